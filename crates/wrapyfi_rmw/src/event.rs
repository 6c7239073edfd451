//! Events of quality of service: what did not match, came too late, was lost.
//!
//! ```text
//!   middleware ── callback ──▶ Notify            only that something happened
//!   counts()   ── rmw_take_event, kind by kind ──▶ EventCounts
//! ```

#![allow(unsafe_code, reason = "events of rmw are structs of C")]

use std::ptr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use wrapyfi_retry::Mutex;

use super::dispatch::{Callback, Dispatch, call};
use super::{Fault, Notify, qos, sys};

/// Numbers of events at an endpoint since it was created.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EventCounts {
    /// Deadlines that passed.
    pub deadlines_missed: u64,
    /// A subscription: publishers that were no longer alive. A publisher: how often it was not alive
    /// in time.
    pub liveliness_lost: u64,
    /// Messages that were lost before they could be taken.
    pub lost: u64,
    /// Policy over which the last other endpoint was refused.
    pub incompatible: Option<&'static str>,
}

/// Time that the other side may take to match what is matched here: rmw tells of this side alone, and what is sent
/// before is lost. On Fast DDS, between two nodes of one process, that was one first request in three.
pub const MATCH_SETTLES: Duration = Duration::from_millis(100);

/// Time by which the second call for a match comes later than the match has settled.
const MARGIN: Duration = Duration::from_millis(10);

/// The endpoint whose events are listened to.
#[derive(Clone, Copy)]
pub(crate) enum Source {
    Publisher(*const sys::rmw_publisher_t),
    Subscription(*const sys::rmw_subscription_t),
}

/// Events of one endpoint. To be dropped before the endpoint is destroyed.
pub(crate) struct Events {
    #[allow(clippy::vec_box, reason = "middlewares keep an event's address")]
    events: Vec<Box<sys::rmw_event_t>>,
    counts: Mutex<EventCounts>,
    /// Something happened since events were taken last.
    is_new: Arc<AtomicBool>,
    _callback: Callback,
}

// SAFETY: rmw's events are taken under the lock of `counts`, and else touched only where `Events` is made and
// dropped.
unsafe impl Send for Events {}
// SAFETY: as above.
unsafe impl Sync for Events {}

impl Events {
    /// Begins to listen to every kind of event that the middleware has; `notify` is called for each.
    pub(crate) fn new(source: Source, dispatch: &Dispatch, notify: Notify) -> Self {
        let is_new = Arc::new(AtomicBool::new(true));
        let noted = Arc::clone(&is_new);
        let callback = dispatch.callback(
            Arc::new(move || {
                noted.store(true, Ordering::Release);
                notify();
            }),
            matches!(source, Source::Publisher(_)).then_some(MATCH_SETTLES + MARGIN),
        );
        let kinds: &[sys::rmw_event_type_t] = match source {
            Source::Publisher(_) => &[
                sys::RMW_EVENT_PUBLICATION_MATCHED,
                sys::RMW_EVENT_OFFERED_QOS_INCOMPATIBLE,
                sys::RMW_EVENT_OFFERED_DEADLINE_MISSED,
                sys::RMW_EVENT_LIVELINESS_LOST,
            ],
            Source::Subscription(_) => &[
                sys::RMW_EVENT_SUBSCRIPTION_MATCHED,
                sys::RMW_EVENT_REQUESTED_QOS_INCOMPATIBLE,
                sys::RMW_EVENT_REQUESTED_DEADLINE_MISSED,
                sys::RMW_EVENT_LIVELINESS_CHANGED,
                sys::RMW_EVENT_MESSAGE_LOST,
            ],
        };
        let mut events = Vec::new();
        for &kind in kinds {
            // SAFETY: a struct of values, by value.
            let mut event = Box::new(unsafe { sys::rmw_get_zero_initialized_event() });
            // SAFETY: the endpoint lives longer than `Events`, and the event is boxed: it stays where it is.
            let code = unsafe {
                match source {
                    Source::Publisher(publisher) => {
                        sys::rmw_publisher_event_init(&raw mut *event, publisher, kind)
                    }
                    Source::Subscription(subscription) => {
                        sys::rmw_subscription_event_init(&raw mut *event, subscription, kind)
                    }
                }
            };
            if let Err(fault) = Fault::check("rmw_event_init", code) {
                tracing::debug!(%fault, kind, "the middleware does not tell of these events");
                continue;
            }
            // SAFETY: the callback lives as long as the event: it is taken back on drop.
            let code = unsafe {
                sys::rmw_event_set_callback(&raw mut *event, Some(call), callback.user_data())
            };
            if let Err(fault) = Fault::check("rmw_event_set_callback", code) {
                tracing::debug!(%fault, kind, "nobody is called for these events");
            }
            events.push(event);
        }
        Self { events, counts: Mutex::default(), is_new, _callback: callback }
    }

