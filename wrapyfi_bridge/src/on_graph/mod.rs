//! What a running bridge says of itself on the graph.
//!
//! ```text
//!   Applier::status ─┬─ once a second ─▶ /diagnostics    OK, WARN, ERROR, STALE per route and middleware
//!                    ├─ ~/list_routes ─▶ RouteInfo[]
//!                    └─ ~/explain ─────▶ why, from where the bridge runs (a thread of its own)
//!
//!   client        asks a bridge elsewhere
//!   diagnostics   statuses -> DiagnosticArray
//!   info          a status -> RouteInfo, a verdict -> Explain_Response, and back
//! ```
//!
//! No bridge by pattern carries these endpoints anywhere: their mark says that they have been everywhere.

pub mod client;
pub mod diagnostics;
pub mod info;

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, Sender, SyncSender, TrySendError, channel, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use wrapyfi_core::endpoint::{
    BridgeMark, Context, IncomingRequest, Publisher, Registry, RequestId, Server, ServiceSpec,
    TopicSpec, Wake,
};
use wrapyfi_core::engine::{Applier, RouteStatus};
use wrapyfi_core::middleware::ros2::NodeHandle;
use wrapyfi_core::types::{MessageType, Payload, RosMessage, RosType, ServiceKind, Value};
use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::diagnostic_msgs::msg::DiagnosticArray;
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_interfaces::wrapyfi_msgs::srv::{Explain_Response, ListRoutes_Response};
use wrapyfi_retry::contained;
use wrapyfi_retry::thread::restarted;

use self::diagnostics::Diagnostics;
use crate::exit::Failure;
use crate::in_force::InForce;
use crate::middlewares;
use crate::node::Node;
use crate::why::judge::judge;
use crate::why::question::explain;

/// Time between two diagnostics.
const EVERY: Duration = Duration::from_secs(1);
/// Most questions that wait while one is answered.
const MAX_WAITING: usize = 16;
/// Longest time that the end of the program waits for a publication.
const STOP_WITHIN: Duration = Duration::from_millis(500);

/// A bridge that runs, as its endpoints need it.
pub struct Parts {
    /// The bridge's node.
    pub node: Node,
    /// Handle of the node on the graph.
    pub handle: NodeHandle,
    /// The routes.
    pub routes: Applier,
    /// Settings beside the routes.
    pub in_force: Arc<Mutex<InForce>>,
}

/// The endpoints. They end when it is dropped.
pub struct OnGraph {
    stop: Arc<AtomicBool>,
    wake: Wake,
    /// Closed once both threads have ended.
    ended: Receiver<()>,
}

impl OnGraph {
    /// Begins to publish, and to answer. An endpoint that the middleware refuses is missing, which is logged.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn start(parts: Parts) -> Result<Self, Failure> {
        let (context, stop) = (Context::default(), Arc::<AtomicBool>::default());
        let registry = parts.routes.registry();
        let diagnostics = publisher(&registry, &context);
        let diagnostics = diagnostics.map(|(publisher, ros_type)| {
            (publisher, ros_type, Diagnostics::new(parts.node.name().fqn()))
        });
        let list = offer::<ListRoutes_Response>(&parts.node, &registry, &context, "list_routes");
        let explain = offer::<Explain_Response>(&parts.node, &registry, &context, "explain");
        drop(registry);
        let (ask, asked) = sync_channel(MAX_WAITING);
        let (tell, told) = channel();
        let (routes, wake) = (parts.routes.clone(), context.wake.clone());
        let handle = parts.handle.clone();
        let (alive, ended) = channel::<()>();
        let explaining = alive.clone();
        let thread = std::thread::Builder::new().name("explain".to_owned());
        // It ends with the sender of questions, at the latest after the one that it answers.
        let started = thread.spawn(move || {
            let _alive = explaining;
            answer_all(&parts, &asked, &tell, &wake);
        });
        started.context("cannot answer ~/explain")?;
        let work = Work { routes, handle, diagnostics, list, explain, ask, told };
        let (leave, wake) = (Arc::clone(&stop), context.wake.clone());
        let thread = std::thread::Builder::new().name("on-graph".to_owned());
        let started = thread.spawn(move || {
            // Dropped last: the endpoints are closed when its end is seen.
            let _alive = alive;
            let mut work = work;
            let pause = |time| {
                wake.wait(time);
                !leave.load(Relaxed)
            };
            restarted("the thread of /diagnostics", pause, || {
                let mut next = Instant::now() + EVERY;
                while !leave.load(Relaxed) {
                    if Instant::now() >= next {
                        work.publish();
                        // A thread that was held up makes up for nothing.
                        next = (next + EVERY).max(Instant::now());
                    }
                    work.answer();
                    wake.wait(next.saturating_duration_since(Instant::now()));
                }
            });
        });
        started.context("cannot publish /diagnostics")?;
        Ok(Self { stop, wake: context.wake, ended })
    }
}

