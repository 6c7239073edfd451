//! Peers that end, come back, or go away in the middle.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Instant;

use wrapyfi_data::Limits;
use wrapyfi_endpoint::{Overflow, PublishError, Wake};

use crate::alone::{run_alone, threads};
use crate::ends::ready;
use crate::payloads::{number, numbers, text};
use crate::{Sink, Source, Testbed, WireEnd, connect, wait_until};

/// Everything that is sent after a restart arrives exactly once.
#[track_caller]
fn flows_once(source: &mut Source, sink: &mut Sink, first: u64) {
    sink.drain();
    let sent = numbers(first..first + 10);
    source.send_all(&sent, sink);
    assert_eq!(sink.receive_many(10), sent);
    assert_eq!(sink.drain(), [], "a second copy");
}

/// The publisher's side ends and starts again, three times over.
pub fn a_publisher_that_restarts_flows_again<R: Testbed>() {
    for from in WireEnd::BOTH {
        let mut testbed = R::start();
        let spec = text("/restart");
        let (mut source, mut sink) = connect(&testbed, from, &spec);
        for round in 1..=3 {
            flows_once(&mut source, &mut sink, round * 100);
            drop(source);
            testbed.restart(from);
            source = Source::open(testbed.side(from), &spec);
            ready::<R>(&source, &sink);
        }
        flows_once(&mut source, &mut sink, 400);
    }
}

/// The listener's side ends and starts again, three times over.
pub fn a_listener_that_restarts_flows_again<R: Testbed>() {
    for from in WireEnd::BOTH {
        let mut testbed = R::start();
        let spec = text("/restart");
        let (mut source, mut sink) = connect(&testbed, from, &spec);
        for round in 1..=3 {
            flows_once(&mut source, &mut sink, round * 100);
            drop(sink);
            source.wait_for_nobody();
            testbed.restart(from.other());
            sink = Sink::open(testbed.side(from.other()), &spec);
            ready::<R>(&source, &sink);
        }
        flows_once(&mut source, &mut sink, 400);
    }
}

/// Listeners and publishers come and go while messages arrive; who stays notices nothing.
pub fn endpoints_may_close_under_traffic<R: Testbed>() {
    let testbed = R::start();
    let spec = text("/busy");
    let stop = AtomicBool::new(false);
    let (mut source, mut steady) = connect(&testbed, WireEnd::Near, &spec);
    std::thread::scope(|scope| {
        let stop = &stop;
        scope.spawn(move || {
            let mut n = 0;
            while !stop.load(Relaxed) {
                n += 1;
                match source.publisher.publish(&number(n)) {
                    // A listener that goes away in the middle may cost a time-out.
                    Ok(_) | Err(PublishError::QueueFull { .. }) => {}
                    Err(error) => panic!("{error}"),
                }
            }
        });
        for round in 0..30 {
            let mut passing = spec.clone();
            if round % 3 == 0 {
                passing.queue.overflow = Overflow::Block(std::time::Duration::from_millis(1));
            }
            let mut sink = Sink::open(testbed.side(WireEnd::Far), &passing);
            let other = Source::open(testbed.side(WireEnd::Far), &spec);
            for _ in 0..round % 4 {
                sink.receive();
            }
            drop((sink, other));
            steady.receive();
        }
        stop.store(true, Relaxed);
    });
    steady.settle();
}

/// Dropping a middleware with open endpoints takes no longer than a process has to end, and none
/// of its threads survives.
pub fn shutdown_is_quick_and_leaves_no_thread<R: Testbed>() {
    run_alone(|| {
        let before = threads();
        let testbed = R::start();
        let routes =
            WireEnd::BOTH.map(|from| connect(&testbed, from, &text(&format!("/{from:?}"))));
        let start = Instant::now();
        drop(routes);
        drop(testbed);
        // Both sides, one after the other.
        assert!(start.elapsed() < 2 * Limits::SHUTDOWN, "took {:?}", start.elapsed());
        wait_until(Wake::new(), "threads to end", || {
            let left: Vec<_> =
                threads().into_iter().filter(|(id, _)| !before.contains_key(id)).collect();
            left.is_empty()
        });
    });
}
