//! Judgement whether looks at the graph have shown all of it: nobody new comes, and everybody has told.
//!
//! ```text
//!   participants               answer within milliseconds ─┐
//!   endpoints, names of nodes  those of Fast DDS: 1.1 s ───┴─▶ complete
//! ```
//!
//! Fast DDS tells its endpoints when it is asked for them, and a reader that knows of none yet is to be told by a heartbeat that there are some.
//! The first heartbeat comes right behind the answer that makes the participant known, and CycloneDDS, which takes note of participants
//! on another thread, drops it. What CycloneDDS then sends by itself counts for Fast DDS as heard, so that the next heartbeat comes a second
//! later (`edp_heartbeat_period` of `EDPSimple.cpp` in Fast DDS 2.14.6 and 3.6.1; `make_preemptive_acknack` of `ddsi_acknack.c` in CycloneDDS
//! 11.0.1).

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use super::vendor::is_fast_dds;

/// Time without another participant after which no more are expected.
const NEWCOMERS: Duration = Duration::from_millis(500);
/// Time without news of endpoints and nodes after which those that have begun to tell are taken to have told all.
const QUIET: Duration = Duration::from_millis(100);
/// Time for which a participant that does not tell is waited for: it may have nothing.
const TELLS_WITHIN: Duration = Duration::from_millis(1500);
/// Shortest look where nobody tells who the participants are.
const SHORTEST_OF_UNKNOWN: Duration = Duration::from_millis(1600);

/// First twelve bytes of the GUIDs of a participant and all that it has.
pub(super) type Prefix = [u8; 12];

/// Progress of the looks at one graph.
pub(super) struct Completeness {
    begun: Instant,
    /// Time of the last news of endpoints and nodes.
    news_at: Instant,
    /// Participants of others, and since when they are known.
    participants: BTreeMap<Prefix, Instant>,
    /// Time at which the last of them came.
    newest_at: Instant,
    is_complete: bool,
}

impl Completeness {
    pub(super) fn new(now: Instant) -> Self {
        let participants = BTreeMap::new();
        Self { begun: now, news_at: now, participants, newest_at: now, is_complete: false }
    }

    /// True once all was told.
    pub(super) fn is_complete(&self) -> bool {
        self.is_complete
    }

    /// Takes note of a look: participants of others, where the graph knows them, whether there was any news, and which participants have told
    /// what they have.
    pub(super) fn note(
        &mut self,
        now: Instant,
        participants: Option<Vec<Prefix>>,
        is_news: bool,
        has_told: impl Fn(&Prefix) -> bool,
    ) {
        if is_news {
            self.news_at = now;
        }
        let since = |then: Instant| now.saturating_duration_since(then);
        let Some(participants) = participants else {
            self.is_complete =
                since(self.begun) >= SHORTEST_OF_UNKNOWN && since(self.news_at) >= NEWCOMERS;
            return;
        };
        self.participants.retain(|known, _| participants.contains(known));
        for one in participants {
            self.participants.entry(one).or_insert_with(|| {
                self.newest_at = now;
                now
            });
        }
        let mut silent =
            self.participants.iter().filter(|(one, _)| is_fast_dds(*one) && !has_told(one));
        let is_anybody_late = silent.clone().next().is_some();
        let is_over = silent.all(|(_, known)| since(*known) >= TELLS_WITHIN);
        // While others tell late, those may as well.
        let quiet = if is_anybody_late { NEWCOMERS } else { QUIET };
        self.is_complete =
            is_over && since(self.newest_at) >= NEWCOMERS && since(self.news_at) >= quiet;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A participant of a vendor: 0x0f is Fast DDS, 0x10 CycloneDDS.
    fn of(vendor: u8) -> Prefix {
        [1, vendor, 0, 0, 0, 0, 0, 0, 0, 0, 0, 5]
    }

    /// Milliseconds, in steps of ten, after which looks are complete that find these participants from the first on, of which all have told
    /// after `told_ms`, which is the last news.
    fn complete_after_ms(participants: Option<&[Prefix]>, told_ms: u64) -> u64 {
        let begun = Instant::now();
        let mut looks = Completeness::new(begun);
        let complete = (0..1000).map(|look| look * 10).find(|ms| {
            let now = begun + Duration::from_millis(*ms);
            let participants = participants.map(<[Prefix]>::to_vec);
            looks.note(now, participants, *ms == told_ms, |_| *ms >= told_ms);
            looks.is_complete()
        });
        complete.unwrap()
    }

    #[test]
    fn who_has_told_is_not_waited_for() {
        assert_eq!(complete_after_ms(Some(&[]), 0), 500, "nobody is there");
        assert_eq!(complete_after_ms(Some(&[of(0x10)]), 10), 500, "CycloneDDS tells at once");
        assert_eq!(complete_after_ms(Some(&[of(0x10)]), 450), 550, "it may be late");
        assert_eq!(complete_after_ms(Some(&[of(0x0f)]), 1120), 1220, "Fast DDS takes a second");
        assert_eq!(complete_after_ms(Some(&[of(0x0f)]), 9000), 1500, "it has nothing to tell");
        assert_eq!(complete_after_ms(None, 0), 1600, "an rmw tells of no participants");
        assert_eq!(complete_after_ms(None, 1400), 1900);
    }

    #[test]
    fn one_that_does_not_tell_is_waited_for_while_others_still_do() {
        let begun = Instant::now();
        let mut looks = Completeness::new(begun);
        let complete = (0..1000).map(|look| look * 10).find(|ms| {
            let now = begun + Duration::from_millis(*ms);
            looks.note(now, Some(vec![of(0x0f)]), [1440, 1600].contains(ms), |_| false);
            looks.is_complete()
        });
        assert_eq!(complete, Some(2100));
    }

    #[test]
    fn another_participant_is_waited_for() {
        let begun = Instant::now();
        let mut looks = Completeness::new(begun);
        let mut complete = |ms, participants: &[Prefix], told: bool| {
            let now = begun + Duration::from_millis(ms);
            looks.note(now, Some(participants.to_vec()), false, |_| told);
            looks.is_complete()
        };
        let (one, other) = (of(0x0f), of(0x10));
        assert!(!complete(0, &[one], true) && complete(500, &[one], true));
        assert!(!complete(510, &[one, other], true) && complete(1010, &[one, other], true));
        assert!(!complete(1020, &[one, other], false));
        assert!(complete(1030, &[other], false), "it has gone");
    }
}
