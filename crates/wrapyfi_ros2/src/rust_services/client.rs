//! Client of the Fast DDS mapping.
//!
//! ```text
//!   send ─ request, { own reply reader, unknown } ─▶ rq/…      its number n
//!   take ◀─ reply { own reply reader, n } ── rr/…              replies to others are passed over
//! ```

use super::adapter::Received;
use super::outgoing::Identity;
use super::participant::Opened;
use super::{identity, remotes};
use crate::discovery_info::Gid;
use crate::graph::{CdrClient, CdrReply, GraphError, Peers};

/// Sends requests, takes replies.
pub(super) struct Client {
    opened: Opened,
    /// GUIDs by which servers name the client: the reader that its requests carry, or their writer
    /// where a request carries none.
    names: [Gid; 2],
}

impl Client {
    pub(super) fn new(opened: Opened) -> Self {
        let pair = &opened.pair;
        let names = [pair.reader_guid().to_bytes(), pair.writer_guid().to_bytes()];
        Self { opened, names }
    }
}

impl CdrClient for Client {
    fn send(&mut self, parts: &[&[u8]]) -> Result<i64, GraphError> {
        let pair = &self.opened.pair;
        pair.write(parts, Identity::IfWhole(identity::of_request(pair.reader_guid())))
    }

    fn take(&mut self) -> Result<Option<CdrReply>, GraphError> {
        let pair = &self.opened.pair;
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
        self.opened.pair.remotes.lock().peers()
    }

    fn lost(&mut self) -> u64 {
        self.opened.pair.take_lost()
    }
}
