//! The same name on ROS 2 where this program does not look: neighbouring domains, and other machines.

use std::time::{Duration, Instant};

use tracing_subscriber::util::SubscriberInitExt as _;
use wrapyfi_core::endpoint::{Discovered, Middleware as _, Role, Wake};
use wrapyfi_core::middleware::ros2::environment::MAX_DOMAIN_ID;

use super::look::Wanted;
use super::{Elsewhere, End};
use crate::middlewares::{Ros2Section, ros2_elsewhere};

/// Time for which each domain is looked at: nodes answer a new one at once.
const LOOK: Duration = Duration::from_millis(500);
/// Time between two looks.
const AGAIN: Duration = Duration::from_millis(20);
/// Domains below and above the own that are looked at.
const NEAR: u32 = 2;

/// Looks into a handful of domains, and past a limited range, side by side.
pub(super) fn look(section: &Ros2Section, end: &End, wanted: &Wanted) -> Vec<Elsewhere> {
    let Some(graph) = &end.graph else { return Vec::new() };
    let own = graph.domain_id;
    let near = own.saturating_sub(NEAR)..=own.saturating_add(NEAR).min(MAX_DOMAIN_ID);
    let mut domains: Vec<u32> = near.chain([0]).filter(|domain| *domain != own).collect();
    domains.sort_by_key(|domain| (domain.abs_diff(own), *domain));
    domains.dedup();
    let is_narrow = graph.range != "SUBNET";
    let places = domains.into_iter().map(|domain| (domain, false));
    let places = places.chain(is_narrow.then_some((own, true)));
    let mut found: Vec<(bool, u32, Discovered)> = std::thread::scope(|scope| {
        let looks: Vec<_> = places
            .map(|(domain, wide)| {
                scope.spawn(move || {
                    let name = &wanted.address.name;
                    // Where a bridge looks, its log is no place for nodes that live for a moment.
                    let _silent = tracing_subscriber::registry().set_default();
                    let found = one(section, domain, wide, name, wanted.role);
                    found.map(|one| (wide, domain, one))
                })
            })
            .collect();
        looks.into_iter().filter_map(|look| look.join().ok().flatten()).collect()
    });
    found.sort_by_key(|(wide, domain, _)| (!*wide, domain.abs_diff(own)));
    let told = |(wide, domain, endpoint): (bool, u32, Discovered)| {
        let (place, remedy) = match wide {
            true => (
                "the same domain on another machine".to_owned(),
                format!(
                    "export ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET where the bridge starts (it has {} now)",
                    graph.range
                ),
            ),
            false => (
                format!("domain {domain}"),
                format!(
                    "export ROS_DOMAIN_ID={domain} where the bridge starts (or `endpoints: {{ ros2: {{ \
                     domain_id: {domain} }} }}`), or {own} there"
                ),
            ),
        };
        Elsewhere { place, remedy, endpoint }
    };
    found.into_iter().map(told).collect()
}

/// Endpoint of the name in a domain.
fn one(
    section: &Ros2Section,
    domain: u32,
    wide: bool,
    name: &str,
    role: Role,
) -> Option<Discovered> {
    let ros2 = ros2_elsewhere(section, domain, wide).ok()?;
    let mut discovery = ros2.discover().ok()?;
    let (wake, end) = (Wake::new(), Instant::now() + LOOK);
    loop {
        let found = discovery.endpoints().ok()?;
        let mut named = found.into_iter().filter(|one| one.name == name && one.role == role);
        let first = named.next();
        if Instant::now() >= end || first.as_ref().is_some_and(|one| one.node.is_some()) {
            return first;
        }
        wake.wait(AGAIN);
    }
}
