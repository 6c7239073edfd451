//! Errors of rmw, in its own words.

#![allow(unsafe_code, reason = "rmw keeps its last error in C")]

use std::ffi::{CStr, CString};

use super::sys;

/// A call of rmw that failed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{operation}: {reason}")]
pub struct Fault {
    /// Name of the function of rmw.
    pub operation: &'static str,
    /// Reason that rmw gave, or its return code.
    pub reason: String,
}

/// A message that was not sent.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SendFault {
    /// Reliable readers did not acknowledge in time.
    #[error("readers did not keep up")]
    Timeout,
    /// rmw refused.
    #[error(transparent)]
    Refused(#[from] Fault),
}

impl Fault {
    /// True where keys are asked for and there are none: no other middleware helps.
    pub fn wants_keys(&self) -> bool {
        self.operation == super::security::KEYS
    }

    /// A fault that rmw has no words for.
    pub(crate) fn new(operation: &'static str, reason: impl Into<String>) -> Self {
        Self { operation, reason: reason.into() }
    }

    /// Error of the call that has just failed on this thread.
    pub(crate) fn last(operation: &'static str) -> Self {
        Self { operation, reason: take_error().unwrap_or_else(|| "no reason given".to_owned()) }
    }

    /// The outcome of a call that returns a code.
    pub(crate) fn check(operation: &'static str, code: sys::rmw_ret_t) -> Result<(), Self> {
        if code == sys::RMW_RET_OK as sys::rmw_ret_t {
            return Ok(());
        }
        let reason = take_error().unwrap_or_else(|| format!("return code {code}"));
        Err(Self { operation, reason })
    }
}

/// A text for C.
pub(crate) fn c_text(operation: &'static str, text: &str) -> Result<CString, Fault> {
    CString::new(text).map_err(|_nul| Fault::new(operation, format!("{text:?} has a zero in it")))
}

/// The text of the last error on this thread, without the place in the source that it names.
fn take_error() -> Option<String> {
    // SAFETY: both functions read and write memory of this thread alone.
    let (is_set, text) = unsafe {
        let is_set = sys::rcutils_error_is_set();
        let text = sys::rcutils_get_error_string();
        sys::rcutils_reset_error();
        (is_set, text)
    };
    if !is_set {
        return None;
    }
    // SAFETY: the text is an array that ends with a zero, and lives until the end of this function.
    let text = unsafe { CStr::from_ptr(text.str_.as_ptr()) }.to_string_lossy().into_owned();
    let without_place = text.rfind(", at ").and_then(|at| text.get(..at)).unwrap_or(&text);
    Some(without_place.to_owned())
}
