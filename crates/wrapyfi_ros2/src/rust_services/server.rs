//! Server of the Fast DDS mapping.
//!
//! ```text
//!   take ◀─ request n { reply reader } ── rq/…       RequestId { reply reader, n }
//!   hears ─ is that reader matched? without it the reply is lost
//!   reply ─ { reply reader, n } ─▶ rr/…
//! ```

use bytes::Bytes;
use rustdds::GUID;

use super::adapter::Received;
use super::end::ReopenedEndpoints;
use super::outgoing::Identity;
use super::{identity, remotes};
use crate::graph::{CdrRequest, CdrServer, GraphError, Peers, RequestId, ServiceMapping};
use crate::service_header;

/// Takes requests, sends replies.
pub(super) struct Server(ReopenedEndpoints);

impl Server {
    pub(super) fn new(end: ReopenedEndpoints) -> Self {
        Self(end)
    }
}

/// A request of CycloneDDS's mapping, which its own stack answers.
fn cyclones(service: &str, cdr: &Bytes) -> Result<(RequestId, Bytes), GraphError> {
    let no_identity = || GraphError::NoIdentity {
        what: "request",
        service: service.to_owned(),
        actual: cdr.len(),
        least: service_header::LEAST,
    };
    let request = service_header::split(cdr).ok_or_else(no_identity)?;
    Ok((service_header::request_id(request.client, request.sequence), request.cdr))
}

impl Drop for Server {
    fn drop(&mut self) {
        // A program that ends after its last reply must not take it along.
        self.0.pair().outgoing.farewell();
    }
}

impl CdrServer for Server {
    fn take(&mut self) -> Result<Option<CdrRequest>, GraphError> {
        self.0.renew()?;
        let pair = self.0.pair();
        let Some(taken) = pair.take()? else { return Ok(None) };
        let is_cyclone = remotes::is_cyclone(&taken.writer);
        if is_cyclone && !self.0.is_beside() {
            return Err(GraphError::ForeignMapping {
                service: pair.service.clone(),
                ours: ServiceMapping::FastDds,
                theirs: ServiceMapping::Cyclone,
            });
        }
        match taken.received {
            Received::Message(cdr) => {
                let (id, cdr) = match is_cyclone {
                    true => cyclones(&pair.service, &cdr)?,
                    false => (identity::request_id(taken.related, taken.writer, taken.number), cdr),
                };
                let (source_timestamp_ns, sample) =
                    (taken.source_timestamp_ns, Some((taken.writer, taken.number)));
                Ok(Some(CdrRequest { id, cdr, source_timestamp_ns, sample }))
            }
            Received::TooLarge(actual) => Err(GraphError::TooLarge {
                topic: pair.service.clone(),
                actual,
                limit: pair.max_bytes,
            }),
        }
    }

    fn hears(&self, id: &RequestId) -> bool {
        let remotes = self.0.pair().remotes.lock();
        if GUID::from_bytes(id.client).entity_id.entity_kind.is_reader() {
            remotes.has_reader(&id.client)
        } else {
            // Named by its request writer: the reply reader is one of the same participant.
            remotes.has_reader_beside(&id.client)
        }
    }

    fn reply(&mut self, id: &RequestId, parts: &[&[u8]]) -> Result<(), GraphError> {
        self.0.pair().write(parts, Identity::Always(identity::of_reply(id))).map(|_| ())
    }

    fn clients(&self) -> Peers {
        self.0.pair().remotes.lock().peers()
    }

    fn lost(&mut self) -> u64 {
        self.0.pair().take_lost()
    }
}
