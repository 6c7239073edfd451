//! The calls of one client: what waits for a server, what waits for its reply, what took too long.
//!
//! ```text
//!   begin ─▶ waiting (no server yet) ── next_to_send, sent ─▶ sent ── reply ─▶ answered
//!               └────────────── expire ──────────────┴──▶ timed out; its reply is late
//! ```
//!
//! No clock and no socket: times are given.

use std::collections::{HashMap, VecDeque};
use std::time::{Duration, Instant};

/// Names a call of one client.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Ticket(u64);

/// How far a call had come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stage {
    /// No server was there for it.
    Waiting,
    /// It was sent.
    Sent,
}

/// When a time that begins now is over. One that no clock reaches is as good as none: its end is
/// decades away.
pub(crate) fn ends(now: Instant, after: Duration) -> Instant {
    now.checked_add(after).unwrap_or(now + Duration::from_secs(1 << 30))
}

/// A call that took too long.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Expired {
    pub(crate) ticket: Ticket,
    pub(crate) stage: Stage,
    /// Time it was given.
    pub(crate) timeout: Duration,
}

#[derive(Debug)]
struct Call<T> {
    ticket: Ticket,
    deadline: Instant,
    timeout: Duration,
    /// The request, until it is sent.
    request: T,
}

/// The calls under way. `T` is a serialised request.
#[derive(Debug)]
pub(crate) struct Calls<T> {
    limit: usize,
    next: u64,
    waiting: VecDeque<Call<T>>,
    sent: HashMap<i64, Call<()>>,
    late: u64,
}

impl<T> Calls<T> {
    /// None, and never more than `limit`.
    pub(crate) fn new(limit: usize) -> Self {
        Self { limit, next: 0, waiting: VecDeque::new(), sent: HashMap::new(), late: 0 }
    }

    /// Calls under way.
    pub(crate) fn len(&self) -> usize {
        self.waiting.len() + self.sent.len()
    }

    /// A new call, or `None` where there are too many already.
    pub(crate) fn begin(&mut self, request: T, now: Instant, timeout: Duration) -> Option<Ticket> {
        if self.len() >= self.limit {
            return None;
        }
        let ticket = Ticket(self.next);
        self.next += 1;
        let deadline = ends(now, timeout);
        self.waiting.push_back(Call { ticket, deadline, timeout, request });
        Some(ticket)
    }

    /// The request that is to go next, once a server is there.
    pub(crate) fn next_to_send(&self) -> Option<&T> {
        self.waiting.front().map(|call| &call.request)
    }

    /// That request goes out under this number; it is handed over.
    pub(crate) fn sent(&mut self, sequence: i64) -> Option<T> {
        let Call { ticket, deadline, timeout, request } = self.waiting.pop_front()?;
        self.sent.insert(sequence, Call { ticket, deadline, timeout, request: () });
        Some(request)
    }

    /// That request can never go out.
    #[cfg_attr(not(feature = "ros2"), allow(dead_code))]
    pub(crate) fn refused(&mut self) -> Option<Ticket> {
        self.waiting.pop_front().map(|call| call.ticket)
    }

    /// The call that a reply is for; `None`, counted, where nobody waits for it any more.
    pub(crate) fn reply(&mut self, sequence: i64) -> Option<Ticket> {
        let call = self.sent.remove(&sequence);
        if call.is_none() {
            self.late += 1;
        }
        call.map(|call| call.ticket)
    }

    /// Takes one call whose time is over.
    pub(crate) fn expire(&mut self, now: Instant) -> Option<Expired> {
        let over = |deadline: Instant| deadline <= now;
        if let Some(at) = self.waiting.iter().position(|call| over(call.deadline)) {
            let call = self.waiting.remove(at)?;
            let Call { ticket, timeout, .. } = call;
            return Some(Expired { ticket, stage: Stage::Waiting, timeout });
        }
        let sequence = self
            .sent
            .iter()
            .find(|(_, call)| over(call.deadline))
            .map(|(&sequence, _)| sequence)?;
        let Call { ticket, timeout, .. } = self.sent.remove(&sequence)?;
        Some(Expired { ticket, stage: Stage::Sent, timeout })
    }

