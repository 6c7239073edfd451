//! Messages that the middleware logs, as lines of this program's log.

#![allow(unsafe_code, reason = "rcutils hands texts of C to a function")]

use std::ffi::{CStr, c_char, c_int};
use std::sync::Once;

use super::sys;

/// Hands what the middleware logs to the log of this program, from the first call on. A program that has set up rcutils'
/// logging itself keeps it.
pub(crate) fn begin() {
    static BEGIN: Once = Once::new();
    BEGIN.call_once(|| {
        // SAFETY: called once; `hear` may be called by every thread, and for as long as the process lives.
        if !unsafe { sys::wrapyfi_log_to(Some(hear)) } {
            tracing::debug!("the middleware's messages stay in the log that rcutils has");
        }
    });
}

/// Writes one message into the log.
unsafe extern "C" fn hear(
    severity: c_int,
    logger: *const c_char,
    text: *const c_char,
    length: usize,
) {
    // SAFETY: as the header says, both are texts of C that live until this function returns, and the logger may be null.
    let (logger, text) = unsafe { (text_of(logger), text_of(text)) };
    let cut = if length > text.len() { "…" } else { "" };
    let text = text.trim_end();
    // rcutils' levels: 10 debug, 20 info, 30 warn, 40 error, 50 fatal.
    match severity {
        ..20 => tracing::debug!(%logger, "{text}{cut}"),
        20..30 => tracing::info!(%logger, "{text}{cut}"),
        30..40 => tracing::warn!(%logger, "{text}{cut}"),
        40.. => tracing::error!(%logger, "{text}{cut}"),
    }
}

/// A text of C; empty where it is null.
///
/// # Safety
/// A pointer that is not null points to a text that ends with a zero and outlives the call.
unsafe fn text_of(text: *const c_char) -> String {
    // SAFETY: not null, and as the caller promises.
    let text = (!text.is_null()).then(|| unsafe { CStr::from_ptr(text) }.to_string_lossy());
    text.unwrap_or_default().into_owned()
}

#[cfg(test)]
mod tests {
    use std::ffi::{CString, c_void};
    use std::ptr;
    use std::sync::Mutex;

    use super::*;

    static HEARD: Mutex<Vec<(c_int, String, String, usize)>> = Mutex::new(Vec::new());

    unsafe extern "C" fn keep(
        severity: c_int,
        logger: *const c_char,
        text: *const c_char,
        length: usize,
    ) {
        // SAFETY: as for `hear`.
        let (logger, text) = unsafe { (text_of(logger), text_of(text)) };
        HEARD.lock().unwrap().push((severity, logger, text, length));
    }

    #[test]
    fn what_the_middleware_logs_is_handed_on() {
        // SAFETY: `keep` may be called by every thread.
        assert!(unsafe { sys::wrapyfi_log_to(Some(keep)) });
        let long = CString::new("a".repeat(5000)).unwrap();
        // SAFETY: the formats fit the arguments that follow.
        unsafe {
            let log = |severity, logger: &CStr, text: &CStr| {
                sys::rcutils_log(
                    ptr::null(),
                    severity,
                    logger.as_ptr(),
                    c"no router: %s".as_ptr(),
                    text.as_ptr(),
                );
            };
            log(30, c"rmw_zenoh_cpp", c"start one");
            log(10, c"rmw_zenoh_cpp", c"below the level that rcutils has by itself");
            log(40, c"rmw", &long);
        }
        let heard = HEARD.lock().unwrap();
        let [first, second] = heard.as_slice() else { panic!("{heard:?}") };
        let said = "no router: start one".to_owned();
        assert_eq!(*first, (30, "rmw_zenoh_cpp".to_owned(), said.clone(), said.len()));
        assert_eq!((second.0, second.3), (40, 5011));
        assert_eq!(second.2.len(), sys::WRAPYFI_LOG_BYTES as usize - 1);
    }

    #[test]
    fn libraries_find_the_console_of_this_program() {
        unsafe extern "C" {
            fn dlsym(handle: *mut c_void, symbol: *const c_char) -> *mut c_void;
        }
        let name = c"rcutils_logging_console_output_handler";
        // SAFETY: a null handle is RTLD_DEFAULT, the order in which libraries look for symbols.
        let found = unsafe { dlsym(ptr::null_mut(), name.as_ptr()) };
        // SAFETY: it tells an address.
        assert_eq!(found, unsafe { sys::wrapyfi_console() });
    }
}
