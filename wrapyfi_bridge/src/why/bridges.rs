//! Findings about the bridges on the graph: one is not activated, none has the route, several have it.

use std::collections::BTreeMap;

use wrapyfi_endpoint::pattern::{Inverse, NamePattern, is_pattern, ros_name};
use wrapyfi_endpoint::{CauseCode, EndpointAddress, Interaction, Role};
use wrapyfi_interfaces::wrapyfi_msgs::msg::{BridgeStatus, RouteInfo};
use wrapyfi_ros2::graph::ServiceMapping;

use super::running::interaction;
use super::server_check::{ConnectOutcome, ServerCheck};
use super::state::{Passed, has_rival, leads_to};
use super::{Finding, OTHER_NODE, RouteFacts, StepResult, Way, WayEnd, same_node};
use crate::lifecycle::State;
use crate::middlewares::conventions;
use crate::node::GRAPH;
use crate::on_graph::info::cause;

/// Words for a route where no bridge can be heard.
const MAY_RUN: &str = "the route may run: no bridge tells its state (`--node NODE` asks one)";

/// A bridge that is not activated, whatever is there.
pub(super) fn inactive(way: &Way) -> Option<Finding> {
    let Way { running, others, node, foreign, .. } = way;
    let state = match running {
        Some(running) => (cause(running) == Some(CauseCode::Inactive)).then_some(State::Inactive),
        // Before it is configured, it has neither routes nor a broker.
        None => is_unconfigured(others.as_ref()?.get(node)?).then_some(State::Unconfigured),
    };
    Some(not_active(state?, node, foreign.get(node).copied()))
}

fn is_unconfigured(status: &BridgeStatus) -> bool {
    status.state == State::Unconfigured.label()
}

/// The first of the bridges that is not configured, which has no routes.
pub(super) fn unconfigured(others: &BTreeMap<String, BridgeStatus>) -> Option<Finding> {
    let (node, _) = others.iter().find(|(_, status)| is_unconfigured(status))?;
    Some(not_active(State::Unconfigured, node, None))
}

/// The finding that a pattern makes no route of a mere name which a program has.
pub(super) fn matched_without_route(way: &Way, end: &WayEnd) -> Option<Finding> {
    let (node, pattern) = way.matched_without_route.as_ref()?;
    let address = &end.address;
    let what =
        format!("the pattern {pattern} of {node} matches {address}, and makes no route of it");
    let remedy = format!("`wrapyfi why {address} --node {node}` tells the reason");
    Some(Finding::new(CauseCode::LeftOut, what, "that bridge", remedy))
}

/// The finding that no program has a name at the destination of a bridge's pattern, with the source that is to be
/// looked at.
pub(super) fn brought_by_pattern(way: &Way, nobody: Finding) -> Finding {
    let Some((node, pattern, source)) = &way.brought_by_pattern else { return nobody };
    let what = format!("{}, and the pattern {pattern} of {node} makes no route to it", nobody.what);
    let remedy =
        format!("`wrapyfi why {source} --node {node}` tells the reason; {}", nobody.remedy);
    Finding { what, remedy, ..nobody }
}

/// Bridge and its pattern that would bring to a name, and the source that it would take.
pub(super) fn pattern_to(
    address: &EndpointAddress,
    all: &BTreeMap<String, BridgeStatus>,
) -> Option<(String, String, EndpointAddress)> {
    let source = |one: &RouteInfo| {
        let [from, to] = interaction(one).in_direction(&one.source, &one.destination);
        let (to, from) =
            (to.parse::<EndpointAddress>().ok()?, from.parse::<EndpointAddress>().ok()?);
        let is_meant = to.middleware == address.middleware && is_pattern(&from.name);
        let pattern = is_meant.then(|| NamePattern::new(&from.name).ok())??;
        let name = Inverse::new(&pattern, &to.name)?.source(&address.name)?;
        // ROS 2 has such a name with what stands there for a colon and the like.
        let name = if from.middleware == GRAPH { ros_name(&name) } else { name };
        Some(EndpointAddress { name, ..from })
    };
    all.iter().find_map(|(node, status)| {
        let mut routes = status.routes.iter();
        let (pattern, from) = routes.find_map(|one| Some((one.key.clone(), source(one)?)))?;
        Some((node.clone(), pattern, from))
    })
}

