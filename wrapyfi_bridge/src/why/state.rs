//! Findings about a route that runs: what its bridge tells of it.

use wrapyfi_endpoint::{DropReason, EndpointAddress, Peers, Role};
use wrapyfi_engine::{CARRIED, GOES_THERE};
use wrapyfi_interfaces::wrapyfi_msgs::msg::RouteInfo;
use wrapyfi_ros1::{OTHER_DEFINITION, REFUSES};
use wrapyfi_ros2::graph::ServiceMapping;
use wrapyfi_ros2::{ACKNOWLEDGES_NOTHING, SPEAKS_NOT};
use wrapyfi_yarp_endpoint::UNOPENED;

use super::drops::{count, drops, meaning, mends};
use super::words::{example, owner, provider};
use super::{Cause, End, Finding, Limited, Step, Way};

/// A step that may be in place.
pub(super) type Passed = Result<Option<String>, Finding>;

/// Number of messages that came, without the programs that were refused.
pub(super) fn came(running: &RouteInfo) -> u64 {
    running.received.saturating_sub(count(running, DropReason::RefusedPeer))
}

/// True where a bridge runs the route and messages of others have come in on it.
pub(super) fn hears_others(way: &Way) -> bool {
    way.running.as_ref().is_some_and(|it| came(it) > count(it, DropReason::OwnPublication))
}

/// True where a bridge runs the route and its messages pass, now or since both ends were there last: the state of one whose
/// publisher has left is another within a second.
pub(super) fn is_carried(way: &Way) -> bool {
    is_used(way) && way.running.as_ref().is_some_and(|running| running.state == "active")
}

/// True where messages of a topic pass now.
pub(super) fn flows(way: &Way) -> bool {
    !way.is_service
        && is_carried(way)
        && way.running.as_ref().is_some_and(|running| running.messages_per_s > 0.0)
}

/// True where a bridge knows somebody in the role at the end, whatever the server of names says: its route runs there,
/// or takes from there.
pub(super) fn is_met(way: &Way, at: &EndpointAddress, role: Role) -> bool {
    let Some(running) = &way.running else { return false };
    if way.route.is_none() {
        let at = at.to_string();
        // What is sent there has a listener; what comes from there has the bridge.
        let is_end = leads_to(running, &at) || running.resolved_source == at;
        return takes(running, &at) || (!is_provider(role) && is_end && is_carried(way));
    }
    let is_found = is_provider(role) && running.has_source;
    is_found || matches!(running.state.as_str(), "active" | "degraded")
}

/// True for the role of the end from which a route takes.
pub(super) fn is_provider(role: Role) -> bool {
    matches!(role, Role::Publisher | Role::Server)
}

/// True for a route that waits for somebody who listens at its destination, whatever its source has.
pub(super) fn lacks_listener(running: &RouteInfo) -> bool {
    /// Begins of such reasons, of each side and of a route whose source is closed meanwhile.
    const BEGINS: [&str; 4] =
        ["a subscriber of ", "a ROS 1 node that subscribes to ", "a reader of ", "a listener on "];
    BEGINS.iter().any(|begin| running.reason.starts_with(begin))
}

/// Mapping of services that the servers speak, and that of the bridge, where its route waits for another server.
pub(super) fn other_mapping(running: &RouteInfo) -> Option<(ServiceMapping, ServiceMapping)> {
    let (_, rmw) = running.reason.split_once(SPEAKS_NOT)?;
    let (cyclone, fast_dds) = (ServiceMapping::Cyclone, ServiceMapping::FastDds);
    [(cyclone, fast_dds), (fast_dds, cyclone)].into_iter().find(|(it, _)| rmw == it.rmw())
}

/// Input port of another program on YARP to which a route would write.
pub(super) fn unopened(running: &RouteInfo) -> Option<&str> {
    let RouteInfo { kind, source, destination, reason, .. } = running;
    let is_to = destination.starts_with("yarp:") && !source.starts_with("yarp:");
    reason.strip_prefix("port ")?.strip_suffix(UNOPENED).filter(|_| is_to && kind != "service")
}

