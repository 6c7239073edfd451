//! Quality of service between nodes: fitted to peers, changed under traffic, kept and missed.

use std::sync::Arc;
use std::time::{Duration, Instant};

use wrapyfi_data::types::{MessageType, Payload, Value};
use wrapyfi_endpoint::{
    Absent, AnnouncedQos, Cause, Context, DropReason, Durability, History, Listener, Liveliness,
    Middleware, Publisher, Qos, QosEvent, QosPreset, Reliability, Role, TopicSpec,
};
use wrapyfi_ros2::Ros2;
use wrapyfi_ros2::graph::wait_until;

use crate::common::{TIMEOUT, far, near};

/// Longer than what only might be better has to last.
const LATER: Duration = Duration::from_secs(6);

/// Two nodes with a wire between them.
fn pair() -> (Ros2, Ros2) {
    let as_named = |name: &str| Ok(name.to_owned());
    (Ros2::new(Arc::new(near("near")), as_named), Ros2::new(Arc::new(far("far")), as_named))
}

fn fixed(topic: &str, qos: Qos) -> TopicSpec {
    let mut spec = TopicSpec::new(topic, MessageType::StringJson);
    spec.qos = qos;
    spec.queue.depth = 1000;
    spec
}

fn following(topic: &str) -> TopicSpec {
    TopicSpec { match_peers: true, ..fixed(topic, Qos::default()) }
}

fn best_effort() -> Qos {
    Qos { reliability: Reliability::BestEffort, ..Qos::default() }
}

fn number(n: i64) -> Payload {
    Payload::from(Value::Int(n))
}

/// A listener whose owner does what owners do: look when the bell rings.
struct Hearing {
    listener: Box<dyn Listener>,
    context: Context,
    qos: Option<Qos>,
    changes: usize,
    warnings: Vec<String>,
    heard: Vec<Payload>,
    /// Time by which its clock is ahead.
    ahead: Duration,
}

impl Hearing {
    fn open(node: &Ros2, spec: &TopicSpec) -> Self {
        let context = Context::default();
        let listener = node.open_listener(spec, &context).unwrap();
        Self {
            listener,
            context,
            qos: None,
            changes: 0,
            warnings: vec![],
            heard: vec![],
            ahead: Duration::ZERO,
        }
    }

    fn look(&mut self) {
        let review = self.listener.review(Instant::now() + self.ahead);
        self.qos = review.qos;
        self.changes += usize::from(review.changed.is_some());
        self.warnings.extend(review.warnings);
        self.heard.extend(std::iter::from_fn(|| self.listener.take().unwrap()).map(|s| s.payload));
    }

    fn until(&mut self, what: &str, mut condition: impl FnMut(&Self) -> bool) {
        let wake = self.context.wake.clone();
        let held = wait_until(&wake, TIMEOUT, || {
            self.look();
            condition(self)
        });
        assert!(held, "{what}: {:?} {:?} {:?}", self.qos, self.heard, self.warnings);
    }

    /// As `until`, with a clock that runs: what only might be better has to last.
    fn long_until(&mut self, what: &str, condition: impl Fn(&Self) -> bool) {
        let wake = self.context.wake.clone();
        let held = wait_until(&wake, TIMEOUT, || {
            self.look();
            self.ahead += LATER;
            condition(self)
        });
        assert!(held, "{what}: {:?} {:?} {:?}", self.qos, self.heard, self.warnings);
    }

    fn has(&self, reliability: Reliability, durability: Durability) -> bool {
        self.qos.is_some_and(|qos| (qos.reliability, qos.durability) == (reliability, durability))
    }
}

/// Publishes until it is seen, as a program that does not know its listeners does.
fn matched(
    node: &Ros2,
    spec: &TopicSpec,
    listener: &mut Hearing,
    peers: usize,
) -> Box<dyn Publisher> {
    let publisher = node.open_publisher(spec, &Context::default()).unwrap();
    listener.until("a match", |_| publisher.link().peers == Some(peers));
    publisher
}

