//! Services on CycloneDDS, as `rmw_cyclonedds_cpp` maps them.
//!
//! ```text
//!   CycloneClient   writer rq/…Request ──▶ reader   CycloneServer
//!                   reader rr/…Reply  ◀── writer
//!                   identity in front of every body: service_header
//! ```
//!
//! All clients of a service hear all its replies; each keeps its own.
//!
//! Beside Fast DDS's mapping (`both_mappings`) a server gives requests of that mapping too: a client asks as soon as one
//! stack of the node has matched, and here its request is whole.

use std::cell::{Cell, RefCell};
use std::collections::{HashMap, HashSet};
use std::time::{Duration, Instant};

use super::cyclone::{EndpointFound, RawReader, RawWriter, Taken};
use super::graph::{
    CdrClient, CdrReply, CdrRequest, CdrSample, CdrServer, GraphError, LOOK_AGAIN, Peers,
    RequestId, ServiceMapping,
};
use super::service_header::{self, HEADER, LEAST};
use super::vendor::{EndKey, is_rustdds, pair};

/// Clients whose endpoints a server remembers.
const MAX_CLIENTS: usize = 1024;
/// Writers whose peers are remembered.
const MAX_WRITERS: usize = 1024;
/// Time that the other ends have to confirm that they hear; after it they count as hearing.
const CONFIRM: Duration = Duration::from_secs(1);
/// Service mapping of this module.
const OURS: ServiceMapping = ServiceMapping::Cyclone;

/// Origin of a sample: the key that its sender's endpoints have in common, its writer, and the sender's mapping
/// where that is not ours.
type Origin = (EndKey, [u8; 16], Option<ServiceMapping>);

/// The two endpoints of a client or a server.
pub(super) struct Ends {
    /// Service, for messages.
    pub(super) service: String,
    /// Writer of requests for a client, of replies for a server.
    pub(super) writer: RawWriter,
    /// Reader of replies for a client, of requests for a server.
    pub(super) reader: RawReader,
    /// Largest message without its identity.
    pub(super) max_bytes: usize,
    /// True where the node has Fast DDS's mapping too: programs on RustDDS that do not tell theirs are taken to speak
    /// that one.
    is_beside: bool,
    /// Origins of samples, by the handle of the sample's writer.
    writers: RefCell<HashMap<u64, Option<Origin>>>,
    /// Change of the writer's matches that was probed last, the time of the probe, and true when
    /// all had confirmed it at the last look.
    probed: Cell<(u64, Instant, bool)>,
}

impl Ends {
    pub(super) fn new(
        service: &str,
        writer: RawWriter,
        reader: RawReader,
        max_bytes: usize,
        is_beside: bool,
    ) -> Self {
        let (service, writers) = (service.to_owned(), RefCell::default());
        let probed = Cell::new((0, Instant::now(), true));
        Self { service, writer, reader, max_bytes, is_beside, writers, probed }
    }

    /// Mapping of a peer, where that can be known.
    fn mapping(&self, peer: &EndpointFound) -> Option<ServiceMapping> {
        let taken = (self.is_beside && is_rustdds(&peer.guid)).then_some(ServiceMapping::FastDds);
        peer.service_mapping.or(taken)
    }

    /// The next sample, the identity still in it, and its number.
    fn take(&mut self) -> Result<Option<(CdrSample, Option<i64>)>, GraphError> {
        match self.reader.take(self.max_bytes.saturating_add(HEADER)) {
            Ok(Taken::Nothing) => Ok(None),
            Ok(Taken::Message(sample, number)) => Ok(Some((sample, number))),
            Ok(Taken::TooLarge(actual)) => Err(GraphError::TooLarge {
                topic: self.service.clone(),
                actual: actual.saturating_sub(HEADER),
                limit: self.max_bytes,
            }),
            Err(code) => Err(self.fault("taking", &code.to_string())),
        }
    }

    /// Sender of a sample; `None` where the writer is gone.
    fn origin(&self, sample: &CdrSample) -> Option<Origin> {
        let mut writers = self.writers.borrow_mut();
        if writers.len() >= MAX_WRITERS {
            writers.clear();
        }
        let known = writers.entry(sample.publisher).or_insert_with(|| {
            let peer = self.reader.writer(sample.publisher)?;
            let theirs = self.mapping(&peer).filter(|&theirs| theirs != OURS);
            Some((EndKey::new(&peer.guid, &peer.user_data), peer.guid, theirs))
        });
        known.clone()
    }

