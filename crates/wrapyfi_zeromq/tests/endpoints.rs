//! Listeners and publishers through a broker.

use std::io::{Read as _, Write as _};
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::common::{Cable, MONITOR, any_ports, bound, foreign, peer, subscriber, wait_for_count};
use wrapyfi_conformance::until;
use wrapyfi_data::Limits;
use wrapyfi_data::types::{MessageType, Payload, Value};
use wrapyfi_endpoint::{
    Cause, CauseCode, Context, DropReason, Link, Listener, Middleware, OpenError, Overflow,
    PublishError, Publisher, QueueSpec, Sample, TopicSpec,
};
use wrapyfi_zeromq::{Broker, ZeroMq, ZeroMqConfig, ZeroMqError};

fn spec(topic: &str) -> TopicSpec {
    TopicSpec::new(topic, MessageType::NativeObject)
}

fn number(n: i64) -> Payload {
    Payload::from(Value::Int(n))
}

fn dropped(context: &Context, reason: DropReason) -> u64 {
    context.counters.snapshot().dropped_for(reason)
}

#[track_caller]
fn next(listener: &mut dyn Listener) -> Sample {
    let mut sample = None;
    until("a message", || {
        sample = listener.take().unwrap();
        sample.is_some()
    });
    sample.unwrap()
}

fn drain(listener: &mut dyn Listener) -> Vec<Payload> {
    std::iter::from_fn(|| listener.take().unwrap()).map(|sample| sample.payload).collect()
}

/// A listener of `zeromq`, and a raw publisher that knows the broker knows of it.
fn listener_and_raw(
    zeromq: &ZeroMq,
    spec: &TopicSpec,
) -> (Box<dyn Listener>, Context, zmq::Socket) {
    let context = Context::default();
    let listener = zeromq.open_listener(spec, &context).unwrap();
    let raw = peer(&zmq::Context::new(), zmq::XPUB, zeromq.sub_port());
    let subscription = [b"\x01", spec.topic.as_bytes()].concat();
    while raw.recv_bytes(0).unwrap() != subscription {}
    (listener, context, raw)
}

fn ready(publisher: &dyn Publisher) {
    until("a listener", || publisher.link().peers > Some(0));
}

#[test]
fn what_is_published_arrives_in_either_order_of_start() {
    let ours = ZeroMq::start(&any_ports()).unwrap();
    let theirs = ZeroMq::start(&foreign(ours.pub_port(), ours.sub_port())).unwrap();
    for (first, second) in [(&ours, &theirs), (&theirs, &ours)] {
        let context = Context::default();
        let mut publisher = first.open_publisher(&spec("/a"), &context).unwrap();
        until("the broker", || publisher.link().waiting_for.is_none());
        assert_eq!(publisher.link().peers, Some(0));
        let unheard = publisher.publish(&number(0)).unwrap_err();
        assert_eq!(unheard.to_string(), "nobody listens to \"/a\"");
        while context.wake.wait(Duration::ZERO) {}
        let mut listener = second.open_listener(&spec("/a"), &Context::default()).unwrap();
        assert!(context.wake.wait(Duration::from_secs(30)), "the owner is told");
        ready(&*publisher);
        let sent = publisher.publish(&number(7)).unwrap();
        let sample = next(&mut *listener);
        assert_eq!((sample.payload, sample.wire_bytes), (number(7), sent));
        assert_eq!(listener.link().waiting_for, None);
        drop(listener);
        until("no listener", || publisher.link().peers == Some(0));

        let mut listener = second.open_listener(&spec("/b"), &Context::default()).unwrap();
        let mut publisher = first.open_publisher(&spec("/b"), &Context::default()).unwrap();
        ready(&*publisher);
        publisher.publish(&number(8)).unwrap();
        assert_eq!(next(&mut *listener).payload, number(8));
    }
}

/// No thread of the broker has to run between the two: what was published has been passed on.
#[test]
fn a_publisher_in_the_process_of_the_broker_passes_its_messages_on_itself() {
    let ours = ZeroMq::start(&any_ports()).unwrap();
    let context = zmq::Context::new();
    let listener = subscriber(&context, ours.pub_port(), "/a");
    let mut publisher = ours.open_publisher(&spec("/a"), &Context::default()).unwrap();
    ready(&*publisher);
    for n in 1..=100 {
        publisher.publish(&number(n)).unwrap();
        assert_eq!(ours.broker_status().unwrap().messages, n.unsigned_abs());
    }
    for n in 1..=100 {
        let frames = listener.recv_multipart(0).unwrap();
        assert_eq!(frames, [b"/a".to_vec(), n.to_string().into_bytes()]);
    }
}

