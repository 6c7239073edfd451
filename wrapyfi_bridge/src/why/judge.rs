//! Walk along a way: what is in place, and the first thing that is missing. Pure.
//!
//! ```text
//!   route: definition, pattern ─▶ source: server, somebody there, address, type, mapping, quality of service
//!       ─▶ route: heard, run by a bridge ─▶ destination: the same ─▶ messages come
//! ```

use wrapyfi_core::endpoint::{AnnouncedQos, Discovered, DropReason, Role, mismatches};
use wrapyfi_core::engine::{LeftOut, TO_BE_ACTIVATED};
use wrapyfi_core::middleware::ros2::remedy;
use wrapyfi_interfaces::wrapyfi_msgs::msg::RouteInfo;

use crate::lifecycle::State;
use crate::on_graph::not_active;

use super::door::{Answer, name as server_name};
use super::drops::{drops, is_harmless, meaning, mends};
use super::names::nearest;
use super::reach::{opened, reachable};
use super::words::{between, example, is_same_type, nobody, owner, people, provider, types_differ};
use super::{
    Cause, Elsewhere, End, Finding, Graph, Limited, Registered, RouteFacts, Step, Verdict, Way,
};

/// Steps of a walk: what is in place, until something is not.
struct Walk<'w> {
    way: &'w Way,
    passed: Vec<String>,
}

/// Walks along the way.
#[must_use]
pub fn judge(way: &Way) -> Verdict {
    let mut walk = Walk { way, passed: way.known.clone() };
    let finding = inactive(way).or_else(|| walk.walk().err());
    Verdict { way: way.title.clone(), passed: walk.passed, finding }
}

/// True where a bridge runs the route and messages of others have come in on it.
fn way_received(way: &Way) -> bool {
    way.running.as_ref().is_some_and(|running| {
        let own = drops(running).find(|(reason, _)| *reason == DropReason::OwnPublication);
        running.received > own.map_or(0, |(_, count)| count)
    })
}

/// True for a publisher that the bridge with the ROS 2 node `own` may be itself. Only ROS names the nodes of
/// publishers; a node of the bridge on ROS 1 is `wrapyfi_` and a number.
fn may_be_bridge(one: &Discovered, middleware: &str, own: &str) -> bool {
    match (&one.node, middleware) {
        (Some(node), "ros2") => node == own,
        (Some(node), "ros") => {
            node.rsplit('/').next().is_some_and(|last| last.starts_with("wrapyfi_"))
        }
        _ => true,
    }
}

