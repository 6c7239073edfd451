//! The newest message of a route, for a reader that looks now and then.
//!
//! ```text
//!   data path ─ show(payload) ─▶ no reader wants one: a load, and nothing else
//!                             └▶ else: kept, once ─▶ take()
//! ```

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use wrapyfi_data::types::Payload;
use wrapyfi_endpoint::Mutex;

/// Window on the messages of one route.
#[derive(Debug, Default)]
pub struct Tap {
    is_wanted: AtomicBool,
    newest: Mutex<Option<Payload>>,
}

impl Tap {
    /// Shows a message that has just come. It is kept where a reader wants one, and its bytes are shared.
    pub(super) fn show(&self, payload: &Payload) {
        if self.is_wanted.load(Relaxed) {
            let mut newest = self.newest.lock();
            // Another may have left since.
            if self.is_wanted.swap(false, Relaxed) {
                *newest = Some(payload.clone());
            }
        }
    }

    /// The message that was kept, if any has come since the last call; asks for the next one.
    #[must_use]
    pub fn take(&self) -> Option<Payload> {
        let mut newest = self.newest.lock();
        self.is_wanted.store(true, Relaxed);
        newest.take()
    }

    /// Asks for no more messages, and lets go of the one that was kept.
    pub fn leave(&self) {
        let mut newest = self.newest.lock();
        self.is_wanted.store(false, Relaxed);
        *newest = None;
    }
}

#[cfg(test)]
mod tests {
    use wrapyfi_data::types::Value;

    use super::*;

    #[test]
    fn one_message_is_kept_for_each_look_and_none_while_nobody_looks() {
        let tap = Tap::default();
        let payload = |number: i64| Payload::from(Value::from(number));
        tap.show(&payload(1));
        assert_eq!(tap.take(), None, "nobody looked");
        tap.show(&payload(2));
        tap.show(&payload(3));
        assert_eq!(tap.take(), Some(payload(2)), "the first one after the look, and no other");
        tap.show(&payload(4));
        tap.leave();
        assert_eq!(*tap.newest.lock(), None, "whoever left holds no memory");
        tap.show(&payload(5));
        assert_eq!(*tap.newest.lock(), None);
    }
}
