//! The calls of one client: those that wait for a server, those that wait for replies, those that
//! ended.
//!
//! ```text
//!   begin ─▶ waiting (no server yet, or no room there) ── send ─▶ sent ── answered, failed ─▶ ended ─▶ take, take_only
//!               └───────────────────── expire ──────────────────────┴──▶ timed out; its reply is late, and counted
//! ```
//!
//! The calls have no socket. A request counts against the budget of bytes that wait until its call has ended.

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use super::{CallError, Clock, Context, DropReason, Reply, Share, Wake};
use wrapyfi_data::types::Payload;

/// Number of a call of one client.
///
/// See [`Client::send`](crate::Client::send), which gives one to each call.
///
/// ```
/// # use std::time::Duration;
/// # use wrapyfi_data::types::{ServiceKind, Value};
/// # use wrapyfi_endpoint::{Context, Middleware, Request, ServiceSpec, memory::Memory};
/// # let (bus, context) = (Memory::new("memory"), Context::default());
/// # let spec = ServiceSpec::new("/double", ServiceKind::NativeObject);
/// # let mut server = bus.open_server(&spec, &context)?;
/// # let mut client = bus.open_client(&spec, &context)?;
/// let slow = client.send(&Request::new(["far".into()]), Duration::from_secs(5))?;
/// let fast = client.send(&Request::new(["near".into()]), Duration::from_secs(5))?;
/// assert!(slow < fast);
/// client.cancel(slow);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Ticket(u64);

impl Ticket {
    /// Number of the call or goal with this count among those of its client.
    pub fn new(count: u64) -> Self {
        Self(count)
    }
}

/// Stage that a call had reached when its time was over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// No server had come to which the request could be sent, or those before it were not answered.
    Waiting,
    /// The request was sent, and no reply came.
    Sent,
}

/// Instant at which a time that begins now is over. A time that no clock reaches ends decades from
/// now, which is as good as never.
pub fn ends(now: Instant, after: Duration) -> Instant {
    now.checked_add(after).unwrap_or(now + Duration::from_secs(1 << 30))
}

#[derive(Debug, Clone, Copy)]
struct Call {
    ticket: Ticket,
    deadline: Instant,
    timeout: Duration,
    /// Size of the request in bytes.
    bytes: usize,
}

/// The calls of one client. `T` is a request as it will be sent.
#[derive(Debug)]
pub struct Calls<T> {
    service: String,
    limit: usize,
    /// Largest number of requests that are with the server at once.
    at_once: usize,
    /// First of the sent requests that count as being with the server.
    counted_from: i64,
    next: u64,
    waiting: VecDeque<(Call, T)>,
    sent: BTreeMap<i64, Call>,
    ended: VecDeque<(Ticket, Result<Reply, CallError>)>,
    share: Share,
    context: Context,
}

impl<T> Calls<T> {
    /// A client without calls, which refuses to have more than `limit` under way.
    pub fn new(service: &str, limit: usize, context: &Context) -> Self {
        Self {
            service: service.to_owned(),
            limit,
            at_once: usize::MAX,
            counted_from: i64::MIN,
            next: 0,
            waiting: VecDeque::new(),
            sent: BTreeMap::new(),
            ended: VecDeque::new(),
            share: Share::default(),
            context: context.clone(),
        }
    }

    /// Sends at most `at_once` requests before one of them is answered; the others wait.
    #[must_use]
    pub fn at_once(self, at_once: usize) -> Self {
        Self { at_once, ..self }
    }

    /// Name of the service, for messages.
    pub fn service(&self) -> &str {
        &self.service
    }

    /// Clock by which the calls end.
    pub fn clock(&self) -> &Clock {
        &self.context.clock
    }

    /// Bell that rings when a call may have ended.
    pub fn wake(&self) -> &Wake {
        &self.context.wake
    }

