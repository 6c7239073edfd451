//! Actions of middlewares that have none: a function is called with the goal, and its reply is the result.
//!
//! ```text
//!   goal ─────▶ the fields as arguments ──▶ function     one that ends late enough for its clients to wait
//!   succeeded ◀──────── reply ─────────────────┘         an error, and a server that has gone, abort the goal
//!   feedback  ◀── topic of the option `feedback`, and replies to the request of the option `poll`
//! ```
//!
//! A function that only begins something, such as a movement, has the option `until`: its goal goes on after the reply,
//! until feedback says that it is over. Neither Wrapyfi nor YARP has a word by which a call is taken back, so a wish to
//! cancel is refused.

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use crate::calls::ends;
use crate::codec::requests::returned_message;
use crate::service_error::CallError;
use crate::{
    ActionClient, ActionSpec, Client, Context, GoalOutcome, GoalUpdate, Link, Listener, Middleware,
    OpenError, Opened, Request, ServiceSpec, Ticket, TopicSpec,
};
use wrapyfi_data::types::{Map, MessageType, Payload, RosAction, ServiceKind, Value};
use wrapyfi_interfaces::dynamic::DynamicValue;

/// Option that names the topic of the feedback.
pub const FEEDBACK: &str = "feedback";
/// Option with the words of a request whose replies are feedback.
pub const POLL: &str = "poll";
/// Option with the time between two of these requests, in milliseconds.
pub const POLL_MS: &str = "poll_ms";
/// Option with the name of the field of the feedback, true or false, that says when a goal is over.
pub const UNTIL: &str = "until";
/// Options of actions on middlewares that have none.
pub const OPTIONS: [&str; 4] = [FEEDBACK, POLL, POLL_MS, UNTIL];

/// Time between two requests for feedback unless said otherwise.
const POLL_EVERY: Duration = Duration::from_millis(200);
/// Longest time between two looks for the server while a goal is under way.
const LOOK_EVERY: Duration = Duration::from_millis(500);
/// Time that such a request has.
const POLL_TIMEOUT: Duration = Duration::from_secs(2);
/// Time that a call has unless said otherwise: longer than any robot moves.
const NO_TIMEOUT: Duration = Duration::from_secs(1 << 30);

/// Checks the value of an option of these.
///
/// # Errors
/// When it is not of the kind that the option has.
pub fn check_option(name: &str, value: &Value) -> Result<(), String> {
    match (name, value) {
        (FEEDBACK, Value::Str(topic)) if topic.starts_with('/') => Ok(()),
        (FEEDBACK, _) => {
            Err("option feedback must be the name of a topic, such as /progress".into())
        }
        (POLL, Value::Str(words)) if !words.trim().is_empty() => Ok(()),
        (POLL, _) => {
            Err("option poll must be the words of a request, such as checkMotionDone".into())
        }
        (POLL_MS, value) if value.as_i64().is_some_and(|ms| (10..=3_600_000).contains(&ms)) => {
            Ok(())
        }
        (POLL_MS, _) => Err("option poll_ms must lie between 10 and 3600000".into()),
        (UNTIL, Value::Str(field)) if !field.is_empty() => Ok(()),
        (UNTIL, _) => {
            Err("option until must be the name of a field of the feedback, such as done".into())
        }
        _ => Ok(()),
    }
}

