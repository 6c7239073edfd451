//! Writing side of one end of a service.
//!
//! ```text
//!   message ─┬─ fits a datagram ──▶ RustDDS, with its identity
//!            ├─ a larger request ─▶ RustDDS, without: it is named by its sample
//!            └─ a larger reply ───▶ large, with its identity, then RustDDS without
//! ```

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use bytes::Bytes;
use rustdds::dds::WriteError;
use rustdds::no_key::DataWriter;
use rustdds::rpc::SampleIdentity;
use rustdds::{RTPSEntity as _, Timestamp, WriteOptionsBuilder};

use super::adapter::{self, CDR_LE, RawCdr};
use super::fragments::Identified;
use super::large::{self, Addressed, MAX_LARGE, Sent, UnsendableReply};
use super::remotes::{PREFIX, Remotes};
use super::settings::WholeSamples;
use crate::graph::{GraphError, GraphResult};
use wrapyfi_endpoint::Mutex;

/// Longest time that a write waits for reliable peers that do not keep up.
pub(super) use crate::vendor::RUST_SERVICES_BLOCKING as MAX_BLOCKING;

/// Longest time that an end which leaves waits for its last samples to arrive.
const FAREWELL: Duration = Duration::from_millis(100);
/// RustDDS tells of a match before it counts the new reader among those that are to acknowledge: so
/// long after a write its answer to whether all have done so means nothing.
const SETTLE: Duration = Duration::from_millis(20);

/// Writes serialised messages.
pub(super) type Writer = DataWriter<Bytes, RawCdr>;

/// The related sample identity of a message that is to be written.
///
/// RustDDS 0.15 puts a byte too many in front of the inline QoS of a sample that it cuts into
/// fragments: no program reads it, and a debug build of it panics. So it is given one with whole samples
/// only; see [`large`](super::large) for the others.
#[derive(Debug, Clone, Copy)]
pub(super) enum Identity {
    /// Left out of what is not sent whole: a request is named by its sample then.
    IfWhole(SampleIdentity),
    /// Without it the message is of no use.
    Always(SampleIdentity),
}

/// The writer of one end, and what it has sent.
pub(super) struct Outgoing {
    service: String,
    whole: WholeSamples,
    pub(super) writer: Writer,
    sent: Mutex<Sent>,
}

impl Outgoing {
    pub(super) fn new(service: &str, whole: WholeSamples, writer: Writer) -> Self {
        Self { service: service.to_owned(), whole, writer, sent: Mutex::default() }
    }

    /// Writes one message, given in pieces. Its number.
    pub(super) fn write(
        &self,
        parts: &[&[u8]],
        identity: Identity,
        remotes: &Mutex<Remotes>,
    ) -> GraphResult<i64> {
        let body = adapter::body(parts)
            .map_err(|error| GraphError::stack("writing", &self.service, &error))?;
        let mut sent = self.sent.lock();
        if let Some(owed) = sent.owed.take() {
            sent.owed = Some(owed.clone());
            self.give(&mut sent, owed, None, Timestamp::now())?;
            sent.owed = None;
        }
        let size = body.len().saturating_add(CDR_LE.len());
        let limit = self.whole_bytes(size, remotes);
        let related = match identity {
            Identity::IfWhole(identity) => (size <= limit).then_some(identity),
            Identity::Always(identity) if size <= limit => Some(identity),
            Identity::Always(identity) => {
                return self.write_large(&mut sent, body, (size, limit), identity, remotes);
            }
        };
        self.give(&mut sent, body, related, Timestamp::now())
    }

    /// Gives RustDDS a sample; its number.
    fn give(
        &self,
        sent: &mut Sent,
        body: Bytes,
        related: Option<SampleIdentity>,
        stamp: Timestamp,
    ) -> GraphResult<i64> {
        let options = WriteOptionsBuilder::new()
            .source_timestamp(stamp)
            .related_sample_identity_opt(related)
            .build();
        match self.writer.write_with_options(body, options) {
            Ok(sample) => {
                let number = sample.sequence_number.into();
                sent.last = Some((number, Instant::now()));
                Ok(number)
            }
            Err(WriteError::WouldBlock { .. }) => Err(GraphError::Timeout {
                topic: self.service.clone(),
                timeout_ms: u64::try_from(MAX_BLOCKING.as_millis()).unwrap_or(u64::MAX),
            }),
            Err(error) => Err(GraphError::stack("writing", &self.service, &error)),
        }
    }

