//! What every ROS 2 node has beside its topics: parameters, type descriptions, log, clock.
//!
//! ```text
//!   ~/describe_parameters … ~/set_parameters_atomically ─┐         ┌─▶ ParameterStore ─▶ watches
//!   ~/get_type_description ──────────────────────────────┤ thread ─┼─▶ TypeDescriptions
//!   /clock, while use_sim_time ──────────────────────────┘         └─▶ RosTime
//!   /parameter_events, /rosout ◀── the same thread ◀── what changed, LogLine
//! ```
//!
//! One thread serves them all; it sleeps until something arrives. The logic is in [`crate::node`].

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use bytes::Bytes;
use wrapyfi_interfaces::cdr::{CdrError, CdrParts};
use wrapyfi_interfaces::rcl_interfaces::msg::{Log, ParameterEvent};
use wrapyfi_interfaces::rosgraph_msgs::msg::Clock;
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_interfaces::type_description_interfaces::srv::GetTypeDescription;
use wrapyfi_interfaces::{Message, Service};

use super::any::ringing;
use super::graph::{
    CdrReader, CdrWriter, Graph, GraphError, Notify, ServiceDescription, TopicDescription,
};
use super::node_handle::{NodeHandle, Shared};
use super::service::LOOK_AGAIN;
use super::service::replies::{Replies, Reply};
use crate::endpoint::{Durability, History, Qos, Reliability};
use crate::node::parameters::{ParameterService, ParameterStore, ParameterWatch};
use crate::node::type_description::TypeDescriptions;
use crate::node::{LogLine, ParameterValue, RosTime};

/// Longest request, reply, event or log line.
const MAX_BYTES: usize = 32 << 20;
/// How long a client may take to hear its reply.
const PATIENCE: Duration = Duration::from_secs(5);
/// Replies kept for clients that do not hear yet, of one service.
const MAX_KEPT: usize = 64;
/// Requests answered before others have their turn.
const BATCH: usize = 32;
/// Longest sleep; nothing depends on it but the end of a reply's time.
const NAP: Duration = Duration::from_secs(1);

/// The endpoints of a node beside its topics, as long as it lives.
pub struct NodeEndpoints {
    handle: NodeHandle,
    leave: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl NodeEndpoints {
    /// Offers them on `graph`, in the order in which `rclpy` does.
    ///
    /// A service that the DDS stack refuses is missing, which is logged: the node has its topics all
    /// the same.
    ///
    /// # Errors
    /// When the DDS stack refuses one of the topics, or there can be no thread.
    pub fn start(graph: &Arc<dyn Graph>, mut store: ParameterStore) -> Result<Self, GraphError> {
        let node = graph.node().fqn();
        let simulated = store.get("use_sim_time").ok() == Some(&ParameterValue::Bool(true));
        let describes =
            store.get("start_type_description_service").ok() == Some(&ParameterValue::Bool(true));
        let wake = crate::endpoint::Wake::new();
        let watch = store.watch(&["use_sim_time"], &wake);
        let shared = Arc::new(Shared::new(store, RosTime::new(simulated), wake));
        let bell = || ringing(&shared.wake);
        let topic = |name: &str, qos| topic::<Log>(name, qos);
        let rosout = graph.advertise(&topic(LogLine::TOPIC, rosout_qos()), bell())?;
        let events = topic_of_events();
        let events = graph.advertise(&events, bell())?;
        let mut servers = Vec::new();
        for service in ParameterService::ALL {
            let (request, response) = service.hashes();
            let name = format!("{node}/{}", service.name());
            let depth = ParameterService::DEPTH;
            let described = description(&name, service.type_name(), (request, response), depth);
            let answers = Answers::Parameters(service);
            servers.extend(serve(graph.as_ref(), &described, answers, bell()));
        }
        if describes {
            type S = GetTypeDescription;
            let name = format!("{node}/{}", TypeDescriptions::SERVICE);
            let hashes = (<S as Service>::Request::TYPE_HASH, <S as Service>::Response::TYPE_HASH);
            let described = description(&name, S::ROS_TYPE, hashes, TypeDescriptions::DEPTH);
            servers.extend(serve(graph.as_ref(), &described, Answers::Types, bell()));
        }
        let leave = Arc::new(AtomicBool::new(false));
        let mut work = Work {
            shared: Arc::clone(&shared),
            graph: Arc::clone(graph),
            rosout,
            events,
            servers,
            clock: None,
            watch,
        };
        if describes {
            work.describe_own_types();
        }
        work.follow_clock();
        let told = Arc::clone(&leave);
        let thread = std::thread::Builder::new()
            .name("wrapyfi node".into())
            .spawn(move || work.run(&told))
            .map_err(|error| GraphError::Stack {
                operation: "starting a thread",
                topic: node,
                reason: error.to_string(),
            })?;
        Ok(Self { handle: NodeHandle(shared), leave, thread: Some(thread) })
    }

    /// The node as the rest of the program uses it.
    #[must_use]
    pub fn handle(&self) -> &NodeHandle {
        &self.handle
    }
}

impl Drop for NodeEndpoints {
    fn drop(&mut self) {
        self.leave.store(true, Relaxed);
        self.handle.0.wake.ring();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the node's thread panicked");
        }
    }
}

