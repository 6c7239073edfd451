//! Payloads through the middleware `ros2`, between two nodes over loopback.

use std::sync::Arc;
use std::time::Duration;

use wrapyfi_data::types::{Encoding, Image, Map, MessageType, Payload, RawPixels, Stamp, Value};
use wrapyfi_endpoint::{
    Context, DropReason, Link, Listener, Middleware, OpenError, Overflow, PublishError, Publisher,
    QosPreset, QueueSpec, Reliability, Sample, TakeError, TopicSpec,
};
use wrapyfi_ros2::graph::wait_until;
use wrapyfi_ros2::{CycloneConfig, CycloneGraph, Ros2};

use crate::common::{TIMEOUT, far_config, near_config};

/// Two nodes on one wire, each in a stack of its own.
fn pair() -> (Ros2, Ros2) {
    let open = |config: &CycloneConfig| {
        let graph = CycloneGraph::new(config).unwrap();
        Ros2::new(Arc::new(graph), |name| match name {
            "/robot/old" => Ok("/new".to_owned()),
            "/robot/forbidden" => Err("no rule allows it".to_owned()),
            name => Ok(name.to_owned()),
        })
    };
    (open(&near_config("near")), open(&far_config("far")))
}

struct Route {
    publisher: Box<dyn Publisher>,
    listener: Box<dyn Listener>,
    /// The listener's.
    context: Context,
}

fn connect(from: &Ros2, to: &Ros2, spec: &TopicSpec) -> Route {
    let context = Context::default();
    let publisher = from.open_publisher(spec, &Context::default()).unwrap();
    let listener = to.open_listener(spec, &context).unwrap();
    assert!(wait_until(&context.wake, TIMEOUT, || {
        publisher.link().peers == Some(1) && listener.link().peers == Some(1)
    }));
    assert_eq!(publisher.link().waiting_for, None);
    assert_eq!(listener.link().waiting_for, None);
    Route { publisher, listener, context }
}

impl Route {
    /// Sets aside the next message; how many were lost.
    fn discard_except_latched(&mut self) -> u64 {
        let mut lost = None;
        assert!(wait_until(&self.context.wake, TIMEOUT, || {
            lost = self.listener.forwarding().unwrap().discard_except_latched();
            lost.is_some()
        }));
        lost.unwrap()
    }

    fn next(&mut self) -> Result<Sample, TakeError> {
        let mut got = None;
        assert!(wait_until(&self.context.wake, TIMEOUT, || {
            got = self.listener.take().transpose();
            got.is_some()
        }));
        got.unwrap()
    }
}

fn number(n: i64) -> Payload {
    Value::from(Map::from([("n", n)])).into()
}

fn frame(width: u32, height: u32) -> Payload {
    let step = width * 3;
    let data: Vec<u8> = (0..step * height).map(|n| u8::try_from(n % 253).unwrap()).collect();
    let raw = RawPixels::new(width, height, Encoding::Bgr8, step, data).unwrap();
    Image::new(Stamp { sec: 7, nanosec: 9 }, raw).into()
}

#[test]
fn payloads_arrive_as_they_were_sent() {
    let (a, b) = pair();
    for (topic, message_type, payload) in [
        ("object", MessageType::NativeObject, number(1)),
        ("text", MessageType::StringJson, number(2)),
        ("small", MessageType::Image, frame(4, 3)),
        ("full_hd", MessageType::Image, frame(1920, 1080)),
    ] {
        let mut route = connect(&a, &b, &TopicSpec::new(topic, message_type));
        let bytes = route.publisher.publish(&payload).unwrap();
        let sample = route.next().unwrap();
        assert!(sample.payload == payload, "{topic}");
        assert_eq!(sample.wire_bytes, bytes.next_multiple_of(4), "{topic}");
        let now = route.context.counters.snapshot();
        assert_eq!((now.received, now.received_bytes), (1, sample.wire_bytes as u64));
    }
}

#[test]
fn names_are_expanded_and_remapped() {
    let (a, b) = pair();
    let spec = |name: &str| TopicSpec::new(name, MessageType::StringJson);
    let _old = a.open_publisher(&spec("old"), &Context::default()).unwrap();
    let _own = a.open_publisher(&spec("~/own"), &Context::default()).unwrap();
    let context = Context::default();
    let listener = b.open_listener(&spec("/new"), &context).unwrap();
    assert!(wait_until(&context.wake, TIMEOUT, || listener.link().peers == Some(1)));
    let topics: Vec<String> =
        a.graph().endpoints().unwrap().into_iter().map(|endpoint| endpoint.topic).collect();
    assert!(topics.iter().any(|topic| topic == "/robot/near/own"), "{topics:?}");
    for (name, reason) in [
        ("a b", "characters other than"),
        ("a//b", "repeated '/'"),
        ("forbidden", "no rule allows it"),
    ] {
        match a.open_listener(&spec(name), &Context::default()).err() {
            Some(error @ OpenError::InvalidName { .. }) => {
                assert!(error.to_string().contains(reason), "{error}");
                assert!(!error.is_transient());
            }
            other => panic!("{name}: {other:?}"),
        }
    }
}

