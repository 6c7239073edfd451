//! Quality of service from outside.

use super::*;
use crate::{NodeName, ParameterValue};
use wrapyfi_endpoint::{History, PinnedQos, Qos, Reliability};

fn store_with(overrides: &[(&str, ParameterValue)]) -> ParameterStore {
    let overrides = overrides.iter().map(|(name, value)| ((*name).to_owned(), value.clone()));
    ParameterStore::new(&NodeName::new("node", "/ns").unwrap(), overrides.collect()).unwrap()
}

#[test]
fn qos_overrides_are_read_only_parameters() {
    let camera = "qos_overrides./ns/camera.publisher";
    let mut store = store_with(&[
        (&format!("{camera}.reliability"), "best_effort".into()),
        (&format!("{camera}.depth"), 20.into()),
        ("qos_overrides./ns/camera.subscription.depth", 2.into()),
    ]);
    let base = Qos::default();
    let mut declare = |role| store.declare_qos_overrides("/ns/camera", role, &base, false);
    let changed = declare(EndpointRole::Publisher).unwrap();
    let expected = PinnedQos {
        reliability: Some(Reliability::BestEffort),
        history: Some(History::KeepLast(20)),
        ..PinnedQos::all_of(&base)
    };
    assert_eq!(changed, (expected, false));
    // Another publisher of the topic gets the same.
    assert_eq!(declare(EndpointRole::Publisher).unwrap(), (expected, false));
    let (pinned, _) = declare(EndpointRole::Subscription).unwrap();
    assert_eq!(pinned.history, Some(History::KeepLast(2)));
    assert_eq!(store.unused_overrides().count(), 0);
    let reliability = format!("{camera}.reliability");
    assert_eq!(store.get(&reliability).unwrap(), &ParameterValue::from("best_effort"));
    assert_eq!(
        store.get(&format!("{camera}.history")).unwrap(),
        &ParameterValue::from("keep_last")
    );
    assert!(matches!(store.set(&reliability, "reliable"), Err(SetError::ReadOnly { .. })));
    assert!(store.describe(&format!("{camera}.lifespan")).is_some());
    assert!(store.describe("qos_overrides./ns/camera.subscription.lifespan").is_none());
}

#[test]
fn a_wrong_qos_override_names_topic_policy_and_values() {
    let error = |policy: &str, value: ParameterValue| {
        let name = format!("qos_overrides./chatter.subscription.{policy}");
        let mut store = store_with(&[(&name, value)]);
        let role = EndpointRole::Subscription;
        let base = Qos::default();
        let error = store.declare_qos_overrides("/chatter", role, &base, false).unwrap_err();
        assert_eq!(store.names().count(), 2);
        error.to_string()
    };
    assert_eq!(
        error("reliability", "reliabel".into()),
        "parameter qos_overrides./chatter.subscription.reliability: policy reliability of the \
         subscription of /chatter cannot be reliabel (STRING); it can be system_default, reliable, \
         best_effort, best_available"
    );
    assert_eq!(
        error("lifespan", 1.into()),
        "parameter qos_overrides./chatter.subscription.lifespan: the subscription of /chatter has no \
         policy \"lifespan\" to override; it has deadline, depth, durability, history, liveliness, \
         liveliness_lease_duration, reliability"
    );
    assert!(error("deepth", 1.into()).contains("no policy \"deepth\""));
    for depth in [ParameterValue::from(-1), (1_i64 << 31).into(), 1.5.into(), "10".into()] {
        assert!(error("depth", depth).contains("an integer from 0 to 2147483647"));
    }
    assert!(error("deadline", (-1).into()).contains("nanoseconds"));
}
