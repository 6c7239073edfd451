//! Offers an action to clients of actionlib.
//!
//! ```text
//!   clients ─▶ <action>/goal, cancel ─▶ ServerGoals ─▶ take
//!           ◀─ <action>/status (latched, 5 Hz), feedback, result ◀─ update
//! ```
//!
//! A client takes a goal that one status array lacks as lost. So nothing is offered while another node publishes
//! `<action>/status`, and no longer once one comes. Of several bridges that begin at once one offers the action: each
//! registers the status alone and is silent, until the master has listed it there and nobody else is. Where others are
//! as far, the one whose node comes first by name goes on, and the others step back.
//!
//! ```text
//!   nobody publishes the status ─▶ claim ─┬ listed alone ─▶ offered
//!                                         └ another one: its name comes first, or too long ─▶ later again
//! ```

use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::BufMut as _;

use super::action_messages::{self, GoalState, RosTime, Stamps};
use super::action_topics::{ActionTopic, ActionTopics};
use super::config::NAME;
use super::conversion::from_ros1;
use super::listener::Ros1Listener;
use super::listener_connections::{Arrival, OtherPublisher};
use super::node::{Mark, Node};
use super::publisher::Ros1Publisher;
use super::server_goals::{Arrived, Goal, ServerGoals};
use wrapyfi_data::EncodeResult;
use wrapyfi_data::types::{Map, Payload, RosMessage, RosType, Value};
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::codec::requests::returned_message;
use wrapyfi_endpoint::{
    ActionServer, ActionSpec, Cause, Context, DropReason, GoalNumber, GoalOutcome, GoalRequest,
    GoalUpdate, Interaction, Link, OpenResult, PublishError, Request, Role, ServeError,
    ServeResult,
};

/// Time between two status arrays.
const STATUS_EVERY: Duration = Duration::from_millis(200);
/// Least time between two of them that tell of changes.
const STATUS_AT_MOST: Duration = Duration::from_millis(5);
/// Time between two looks at the nodes that publish the status.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Most wishes to cancel that are read at once.
const CANCELS: usize = 1000;

/// Longest time for which the status is registered without being offered.
const CLAIM_LASTS: Duration = Duration::from_secs(5);

/// The status of an action that is to be offered, as long as nothing is sent.
struct Claim {
    status: Ros1Publisher,
    until: Instant,
}

/// The topics of an action that is offered.
struct Parts {
    goal: Ros1Listener,
    cancel: Ros1Listener,
    status: Ros1Publisher,
    feedback: Ros1Publisher,
    result: Ros1Publisher,
    /// Told to other bridges while the action is offered.
    _mark: Option<Mark>,
}

/// Offers one action.
pub(super) struct Ros1ActionServer {
    topics: ActionTopics,
    /// Listener that shows which other nodes publish the status.
    others: Ros1Listener,
    claim: Option<Claim>,
    parts: Option<Parts>,
    goals: ServerGoals,
    requests: VecDeque<GoalRequest>,
    stamps: Stamps,
    published_at: Instant,
    next_status: Instant,
    /// A goal changed its state since the last status array.
    is_unpublished: bool,
    /// Time before which the action is not offered again: two bridges that gave way to each other wait for different
    /// times.
    next_try: Instant,
    backoff: Backoff,
}

impl Ros1ActionServer {
    pub(super) fn open(
        node: &Arc<Node>,
        action: String,
        spec: &ActionSpec,
        context: &Context,
    ) -> OpenResult<Self> {
        let topics = ActionTopics::new(node, action, spec, context)?;
        // What can never be offered is told now.
        topics.check()?;
        let now = context.clock.now();
        Ok(Self {
            others: topics.listen_to(ActionTopic::Status)?,
            claim: None,
            parts: None,
            goals: ServerGoals::new(spec.goals),
            requests: VecDeque::new(),
            stamps: Stamps::default(),
            published_at: now,
            next_status: now,
            is_unpublished: false,
            next_try: now,
            backoff: Backoff::of_process(node.next_id()),
            topics,
        })
    }