impl Walk<'_> {
    fn walk(&mut self) -> Step {
        let way = self.way;
        if let Some(route) = &way.route {
            of_file(route)?;
        }
        self.broken()?;
        self.refused()?;
        let Some(source) = &way.source else { return Ok(()) };
        let (provider, taker) = match way.is_service {
            false => (Role::Publisher, Role::Listener),
            true => (Role::Server, Role::Client),
        };
        self.side(source)?;
        self.somebody(source, provider)?;
        self.reached(source, provider)?;
        self.types(source, provider)?;
        self.mapping(source)?;
        self.definition(source)?;
        self.quality(source, provider)?;
        match &way.destination {
            None if source.names.is_some() => self.state()?,
            None if way.without_route.is_some() => {
                let file = way.without_route.as_deref().unwrap_or_default();
                let address = &source.address;
                return Err(Finding::new(
                    Cause::NoRoute,
                    format!("no route of {file} begins or ends at {address}"),
                    "the file of the routes",
                    format!("write one: {{from: \"{address}\", to: …}}; or correct the name"),
                ));
            }
            None => {
                self.among_themselves(source, provider, taker)?;
                if !way.is_service {
                    self.somebody(source, taker)?;
                    self.messages(source)?;
                }
            }
            Some(destination) => {
                self.bridge(source, destination)?;
                self.side(destination)?;
                if !way.is_service {
                    self.somebody(destination, taker)?;
                    self.reached(destination, taker)?;
                    self.types(destination, taker)?;
                    self.quality(destination, taker)?;
                    self.state()?;
                    self.messages(source)?;
                    self.rate()?;
                } else {
                    self.state()?;
                }
                self.namesakes([source, destination])?;
            }
        }
        Ok(())
    }

    fn pass(&mut self, what: impl Into<String>) {
        let what = what.into();
        if !self.passed.contains(&what) {
            self.passed.push(what);
        }
    }

    /// The servers of a side, and the side itself.
    fn side(&mut self, end: &End) -> Step {
        for knock in &end.doors {
            opened(knock, &end.address, self.way.route.as_ref())?;
            self.pass(format!("{} answers", knock.words()));
        }
        if let Some(graph) = &end.graph {
            let Graph { domain_id, carried_by, .. } = graph;
            self.pass(format!("ROS 2 in domain {domain_id}, on {carried_by}"));
        }
        let Some(away) = &end.away else { return Ok(()) };
        let middleware = &end.address.middleware;
        let remedy = match end.doors.first() {
            Some(knock) => format!(
                "look what runs on port {} of {}; it has to be a {}",
                knock.door.port,
                knock.door.host,
                server_name(knock.door.server)
            ),
            None => "see the reason; `wrapyfi list` shows the same".to_owned(),
        };
        let who = format!("the settings of {middleware}, or its server");
        Err(Finding::new(
            Cause::Middleware,
            format!("{middleware} does not work: {away}"),
            who,
            remedy,
        ))
    }

    /// Somebody in a role at an end.
    fn somebody(&mut self, end: &End, role: Role) -> Step {
        let address = &end.address;
        match end.names {
            None => {}
            Some(0) => {
                let what = format!("no name matches {address}");
                let who = provider(end, role);
                let remedy = format!(
                    "start it, or change the pattern; `wrapyfi list {}` shows what there is",
                    address.middleware
                );
                return Err(Finding::new(cause_of_nobody(role), what, who, remedy));
            }
            Some(names) => {
                self.pass(format!("{names} names match {address}"));
                return Ok(());
            }
        }
        let there: Vec<&Discovered> = end.of(role).collect();
        let nobody = nobody(end, role);
        // Where it publishes itself, a bridge is one of them, and hears the others only.
        let unheard = self.way.route.as_ref().and_then(|route| route.unheard.as_ref());
        let has_received = way_received(self.way);
        let unheard = unheard.filter(|unheard| {
            role == Role::Publisher
                && !has_received
                && there.iter().map(|one| one.count.max(1)).sum::<u64>() <= 1
                && there.iter().all(|one| may_be_bridge(one, &address.middleware, &unheard.node))
        });
        if let Some(unheard) = unheard {
            let (cause, what) = match unheard.circle.is_empty() {
                true => (
                    Cause::OwnPublication,
                    format!("{nobody} but this bridge, which ignores its own publications"),
                ),
                false => (
                    Cause::Cycle,
                    format!(
                        "the routes of the file make a circle: {}",
                        unheard.circle.join(" -> ")
                    ),
                ),
            };
            let who = "a program that is no route of this bridge";
            return Err(Finding::new(cause, what, who, unheard.text.clone()));
        }
        if !there.is_empty() {
            self.pass(format!("{address} has {}", people(&there, role)));
            return Ok(());
        }
        // Services of ZeroMQ have no names: whoever answers at the broker is one.
        if self.way.is_service && address.middleware == "zeromq" {
            return Ok(());
        }
        if let Some(found) = same_name_differently(end, role) {
            return Err(found);
        }
        if let Some(Elsewhere { place, remedy, endpoint }) = end.elsewhere.first() {
            let cause = match place.starts_with("domain") {
                true => Cause::OtherDomain,
                false => Cause::DiscoveryRange,
            };
            let here = end
                .graph
                .as_ref()
                .map_or(String::new(), |graph| format!(" (domain {})", graph.domain_id));
            let what = format!(
                "{nobody} here{here}; in {place} there is {}",
                people(&[endpoint], endpoint.role)
            );
            return Err(Finding::new(cause, what, owner(endpoint), remedy.clone()));
        }
        if let Some(Graph { range: range @ ("OFF" | "LOCALHOST"), range_setting, .. }) = &end.graph
        {
            let sees = if *range == "OFF" { "nobody but itself" } else { "this machine only" };
            let what = format!("{nobody}, and this program sees {sees} ({range_setting})");
            let who = format!("{}, or one on another machine", provider(end, role));
            let remedy = format!(
                "{}; or export ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET at both ends",
                example(end, role)
            );
            // A program on this machine would have been seen.
            let cause = match *range {
                "OFF" => Cause::DiscoveryRange,
                _ => cause_of_nobody(role),
            };
            return Err(Finding::new(cause, what, who, remedy));
        }
        Err(Finding::new(cause_of_nobody(role), nobody, provider(end, role), example(end, role)))
    }

    /// Addresses of those who are there.
    fn reached(&mut self, end: &End, role: Role) -> Step {
        let registered: Vec<_> = end.registered.iter().filter(|one| one.role == role).collect();
        for one in &registered {
            reachable(end, one)?;
        }
        if let Some(Registered { host, port, .. }) = registered.first() {
            self.pass(format!("{host}:{port} answers"));
        }
        Ok(())
    }

    /// Types of those who are there.
    fn types(&mut self, end: &End, role: Role) -> Step {
        let Some(wanted) = &end.type_name else { return Ok(()) };
        let told: Vec<&Discovered> = end.of(role).filter(|one| one.type_name.is_some()).collect();
        let Some(first) = told.first() else { return Ok(()) };
        let same = |one: &&Discovered| {
            one.type_name.as_deref().is_none_or(|theirs| is_same_type(theirs, wanted))
        };
        if told.iter().any(same) {
            self.pass(format!("its type is {wanted}"));
            return Ok(());
        }
        let theirs = first.type_name.as_deref().unwrap_or_default();
        let verb = if role == Role::Listener { "wants" } else { "has" };
        let what = format!(
            "{} on {} {verb} type {theirs}, the route has {wanted}",
            owner(first),
            end.address
        );
        let file =
            self.way.route.as_ref().map_or(String::new(), |route| format!(" in {}", route.file));
        let remedy = match end.learned {
            Some(_) => {
                format!("make it {wanted} there: that is what the source of the route sends")
            }
            None => format!("write `type: {theirs}` on the route{file}, or make it {wanted} there"),
        };
        Err(Finding::new(Cause::Type, what, "the route, or that program", remedy))
    }

    /// Mapping of services to DDS.
    fn mapping(&mut self, end: &End) -> Step {
        let Some((theirs, ours)) = end.foreign.filter(|(theirs, ours)| theirs != ours) else {
            return Ok(());
        };
        let server = end.of(Role::Server).next();
        let what = format!(
            "{} speaks {}, and services are mapped in the way of {} here: requests of one are not \
             understood by the other",
            server.map_or_else(|| format!("the server of {}", end.address), owner),
            theirs.rmw(),
            ours.rmw()
        );
        let remedy = format!(
            "export RMW_IMPLEMENTATION={} where the bridge starts (or {} where the server does)",
            theirs.rmw(),
            ours.rmw()
        );
        Err(Finding::new(Cause::ServiceMapping, what, "either end", remedy))
    }

    /// Definition of a type that the source announces.
    fn definition(&mut self, end: &End) -> Step {
        let Some((type_name, reason)) = &end.undefined else { return Ok(()) };
        Err(undefined(type_name, reason))
    }

    /// Quality of service of those who are there, against that of the route.
    fn quality(&mut self, end: &End, role: Role) -> Step {
        let Some(own) = &end.qos else { return Ok(()) };
        let awaits_publisher = role == Role::Publisher;
        let told: Vec<_> = end.of(role).filter_map(|one| Some((one, one.qos?))).collect();
        let unmet = |theirs: &AnnouncedQos| match awaits_publisher {
            true => mismatches(theirs, &AnnouncedQos::from(*own)),
            false => mismatches(&AnnouncedQos::from(*own), theirs),
        };
        if told.is_empty() || told.iter().any(|(_, qos)| unmet(qos).is_empty()) {
            if !told.is_empty() {
                self.pass("its quality of service fits");
            }
            return Ok(());
        }
        let Some((one, theirs)) = told.first() else { return Ok(()) };
        let Some(policy) = unmet(theirs).first().copied() else { return Ok(()) };
        let (verb, verb_ours) =
            if awaits_publisher { ("offers", "asks for") } else { ("asks for", "offers") };
        let what = format!(
            "{} of {} {verb} {}, the route {verb_ours} {}",
            owner(one),
            end.address,
            policy.value(theirs),
            policy.value(&AnnouncedQos::from(*own))
        );
        let remedy =
            format!("leave out `qos` on the route, or {}", remedy(policy, awaits_publisher, own));
        Err(Finding::new(Cause::Qos, what, "the route, or that program", remedy))
    }

    /// Types and quality of service of the programs at one endpoint.
    fn among_themselves(&mut self, end: &End, provider: Role, taker: Role) -> Step {
        let (providers, takers): (Vec<_>, Vec<_>) =
            (end.of(provider).collect(), end.of(taker).collect());
        let pairs =
            || providers.iter().flat_map(|one| takers.iter().map(move |other| (*one, *other)));
        if pairs().next().is_none() {
            return Ok(());
        }
        let Some(first) = pairs().find(|(one, other)| !types_differ(one, other)) else {
            let Some((one, other)) = pairs().next() else { return Ok(()) };
            let name = |one: &Discovered| one.type_name.clone().unwrap_or_default();
            let what = format!(
                "{} has type {}, {} wants {}",
                owner(one),
                name(one),
                owner(other),
                name(other)
            );
            let remedy = "give both the same type, or one of them another name".to_owned();
            return Err(Finding::new(Cause::Type, what, "either program", remedy));
        };
        let unmet = |one: &Discovered, other: &Discovered| match (one.qos, other.qos) {
            (Some(offered), Some(asked)) => mismatches(&offered, &asked),
            _ => Vec::new(),
        };
        let fits =
            pairs().any(|(one, other)| !types_differ(one, other) && unmet(one, other).is_empty());
        if fits {
            self.pass("type and quality of service fit");
            return Ok(());
        }
        let (one, other) = first;
        let (Some(offered), Some(asked)) = (one.qos, other.qos) else { return Ok(()) };
        let Some(policy) = mismatches(&offered, &asked).first().copied() else { return Ok(()) };
        let what = format!(
            "{} offers {}, {} asks for {}",
            owner(one),
            policy.value(&offered),
            owner(other),
            policy.value(&asked)
        );
        Err(Finding::new(Cause::Qos, what, "either program", between(policy, &offered, &asked)))
    }

    /// A bridge that runs the route.
    fn bridge(&mut self, source: &End, destination: &End) -> Step {
        if let Some(running) = &self.way.running {
            let RouteInfo { received, sent, .. } = running;
            self.pass(format!("a bridge runs the route: {received} in, {sent} out"));
            return Ok(());
        }
        let Some(route) = &self.way.route else { return Ok(()) };
        let (at_source, at_destination) = match self.way.is_service {
            false => (Role::Listener, Role::Publisher),
            true => (Role::Client, Role::Server),
        };
        let tells = |end: &End| end.address.middleware != "zeromq";
        let seen = source.of(at_source).next().is_some()
            || destination.of(at_destination).next().is_some()
            || !destination.doors.iter().all(|knock| knock.answer == Answer::Open)
            || (!tells(source) && !tells(destination));
        if seen {
            self.pass(
                "the route may run: no bridge on the graph of ROS 2 tells its state (`--node NODE` asks one)",
            );
            return Ok(());
        }
        let what = format!(
            "no bridge runs the route: nobody listens to {} for it, and nobody has {} at the other end",
            source.address, destination.address
        );
        let remedy = format!("wrapyfi bridge --config {}", route.file);
        Err(Finding::new(Cause::NoBridge, what, "a bridge", remedy))
    }

    /// A route that cannot work as configured, whatever is there.
    fn broken(&self) -> Step {
        let Some(running) = self.way.running.as_ref().filter(|running| running.state == "error")
        else {
            return Ok(());
        };
        let what = format!("{} is in state error: {}", self.called(running), running.reason);
        let remedy = "change what the reason names; the bridge turns to the changed file";
        Err(Finding::new(Cause::State, what, "the configuration", remedy))
    }

    /// Programs that were refused, where nobody else came.
    fn refused(&mut self) -> Step {
        let Some(running) = self.way.running.as_ref().filter(|it| !it.refused.is_empty()) else {
            return Ok(());
        };
        let all = drops(running).find(|(reason, _)| *reason == DropReason::RefusedPeer);
        let count = all.map_or(0, |(_, count)| count);
        let what = format!(
            "{} refused {count} times, the last: {}",
            self.called(running),
            running.refused
        );
        if running.received > count && running.sent > 0 {
            self.pass(what);
            return Ok(());
        }
        let remedy = format!("where it may: {}", running.allow);
        Err(Finding::new(Cause::Refused, what, "the configuration, or that program", remedy))
    }

    /// Route in words: of a pattern, the one that is meant.
    fn called(&self, running: &RouteInfo) -> String {
        match &self.way.route {
            Some(route) if route.name != running.key => format!("the route {}", running.key),
            _ => "the route".to_owned(),
        }
    }

    /// State of a route in a bridge, and the messages that it drops.
    fn state(&mut self) -> Step {
        /// Share of messages from which on a route that calls itself active drops too many.
        const MOST: f64 = 0.9;
        let way = self.way;
        let Some(running) = &way.running else { return Ok(()) };
        let (route, reason) = (self.called(running), &running.reason);
        let lost: Vec<_> = drops(running).filter(|(reason, _)| !is_harmless(*reason)).collect();
        let is_degraded = running.state == "degraded";
        if running.state == "waiting" {
            let what = format!("{route} waits for {reason}");
            let remedy = "provide it; the route begins by itself";
            return Err(Finding::new(Cause::State, what, "see the reason", remedy));
        }
        let Some((most, _)) = lost.iter().max_by_key(|(_, count)| *count) else {
            if !is_degraded {
                return Ok(());
            }
            let what = format!("{route} is degraded: {reason}");
            let remedy = "remove what the reason names";
            return Err(Finding::new(Cause::State, what, "see the reason", remedy));
        };
        let count: u64 = lost.iter().map(|(_, count)| count).sum();
        let all: Vec<_> = lost.iter().map(|(reason, count)| format!("{count} {reason}")).collect();
        let what = format!(
            "messages of {route} are dropped: {count} of {} that came ({}); mostly because {}",
            running.received,
            all.join(", "),
            meaning(*most)
        );
        if !is_degraded && (count as f64) < MOST * running.received as f64 {
            self.pass(what);
            return Ok(());
        }
        let what = if reason.is_empty() { what } else { format!("{what}; the last: {reason}") };
        let who = "the route, or the program at its end";
        let cause = match most {
            DropReason::ServiceMapping => Cause::ServiceMapping,
            _ => Cause::Drops,
        };
        Err(Finding::new(cause, what, who, mends(*most)))
    }

    /// Limit of the rate, where it leaves out most of the messages.
    fn rate(&mut self) -> Step {
        /// Share of messages from which on a limit is taken for a mistake.
        const MOST: f64 = 0.9;
        let Some(route) = &self.way.route else { return Ok(()) };
        let Some(Limited { max_rate_hz, came_hz, dropped }) = route.limited else { return Ok(()) };
        let came = came_hz.map(|hz| format!(", and {hz:.1} messages a second come"));
        let what = format!(
            "max_rate_hz is {max_rate_hz}{}: {:.0} % of all were left out",
            came.unwrap_or_default(),
            100.0 * dropped
        );
        if dropped < MOST {
            self.pass(what);
            return Ok(());
        }
        let enough = came_hz.unwrap_or(max_rate_hz / (1.0 - dropped).max(0.001));
        let remedy = format!(
            "write `max_rate_hz: {:.0}` or more on the route in {}, or leave it out",
            enough.max(max_rate_hz).ceil(),
            route.file
        );
        Err(Finding::new(Cause::RateLimit, what, "the route", remedy))
    }

    /// Other bridges whose node has the same name.
    fn namesakes(&self, ends: [&End; 2]) -> Step {
        let Some(RouteFacts { node, is_own, .. }) = &self.way.route else { return Ok(()) };
        // Each bridge publishes its status once; one that looks does not see its own.
        let status = format!("{node}/status");
        let is_status = |one: &&Discovered| one.name == status && one.role == Role::Publisher;
        let bridges = |end: &End| end.found.iter().filter(is_status).count();
        let of_ros2 = ends.into_iter().filter(|end| end.address.middleware == "ros2");
        let others = of_ros2.map(bridges).max().unwrap_or(0);
        let others = others.saturating_sub(usize::from(!is_own));
        if others == 0 {
            return Ok(());
        }
        Err(Finding::new(
            Cause::SameNode,
            super::same_node(node),
            "whoever starts the bridges",
            super::OTHER_NODE,
        ))
    }

    /// Messages that come.
    fn messages(&mut self, source: &End) -> Step {
        if source.heard > 0 {
            self.pass(format!("{} messages came while we listened", source.heard));
        }
        let Some(time) = source.silent.filter(|_| source.heard == 0) else { return Ok(()) };
        let publisher = source.of(Role::Publisher).next();
        let what = format!(
            "everything is in place, and no message came on {} within {} ms: the connection is open and \
             idle",
            source.address,
            time.as_millis()
        );
        let who = publisher.map_or_else(|| "its publisher".to_owned(), owner);
        let remedy =
            format!("look at that program; `wrapyfi echo {}` shows what comes", source.address);
        Err(Finding::new(Cause::Idle, what, who, remedy))
    }
}

