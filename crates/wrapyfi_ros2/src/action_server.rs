//! Serves an action with three services and two publishers.
//!
//! ```text
//!   send_goal ───▶ goal ───▶ take        update: accepted, rejected ───▶ the reply of send_goal
//!   cancel_goal ─▶ wishes ─▶ take                canceling, refused ───▶ the reply of cancel_goal
//!   get_result ──▶ waits with its goal           ended ────────────────▶ the reply of get_result
//!                                                feedback ─▶ feedback    any change ─▶ status
//! ```
//!
//! A client takes the server for there when it has found all five. So an action whose real server is away keeps its
//! services and closes its topics. Were the services closed too, clients on Fast DDS would go on taking them for there:
//! it passes over the end of an endpoint of RustDDS, whose notice has the key where Fast DDS looks for its hash. They
//! would send their next goal to what is no longer there as soon as the new topics are.

use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};
use std::time::{Duration, Instant};

use wrapyfi_interfaces::Message as _;
use wrapyfi_interfaces::action_msgs::msg::{GoalInfo, GoalStatus, GoalStatusArray};
use wrapyfi_interfaces::action_msgs::srv::{CancelGoal_Request, CancelGoal_Response};
use wrapyfi_interfaces::builtin_interfaces::msg::Time;
use wrapyfi_interfaces::dynamic::DynamicMessage;
use wrapyfi_interfaces::unique_identifier_msgs::msg::UUID;

use super::action::{GoalId, Parts, context_of_parts, next_state, split_id, with_id};
use wrapyfi_data::types::{Payload, RosMessage, RosService, RosType};
use wrapyfi_data::{DecodeError, EncodeError, EncodeResult};
use wrapyfi_endpoint::codec::{requests, ros};
use wrapyfi_endpoint::{
    ActionServer, ActionSpec, Context, DropReason, GoalNumber, GoalOutcome, GoalRequest,
    GoalUpdate, IncomingRequest, Link, Middleware, OpenResult, PublishError, Publisher, Request,
    RequestId, ServeError, ServeResult, Server,
};

/// Time for which the result of a goal that has ended can be asked for, as `rcl_action` has it.
const RESULT_KEPT: Duration = Duration::from_secs(10);
/// Time that the owner has to say what becomes of goals that are to be cancelled. Clients wait for it.
const CANCEL_DECIDED: Duration = Duration::from_secs(3);
/// Time for which a goal waits for the first reader of the feedback. A client on Fast DDS takes the server for there
/// before CycloneDDS knows the client's reader, and feedback is not kept: what is published until then is lost to it.
const READER_KNOWN: Duration = Duration::from_millis(500);
/// Requests for the result of one goal that wait. Clients ask once, and once more where they doubt that they were heard.
const RESULT_REQUESTS: usize = 16;

/// An action that this program offers.
pub(super) struct PartsServer {
    spec: ActionSpec,
    context: Context,
    /// Counters of the parts.
    parts: Context,
    send_goal: Box<dyn Server>,
    cancel_goal: Box<dyn Server>,
    get_result: Box<dyn Server>,
    /// Closed while the action is hidden.
    topics: Option<Topics>,
    cancel: RosService,
    states: RosType,
    goals: BTreeMap<GoalNumber, Goal>,
    numbers: HashMap<GoalId, GoalNumber>,
    /// Goal that waits until the feedback has a reader.
    held: Option<IncomingRequest>,
    cancels: Vec<Cancel>,
    /// Goals that are to be cancelled, which the owner has not heard of.
    wishes: VecDeque<GoalRequest>,
    last: u64,
}

struct Topics {
    feedback: Box<dyn Publisher>,
    status: Box<dyn Publisher>,
}

struct Goal {
    info: GoalInfo,
    status: i8,
    /// Request that brought the goal, until it is answered.
    asked: Option<RequestId>,
    received_at: Instant,
    /// Requests for the result that wait for the end.
    waiting: VecDeque<RequestId>,
    end: Option<End>,
}

struct End {
    at: Instant,
    response: RosMessage,
    was_fetched: bool,
}

/// A request to cancel goals that is not answered yet.
struct Cancel {
    asked: RequestId,
    undecided: BTreeSet<GoalNumber>,
    canceling: Vec<GoalInfo>,
    due: Instant,
}

