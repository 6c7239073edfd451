//! Rates of messages, from counters that are looked at once a second.
//!
//! ```text
//!   counters ◀─ data path, adds and never waits
//!      └─ look(now), each second ─▶ messages_per_s, bytes_per_s
//! ```

use std::time::{Duration, Instant};

use wrapyfi_endpoint::Counters;

/// Time between two looks at the counters.
pub(super) const LOOK_EVERY: Duration = Duration::from_secs(1);

/// Counters at the last look, and the rate since the one before.
#[derive(Debug, Default)]
pub(super) struct RateMeter {
    looked: Option<(Instant, (u64, u64))>,
    rate: (f64, u64),
}

impl RateMeter {
    /// Looks at the counters, at most once in [`LOOK_EVERY`].
    pub(super) fn look(&mut self, counters: &Counters, now: Instant) {
        let sent = counters.sent_so_far();
        let Some((at, before)) = self.looked else {
            self.looked = Some((now, sent));
            return;
        };
        let time = now.saturating_duration_since(at);
        if time < LOOK_EVERY {
            return;
        }
        self.looked = Some((now, sent));
        // Less than before where messages turn out undelivered.
        let per_s = |now: u64, before: u64| now.saturating_sub(before) as f64 / time.as_secs_f64();
        let messages = (per_s(sent.0, before.0) * 10.0).round() / 10.0;
        self.rate = (messages, per_s(sent.1, before.1).round() as u64);
    }

    /// Messages, to a tenth, and bytes a second between the last two looks.
    pub(super) fn rate(&self) -> (f64, u64) {
        self.rate
    }
}

#[cfg(test)]
mod tests {
    use wrapyfi_endpoint::DropReason;

    use super::*;

    #[test]
    fn a_rate_is_that_of_the_last_second_and_ends_with_the_messages() {
        let (counters, mut meter) = (Counters::default(), RateMeter::default());
        let mut now = Instant::now();
        let mut after = |ms: u64, messages: u64, meter: &mut RateMeter| {
            (0..messages).for_each(|_| counters.sent(100, Duration::ZERO));
            now += Duration::from_millis(ms);
            meter.look(&counters, now);
            meter.rate()
        };
        assert_eq!(after(0, 50, &mut meter), (0.0, 0), "nobody knows how long these took");
        assert_eq!(after(500, 10, &mut meter), (0.0, 0), "too soon");
        assert_eq!(after(500, 10, &mut meter), (20.0, 2000));
        assert_eq!(after(1500, 50, &mut meter), (33.3, 3333));
        assert_eq!(after(1000, 0, &mut meter), (0.0, 0));
        counters.undelivered(DropReason::Stalled, 100);
        assert_eq!(after(1000, 0, &mut meter), (0.0, 0), "less than before is no rate");
    }
}