    /// Begins a call, whose request has `bytes` bytes.
    pub fn begin(
        &mut self,
        (request, bytes): (T, usize),
        now: Instant,
        timeout: Duration,
    ) -> Result<Ticket, CallError> {
        let service = || self.service.clone();
        if self.waiting.len() + self.sent.len() >= self.limit {
            return Err(CallError::TooMany { service: service(), limit: self.limit });
        }
        if !self.share.take(bytes) {
            return Err(CallError::NoRoom { service: service(), bytes });
        }
        let ticket = Ticket(self.next);
        self.next += 1;
        self.waiting
            .push_back((Call { ticket, deadline: ends(now, timeout), timeout, bytes }, request));
        Ok(ticket)
    }

    /// Request that is sent next, once there is a server; `None` while it has as many as may be with it.
    pub fn next_to_send(&self) -> Option<&T> {
        if self.is_held_back() {
            return None;
        }
        self.waiting.front().map(|(_, request)| request)
    }

    /// True when a request waits for the answer to one before it.
    pub fn is_held_back(&self) -> bool {
        // A call that was sent to a server that is gone holds up no other call, nor does one that may wait for ever:
        // its server has taken it, and answers when something has ended.
        let sent = self.sent.range(self.counted_from..);
        let counted = sent.filter(|(_, call)| call.timeout < Duration::MAX).count();
        !self.waiting.is_empty() && counted >= self.at_once
    }

    /// Lets the next requests be sent although those before were not answered: the server to which they went may be
    /// gone. Sequence numbers must rise.
    pub fn server_changed(&mut self) {
        if let Some((last, _)) = self.sent.last_key_value() {
            self.counted_from = last.saturating_add(1);
        }
    }

    /// Hands over the request of [`Calls::next_to_send`]; its reply will come under `sequence`.
    pub fn send(&mut self, sequence: i64) -> Option<T> {
        let (call, request) = self.waiting.pop_front()?;
        self.sent.insert(sequence, call);
        Some(request)
    }

    /// True while the call that was sent under `sequence` has neither ended nor been forgotten.
    pub fn is_sent(&self, sequence: i64) -> bool {
        self.sent.contains_key(&sequence)
    }

    /// Ends the call of [`Calls::next_to_send`], whose request can never be sent.
    pub fn refused(&mut self, error: CallError) {
        if let Some((call, _)) = self.waiting.pop_front() {
            self.end(call, Err(error));
        }
    }

    /// Ends a call with the answer that came for it, `bytes` long on the wire.
    pub fn answered(
        &mut self,
        sequence: i64,
        bytes: usize,
        received_at: Instant,
        answer: impl FnOnce() -> Result<Payload, CallError>,
    ) {
        self.context.counters.received(bytes);
        let Some(call) = self.sent.remove(&sequence) else {
            self.context.counters.dropped(DropReason::Late);
            tracing::debug!(service = self.service, sequence, "dropped a reply that came too late");
            return;
        };
        let reply = answer().map(|payload| Reply { payload, wire_bytes: bytes, received_at });
        if let Err(CallError::Reply { fault, .. }) = &reply {
            self.context.counters.dropped(fault.into());
        }
        self.end(call, reply);
    }

    /// Ends the call `sequence` with `error`, if it is still under way.
    pub fn failed(&mut self, sequence: i64, error: CallError) {
        if let Some(call) = self.sent.remove(&sequence) {
            self.end(call, Err(error));
        }
    }

    /// Ends the calls whose time is over; `why` says how far one came.
    pub fn expire(&mut self, now: Instant, why: impl Fn(Stage) -> String) {
        let is_over = |call: &Call| call.deadline <= now;
        while let Some(at) = self.waiting.iter().position(|(call, _)| is_over(call)) {
            let Some((call, _)) = self.waiting.remove(at) else { break };
            self.time_out(call, why(Stage::Waiting));
        }
        let over = self.sent.iter().filter(|(_, call)| is_over(call));
        for sequence in over.map(|(&sequence, _)| sequence).collect::<Vec<_>>() {
            let Some(call) = self.sent.remove(&sequence) else { break };
            self.time_out(call, why(Stage::Sent));
        }
    }

    fn time_out(&mut self, call: Call, why: String) {
        let timeout_ms = u64::try_from(call.timeout.as_millis()).unwrap_or(u64::MAX);
        let service = self.service.clone();
        self.end(call, Err(CallError::TimedOut { service, timeout_ms, why }));
    }

