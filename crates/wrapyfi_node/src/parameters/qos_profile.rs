//! Quality of service of an endpoint, as values from outside change it.
//!
//! ```text
//!   Qos ─ Changed::new ─▶ Changed ◀─ set ─ policy, value
//!                            └─ end ─▶ PinnedQos, true where the rest follows the peers
//! ```

use std::time::Duration;

use wrapyfi_interfaces::named;

use crate::ParameterValue;
use wrapyfi_endpoint::{Durability, History, Liveliness, PinnedQos, Qos, Reliability};

/// Number that `rmw` uses for the best available deadline or lease, which is that of the peers.
const BEST_AVAILABLE_NS: u64 = i64::MAX.unsigned_abs() - 1;

named! {
    /// A policy, by its name.
    pub(super) enum Policy {
        Deadline => "deadline",
        Depth => "depth",
        Durability => "durability",
        History => "history",
        Lifespan => "lifespan",
        Liveliness => "liveliness",
        LivelinessLeaseDuration => "liveliness_lease_duration",
        Reliability => "reliability",
    }
    /// Word in the names of parameters.
    pub fn word;
}

/// Word of a policy that is to be that of the peers.
const BEST_AVAILABLE: &str = "best_available";

impl Policy {
    /// Words that the policy can be; none where it is a number.
    fn words(self) -> &'static [&'static str] {
        match self {
            Self::Durability => &["system_default", "transient_local", "volatile", BEST_AVAILABLE],
            Self::History => &["system_default", "keep_last", "keep_all"],
            Self::Liveliness => &["system_default", "automatic", "manual_by_topic", BEST_AVAILABLE],
            Self::Reliability => &["system_default", "reliable", "best_effort", BEST_AVAILABLE],
            Self::Deadline | Self::Depth | Self::Lifespan | Self::LivelinessLeaseDuration => &[],
        }
    }

    /// Values that the policy can have, in words.
    pub(super) fn allowed(self) -> String {
        match self {
            Self::Depth => format!("an integer from 0 to {}", i32::MAX),
            _ if self.words().is_empty() => "a time in nanoseconds: an integer from 0".to_owned(),
            _ => self.words().join(", "),
        }
    }

    /// Value for an endpoint with `qos`. Policies that the peers of one that `follows` them decide
    /// are given as the best available, and their times as 0.
    pub(super) fn value(self, qos: &Qos, follows: bool) -> ParameterValue {
        match self {
            Self::Deadline | Self::LivelinessLeaseDuration if follows => 0.into(),
            Self::Durability | Self::Liveliness | Self::Reliability if follows => {
                BEST_AVAILABLE.into()
            }
            Self::Deadline => nanoseconds(qos.deadline).into(),
            Self::Depth => match qos.history {
                History::KeepLast(depth) => i64::from(depth).into(),
                History::KeepAll => i64::from(default_depth()).into(),
            },
            Self::Durability => match qos.durability {
                Durability::Volatile => "volatile".into(),
                Durability::TransientLocal => "transient_local".into(),
            },
            Self::History => match qos.history {
                History::KeepLast(_) => "keep_last".into(),
                History::KeepAll => "keep_all".into(),
            },
            Self::Lifespan => nanoseconds(qos.lifespan).into(),
            Self::Liveliness => match qos.liveliness {
                Liveliness::ManualByTopic => "manual_by_topic".into(),
                Liveliness::Automatic | Liveliness::ManualByParticipant => "automatic".into(),
            },
            Self::LivelinessLeaseDuration => nanoseconds(qos.lease).into(),
            Self::Reliability => match qos.reliability {
                Reliability::Reliable => "reliable".into(),
                Reliability::BestEffort => "best_effort".into(),
            },
        }
    }
}

/// Policies that are fixed for an endpoint.
pub(super) struct Changed {
    pinned: PinnedQos,
    /// True when the endpoint follows its peers in the rest.
    follows: bool,
    base: History,
    depth: Option<u32>,
    /// True for all messages, false for the last ones, where the history is given.
    keeps_all: Option<bool>,
}

impl Changed {
    /// Policies of an endpoint that has `base`, as long as nothing is given. Peers of one that
    /// `follows` them decide all but history and lifespan.
    pub(super) fn new(base: &Qos, follows: bool) -> Self {
        let all = PinnedQos::all_of(base);
        let PinnedQos { history, lifespan, .. } = all;
        let pinned =
            if follows { PinnedQos { history, lifespan, ..PinnedQos::default() } } else { all };
        Self { pinned, follows, base: base.history, depth: None, keeps_all: None }
    }

