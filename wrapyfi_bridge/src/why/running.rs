//! Status of a route, as a bridge that runs it tells it: the bridge that looks, or those on the graph of ROS 2.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

use wrapyfi_core::engine::{Kind, Route};
use wrapyfi_core::middleware::ros2::Ros2;
use wrapyfi_core::types::Map;
use wrapyfi_interfaces::wrapyfi_msgs::msg::RouteInfo;
use wrapyfi_interfaces::wrapyfi_msgs::srv::ListRoutes_Response;

use super::PATIENCE;
use crate::on_graph::client::{Asker, LIST_ROUTES, bridges};

/// Time for an answer of a bridge that was found late.
const ANSWER: Duration = Duration::from_millis(400);

/// Status of a route among those of a bridge: the one between the same ends. Of a pattern that is well it is that of
/// the first of its routes that is not.
pub(super) fn of(route: &Route, all: Vec<RouteInfo>) -> Option<RouteInfo> {
    let kind = if matches!(route.kind, Kind::Topic(_)) { "topic" } else { "service" };
    let ends = |one: &RouteInfo| {
        let is_service = one.kind == "service";
        let (from, to) = (one.source.clone(), one.destination.clone());
        if is_service { (to, from) } else { (from, to) }
    };
    let (from, to) = (route.from.to_string(), route.to.to_string());
    let is_one_of = |one: &RouteInfo| {
        let (from, to) = ends(one);
        let source = from.strip_prefix(&format!("{}:", route.from.middleware));
        source.and_then(|name| route.target(name)).is_some_and(|target| target.to_string() == to)
    };
    let is_ill = |one: &RouteInfo| matches!(one.state.as_str(), "error" | "degraded");
    let (mut own, mut ill) = (None, None);
    for one in all.into_iter().filter(|one| one.kind == kind) {
        if ends(&one) == (from.clone(), to.clone()) {
            own = Some(one);
        } else if ill.is_none() && is_ill(&one) && is_one_of(&one) {
            ill = Some(one);
        }
    }
    match own {
        Some(own) if is_ill(&own) => Some(own),
        own => ill.or(own),
    }
}

/// Asks the bridges on the graph of ROS 2 for the route: the node of the one that has it, and its status. `None` where
/// none tells of it in time, and where it `is_answered` before.
pub(super) fn asked(
    ros2: &Ros2,
    route: &Route,
    is_answered: &AtomicBool,
) -> Option<(String, RouteInfo)> {
    let until = Instant::now() + PATIENCE;
    let is_over =
        |_: bool, has_told: bool| has_told || is_answered.load(Relaxed) || Instant::now() >= until;
    bridges(ros2, is_over).ok()?.into_keys().find_map(|node| {
        let mut asker = Asker::<ListRoutes_Response>::open(ros2, &node, LIST_ROUTES).ok()?;
        let left = (until + ANSWER).saturating_duration_since(Instant::now());
        Some((node, of(route, asker.ask(Map::new(), left).ok()?.routes)?))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::middlewares::load_text;

    fn info(source: &str, destination: &str, state: &str) -> RouteInfo {
        let [source, destination, state, kind] =
            [source, destination, state, "topic"].map(str::to_owned);
        RouteInfo { source, destination, state, kind, ..RouteInfo::default() }
    }

    fn state(route: &str, all: &[RouteInfo]) -> Option<String> {
        let plan = load_text(&format!("routes:\n  - {{ {route} }}\n"), "x.yaml").unwrap().plan;
        of(&plan.routes[0], all.to_vec()).map(|one| format!("{} {}", one.source, one.state))
    }

    #[test]
    fn a_route_is_known_by_its_ends_and_a_pattern_by_the_first_that_is_not_well() {
        let all = [
            info("ros2:/a", "zeromq:/a", "active"),
            info("ros2:/b", "zeromq:/other", "degraded"),
            info("ros2:/c", "zeromq:/c", "waiting"),
        ];
        let told = |route: &str| state(route, &all);
        assert_eq!(told("from: 'ros2:/a', to: 'zeromq:/a'").as_deref(), Some("ros2:/a active"));
        assert_eq!(told("from: 'ros2:/a', to: 'zeromq:/x'"), None);
        let pattern = info("ros2:/(.*)", "zeromq:/$1", "active");
        let ill = info("ros2:/d", "zeromq:/d", "degraded");
        let many = [&all[..], std::slice::from_ref(&pattern)].concat();
        let route = "from: 'ros2:/(.*)', to: 'zeromq:/$1'";
        assert_eq!(state(route, &many).as_deref(), Some("ros2:/(.*) active"));
        let with_ill = [&all[..], &[pattern, ill]].concat();
        assert_eq!(state(route, &with_ill).as_deref(), Some("ros2:/d degraded"));
    }
}
