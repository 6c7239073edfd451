//! The same name on ROS 2, or a bridge with the route, where this program does not look: neighbouring domains, and other
//! machines.

use std::time::Duration;

use tracing_subscriber::util::SubscriberInitExt as _;
use wrapyfi_endpoint::{CauseCode, Discovered, Middleware as _, Wake};
use wrapyfi_ros2::environment::MAX_DOMAIN_ID;
use wrapyfi_ros2::{Ros2, Ros2Section};

use super::look::Wanted;
use super::{Elsewhere, Graph, running};
use crate::middlewares::ros2_elsewhere;

/// Time for which the own domain is looked at again, as far as multicast reaches.
pub(super) const WIDE: Duration = Duration::from_millis(450);
/// Time between two looks.
const AGAIN: Duration = Duration::from_millis(20);
/// Domains below and above the own that are looked at.
const NEAR: u32 = 2;

/// Looks into a handful of domains, side by side; if `wide`, into the same one as far as multicast reaches. Each is
/// looked at until `is_over`, because some nodes answer a new one late.
pub(super) fn look(
    section: &Ros2Section,
    graph: &Graph,
    wanted: &Wanted,
    wide: bool,
    is_over: &(dyn Fn() -> bool + Sync),
) -> Vec<Elsewhere> {
    let own = graph.domain_id;
    let found = in_each(section, graph, wide, &|ros2| one(ros2, wanted, is_over));
    let told = |(domain, endpoint): (u32, Discovered)| {
        let (cause, place, remedy) = match wide {
            true => (
                CauseCode::DiscoveryRange,
                "the same domain on another machine".to_owned(),
                format!("{} where the bridge starts (it has {} now)", graph.widening, graph.range),
            ),
            false => (
                CauseCode::OtherDomain,
                format!("domain {domain}"),
                format!(
                    "export ROS_DOMAIN_ID={domain} where the bridge starts (or `endpoints: {{ ros2: {{ \
                     domain_id: {domain} }} }}`), or {own} there"
                ),
            ),
        };
        Elsewhere { cause, place, remedy, endpoint }
    };
    found.into_iter().map(told).collect()
}

/// Domain in which a bridge has the route, and its node.
pub(super) fn bridge(
    section: &Ros2Section,
    graph: &Graph,
    find: running::Find<'_>,
    is_over: &(dyn Fn() -> bool + Sync),
) -> Option<(u32, String)> {
    let hear = |ros2: &Ros2| {
        let (node, _) =
            running::heard(ros2, find, &|_bridges, is_found| is_found || is_over()).running?;
        Some(node)
    };
    in_each(section, graph, false, &hear).into_iter().next()
}

/// Result of a look into each of a handful of domains, the nearest first; if `wide`, into the own as far as multicast
/// reaches.
fn in_each<R: Send>(
    section: &Ros2Section,
    graph: &Graph,
    wide: bool,
    look: &(dyn Fn(&Ros2) -> Option<R> + Sync),
) -> Vec<(u32, R)> {
    let own = graph.domain_id;
    let near = own.saturating_sub(NEAR)..=own.saturating_add(NEAR).min(MAX_DOMAIN_ID);
    let mut domains: Vec<u32> = match wide {
        true => vec![own],
        false => near.chain([0]).filter(|domain| *domain != own).collect(),
    };
    domains.sort_by_key(|domain| (domain.abs_diff(own), *domain));
    domains.dedup();
    std::thread::scope(|scope| {
        let start = |domain| {
            scope.spawn(move || {
                // Where a bridge looks, its log is no place for nodes that live for a moment.
                let _silent = tracing_subscriber::registry().set_default();
                Some((domain, look(&ros2_elsewhere(section, domain, wide).ok()?)?))
            })
        };
        let looks: Vec<_> = domains.into_iter().map(start).collect();
        looks.into_iter().filter_map(|look| look.join().ok().flatten()).collect()
    })
}

/// Endpoint of the name in a domain.
fn one(ros2: &Ros2, wanted: &Wanted, is_over: &dyn Fn() -> bool) -> Option<Discovered> {
    let mut discovery = ros2.discover().ok()?;
    let wake = Wake::new();
    loop {
        let found = discovery.endpoints().ok()?;
        let first = found.into_iter().find(|one| wanted.is_met(one));
        if is_over() || first.as_ref().is_some_and(|one| one.node.is_some()) {
            return first;
        }
        wake.wait(AGAIN);
    }
}
