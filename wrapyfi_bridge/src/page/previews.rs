//! Messages of the routes that a page shows.
//!
//! Showing one costs time: the next of that route comes when many times as long has passed, so that all that is
//! shown takes a small part of a core, whatever its size.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use wrapyfi_engine::Tap;
use wrapyfi_retry::contained;

use super::preview::{Preview, preview};

/// Time without a request after which no page shows a route.
const GONE_AFTER: Duration = Duration::from_secs(3);
/// Shortest time between two messages that are shown of one route.
const EVERY: Duration = Duration::from_millis(300);
/// Part of a core that the messages of one route may take, as its inverse.
const SHARE: u32 = 400;
/// Longest time between two messages, however long one takes.
const AT_LEAST: Duration = Duration::from_secs(5);

/// A route that is looked at.
struct ViewedRoute {
    tap: Arc<Tap>,
    seen: Instant,
    not_before: Instant,
}

/// The routes that are looked at, by their number.
#[derive(Default)]
pub(super) struct Previews(BTreeMap<String, ViewedRoute>);

impl Previews {
    /// The newest message, where one has come since the last look and it is time for it.
    pub(super) fn look(&mut self, id: &str, tap: Arc<Tap>, now: Instant) -> Option<Preview> {
        let fresh = || ViewedRoute { tap: Arc::clone(&tap), seen: now, not_before: now };
        let look = self.0.entry(id.to_owned()).or_insert_with(fresh);
        look.seen = now;
        if !Arc::ptr_eq(&look.tap, &tap) {
            // The route has begun anew.
            std::mem::replace(&mut look.tap, tap).leave();
        }
        if now < look.not_before {
            return None;
        }
        let payload = look.tap.take()?;
        let begin = Instant::now();
        // What is broken is not shown; that its bytes are foreign, is no reason to end the page.
        let shown = contained(|| preview(&payload)).ok();
        look.not_before = now + (begin.elapsed() * SHARE).clamp(EVERY, AT_LEAST);
        shown
    }

    /// Lets go of those that no page has shown for a while.
    pub(super) fn sweep(&mut self, now: Instant) {
        self.0.retain(|_, look| {
            let is_seen = now.saturating_duration_since(look.seen) < GONE_AFTER;
            if !is_seen {
                look.tap.leave();
            }
            is_seen
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whoever_looks_no_more_is_forgotten() {
        let (mut previews, tap, now) = (Previews::default(), Arc::<Tap>::default(), Instant::now());
        assert!(previews.look("1", Arc::clone(&tap), now).is_none());
        previews.sweep(now + GONE_AFTER / 2);
        assert_eq!(Arc::strong_count(&tap), 2);
        previews.sweep(now + GONE_AFTER);
        assert_eq!(Arc::strong_count(&tap), 1);
    }
}