#[test]
fn a_listener_hears_publishers_of_either_kind() {
    let (a, b) = pair();
    let mut hearing = Hearing::open(&a, &following("/mixed"));
    hearing.look();
    assert_eq!(hearing.qos, Some(Qos::default()));
    let mut reliable = matched(&b, &fixed("/mixed", Qos::default()), &mut hearing, 1);
    // In the middle of a stream one comes that a reliable subscription does not hear.
    let mut loose = b.open_publisher(&fixed("/mixed", best_effort()), &Context::default()).unwrap();
    let mut sent = 0;
    let mut after = 0;
    hearing.until("best effort in the middle of a stream", |hearing| {
        // One at a time, so that no depth overflows.
        if hearing.heard.len() == sent {
            reliable.publish(&number(i64::try_from(sent).unwrap())).unwrap();
            sent += 1;
            after += usize::from(hearing.has(Reliability::BestEffort, Durability::Volatile));
        }
        after == 100
    });
    hearing.until("all of the stream", |hearing| hearing.heard.len() >= sent);
    let expected: Vec<_> = (0..i64::try_from(sent).unwrap()).map(number).collect();
    hearing.until("the second publisher", |_| loose.link().peers == Some(1));
    assert_eq!(hearing.heard, expected);
    hearing.heard.clear();
    loose.publish(&number(-1)).unwrap();
    hearing.until("the second publisher's message", |hearing| hearing.heard == [number(-1)]);
    assert_eq!(hearing.changes, 1);
    let now = hearing.context.counters.snapshot();
    assert_eq!(now.qos_events_of(QosEvent::Changed), 1);
    assert_eq!(now.dropped(), now.dropped_for(DropReason::Duplicate));

    // When it has gone for good, the subscription is reliable again.
    drop(loose);
    hearing.long_until("reliable again", |hearing| {
        hearing.has(Reliability::Reliable, Durability::Volatile)
    });
    assert_eq!(hearing.changes, 2);
    // With a clock that runs, the old one goes before the publisher knows the new one.
    hearing.until("the first publisher", |hearing| {
        reliable.publish(&number(1000)).unwrap();
        hearing.heard.contains(&number(1000))
    });
}

#[test]
fn a_kept_message_comes_once_however_often_the_listener_is_opened() {
    let (a, b) = pair();
    let latched = fixed("/kept", QosPreset::Latched.into());
    let mut publisher = b.open_publisher(&latched, &Context::default()).unwrap();
    publisher.publish(&number(1)).unwrap();
    // Later than the message, and reopened for it.
    let mut hearing = Hearing::open(&a, &following("/kept"));
    hearing.until("what was kept", |hearing| hearing.heard == [number(1)]);
    assert!(hearing.has(Reliability::Reliable, Durability::TransientLocal));
    for round in 1..=2 {
        let volatile =
            b.open_publisher(&fixed("/kept", Qos::default()), &Context::default()).unwrap();
        hearing
            .until("volatile", |hearing| hearing.has(Reliability::Reliable, Durability::Volatile));
        drop(volatile);
        hearing.long_until("transient local again", |hearing| {
            hearing.has(Reliability::Reliable, Durability::TransientLocal)
        });
        // The replay has come, and was recognised.
        hearing.until("the replay", |hearing| {
            hearing.context.counters.snapshot().dropped_for(DropReason::Duplicate) == round
        });
    }
    publisher.publish(&number(2)).unwrap();
    hearing.until("the next one", |hearing| hearing.heard.len() > 1);
    assert_eq!(hearing.heard, [number(1), number(2)]);
}

