//! The wait of a call: its time-out, the lines it logs meanwhile, and its early end.

use std::io::Write as _;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::SeqCst};
use std::time::{Duration, Instant};

use super::error::MethodError;
use wrapyfi_endpoint::Link;

/// Time after which a wait logs the thing that it waits for, the first time.
const SAY_AFTER: Duration = Duration::from_secs(1);
const SAY_EVERY: Duration = Duration::from_secs(5);

/// Writes a line to standard error where the program has no subscriber of the log, whose user
/// would not see why it stands still. False where it has one.
pub(super) fn to_stderr(line: std::fmt::Arguments<'_>) -> bool {
    if tracing::dispatcher::has_been_set() {
        return false;
    }
    // A closed standard error is no reason to fail.
    drop(writeln!(std::io::stderr(), "{line}"));
    true
}

/// The thing that is waited for, with the reason that it cannot come at the moment.
pub(super) fn with_reason(what: String, link: Link) -> String {
    match link.waiting_for {
        Some(reason) => format!("{what} ({reason})"),
        None => what,
    }
}

/// Longest time between two questions to what may interrupt a wait.
pub(super) const ASK_EVERY: Duration = Duration::from_millis(50);

/// Question whether something from outside, such as a signal, ends the waits of the thread that asks.
pub type IsInterrupted = fn() -> bool;

/// Switch that ends the waits of one method.
#[derive(Debug, Default)]
pub(super) struct Stop {
    ended: AtomicBool,
    cancels: AtomicU64,
    is_interrupted: Option<IsInterrupted>,
}

impl Stop {
    pub(super) fn new(is_interrupted: Option<IsInterrupted>) -> Self {
        Self { is_interrupted, ..Self::default() }
    }

    /// Ends all waits, now and later, because the method was closed or has another mode.
    pub(super) fn end(&self) {
        self.ended.store(true, SeqCst);
    }

    /// Ends the waits that have begun; later ones are not touched.
    pub(super) fn cancel(&self) {
        self.cancels.fetch_add(1, SeqCst);
    }
}

/// Wait of one call, with its deadline.
pub(super) struct Wait<'a> {
    method: &'a str,
    stop: &'a Stop,
    cancels: u64,
    started: Instant,
    deadline: Option<Instant>,
    say_at: Instant,
}

impl<'a> Wait<'a> {
    /// Begins a wait of at most `timeout`.
    pub(super) fn new(method: &'a str, stop: &'a Stop, timeout: Option<Duration>) -> Self {
        let started = Instant::now();
        Self {
            method,
            stop,
            cancels: stop.cancels.load(SeqCst),
            started,
            deadline: timeout.and_then(|timeout| started.checked_add(timeout)),
            say_at: started + SAY_AFTER,
        }
    }

    /// Time to wait until the next look.
    ///
    /// # Errors
    /// When the wait is over: by its deadline, a cancel or the end of the method.
    pub(super) fn check(
        &mut self,
        waited_for: impl Fn() -> String,
    ) -> Result<Duration, MethodError> {
        let method = || self.method.to_owned();
        if self.stop.ended.load(SeqCst) {
            return Err(MethodError::Ended { method: method(), waited_for: waited_for() });
        }
        let is_interrupted = self.stop.is_interrupted;
        if self.stop.cancels.load(SeqCst) != self.cancels || is_interrupted.is_some_and(|ask| ask())
        {
            return Err(MethodError::Cancelled { method: method(), waited_for: waited_for() });
        }
        let now = Instant::now();
        if self.deadline.is_some_and(|deadline| now >= deadline) {
            let waited = now - self.started;
            return Err(MethodError::TimedOut {
                method: method(),
                waited,
                waited_for: waited_for(),
            });
        }
        if now >= self.say_at {
            let (method, waited_for) = (self.method, waited_for());
            if !to_stderr(format_args!("{method} waits for {waited_for}")) {
                tracing::warn!("{method} waits for {waited_for}");
            }
            self.say_at = now + SAY_EVERY;
        }
        let next = self.deadline.map_or(self.say_at, |deadline| deadline.min(self.say_at));
        let next = next.saturating_duration_since(now);
        Ok(if is_interrupted.is_some() { next.min(ASK_EVERY) } else { next })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wait_ends_by_time_by_order_and_by_the_end() {
        let what = || "godot".to_owned();
        let stop = Stop::default();
        let mut wait = Wait::new("A::b", &stop, None);
        assert!(wait.check(what).unwrap() <= SAY_AFTER);
        let mut none = Wait::new("A::b", &stop, Some(Duration::ZERO));
        let error = none.check(what).unwrap_err().to_string();
        assert!(error.starts_with("A::b: waited 0 ms for godot: start the other side"), "{error}");
        stop.cancel();
        assert!(matches!(wait.check(what), Err(MethodError::Cancelled { .. })));
        let mut later = Wait::new("A::b", &stop, None);
        assert!(later.check(what).is_ok());
        stop.end();
        assert!(matches!(later.check(what), Err(MethodError::Ended { .. })));
        let stop = Stop::new(Some(|| true));
        let mut interrupted = Wait::new("A::b", &stop, None);
        assert!(matches!(interrupted.check(what), Err(MethodError::Cancelled { .. })));
        let stop = Stop::new(Some(|| false));
        assert!(Wait::new("A::b", &stop, None).check(what).unwrap() <= ASK_EVERY);
    }
}
