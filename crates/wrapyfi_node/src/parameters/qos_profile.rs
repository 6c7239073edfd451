//! Quality of service from outside, as an endpoint uses it.
//!
//! ```text
//!   Qos ─ QosOverrides::of ─▶ declare_qos_overrides ─▶ what was changed ─ pin ─▶ PinnedQos
//! ```

use std::time::Duration;

use super::{
    DurabilityOverride, HistoryOverride, LivelinessOverride, QosOverrides, ReliabilityOverride,
};
use wrapyfi_endpoint::{Durability, History, Liveliness, PinnedQos, Qos, Reliability};

/// Number that `rmw` uses for the best available deadline or lease, which is that of the peers.
const BEST_AVAILABLE_NS: u64 = i64::MAX.unsigned_abs() - 1;

impl QosOverrides {
    /// Policies of an endpoint with `qos`, all of which may be changed. Policies that the peers of
    /// one that `follows` them decide are given as the best available, and their times as 0.
    pub fn of(qos: &Qos, follows: bool) -> Self {
        let followed = |time| Some(if follows { 0 } else { nanoseconds(time) });
        let (history, depth) = match qos.history {
            History::KeepLast(depth) => (HistoryOverride::KeepLast, depth),
            History::KeepAll => (HistoryOverride::KeepAll, default_depth()),
        };
        Self {
            deadline_ns: followed(qos.deadline),
            depth: Some(depth),
            durability: Some(match qos.durability {
                _ if follows => DurabilityOverride::BestAvailable,
                Durability::Volatile => DurabilityOverride::Volatile,
                Durability::TransientLocal => DurabilityOverride::TransientLocal,
            }),
            history: Some(history),
            lifespan_ns: Some(nanoseconds(qos.lifespan)),
            liveliness: Some(match qos.liveliness {
                _ if follows => LivelinessOverride::BestAvailable,
                Liveliness::ManualByTopic => LivelinessOverride::ManualByTopic,
                Liveliness::Automatic | Liveliness::ManualByParticipant => {
                    LivelinessOverride::Automatic
                }
            }),
            liveliness_lease_duration_ns: followed(qos.lease),
            reliability: Some(match qos.reliability {
                _ if follows => ReliabilityOverride::BestAvailable,
                Reliability::Reliable => ReliabilityOverride::Reliable,
                Reliability::BestEffort => ReliabilityOverride::BestEffort,
            }),
        }
    }

    /// Policies that these overrides fix for an endpoint that has `base` without them, and true
    /// when the endpoint follows its peers in the rest: because it `follows` them anyway, or
    /// because a policy is to be the best available. `system_default` is as in
    /// `rmw_cyclonedds_cpp`: reliable, volatile, keep last, automatic.
    #[must_use]
    pub fn pin(&self, base: &Qos, follows: bool) -> (PinnedQos, bool) {
        let available = [
            self.reliability == Some(ReliabilityOverride::BestAvailable),
            self.durability == Some(DurabilityOverride::BestAvailable),
            self.liveliness == Some(LivelinessOverride::BestAvailable),
            self.deadline_ns == Some(BEST_AVAILABLE_NS),
            self.liveliness_lease_duration_ns == Some(BEST_AVAILABLE_NS),
        ];
        // An endpoint that follows nobody otherwise does so in these policies alone.
        let [reliability, durability, liveliness, deadline, lease] =
            available.map(|available| follows || available);
        let rest = PinnedQos::all_of(base);
        let given = |value: Option<u64>| value.filter(|&ns| ns != BEST_AVAILABLE_NS).map(duration);
        let pinned = PinnedQos {
            reliability: match self.reliability {
                Some(ReliabilityOverride::Reliable | ReliabilityOverride::SystemDefault) => {
                    Some(Reliability::Reliable)
                }
                Some(ReliabilityOverride::BestEffort) => Some(Reliability::BestEffort),
                _ => rest.reliability.filter(|_| !reliability),
            },
            durability: match self.durability {
                Some(DurabilityOverride::Volatile | DurabilityOverride::SystemDefault) => {
                    Some(Durability::Volatile)
                }
                Some(DurabilityOverride::TransientLocal) => Some(Durability::TransientLocal),
                _ => rest.durability.filter(|_| !durability),
            },
            history: Some(self.history(base.history)),
            deadline: given(self.deadline_ns).or(rest.deadline.filter(|_| !deadline)),
            lifespan: self.lifespan_ns.map(duration).or(rest.lifespan),
            liveliness: match self.liveliness {
                Some(LivelinessOverride::Automatic | LivelinessOverride::SystemDefault) => {
                    Some(Liveliness::Automatic)
                }
                Some(LivelinessOverride::ManualByTopic) => Some(Liveliness::ManualByTopic),
                _ => rest.liveliness.filter(|_| !liveliness),
            },
            lease: given(self.liveliness_lease_duration_ns).or(rest.lease.filter(|_| !lease)),
        };
        (pinned, follows || available.contains(&true))
    }