/// The finding that the bridge is registered at another server than the one that a variable of this shell names, which
/// would have the subscription or the publication of its active route. Not while messages pass: a master that was
/// restarted knows no node either.
pub(super) fn other_master(way: &Way, end: &WayEnd) -> StepResult {
    let is_own = way.route.as_ref().is_some_and(|route| route.is_own);
    let server = conventions(&end.address.middleware).name_service;
    let variable = server.and_then(|server| server.server_variable);
    let Some(variable) = variable.filter(|_| !is_own && end.is_open()) else { return Ok(()) };
    let running = way.running.as_ref().filter(|it| it.state == "active");
    let running = running.filter(|it| interaction(it) == Interaction::Topic);
    let running = running.filter(|it| it.messages_per_s <= 0.0);
    let Some(running) = running else { return Ok(()) };
    let address = end.address.to_string();
    let (role, has) = if running.resolved_source == address {
        (Role::Listener, "subscription")
    } else if running.resolved_destination == address {
        (Role::Publisher, "publication")
    } else {
        return Ok(());
    };
    if end.of(role).next().is_some() {
        return Ok(());
    }
    let Way { node, .. } = way;
    let master = end.servers.first().map(ServerCheck::words).unwrap_or_default();
    let what = format!(
        "the route {} of {node} is active, and the {master} of this shell has no {has} of {address}: that bridge has another \
         {variable}",
        running.key
    );
    let remedy = format!(
        "set {variable} in this shell as where {node} starts, or the other way round; the log of {node} names its master"
    );
    Err(Finding::new(
        CauseCode::OtherMaster,
        what,
        "this shell, or whoever starts the bridge",
        remedy,
    ))
}

/// End from which a route takes, as it is written.
fn source(one: &RouteInfo) -> &str {
    let [from, _] = interaction(one).in_direction(&one.source, &one.destination);
    from
}

/// Bridge and its pattern that matches a name, where none has a route of it.
pub(super) fn pattern_of(
    address: &EndpointAddress,
    all: &BTreeMap<String, BridgeStatus>,
) -> Option<(String, String)> {
    let matches = |source: &str| {
        let source = source.parse::<EndpointAddress>().ok();
        let source =
            source.filter(|it| it.middleware == address.middleware && is_pattern(&it.name));
        source
            .and_then(|it| NamePattern::new(&it.name).ok())
            .is_some_and(|it| it.matches(&address.name))
    };
    all.iter().find_map(|(node, status)| {
        let pattern = status.routes.iter().find(|one| matches(source(one)))?;
        Some((node.clone(), pattern.key.clone()))
    })
}

/// Sources that would go to an address, and do not because another one does, in words.
pub(super) fn rivals(all: &[RouteInfo], address: &str) -> Vec<String> {
    let waits = |one: &&RouteInfo| has_rival(one) && leads_to(one, address);
    let words = |one: &RouteInfo| format!("{} waits for {}", source(one), one.reason);
    all.iter().filter(waits).map(words).collect()
}

/// Finding about any way through a bridge whose routes are closed. `foreign` is the mapping of its services, where who asks
/// has another.
pub(crate) fn not_active(state: State, node: &str, foreign: Option<ServiceMapping>) -> Finding {
    let asker = foreign.map(|it| format!("RMW_IMPLEMENTATION={} ", it.rmw())).unwrap_or_default();
    let what = format!("the bridge {node} is {}: its routes are closed", state.label());
    let set = |step: &str| format!("{asker}ros2 lifecycle set {node} {step}");
    let remedy = match state {
        State::Inactive => set("activate"),
        _ => format!("{} && {}", set("configure"), set("activate")),
    };
    Finding::new(CauseCode::State, what, "whoever manages the node", remedy)
}

/// The finding that the bridge of the route is in another domain of ROS 2.
pub(super) fn elsewhere(way: &Way) -> Option<Finding> {
    if way.running.is_some() || way.route.is_none() {
        return None;
    }
    let Some((domain, bridge)) = &way.other_domain else {
        return way.stopped.clone().filter(|it| it.cause == CauseCode::OtherDomain);
    };
    let mut graphs = way.source.iter().chain(&way.destination).filter_map(|end| end.graph.as_ref());
    let own = graphs.next().map_or(String::new(), |it| format!(" (domain {})", it.domain_id));
    let what =
        format!("no bridge runs the route here{own}: {bridge} does in domain {domain} of ROS 2");
    let remedy = format!(
        "export ROS_DOMAIN_ID={domain} in this shell, where that is the robot's; else end {bridge}, and start it in the \
         domain of its peers"
    );
    let who = "this shell, or whoever starts the bridge";
    Some(Finding::new(CauseCode::OtherDomain, what, who, remedy))
}