    fn now(&self) -> Instant {
        self.topics.context.clock.now()
    }

    /// Nodes that publish the status beside this one.
    fn rivals(&self) -> Vec<OtherPublisher> {
        self.others.connections().publishers()
    }

    /// Offers the action where nobody else does, and gives way where somebody does.
    fn review(&mut self, now: Instant) {
        while self.others.next().is_some() {}
        let rivals = self.rivals();
        let node = Arc::clone(&self.topics.node);
        let comes_first =
            |rival: &OtherPublisher| !rival.is_offer || rival.node.as_str() < node.name.full();
        if self.parts.is_some() {
            // One that claims the action and is silent steps back.
            let over =
                |rival: &&OtherPublisher| comes_first(rival) && (rival.has_sent || !rival.is_offer);
            if let Some(rival) = rivals.iter().find(over) {
                self.give_way(&rival.node, now);
            }
            return;
        }
        let topic = self.topics.topic(ActionTopic::Status);
        let is_alone = rivals.is_empty() && self.others.connections().is_settled();
        match self.claim.take() {
            Some(claim) if is_alone && node.is_listed(&topic) => {
                let offered = self.offer(claim.status);
                self.parts = self.or_later(offered, now);
                self.publish_status(now);
            }
            Some(claim)
                if now >= claim.until
                    || rivals.iter().any(|rival| comes_first(rival) || rival.has_sent) =>
            {
                self.next_try = now + self.backoff.wait();
            }
            Some(claim) => {
                self.claim = Some(claim);
                self.next_try = now + LOOK_EVERY;
            }
            None if now >= self.next_try => {
                // The master may not have answered, or a node that was there may go.
                self.next_try = now + LOOK_EVERY;
                if is_alone && node.has_asked_for(&topic) {
                    let status = self.topics.publish(ActionTopic::Status);
                    let until = now + CLAIM_LASTS;
                    self.claim = self.or_later(status, now).map(|status| Claim { status, until });
                    node.ask_again(&topic);
                }
            }
            None => {}
        }
    }

    /// Result of opening, where it was opened; what was not is tried again later.
    fn or_later<T>(&mut self, opened: OpenResult<T>, now: Instant) -> Option<T> {
        opened
            .inspect_err(|error| {
                tracing::warn!("ROS 1: {error}");
                self.next_try = now + self.backoff.wait();
            })
            .ok()
    }

    /// Offers the action no longer: its goals end, those that have come and that nobody has read, too.
    fn give_way(&mut self, rival: &str, now: Instant) {
        let reason = format!("{rival} offers {} too", self.topics.action);
        tracing::warn!("ROS 1: {} is no longer offered: {reason}", self.topics.action);
        while let Some(arrival) = self.parts.as_mut().and_then(|parts| parts.goal.next()) {
            // A goal that cannot be taken is answered already.
            _ = self.take_goal(&arrival, now);
        }
        let unread = self.requests.iter().filter_map(|request| match request {
            GoalRequest::Goal { number, .. } => Some(*number),
            _ => None,
        });
        let unread: BTreeSet<_> = unread.collect();
        self.requests.retain(|request| match request {
            GoalRequest::Goal { .. } => false,
            GoalRequest::Cancel(number) => !unread.contains(number),
            _ => true,
        });
        let mut known = self.goals.under_way();
        known.retain(|number| !unread.contains(number));
        self.end_all(&reason, now);
        // The real server is to give them up.
        self.requests.extend(known.into_iter().map(GoalRequest::Cancel));
        self.parts = None;
        self.next_try = now + self.backoff.wait();
    }

