//! Waits between tries, which grow up to a limit, and are spread so that a hundred routes or peers
//! do not try all at once.

use std::time::Duration;

/// First wait before a lost peer or a failed opening is tried again.
pub const FIRST: Duration = Duration::from_millis(100);
/// Longest wait between two tries: a peer that comes back after a long time is found within two seconds, too.
pub const LONGEST: Duration = Duration::from_millis(1500);

/// Exponential back-off from [`FIRST`] to [`LONGEST`] with jitter from a seed, so that a run can be repeated.
#[derive(Debug, Clone)]
pub struct Backoff {
    first: Duration,
    longest: Duration,
    next: Duration,
    random: u64,
}

impl Backoff {
    /// Back-off whose jitter repeats with `seed`.
    pub fn new(seed: u64) -> Self {
        Self { first: FIRST, longest: LONGEST, next: FIRST, random: seed | 1 }
    }

    /// As [`Backoff::new`], with waits that differ from those of other processes with this seed,
    /// which try the same peers.
    pub fn of_process(seed: u64) -> Self {
        Self::new(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ u64::from(std::process::id()))
    }

    /// As [`Backoff::of_process`], with waits that differ from those for other names.
    pub fn of_name(name: &str) -> Self {
        use std::hash::{DefaultHasher, Hash as _, Hasher as _};
        let mut seed = DefaultHasher::new();
        name.hash(&mut seed);
        Self::of_process(seed.finish())
    }

    /// Sets another first wait.
    #[must_use]
    pub fn starting_at(self, first: Duration) -> Self {
        Self { first, next: first, ..self }
    }

    /// Sets another longest wait.
    #[must_use]
    pub fn up_to(self, longest: Duration) -> Self {
        Self { longest, next: self.next.min(longest), ..self }
    }

    /// Waits for [`Backoff::wait`].
    #[cfg(feature = "tokio")]
    pub async fn pause(&mut self) {
        tokio::time::sleep(self.wait()).await;
    }

    /// Time to wait before the next try: between half of the current step and all of it.
    pub fn wait(&mut self) -> Duration {
        // xorshift64: jitter needs no better source, and the seed repeats it.
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        let step = self.next;
        self.next = (step * 2).min(self.longest);
        let thousandths = u32::try_from(self.random % 500).unwrap_or(0);
        step / 2 + step / 1000 * thousandths
    }

    /// Begins anew with the first wait, after a try that succeeded.
    pub fn reset(&mut self) {
        self.next = self.first;
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
            assert!(last >= FIRST / 2 && last <= LONGEST);
        }
        assert!(last >= LONGEST / 2);
        backoff.reset();
        assert!(backoff.wait() <= FIRST);
        let mut short = backoff.up_to(FIRST);
        assert!((0..10).all(|_| short.wait() <= FIRST));
    }
}