    /// Sets a policy, where it can have the value. One that is to be the best available follows the
    /// peers. `system_default` is as in `rmw_cyclonedds_cpp`: reliable, volatile, keep last,
    /// automatic.
    pub(super) fn set(&mut self, policy: Policy, value: &ParameterValue) -> Option<()> {
        let (number, word) = match value {
            ParameterValue::Integer(value) => (u64::try_from(*value).ok(), ""),
            ParameterValue::String(word) => (None, word.as_str()),
            _ => (None, ""),
        };
        let pinned = &mut self.pinned;
        let followed = |ns: u64| (ns != BEST_AVAILABLE_NS).then(|| duration(ns));
        match policy {
            Policy::Deadline => pinned.deadline = followed(number?),
            Policy::Depth => {
                let depth = number.filter(|&depth| i32::try_from(depth).is_ok());
                self.depth = Some(u32::try_from(depth?).ok()?);
            }
            Policy::Lifespan => pinned.lifespan = Some(duration(number?)),
            Policy::LivelinessLeaseDuration => pinned.lease = followed(number?),
            _ if !policy.words().contains(&word) => return None,
            Policy::Durability => {
                pinned.durability = match word {
                    BEST_AVAILABLE => None,
                    "transient_local" => Some(Durability::TransientLocal),
                    _ => Some(Durability::Volatile),
                }
            }
            Policy::History => self.keeps_all = Some(word == "keep_all"),
            Policy::Liveliness => {
                pinned.liveliness = match word {
                    BEST_AVAILABLE => None,
                    "manual_by_topic" => Some(Liveliness::ManualByTopic),
                    _ => Some(Liveliness::Automatic),
                }
            }
            Policy::Reliability => {
                pinned.reliability = match word {
                    BEST_AVAILABLE => None,
                    "best_effort" => Some(Reliability::BestEffort),
                    _ => Some(Reliability::Reliable),
                }
            }
        }
        // An endpoint that follows no peer otherwise does so in these policies alone.
        self.follows |= word == BEST_AVAILABLE
            || number == Some(BEST_AVAILABLE_NS) && policy != Policy::Lifespan;
        Some(())
    }

    /// Policies that are fixed, and true when the endpoint follows its peers in the rest.
    pub(super) fn end(self) -> (PinnedQos, bool) {
        // As rmw_cyclonedds_cpp takes a depth of 0.
        let depth = self.depth.map(|depth| depth.max(1));
        let history = match (self.keeps_all, self.base) {
            (Some(true), _) | (None, History::KeepAll) => History::KeepAll,
            (_, History::KeepLast(base)) => History::KeepLast(depth.unwrap_or(base)),
            (Some(false), History::KeepAll) => {
                History::KeepLast(depth.unwrap_or_else(default_depth))
            }
        };
        (PinnedQos { history: Some(history), ..self.pinned }, self.follows)
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
fn nanoseconds(time: Option<Duration>) -> i64 {
    time.map_or(0, |time| i64::try_from(time.as_nanos()).unwrap_or(i64::MAX))
}

fn duration(nanoseconds: u64) -> Option<Duration> {
    let finite = (1..i64::MAX.unsigned_abs()).contains(&nanoseconds);
    finite.then(|| Duration::from_nanos(nanoseconds))
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_endpoint::QosPreset;

    /// Policies of an endpoint with `base`, of which `given` are given.
    fn pin(given: &[(Policy, ParameterValue)], base: &Qos, follows: bool) -> (PinnedQos, bool) {
        let mut changed = Changed::new(base, follows);
        for (policy, value) in given {
            changed.set(*policy, value).unwrap();
        }
        changed.end()
    }

    #[test]
    fn what_is_given_is_laid_down_and_the_rest_follows() {
        let given = [
            (Policy::Reliability, "best_effort".into()),
            (Policy::Depth, 20.into()),
            (Policy::Deadline, 100_000_000.into()),
        ];
        let (pinned, follows) = pin(&given, &Qos::default(), true);
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
            let (pinned, follows) = pin(&[], &qos, false);
            assert_eq!((pinned.apply(Qos::default()), follows), (qos, false));
            // Parameters that are not overridden pin the same policies.
            let values = |follows| Policy::ALL.map(|policy| (policy, policy.value(&qos, follows)));
            let (pinned, follows) = pin(&values(false), &qos, false);
            assert_eq!((pinned.apply(Qos::default()), follows), (qos, false));
            let times = [Policy::Deadline, Policy::LivelinessLeaseDuration];
            let mut values = values(true).to_vec();
            values.retain(|(policy, _)| !times.contains(policy));
            let (pinned, follows) = pin(&values, &qos, true);
            let history = Some(qos.history);
            assert_eq!(pinned, PinnedQos { history, lifespan: Some(None), ..PinnedQos::default() });
            assert!(follows);
        }
    }

    #[test]
    fn the_best_available_is_followed_alone_where_the_rest_is_written() {
        let latched = Qos::from(QosPreset::Latched);
        let reliability = (Policy::Reliability, "best_available".into());
        let (pinned, follows) = pin(&[reliability], &latched, false);
        assert!(follows);
        assert_eq!(pinned, PinnedQos { reliability: None, ..PinnedQos::all_of(&latched) });
        let deadline = (Policy::Deadline, (i64::MAX - 1).into());
        let (pinned, _) = pin(&[deadline], &latched, false);
        assert_eq!(pinned, PinnedQos { deadline: None, ..PinnedQos::all_of(&latched) });
    }

    #[test]
    fn system_defaults_and_zeros_are_those_of_rmw() {
        let given = [
            (Policy::Reliability, "system_default".into()),
            (Policy::Durability, "system_default".into()),
            (Policy::History, "system_default".into()),
            (Policy::Liveliness, "system_default".into()),
            (Policy::Depth, 0.into()),
            (Policy::Deadline, 0.into()),
            (Policy::Lifespan, i64::MAX.into()),
            (Policy::LivelinessLeaseDuration, 5.into()),
        ];
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
        assert_eq!(pin(&given, &base, true).0.apply(base), expected);
        let kept = pin(&[(Policy::History, "keep_last".into())], &base, false).0.history;
        assert_eq!(kept, Some(History::KeepLast(10)));
        let kept = pin(&[(Policy::Depth, 3.into())], &base, false).0.history;
        assert_eq!(kept, Some(History::KeepAll));
    }
}
