//! One end of a service: a writer and a reader, and whom they are matched with.
//!
//! ```text
//!   client   Pair { requests: writer ─▶ rq/…Request,  replies: reader ◀─ rr/…Reply }
//!   server   Pair { requests: reader ◀─ rq/…Request,  replies: writer ─▶ rr/…Reply }
//!                     ▲ matches, arrivals: watch
//! ```

use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::pin;
use std::task::{Context, Poll, Waker};

use futures_core::Stream as _;
use rustdds::no_key::{DeserializedCacheChange, SimpleDataReader};
use rustdds::rpc::SampleIdentity;
use rustdds::{DataReaderStatus, DataWriterStatus, RTPSEntity as _, StatusEvented as _, Timestamp};

use super::adapter::{RawCdr, Received, Within};
use super::outgoing::{Identity, Outgoing, Writer};
use super::remotes::{PREFIX, Remotes};
use super::settings::WholeSamples;
use crate::discovery_info::Gid;
use crate::gaps::Gaps;
use crate::graph::{GraphError, Notify, ServiceDescription};
use wrapyfi_endpoint::Mutex;

/// Disposals in a row that one call passes over. RustDDS says of a disposal what it says of an
/// empty reader, so that the sample behind it is looked for by asking again.
const DISPOSALS: usize = 8;

/// Takes serialised messages.
pub(super) type Reader = SimpleDataReader<Received, RawCdr>;

/// A writer and a reader of one service.
pub(super) struct Pair {
    pub(super) service: String,
    pub(super) max_bytes: usize,
    pub(super) outgoing: Outgoing,
    reader: Reader,
    notify: Notify,
    /// Remote endpoints that the two are matched with.
    pub(super) remotes: Mutex<Remotes>,
    gaps: Mutex<Gaps<Gid>>,
}

/// A message as its reader takes it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Taken {
    /// GUID of the writer.
    pub(super) writer: Gid,
    /// Number that the writer gave it.
    pub(super) number: i64,
    /// Related sample identity, where it has one.
    pub(super) related: Option<SampleIdentity>,
    /// The message, or its size.
    pub(super) received: Received,
    /// Source timestamp in nanoseconds since 1970; of reception where the writer sent none.
    pub(super) source_timestamp_ns: i64,
}

impl Pair {
    pub(super) fn new(
        service: &ServiceDescription,
        whole: WholeSamples,
        (writer, reader): (Writer, Reader),
        notify: Notify,
    ) -> Self {
        let pair = Self {
            service: service.name.clone(),
            max_bytes: service.max_bytes,
            outgoing: Outgoing::new(&service.name, whole, writer),
            reader,
            notify,
            remotes: Mutex::default(),
            gaps: Mutex::default(),
        };
        pair.forget();
        pair
    }

    /// RustDDS keeps samples by topic and participant: what an earlier reader of the participant
    /// was given would be given again.
    fn forget(&self) {
        while !matches!(self.reader.try_take_one_with(Within { limit: 0 }), Ok(None)) {}
    }

    pub(super) fn writer_guid(&self) -> rustdds::GUID {
        self.outgoing.writer.guid()
    }

    pub(super) fn reader_guid(&self) -> rustdds::GUID {
        self.reader.guid()
    }

    /// Samples lost since the last call.
    pub(super) fn take_lost(&self) -> u64 {
        self.gaps.lock().take()
    }

    /// Writes one message, given in pieces. Its number.
    pub(super) fn write(&self, parts: &[&[u8]], identity: Identity) -> Result<i64, GraphError> {
        self.outgoing.write(parts, identity, &self.remotes)
    }

    /// The next message, if one waits.
    pub(super) fn take(&self) -> Result<Option<Taken>, GraphError> {
        for _ in 0..DISPOSALS {
            match self.reader.try_take_one_with(Within { limit: self.max_bytes }) {
                Ok(Some(sample)) => return Ok(Some(self.taken(sample))),
                Ok(None) => {}
                Err(error) => return Err(GraphError::stack("taking", &self.service, &error)),
            }
        }
        Ok(None)
    }

    fn taken(&self, sample: DeserializedCacheChange<Received>) -> Taken {
        let (writer, number) = (sample.writer_guid().to_bytes(), i64::from(sample.sequence_number));
        self.gaps.lock().note(writer, number);
        let stamp = sample.source_timestamp().unwrap_or(sample.receive_instant);
        Taken {
            writer,
            number,
            related: sample.related_sample_identity(),
            received: sample.into_value(),
            source_timestamp_ns: nanoseconds(stamp),
        }
    }

    /// Forgets an endpoint that discovery has lost; true when it was matched.
    pub(super) fn remote_lost(&self, gid: &Gid) -> bool {
        self.gaps.lock().retain(|known| known != gid);
        self.remotes.lock().remove(gid)
    }

    /// Forgets the endpoints of a participant that discovery has lost.
    pub(super) fn participant_lost(&self, prefix: &[u8]) -> bool {
        self.gaps.lock().retain(|gid| !gid.starts_with(prefix));
        self.remotes.lock().retain(|gid| !gid.starts_with(prefix))
    }