#[test]
fn longer_topics_and_bad_messages_are_counted() {
    let zeromq = ZeroMq::start(&any_ports()).unwrap();
    let mut spec = spec("/a");
    spec.limits = Limits { message_bytes: 1000, ..Limits::default() };
    let (mut listener, context, raw) = listener_and_raw(&zeromq, &spec);
    raw.send_multipart(["/ab", "1"], 0).unwrap();
    raw.send_multipart(["/a", &"1".repeat(1000)], 0).unwrap();
    raw.send_multipart(vec!["/a"; 17], 0).unwrap();
    raw.send_multipart(["/a", "{not json"], 0).unwrap();
    raw.send_multipart(["/a", "5"], 0).unwrap();
    let mut error = None;
    until("the bad message", || {
        error = listener.take().err();
        error.is_some()
    });
    assert_eq!(DropReason::from(&error.unwrap()), DropReason::Malformed);
    let sample = next(&mut *listener);
    assert_eq!((sample.payload, sample.wire_bytes), (number(5), 3));
    assert_eq!(dropped(&context, DropReason::WrongTopic), 1);
    assert_eq!(dropped(&context, DropReason::Oversize), 1);
    assert_eq!(dropped(&context, DropReason::Malformed), 1, "too many frames");
    assert_eq!(context.counters.snapshot().received, 5);
}

#[test]
fn a_message_that_cuts_the_connection_is_counted_and_survived() {
    let zeromq = ZeroMq::start(&any_ports()).unwrap();
    let mut spec = spec("/a");
    spec.limits = Limits { message_bytes: 1000, ..Limits::default() };
    let (mut listener, context, raw) = listener_and_raw(&zeromq, &spec);
    until("the broker", || listener.link().waiting_for.is_none());
    raw.send_multipart(["/a", "1"], 0).unwrap();
    assert_eq!(next(&mut *listener).payload, number(1));
    raw.send_multipart(["/a", &"1".repeat(100_000)], 0).unwrap();
    until("the drop", || dropped(&context, DropReason::Oversize) == 1);
    until("the broker", || listener.link().waiting_for.is_none());
    // The broker knows of the listener a moment later.
    let mut sample = None;
    until("a message", || {
        raw.send_multipart(["/a", "2"], 0).unwrap();
        sample = listener.take().unwrap();
        sample.is_some()
    });
    assert_eq!(sample.unwrap().payload, number(2));
    assert_eq!(dropped(&context, DropReason::Oversize), 1);
}

#[test]
fn a_broker_that_never_ends_a_message_is_left_and_met_again() {
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let zeromq = ZeroMq::start(&foreign(port.local_addr().unwrap().port(), 1)).unwrap();
    let context = Context::default();
    let _listener = zeromq.open_listener(&spec("/a"), &context).unwrap();
    let (mut broker, _) = port.accept().unwrap();
    let mut greeting = [&[0xff, 0, 0, 0, 0, 0, 0, 0, 1, 0x7f, 3, 0][..], b"NULL"].concat();
    greeting.resize(64, 0);
    let ready = b"\x05READY\x0bSocket-Type\0\0\0\x04XPUB";
    greeting.extend([&[4, ready.len() as u8][..], ready].concat());
    broker.write_all(&greeting).unwrap();
    let mut said = Vec::new();
    while !said.ends_with(b"\x01/a") {
        let mut some = [0; 256];
        let count = broker.read(&mut some).unwrap();
        said.extend(&some[..count]);
    }
    // The topic and frames of one byte, each with another behind it.
    broker.write_all(&[&b"\x01\x02/a"[..], &b"\x01\x01x".repeat(5000)].concat()).unwrap();
    until("the drop", || dropped(&context, DropReason::Oversize) == 1);
    port.accept().expect("it is connected to again");
}

#[test]
fn unwanted_messages_are_dropped_unseen() {
    let zeromq = ZeroMq::start(&any_ports()).unwrap();
    let mut spec = spec("/a");
    spec.queue = QueueSpec { depth: 1, overflow: Overflow::Block(Duration::from_secs(60)) };
    let (mut listener, context, raw) = listener_and_raw(&zeromq, &spec);
    assert!(!listener.discard());
    for text in ["{not json", "2"] {
        raw.send_multipart(["/a", text], 0).unwrap();
    }
    until("a full queue", || context.counters.snapshot().received == 2);
    assert!(listener.discard());
    assert_eq!(next(&mut *listener).payload, number(2), "the held one takes its place");
}

