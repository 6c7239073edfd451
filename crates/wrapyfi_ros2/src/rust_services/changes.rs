//! Tells one owner what readers and writers there are, whenever that changes.
//!
//! ```text
//!   set ── the newest ──▶ Changes ── tell, no lock held ──▶ on_change(endpoints)
//!                             ▲ changed meanwhile, by whom ever: told again ─┘
//! ```
//!
//! The callback may do what it likes, create and drop services included: what that changes is told
//! after it returns, by the thread that is telling already.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use super::announce::ServiceEndpoints;
use wrapyfi_endpoint::Mutex;

/// Function that is called with the endpoints that exist.
pub(super) type OnChange = Arc<dyn Fn(&ServiceEndpoints) + Send + Sync>;

/// Endpoints of the services, and those who are notified of changes.
#[derive(Default)]
pub(super) struct Changes(Mutex<State>);

#[derive(Default)]
struct State {
    endpoints: ServiceEndpoints,
    on_change: Option<OnChange>,
    notifying: bool,
    unreported: bool,
}

impl Changes {
    /// Endpoints that exist.
    pub(super) fn endpoints(&self) -> ServiceEndpoints {
        self.0.lock().endpoints.clone()
    }

    /// Notes the endpoints that exist, which the next [`Changes::notify`] reports.
    pub(super) fn set(&self, endpoints: &ServiceEndpoints) {
        let mut state = self.0.lock();
        state.endpoints = endpoints.clone();
        state.unreported = true;
    }

    /// Notifies `on_change` from now on, instead of the function before.
    pub(super) fn notify_by(&self, on_change: OnChange) {
        let before = {
            let mut state = self.0.lock();
            state.unreported = true;
            state.on_change.replace(on_change)
        };
        // It is foreign code too.
        drop(before);
        self.notify();
    }

    /// Reports a change that is not reported yet. Another thread that is reporting goes on with it.
    pub(super) fn notify(&self) {
        let mut state = self.0.lock();
        if state.notifying {
            return;
        }
        while state.unreported {
            let Some(on_change) = state.on_change.clone() else { return };
            (state.notifying, state.unreported) = (true, false);
            let endpoints = state.endpoints.clone();
            drop(state);
            if catch_unwind(AssertUnwindSafe(|| on_change(&endpoints))).is_err() {
                tracing::error!("a callback for endpoints of services panicked");
            }
            // The last of it where it was replaced while it was called.
            drop(on_change);
            state = self.0.lock();
            state.notifying = false;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;

    fn ends(count: u8) -> ServiceEndpoints {
        ServiceEndpoints { readers: (0..count).map(|n| [n; 16]).collect(), writers: Vec::new() }
    }

    /// Numbers of readers, in the order in which they were reported.
    fn told(changes: &Changes) -> mpsc::Receiver<usize> {
        let (sender, receiver) = mpsc::channel();
        changes.notify_by(Arc::new(move |ends| sender.send(ends.readers.len()).unwrap()));
        receiver
    }

    #[test]
    fn the_newest_is_told_at_once_and_after_each_change() {
        let changes = Changes::default();
        let first = told(&changes);
        for count in [1, 2] {
            changes.set(&ends(count));
            changes.notify();
            changes.notify();
        }
        let second = told(&changes);
        changes.set(&ends(3));
        changes.notify();
        assert_eq!(first.try_iter().collect::<Vec<_>>(), [0, 1, 2]);
        assert_eq!(second.try_iter().collect::<Vec<_>>(), [2, 3]);
        assert_eq!(changes.endpoints(), ends(3));
    }

    /// With a lock held, each of these would wait for itself.
    #[test]
    fn the_callback_may_look_change_and_replace_itself() {
        let changes = Arc::new(Changes::default());
        let (sender, seen) = mpsc::channel();
        let inner = Arc::downgrade(&changes);
        changes.notify_by(Arc::new(move |ends_now| {
            let changes = inner.upgrade().unwrap();
            let count = ends_now.readers.len();
            assert_eq!(changes.endpoints().readers.len(), count);
            sender.send(count).unwrap();
            if count < 3 {
                changes.set(&ends(u8::try_from(count).unwrap() + 1));
                changes.notify();
            } else {
                let sender = sender.clone();
                changes
                    .notify_by(Arc::new(move |ends| sender.send(10 + ends.readers.len()).unwrap()));
            }
        }));
        assert_eq!(seen.try_iter().collect::<Vec<_>>(), [0, 1, 2, 3, 13]);
        changes.set(&ends(1));
        changes.notify();
        assert_eq!(seen.try_iter().collect::<Vec<_>>(), [11]);
    }

    #[test]
    fn one_that_panics_is_told_the_next_change_too() {
        let changes = Changes::default();
        let (sender, seen) = mpsc::channel();
        changes.notify_by(Arc::new(move |ends| {
            sender.send(ends.readers.len()).unwrap();
            panic!("a fault of the user");
        }));
        changes.set(&ends(1));
        changes.notify();
        assert_eq!(seen.try_iter().collect::<Vec<_>>(), [0, 1]);
    }

    #[test]
    fn threads_together_leave_the_newest_told() {
        let changes = Arc::new(Changes::default());
        let last = Arc::new(Mutex::new(usize::MAX));
        let seen = Arc::clone(&last);
        changes.notify_by(Arc::new(move |ends| *seen.lock() = ends.readers.len()));
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for count in 0..100 {
                        changes.set(&ends(count));
                        changes.notify();
                    }
                });
            }
        });
        // Whoever told last was not alone, but nothing is left unreported.
        assert_eq!(*last.lock(), changes.endpoints().readers.len());
    }
}
