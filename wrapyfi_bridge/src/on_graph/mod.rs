//! Topics and services by which a running bridge tells the graph about itself.
//!
//! ```text
//!   Applier::status ─┬─ once a second ─▶ /diagnostics    OK, WARN, ERROR, STALE per route and middleware
//!                    ├─ once a second ─▶ ~/status        state of the life cycle, RouteInfo[]
//!                    ├─ ~/list_routes ─▶ RouteInfo[]
//!                    └─ ~/explain ─────▶ why, from where the bridge runs (a thread of its own)
//!
//!   circles       what each bridge carries, and the circles that it would make
//!   client        asks a bridge elsewhere
//!   diagnostics   statuses -> DiagnosticArray
//!   lifecycle     the services of a managed node, and ~/transition_event
//!   info          a status -> RouteInfo, a diagnosis -> Explain_Response, and back
//!   duplicate_nodes     other bridges of the same node name
//! ```
//!
//! No bridge by pattern carries these endpoints anywhere: their mark says that they have been everywhere, and
//! services, of which the mapping of Fast DDS shows no mark, are left out by name. A bridge's own are left out by
//! address, because discovery does not list them to it.

pub(crate) mod circles;
pub mod client;
pub mod diagnostics;
mod duplicate_nodes;
pub mod info;
pub mod lifecycle;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, Sender, SyncSender, TrySendError, channel, sync_channel};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use wrapyfi_data::types::{
    MessageType, Payload, RosMessage, RosService, RosType, ServiceKind, Value,
};
use wrapyfi_endpoint::{
    BridgeMark, Context, Durability, EndpointAddress, History, IncomingRequest, Publisher, Qos,
    Registry, RequestId, Server, ServiceSpec, Throttle, TopicSpec, Wake,
};
use wrapyfi_engine::RouteStatus;
use wrapyfi_interfaces::builtin_interfaces::msg::Time;
use wrapyfi_interfaces::diagnostic_msgs::msg::DiagnosticArray;
use wrapyfi_interfaces::std_msgs::msg::Header;
use wrapyfi_interfaces::wrapyfi_msgs::msg::{BridgeStatus, RouteInfo};
use wrapyfi_interfaces::wrapyfi_msgs::srv::{
    Explain, Explain_Response, ListRoutes, ListRoutes_Response,
};
use wrapyfi_interfaces::{Message, Service};
use wrapyfi_retry::contained;
use wrapyfi_retry::thread::restarted;
use wrapyfi_ros2::NodeHandle;

use self::circles::Circles;
use self::diagnostics::Diagnostics;
use self::duplicate_nodes::DuplicateNodes;
use self::info::{is_destination, is_source};
use crate::exit::Result;
use crate::in_force::Running;
use crate::lifecycle::{Lifecycle, State};
use crate::middlewares;
use crate::node::{GRAPH, Node};
use crate::why::Diagnosis;
use crate::why::bridges::not_active;
use crate::why::judge::judge;

/// Time between two diagnostics.
const EVERY: Duration = Duration::from_secs(1);
/// Most questions that wait while one is answered.
const MAX_WAITING: usize = 16;
/// Longest time that the end of the program waits for a publication.
const STOP_WITHIN: Duration = Duration::from_millis(500);

/// A bridge that runs, as its endpoints need it.
#[derive(Clone)]
pub struct Parts {
    /// The bridge.
    pub bridge: Running,
    /// Handle of the node on the graph.
    pub handle: NodeHandle,
    /// State of the node.
    pub lifecycle: Lifecycle,
}

