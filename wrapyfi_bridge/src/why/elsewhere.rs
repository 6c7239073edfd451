//! A name, or a bridge, on ROS 2 where this program does not look: neighbouring domains, and other machines.

use std::time::Duration;

use tracing_subscriber::util::SubscriberInitExt as _;
use wrapyfi_core::endpoint::{Discovered, Middleware as _, Wake};
use wrapyfi_core::middleware::ros2::environment::MAX_DOMAIN_ID;

use super::{Elsewhere, Graph};
use crate::middlewares::{Ros2Section, ros2_elsewhere};

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
    is_met: &(dyn Fn(&Discovered) -> bool + Sync),
    wide: bool,
    is_over: &(dyn Fn() -> bool + Sync),
) -> Vec<Elsewhere> {
    let own = graph.domain_id;
    let near = own.saturating_sub(NEAR)..=own.saturating_add(NEAR).min(MAX_DOMAIN_ID);
    let mut domains: Vec<u32> = match wide {
        true => vec![own],
        false => near.chain([0]).filter(|domain| *domain != own).collect(),
    };
    domains.sort_by_key(|domain| (domain.abs_diff(own), *domain));
    domains.dedup();
    let mut found: Vec<(u32, Discovered)> = std::thread::scope(|scope| {
        let looks: Vec<_> = domains
            .into_iter()
            .map(|domain| {
                scope.spawn(move || {
                    // Where a bridge looks, its log is no place for nodes that live for a moment.
                    let _silent = tracing_subscriber::registry().set_default();
                    let found = one(section, domain, wide, is_met, is_over);
                    found.map(|one| (domain, one))
                })
            })
            .collect();
        looks.into_iter().filter_map(|look| look.join().ok().flatten()).collect()
    });
    found.sort_by_key(|(domain, _)| domain.abs_diff(own));
    let told = |(domain, endpoint): (u32, Discovered)| {
        let (place, remedy) = match wide {
            true => (
                "the same domain on another machine".to_owned(),
                format!("{} where the bridge starts (it has {} now)", graph.widening, graph.range),
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

/// Endpoint that is looked for in a domain.
fn one(
    section: &Ros2Section,
    domain: u32,
    wide: bool,
    is_met: &dyn Fn(&Discovered) -> bool,
    is_over: &dyn Fn() -> bool,
) -> Option<Discovered> {
    let ros2 = ros2_elsewhere(section, domain, wide).ok()?;
    let mut discovery = ros2.discover().ok()?;
    let wake = Wake::new();
    loop {
        let found = discovery.endpoints().ok()?;
        let first = found.into_iter().find(is_met);
        if is_over() || first.as_ref().is_some_and(|one| one.node.is_some()) {
            return first;
        }
        wake.wait(AGAIN);
    }
}
