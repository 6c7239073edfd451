//! One clock for every process of a measurement: `CLOCK_MONOTONIC`, in nanoseconds.
//!
//! Python's `time.monotonic_ns()` reads the same one.

use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};

/// Time that is waited away awake before something is due: a sleep alone ends up to this late.
const AWAKE: u64 = 250_000;

/// Nanoseconds now.
pub(crate) fn now() -> u64 {
    nanoseconds(ClockId::Monotonic)
}

/// CPU time of this process, in nanoseconds.
pub(crate) fn cpu() -> u64 {
    nanoseconds(ClockId::ProcessCPUTime)
}

fn nanoseconds(clock: ClockId) -> u64 {
    let time = clock_gettime(clock);
    time.tv_sec.unsigned_abs() * 1_000_000_000 + time.tv_nsec.unsigned_abs()
}

/// Waits until `due`; the nanoseconds of it that were spent awake.
pub(crate) fn wait_until(due: u64) -> u64 {
    let sleep = due.saturating_sub(now()).saturating_sub(AWAKE);
    if sleep > 0 {
        std::thread::sleep(Duration::from_nanos(sleep));
    }
    let awake_since = now();
    loop {
        let time = now();
        if time >= due {
            return time - awake_since;
        }
        std::hint::spin_loop();
    }
}
