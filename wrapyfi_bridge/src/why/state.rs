//! Findings about a route that runs: what its bridge tells of it.

use wrapyfi_endpoint::{CauseCode, DropReason, EndpointAddress, Interaction, Role};
use wrapyfi_interfaces::wrapyfi_msgs::msg::RouteInfo;
use wrapyfi_ros2::graph::ServiceMapping;

use crate::middlewares::option_names;
use crate::on_graph::info::cause;

use super::drops::{count, drops, meaning, mends};
use super::running::interaction;
use super::words::{example, owner, provider};
use super::{Finding, Limited, StepResult, Way, WayEnd};

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
    way.interaction == Interaction::Topic
        && is_carried(way)
        && way.running.as_ref().is_some_and(|running| running.messages_per_s > 0.0)
}

/// True where a bridge knows a program in the role at the end, whatever the server of names says: its route runs there,
/// or takes from there.
pub(super) fn is_met(way: &Way, at: &EndpointAddress, role: Role) -> bool {
    let Some(running) = &way.running else { return false };
    if way.route.is_none() {
        let at = at.to_string();
        // What is sent there has a listener; what comes from there has the bridge.
        let is_end = leads_to(running, &at) || running.resolved_source == at;
        return receives_from(running, &at) || (!role.is_provider() && is_end && is_carried(way));
    }
    let is_found = role.is_provider() && running.has_source;
    is_found || matches!(running.state.as_str(), "active" | "degraded")
}

/// True for a route that waits for a program that listens at its destination, whatever its source has.
pub(super) fn lacks_listener(running: &RouteInfo) -> bool {
    match cause(running) {
        Some(CauseCode::NobodyListens) => true,
        // Those who are there do not fit; its source is not among them.
        Some(CauseCode::Type | CauseCode::OtherDefinition | CauseCode::Qos) => running.has_source,
        _ => false,
    }
}

/// Mapping of services that the servers speak, and that of the bridge, where its route waits for another server.
pub(super) fn other_mapping(running: &RouteInfo) -> Option<(ServiceMapping, ServiceMapping)> {
    let is_other = cause(running) == Some(CauseCode::ServiceMapping);
    let mappings = [ServiceMapping::Cyclone, ServiceMapping::FastDds];
    let theirs = mappings.into_iter().find(|it| is_other && it.rmw() == running.cause_theirs)?;
    Some((theirs, theirs.other()))
}

/// Port of another program to which a route would write, where its middleware has such an option.
pub(super) fn unopened(running: &RouteInfo) -> Option<String> {
    let RouteInfo { source, destination, cause_subject, .. } = running;
    let is_to = has_ports(destination) && !has_ports(source);
    let is_to = is_to && interaction(running) == Interaction::Topic;
    let is_unopened = is_to && cause(running) == Some(CauseCode::NotOpened);
    let port = is_unopened.then(|| cause_subject.parse::<EndpointAddress>().ok()).flatten()?;
    Some(port.name)
}

fn has_ports(address: &str) -> bool {
    let address = address.parse::<EndpointAddress>();
    address.is_ok_and(|it| option_names(&it.middleware).contains(&"port"))
}

/// True for a route that gets what an address has, messages or replies, or would, if it understood the servers there.
pub(super) fn receives_from(running: &RouteInfo, address: &str) -> bool {
    let RouteInfo { resolved_source, resolved_destination, .. } = running;
    let [from, _] = interaction(running).in_direction(resolved_source, resolved_destination);
    from == address && (running.has_source || other_mapping(running).is_some())
}

/// True for a route that brings to an address what it carries, or answers there, once it is active.
pub(super) fn leads_to(running: &RouteInfo, address: &str) -> bool {
    let RouteInfo { resolved_source, resolved_destination, .. } = running;
    let [_, to] = interaction(running).in_direction(resolved_source, resolved_destination);
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
    let now = match interaction(running) {
        Interaction::Topic => format!(", {rate:.1} a second now"),
        Interaction::Service | Interaction::Action => String::new(),
    };
    format!("a bridge runs the route: {received} in, {sent} out{now}")
}

/// True for a source whose destination another one has.
pub(super) fn has_rival(running: &RouteInfo) -> bool {
    cause(running) == Some(CauseCode::DestinationTaken)
}

/// A route that cannot work as configured, whatever is there.
pub(super) fn broken(way: &Way) -> StepResult {
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
    Err(Finding::new(CauseCode::State, what, "the configuration", remedy))
}

/// The programs that were refused.
pub(super) fn refused(way: &Way) -> Option<Finding> {
    let running = way.running.as_ref().filter(|it| !it.refused.is_empty())?;
    let times = count(running, DropReason::RefusedPeer);
    let what = format!("{} refused {times} times: {}", called(way, running), running.refused);
    let remedy = format!("where they may: {}", running.allow);
    Some(Finding::new(CauseCode::Refused, what, "the configuration, or those programs", remedy))
}

