//! Circles over the routes of several bridges.
//!
//! ```text
//!   bridge 1: A ─▶ B      bridge 2: B ─▶ A      no bridge hears itself, each hears the other:
//!                                               every message would go round for ever
//! ```
//!
//! Bridges tell each other what they carry. Of the bridges of a circle the one that began last stops its route, and
//! all of them come to that by themselves. Routes by pattern pass over what other patterns made, so that a circle
//! of those alone carries nothing round.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::circle::shortest_way_back;
use super::route::RouteKey;
use wrapyfi_endpoint::{CarriedBack, Cause};

/// End of a route, comparable with the ends of other bridges' routes.
///
/// ```
/// use wrapyfi_engine::NetworkAddress;
/// let end = |network: &str| NetworkAddress { address: "zeromq:/x".into(), network: network.into() };
/// assert_ne!(end("10.0.0.5:5555"), end("10.0.0.6:5555")); // two brokers, two topics
/// ```
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct NetworkAddress {
    /// Address with the name that the topic has on its middleware: `zeromq:/x`.
    pub address: String,
    /// Network on which that name means this topic, as `Middleware::network` has it.
    pub network: String,
}

/// Topic that a bridge carries from one name to another.
///
/// See [`BridgeRoutes`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CarriedTopic {
    /// Place from which messages are taken.
    pub from: NetworkAddress,
    /// Place at which they are published.
    pub to: NetworkAddress,
    /// True where a pattern made the route: it passes over what other patterns made.
    pub by_pattern: bool,
}

/// Topics that a bridge carries.
///
/// ```
/// use wrapyfi_engine::{BridgeRoutes, CarriedTopic, NetworkAddress};
/// let end = |address: &str| NetworkAddress { address: address.into(), network: String::new() };
/// let carried = |from, to| CarriedTopic { from: end(from), to: end(to), by_pattern: false };
/// let bridge = |bridge, node: &str, from, to| {
///     BridgeRoutes { bridge, node: node.into(), topics: vec![carried(from, to)] }
/// };
/// let first = bridge(1, "/there", "ros2:/x", "zeromq:/x");
/// let last = bridge(2, "/back", "zeromq:/x", "ros2:/x");
/// assert!(first.closing(&[&last]).is_empty()); // the bridge that began last stops its route
/// let circle = &last.closing(&[&first])[&0];
/// assert_eq!(circle.code(), wrapyfi_endpoint::CauseCode::Cycle);
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct BridgeRoutes {
    /// Number of the bridge. The bridge that began earlier has the smaller number.
    pub bridge: u64,
    /// Full name of its node.
    pub node: String,
    /// Topics that it carries.
    pub topics: Vec<CarriedTopic>,
}

impl BridgeRoutes {
    /// Routes of this bridge that close a circle over `others` and are to stop, by their places in `topics`, each with
    /// the reason. Bridges that began later stop their own.
    #[must_use]
    pub fn closing(&self, others: &[&Self]) -> BTreeMap<usize, Cause> {
        let earlier = others.iter().copied().filter(|other| other.bridge < self.bridge);
        let all: Vec<(&Self, &CarriedTopic)> = [self]
            .into_iter()
            .chain(earlier)
            .flat_map(|it| it.topics.iter().map(move |topic| (it, topic)))
            .collect();
        let mut taking: BTreeMap<&NetworkAddress, Vec<usize>> = BTreeMap::new();
        for (place, (_, topic)) in all.iter().enumerate() {
            taking.entry(&topic.from).or_default().push(place);
        }
        let (all, taking) = (&all, &taking);
        let next = |place: usize| {
            let here = all.get(place).copied();
            let reached = here.and_then(|(_, topic)| taking.get(&topic.to)).into_iter().flatten();
            reached.copied().filter(move |then| {
                let then = all.get(*then).copied();
                here.zip(then).is_some_and(|((bridge, topic), (other, after))| {
                    // A bridge does not hear itself.
                    bridge.bridge != other.bridge && !(topic.by_pattern && after.by_pattern)
                })
            })
        };
        let mut closing = BTreeMap::new();
        for (first, topic) in self.topics.iter().enumerate() {
            let Some(way) = shortest_way_back(first, next) else { continue };
            let way = way.into_iter().filter_map(|place| all.get(place));
            let way = way.map(|(bridge, topic)| CarriedBack {
                bridge: bridge.node.clone(),
                from: topic.from.address.clone(),
                to: topic.to.address.clone(),
            });
            let (from, to) = (topic.from.address.clone(), topic.to.address.clone());
            let (bridge, way) = (self.node.clone(), way.collect());
            closing.insert(first, Cause::Cycle { bridge, from, to, way });
        }
        closing
    }
}