    /// Forgets the endpoints of others that discovery does not know any more; true when there were
    /// some. Discovery is read after the events were: it forgets an endpoint before it says that it
    /// is lost.
    pub(super) fn forget_ghosts(&self, discovered: &BTreeSet<Gid>) -> bool {
        // Those of our own participant are not discovered.
        let own = self.writer_guid().to_bytes();
        let stays = |gid: &Gid| {
            gid.first_chunk::<PREFIX>() == own.first_chunk::<PREFIX>() || discovered.contains(gid)
        };
        self.gaps.lock().retain(stays);
        self.remotes.lock().retain(stays)
    }

    /// The readers and writers of others that discovery knows now.
    pub(super) fn discovered(&self) -> Option<BTreeSet<Gid>> {
        let dds = self.outgoing.writer.publisher().participant()?;
        let readers = dds.discovered_readers();
        let readers = readers.iter().map(|known| known.reader_proxy.remote_reader_guid);
        let writers = dds.discovered_writers();
        let writers = writers.iter().map(|known| known.writer_proxy.remote_writer_guid);
        Some(readers.chain(writers).map(|guid| guid.to_bytes()).collect())
    }

    /// A remote reader has matched our writer.
    pub(super) fn reader_matched(&self, gid: Gid) {
        if !self.remotes.lock().add_reader(gid) {
            tracing::warn!(service = self.service, "too many readers: one is not kept");
        }
    }

    /// A remote writer has matched our reader.
    pub(super) fn writer_matched(&self, gid: Gid) {
        if !self.remotes.lock().add_writer(gid) {
            tracing::warn!(service = self.service, "too many writers: one is not kept");
        }
    }

    /// Readies the reader to signal what comes next.
    pub(super) fn on_data(&self) {
        self.reader.drain_read_notifications();
    }

    /// Reads what RustDDS has to say about the reader.
    pub(super) fn on_reader_status(&self) {
        while let Some(status) = self.reader.try_recv_status() {
            match status {
                DataReaderStatus::SubscriptionMatched { writer, current, .. } => {
                    if current.count_change() > 0 {
                        self.writer_matched(writer.to_bytes());
                    } else {
                        self.remote_lost(&writer.to_bytes());
                    }
                }
                DataReaderStatus::RequestedIncompatibleQos { last_policy_id, .. } => {
                    self.refused("a writer", &last_policy_id);
                }
                DataReaderStatus::SampleLost { .. }
                | DataReaderStatus::SampleRejected { .. }
                | DataReaderStatus::LivelinessChanged { .. }
                | DataReaderStatus::RequestedDeadlineMissed { .. } => {}
            }
        }
    }

    /// Reads what RustDDS has to say about the writer; false where the loop that would say more has ended.
    pub(super) fn on_writer_status(&self) -> bool {
        let mut statuses = pin!(self.outgoing.writer.as_async_status_stream());
        let mut context = Context::from_waker(Waker::noop());
        loop {
            let status = match statuses.as_mut().poll_next(&mut context) {
                Poll::Ready(Some(status)) => status,
                Poll::Ready(None) => return false,
                Poll::Pending => return true,
            };
            match status {
                DataWriterStatus::PublicationMatched { reader, current, .. } => {
                    if current.count_change() > 0 {
                        self.reader_matched(reader.to_bytes());
                    } else {
                        self.remote_lost(&reader.to_bytes());
                    }
                }
                DataWriterStatus::OfferedIncompatibleQos { last_policy_id, .. } => {
                    self.refused("a reader", &last_policy_id);
                }
                DataWriterStatus::LivelinessLost { .. }
                | DataWriterStatus::OfferedDeadlineMissed { .. } => {}
            }
        }
    }

    /// Tells the owner to look. No lock is held.
    pub(super) fn ring(&self) {
        if catch_unwind(AssertUnwindSafe(|| (self.notify)())).is_err() {
            tracing::error!(service = self.service, "a callback for events of a service panicked");
        }
    }

    fn refused(&self, peer: &str, policy: &impl std::fmt::Debug) {
        tracing::warn!(
            service = self.service,
            ?policy,
            "{peer} does not match, its quality of service is incompatible: services are reliable \
             and volatile"
        );
    }
}

/// RTPS counts seconds and 2^-32 seconds.
fn nanoseconds(stamp: Timestamp) -> i64 {
    let ns = (u128::from(stamp.to_ticks()) * 1_000_000_000) >> 32;
    i64::try_from(ns).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timestamps_are_nanoseconds() {
        let ticks = |seconds: u64, fraction: u64| Timestamp::from_ticks((seconds << 32) + fraction);
        assert_eq!(nanoseconds(ticks(1, 0)), 1_000_000_000);
        assert_eq!(nanoseconds(ticks(1_795_215_773, 1 << 31)), 1_795_215_773_500_000_000);
        assert_eq!(nanoseconds(Timestamp::INVALID), 4_294_967_295_999_999_999);
    }
}
