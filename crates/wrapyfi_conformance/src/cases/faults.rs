//! Messages and names that must not pass, and must not stop what comes after them.

use wrapyfi_data::types::{Encoding, MessageType};
use wrapyfi_endpoint::{Context, DropReason, OpenError, PublishError, TopicSpec};

use crate::ends::{ready, unusable};
use crate::payloads::{frame, number, small, text};
use crate::{Sink, Source, Testbed, TypeCheck, WireEnd, connect, wait_until};

/// Over the listener's limit: counted, and the next one arrives. Over the publisher's: refused.
pub fn what_is_too_large_is_counted_and_passed_over<R: Testbed>() {
    let testbed = R::start();
    let mut wide = TopicSpec::new("/big", MessageType::Image);
    let mut narrow = wide.clone();
    narrow.limits.message_bytes = 40_000;
    wide.limits.message_bytes = 1 << 20;
    let mut source = Source::open(testbed.side(WireEnd::Near), &wide);
    let mut sink = Sink::open(testbed.side(WireEnd::Far), &narrow);
    ready::<R>(&source, &sink);
    for round in 1..=3 {
        source.send(&frame(120, 120, Encoding::Bgr8));
        source.send(&frame(4, round, Encoding::Bgr8));
        assert!(sink.receive() == frame(4, round, Encoding::Bgr8));
        let now = sink.counters();
        let rounds = u64::from(round);
        assert_eq!((now.received, now.dropped_for(DropReason::Oversize)), (2 * rounds, rounds));
    }
    let refused = source.publisher.publish(&frame(1000, 1000, Encoding::Bgr8));
    assert!(matches!(refused, Err(PublishError::Encode(_))), "{refused:?}");
    source.send(&frame(5, 5, Encoding::Bgr8));
    assert!(sink.receive() == frame(5, 5, Encoding::Bgr8));
}

/// Bytes that are no message, for every type: each one counted, and the next message arrives.
pub fn what_is_malformed_is_counted_and_passed_over<R: Testbed>() {
    let bodies: [&[u8]; 6] = [
        b"\xff\xff\xff\xff",
        b"{",
        &[0xff; 64],
        b"\xff\xff\xff\x7f\0\0\0\0",
        &[b'['; 1000],
        b"{\"__wrapyfi__\": [\"numpy.ndarray\", \"k05VTVBZ\"]}",
    ];
    let mut testbed = R::start();
    for message_type in MessageType::TOPICS {
        let spec = TopicSpec::new(format!("/{message_type:?}"), message_type);
        let (mut source, mut sink) = connect(&testbed, WireEnd::Near, &spec);
        for body in bodies {
            testbed.inject(&spec, body);
        }
        let sent = bodies.len() as u64;
        wait_until(sink.context.wake.clone(), "the broken messages", || {
            assert_eq!(sink.drain(), [], "{message_type} out of broken bytes");
            sink.counters().received == sent
        });
        // Messages may have come between the look into the queue and the look at the counter.
        assert_eq!(sink.drain(), [], "{message_type} out of broken bytes");
        let now = sink.counters();
        assert_eq!(unusable(&now), sent, "{message_type}: {now:?}");
        source.send(&small::<R>(message_type));
        assert!(sink.receive() == small::<R>(message_type), "{message_type} after broken ones");
    }
}

/// A publisher of another type: nothing of it is delivered, and it is said or counted.
pub fn other_types_are_never_delivered<R: Testbed>() {
    let testbed = R::start();
    let spec = TopicSpec::new("/contested", MessageType::Image);
    let mut sink = Sink::open(testbed.side(WireEnd::Far), &spec);
    let mut wrong = Source::open(testbed.side(WireEnd::Near), &text("/contested"));
    match R::CAPABILITIES.types {
        TypeCheck::Match => {
            sink.wait_for("the link to name the other type", |link| {
                let told = link.waiting_for.as_ref().map(|cause| [cause.theirs(), cause.ours()]);
                let types = [MessageType::StringJson, MessageType::Image];
                told == Some(types.map(R::type_name))
            });
            assert_eq!(wrong.publisher.link().peers, Some(0));
            wrong.send(&number(1));
        }
        _ => {
            wrong.wait_for_listener();
            wrong.send(&number(1));
            wait_until(sink.context.wake.clone(), "the mismatch to be counted", || {
                assert_eq!(sink.take(), None);
                sink.counters().dropped_for(DropReason::Mismatch) == 1
            });
        }
    }
    if !R::CAPABILITIES.several_publishers {
        drop(wrong);
    }
    let mut right = Source::open(testbed.side(WireEnd::Near), &spec);
    ready::<R>(&right, &sink);
    right.send(&small::<R>(MessageType::Image));
    assert!(sink.receive() == small::<R>(MessageType::Image));
}

/// A payload that the topic's type does not carry is refused at once, as unencodable.
pub fn a_payload_of_another_kind_is_refused<R: Testbed>() {
    let testbed = R::start();
    for message_type in MessageType::TOPICS {
        let spec = TopicSpec::new(format!("/{message_type:?}"), message_type);
        let (mut source, mut sink) = connect(&testbed, WireEnd::Near, &spec);
        for other in MessageType::TOPICS {
            if other.data_type() == message_type.data_type() {
                continue;
            }
            let error = source.publisher.publish(&small::<R>(other)).unwrap_err();
            assert_eq!(error.drop_reason(), DropReason::Unencodable, "{error}");
        }
        source.send(&small::<R>(message_type));
        assert!(sink.receive() == small::<R>(message_type));
        assert_eq!(sink.counters().received, 1);
    }
}

/// Names the middleware cannot carry are refused at once, for good, with a reason.
pub fn names_that_cannot_work_are_refused<R: Testbed>() {
    let testbed = R::start();
    let names = R::invalid_names();
    assert!(!names.is_empty(), "the testbed names none");
    for name in names {
        for side in WireEnd::BOTH {
            let middleware = testbed.side(side);
            for refused in [
                middleware.open_listener(&text(&name), &Context::default()).err(),
                middleware.open_publisher(&text(&name), &Context::default()).err(),
            ] {
                match refused {
                    Some(error @ OpenError::InvalidName { .. }) => assert!(!error.is_transient()),
                    other => panic!("{name:?}: {other:?}"),
                }
            }
        }
    }
}
