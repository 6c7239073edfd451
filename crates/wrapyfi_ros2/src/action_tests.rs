//! Both ends of an action over a bus in memory, and the bytes that cross it.

use std::sync::Arc;
use std::time::{Duration, Instant};

use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::action_msgs::msg::{GoalInfo, GoalStatus, GoalStatusArray};
use wrapyfi_interfaces::action_msgs::srv::{CancelGoal_Request, CancelGoal_Response};
use wrapyfi_interfaces::builtin_interfaces::msg::Time;
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::ResolvedType;
use wrapyfi_interfaces::unique_identifier_msgs::msg::UUID;

use crate::action::{GoalId, Parts, with_id};
use crate::action_client::PartsClient;
use crate::action_server::PartsServer;
use wrapyfi_data::types::{Map, Payload, RosAction, RosMessage, ServiceKind, Stamp, Value};
use wrapyfi_endpoint::memory::{Carriage, Fate, Memory};
use wrapyfi_endpoint::{
    ActionClient, ActionServer, ActionSpec, CallError, Cause, Client, Clock, Context, DropReason,
    GoalNumber, GoalOutcome, GoalRequest, GoalUpdate, Listener, Middleware, Mutex, Request, RosNow,
    ServiceSpec, Ticket,
};

pub(crate) const SECOND: Duration = Duration::from_secs(1);

pub(crate) fn count() -> RosAction {
    let name = TypeName::parse(Dialect::Ros2, "demo/action/Count").unwrap();
    let text = "int32 to\n---\nint64 reached\n---\nfloat64 at\n";
    RosAction::new(&ResolvedType::from_text(Dialect::Ros2, &name, text).unwrap()).unwrap()
}

pub(crate) struct Bench {
    pub(crate) bus: Memory,
    pub(crate) spec: ActionSpec,
    pub(crate) context: Context,
    /// Time since the bench began.
    age: Arc<Mutex<Duration>>,
    /// Readers of the feedback, for which no goal has to wait.
    readers: Mutex<Vec<Box<dyn Listener>>>,
}

impl Bench {
    pub(crate) fn new() -> Self {
        Self::of(count())
    }

    pub(crate) fn of(kind: RosAction) -> Self {
        let (began, age) = (Instant::now(), Arc::<Mutex<Duration>>::default());
        let (passed, ros_passed) = (Arc::clone(&age), Arc::clone(&age));
        let ros_now = move || {
            let sec = 100 + i32::try_from(ros_passed.lock().as_secs()).unwrap();
            RosNow { stamp: Stamp { sec, nanosec: 7 }, simulated: false }
        };
        let clock = Clock::new(move || began + *passed.lock()).with_ros_time(ros_now);
        let context = Context { clock, ..Context::default() };
        let (bus, spec) = (Memory::new("memory"), ActionSpec::new("/count", kind));
        Self { bus, spec, context, age, readers: Mutex::default() }
    }

    /// A context of an end's own, at the time of the bench.
    pub(crate) fn context(&self) -> Context {
        Context { counters: Arc::default(), ..self.context.clone() }
    }

    pub(crate) fn pass(&self, time: Duration) {
        *self.age.lock() += time;
    }

    pub(crate) fn client(&self) -> PartsClient {
        PartsClient::open(&self.bus, &self.spec, &self.context()).unwrap()
    }

    pub(crate) fn server(&self) -> PartsServer {
        self.readers.lock().push(self.reader());
        self.unread_server()
    }

    /// A server whose feedback only clients read.
    pub(crate) fn unread_server(&self) -> PartsServer {
        PartsServer::open(&self.bus, &self.spec, &self.context).unwrap()
    }

    pub(crate) fn dropped(&self, reason: DropReason) -> u64 {
        self.context.counters.snapshot().dropped_for(reason)
    }

    /// A client of one of the services.
    pub(crate) fn caller(&self, of: impl FnOnce(Parts) -> ServiceSpec) -> Caller {
        let spec = of(Parts::of(&self.spec).unwrap());
        Caller { client: self.bus.open_client(&spec, &self.context()).unwrap(), spec }
    }

    pub(crate) fn reader(&self) -> Box<dyn Listener> {
        let spec = Parts::of(&self.spec).unwrap().feedback;
        self.bus.open_listener(&spec, &self.context()).unwrap()
    }