    fn end(&mut self, call: Call, result: Result<Reply, CallError>) {
        self.share.give(call.bytes);
        self.ended.push_back((call.ticket, result));
    }

    /// Removes the call that ended first and returns its result.
    pub fn take(&mut self) -> Option<(Ticket, Result<Reply, CallError>)> {
        self.ended.pop_front()
    }

    /// Removes this call and returns its result, if it has ended.
    pub fn take_only(&mut self, ticket: Ticket) -> Option<Result<Reply, CallError>> {
        let at = self.ended.iter().position(|(ended, _)| *ended == ticket)?;
        self.ended.remove(at).map(|(_, result)| result)
    }

    /// Forgets a call; its reply will be late.
    pub fn cancel(&mut self, ticket: Ticket) {
        let Self { waiting, sent, ended, share, .. } = self;
        let stays = |call: &Call| {
            let stays = call.ticket != ticket;
            share.give(if stays { 0 } else { call.bytes });
            stays
        };
        waiting.retain(|(call, _)| stays(call));
        sent.retain(|_, call| stays(call));
        ended.retain(|(ended, _)| *ended != ticket);
    }

    /// Instant at which the next call times out.
    pub fn deadline(&self) -> Option<Instant> {
        self.waiting
            .iter()
            .map(|(call, _)| call)
            .chain(self.sent.values())
            .map(|c| c.deadline)
            .min()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Budget;
    use wrapyfi_data::types::Value;

    const SECOND: Duration = Duration::from_secs(1);

    fn calls<T>(limit: usize) -> Calls<T> {
        Calls::new("/x", limit, &Context::default())
    }

    fn answer<T>(calls: &mut Calls<T>, sequence: i64) {
        calls.answered(sequence, 3, Instant::now(), || Ok(Value::from(sequence).into()));
    }

    #[test]
    fn calls_wait_go_out_in_order_and_are_answered_in_any() {
        let now = Instant::now();
        let mut calls = calls(3);
        let tickets = ["a", "b", "c"].map(|text| calls.begin((text, 1), now, SECOND).unwrap());
        let refused = calls.begin(("d", 1), now, SECOND).unwrap_err();
        assert_eq!(refused, CallError::TooMany { service: "/x".into(), limit: 3 });
        for (sequence, text) in [(7, "a"), (8, "b"), (9, "c")] {
            assert_eq!(calls.next_to_send(), Some(&text));
            assert_eq!(calls.send(sequence), Some(text));
        }
        assert_eq!(calls.next_to_send(), None);
        for (sequence, at) in [(9, 2), (7, 0), (8, 1)] {
            answer(&mut calls, sequence);
            let (ticket, reply) = calls.take().unwrap();
            assert_eq!(
                (ticket, reply.unwrap().payload),
                (tickets[at], Value::from(sequence).into())
            );
        }
        assert_eq!((calls.deadline(), calls.share.used()), (None, 0));
        assert_eq!(calls.context.counters.snapshot().received, 3);
    }

    #[test]
    fn no_more_than_a_server_keeps_are_sent_before_it_answers() {
        let now = Instant::now();
        let mut calls = calls(64).at_once(2);
        for number in 0..7 {
            calls.begin((number, 1), now, SECOND * (number + 1)).unwrap();
        }
        let mut sequence = 0;
        let mut send_all = |calls: &mut Calls<u32>| {
            std::iter::from_fn(|| {
                calls.next_to_send()?;
                sequence += 1;
                calls.send(sequence)
            })
            .collect::<Vec<_>>()
        };
        assert_eq!(send_all(&mut calls), [0, 1]);
        assert!(send_all(&mut calls).is_empty(), "both are with the server");
        answer(&mut calls, 2);
        assert_eq!(send_all(&mut calls), [2]);
        calls.expire(now + SECOND, |_| String::new());
        assert_eq!(send_all(&mut calls), [3], "the time of the first is over");
        calls.server_changed();
        assert_eq!(send_all(&mut calls), [4, 5], "what the last server got holds up nobody");
        answer(&mut calls, 3);
        assert!(calls.is_held_back() && send_all(&mut calls).is_empty());
    }

    #[test]
    fn calls_that_may_wait_for_ever_hold_up_no_other() {
        let now = Instant::now();
        let mut calls = calls(64).at_once(1);
        for (number, timeout) in [Duration::MAX, Duration::MAX, SECOND, SECOND].iter().enumerate() {
            calls.begin((number, 1), now, *timeout).unwrap();
        }
        for sequence in 1..=3 {
            assert!(calls.next_to_send().is_some());
            calls.send(sequence);
        }
        assert!(calls.is_held_back(), "one of them may be with the server");
        calls.expire(now + SECOND, |_| String::new());
        assert_eq!(calls.sent.len(), 2);
        assert!(calls.deadline() > Some(now + 1000 * SECOND));
    }

    #[test]
    fn late_replies_are_dropped_and_counted() {
        let now = Instant::now();
        let mut calls = calls(8);
        let slow = calls.begin(("slow", 1), now, SECOND).unwrap();
        let lonely = calls.begin(("lonely", 1), now, 2 * SECOND).unwrap();
        calls.send(1);
        assert_eq!(calls.deadline(), Some(now + SECOND));
        let stage = |stage| format!("{stage:?}");
        calls.expire(now + SECOND / 2, stage);
        assert_eq!(calls.take(), None);
        for (after, ticket, timeout_ms, why) in
            [(1, slow, 1000, "Sent"), (3, lonely, 2000, "Waiting")]
        {
            calls.expire(now + after * SECOND, stage);
            let error = CallError::TimedOut { service: "/x".into(), timeout_ms, why: why.into() };
            assert_eq!(calls.take_only(ticket), Some(Err(error)));
        }
        answer(&mut calls, 1);
        assert_eq!(calls.take(), None);
        assert_eq!(calls.context.counters.snapshot().dropped_for(DropReason::Late), 1);
    }

    #[test]
    fn a_request_that_is_too_big_for_what_waits_is_refused() {
        static BUDGET: Budget = Budget::new(1000);
        let now = Instant::now();
        let mut calls = Calls { share: Share::of(&BUDGET), ..calls(64) };
        let first = calls.begin(("first", 200), now, SECOND).unwrap();
        let refused = calls.begin(("second", 100), now, SECOND).unwrap_err();
        assert_eq!(refused, CallError::NoRoom { service: "/x".into(), bytes: 100 });
        assert_eq!(calls.send(1), Some("first"));
        assert!(calls.begin(("second", 100), now, SECOND).is_err(), "it is still under way");
        calls.cancel(first);
        assert_eq!(BUDGET.used(), 0);
        calls.begin(("second", 100), now, SECOND).unwrap();
        calls.expire(now + SECOND, |_| String::new());
        assert_eq!(BUDGET.used(), 0);
    }

    #[test]
    fn a_time_that_no_clock_reaches_is_decades() {
        let now = Instant::now();
        assert_eq!(ends(now, SECOND), now + SECOND);
        assert!(ends(now, Duration::MAX) > now + SECOND * (1 << 29));
    }

    proptest! {
        /// No call is lost, answered twice, or over the limit, in any order of events.
        #[test]
        fn every_call_ends_once(steps in proptest::collection::vec(0_u8..6, 0..200)) {
            let mut now = Instant::now();
            let mut calls = calls(4);
            let (mut begun, mut ended, mut sequence) = (0, 0, 0_i64);
            for step in steps {
                match step {
                    0 | 1 => begun += usize::from(calls.begin(((), 5), now, SECOND).is_ok()),
                    2 if calls.next_to_send().is_some() => {
                        sequence += 1;
                        calls.send(sequence);
                    }
                    3 => answer(&mut calls, sequence),
                    4 => now += SECOND / 3,
                    _ => calls.expire(now, |_| String::new()),
                }
                while calls.take().is_some() {
                    ended += 1;
                }
                let left = calls.waiting.len() + calls.sent.len();
                prop_assert!(left <= 4);
                prop_assert_eq!(begun, ended + left);
                prop_assert_eq!(calls.share.used(), 5 * left);
            }
        }
    }
}