#[test]
fn the_link_says_what_it_waits_for() {
    let (a, b) = pair();
    let context = Context::default();
    let images = TopicSpec::new("/x", MessageType::Image);
    let says = |link: &dyn Fn() -> Link, words: &str| {
        let held = wait_until(&context.wake, TIMEOUT, || {
            link().waiting_for.is_some_and(|what| what.to_string() == words)
        });
        assert!(held, "{words}: {:?}", link());
    };
    let listener = b.open_listener(&images, &context).unwrap();
    let heard = || listener.link();
    says(&heard, "a publisher of /x");
    let text = a.open_publisher(&TopicSpec::new("/x", MessageType::StringJson), &context).unwrap();
    says(
        &heard,
        "a publisher of /x with type sensor_msgs/msg/Image (those there carry std_msgs/msg/String)",
    );
    let sent = || text.link();
    says(
        &sent,
        "a subscriber of /x with type std_msgs/msg/String (those there carry sensor_msgs/msg/Image)",
    );
    drop(text);
    says(&heard, "a publisher of /x");
    let mut best_effort = images.clone();
    best_effort.qos.reliability = Reliability::BestEffort;
    let refused = a.open_publisher(&best_effort, &context).unwrap();
    let sent = || refused.link();
    says(
        &heard,
        "a publisher of /x that fits (/robot/near offers best effort, the route asks for reliable)",
    );
    says(
        &sent,
        "a subscriber of /x that fits (/robot/far asks for reliable, the route offers best effort)",
    );
}

#[test]
fn the_last_message_is_kept_for_later_listeners() {
    let (a, b) = pair();
    let mut spec = TopicSpec::new("/latched", MessageType::StringJson);
    spec.qos = QosPreset::Latched.into();
    let mut publisher = a.open_publisher(&spec, &Context::default()).unwrap();
    assert!(publisher.link().keeps_last);
    publisher.publish(&number(1)).unwrap();
    publisher.publish(&number(2)).unwrap();
    let context = Context::default();
    let listener = b.open_listener(&spec, &context).unwrap();
    let mut route = Route { publisher, listener, context };
    assert_eq!(route.next().unwrap().payload, number(2));
}

/// The last message of each publisher that came while no program listened is there when one does.
#[test]
fn what_publishers_keep_can_be_set_aside() {
    let (a, b) = pair();
    let mut spec = TopicSpec::new("/map", MessageType::StringJson);
    spec.qos = QosPreset::Latched.into();
    let open = || a.open_publisher(&spec, &Context::default()).unwrap();
    let (mut one, mut other) = (open(), open());
    one.publish(&number(1)).unwrap();
    other.publish(&number(7)).unwrap();
    let context = Context::default();
    let listener = b.open_listener(&spec, &context).unwrap();
    let mut route = Route { publisher: open(), listener, context };
    assert_eq!(
        [route.discard_except_latched(), route.discard_except_latched()],
        [0, 0],
        "one of each publisher"
    );
    for n in [2, 3] {
        one.publish(&number(n)).unwrap();
        assert_eq!(route.discard_except_latched(), 1, "instead of the one before");
    }
    let taken = [route.next(), route.next()].map(|sample| sample.unwrap().payload);
    assert_eq!(taken, [number(7), number(3)]);
    // Of others nothing is kept.
    spec.qos = QosPreset::Default.into();
    spec.topic = "/chatter".to_owned();
    let mut route = connect(&a, &b, &spec);
    route.publisher.publish(&number(1)).unwrap();
    assert_eq!(route.discard_except_latched(), 1);
    assert!(route.listener.take().unwrap().is_none());
}

#[test]
fn what_is_too_large_is_refused_on_both_sides() {
    let (a, b) = pair();
    let mut wide = TopicSpec::new("/big", MessageType::Image);
    let mut narrow = wide.clone();
    narrow.limits.message_bytes = 10_000;
    wide.limits.message_bytes = 1 << 20;
    let context = Context::default();
    let mut publisher = a.open_publisher(&wide, &Context::default()).unwrap();
    let listener = b.open_listener(&narrow, &context).unwrap();
    assert!(wait_until(&context.wake, TIMEOUT, || publisher.link().peers == Some(1)));
    publisher.publish(&frame(100, 100)).unwrap();
    publisher.publish(&frame(10, 10)).unwrap();
    assert!(matches!(publisher.publish(&frame(1000, 1000)), Err(PublishError::Encode(_))));
    let mut route = Route { publisher, listener, context };
    assert!(route.next().unwrap().payload == frame(10, 10));
    let now = route.context.counters.snapshot();
    assert_eq!((now.received, now.dropped_for(DropReason::Oversize)), (2, 1));
    assert!(now.received_bytes > 30_000);
}

