//! Match of two endpoints' quality of service, and the quality of service that fits all peers.
//!
//! ```text
//!   what publishers offer ─▶ listener_qos  ─▶ the most that all of them offer
//!   what listeners ask    ─▶ publisher_qos ─▶ the least that all of them are content with
//! ```
//!
//! The functions are pure: the endpoint decides when to apply their results.
//! `docs/reference/qos.md` has the rules as a table.

use std::fmt;
use std::time::Duration;

use serde::Serialize;

use super::{AnnouncedDurability, AnnouncedQos, Durability, Liveliness, Qos, Reliability, Role};

/// Shortest deadline and lease that are taken over from a peer: shorter ones would let a stranger
/// keep this machine busy with timers.
const SHORTEST: Duration = Duration::from_millis(1);

/// A policy that a publisher and a listener must agree on to be matched.
///
/// ```
/// use wrapyfi_endpoint::{Qos, QosPolicy, QosPreset, mismatches};
/// let (offered, asked) = (Qos::from(QosPreset::SensorData).into(), Qos::default().into());
/// assert_eq!(mismatches(&offered, &asked), [QosPolicy::Reliability]);
/// assert_eq!(QosPolicy::Reliability.value(&offered), "best effort");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)]
pub enum QosPolicy {
    Reliability,
    Durability,
    Deadline,
    /// Kind of liveliness, or its lease.
    Liveliness,
}

impl QosPolicy {
    /// Value that `qos` has for the policy, in words: `best effort`, `deadline 100ms`.
    pub fn value(self, qos: &AnnouncedQos) -> String {
        let time = |name: &str, time: Option<Duration>| match time {
            Some(time) => format!("{name} {time:?}"),
            None => format!("no {name}"),
        };
        match self {
            Self::Reliability => in_words(qos.reliability),
            Self::Durability => in_words(qos.durability),
            Self::Deadline => time("deadline", qos.deadline),
            Self::Liveliness => {
                let kind = match qos.liveliness {
                    Liveliness::Automatic => "automatic liveliness".to_owned(),
                    manual => format!("liveliness {}", in_words(manual)),
                };
                format!("{kind} with {}", time("lease", qos.lease))
            }
        }
    }
}

/// Words of a value that is written with underscores elsewhere: `best effort`.
fn in_words(value: impl fmt::Display) -> String {
    value.to_string().replace('_', " ")
}

/// Policies in which a publisher offers less than a listener asks for: none when they fit.
pub fn mismatches(offered: &AnnouncedQos, asked: &AnnouncedQos) -> Vec<QosPolicy> {
    let shorter = |asked: Option<Duration>, offered: Option<Duration>| match (asked, offered) {
        (None, _) => false,
        (Some(_), None) => true,
        (Some(asked), Some(offered)) => asked < offered,
    };
    let unmet = [
        (
            QosPolicy::Reliability,
            asked.reliability == Reliability::Reliable
                && offered.reliability == Reliability::BestEffort,
        ),
        (QosPolicy::Durability, asked.durability > offered.durability),
        (QosPolicy::Deadline, shorter(asked.deadline, offered.deadline)),
        (
            QosPolicy::Liveliness,
            asked.liveliness > offered.liveliness || shorter(asked.lease, offered.lease),
        ),
    ];
    unmet.into_iter().filter(|&(_, unmet)| unmet).map(|(policy, _)| policy).collect()
}

/// Quality of service that fits the peers, and warnings of peers that it does not fit.
///
/// ```
/// use wrapyfi_endpoint::{Qos, QosPreset, Reliability, listener_qos};
/// let publishers = [Qos::from(QosPreset::SensorData).into(), Qos::default().into()];
/// let matched = listener_qos(&publishers, &Qos::default());
/// assert_eq!(matched.qos.reliability, Reliability::BestEffort); // heard by both
/// assert_eq!(matched.warnings[0].count, 1);
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MatchedQos {
    /// The quality of service to use.
    pub qos: Qos,
    /// Policies in which the peers do not agree, or ask for more than can be offered.
    pub warnings: Vec<QosWarning>,
}

/// Peers that do not agree with the others, or with us.
///
/// See [`MatchedQos`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct QosWarning {
    /// Policy in which they do not agree.
    pub policy: QosPolicy,
    /// Role of these peers: [`Role::Publisher`] where the endpoint is a listener.
    pub peers: Role,
    /// Number of the peers that do not agree.
    pub count: usize,
    /// Number of all peers.
    pub of: usize,
}