#[test]
fn a_publisher_offers_what_a_subscriber_asks_for() {
    let (a, b) = pair();
    let context = Context::default();
    let mut publisher = a.open_publisher(&following("/asked"), &context).unwrap();
    let mut usual = Hearing::open(&b, &fixed("/asked", Qos::default()));
    usual.until("a match", |usual| {
        publisher.link().peers == Some(1) && usual.listener.link().peers == Some(1)
    });
    let strict = Qos {
        durability: Durability::TransientLocal,
        deadline: Some(Duration::from_secs(3600)),
        lease: Some(Duration::from_secs(1800)),
        liveliness: Liveliness::ManualByTopic,
        ..Qos::default()
    };
    let mut asking = Hearing::open(&b, &fixed("/asked", strict));
    let (mut changed, mut sent) = (None, 0);
    asking.until("what comes from then on", |hearing| {
        let review = publisher.review(Instant::now());
        changed = changed.take().or(review.changed);
        usual.look();
        // One at a time, so that no depth overflows.
        if usual.heard.len() == sent {
            publisher.publish(&number(i64::try_from(sent).unwrap())).unwrap();
            sent += 1;
        }
        hearing.heard.len() > 3
    });
    let change = changed.unwrap();
    assert_eq!((change.from, change.to), (Qos::default(), strict));
    assert!(change.why.ends_with(" asks for transient local"), "{}", change.why);
    usual.until("all", |hearing| hearing.heard.len() >= sent);
    let expected: Vec<_> = (0..i64::try_from(sent).unwrap()).map(number).collect();
    assert_eq!(usual.heard, expected);
    assert_eq!(context.counters.snapshot().qos_events_of(QosEvent::Changed), 1);
    assert!(publisher.link().keeps_last);
}

#[test]
fn what_is_asked_for_is_announced() {
    let (a, b) = pair();
    let strict = Qos {
        reliability: Reliability::Reliable,
        durability: Durability::TransientLocal,
        history: History::KeepLast(7),
        deadline: Some(Duration::from_millis(100)),
        lifespan: Some(Duration::from_secs(2)),
        liveliness: Liveliness::ManualByTopic,
        lease: Some(Duration::from_millis(1500)),
    };
    let context = Context::default();
    let _publisher = a.open_publisher(&fixed("/strict", strict), &context).unwrap();
    let _listener = a.open_listener(&fixed("/strict", strict), &context).unwrap();
    let seen = |publisher: bool| {
        let mut all = b.graph().endpoints().unwrap().into_iter();
        all.find(|e| e.is_publisher == publisher && e.topic == "/strict").map(|e| e.qos)
    };
    assert!(wait_until(&context.wake, TIMEOUT, || seen(true).is_some() && seen(false).is_some()));
    let announced = AnnouncedQos { history: seen(true).unwrap().history, ..strict.into() };
    assert_eq!(seen(true), Some(announced));
    // Readers have no lifespan.
    assert_eq!(
        seen(false).map(|qos| AnnouncedQos { history: announced.history, ..qos }),
        Some(AnnouncedQos { lifespan: None, ..announced })
    );
}

#[test]
fn a_message_older_than_its_lifespan_is_not_delivered() {
    let (a, b) = pair();
    let lifespan = Duration::from_millis(300);
    let qos = Qos { lifespan: Some(lifespan), ..QosPreset::Latched.into() };
    let mut publisher = a.open_publisher(&fixed("/short", qos), &Context::default()).unwrap();
    let endless = a.open_publisher(&fixed("/long", QosPreset::Latched.into()), &Context::default());
    let mut endless = endless.unwrap();
    publisher.publish(&number(1)).unwrap();
    endless.publish(&number(1)).unwrap();
    let old = Instant::now() + 2 * lifespan;
    let bell = Context::default().wake;
    assert!(wait_until(&bell, TIMEOUT, || Instant::now() > old));
    let kept = QosPreset::Latched.into();
    let mut long = Hearing::open(&b, &fixed("/long", kept));
    long.until("what is kept for ever", |hearing| hearing.heard == [number(1)]);
    let mut short = Hearing::open(&b, &fixed("/short", kept));
    short.until("a match", |_| publisher.link().peers == Some(1));
    short.until("a new one", |hearing| {
        publisher.publish(&number(2)).unwrap();
        !hearing.heard.is_empty()
    });
    assert!(!short.heard.contains(&number(1)), "{:?}", short.heard);
}

