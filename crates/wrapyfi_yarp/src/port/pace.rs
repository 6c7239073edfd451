//! The pace of datagrams.
//!
//! ```text
//!   a picture of 230 kB   ▉ ─ 1 ms ─ ▉ ─ 1 ms ─ ▉ ─ 1 ms ─ ▌
//! ```
//!
//! A reader's socket has room for three datagrams of the largest size where the user has not raised
//! `net.core.rmem_default`; the system discards those that find no room, and YARP's readers the whole
//! message with them. YARP's own senders pause as long.

use std::time::Duration;

use tokio::time::Instant;

use crate::wire::datagram::MAX_DATAGRAM;

/// Time from a datagram of the largest size to the next one; smaller ones take a part of it.
const STEP: Duration = Duration::from_millis(1);

/// Schedule of the datagrams of a socket.
#[derive(Debug)]
pub(super) struct Pace {
    due: Instant,
}

impl Pace {
    pub(super) fn new() -> Self {
        Self { due: Instant::now() }
    }

    /// Waits until a datagram of so many bytes may be sent.
    pub(super) async fn turn(&mut self, bytes: usize) {
        if let Some(due) = self.next(bytes, Instant::now()) {
            tokio::time::sleep_until(due).await;
        }
    }

    /// Time at which a datagram that is there at `now` is sent; `None` for at once. Small ones may
    /// be half a step early: timers are no finer, and a flood of them is not slowed down.
    fn next(&mut self, bytes: usize, now: Instant) -> Option<Instant> {
        let due = self.due.max(now);
        let cost = STEP.mul_f64(bytes.min(MAX_DATAGRAM) as f64 / MAX_DATAGRAM as f64);
        let early = STEP.saturating_sub(cost) / 2;
        self.due = due + cost;
        (due.saturating_duration_since(now) > early).then_some(due)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Times at which datagrams are sent that are all there at the start. Timers fire `late`, the
    /// tenth time 20 ms.
    fn sent(count: usize, bytes: usize, late: Duration) -> Vec<Instant> {
        let mut pace = Pace::new();
        let mut now = pace.due;
        let mut times = Vec::new();
        for number in 0..count {
            if let Some(due) = pace.next(bytes, now) {
                now = due + if number == 10 { 20 * STEP } else { late };
            }
            times.push(now);
        }
        times
    }

    #[test]
    fn a_picture_goes_out_one_datagram_after_the_other() {
        for late in [0, 100, 500, 900, 999] {
            let late = Duration::from_micros(late);
            let times = sent(15, MAX_DATAGRAM, late);
            assert!(times[1] >= times[0] + STEP, "nothing is saved up for the beginning");
            for window in times.windows(3) {
                assert!(window[2] - window[0] >= STEP, "{late:?}: three at once: {times:?}");
            }
            assert!(times[14] - times[0] < 40 * STEP, "{late:?}: lateness adds up: {times:?}");
        }
    }

    #[test]
    fn small_datagrams_do_not_wait() {
        let times = sent(300, 100, Duration::ZERO);
        assert_eq!(times[0], times[299]);
        // 2 MB at once are no few.
        let times = sent(20_000, 100, Duration::ZERO);
        assert!(times[19_999] - times[0] >= 20 * STEP);
    }
}
