//! Calls an action with three clients and two listeners.
//!
//! ```text
//!   send ─▶ send_goal ── accepted ─▶ get_result, which is answered when the goal has ended
//!     │        └ rejected: ended                       │
//!     └ cancel ─▶ cancel_goal, once it is accepted     ▼
//!   take ◀── executing, canceling: status ◀── ended: the states before it are given first
//!        ◀── feedback
//! ```
//!
//! A state of a goal says that it was accepted, also where it comes before the reply, and feedback that it is being executed:
//! it has a topic of its own, which may be ahead of the states. A request for a result may
//! be lost in a server that has too many of them: it is sent again where the goal is said to have ended, or where the
//! servers have changed. A server that does not know the goal then answers so.

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use uuid::Uuid;
use wrapyfi_interfaces::Message as _;
use wrapyfi_interfaces::action_msgs::msg::{GoalInfo, GoalStatus, GoalStatusArray};
use wrapyfi_interfaces::action_msgs::srv::{CancelGoal_Request, CancelGoal_Response};
use wrapyfi_interfaces::dynamic::{DynamicMessage, DynamicValue};
use wrapyfi_interfaces::unique_identifier_msgs::msg::UUID;

use super::action::{
    GoalId, PARTS, Parts, SERVICES, context_of_parts, next_state, split_id, with_id,
};
use super::ros2::NAME;
use wrapyfi_data::DecodeError;
use wrapyfi_data::types::{Payload, RosMessage, RosService};
use wrapyfi_endpoint::codec::{requests, ros};
use wrapyfi_endpoint::{
    Absent, ActionClient, ActionSpec, CallError, Cause, Client, Context, DropReason, GoalOutcome,
    GoalUpdate, Link, Listener, Middleware, OpenResult, Reply, Request, Role, Sample, ServiceSpec,
    Ticket,
};

/// Time that a server has to accept or reject a goal.
const ACCEPTED_WITHIN: Duration = Duration::from_secs(60);
/// Time after which the result of a goal is asked for again, where its state says that it has ended.
const ASK_AGAIN: Duration = Duration::from_secs(2);
/// Time for which a server that publishes states stays there though a part of it is missing: its parts are matched one
/// after the other, and again where another program joins.
const PART_MISSING: Duration = Duration::from_secs(2);

/// Goals sent to an action.
pub(super) struct PartsClient {
    spec: ActionSpec,
    context: Context,
    /// Counters of the parts.
    parts: Context,
    send_goal: Box<dyn Client>,
    cancel_goal: Box<dyn Client>,
    get_result: Box<dyn Client>,
    feedback: Box<dyn Listener>,
    status: Box<dyn Listener>,
    cancel: RosService,
    goals: BTreeMap<GoalId, Goal>,
    /// Goals by the calls that are under way for them: of `send_goal`, `cancel_goal`, `get_result`.
    sent: BTreeMap<Ticket, GoalId>,
    canceled: BTreeMap<Ticket, GoalId>,
    asked: BTreeMap<Ticket, GoalId>,
    updates: VecDeque<(Ticket, GoalUpdate)>,
    last: u64,
    /// Servers at the last look, and since when a part of them is missing.
    servers: usize,
    missing_since: Option<Instant>,
}

struct Goal {
    ticket: Ticket,
    status: i8,
    /// Time by which a server must have come.
    until: Instant,
    is_unwanted: bool,
    /// Instant at which the result is asked for again.
    ask_at: Option<Instant>,
}

impl PartsClient {
    /// Opens the parts of the action on `middleware`.
    ///
    /// # Errors
    /// As those of the parts.
    pub(super) fn open(
        middleware: &dyn Middleware,
        spec: &ActionSpec,
        context: &Context,
    ) -> OpenResult<Self> {
        let (of, parts) = (Parts::of(spec)?, context_of_parts(context));
        Ok(Self {
            status: middleware.open_listener(&of.status, &parts)?,
            feedback: middleware.open_listener(&of.feedback, &parts)?,
            get_result: middleware.open_client(&of.get_result, &parts)?,
            cancel_goal: middleware.open_client(&of.cancel_goal, &parts)?,
            send_goal: middleware.open_client(&of.send_goal, &parts)?,
            cancel: of.cancel,
            spec: spec.clone(),
            context: context.clone(),
            parts,
            goals: BTreeMap::new(),
            sent: BTreeMap::new(),
            canceled: BTreeMap::new(),
            asked: BTreeMap::new(),
            updates: VecDeque::new(),
            last: 0,
            servers: 0,
            missing_since: None,
        })
    }