    /// Writes a sample that does not stay whole, with its identity.
    fn write_large(
        &self,
        sent: &mut Sent,
        body: Bytes,
        (size, limit): (usize, usize),
        identity: SampleIdentity,
        remotes: &Mutex<Remotes>,
    ) -> GraphResult<i64> {
        let refused =
            |error: UnsendableReply| Err(GraphError::stack("writing", &self.service, &error));
        if size > MAX_LARGE {
            return refused(UnsendableReply::TooLarge { size, limit: MAX_LARGE });
        }
        let client = identity.writer_guid.to_bytes();
        let readers = self.addressed(remotes);
        let beside = |known: &Addressed| {
            known.reader == client || known.reader.starts_with(client.get(..PREFIX).unwrap_or(&[]))
        };
        if !readers.iter().any(beside) {
            return refused(UnsendableReply::NoAddress { size, limit });
        }
        let (number, stamp) = (sent.next(), Timestamp::now());
        let sample = Identified {
            writer: self.writer.guid().to_bytes(),
            number,
            related: (client, identity.sequence_number.into()),
            stamp: stamp.to_ticks(),
            body: &body,
        };
        large::send(&sample, &readers)
            .map_err(|error| GraphError::stack("sending", &self.service, &error))?;
        match self.give(sent, body.clone(), None, stamp) {
            // The readers have it, but nothing is repeated yet.
            Err(GraphError::Timeout { .. }) => sent.owed = Some(body),
            Ok(given) if given != number => {
                tracing::error!(service = self.service, number, given, "a reply was misnumbered");
            }
            result => return result,
        }
        Ok(number)
    }

    /// The readers matched with our writer that announce where they listen.
    fn addressed(&self, remotes: &Mutex<Remotes>) -> Vec<Addressed> {
        let Some(dds) = self.writer.publisher().participant() else { return Vec::new() };
        let remotes = remotes.lock();
        let readers = dds.discovered_readers();
        let addressed = readers.iter().filter_map(|known| {
            let reader = known.reader_proxy.remote_reader_guid.to_bytes();
            let locators = known.reader_proxy.unicast_locator_list.iter();
            let addresses: Vec<SocketAddr> = locators
                .filter(|locator| locator.is_udp())
                .map(|locator| SocketAddr::from(*locator))
                .filter(SocketAddr::is_ipv4)
                .collect();
            let near = addresses.iter().all(|address| address.ip().is_loopback());
            let room = self.whole.datagram(near);
            let heard = remotes.has_reader(&reader) && !addresses.is_empty();
            heard.then_some(Addressed { reader, addresses, room })
        });
        addressed.collect()
    }

    /// Waits a moment for what was written to arrive. RustDDS hands messages to a thread of its own,
    /// and ends a writer without sending what waits there.
    pub(super) fn farewell(&self) {
        let Some((_, wrote)) = self.sent.lock().last else { return };
        std::thread::sleep(SETTLE.saturating_sub(wrote.elapsed()));
        match self.writer.wait_for_acknowledgments(FAREWELL) {
            Ok(true) => {}
            Ok(false) => tracing::debug!(service = self.service, "the last was not acknowledged"),
            Err(error) => {
                tracing::debug!(service = self.service, %error, "waiting for acknowledgements");
            }
        }
    }

    /// Bytes up to which a sample of `size` bytes is sent to all matched readers in one piece.
    fn whole_bytes(&self, size: usize, remotes: &Mutex<Remotes>) -> usize {
        if size <= self.whole.anywhere {
            return self.whole.anywhere;
        }
        let Some(dds) = self.writer.publisher().participant() else { return self.whole.anywhere };
        let discovered = dds.discovered_readers();
        let remotes = remotes.lock();
        let mut near = discovered
            .iter()
            .filter(|known| remotes.has_reader(&known.reader_proxy.remote_reader_guid.to_bytes()))
            .map(|known| {
                let addresses = &known.reader_proxy.unicast_locator_list;
                !addresses.is_empty() && !addresses.iter().any(|address| !address.is_loopback())
            })
            .peekable();
        if near.peek().is_some() && near.all(|near| near) {
            self.whole.loopback
        } else {
            self.whole.anywhere
        }
    }
}