impl Drop for OnGraph {
    fn drop(&mut self) {
        self.stop.store(true, Relaxed);
        self.wake.ring();
        // They send nothing, and are gone or left in the middle of a publication or an answer.
        _ = self.ended.recv_timeout(STOP_WITHIN);
    }
}

/// A server, and the type of its replies.
type Offered = (Box<dyn Server>, RosType);

/// Work of the thread.
struct Work {
    routes: Applier,
    handle: NodeHandle,
    diagnostics: Option<(Box<dyn Publisher>, RosType, Diagnostics)>,
    list: Option<Offered>,
    explain: Option<Offered>,
    /// Questions for the thread that answers them, and its answers.
    ask: SyncSender<(RequestId, String)>,
    told: Receiver<(RequestId, Explain_Response)>,
}

impl Work {
    fn publish(&mut self) {
        let Some((publisher, ros_type, diagnostics)) = &mut self.diagnostics else { return };
        let registry = self.routes.registry();
        let away = middlewares::names().into_iter().filter_map(|name| {
            let middleware = registry.get(name).ok()?;
            Some((name, middleware.ended().or_else(|| middleware.waiting_for())))
        });
        let away: Vec<_> = away.collect();
        drop(registry);
        let array: DiagnosticArray =
            diagnostics.of(&self.routes.status(), &away, self.handle.now(), Instant::now());
        if let Err(error) = publisher.publish(&message(*ros_type, &array)) {
            tracing::debug!(%error, "/diagnostics");
        }
    }

    fn answer(&mut self) {
        if let Some((server, response)) = &mut self.list {
            while let Some(asked) = next(server.as_mut()) {
                let routes = self.routes.status().iter().map(info::of).collect();
                let reply = ListRoutes_Response { routes };
                tell(server.as_mut(), asked.id, *response, &reply);
            }
        }
        let Some((server, response)) = &mut self.explain else { return };
        while let Some(IncomingRequest { id, request, .. }) = next(server.as_mut()) {
            let call = request.into_call().unwrap_or_default();
            let name = call.kwargs.get("name").and_then(Value::as_str).unwrap_or_default();
            let name = name.to_owned();
            if let Err(TrySendError::Full((id, name)) | TrySendError::Disconnected((id, name))) =
                self.ask.try_send((id, name))
            {
                let what = format!("{MAX_WAITING} questions wait already: ask again for {name}");
                let busy = Explain_Response { what, ..Explain_Response::default() };
                tell(server.as_mut(), id, *response, &busy);
            }
        }
        for (id, reply) in self.told.try_iter() {
            tell(server.as_mut(), id, *response, &reply);
        }
    }
}

/// Answers questions until nobody asks any more.
fn answer_all(
    parts: &Parts,
    asked: &Receiver<(RequestId, String)>,
    tell: &Sender<(RequestId, Explain_Response)>,
    wake: &Wake,
) {
    while let Ok((id, name)) = asked.recv() {
        let answer = contained(|| {
            let Parts { node, routes, in_force, .. } = parts;
            let way =
                explain(node, routes, in_force, &name).map_err(|failure| failure.to_string())?;
            Ok(info::explained(&judge(&way), &meant(&way.title, &name, &parts.routes.status())))
        });
        let reply = answer
            .flatten()
            .unwrap_or_else(|what| Explain_Response { what, ..Explain_Response::default() });
        if tell.send((id, reply)).is_err() {
            return;
        }
        wake.ring();
    }
}

/// Routes that a name means, for their counters.
fn meant(title: &str, name: &str, all: &[RouteStatus]) -> Vec<RouteStatus> {
    let is_meant = |one: &&RouteStatus| {
        one.name == title
            || title.starts_with(&format!("{}: ", one.name))
            || [&one.name, &one.from, &one.to].contains(&&name.to_owned())
    };
    all.iter().filter(is_meant).cloned().collect()
}