impl Topics {
    fn open(middleware: &dyn Middleware, of: &Parts, parts: &Context) -> OpenResult<Self> {
        Ok(Self {
            status: middleware.open_publisher(&of.status, parts)?,
            feedback: middleware.open_publisher(&of.feedback, parts)?,
        })
    }
}

impl PartsServer {
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
            // The topics come first, so that no state and no feedback is missed.
            topics: Some(Topics::open(middleware, &of, &parts)?),
            get_result: middleware.open_server(&of.get_result, &parts)?,
            cancel_goal: middleware.open_server(&of.cancel_goal, &parts)?,
            send_goal: middleware.open_server(&of.send_goal, &parts)?,
            cancel: of.cancel,
            states: of.states,
            spec: spec.clone(),
            context: context.clone(),
            parts,
            goals: BTreeMap::new(),
            numbers: HashMap::new(),
            held: None,
            cancels: Vec::new(),
            wishes: VecDeque::new(),
            last: 0,
        })
    }

    fn most(&self) -> usize {
        self.spec.limits.message_bytes
    }

    fn unread(&self, error: &DecodeError) -> ServeError {
        let reason = DropReason::from(error);
        self.context.counters.dropped(reason);
        ServeError::Request { service: self.spec.action.clone(), fault: error.to_string(), reason }
    }

    fn unsent(&self, fault: EncodeError) -> ServeError {
        ServeError::Reply { service: self.spec.action.clone(), fault }
    }

    /// The message of a request.
    fn message(&self, request: &Request, ros_type: RosType) -> Result<RosMessage, ServeError> {
        requests::asked_message(request, ros_type, self.most()).map_err(|fault| {
            self.unread(&DecodeError::mismatch(ros_type.to_string(), fault.to_string()))
        })
    }

    /// Answers a request of `send_goal`.
    fn answer_goal(&mut self, asked: RequestId, stamp: Option<&Time>) -> ServeResult<usize> {
        let response = self.spec.kind.send_goal().response();
        let mut fields = response.plan().default_message();
        let set = |fields: &mut DynamicMessage, stamp: &Time| {
            fields.set("accepted", true)?;
            fields.set("stamp.sec", stamp.sec)?;
            fields.set("stamp.nanosec", stamp.nanosec)
        };
        let message = stamp.map_or(Ok(()), |stamp| set(&mut fields, stamp));
        let message = message.and_then(|()| RosMessage::from_fields(response, &fields));
        let message =
            message.map_err(|error| self.unsent(unsuitable(response, &error.to_string())))?;
        self.send_goal.reply(asked, Ok(message.into()))
    }

    /// The next goal that came, once somebody reads the feedback, or that is not to be waited for any longer.
    fn next_goal(&mut self) -> ServeResult<Option<IncomingRequest>> {
        if self.held.is_none() {
            self.held = self.send_goal.take()?;
        }
        let readers = self.topics.as_ref().map(|topics| topics.feedback.link().peers);
        let is_unread = readers == Some(Some(0));
        let age = |held: &mut IncomingRequest| self.context.clock.age(held.received_at);
        Ok(self.held.take_if(|held| !is_unread || age(held) >= READER_KNOWN))
    }

    /// Takes a goal that came, unless it is refused at once.
    fn begin_goal(&mut self, incoming: IncomingRequest) -> ServeResult<Option<GoalRequest>> {
        let IncomingRequest { id: asked, request, wire_bytes, received_at } = incoming;
        let kind = self.spec.kind;
        self.context.counters.received(wire_bytes);
        let read = self.message(&request, kind.send_goal().request()).and_then(|message| {
            split_id(&message, kind.goal(), self.most()).map_err(|error| self.unread(&error))
        });
        let (uuid, goal) = match read {
            Ok(read) => read,
            Err(error) => {
                self.answer_goal(asked, None)?;
                return Err(error);
            }
        };
        let under_way = self.goals.values().filter(|goal| goal.end.is_none()).count();
        let refused = match self.numbers.contains_key(&uuid) {
            true => Some(DropReason::Duplicate),
            false => (under_way >= self.spec.goals).then_some(DropReason::Overloaded),
        };
        if let Some(reason) = refused {
            self.context.counters.dropped(reason);
            self.answer_goal(asked, None)?;
            return Ok(None);
        }
        self.last += 1;
        let number = GoalNumber(self.last);
        let info = GoalInfo { goal_id: UUID { uuid }, ..GoalInfo::default() };
        let (status, waiting) = (GoalStatus::STATUS_UNKNOWN, VecDeque::new());
        let goal_kept = Goal { info, status, asked: Some(asked), received_at, waiting, end: None };
        self.goals.insert(number, goal_kept);
        self.numbers.insert(uuid, number);
        Ok(Some(GoalRequest::Goal { number, goal: Request::Message(goal), wire_bytes }))
    }

    /// Answers a request for a result, or lets it wait.
    fn begin_result(&mut self, incoming: &IncomingRequest) -> ServeResult<()> {
        let request = self.spec.kind.get_result().request();
        let message = self.message(&incoming.request, request)?;
        let read = UUID::decode(&message.cdr, self.most());
        let uuid = read.map_err(|error| self.unread(&ros::fault(&error)))?.uuid;
        let goal = self.numbers.get(&uuid).and_then(|number| self.goals.get_mut(number));
        let response = match goal {
            Some(Goal { end: Some(end), .. }) => {
                end.was_fetched = true;
                end.response.clone()
            }
            Some(goal) if goal.status != GoalStatus::STATUS_UNKNOWN => {
                goal.waiting.push_back(incoming.id);
                if goal.waiting.len() > RESULT_REQUESTS
                    && let Some(oldest) = goal.waiting.pop_front()
                {
                    _ = self.get_result.reply(oldest, Err("asked too often".into()));
                }
                return Ok(());
            }
            _ => self
                .response(GoalStatus::STATUS_UNKNOWN, None)
                .map_err(|fault| self.unsent(fault))?,
        };
        self.get_result.reply(incoming.id, Ok(response.into())).map(drop)
    }

    /// Response of `get_result` for a goal in this state.
    fn response(&self, status: i8, result: Option<&Payload>) -> EncodeResult<RosMessage> {
        let (kind, most) = (self.spec.kind, self.most());
        let response = kind.get_result().response();
        let unsuitable = |error: &dyn std::error::Error| unsuitable(response, &error.to_string());
        let mut fields = response.plan().default_message();
        fields.set("status", status).map_err(|error| unsuitable(&error))?;
        if let Some(result) = result {
            let result = requests::returned_message(result, kind.result(), most)?;
            let result = result.fields(most).map_err(|error| unsuitable(&error))?;
            fields.set("result", result).map_err(|error| unsuitable(&error))?;
        }
        let message = RosMessage::from_fields(response, &fields);
        let message = message.map_err(|error| unsuitable(&error))?;
        EncodeError::check_size(message.cdr.len(), most)?;
        Ok(message)
    }

    /// Begins to cancel goals: which, and how the request is answered where there is none, is `rcl_action`'s.
    fn begin_cancel(&mut self, incoming: &IncomingRequest) -> ServeResult<()> {
        type Code = CancelGoal_Response;
        let message = self.message(&incoming.request, self.cancel.request())?;
        let read = CancelGoal_Request::decode(&message.cdr, self.most());
        let wanted = read.map_err(|error| self.unread(&ros::fault(&error)))?.goal_info;
        let (uuid, stamp) = (wanted.goal_id.uuid, nanoseconds(&wanted.stamp));
        let one = self.numbers.get(&uuid).copied();
        let is_one_meant = uuid != GoalId::default() && stamp == 0;
        let is_all_meant = uuid == GoalId::default() && stamp == 0;
        let is_meant = |(number, goal): &(&GoalNumber, &Goal)| {
            let by_time = is_all_meant || (!is_one_meant && nanoseconds(&goal.info.stamp) <= stamp);
            let can = [GoalStatus::STATUS_ACCEPTED, GoalStatus::STATUS_EXECUTING];
            can.contains(&goal.status) && (by_time || Some(**number) == one)
        };
        let undecided: BTreeSet<GoalNumber> =
            self.goals.iter().filter(is_meant).map(|(number, _)| *number).collect();
        let is_asked =
            |number: &GoalNumber| self.cancels.iter().any(|it| it.undecided.contains(number));
        let wishes = undecided.iter().filter(|number| !is_asked(number));
        self.wishes.extend(wishes.copied().map(GoalRequest::Cancel));
        if is_all_meant && !self.wishes.contains(&GoalRequest::CancelAll) {
            self.wishes.push_back(GoalRequest::CancelAll);
        }
        if undecided.is_empty() {
            let status = one.and_then(|number| self.goals.get(&number)).map(|goal| goal.status);
            let code = match status.filter(|status| *status != GoalStatus::STATUS_UNKNOWN) {
                _ if !is_one_meant => Code::ERROR_NONE,
                None => Code::ERROR_UNKNOWN_GOAL_ID,
                Some(_) => Code::ERROR_GOAL_TERMINATED,
            };
            self.answer_cancel(incoming.id, code, Vec::new());
            return Ok(());
        }
        let due = self.context.clock.now() + CANCEL_DECIDED;
        self.cancels.push(Cancel { asked: incoming.id, undecided, canceling: Vec::new(), due });
        Ok(())
    }

    /// Notes whether a goal is being cancelled, and answers the requests that waited for that alone.
    fn decide(&mut self, number: GoalNumber, is_canceling: bool) {
        let Some(info) = self.goals.get(&number).map(|goal| goal.info.clone()) else { return };
        for cancel in &mut self.cancels {
            if cancel.undecided.remove(&number) && is_canceling {
                cancel.canceling.push(info.clone());
            }
        }
        self.answer_cancels();
    }

    /// Answers the requests to cancel all of whose goals are decided, or that have waited for long enough.
    fn answer_cancels(&mut self) {
        let now = self.context.clock.now();
        let is_ready = |it: &mut Cancel| it.undecided.is_empty() || it.due <= now;
        for cancel in self.cancels.extract_if(.., is_ready).collect::<Vec<_>>() {
            let code = match cancel.canceling.is_empty() {
                true => CancelGoal_Response::ERROR_REJECTED,
                false => CancelGoal_Response::ERROR_NONE,
            };
            self.answer_cancel(cancel.asked, code, cancel.canceling);
        }
    }

    fn answer_cancel(&mut self, asked: RequestId, return_code: i8, goals_canceling: Vec<GoalInfo>) {
        let response = CancelGoal_Response { return_code, goals_canceling };
        let message = RosMessage::new(self.cancel.response(), response.encode());
        if let Err(error) = self.cancel_goal.reply(asked, Ok(message.into())) {
            tracing::debug!(action = self.spec.action, %error, "a cancellation was not answered");
        }
    }

    /// Brings a goal to a state over those before it; size of the reply to its client, where that was sent.
    fn reach(&mut self, number: GoalNumber, state: i8) -> ServeResult<usize> {
        let mut sent = Ok(0);
        while let Some(goal) = self.goals.get_mut(&number)
            && let Some(next) = next_state(goal.status, state)
        {
            goal.status = next;
            if let Some(asked) = goal.asked.take() {
                let stamp = self.context.clock.ros_now().stamp;
                goal.info.stamp = Time { sec: stamp.sec, nanosec: stamp.nanosec };
                let stamp = goal.info.stamp.clone();
                sent = self.answer_goal(asked, Some(&stamp));
            }
            self.publish_status();
            if next == GoalStatus::STATUS_CANCELING {
                self.decide(number, true);
            }
        }
        sent
    }

    fn publish_status(&mut self) {
        let known = self.goals.values().filter(|it| it.status != GoalStatus::STATUS_UNKNOWN);
        let status = |goal: &Goal| GoalStatus { goal_info: goal.info.clone(), status: goal.status };
        let array = GoalStatusArray { status_list: known.map(status).collect() };
        let message = RosMessage::new(self.states, array.encode());
        let Some(topics) = &mut self.topics else { return };
        match topics.status.publish(&message.into()) {
            Ok(_) | Err(PublishError::NoConsumer(_)) => {}
            Err(error) => {
                self.context.counters.dropped(error.drop_reason());
                tracing::debug!(action = self.spec.action, %error, "states were not sent");
            }
        }
    }

    fn publish_feedback(&mut self, number: GoalNumber, payload: &Payload) -> ServeResult<usize> {
        let kind = self.spec.kind;
        let body = requests::returned_message(payload, kind.feedback(), self.most())
            .map_err(|fault| self.unsent(fault))?;
        let Some(goal) = self.goals.get(&number) else { return Ok(0) };
        let message = with_id(&goal.info.goal_id.uuid, &body, kind.feedback_message());
        let Some(topics) = &mut self.topics else { return Ok(0) };
        match topics.feedback.publish(&message.into()) {
            Ok(bytes) => Ok(bytes),
            Err(PublishError::NoConsumer(_)) => Ok(0),
            Err(PublishError::Encode(fault)) => Err(self.unsent(fault)),
            Err(error) => Err(ServeError::Transport {
                service: self.spec.action.clone(),
                reason: error.to_string(),
            }),
        }
    }

    fn reject(&mut self, number: GoalNumber) -> ServeResult<usize> {
        let Some(goal) = self.forget(number) else { return Ok(0) };
        goal.asked.map_or(Ok(0), |asked| self.answer_goal(asked, None))
    }

    /// Ends a goal, and answers those who wait for its result.
    fn end(
        &mut self,
        number: GoalNumber,
        outcome: GoalOutcome,
        result: Option<&Payload>,
    ) -> ServeResult<usize> {
        let status = match outcome {
            GoalOutcome::Succeeded => GoalStatus::STATUS_SUCCEEDED,
            GoalOutcome::Canceled => GoalStatus::STATUS_CANCELED,
            GoalOutcome::Aborted => GoalStatus::STATUS_ABORTED,
        };
        let (status, response, fault) = match self.response(status, result) {
            Ok(response) => (status, response, None),
            Err(fault) => {
                let status = GoalStatus::STATUS_ABORTED;
                let response = self.response(status, None).map_err(|it| self.unsent(it))?;
                (status, response, Some(self.unsent(fault)))
            }
        };
        let reached = self.reach(number, status);
        self.decide(number, status == GoalStatus::STATUS_CANCELED);
        self.wishes.retain(|wish| *wish != GoalRequest::Cancel(number));
        let Some(goal) = self.goals.get_mut(&number) else { return Ok(0) };
        let (waiting, bytes) = (std::mem::take(&mut goal.waiting), response.cdr.len());
        let was_fetched = !waiting.is_empty();
        goal.end =
            Some(End { at: self.context.clock.now(), response: response.clone(), was_fetched });
        for asked in waiting {
            if let Err(error) = self.get_result.reply(asked, Ok(response.clone().into())) {
                tracing::debug!(action = self.spec.action, %error, "a result was not sent");
            }
        }
        reached?;
        fault.map_or(Ok(bytes), Err)
    }

    fn forget(&mut self, number: GoalNumber) -> Option<Goal> {
        let goal = self.goals.remove(&number)?;
        self.numbers.remove(&goal.info.goal_id.uuid);
        Some(goal)
    }

    /// Forgets the goals whose results were kept for long enough, and the oldest of too many.
    fn forget_old(&mut self) {
        let now = self.context.clock.now();
        let ended = |(number, goal): (&GoalNumber, &Goal)| Some((goal.end.as_ref()?.at, *number));
        let mut ended: Vec<_> = self.goals.iter().filter_map(ended).collect();
        ended.sort_unstable();
        let too_many = ended.len().saturating_sub(self.spec.goals);
        for (place, (at, number)) in ended.into_iter().enumerate() {
            if place < too_many || at + RESULT_KEPT <= now {
                self.forget(number);
            }
        }
    }

    /// Counts what was dropped in the parts as dropped in the action.
    fn count_drops(&self) {
        for (reason, count) in self.parts.counters.take_drops() {
            self.context.counters.dropped_many(reason, count);
        }
    }
}

