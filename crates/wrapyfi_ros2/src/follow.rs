//! Reactions of an endpoint to its peers: complaints about those that do not fit, a decision to be
//! opened again, and the count of the events of its quality of service.
//!
//! ```text
//!   peers changed, or a time has come ─▶ Follower::look ─▶ switch to …, because …
//!                                                      └─▶ complaints, the next time
//!   deadlines, liveliness ─▶ EventLog ─▶ counters, a line every Throttle::EVERY at most
//! ```

use std::sync::Arc;
use std::time::Instant;

use super::diagnosis::{Diagnosis, Names};
use super::graph::{GraphResult, Notify, QosEvents, TopicDescription};
use super::matching::{Decision, Matching};
use wrapyfi_endpoint::{Counters, Qos, QosEvent, Throttle, TopicSpec};

/// One endpoint's view of its peers.
pub(super) struct Follower {
    pub(super) diagnosis: Diagnosis,
    /// None where the quality of service is fixed.
    matching: Option<Matching>,
    /// Changes that were looked at.
    seen: u64,
    next: Option<Instant>,
}

/// Steps that follow from one look at the peers.
#[derive(Debug, Default)]
pub(super) struct FollowSteps {
    /// Open the endpoint again with this, because of that.
    pub(super) switch: Option<(Qos, String)>,
    /// Complaints about peers, for the user.
    pub(super) complaints: Vec<String>,
    /// Time of the next look.
    pub(super) next: Option<Instant>,
}

impl Follower {
    /// `on_change` is called from a DDS thread when peers come, change or go.
    pub(super) fn new(
        names: &Arc<Names>,
        topic: &TopicDescription,
        spec: &TopicSpec,
        listens: bool,
        on_change: Notify,
    ) -> GraphResult<Self> {
        let matching = spec.match_peers.then(|| Matching::new(listens, topic.qos, spec.pinned));
        let diagnosis = Diagnosis::new(names, topic, spec, listens, on_change)?;
        Ok(Self { diagnosis, matching, seen: 0, next: None })
    }

    /// Looks at the peers of an endpoint that has `own`, if there is news or it is time.
    pub(super) fn look(&mut self, own: &Qos, now: Instant) -> FollowSteps {
        let changes = self.diagnosis.changes();
        if changes == self.seen && self.next.is_none_or(|next| now < next) {
            return FollowSteps { next: self.next, ..FollowSteps::default() };
        }
        self.seen = changes;
        self.next = None;
        if let Some(matching) = &mut self.matching {
            let peers = self.diagnosis.peers();
            let announced: Vec<_> = peers.iter().map(|peer| peer.qos).collect();
            match matching.decide(own, &announced, now) {
                Decision::Keep => {}
                Decision::Wait(until) => {
                    self.diagnosis.prepare_names();
                    self.next = Some(until);
                    return FollowSteps { next: self.next, ..FollowSteps::default() };
                }
                Decision::Switch(found) => {
                    let mut why = self.diagnosis.reason(&peers, own, &found.qos);
                    for warning in &found.warnings {
                        why.push_str("; ");
                        why.push_str(&warning.to_string());
                    }
                    // Complaints are about what it has then.
                    self.next = Some(now);
                    return FollowSteps {
                        switch: Some((found.qos, why)),
                        next: self.next,
                        ..FollowSteps::default()
                    };
                }
            }
        }
        let (complaints, next) = self.diagnosis.complaints(own, now);
        self.next = next;
        FollowSteps { switch: None, complaints, next }
    }

    /// The endpoint could not be opened again: not before `at`.
    pub(super) fn retry(&mut self, at: Instant) {
        self.next = Some(at);
    }
}

/// Counts deadlines and liveliness, and logs them without flooding the log.
pub(super) struct EventLog {
    counters: Arc<Counters>,
    topic: String,
    listens: bool,
    complaints: Throttle,
}

impl EventLog {
    pub(super) fn new(counters: &Arc<Counters>, topic: &str, listens: bool) -> Self {
        let (counters, topic) = (Arc::clone(counters), topic.to_owned());
        Self { counters, topic, listens, complaints: Throttle::default() }
    }

    /// Books what happened since the last call.
    pub(super) fn note(&mut self, events: QosEvents, now: Instant) {
        let (deadline, liveliness) = if self.listens {
            (QosEvent::DeadlineMissed, QosEvent::PublisherNotAlive)
        } else {
            (QosEvent::OwnDeadlineMissed, QosEvent::OwnLivelinessLost)
        };
        for (event, count) in
            [(deadline, events.deadlines_missed), (liveliness, events.liveliness_lost)]
        {
            if count == 0 {
                continue;
            }
            self.counters.qos_event(event, count);
            if let Some(unlogged_before) = self.complaints.pass(now) {
                tracing::warn!(topic = self.topic, count, unlogged_before, "{}", in_words(event));
            }
        }
    }
}

fn in_words(event: QosEvent) -> &'static str {
    match event {
        QosEvent::DeadlineMissed => "a publisher let its deadline pass",
        QosEvent::OwnDeadlineMissed => "nothing was published within the deadline",
        QosEvent::PublisherNotAlive => "a publisher is no longer alive",
        QosEvent::OwnLivelinessLost => "the publisher was silent for longer than its lease",
        QosEvent::Changed => "quality of service changed",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_are_counted_all_and_logged_seldom() {
        let counters = Arc::new(Counters::default());
        let mut log = EventLog::new(&counters, "/t", true);
        let start = Instant::now();
        let late = QosEvents { deadlines_missed: 2, liveliness_lost: 0 };
        for ms in 0..100 {
            log.note(late, start + std::time::Duration::from_millis(ms));
        }
        let unlogged = |log: &EventLog, at| log.complaints.clone().pass(at);
        assert_eq!(unlogged(&log, start + Throttle::EVERY), Some(99));
        log.note(QosEvents { liveliness_lost: 1, ..late }, start + Throttle::EVERY);
        assert_eq!(unlogged(&log, start + Throttle::EVERY * 2), Some(1));
        let now = counters.snapshot();
        assert_eq!(now.qos_events_of(QosEvent::DeadlineMissed), 202);
        assert_eq!(now.qos_events_of(QosEvent::PublisherNotAlive), 1);
        let mut own = EventLog::new(&counters, "/t", false);
        own.note(QosEvents { deadlines_missed: 3, liveliness_lost: 4 }, start);
        let now = counters.snapshot();
        assert_eq!(now.qos_events_of(QosEvent::OwnDeadlineMissed), 3);
        assert_eq!(now.qos_events_of(QosEvent::OwnLivelinessLost), 4);
        assert_eq!(now.dropped(), 0);
    }
}
