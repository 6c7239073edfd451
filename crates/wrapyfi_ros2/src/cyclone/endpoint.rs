//! Writers and readers of serialised messages.
//!
//! ```text
//!   RawWriter.write(pieces) ─▶ serdata ─▶ dds_writecdr        RawReader.take() ◀─ dds_takecdr
//!        │                                                        │
//!      Endpoint { entity, topic, events }: listener cleared, then deleted, then events freed
//! ```
//!
//! Contract: calls use the endpoint's own handles; samples are owned by [`Sample`] from the moment
//! a call returns them.
#![allow(unsafe_code)]

use std::ffi::c_void;
use std::mem::MaybeUninit;
use std::ptr;
use std::sync::Arc;
use std::time::Duration;

use super::builtin::EndpointFound;
use super::entity::{Entity, ReturnCode};
use super::events::{Events, Listener, silence};
use super::matched::{self, Side};
use super::qos::{EndpointQos, QosObject};
use super::serdata::Sample;
use super::spacing;
use crate::gaps::Gaps;
use crate::graph::CdrSample;

/// Call that creates a writer or a reader.
type Create = unsafe extern "C" fn(
    cyclors::dds_entity_t,
    cyclors::dds_entity_t,
    *const cyclors::dds_qos_t,
    *const cyclors::dds_listener_t,
) -> cyclors::dds_entity_t;

// Functions that Cyclone keeps to itself: `dds_wait_for_acks` is made of them, and says of all readers what the second
// one says of a single one. They are as in `dds__entity.h` and `dds__writer.h` of the one version of `cyclors` that
// Cargo.toml allows; the GUID has four words in the byte order of this machine.
unsafe extern "C" {
    fn dds_entity_pin(handle: cyclors::dds_entity_t, entity: *mut *mut c_void) -> i32;
    fn dds__ddsi_writer_wait_for_acks(
        writer: *mut c_void,
        reader: *const u32,
        until: cyclors::ddsrt_mtime_t,
    ) -> i32;
    fn dds_entity_unpin(entity: *mut c_void);
}

/// Fields drop in this order: the entity before its topic, both before the events.
struct Endpoint {
    entity: Entity,
    _topic: Entity,
    events: Arc<Events>,
}

impl Endpoint {
    /// An endpoint of `topic`, a DDS topic and type name.
    fn new(
        create: Create,
        participant: &Entity,
        topic: (&str, &str),
        qos: &QosObject,
        listener: &Listener,
        events: Arc<Events>,
    ) -> Result<Self, ReturnCode> {
        let topic = participant.topic(topic.0, topic.1)?;
        let (participant, topic_handle) = (participant.handle(), topic.handle());
        // SAFETY: QoS and listener are copied by the call; `events` lives as long as the endpoint.
        let created = unsafe { create(participant, topic_handle, qos.as_ptr(), listener.as_ptr()) };
        Ok(Self { entity: Entity::adopt(created)?, _topic: topic, events })
    }
}

impl Drop for Endpoint {
    fn drop(&mut self) {
        silence(self.entity.handle(), &self.events);
    }
}

/// Writes serialised messages.
pub(crate) struct RawWriter(Endpoint);

/// Error of a write.
#[derive(Debug)]
pub(crate) enum WriteFault {
    /// Cyclone's word.
    Code(ReturnCode),
    /// Ours.
    Message(String),
}

impl From<ReturnCode> for WriteFault {
    fn from(code: ReturnCode) -> Self {
        Self::Code(code)
    }
}

impl RawWriter {
    /// A writer of `topic`, a DDS topic and type name.
    pub(crate) fn new(
        participant: &Entity,
        topic: (&str, &str),
        qos: &EndpointQos<'_>,
        events: Arc<Events>,
    ) -> Result<Self, ReturnCode> {
        let (qos, listener) = (QosObject::for_writer(qos), Listener::for_writer(&events));
        let create = cyclors::dds_create_writer;
        Endpoint::new(create, participant, topic, &qos, &listener, events).map(Self)
    }

    /// Writes the message made of `parts`.
    pub(crate) fn write(&self, parts: &[&[u8]]) -> Result<(), WriteFault> {
        self.write_spaced(parts, None)
    }