/// True for a route that gets what an address has, messages or replies, or would, if it understood the servers there.
pub(super) fn takes(running: &RouteInfo, address: &str) -> bool {
    let is_service = running.kind == "service";
    let from = if is_service { &running.resolved_destination } else { &running.resolved_source };
    from == address && (running.has_source || other_mapping(running).is_some())
}

/// True for a route that brings to an address what it carries, or answers there, once it is active.
pub(super) fn leads_to(running: &RouteInfo, address: &str) -> bool {
    let is_service = running.kind == "service";
    let to = if is_service { &running.resolved_source } else { &running.resolved_destination };
    to == address
}

/// Route of a bridge that brings to a mere name what it carries, or answers there.
pub(super) fn brought<'w>(way: &'w Way, at: &EndpointAddress) -> Option<&'w RouteInfo> {
    let running = way.running.as_ref().filter(|running| running.state == "active")?;
    (way.route.is_none() && leads_to(running, &at.to_string())).then_some(running)
}

/// Route that a bridge runs, in words.
pub(super) fn runs(running: &RouteInfo) -> String {
    let (received, sent, rate) = (came(running), running.sent, running.messages_per_s);
    let is_service = running.kind == "service";
    let now = if is_service { String::new() } else { format!(", {rate:.1} a second now") };
    format!("a bridge runs the route: {received} in, {sent} out{now}")
}

/// True for a source whose destination another one has.
pub(super) fn has_rival(running: &RouteInfo) -> bool {
    running.reason.ends_with(GOES_THERE)
}

/// A route that cannot work as configured, whatever is there.
pub(super) fn broken(way: &Way) -> Step {
    if way.running.as_ref().is_some_and(has_rival) {
        return state(way).map(drop);
    }
    let Some(running) = way.running.as_ref().filter(|running| running.state == "error") else {
        return Ok(());
    };
    let what = format!("{} is in state error: {}", called(way, running), running.reason);
    let remedy = match &way.route {
        Some(_) => "change what the reason names; the bridge turns to the changed file".to_owned(),
        None => {
            format!("change what the reason names, in the file or the parameters of {}", way.node)
        }
    };
    Err(Finding::new(Cause::State, what, "the configuration", remedy))
}

/// The programs that were refused.
pub(super) fn refused(way: &Way) -> Option<Finding> {
    let running = way.running.as_ref().filter(|it| !it.refused.is_empty())?;
    let times = count(running, DropReason::RefusedPeer);
    let what = format!("{} refused {times} times: {}", called(way, running), running.refused);
    let remedy = format!("where they may: {}", running.allow);
    Some(Finding::new(Cause::Refused, what, "the configuration, or those programs", remedy))
}

/// The programs that were refused in the role at an end where `nobody` else is, else that.
pub(super) fn refused_alone(way: &Way, role: Role, nobody: Finding) -> Finding {
    let lists = match is_provider(role) {
        true => ["publish: [", Peers::FROM],
        false => ["subscribe: [", Peers::TO],
    };
    let refused = refused(way).filter(|it| lists.iter().any(|list| it.remedy.contains(list)));
    match refused {
        Some(it) => Finding { what: format!("{}, and {}", nobody.what, it.what), ..it },
        None => nobody,
    }
}

/// True where messages of a route reach its destination.
pub(super) fn is_used(way: &Way) -> bool {
    way.running.as_ref().is_some_and(|running| came(running) > 0 && running.sent > 0)
}

