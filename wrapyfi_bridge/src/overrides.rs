//! Quality of service of routes from the command line: `-p qos_overrides./topic.publisher.depth:=20`.
//!
//! ```text
//!   Plan ─ ROS 2 ends, remapped ─▶ those that are given ─▶ read-only parameters, before anything opens
//!     ▲                                                        │
//!     └───── what they change ─────────────────────────────────┘
//! ```

use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::Interaction;
use wrapyfi_engine::{Plan, QosConfig, QosOverride, Route};
use wrapyfi_node::parameters::{EndpointRole, ParameterStore, QosOverrideError};

use crate::node::{GRAPH, Node};

/// Changes the quality of service of routes by what the command line gives for their topics on ROS 2,
/// and declares the policies of those ends as parameters, and of no others. Routes that meet in one end
/// of one topic share its parameters: these change all of them, and otherwise show what the first of
/// them has.
///
/// # Errors
/// When the command line names a policy that there is not, or a value that it cannot have.
pub fn apply(
    plan: &mut Plan,
    node: &Node,
    store: &mut ParameterStore,
) -> Result<(), QosOverrideError> {
    for route in &mut plan.routes {
        for role in [EndpointRole::Subscription, EndpointRole::Publisher] {
            // A name that the rules make invalid is the route's own fault, and said there.
            let Some(topic) = topic(route, role, node) else { continue };
            let prefix = format!("qos_overrides.{topic}.{role}.");
            if store.overrides().keys().any(|name| name.starts_with(&prefix)) {
                change(route, role, &topic, store)?;
            }
        }
    }
    Ok(())
}

/// Changes one end of a route.
fn change(
    route: &mut Route,
    role: EndpointRole,
    topic: &str,
    store: &mut ParameterStore,
) -> Result<(), QosOverrideError> {
    let (base, follows) = (route.policy.qos.qos(), matches!(route.policy.qos, QosConfig::Match(_)));
    let (pinned, follows) = store.declare_qos_overrides(topic, role, &base, follows)?;
    let end = match role {
        EndpointRole::Publisher => &mut route.policy.to_override,
        EndpointRole::Subscription => &mut route.policy.from_override,
    };
    *end = QosOverride { pinned, follows };
    let qos = pinned.apply(base);
    let rest = if follows { ", and follows its peers in the rest" } else { "" };
    tracing::info!(route = %route.name, "the {role} of {topic} begins as {qos}{rest}");
    Ok(())
}

