//! How an I/O thread tells the thread that propagates messages that there is work.

use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

/// A doorbell: rung by I/O threads, waited on by the thread that takes messages.
///
/// Rings are not counted: one wait answers all rings before it, so the waiter must look at every
/// endpoint it owns. A ring before the wait is not lost.
///
/// ```
/// use std::time::Duration;
/// use wrapyfi_core::endpoint::Wake;
/// let wake = Wake::new();
/// wake.ring();
/// assert!(wake.wait(Duration::from_secs(60))); // returns at once
/// ```
#[derive(Clone, Debug, Default)]
pub struct Wake(Arc<Bell>);

#[derive(Debug, Default)]
struct Bell {
    rung: Mutex<bool>,
    changed: Condvar,
}

impl Wake {
    /// A doorbell nobody has rung.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Tells the waiter to look. Never blocks for longer than the flag is held.
    pub fn ring(&self) {
        *self.0.rung.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.0.changed.notify_all();
    }

    /// Waits until rung, at most `timeout`; true when it was rung.
    pub fn wait(&self, timeout: Duration) -> bool {
        let rung = self.0.rung.lock().unwrap_or_else(PoisonError::into_inner);
        let (mut rung, _) = self
            .0
            .changed
            .wait_timeout_while(rung, timeout, |rung| !*rung)
            .unwrap_or_else(PoisonError::into_inner);
        std::mem::take(&mut *rung)
    }
}
