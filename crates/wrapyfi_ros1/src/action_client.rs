//! Sends goals to an actionlib server.
//!
//! ```text
//!   send, cancel ─▶ <action>/goal, cancel ──▶ server
//!   take ◀─ ClientGoals ◀─ <action>/status, feedback, result
//! ```
//!
//! A server is a node that has all five topics. Its status arrays count alone: another node that publishes some would make
//! every goal lost.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::action_messages::{self, GoalId, GoalStatus, StampedId, Stamps};
use super::action_topics::{ActionTopic, ActionTopics};
use super::client_goals::ClientGoals;
use super::config::NAME;
use super::conversion::from_ros1;
use super::listener::Ros1Listener;
use super::listener_connections::Arrival;
use super::node::Node;
use super::publisher::Ros1Publisher;
use wrapyfi_data::types::{Payload, RosType};
use wrapyfi_endpoint::codec::requests::asked_message;
use wrapyfi_endpoint::{
    Absent, ActionClient, ActionSpec, CallError, Cause, Context, GoalUpdate, Link, Listener as _,
    OpenError, OpenResult, PublishError, Publisher as _, Request, Role, Ticket,
};

/// Option that says what a goal is that the server gave up for a newer one.
pub(super) const PREEMPTED: &str = "preempted";
/// Its values.
const OUTCOMES: [&str; 2] = ["aborted", "canceled"];

/// Time after which a server whose connections have closed is gone.
const GONE_AFTER: Duration = Duration::from_secs(1);

/// Sends goals to one action.
pub(super) struct Ros1ActionClient {
    topics: ActionTopics,
    goal: Ros1Publisher,
    cancel: Ros1Publisher,
    status: Ros1Listener,
    feedback: Ros1Listener,
    result: Ros1Listener,
    goals: ClientGoals,
    stamps: Stamps,
    sent: u64,
    /// Node that has the goals, and since when it is not connected.
    server: Option<(String, Option<Instant>)>,
}

/// Checks a value of the option `preempted`.
pub(super) fn check_preempted(value: Option<&str>) -> Result<bool, String> {
    match value {
        Some(value) if OUTCOMES.contains(&value) => Ok(value == "canceled"),
        _ => Err(OUTCOMES.join(" or ")),
    }
}

impl Ros1ActionClient {
    pub(super) fn open(
        node: &Arc<Node>,
        action: String,
        spec: &ActionSpec,
        context: &Context,
    ) -> OpenResult<Self> {
        let preempted = spec.options.get(PREEMPTED).map(|value| {
            check_preempted(value.as_str()).map_err(|wanted| OpenError::InvalidOption {
                middleware: NAME,
                topic: action.clone(),
                option: PREEMPTED.to_owned(),
                found: format!("{value:?}").chars().take(80).collect(),
                wanted,
            })
        });
        let preempted_is_canceled = preempted.transpose()?.unwrap_or(false);
        let topics = ActionTopics::new(node, action, spec, context)?;
        Ok(Self {
            goal: topics.publish(ActionTopic::Goal)?,
            cancel: topics.publish(ActionTopic::Cancel)?,
            status: topics.listen_to(ActionTopic::Status)?,
            feedback: topics.listen_to(ActionTopic::Feedback)?,
            result: topics.listen_to(ActionTopic::Result)?,
            topics,
            goals: ClientGoals::new(preempted_is_canceled),
            stamps: Stamps::default(),
            sent: 0,
            server: None,
        })
    }

    /// Nodes that have all five topics.
    fn servers(&self) -> BTreeSet<String> {
        let mut nodes = self.goal.callers();
        nodes.retain(|node| self.cancel.callers().contains(node));
        for listener in [&self.status, &self.feedback, &self.result] {
            let publishers = listener.connections().callers();
            nodes.retain(|node| publishers.values().any(|publisher| publisher == node));
        }
        nodes
    }

    /// Follows which node has the goals; those of one that has gone have ended.
    fn follow_server(&mut self, now: Instant) {
        let servers = self.servers();
        let gone = match &mut self.server {
            Some((node, absent_since)) if servers.contains(node) => {
                *absent_since = None;
                None
            }
            Some((node, absent_since)) => {
                let since = *absent_since.get_or_insert(now);
                // Another server in its place has come because it went.
                let is_gone =
                    !servers.is_empty() || now.saturating_duration_since(since) >= GONE_AFTER;
                is_gone.then(|| format!("the server {node} has gone"))
            }
            None => None,
        };
        if let Some(reason) = gone {
            self.goals.lose_all(&reason);
            self.server = None;
        }
        if self.server.is_none() {
            self.server = servers.into_iter().next().map(|node| (node, None));
        }
    }

    fn is_server(&self, source: u64) -> bool {
        let callers = self.status.connections().callers();
        let server = self.server.as_ref().map(|(node, _)| node);
        callers.get(&source).is_some_and(|caller| Some(caller) == server)
    }

    fn look(&mut self) {
        let now = self.topics.context.clock.now();
        self.follow_server(now);
        while let Some(arrival) = self.status.next() {
            if !self.is_server(arrival.source) {
                continue;
            }
            match action_messages::read_statuses(&arrival.message) {
                Some(statuses) => {
                    for id in self.goals.statuses(&statuses, now) {
                        self.ask_to_cancel(id);
                    }
                }
                None => self.topics.malformed("it is no actionlib_msgs/GoalStatusArray"),
            }
        }
        let Self { topics, feedback, result, goals, .. } = self;
        let kind = topics.spec.kind;
        while let Some((status, part)) = next_part(feedback, topics, goals, kind.feedback()) {
            if let Ok(feedback) = part {
                goals.feedback(&status, feedback);
            }
        }
        while let Some((status, part)) = next_part(result, topics, goals, kind.result()) {
            goals.result(status, part, now);
        }
        self.goals.look(now);
    }