    pub(crate) fn states(&self) -> Box<dyn Listener> {
        let spec = Parts::of(&self.spec).unwrap().status;
        self.bus.open_listener(&spec, &self.context()).unwrap()
    }
}

/// A client of one of the services of an action.
pub(crate) struct Caller {
    client: Box<dyn Client>,
    spec: ServiceSpec,
}

impl Caller {
    pub(crate) fn send(&mut self, cdr: Vec<u8>) -> Ticket {
        let ServiceKind::Ros(service) = self.spec.kind else { unreachable!() };
        let request = Request::Message(RosMessage::new(service.request(), cdr));
        self.client.send(&request, Duration::MAX).unwrap()
    }

    /// Bytes of a reply; `None` where none has come.
    pub(crate) fn reply(&mut self) -> Option<RosMessage> {
        match self.client.take()?.1.unwrap().payload {
            Payload::RosMessage(message) => Some(message),
            other => panic!("{other:?}"),
        }
    }

    /// Field of a reply.
    pub(crate) fn replied(&mut self, field: &str) -> i128 {
        let fields = self.reply().expect("a reply").fields(1000).unwrap();
        let value = fields.get(field).unwrap();
        value.as_integer().unwrap_or_else(|| i128::from(format!("{value:?}").contains("true")))
    }
}

pub(crate) fn goal(to: i32) -> Request {
    Request::default().with(Map::from([("to", Value::from(to))]))
}

/// Bytes of a request of `send_goal`.
pub(crate) fn goal_bytes(id: GoalId, to: i32) -> Vec<u8> {
    let fields = count().goal();
    let mut message = fields.plan().default_message();
    message.set("to", to).unwrap();
    let body = RosMessage::from_fields(fields, &message).unwrap();
    with_id(&id, &body, count().send_goal().request()).cdr.to_vec()
}

pub(crate) fn id_bytes(uuid: GoalId) -> Vec<u8> {
    UUID { uuid }.encode().to_bytes().to_vec()
}

pub(crate) fn cancel_bytes(uuid: GoalId, sec: i32) -> Vec<u8> {
    let goal_info =
        GoalInfo { goal_id: UUID { uuid }, stamp: Time { sec, nanosec: 8 * u32::from(sec > 0) } };
    CancelGoal_Request { goal_info }.encode().to_bytes().to_vec()
}

pub(crate) fn taken(server: &mut PartsServer) -> (GoalNumber, i64) {
    match server.take().unwrap() {
        Some(GoalRequest::Goal { number, goal, .. }) => {
            (number, goal.call().unwrap().kwargs.get("to").unwrap().as_i64().unwrap())
        }
        other => panic!("{other:?}"),
    }
}

pub(crate) fn wish(server: &mut PartsServer) -> GoalNumber {
    match server.take().unwrap() {
        Some(GoalRequest::Cancel(number)) => number,
        other => panic!("{other:?}"),
    }
}

pub(crate) fn ended(outcome: GoalOutcome, reached: i64) -> GoalUpdate {
    let result = Value::from(Map::from([("reached", Value::from(reached))]));
    GoalUpdate::Ended { outcome, result: Some(result.into()), text: String::new() }
}

/// All that a client has to tell, results and feedback as their only field.
pub(crate) fn told(client: &mut PartsClient) -> Vec<String> {
    let only = |payload: &Payload| match payload {
        Payload::RosMessage(message) => {
            let fields = message.fields(1000).unwrap();
            let (_, value) = fields.fields().next().unwrap();
            value.as_f64().unwrap()
        }
        other => panic!("{other:?}"),
    };
    std::iter::from_fn(|| client.take())
        .map(|(_, update)| match update {
            GoalUpdate::Feedback(payload) => format!("at {}", only(&payload)),
            GoalUpdate::Ended { outcome, result: Some(result), .. } => {
                format!("{outcome} {}", only(&result))
            }
            GoalUpdate::Ended { outcome, text, .. } => format!("{outcome}: {text}"),
            other => format!("{other:?}").to_lowercase(),
        })
        .collect()
}

