//! Events of an endpoint: Cyclone's listener callbacks, kept as counters and a doorbell.
//!
//! ```text
//!   receive thread ─▶ callback ─▶ Events { matched, lost, … } ─▶ notify()
//!                        ▲ arg
//!                 Arc held by the endpoint, freed after the endpoint is deleted
//! ```
//!
//! Contract: the argument of every callback is a pointer to an [`Events`] whose `Arc` the endpoint
//! keeps until Cyclone can call no more; a callback holds one more `Arc` while it runs. Callbacks take no lock of
//! ours and never panic into C. Endpoints that a callback drops are deleted after it, by another thread
//! ([`delete`]): Cyclone's deletion waits for callbacks under way, and would wait for its own caller for ever.
#![allow(unsafe_code)]

use std::cell::RefCell;
use std::ffi::c_void;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr;
use std::sync::Arc;
use std::sync::atomic::{
    AtomicU32, AtomicU64, AtomicUsize,
    Ordering::{Acquire, Relaxed, Release},
};
use std::thread;

use super::entity::ReturnCode;
use crate::graph::Notify;
use wrapyfi_endpoint::Reliability;

/// Counters of the events that Cyclone reported about one endpoint.
pub(crate) struct Events {
    topic: String,
    reliability: Reliability,
    notify: Notify,
    matched: AtomicUsize,
    /// Number of changes of `matched`.
    changes: AtomicU64,
    lost: AtomicU64,
    /// Policy of the last refused peer; 0 when none was refused.
    policy: AtomicU32,
    deadlines: AtomicU64,
    livelinesses: AtomicU64,
}

impl Events {
    /// Counters of a new endpoint, all zero.
    pub(crate) fn new(topic: &str, reliability: Reliability, notify: Notify) -> Arc<Self> {
        Arc::new(Self {
            topic: topic.to_owned(),
            reliability,
            notify,
            matched: AtomicUsize::new(0),
            changes: AtomicU64::new(0),
            lost: AtomicU64::new(0),
            policy: AtomicU32::new(0),
            deadlines: AtomicU64::new(0),
            livelinesses: AtomicU64::new(0),
        })
    }

    /// Deadlines that passed since the last call: those of writers for a reader, else our own.
    pub(crate) fn take_missed_deadlines(&self) -> u64 {
        self.deadlines.swap(0, Relaxed)
    }

    /// Number of times since the last call that a writer which a reader hears was no longer alive,
    /// or a writer of ours was not alive in time.
    pub(crate) fn take_lost_liveliness(&self) -> u64 {
        self.livelinesses.swap(0, Relaxed)
    }

    /// Peers matched now.
    pub(crate) fn matched(&self) -> usize {
        self.matched.load(Relaxed)
    }

    /// Grows whenever a peer comes or goes.
    pub(crate) fn changes(&self) -> u64 {
        self.changes.load(Acquire)
    }

    /// Samples lost since the last call.
    pub(crate) fn take_lost(&self) -> u64 {
        self.lost.swap(0, Relaxed)
    }

    /// Name of the policy over which the last peer was refused.
    pub(crate) fn incompatible(&self) -> Option<&'static str> {
        match self.policy.load(Relaxed) {
            0 => None,
            policy => Some(policy_name(policy)),
        }
    }

    fn ring(&self) {
        if catch_unwind(AssertUnwindSafe(|| (self.notify)())).is_err() {
            // Formatting a plain line may panic only if the subscriber does: swallow that too.
            _ = catch_unwind(|| tracing::error!("a callback for DDS events panicked"));
        }
    }

    fn set_matched(&self, count: u32) {
        self.matched.store(usize::try_from(count).unwrap_or(usize::MAX), Relaxed);
        self.changes.fetch_add(1, Release);
        self.ring();
    }

    fn refused(&self, policy: u32, peer: &str) {
        self.policy.store(policy, Relaxed);
        // The endpoint's owner tells the user, with names and values.
        _ = catch_unwind(AssertUnwindSafe(|| {
            tracing::debug!(
                topic = self.topic,
                policy = policy_name(policy),
                "{peer} does not match, its quality of service is incompatible"
            );
        }));
        self.ring();
    }

    fn add(&self, counter: &AtomicU64, change: i32) {
        // News without a change, such as a publisher that is alive again, wakes no thread.
        if let Ok(change @ 1..) = u64::try_from(change) {
            counter.fetch_add(change, Relaxed);
            self.ring();
        }
    }
}

