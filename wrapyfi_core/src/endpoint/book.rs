//! What a client of any middleware keeps: its calls, how they ended, what to count.
//!
//! ```text
//!   begin ─▶ Calls ── answered, expire ─▶ ended ─▶ take, take_only
//!                └─ nobody waits any more ─▶ late, counted
//! ```

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::calls::{Calls, Stage, Ticket};
use super::{CallError, Counters, DropReason, Reply};
use crate::types::Payload;

/// The calls of one client. `T` is a request as it will be sent.
pub(crate) struct Book<T> {
    service: String,
    limit: usize,
    calls: Calls<T>,
    ended: VecDeque<(Ticket, Result<Reply, CallError>)>,
    counters: Arc<Counters>,
}

impl<T> Book<T> {
    /// No calls, and never more than `limit`.
    pub(crate) fn new(service: &str, limit: usize, counters: &Arc<Counters>) -> Self {
        Self {
            service: service.to_owned(),
            limit,
            calls: Calls::new(limit),
            ended: VecDeque::new(),
            counters: Arc::clone(counters),
        }
    }

    pub(crate) fn begin(&mut self, request: T, timeout: Duration) -> Result<Ticket, CallError> {
        self.calls
            .begin(request, Instant::now(), timeout)
            .ok_or_else(|| CallError::TooMany { service: self.service.clone(), limit: self.limit })
    }

    /// The request that goes next, once there is a way.
    pub(crate) fn next_to_send(&self) -> Option<&T> {
        self.calls.next_to_send()
    }

    /// Hands that request over to be sent under this number.
    pub(crate) fn send(&mut self, sequence: i64) -> Option<T> {
        self.calls.sent(sequence)
    }

    /// What came back for a call, `bytes` long on the wire.
    pub(crate) fn answered(
        &mut self,
        sequence: i64,
        bytes: usize,
        received_at: Instant,
        answer: impl FnOnce() -> Result<Payload, CallError>,
    ) {
        self.counters.received(bytes);
        let Some(ticket) = self.calls.reply(sequence) else {
            self.counters.dropped(DropReason::Late);
            tracing::debug!(service = self.service, sequence, "dropped a reply that came too late");
            return;
        };
        let reply = answer().map(|payload| Reply { payload, wire_bytes: bytes, received_at });
        if let Err(CallError::Reply { fault, .. }) = &reply {
            self.counters.dropped(fault.drop_reason());
        }
        self.ended.push_back((ticket, reply));
    }

    /// A call ends without a reply, if anybody waits for it still.
    #[cfg_attr(not(feature = "yarp"), allow(dead_code))]
    pub(crate) fn failed(&mut self, sequence: i64, error: CallError) {
        if let Some(ticket) = self.calls.reply(sequence) {
            self.ended.push_back((ticket, Err(error)));
        }
    }

    /// Ends the calls whose time is over; `why` says how far one came.
    pub(crate) fn expire(&mut self, why: impl Fn(Stage) -> String) {
        let now = Instant::now();
        while let Some(expired) = self.calls.expire(now) {
            let error = CallError::TimedOut {
                service: self.service.clone(),
                timeout_ms: u64::try_from(expired.timeout.as_millis()).unwrap_or(u64::MAX),
                why: why(expired.stage),
            };
            self.ended.push_back((expired.ticket, Err(error)));
        }
    }

    pub(crate) fn take(&mut self) -> Option<(Ticket, Result<Reply, CallError>)> {
        self.ended.pop_front()
    }

    pub(crate) fn take_only(&mut self, ticket: Ticket) -> Option<Result<Reply, CallError>> {
        let at = self.ended.iter().position(|(ended, _)| *ended == ticket)?;
        self.ended.remove(at).map(|(_, result)| result)
    }

    pub(crate) fn cancel(&mut self, ticket: Ticket) {
        if !self.calls.forget(ticket) {
            self.ended.retain(|(ended, _)| *ended != ticket);
        }
    }

    pub(crate) fn deadline(&self) -> Option<Instant> {
        self.calls.deadline()
    }
}