pub(crate) fn states_of(listener: &mut dyn Listener) -> Vec<Vec<i8>> {
    let arrays = std::iter::from_fn(|| match listener.take().unwrap()?.payload {
        Payload::RosMessage(message) => {
            Some(GoalStatusArray::decode(&message.cdr, 10_000).unwrap())
        }
        other => panic!("{other:?}"),
    });
    arrays.map(|array| array.status_list.iter().map(|it| it.status).collect()).collect()
}

#[test]
fn a_goal_goes_there_and_its_feedback_and_result_come_back() {
    let bench = Bench::new();
    let mut server = bench.server();
    let mut client = bench.client();
    assert_eq!((client.link().peers, server.link().peers), (Some(1), Some(1)));
    let mut states = bench.states();
    client.send(&goal(3)).unwrap();
    let (number, to) = taken(&mut server);
    assert_eq!(to, 3);
    assert!(told(&mut client).is_empty());
    server.update(number, GoalUpdate::Accepted).unwrap();
    server.update(number, GoalUpdate::Executing).unwrap();
    let at = Value::from(Map::from([("at", Value::from(1.5))]));
    server.update(number, GoalUpdate::Feedback(at.into())).unwrap();
    assert_eq!(told(&mut client), ["accepted", "executing", "at 1.5"]);
    assert_eq!(server.kept(), 1);
    bench.pass(3600 * SECOND);
    assert!(told(&mut client).is_empty());
    assert_eq!(server.take().unwrap(), None);
    server.update(number, ended(GoalOutcome::Succeeded, 3)).unwrap();
    assert_eq!(server.kept(), 0, "its result was given");
    server.update(number, ended(GoalOutcome::Aborted, 3)).unwrap();
    assert_eq!(told(&mut client), ["succeeded 3"]);
    assert_eq!(states_of(&mut *states), [[1], [2], [4]]);
    let counted = bench.context.counters.snapshot();
    assert_eq!((counted.received, counted.sent, counted.dropped()), (1, 4, 0));
}

/// Feedback has a topic of its own, on which it may be ahead of the states.
#[test]
fn feedback_says_that_a_goal_is_executed() {
    let bench = Bench::new();
    let (mut server, mut client) = (bench.server(), bench.client());
    client.send(&goal(3)).unwrap();
    let (number, _) = taken(&mut server);
    server.update(number, GoalUpdate::Accepted).unwrap();
    let at = Value::from(Map::from([("at", Value::from(1.5))]));
    server.update(number, GoalUpdate::Feedback(at.into())).unwrap();
    assert_eq!(told(&mut client), ["accepted", "executing", "at 1.5"]);
    server.update(number, GoalUpdate::Executing).unwrap();
    assert!(told(&mut client).is_empty());
}

/// A client hears all states between two, whatever the owner of the server leaves out.
#[test]
fn states_that_are_left_out_are_filled_in() {
    for (outcome, heard, published) in [
        (GoalOutcome::Succeeded, "executing", [[1], [2], [4]]),
        (GoalOutcome::Aborted, "executing", [[1], [2], [6]]),
        (GoalOutcome::Canceled, "canceling", [[1], [3], [5]]),
    ] {
        let bench = Bench::new();
        let (mut server, mut client, mut states) = (bench.server(), bench.client(), bench.states());
        client.send(&goal(3)).unwrap();
        let (number, _) = taken(&mut server);
        server.update(number, ended(outcome, 3)).unwrap();
        let told = std::iter::repeat_with(|| {
            _ = server.take().unwrap();
            told(&mut client)
        });
        let told: Vec<_> = told.take(3).flatten().collect();
        assert_eq!(told, ["accepted", heard, &format!("{outcome} 3")]);
        assert_eq!(states_of(&mut *states), published);
    }
}

#[test]
fn a_goal_is_rejected() {
    let bench = Bench::new();
    let (mut server, mut client) = (bench.server(), bench.client());
    client.send(&goal(3)).unwrap();
    let (number, _) = taken(&mut server);
    server.update(number, GoalUpdate::Rejected("no".to_owned())).unwrap();
    assert_eq!(told(&mut client), ["rejected(\"\")"]);
    assert_eq!(server.kept(), 0);
    // One that was accepted can only be aborted.
    client.send(&goal(3)).unwrap();
    let (number, _) = taken(&mut server);
    server.update(number, GoalUpdate::Accepted).unwrap();
    server.update(number, GoalUpdate::Rejected("no".to_owned())).unwrap();
    assert_eq!(told(&mut client), ["accepted", "executing"]);
    assert_eq!(server.take().unwrap(), None);
    assert_eq!(told(&mut client), ["aborted 0"]);
}

