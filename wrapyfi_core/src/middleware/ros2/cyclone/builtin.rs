//! The endpoints that discovery has found, from Cyclone's built-in topics.
//!
//! ```text
//!   DCPSPublication, DCPSSubscription ── take all ──▶ EndpointFound { guid, topic, type, … }
//! ```
//!
//! Contract: samples are lent by Cyclone and returned before the call ends; what leaves this
//! module is copied.
#![allow(unsafe_code)]

use std::ffi::{CStr, c_char, c_void};
use std::ptr;

use super::entity::{Entity, ReturnCode};
use super::qos::announced;
use crate::endpoint::AnnouncedQos;

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
}

/// All endpoints alive now.
pub(crate) fn endpoints(participant: &Entity) -> Result<Vec<EndpointFound>, ReturnCode> {
    let mut found = Vec::new();
    for (topic, is_writer) in [
        (cyclors::DDS_BUILTIN_TOPIC_DCPSPUBLICATION, true),
        (cyclors::DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION, false),
    ] {
        // SAFETY: default QoS, no listener; the pseudo-topic exists in every participant.
        let reader = Entity::adopt(unsafe {
            cyclors::dds_create_reader(participant.handle(), topic, ptr::null(), ptr::null())
        })?;
        while take_batch(&reader, is_writer, &mut found)? {}
    }
    Ok(found)
}

/// Takes one batch; false when nothing is left.
fn take_batch(
    reader: &Entity,
    is_writer: bool,
    found: &mut Vec<EndpointFound>,
) -> Result<bool, ReturnCode> {
    let mut samples: [*mut c_void; BATCH] = [ptr::null_mut(); BATCH];
    // SAFETY: plain numbers, for which zeros are valid.
    let mut infos: [cyclors::dds_sample_info_t; BATCH] = unsafe { std::mem::zeroed() };
    // SAFETY: room for BATCH samples and infos; null pointers ask Cyclone to lend the samples.
    let taken = ReturnCode::check(unsafe {
        cyclors::dds_take(
            reader.handle(),
            samples.as_mut_ptr(),
            infos.as_mut_ptr(),
            BATCH,
            u32::try_from(BATCH).unwrap_or(1),
        )
    })?;
    if taken == 0 {
        return Ok(false);
    }
    for (sample, info) in samples.iter().zip(&infos).take(usize::try_from(taken).unwrap_or(0)) {
        // SAFETY: samples of these topics are of this type and lent until returned below.
        let endpoint = unsafe { sample.cast::<cyclors::dds_builtintopic_endpoint_t>().as_ref() };
        if let (true, Some(endpoint)) = (info.valid_data, endpoint) {
            // SAFETY: names are null or NUL-terminated.
            let (topic, type_name) =
                unsafe { (text(endpoint.topic_name), text(endpoint.type_name)) };
            // The reader with which we look is not on the wire.
            if topic.starts_with("DCPS") {
                continue;
            }
            found.push(EndpointFound {
                is_writer,
                guid: endpoint.key.v,
                topic,
                type_name,
                // SAFETY: the QoS belongs to the lent sample.
                user_data: unsafe { user_data(endpoint.qos) },
                // SAFETY: as above.
                qos: unsafe { announced(endpoint.qos) },
            });
        }
    }
    // SAFETY: returns exactly what was lent.
    ReturnCode::check(unsafe {
        cyclors::dds_return_loan(reader.handle(), samples.as_mut_ptr(), taken)
    })?;
    Ok(true)
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
pub(super) unsafe fn user_data(qos: *const cyclors::dds_qos_t) -> Vec<u8> {
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