/// A bridge that is not activated, whatever is there.
fn inactive(way: &Way) -> Option<Finding> {
    let (route, running) = (way.route.as_ref()?, way.running.as_ref()?);
    (running.reason == TO_BE_ACTIVATED).then(|| not_active(State::Inactive, &route.node))
}

/// Causes that the file alone tells.
fn of_file(route: &RouteFacts) -> Step {
    if let Some((type_name, reason)) = &route.undefined {
        return Err(undefined(type_name, reason));
    }
    let (name, file) = (&route.name, &route.file);
    if let Some((topic, why)) = &route.left_out {
        let (what, remedy) = match why {
            LeftOut::Denied(entry) => (
                format!("{topic} is left out by deny: {entry:?} of {name}"),
                format!("take {entry:?} out of `deny` in {file}, or write a route for {topic}"),
            ),
            LeftOut::NotAllowed => (
                format!("{topic} is left out of {name}: no entry of allow matches it"),
                format!("add it to `allow` in {file}"),
            ),
            LeftOut::ByDefault => (
                format!("{topic} is left out of {name} by default: hidden, or of every node"),
                format!(
                    "write `default_deny: false` on the pattern in {file}, or a route for {topic}"
                ),
            ),
        };
        return Err(Finding::new(Cause::LeftOut, what, "the pattern", remedy));
    }
    match route.limit {
        Some((limit, names)) if names > limit => {
            let what = format!("{names} names match {name}, and {limit} routes are its limit");
            let remedy = format!("write `max_routes: {names}` or more on the pattern in {file}");
            Err(Finding::new(Cause::Limit, what, "the pattern", remedy))
        }
        _ => Ok(()),
    }
}