    fn offer(&self, status: Ros1Publisher) -> OpenResult<Parts> {
        let ActionTopics { node, action, spec, .. } = &self.topics;
        Ok(Parts {
            status,
            feedback: self.topics.publish(ActionTopic::Feedback)?,
            result: self.topics.publish(ActionTopic::Result)?,
            goal: self.topics.listen_to(ActionTopic::Goal)?,
            cancel: self.topics.listen_to(ActionTopic::Cancel)?,
            _mark: node.mark(Role::ActionServer, action, &spec.mark),
        })
    }

    /// Reads goals until one is to be taken, and the wishes to cancel that came.
    fn hear(&mut self, now: Instant) -> ServeResult<()> {
        while let Some(arrival) = self.parts.as_mut().and_then(|parts| parts.goal.next()) {
            if self.take_goal(&arrival, now)? {
                break;
            }
        }
        for _ in 0..CANCELS {
            let Some(arrival) = self.parts.as_mut().and_then(|parts| parts.cancel.next()) else {
                break;
            };
            match action_messages::read_cancel(&arrival.message) {
                Some(wanted) => {
                    let before = self.goals.goals().len();
                    let asked = self.goals.cancel(&wanted, now);
                    self.requests.extend(asked.into_iter().map(GoalRequest::Cancel));
                    if wanted.is_all() && !self.requests.contains(&GoalRequest::CancelAll) {
                        self.requests.push_back(GoalRequest::CancelAll);
                    }
                    if self.goals.goals().len() > before {
                        self.publish_change(now);
                    }
                }
                None => self.topics.malformed("it is no actionlib_msgs/GoalID"),
            }
        }
        Ok(())
    }

    /// Takes a goal; true where it waits to be accepted.
    fn take_goal(&mut self, arrival: &Arrival, now: Instant) -> ServeResult<bool> {
        let Arrival { message, plan, .. } = arrival;
        let (Some((mut id, part)), Some(plan)) = (action_messages::read_goal(message), plan) else {
            let fault = "it is no goal of actionlib, or its id is too long".to_owned();
            return Err(self.refused(fault, DropReason::Malformed));
        };
        let clock = &self.topics.context.clock;
        if id.id.0.is_empty() {
            id = self.stamps.next_id(&self.topics.node, clock);
        } else if id.stamp.is_zero() {
            id.stamp = self.stamps.next(clock);
        }
        let number = match self.goals.arrive(id, now) {
            Arrived::Pending(number) => number,
            Arrived::Known => {
                self.topics.context.counters.dropped(DropReason::Duplicate);
                return Ok(false);
            }
            Arrived::Recalled(number) => {
                self.publish_result(number, None, now);
                return Ok(false);
            }
            Arrived::TooMany(number) => {
                self.publish_result(number, None, now);
                self.topics.context.counters.dropped(DropReason::Overloaded);
                let ActionSpec { action: service, goals: limit, .. } = self.topics.spec.clone();
                return Err(ServeError::Overloaded { service, limit });
            }
        };
        let ActionSpec { kind, limits, .. } = &self.topics.spec;
        match from_ros1(&part, plan, kind.goal(), limits) {
            Ok(goal) => {
                let (goal, wire_bytes) = (Request::Message(goal), message.len() + 4);
                self.requests.push_back(GoalRequest::Goal { number, goal, wire_bytes });
                self.publish_change(now);
                Ok(true)
            }
            Err(fault) => {
                let (text, reason) = (fault.to_string(), DropReason::from(&fault));
                self.goals.end(number, GoalState::Rejected, &text, now);
                self.publish_result(number, None, now);
                Err(self.refused(text, reason))
            }
        }
    }

    fn refused(&self, fault: String, reason: DropReason) -> ServeError {
        self.topics.context.counters.dropped(reason);
        ServeError::Request { service: self.topics.spec.action.clone(), fault, reason }
    }

    /// Time in the headers of messages.
    fn stamp(&self) -> RosTime {
        self.topics.context.clock.ros_now().stamp.into()
    }

