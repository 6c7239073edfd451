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
    /// Number of all peers, those that agree included.
    pub of: usize,
}

impl fmt::Display for QosWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { policy, peers, count, of } = self;
        match peers.is_provider() {
            true => write!(
                f,
                "{count} of {of} publishers offer less {policy} than the others: the route asks \
                 for no more than they all offer"
            ),
            false => write!(
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
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{History, QosPreset};

    fn usual() -> AnnouncedQos {
        Qos::default().into()
    }

    fn sensor() -> AnnouncedQos {
        Qos::from(QosPreset::SensorData).into()
    }

    fn latched() -> AnnouncedQos {
        Qos::from(QosPreset::Latched).into()
    }

    fn ms(time: u64) -> Option<Duration> {
        Some(Duration::from_millis(time))
    }

    #[test]
    fn without_peers_the_base_is_used() {
        let base = Qos { history: History::KeepAll, ..QosPreset::SensorData.into() };
        let expected = MatchedQos { qos: base, warnings: vec![] };
        assert_eq!(listener_qos(&[], &base), expected);
        assert_eq!(publisher_qos(&[], &base), expected);
    }

    #[test]
    fn a_listener_asks_for_what_all_publishers_offer() {
        let base = Qos::default();
        let reliability = |peers: &[AnnouncedQos]| listener_qos(peers, &base).qos.reliability;
        assert_eq!(reliability(&[usual(), usual()]), Reliability::Reliable);
        assert_eq!(reliability(&[usual(), sensor()]), Reliability::BestEffort);
        let durability = |peers: &[AnnouncedQos]| listener_qos(peers, &base).qos.durability;
        assert_eq!(durability(&[latched(), latched()]), Durability::TransientLocal);
        assert_eq!(durability(&[latched(), usual()]), Durability::Volatile);
        let persistent = AnnouncedQos { durability: AnnouncedDurability::Persistent, ..usual() };
        assert_eq!(durability(&[latched(), persistent]), Durability::TransientLocal);
    }

    #[test]
    fn a_listener_asks_for_the_longest_times() {
        let base = Qos::default();
        let fast = AnnouncedQos { deadline: ms(10), lease: ms(300), ..usual() };
        let slow = AnnouncedQos { deadline: ms(40), lease: ms(200), lifespan: ms(1), ..usual() };
        let both = listener_qos(&[fast, slow], &base).qos;
        assert_eq!((both.deadline, both.lease, both.lifespan), (ms(40), ms(300), None));
        let with_endless = listener_qos(&[fast, slow, usual()], &base).qos;
        assert_eq!((with_endless.deadline, with_endless.lease), (None, None));
    }

    #[test]
    fn a_listener_asks_for_manual_liveliness_where_all_have_it() {
        let manual = AnnouncedQos { liveliness: Liveliness::ManualByTopic, ..usual() };
        let participant = AnnouncedQos { liveliness: Liveliness::ManualByParticipant, ..usual() };
        let asked = |peers: &[AnnouncedQos]| listener_qos(peers, &Qos::default()).qos.liveliness;
        assert_eq!(asked(&[manual, manual]), Liveliness::ManualByTopic);
        assert_eq!(asked(&[manual, participant]), Liveliness::Automatic);
        assert_eq!(asked(&[manual, usual()]), Liveliness::Automatic);
    }

    #[test]
    fn publishers_that_differ_are_named() {
        let found = listener_qos(&[latched(), sensor(), sensor()], &Qos::default()).warnings;
        let texts: Vec<_> = found.iter().map(ToString::to_string).collect();
        assert_eq!(texts.len(), 2);
        assert!(texts[0].starts_with("2 of 3 publishers offer less reliability"), "{}", texts[0]);
        assert!(texts[1].starts_with("2 of 3 publishers offer less durability"), "{}", texts[1]);
        assert_eq!(listener_qos(&[sensor(), sensor()], &Qos::default()).warnings, []);
    }

    #[test]
    fn a_publisher_offers_what_one_listener_asks_for() {
        let base = Qos::from(QosPreset::SensorData);
        let strict = AnnouncedQos {
            deadline: ms(100),
            lease: ms(1500),
            liveliness: Liveliness::ManualByTopic,
            ..latched()
        };
        let loose = AnnouncedQos { deadline: ms(300), lease: ms(50), ..sensor() };
        let found = publisher_qos(&[strict, loose], &base);
        assert_eq!(
            found.qos,
            Qos {
                reliability: Reliability::Reliable,
                durability: Durability::TransientLocal,
                history: base.history,
                deadline: ms(100),
                lifespan: None,
                liveliness: Liveliness::ManualByTopic,
                lease: ms(50),
            }
        );
        assert_eq!(found.warnings, []);
        assert_eq!(publisher_qos(&[sensor()], &Qos::default()).qos, Qos::default());
    }

    #[test]
    fn what_no_publisher_can_offer_is_said() {
        let persistent = AnnouncedQos { durability: AnnouncedDurability::Persistent, ..usual() };
        let hasty = AnnouncedQos { deadline: Some(Duration::from_nanos(1)), ..usual() };
        let found = publisher_qos(&[persistent, hasty, usual()], &Qos::default());
        assert_eq!(found.qos.deadline, Some(SHORTEST));
        let texts: Vec<_> = found.warnings.iter().map(ToString::to_string).collect();
        assert!(texts[0].starts_with("1 of 3 subscribers ask for a durability"), "{texts:?}");
        assert!(texts[1].starts_with("1 of 3 subscribers ask for a deadline"), "{texts:?}");
    }

    #[test]
    fn values_are_told_in_words() {
        let strict = AnnouncedQos { deadline: ms(100), lease: ms(1500), ..sensor() };
        let words = |policy: QosPolicy| policy.value(&strict);
        assert_eq!(words(QosPolicy::Reliability), "best effort");
        assert_eq!(words(QosPolicy::Durability), "volatile");
        assert_eq!(words(QosPolicy::Deadline), "deadline 100ms");
        assert_eq!(words(QosPolicy::Liveliness), "automatic liveliness with lease 1.5s");
        assert_eq!(QosPolicy::Deadline.value(&usual()), "no deadline");
    }

    fn time() -> impl Strategy<Value = Option<Duration>> {
        prop_oneof![
            Just(None),
            (0_u64..5_000_000_000).prop_map(|ns| Some(Duration::from_nanos(ns)))
        ]
    }

    fn announced() -> impl Strategy<Value = AnnouncedQos> {
        let reliability = prop_oneof![Just(Reliability::Reliable), Just(Reliability::BestEffort)];
        let durability = prop_oneof![
            Just(AnnouncedDurability::Volatile),
            Just(AnnouncedDurability::TransientLocal),
            Just(AnnouncedDurability::Transient),
            Just(AnnouncedDurability::Persistent),
        ];
        let liveliness = prop_oneof![
            Just(Liveliness::Automatic),
            Just(Liveliness::ManualByParticipant),
            Just(Liveliness::ManualByTopic),
        ];
        (reliability, durability, time(), time(), liveliness, time()).prop_map(
            |(reliability, durability, deadline, lifespan, liveliness, lease)| AnnouncedQos {
                reliability,
                durability,
                history: None,
                deadline,
                lifespan,
                liveliness,
                lease,
            },
        )
    }

    fn base() -> impl Strategy<Value = Qos> {
        prop_oneof![
            Just(Qos::default()),
            Just(Qos::from(QosPreset::SensorData)),
            Just(Qos::from(QosPreset::Latched)),
        ]
    }

    /// True for a quality of service that some route could offer.
    fn possible(asked: &AnnouncedQos) -> bool {
        asked.durability <= AnnouncedDurability::TransientLocal
            && [asked.deadline, asked.lease].into_iter().flatten().all(|time| time >= SHORTEST)
    }

    proptest! {
        #[test]
        fn a_listener_fits_every_publisher(
            peers in prop::collection::vec(announced(), 0..6),
            base in base(),
        ) {
            let asked = listener_qos(&peers, &base).qos.into();
            if !peers.is_empty() {
                for offered in &peers {
                    prop_assert_eq!(mismatches(offered, &asked), []);
                }
            }
        }

        #[test]
        fn a_listener_asks_for_no_less_than_it_can_have(
            peers in prop::collection::vec(announced(), 1..6),
            base in base(),
        ) {
            let asked = listener_qos(&peers, &base).qos;
            let too_much = |more: Qos| {
                let more = more.into();
                peers.iter().any(|offered| !mismatches(offered, &more).is_empty())
            };
            if asked.reliability == Reliability::BestEffort {
                let more = Qos { reliability: Reliability::Reliable, ..asked };
                prop_assert!(too_much(more));
            }
            if asked.durability == Durability::Volatile {
                let more = Qos { durability: Durability::TransientLocal, ..asked };
                prop_assert!(too_much(more));
            }
            if asked.liveliness == Liveliness::Automatic {
                let more = Qos { liveliness: Liveliness::ManualByTopic, ..asked };
                prop_assert!(too_much(more));
            }
            for deadline in asked.deadline.into_iter().filter(|&time| time > SHORTEST) {
                let more = Qos { deadline: Some(deadline - Duration::from_nanos(1)), ..asked };
                prop_assert!(too_much(more));
            }
        }

        #[test]
        fn a_publisher_fits_every_listener_that_can_be_had(
            peers in prop::collection::vec(announced(), 0..6),
            base in base(),
        ) {
            let found = publisher_qos(&peers, &base);
            let offered = found.qos.into();
            for asked in &peers {
                let unmet = mismatches(&offered, asked);
                prop_assert!(unmet.is_empty() || !possible(asked), "{:?}", unmet);
            }
            let all_met = peers.iter().all(|asked| mismatches(&offered, asked).is_empty());
            prop_assert_eq!(found.warnings.is_empty(), all_met);
            prop_assert_eq!(mismatches(&offered, &base.into()), []);
        }

        #[test]
        fn the_order_of_peers_does_not_matter(
            peers in prop::collection::vec(announced(), 0..6),
            base in base(),
        ) {
            let mut turned = peers.clone();
            turned.reverse();
            prop_assert_eq!(listener_qos(&peers, &base), listener_qos(&turned, &base));
            prop_assert_eq!(publisher_qos(&peers, &base), publisher_qos(&turned, &base));
        }
    }
}