impl ActionServer for PartsServer {
    fn take(&mut self) -> ServeResult<Option<GoalRequest>> {
        self.forget_old();
        self.answer_cancels();
        self.count_drops();
        while let Some(incoming) = self.get_result.take()? {
            if let Err(error) = self.begin_result(&incoming) {
                return Err(refused(&mut *self.get_result, incoming.id, error));
            }
        }
        while let Some(incoming) = self.cancel_goal.take()? {
            if let Err(error) = self.begin_cancel(&incoming) {
                return Err(refused(&mut *self.cancel_goal, incoming.id, error));
            }
        }
        if let Some(wish) = self.wishes.pop_front() {
            return Ok(Some(wish));
        }
        while let Some(incoming) = self.next_goal()? {
            if let Some(goal) = self.begin_goal(incoming)? {
                return Ok(Some(goal));
            }
        }
        Ok(None)
    }

    fn update(&mut self, number: GoalNumber, update: GoalUpdate) -> ServeResult<usize> {
        let Some(goal) = self.goals.get(&number).filter(|goal| goal.end.is_none()) else {
            return Ok(0);
        };
        let (is_asked, received_at) = (goal.asked.is_some(), goal.received_at);
        let bytes = match update {
            GoalUpdate::Rejected(_) if is_asked => self.reject(number),
            GoalUpdate::Rejected(_) => self.end(number, GoalOutcome::Aborted, None),
            GoalUpdate::Accepted => self.reach(number, GoalStatus::STATUS_ACCEPTED),
            GoalUpdate::Executing => self.reach(number, GoalStatus::STATUS_EXECUTING),
            GoalUpdate::Canceling => self.reach(number, GoalStatus::STATUS_CANCELING),
            GoalUpdate::CancelRefused(_) => {
                self.decide(number, false);
                Ok(0)
            }
            GoalUpdate::Feedback(payload) => self
                .reach(number, GoalStatus::STATUS_ACCEPTED)
                .and_then(|_| self.publish_feedback(number, &payload)),
            GoalUpdate::Ended { outcome, result, .. } => self.end(number, outcome, result.as_ref()),
        }?;
        // What a client is told of a goal that it has sent long ago was not late for that.
        let clock = &self.context.clock;
        let added = if is_asked { clock.age(received_at) } else { Duration::ZERO };
        self.context.counters.sent(bytes, added);
        Ok(bytes)
    }