/// The finding that no bridge runs the route; else what is known instead of that. A pattern has no destination.
pub(super) fn lacking(way: &Way, source: &WayEnd, destination: Option<&WayEnd>) -> Passed {
    let Way { running: None, others, route: Some(route), .. } = way else { return Ok(None) };
    if let Some(stopped) = &way.stopped {
        return Err(stopped.clone());
    }
    if let Some((node, entry)) = &route.taken_from {
        let request = serde_json::json!({ "route": entry });
        let remedy = format!("wrapyfi call ros2:{node}/add_route --value '{request}'");
        let what = format!(
            "no bridge runs the route: it was taken out of {node}, which runs what else {} has",
            route.file
        );
        return Err(Finding::new(CauseCode::NoBridge, what, "whoever took it out", remedy));
    }
    let remedy = format!("wrapyfi bridge --config {}", route.file);
    if let Some(others) = others {
        let names = others.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
        let mut ends = std::iter::once(source).chain(destination);
        let graph = ends.find_map(|end| end.graph.as_ref());
        let domain = graph.map_or(String::new(), |it| format!(" (domain {})", it.domain_id));
        let what = match names.is_empty() {
            true => format!("no bridge runs the route: none is on the graph of ROS 2{domain}"),
            false => format!("no bridge runs the route: {names}{domain} has others"),
        };
        // One that is to be configured has no routes yet.
        let begins = others.iter().find(|(_, status)| is_unconfigured(status));
        let begins = begins.map(|(node, _)| {
            let mapping = way.foreign.get(node).copied();
            format!("; or {}", not_active(State::Unconfigured, node, mapping).remedy)
        });
        let remedy = remedy + &begins.unwrap_or_default();
        return Err(Finding::new(CauseCode::NoBridge, what, "a bridge", remedy));
    }
    let Some(destination) = destination else { return Ok(Some(MAY_RUN.to_owned())) };
    let (at_destination, at_source) = (way.interaction.provider(), way.interaction.taker());
    let tells = |end: &WayEnd| conventions(&end.address.middleware).shows_publishers;
    let seen = source.of(at_source).next().is_some()
        || destination.of(at_destination).next().is_some()
        || !destination.servers.iter().all(|check| check.answer == ConnectOutcome::Open)
        || (!tells(source) && !tells(destination));
    if seen {
        return Ok(Some(MAY_RUN.to_owned()));
    }
    let what = format!(
        "no bridge runs the route: nobody listens to {} for it, and nobody has {} at the other end",
        source.address, destination.address
    );
    Err(Finding::new(CauseCode::NoBridge, what, "a bridge", remedy))
}

/// Other bridges that run the route, or whose node has the same name.
pub(super) fn several(way: &Way, ends: &[&WayEnd]) -> StepResult {
    let Way { node, also, route, .. } = way;
    let who = "whoever starts the bridges";
    if !also.is_empty() {
        let count = also.len() + 1;
        let names = [std::slice::from_ref(node), also].concat().join(", ");
        let each = match way.interaction {
            Interaction::Topic => "each message comes",
            Interaction::Service | Interaction::Action => "a call may be made",
        };
        let key = way.running.as_ref().filter(|_| route.is_none()).map(|it| format!(" {}", it.key));
        let key = key.unwrap_or_default();
        let what = format!("{count} bridges run the route{key}, {names}: {each} {count} times");
        let remedy = "end all of them but one, or take the route out of their files";
        return Err(Finding::new(CauseCode::SeveralBridges, what, who, remedy));
    }
    let Some(RouteFacts { is_own, .. }) = route else { return Ok(()) };
    // Each bridge publishes its status once; one that looks does not see its own.
    let status = format!("{node}/status");
    let is_status = |end: &&WayEnd| end.address.middleware == GRAPH;
    let named = |end: &WayEnd| {
        let of_name = end.found.iter().filter(|one| one.name == status);
        of_name.filter(|one| one.role == Role::Publisher).count()
    };
    let bridges = ends.iter().copied().filter(is_status).map(named).max().unwrap_or(0);
    if bridges <= usize::from(!is_own) {
        return Ok(());
    }
    Err(Finding::new(CauseCode::SameNode, same_node(node), who, OTHER_NODE))
}
