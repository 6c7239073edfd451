//! Endpoints of every ROS 2 node beside its topics: parameters, type descriptions, log, clock.
//!
//! ```text
//!   ~/describe_parameters … ~/set_parameters_atomically ─┐         ┌─▶ ParameterStore ─▶ watches
//!   ~/get_type_description ──────────────────────────────┤ thread ─┼─▶ TypeDescriptions
//!   ~/get_logger_levels, ~/set_logger_levels ────────────┤         ├─▶ Loggers, where there are
//!   /clock, while use_sim_time ──────────────────────────┘         └─▶ RosTime
//!   /parameter_events, /rosout ◀── the same thread ◀── what changed, LogLine
//! ```
//!
//! One thread serves them all; it sleeps until something arrives. The logic is in [`wrapyfi_node`].

mod work;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::JoinHandle;

use wrapyfi_interfaces::rcl_interfaces::msg::{Log, ParameterEvent};
use wrapyfi_interfaces::rosgraph_msgs::msg::Clock;
use wrapyfi_interfaces::type_description_interfaces::srv::GetTypeDescription;
use wrapyfi_interfaces::{Message, Service, ServiceHashes};

use self::work::{Answers, Served, Topics, Work};
use super::graph::{
    Graph, GraphError, GraphResult, Notify, ServiceDescription, TopicDescription, ringing,
};
use super::node_handle::{NodeHandle, NodeState};
use wrapyfi_endpoint::{Durability, History, Qos, Reliability};
use wrapyfi_node::logger_services::{LoggerService, Loggers};
use wrapyfi_node::parameters::{ParameterService, ParameterStore};
use wrapyfi_node::type_description::TypeDescriptions;
use wrapyfi_node::{LogLine, ParameterValue, RosTime};

/// Longest request, reply, event or log line.
const MAX_BYTES: usize = 32 << 20;

