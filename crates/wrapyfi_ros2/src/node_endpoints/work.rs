//! Work of a node's thread.
//!
//! ```text
//!   sleep ─ rung, a reply waits, NAP ─▶ answer ─▶ follow changes ─▶ read the clock ─▶ publish ─┐
//!     ▲                                                                                        │
//!     └────────────────────────────────────────────────────────────────────────────────────────┘
//! ```

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

use bytes::Bytes;
use wrapyfi_interfaces::cdr::{CdrError, CdrParts};
use wrapyfi_interfaces::rcl_interfaces::msg::{Log, ParameterEvent};
use wrapyfi_interfaces::rosgraph_msgs::msg::Clock;
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_interfaces::type_description_interfaces::srv::{
    GetTypeDescription, GetTypeDescription_Request, GetTypeDescription_Response,
};
use wrapyfi_interfaces::{Message as _, Service as _};

use super::{MAX_BYTES, topic_of_clock};
use crate::graph::{CdrReader, CdrServer, CdrWriter, Graph, GraphError, ringing};
use crate::node_handle::{NodeState, in_node_thread};
use crate::service::replies::{Replies, Reply};
use wrapyfi_data::types::{RosAction, RosService, RosType};
use wrapyfi_endpoint::Throttle;
use wrapyfi_node::logger_services::{LoggerService, Loggers};
use wrapyfi_node::parameters::{ParameterService, ParameterWatch};
use wrapyfi_node::type_description::TypeDescriptions;
use wrapyfi_node::{ParameterValue, RosTime};

/// Longest time that a client may take to become able to hear its reply.
const TIMEOUT: Duration = Duration::from_secs(5);
/// Replies kept for clients that do not hear yet, of one service.
const MAX_KEPT: usize = 64;
/// Requests answered before others have their turn.
const BATCH: usize = 32;
/// Longest sleep; what waits for it are the sums of complaints.
const NAP: Duration = Duration::from_secs(1);

/// Source of the answers of a service.
pub(super) enum Answers {
    Parameters(ParameterService),
    Types,
    Loggers(LoggerService, Arc<dyn Loggers>),
}

/// A service of the node.
pub(super) struct Served {
    answers: Answers,
    replies: Replies,
    /// Error that DDS last returned instead of requests, logged once until it changes.
    trouble: Option<GraphError>,
}

impl Served {
    pub(super) fn new(answers: Answers, server: Box<dyn CdrServer>, name: &str) -> Self {
        let replies = Replies::new(server, name, MAX_KEPT, &wrapyfi_endpoint::Clock::default());
        Self { answers, replies, trouble: None }
    }
}

/// Topics on which the node tells of itself.
pub(super) struct Topics {
    pub(super) rosout: Box<dyn CdrWriter>,
    pub(super) events: Box<dyn CdrWriter>,
}

pub(super) struct Work {
    pub(super) shared: Arc<NodeState>,
    pub(super) graph: Arc<dyn Graph>,
    /// `None` for a node that only describes types.
    pub(super) topics: Option<Topics>,
    pub(super) servers: Vec<Served>,
    pub(super) clock: Option<Box<dyn CdrReader>>,
    /// True once the type of the clock counts as used.
    pub(super) describes: bool,
    pub(super) watch: ParameterWatch,
    /// Requests that were refused and replies that were not sent; what `/clock` said wrongly.
    pub(super) complaints: Throttle,
    pub(super) clock_complaints: Throttle,
}

impl Work {
    pub(super) fn new(
        shared: &Arc<NodeState>,
        graph: &Arc<dyn Graph>,
        topics: Option<Topics>,
        servers: Vec<Served>,
        watch: ParameterWatch,
    ) -> Self {
        Self {
            shared: Arc::clone(shared),
            graph: Arc::clone(graph),
            topics,
            servers,
            clock: None,
            describes: false,
            watch,
            complaints: Throttle::default(),
            clock_complaints: Throttle::default(),
        }
    }

    pub(super) fn run(&mut self, leave: &AtomicBool) {
        // Log lines of this thread must not come back to it as work.
        in_node_thread();
        while !leave.load(Relaxed) {
            let more = self.answer();
            self.follow_changes();
            self.read_clock();
            self.publish();
            if let Some(count) = self.complaints.rest(Instant::now()) {
                tracing::warn!(count, "more requests to the node were refused");
            }
            if !more {
                self.shared.wake.wait(self.nap());
            }
        }
        self.publish();
    }

    /// Time for which nothing is to be done unless the thread is woken.
    fn nap(&self) -> Duration {
        let due = self.servers.iter().filter_map(|served| served.replies.deadline()).min();
        due.map_or(NAP, |at| at.saturating_duration_since(Instant::now()).min(NAP))
    }

    /// Answers what has arrived; true when more may wait.
    pub(super) fn answer(&mut self) -> bool {
        let mut more = false;
        let mut servers = std::mem::take(&mut self.servers);
        for served in &mut servers {
            // A reply that could not be sent is counted and logged there; these services have no
            // word for one that fails.
            drop(served.replies.flush());
            more |= self.answer_some(served);
        }
        self.servers = servers;
        more
    }