    /// Writes the message made of `parts`; where it is longer than a fragment, with `pause` between two of them.
    pub(crate) fn write_spaced(
        &self,
        parts: &[&[u8]],
        pause: Option<Duration>,
    ) -> Result<(), WriteFault> {
        let (handle, sertype) = (self.0.entity.handle(), self.sertype()?);
        // SAFETY: the type of a writer that `self` keeps alive.
        let sample = unsafe { Sample::from_parts(sertype, parts) }.map_err(WriteFault::Message)?;
        // SAFETY: the call consumes the reference, also when it fails.
        let write = || unsafe { cyclors::dds_writecdr(handle, sample.into_raw()) };
        ReturnCode::check(spacing::spaced(pause, write))?;
        Ok(())
    }

    /// The type of the writer, which is valid while the writer lives.
    fn sertype(&self) -> Result<*const cyclors::ddsi_sertype, ReturnCode> {
        let mut sertype = ptr::null();
        let handle = self.0.entity.handle();
        // SAFETY: writes one pointer.
        ReturnCode::check(unsafe { cyclors::dds_get_entity_sertype(handle, &raw mut sertype) })?;
        Ok(sertype)
    }

    /// Writes a sample without data, so that [`RawWriter::all_acknowledged`] tells whether the
    /// readers matched now take part: a volatile reader passes over what was written before it
    /// heard of its writer, and neither side is told.
    pub(crate) fn write_without_data(&self) -> Result<(), WriteFault> {
        let (handle, sertype) = (self.0.entity.handle(), self.sertype()?);
        // SAFETY: the type of a writer that `self` keeps alive.
        let sample = unsafe { Sample::empty(sertype) }
            .ok_or_else(|| WriteFault::Message("no memory for a sample".to_owned()))?;
        // SAFETY: the call consumes the reference, also when it fails; it keeps status and time,
        // which `dds_writecdr` would reset.
        ReturnCode::check(unsafe { cyclors::dds_forwardcdr(handle, sample.into_raw()) })?;
        Ok(())
    }

    /// True when reliable readers have acknowledged every message. Never blocks.
    pub(crate) fn all_acknowledged(&self) -> bool {
        self.wait_for_acks(0).is_ok()
    }

    /// Waits until reliable readers have everything, at most `timeout_ns`.
    pub(crate) fn wait_for_acks(&self, timeout_ns: i64) -> Result<(), ReturnCode> {
        // SAFETY: plain values.
        ReturnCode::check(unsafe {
            cyclors::dds_wait_for_acks(self.0.entity.handle(), timeout_ns)
        })?;
        Ok(())
    }

    /// Waits until one reader has acknowledged every message, at most for `timeout`; true when it has, is best effort
    /// or is not matched.
    pub(crate) fn acknowledged_by(&self, reader: &[u8; 16], timeout: Duration) -> bool {
        let mut words = reader.as_chunks::<4>().0.iter().map(|&word| u32::from_be_bytes(word));
        let guid: [u32; 4] = std::array::from_fn(|_| words.next().unwrap_or(0));
        let timeout_ns = i64::try_from(timeout.as_nanos()).unwrap_or(i64::MAX);
        let mut entity = ptr::null_mut();
        // SAFETY: the handle is of a writer that `self` keeps alive, so that what is pinned is one; it is let go
        // again after the last use.
        unsafe {
            if ReturnCode::check(dds_entity_pin(self.0.entity.handle(), &raw mut entity)).is_err() {
                return true;
            }
            let now = cyclors::ddsrt_time_monotonic().v;
            let until = cyclors::ddsrt_mtime_t { v: now.saturating_add(timeout_ns) };
            let code = dds__ddsi_writer_wait_for_acks(entity, guid.as_ptr(), until);
            dds_entity_unpin(entity);
            ReturnCode::check(code).is_ok()
        }
    }

    /// The readers it is matched with.
    pub(crate) fn readers(&self) -> Result<Vec<EndpointFound>, ReturnCode> {
        matched::peers(&self.0.entity, Side::Writer)
    }