    /// Forgets a call; its reply will be late. False where there is no such call.
    pub(crate) fn forget(&mut self, ticket: Ticket) -> bool {
        let before = self.len();
        self.waiting.retain(|call| call.ticket != ticket);
        self.sent.retain(|_, call| call.ticket != ticket);
        self.len() < before
    }

    /// When the next call will have taken too long.
    pub(crate) fn deadline(&self) -> Option<Instant> {
        let waiting = self.waiting.iter().map(|call| call.deadline);
        waiting.chain(self.sent.values().map(|call| call.deadline)).min()
    }

    #[cfg_attr(not(feature = "ros2"), allow(dead_code))]
    /// Replies that came when nobody waited for them any more, so far.
    pub(crate) fn late(&self) -> u64 {
        self.late
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    #[test]
    fn calls_wait_go_out_in_order_and_are_answered_in_any() {
        let now = Instant::now();
        let mut calls = Calls::new(3);
        let [a, b, c] = ["a", "b", "c"].map(|text| calls.begin(text, now, SECOND).unwrap());
        assert_eq!(calls.begin("d", now, SECOND), None);
        for (sequence, text) in [(7, "a"), (8, "b"), (9, "c")] {
            assert_eq!(calls.next_to_send(), Some(&text));
            assert_eq!(calls.sent(sequence), Some(text));
        }
        assert_eq!(calls.next_to_send(), None);
        assert_eq!([9, 7, 8].map(|sequence| calls.reply(sequence)), [Some(c), Some(a), Some(b)]);
        assert_eq!((calls.len(), calls.late()), (0, 0));
        assert_eq!(calls.deadline(), None);
    }

    #[test]
    fn late_replies_are_dropped_and_counted() {
        let now = Instant::now();
        let mut calls = Calls::new(8);
        let slow = calls.begin("slow", now, SECOND).unwrap();
        let lonely = calls.begin("lonely", now, 2 * SECOND).unwrap();
        calls.sent(1);
        assert_eq!(calls.deadline(), Some(now + SECOND));
        assert_eq!(calls.expire(now + SECOND / 2), None);
        let sent = Expired { ticket: slow, stage: Stage::Sent, timeout: SECOND };
        assert_eq!(calls.expire(now + SECOND), Some(sent));
        assert_eq!(calls.expire(now + SECOND), None);
        assert_eq!(calls.reply(1), None);
        let waited = Expired { ticket: lonely, stage: Stage::Waiting, timeout: 2 * SECOND };
        assert_eq!(calls.expire(now + 3 * SECOND), Some(waited));
        assert_eq!(calls.late(), 1);
    }

    #[test]
    fn a_time_that_no_clock_reaches_is_decades() {
        let now = Instant::now();
        assert_eq!(ends(now, SECOND), now + SECOND);
        assert!(ends(now, Duration::MAX) > now + SECOND * (1 << 29));
    }

    proptest! {
        /// Whatever happens, no call is lost, answered twice, or over the limit.
        #[test]
        fn every_call_ends_once(steps in proptest::collection::vec(0_u8..6, 0..200)) {
            let mut now = Instant::now();
            let mut calls = Calls::new(4);
            let (mut begun, mut ended, mut sequence) = (0, 0, 0_i64);
            for step in steps {
                match step {
                    0 | 1 => begun += usize::from(calls.begin((), now, SECOND).is_some()),
                    2 if calls.next_to_send().is_some() => {
                        sequence += 1;
                        calls.sent(sequence);
                    }
                    3 => ended += usize::from(calls.reply(sequence).is_some()),
                    4 => now += SECOND / 3,
                    _ => while calls.expire(now).is_some() { ended += 1 },
                }
                prop_assert!(calls.len() <= 4);
                prop_assert_eq!(begun, ended + calls.len());
            }
        }
    }
}