    fn most(&self) -> usize {
        self.spec.limits.message_bytes
    }

    /// Links of the parts, in the order of [`PARTS`].
    fn links(&self) -> [Link; PARTS.len()] {
        let Self { send_goal, cancel_goal, get_result, feedback, status, .. } = self;
        [send_goal.link(), cancel_goal.link(), get_result.link(), feedback.link(), status.link()]
    }

    /// Number of servers that have all parts.
    fn whole_servers(&self, links: &[Link; PARTS.len()]) -> usize {
        let [.., status] = links;
        let whole = links.iter().map(|link| link.peers.unwrap_or(1)).min().unwrap_or(0);
        let now = self.context.clock.now();
        let is_short = self.missing_since.is_none_or(|since| now < since + PART_MISSING);
        match whole {
            0 if status.peers != Some(0) && is_short => self.servers,
            whole => whole,
        }
    }

    fn push(&mut self, id: &GoalId, update: GoalUpdate) {
        if let Some(goal) = self.goals.get(id) {
            self.updates.push_back((goal.ticket, update));
        }
    }

    /// Gives the states of a goal up to `state`, without an end.
    fn reach(&mut self, id: &GoalId, state: i8) {
        while let Some(goal) = self.goals.get_mut(id)
            && let Some(next) = next_state(goal.status, state)
        {
            let (ticket, is_unwanted) = (goal.ticket, goal.is_unwanted);
            let update = match next {
                GoalStatus::STATUS_ACCEPTED => GoalUpdate::Accepted,
                GoalStatus::STATUS_EXECUTING => GoalUpdate::Executing,
                GoalStatus::STATUS_CANCELING => GoalUpdate::Canceling,
                _ => return,
            };
            goal.status = next;
            self.updates.push_back((ticket, update));
            if next == GoalStatus::STATUS_ACCEPTED {
                self.ask_result(id);
                if is_unwanted {
                    self.send_cancel(id);
                }
            }
        }
    }

    /// Ends a goal. Replies that come for it later are counted as late.
    fn end(&mut self, id: &GoalId, update: GoalUpdate) {
        let Some(goal) = self.goals.remove(id) else { return };
        self.updates.push_back((goal.ticket, update));
        forget(&mut self.sent, &mut *self.send_goal, id);
        forget(&mut self.canceled, &mut *self.cancel_goal, id);
        forget(&mut self.asked, &mut *self.get_result, id);
    }

    fn ask_result(&mut self, id: &GoalId) {
        forget(&mut self.asked, &mut *self.get_result, id);
        if let Some(goal) = self.goals.get_mut(id) {
            goal.ask_at = None;
        }
        let request = UUID { uuid: *id }.encode();
        let request = RosMessage::new(self.spec.kind.get_result().request(), request);
        match self.get_result.send(&Request::Message(request), Duration::MAX) {
            Ok(call) => {
                self.asked.insert(call, *id);
            }
            Err(error) => self.end_aborted(id, error.to_string()),
        }
    }

    /// Asks for the end of the goal with this id, or of all goals where it is zero.
    fn ask_to_cancel(&mut self, uuid: GoalId) -> Result<Ticket, CallError> {
        let goal_info = GoalInfo { goal_id: UUID { uuid }, ..GoalInfo::default() };
        let request = CancelGoal_Request { goal_info }.encode();
        let request = RosMessage::new(self.cancel.request(), request);
        self.cancel_goal.send(&Request::Message(request), ServiceSpec::TIMEOUT)
    }

    fn send_cancel(&mut self, id: &GoalId) {
        match self.ask_to_cancel(*id) {
            Ok(call) => {
                self.canceled.insert(call, *id);
            }
            Err(error) => self.push(id, GoalUpdate::CancelRefused(error.to_string())),
        }
    }

