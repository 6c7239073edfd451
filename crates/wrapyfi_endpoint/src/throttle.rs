//! Throttle for log lines that repeat.
//!
//! ```text
//!   complaint ─▶ pass ─ first, or the last is long ago ─▶ log it, and how many were not
//!                  └─ too soon ─▶ counted ── rest ─▶ the sum, when its time has come
//! ```

use std::collections::BTreeMap;
use std::hash::{BuildHasher as _, Hash, RandomState};
use std::time::{Duration, Instant};

/// Throttle that lets the first of many complaints through at once, then one every
/// [`Throttle::EVERY`], and counts those kept back.
///
/// ```
/// use std::time::Instant;
/// use wrapyfi_endpoint::Throttle;
/// let (mut refused, now) = (Throttle::default(), Instant::now());
/// assert_eq!(refused.pass(now), Some(0));
/// assert_eq!(refused.pass(now), None);
/// assert_eq!(refused.rest(now), None);
/// assert_eq!(refused.rest(now + Throttle::EVERY), Some(1));
/// ```
#[derive(Debug, Clone, Default)]
pub struct Throttle {
    /// Number of complaints that pass before the throttle begins.
    free: u32,
    last: Option<Instant>,
    silent: u64,
}

impl Throttle {
    /// Least time between two lines.
    pub const EVERY: Duration = Duration::from_secs(5);

    /// A throttle that begins after so many complaints, all of which pass.
    ///
    /// ```
    /// use std::time::Instant;
    /// use wrapyfi_endpoint::Throttle;
    /// let (mut reasons, now) = (Throttle::after(2), Instant::now());
    /// let passed = [reasons.pass(now), reasons.pass(now), reasons.pass(now), reasons.pass(now)];
    /// assert_eq!(passed, [Some(0), Some(0), Some(0), None]);
    /// ```
    pub fn after(free: u32) -> Self {
        Self { free, ..Self::default() }
    }

    /// Counts a complaint. `Some(n)` where it is to be logged, n complaints before it not having been.
    pub fn pass(&mut self, now: Instant) -> Option<u64> {
        if let Some(left) = self.free.checked_sub(1) {
            self.free = left;
            return Some(0);
        }
        if self.due().is_some_and(|at| now < at) {
            self.silent = self.silent.saturating_add(1);
            return None;
        }
        self.last = Some(now);
        Some(std::mem::take(&mut self.silent))
    }

    /// Number of complaints that were not logged, once it is time to log it: for the end of a
    /// flood, which no further complaint would report. `None` where there are none.
    pub fn rest(&mut self, now: Instant) -> Option<u64> {
        if self.silent == 0 || self.due().is_some_and(|at| now < at) {
            return None;
        }
        self.last = Some(now);
        Some(std::mem::take(&mut self.silent))
    }

    /// As [`Throttle::rest`], without waiting for the time: for the end of the complaints' source.
    pub fn finish(&mut self) -> Option<u64> {
        let silent = std::mem::take(&mut self.silent);
        (silent > 0).then_some(silent)
    }

    fn due(&self) -> Option<Instant> {
        self.last.map(|at| at + Self::EVERY)
    }
}

/// Throttles of complaints by their subject, so that a subject with many complaints hides no other one. Beyond
/// [`Self::MOST`] at a time, the others have one together.
///
/// ```
/// use std::time::Instant;
/// use wrapyfi_endpoint::Throttles;
/// let (mut complaints, now) = (Throttles::default(), Instant::now());
/// assert_eq!(complaints.pass(&"/camera", now), Some(0));
/// assert_eq!(complaints.pass(&"/camera", now), None);
/// assert_eq!(complaints.pass(&"/arm", now), Some(0)); // another subject
/// ```
#[derive(Debug, Default)]
pub struct Throttles(BTreeMap<u64, Throttle>, RandomState);

impl Throttles {
    /// Most subjects at a time.
    pub const MOST: usize = 256;

    /// As [`Throttle::pass`], for a complaint about a subject.
    pub fn pass(&mut self, subject: &impl Hash, now: Instant) -> Option<u64> {
        let subject = self.1.hash_one(subject);
        if self.0.len() >= Self::MOST && !self.0.contains_key(&subject) {
            self.0.retain(|_, one| one.due().is_some_and(|at| now < at));
        }
        let is_full = self.0.len() >= Self::MOST && !self.0.contains_key(&subject);
        self.0.entry(if is_full { 0 } else { subject }).or_default().pass(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_hides_its_own_subject_alone() {
        let (mut throttles, start) = (Throttles::default(), Instant::now());
        let passed = (0..1000).filter_map(|_| throttles.pass(&"flood", start)).count();
        assert_eq!((passed, throttles.pass(&"other", start)), (1, Some(0)));
        let many = (0..1000).filter_map(|n| throttles.pass(&n, start)).count();
        assert_eq!(many, Throttles::MOST - 1, "those beyond have one together");
        assert!(throttles.0.len() <= Throttles::MOST + 1);
        let later = start + Throttle::EVERY;
        assert_eq!(throttles.pass(&"new", later), Some(0));
        assert_eq!(throttles.0.len(), 1, "those before are over");
    }

    #[test]
    fn a_flood_is_one_line_and_its_sum() {
        let (mut throttle, start) = (Throttle::default(), Instant::now());
        let passed: Vec<_> =
            (0..1000).filter_map(|ms| throttle.pass(start + Duration::from_millis(ms))).collect();
        assert_eq!(passed, [0]);
        assert_eq!(throttle.rest(start + Duration::from_secs(1)), None, "too soon");
        assert_eq!(throttle.pass(start + Throttle::EVERY), Some(999));
        assert_eq!(throttle.pass(start + Throttle::EVERY), None);
        assert_eq!(throttle.rest(start + 2 * Throttle::EVERY), Some(1));
        assert_eq!(throttle.rest(start + 3 * Throttle::EVERY), None, "told already");
        assert_eq!(throttle.pass(start + 4 * Throttle::EVERY), Some(0));
        assert_eq!(throttle.pass(start + 4 * Throttle::EVERY), None);
        assert_eq!((throttle.finish(), throttle.finish()), (Some(1), None));
    }
}