    /// Numbers of events so far.
    pub(crate) fn counts(&self) -> EventCounts {
        let mut counts = self.counts.lock();
        if self.is_new.swap(false, Ordering::AcqRel) {
            for event in &self.events {
                take(event, &mut counts);
            }
        }
        *counts
    }
}

/// Takes what happened of one kind since the last time.
fn take(event: &sys::rmw_event_t, counts: &mut EventCounts) {
    /// Reads a status of the type that rmw writes for the event's kind.
    fn status<T: Default>(event: &sys::rmw_event_t) -> Option<T> {
        let mut status = T::default();
        let mut taken = false;
        // SAFETY: `T` is the struct that belongs to the kind: see the callers below.
        let code = unsafe {
            sys::rmw_take_event(event, ptr::from_mut(&mut status).cast(), &raw mut taken)
        };
        (Fault::check("rmw_take_event", code).is_ok() && taken).then_some(status)
    }
    let more = |change: i32| u64::try_from(change).unwrap_or(0);
    match event.event_type {
        sys::RMW_EVENT_PUBLICATION_MATCHED | sys::RMW_EVENT_SUBSCRIPTION_MATCHED => {
            // Taken, so that the middleware tells of the next one; the graph counts.
            status::<sys::rmw_matched_status_t>(event);
        }
        sys::RMW_EVENT_OFFERED_QOS_INCOMPATIBLE | sys::RMW_EVENT_REQUESTED_QOS_INCOMPATIBLE => {
            if let Some(status) = status::<sys::rmw_qos_incompatible_event_status_t>(event)
                && status.total_count > 0
            {
                counts.incompatible = Some(qos::policy(status.last_policy_kind));
            }
        }
        sys::RMW_EVENT_OFFERED_DEADLINE_MISSED => {
            let status = status::<sys::rmw_offered_deadline_missed_status_t>(event);
            counts.deadlines_missed += status.map_or(0, |status| more(status.total_count_change));
        }
        sys::RMW_EVENT_REQUESTED_DEADLINE_MISSED => {
            let status = status::<sys::rmw_requested_deadline_missed_status_t>(event);
            counts.deadlines_missed += status.map_or(0, |status| more(status.total_count_change));
        }
        sys::RMW_EVENT_LIVELINESS_LOST => {
            let status = status::<sys::rmw_liveliness_lost_status_t>(event);
            counts.liveliness_lost += status.map_or(0, |status| more(status.total_count_change));
        }
        sys::RMW_EVENT_LIVELINESS_CHANGED => {
            let status = status::<sys::rmw_liveliness_changed_status_t>(event);
            counts.liveliness_lost +=
                status.map_or(0, |status| more(status.not_alive_count_change));
        }
        sys::RMW_EVENT_MESSAGE_LOST => {
            let status = status::<sys::rmw_message_lost_status_t>(event);
            let lost = status.map_or(0, |status| status.total_count_change);
            counts.lost += u64::try_from(lost).unwrap_or(0);
        }
        _ => {}
    }
}

impl Drop for Events {
    fn drop(&mut self) {
        for event in &mut self.events {
            // SAFETY: the event was initialised and its endpoint lives. After the callback is taken back no thread
            // calls it: middlewares hold the lock under which they call.
            let codes = unsafe {
                let callback = sys::rmw_event_set_callback(&raw mut **event, None, ptr::null());
                [callback, sys::rmw_event_fini(&raw mut **event)]
            };
            for code in codes {
                if let Err(fault) = Fault::check("rmw_event_fini", code) {
                    tracing::debug!(%fault, "an event was not ended");
                }
            }
        }
    }
}
