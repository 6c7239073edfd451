//! Status of a route, as a bridge that runs it tells it: the bridge that looks, or those on the graph of ROS 2.
//!
//! Those on the graph are heard on `~/status`, not asked by a service: services are understood in one mapping alone, and
//! who asks may have set another one.

use std::collections::BTreeMap;

use wrapyfi_core::endpoint::{
    Context, History, Listener, Middleware as _, Qos, QosPreset, Role, TopicSpec,
};
use wrapyfi_core::engine::{Kind, Route};
use wrapyfi_core::middleware::ros2::Ros2;
use wrapyfi_core::types::{MessageType, Payload};
use wrapyfi_interfaces::Message as _;
use wrapyfi_interfaces::wrapyfi_msgs::msg::{BridgeStatus, RouteInfo};

use super::look::LOOK;
use crate::on_graph::client::ros_type;

/// End of the name of the topic that has the status of a bridge; its node stands before it.
const STATUS: &str = "/status";
/// Most bytes of a status that are read.
const MAX_BYTES: usize = 16 << 20;
/// Most bridges of one name that are heard.
const NAMESAKES: usize = 10;

/// Route among those that a bridge has.
pub(super) type Find<'f> = &'f (dyn Fn(Vec<RouteInfo>) -> Option<RouteInfo> + Sync);

/// Account of the bridges on the graph of ROS 2 about a route.
#[derive(Debug, Default)]
pub(super) struct Heard {
    /// Node of the bridge that has it, and its status there.
    pub(super) running: Option<(String, RouteInfo)>,
    /// Bridges without it, each with its state; `None` where one of them has told nothing, or all may not be found.
    pub(super) others: Option<BTreeMap<String, String>>,
}

/// Hears the bridges on the graph until one has the route, or it `is_over`.
pub(super) fn heard(ros2: &Ros2, find: Find<'_>, is_over: &dyn Fn() -> bool) -> Heard {
    let (Ok(mut discovery), Ok(ros_type)) = (ros2.discover(), ros_type::<BridgeStatus>()) else {
        return Heard::default();
    };
    discovery.only(Box::new(|name| name.ends_with(STATUS)));
    let context = Context::default();
    let qos = Qos { history: History::KeepLast(NAMESAKES as u32), ..QosPreset::Latched.into() };
    let mut bridges: BTreeMap<String, (Box<dyn Listener>, Option<String>)> = BTreeMap::new();
    loop {
        let Ok(found) = discovery.endpoints() else { return Heard::default() };
        for one in found {
            let is_status = one.role == Role::Publisher
                && one.type_name.as_deref() == Some(BridgeStatus::ROS_TYPE);
            let Some(node) = one.name.strip_suffix(STATUS).filter(|_| is_status) else { continue };
            if !bridges.contains_key(node) {
                let spec =
                    TopicSpec { qos, ..TopicSpec::new(&one.name, MessageType::Ros(ros_type)) };
                let Ok(listener) = ros2.open_listener(&spec, &context) else { continue };
                bridges.insert(node.to_owned(), (listener, None));
            }
        }
        for (node, (listener, state)) in &mut bridges {
            while let Ok(Some(sample)) = listener.take() {
                let Payload::RosMessage(message) = &sample.payload else { continue };
                let Ok(status) = BridgeStatus::decode(&message.cdr, MAX_BYTES) else { continue };
                *state = Some(status.state);
                if let Some(route) = find(status.routes) {
                    return Heard { running: Some((node.clone(), route)), others: None };
                }
            }
        }
        if is_over() {
            let told = bridges.into_iter().map(|(node, (_, state))| Some((node, state?)));
            return Heard { running: None, others: told.collect() };
        }
        context.wake.wait(LOOK);
    }
}

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