/// Opens a client that sends its goals to the function `spec.action` of `middleware`. `words` is the option in which that
/// takes the words of a request; `None` where they are its arguments.
///
/// # Errors
/// When an option is wrong, or the function can never be called as asked.
pub fn open(
    middleware: &(impl Middleware + ?Sized),
    spec: &ActionSpec,
    context: &Context,
    words: Option<&str>,
) -> Opened<dyn ActionClient> {
    let wrong = |reason| OpenError::transport("action", &spec.action, reason);
    let option = |name: &str| spec.options.get(name);
    for name in OPTIONS {
        if let Some(value) = option(name) {
            check_option(name, value).map_err(wrong)?;
        }
    }
    check_until(&spec.options, spec.kind).map_err(wrong)?;
    let text = |name: &str| option(name).and_then(Value::as_str);
    let service = |kind| ServiceSpec {
        timeout: spec.timeout.unwrap_or(NO_TIMEOUT),
        pending: spec.goals,
        color_order: spec.color_order,
        limits: spec.limits,
        plugins: spec.plugins.clone(),
        options: spec.options.clone(),
        mark: spec.mark.clone(),
        ..ServiceSpec::new(&*spec.action, ServiceKind::Ros(kind))
    };
    let poll = match text(POLL) {
        None => None,
        Some(asked) => {
            let mut service = service(spec.kind.progress());
            let request = match words {
                Some(words) => {
                    service.options.insert(words, asked);
                    Request::default()
                }
                None => Request::new(asked.split_whitespace().map(Value::from).collect::<Vec<_>>()),
            };
            Some(Poll {
                client: middleware.open_client(&service, context)?,
                request,
                every: option(POLL_MS)
                    .and_then(Value::as_i64)
                    .map_or(POLL_EVERY, |ms| Duration::from_millis(ms.unsigned_abs())),
                next: None,
                sent_at: BTreeMap::new(),
            })
        }
    };
    let feedback = match text(FEEDBACK) {
        None => None,
        Some(topic) => {
            let topic = TopicSpec {
                color_order: spec.color_order,
                limits: spec.limits,
                plugins: spec.plugins.clone(),
                ..TopicSpec::new(topic, MessageType::Ros(spec.kind.feedback()))
            };
            Some(middleware.open_listener(&topic, context)?)
        }
    };
    Ok(Box::new(FunctionAction {
        client: middleware.open_client(&service(spec.kind.function()), context)?,
        spec: spec.clone(),
        feedback,
        poll,
        goals: BTreeMap::new(),
        updates: VecDeque::new(),
        context: context.clone(),
    }))
}

/// Checks that the option `until`, where it is given, can say when a goal of the action is over.
///
/// # Errors
/// When nothing gives feedback, or the feedback has no such field that is true or false.
pub fn check_until(options: &Map, kind: RosAction) -> Result<(), String> {
    let Some(field) = options.get(UNTIL).and_then(Value::as_str) else { return Ok(()) };
    if options.get(FEEDBACK).or_else(|| options.get(POLL)).is_none() {
        return Err("option until is about feedback: give the option feedback or poll, too".into());
    }
    let kind = kind.feedback();
    let defaults = kind.plan().default_message();
    if let Some(DynamicValue::Bool(_)) = defaults.get(field) {
        return Ok(());
    }
    let truths = defaults.fields().filter(|(_, value)| matches!(value, DynamicValue::Bool(_)));
    let truths: Vec<_> = truths.map(|(name, _)| name).collect();
    let names = if truths.is_empty() { "none".to_owned() } else { truths.join(", ") };
    Err(format!("option until is {field}: fields of {kind} that are true or false: {names}"))
}

/// A request that is made again and again while a goal is under way.
struct Poll {
    client: Box<dyn Client>,
    request: Request,
    every: Duration,
    next: Option<Instant>,
    /// Instants at which the requests were sent that have no reply.
    sent_at: BTreeMap<Ticket, Instant>,
}

/// A goal under way.
struct Goal {
    /// Instant at which the time of the goal is over.
    ends: Instant,
    /// Reply of a function whose goal goes on after it, and the instant at which it was taken.
    replied: Option<(Instant, Payload)>,
}

struct FunctionAction {
    spec: ActionSpec,
    client: Box<dyn Client>,
    feedback: Option<Box<dyn Listener>>,
    poll: Option<Poll>,
    goals: BTreeMap<Ticket, Goal>,
    updates: VecDeque<(Ticket, GoalUpdate)>,
    context: Context,
}

impl FunctionAction {
    /// Time that a goal has.
    fn timeout(&self) -> Duration {
        self.spec.timeout.unwrap_or(NO_TIMEOUT)
    }

    fn until(&self) -> Option<&str> {
        self.spec.options.get(UNTIL).and_then(Value::as_str)
    }

