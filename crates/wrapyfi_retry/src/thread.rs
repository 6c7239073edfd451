//! Threads that panic begin again, and the place where a panic ends.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use crate::backoff::{Backoff, LONGEST};

/// Runs `act`, and returns the message of its panic as an error. The caller closes or replaces the
/// values that `act` changed.
///
/// # Errors
/// When `act` panics.
pub fn contained<T>(act: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(act)).map_err(|panic| words(panic.as_ref()))
}

fn words(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "a panic without words".to_owned())
}

/// Runs `act`, the work of the thread that `what` names, until it ends. After a panic, which is logged
/// with the number of panics before it, `act` begins again once `pause` has waited. A `pause` that
/// returns false ends the thread.
pub fn restarted(what: &str, mut pause: impl FnMut(Duration) -> bool, mut act: impl FnMut()) {
    let mut backoff = Backoff::of_name(what);
    for panics in 1_u64.. {
        let began = Instant::now();
        let Err(panic) = contained(&mut act) else { return };
        tracing::error!(panics, "{what} panicked, it begins again after a pause: {panic}");
        if began.elapsed() > LONGEST {
            backoff.reset();
        }
        if !pause(backoff.wait()) {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_that_panics_begins_again_until_it_ends_or_is_told_to() {
        let (mut began, mut paused) = (0, Vec::new());
        let pause = |time| {
            paused.push(time);
            true
        };
        restarted("the thread", pause, || {
            began += 1;
            assert!(began == 4, "on purpose");
        });
        assert_eq!((began, paused.len()), (4, 3));
        assert!(paused.is_sorted() && !paused.contains(&Duration::ZERO), "{paused:?}");
        let mut began = 0;
        restarted(
            "the thread",
            |_| false,
            || {
                began += 1;
                panic!("on purpose")
            },
        );
        assert_eq!(began, 1);
    }

    #[test]
    fn the_words_of_a_panic_are_its_error() {
        assert_eq!(contained(|| 7), Ok(7));
        let thrown = |text: String| contained(move || panic!("{text}")).unwrap_err();
        assert_eq!(thrown("on purpose".to_owned()), "on purpose");
        let wordless = contained(|| std::panic::panic_any(7)).unwrap_err();
        assert_eq!(wordless, "a panic without words");
    }
}
