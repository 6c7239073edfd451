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

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::JoinHandle;

use wrapyfi_interfaces::rcl_interfaces::msg::{Log, ParameterEvent};
use wrapyfi_interfaces::rosgraph_msgs::msg::Clock;
use wrapyfi_interfaces::type_description_interfaces::srv::GetTypeDescription;
use wrapyfi_interfaces::{Message, Service, ServiceHashes};

use self::work::{Answers, Served, Work};
use super::any::ringing;
use super::graph::{Graph, GraphError, Notify, ServiceDescription, TopicDescription};
use super::node_handle::{NodeHandle, Shared};
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
    /// Offers them on `graph`, in the order in which `rclpy` does.
    ///
    /// A service that the DDS stack refuses is missing, which is logged: the node has its topics all
    /// the same.
    ///
    /// # Errors
    /// When the DDS stack refuses one of the topics, or there can be no thread.
    pub fn start(graph: &Arc<dyn Graph>, store: ParameterStore) -> Result<Self, GraphError> {
        Self::start_with(graph, store, None)
    }

    /// As [`NodeEndpoints::start`]; the levels of `loggers`, where there are, can be read and set from
    /// outside, as with `enable_logger_service` of rclcpp.
    ///
    /// # Errors
    /// As [`NodeEndpoints::start`].
    pub fn start_with(
        graph: &Arc<dyn Graph>,
        mut store: ParameterStore,
        loggers: Option<&Arc<dyn Loggers>>,
    ) -> Result<Self, GraphError> {
        let node = graph.node().fqn();
        let simulated = store.get("use_sim_time").ok() == Some(&ParameterValue::Bool(true));
        let describes =
            store.get("start_type_description_service").ok() == Some(&ParameterValue::Bool(true));
        let wake = wrapyfi_endpoint::Wake::new();
        let watch = store.watch(&["use_sim_time"], &wake);
        let shared = Arc::new(Shared::new(store, RosTime::new(simulated), wake));
        let bell = || ringing(&shared.wake);
        let topic = |name: &str, qos| topic::<Log>(name, qos);
        let rosout = graph.advertise(&topic(LogLine::TOPIC, rosout_qos()), bell())?;
        let events = topic_of_events();
        let events = graph.advertise(&events, bell())?;
        let mut servers = Vec::new();
        for service in ParameterService::ALL {
            let (hashes, depth) = (service.hashes(), ParameterService::DEPTH);
            let name = format!("{node}/{}", service.name());
            let described = description(&name, service.type_name(), hashes, depth);
            let answers = Answers::Parameters(service);
            servers.extend(serve(graph.as_ref(), &described, answers, bell()));
        }
        if describes {
            type S = GetTypeDescription;
            let name = format!("{node}/{}", TypeDescriptions::SERVICE);
            let hashes = ServiceHashes::of::<S>();
            let described = description(&name, S::ROS_TYPE, hashes, TypeDescriptions::DEPTH);
            servers.extend(serve(graph.as_ref(), &described, Answers::Types, bell()));
        }
        let services = |loggers| LoggerService::ALL.map(|service| (service, loggers));
        for (service, loggers) in loggers.into_iter().flat_map(services) {
            let name = format!("{node}/{}", service.name());
            let (hashes, depth) = (service.hashes(), LoggerService::DEPTH);
            let described = description(&name, service.type_name(), hashes, depth);
            let answers = Answers::Loggers(service, Arc::clone(loggers));
            servers.extend(serve(graph.as_ref(), &described, answers, bell()));
        }
        let offers_loggers = loggers.is_some();
        tracing::debug!(%node, services = servers.len(), "parameters, log and clock offered");
        let leave = Arc::new(AtomicBool::new(false));
        let mut work =
            Work::new(Arc::clone(&shared), Arc::clone(graph), rosout, events, servers, watch);
        if describes {
            work.describe_own_types(offers_loggers);
        }
        work.follow_clock();
        let leave_of_thread = Arc::clone(&leave);
        let thread = std::thread::Builder::new()
            .name("wrapyfi node".into())
            .spawn(move || work.run(&leave_of_thread))
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

/// One service of the node, where the DDS stack does not refuse it.
fn serve(
    graph: &dyn Graph,
    described: &ServiceDescription,
    answers: Answers,
    bell: Notify,
) -> Option<Served> {
    match graph.server(described, bell) {
        Ok(server) => Some(Served::new(answers, server, &described.name)),
        Err(error) => {
            tracing::error!(%error, "the node has no {}", described.name);
            None
        }
    }
}

fn description(
    name: &str,
    type_name: &str,
    hashes: ServiceHashes,
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

#[cfg(test)]
mod tests;
