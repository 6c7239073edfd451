//! Middlewares that another program has ended, as `rosnode kill` does, and that start anew.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use wrapyfi_endpoint::backoff::Backoff;

use super::Reload;

/// Time for which a middleware that was ended stays so, at first and at most: two nodes of one name end each other.
const ANEW_AFTER: Duration = Duration::from_secs(1);
const ANEW_AFTER_AT_MOST: Duration = Duration::from_secs(30);
/// Time of life after which the next end of a middleware counts as its first.
const LIVES: Duration = Duration::from_secs(60);

impl Reload {
    /// Starts middlewares anew that have ended, `ends` of which are known, each once its time has come.
    pub(super) fn start_ended_anew(&mut self, ends: &mut BTreeMap<&'static str, Ends>) {
        let ended =
            self.middlewares.ended().filter(|(name, _)| self.options.lives_with != Some(*name));
        let mut is_other = false;
        for (name, reason) in ended.collect::<Vec<_>>() {
            let ends = ends.entry(name).or_insert_with(|| Ends::new(name));
            if !ends.is_time(Instant::now()) {
                continue;
            }
            match self.middlewares.start_anew(name, &reason) {
                Ok(()) => is_other = true,
                Err(failure) => tracing::error!("{name} does not start anew: {failure}"),
            }
        }
        if is_other {
            self.bridge.routes.turn_to(self.middlewares.registry_on(self.handle.as_ref()));
        }
    }
}

/// Ends of a middleware by another program's order.
pub(super) struct Ends {
    backoff: Backoff,
    /// Instant of the next start, while it has ended.
    anew_at: Option<Instant>,
    /// Instant of the last start.
    started_at: Option<Instant>,
}

impl Ends {
    fn new(name: &str) -> Self {
        let backoff = Backoff::of_name(name).starting_at(ANEW_AFTER).up_to(ANEW_AFTER_AT_MOST);
        Self { backoff, anew_at: None, started_at: None }
    }

    /// True when a middleware that is seen ended at `now` is to start.
    fn is_time(&mut self, now: Instant) -> bool {
        let at = *self.anew_at.get_or_insert_with(|| {
            let lived = self.started_at.map(|at| now.saturating_duration_since(at));
            if lived.is_some_and(|lived| lived >= LIVES) {
                self.backoff.reset();
            }
            now + self.backoff.wait()
        });
        if now < at {
            return false;
        }
        (self.anew_at, self.started_at) = (None, Some(now));
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_middleware_that_is_ended_again_and_again_waits_longer() {
        let (mut ends, mut now) = (Ends::new("ros"), Instant::now());
        let mut wait = |lived: Duration| {
            now += lived;
            let ended = now;
            while !ends.is_time(now) {
                now += Duration::from_millis(10);
            }
            now - ended
        };
        let first = wait(Duration::ZERO);
        assert!(first >= ANEW_AFTER / 2 && first <= ANEW_AFTER, "{first:?}");
        let last = (0..8).map(|_| wait(Duration::ZERO)).last().unwrap();
        assert!(last >= ANEW_AFTER_AT_MOST / 2, "{last:?}");
        assert!(wait(LIVES) <= ANEW_AFTER, "it has lived since");
    }
}
