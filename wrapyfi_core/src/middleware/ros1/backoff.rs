//! Waits between tries: growing, capped, and spread so that a hundred peers do not knock together.

use std::time::Duration;

use crate::Limits;

/// Exponential, from [`Limits::RECONNECT_MIN`] to [`Limits::RECONNECT_MAX`], with jitter from a seed.
#[derive(Debug)]
pub(super) struct Backoff {
    next: Duration,
    random: u64,
}

impl Backoff {
    pub(super) fn new(seed: u64) -> Self {
        let random = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ u64::from(std::process::id());
        Self { next: Limits::RECONNECT_MIN, random: random | 1 }
    }

    /// How long to wait before the next try: between half of the current step and all of it.
    pub(super) fn wait(&mut self) -> Duration {
        // xorshift64: jitter needs no better source.
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
