//! Memory goes back to the system once much of what waited in this process is gone.
//!
//! ```text
//!   bytes that wait:  much ──▶ a quarter of it, for two seconds ──▶ malloc_trim, once
//! ```
//!
//! glibc keeps what was freed in small pieces for what may come next: a hundred thousand subscriptions that one peer had
//! and has no more would be memory of this process for as long as it lives.
//!
//! Contract of the unsafe code here: `malloc_trim` takes a number and no pointer, may be called by any thread at any time,
//! and gives back pages that no allocation holds.

#![allow(unsafe_code, reason = "a call of glibc for which no crate has a safe one")]

use std::time::{Duration, Instant};

use super::{Mutex, WAITING};

/// Bytes that have waited once; after less nothing is given back.
const MUCH: usize = 16 << 20;
/// Time for which less waits: what is gone for a moment comes back.
const QUIET: Duration = Duration::from_secs(2);

static LOOKS: Mutex<Looks> = Mutex::new(Looks { most: 0, less_since: None });

/// Looks how much waits in this process, and gives memory back where it was much more. Threads that run for as long as the
/// program does call it about twice a second.
pub fn give_memory_back(now: Instant) {
    if LOOKS.try_lock().is_some_and(|mut looks| looks.has_fallen(WAITING.used(), now)) {
        trim();
    }
}

/// Most bytes that waited at one of the looks.
#[derive(Debug)]
struct Looks {
    most: usize,
    /// Time since when it is less than a quarter of that.
    less_since: Option<Instant>,
}

impl Looks {
    /// True once after much has waited and is gone.
    fn has_fallen(&mut self, used: usize, now: Instant) -> bool {
        if used > self.most / 4 {
            self.most = self.most.max(used);
            self.less_since = None;
            return false;
        }
        let less_since = *self.less_since.get_or_insert(now);
        if now.saturating_duration_since(less_since) < QUIET {
            return false;
        }
        let most = std::mem::replace(&mut self.most, used);
        self.less_since = None;
        most >= MUCH
    }
}

#[cfg(target_env = "gnu")]
fn trim() {
    // SAFETY: as the module says.
    let any = unsafe { libc::malloc_trim(0) };
    tracing::debug!(any, "memory that was freed goes back to the system");
}

#[cfg(not(target_env = "gnu"))]
fn trim() {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_goes_back_once_when_much_is_gone_for_good() {
        let mut looks = Looks { most: 0, less_since: None };
        let begin = Instant::now();
        let mut at =
            |used: usize, ms: u64| looks.has_fallen(used, begin + Duration::from_millis(ms));
        assert!(!at(4 * MUCH, 0));
        assert!(!at(MUCH, 500), "it falls");
        assert!(!at(3 * MUCH, 1000), "and comes back");
        assert!(!at(MUCH, 2000) && !at(0, 3500));
        assert!(at(0, 4000));
        assert!(!at(0, 6000) && !at(0, 9000), "once");
        assert!(!at(MUCH / 2, 10_000) && !at(0, 11_000) && !at(0, 14_000), "little has waited");
    }

    #[cfg(target_env = "gnu")]
    #[test]
    fn pieces_that_were_freed_are_no_longer_resident() {
        let resident_pages = || {
            let statm = std::fs::read_to_string("/proc/self/statm").unwrap();
            statm.split(' ').nth(1).unwrap().parse::<usize>().unwrap()
        };
        let mut pieces: Vec<Vec<u8>> = (0..100_000).map(|_| vec![1; 1000]).collect();
        // One in a thousand stays: the end of the heap does not move.
        let kept: Vec<_> = (0..100).map(|n| std::mem::take(&mut pieces[n * 1000 + 999])).collect();
        drop(pieces);
        let before = resident_pages();
        trim();
        assert!(resident_pages() + 10_000 < before, "of {before} pages");
        drop(kept);
    }
}