#[test]
fn a_full_queue_follows_its_policy() {
    let zeromq = ZeroMq::start(&any_ports()).unwrap();
    for (topic, overflow, kept) in
        [("/oldest", Overflow::DropOldest, [8, 9]), ("/newest", Overflow::DropNewest, [0, 1])]
    {
        let mut spec = spec(topic);
        spec.queue = QueueSpec { depth: 2, overflow };
        let (mut listener, context, raw) = listener_and_raw(&zeromq, &spec);
        for n in 0..10 {
            raw.send_multipart([topic, &n.to_string()], 0).unwrap();
        }
        until("ten messages", || context.counters.snapshot().received == 10);
        until("the drops", || dropped(&context, DropReason::QueueFull) == 8);
        assert_eq!(drain(&mut *listener), kept.map(number));
    }
}

#[test]
fn block_loses_nothing_while_the_reader_comes_back() {
    let zeromq = ZeroMq::start(&any_ports()).unwrap();
    let mut slow = spec("/slow");
    slow.queue = QueueSpec { depth: 1, overflow: Overflow::Block(Duration::from_secs(60)) };
    let (mut listener, context, raw) = listener_and_raw(&zeromq, &slow);
    let (mut other, _, other_raw) = listener_and_raw(&zeromq, &spec("/other"));
    for n in 0..10 {
        raw.send_multipart(["/slow", &n.to_string()], 0).unwrap();
    }
    until("a full queue", || context.counters.snapshot().received == 2);
    // One stalled listener does not stop the others.
    other_raw.send_multipart(["/other", "1"], 0).unwrap();
    assert_eq!(next(&mut *other).payload, number(1));
    for n in 0..10 {
        assert_eq!(next(&mut *listener).payload, number(n));
    }
    assert_eq!(context.counters.snapshot().received, 10);
    assert!(context.counters.snapshot().drops.is_empty());
}

#[test]
fn block_gives_up_at_its_deadline() {
    let zeromq = ZeroMq::start(&any_ports()).unwrap();
    let mut spec = spec("/a");
    spec.queue = QueueSpec { depth: 1, overflow: Overflow::Block(Duration::from_millis(20)) };
    let (mut listener, context, raw) = listener_and_raw(&zeromq, &spec);
    for n in 0..3 {
        raw.send_multipart(["/a", &n.to_string()], 0).unwrap();
    }
    until("the deadlines", || dropped(&context, DropReason::BlockDeadline) == 2);
    assert_eq!(drain(&mut *listener), [number(0)]);
}

#[test]
fn our_own_messages_are_not_received() {
    let ours = ZeroMq::start(&any_ports()).unwrap();
    let theirs = ZeroMq::start(&foreign(ours.pub_port(), ours.sub_port())).unwrap();
    let context = Context::default();
    let mut echo = ours.open_listener(&spec("/a"), &context).unwrap();
    let mut other = theirs.open_listener(&spec("/a"), &Context::default()).unwrap();
    let mut publisher = ours.open_publisher(&spec("/a"), &Context::default()).unwrap();
    let mut foreign = theirs.open_publisher(&spec("/a"), &Context::default()).unwrap();
    let monitor = subscriber(&zmq::Context::new(), ours.pub_port(), MONITOR);
    wait_for_count(&monitor, "/a", 2);
    ready(&*publisher);
    ready(&*foreign);
    publisher.publish(&number(1)).unwrap();
    assert_eq!(next(&mut *other).payload, number(1));
    until("the echo", || dropped(&context, DropReason::OwnPublication) == 1);
    // The same value from another program is theirs, not ours.
    foreign.publish(&number(1)).unwrap();
    assert_eq!(next(&mut *echo).payload, number(1));
}

#[test]
fn routes_live_again_after_the_broker_was_away() {
    let broker = Broker::start(&any_ports()).unwrap();
    let (pub_port, sub_port) = (broker.pub_port(), broker.sub_port());
    let zeromq = ZeroMq::start(&foreign(pub_port, sub_port)).unwrap();
    let other = ZeroMq::start(&foreign(pub_port, sub_port)).unwrap();
    let mut listener = zeromq.open_listener(&spec("/a"), &Context::default()).unwrap();
    let mut publisher = other.open_publisher(&spec("/a"), &Context::default()).unwrap();
    ready(&*publisher);
    drop(broker);
    until("the listener's reason", || listener.link().waiting_for.is_some());
    until("the publisher's reason", || publisher.link().waiting_for.is_some());
    until("no listener", || publisher.link().peers == Some(0));
    let what = publisher.link().waiting_for.unwrap();
    assert_eq!(what.code(), CauseCode::ServerAway);
    assert_eq!(what.subject(), format!("tcp://127.0.0.1:{sub_port}"));
    let error = publisher.publish(&number(1)).unwrap_err();
    assert!(matches!(error, PublishError::Transport { .. }));
    assert_eq!(error.to_string(), format!("could not send to \"/a\": waiting for {what}"));
    let _broker =
        Broker::start(&ZeroMqConfig { pub_port, sub_port, ..ZeroMqConfig::default() }).unwrap();
    ready(&*publisher);
    publisher.publish(&number(2)).unwrap();
    assert_eq!(next(&mut *listener).payload, number(2));
}

