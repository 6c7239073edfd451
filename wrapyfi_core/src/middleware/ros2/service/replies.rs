//! Replies of one server, kept until their clients hear.
//!
//! ```text
//!   send ─ the client hears ─▶ CdrServer
//!     └─ not yet ─▶ kept ─ flush, the client hears ─▶ CdrServer
//!                     └─ too long, too many ─▶ unheard, counted
//! ```
//!
//! Discovery may bring a request before its client's other half, and a reply that nobody hears is
//! lost.

use std::collections::VecDeque;
use std::time::Instant;

use bytes::Bytes;

use crate::middleware::ros2::graph::{CdrRequest, CdrServer, GraphError, Peers, RequestId};

/// A reply on its way.
pub(in super::super) struct Reply {
    /// Which request it answers.
    pub(in super::super) id: RequestId,
    /// Encapsulation header and body.
    pub(in super::super) cdr: Bytes,
    /// How long its client may take to hear.
    pub(in super::super) until: Instant,
}

/// A server and the replies that are kept.
pub(in super::super) struct Replies {
    server: Box<dyn CdrServer>,
    name: String,
    kept: VecDeque<Reply>,
    limit: usize,
    unheard: u64,
}

impl Replies {
    /// Nothing is kept yet, and never more than `limit`.
    pub(in super::super) fn new(server: Box<dyn CdrServer>, name: &str, limit: usize) -> Self {
        let (name, kept) = (name.to_owned(), VecDeque::new());
        Self { server, name, kept, limit: limit.max(1), unheard: 0 }
    }

    /// As [`CdrServer::take`].
    pub(in super::super) fn take(&mut self) -> Result<Option<CdrRequest>, GraphError> {
        self.server.take()
    }

    /// Sends a reply, now or as soon as its client hears.
    pub(in super::super) fn send(&mut self, reply: Reply) -> Result<(), GraphError> {
        if self.server.hears(&reply.id) {
            let sent = self.server.reply(&reply.id, &[&reply.cdr]);
            self.unheard += u64::from(sent.is_err());
            return sent;
        }
        // Those beyond are replies to clients that will never hear.
        if self.kept.len() >= self.limit {
            self.kept.pop_front();
            self.unheard += 1;
        }
        self.kept.push_back(reply);
        Ok(())
    }

    /// Sends what was kept and is heard now.
    pub(in super::super) fn flush(&mut self) {
        let now = Instant::now();
        for reply in std::mem::take(&mut self.kept) {
            if self.server.hears(&reply.id) {
                if let Err(error) = self.server.reply(&reply.id, &[&reply.cdr]) {
                    self.unheard += 1;
                    tracing::warn!(service = self.name, %error, "a reply was not sent");
                }
            } else if reply.until > now {
                self.kept.push_back(reply);
            } else {
                self.unheard += 1;
                tracing::warn!(service = self.name, "a client never heard its reply");
            }
        }
    }

    /// How many are kept.
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

    /// A graph whose clients hear when they are told to.
    #[derive(Clone, Default)]
    struct Scripted {
        hears: Arc<AtomicBool>,
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

        fn reply(&mut self, id: &RequestId, _: &[&[u8]]) -> Result<(), GraphError> {
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

    fn reply(sequence: i64, until: Instant) -> Reply {
        Reply { id: RequestId { client: [0; 16], sequence }, cdr: Bytes::new(), until }
    }

    #[test]
    fn replies_wait_for_their_clients() {
        let graph = Scripted::default();
        let mut replies = Replies::new(Box::new(graph.clone()), "/add", 2);
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
}