    /// True when the readers that are matched now would hear a message written now. A match on our
    /// side is not enough: see [`RawWriter::write_without_data`].
    fn heard(&self) -> bool {
        let changes = self.writer.events().changes();
        let (mut known, mut since, mut confirmed) = self.probed.get();
        if known != changes {
            (known, since) = (changes, Instant::now());
            // A probe that cannot be written counts as confirmed: a message fails likewise, and
            // says why.
            confirmed = self.writer.write_without_data().is_err();
        }
        confirmed = confirmed || self.writer.all_acknowledged() || since.elapsed() >= CONFIRM;
        self.probed.set((known, since, confirmed));
        confirmed
    }

    /// Time until [`Ends::heard`] is asked again, where it has said no: no program is told of
    /// acknowledgements. Soon after a match, then ever less often, until [`CONFIRM`] is over. Its
    /// last answer counts, not the one it would give now: that would keep the news from the program that was
    /// told no.
    fn look_again(&self) -> Option<Duration> {
        let (_, since, confirmed) = self.probed.get();
        (!confirmed).then(|| (since.elapsed() / 4).max(LOOK_AGAIN))
    }

    fn send(&self, client: u64, sequence: i64, parts: &[&[u8]]) -> Result<(), GraphError> {
        let mut room = [0; HEADER];
        let joined = service_header::join(client, sequence, parts, &mut room)
            .ok_or_else(|| self.fault("writing", "the message has no encapsulation header"))?;
        super::cyclone_endpoints::write(&self.writer, &self.service, &joined)
    }

    /// The other ends; `requests` says whether the writer is that of requests.
    fn peers(&self, writer_is_requests: bool) -> Peers {
        let readers = self.writer.readers().unwrap_or_default();
        let writers = self.reader.writers().unwrap_or_default();
        let (requests, replies) =
            if writer_is_requests { (&readers, &writers) } else { (&writers, &readers) };
        let keyed =
            |peer: &EndpointFound| (self.mapping(peer), EndKey::new(&peer.guid, &peer.user_data));
        pair(requests.iter().map(keyed), replies.iter().map(keyed), OURS)
    }

    fn no_identity(&self, what: &'static str, actual: usize) -> GraphError {
        GraphError::NoIdentity { what, service: self.service.clone(), actual, least: LEAST }
    }

    fn fault(&self, operation: &'static str, reason: &str) -> GraphError {
        GraphError::stack(operation, &self.service, &reason)
    }
}

/// A client. `L` is what lists its endpoints in the node while it lives.
pub(super) struct CycloneClient<L> {
    ends: Ends,
    id: u64,
    sequence: i64,
    _listed: L,
}

impl<L> CycloneClient<L> {
    /// A client whose identity is made of the GUID of its request writer.
    pub(super) fn new(ends: Ends, guid: [u8; 16], listed: L) -> Self {
        let id = service_header::client_id(guid);
        Self { ends, id, sequence: 0, _listed: listed }
    }
}

impl<L: Send> CdrClient for CycloneClient<L> {
    fn send(&mut self, parts: &[&[u8]]) -> Result<i64, GraphError> {
        let sequence = self.sequence.saturating_add(1);
        self.ends.send(self.id, sequence, parts)?;
        self.sequence = sequence;
        Ok(sequence)
    }

    fn take(&mut self) -> Result<Option<CdrReply>, GraphError> {
        while let Some((sample, _)) = self.ends.take()? {
            // Replies to clients of the other vendor, which are on the same topic.
            if self.ends.origin(&sample).is_some_and(|(_, _, theirs)| theirs.is_some()) {
                continue;
            }
            let reply = service_header::split(&sample.cdr)
                .ok_or_else(|| self.ends.no_identity("reply", sample.cdr.len()))?;
            if reply.client == self.id {
                return Ok(Some(CdrReply {
                    sequence: reply.sequence,
                    cdr: reply.cdr,
                    source_timestamp_ns: sample.source_timestamp_ns,
                }));
            }
        }
        Ok(None)
    }

    fn id_of(&self, sequence: i64) -> RequestId {
        service_header::request_id(self.id, sequence)
    }

    fn servers(&self) -> Peers {
        match self.ends.peers(true) {
            Peers::Ready(_) if !self.ends.heard() => Peers::Half,
            peers => peers,
        }
    }

    fn look_again(&self) -> Option<Duration> {
        self.ends.look_again()
    }
}

/// Keys of the clients whose requests came last.
#[derive(Default)]
struct Clients {
    /// Keys by client, with the number of the client's last request.
    known: HashMap<u64, (EndKey, u64)>,
    requests: u64,
}

