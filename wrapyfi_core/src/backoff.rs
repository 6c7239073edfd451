//! Waits between tries: growing, capped, and spread so that a hundred routes or peers do not knock
//! together.

use std::time::Duration;

use crate::Limits;

/// Exponential back-off from [`Limits::RECONNECT_MIN`] to [`Limits::RECONNECT_MAX`] with jitter
/// from a seed, so that a run can be repeated.
#[derive(Debug, Clone)]
pub(crate) struct Backoff {
    next: Duration,
    random: u64,
}

impl Backoff {
    pub(crate) fn new(seed: u64) -> Self {
        Self { next: Limits::RECONNECT_MIN, random: seed | 1 }
    }

    /// As [`Backoff::new`], with waits that differ from those of other processes with this seed: they
    /// knock at the same doors.
    pub(crate) fn of_process(seed: u64) -> Self {
        Self::new(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ u64::from(std::process::id()))
    }

    /// How long to wait before the next try: between half of the current step and all of it.
    pub(crate) fn wait(&mut self) -> Duration {
        // xorshift64: jitter needs no better source, and the seed repeats it.
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        let step = self.next;
        self.next = (step * 2).min(Limits::RECONNECT_MAX);
        let thousandths = u32::try_from(self.random % 500).unwrap_or(0);
        step / 2 + step / 1000 * thousandths
    }

    /// The try succeeded.
    pub(crate) fn reset(&mut self) {
        self.next = Limits::RECONNECT_MIN;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grows_to_the_cap_and_starts_over() {
        let mut backoff = Backoff::new(7);
        let mut last = Duration::ZERO;
        for _ in 0..50 {
            last = backoff.wait();
            assert!(last >= Limits::RECONNECT_MIN / 2 && last <= Limits::RECONNECT_MAX);
        }
        assert!(last >= Limits::RECONNECT_MAX / 2);
        backoff.reset();
        assert!(backoff.wait() <= Limits::RECONNECT_MIN);
    }
}
