//! Cyclone's QoS object, filled from ours.
//!
//! ```text
//!   EndpointQos ── for_writer / for_reader ──▶ QosObject ──▶ dds_create_…
//! ```
//!
//! Contract: the object is created, filled and freed here; calls that take it copy it.
#![allow(unsafe_code)]

use std::time::Duration;

use crate::endpoint::{Durability, History, Qos, Reliability};

/// What an endpoint asks for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EndpointQos<'a> {
    /// Reliability, durability, history.
    pub(crate) qos: Qos,
    /// How long a write waits for reliable readers.
    pub(crate) max_blocking: Duration,
    /// USER_DATA, for the type hash.
    pub(crate) user_data: &'a str,
}

/// Owns a `dds_qos_t`.
pub(super) struct QosObject(*mut cyclors::dds_qos_t);

impl QosObject {
    fn new() -> Self {
        // SAFETY: allocates; Cyclone aborts rather than return null.
        Self(unsafe { cyclors::dds_create_qos() })
    }

    /// Nothing but USER_DATA.
    pub(super) fn with_user_data(user_data: &str) -> Self {
        let qos = Self::new();
        // SAFETY: the bytes are read during the call and copied.
        unsafe { cyclors::dds_qset_userdata(qos.0, user_data.as_ptr().cast(), user_data.len()) };
        qos
    }

    /// QoS of a reader.
    pub(super) fn for_reader(wanted: &EndpointQos<'_>) -> Self {
        let qos = Self::with_user_data(wanted.user_data);
        let reliability = match wanted.qos.reliability {
            Reliability::Reliable => cyclors::dds_reliability_kind_DDS_RELIABILITY_RELIABLE,
            Reliability::BestEffort => cyclors::dds_reliability_kind_DDS_RELIABILITY_BEST_EFFORT,
        };
        let durability = match wanted.qos.durability {
            Durability::Volatile => cyclors::dds_durability_kind_DDS_DURABILITY_VOLATILE,
            Durability::TransientLocal => {
                cyclors::dds_durability_kind_DDS_DURABILITY_TRANSIENT_LOCAL
            }
        };
        let (kind, depth) = history(wanted.qos.history);
        let max_blocking = i64::try_from(wanted.max_blocking.as_nanos()).unwrap_or(i64::MAX);
        // SAFETY: plain values into an object this type owns.
        unsafe {
            cyclors::dds_qset_reliability(qos.0, reliability, max_blocking);
            cyclors::dds_qset_durability(qos.0, durability);
            cyclors::dds_qset_history(qos.0, kind, depth);
            // A node does not hear itself: this is what keeps routes from looping.
            cyclors::dds_qset_ignorelocal(
                qos.0,
                cyclors::dds_ignorelocal_kind_DDS_IGNORELOCAL_PARTICIPANT,
            );
        }
        qos
    }

    /// QoS of a writer: a reader's, and what late readers are given.
    pub(super) fn for_writer(wanted: &EndpointQos<'_>) -> Self {
        let qos = Self::for_reader(wanted);
        let (kind, depth) = history(wanted.qos.history);
        let any = cyclors::DDS_LENGTH_UNLIMITED;
        // SAFETY: as above.
        unsafe {
            // Disposing has no meaning on topics without keys.
            cyclors::dds_qset_writer_data_lifecycle(qos.0, false);
            if wanted.qos.durability == Durability::TransientLocal {
                cyclors::dds_qset_durability_service(qos.0, 0, kind, depth, any, any, any);
            }
        }
        qos
    }

    /// For calls that copy it.
    pub(super) fn as_ptr(&self) -> *const cyclors::dds_qos_t {
        self.0
    }
}

impl Drop for QosObject {
    fn drop(&mut self) {
        // SAFETY: created in `new`, freed once.
        unsafe { cyclors::dds_delete_qos(self.0) };
    }
}

fn history(history: History) -> (cyclors::dds_history_kind_t, i32) {
    match history {
        History::KeepLast(depth) => (
            cyclors::dds_history_kind_DDS_HISTORY_KEEP_LAST,
            i32::try_from(depth.max(1)).unwrap_or(i32::MAX),
        ),
        History::KeepAll => {
            (cyclors::dds_history_kind_DDS_HISTORY_KEEP_ALL, cyclors::DDS_LENGTH_UNLIMITED)
        }
    }
}
