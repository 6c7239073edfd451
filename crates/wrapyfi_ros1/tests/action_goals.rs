//! Goals as others write them: odd ids, other types, times that stand still. Everything is read on the wire.

use std::net::TcpStream;
use std::time::Instant;

use crate::actions::{Scene, count, goal};
use crate::common::{RawPublisher, call, data_port, framed, greet, read_framed};
use wrapyfi_conformance::TIMEOUT;
use wrapyfi_data::types::{Payload, Stamp, Value};
use wrapyfi_endpoint::{
    ActionSpec, Clock, Context, DropReason, GoalOutcome, GoalRequest, GoalUpdate, RosNow,
};
use wrapyfi_ros1::Ros1;
use wrapyfi_ros1::header::Header;
use wrapyfi_ros1::xmlrpc::{Reply, text};

/// A publisher of goals of the type `kind`.
fn goals(scene: &Scene, kind: &str, md5: &str) -> RawPublisher {
    let header = Header::new().with("callerid", "/odd").with("type", kind).with("md5sum", md5);
    RawPublisher::start(&scene.master, "/odd", "/count/goal", &header)
}

/// `Header │ stamp │ id │ body`, with a size around it.
fn goal_bytes(id: &[u8], body: &[u8]) -> Vec<u8> {
    let head = [0; 12 + 4 + 8];
    framed(&[&head[..], &framed(id), body].concat())
}

/// A subscriber of what a node publishes.
fn hear(node: &Ros1, topic: &str) -> TcpStream {
    let own = Header::new().with("callerid", "/raw").with("topic", topic);
    let (stream, _) = greet(&data_port(node, topic), &own.with("type", "*").with("md5sum", "*"));
    stream.set_read_timeout(Some(TIMEOUT)).unwrap();
    let deadline = Instant::now() + TIMEOUT;
    let is_in = |info: Reply| format!("{:?}", info.value).contains("/raw");
    while !call(&node.api_uri(), "getBusInfo", vec![text("/raw")]).is_some_and(is_in) {
        assert!(Instant::now() < deadline, "{topic} has no subscriber");
    }
    stream
}

/// Stamp in nanoseconds and id of the goal in a message that begins with a header without a frame.
fn goal_id(message: &[u8]) -> (u64, Vec<u8>) {
    let number = |at: usize| u32::from_le_bytes(message[at..at + 4].try_into().unwrap());
    let (secs, nanos, size) = (number(16), number(20), number(24) as usize);
    (u64::from(secs) * 1_000_000_000 + u64::from(nanos), message[28..28 + size].to_vec())
}

fn succeeded() -> GoalUpdate {
    let result = Some(Payload::from(Value::from(3)));
    GoalUpdate::Ended { outcome: GoalOutcome::Succeeded, result, text: String::new() }
}

/// An id is any bytes, and comes back as it was; only an empty one is made here.
#[test]
fn odd_ids_of_goals_come_back_as_they_were() {
    let mut scene = Scene::new();
    let odd = goals(&scene, "demo/CountActionGoal", "*");
    scene.until("the server listens", |_| odd.subscribers() > 0);
    let mut results = hear(&scene.far, "/count/result");
    let longest = vec![b'x'; 4096];
    let ids: [&[u8]; 7] = [
        b"",
        "z\u{e4}hl\u{2192}\u{1f916}".as_bytes(),
        b"/a/b//c-1",
        b" \n\t",
        b"\xff\0\xfe",
        b"{}",
        &longest,
    ];
    for id in ids {
        odd.send(&goal_bytes(id, &3_i32.to_le_bytes()));
        let (number, _) = scene.goal();
        scene.tell(number, succeeded());
        let (stamp, told) = goal_id(&read_framed(&mut results).unwrap());
        assert!(stamp > 0);
        match id {
            b"" => assert!(told.starts_with(b"/far-"), "{}", String::from_utf8_lossy(&told)),
            id => assert_eq!(told, id),
        }
    }
}

/// An id of ten thousand letters is dropped, counted and told; what comes after it is taken.
#[test]
fn a_goal_with_an_endless_id_is_dropped_and_counted() {
    let mut scene = Scene::new();
    let odd = goals(&scene, "demo/CountActionGoal", "*");
    scene.until("the server listens", |_| odd.subscribers() > 0);
    odd.send(&goal_bytes(&[b'x'; 10_000], &3_i32.to_le_bytes()));
    assert!(refusal(&mut scene).contains("its id is too long"));
    assert_eq!(malformed(&scene), 1);
    odd.send(&goal_bytes(b"short", &3_i32.to_le_bytes()));
    scene.goal();
}