    /// Gives a message, which tells of the time since `since`, to all goals, because neither a topic nor a reply says
    /// which one it is about.
    fn give(&mut self, payload: &Payload, since: Instant) {
        let kind = self.spec.kind.feedback();
        let message = match returned_message(payload, kind, self.spec.limits.message_bytes) {
            Ok(message) => message,
            Err(error) => {
                tracing::debug!("{}: feedback is no {kind}: {error}", self.spec.action);
                return self.context.counters.dropped(crate::DropReason::Mismatch);
            }
        };
        let is_over = self.until().is_some_and(|field| {
            let fields = message.fields(self.spec.limits.message_bytes);
            fields.is_ok_and(|fields| fields.get(field) == Some(&DynamicValue::Bool(true)))
        });
        let update = || GoalUpdate::Feedback(message.clone().into());
        self.updates.extend(self.goals.keys().map(|ticket| (*ticket, update())));
        if is_over {
            for (ticket, goal) in std::mem::take(&mut self.goals) {
                match goal.replied {
                    Some((at, reply)) if at <= since => {
                        self.updates.push_back((ticket, succeeded(reply)));
                    }
                    replied => _ = self.goals.insert(ticket, Goal { replied, ..goal }),
                }
            }
        }
    }

    fn look(&mut self) {
        while let Some(listener) = &mut self.feedback {
            match listener.take() {
                Ok(Some(sample)) => self.give(&sample.payload, sample.received_at),
                Ok(None) => break,
                // The listener has counted it.
                Err(error) => tracing::debug!("{}: feedback: {error}", self.spec.action),
            }
        }
        self.poll();
        let now = self.context.clock.now();
        while let Some((ticket, result)) = self.client.take() {
            let Some(goal) = self.goals.get_mut(&ticket) else { continue };
            let update = match result {
                Ok(reply) if self.spec.options.get(UNTIL).is_some() => {
                    goal.replied = Some((now, reply.payload));
                    continue;
                }
                Ok(reply) => succeeded(reply.payload),
                Err(error) => GoalUpdate::aborted(error.to_string()),
            };
            self.goals.remove(&ticket);
            self.updates.push_back((ticket, update));
        }
        self.abandon(now);
    }

    /// Aborts the goals of a server that has gone, and those whose time is over. Neither Wrapyfi nor YARP says that a
    /// function has failed where its program ends.
    fn abandon(&mut self, now: Instant) {
        if self.goals.is_empty() {
            return;
        }
        let link = self.client.link();
        let gone = match (link.waiting_for, link.peers) {
            (Some(cause), _) => Some(format!("the server has gone, waiting for {cause}")),
            (None, Some(0)) => Some("the server has gone".to_owned()),
            _ => None,
        };
        for (ticket, goal) in std::mem::take(&mut self.goals) {
            let why = match &gone {
                Some(why) => why.clone(),
                None if goal.replied.is_some() && goal.ends <= now => {
                    format!("it took longer than {} ms", self.timeout().as_millis())
                }
                None => {
                    self.goals.insert(ticket, goal);
                    continue;
                }
            };
            self.client.cancel(ticket);
            self.updates.push_back((ticket, GoalUpdate::aborted(why)));
        }
    }

    fn poll(&mut self) {
        let Some(poll) = &mut self.poll else { return };
        let now = self.context.clock.now();
        if self.goals.is_empty() {
            poll.next = None;
        } else if poll.next.is_none_or(|at| now >= at) {
            poll.next = Some(now + poll.every);
            match poll.client.send(&poll.request, POLL_TIMEOUT) {
                Ok(ticket) => _ = poll.sent_at.insert(ticket, now),
                Err(error) => tracing::debug!("{}: {error}", self.spec.action),
            }
        }
        let mut replies = Vec::new();
        while let Some((ticket, reply)) = poll.client.take() {
            let sent_at = poll.sent_at.remove(&ticket);
            match reply {
                Ok(reply) => replies.extend(sent_at.map(|at| (reply.payload, at))),
                Err(error) => tracing::debug!("{}: {error}", self.spec.action),
            }
        }
        replies.iter().for_each(|(payload, at)| self.give(payload, *at));
    }
}

fn succeeded(result: Payload) -> GoalUpdate {
    let (outcome, text) = (GoalOutcome::Succeeded, String::new());
    GoalUpdate::Ended { outcome, result: Some(result), text }
}

impl ActionClient for FunctionAction {
    fn send(&mut self, goal: &Request) -> Result<Ticket, CallError> {
        let ticket = self.client.send(goal, self.timeout())?;
        let ends = ends(self.context.clock.now(), self.timeout());
        self.goals.insert(ticket, Goal { ends, replied: None });
        self.updates.extend([GoalUpdate::Accepted, GoalUpdate::Executing].map(|it| (ticket, it)));
        Ok(ticket)
    }