/// The next request; unusable ones are passed over. A server that fails each time is left until the thread
/// wakes again.
fn next(server: &mut dyn Server) -> Option<IncomingRequest> {
    for _ in 0..MAX_WAITING {
        match server.take() {
            Ok(next) => return next,
            Err(error) => tracing::debug!(%error, "a request was passed over"),
        }
    }
    None
}

fn tell(server: &mut dyn Server, id: RequestId, response: RosType, reply: &impl Message) {
    if let Err(error) = server.reply(id, Ok(message(response, reply))) {
        tracing::debug!(%error, "a reply was not sent");
    }
}

fn message(ros_type: RosType, message: &impl Message) -> Payload {
    Payload::RosMessage(RosMessage::new(ros_type, message.encode().to_bytes()))
}

/// Mark of what no bridge by pattern carries anywhere: it has been everywhere.
fn mark() -> Option<BridgeMark> {
    let path = middlewares::names().into_iter().map(str::to_owned).collect();
    Some(BridgeMark { bridge: BridgeMark::number(), path })
}

/// Publisher of `/diagnostics`.
fn publisher(registry: &Registry, context: &Context) -> Option<(Box<dyn Publisher>, RosType)> {
    let opened = || -> Result<_, String> {
        let resolved = TypeStore::generated().resolve_name(DiagnosticArray::ROS_TYPE);
        let ros_type = RosType::new(&resolved.map_err(|error| error.to_string())?);
        let ros_type = ros_type.map_err(|error| error.to_string())?;
        let spec = TopicSpec::new("/diagnostics", MessageType::Ros(ros_type));
        let spec = TopicSpec { mark: mark(), ..spec };
        let ros2 = registry.get("ros2").map_err(|error| error.to_string())?;
        let publisher = ros2.open_publisher(&spec, context).map_err(|error| error.to_string())?;
        Ok((publisher, ros_type))
    };
    opened().inspect_err(|why| tracing::warn!("/diagnostics is not published: {why}")).ok()
}

/// Offers a service of the node, whose replies are of type `R`.
fn offer<R: Message>(
    node: &Node,
    registry: &Registry,
    context: &Context,
    service: &str,
) -> Option<Offered> {
    let opened = || -> Result<_, String> {
        let type_name = R::ROS_TYPE.trim_end_matches("_Response");
        let kind = ServiceKind::resolve(type_name, &mut TypeStore::generated());
        let ServiceKind::Ros(known) = kind.map_err(|error| error.to_string())? else {
            return Err(format!("{type_name} is not what it was"));
        };
        let name = node.resolve_service(&format!("~/{service}"));
        let name = name.map_err(|error| error.to_string())?;
        let ros2 = registry.get("ros2").map_err(|error| error.to_string())?;
        let spec = ServiceSpec::new(name, ServiceKind::Ros(known));
        let server = ros2.open_server(&ServiceSpec { mark: mark(), ..spec }, context);
        Ok((server.map_err(|error| error.to_string())?, known.response()))
    };
    opened().inspect_err(|why| tracing::warn!("~/{service} is not offered: {why}")).ok()
}

#[cfg(test)]
mod tests {
    use wrapyfi_core::endpoint::{Link, Refusal, ServeError};

    use super::*;

    /// A server that takes no request any more, and the number of tries.
    struct Failing(usize);

    impl Server for Failing {
        fn take(&mut self) -> Result<Option<IncomingRequest>, ServeError> {
            self.0 += 1;
            Err(ServeError::Overloaded { service: "/explain".to_owned(), limit: 1 })
        }

        fn reply(
            &mut self,
            _: RequestId,
            _: Result<Payload, Refusal>,
        ) -> Result<usize, ServeError> {
            Ok(0)
        }

        fn deadline(&self) -> Option<Instant> {
            None
        }

        fn link(&self) -> Link {
            Link::default()
        }
    }

    #[test]
    fn a_server_that_fails_each_time_does_not_keep_the_thread() {
        let mut server = Failing(0);
        assert!(next(&mut server).is_none());
        assert_eq!(server.0, MAX_WAITING);
    }
}