#[test]
fn under_block_messages_wait_for_room() {
    let (a, b) = pair();
    let mut spec = TopicSpec::new("/blocked", MessageType::StringJson);
    spec.queue = QueueSpec { depth: 5, overflow: Overflow::Block(TIMEOUT) };
    let mut route = connect(&a, &b, &spec);
    for n in 0..10 {
        route.publisher.publish(&number(n)).unwrap();
    }
    for n in 0..10 {
        assert_eq!(route.next().unwrap().payload, number(n));
    }
    assert_eq!(route.context.counters.snapshot().dropped(), 0);
}

#[test]
fn a_discarded_message_makes_room_and_counts_as_received_only() {
    let (a, b) = pair();
    let mut spec = TopicSpec::new("/unwanted", MessageType::StringJson);
    spec.queue = QueueSpec { depth: 2, overflow: Overflow::Block(TIMEOUT) };
    let mut route = connect(&a, &b, &spec);
    assert!(!route.listener.discard());
    for n in 0..4 {
        route.publisher.publish(&number(n)).unwrap();
    }
    for _ in 0..3 {
        assert!(wait_until(&route.context.wake, TIMEOUT, || route.listener.discard()));
    }
    assert_eq!(route.next().unwrap().payload, number(3));
    assert!(!route.listener.discard());
    let now = route.context.counters.snapshot();
    assert_eq!((now.received, now.dropped()), (4, 0));
}

#[test]
fn a_full_queue_drops_the_oldest_and_counts() {
    let (a, b) = pair();
    let mut spec = TopicSpec::new("/stream", MessageType::StringJson);
    spec.queue = QueueSpec { depth: 3, overflow: Overflow::DropOldest };
    let mut route = connect(&a, &b, &spec);
    for n in 0..20 {
        route.publisher.publish(&number(n)).unwrap();
        // Nothing is taken, but each one has to be here before the next one goes.
        let counters = Arc::clone(&route.context.counters);
        assert!(wait_until(&route.context.wake, TIMEOUT, || {
            counters.snapshot().received == u64::try_from(n).unwrap() + 1
        }));
    }
    for n in 17..20 {
        assert_eq!(route.next().unwrap().payload, number(n));
    }
    assert_eq!(route.context.counters.snapshot().dropped_for(DropReason::QueueFull), 17);
}

#[test]
fn listeners_come_and_go_under_traffic() {
    let (a, b) = pair();
    let spec = TopicSpec::new("/busy", MessageType::StringJson);
    let stop = std::sync::atomic::AtomicBool::new(false);
    let relaxed = std::sync::atomic::Ordering::Relaxed;
    std::thread::scope(|scope| {
        for from in [&a, &b] {
            let (spec, stop) = (&spec, &stop);
            scope.spawn(move || {
                let mut publisher = from.open_publisher(spec, &Context::default()).unwrap();
                while !stop.load(relaxed) {
                    // A listener that goes away in the middle may cost a time-out, nothing else.
                    match publisher.publish(&number(1)) {
                        Ok(_) | Err(PublishError::QueueFull { .. }) => {}
                        Err(error) => panic!("{error}"),
                    }
                }
            });
        }
        // A second node in the publisher's own stack is called on the publisher's thread.
        let graph = CycloneGraph::new(&near_config("third")).unwrap();
        let third = Ros2::new(Arc::new(graph), |name| Ok(name.to_owned()));
        for round in 0..60 {
            let context = Context::default();
            let mut spec = spec.clone();
            if round % 3 == 0 {
                spec.queue.overflow = Overflow::Block(Duration::from_millis(1));
            }
            let mut listener = third.open_listener(&spec, &context).unwrap();
            for _ in 0..round % 4 {
                assert!(wait_until(&context.wake, TIMEOUT, || {
                    listener.take().unwrap().is_some()
                }));
            }
        }
        stop.store(true, relaxed);
    });
}

#[test]
fn images_have_the_form_of_the_topic() {
    let (a, b) = pair();
    let files = TopicSpec::new("/files", MessageType::CompressedImage);
    let raws = TopicSpec::new("/raws", MessageType::Image);
    let file = files.conversion().convert(frame(64, 48), Stamp::now).unwrap();
    for (spec, payload, other) in [(files, &file, &frame(64, 48)), (raws, &frame(64, 48), &file)] {
        let mut topic = connect(&a, &b, &spec);
        topic.publisher.publish(payload).unwrap();
        assert_eq!(topic.next().unwrap().payload, *payload);
        for wrong in [other, &number(1)] {
            let error = topic.publisher.publish(wrong).unwrap_err();
            assert_eq!(error.drop_reason(), DropReason::Unencodable);
        }
    }
}
