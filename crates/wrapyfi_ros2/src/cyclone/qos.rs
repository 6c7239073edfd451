//! Cyclone's QoS object, filled from ours, and read where another program filled it.
//!
//! ```text
//!   EndpointQos ── for_writer / for_reader ──▶ QosObject ──▶ dds_create_…
//!   dds_qos_t of a discovered endpoint ── announced ──▶ AnnouncedQos
//! ```
//!
//! Contract: the object is created, filled and freed here; calls that take it copy it. One that is
//! read belongs to the caller and is only looked at.
#![allow(unsafe_code)]

use std::ffi::CStr;
use std::time::Duration;

use crate::graph::Replay;
use wrapyfi_endpoint::{
    AnnouncedDurability, AnnouncedQos, Durability, History, Liveliness, Qos, Reliability,
};

/// Settings of a new endpoint.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EndpointQos<'a> {
    /// The policies that ROS 2 knows.
    pub(crate) qos: Qos,
    /// Longest time that a write waits for reliable readers.
    pub(crate) max_blocking: Duration,
    /// USER_DATA, for the type hash.
    pub(crate) user_data: &'a str,
    /// True when endpoints of the same participant are not heard.
    pub(crate) ignore_local: bool,
    /// Messages that a transient-local writer gives to readers that come later.
    pub(crate) replay: Replay,
    /// Partition of DDS: endpoints of others do not match. ROS 2 has none.
    pub(crate) partition: Option<&'static CStr>,
}

/// Owns a `dds_qos_t`.
pub(super) struct QosObject(*mut cyclors::dds_qos_t);

impl QosObject {
    fn new() -> Self {
        // SAFETY: allocates; Cyclone aborts rather than return null.
        Self(unsafe { cyclors::dds_create_qos() })
    }

    /// Quality of service with USER_DATA alone.
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
        let liveliness = match wanted.qos.liveliness {
            Liveliness::Automatic => cyclors::dds_liveliness_kind_DDS_LIVELINESS_AUTOMATIC,
            Liveliness::ManualByParticipant => {
                cyclors::dds_liveliness_kind_DDS_LIVELINESS_MANUAL_BY_PARTICIPANT
            }
            Liveliness::ManualByTopic => {
                cyclors::dds_liveliness_kind_DDS_LIVELINESS_MANUAL_BY_TOPIC
            }
        };
        let (deadline, lease) = (nanoseconds(wanted.qos.deadline), nanoseconds(wanted.qos.lease));
        let max_blocking = nanoseconds(Some(wanted.max_blocking));
        // SAFETY: plain values into an object this type owns.
        unsafe {
            cyclors::dds_qset_reliability(qos.0, reliability, max_blocking);
            cyclors::dds_qset_durability(qos.0, durability);
            cyclors::dds_qset_history(qos.0, kind, depth);
            cyclors::dds_qset_deadline(qos.0, deadline);
            cyclors::dds_qset_liveliness(qos.0, liveliness, lease);
            if wanted.ignore_local {
                cyclors::dds_qset_ignorelocal(
                    qos.0,
                    cyclors::dds_ignorelocal_kind_DDS_IGNORELOCAL_PARTICIPANT,
                );
            }
            if let Some(name) = wanted.partition {
                cyclors::dds_qset_partition1(qos.0, name.as_ptr());
            }
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
            cyclors::dds_qset_lifespan(qos.0, nanoseconds(wanted.qos.lifespan));
            match (wanted.qos.durability, wanted.replay) {
                (Durability::Volatile, _) => {}
                (Durability::TransientLocal, Replay::History) => {
                    cyclors::dds_qset_durability_service(qos.0, 0, kind, depth, any, any, any);
                }
                (Durability::TransientLocal, Replay::Newest(most)) => {
                    let (kind, depth) = history(match wanted.qos.history {
                        History::KeepLast(depth) => History::KeepLast(depth.min(most)),
                        History::KeepAll if most == u32::MAX => History::KeepAll,
                        History::KeepAll => History::KeepLast(most),
                    });
                    cyclors::dds_qset_durability_service(qos.0, 0, kind, depth, any, any, any);
                }
                (Durability::TransientLocal, Replay::Nothing) => cyclors::dds_qset_durability(
                    qos.0,
                    cyclors::dds_durability_kind_DDS_DURABILITY_TRANSIENT,
                ),
            }
        }
        qos
    }

    /// Pointer for calls that copy the policies.
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

