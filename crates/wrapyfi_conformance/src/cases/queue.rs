//! A consumer that is slower than the source: every policy, and counters that add up.

use std::time::Duration;

use wrapyfi_endpoint::{DropReason, Overflow, QueueSpec, TopicSpec};

use crate::payloads::{number, numbers, text};
use crate::{TIMEOUT, Testbed, WireEnd, connect, wait_until};

const DEPTH: usize = 4;
const SENT: u64 = 20;

fn queued(overflow: Overflow) -> TopicSpec {
    TopicSpec { queue: QueueSpec { depth: DEPTH, overflow }, ..text("/slow") }
}

/// Sends while the listener takes nothing; what is taken afterwards.
#[track_caller]
fn overflow<R: Testbed>(policy: Overflow, kept: std::ops::Range<u64>) {
    let testbed = R::start();
    for from in WireEnd::BOTH {
        let mut spec = queued(policy);
        spec.topic = format!("/{from:?}");
        let (mut source, mut sink) = connect(&testbed, from, &spec);
        source.send_all(&numbers(0..SENT), &sink);
        wait_until(&sink.context.wake, "the drops to be counted", || {
            sink.counters().dropped_for(DropReason::QueueFull) == SENT - DEPTH as u64
        });
        assert_eq!(sink.drain(), numbers(kept.clone()));
        let now = sink.counters();
        assert_eq!(now.received, sink.taken + now.dropped(), "{now:?}");
        // The queue works on.
        source.send(&number(99));
        assert_eq!(sink.receive(), number(99));
    }
}

/// [`Overflow::DropOldest`].
pub fn drop_oldest_keeps_the_newest<R: Testbed>() {
    overflow::<R>(Overflow::DropOldest, SENT - DEPTH as u64..SENT);
}

/// [`Overflow::DropNewest`].
pub fn drop_newest_keeps_the_oldest<R: Testbed>() {
    overflow::<R>(Overflow::DropNewest, 0..DEPTH as u64);
}

/// [`Overflow::Block`] with a reader that comes back: twice what the queue holds is not lost.
pub fn block_waits_for_the_reader<R: Testbed>() {
    let testbed = R::start();
    let (mut source, mut sink) =
        connect(&testbed, WireEnd::Near, &queued(Overflow::Block(TIMEOUT)));
    let sent = numbers(0..2 * DEPTH as u64);
    for message in &sent {
        source.send(message);
    }
    wait_until(&sink.context.wake, "a full queue", || sink.counters().received >= DEPTH as u64);
    assert_eq!(sink.receive_many(sent.len()), sent);
    let now = sink.counters();
    assert_eq!((now.received, now.dropped()), (sent.len() as u64, 0), "{now:?}");
}

/// [`Overflow::Block`] with a reader that does not: what is lost is counted, and the queue works on.
pub fn block_gives_up_at_its_deadline<R: Testbed>() {
    let testbed = R::start();
    let policy = Overflow::Block(Duration::from_millis(20));
    let (mut source, mut sink) = connect(&testbed, WireEnd::Near, &queued(policy));
    source.send_all(&numbers(0..SENT), &sink);
    let taken = sink.settle();
    assert!(taken.len() >= DEPTH, "{taken:?}");
    assert_eq!(taken[..DEPTH], numbers(0..DEPTH as u64));
    let now = sink.counters();
    assert_eq!(now.dropped(), now.dropped_for(DropReason::BlockDeadline), "{now:?}");
    source.send(&number(99));
    assert_eq!(sink.receive(), number(99));
}

/// `discard` passes over exactly one message and says whether there was one.
pub fn discarding_takes_one_message<R: Testbed>() {
    let testbed = R::start();
    let (mut source, mut sink) = connect(&testbed, WireEnd::Near, &text("/discarded"));
    assert!(!sink.listener.discard(), "nothing waits yet");
    source.send_all(&numbers(0..3), &sink);
    assert!(sink.listener.discard());
    assert_eq!(sink.receive(), number(1));
    assert!(sink.listener.discard());
    assert!(!sink.listener.discard());
    assert_eq!(sink.take(), None);
    assert_eq!((sink.counters().received, sink.counters().dropped()), (3, 0));
    source.send(&number(3));
    assert_eq!(sink.receive(), number(3));
}
