//! Channel for one value, received by a thread or by a task of any executor.

use std::future::Future;
use std::pin::Pin;
use std::sync::{Arc, Condvar, PoisonError};
use std::task::{Context, Poll, Waker};

use crate::endpoint::Mutex;

/// Sending side.
pub(super) struct Sender<T>(Arc<Shared<T>>);

/// Receiving side, also a future.
pub(super) struct Receiver<T>(Arc<Shared<T>>);

struct Shared<T> {
    state: Mutex<State<T>>,
    sent: Condvar,
}

struct State<T> {
    value: Option<T>,
    /// True once the sender was dropped, after which no value comes.
    is_closed: bool,
    waker: Option<Waker>,
}

/// Opens a channel for one value.
pub(super) fn channel<T>() -> (Sender<T>, Receiver<T>) {
    let state = Mutex::new(State { value: None, is_closed: false, waker: None });
    let shared = Arc::new(Shared { state, sent: Condvar::new() });
    (Sender(Arc::clone(&shared)), Receiver(shared))
}

impl<T> Sender<T> {
    /// Sends the value.
    pub(super) fn send(self, value: T) {
        self.0.state.lock().value = Some(value);
        // Dropping `self` wakes the receiver.
    }
}

impl<T> Drop for Sender<T> {
    fn drop(&mut self) {
        let waker = {
            let mut state = self.0.state.lock();
            state.is_closed = true;
            state.waker.take()
        };
        self.0.sent.notify_all();
        if let Some(waker) = waker {
            waker.wake();
        }
    }
}

impl<T> Receiver<T> {
    /// Waits for the value; `None` when the sender was dropped without sending it.
    pub(super) fn recv(self) -> Option<T> {
        let state = self.0.state.lock();
        let mut state = self
            .0
            .sent
            .wait_while(state, |state| !state.is_closed)
            .unwrap_or_else(PoisonError::into_inner);
        state.value.take()
    }
}

impl<T> Future for Receiver<T> {
    type Output = Option<T>;

    fn poll(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<T>> {
        let mut state = self.0.state.lock();
        if state.is_closed {
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
        let (sender, receiver) = channel();
        let thread = std::thread::spawn(move || sender.send(7));
        assert_eq!(receiver.recv(), Some(7));
        thread.join().unwrap();
        let (sender, receiver) = channel::<u8>();
        drop(sender);
        assert_eq!(receiver.recv(), None);
    }
}
