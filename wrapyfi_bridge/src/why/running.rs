//! Status of a route, as a bridge that runs it tells it: the bridge that looks, or those on the graph of ROS 2.
//!
//! Those on the graph are heard on `~/status`, not asked by a service: services are understood in one mapping alone, and
//! who asks may have set another one.

use std::collections::BTreeMap;

use wrapyfi_data::types::{MessageType, Payload, RosType};
use wrapyfi_endpoint::{
    CauseCode, Context, EndpointAddress, History, Interaction, Listener, Middleware as _, Qos,
    QosPreset, Role, TopicSpec,
};
use wrapyfi_engine::Route;
use wrapyfi_interfaces::Message as _;
use wrapyfi_interfaces::wrapyfi_msgs::msg::{BridgeStatus, RouteInfo};
use wrapyfi_ros2::Ros2;
use wrapyfi_ros2::graph::ServiceMapping;

use super::look::LOOK;
use crate::on_graph::client::{mappings, node_of_status, only_foreign};
use crate::on_graph::info::cause;

/// Most bytes of a status that are read.
const MAX_BYTES: usize = 16 << 20;
/// Most bridges of one name that are heard.
const NAMESAKES: usize = 10;

/// Route among those that a bridge has.
pub(super) type Find<'f> = &'f (dyn Fn(Vec<RouteInfo>) -> Option<RouteInfo> + Sync);

/// Account of the bridges on the graph of ROS 2 about a route.
#[derive(Debug, Default)]
pub(super) struct BridgeReports {
    /// Node of the bridge that has it, and its status there.
    pub(super) running: Option<(String, RouteInfo)>,
    /// Nodes of the further bridges in which it is active, too.
    pub(super) also: Vec<String>,
    /// Bridges without it, where none has it; `None` where one of them has told nothing, or all may not be found.
    pub(super) others: Option<BTreeMap<String, BridgeStatus>>,
    /// Mapping of services of the bridges that have another than ours, by node.
    pub(super) foreign: BTreeMap<String, ServiceMapping>,
    /// Domain in which a bridge has it, and its node, where there is no bridge in the own.
    pub(super) other_domain: Option<(u32, String)>,
}

/// Hears the bridges on the graph until it `is_over`, which is told their number and whether one has the route.
pub(super) fn heard(
    ros2: &Ros2,
    find: Find<'_>,
    is_over: &dyn Fn(usize, bool) -> bool,
) -> BridgeReports {
    let (Ok(mut discovery), Ok(ros_type)) = (ros2.discover(), RosType::of::<BridgeStatus>()) else {
        return BridgeReports::default();
    };
    discovery.only(Box::new(|name| node_of_status(name).is_some()));
    let context = Context::default();
    let qos = Qos { history: History::KeepLast(NAMESAKES as u32), ..QosPreset::Latched.into() };
    let mut bridges: BTreeMap<String, (Box<dyn Listener>, Option<BridgeStatus>)> = BTreeMap::new();
    // Bridges of one name are told apart by their publishers.
    let mut having: BTreeMap<(String, Option<u64>), RouteInfo> = BTreeMap::new();
    let graph = ros2.graph().as_ref();
    let served = |node: &str| mappings(graph, &format!("{node}/change_state"), false);
    loop {
        let Ok(found) = discovery.endpoints() else { return BridgeReports::default() };
        for one in found {
            let is_status = one.role == Role::Publisher
                && one.type_name.as_deref() == Some(BridgeStatus::ROS_TYPE);
            let Some(node) = node_of_status(&one.name).filter(|_| is_status) else { continue };
            if !bridges.contains_key(node) {
                let spec =
                    TopicSpec { qos, ..TopicSpec::new(&one.name, MessageType::Ros(ros_type)) };
                let Ok(listener) = ros2.open_listener(&spec, &context) else { continue };
                bridges.insert(node.to_owned(), (listener, None));
            }
        }
        for (node, (listener, told)) in &mut bridges {
            while let Ok(Some(sample)) = listener.take() {
                let Payload::RosMessage(message) = &sample.payload else { continue };
                let Ok(status) = BridgeStatus::decode(&message.cdr, MAX_BYTES) else { continue };
                let bridge = (node.clone(), sample.origin.map(|origin| origin.publisher));
                _ = match find(status.routes.clone()) {
                    Some(route) => having.insert(bridge, route),
                    None => having.remove(&bridge),
                };
                *told = Some(status);
            }
        }
        // Who would have to activate it has to know how its services are mapped; so has who judges its route of services.
        let is_told = |((node, _), route): (&(String, _), &RouteInfo)| {
            (interaction(route) == Interaction::Topic && cause(route) != Some(CauseCode::Inactive))
                || !served(node).is_empty()
        };
        if !is_over(bridges.len(), having.iter().any(is_told)) {
            context.wake.wait(LOOK);
            continue;
        }
        let ours = graph.service_mapping();
        let foreign = bridges.keys().filter_map(|node| {
            let theirs = only_foreign(ours, &served(node))?;
            Some((node.clone(), theirs))
        });
        let foreign = foreign.collect();
        let (active, rest): (Vec<_>, Vec<_>) =
            having.into_iter().partition(|(_, route)| route.state == "active");
        // One that waits for another bridge tells less than that one.
        let (second, first): (Vec<_>, Vec<_>) =
            rest.into_iter().partition(|(_, route)| cause(route) == Some(CauseCode::Carried));
        let mut all =
            active.into_iter().chain(first).chain(second).map(|((node, _), route)| (node, route));
        let running = all.next();
        let first = running.as_ref().map(|(_, route)| route.clone());
        let is_same = |one: &RouteInfo| {
            let ends = |it: &RouteInfo| {
                (it.kind.clone(), it.resolved_source.clone(), it.resolved_destination.clone())
            };
            // One that waits for what the other has, or for that one, is no second.
            let is_as_well =
                |first: &RouteInfo| one.state == first.state && one.cause == first.cause;
            let is_open = !matches!(cause(one), Some(CauseCode::Carried | CauseCode::Inactive));
            let is_second = |first: &RouteInfo| is_as_well(first) && ends(first) == ends(one);
            is_open && one.state != "error" && first.as_ref().is_some_and(is_second)
        };
        let also = all.filter(|(_, route)| is_same(route)).map(|(node, _)| node);
        let others = bridges.into_iter().map(|(node, (_, status))| Some((node, status?)));
        let others = others.collect::<Option<_>>().filter(|_| running.is_none());
        return BridgeReports {
            also: also.collect(),
            others,
            running,
            foreign,
            other_domain: None,
        };
    }
}

