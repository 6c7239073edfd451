//! The work on one message shared among the cores of the machine.
//!
//! ```text
//!   jobs 0, 1, 2 … ─┬─ the caller: takes the next one until none is left, then does what is late itself ─▶ results
//!                   └─ helpers: take the next one until none is left, and sleep
//! ```
//!
//! Helpers are threads that stay: one that is woken runs within 20 us, a new one waited 1000 us for a core where
//! the caller computed on (Linux 6.18, two cores).

use std::num::NonZero;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Condvar, LazyLock, Mutex, MutexGuard, PoisonError, Weak};
use std::thread::{self, Builder};
use std::time::Instant;

/// Most threads that work on one message.
const MOST: usize = 4;

/// Number of threads that one message is worth on this machine: as many as it has cores, at most four.
pub(super) fn cores() -> usize {
    // Asking reads files of the system, which takes as long as a small picture.
    static CORES: LazyLock<usize> =
        LazyLock::new(|| thread::available_parallelism().map_or(1, NonZero::get).min(MOST));
    *CORES
}

/// Results of `work` for each number below `count`, made by the caller and `threads - 1` helpers.
///
/// A helper that is busy with another message, or that the system does not let run, costs little: others take its
/// jobs, and the caller does the one that it has begun once more.
pub(super) fn share<R: Send + 'static>(
    threads: usize,
    count: usize,
    work: impl Fn(usize) -> R + Send + Sync + 'static,
) -> Vec<R> {
    let begun = Instant::now();
    let results = Results { of: (0..count).map(|_| None).collect(), missing: count };
    let shared = Shared {
        work,
        next: AtomicUsize::new(0),
        results: Mutex::new(results),
        all_there: Condvar::new(),
    };
    let shared = Arc::new(shared);
    let labour: Arc<dyn Labour> = shared.clone();
    wake(threads.min(count).saturating_sub(1), &labour);
    let done_here = shared.labour();
    // Where cores are free, the others end within one job of here.
    let patience = begun.elapsed() / u32::try_from(done_here.max(1)).unwrap_or(u32::MAX);
    let waited = shared
        .all_there
        .wait_timeout_while(shared.results(), patience, |results| results.missing > 0);
    drop(waited);
    for number in 0..count {
        if shared.results().is_missing(number) {
            let result = (shared.work)(number);
            shared.results().put(number, result);
        }
    }
    let results = std::mem::take(&mut shared.results().of);
    results.into_iter().flatten().collect()
}

/// Jobs of any kind, as a helper sees them.
trait Labour: Send + Sync {
    /// Does jobs until each is begun; their number.
    fn labour(&self) -> usize;
}

/// Threads that sleep until they are told of jobs.
struct Helpers {
    /// The process that they are threads of: the child of a fork has none of its parent's.
    process: u32,
    /// Each takes one message more than that which it works on.
    tell: Vec<SyncSender<Weak<dyn Labour>>>,
}

impl Helpers {
    const fn new() -> Self {
        Self { process: 0, tell: Vec::new() }
    }

    fn add(&mut self) -> std::io::Result<()> {
        let (tell, told) = sync_channel::<Weak<dyn Labour>>(1);
        Builder::new().name("strips".to_owned()).spawn(move || {
            // Jobs whose caller has what it wants are gone.
            for jobs in told.iter().filter_map(|jobs| jobs.upgrade()) {
                jobs.labour();
            }
        })?;
        self.tell.push(tell);
        Ok(())
    }
}

/// Tells `count` helpers of jobs. Nobody waits for them: in the child of a fork the lock may be held for ever.
fn wake(count: usize, jobs: &Arc<dyn Labour>) {
    static HELPERS: Mutex<Helpers> = Mutex::new(Helpers::new());
    let Ok(mut helpers) = HELPERS.try_lock() else { return };
    let process = std::process::id();
    if helpers.process != process {
        let parents = std::mem::replace(&mut *helpers, Helpers { process, tell: Vec::new() });
        // To close these channels would be to wake threads that are not there.
        std::mem::forget(parents);
    }
    while helpers.tell.len() < count && helpers.add().is_ok() {}
    for tell in helpers.tell.iter().take(count) {
        // One that has enough to do is told nothing.
        drop(tell.try_send(Arc::downgrade(jobs)));
    }
}

struct Shared<W, R> {
    work: W,
    /// The first job that nobody has begun.
    next: AtomicUsize,
    results: Mutex<Results<R>>,
    all_there: Condvar,
}

struct Results<R> {
    of: Vec<Option<R>>,
    missing: usize,
}

impl<R> Results<R> {
    fn is_missing(&self, number: usize) -> bool {
        matches!(self.of.get(number), Some(None))
    }

    /// Keeps the first result of a job.
    fn put(&mut self, number: usize, result: R) {
        if let Some(place @ None) = self.of.get_mut(number) {
            *place = Some(result);
            self.missing -= 1;
        }
    }
}

impl<W, R> Shared<W, R> {
    fn results(&self) -> MutexGuard<'_, Results<R>> {
        self.results.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<R: Send, W: Fn(usize) -> R + Send + Sync> Labour for Shared<W, R> {
    fn labour(&self) -> usize {
        let count = self.results().of.len();
        let mut done = 0;
        loop {
            let number = self.next.fetch_add(1, Ordering::Relaxed);
            if number >= count {
                return done;
            }
            let result = (self.work)(number);
            let mut results = self.results();
            results.put(number, result);
            if results.missing == 0 {
                self.all_there.notify_all();
            }
            done += 1;
        }
    }
}

/// Things that the next message needs too: pages that were touched before, tables that are there.
pub(super) struct Kept<T> {
    list: Mutex<Vec<T>>,
}

impl<T> Kept<T> {
    pub(super) const fn new() -> Self {
        Self { list: Mutex::new(Vec::new()) }
    }

    /// One that was kept. Nobody waits for it: in the child of a fork the lock may be held for ever.
    pub(super) fn take(&self) -> Option<T> {
        self.list.try_lock().ok()?.pop()
    }

    /// Keeps one more, as many in all as work on one message.
    pub(super) fn give(&self, one: T) {
        if let Ok(mut list) = self.list.try_lock()
            && list.len() < MOST
        {
            list.push(one);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_job_has_its_result() {
        for (threads, count) in [(1, 0), (1, 5), (2, 1), (2, 100), (4, 3), (4, 1000)] {
            let results = share(threads, count, |number| number * 2);
            assert_eq!(results, (0..count).map(|it| it * 2).collect::<Vec<_>>());
        }
    }

    /// The other thread never ends its job, and the caller does.
    #[test]
    fn a_thread_that_does_not_run_holds_up_nothing() {
        let (caller, waits) = (thread::current().id(), Mutex::new(()));
        let waits: &'static Mutex<()> = Box::leak(Box::new(waits));
        let held = waits.lock().unwrap();
        let results = share(2, 2, move |number| {
            if thread::current().id() != caller {
                drop(waits.lock());
            }
            number
        });
        assert_eq!(results, [0, 1]);
        drop(held);
    }

    #[test]
    fn what_is_kept_is_bounded() {
        let kept = Kept::new();
        (0..10).for_each(|it| kept.give(it));
        assert_eq!(std::iter::from_fn(|| kept.take()).count(), MOST);
    }
}
