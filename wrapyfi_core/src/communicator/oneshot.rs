//! Channel for one value, received by a thread or by a task of any executor.

use std::future::Future;
use std::pin::Pin;
use std::sync::mpsc;
use std::task::{Context, Poll};
use std::time::Duration;

use wrapyfi_endpoint::Wake;

/// Sending side. The doorbell is dropped last: who is woken by it finds the value, or that none comes.
pub(super) struct Sender<T> {
    value: mpsc::Sender<T>,
    _done: RingOnDrop,
}

/// Receiving side, also a future.
pub(super) struct Receiver<T> {
    value: mpsc::Receiver<T>,
    done: Wake,
}

struct RingOnDrop(Wake);

impl Drop for RingOnDrop {
    fn drop(&mut self) {
        self.0.ring();
    }
}

/// Opens a channel for one value.
pub(super) fn channel<T>() -> (Sender<T>, Receiver<T>) {
    let ((sender, value), done) = (mpsc::channel(), Wake::new());
    (Sender { value: sender, _done: RingOnDrop(done.clone()) }, Receiver { value, done })
}

impl<T> Sender<T> {
    /// Sends the value.
    pub(super) fn send(self, value: T) {
        // A receiver that is gone does not want it.
        drop(self.value.send(value));
    }
}

impl<T> Receiver<T> {
    /// Waits for the value; `None` when the sender was dropped without sending it.
    pub(super) fn recv(self) -> Option<T> {
        self.value.recv().ok()
    }

    /// As [`Receiver::recv`], asking `is_over` meanwhile, whose yes ends the wait.
    pub(super) fn recv_until(self, every: Duration, is_over: impl Fn() -> bool) -> Option<T> {
        loop {
            match self.value.recv_timeout(every) {
                Err(mpsc::RecvTimeoutError::Timeout) if !is_over() => {}
                received => return received.ok(),
            }
        }
    }
}

impl<T> Future for Receiver<T> {
    type Output = Option<T>;

    fn poll(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<T>> {
        self.done.notify(context.waker());
        match self.value.try_recv() {
            Ok(value) => Poll::Ready(Some(value)),
            Err(mpsc::TryRecvError::Disconnected) => Poll::Ready(None),
            Err(mpsc::TryRecvError::Empty) => Poll::Pending,
        }
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
        let (sender, receiver) = channel::<u8>();
        assert_eq!(receiver.recv_until(Duration::from_millis(1), || true), None);
        drop(sender);
    }
}