    /// Publishes a change: at once, unless arrays follow each other so closely that they would be most of the traffic.
    fn publish_change(&mut self, now: Instant) {
        let soon = self.published_at + STATUS_AT_MOST;
        if now >= soon {
            self.publish_status(now);
        } else {
            self.next_status = self.next_status.min(soon);
            self.is_unpublished = true;
        }
    }

    fn publish_status(&mut self, now: Instant) {
        (self.published_at, self.next_status) = (now, now + STATUS_EVERY);
        self.is_unpublished = false;
        self.goals.forget(now);
        let (stamp, goals) = (self.stamp(), self.goals.goals());
        let Some(parts) = &mut self.parts else { return };
        let head = |sequence| {
            let mut bytes = action_messages::header(sequence, stamp);
            bytes.put_u32_le(u32::try_from(goals.len()).unwrap_or(0));
            for Goal { id, state, text, .. } in goals {
                action_messages::put_status(&mut bytes, id, *state, text);
            }
            bytes
        };
        if let Err(error) = parts.status.send_part(head, None) {
            tracing::debug!("ROS 1: a status array was not sent: {error}");
        }
    }

    /// A message of type `part` for what is given, or an empty one.
    fn part(&self, part: RosType, payload: Option<&Payload>) -> EncodeResult<RosMessage> {
        let limit = self.topics.spec.limits.message_bytes;
        let empty = Payload::from(Value::Map(Map::default()));
        returned_message(payload.unwrap_or(&empty), part, limit)
    }

    /// Publishes the result of a goal that has ended; the status follows. Number of bytes.
    fn publish_result(
        &mut self,
        number: GoalNumber,
        result: Option<&RosMessage>,
        now: Instant,
    ) -> usize {
        let empty = self.part(self.topics.spec.kind.result(), None).ok();
        let (stamp, goal) = (self.stamp(), self.goals.get(number).cloned());
        let sent = match (&mut self.parts, goal, result.or(empty.as_ref())) {
            (Some(parts), Some(goal), Some(result)) => {
                parts.result.send_part(status_head(stamp, &goal), Some(result))
            }
            _ => Ok(0),
        };
        // Not at once: a client of rospy hears both on threads of their own, and logs an error where the status comes to
        // its goal while the result ends it.
        self.next_status = self.next_status.min(now + STATUS_AT_MOST);
        sent.unwrap_or_else(|error| {
            tracing::debug!("ROS 1: a result was not sent: {error}");
            0
        })
    }

    /// Ends a goal; `None` outcome is a rejection.
    fn end(
        &mut self,
        number: GoalNumber,
        outcome: Option<GoalOutcome>,
        result: Option<&Payload>,
        text: &str,
    ) -> ServeResult<usize> {
        let now = self.now();
        if let Some(outcome) = outcome
            && self.goals.go_on(number, outcome == GoalOutcome::Canceled)
        {
            // A state that the real server went through while nobody looked.
            self.publish_change(now);
        }
        // PREEMPTING alone tells a client that a goal was cancelled by another, and not given up for a newer one.
        if outcome == Some(GoalOutcome::Canceled) && self.is_unpublished {
            self.publish_status(now);
        }
        let message = self.part(self.topics.spec.kind.result(), result);
        let outcome = if message.is_err() { Some(GoalOutcome::Aborted) } else { outcome };
        let Some(state) = self.goals.end_state(number, outcome) else { return Ok(0) };
        let fault = message.as_ref().err().map(ToString::to_string);
        self.goals.end(number, state, fault.as_deref().unwrap_or(text), now);
        let bytes = self.publish_result(number, message.as_ref().ok(), now);
        let service = self.topics.spec.action.clone();
        message.map(|_| bytes).map_err(|fault| ServeError::Reply { service, fault })
    }

    fn end_all(&mut self, reason: &str, now: Instant) {
        for number in self.goals.under_way() {
            self.goals.end(number, GoalState::Aborted, reason, now);
            self.publish_result(number, None, now);
        }
    }