/// A time for Cyclone, which calls the largest number infinite; no endpoint can have one of 0.
fn nanoseconds(time: Option<Duration>) -> i64 {
    time.map_or(i64::MAX, |time| i64::try_from(time.as_nanos()).unwrap_or(i64::MAX).max(1))
}

/// The policies that an endpoint announces; what is absent is DDS's default.
///
/// # Safety
/// `qos` is null or a QoS object that is alive.
pub(super) unsafe fn announced(qos: *const cyclors::dds_qos_t) -> AnnouncedQos {
    let (mut reliability, mut durability) = (Default::default(), Default::default());
    let (mut history_kind, mut liveliness) = (Default::default(), Default::default());
    let (mut blocking, mut deadline, mut lifespan, mut lease) = (0, None, None, None);
    let (mut depth, mut has_history) = (0, false);
    if !qos.is_null() {
        let time = |get: unsafe extern "C" fn(*const cyclors::dds_qos_t, *mut i64) -> bool| {
            let mut nanoseconds = i64::MAX;
            // SAFETY: alive by contract; one number is written.
            let known = unsafe { get(qos, &raw mut nanoseconds) };
            duration(known.then_some(nanoseconds))
        };
        deadline = time(cyclors::dds_qget_deadline);
        lifespan = time(cyclors::dds_qget_lifespan);
        let mut lease_ns = i64::MAX;
        // SAFETY: alive by contract; numbers are written to the places given.
        unsafe {
            cyclors::dds_qget_reliability(qos, &raw mut reliability, &raw mut blocking);
            cyclors::dds_qget_durability(qos, &raw mut durability);
            has_history = cyclors::dds_qget_history(qos, &raw mut history_kind, &raw mut depth);
            cyclors::dds_qget_liveliness(qos, &raw mut liveliness, &raw mut lease_ns);
        }
        lease = duration(Some(lease_ns));
    }
    AnnouncedQos {
        reliability: match reliability {
            cyclors::dds_reliability_kind_DDS_RELIABILITY_RELIABLE => Reliability::Reliable,
            _ => Reliability::BestEffort,
        },
        durability: match durability {
            cyclors::dds_durability_kind_DDS_DURABILITY_TRANSIENT_LOCAL => {
                AnnouncedDurability::TransientLocal
            }
            cyclors::dds_durability_kind_DDS_DURABILITY_TRANSIENT => AnnouncedDurability::Transient,
            cyclors::dds_durability_kind_DDS_DURABILITY_PERSISTENT => {
                AnnouncedDurability::Persistent
            }
            _ => AnnouncedDurability::Volatile,
        },
        history: has_history.then(|| match history_kind {
            cyclors::dds_history_kind_DDS_HISTORY_KEEP_ALL => History::KeepAll,
            _ => History::KeepLast(u32::try_from(depth).unwrap_or_default()),
        }),
        deadline,
        lifespan,
        liveliness: match liveliness {
            cyclors::dds_liveliness_kind_DDS_LIVELINESS_MANUAL_BY_PARTICIPANT => {
                Liveliness::ManualByParticipant
            }
            cyclors::dds_liveliness_kind_DDS_LIVELINESS_MANUAL_BY_TOPIC => {
                Liveliness::ManualByTopic
            }
            _ => Liveliness::Automatic,
        },
        lease,
    }
}

/// Longest time that the owner of an endpoint waits where it writes, as it announces it.
///
/// # Safety
/// `qos` is null or a QoS object that is alive.
pub(super) unsafe fn max_blocking(qos: *const cyclors::dds_qos_t) -> Option<Duration> {
    let (mut kind, mut blocking) = (Default::default(), i64::MAX);
    if !qos.is_null() {
        // SAFETY: alive by contract; numbers are written to the places given.
        unsafe { cyclors::dds_qget_reliability(qos, &raw mut kind, &raw mut blocking) };
    }
    duration(Some(blocking))
}

/// A time of Cyclone's; `None` where it is infinite.
fn duration(nanoseconds: Option<i64>) -> Option<Duration> {
    nanoseconds
        .filter(|&ns| ns != i64::MAX)
        .and_then(|ns| u64::try_from(ns).ok())
        .map(Duration::from_nanos)
}