/// The topic at one end of a route, where that end is one on ROS 2.
fn topic(route: &Route, role: EndpointRole, node: &Node) -> Option<String> {
    let types = route.message_types();
    let (address, message_type) = match role {
        EndpointRole::Publisher => (&route.to, types.to),
        EndpointRole::Subscription => (&route.from, types.from),
    };
    // Properties are the parameters of a node: no topic.
    let is_topic = route.is_whole()
        && route.interaction() == Interaction::Topic
        && address.middleware == GRAPH
        && message_type != MessageType::Properties;
    is_topic.then(|| node.resolve_topic(&address.name).ok()).flatten()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::time::Duration;

    use super::*;
    use wrapyfi_endpoint::{Durability, PinnedQos, QosPreset, Reliability, TopicSpec};
    use wrapyfi_node::ParameterValue;

    fn route(from: &str, to: &str, qos: QosConfig) -> Route {
        let address = |text: &str| text.parse().unwrap();
        let mut route = Route::topic(address(from), address(to), MessageType::Image);
        route.policy.qos = qos;
        route
    }

    fn applied(
        routes: Vec<Route>,
        given: &[(&str, ParameterValue)],
    ) -> Result<(Vec<Route>, ParameterStore), QosOverrideError> {
        let node = Node::bridge().unwrap();
        let given: BTreeMap<_, _> =
            given.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
        let mut store = ParameterStore::new(node.name(), given).unwrap();
        let mut plan = Plan { routes };
        apply(&mut plan, &node, &mut store)?;
        Ok((plan.routes, store))
    }

    fn ends(route: &Route) -> [TopicSpec; 2] {
        [&route.from, &route.to].map(|address| route.topic_spec(address))
    }

    #[test]
    fn each_end_has_its_own() {
        let fixed = QosConfig::Fixed(QosPreset::Latched.into());
        let routes = vec![
            route("ros2:/in", "ros2:/out", QosConfig::default()),
            route("zeromq:/in", "ros2:/kept", fixed),
        ];
        let (routes, store) = applied(
            routes,
            &[
                ("qos_overrides./out.publisher.reliability", "best_effort".into()),
                ("qos_overrides./in.subscription.deadline", 250_000_000.into()),
                ("qos_overrides./kept.publisher.depth", 7.into()),
                ("qos_overrides./in.publisher.depth", 1.into()),
            ],
        )
        .unwrap();
        let [from, to] = ends(&routes[0]);
        assert_eq!(to.pinned.reliability, Some(Reliability::BestEffort));
        assert_eq!((to.pinned.durability, to.match_peers), (None, true));
        assert_eq!(from.pinned.deadline, Some(Some(Duration::from_millis(250))));
        assert_eq!((from.pinned.reliability, from.match_peers), (None, true));
        let [zeromq, kept] = ends(&routes[1]);
        assert_eq!(zeromq.pinned, PinnedQos::default());
        let qos = kept.pinned.apply(kept.qos);
        assert_eq!(qos.to_string(), "reliable transient_local keep_last(7)");
        assert!(!kept.match_peers);
        // Nothing publishes there.
        let unused: Vec<_> = store.unused_overrides().map(|(name, _)| name).collect();
        assert_eq!(unused, ["qos_overrides./in.publisher.depth"]);
        let value = |name: &str| store.get(&format!("qos_overrides.{name}")).unwrap().to_string();
        assert_eq!(value("/out.publisher.durability"), "best_available");
        assert_eq!(value("/kept.publisher.durability"), "transient_local");
        assert!(store.describe("qos_overrides./in.subscription.lifespan").is_none());
    }

    #[test]
    fn routes_that_meet_share_the_parameters() {
        let fixed = |preset: QosPreset| QosConfig::Fixed(preset.into());
        let routes = vec![
            route("ros2:/cam", "zeromq:/a", fixed(QosPreset::SensorData)),
            route("ros2:/cam", "zeromq:/b", fixed(QosPreset::Latched)),
        ];
        let name = "qos_overrides./cam.subscription.reliability";
        let (routes, store) = applied(routes, &[(name, "best_available".into())]).unwrap();
        for (route, durability) in
            routes.iter().zip([Durability::Volatile, Durability::TransientLocal])
        {
            let [from, _] = ends(route);
            assert!(from.match_peers);
            assert_eq!(from.pinned.reliability, None);
            assert_eq!(from.pinned.apply(from.qos).durability, durability);
        }
        assert_eq!(store.get(name).unwrap().to_string(), "best_available");
        let depth = store.get("qos_overrides./cam.subscription.depth").unwrap();
        assert_eq!(depth, &ParameterValue::Integer(5));
    }

    #[test]
    fn what_is_wrong_names_topic_policy_and_values() {
        let error = |name: &str, value: ParameterValue| {
            let name = format!("qos_overrides./out.publisher.{name}");
            let routes = vec![route("zeromq:/in", "ros2:/out", QosConfig::default())];
            applied(routes, &[(&name, value)]).map(drop).unwrap_err().to_string()
        };
        let text = error("reliabilty", "best_effort".into());
        assert!(text.contains("qos_overrides./out.publisher.reliabilty"), "{text}");
        assert!(text.contains("/out has no policy") && text.contains("reliability"), "{text}");
        let text = error("reliability", "best".into());
        assert!(text.contains("cannot be best") && text.contains("best_effort"), "{text}");
        let text = error("avoid_ros_namespace_conventions", true.into());
        assert!(text.contains("has no policy"), "{text}");
    }

    #[test]
    fn only_what_is_given_is_a_parameter() {
        let own = applied(Vec::new(), &[]).unwrap().1.names().count();
        let routes = || {
            let many = (0..600).map(|n| format!("ros2:/out{n}"));
            many.map(|to| route("zeromq:/in", &to, QosConfig::default())).collect()
        };
        assert_eq!(applied(routes(), &[]).unwrap().1.names().count(), own);
        let name = "qos_overrides./out599.publisher.depth";
        let (routes, store) = applied(routes(), &[(name, 3.into())]).unwrap();
        let given: Vec<_> =
            store.names().filter(|name| name.starts_with("qos_overrides")).collect();
        assert!(given.iter().all(|name| name.starts_with("qos_overrides./out599.publisher.")));
        assert_eq!((given.len(), store.names().count()), (8, own + 8));
        let [_, to] = ends(&routes[599]);
        assert_eq!(to.pinned.apply(to.qos).to_string(), "reliable volatile keep_last(3)");
    }
}