/// Connections to a broker behind a cable that is cut stay open: both ends of a route miss the broker all the same.
#[test]
fn a_broker_behind_a_cut_cable_is_missed_and_found_again() {
    let broker = Broker::start(&any_ports()).unwrap();
    let cables = [broker.pub_port(), broker.sub_port()].map(Cable::to);
    let [pub_port, sub_port] = cables.each_ref().map(|cable| cable.port);
    let zeromq = ZeroMq::start(&foreign(pub_port, sub_port)).unwrap();
    let other = ZeroMq::start(&foreign(pub_port, sub_port)).unwrap();
    let mut listener = zeromq.open_listener(&spec("/a"), &Context::default()).unwrap();
    let mut publisher = other.open_publisher(&spec("/a"), &Context::default()).unwrap();
    ready(&*publisher);
    publisher.publish(&number(1)).unwrap();
    assert_eq!(next(&mut *listener).payload, number(1));
    cables.iter().for_each(|cable| cable.cut(true));
    until("the listener's reason", || listener.link().waiting_for.is_some());
    until("the publisher's reason", || publisher.link().waiting_for.is_some());
    cables.iter().for_each(|cable| cable.cut(false));
    let mut sample = None;
    until("a message", || {
        // Refused until the broker and the listener are there again.
        publisher.publish(&number(2)).ok();
        sample = listener.take().unwrap();
        sample.is_some()
    });
    assert_eq!(sample.unwrap().payload, number(2));
}

#[test]
fn something_else_in_the_place_of_the_broker_is_said() {
    let context = zmq::Context::new();
    let (_rep, port) = bound(&context, zmq::REP);
    let zeromq = ZeroMq::start(&foreign(port, port)).unwrap();
    let listener = zeromq.open_listener(&spec("/a"), &Context::default()).unwrap();
    let publisher = zeromq.open_publisher(&spec("/a"), &Context::default()).unwrap();
    for link in [&|| listener.link() as Link, &|| publisher.link()] as [&dyn Fn() -> Link; 2] {
        until("the reason", || {
            link().waiting_for.is_some_and(|what| what.code() == CauseCode::OtherServer)
        });
    }
}

#[test]
fn a_broker_in_the_place_of_something_else_is_found() {
    let context = zmq::Context::new();
    let (rep, port) = bound(&context, zmq::REP);
    let (_, free) = bound(&context, zmq::REP);
    let zeromq = ZeroMq::start(&foreign(port, port)).unwrap();
    let listener = zeromq.open_listener(&spec("/a"), &Context::default()).unwrap();
    until("the reason", || {
        listener.link().waiting_for.is_some_and(|what| what.code() == CauseCode::OtherServer)
    });
    drop(rep);
    let config = ZeroMqConfig { pub_port: port, sub_port: free, ..ZeroMqConfig::default() };
    let mut broker = None;
    until("the port", || {
        broker = Broker::start(&config).ok();
        broker.is_some()
    });
    until("the broker", || listener.link().waiting_for.is_none());
}

#[test]
fn endpoints_that_outlive_their_instance_hang_nobody() {
    let zeromq = ZeroMq::start(&any_ports()).unwrap();
    let (pub_port, sub_port) = (zeromq.pub_port(), zeromq.sub_port());
    let mut listener = zeromq.open_listener(&spec("/a"), &Context::default()).unwrap();
    let mut publisher = zeromq.open_publisher(&spec("/a"), &Context::default()).unwrap();
    ready(&*publisher);
    let start = Instant::now();
    drop(zeromq);
    assert!(start.elapsed() < 2 * Limits::SHUTDOWN, "{:?}", start.elapsed());
    assert!(matches!(publisher.publish(&number(1)), Err(PublishError::Transport { .. })));
    assert_eq!(listener.take().unwrap(), None);
    assert!(matches!(listener.link().waiting_for, Some(Cause::Ended(_))));
    let again = Broker::start(&ZeroMqConfig { pub_port, sub_port, ..ZeroMqConfig::default() });
    assert!(again.is_ok(), "{again:?}");
}