    fn history(&self, base: History) -> History {
        // As rmw_cyclonedds_cpp takes a depth of 0.
        let depth = self.depth.map(|depth| depth.max(1));
        match (self.history, base) {
            (Some(HistoryOverride::KeepAll), _) | (None, History::KeepAll) => History::KeepAll,
            (_, History::KeepLast(base)) => History::KeepLast(depth.unwrap_or(base)),
            (Some(_), History::KeepAll) => History::KeepLast(depth.unwrap_or_else(default_depth)),
        }
    }
}

/// Depth of ROS 2's default profile.
fn default_depth() -> u32 {
    match Qos::default().history {
        History::KeepLast(depth) => depth,
        History::KeepAll => 10,
    }
}

/// Converts a time to nanoseconds, in which 0 stands for an infinite one.
fn nanoseconds(time: Option<Duration>) -> u64 {
    time.map_or(0, |time| u64::try_from(time.as_nanos()).unwrap_or(u64::MAX))
}

fn duration(nanoseconds: u64) -> Option<Duration> {
    let finite = (1..i64::MAX.unsigned_abs()).contains(&nanoseconds);
    finite.then(|| Duration::from_nanos(nanoseconds))
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_endpoint::QosPreset;

    fn overrides() -> QosOverrides {
        QosOverrides::default()
    }

    #[test]
    fn what_is_given_is_laid_down_and_the_rest_follows() {
        let given = QosOverrides {
            reliability: Some(ReliabilityOverride::BestEffort),
            depth: Some(20),
            deadline_ns: Some(100_000_000),
            ..overrides()
        };
        let (pinned, follows) = given.pin(&Qos::default(), true);
        assert!(follows);
        let expected = PinnedQos {
            reliability: Some(Reliability::BestEffort),
            history: Some(History::KeepLast(20)),
            deadline: Some(Some(Duration::from_millis(100))),
            // Peers do not decide the lifespan.
            lifespan: Some(None),
            ..PinnedQos::default()
        };
        assert_eq!(pinned, expected);
    }

    #[test]
    fn nothing_given_changes_nothing() {
        for preset in [QosPreset::Default, QosPreset::SensorData, QosPreset::Latched] {
            let qos = Qos::from(preset);
            let (pinned, follows) = overrides().pin(&qos, false);
            assert_eq!((pinned.apply(Qos::default()), follows), (qos, false));
            // Parameters that are not overridden pin the same policies.
            let (pinned, follows) = QosOverrides::of(&qos, false).pin(&qos, false);
            assert_eq!((pinned.apply(Qos::default()), follows), (qos, false));
            let (pinned, follows) = QosOverrides {
                deadline_ns: None,
                liveliness_lease_duration_ns: None,
                ..QosOverrides::of(&qos, true)
            }
            .pin(&qos, true);
            let history = Some(qos.history);
            assert_eq!(pinned, PinnedQos { history, lifespan: Some(None), ..PinnedQos::default() });
            assert!(follows);
        }
    }

    #[test]
    fn the_best_available_is_followed_alone_where_the_rest_is_written() {
        let latched = Qos::from(QosPreset::Latched);
        let reliability = Some(ReliabilityOverride::BestAvailable);
        let (pinned, follows) = QosOverrides { reliability, ..overrides() }.pin(&latched, false);
        assert!(follows);
        assert_eq!(pinned, PinnedQos { reliability: None, ..PinnedQos::all_of(&latched) });
        let deadline_ns = Some(BEST_AVAILABLE_NS);
        let (pinned, _) = QosOverrides { deadline_ns, ..overrides() }.pin(&latched, false);
        assert_eq!(pinned, PinnedQos { deadline: None, ..PinnedQos::all_of(&latched) });
    }

    #[test]
    fn system_defaults_and_zeros_are_those_of_rmw() {
        let given = QosOverrides {
            reliability: Some(ReliabilityOverride::SystemDefault),
            durability: Some(DurabilityOverride::SystemDefault),
            history: Some(HistoryOverride::SystemDefault),
            liveliness: Some(LivelinessOverride::SystemDefault),
            depth: Some(0),
            deadline_ns: Some(0),
            lifespan_ns: Some(i64::MAX.unsigned_abs()),
            liveliness_lease_duration_ns: Some(5),
        };
        let base = Qos {
            history: History::KeepAll,
            reliability: Reliability::BestEffort,
            deadline: Some(Duration::from_secs(1)),
            lifespan: Some(Duration::from_secs(1)),
            ..QosPreset::Latched.into()
        };
        let expected = Qos {
            history: History::KeepLast(1),
            lease: Some(Duration::from_nanos(5)),
            ..Qos::default()
        };
        assert_eq!(given.pin(&base, true).0.apply(base), expected);
        let history = Some(HistoryOverride::KeepLast);
        let kept = QosOverrides { history, ..overrides() }.pin(&base, false).0.history;
        assert_eq!(kept, Some(History::KeepLast(10)));
        let depth = Some(3);
        let kept = QosOverrides { depth, ..overrides() }.pin(&base, false).0.history;
        assert_eq!(kept, Some(History::KeepAll));
    }
}