impl fmt::Display for QosWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { policy, peers, count, of } = self;
        match peers {
            Role::Publisher | Role::Server => write!(
                f,
                "{count} of {of} publishers offer less {policy} than the others: the route asks \
                 for no more than they all offer"
            ),
            Role::Listener | Role::Client => write!(
                f,
                "{count} of {of} subscribers ask for a {policy} that no route offers: they stay \
                 unmatched"
            ),
        }
    }
}

/// Quality of service with which a listener hears all of `publishers`: `base` where there are none,
/// and for history and lifespan always.
///
/// It is reliable and transient local only where all of them are; it has the longest deadline and
/// lease, none where one of them has none, and manual liveliness only where all of them have it.
pub fn listener_qos(publishers: &[AnnouncedQos], base: &Qos) -> MatchedQos {
    let of = publishers.len();
    if of == 0 {
        return MatchedQos { qos: *base, warnings: Vec::new() };
    }
    let count = |has: &dyn Fn(&AnnouncedQos) -> bool| publishers.iter().filter(|p| has(p)).count();
    let best_effort = count(&|p| p.reliability == Reliability::BestEffort);
    let volatile = count(&|p| p.durability == AnnouncedDurability::Volatile);
    let warnings = [(QosPolicy::Reliability, best_effort), (QosPolicy::Durability, volatile)]
        .into_iter()
        .filter(|&(_, count)| 0 < count && count < of)
        .map(|(policy, count)| QosWarning { policy, peers: Role::Publisher, count, of })
        .collect();
    let by_topic = publishers.iter().all(|p| p.liveliness == Liveliness::ManualByTopic);
    let qos = Qos {
        reliability: if best_effort == 0 { Reliability::Reliable } else { Reliability::BestEffort },
        durability: if volatile == 0 { Durability::TransientLocal } else { Durability::Volatile },
        history: base.history,
        deadline: longest(publishers.iter().map(|p| p.deadline)),
        // Messages grow old at their publisher; listeners have no say in it.
        lifespan: base.lifespan,
        liveliness: if by_topic { Liveliness::ManualByTopic } else { Liveliness::Automatic },
        lease: longest(publishers.iter().map(|p| p.lease)),
    };
    MatchedQos { qos, warnings }
}

/// Quality of service with which a publisher is heard by all of `listeners`: `base`, and more where
/// one of them asks for more.
///
/// It is reliable and transient local where one asks for it; it has the shortest deadline and
/// lease, and manual liveliness where one asks for it. No policy is less than that of `base`.
pub fn publisher_qos(listeners: &[AnnouncedQos], base: &Qos) -> MatchedQos {
    let any = |asks: &dyn Fn(&AnnouncedQos) -> bool| listeners.iter().any(asks);
    let mut qos = *base;
    if any(&|l| l.reliability == Reliability::Reliable) {
        qos.reliability = Reliability::Reliable;
    }
    if any(&|l| l.durability >= AnnouncedDurability::TransientLocal) {
        qos.durability = Durability::TransientLocal;
    }
    qos.deadline = shortest(listeners.iter().map(|l| l.deadline).chain([base.deadline]));
    qos.lease = shortest(listeners.iter().map(|l| l.lease).chain([base.lease]));
    if any(&|l| l.liveliness != Liveliness::Automatic) {
        qos.liveliness = Liveliness::ManualByTopic;
    }
    let offered = AnnouncedQos::from(qos);
    let of = listeners.len();
    let warnings =
        [QosPolicy::Reliability, QosPolicy::Durability, QosPolicy::Deadline, QosPolicy::Liveliness]
            .into_iter()
            .filter_map(|policy| {
                let unmet = |asked: &&AnnouncedQos| mismatches(&offered, asked).contains(&policy);
                let count = listeners.iter().filter(unmet).count();
                (count > 0).then_some(QosWarning { policy, peers: Role::Listener, count, of })
            })
            .collect();
    MatchedQos { qos, warnings }
}

/// The longest of several times, infinite where one is.
fn longest(times: impl Iterator<Item = Option<Duration>>) -> Option<Duration> {
    let all = times.collect::<Option<Vec<_>>>()?;
    all.into_iter().max().map(|time| time.max(SHORTEST))
}

/// The shortest of several times; infinite where all are.
fn shortest(times: impl Iterator<Item = Option<Duration>>) -> Option<Duration> {
    times.flatten().min().map(|time| time.max(SHORTEST))
}

#[cfg(test)]
#[path = "qos_match_tests.rs"]
mod tests;