/// Topics and services that a bridge has about itself; dropping it closes them.
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
    pub fn start(parts: Parts) -> Result<Self> {
        let wake = parts.lifecycle.changes().clone();
        let (context, stop) =
            (Context { wake, ..Context::default() }, Arc::<AtomicBool>::default());
        let (node, registry) = (&parts.bridge.node, parts.bridge.routes.registry());
        let own = Advertise {
            node,
            number: parts.bridge.routes.number(),
            registry: &registry,
            context: &context,
        };
        let diagnostics = own.open::<DiagnosticArray>("/diagnostics", Qos::default());
        // Who comes late has the latest at once.
        let latched = Qos {
            durability: Durability::TransientLocal,
            history: History::KeepLast(1),
            ..Qos::default()
        };
        let (ask, asked) = sync_channel(MAX_WAITING);
        let (tell, answers) = channel();
        let work = Work {
            diagnostics: diagnostics.map(|topic| (topic, Diagnostics::new(node.name().fqn()))),
            status: own.open::<BridgeStatus>("~/status", latched),
            told: None,
            list: own.offer::<ListRoutes>("list_routes"),
            explain: own.offer::<Explain>("explain"),
            circles: Circles::new(&own, latched),
            duplicate_nodes: DuplicateNodes::new(node, &registry),
            parts: parts.clone(),
            ask,
            answers,
        };
        drop(registry);
        let wake = context.wake.clone();
        let (alive, ended) = channel::<()>();
        let explaining = alive.clone();
        let thread = std::thread::Builder::new().name("explain".to_owned());
        // It ends with the sender of questions, at the latest after the one that it answers.
        let started = thread.spawn(move || {
            let _alive = explaining;
            let parts = parts;
            answer_all(&parts, &asked, &tell, &wake);
        });
        started.context("cannot answer ~/explain")?;
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
                let (mut next, mut told) = (Instant::now() + EVERY, work.parts.lifecycle.state());
                while !leave.load(Relaxed) {
                    let state = work.parts.lifecycle.state();
                    let is_new = state != told && state.is_primary();
                    if is_new || Instant::now() >= next {
                        told = state;
                        work.publish();
                        // A thread that was held up makes up for nothing.
                        next = (next + EVERY).max(Instant::now());
                    }
                    work.circles.look(&work.parts.bridge);
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

/// A service that the node offers.
pub(crate) struct Offered {
    server: Box<dyn Server>,
    /// Type of the replies.
    response: RosType,
    refusals: Throttle,
}

impl Offered {
    /// The next request; of those that are refused, as those of another RMW's mapping are, the log tells. A server that
    /// fails each time is left until the thread wakes again.
    pub(crate) fn next(&mut self) -> Option<IncomingRequest> {
        for _ in 0..MAX_WAITING {
            match self.server.take() {
                Ok(next) => return next,
                Err(error) => {
                    if let Some(unlogged_before) = self.refusals.pass(Instant::now()) {
                        tracing::warn!(unlogged_before, "refused a request: {error}");
                    }
                }
            }
        }
        None
    }

    fn tell(&mut self, id: RequestId, reply: &impl Message) {
        self.answer(id, message(self.response, reply));
    }

    /// Answers a request.
    pub(crate) fn answer(&mut self, id: RequestId, reply: Payload) {
        if let Err(error) = self.server.reply(id, Ok(reply)) {
            tracing::warn!("a request was not answered: {error}");
        }
    }
}

/// Topic that the node publishes, and the type of its messages.
struct Topic {
    name: &'static str,
    publisher: Box<dyn Publisher>,
    ros_type: RosType,
}

impl Topic {
    fn has_readers(&self) -> bool {
        self.publisher.link().has_peers()
    }

    fn publish(&mut self, fields: &impl Message) {
        if let Err(error) = self.publisher.publish(&message(self.ros_type, fields)) {
            tracing::debug!(%error, "{}", self.name);
        }
    }
}

/// Work of the thread.
struct Work {
    parts: Parts,
    diagnostics: Option<(Topic, Diagnostics)>,
    status: Option<Topic>,
    /// State of the node and of the routes at the last publication, or the last one that was left out because it was the same.
    told: Option<(State, Vec<RouteStatus>)>,
    list: Option<Offered>,
    explain: Option<Offered>,
    circles: Circles,
    duplicate_nodes: Option<DuplicateNodes>,
    /// Questions for the thread that answers them, and its answers.
    ask: SyncSender<(RequestId, String)>,
    answers: Receiver<(RequestId, Explain_Response)>,
}

impl Work {
    fn publish(&mut self) {
        if let Some(duplicate_nodes) = &mut self.duplicate_nodes {
            duplicate_nodes.look(Instant::now());
        }
        let Parts { bridge, handle, lifecycle } = &self.parts;
        let (routes, now) = (bridge.routes.status(), handle.now());
        let seen = (lifecycle.state(), routes);
        // The latest is kept for those who come late: while nobody reads, it is made anew only where it differs.
        if let Some(status) = &mut self.status
            && (status.has_readers() || self.told.as_ref() != Some(&seen))
        {
            let stamp = Time { sec: now.sec, nanosec: now.nanosec };
            status.publish(&BridgeStatus {
                header: Header { stamp, frame_id: String::new() },
                state: seen.0.label().to_owned(),
                routes: info::of_all(&seen.1, &bridge.node),
            });
        }
        if let Some((topic, diagnostics)) = &mut self.diagnostics {
            let at = Instant::now();
            if topic.has_readers() {
                let away = middlewares::wait_causes(&bridge.routes.registry());
                topic.publish(&diagnostics.of(&seen.1, &away, now, at));
            } else {
                diagnostics.note(&seen.1, at);
            }
        }
        self.told = Some(seen);
    }

    fn answer(&mut self) {
        if let Some(list) = &mut self.list {
            while let Some(asked) = list.next() {
                let routes = self.parts.bridge.infos();
                list.tell(asked.id, &ListRoutes_Response { routes });
            }
        }
        let Some(explain) = &mut self.explain else { return };
        while let Some(IncomingRequest { id, request, .. }) = explain.next() {
            let call = request.into_call().unwrap_or_default();
            let name = call.kwargs.get("name").and_then(Value::as_str).unwrap_or_default();
            let name = name.to_owned();
            if let Err(TrySendError::Full((id, name)) | TrySendError::Disconnected((id, name))) =
                self.ask.try_send((id, name))
            {
                let what = format!("{MAX_WAITING} questions wait already: ask again for {name}");
                let busy = Explain_Response { what, ..Explain_Response::default() };
                explain.tell(id, &busy);
            }
        }
        for (id, reply) in self.answers.try_iter() {
            explain.tell(id, &reply);
        }
    }
}

/// Answers questions until none can come any more.
fn answer_all(
    parts: &Parts,
    asked: &Receiver<(RequestId, String)>,
    tell: &Sender<(RequestId, Explain_Response)>,
    wake: &Wake,
) {
    while let Ok((id, name)) = asked.recv() {
        let answer = contained(|| {
            let Parts { bridge, lifecycle, .. } = parts;
            let state = lifecycle.state();
            if state != State::Active {
                let finding = Some(not_active(state, &bridge.node.name().fqn(), None));
                let diagnosis = Diagnosis { way: name.clone(), passed: Vec::new(), finding };
                return Ok(info::explained(&diagnosis, meant(&name, &name, bridge.infos())));
            }
            let way = bridge.explain(&name).map_err(|failure| failure.to_string())?;
            Ok(info::explained(&judge(&way), meant(&way.title, &name, bridge.infos())))
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
fn meant(title: &str, name: &str, mut all: Vec<RouteInfo>) -> Vec<RouteInfo> {
    all.retain(|one| {
        one.key == title
            || title.starts_with(&format!("{}: ", one.key))
            || one.key == name
            || is_source(one, name)
            || is_destination(one, name)
    });
    all
}

fn message(ros_type: RosType, message: &impl Message) -> Payload {
    Payload::RosMessage(RosMessage::new(ros_type, message.encode()))
}

/// Addresses of what the bridge of a node has about itself, but for topics that it shares with other nodes.
pub fn own_addresses(node: &Node) -> Vec<EndpointAddress> {
    let topics =
        ["status", "transition_event"].iter().map(|it| node.resolve_topic(&format!("~/{it}")));
    let services = middlewares::NODE_SERVICES.iter().copied().flatten();
    let services = services.map(|it| node.resolve_service(&format!("~/{it}")));
    let names = topics.chain(services).flatten();
    names.map(|name| EndpointAddress { middleware: GRAPH.to_owned(), name }).collect()
}

/// Mark of what no bridge by pattern carries anywhere: it has been everywhere. Other bridges see by it who began first.
fn mark(bridge: u64) -> Option<BridgeMark> {
    let path = middlewares::names().iter().map(|&name| name.to_owned()).collect();
    Some(BridgeMark { bridge, path })
}

/// Opens topics and services of a node.
pub(crate) struct Advertise<'n> {
    pub(crate) node: &'n Node,
    /// Number of the bridge.
    pub(crate) number: u64,
    pub(crate) registry: &'n Registry,
    pub(crate) context: &'n Context,
}

impl Advertise<'_> {
    /// Opens a publisher of messages `M`.
    fn open<M: Message>(&self, name: &'static str, qos: Qos) -> Option<Topic> {
        let opened = || -> anyhow::Result<_> {
            let ros_type = RosType::of::<M>()?;
            let spec = TopicSpec::new(self.node.resolve_topic(name)?, MessageType::Ros(ros_type));
            let spec = TopicSpec { mark: mark(self.number), qos, ..spec };
            let publisher = self.registry.get(GRAPH)?.open_publisher(&spec, self.context)?;
            Ok(Topic { name, publisher, ros_type })
        };
        opened().inspect_err(|why| tracing::warn!("{name} is not published: {why}")).ok()
    }

    /// Offers a service of type `S`.
    pub(crate) fn offer<S: Service>(&self, service: &str) -> Option<Offered> {
        let opened = || -> anyhow::Result<_> {
            let known = RosService::of::<S>()?;
            let name = self.node.resolve_service(&format!("~/{service}"))?;
            let spec = ServiceSpec::new(name, ServiceKind::Ros(known));
            let spec = ServiceSpec { mark: mark(self.number), ..spec };
            let server = self.registry.get(GRAPH)?.open_server(&spec, self.context)?;
            Ok(Offered { server, response: known.response(), refusals: Throttle::default() })
        };
        opened().inspect_err(|why| tracing::warn!("~/{service} is not offered: {why}")).ok()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicUsize;

    use wrapyfi_endpoint::{Link, Refusal, ServeError};

    use super::*;

    /// A server that takes no request any more, and the number of tries.
    struct Failing(Arc<AtomicUsize>);

    impl Server for Failing {
        fn take(&mut self) -> Result<Option<IncomingRequest>, ServeError> {
            self.0.fetch_add(1, Relaxed);
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
        let tries = Arc::<AtomicUsize>::default();
        let response = RosType::of::<Explain_Response>().unwrap();
        let server = Box::new(Failing(Arc::clone(&tries)));
        let mut offered = Offered { server, response, refusals: Throttle::default() };
        assert!(offered.next().is_none());
        assert_eq!(tries.load(Relaxed), MAX_WAITING);
    }
}
