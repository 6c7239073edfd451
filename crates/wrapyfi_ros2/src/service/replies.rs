//! Replies of one server, kept until their clients hear.
//!
//! ```text
//!   send ─ the client hears ─▶ CdrServer ◀─────┐
//!     └─ not yet, or there is no room ─▶ kept ─┴─ flush ─ refused ─▶ Unsent, counted
//!                                         └─ too long, too many ─▶ unheard, counted
//! ```
//!
//! Discovery may bring a request before its client's other half, and a reply that no client hears is
//! lost. Other clients that do not acknowledge, because they have just come or were killed, take the
//! room in which replies wait: those to the living wait for it.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use bytes::Bytes;

use crate::graph::{CdrRequest, CdrServer, GraphError, LOOK_AGAIN, Peers, RequestId};
use wrapyfi_endpoint::{Clock, Share, Throttle};

/// Time between two tries where clients do not acknowledge; each try waits in DDS as well.
const TRY_AGAIN: Duration = Duration::from_millis(100);

/// A reply on its way.
pub(in super::super) struct Reply {
    /// Identity of the request that it answers.
    pub(in super::super) id: RequestId,
    /// Encapsulation header and body.
    pub(in super::super) cdr: Bytes,
    /// Time by which the client must have become able to hear.
    pub(in super::super) until: Instant,
}

/// A kept reply that could not be sent when its client heard at last.
#[derive(Debug, Clone, PartialEq)]
pub(in super::super) struct Unsent {
    /// Identity of the request that it answered.
    pub(in super::super) id: RequestId,
    /// Error that kept it back.
    pub(in super::super) error: GraphError,
}

/// A server and the replies that are kept.
pub(in super::super) struct Replies {
    server: Box<dyn CdrServer>,
    name: String,
    kept: VecDeque<Reply>,
    limit: usize,
    /// Bytes of what is kept.
    share: Share,
    unheard: u64,
    /// A client hears since some were kept: others may, too.
    news: bool,
    /// There was no room for the last reply: those after it wait behind it.
    is_full: bool,
    complaints: Throttle,
    clock: Clock,
}

impl Replies {
    /// Replies of `server`, none so far and never more than `limit`.
    pub(in super::super) fn new(
        server: Box<dyn CdrServer>,
        name: &str,
        limit: usize,
        clock: &Clock,
    ) -> Self {
        Self {
            server,
            name: name.to_owned(),
            kept: VecDeque::new(),
            limit: limit.max(1),
            share: Share::default(),
            unheard: 0,
            news: false,
            is_full: false,
            complaints: Throttle::default(),
            clock: clock.clone(),
        }
    }

    /// As [`CdrServer::take`].
    pub(in super::super) fn take(&mut self) -> Result<Option<CdrRequest>, GraphError> {
        self.server.take()
    }

    /// Sends a reply, now or as soon as its client hears and there is room.
    pub(in super::super) fn send(&mut self, reply: Reply) -> Result<(), GraphError> {
        if !self.is_full && self.server.hears(&reply.id) {
            self.news = !self.kept.is_empty();
            match self.server.reply(&reply.id, &[&reply.cdr]) {
                Err(GraphError::Timeout { .. }) if reply.until > self.clock.now() => {
                    self.is_full = true;
                }
                sent => {
                    self.unheard += u64::from(sent.is_err());
                    return sent;
                }
            }
        }
        // Those beyond are replies to clients that will never hear.
        while self.kept.len() >= self.limit || !self.share.take(reply.cdr.len()) {
            let Some(oldest) = self.kept.pop_front() else { break };
            self.share.give(oldest.cdr.len());
            self.lose(&"too many are kept for clients that do not hear yet");
        }
        self.kept.push_back(reply);
        Ok(())
    }

    /// Sends what was kept and is heard now. A reply that could not be sent is counted and logged,
    /// and returned, so that its client can be told.
    pub(in super::super) fn flush(&mut self) -> Vec<Unsent> {
        let now = self.clock.now();
        let (mut unsent, mut heard) = (Vec::new(), false);
        self.is_full = false;
        for reply in std::mem::take(&mut self.kept) {
            let (hears, has_time) = (self.server.hears(&reply.id), reply.until > now);
            let sent =
                (hears && !self.is_full).then(|| self.server.reply(&reply.id, &[&reply.cdr]));
            heard |= sent.is_some();
            self.is_full |= matches!(sent, Some(Err(GraphError::Timeout { .. })));
            match sent {
                None | Some(Err(GraphError::Timeout { .. })) if has_time => {
                    self.kept.push_back(reply);
                    continue;
                }
                None if hears => self.lose(&"other clients of the service held it up"),
                None => self.lose(&"its client never heard it"),
                Some(Err(error)) => {
                    self.lose(&error);
                    unsent.push(Unsent { id: reply.id, error });
                }
                Some(Ok(())) => {}
            }
            self.share.give(reply.cdr.len());
        }
        self.news = heard && !self.kept.is_empty();
        unsent
    }

