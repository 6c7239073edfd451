//! The participants and endpoints that discovery has found, from Cyclone's built-in topics.
//!
//! ```text
//!   DCPSParticipant ── take all ──▶ first bytes of its GUID
//!   DCPSPublication, DCPSSubscription ── take all ──▶ EndpointFound { guid, topic, type, … }
//!                          │ listener
//!                          └─▶ notify, then BuiltinReader::take ──▶ found, or gone
//! ```
//!
//! Contract: samples are lent by Cyclone and returned before the call ends; what leaves this
//! module is copied.
#![allow(unsafe_code)]

use std::ffi::{CStr, c_char, c_void};
use std::ptr;
use std::sync::Arc;

use super::entity::{Entity, ReturnCode};
use super::events::{Events, Listener, silence};
use super::qos::{announced, max_blocking};
use crate::graph::{Notify, ServiceMapping};
use crate::vendor;
use wrapyfi_endpoint::{AnnouncedQos, Reliability};

/// Samples taken at once.
const BATCH: usize = 32;

/// An endpoint known to the participant, its own ones included.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct EndpointFound {
    /// True for writers.
    pub(crate) is_writer: bool,
    /// GUID.
    pub(crate) guid: [u8; 16],
    /// DDS topic.
    pub(crate) topic: String,
    /// DDS type.
    pub(crate) type_name: String,
    /// USER_DATA.
    pub(crate) user_data: Vec<u8>,
    /// The policies it announces.
    pub(crate) qos: AnnouncedQos,
    /// Form in which its owner maps services to DDS, where that is known.
    pub(crate) service_mapping: Option<ServiceMapping>,
}

impl EndpointFound {
    /// Copies what Cyclone tells of an endpoint.
    ///
    /// # Safety
    /// Names and QoS of `found` are alive: null, or NUL-terminated and a QoS object.
    pub(super) unsafe fn copy(
        is_writer: bool,
        found: &cyclors::dds_builtintopic_endpoint_t,
    ) -> Self {
        // SAFETY: by contract.
        unsafe {
            Self {
                is_writer,
                guid: found.key.v,
                topic: text(found.topic_name),
                type_name: text(found.type_name),
                user_data: user_data(found.qos),
                qos: announced(found.qos),
                service_mapping: vendor::mapping_of(&found.key.v, max_blocking(found.qos)),
            }
        }
    }
}

/// First twelve bytes of the GUIDs of all participants alive now, the own ones included.
pub(crate) fn participants(participant: &Entity) -> Result<Vec<[u8; 12]>, ReturnCode> {
    let reader = reader(participant, cyclors::DDS_BUILTIN_TOPIC_DCPSPARTICIPANT, ptr::null())?;
    let mut found = Vec::new();
    let mut each = |_, one: Option<&cyclors::dds_builtintopic_participant_t>| {
        found.extend(one.and_then(|one| one.key.v.first_chunk::<12>().copied()));
    };
    // SAFETY: samples of that topic are of that type.
    while unsafe { take_lent(&reader, &mut each) }? {}
    Ok(found)
}

/// All endpoints alive now.
pub(crate) fn endpoints(participant: &Entity) -> Result<Vec<EndpointFound>, ReturnCode> {
    let mut found = Vec::new();
    for is_writer in [true, false] {
        let reader = reader(participant, builtin_topic(is_writer), ptr::null())?;
        while take_batch(&reader, is_writer, &mut |_, endpoint| found.extend(endpoint))? {}
    }
    Ok(found)
}

/// Hears of endpoints that come, change and go.
///
/// Fields drop in this order: the reader before what its listener points to.
pub(crate) struct BuiltinReader {
    reader: Entity,
    is_writer: bool,
    events: Arc<Events>,
}

impl BuiltinReader {
    /// Reader of all writers, or of all readers. `notify` is called from a DDS thread when
    /// something waits, also for endpoints that exist already, and possibly before this returns.
    pub(crate) fn new(
        participant: &Entity,
        is_writer: bool,
        notify: Notify,
    ) -> Result<Self, ReturnCode> {
        let events = Events::new("DCPS", Reliability::Reliable, notify);
        let listener = Listener::for_news(&events);
        // `events` outlives the reader.
        let reader = reader(participant, builtin_topic(is_writer), listener.as_ptr())?;
        Ok(Self { reader, is_writer, events })
    }

    /// Takes what waits: every endpoint with its number, `None` for one that is gone. The number is
    /// the one that samples carry as their publisher's.
    pub(crate) fn take(
        &self,
        mut each: impl FnMut(u64, Option<EndpointFound>),
    ) -> Result<(), ReturnCode> {
        while take_batch(&self.reader, self.is_writer, &mut each)? {}
        Ok(())
    }
}

impl Drop for BuiltinReader {
    fn drop(&mut self) {
        silence(self.reader.handle(), &self.events);
    }
}

