//! Methods that are actions: goals, feedback, cancellation and every other end, in both modes.

use std::pin::pin;
use std::sync::Arc;
use std::task::{Context as Task, Waker};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use wrapyfi_core::communicator::{
    ActivateError, CommunicatorContext, Feedback, MethodError, Mode, communicator,
};
use wrapyfi_data::types::{Map, RosAction, Value};
use wrapyfi_endpoint::memory::Memory;
use wrapyfi_endpoint::{
    ActionClient, ActionServer, ActionSpec, CallError, Context, GoalEvent, GoalOutcome,
    GoalRequest, GoalUpdate, Middleware, Opened, Publisher, Request, TopicSpec,
};
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::TypeStore;

use super::requests::block_on;

const COUNT: &str = "int32 to\n---\nint32 reached\n---\nint32 at\n";
/// Long enough for the slowest machine; reached only by failures.
const LONG: Duration = Duration::from_secs(60);

fn types() -> TypeStore {
    let mut types = TypeStore::generated();
    for (name, text) in [("demo/action/Count", COUNT), ("demo/action/Stop", "---\n---\n")] {
        types.add_definition(&TypeName::parse(Dialect::Ros2, name).unwrap(), text).unwrap();
    }
    types
}

fn spec() -> ActionSpec {
    ActionSpec::new("/count", RosAction::resolve("demo/action/Count", &mut types()).unwrap())
}