    /// Answers requests to one service; true when more may wait.
    fn answer_some(&mut self, served: &mut Served) -> bool {
        for _ in 0..BATCH {
            let request = match served.replies.take() {
                Ok(request) => {
                    served.trouble = None;
                    request
                }
                // It may last: then each look finds it again.
                Err(error @ GraphError::Stack { .. }) => {
                    if served.trouble.as_ref() != Some(&error) {
                        self.refused("a request to the node was refused", &error);
                        served.trouble = Some(error);
                    }
                    return false;
                }
                Err(error) => {
                    self.refused("a request to the node was refused", &error);
                    continue;
                }
            };
            let Some(request) = request else { return false };
            match served.answers.answer(&self.shared, &request.cdr) {
                Ok(parts) => {
                    // A client that set use_sim_time finds it in force when the reply is there.
                    self.follow_changes();
                    let until = Instant::now() + TIMEOUT;
                    let reply = Reply { id: request.id, cdr: parts.to_bytes(), until };
                    if let Err(error) = served.replies.send(reply) {
                        self.complain("the node's reply was not sent", &error);
                    }
                }
                Err(error) => self.refused("a request to the node is not of its type", &error),
            }
        }
        true
    }

    fn refused(&mut self, what: &str, error: &dyn std::fmt::Display) {
        self.shared.count_refused();
        self.complain(what, error);
    }

    fn complain(&mut self, what: &str, error: &dyn std::fmt::Display) {
        if let Some(unlogged_before) = self.complaints.pass(Instant::now()) {
            tracing::warn!(unlogged_before, "{what}: {error}");
        }
    }

    /// Publishes what changed and what was logged.
    fn publish(&mut self) {
        let Some(Topics { rosout, events }) = &mut self.topics else { return };
        let stamp = self.shared.now();
        let changed = self.shared.store().take_events(stamp);
        for event in changed {
            send(events.as_mut(), &event.encode());
        }
        for (stamp, line) in self.shared.take_lines() {
            send(rosout.as_mut(), &line.to_message(stamp).encode());
        }
    }

    /// Describes the types of every node's own services and topics, as nodes of ROS 2 do.
    pub(super) fn describe_own_types(&mut self, offers_loggers: bool) {
        self.describes = true;
        let services = ParameterService::ALL.map(ParameterService::type_name);
        let loggers = LoggerService::ALL.map(LoggerService::type_name);
        let loggers = loggers.iter().filter(|_| offers_loggers);
        let others = [Log::ROS_TYPE, ParameterEvent::ROS_TYPE, GetTypeDescription::ROS_TYPE];
        self.describe(others.iter().chain(&services).chain(loggers).copied());
    }

    fn describe<'a>(&self, names: impl IntoIterator<Item = &'a str>) {
        let mut store = TypeStore::generated();
        let mut types = self.shared.types();
        for name in names {
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
    pub(super) fn follow_clock(&mut self) {
        let value = self.shared.store().get("use_sim_time").ok().cloned();
        let simulated = value == Some(ParameterValue::Bool(true));
        self.shared.set_simulated(simulated);
        if !simulated {
            if self.clock.take().is_some() && self.describes {
                self.shared.types().remove(Clock::ROS_TYPE, Clock::TYPE_HASH);
            }
        } else if self.clock.is_none() {
            match self.graph.subscribe(&topic_of_clock(), ringing(&self.shared.wake)) {
                Ok(reader) => {
                    self.clock = Some(reader);
                    if self.describes {
                        self.describe([Clock::ROS_TYPE]);
                    }
                }
                Err(error) => tracing::error!(%error, "simulated time stands still"),
            }
        }
    }

    fn read_clock(&mut self) {
        let Some(reader) = &mut self.clock else { return };
        let complaints = &mut self.clock_complaints;
        let mut complain = |error: &dyn std::fmt::Display| {
            if let Some(unlogged_before) = complaints.pass(Instant::now()) {
                tracing::warn!(unlogged_before, "{} is not readable: {error}", RosTime::TOPIC);
            }
        };
        loop {
            match reader.take() {
                Ok(Some(sample)) => match Clock::decode(&sample.cdr, MAX_BYTES) {
                    Ok(clock) => self.shared.on_clock(&clock),
                    Err(error) => complain(&error),
                },
                Ok(None) => return,
                Err(error) => {
                    complain(&error);
                    // A message that is too large is gone, and nothing rings again for those behind
                    // it.
                    if !matches!(error, GraphError::TooLarge { .. }) {
                        return;
                    }
                }
            }
        }
    }
}

impl Answers {
    fn answer(&self, shared: &NodeState, request: &Bytes) -> Result<CdrParts, CdrError> {
        match self {
            Self::Parameters(service) => shared.store().answer(*service, request, MAX_BYTES),
            Self::Types => {
                let request = GetTypeDescription_Request::decode(request, MAX_BYTES)?;
                Ok(described(&mut shared.types(), &request).encode())
            }
            Self::Loggers(service, loggers) => service.answer(loggers.as_ref(), request, MAX_BYTES),
        }
    }
}

/// Description of a type that the node has, or that its program has learned of programs elsewhere.
fn described(
    types: &mut TypeDescriptions,
    request: &GetTypeDescription_Request,
) -> GetTypeDescription_Response {
    let answer = types.answer(request);
    // DDS shows the hash of a service's request.
    let (name, hash) = (request.type_name.as_str(), request.type_hash.as_str());
    if answer.successful {
        return answer;
    }
    let message = || RosType::known(name, hash).map(RosType::resolved);
    let service = || RosService::known(name, hash).map(RosService::resolved);
    let action = || RosAction::known(name, hash).map(RosAction::resolved);
    let Some(resolved) = message().or_else(service).or_else(action) else { return answer };
    let type_hash = types.add(resolved, Vec::new());
    types.answer(&GetTypeDescription_Request { type_hash, ..request.clone() })
}

fn send(writer: &mut dyn CdrWriter, message: &CdrParts) {
    let parts: Vec<&[u8]> = message.pieces().iter().map(AsRef::as_ref).collect();
    // The message is for listeners; nothing of the node depends on it.
    if let Err(error) = writer.write(&parts) {
        tracing::debug!(%error, "the node's message was not sent");
    }
}
