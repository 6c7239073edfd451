//! Recipients of messages, and the order in which they get them.

use wrapyfi_endpoint::QosPreset;

use crate::ends::ready;
use crate::payloads::{number, numbers, text};
use crate::{Sink, Source, Testbed, WireEnd, connect, wait_until};

/// Two hundred messages arrive once each, in the order in which they were sent.
pub fn order_is_kept<R: Testbed>() {
    let testbed = R::start();
    for from in WireEnd::BOTH {
        let mut spec = text(&format!("/{from:?}"));
        spec.queue.depth = 256;
        let (mut source, mut sink) = connect(&testbed, from, &spec);
        let sent = numbers(0..200);
        source.send_all(&sent, &sink);
        assert_eq!(sink.receive_many(200), sent);
        assert_eq!(sink.drain(), []);
        assert_eq!((sink.counters().received, sink.counters().dropped()), (200, 0));
    }
}

/// Opening order does not matter, and opening never waits for a peer.
pub fn either_end_may_come_first<R: Testbed>() {
    let testbed = R::start();
    for from in WireEnd::BOTH {
        let spec = text(&format!("/listener_first_{from:?}"));
        let mut sink = Sink::open(testbed.side(from.other()), &spec);
        assert_eq!(sink.take(), None);
        let mut source = Source::open(testbed.side(from), &spec);
        ready::<R>(&source, &sink);
        source.send(&number(1));
        assert_eq!(sink.receive(), number(1));

        let spec = text(&format!("/publisher_first_{from:?}"));
        let mut source = Source::open(testbed.side(from), &spec);
        let mut sink = Sink::open(testbed.side(from.other()), &spec);
        ready::<R>(&source, &sink);
        source.send(&number(2));
        assert_eq!(sink.receive(), number(2));
    }
}

/// Two listeners of one side and one of the other: each gets every message once.
pub fn every_listener_gets_its_copy<R: Testbed>() {
    let testbed = R::start();
    let spec = text("/shared");
    let (mut source, sink) = connect(&testbed, WireEnd::Near, &spec);
    let mut sinks = vec![sink, Sink::open(testbed.side(WireEnd::Far), &spec)];
    // Not all transports can say that the second one is known: it is when something arrives.
    let mut n = 0;
    wait_until(sinks[1].context.wake.clone(), "the second listener", || {
        n += 1;
        source.send(&number(n));
        sinks[1].take().is_some()
    });
    let first = n + 1;
    source.send_all(&numbers(first..first + 5), &sinks[0]);
    for sink in &mut sinks {
        let mut heard = Vec::new();
        wait_until(sink.context.wake.clone(), "all copies", || {
            heard.extend(sink.drain());
            heard.last() == Some(&number(first + 4))
        });
        let new = heard.iter().position(|message| *message == number(first)).unwrap();
        assert_eq!(heard[new..], numbers(first..first + 5));
    }
}

/// A volatile topic: who comes late hears what is sent from then on, and nothing older.
pub fn late_listeners_hear_what_is_new<R: Testbed>() {
    let testbed = R::start();
    let spec = text("/volatile");
    let mut source = Source::open(testbed.side(WireEnd::Near), &spec);
    assert!(!source.publisher.link().keeps_last);
    source
        .wait_for("an open way", |link| R::CAPABILITIES.waits_aloud || link.waiting_for.is_none());
    for n in 0..3 {
        source.send(&number(n));
    }
    let mut first = Sink::open(testbed.side(WireEnd::Far), &spec);
    ready::<R>(&source, &first);
    source.send(&number(3));
    assert_eq!(first.receive(), number(3));
    drop(first);
    source.wait_for_nobody();
    source.send(&number(4));
    let mut second = Sink::open(testbed.side(WireEnd::Far), &spec);
    ready::<R>(&source, &second);
    source.send(&number(5));
    assert_eq!(second.receive(), number(5));
    assert_eq!(second.counters().received, 1);
}

/// Transient local: who comes late gets the last message once, then what is sent.
pub fn the_kept_message_is_replayed_once<R: Testbed>() {
    let testbed = R::start();
    let mut spec = text("/latched");
    spec.qos = QosPreset::Latched.into();
    let mut source = Source::open(testbed.side(WireEnd::Near), &spec);
    assert!(source.publisher.link().keeps_last);
    source.send(&number(1));
    source.send(&number(2));
    let mut first = Sink::open(testbed.side(WireEnd::Far), &spec);
    assert_eq!(first.receive(), number(2));
    source.send(&number(3));
    assert_eq!(first.receive(), number(3));
    let mut second = Sink::open(testbed.side(WireEnd::Far), &spec);
    assert_eq!(second.receive(), number(3));
    source.send(&number(4));
    assert_eq!((first.receive(), second.receive()), (number(4), number(4)));
    assert_eq!((first.counters().received, second.counters().received), (3, 2));
}

/// Twenty topics at once, with names that begin alike, in both directions.
pub fn topics_do_not_disturb_each_other<R: Testbed>() {
    const TOPICS: u64 = 20;
    const ROUNDS: u64 = 20;
    let testbed = R::start();
    let mut routes: Vec<_> = (1..=TOPICS)
        .map(|topic| {
            let mut spec = text(&format!("/t{topic}"));
            spec.queue.depth = 64;
            connect(&testbed, WireEnd::BOTH[usize::from(topic % 2 == 0)], &spec)
        })
        .collect();
    // A publisher may take a listener of `/t1` for one of `/t10`: so each route is tried first.
    let trial = |topic: usize| number(1000 * topic as u64 + 999);
    for (topic, (source, sink)) in routes.iter_mut().enumerate() {
        wait_until(sink.context.wake.clone(), "the first message of a topic", || {
            source.send(&trial(topic));
            sink.take().is_some()
        });
    }
    let mut heard = vec![Vec::new(); routes.len()];
    for round in 0..ROUNDS {
        for (topic, (source, _)) in routes.iter_mut().enumerate() {
            source.send(&number(1000 * topic as u64 + round));
        }
        for (topic, (_, sink)) in routes.iter_mut().enumerate() {
            wait_until(sink.context.wake.clone(), "the round to arrive", || {
                heard[topic].extend(sink.drain());
                heard[topic].last() == Some(&number(1000 * topic as u64 + round))
            });
        }
    }
    for (topic, (_, sink)) in routes.iter_mut().enumerate() {
        heard[topic].extend(sink.drain());
        heard[topic].retain(|message| *message != trial(topic));
        let first = 1000 * topic as u64;
        assert_eq!(heard[topic], numbers(first..first + ROUNDS), "topic {topic}");
    }
}

/// A side does not hear itself, and still hears the other side say the same.
pub fn own_publications_are_not_received<R: Testbed>() {
    let testbed = R::start();
    let spec = text("/echo");
    let mut own = Sink::open(testbed.side(WireEnd::Near), &spec);
    let (mut near, mut witness) = connect(&testbed, WireEnd::Near, &spec);
    let mut far = Source::open(testbed.side(WireEnd::Far), &spec);
    ready::<R>(&far, &own);
    for n in 1..=3 {
        wait_until(witness.context.wake.clone(), "the near side to be heard", || {
            near.send(&number(n));
            witness.drain().contains(&number(n))
        });
        far.send(&number(n));
        assert_eq!(own.receive(), number(n), "from the other side");
    }
    assert_eq!(own.drain(), []);
}