/// What a service is answered from.
enum Answers {
    Parameters(ParameterService),
    Types,
}

struct Work {
    shared: Arc<Shared>,
    graph: Arc<dyn Graph>,
    rosout: Box<dyn CdrWriter>,
    events: Box<dyn CdrWriter>,
    servers: Vec<(Answers, Replies)>,
    clock: Option<Box<dyn CdrReader>>,
    watch: ParameterWatch,
}

impl Work {
    fn run(&mut self, leave: &AtomicBool) {
        // What this thread says about itself must not come back as work.
        super::node_handle::in_node_thread();
        while !leave.load(Relaxed) {
            let more = self.answer();
            self.follow_changes();
            self.read_clock();
            self.publish();
            if !more {
                let kept = self.servers.iter().any(|(_, replies)| replies.kept() > 0);
                self.shared.wake.wait(if kept { LOOK_AGAIN } else { NAP });
            }
        }
        self.publish();
    }

    /// Answers what has arrived; true when more may wait.
    fn answer(&mut self) -> bool {
        let mut more = false;
        let mut servers = std::mem::take(&mut self.servers);
        for (answers, replies) in &mut servers {
            replies.flush();
            let mut left = BATCH;
            while left > 0 {
                left -= 1;
                let request = match replies.take() {
                    Ok(Some(request)) => request,
                    Ok(None) => break,
                    Err(error) => {
                        self.shared.count_refused();
                        tracing::warn!(%error, "a request to the node was refused");
                        if matches!(error, GraphError::Stack { .. }) {
                            break;
                        }
                        continue;
                    }
                };
                match answers.answer(&self.shared, &request.cdr) {
                    Ok(parts) => {
                        // Who set use_sim_time finds it in force when the reply is there.
                        self.follow_changes();
                        let until = Instant::now() + PATIENCE;
                        let reply = Reply { id: request.id, cdr: parts.to_bytes(), until };
                        if let Err(error) = replies.send(reply) {
                            tracing::warn!(%error, "the node's reply was not sent");
                        }
                    }
                    Err(error) => {
                        self.shared.count_refused();
                        tracing::warn!(%error, "a request to the node is not of its type");
                    }
                }
            }
            more |= left == 0;
        }
        self.servers = servers;
        more
    }

    /// Publishes what changed and what was logged.
    fn publish(&mut self) {
        let stamp = self.shared.now();
        let changed = self.shared.store().take_events(stamp);
        for event in changed {
            send(self.events.as_mut(), &event.encode());
        }
        for (stamp, line) in self.shared.take_lines() {
            send(self.rosout.as_mut(), &line.to_message(stamp).encode());
        }
    }

    /// As nodes of ROS 2 do, also for the types of what every node has.
    fn describe_own_types(&self) {
        let mut store = TypeStore::generated();
        let mut types = self.shared.types();
        let services = ParameterService::ALL.map(ParameterService::type_name);
        let others = [Log::ROS_TYPE, ParameterEvent::ROS_TYPE, GetTypeDescription::ROS_TYPE];
        for name in others.iter().chain(&services) {
            if let Err(error) = types.add_named(&mut store, name) {
                tracing::error!(%error, "a type of the node is not described");
            }
        }
    }

