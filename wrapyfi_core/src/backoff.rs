//! Waits between tries: growing, capped, and spread so that a hundred routes do not knock together.

use std::time::Duration;

use crate::Limits;

/// Exponential back-off from [`Limits::RECONNECT_MIN`] to [`Limits::RECONNECT_MAX`] with jitter
/// from a seed, so that a run can be repeated.
#[derive(Debug, Clone)]
pub(super) struct Backoff {
    next: Duration,
    random: u64,
}

impl Backoff {
    pub(super) fn new(seed: u64) -> Self {
        Self { next: Limits::RECONNECT_MIN, random: seed | 1 }
    }

    /// How long to wait before the next try: between half of the current step and all of it.
    pub(super) fn wait(&mut self) -> Duration {
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
    pub(super) fn reset(&mut self) {
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