/// Program that a waiting route needs, and the remedy.
fn awaited(way: &Way, running: &RouteInfo) -> (String, String) {
    let reason = &running.reason;
    if let (Some(end), port @ Some(_)) = (&way.destination, unopened(running)) {
        return (provider(end, Role::Listener), example(end, Role::Listener, port));
    }
    if has_rival(running) {
        let RouteInfo { source, destination, .. } = running;
        let (from, to, [from_key, to_key]) = match running.kind == "service" {
            true => (destination, source, ["service", "as"]),
            false => (source, destination, ["from", "to"]),
        };
        let remedy = format!(
            "give it a route with another name: {{{from_key}: {from:?}, {to_key}: \"{to}_2\"}}"
        );
        return ("the configuration of the bridge".to_owned(), remedy);
    }
    if let Some((bridge, _)) = reason.split_once(CARRIED) {
        return (bridge.to_owned(), "nothing: where that one ends, this bridge goes on".to_owned());
    }
    let misfit = reason.split_once(" wants ").and_then(|(before, wanted)| {
        let (any, node) = before.rsplit_once(": ")?;
        Some((node, wanted, any.rsplit(' ').next()?))
    });
    if let Some((node, wanted, ours)) = misfit {
        let remedy = match wanted.strip_suffix(OTHER_DEFINITION) {
            Some(_) => format!("have {node} and the bridge use the same definition of {ours}"),
            None => format!("write `type: {wanted}` on the route, or have {node} use {ours}"),
        };
        return (format!("{node}, or the route"), remedy);
    }
    let between = |before, after| Some(reason.split_once(before)?.1.split_once(after)?.0);
    let theirs = between(" vs. [", "]").or_else(|| between(": it sends ", ","));
    if theirs.is_some() || reason.contains(REFUSES) {
        let remedy = match theirs {
            Some(theirs) => format!("write `type: {theirs}` on the route, or change it there"),
            None => "give both the same type: `type` on the route says its own".to_owned(),
        };
        return ("that publisher, or the route".to_owned(), remedy);
    }
    let more = match &way.route {
        Some(_) => String::new(),
        None => format!("; `wrapyfi why {:?} --node {}` looks there", running.key, way.node),
    };
    // A part behind the name tells what is wrong with who is there.
    if reason.contains(" (") || reason.contains(": ") || reason.starts_with("a definition of ") {
        let remedy = format!("mend what the reason names: the route begins by itself then{more}");
        return ("the program or setting that the reason names".to_owned(), remedy);
    }
    if lacks_listener(running) && !running.destination.starts_with("yarp:") {
        let remedy = format!("start it; to try: wrapyfi echo {}{more}", running.destination);
        return ("a program that subscribes".to_owned(), remedy);
    }
    ("whoever provides that".to_owned(), format!("start it: the route begins by itself{more}"))
}

/// State of a route in a bridge, and the messages that it drops.
pub(super) fn state(way: &Way) -> Passed {
    /// Share of messages from which on a route that calls itself active drops too many.
    const MOST: f64 = 0.9;
    let Some(running) = &way.running else { return Ok(None) };
    let (route, reason) = (called(way, running), &running.reason);
    let lost: Vec<_> = drops(running)
        .filter_map(|(reason, count)| Some((reason, count, meaning(reason)?)))
        .collect();
    let is_degraded = running.state == "degraded";
    let most = lost.iter().max_by_key(|(_, count, _)| *count);
    // Calls that nobody here understands are the nearer cause.
    let is_mapping = most.is_some_and(|(reason, ..)| *reason == DropReason::ServiceMapping);
    if running.state == "waiting" && !is_mapping {
        let what = format!("{route} waits for {reason}");
        let lacks_server = |end: &&End| *reason == format!("a server of {}", end.address);
        if let Some(end) = way.source.as_ref().filter(lacks_server) {
            let remedy = example(end, Role::Server, None);
            let who = "the program that offers it";
            return Err(Finding::new(Cause::NobodyOffers, what, who, remedy));
        }
        let (who, remedy) = awaited(way, running);
        return Err(Finding::new(Cause::State, what, who, remedy));
    }
    if is_degraded && let Some((reader, _)) = reason.split_once(ACKNOWLEDGES_NOTHING) {
        let node = reader.split(' ').next().filter(|node| node.starts_with('/'));
        let node = node.unwrap_or("the program that subscribes");
        let what = format!("{route} is degraded: {reason}");
        let remedy =
            format!("end {node} or start it again; the bridge goes on without it meanwhile");
        return Err(Finding::new(Cause::State, what, node, remedy));
    }
    let Some((most, _, meaning)) = most else {
        if !is_degraded {
            return Ok(None);
        }
        let what = format!("{route} is degraded: {reason}");
        let remedy = "remove what the reason names";
        return Err(Finding::new(Cause::State, what, "a program at an end of the route", remedy));
    };
    let count: u64 = lost.iter().map(|(_, count, _)| count).sum();
    let all: Vec<_> = lost.iter().map(|(reason, count, _)| format!("{count} {reason}")).collect();
    let came = came(running);
    // What is lost before the bridge has it is no part of what came.
    let share = match count <= came {
        true => format!("{count} of {came} that came"),
        false => format!("{count}, and {came} came"),
    };
    let what = format!(
        "messages of {route} are dropped: {share} ({}); mostly because {meaning}",
        all.join(", ")
    );
    if !is_degraded && (count as f64) < MOST * came as f64 {
        return Ok(Some(what));
    }
    let what = if reason.is_empty() { what } else { format!("{what}; the last: {reason}") };
    let who = "the route, or the program at its end";
    let cause = match most {
        DropReason::ServiceMapping => Cause::ServiceMapping,
        _ => Cause::Drops,
    };
    let remedy = match most {
        DropReason::SendFailed if way.is_service => {
            "a server that answers requests: what the last reason names"
        }
        most => mends(*most),
    };
    Err(Finding::new(cause, what, who, remedy))
}

