//! Memory goes back to the system once much of what waited in this process is gone, and once its start is over.
//!
//! ```text
//!   most bytes that waited, and of routes:  much ──▶ half of it, for two seconds ──▶ malloc_trim, once
//!   large buffers:  mapped one by one ──▶ the first large message, or the end of the start: kept for the next
//! ```
//!
//! glibc keeps what was freed in small pieces for what may come next: a hundred thousand subscriptions that one peer had
//! and has no more would be memory of this process for as long as it lives.
//!
//! Contract of the unsafe code here: `malloc_trim` takes a number and no pointer, may be called by any thread at any time,
//! and gives back pages that no allocation holds. `mallopt` takes two numbers; of those that are set here every `free` of a
//! large buffer may set two, without a lock, and the third is read where a thread first allocates, so that any thread may.

#![allow(unsafe_code, reason = "a call of glibc for which no crate has a safe one")]

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use super::{Mutex, WAITING};

/// Bytes that have waited once; after less nothing is given back.
const MUCH: usize = 16 << 20;
/// Bytes of a route that is open, in small pieces: its ends, their names and what DDS keeps of them.
const OF_ROUTE: usize = 64 << 10;
/// Time for which less waits: what is gone for a moment comes back.
const QUIET: Duration = Duration::from_secs(2);

/// Time from the first look until a start is over.
const START: Duration = Duration::from_secs(3);
/// Size from which glibc maps a buffer alone, until it has learned better.
const LARGE: usize = 128 << 10;

static LOOKS: Mutex<Looks> = Mutex::new(Looks { most: 0, less_since: None, start: Start::Waits });
static STARTS_SMALL: AtomicBool = AtomicBool::new(false);
static KEEPS_LARGE: AtomicBool = AtomicBool::new(false);
static ROUTES: AtomicUsize = AtomicUsize::new(0);

/// Has every large buffer mapped alone and unmapped when it is freed, until the first large message waits or
/// [`give_memory_back`] finds that the start is over, and for all small ones as many heaps as there are cores.
///
/// glibc makes eight for each core, and what one thread has freed in its heap no other thread uses again.
///
/// glibc stops doing so with the first that is freed. A start frees many that it takes for a moment, lists of network
/// interfaces of 1 MiB each above all, whose pages would stay under what lives as long as the process.
pub fn start_small() {
    STARTS_SMALL.store(true, Ordering::Relaxed);
    KEEPS_LARGE.store(false, Ordering::Relaxed);
    map_from(LARGE as libc::c_int, LARGE as libc::c_int);
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    set_heaps(libc::c_int::try_from(cores).unwrap_or(1));
}

/// Takes note of a message of `bytes` bytes that waits: where that is large, its buffers are kept for the next from now
/// on. A page that is mapped anew for each message costs more than all that a route does with it. This goes for every
/// program: glibc by itself gives the free end of a heap back once it has twice the size of the largest buffer, so that up to
/// half the pages of each picture were new.
pub(super) fn note_message(bytes: usize) {
    if bytes >= LARGE {
        keep_large();
    }
}

/// Has large buffers come from the heaps, once.
fn keep_large() {
    if !KEEPS_LARGE.load(Ordering::Relaxed) && !KEEPS_LARGE.swap(true, Ordering::Relaxed) {
        // The most that glibc would come to by itself: a picture in the heap costs no page fault a page.
        map_from(32 << 20, 16 << 20);
    }
}

/// Takes note of the number of routes that are open in this process, for [`give_memory_back`].
pub fn note_routes(count: usize) {
    ROUTES.store(count, Ordering::Relaxed);
}

/// Looks how much has waited in this process since the last look and how many routes are open, and gives memory back where it
/// was twice as much or more, or where the start is over: of a stream that stalled for a moment the buffers that waited then are
/// not kept for as long as it runs. Threads that run for as long as the program does call it about twice a second.
pub fn give_memory_back(now: Instant) {
    let Some(mut looks) = LOOKS.try_lock() else { return };
    let started = looks.start.is_over(now);
    // A program that has not asked for it keeps glibc's own rule until it has a large message.
    if started && STARTS_SMALL.load(Ordering::Relaxed) {
        keep_large();
    }
    let peak = WAITING.take_peak() + ROUTES.load(Ordering::Relaxed) * OF_ROUTE;
    if looks.has_fallen(peak, now) || started {
        trim();
    }
}

/// The start of this process, from the first look.
#[derive(Debug)]
enum Start {
    Waits,
    Runs(Instant),
    Over,
}

