//! Messages that YARP's ports lose, counted under the project's own reasons: those refused before
//! they were whole, and those written that do not reach a reader.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use wrapyfi_yarp::port::{Fate, Loss, Message, PayloadKind, Port, PortPayload, Room, Written};
use wrapyfi_yarp::sig::Stamp;

use wrapyfi_endpoint::{Counters, DropReason, Mutex, Share};

/// Faults of peers that cost a message each.
const REASONS: [(&str, DropReason); 10] = [
    ("message_too_large", DropReason::Oversize),
    ("line_too_long", DropReason::Oversize),
    ("bad_payload", DropReason::Malformed),
    ("negative_length", DropReason::Malformed),
    ("truncated", DropReason::Malformed),
    ("no_progress", DropReason::Malformed),
    ("over_budget", DropReason::OverBudget),
    ("bad_datagram", DropReason::Malformed),
    ("lost_datagram", DropReason::LostUpstream),
    ("not_admitted", DropReason::RefusedPeer),
];

/// Numbers of faults of a port that are counted already, by fault.
#[derive(Debug, Default)]
pub(super) struct Losses(Mutex<BTreeMap<&'static str, u64>>);

impl Losses {
    /// Counts the faults that the port has noticed since the last call.
    pub(super) fn count(&self, port: &wrapyfi_yarp::port::FaultCounts, counters: &Counters) {
        let mut counted = self.0.lock();
        for (fault, reason) in REASONS {
            let (now, known) = (port.get(fault), counted.entry(fault).or_default());
            for _ in *known..now {
                // A message that was lost before it came here was not received either.
                if reason != DropReason::LostUpstream {
                    counters.received(0);
                }
                counters.dropped(reason);
            }
            *known = now;
        }
    }
}

/// A message that is written: what readers miss of it is counted once, however many miss it.
#[derive(Debug)]
pub(super) struct Sent {
    counters: Arc<Counters>,
    bytes: usize,
    missed: AtomicBool,
}

impl Sent {
    pub(super) fn new(counters: &Arc<Counters>, bytes: usize) -> Arc<Self> {
        Arc::new(Self { counters: Arc::clone(counters), bytes, missed: AtomicBool::new(false) })
    }

    /// Counts that a reader does not get it.
    pub(super) fn missed(&self, reason: DropReason) {
        if !self.missed.swap(true, Relaxed) {
            self.counters.undelivered(reason, self.bytes);
        }
    }

    /// Writes it to the readers of `port`: files to those of carrier mjpeg, objects to all others.
    pub(super) fn write(
        self: &Arc<Self>,
        port: &Port,
        payload: PortPayload,
        stamp: Option<Stamp>,
        written: &mut Written,
    ) {
        let is_file = payload.kind == PayloadKind::Raw;
        let fate: Arc<dyn Fate> = self.clone();
        let mut message = Message { fate: Some(fate), ..Message::new(payload) };
        if let Some(stamp) = stamp {
            message = message.stamped(stamp);
        }
        let more = if is_file { port.write_picture(message) } else { port.write_object(message) };
        written.targets += more.targets;
        written.dropped += more.dropped;
        written.over_budget += more.over_budget;
    }

    /// Counts what had no place in a reader's queue.
    pub(super) fn queued(&self, written: Written) {
        match written {
            Written { dropped: 0, .. } => {}
            Written { over_budget: 0, .. } => self.missed(DropReason::SendQueueFull),
            _ => self.missed(DropReason::OverBudget),
        }
    }

    /// The publisher's owner counts it: no other code does any more.
    pub(super) fn refused(&self) {
        self.missed.store(true, Relaxed);
    }
}

impl Fate for Sent {
    fn lost(&self, how: Loss) {
        self.missed(match how {
            Loss::Full => DropReason::SendQueueFull,
            Loss::Connection => DropReason::ConnectionLost,
            Loss::Closed => DropReason::Closed,
            Loss::Unsendable => DropReason::Unencodable,
        });
    }
}

/// Bytes that the queue of one output may hold of the process's budget.
#[derive(Debug)]
pub(super) struct OutputRoom(pub(super) Share);

impl Room for OutputRoom {
    fn take(&self, bytes: usize) -> bool {
        self.0.take(bytes)
    }

    fn give(&self, bytes: usize) {
        self.0.give(bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_that_two_readers_miss_is_lost_once() {
        let counters = Arc::new(Counters::default());
        let sent = Sent::new(&counters, 10);
        counters.sent(10, std::time::Duration::ZERO);
        sent.lost(Loss::Connection);
        sent.queued(Written { targets: 2, dropped: 1, over_budget: 0 });
        let now = counters.snapshot();
        assert_eq!((now.sent, now.dropped_for(DropReason::ConnectionLost)), (0, 1));
        assert_eq!(now.dropped(), 1);
        let sent = Sent::new(&counters, 10);
        sent.refused();
        sent.lost(Loss::Closed);
        assert_eq!(counters.snapshot().dropped(), 1);
    }

    #[test]
    fn each_loss_is_counted_once() {
        let (port, counters) = (wrapyfi_yarp::port::FaultCounts::default(), Counters::default());
        let losses = Losses::default();
        for rounds in 1..=3 {
            port.add("message_too_large");
            port.add("lost_datagram");
            port.add("replaced");
            losses.count(&port, &counters);
            losses.count(&port, &counters);
            let now = counters.snapshot();
            assert_eq!(now.dropped_for(DropReason::Oversize), rounds);
            assert_eq!(now.dropped_for(DropReason::LostUpstream), rounds);
            assert_eq!((now.received, now.dropped()), (rounds, 2 * rounds));
        }
    }
}
