//! Actions of ROS 2 and what others may send: floods, bytes that are no messages, odd definitions.

use std::time::Duration;

use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::action_msgs::msg::{GoalStatus, GoalStatusArray};
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::ResolvedType;

use crate::action::Parts;
use crate::action_client::PartsClient;
use crate::action_tests::{
    Bench, SECOND, cancel_bytes, count, ended, goal, goal_bytes, id_bytes, taken, told, wish,
};
use wrapyfi_data::types::{Map, RosAction, RosMessage, RosType, Value};
use wrapyfi_endpoint::{
    ActionClient, ActionServer, DropReason, GoalOutcome, GoalUpdate, Middleware, Request,
};

/// The parts of an action carry fields of these names beside those of its own.
#[test]
fn fields_may_be_called_as_the_parts_that_carry_them() {
    let name = TypeName::parse(Dialect::Ros2, "demo/action/Odd").unwrap();
    let text = "int32 goal\nint32 goal_id\nbool accepted\n---\nint32 result\nint32 status\n---\nint32 feedback\n\
                int32 goal_id\n";
    let odd = ResolvedType::from_text(Dialect::Ros2, &name, text).unwrap();
    let bench = Bench::of(RosAction::new(&odd).unwrap());
    let (mut server, mut client) = (bench.server(), bench.client());
    let fields = |pairs: &[(&str, i32)]| {
        Map::from_iter(pairs.iter().map(|(key, value)| (*key, Value::from(*value))))
    };
    client.send(&Request::default().with(fields(&[("goal", 3), ("goal_id", 4)]))).unwrap();
    let Some(wrapyfi_endpoint::GoalRequest::Goal { number, goal, .. }) = server.take().unwrap()
    else {
        panic!("no goal");
    };
    let call = goal.call().unwrap();
    let asked = ["goal", "goal_id"].map(|key| call.kwargs.get(key).unwrap().as_i64());
    assert_eq!(asked, [Some(3), Some(4)]);
    let feedback = Value::from(fields(&[("feedback", 5), ("goal_id", 6)]));
    server.update(number, GoalUpdate::Feedback(feedback.into())).unwrap();
    assert_eq!(told(&mut client), ["accepted", "executing", "at 5"]);
    assert_eq!(server.take().unwrap(), None);
    let result = Some(Value::from(fields(&[("result", 7), ("status", 8)])).into());
    let (outcome, text) = (GoalOutcome::Succeeded, String::new());
    server.update(number, GoalUpdate::Ended { outcome, result, text }).unwrap();
    assert_eq!(told(&mut client), ["succeeded 7"]);
}

/// Feedback that is not taken is dropped and counted, and the end of the goal comes all the same.
#[test]
fn a_flood_of_feedback_is_bounded_and_counted() {
    const FLOOD: usize = 5000;
    let bench = Bench::new();
    let context = bench.context();
    let (mut server, mut client) =
        (bench.server(), PartsClient::open(&bench.bus, &bench.spec, &context).unwrap());
    client.send(&goal(3)).unwrap();
    let (number, _) = taken(&mut server);
    server.update(number, GoalUpdate::Executing).unwrap();
    assert_eq!(told(&mut client), ["accepted", "executing"]);
    for at in 0..FLOOD {
        let at = Value::from(Map::from([("at", Value::from(at as f64))]));
        server.update(number, GoalUpdate::Feedback(at.into())).unwrap();
    }
    let heard = told(&mut client);
    assert_eq!((heard.len(), heard.last().unwrap().as_str()), (1000, "at 4999"));
    let dropped = context.counters.snapshot().dropped_for(DropReason::QueueFull);
    assert_eq!(dropped, FLOOD as u64 - 1000);
    assert_eq!(server.take().unwrap(), None);
    server.update(number, ended(GoalOutcome::Succeeded, 3)).unwrap();
    assert_eq!(told(&mut client), ["succeeded 3"]);
}