#[test]
fn several_goals_end_each_for_itself() {
    let bench = Bench::new();
    let (mut server, mut client) = (bench.server(), bench.client());
    let tickets: Vec<_> = (0..50).map(|to| client.send(&goal(to)).unwrap()).collect();
    let numbers: Vec<_> = (0..50).map(|_| taken(&mut server)).collect();
    for (number, _) in &numbers {
        server.update(*number, GoalUpdate::Executing).unwrap();
    }
    told(&mut client);
    assert_eq!(server.take().unwrap(), None);
    for (number, to) in numbers.iter().rev() {
        server.update(*number, ended(GoalOutcome::Succeeded, *to)).unwrap();
    }
    let ends: Vec<_> = std::iter::from_fn(|| client.take()).collect();
    let wanted: Vec<_> = tickets.into_iter().rev().collect();
    assert_eq!(ends.iter().map(|(ticket, _)| *ticket).collect::<Vec<_>>(), wanted);
    assert!(ends.iter().all(|(_, update)| update.is_end()));
}

#[test]
fn a_wish_to_cancel_before_the_goal_is_accepted_is_not_forgotten() {
    let bench = Bench::new();
    let (mut server, mut client) = (bench.server(), bench.client());
    let ticket = client.send(&goal(3)).unwrap();
    client.cancel(ticket);
    let (number, _) = taken(&mut server);
    assert_eq!(server.take().unwrap(), None);
    server.update(number, GoalUpdate::Accepted).unwrap();
    assert_eq!(told(&mut client), ["accepted"]);
    client.cancel(ticket);
    assert_eq!(wish(&mut server), number);
    assert_eq!(server.take().unwrap(), None, "it is asked once");
    server.update(number, GoalUpdate::Canceling).unwrap();
    assert_eq!(told(&mut client), ["canceling"]);
    server.update(number, ended(GoalOutcome::Canceled, 1)).unwrap();
    assert_eq!(told(&mut client), ["canceled 1"]);
    client.cancel(ticket);
    assert_eq!(server.take().unwrap(), None);
}

#[test]
fn a_server_may_go_on_with_a_goal_that_was_to_be_cancelled() {
    let bench = Bench::new();
    let (mut server, mut client) = (bench.server(), bench.client());
    let ticket = client.send(&goal(3)).unwrap();
    let (number, _) = taken(&mut server);
    server.update(number, GoalUpdate::Executing).unwrap();
    told(&mut client);
    client.cancel(ticket);
    assert_eq!(wish(&mut server), number);
    assert!(told(&mut client).is_empty(), "the answer waits");
    server.update(number, GoalUpdate::CancelRefused("busy".to_owned())).unwrap();
    let refused = "cancelrefused(\"the server goes on with it\")";
    assert_eq!(told(&mut client), [refused]);
    // Nobody decides: the client is not left without an answer.
    client.cancel(ticket);
    assert_eq!(wish(&mut server), number);
    bench.pass(3 * SECOND);
    assert_eq!(server.take().unwrap(), None);
    assert_eq!(told(&mut client), [refused]);
    // One that ends by itself while it is to be cancelled.
    client.cancel(ticket);
    assert_eq!(wish(&mut server), number);
    server.update(number, ended(GoalOutcome::Succeeded, 3)).unwrap();
    assert_eq!(told(&mut client), [refused, "succeeded 3"]);
}