    fn cancel(&mut self, ticket: Ticket) {
        if self.goals.contains_key(&ticket) {
            let text = format!("{} is a function, which goes on until it ends", self.spec.action);
            self.updates.push_back((ticket, GoalUpdate::CancelRefused(text)));
        }
    }

    fn cancel_all(&mut self) -> Result<(), CallError> {
        let (service, reason) =
            (self.spec.action.clone(), "a call of a function cannot be taken back");
        Err(CallError::Refused { service, reason: reason.to_owned() })
    }

    fn take(&mut self) -> Option<(Ticket, GoalUpdate)> {
        if self.updates.is_empty() {
            self.look();
        }
        self.updates.pop_front()
    }

    fn deadline(&self) -> Option<Instant> {
        let poll = self.poll.as_ref();
        let due = [
            self.client.deadline(),
            poll.and_then(|poll| poll.next),
            poll.and_then(|poll| poll.client.deadline()),
        ];
        let replied = self.goals.values().filter(|goal| goal.replied.is_some());
        // Not every transport rings when a server goes.
        let look = (!self.goals.is_empty()).then(|| self.context.clock.now() + LOOK_EVERY);
        let due = due.into_iter().chain([look]).flatten();
        due.chain(replied.map(|goal| goal.ends)).min()
    }

