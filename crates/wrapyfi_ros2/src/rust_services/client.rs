//! Client of the Fast DDS mapping.
//!
//! ```text
//!   send ─ request, { own reply reader, unknown } ─▶ rq/…      its number n
//!   take ◀─ reply { own reply reader, n } ── rr/…              replies to others are passed over
//! ```

use super::adapter::Received;
use super::end::End;
use super::outgoing::Identity;
use super::{identity, remotes};
use crate::discovery_info::Gid;
use crate::graph::{CdrClient, CdrReply, GraphError, GraphResult, Peers};

/// Sends requests, takes replies.
pub(super) struct Client {
    end: End,
    /// GUIDs by which servers name the client: the reader that its requests carry, or their writer
    /// where a request carries none.
    names: [Gid; 2],
    /// Number of the last request, and of the last one of the endpoints before: those that follow count from 1 again.
    last: i64,
    before: i64,
}

impl Client {
    pub(super) fn new(end: End) -> Self {
        Self { names: names(&end), end, last: 0, before: 0 }
    }

    fn renew(&mut self) -> GraphResult<()> {
        if self.end.renew()? {
            (self.names, self.before) = (names(&self.end), self.last);
        }
        Ok(())
    }
}

fn names(end: &End) -> [Gid; 2] {
    [end.pair().reader_guid().to_bytes(), end.pair().writer_guid().to_bytes()]
}

impl CdrClient for Client {
    fn send(&mut self, parts: &[&[u8]]) -> Result<i64, GraphError> {
        self.renew()?;
        let pair = self.end.pair();
        let number =
            pair.write(parts, Identity::IfWhole(identity::of_request(pair.reader_guid())))?;
        self.last = self.before.saturating_add(number);
        Ok(self.last)
    }

    fn take(&mut self) -> Result<Option<CdrReply>, GraphError> {
        self.renew()?;
        let pair = self.end.pair();
        while let Some(taken) = pair.take()? {
            let source_timestamp_ns = taken.source_timestamp_ns;
            let size = match &taken.received {
                Received::Message(cdr) => cdr.len(),
                Received::TooLarge(actual) => *actual,
            };
            let Some((client, sequence)) = identity::reply_to(taken.related) else {
                // A server of Cyclone's answers its own clients.
                if remotes::is_cyclone(&taken.writer) {
                    continue;
                }
                return Err(GraphError::NoIdentity {
                    what: "reply",
                    service: pair.service.clone(),
                    actual: size,
                    least: identity::BYTES,
                });
            };
            if !self.names.contains(&client) {
                continue;
            }
            let sequence = self.before.saturating_add(sequence);
            return match taken.received {
                Received::Message(cdr) => Ok(Some(CdrReply { sequence, cdr, source_timestamp_ns })),
                Received::TooLarge(actual) => Err(GraphError::TooLarge {
                    topic: pair.service.clone(),
                    actual,
                    limit: pair.max_bytes,
                }),
            };
        }
        Ok(None)
    }

    fn servers(&self) -> Peers {
        self.end.pair().remotes.lock().peers()
    }

    fn lost(&mut self) -> u64 {
        self.end.pair().take_lost()
    }
}