/// Answers to requests to cancel, as `rcl_action` and `rclcpp_action` give them.
#[test]
fn cancellations_are_answered_by_code() {
    let bench = Bench::new();
    let mut server = bench.server();
    let mut caller = bench.caller(|parts| parts.cancel_goal);
    let mut sender = bench.caller(|parts| parts.send_goal);
    let mut numbers = Vec::new();
    for place in 1..=3 {
        sender.send(goal_bytes([place; 16], 1));
        let (number, _) = taken(&mut server);
        server.update(number, GoalUpdate::Executing).unwrap();
        assert_eq!(sender.replied("accepted"), 1);
        numbers.push(number);
        bench.pass(SECOND);
    }
    let mut ask = |server: &mut PartsServer, id: u8, sec, goes_on: bool| {
        caller.send(cancel_bytes([id; 16], sec));
        let mut asked = Vec::new();
        let mut is_all_asked = false;
        while let Some(request) = server.take().unwrap() {
            assert!(!is_all_asked, "{request:?} after the wish to cancel all");
            let GoalRequest::Cancel(number) = request else {
                assert_eq!(request, GoalRequest::CancelAll);
                is_all_asked = true;
                continue;
            };
            let update = match goes_on {
                true => GoalUpdate::CancelRefused(String::new()),
                false => GoalUpdate::Canceling,
            };
            server.update(number, update).unwrap();
            asked.push(number);
        }
        assert_eq!(is_all_asked, (id, sec) == (0, 0));
        let reply = caller.reply().expect("an answer");
        let reply = CancelGoal_Response::decode(&reply.cdr, 1000).unwrap();
        let ids: Vec<_> = reply.goals_canceling.iter().map(|it| it.goal_id.uuid[0]).collect();
        (asked, reply.return_code, ids)
    };
    let none: Vec<GoalNumber> = Vec::new();
    assert_eq!(ask(&mut server, 9, 0, false), (none.clone(), 2, vec![]), "an unknown goal");
    assert_eq!(ask(&mut server, 0, 50, false), (none.clone(), 0, vec![]), "none is that old");
    assert_eq!(ask(&mut server, 0, 0, true), (numbers.clone(), 1, vec![]), "all, and all refused");
    assert_eq!(ask(&mut server, 2, 0, true), (vec![numbers[1]], 1, vec![]), "one, and refused");
    let first_and_third = vec![numbers[0], numbers[2]];
    assert_eq!(ask(&mut server, 3, 100, false), (first_and_third, 0, vec![1, 3]), "by both");
    assert_eq!(ask(&mut server, 1, 0, false), (none.clone(), 3, vec![]), "it is canceling");
    assert_eq!(ask(&mut server, 0, 0, false), (vec![numbers[1]], 0, vec![2]), "those that go on");
    server.update(numbers[1], ended(GoalOutcome::Canceled, 1)).unwrap();
    assert_eq!(ask(&mut server, 2, 0, false), (none, 3, vec![]), "it has ended");
}

/// A client takes the server for there before the server knows its reader, and feedback is not kept for that.
#[test]
fn a_goal_waits_until_its_feedback_is_read_but_not_for_long() {
    let bench = Bench::new();
    let mut server = bench.unread_server();
    let mut sender = bench.caller(|parts| parts.send_goal);
    sender.send(goal_bytes([1; 16], 1));
    assert_eq!(server.take().unwrap(), None);
    assert_eq!((server.kept(), sender.reply()), (1, None));
    let due = bench.context.clock.now() + SECOND / 2;
    assert_eq!(server.deadline(), Some(due), "it is looked at again");
    let reader = bench.reader();
    let (number, _) = taken(&mut server);
    server.update(number, GoalUpdate::Executing).unwrap();
    assert_eq!(sender.replied("accepted"), 1);
    drop(reader);
    sender.send(goal_bytes([2; 16], 1));
    assert_eq!(server.take().unwrap(), None);
    bench.pass(SECOND / 2);
    let (number, _) = taken(&mut server);
    server.update(number, GoalUpdate::Executing).unwrap();
    assert_eq!(sender.replied("accepted"), 1, "a client may do without feedback");
    sender.send(goal_bytes([3; 16], 1));
    assert_eq!(server.take().unwrap(), None);
    drop(server);
    assert_eq!(sender.replied("accepted"), 0, "a goal that is held is answered at the end");
}

#[test]
fn an_id_that_repeats_is_rejected_and_counted() {
    let bench = Bench::new();
    let mut server = bench.server();
    let mut sender = bench.caller(|parts| parts.send_goal);
    sender.send(goal_bytes([1; 16], 1));
    let (number, _) = taken(&mut server);
    sender.send(goal_bytes([1; 16], 2));
    assert_eq!(server.take().unwrap(), None);
    assert_eq!(sender.replied("accepted"), 0);
    bench.pass(SECOND);
    server.update(number, GoalUpdate::Accepted).unwrap();
    assert_eq!(sender.replied("stamp.sec"), 101, "the time of its acceptance");
    server.update(number, ended(GoalOutcome::Succeeded, 1)).unwrap();
    sender.send(goal_bytes([1; 16], 2));
    assert_eq!(server.take().unwrap(), None);
    assert_eq!((sender.replied("accepted"), bench.dropped(DropReason::Duplicate)), (0, 2));
}