/// Route that carries a topic, as its driver lists it for [`BridgeRoutes`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CarryingRoute {
    /// Ends of the route.
    pub key: RouteKey,
    /// True where a pattern made it.
    pub by_pattern: bool,
    /// False where it goes on though it closes a circle (`loop_guard: false`).
    pub guarded: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bridge(number: u64, topics: &[(&str, &str, bool)]) -> BridgeRoutes {
        let end = |name: &str| NetworkAddress { address: format!("m:{name}"), network: "n".into() };
        let carried = |(from, to, by_pattern): &(&str, &str, bool)| CarriedTopic {
            from: end(from),
            to: end(to),
            by_pattern: *by_pattern,
        };
        BridgeRoutes {
            bridge: number,
            node: format!("/{number}"),
            topics: topics.iter().map(carried).collect(),
        }
    }

    /// Places of the routes that each bridge stops.
    fn stopped(bridges: &[BridgeRoutes]) -> Vec<Vec<usize>> {
        let others = |own: &BridgeRoutes| {
            bridges.iter().filter(|it| it.bridge != own.bridge).collect::<Vec<_>>()
        };
        bridges.iter().map(|own| own.closing(&others(own)).into_keys().collect()).collect()
    }

    fn hop(bridge: &str, from: &str, to: &str) -> CarriedBack {
        let [bridge, from, to] = [bridge, from, to].map(str::to_owned);
        CarriedBack { bridge, from, to }
    }

    #[test]
    fn the_bridge_that_began_last_stops_the_route_that_closes_a_circle() {
        let there = bridge(1, &[("a", "b", false), ("c", "d", false)]);
        let back = bridge(2, &[("x", "y", false), ("b", "a", false)]);
        let none: &[usize] = &[];
        assert_eq!(stopped(&[there.clone(), back.clone()]), [none, &[1]]);
        let cause = back.closing(&[&there]).remove(&1).unwrap();
        let through = matches!(&cause, Cause::Cycle { bridge, way, .. } if bridge == "/2" && *way == [hop("/1", "m:a", "m:b")]);
        assert!(through, "{cause}");
        let beside = bridge(3, &[("a", "b", false)]);
        assert_eq!(stopped(&[there.clone(), beside.clone()]), [none, none]);
        assert_eq!(stopped(&[there, beside, back]), [none, &[0], &[1]]);
    }

    #[test]
    fn a_ring_of_three_is_a_circle_and_a_chain_is_none() {
        let each = [("a", "b"), ("b", "c"), ("c", "a")];
        let ring: Vec<_> =
            (1..).zip(each).map(|(n, (from, to))| bridge(n, &[(from, to, false)])).collect();
        let none: &[usize] = &[];
        assert_eq!(stopped(&ring), [none, none, &[0]]);
        let cause = ring[2].closing(&[&ring[0], &ring[1]]).remove(&0).unwrap();
        let Cause::Cycle { way, .. } = cause else { panic!("{cause}") };
        assert_eq!(way, [hop("/1", "m:a", "m:b"), hop("/2", "m:b", "m:c")]);
        assert_eq!(stopped(&ring[..2]), [none, none]);
    }

    #[test]
    fn one_bridge_does_not_hear_itself_and_patterns_pass_over_each_other() {
        assert_eq!(stopped(&[bridge(1, &[("a", "b", false), ("b", "a", false)])]), [[0; 0]]);
        let [there, back] = [bridge(1, &[("a", "b", true)]), bridge(2, &[("b", "a", true)])];
        assert_eq!(stopped(&[there.clone(), back]), [[0; 0], [0; 0]]);
        let none: &[usize] = &[];
        assert_eq!(stopped(&[there, bridge(2, &[("b", "a", false)])]), [none, &[0]]);
        let mut elsewhere = bridge(2, &[("b", "a", false)]);
        elsewhere.topics[0].from.network = "another".into();
        assert_eq!(stopped(&[bridge(1, &[("a", "b", false)]), elsewhere]), [none, none]);
    }
}
