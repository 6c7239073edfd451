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
    prop_oneof![Just(None), (0_u64..5_000_000_000).prop_map(|ns| Some(Duration::from_nanos(ns)))]
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