    /// Time of the next flush though nothing rang: the time of a kept reply will be over, or its
    /// client may have confirmed that it hears.
    pub(in super::super) fn deadline(&self) -> Option<Instant> {
        let over = self.kept.iter().map(|reply| reply.until).min()?;
        let look_again = match (self.is_full, self.news) {
            (true, _) => Some(TRY_AGAIN),
            (false, true) => Some(LOOK_AGAIN),
            (false, false) => self.server.look_again(),
        };
        let soon = look_again.map(|wait| self.clock.now() + wait);
        Some(soon.map_or(over, |soon| soon.min(over)))
    }

    /// Counts a kept reply that is lost, and says why.
    fn lose(&mut self, why: &dyn std::fmt::Display) {
        self.unheard += 1;
        if let Some(unlogged_before) = self.complaints.pass(self.clock.now()) {
            tracing::warn!(service = self.name, unlogged_before, "a reply was not sent: {why}");
        }
    }

    /// Number of replies that are kept.
    pub(in super::super) fn kept(&self) -> usize {
        self.kept.len()
    }

    /// Replies that were not heard, so far.
    pub(in super::super) fn unheard(&self) -> u64 {
        self.unheard
    }

    /// As [`CdrServer::clients`].
    pub(in super::super) fn clients(&self) -> Peers {
        self.server.clients()
    }