/// Name of a policy as ROS 2 writes it.
fn policy_name(policy: u32) -> &'static str {
    match policy {
        cyclors::dds_qos_policy_id_DDS_DURABILITY_QOS_POLICY_ID => "durability",
        cyclors::dds_qos_policy_id_DDS_PRESENTATION_QOS_POLICY_ID => "presentation",
        cyclors::dds_qos_policy_id_DDS_DEADLINE_QOS_POLICY_ID => "deadline",
        cyclors::dds_qos_policy_id_DDS_LATENCYBUDGET_QOS_POLICY_ID => "latency budget",
        cyclors::dds_qos_policy_id_DDS_OWNERSHIP_QOS_POLICY_ID => "ownership",
        cyclors::dds_qos_policy_id_DDS_LIVELINESS_QOS_POLICY_ID => "liveliness",
        cyclors::dds_qos_policy_id_DDS_PARTITION_QOS_POLICY_ID => "partition",
        cyclors::dds_qos_policy_id_DDS_RELIABILITY_QOS_POLICY_ID => "reliability",
        cyclors::dds_qos_policy_id_DDS_DESTINATIONORDER_QOS_POLICY_ID => "destination order",
        cyclors::dds_qos_policy_id_DDS_TYPE_CONSISTENCY_ENFORCEMENT_QOS_POLICY_ID => "type",
        cyclors::dds_qos_policy_id_DDS_DATA_REPRESENTATION_QOS_POLICY_ID => "data representation",
        _ => "another policy",
    }
}

/// Owns a `dds_listener_t`, which the create call of an endpoint copies.
pub(super) struct Listener(*mut cyclors::dds_listener_t);

impl Listener {
    /// Listener of a reader. `events` must outlive the reader.
    pub(super) fn for_reader(events: &Arc<Events>) -> Self {
        let listener = Self::new(events);
        // SAFETY: the functions below accept the argument that `new` gave.
        unsafe {
            cyclors::dds_lset_data_available(listener.0, Some(on_data));
            cyclors::dds_lset_subscription_matched(listener.0, Some(on_reader_matched));
            cyclors::dds_lset_sample_lost(listener.0, Some(on_lost));
            cyclors::dds_lset_sample_rejected(listener.0, Some(on_rejected));
            cyclors::dds_lset_requested_incompatible_qos(listener.0, Some(on_writer_refused));
            cyclors::dds_lset_requested_deadline_missed(listener.0, Some(on_writer_late));
            cyclors::dds_lset_liveliness_changed(listener.0, Some(on_writer_alive_or_not));
        }
        listener
    }

    /// Listener of a writer. `events` must outlive the writer.
    pub(super) fn for_writer(events: &Arc<Events>) -> Self {
        let listener = Self::new(events);
        // SAFETY: as above.
        unsafe {
            cyclors::dds_lset_publication_matched(listener.0, Some(on_writer_matched));
            cyclors::dds_lset_offered_incompatible_qos(listener.0, Some(on_reader_refused));
            cyclors::dds_lset_offered_deadline_missed(listener.0, Some(on_late));
            cyclors::dds_lset_liveliness_lost(listener.0, Some(on_not_alive));
        }
        listener
    }

    /// Listener of a reader of a built-in topic: rings when something waits. `events` must outlive
    /// it.
    pub(super) fn for_news(events: &Arc<Events>) -> Self {
        let listener = Self::new(events);
        // SAFETY: as above.
        unsafe { cyclors::dds_lset_data_available(listener.0, Some(on_data)) };
        listener
    }

    fn new(events: &Arc<Events>) -> Self {
        // SAFETY: the pointer is only stored; callbacks read it while the Arc lives.
        Self(unsafe { cyclors::dds_create_listener(Arc::as_ptr(events).cast_mut().cast()) })
    }

    pub(super) fn as_ptr(&self) -> *const cyclors::dds_listener_t {
        self.0
    }
}

/// Removes the listener of an entity, after which Cyclone calls back no more, and frees its events.
pub(super) fn silence(handle: i32, events: &Arc<Events>) {
    let events = Arc::clone(events);
    delete(move || {
        // SAFETY: a null listener removes ours; the call waits for callbacks under way.
        let code = unsafe { cyclors::dds_set_listener(handle, ptr::null()) };
        if let Err(error) = ReturnCode::check(code) {
            tracing::debug!(%error, "an endpoint was gone before its owner");
        }
        drop(events);
    });
}

