//! Endpoints know their peers, and their owner is told of changes.

use crate::ends::ready;
use crate::payloads::{number, text};
use crate::{Sink, Source, TIMEOUT, Testbed, WireEnd, connect};

/// A publisher's link follows its listeners, and each change rings.
pub fn publishers_know_who_listens<R: Testbed>() {
    let testbed = R::start();
    for side in WireEnd::BOTH {
        let spec = text(&format!("/{side:?}"));
        let source = Source::open(testbed.side(side), &spec);
        source.wait_for("nobody", |link| link.peers == Some(0));
        if R::CAPABILITIES.waits_aloud {
            source.wait_for("the reason", |link| link.waiting_for.is_some());
        } else {
            source.wait_for("an open way", |link| link.waiting_for.is_none());
        }
        for _ in 0..3 {
            silence(&source.context.wake);
            let first = Sink::open(testbed.side(side.other()), &spec);
            rings(&source.context.wake, "a listener came");
            source.wait_for_listener();
            if R::CAPABILITIES.publisher_counts_listeners {
                let second = Sink::open(testbed.side(side.other()), &spec);
                source.wait_for("two listeners", |link| link.peers == Some(2));
                drop(second);
                source.wait_for("one listener", |link| link.peers == Some(1));
            }
            silence(&source.context.wake);
            drop(first);
            rings(&source.context.wake, "a listener went");
            source.wait_for_nobody();
            if R::CAPABILITIES.waits_aloud {
                assert!(source.publisher.link().waiting_for.is_some());
            }
        }
    }
}

/// A listener's link follows its publishers, and each change rings.
pub fn listeners_know_who_publishes<R: Testbed>() {
    let testbed = R::start();
    for side in WireEnd::BOTH {
        let spec = text(&format!("/{side:?}"));
        let sink = Sink::open(testbed.side(side), &spec);
        sink.wait_for("nobody", |link| {
            link.peers == Some(0) && link.waiting_for.is_some() == R::CAPABILITIES.waits_aloud
        });
        for _ in 0..3 {
            silence(&sink.context.wake);
            let first = Source::open(testbed.side(side.other()), &spec);
            rings(&sink.context.wake, "a publisher came");
            ready::<R>(&first, &sink);
            if R::CAPABILITIES.several_publishers {
                let second = Source::open(testbed.side(side.other()), &spec);
                if R::CAPABILITIES.listener_counts_publishers {
                    sink.wait_for("two publishers", |link| link.peers == Some(2));
                }
                drop(second);
            }
            sink.wait_for("one publisher", |link| link.peers == Some(1));
            silence(&sink.context.wake);
            drop(first);
            rings(&sink.context.wake, "a publisher went");
            sink.wait_for("nobody", |link| link.peers == Some(0));
        }
    }
}

/// A message that arrives rings, and can be taken then.
pub fn an_arrival_rings<R: Testbed>() {
    let testbed = R::start();
    for from in WireEnd::BOTH {
        let (mut source, mut sink) = connect(&testbed, from, &text(&format!("/{from:?}")));
        if !R::CAPABILITIES.listener_knows_peers {
            assert_eq!(sink.listener.link().peers, None, "unknown is not zero");
        }
        for n in 0..20 {
            silence(&sink.context.wake);
            source.send(&number(n));
            // Rings for other reasons are allowed, missing ones are not.
            while sink.listener.link().waiting_for.is_none() {
                rings(&sink.context.wake, "a message came");
                if let Some(message) = sink.take() {
                    assert_eq!(message, number(n));
                    break;
                }
            }
        }
    }
}

/// Answers the rings so far.
fn silence(wake: &wrapyfi_endpoint::Wake) {
    while wake.wait(std::time::Duration::ZERO) {}
}

#[track_caller]
fn rings(wake: &wrapyfi_endpoint::Wake, why: &str) {
    assert!(wake.wait(TIMEOUT), "nobody rang: {why}");
}