impl Start {
    /// True once.
    fn is_over(&mut self, now: Instant) -> bool {
        match *self {
            Self::Waits => *self = Self::Runs(now),
            Self::Runs(since) if now.saturating_duration_since(since) >= START => {
                *self = Self::Over;
                return true;
            }
            Self::Runs(_) | Self::Over => {}
        }
        false
    }
}

/// Most bytes that waited before one of the looks.
#[derive(Debug)]
struct Looks {
    most: usize,
    /// Time since when it is no more than half of that.
    less_since: Option<Instant>,
    start: Start,
}

impl Looks {
    /// True once after much has waited and half of it or more is gone; `peak` is what waited at most since the last look.
    fn has_fallen(&mut self, peak: usize, now: Instant) -> bool {
        if peak > self.most / 2 {
            self.most = self.most.max(peak);
            self.less_since = None;
            return false;
        }
        let less_since = *self.less_since.get_or_insert(now);
        if now.saturating_duration_since(less_since) < QUIET {
            return false;
        }
        let most = std::mem::replace(&mut self.most, peak);
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

/// Buffers of so many bytes are mapped alone; of what is free at the end of a heap so many bytes stay.
#[cfg(target_env = "gnu")]
fn map_from(bytes: libc::c_int, kept: libc::c_int) {
    // SAFETY: as the module says.
    let set = unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, bytes) & libc::mallopt(libc::M_TRIM_THRESHOLD, kept)
    };
    tracing::debug!(set, bytes, kept, "large buffers");
}

#[cfg(not(target_env = "gnu"))]
fn map_from(_bytes: i32, _kept: i32) {}

#[cfg(target_env = "gnu")]
fn set_heaps(count: libc::c_int) {
    // SAFETY: as the module says.
    let set = unsafe { libc::mallopt(libc::M_ARENA_MAX, count) };
    tracing::debug!(set, count, "heaps");
}

#[cfg(not(target_env = "gnu"))]
fn set_heaps(_count: i32) {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_goes_back_once_when_much_is_gone_for_good() {
        let mut looks = Looks { most: 0, less_since: None, start: Start::Over };
        let begin = Instant::now();
        let mut at =
            |peak: usize, ms: u64| looks.has_fallen(peak, begin + Duration::from_millis(ms));
        assert!(!at(4 * MUCH, 0));
        assert!(!at(2 * MUCH, 500), "it falls");
        assert!(!at(3 * MUCH, 1000), "and comes back");
        assert!(!at(MUCH, 2000) && !at(2 * MUCH, 3500), "a stream goes on with half of it");
        assert!(at(MUCH, 4000));
        assert!(!at(MUCH, 6000) && !at(MUCH, 9000), "once");
        assert!(!at(0, 9500) && at(0, 11_500), "the rest goes, too");
        assert!(!at(MUCH / 2, 12_000) && !at(0, 13_000) && !at(0, 16_000), "little has waited");
    }

    #[test]
    fn a_start_is_over_once() {
        let mut start = Start::Waits;
        let begin = Instant::now();
        let mut at = |ms: u64| start.is_over(begin + Duration::from_millis(ms));
        assert!(!at(0) && !at(2900));
        assert!(at(3000));
        assert!(!at(3500) && !at(9000));
    }

    #[cfg(target_env = "gnu")]
    #[test]
    fn a_small_start_keeps_no_page_of_large_buffers() {
        let dirty = || {
            let maps = std::fs::read_to_string("/proc/self/smaps_rollup").unwrap();
            let line = maps.lines().find(|line| line.starts_with("Private_Dirty:")).unwrap();
            line.split_whitespace().nth(1).unwrap().parse::<usize>().unwrap()
        };
        start_small();
        let before = dirty();
        for _ in 0..4 {
            drop(std::hint::black_box(vec![1_u8; 8 << 20]));
        }
        let lasting = std::hint::black_box(Vec::<u8>::with_capacity(6 << 20));
        assert!(dirty() < before + 2048, "of {before} KiB");
        drop(lasting);
    }

    #[cfg(target_env = "gnu")]
    #[test]
    fn the_buffers_of_the_second_large_message_are_those_of_the_first() {
        // Pages that were mapped for one buffer.
        let faults = || {
            let all = || {
                let stat = std::fs::read_to_string("/proc/self/stat").unwrap();
                let fields = stat.rsplit_once(") ").unwrap().1.to_owned();
                fields.split(' ').nth(7).unwrap().parse::<usize>().unwrap()
            };
            let before = all();
            drop(std::hint::black_box(vec![1_u8; 4 << 20]));
            all() - before
        };
        start_small();
        note_message(LARGE - 1);
        assert!(faults() > 900 && faults() > 900);
        note_message(LARGE);
        assert!(faults() > 900, "the heap grows");
        let again = faults();
        assert!(again < 100, "{again} pages");
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