    /// As [`CdrServer::lost`].
    pub(in super::super) fn lost(&mut self) -> u64 {
        self.server.lost()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
    use std::sync::{Arc, Mutex};
    use std::time::Duration;

    use super::*;
    use wrapyfi_endpoint::Budget;

    /// A graph whose clients hear when they are told to.
    #[derive(Clone, Default)]
    struct Scripted {
        hears: Arc<AtomicBool>,
        refuses: Arc<AtomicBool>,
        is_full: Arc<AtomicBool>,
        tries: Arc<AtomicU64>,
        look_again: Option<Duration>,
        sent: Arc<Mutex<Vec<i64>>>,
        lost: Arc<AtomicU64>,
    }

    impl CdrServer for Scripted {
        fn take(&mut self) -> Result<Option<CdrRequest>, GraphError> {
            Ok(None)
        }

        fn hears(&self, _: &RequestId) -> bool {
            self.hears.load(Relaxed)
        }

        fn look_again(&self) -> Option<Duration> {
            self.look_again
        }

        fn reply(&mut self, id: &RequestId, _: &[&[u8]]) -> Result<(), GraphError> {
            self.tries.fetch_add(1, Relaxed);
            if self.refuses.load(Relaxed) {
                return Err(refusal());
            }
            if self.is_full.load(Relaxed) {
                return Err(GraphError::Timeout { topic: "/add".into(), timeout_ms: 500 });
            }
            self.sent.lock().unwrap().push(id.sequence);
            Ok(())
        }

        fn clients(&self) -> Peers {
            Peers::None
        }

        fn lost(&mut self) -> u64 {
            self.lost.load(Relaxed)
        }
    }

    fn refusal() -> GraphError {
        GraphError::TooLarge { topic: "/add".into(), actual: 2, limit: 1 }
    }

    fn reply(sequence: i64, until: Instant) -> Reply {
        Reply { id: RequestId { client: [0; 16], sequence }, cdr: Bytes::new(), until }
    }

    #[test]
    fn replies_wait_for_their_clients() {
        let graph = Scripted::default();
        let mut replies = Replies::new(Box::new(graph.clone()), "/add", 2, &Clock::default());
        let later = Instant::now() + Duration::from_secs(1000);
        for sequence in 1..=3 {
            replies.send(reply(sequence, later)).unwrap();
        }
        assert_eq!((replies.kept(), replies.unheard()), (2, 1), "the oldest made room");
        replies.flush();
        assert_eq!(replies.kept(), 2);
        graph.hears.store(true, Relaxed);
        replies.flush();
        replies.send(reply(4, later)).unwrap();
        assert_eq!(*graph.sent.lock().unwrap(), [2, 3, 4]);
        graph.hears.store(false, Relaxed);
        replies.send(reply(5, Instant::now())).unwrap();
        replies.flush();
        assert_eq!((replies.kept(), replies.unheard()), (0, 2), "its time was over");
    }

    #[test]
    fn replies_that_nobody_hears_are_bounded_in_bytes() {
        static BUDGET: Budget = Budget::new(4000);
        let graph = Scripted::default();
        let mut replies = Replies::new(Box::new(graph.clone()), "/add", 64, &Clock::default());
        replies.share = Share::of(&BUDGET);
        let later = Instant::now() + Duration::from_secs(1000);
        for sequence in 1..=20 {
            replies.send(Reply { cdr: vec![0; 300].into(), ..reply(sequence, later) }).unwrap();
        }
        assert_eq!((replies.kept(), replies.unheard(), BUDGET.used()), (3, 17, 900));
        graph.hears.store(true, Relaxed);
        replies.flush();
        assert_eq!((replies.kept(), BUDGET.used()), (0, 0));
        assert_eq!(*graph.sent.lock().unwrap(), [18, 19, 20]);
    }

    #[test]
    fn a_kept_reply_that_is_refused_is_told_once() {
        let graph = Scripted::default();
        let mut replies = Replies::new(Box::new(graph.clone()), "/add", 2, &Clock::default());
        let later = Instant::now() + Duration::from_secs(1000);
        replies.send(reply(1, later)).unwrap();
        graph.hears.store(true, Relaxed);
        graph.refuses.store(true, Relaxed);
        let id = reply(1, later).id;
        assert_eq!(replies.flush(), [Unsent { id, error: refusal() }]);
        assert_eq!((replies.kept(), replies.unheard()), (0, 1));
        assert_eq!(replies.flush(), []);
        assert_eq!(replies.unheard(), 1);
    }

    #[test]
    fn replies_wait_in_their_order_while_other_clients_do_not_acknowledge() {
        let graph = Scripted::default();
        graph.hears.store(true, Relaxed);
        graph.is_full.store(true, Relaxed);
        let mut replies = Replies::new(Box::new(graph.clone()), "/add", 4, &Clock::default());
        let later = Instant::now() + Duration::from_secs(1000);
        for sequence in 1..=3 {
            replies.send(reply(sequence, later)).unwrap();
        }
        assert_eq!((replies.kept(), replies.unheard()), (3, 0));
        assert_eq!(replies.flush(), []);
        assert_eq!(graph.tries.load(Relaxed), 2, "each try waits in DDS: one for all of them");
        assert!(replies.deadline().unwrap() < later);
        graph.is_full.store(false, Relaxed);
        assert_eq!(replies.flush(), []);
        replies.send(reply(4, later)).unwrap();
        assert_eq!(*graph.sent.lock().unwrap(), [1, 2, 3, 4]);
        graph.is_full.store(true, Relaxed);
        assert!(replies.send(reply(5, Instant::now())).is_err(), "its time was over");
        assert_eq!((replies.kept(), replies.unheard()), (0, 1));
    }

    #[test]
    fn one_that_hears_is_news_for_the_others() {
        let graph = Scripted::default();
        let mut replies = Replies::new(Box::new(graph.clone()), "/add", 3, &Clock::default());
        let later = Instant::now() + Duration::from_secs(1000);
        replies.send(reply(1, later)).unwrap();
        assert_eq!(replies.deadline(), Some(later));
        // The coming of the second reply does not try the kept one again.
        graph.hears.store(true, Relaxed);
        replies.send(reply(2, later)).unwrap();
        assert!(replies.deadline().unwrap() < later);
        graph.hears.store(false, Relaxed);
        replies.flush();
        assert_eq!(replies.deadline(), Some(later));
    }

    #[test]
    fn nobody_looks_before_there_is_news() {
        let later = Instant::now() + Duration::from_secs(1000);
        let sooner = later - Duration::from_secs(1);
        let mut replies = Replies::new(Box::new(Scripted::default()), "/add", 2, &Clock::default());
        assert_eq!(replies.deadline(), None);
        replies.send(reply(1, later)).unwrap();
        replies.send(reply(2, sooner)).unwrap();
        assert_eq!(replies.deadline(), Some(sooner), "a match would ring");
        let unconfirmed =
            Scripted { look_again: Some(Duration::from_millis(7)), ..Scripted::default() };
        let mut replies = Replies::new(Box::new(unconfirmed), "/add", 2, &Clock::default());
        assert_eq!(replies.deadline(), None, "nothing waits for it");
        replies.send(reply(1, later)).unwrap();
        assert!(replies.deadline().unwrap() < sooner);
    }
}