    fn kept(&self) -> usize {
        let is_kept = |goal: &&Goal| goal.end.as_ref().is_none_or(|end| !end.was_fetched);
        let replies = [&self.send_goal, &self.cancel_goal, &self.get_result];
        let replies = replies.map(|server| server.kept()).iter().sum::<usize>();
        self.goals.values().filter(is_kept).count() + replies + usize::from(self.held.is_some())
    }

    fn deadline(&self) -> Option<Instant> {
        let ended = self.goals.values().filter_map(|goal| Some(goal.end.as_ref()?.at));
        let parts = [&self.send_goal, &self.cancel_goal, &self.get_result];
        let parts = parts.into_iter().filter_map(|server| server.deadline());
        let due = self.cancels.iter().map(|cancel| cancel.due);
        let held = self.held.iter().map(|held| held.received_at + READER_KNOWN);
        ended.map(|at| at + RESULT_KEPT).chain(due).chain(held).chain(parts).min()
    }

    fn link(&self) -> Link {
        self.send_goal.link()
    }

    fn hide(&mut self) -> bool {
        self.topics = None;
        true
    }

    fn show(&mut self, on: &dyn Middleware) -> OpenResult<()> {
        if self.topics.is_none() {
            self.topics = Some(Topics::open(on, &Parts::of(&self.spec)?, &self.parts)?);
        }
        Ok(())
    }
}