impl Drop for Listener {
    fn drop(&mut self) {
        // SAFETY: created in `new`, freed once; endpoints hold their own copy.
        unsafe { cyclors::dds_delete_listener(self.0) };
    }
}

/// A deletion that waits for the end of a callback.
type Deletion = Box<dyn FnOnce() + Send>;

thread_local! {
    /// Deletions asked for by the callback that this thread runs; `None` outside a callback.
    static WAITING: RefCell<Option<Vec<Deletion>>> = const { RefCell::new(None) };
}

/// Runs a deletion now, or after the callback in which it is asked for, in the order in which they were asked for.
pub(super) fn delete(deletion: impl FnOnce() + Send + 'static) {
    let now = WAITING.with_borrow_mut(|waiting| match waiting {
        Some(waiting) => {
            waiting.push(Box::new(deletion));
            None
        }
        None => Some(deletion),
    });
    if let Some(now) = now {
        now();
    }
}

/// Runs the reaction of a callback on the events behind its argument.
///
/// # Safety
/// `arg` is the pointer that `Listener::new` stored, whose `Arc` is alive now.
unsafe fn react(arg: *mut c_void, reaction: impl FnOnce(&Events)) {
    let events = arg.cast_const().cast::<Events>();
    if events.is_null() {
        return;
    }
    // SAFETY: by contract; the added reference belongs to the new `Arc`, which outlives the owner's where the
    // reaction drops the endpoint.
    let events = unsafe {
        Arc::increment_strong_count(events);
        Arc::from_raw(events)
    };
    // Cyclone may call from within a call that a reaction makes: the outermost callback deletes.
    let outer = WAITING.replace(Some(Vec::new()));
    reaction(&events);
    // Its last reference may own endpoints: they are dropped while deletions still wait.
    _ = catch_unwind(AssertUnwindSafe(|| drop(events)));
    let mut asked = WAITING.replace(None).unwrap_or_default();
    if let Some(mut waiting) = outer {
        waiting.append(&mut asked);
        WAITING.set(Some(waiting));
    } else if !asked.is_empty() {
        let delete_all = || asked.into_iter().for_each(|deletion| deletion());
        if let Err(error) = thread::Builder::new().name("dds-deletion".to_owned()).spawn(delete_all)
        {
            _ = catch_unwind(AssertUnwindSafe(|| {
                tracing::error!(%error, "endpoints dropped in a callback stay until the program ends: no thread");
            }));
        }
    }
}

/// Callbacks that run a reaction on the events behind their argument.
macro_rules! callbacks {
    ($($name:ident($status:ident: $type:ident) |$events:ident| $react:expr;)*) => {$(
        unsafe extern "C" fn $name(_: i32, $status: cyclors::$type, arg: *mut c_void) {
            // SAFETY: Cyclone passes the pointer that `Listener::new` stored, whose `Arc` is alive.
            unsafe { react(arg, |$events| $react) }
        }
    )*};
}

callbacks! {
    on_reader_matched(status: dds_subscription_matched_status_t)
        |events| events.set_matched(status.current_count);
    on_writer_matched(status: dds_publication_matched_status_t)
        |events| events.set_matched(status.current_count);
    on_lost(status: dds_sample_lost_status_t)
        |events| events.add(&events.lost, status.total_count_change);
    on_rejected(status: dds_sample_rejected_status_t)
        // A reliable writer sends a rejected sample again; only the others have lost it.
        |events| match events.reliability {
            Reliability::Reliable => events.ring(),
            Reliability::BestEffort => events.add(&events.lost, status.total_count_change),
        };
    on_writer_refused(status: dds_requested_incompatible_qos_status_t)
        |events| events.refused(status.last_policy_id, "a publisher");
    on_reader_refused(status: dds_offered_incompatible_qos_status_t)
        |events| events.refused(status.last_policy_id, "a subscriber");
    on_writer_late(status: dds_requested_deadline_missed_status_t)
        |events| events.add(&events.deadlines, status.total_count_change);
    on_late(status: dds_offered_deadline_missed_status_t)
        |events| events.add(&events.deadlines, status.total_count_change);
    on_writer_alive_or_not(status: dds_liveliness_changed_status_t)
        |events| events.add(&events.livelinesses, status.not_alive_count_change);
    on_not_alive(status: dds_liveliness_lost_status_t)
        |events| events.add(&events.livelinesses, status.total_count_change);
}

unsafe extern "C" fn on_data(_: i32, arg: *mut c_void) {
    // SAFETY: as those above.
    unsafe { react(arg, Events::ring) }
}