    /// GUID of the writer.
    pub(crate) fn guid(&self) -> Result<[u8; 16], ReturnCode> {
        self.0.entity.guid()
    }

    /// Counters of the events that Cyclone reported about the writer.
    pub(crate) fn events(&self) -> &Events {
        &self.0.events
    }
}

/// Takes serialised messages.
pub(crate) struct RawReader {
    endpoint: Endpoint,
    gaps: Gaps<u64>,
}

/// Result of taking one sample from a reader.
pub(crate) enum Taken {
    /// Nothing: no message waits.
    Nothing,
    /// A message, and the number that its writer gave it where it came from another process; its publisher is the
    /// handle of the writer, for [`RawReader::writer`].
    Message(CdrSample, Option<i64>),
    /// A message of so many bytes was over the limit and is gone.
    TooLarge(usize),
}

impl RawReader {
    /// A reader of `topic`, a DDS topic and type name.
    pub(crate) fn new(
        participant: &Entity,
        topic: (&str, &str),
        qos: &EndpointQos<'_>,
        events: Arc<Events>,
    ) -> Result<Self, ReturnCode> {
        let (qos, listener) = (QosObject::for_reader(qos), Listener::for_reader(&events));
        let create = cyclors::dds_create_reader;
        let endpoint = Endpoint::new(create, participant, topic, &qos, &listener, events)?;
        Ok(Self { endpoint, gaps: Gaps::default() })
    }

    /// The next message, unless it is larger than `max_bytes`.
    pub(crate) fn take(&mut self, max_bytes: usize) -> Result<Taken, ReturnCode> {
        loop {
            let mut serdata = ptr::null_mut();
            let mut info = MaybeUninit::<cyclors::dds_sample_info_t>::zeroed();
            // SAFETY: room for one sample and its info.
            let taken = ReturnCode::check(unsafe {
                cyclors::dds_takecdr(
                    self.endpoint.entity.handle(),
                    &raw mut serdata,
                    1,
                    info.as_mut_ptr(),
                    cyclors::DDS_ANY_STATE,
                )
            })?;
            if taken == 0 {
                return Ok(Taken::Nothing);
            }
            // SAFETY: one sample was taken; its reference is ours.
            let Some(sample) = (unsafe { Sample::adopt(serdata) }) else {
                return Ok(Taken::Nothing);
            };
            // SAFETY: filled by the call, and zeros are valid too.
            let info = unsafe { info.assume_init() };
            // News about an instance has no data and no size.
            if !info.valid_data {
                continue;
            }
            let number = sample.sequence();
            if let Some(number) = number {
                self.gaps.note(info.publication_handle, number);
            }
            let bytes = sample.len();
            return Ok(if bytes > max_bytes {
                Taken::TooLarge(bytes)
            } else {
                let (cdr, publisher) = (sample.into_bytes(), info.publication_handle);
                let source_timestamp_ns = info.source_timestamp;
                Taken::Message(CdrSample { cdr, source_timestamp_ns, publisher }, number)
            });
        }
    }

    /// Messages that were lost before those that were taken, since the last call.
    pub(crate) fn take_lost(&mut self) -> u64 {
        self.gaps.take()
    }

    /// The writers it is matched with.
    pub(crate) fn writers(&self) -> Result<Vec<EndpointFound>, ReturnCode> {
        matched::peers(&self.endpoint.entity, Side::Reader)
    }

    /// Handles of the matched writers, as their samples carry them.
    pub(crate) fn writer_handles(&self) -> Result<Vec<u64>, ReturnCode> {
        matched::handles(&self.endpoint.entity, Side::Reader)
    }

    /// The writer of a sample, while it is matched.
    pub(crate) fn writer(&self, handle: u64) -> Option<EndpointFound> {
        matched::peer(&self.endpoint.entity, Side::Reader, handle)
    }

    /// GUID of the reader.
    pub(crate) fn guid(&self) -> Result<[u8; 16], ReturnCode> {
        self.endpoint.entity.guid()
    }

    /// Counters of the events that Cyclone reported about the reader.
    pub(crate) fn events(&self) -> &Events {
        &self.endpoint.events
    }
}