fn bench() -> (Arc<Memory>, CommunicatorContext) {
    let bus = Arc::new(Memory::new("memory"));
    (bus.clone(), CommunicatorContext::builder().only(bus).types(types()).build())
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Reached {
    reached: i32,
}

struct Counter;

#[communicator]
impl Counter {
    #[register(Action, "$mware", "/count", action_type = "demo/action/Count")]
    fn count(&self, mware: &str, to: i32, #[feedback] progress: &Feedback) -> Reached {
        assert_eq!(mware, "memory");
        if to < 0 {
            progress.abort("nothing is below 0");
        }
        for at in 1..=to {
            progress.send(&Map::from([("at", at)])).unwrap();
        }
        // A goal without an end runs until it is cancelled.
        while to == 0 && !progress.is_canceled() {
            std::thread::sleep(Duration::from_millis(1));
        }
        Reached { reached: to }
    }

    #[register(Action, "memory", "/count", action_type = "demo/action/Count", timeout_ms = 50)]
    fn brief(&self, to: i32) -> i32 {
        to
    }

    #[register(Action, "memory", "/count", action_type = "demo/action/Count")]
    async fn slow(&self, to: i32, #[feedback] progress: &Feedback) -> Value {
        progress.send(&to).unwrap();
        std::future::ready(Value::from(Map::from([("reached", to)]))).await
    }

    #[register(Action, "memory", "/count", action_type = "demo/action/Count")]
    fn narrow(&self, to: u8) -> String {
        to.to_string()
    }

    #[register(Action, "memory", "/stop", action_type = "demo/action/Stop")]
    fn stop(&self) {}

    #[register(Action, "memory", "/count", action_type = "$of")]
    fn untyped(&self, of: Option<String>) {
        drop(of);
    }
}

fn counter(
    context: &CommunicatorContext,
    method: CounterMethod,
    mode: Mode,
) -> CounterCommunicator {
    let mut counter = Counter.communicator_in(context);
    counter.activate(method, mode).unwrap();
    counter
}

/// Takes the next goal and ends it so.
fn end(server: &mut dyn ActionServer, updates: impl IntoIterator<Item = GoalUpdate>) {
    let number = loop {
        match server.take().unwrap() {
            Some(GoalRequest::Goal { number, .. }) => break number,
            _ => std::thread::yield_now(),
        }
    };
    for update in updates {
        server.update(number, update).unwrap();
    }
}

/// The updates of a goal up to one that `is_last`.
fn updates(
    client: &mut dyn ActionClient,
    is_last: impl Fn(&GoalUpdate) -> bool,
) -> Vec<GoalUpdate> {
    let mut updates = Vec::new();
    while !updates.last().is_some_and(&is_last) {
        match client.take() {
            Some((_, update)) => updates.push(update),
            None => std::thread::yield_now(),
        }
    }
    updates
}

fn goal(to: i32) -> Request {
    Request::default().with(Map::from([("to", to)]))
}

fn not_reached(error: MethodError) -> (GoalEvent, String, String) {
    let text = error.to_string();
    let MethodError::Unanswered { source, .. } = error else { panic!("{error:?}") };
    let CallError::NotReached { how, reason, .. } = *source else { panic!("{source:?}") };
    (how, reason, text)
}

#[test]
fn a_goal_runs_the_body_elsewhere_and_its_feedback_comes_back() {
    let (_bus, context) = bench();
    let server = counter(&context, CounterMethod::Count, Mode::Reply);
    let client = counter(&context, CounterMethod::Count, Mode::Request);
    let (feedback, mut heard) = Feedback::channel();
    std::thread::scope(|scope| {
        let served = scope.spawn(|| server.count("memory", 7, &Feedback::default()).unwrap());
        let reached = client.count("memory", 3, &feedback).unwrap();
        assert_eq!(reached, Some(Reached { reached: 3 }));
        assert_eq!(served.join().unwrap(), reached);
    });
    for at in 1..=3 {
        assert_eq!(heard.recv_timeout(LONG), Some(Value::from(Map::from([("at", at)]))));
    }
    drop(feedback);
    assert_eq!((block_on(heard.recv()), heard.dropped()), (None, 0));
    for end in [&server, &client] {
        let goals = end.status(CounterMethod::Count)[0].ends[0].counters.goals.clone();
        let once = [(GoalEvent::Accepted, 1), (GoalEvent::Feedback, 3), (GoalEvent::Succeeded, 1)];
        assert_eq!(goals, once);
    }
}

#[test]
fn async_methods_are_actions_too() {
    let (_bus, context) = bench();
    let server = counter(&context, CounterMethod::Slow, Mode::Reply);
    let client = counter(&context, CounterMethod::Slow, Mode::Request);
    let (feedback, mut heard) = Feedback::channel();
    std::thread::scope(|scope| {
        let served = scope.spawn(|| block_on(server.slow(0, &Feedback::default())).unwrap());
        let reached = block_on(client.slow(3, &feedback)).unwrap();
        assert_eq!(reached, Some(Map::from([("reached", 3)]).into()));
        assert_eq!(served.join().unwrap(), reached);
        // The one field that feedback has.
        assert_eq!(block_on(heard.recv()), Some(Map::from([("at", 3)]).into()));
    });
    fn is_send<T: Send>(_: &T) {}
    is_send(&client.slow(3, &feedback));
}

#[test]
fn a_method_may_return_the_one_field_of_a_result_or_none() {
    let (_bus, context) = bench();
    for method in [CounterMethod::Brief, CounterMethod::Stop] {
        let server = counter(&context, method, Mode::Reply);
        let client = counter(&context, method, Mode::Request);
        std::thread::scope(|scope| {
            scope.spawn(move || match method {
                CounterMethod::Stop => server.stop().map(drop).unwrap(),
                _ => server.brief(0).map(drop).unwrap(),
            });
            match method {
                CounterMethod::Stop => assert_eq!(client.stop().unwrap(), Some(())),
                _ => assert_eq!(client.brief(5).unwrap(), Some(5)),
            }
        });
    }
}

#[test]
fn a_call_waits_for_its_server_and_its_time_out_cancels_the_goal() {
    let (bus, context) = bench();
    let client = counter(&context, CounterMethod::Brief, Mode::Request);
    let error = client.brief(1).unwrap_err().to_string();
    assert!(error.contains("within 50 ms: no server of it was there"), "{error}");
    let mut server = bus.open_action_server(&spec(), &Context::default()).unwrap();
    let error = client.brief(1).unwrap_err().to_string();
    assert!(error.contains("its goal was under way, and is cancelled"), "{error}");
    let Some(GoalRequest::Goal { number, .. }) = server.take().unwrap() else { panic!("no goal") };
    assert_eq!(server.take().unwrap(), Some(GoalRequest::Cancel(number)));
}

#[test]
fn a_dropped_call_cancels_its_goal() {
    let (bus, context) = bench();
    let mut server = bus.open_action_server(&spec(), &Context::default()).unwrap();
    let client = counter(&context, CounterMethod::Slow, Mode::Request);
    // The first poll may find that the endpoints are not open yet.
    let number = {
        let feedback = Feedback::default();
        let mut call = pin!(client.slow(1, &feedback));
        loop {
            assert!(call.as_mut().poll(&mut Task::from_waker(Waker::noop())).is_pending());
            if let Some(GoalRequest::Goal { number, .. }) = server.take().unwrap() {
                break number;
            }
            std::thread::yield_now();
        }
    };
    assert_eq!(server.take().unwrap(), Some(GoalRequest::Cancel(number)));
    // A call that is cancelled from another thread ends so, too.
    let control = client.control();
    std::thread::scope(|scope| {
        let call = scope.spawn(|| block_on(client.slow(2, &Feedback::default())));
        end(&mut *server, [GoalUpdate::Accepted]);
        control.cancel(CounterMethod::Slow);
        assert!(matches!(call.join().unwrap(), Err(MethodError::Cancelled { .. })));
    });
    assert!(matches!(server.take().unwrap(), Some(GoalRequest::Cancel(_))));
}

#[test]
fn a_rejected_an_aborted_and_a_canceled_goal_are_errors_with_the_server_s_text() {
    let (bus, context) = bench();
    let client = counter(&context, CounterMethod::Count, Mode::Request);
    let mut server = bus.open_action_server(&spec(), &Context::default()).unwrap();
    let text = || "the arm is off".to_owned();
    let ended = |outcome| GoalUpdate::Ended { outcome, result: None, text: text() };
    for (update, how) in [
        (GoalUpdate::Rejected(text()), GoalEvent::Rejected),
        (ended(GoalOutcome::Aborted), GoalEvent::Aborted),
        (ended(GoalOutcome::Canceled), GoalEvent::Canceled),
    ] {
        std::thread::scope(|scope| {
            let call = scope.spawn(|| client.count("memory", 1, &Feedback::default()));
            end(&mut *server, [update]);
            let (found, reason, shown) = not_reached(call.join().unwrap().unwrap_err());
            assert_eq!((found, reason), (how, text()));
            let wanted = format!("the goal of \"/count\" was {}: the arm is off", how.as_str());
            assert_eq!(shown, format!("Counter::count: {wanted}"));
        });
    }
    // A server that goes takes its goals along.
    std::thread::scope(|scope| {
        let call = scope.spawn(|| client.count("memory", 1, &Feedback::default()));
        end(&mut *server, [GoalUpdate::Accepted]);
        drop(server);
        assert_eq!(not_reached(call.join().unwrap().unwrap_err()).0, GoalEvent::Aborted);
    });
}

#[test]
fn a_wish_to_cancel_reaches_the_body_and_a_goal_that_waits_ends_at_once() {
    let (bus, context) = bench();
    let server = counter(&context, CounterMethod::Count, Mode::Reply);
    let mut client = bus.open_action_client(&spec(), &Context::default()).unwrap();
    std::thread::scope(|scope| {
        let served = scope.spawn(|| server.count("memory", 0, &Feedback::default()));
        while client.link().peers == Some(0) {
            std::thread::yield_now();
        }
        let running = client.send(&goal(0)).unwrap();
        updates(&mut *client, |update| *update == GoalUpdate::Executing);
        // It is accepted while the body of the other runs.
        let waiting = client.send(&goal(5)).unwrap();
        assert_eq!(
            updates(&mut *client, |update| *update == GoalUpdate::Accepted),
            [GoalUpdate::Accepted]
        );
        client.cancel(waiting);
        let seen = updates(&mut *client, GoalUpdate::is_end);
        let (outcome, text) = (GoalOutcome::Canceled, String::new());
        let canceled = GoalUpdate::Ended { outcome, result: None, text };
        assert_eq!(seen, [GoalUpdate::Canceling, canceled]);
        client.cancel(running);
        let seen = updates(&mut *client, GoalUpdate::is_end);
        let [GoalUpdate::Canceling, GoalUpdate::Ended { outcome, result: Some(_), .. }] = &seen[..]
        else {
            panic!("{seen:?}")
        };
        assert_eq!(*outcome, GoalOutcome::Canceled);
        served.join().unwrap().unwrap();
    });
}

#[test]
fn a_body_without_feedback_goes_on() {
    struct Deaf(std::sync::mpsc::Receiver<()>);

    #[communicator]
    impl Deaf {
        #[register(Action, "memory", "/count", action_type = "demo/action/Count")]
        fn count(&mut self, to: i32) -> i32 {
            self.0.recv().unwrap();
            to
        }
    }

    let (bus, context) = bench();
    let (go_on, wait) = std::sync::mpsc::channel();
    let mut server = Deaf(wait).communicator_in(&context);
    server.activate(DeafMethod::Count, Mode::Reply).unwrap();
    let mut client = bus.open_action_client(&spec(), &Context::default()).unwrap();
    std::thread::scope(|scope| {
        scope.spawn(move || server.count(0).unwrap());
        while client.link().peers == Some(0) {
            std::thread::yield_now();
        }
        let ticket = client.send(&goal(3)).unwrap();
        updates(&mut *client, |update| *update == GoalUpdate::Executing);
        client.cancel(ticket);
        updates(&mut *client, |update| matches!(update, GoalUpdate::CancelRefused(_)));
        go_on.send(()).unwrap();
        let seen = updates(&mut *client, GoalUpdate::is_end);
        let [GoalUpdate::Ended { outcome: GoalOutcome::Succeeded, .. }] = &seen[..] else {
            panic!("{seen:?}")
        };
    });
}

#[test]
fn what_goes_wrong_in_a_method_aborts_its_goal() {
    let (bus, context) = bench();
    let mut client = bus.open_action_client(&spec(), &Context::default()).unwrap();
    let mut aborted = |to| {
        while client.link().peers == Some(0) {
            std::thread::yield_now();
        }
        client.send(&goal(to)).unwrap();
        match updates(&mut *client, GoalUpdate::is_end).pop() {
            Some(GoalUpdate::Ended { outcome: GoalOutcome::Aborted, text, .. }) => text,
            other => panic!("{other:?}"),
        }
    };
    std::thread::scope(|scope| {
        let server = counter(&context, CounterMethod::Count, Mode::Reply);
        let served = scope.spawn(move || server.count("memory", 0, &Feedback::default()));
        assert_eq!(aborted(-1), "nothing is below 0");
        served.join().unwrap().unwrap();
        let server = counter(&context, CounterMethod::Narrow, Mode::Reply);
        let served = scope.spawn(move || server.narrow(0));
        let text = aborted(300);
        assert!(text.contains("argument to cannot be used"), "{text}");
        // The method has waited for another goal. It returns text where a number should be.
        let text = aborted(1);
        assert!(text.contains("demo/action/Count_Result"), "{text}");
        let result = served.join().unwrap();
        assert!(matches!(result, Err(MethodError::Reply { .. })), "{result:?}");
    });
}

#[test]
fn a_goal_of_another_form_is_rejected_and_a_body_that_panics_aborts() {
    struct Bad;

    #[communicator]
    impl Bad {
        #[register(Action, "memory", "/count", action_type = "demo/action/Count")]
        fn count(&self, to: i32, #[feedback] progress: &Feedback) -> i32 {
            let error = progress.send("no number").unwrap_err().to_string();
            assert!(error.starts_with("the value is no feedback of the action: "), "{error}");
            panic!("at {to}")
        }
    }

    let (bus, context) = bench();
    let mut server = Bad.communicator_in(&context);
    server.activate(BadMethod::Count, Mode::Reply).unwrap();
    let mut client = bus.open_action_client(&spec(), &Context::default()).unwrap();
    std::thread::scope(|scope| {
        let served = scope.spawn(move || server.count(0, &Feedback::default()));
        while client.link().peers == Some(0) {
            std::thread::yield_now();
        }
        client.send(&Request::default().with(Map::from([("too", 3)]))).unwrap();
        let seen = updates(&mut *client, GoalUpdate::is_end);
        assert!(
            matches!(&seen[..], [GoalUpdate::Rejected(text)] if text.contains("too")),
            "{seen:?}"
        );
        client.send(&goal(3)).unwrap();
        let seen = updates(&mut *client, GoalUpdate::is_end);
        let Some(GoalUpdate::Ended { outcome: GoalOutcome::Aborted, text, .. }) = seen.last()
        else {
            panic!("{seen:?}")
        };
        assert_eq!(text, "the method ended without an answer");
        assert!(served.join().is_err());
    });
}

#[test]
fn an_action_is_no_topic_and_needs_a_type_that_is_found() {
    let (_bus, context) = bench();
    let mut counter = Counter.communicator_in(&context);
    for mode in Mode::ALL {
        let is_topic = mode.sends() || mode.listens();
        let result = counter.activate(CounterMethod::Stop, mode);
        assert_eq!(matches!(result, Err(ActivateError::NoTopic { .. })), is_topic, "{mode}");
    }
    counter.activate(CounterMethod::Untyped, Mode::Request).unwrap();
    for (of, words) in [
        (None, "option action_type is not given, and should be the type of an action"),
        (Some("demo/action/Nothing"), "the type of an action whose definition is found"),
        (Some("geometry_msgs/msg/Twist"), "geometry_msgs/msg/Twist is no action"),
    ] {
        let error = counter.untyped(of.map(str::to_owned)).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
}

/// A middleware that has no actions.
struct Functions(Memory);

impl Middleware for Functions {
    fn name(&self) -> &str {
        "memory"
    }

    fn open_listener(
        &self,
        spec: &TopicSpec,
        context: &Context,
    ) -> Opened<dyn wrapyfi_endpoint::Listener> {
        self.0.open_listener(spec, context)
    }

    fn open_publisher(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Publisher> {
        self.0.open_publisher(spec, context)
    }

    fn open_client(
        &self,
        spec: &wrapyfi_endpoint::ServiceSpec,
        context: &Context,
    ) -> Opened<dyn wrapyfi_endpoint::Client> {
        self.0.open_client(spec, context)
    }

    fn open_server(
        &self,
        spec: &wrapyfi_endpoint::ServiceSpec,
        context: &Context,
    ) -> Opened<dyn wrapyfi_endpoint::Server> {
        self.0.open_server(spec, context)
    }
}

#[test]
fn a_function_stands_for_an_action_where_there_are_none() {
    struct Function;

    #[communicator]
    impl Function {
        #[register(NativeObject, "memory", "/count")]
        fn count(&self, to: i32) -> Reached {
            Reached { reached: to }
        }
    }

    let functions = Arc::new(Functions(Memory::new("memory")));
    let context = CommunicatorContext::builder().only(functions).types(types()).build();
    let server = counter(&context, CounterMethod::Count, Mode::Reply);
    let error = server.count("memory", 1, &Feedback::default()).unwrap_err();
    assert!(matches!(error, MethodError::NoActions { .. }), "{error:?}");
    assert!(error.to_string().contains("register a function (NativeObject) and route it"));
    let mut function = Function.communicator_in(&context);
    function.activate(FunctionMethod::Count, Mode::Reply).unwrap();
    let client = counter(&context, CounterMethod::Count, Mode::Request);
    std::thread::scope(|scope| {
        scope.spawn(|| function.count(0).unwrap());
        let reached = client.count("memory", 3, &Feedback::default()).unwrap();
        assert_eq!(reached, Some(Reached { reached: 3 }));
    });
}
