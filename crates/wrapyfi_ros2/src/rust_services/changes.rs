//! Tells one owner what readers and writers there are, whenever that changes.
//!
//! The owner is told under the lock, so that it hears of changes in their order: what it does must not create or drop
//! a service.

use super::announce::ServiceEndpoints;
use wrapyfi_endpoint::Mutex;

/// Function that is called with the endpoints that exist.
pub(super) type OnChange = Box<dyn Fn(&ServiceEndpoints) + Send + Sync>;

/// Endpoints of the services, and the function that is told of changes.
#[derive(Default)]
pub(super) struct Changes(Mutex<(ServiceEndpoints, Option<OnChange>)>);

impl Changes {
    /// Endpoints that exist.
    pub(super) fn endpoints(&self) -> ServiceEndpoints {
        self.0.lock().0.clone()
    }

    /// Notes and tells the endpoints that exist.
    pub(super) fn set(&self, endpoints: &ServiceEndpoints) {
        let (known, on_change) = &mut *self.0.lock();
        known.clone_from(endpoints);
        on_change.iter().for_each(|on_change| on_change(known));
    }

    /// Has `on_change` told of the endpoints that exist, now and after each change.
    pub(super) fn notify_by(&self, on_change: OnChange) {
        let (known, known_by) = &mut *self.0.lock();
        on_change(known);
        *known_by = Some(on_change);
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
        changes.notify_by(Box::new(move |ends| sender.send(ends.readers.len()).unwrap()));
        receiver
    }

    #[test]
    fn the_newest_is_told_at_once_and_after_each_change() {
        let changes = Changes::default();
        let first = told(&changes);
        for count in [1, 2] {
            changes.set(&ends(count));
        }
        let second = told(&changes);
        changes.set(&ends(3));
        assert_eq!(first.try_iter().collect::<Vec<_>>(), [0, 1, 2]);
        assert_eq!(second.try_iter().collect::<Vec<_>>(), [2, 3]);
        assert_eq!(changes.endpoints(), ends(3));
    }

    #[test]
    fn threads_together_leave_the_newest_told() {
        let changes = Changes::default();
        let told = told(&changes);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| (0..100).for_each(|count| changes.set(&ends(count))));
            }
        });
        assert_eq!(told.try_iter().last(), Some(changes.endpoints().readers.len()));
    }
}