    fn ask_to_cancel(&mut self, id: GoalId) {
        let wanted = StampedId { id, ..StampedId::default() };
        if let Err(error) = self.cancel.send_part(|_| cancel_bytes(&wanted), None) {
            tracing::debug!("ROS 1: a cancel was not sent: {error}");
        }
    }

    fn absent(&self) -> Cause {
        let action = &*self.topics.action;
        let nobody =
            Absent::new(Role::ActionServer, "a ROS 1 node that offers the action", NAME, action);
        let links = [
            self.status.link(),
            self.result.link(),
            self.feedback.link(),
            self.goal.link(),
            self.cancel.link(),
        ];
        // Where some of its topics are there, the one that lacks is told.
        let is_there = links.iter().any(|link| link.peers.is_some_and(|peers| peers > 0));
        let lacks = links.into_iter().find_map(|link| link.waiting_for);
        let fault = self.topics.node.fault();
        let lacks = lacks.filter(|_| is_there).unwrap_or(Cause::Nobody(nobody));
        fault.unwrap_or(lacks)
    }
}

/// The next feedback or result of a goal of this client: the part that it carries, or the fault in it.
fn next_part(
    listener: &mut Ros1Listener,
    topics: &ActionTopics,
    goals: &ClientGoals,
    ros_type: RosType,
) -> Option<(GoalStatus, Result<Payload, String>)> {
    loop {
        let Arrival { message, plan, .. } = listener.next()?;
        let (Some((status, part)), Some(plan)) = (action_messages::read_part(&message), plan)
        else {
            topics.malformed("it is no feedback or result of actionlib");
            continue;
        };
        // Goals of other clients are theirs.
        if goals.has(&status.goal.id) {
            let read = from_ros1(&part, &plan, ros_type, &topics.spec.limits);
            let read = read.map(Payload::from).map_err(|fault| {
                let fault = format!("{ros_type} cannot be read: {fault}");
                topics.malformed(&fault);
                fault
            });
            return Some((status, read));
        }
    }
}

fn cancel_bytes(wanted: &StampedId) -> Vec<u8> {
    let mut bytes = Vec::new();
    action_messages::put_id(&mut bytes, wanted);
    bytes
}

impl ActionClient for Ros1ActionClient {
    fn send(&mut self, goal: &Request) -> Result<Ticket, CallError> {
        let ActionSpec { action, kind, goals: limit, limits, .. } = &self.topics.spec;
        let (service, limit, kind) = (action.clone(), *limit, *kind);
        if self.goals.len() >= limit {
            return Err(CallError::TooMany { service, limit });
        }
        let unsuitable = |fault| CallError::Request { service: service.clone(), fault };
        let message = asked_message(goal, kind.goal(), limits.message_bytes).map_err(unsuitable)?;
        let now = self.topics.context.clock.now();
        self.follow_server(now);
        self.sent += 1;
        let ticket = Ticket::new(self.sent);
        if !matches!(self.server, Some((_, None))) {
            self.goals.reject(ticket, format!("there is no server: waiting for {}", self.absent()));
            return Ok(ticket);
        }
        let goal = self.stamps.next_id(&self.topics.node, &self.topics.context.clock);
        let head = |sequence| {
            let mut bytes = action_messages::header(sequence, goal.stamp);
            action_messages::put_id(&mut bytes, &goal);
            bytes
        };
        match self.goal.send_part(head, Some(&message)) {
            Ok(_) => self.goals.begin(ticket, goal.id, now),
            Err(PublishError::Encode(fault)) => return Err(unsuitable(fault)),
            Err(error) => self.goals.reject(ticket, error.to_string()),
        }
        Ok(ticket)
    }

    fn cancel(&mut self, ticket: Ticket) {
        if let Some(id) = self.goals.cancel(ticket, self.topics.context.clock.now()) {
            self.ask_to_cancel(id);
        }
    }

    fn cancel_all(&mut self) -> Result<(), CallError> {
        let sent = self.cancel.send_part(|_| cancel_bytes(&StampedId::default()), None);
        let service = self.topics.spec.action.clone();
        sent.map_err(|error| CallError::Transport { service, reason: error.to_string() })?;
        self.goals.cancel_all();
        Ok(())
    }

    fn take(&mut self) -> Option<(Ticket, GoalUpdate)> {
        let update = self.goals.take();
        update.or_else(|| {
            self.look();
            self.goals.take()
        })
    }

    fn deadline(&self) -> Option<Instant> {
        let absent_since = self.server.as_ref().and_then(|(_, since)| *since);
        let gone_at = absent_since.and_then(|since| since.checked_add(GONE_AFTER));
        [gone_at, self.goals.deadline()].into_iter().flatten().min()
    }

    fn link(&self) -> Link {
        let servers = self.servers().len();
        let waiting_for = (servers == 0).then(|| self.absent());
        Link { peers: Some(servers), waiting_for, keeps_last: false }
    }
}