/// The programs that were refused in the role at an end where `nobody` else is, else that.
pub(super) fn refused_alone(way: &Way, role: Role, nobody: Finding) -> Finding {
    let of_role = |it: &&RouteInfo| it.refused_roles.iter().any(|one| *one == role.to_string());
    match way.running.as_ref().filter(of_role).and_then(|_| refused(way)) {
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
    use CauseCode as Code;
    let RouteInfo { source, destination, cause_subject: subject, .. } = running;
    let RouteInfo { cause_theirs: theirs, cause_ours: ours, .. } = running;
    if let (Some(end), port @ Some(_)) = (&way.destination, unopened(running)) {
        return (provider(end, Role::Listener), example(end, Role::Listener, port.as_deref()));
    }
    let more = match &way.route {
        Some(_) => String::new(),
        None => format!("; `wrapyfi why {:?} --node {}` looks there", running.key, way.node),
    };
    let (who, remedy) = match cause(running) {
        Some(Code::DestinationTaken) => {
            let interaction = interaction(running);
            let ([from, to], [from_key, to_key]) =
                (interaction.in_direction(source, destination), interaction.keys());
            let remedy = format!(
                "give it a route with another name: {{{from_key}: {from:?}, {to_key}: \"{to}_2\"}}"
            );
            ("the configuration of the bridge", remedy)
        }
        Some(Code::Carried) => {
            (&**subject, "nothing: where that one ends, this bridge goes on".to_owned())
        }
        Some(Code::Type) => {
            let remedy =
                format!("write `type: {theirs}` on the route, or have {subject} use {ours}");
            return (format!("{subject}, or the route"), remedy);
        }
        Some(Code::OtherDefinition) => {
            let remedy = format!("have {subject} and the bridge use the same definition of {ours}");
            return (format!("{subject}, or the route"), remedy);
        }
        Some(Code::RefusedByPeer) if !ours.is_empty() => {
            let remedy = match theirs.is_empty() {
                false => format!("write `type: {theirs}` on the route, or change it there"),
                true => "give both the same type: `type` on the route says its own".to_owned(),
            };
            ("that publisher, or the route", remedy)
        }
        Some(Code::NobodyListens) if !has_ports(destination) => {
            let remedy = format!("start it; to try: wrapyfi echo {destination}{more}");
            ("a program that subscribes", remedy)
        }
        None
        | Some(
            Code::NobodyListens
            | Code::NobodyPublishes
            | Code::NobodyOffers
            | Code::NobodyCalls
            | Code::NotReady
            | Code::NotOpened
            | Code::NoName
            | Code::Starting
            | Code::ServerAway,
        ) => ("whoever provides that", format!("start it: the route begins by itself{more}")),
        Some(_) => {
            let remedy =
                format!("mend what the reason names: the route begins by itself then{more}");
            ("the program or setting that the reason names", remedy)
        }
    };
    (who.to_owned(), remedy)
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
    // Calls that this bridge does not understand are the nearer cause.
    let is_mapping = most.is_some_and(|(reason, ..)| *reason == DropReason::ServiceMapping);
    if running.state == "waiting" && !is_mapping {
        let what = format!("{route} waits for {reason}");
        let lacks_server = |end: &&WayEnd| {
            cause(running) == Some(CauseCode::NobodyOffers)
                && running.cause_subject == end.address.to_string()
        };
        if let Some(end) = way.source.as_ref().filter(lacks_server) {
            let remedy = example(end, way.interaction.provider(), None);
            let who = "the program that offers it";
            return Err(Finding::new(CauseCode::NobodyOffers, what, who, remedy));
        }
        let (who, remedy) = awaited(way, running);
        return Err(Finding::new(CauseCode::State, what, who, remedy));
    }
    if is_degraded && cause(running) == Some(CauseCode::Unacknowledged) {
        let node = match running.cause_subject.as_str() {
            "" => "the program that subscribes",
            node => node,
        };
        let what = format!("{route} is degraded: {reason}");
        let remedy =
            format!("end {node} or start it again; the bridge goes on without it meanwhile");
        return Err(Finding::new(CauseCode::State, what, node, remedy));
    }
    let Some((most, _, meaning)) = most else {
        if !is_degraded {
            return Ok(None);
        }
        let what = format!("{route} is degraded: {reason}");
        let remedy = "remove what the reason names";
        return Err(Finding::new(
            CauseCode::State,
            what,
            "a program at an end of the route",
            remedy,
        ));
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
        DropReason::ServiceMapping => CauseCode::ServiceMapping,
        _ => CauseCode::Drops,
    };
    let remedy = match most {
        DropReason::SendFailed if way.interaction != Interaction::Topic => {
            "a server that answers requests: what the last reason names"
        }
        most => mends(*most),
    };
    Err(Finding::new(cause, what, who, remedy))
}

/// Messages that the bridge has counted, of a source to which no other program can listen.
pub(super) fn counted(way: &Way, source: &WayEnd) -> Passed {
    let running = way.running.as_ref();
    let Some(running) =
        running.filter(|it| source.heard == 0 && interaction(it) == Interaction::Topic)
    else {
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
    Err(Finding::new(CauseCode::Idle, what, who, "look at that program"))
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
    Err(Finding::new(CauseCode::RateLimit, what, "the route", remedy))
}

/// Route in words: of a pattern, the one that is meant.
fn called(way: &Way, running: &RouteInfo) -> String {
    match &way.route {
        Some(route) if route.name == running.key => "the route".to_owned(),
        Some(_) => format!("the route {}", running.key),
        None => format!("the route {} of {}", running.key, way.node),
    }
}
