//! What a port refused before it became a message, in the words of our counters.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use crate::endpoint::{Counters, DropReason};

/// Faults of peers that cost a message each.
const REASONS: [(&str, DropReason); 7] = [
    ("message_too_large", DropReason::Oversize),
    ("line_too_long", DropReason::Oversize),
    ("bad_payload", DropReason::Malformed),
    ("negative_length", DropReason::Malformed),
    ("truncated", DropReason::Malformed),
    ("bad_datagram", DropReason::Malformed),
    ("lost_datagram", DropReason::LostUpstream),
];

/// How much of it is counted already.
#[derive(Debug, Default)]
pub(super) struct Losses(Mutex<BTreeMap<&'static str, u64>>);

impl Losses {
    /// Counts what is new.
    pub(super) fn count(&self, port: &wrapyfi_yarp::port::Counters, counters: &Counters) {
        let mut counted = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        for (fault, reason) in REASONS {
            let (now, known) = (port.get(fault), counted.entry(fault).or_default());
            for _ in *known..now {
                // What was lost before it came here was not received either.
                if reason != DropReason::LostUpstream {
                    counters.received(0);
                }
                counters.dropped(reason);
            }
            *known = now;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_loss_is_counted_once() {
        let (port, counters) = (wrapyfi_yarp::port::Counters::default(), Counters::default());
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