/// The endpoints of a node beside its topics, as long as it lives.
pub struct NodeEndpoints {
    handle: NodeHandle,
    leave: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl NodeEndpoints {
    /// Offers them on `graph`, in the order in which `rclpy` does; the levels of `loggers`, where there are,
    /// can be read and set from outside, as with `enable_logger_service` of rclcpp.
    ///
    /// A service that the DDS stack refuses is missing, which is logged: the node has its topics all
    /// the same.
    ///
    /// # Errors
    /// When the DDS stack refuses one of the topics, or there can be no thread.
    pub fn start(
        graph: &Arc<dyn Graph>,
        mut store: ParameterStore,
        loggers: Option<&Arc<dyn Loggers>>,
    ) -> GraphResult<Self> {
        let node = graph.node().fqn();
        let simulated = store.get("use_sim_time").ok() == Some(&ParameterValue::Bool(true));
        let describes =
            store.get("start_type_description_service").ok() == Some(&ParameterValue::Bool(true));
        let wake = wrapyfi_endpoint::Wake::new();
        let watch = store.watch(&["use_sim_time"], &wake);
        let shared = Arc::new(NodeState::new(store, RosTime::new(simulated), wake));
        let bell = || ringing(&shared.wake);
        let topic = |name: &str, qos| topic::<Log>(name, qos);
        let rosout = graph.advertise(&topic(LogLine::TOPIC, rosout_qos()), bell())?;
        let events = topic_of_events();
        let events = graph.advertise(&events, bell())?;
        let parameters = ParameterService::ALL.map(|service| {
            let (kind, depth) = ((service.type_name(), service.hashes()), ParameterService::DEPTH);
            (service.name(), kind, depth, Answers::Parameters(service))
        });
        let levels = loggers.into_iter().flat_map(|loggers| {
            LoggerService::ALL.map(|service| {
                let (kind, depth) = ((service.type_name(), service.hashes()), LoggerService::DEPTH);
                (service.name(), kind, depth, Answers::Loggers(service, Arc::clone(loggers)))
            })
        });
        let types = describes.then(types_service);
        let offered = parameters.into_iter().chain(types).chain(levels);
        let serve = |(name, kind, depth, answers)| {
            let described = description(&format!("{node}/{name}"), kind, depth);
            match serve(graph.as_ref(), &described, answers, bell()) {
                Ok(served) => Some(served),
                Err(error) => {
                    tracing::error!(%error, "the node has no {}", described.name);
                    None
                }
            }
        };
        let servers: Vec<Served> = offered.filter_map(serve).collect();
        let offers_loggers = loggers.is_some();
        tracing::debug!(%node, services = servers.len(), "parameters, log and clock offered");
        let topics = Some(Topics { rosout, events });
        let mut work = Work::new(&shared, graph, topics, servers, watch);
        if describes {
            work.describe_own_types(offers_loggers);
        }
        work.follow_clock();
        Self::run(work, shared)
    }

    /// Offers the descriptions of types alone, for a node without parameters.
    ///
    /// # Errors
    /// When the DDS stack refuses the service, or there can be no thread.
    pub(super) fn describing(graph: &Arc<dyn Graph>) -> GraphResult<Self> {
        let node = graph.node();
        let store = ParameterStore::new(node, BTreeMap::new());
        let mut store =
            store.map_err(|error| GraphError::stack("describing types", &node.fqn(), &error))?;
        let wake = wrapyfi_endpoint::Wake::new();
        let watch = store.watch(&[], &wake);
        let shared = Arc::new(NodeState::new(store, RosTime::new(false), wake));
        let (name, kind, depth, answers) = types_service();
        let described = description(&format!("{}/{name}", node.fqn()), kind, depth);
        let served = serve(graph.as_ref(), &described, answers, ringing(&shared.wake))?;
        Self::run(Work::new(&shared, graph, None, vec![served], watch), shared)
    }

    /// Starts the thread of the work.
    fn run(mut work: Work, shared: Arc<NodeState>) -> GraphResult<Self> {
        let node = work.graph.node().fqn();
        let leave = Arc::new(AtomicBool::new(false));
        let leave_of_thread = Arc::clone(&leave);
        let thread = std::thread::Builder::new()
            .name("wrapyfi node".into())
            .spawn(move || work.run(&leave_of_thread))
            .map_err(|error| GraphError::stack("starting a thread", &node, &error))?;
        Ok(Self { handle: NodeHandle(shared), leave, thread: Some(thread) })
    }

    /// The node as the rest of the program uses it.
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

/// The service that describes types: its name, type, depth and answers.
fn types_service() -> (&'static str, (&'static str, ServiceHashes), u32, Answers) {
    type S = GetTypeDescription;
    let kind = (S::ROS_TYPE, ServiceHashes::of::<S>());
    (TypeDescriptions::SERVICE, kind, TypeDescriptions::DEPTH, Answers::Types)
}

/// One service of the node.
fn serve(
    graph: &dyn Graph,
    described: &ServiceDescription,
    answers: Answers,
    bell: Notify,
) -> GraphResult<Served> {
    let server = graph.server(described, bell)?;
    Ok(Served::new(answers, server, &described.name))
}

fn description(
    name: &str,
    (type_name, hashes): (&str, ServiceHashes),
    depth: u32,
) -> ServiceDescription {
    ServiceDescription {
        name: name.to_owned(),
        type_name: type_name.to_owned(),
        type_hash: Some(hashes.service.to_owned()),
        request_hash: Some(hashes.request.to_owned()),
        response_hash: Some(hashes.response.to_owned()),
        depth,
        max_bytes: MAX_BYTES,
    }
}

fn topic<M: Message>(name: &str, qos: Qos) -> TopicDescription {
    TopicDescription::of::<M>(name, qos, MAX_BYTES)
}

pub(super) fn topic_of_events() -> TopicDescription {
    topic::<ParameterEvent>(
        "/parameter_events",
        Qos { history: History::KeepLast(1000), ..Qos::default() },
    )
}

fn topic_of_clock() -> TopicDescription {
    let reliability = Reliability::BestEffort;
    let qos = Qos { reliability, history: History::KeepLast(1), ..Qos::default() };
    // A bridge may bring the clock of another side itself.
    TopicDescription { hears_own: true, ..topic::<Clock>(RosTime::TOPIC, qos) }
}

fn rosout_qos() -> Qos {
    Qos {
        durability: Durability::TransientLocal,
        history: History::KeepLast(LogLine::DEPTH),
        lifespan: Some(LogLine::LIFESPAN),
        ..Qos::default()
    }
}

#[cfg(test)]
mod tests;