impl Drop for PartsServer {
    fn drop(&mut self) {
        if let Some(held) = self.held.take()
            && let Err(error) = self.answer_goal(held.id, None)
        {
            tracing::debug!(action = self.spec.action, %error, "a goal was not answered");
        }
        let going = self.goals.iter().filter(|(_, goal)| goal.end.is_none());
        for number in going.map(|(number, _)| *number).collect::<Vec<_>>() {
            let asked = self.goals.get(&number).is_some_and(|goal| goal.asked.is_some());
            let ended = match asked {
                true => self.reject(number),
                false => self.end(number, GoalOutcome::Aborted, None),
            };
            if let Err(error) = ended {
                tracing::debug!(action = self.spec.action, %error, "the end of a goal was not sent");
            }
        }
    }
}

/// Gives a request up that cannot be served.
fn refused(server: &mut dyn Server, asked: RequestId, error: ServeError) -> ServeError {
    // The types of actions have no room for the reason.
    _ = server.reply(asked, Err(error.to_string().into()));
    error
}

fn nanoseconds(stamp: &Time) -> i64 {
    i64::from(stamp.sec) * 1_000_000_000 + i64::from(stamp.nanosec)
}

fn unsuitable(ros_type: RosType, fault: &str) -> EncodeError {
    EncodeError::mismatch(format!("the fields of {ros_type}"), fault.to_owned())
}