#[test]
fn more_goals_than_may_be_under_way_are_rejected() {
    let mut bench = Bench::new();
    bench.spec.goals = 2;
    let mut server = bench.server();
    let [mut one, mut other] = [bench.client(), bench.client()];
    for _ in 0..2 {
        one.send(&goal(1)).unwrap();
        let (number, _) = taken(&mut server);
        server.update(number, GoalUpdate::Accepted).unwrap();
    }
    let error = one.send(&goal(1)).unwrap_err();
    assert_eq!(error, CallError::TooMany { service: "/count".to_owned(), limit: 2 });
    other.send(&goal(1)).unwrap();
    assert_eq!(server.take().unwrap(), None);
    assert_eq!(told(&mut other), ["rejected(\"\")"]);
    assert_eq!(bench.dropped(DropReason::Overloaded), 1);
}

#[test]
fn a_result_is_kept_for_ten_seconds_and_freed_though_nobody_fetches_it() {
    let mut bench = Bench::new();
    bench.spec.goals = 4;
    let (mut server, mut states) = (bench.server(), bench.states());
    let mut sender = bench.caller(|parts| parts.send_goal);
    let mut asker = bench.caller(|parts| parts.get_result);
    for id in 1..=20 {
        sender.send(goal_bytes([id; 16], 1));
        let (number, _) = taken(&mut server);
        server.update(number, ended(GoalOutcome::Succeeded, i64::from(id))).unwrap();
        let most = states_of(&mut *states).iter().map(Vec::len).max();
        assert!(most <= Some(9), "{most:?}");
    }
    assert_eq!(server.take().unwrap(), None);
    assert_eq!(server.kept(), 4);
    let mut ask = |server: &mut PartsServer, id, field: &str| {
        asker.send(id_bytes([id; 16]));
        assert_eq!(server.take().unwrap(), None);
        asker.replied(field)
    };
    assert_eq!(ask(&mut server, 20, "result.reached"), 20);
    assert_eq!(server.kept(), 3);
    assert_eq!(ask(&mut server, 1, "status"), 0, "there were too many");
    assert_eq!(server.deadline(), Some(bench.context.clock.now() + 10 * SECOND));
    bench.pass(9 * SECOND);
    assert_eq!(ask(&mut server, 19, "status"), 4);
    bench.pass(SECOND);
    assert_eq!(ask(&mut server, 19, "status"), 0);
    assert_eq!((server.kept(), server.deadline()), (0, None));
}

#[test]
fn a_server_that_goes_ends_its_goals() {
    let bench = Bench::new();
    let (mut server, mut client) = (bench.server(), bench.client());
    for _ in 0..2 {
        client.send(&goal(1)).unwrap();
    }
    let (number, _) = taken(&mut server);
    server.update(number, GoalUpdate::Executing).unwrap();
    assert_eq!(told(&mut client), ["accepted", "executing"]);
    assert!(matches!(server.take().unwrap(), Some(GoalRequest::Goal { .. })));
    drop(server);
    assert_eq!(told(&mut client), ["rejected(\"\")", "aborted 0"]);
    // A goal without a server waits for one.
    client.send(&goal(1)).unwrap();
    assert!(told(&mut client).is_empty());
    assert_eq!(client.deadline(), Some(bench.context.clock.now() + 5 * SECOND));
    bench.pass(5 * SECOND);
    assert_eq!(told(&mut client), ["rejected(\"there is no server\")"]);
}