    fn link(&self) -> Link {
        self.client.link()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

    use wrapyfi_interfaces::parser::{Dialect, TypeName};
    use wrapyfi_interfaces::store::ResolvedType;

    use super::*;
    use crate::Clock;
    use crate::memory::Memory;

    fn action(name: &str, text: &str) -> RosAction {
        let name = TypeName::parse(Dialect::Ros2, name).unwrap();
        RosAction::new(&ResolvedType::from_text(Dialect::Ros2, &name, text).unwrap()).unwrap()
    }

    fn count() -> RosAction {
        action("demo/action/Count", "int32 to\n---\nint32 reached\n---\nint32 at\n")
    }

    fn spec(options: Map) -> ActionSpec {
        ActionSpec { options, ..ActionSpec::new("/count", count()) }
    }

    fn value(payload: &Payload) -> Value {
        let Payload::RosMessage(message) = payload else { panic!("{payload:?}") };
        message.to_value(1 << 20).unwrap()
    }

    #[test]
    fn a_call_is_the_goal_and_its_reply_the_result() {
        let (bus, context) = (Memory::new("memory"), Context::default());
        let spec = spec(Map::from([("feedback", Value::from("/progress"))]));
        let mut client = open(&bus, &spec, &context, None).unwrap();
        let function = ServiceSpec::new("/count", ServiceKind::NativeObject);
        let mut server = bus.open_server(&function, &context).unwrap();
        let progress = TopicSpec::new("/progress", MessageType::NativeObject);
        let mut progress = bus.open_publisher(&progress, &context).unwrap();
        let ticket = client.send(&Request::default().with(Map::from([("to", 3)]))).unwrap();
        assert_eq!(client.take(), Some((ticket, GoalUpdate::Accepted)));
        assert_eq!(client.take(), Some((ticket, GoalUpdate::Executing)));
        let asked = server.take().unwrap().unwrap();
        assert_eq!(asked.request.call().unwrap().kwargs.get("to"), Some(&Value::from(3)));
        progress.publish(&Value::from(Map::from([("at", 2)])).into()).unwrap();
        let Some((_, GoalUpdate::Feedback(at))) = client.take() else { panic!("no feedback") };
        assert_eq!(value(&at).get("at"), Some(&Value::from(2)));
        client.cancel(ticket);
        assert!(matches!(client.take(), Some((_, GoalUpdate::CancelRefused(_)))));
        server.reply(asked.id, Ok(Value::from(Map::from([("reached", 3)])).into())).unwrap();
        let Some((_, GoalUpdate::Ended { outcome, result, .. })) = client.take() else {
            panic!("no end")
        };
        assert_eq!(outcome, GoalOutcome::Succeeded);
        assert!(result.is_some());
        assert_eq!(client.take(), None);
    }

    #[test]
    fn a_function_that_fails_aborts_the_goal() {
        let (bus, context) = (Memory::new("memory"), Context::default());
        let mut client = open(&bus, &spec(Map::default()), &context, None).unwrap();
        let function = ServiceSpec::new("/count", ServiceKind::NativeObject);
        let mut server = bus.open_server(&function, &context).unwrap();
        client.send(&Request::new([3.into()])).unwrap();
        client.take();
        let asked = server.take().unwrap().unwrap();
        server.reply(asked.id, Err("the arm is off".into())).unwrap();
        let ends: Vec<_> = std::iter::from_fn(|| client.take()).map(|(_, update)| update).collect();
        let Some(GoalUpdate::Ended { outcome: GoalOutcome::Aborted, text, .. }) = ends.last()
        else {
            panic!("{ends:?}")
        };
        assert!(text.contains("the arm is off"), "{text}");
    }

    /// A program that ends while it is called says nothing: on a broker nobody sees it go.
    #[test]
    fn a_function_that_does_not_answer_in_its_time_aborts_the_goal() {
        let (begin, seconds) = (Instant::now(), Arc::new(AtomicU64::new(0)));
        let passed = Arc::clone(&seconds);
        let clock = Clock::new(move || begin + Duration::from_secs(passed.load(Relaxed)));
        let (bus, context) = (Memory::new("memory"), Context { clock, ..Context::default() });
        let spec = ActionSpec { timeout: Some(Duration::from_secs(60)), ..spec(Map::default()) };
        let mut client = open(&bus, &spec, &context, None).unwrap();
        let function = ServiceSpec::new("/count", ServiceKind::NativeObject);
        let mut server = bus.open_server(&function, &context).unwrap();
        client.send(&Request::new([3.into()])).unwrap();
        server.take().unwrap().unwrap();
        while client.take().is_some() {}
        seconds.store(59, Relaxed);
        assert_eq!(client.take(), None);
        seconds.store(61, Relaxed);
        let Some((_, GoalUpdate::Ended { outcome, text, .. })) = client.take() else {
            panic!("no end")
        };
        assert_eq!(outcome, GoalOutcome::Aborted);
        assert!(text.contains("60000 ms"), "{text}");
    }

    #[test]
    fn a_goal_goes_on_after_the_reply_until_feedback_says_that_it_is_over() {
        let (bus, context) = (Memory::new("memory"), Context::default());
        let spec = |until: &str| ActionSpec {
            kind: action("demo/action/Move", "int32 to\n---\nint32 at\n---\nint32 at\nbool done\n"),
            options: Map::from([("feedback", Value::from("/at")), ("until", Value::from(until))]),
            ..ActionSpec::new("/move", count())
        };
        let mut client = open(&bus, &spec("done"), &context, None).unwrap();
        let function = ServiceSpec::new("/move", ServiceKind::NativeObject);
        let mut server = bus.open_server(&function, &context).unwrap();
        let at = TopicSpec::new("/at", MessageType::NativeObject);
        let mut at = bus.open_publisher(&at, &context).unwrap();
        let mut tell = |done: bool| {
            at.publish(&Value::from(Map::from([("done", done)])).into()).unwrap();
        };
        client.send(&Request::new([3.into()])).unwrap();
        tell(true);
        // It was over before it began.
        let begun: Vec<_> = std::iter::from_fn(|| client.take()).collect();
        assert_eq!(begun.len(), 3);
        let asked = server.take().unwrap().unwrap();
        server.reply(asked.id, Ok(Value::from(3).into())).unwrap();
        assert_eq!(client.take(), None);
        tell(false);
        assert!(matches!(client.take(), Some((_, GoalUpdate::Feedback(_)))));
        assert_eq!(client.take(), None);
        tell(true);
        assert!(matches!(client.take(), Some((_, GoalUpdate::Feedback(_)))));
        assert_eq!(client.take().map(|(_, end)| end), Some(succeeded(Value::from(3).into())));
        let error = open(&bus, &spec("at"), &context, None).err().unwrap().to_string();
        assert!(error.ends_with("true or false: done"), "{error}");
    }

    #[test]
    fn options_are_checked() {
        for (name, value) in
            [("feedback", Value::from(3)), ("poll", Value::from(" ")), ("poll_ms", Value::from(1))]
        {
            let error = check_option(name, &value).unwrap_err();
            assert!(error.contains(name), "{error}");
        }
        assert_eq!(check_option("poll_ms", &Value::from(100)), Ok(()));
    }
}