#[test]
fn names_that_cannot_work_are_refused() {
    let zeromq = Arc::new(ZeroMq::start(&any_ports()).unwrap());
    assert_eq!(zeromq.name(), "zeromq");
    for name in ["", MONITOR, "ZEROMQ/CONNECTIONS/x", "/a\0", &"x".repeat(1025)] {
        for result in [
            zeromq.open_listener(&spec(name), &Context::default()).err(),
            zeromq.open_publisher(&spec(name), &Context::default()).err(),
        ] {
            let error = result.unwrap();
            assert!(matches!(error, OpenError::InvalidName { .. }), "{error}");
            assert!(!error.is_transient());
        }
    }
    let empty = ZeroMqConfig { monitor_topic: String::new(), ..any_ports() };
    assert!(matches!(ZeroMq::start(&empty), Err(ZeroMqError::MonitorTopic { .. })));
}

#[test]
fn there_is_room_for_more_endpoints_than_a_context_has_sockets() {
    // As the programs do at their start: one endpoint takes four files here, and a fifth at the broker.
    let limit = rustix::process::getrlimit(rustix::process::Resource::Nofile);
    let most = rustix::process::Rlimit { current: limit.maximum, maximum: limit.maximum };
    rustix::process::setrlimit(rustix::process::Resource::Nofile, most).unwrap();
    let zeromq = ZeroMq::start(&any_ports()).unwrap();
    let open = |number: usize| {
        let context = Context::default();
        let topic = format!("/many/{number:03}");
        (zeromq.open_listener(&spec(&topic), &context).unwrap(), topic)
    };
    let mut listeners: Vec<_> = (0..400).map(open).collect();
    until("all subscriptions", || {
        zeromq.broker_status().unwrap().subscriptions.len() == listeners.len()
    });
    let raw = peer(&zmq::Context::new(), zmq::XPUB, zeromq.sub_port());
    for _ in 0..listeners.len() {
        raw.recv_bytes(0).unwrap();
    }
    for (listener, topic) in &mut listeners {
        raw.send_multipart([topic.as_str(), "3"], 0).unwrap();
        assert_eq!(next(&mut **listener).payload, number(3), "{topic}");
    }
}

#[test]
fn a_publisher_without_files_says_so_and_connects_when_there_are_some() {
    use rustix::process::{Resource, getrlimit, setrlimit};
    let limit = getrlimit(Resource::Nofile);
    setrlimit(Resource::Nofile, rustix::process::Rlimit { current: Some(256), ..limit }).unwrap();
    let broker = Broker::start(&any_ports()).unwrap();
    let zeromq = ZeroMq::start(&foreign(broker.pub_port(), broker.sub_port())).unwrap();
    let files: Vec<_> =
        std::iter::from_fn(|| std::fs::File::open("/dev/null").ok()).take(256).collect();
    assert!(files.len() < 256);
    let publisher = zeromq.open_publisher(&spec("/a"), &Context::default()).unwrap();
    let said = || publisher.link().waiting_for.map_or_else(String::new, |it| it.to_string());
    until("the reason", || said().contains("limit of open files") && said().contains("ulimit -n"));
    drop(files);
    until("the connection", || publisher.link().waiting_for.is_none());
}

#[test]
fn a_panic_at_one_endpoint_ends_neither_the_others_nor_itself() {
    struct Panics;
    impl std::task::Wake for Panics {
        fn wake(self: Arc<Self>) {
            panic!("on purpose, on the thread that rings");
        }
    }
    let zeromq = ZeroMq::start(&any_ports()).unwrap();
    let (mut good, _context, raw) = listener_and_raw(&zeromq, &spec("/good"));
    let context = Context::default();
    let mut bad = zeromq.open_listener(&spec("/bad"), &context).unwrap();
    while raw.recv_bytes(0).unwrap() != b"\x01/bad" {}
    // Rung when the connection is there, too: so that the message is what rings.
    until("the connection", || bad.link().waiting_for.is_none());
    context.wake.notify(&Arc::new(Panics).into());
    for (topic, text) in [("/bad", "1"), ("/good", "2"), ("/bad", "3")] {
        raw.send_multipart([topic, text], 0).unwrap();
    }
    assert_eq!(next(&mut *good).payload, number(2));
    assert_eq!(next(&mut *bad).payload, number(1));
    assert_eq!(next(&mut *bad).payload, number(3));
}