    /// Ends a goal whose server cannot be heard any more.
    fn end_aborted(&mut self, id: &GoalId, text: String) {
        self.reach(id, GoalStatus::STATUS_ABORTED);
        self.end(id, GoalUpdate::aborted(text));
    }

    /// The message of a reply, or why there is none.
    fn message(
        &self,
        reply: Result<Reply, CallError>,
        service: RosService,
    ) -> Result<RosMessage, String> {
        let wanted = service.response();
        match reply.map_err(|error| error.to_string())?.payload {
            Payload::RosMessage(message) if message.ros_type == wanted => Ok(message),
            other => {
                let found = other.data_type().to_string();
                Err(self.unread(&DecodeError::mismatch(wanted.to_string(), found)))
            }
        }
    }

    /// Fields of a reply, or why there are none.
    fn fields(
        &self,
        reply: Result<Reply, CallError>,
        service: RosService,
    ) -> Result<DynamicMessage, String> {
        let fields = self.message(reply, service)?.fields(self.most());
        fields.map_err(|error| self.unread(&ros::fault(&error)))
    }

    fn unread(&self, error: &DecodeError) -> String {
        self.context.counters.dropped(error.into());
        error.to_string()
    }

    fn on_goal_reply(&mut self, id: &GoalId, reply: Result<Reply, CallError>) {
        let fields = self.fields(reply, self.spec.kind.send_goal());
        let is_open =
            self.goals.get(id).is_some_and(|goal| goal.status == GoalStatus::STATUS_UNKNOWN);
        match fields {
            Ok(fields) if fields.get("accepted") == Some(&DynamicValue::Bool(true)) => {
                self.reach(id, GoalStatus::STATUS_ACCEPTED);
            }
            // A state or feedback has come for it.
            _ if !is_open => {}
            Ok(_) => self.end(id, GoalUpdate::Rejected(String::new())),
            Err(text) => self.end(id, GoalUpdate::Rejected(text)),
        }
    }

    fn on_cancel_reply(&mut self, id: &GoalId, reply: Result<Reply, CallError>) {
        type Code = CancelGoal_Response;
        let message = self.message(reply, self.cancel);
        let response = message.and_then(|message| {
            Code::decode(&message.cdr, self.most())
                .map_err(|error| self.unread(&ros::fault(&error)))
        });
        let is_canceling =
            |response: &Code| response.goals_canceling.iter().any(|it| it.goal_id.uuid == *id);
        let why = match response {
            Ok(response) if is_canceling(&response) => {
                return self.reach(id, GoalStatus::STATUS_CANCELING);
            }
            Ok(response) => match response.return_code {
                // Its end is on its way; rcl also says so of a goal that is being cancelled.
                Code::ERROR_GOAL_TERMINATED => return,
                Code::ERROR_UNKNOWN_GOAL_ID => "the server does not know it".to_owned(),
                // rclpy names no goal, and no error either.
                _ => "the server goes on with it".to_owned(),
            },
            Err(error) => error,
        };
        self.push(id, GoalUpdate::CancelRefused(why));
    }

    fn on_result(&mut self, id: &GoalId, reply: Result<Reply, CallError>) {
        let kind = self.spec.kind;
        let fields = match self.fields(reply, kind.get_result()) {
            Ok(fields) => fields,
            Err(text) => return self.end_aborted(id, text),
        };
        let state = match fields.get("status") {
            Some(DynamicValue::I8(state)) => *state,
            _ => GoalStatus::STATUS_UNKNOWN,
        };
        let outcome = match state {
            GoalStatus::STATUS_SUCCEEDED => GoalOutcome::Succeeded,
            GoalStatus::STATUS_CANCELED => GoalOutcome::Canceled,
            GoalStatus::STATUS_ABORTED => GoalOutcome::Aborted,
            // Of several servers, the one that took the goal is to be heard.
            GoalStatus::STATUS_UNKNOWN if self.servers > 1 => return,
            GoalStatus::STATUS_UNKNOWN => {
                let text = "the server does not know the goal: it has started again, or its result has expired";
                return self.end_aborted(id, text.to_owned());
            }
            _ => {
                self.context.counters.dropped(DropReason::Malformed);
                return self
                    .end_aborted(id, format!("its result says that it is in state {state}"));
            }
        };
        self.reach(id, state);
        let result = fields.get("result").and_then(DynamicValue::as_message);
        let result = result.and_then(|it| RosMessage::from_fields(kind.result(), it).ok());
        let result = result.map(Payload::from);
        self.end(id, GoalUpdate::Ended { outcome, result, text: String::new() });
    }