impl Clients {
    /// A request of a client whose endpoints are those of `key`. For want of room the client that
    /// was silent for longest is forgotten: its replies are sent without waiting.
    fn note(&mut self, client: u64, key: EndKey) {
        if self.known.len() >= MAX_CLIENTS && !self.known.contains_key(&client) {
            let oldest = self.known.iter().min_by_key(|(_, (_, request))| *request);
            if let Some((&oldest, _)) = oldest {
                self.known.remove(&oldest);
            }
        }
        self.requests = self.requests.saturating_add(1);
        self.known.insert(client, (key, self.requests));
    }

    fn key(&self, client: u64) -> Option<&EndKey> {
        self.known.get(&client).map(|(key, _)| key)
    }
}

/// A server. `L` as in [`CycloneClient`].
pub(super) struct CycloneServer<L> {
    ends: Ends,
    clients: Clients,
    /// Clients that hear replies, with the number of the writer's matches for which that holds.
    hearing: RefCell<(u64, HashSet<EndKey>)>,
    _listed: L,
}

impl<L> CycloneServer<L> {
    pub(super) fn new(ends: Ends, listed: L) -> Self {
        let hearing = RefCell::new((u64::MAX, HashSet::new()));
        Self { ends, clients: Clients::default(), hearing, _listed: listed }
    }
}

impl<L: Send> CdrServer for CycloneServer<L> {
    fn take(&mut self) -> Result<Option<CdrRequest>, GraphError> {
        let Some((sample, number)) = self.ends.take()? else { return Ok(None) };
        let origin = self.ends.origin(&sample);
        if let Some((_, writer, Some(theirs))) = origin {
            if let Some(sequence) = number.filter(|_| self.ends.is_beside) {
                return Ok(Some(CdrRequest {
                    id: RequestId { client: writer, sequence },
                    cdr: sample.cdr,
                    source_timestamp_ns: sample.source_timestamp_ns,
                    sample: Some((writer, sequence)),
                }));
            }
            let service = self.ends.service.clone();
            return Err(GraphError::ForeignMapping { service, ours: OURS, theirs });
        }
        let source_timestamp_ns = sample.source_timestamp_ns;
        let request = service_header::split(&sample.cdr)
            .ok_or_else(|| self.ends.no_identity("request", sample.cdr.len()))?;
        let sample = origin.as_ref().map(|(_, writer, _)| *writer).zip(number);
        if let Some((key, ..)) = origin {
            self.clients.note(request.client, key);
        }
        Ok(Some(CdrRequest {
            id: service_header::request_id(request.client, request.sequence),
            cdr: request.cdr,
            source_timestamp_ns,
            sample,
        }))
    }

    fn hears(&self, id: &RequestId) -> bool {
        let Some(key) = self.clients.key(service_header::client(id)) else { return true };
        let (known, hearing) = &mut *self.hearing.borrow_mut();
        let changes = self.ends.writer.events().changes();
        if *known != changes {
            let Ok(readers) = self.ends.writer.readers() else { return true };
            let keys = |peer: &EndpointFound| {
                [EndKey::new(&peer.guid, &peer.user_data), EndKey::new(&peer.guid, b"")]
            };
            *hearing = readers.iter().flat_map(keys).collect();
            *known = changes;
        }
        hearing.contains(key) && self.ends.heard()
    }

    fn note_client(&mut self, id: &RequestId, writer: &[u8; 16]) {
        let client = service_header::client(id);
        if self.clients.key(client).is_none() {
            self.clients.note(client, EndKey::new(writer, b""));
        }
    }

    fn look_again(&self) -> Option<Duration> {
        self.ends.look_again()
    }

    fn reply(&mut self, id: &RequestId, parts: &[&[u8]]) -> Result<(), GraphError> {
        self.ends.send(service_header::client(id), id.sequence, parts)
    }

    fn clients(&self) -> Peers {
        self.ends.peers(false)
    }

    fn lost(&mut self) -> u64 {
        self.ends.reader.events().take_lost()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_client_that_was_silent_for_longest_is_forgotten() {
        let key = |client: u64| EndKey::new(&[0; 16], format!("clientid= {client};").as_bytes());
        let mut clients = Clients::default();
        let many = MAX_CLIENTS as u64;
        (0..many).for_each(|client| clients.note(client, key(client)));
        clients.note(0, key(0));
        clients.note(many, key(many));
        assert_eq!(clients.known.len(), MAX_CLIENTS);
        assert_eq!(clients.key(1), None);
        for client in [0].into_iter().chain(2..=many) {
            assert_eq!(clients.key(client), Some(&key(client)));
        }
    }
}
