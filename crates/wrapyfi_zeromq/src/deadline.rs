//! Deadlines of requests, as callers tell them to a broker.
//!
//! ```text
//!   on the same machine   the time at which it gives up      however long the request was on its way
//!   on another one        its timeout, from the arrival on   clocks of machines differ
//! ```

use std::sync::OnceLock;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use crate::codec::mark::{Content, Kind, Mark};
use wrapyfi_endpoint::Clock;

/// Mark of a request whose caller gives up at `deadline`.
pub(super) fn request(content: Content, number: u64, deadline: Instant, clock: &Clock) -> Mark {
    // In this order: what passes between the two makes the time that is told earlier, never later.
    let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let left = deadline.saturating_duration_since(clock.now());
    Mark {
        kind: Kind::Request,
        content,
        timeout_ms: u32::try_from(left.as_millis()).unwrap_or(u32::MAX),
        number,
        machine: machine(),
        ends_ms: u64::try_from(unix.saturating_add(left).as_millis()).unwrap_or(u64::MAX),
    }
}

/// Deadline of a request that has just come; `None` for none.
pub(super) fn of(mark: &Mark) -> Option<Instant> {
    let now = Instant::now();
    let timeout = Duration::from_millis(mark.timeout_ms.into());
    let left = if mark.machine != 0 && mark.machine == machine() {
        let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        // No longer than it waits at all, should the clock have been set back.
        Duration::from_millis(mark.ends_ms).saturating_sub(unix).min(timeout)
    } else {
        timeout
    };
    now.checked_add(left)
}

/// Number of this machine since it was started, whatever container this runs in; 0 where the system
/// tells none.
fn machine() -> u32 {
    static NUMBER: OnceLock<u32> = OnceLock::new();
    *NUMBER.get_or_init(|| {
        let id = std::fs::read("/proc/sys/kernel/random/boot_id").unwrap_or_default();
        // FNV-1a. The identifier is random, so a part of its hash tells machines apart.
        let hash = |hash: u32, byte: &u8| (hash ^ u32::from(*byte)).wrapping_mul(0x0100_0193);
        if id.is_empty() { 0 } else { id.iter().fold(0x811c_9dc5, hash).max(1) }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    #[test]
    fn on_the_same_machine_it_is_the_callers_own_time() {
        let deadline = Instant::now() + 60 * SECOND;
        let mark = request(Content::Image, 7, deadline, &Clock::default());
        assert_eq!((mark.number, mark.content), (7, Content::Image));
        let told = of(&mark).unwrap();
        assert!(told <= deadline && told > deadline - 30 * SECOND, "{:?}", deadline - told);
        // However late it comes.
        let late = Mark { ends_ms: mark.ends_ms - 61_000, ..mark };
        assert!(of(&late).unwrap() <= Instant::now());
        let over = request(Content::Image, 8, Instant::now(), &Clock::default());
        assert!(of(&over).unwrap() <= Instant::now());
        // A clock that was set back.
        let back = Mark { ends_ms: mark.ends_ms + 3_600_000, ..mark };
        assert!(of(&back).unwrap() <= Instant::now() + 60 * SECOND);
    }

    #[test]
    fn on_another_machine_its_timeout_counts_from_the_arrival() {
        let mark = request(Content::Image, 7, Instant::now() + 60 * SECOND, &Clock::default());
        for machine in [0, mark.machine.wrapping_add(1)] {
            let other = Mark { machine, ends_ms: 5, ..mark };
            assert!(of(&other).unwrap() > Instant::now() + 30 * SECOND);
        }
        let forever = Mark { timeout_ms: u32::MAX, machine: 0, ..mark };
        assert!(of(&forever).unwrap() > Instant::now() + 60 * SECOND);
    }
}