    fn on_states(&mut self, message: &RosMessage) {
        let now = self.context.clock.now();
        let array = match GoalStatusArray::decode(&message.cdr, self.most()) {
            Ok(array) => array,
            Err(error) => {
                self.unread(&ros::fault(&error));
                return;
            }
        };
        for GoalStatus { goal_info, status } in array.status_list {
            let id = goal_info.goal_id.uuid;
            if !self.goals.contains_key(&id) {
                continue;
            }
            if status < GoalStatus::STATUS_SUCCEEDED {
                self.reach(&id, status);
            } else {
                self.reach(&id, GoalStatus::STATUS_ACCEPTED);
                if let Some(goal) = self.goals.get_mut(&id) {
                    goal.ask_at.get_or_insert(now + ASK_AGAIN);
                }
            }
        }
    }

    fn on_feedback(&mut self, message: &RosMessage) {
        match split_id(message, self.spec.kind.feedback(), self.most()) {
            Ok((id, feedback)) if self.goals.contains_key(&id) => {
                self.reach(&id, GoalStatus::STATUS_EXECUTING);
                self.push(&id, GoalUpdate::Feedback(feedback.into()));
            }
            Ok(_) => {}
            Err(error) => {
                self.unread(&error);
            }
        }
    }

    /// Takes what has come to the parts: what may come before an end first.
    fn turn(&mut self) {
        while let Some((call, reply)) = self.send_goal.take() {
            if let Some(id) = self.sent.remove(&call) {
                self.on_goal_reply(&id, reply);
            }
        }
        while let Some(message) = next(&mut *self.status, &self.context) {
            self.on_states(&message);
        }
        while let Some(message) = next(&mut *self.feedback, &self.context) {
            self.on_feedback(&message);
        }
        while let Some((call, reply)) = self.cancel_goal.take() {
            if let Some(id) = self.canceled.remove(&call) {
                self.on_cancel_reply(&id, reply);
            }
        }
        while let Some((call, reply)) = self.get_result.take() {
            if let Some(id) = self.asked.remove(&call) {
                self.on_result(&id, reply);
            }
        }
        self.look_for_servers();
        let now = self.context.clock.now();
        for id in self.ids(|goal| goal.ask_at.is_some_and(|at| at <= now)) {
            self.ask_result(&id);
        }
        for (reason, count) in self.parts.counters.take_drops() {
            self.context.counters.dropped_many(reason, count);
        }
    }

    fn ids(&self, which: impl Fn(&Goal) -> bool) -> Vec<GoalId> {
        self.goals.iter().filter(|(_, goal)| which(goal)).map(|(id, _)| *id).collect()
    }

    /// Ends the goals of servers that have gone, and asks those that have come for the results of the others.
    fn look_for_servers(&mut self) {
        let (now, links) = (self.context.clock.now(), self.links());
        let is_missing = links.iter().any(|link| link.peers == Some(0));
        self.missing_since = is_missing.then(|| self.missing_since.unwrap_or(now));
        let servers = self.whole_servers(&links);
        let before = std::mem::replace(&mut self.servers, servers);
        let is_accepted = |goal: &Goal| goal.status != GoalStatus::STATUS_UNKNOWN;
        match (before, servers) {
            (0, 0) => {
                for id in self.ids(|goal| goal.until <= now) {
                    self.end(&id, GoalUpdate::Rejected("there is no server".to_owned()));
                }
            }
            (_, 0) => {
                for id in self.ids(is_accepted) {
                    self.end_aborted(&id, "the server has gone".to_owned());
                }
                for id in self.ids(|_| true) {
                    self.end(&id, GoalUpdate::Rejected("the server has gone".to_owned()));
                }
            }
            (1.., _) if before != servers => {
                for id in self.ids(is_accepted) {
                    self.ask_result(&id);
                }
            }
            _ => {}
        }
    }
}