/// Error of the server for what it has received.
fn refusal(scene: &mut Scene) -> String {
    let deadline = Instant::now() + TIMEOUT;
    loop {
        assert!(Instant::now() < deadline);
        match scene.server.as_mut().unwrap().take() {
            Ok(None) => std::thread::yield_now(),
            Ok(Some(taken)) => panic!("{taken:?}"),
            Err(error) => return error.to_string(),
        }
    }
}

fn malformed(scene: &Scene) -> u64 {
    scene.contexts[1].counters.snapshot().dropped_for(DropReason::Malformed)
}

/// A goal whose bytes are not those of its type is rejected, so that its client does not wait for ever.
#[test]
fn a_goal_with_other_fields_is_rejected() {
    let mut scene = Scene::new();
    let odd = goals(&scene, "demo/CountActionGoal", "*");
    scene.until("the server listens", |_| odd.subscribers() > 0);
    let mut results = hear(&scene.far, "/count/result");
    odd.send(&goal_bytes(b"cut", b"\x01"));
    let told = refusal(&mut scene);
    assert!(told.contains("/count"), "{told}");
    let message = read_framed(&mut results).unwrap();
    let (_, id) = goal_id(&message);
    assert_eq!((id.as_slice(), message[28 + id.len()]), (&b"cut"[..], 5), "rejected");
    assert_eq!(malformed(&scene), 1);
}

/// A client of another type is not connected to, and is no client.
#[test]
fn goals_of_another_type_are_not_taken() {
    let mut scene = Scene::new();
    let odd = goals(&scene, "demo/OtherActionGoal", "0123456789abcdef0123456789abcdef");
    scene.until("the server has asked", |_| odd.subscribers() > 0);
    odd.send(&goal_bytes(b"odd", &3_i32.to_le_bytes()));
    scene.client.send(&goal(4)).unwrap();
    let (_, asked) = scene.goal();
    assert_eq!(asked.call().unwrap().kwargs.get("goal"), Some(&Value::from(4)));
    assert_eq!(scene.server.as_ref().unwrap().kept(), 1);
}

/// Simulated time without a clock is zero, and a stamp of zero means every goal to who cancels one.
#[test]
fn stamps_are_never_zero_where_simulated_time_has_no_clock() {
    let clock = || {
        let stamp = Stamp { sec: 0, nanosec: 0 };
        Clock::default().with_ros_time(move || RosNow { stamp, simulated: true })
    };
    let contexts = [(); 2].map(|()| Context { clock: clock(), ..Context::default() });
    let mut scene = Scene::with_contexts(&ActionSpec::new("/count", count()), contexts);
    let mut sent = hear(&scene.near, "/count/goal");
    let tickets = [1, 2].map(|to| scene.client.send(&goal(to)).unwrap());
    let numbers = tickets.map(|_| scene.goal().0);
    let stamps = tickets.map(|_| goal_id(&read_framed(&mut sent).unwrap()).0);
    assert!(0 < stamps[0] && stamps[0] < stamps[1], "{stamps:?}");
    scene.client.cancel(tickets[0]);
    assert_eq!(scene.request(), GoalRequest::Cancel(numbers[0]));
    scene.tell(numbers[1], succeeded());
    scene.until("the other one succeeds", |scene| {
        scene.client.take().is_some_and(|(one, update)| {
            one == tickets[1]
                && matches!(update, GoalUpdate::Ended { outcome: GoalOutcome::Succeeded, .. })
        })
    });
    assert!(scene.requests.is_empty(), "one was cancelled: {:?}", scene.requests);
    // A goal of others without id and stamp.
    let odd = goals(&scene, "demo/CountActionGoal", "*");
    scene.until("the server listens", |_| odd.subscribers() > 0);
    let mut results = hear(&scene.far, "/count/result");
    odd.send(&goal_bytes(b"", &3_i32.to_le_bytes()));
    let (number, _) = scene.goal();
    scene.tell(number, succeeded());
    assert!(goal_id(&read_framed(&mut results).unwrap()).0 > 0);
}