/// Messages that the bridge has counted, of a source to which nobody else can listen.
pub(super) fn counted(way: &Way, source: &End) -> Passed {
    let running = way.running.as_ref();
    let Some(running) = running.filter(|it| source.heard == 0 && it.kind != "service") else {
        return Ok(None);
    };
    let address = &source.address;
    if running.messages_per_s > 0.0 || address.to_string() != running.resolved_source {
        return Ok(None);
    }
    // Its source may be closed meanwhile.
    if running.state == "waiting" {
        return state(way);
    }
    if came(running) > 0 {
        return Ok(Some(format!("nothing came on {address} in the last second")));
    }
    let what = format!(
        "everything is in place, and no message has come on {address} since the route {} began: the connection is open \
         and idle",
        running.key
    );
    let who = source.of(Role::Publisher).next().map_or_else(|| "its publisher".to_owned(), owner);
    Err(Finding::new(Cause::Idle, what, who, "look at that program"))
}

/// Limit of the rate, where it leaves out most of the messages.
pub(super) fn rate(way: &Way) -> Passed {
    /// Share of messages from which on a limit is taken for a mistake.
    const MOST: f64 = 0.9;
    let Some(route) = &way.route else { return Ok(None) };
    let Some(Limited { max_rate_hz, came_hz, dropped }) = route.limited else { return Ok(None) };
    let came = came_hz.map(|hz| format!(", and {hz:.1} messages a second come"));
    let what = format!(
        "max_rate_hz is {max_rate_hz}{}: {:.0} % of all were left out",
        came.unwrap_or_default(),
        100.0 * dropped
    );
    if dropped < MOST {
        return Ok(Some(what));
    }
    let remedy = match came_hz {
        Some(hz) => format!("write `max_rate_hz: {:.0}` or more", hz.max(max_rate_hz).ceil()),
        None => format!("write more than `max_rate_hz: {max_rate_hz}`"),
    };
    let remedy = format!("{remedy} on the route in {}, or leave it out", route.file);
    Err(Finding::new(Cause::RateLimit, what, "the route", remedy))
}

/// Route in words: of a pattern, the one that is meant.
fn called(way: &Way, running: &RouteInfo) -> String {
    match &way.route {
        Some(route) if route.name == running.key => "the route".to_owned(),
        Some(_) => format!("the route {}", running.key),
        None => format!("the route {} of {}", running.key, way.node),
    }
}
