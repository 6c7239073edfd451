//! Cyclone's log lines as tracing events.
//!
//! ```text
//!   dds_log(…) ──▶ sink (one for the process) ──▶ tracing, target "cyclonedds"
//! ```
//!
//! Contract: the sink reads the line during the call only and never panics into C.
#![allow(unsafe_code)]

use std::ffi::{CStr, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Once;

/// Sends Cyclone's log lines to tracing from now on; further calls do nothing.
pub(super) fn install() {
    static ONCE: Once = Once::new();
    // SAFETY: the sink is a function of this program and needs no argument.
    ONCE.call_once(|| unsafe { cyclors::dds_set_log_sink(Some(sink), std::ptr::null_mut()) });
}

unsafe extern "C" fn sink(_: *mut c_void, data: *const cyclors::dds_log_data_t) {
    // SAFETY: Cyclone passes a valid line that lives through the call, or nothing.
    let Some(data) = (unsafe { data.as_ref() }) else { return };
    if data.message.is_null() {
        return;
    }
    // SAFETY: the message is NUL-terminated.
    let message = unsafe { CStr::from_ptr(data.message) }.to_string_lossy();
    let message = message.trim_end();
    let domain = data.domid;
    // A subscriber that panics must not unwind into C; there is nowhere left to report it.
    _ = catch_unwind(AssertUnwindSafe(|| match data.priority {
        cyclors::DDS_LC_FATAL | cyclors::DDS_LC_ERROR => {
            tracing::error!(target: "cyclonedds", domain, "{message}");
        }
        cyclors::DDS_LC_WARNING => tracing::warn!(target: "cyclonedds", domain, "{message}"),
        _ => tracing::debug!(target: "cyclonedds", domain, "{message}"),
    }));
}
