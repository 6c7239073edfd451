//! The requests of one server: those that wait for its user, and the number that the user has.
//!
//! ```text
//!   transport ── put ──▶ [ waiting … ] ── next ──▶ with the user ── ended
//!                 └─ too many, too many bytes, closed: refused, and the transport tells its client
//! ```

use std::collections::VecDeque;
use std::time::Instant;

use super::{Context, DropReason, ServeError, ServiceSpec, Share};
use crate::Mutex;

/// A request that came. `A` is its form in the middleware: the body, and the way back.
#[derive(Debug)]
pub struct Asked<A> {
    /// The request as the transport holds it until it is answered.
    pub ask: A,
    /// Size on the wire in bytes.
    pub bytes: usize,
    /// Instant at which the last byte arrived.
    pub received_at: Instant,
}

/// Requests of one server, which a transport puts in and the server takes.
#[derive(Debug)]
pub struct Requests<A> {
    service: String,
    limit: usize,
    context: Context,
    share: Share,
    state: Mutex<RequestsState<A>>,
}

#[derive(Debug)]
struct RequestsState<A> {
    waiting: VecDeque<Asked<A>>,
    /// Number of requests that the user has not answered.
    open: usize,
    closed: bool,
}

impl<A> Requests<A> {
    /// Queue of a server of `spec`, counted in `context`.
    pub fn new(spec: &ServiceSpec, context: &Context) -> Self {
        Self {
            service: spec.service.clone(),
            limit: spec.pending,
            context: context.clone(),
            share: Share::default(),
            state: Mutex::new(RequestsState { waiting: VecDeque::new(), open: 0, closed: false }),
        }
    }

    /// Wake and counters that the server shares with its owner.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// Lets a request wait for the user. A request without room is counted, and returned with the
    /// error for its client.
    pub fn put(&self, ask: A, bytes: usize) -> Result<(), (A, ServeError)> {
        let counters = &self.context.counters;
        counters.received(bytes);
        let mut state = self.state.lock();
        let service = || self.service.clone();
        let (reason, error) = if state.closed {
            (DropReason::Closed, ServeError::Ended(service()))
        } else if state.open + state.waiting.len() >= self.limit {
            let limit = self.limit;
            (DropReason::Overloaded, ServeError::Overloaded { service: service(), limit })
        } else if !self.share.take(bytes) {
            (DropReason::OverBudget, ServeError::NoRoom { service: service(), bytes })
        } else {
            state.waiting.push_back(Asked { ask, bytes, received_at: self.context.clock.now() });
            drop(state);
            self.context.wake.ring();
            return Ok(());
        };
        counters.dropped(reason);
        Err((ask, error))
    }

    /// Takes the oldest request for the user, who calls [`Requests::ended`] when it is answered.
    pub fn next(&self) -> Option<Asked<A>> {
        let mut state = self.state.lock();
        let asked = state.waiting.pop_front()?;
        state.open += 1;
        Some(asked)
    }

    /// Notes that the user has answered or dropped a request of `bytes` bytes.
    pub fn ended(&self, bytes: usize) {
        self.share.give(bytes);
        let mut state = self.state.lock();
        state.open = state.open.saturating_sub(1);
    }
    /// True once the server has closed: no request is taken any more.
    pub fn is_closed(&self) -> bool {
        self.state.lock().closed
    }

    /// Closes the queue and returns the requests that wait.
    pub fn close(&self) -> Vec<A> {
        let mut state = self.state.lock();
        state.closed = true;
        let waiting = std::mem::take(&mut state.waiting);
        drop(state);
        let given = |asked: Asked<A>| {
            self.share.give(asked.bytes);
            asked.ask
        };
        waiting.into_iter().map(given).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Budget;
    use wrapyfi_data::types::ServiceKind;

    fn requests(pending: usize) -> Requests<&'static str> {
        let spec = ServiceSpec { pending, ..ServiceSpec::new("/x", ServiceKind::NativeObject) };
        Requests::new(&spec, &Context::default())
    }

    #[test]
    fn those_with_the_user_count_until_they_have_ended() {
        let requests = requests(2);
        requests.put("first", 10).unwrap();
        let first = requests.next().unwrap();
        assert_eq!((first.ask, first.bytes), ("first", 10));
        requests.put("second", 10).unwrap();
        let (back, error) = requests.put("third", 10).unwrap_err();
        let overloaded = ServeError::Overloaded { service: "/x".into(), limit: 2 };
        assert_eq!((back, error), ("third", overloaded));
        requests.ended(10);
        requests.put("third", 10).unwrap();
        assert_eq!(requests.share.used(), 20);
        assert_eq!(requests.close(), ["second", "third"]);
        assert_eq!(requests.share.used(), 0);
        let (_, error) = requests.put("fourth", 10).unwrap_err();
        assert_eq!(error, ServeError::Ended("/x".into()));
        let counted = requests.context().counters.snapshot();
        let reasons = [DropReason::Overloaded, DropReason::Closed];
        assert_eq!((counted.received, reasons.map(|why| counted.dropped_for(why))), (5, [1, 1]));
    }

    #[test]
    fn a_big_request_is_refused_while_others_wait() {
        static BUDGET: Budget = Budget::new(1000);
        let requests = Requests { share: Share::of(&BUDGET), ..requests(64) };
        requests.put("first", 200).unwrap();
        let first = requests.next().unwrap();
        let (_, error) = requests.put("second", 100).unwrap_err();
        assert_eq!(error, ServeError::NoRoom { service: "/x".into(), bytes: 100 });
        assert!(error.to_string().contains("waiting_mib"), "{error}");
        assert_eq!(requests.context().counters.snapshot().dropped_for(DropReason::OverBudget), 1);
        requests.ended(first.bytes);
        requests.put("second", 100).unwrap();
        assert_eq!(BUDGET.used(), 100);
    }
}