/// A reader of a built-in topic, with a listener or null.
fn reader(
    participant: &Entity,
    topic: i32,
    listener: *const cyclors::dds_listener_t,
) -> Result<Entity, ReturnCode> {
    // SAFETY: default QoS; the pseudo-topic exists in every participant; a listener is copied by the call.
    Entity::adopt(unsafe {
        cyclors::dds_create_reader(participant.handle(), topic, ptr::null(), listener)
    })
}

fn builtin_topic(is_writer: bool) -> i32 {
    if is_writer {
        cyclors::DDS_BUILTIN_TOPIC_DCPSPUBLICATION
    } else {
        cyclors::DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION
    }
}

/// Samples on loan, which go back on drop: also where a callback panics, because Cyclone keeps what is lent until
/// it comes back.
struct Loan<'a> {
    reader: &'a Entity,
    samples: [*mut c_void; BATCH],
    taken: i32,
}

impl Drop for Loan<'_> {
    fn drop(&mut self) {
        if self.taken == 0 {
            return;
        }
        let (reader, samples) = (self.reader.handle(), self.samples.as_mut_ptr());
        // SAFETY: returns exactly what was lent.
        let code = unsafe { cyclors::dds_return_loan(reader, samples, self.taken) };
        if let Err(error) = ReturnCode::check(code) {
            tracing::warn!(%error, "CycloneDDS did not take back what it lent: memory grows");
        }
    }
}

/// Takes one batch of endpoints; false when nothing is left.
fn take_batch(
    reader: &Entity,
    is_writer: bool,
    each: &mut impl FnMut(u64, Option<EndpointFound>),
) -> Result<bool, ReturnCode> {
    let mut lent = |number, endpoint: Option<&cyclors::dds_builtintopic_endpoint_t>| {
        let Some(endpoint) = endpoint else { return each(number, None) };
        // SAFETY: lent until this returns.
        let found = unsafe { EndpointFound::copy(is_writer, endpoint) };
        // The readers with which we look are not on the wire.
        if !found.topic.starts_with("DCPS") {
            each(number, Some(found));
        }
    };
    // SAFETY: samples of these topics are of this type.
    unsafe { take_lent(reader, &mut lent) }
}

/// Takes one batch, each sample with its number, `None` for one that is gone; false when nothing is left.
///
/// # Safety
/// Samples of the reader's topic are `T`s.
unsafe fn take_lent<T>(
    reader: &Entity,
    each: &mut impl FnMut(u64, Option<&T>),
) -> Result<bool, ReturnCode> {
    let mut loan = Loan { reader, samples: [ptr::null_mut(); BATCH], taken: 0 };
    // SAFETY: plain numbers, for which zeros are valid.
    let mut infos: [cyclors::dds_sample_info_t; BATCH] = unsafe { std::mem::zeroed() };
    // SAFETY: room for BATCH samples and infos; null pointers ask Cyclone to lend the samples.
    loan.taken = ReturnCode::check(unsafe {
        cyclors::dds_take(
            reader.handle(),
            loan.samples.as_mut_ptr(),
            infos.as_mut_ptr(),
            BATCH,
            u32::try_from(BATCH).unwrap_or(1),
        )
    })?;
    let taken = usize::try_from(loan.taken).unwrap_or(0);
    for (sample, info) in loan.samples.iter().zip(&infos).take(taken) {
        let alive = info.instance_state == cyclors::dds_instance_state_DDS_IST_ALIVE;
        // SAFETY: of this type by contract, and lent until returned below.
        match unsafe { sample.cast::<T>().as_ref() } {
            Some(found) if alive && info.valid_data => each(info.instance_handle, Some(found)),
            _ if !alive => each(info.instance_handle, None),
            _ => {}
        }
    }
    Ok(taken > 0)
}

/// # Safety
/// `name` is null or NUL-terminated and alive.
unsafe fn text(name: *const c_char) -> String {
    if name.is_null() {
        return String::new();
    }
    // SAFETY: by contract.
    unsafe { CStr::from_ptr(name) }.to_string_lossy().into_owned()
}

/// USER_DATA of a QoS object.
///
/// # Safety
/// `qos` is null or a QoS object that is alive.
unsafe fn user_data(qos: *const cyclors::dds_qos_t) -> Vec<u8> {
    let mut data: *mut c_void = ptr::null_mut();
    let mut bytes = 0;
    // SAFETY: by contract; the call copies the data into memory that we free.
    if qos.is_null() || !unsafe { cyclors::dds_qget_userdata(qos, &raw mut data, &raw mut bytes) } {
        return Vec::new();
    }
    if data.is_null() {
        return Vec::new();
    }
    // SAFETY: `bytes` bytes were allocated and filled.
    let copy = unsafe { std::slice::from_raw_parts(data.cast::<u8>(), bytes) }.to_vec();
    // SAFETY: allocated by Cyclone, freed once.
    unsafe { cyclors::dds_free(data) };
    copy
}