#[test]
fn deadlines_and_liveliness_that_are_missed_are_counted_on_both_sides() {
    let (a, b) = pair();
    let qos = Qos {
        deadline: Some(Duration::from_millis(50)),
        liveliness: Liveliness::ManualByTopic,
        lease: Some(Duration::from_millis(80)),
        ..Qos::default()
    };
    let context = Context::default();
    let mut publisher = a.open_publisher(&fixed("/late", qos), &context).unwrap();
    let mut hearing = Hearing::open(&b, &fixed("/late", qos));
    hearing.until("a match", |_| publisher.link().peers == Some(1));
    publisher.publish(&number(1)).unwrap();
    hearing.until("the message", |hearing| hearing.heard == [number(1)]);
    let count = |context: &Context, event| context.counters.snapshot().qos_events_of(event);
    hearing.until("silence", |hearing| {
        publisher.review(Instant::now());
        count(&hearing.context, QosEvent::DeadlineMissed) > 0
            && count(&hearing.context, QosEvent::PublisherNotAlive) > 0
            && count(&context, QosEvent::OwnDeadlineMissed) > 0
            && count(&context, QosEvent::OwnLivelinessLost) > 0
    });
    assert_eq!(hearing.context.counters.snapshot().dropped(), 0);
    // Publishing is what says that it is alive.
    publisher.publish(&number(2)).unwrap();
    hearing.until("the next message", |hearing| hearing.heard.len() == 2);
}

#[test]
fn who_does_not_fit_is_named_with_both_values() {
    let (a, b) = pair();
    let mut hearing = Hearing::open(&a, &fixed("/strict", Qos::default()));
    let _loose = b.open_publisher(&fixed("/strict", best_effort()), &Context::default()).unwrap();
    hearing.until("a complaint", |hearing| !hearing.warnings.is_empty());
    assert_eq!(
        hearing.warnings,
        ["publisher on /strict does not match: /robot/far offers best effort, the route asks for \
          reliable; write qos: match on the route, or make the publisher reliable"]
    );
    let waits = hearing.listener.link().waiting_for.unwrap();
    let [peer, theirs, ours] = ["/robot/far", "best effort", "reliable"].map(str::to_owned);
    let absent = Absent::new(Role::Publisher, "a publisher of", "ros2", "/strict");
    assert_eq!(waits, Cause::Qos { absent, peer, theirs, ours });
    let context = Context::default();
    let mut slow = a.open_publisher(&fixed("/slow", Qos::default()), &context).unwrap();
    let hasty = Qos { deadline: Some(Duration::from_millis(10)), ..Qos::default() };
    let _asks = b.open_listener(&fixed("/slow", hasty), &Context::default()).unwrap();
    let mut warnings = Vec::new();
    assert!(wait_until(&context.wake, TIMEOUT, || {
        warnings.extend(slow.review(Instant::now()).warnings);
        !warnings.is_empty()
    }));
    assert_eq!(
        warnings,
        [
            "subscriber on /slow does not match: /robot/far asks for deadline 10ms, the route offers \
          no deadline; write qos: match on the route, or take the deadline from the subscriber"
        ]
    );
    // Once is enough.
    hearing.ahead = LATER;
    hearing.look();
    assert_eq!(
        (hearing.warnings.len(), slow.review(Instant::now() + LATER).warnings.len()),
        (1, 0)
    );
}

#[test]
fn of_many_who_do_not_fit_a_few_are_named() {
    let (a, b) = pair();
    let spec = fixed("/crowd", best_effort());
    let open = || b.open_publisher(&spec, &Context::default()).unwrap();
    let _crowd: Vec<_> = (0..20).map(|_| open()).collect();
    let first = Context::default();
    let bell = first.wake.clone();
    let seen = || {
        let all = a.graph().endpoints().unwrap().into_iter();
        all.filter(|e| e.is_publisher && e.topic == "/crowd").count()
    };
    assert!(wait_until(&bell, TIMEOUT, || seen() == 20));
    let mut hearing = Hearing::open(&a, &fixed("/crowd", Qos::default()));
    hearing.until("complaints", |hearing| !hearing.warnings.is_empty());
    // One that comes later is told of with the others that came while it was quiet.
    let _late = open();
    assert!(wait_until(&bell, TIMEOUT, || seen() == 21));
    hearing.long_until("the rest", |hearing| {
        let more: usize = hearing
            .warnings
            .iter()
            .filter_map(|text| text.strip_suffix(" more publishers on /crowd do not match"))
            .map(|count| count.parse::<usize>().unwrap())
            .sum();
        let named = hearing.warnings.iter().filter(|text| text.contains("/robot/far offers"));
        named.count() + more == 21
    });
    assert!(hearing.warnings.len() < 21, "{:?}", hearing.warnings);
}