    fn follow_changes(&mut self) {
        if !self.watch.take().is_empty() {
            self.follow_clock();
        }
    }

    /// Listens to `/clock` exactly while `use_sim_time` is true.
    fn follow_clock(&mut self) {
        let value = self.shared.store().get("use_sim_time").ok().cloned();
        let simulated = value == Some(ParameterValue::Bool(true));
        self.shared.set_simulated(simulated);
        if !simulated {
            self.clock = None;
        } else if self.clock.is_none() {
            match self.graph.subscribe(&topic_of_clock(), ringing(&self.shared.wake)) {
                Ok(reader) => self.clock = Some(reader),
                Err(error) => tracing::error!(%error, "simulated time stands still"),
            }
        }
    }

    fn read_clock(&mut self) {
        let Some(reader) = &mut self.clock else { return };
        loop {
            match reader.take() {
                Ok(Some(sample)) => match Clock::decode(&sample.cdr, MAX_BYTES) {
                    Ok(clock) => self.shared.on_clock(&clock),
                    Err(error) => tracing::warn!(%error, "{} is not readable", RosTime::TOPIC),
                },
                Ok(None) => return,
                Err(error) => {
                    tracing::warn!(%error, "{}", RosTime::TOPIC);
                    // What is too large is gone, and nothing rings again for what is behind it.
                    if !matches!(error, GraphError::TooLarge { .. }) {
                        return;
                    }
                }
            }
        }
    }
}

impl Answers {
    fn answer(&self, shared: &Shared, request: &Bytes) -> Result<CdrParts, CdrError> {
        match self {
            Self::Parameters(service) => shared.store().answer(*service, request, MAX_BYTES),
            Self::Types => shared.types().answer_cdr(request, MAX_BYTES),
        }
    }
}

fn send(writer: &mut dyn CdrWriter, message: &CdrParts) {
    let parts: Vec<&[u8]> = message.pieces().iter().map(AsRef::as_ref).collect();
    // What is told here is for whoever listens; nothing of the node depends on it.
    if let Err(error) = writer.write(&parts) {
        tracing::debug!(%error, "the node's message was not sent");
    }
}

/// One service of the node, where the DDS stack does not refuse it.
fn serve(
    graph: &dyn Graph,
    described: &ServiceDescription,
    answers: Answers,
    bell: Notify,
) -> Option<(Answers, Replies)> {
    match graph.server(described, bell) {
        Ok(server) => Some((answers, Replies::new(server, &described.name, MAX_KEPT))),
        Err(error) => {
            tracing::error!(%error, "the node has no {}", described.name);
            None
        }
    }
}

fn description(
    name: &str,
    type_name: &str,
    (request, response): (&str, &str),
    depth: u32,
) -> ServiceDescription {
    ServiceDescription {
        name: name.to_owned(),
        type_name: type_name.to_owned(),
        request_hash: Some(request.to_owned()),
        response_hash: Some(response.to_owned()),
        depth,
        max_bytes: MAX_BYTES,
    }
}

fn topic<M: Message>(name: &str, qos: Qos) -> TopicDescription {
    TopicDescription {
        name: name.to_owned(),
        type_name: M::ROS_TYPE.to_owned(),
        type_hash: Some(M::TYPE_HASH.to_owned()),
        qos,
        max_bytes: MAX_BYTES,
    }
}

fn topic_of_events() -> TopicDescription {
    topic::<ParameterEvent>(
        "/parameter_events",
        Qos { history: History::KeepLast(1000), ..Qos::default() },
    )
}

fn topic_of_clock() -> TopicDescription {
    let reliability = Reliability::BestEffort;
    let qos = Qos { reliability, history: History::KeepLast(1), ..Qos::default() };
    topic::<Clock>(RosTime::TOPIC, qos)
}

fn rosout_qos() -> Qos {
    Qos {
        durability: Durability::TransientLocal,
        history: History::KeepLast(LogLine::DEPTH),
        lifespan: Some(LogLine::LIFESPAN),
        ..Qos::default()
    }
}