/// Interaction of what a bridge runs, by its word.
pub(super) fn interaction(one: &RouteInfo) -> Interaction {
    one.kind.parse().unwrap_or_default()
}

/// True where a bridge runs something with the interaction of a route: topics and services may have the same ends.
pub(super) fn is_alike(route: &Route, one: &RouteInfo) -> bool {
    route.interaction() == interaction(one)
}

/// Ends of a route by the names that the bridge has for them: where it takes, and where it brings to.
pub(super) fn resolved(one: &RouteInfo) -> Option<[EndpointAddress; 2]> {
    let ends = [one.resolved_source.parse().ok()?, one.resolved_destination.parse().ok()?];
    let [source, destination] = ends;
    Some(interaction(one).in_direction(source, destination))
}

/// Status of a route among those of a bridge: the one between the same ends. Of a pattern that is well it is that of
/// the first of its routes that is not.
pub(super) fn of(route: &Route, all: Vec<RouteInfo>) -> Option<RouteInfo> {
    let ends = |one: &RouteInfo| {
        let (from, to) = (one.source.clone(), one.destination.clone());
        interaction(one).in_direction(from, to).into()
    };
    let (from, to) = (route.from.to_string(), route.to.to_string());
    let is_one_of = |one: &RouteInfo| {
        let (from, to) = ends(one);
        let source = from.parse::<EndpointAddress>().ok();
        let source = source.filter(|it| it.middleware == route.from.middleware);
        source.and_then(|it| route.target(&it.name)).is_some_and(|target| target.to_string() == to)
    };
    let is_ill = |one: &RouteInfo| matches!(one.state.as_str(), "error" | "degraded");
    let (mut own, mut ill) = (None, None);
    for one in all.into_iter().filter(|one| is_alike(route, one)) {
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

/// Limit of a pattern and number of the names that match it, where these are more.
pub(super) fn over(pattern: &RouteInfo) -> Option<(usize, usize)> {
    let is_over = cause(pattern) == Some(CauseCode::Limit);
    let limit: usize = pattern.cause_ours.parse().ok().filter(|_| is_over)?;
    Some((limit, limit + pattern.cause_theirs.parse::<usize>().ok()?))
}

#[cfg(test)]
mod tests {
    use wrapyfi_endpoint::Cause;

    use super::*;
    use crate::middlewares::load_text;
    use crate::on_graph::info;

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
    fn the_limit_of_a_pattern_is_told_with_the_names_that_match() {
        let of = |cause: &Cause| over(&info::caused(RouteInfo::default(), Some(cause)));
        assert_eq!(of(&Cause::Limit { at: "ros2:/*".to_owned(), limit: 1, more: 2 }), Some((1, 3)));
        assert_eq!(of(&Cause::NoName), None);
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
