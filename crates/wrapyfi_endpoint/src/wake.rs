//! The doorbell by which I/O threads tell the thread that takes messages that there is work.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::task::Waker;
use std::time::Duration;

/// A doorbell: rung by I/O threads, waited on by the thread that takes messages.
///
/// Rings are not counted: one wait answers all rings before it, so the waiter must look at every
/// endpoint that it owns. A ring before the wait is not lost.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use std::time::Duration;
/// use wrapyfi_core::endpoint::Wake;
/// let wake = Wake::new();
/// wake.ring();
/// assert!(wake.wait(Duration::from_secs(60))); // returns at once
/// ```
#[derive(Clone, Debug, Default)]
pub struct Wake(Arc<Doorbell>);

#[derive(Debug, Default)]
struct Doorbell {
    state: Mutex<DoorbellState>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct DoorbellState {
    rung: bool,
    /// Tasks that the next ring wakes.
    tasks: Vec<Waker>,
}

impl Wake {
    /// A doorbell that has not rung.
    pub fn new() -> Self {
        Self::default()
    }

    /// Rings, so that the waiter looks. Never blocks for longer than the flag is held.
    pub fn ring(&self) {
        let tasks = {
            let mut state = self.lock();
            state.rung = true;
            std::mem::take(&mut state.tasks)
        };
        self.0.changed.notify_all();
        tasks.into_iter().for_each(Waker::wake);
    }

    /// Waits until rung, at most `timeout`; true when it was rung.
    pub fn wait(&self, timeout: Duration) -> bool {
        let state = self.lock();
        let (mut state, _) = self
            .0
            .changed
            .wait_timeout_while(state, timeout, |state| !state.rung)
            .unwrap_or_else(PoisonError::into_inner);
        std::mem::take(&mut state.rung)
    }

    /// Makes the next ring wake a task, beside the thread that waits. Call it before the task
    /// looks, so that no ring between is lost.
    pub fn notify(&self, task: &Waker) {
        let mut state = self.lock();
        if !state.tasks.iter().any(|known| known.will_wake(task)) {
            state.tasks.push(task.clone());
        }
    }

    fn lock(&self) -> MutexGuard<'_, DoorbellState> {
        self.0.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};

    use super::*;

    struct Count(AtomicUsize);

    impl std::task::Wake for Count {
        fn wake(self: Arc<Self>) {
            self.0.fetch_add(1, SeqCst);
        }
    }

    #[test]
    fn a_task_is_woken_once_for_each_time_it_asked() {
        let (wake, count) = (Wake::new(), Arc::new(Count(AtomicUsize::new(0))));
        let task = Arc::clone(&count).into();
        wake.notify(&task);
        wake.notify(&task);
        wake.ring();
        wake.ring();
        assert_eq!(count.0.load(SeqCst), 1);
        assert!(wake.wait(Duration::from_secs(60)), "threads are told as well");
    }
}
