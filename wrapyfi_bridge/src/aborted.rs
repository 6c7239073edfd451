//! The end of a library that gives up: one line and exit code 1, where C says `abort`.
//!
//! CycloneDDS aborts where the system refuses it a thread, a file or memory in a place that cannot fail.
//!
//! Contract: the handler calls nothing but `write` and `_exit`, as a handler of a signal may.
#![allow(unsafe_code)]

use signal_hook::consts::SIGABRT;

const LINE: &[u8] = b"wrapyfi: ends, because a library that it uses gave up: a line before says why, or the limits of \
the process do (ulimit -a: files, threads, memory)\n";

/// Catches SIGABRT from now on. A system that refuses leaves the end as it is.
pub fn catch() {
    // SAFETY: the handler makes two system calls, which are safe in a handler, and does not return.
    let caught = unsafe {
        signal_hook::low_level::register(SIGABRT, || {
            // There is no reader left.
            _ = rustix::io::write(std::io::stderr(), LINE);
            signal_hook::low_level::exit(1);
        })
    };
    if let Err(error) = caught {
        tracing::debug!(%error, "aborts of libraries are not caught");
    }
}