impl ActionClient for PartsClient {
    fn send(&mut self, goal: &Request) -> Result<Ticket, CallError> {
        let (kind, limit) = (self.spec.kind, self.spec.goals);
        let service = || self.spec.action.clone();
        if self.goals.len() >= limit {
            return Err(CallError::TooMany { service: service(), limit });
        }
        let body = requests::asked_message(goal, kind.goal(), self.most());
        let body = body.map_err(|fault| CallError::Request { service: service(), fault })?;
        let id = Uuid::new_v4().into_bytes();
        let request = with_id(&id, &body, kind.send_goal().request());
        let call = self.send_goal.send(&Request::Message(request), ACCEPTED_WITHIN)?;
        let ticket = Ticket::new(self.last);
        self.last += 1;
        let until = self.context.clock.now() + ServiceSpec::TIMEOUT;
        let status = GoalStatus::STATUS_UNKNOWN;
        self.goals.insert(id, Goal { ticket, status, until, is_unwanted: false, ask_at: None });
        self.sent.insert(call, id);
        Ok(ticket)
    }

    fn cancel(&mut self, ticket: Ticket) {
        let Some((id, goal)) = self.goals.iter_mut().find(|(_, goal)| goal.ticket == ticket) else {
            return;
        };
        goal.is_unwanted = true;
        let (id, is_accepted) = (*id, goal.status != GoalStatus::STATUS_UNKNOWN);
        if is_accepted && !self.canceled.values().any(|other| *other == id) {
            self.send_cancel(&id);
        }
    }

    fn cancel_all(&mut self) -> Result<(), CallError> {
        // Its answer is about goals whose clients hear of it by themselves.
        self.ask_to_cancel(GoalId::default()).map(drop)
    }

    fn take(&mut self) -> Option<(Ticket, GoalUpdate)> {
        if self.updates.is_empty() {
            self.turn();
        }
        self.updates.pop_front()
    }

    fn deadline(&self) -> Option<Instant> {
        let calls = [&self.send_goal, &self.cancel_goal, &self.get_result];
        let calls = calls.into_iter().filter_map(|client| client.deadline());
        let without_server = self.goals.values().filter(|_| self.servers == 0).map(|it| it.until);
        let missing = self.missing_since.filter(|_| self.servers > 0).map(|it| it + PART_MISSING);
        let again = self.goals.values().filter_map(|goal| goal.ask_at);
        calls.chain(without_server).chain(missing).chain(again).min()
    }

    fn link(&self) -> Link {
        let links = self.links();
        let peers = Some(self.whole_servers(&links));
        let is_missing = |link: &Link| link.peers == Some(0);
        let missing = links.iter().zip(PARTS).filter(|(link, _)| is_missing(link));
        let parts: Vec<&'static str> = missing.map(|(_, part)| part).collect();
        let absent = Absent::new(Role::ActionServer, "a server of", NAME, &self.spec.action);
        // A part that is nobody's is no cause of its own.
        let tells = |cause: &Cause| !matches!(cause, Cause::Nobody(_));
        let cause = links.into_iter().find_map(|link| link.waiting_for.filter(tells));
        let waiting_for = match parts.len() {
            _ if peers != Some(0) => None,
            _ if cause.is_some() => cause,
            // Services alone are a bridge whose real server is away.
            1.. if parts.len() < PARTS.len() && Some(&*parts) != PARTS.get(SERVICES..) => {
                Some(Cause::PartsMissing { absent, parts })
            }
            _ => Some(Cause::Nobody(absent)),
        };
        Link { peers, waiting_for, keeps_last: false }
    }
}

/// Forgets the calls for a goal.
fn forget(calls: &mut BTreeMap<Ticket, GoalId>, client: &mut dyn Client, id: &GoalId) {
    calls.retain(|call, of| {
        let stays = of != id;
        if !stays {
            client.cancel(*call);
        }
        stays
    });
}

/// Message that a listener takes next; what cannot be read is counted.
fn next(listener: &mut dyn Listener, context: &Context) -> Option<RosMessage> {
    loop {
        match listener.take() {
            Ok(None) => return None,
            Ok(Some(Sample { payload: Payload::RosMessage(message), .. })) => return Some(message),
            Ok(Some(_)) => context.counters.dropped(DropReason::Mismatch),
            Err(error) => context.counters.dropped((&error).into()),
        }
    }
}
