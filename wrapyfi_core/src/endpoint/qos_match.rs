//! Whether two endpoints fit, and the quality of service that fits the peers there are.
//!
//! ```text
//!   what publishers offer ─▶ listener_qos  ─▶ the most that all of them offer
//!   what listeners ask    ─▶ publisher_qos ─▶ the least that all of them are content with
//! ```
//!
//! Pure functions: when to apply their answer is the endpoint's affair. `docs/qos.md` has the rules
//! as a table.

use std::fmt;
use std::time::Duration;

use super::{AnnouncedDurability, AnnouncedQos, Durability, Liveliness, Qos, Reliability, Role};

/// Shortest deadline and lease that are taken over from a peer: shorter ones would let a stranger
/// keep this machine busy with timers.
const SHORTEST: Duration = Duration::from_millis(1);

/// A policy over which a publisher and a listener may not come together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[allow(missing_docs)]
pub enum QosPolicy {
    Reliability,
    Durability,
    Deadline,
    /// Its kind, or its lease.
    Liveliness,
}

impl QosPolicy {
    /// The value that `qos` has for the policy, in words: `best effort`, `deadline 100ms`.
    #[must_use]
    pub fn value(self, qos: &AnnouncedQos) -> String {
        let time = |name: &str, time: Option<Duration>| match time {
            Some(time) => format!("{name} {time:?}"),
            None => format!("no {name}"),
        };
        match self {
            Self::Reliability => match qos.reliability {
                Reliability::Reliable => "reliable".to_owned(),
                Reliability::BestEffort => "best effort".to_owned(),
            },
            Self::Durability => match qos.durability {
                AnnouncedDurability::Volatile => "volatile".to_owned(),
                AnnouncedDurability::TransientLocal => "transient local".to_owned(),
                AnnouncedDurability::Transient => "transient".to_owned(),
                AnnouncedDurability::Persistent => "persistent".to_owned(),
            },
            Self::Deadline => time("deadline", qos.deadline),
            Self::Liveliness => {
                let kind = match qos.liveliness {
                    Liveliness::Automatic => "automatic liveliness",
                    Liveliness::ManualByParticipant => "liveliness manual by participant",
                    Liveliness::ManualByTopic => "liveliness manual by topic",
                };
                format!("{kind} with {}", time("lease", qos.lease))
            }
        }
    }
}

impl fmt::Display for QosPolicy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Reliability => "reliability",
            Self::Durability => "durability",
            Self::Deadline => "deadline",
            Self::Liveliness => "liveliness",
        })
    }
}

/// The policies in which a publisher offers less than a listener asks for: none when they fit.
#[must_use]
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

/// What fits the peers, and what they should know about it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MatchedQos {
    /// The quality of service to use.
    pub qos: Qos,
    /// Where the peers do not agree, or ask for what cannot be had.
    pub warnings: Vec<QosWarning>,
}

/// Peers that do not agree with the others, or with us.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct QosWarning {
    /// The policy concerned.
    pub policy: QosPolicy,
    /// What these peers do: [`Role::Publisher`] of a listener.
    pub peers: Role,
    /// How many of them there are.
    pub count: usize,
    /// Peers in all.
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

/// What a listener asks for so that it hears all of `publishers`: `base` where there are none, and
/// for history and lifespan always.
///
/// Reliable and transient local only where all of them are; the longest deadline and lease, none
/// where one of them has none; manual liveliness only where all of them have it.
#[must_use]
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

/// What a publisher offers so that all of `listeners` match: `base`, and more where one of them
/// asks for more.
///
/// Reliable and transient local where one asks for it; the shortest deadline and lease; manual
/// liveliness where one asks for it. Nothing is offered that is less than `base`.
#[must_use]
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

/// The shortest of those that are finite.
fn shortest(times: impl Iterator<Item = Option<Duration>>) -> Option<Duration> {
    times.flatten().min().map(|time| time.max(SHORTEST))
}

#[cfg(test)]
#[path = "qos_match_tests.rs"]
mod tests;