fn undefined(type_name: &str, reason: &str) -> Finding {
    let package = type_name.split('/').next().unwrap_or(type_name);
    let what = format!("nobody here has a definition of {type_name}: {reason}");
    let who = format!("the package {package}; a ROS 1 publisher shows its own");
    let remedy = format!(
        "source the ROS 2 workspace that has {package} before you start (AMENT_PREFIX_PATH), or name its \
         folder: `definitions: [DIR]` in the configuration, `--definitions DIR` of a command"
    );
    Finding::new(Cause::Definition, what, who, remedy)
}

fn cause_of_nobody(role: Role) -> Cause {
    match role {
        Role::Publisher => Cause::NobodyPublishes,
        Role::Server => Cause::NobodyOffers,
        Role::Listener | Role::Client => Cause::NobodyListens,
    }
}

/// A name that exists, and is nearly the one that is looked for.
fn same_name_differently(end: &End, role: Role) -> Option<Finding> {
    let address = &end.address;
    let of_role = || end.found.iter().filter(|one| one.role == role);
    let (name, kinship) = nearest(&address.name, of_role().map(|one| one.name.as_str()))?;
    let one = of_role().find(|one| one.name == name)?;
    let what = format!(
        "{}; {}:{name} has {}: the name differs by {}",
        nobody(end, role),
        address.middleware,
        people(&[one], role),
        kinship.words()
    );
    let middleware = &address.middleware;
    let remedy = format!(
        "write {middleware}:{name} instead of {address}, or give it the name {} there",
        address.name
    );
    Some(Finding::new(Cause::OtherName, what, owner(one), remedy))
}

#[cfg(test)]
#[path = "judge_tests.rs"]
mod tests;