    fn publish_feedback(&mut self, number: GoalNumber, feedback: &Payload) -> ServeResult<usize> {
        let service = || self.topics.spec.action.clone();
        let message = self.part(self.topics.spec.kind.feedback(), Some(feedback));
        let message = message.map_err(|fault| ServeError::Reply { service: service(), fault })?;
        let stamp = self.stamp();
        let goal = self.goals.get(number).filter(|goal| !goal.state.is_end()).cloned();
        let (Some(goal), Some(parts)) = (goal, &mut self.parts) else { return Ok(0) };
        match parts.feedback.send_part(status_head(stamp, &goal), Some(&message)) {
            Err(PublishError::NoConsumer(_)) => Ok(0),
            sent => sent.map_err(|error| unsent(service(), error)),
        }
    }

    /// Tells the clients of a goal what has become of it: number of bytes.
    fn tell(&mut self, number: GoalNumber, update: GoalUpdate) -> ServeResult<usize> {
        let is_news = match update {
            GoalUpdate::Accepted => false,
            GoalUpdate::CancelRefused(_) => {
                self.goals.refuse_cancel(number);
                false
            }
            GoalUpdate::Executing => self.goals.go_on(number, false),
            GoalUpdate::Canceling => self.goals.go_on(number, true),
            GoalUpdate::Feedback(feedback) => return self.publish_feedback(number, &feedback),
            GoalUpdate::Rejected(text) => return self.end(number, None, None, &text),
            GoalUpdate::Ended { outcome, result, text } => {
                return self.end(number, Some(outcome), result.as_ref(), &text);
            }
        };
        if is_news {
            self.publish_change(self.now());
        }
        Ok(0)
    }
}

fn unsent(service: String, error: PublishError) -> ServeError {
    match error {
        PublishError::Encode(fault) => ServeError::Reply { service, fault },
        other => ServeError::Transport { service, reason: other.to_string() },
    }
}

/// Begin of a result or of feedback.
fn status_head(stamp: RosTime, goal: &Goal) -> impl FnOnce(u32) -> Vec<u8> {
    move |sequence| {
        let mut bytes = action_messages::header(sequence, stamp);
        action_messages::put_status(&mut bytes, &goal.id, goal.state, &goal.text);
        bytes
    }
}

impl ActionServer for Ros1ActionServer {
    fn take(&mut self) -> ServeResult<Option<GoalRequest>> {
        let now = self.now();
        self.review(now);
        if self.requests.is_empty() {
            self.hear(now)?;
        }
        if now >= self.next_status {
            self.publish_status(now);
        }
        Ok(self.requests.pop_front())
    }

    fn update(&mut self, number: GoalNumber, update: GoalUpdate) -> ServeResult<usize> {
        let bytes = self.tell(number, update)?;
        if bytes > 0 {
            self.topics.context.counters.sent(bytes, Duration::ZERO);
        }
        Ok(bytes)
    }

    fn kept(&self) -> usize {
        self.goals.goals().len()
    }

    fn deadline(&self) -> Option<Instant> {
        match &self.parts {
            Some(_) => Some(self.next_status),
            None => Some(self.next_try),
        }
    }

    fn link(&self) -> Link {
        let to = || format!("{NAME}:{}", self.topics.action);
        let served = |rival: OtherPublisher| Cause::NameServed {
            to: to(),
            interaction: Interaction::Action,
            by: rival.node,
        };
        // One that claims what is offered here steps back.
        let rival = self.rivals().into_iter().find(|rival| self.parts.is_none() || !rival.is_offer);
        let rival = rival.map(served);
        let clients = |parts: &Parts| parts.goal.connections().callers().len();
        let peers = Some(self.parts.as_ref().map_or(0, clients));
        let waiting_for = rival.or_else(|| self.topics.node.fault());
        Link { peers, waiting_for, keeps_last: false }
    }
}

impl Drop for Ros1ActionServer {
    fn drop(&mut self) {
        self.end_all("the server has ended", self.now());
    }
}