/// Clients on Fast DDS do not hear of the end of a service on RustDDS.
#[test]
fn an_action_that_is_hidden_keeps_its_services() {
    let bench = Bench::new();
    let (mut server, mut client) = (bench.server(), bench.client());
    let mut caller = bench.caller(|parts| parts.send_goal);
    assert!(server.hide());
    let link = client.link();
    assert!(matches!(link.waiting_for, Some(Cause::Nobody(_))), "{link:?}");
    assert_eq!(link.peers, Some(0));
    caller.send(goal_bytes([1; 16], 1));
    let (number, _) = taken(&mut server);
    server.update(number, GoalUpdate::Rejected(String::new())).unwrap();
    assert_eq!(caller.replied("accepted"), 0);
    server.show(&bench.bus).unwrap();
    assert_eq!(client.link().peers, Some(1));
    client.send(&goal(2)).unwrap();
    let (number, to) = taken(&mut server);
    assert_eq!(to, 2);
    server.update(number, ended(GoalOutcome::Succeeded, 2)).unwrap();
    assert_eq!(told(&mut client), ["accepted", "executing"]);
    assert_eq!(server.take().unwrap(), None);
    assert_eq!(told(&mut client), ["succeeded 2"]);
}

/// A server that is killed and starts again knows nothing of the goals before.
#[test]
fn a_server_that_does_not_know_a_goal_ends_it() {
    let bench = Bench::new();
    let (mut server, mut client) = (bench.server(), bench.client());
    client.send(&goal(1)).unwrap();
    let (number, _) = taken(&mut server);
    server.update(number, GoalUpdate::Executing).unwrap();
    told(&mut client);
    assert_eq!(server.take().unwrap(), None);
    // The new one is there before the end of the old one is known, whose last words are lost.
    let mut again = bench.server();
    assert!(told(&mut client).is_empty());
    for server in [&mut again, &mut server] {
        assert_eq!(server.take().unwrap(), None);
    }
    assert!(told(&mut client).is_empty(), "the other may know it");
    bench.bus.carry_services(Carriage::new(|_| Fate::Lost));
    drop(server);
    bench.bus.carry_services(Carriage::default());
    assert!(told(&mut client).is_empty());
    assert_eq!(again.take().unwrap(), None);
    let text = "aborted: the server does not know the goal: it has started again, or its result has expired";
    assert_eq!(told(&mut client), [text]);
}

/// A server says that a goal has ended, and the request for its result was lost.
#[test]
fn a_result_that_does_not_come_is_asked_for_again() {
    let bench = Bench::new();
    let mut client = bench.client();
    let parts = Parts::of(&bench.spec).unwrap();
    let mut sends = bench.bus.open_server(&parts.send_goal, &bench.context()).unwrap();
    let mut results = bench.bus.open_server(&parts.get_result, &bench.context()).unwrap();
    let _cancels = bench.bus.open_server(&parts.cancel_goal, &bench.context()).unwrap();
    let _feedback = bench.bus.open_publisher(&parts.feedback, &bench.context()).unwrap();
    let mut states = bench.bus.open_publisher(&parts.status, &bench.context()).unwrap();
    client.send(&goal(1)).unwrap();
    let asked = sends.take().unwrap().unwrap();
    let Request::Message(message) = &asked.request else { panic!("{asked:?}") };
    let uuid: GoalId = message.cdr[4..20].try_into().unwrap();
    let mut state = |status| {
        let goal_info = GoalInfo { goal_id: UUID { uuid }, ..GoalInfo::default() };
        let array = GoalStatusArray { status_list: vec![GoalStatus { goal_info, status }] };
        let message = RosMessage::new(parts.states, array.encode().to_bytes());
        states.publish(&message.into()).unwrap();
    };
    // The state says it before the reply does.
    state(2);
    assert_eq!(told(&mut client), ["accepted", "executing"]);
    assert!(results.take().unwrap().is_some(), "asked for, and not answered");
    state(4);
    assert!(told(&mut client).is_empty());
    assert_eq!(client.deadline(), Some(bench.context.clock.now() + 2 * SECOND));
    bench.pass(2 * SECOND);
    assert!(told(&mut client).is_empty());
    let again = results.take().unwrap().unwrap();
    let response = count().get_result().response();
    let mut fields = response.plan().default_message();
    fields.set("status", 4_i8).unwrap();
    fields.set("result.reached", 5_i64).unwrap();
    let reply = RosMessage::from_fields(response, &fields).unwrap();
    results.reply(again.id, Ok(reply.into())).unwrap();
    assert_eq!(told(&mut client), ["succeeded 5"]);
}
