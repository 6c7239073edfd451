//! One value from another thread, waited for by a thread or by a task of any executor.

use std::future::Future;
use std::pin::Pin;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};

/// The side that gives.
pub(super) struct Asked<T>(Arc<Shared<T>>);

/// The side that waits.
pub(super) struct Answer<T>(Arc<Shared<T>>);

struct Shared<T> {
    state: Mutex<State<T>>,
    given: Condvar,
}

struct State<T> {
    value: Option<T>,
    /// Nobody will give any more.
    over: bool,
    waker: Option<Waker>,
}

impl<T> Shared<T> {
    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Both sides.
pub(super) fn answer<T>() -> (Asked<T>, Answer<T>) {
    let state = Mutex::new(State { value: None, over: false, waker: None });
    let shared = Arc::new(Shared { state, given: Condvar::new() });
    (Asked(Arc::clone(&shared)), Answer(shared))
}

impl<T> Asked<T> {
    /// Hands the value over.
    pub(super) fn give(self, value: T) {
        self.0.lock().value = Some(value);
        // Dropping tells the other side.
    }
}

impl<T> Drop for Asked<T> {
    fn drop(&mut self) {
        let waker = {
            let mut state = self.0.lock();
            state.over = true;
            state.waker.take()
        };
        self.0.given.notify_all();
        if let Some(waker) = waker {
            waker.wake();
        }
    }
}

impl<T> Answer<T> {
    /// Waits; `None` when the other side is gone without giving anything.
    pub(super) fn wait(self) -> Option<T> {
        let state = self.0.lock();
        let mut state = self
            .0
            .given
            .wait_while(state, |state| !state.over)
            .unwrap_or_else(PoisonError::into_inner);
        state.value.take()
    }
}

impl<T> Future for Answer<T> {
    type Output = Option<T>;

    fn poll(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<T>> {
        let mut state = self.0.lock();
        if state.over {
            return Poll::Ready(state.value.take());
        }
        state.waker = Some(context.waker().clone());
        Poll::Pending
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_crosses_threads_and_its_absence_is_told() {
        let (asked, waiting) = answer();
        let thread = std::thread::spawn(move || asked.give(7));
        assert_eq!(waiting.wait(), Some(7));
        thread.join().unwrap();
        let (asked, waiting) = answer::<u8>();
        drop(asked);
        assert_eq!(waiting.wait(), None);
    }
}