/// Requests that wait for an answer are bounded: what is over the limit is refused and counted.
#[test]
fn floods_of_cancels_and_of_requests_for_results_are_bounded_and_counted() {
    const FLOOD: usize = 200;
    let bench = Bench::new();
    let mut server = bench.server();
    let mut sender = bench.caller(|parts| parts.send_goal);
    sender.send(goal_bytes([1; 16], 1));
    let (number, _) = taken(&mut server);
    server.update(number, GoalUpdate::Executing).unwrap();
    let mut cancels: Vec<_> = (0..10).map(|_| bench.caller(|parts| parts.cancel_goal)).collect();
    for caller in &mut cancels {
        for _ in 0..FLOOD {
            caller.send(cancel_bytes([1; 16], 0));
        }
    }
    assert_eq!(wish(&mut server), number);
    assert_eq!(server.take().unwrap(), None, "one wish");
    let limit = bench.spec.goals;
    assert!(server.kept() <= 1 + limit, "{} are kept", server.kept());
    assert!(bench.dropped(DropReason::Overloaded) >= (10 * FLOOD - limit) as u64);

    let mut asker = bench.caller(|parts| parts.get_result);
    for _ in 0..FLOOD {
        asker.send(id_bytes([1; 16]));
    }
    assert_eq!(server.take().unwrap(), None);
    assert!(server.kept() <= 1 + limit + 16, "{} are kept", server.kept());
    server.update(number, ended(GoalOutcome::Canceled, 1)).unwrap();
    assert_eq!(server.take().unwrap(), None);
    assert_eq!(server.kept(), 0, "all have their answer");
    bench.pass(Duration::from_secs(10) + SECOND);
    assert_eq!((server.take().unwrap(), server.deadline()), (None, None));
}

#[test]
fn bytes_that_are_no_messages_are_counted_and_refused() {
    let bench = Bench::new();
    let mut server = bench.server();
    let mut sender = bench.caller(|parts| parts.send_goal);
    for cdr in [&b""[..], b"\0\x01", b"\0\x01\0\0", &[0, 1, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9]] {
        sender.send(cdr.to_vec());
        assert!(server.take().is_err());
        assert_eq!(sender.replied("accepted"), 0);
    }
    for of in [|parts: Parts| parts.cancel_goal, |parts: Parts| parts.get_result] {
        let mut caller = bench.caller(of);
        for cdr in [&b""[..], b"\0\x01\0\0", b"\0\x01\0\0\xff\xff\xff\xff"] {
            caller.send(cdr.to_vec());
            assert!(server.take().is_err());
        }
    }
    assert_eq!(bench.dropped(DropReason::Malformed), 10);

    let context = bench.context();
    let mut client = PartsClient::open(&bench.bus, &bench.spec, &context).unwrap();
    client.send(&goal(1)).unwrap();
    let (number, _) = taken(&mut server);
    server.update(number, GoalUpdate::Executing).unwrap();
    assert_eq!(told(&mut client), ["accepted", "executing"]);
    let parts = Parts::of(&bench.spec).unwrap();
    let publish = |spec: &_, ros_type: RosType, cdr: &[u8]| {
        let mut publisher = bench.bus.open_publisher(spec, &bench.context()).unwrap();
        publisher.publish(&RosMessage::new(ros_type, cdr.to_vec()).into()).unwrap();
    };
    let states = (&parts.status, parts.states);
    let feedback = (&parts.feedback, count().feedback_message());
    for (spec, ros_type) in [states, feedback] {
        for cdr in [&b""[..], b"\0\x01\0\0", b"\0\x01\0\0\xff\xff\xff\xff"] {
            publish(spec, ros_type, cdr);
        }
    }
    // Ten thousand states of goals that are none of ours.
    let strangers = GoalStatusArray { status_list: vec![GoalStatus::default(); 10_000] };
    publish(states.0, states.1, &strangers.encode().to_bytes());
    assert!(told(&mut client).is_empty());
    assert_eq!(context.counters.snapshot().dropped_for(DropReason::Malformed), 6);
}

#[test]
fn a_result_of_another_type_aborts_the_goal() {
    let bench = Bench::new();
    let (mut server, mut client) = (bench.server(), bench.client());
    client.send(&goal(1)).unwrap();
    let (number, _) = taken(&mut server);
    server.update(number, GoalUpdate::Executing).unwrap();
    told(&mut client);
    assert_eq!(server.take().unwrap(), None);
    let result = Some(Value::from(Map::from([("nothing", Value::from(1))])).into());
    let (outcome, text) = (GoalOutcome::Succeeded, String::new());
    let error = server.update(number, GoalUpdate::Ended { outcome, result, text }).unwrap_err();
    assert!(error.to_string().contains("nothing"), "{error}");
    assert_eq!(told(&mut client), ["aborted 0"]);
}
