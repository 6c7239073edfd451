//! Walk along a way: what is in place, and the first thing that is missing. Pure.
//!
//! ```text
//!   route: definition, pattern ─▶ source: server, somebody there, address, type, mapping, quality of service
//!       ─▶ route: heard, run by a bridge ─▶ destination: the same ─▶ messages come
//! ```

use wrapyfi_endpoint::{AnnouncedQos, Discovered, Role, mismatches};
use wrapyfi_interfaces::wrapyfi_msgs::msg::RouteInfo;
use wrapyfi_ros2::remedy;
use wrapyfi_yarp_endpoint as yarp;

use crate::middlewares::Server;

use super::board::lacks_clients;
use super::bridges::{
    brought_by_pattern, elsewhere, inactive, lacking, matched_without_route, other_master, several,
};
use super::configured::{by_parameters, defined, limit, of_file};
use super::ends::is_told;
use super::reach::{opened, reachable};
use super::server_check::{Answer, ServerCheck};
use super::state::{
    broken, brought, counted, flows, has_rival, hears_others, is_carried, is_met, is_provider,
    is_used, other_mapping, rate, refused, refused_alone, runs, state, unopened,
};
use super::stopped::with_stopped_programs;
use super::words::{
    between, example, is_same_type, nobody, owner, people, provider, same_name_differently,
    types_differ,
};
use super::{
    Board, Cause, Diagnosis, Elsewhere, End, Finding, Graph, Registered, Step, Way, roles,
};

/// Steps of a walk: what is in place, until something is not.
struct Walk<'w> {
    way: &'w Way,
    passed: Vec<String>,
}

/// Walks along the way.
pub fn judge(way: &Way) -> Diagnosis {
    let mut walk = Walk { way, passed: way.known.clone() };
    let finding = inactive(way)
        .or_else(|| walk.walk().err())
        .map(|finding| with_stopped_programs(finding, way));
    let finding = finding.map(|finding| match way.is_of_parameters {
        true => by_parameters(finding, way),
        false => finding,
    });
    Diagnosis { way: way.title.clone(), passed: walk.passed, finding }
}

/// True for a publisher that the bridge with the ROS 2 node `own` may be itself. Only ROS names the nodes of
/// publishers; a node of the bridge on ROS 1 is `wrapyfi_` and a number.
pub(super) fn may_be_bridge(one: &Discovered, middleware: &str, own: &str) -> bool {
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
            let running = way.running.as_ref().filter(|it| !has_rival(it));
            self.passed.extend(running.filter(|_| way.destination.is_some()).map(runs));
        }
        broken(way)?;
        // Of what is in another domain than its bridge, nothing here tells.
        elsewhere(way).map_or(Ok(()), Err)?;
        let refused = refused(way);
        if let Some(found) = refused.clone().filter(|_| !is_used(way)) {
            return Err(found);
        }
        let Some(source) = &way.source else { return Ok(()) };
        let (provider, taker) = roles(way.is_service);
        self.side(source)?;
        let is_brought = brought(way, &source.address).is_some();
        if way.route.is_none() && !is_brought && !is_met(way, &source.address, provider) {
            // The bridge that would be there says why it is not.
            state(way)?;
        }
        self.somebody(source, provider)?;
        other_master(way, source)?;
        // Of a name that nobody has, the limit is no reason.
        way.route.as_ref().map_or(Ok(()), limit)?;
        self.reached(source, provider)?;
        self.types(source, provider)?;
        self.mapping(source)?;
        defined(&source.undefined)?;
        self.quality(source, provider)?;
        match &way.destination {
            None if source.names.is_some() => {
                self.passed.extend(lacking(way, source, None)?);
                self.passed.extend(state(way)?);
            }
            None if way.without_route.is_some() => {
                let file = way.without_route.as_deref().unwrap_or_default();
                let address = &source.address;
                let what = format!("no route of {file} begins or ends at {address}");
                let who = "the file of the routes";
                let remedy =
                    format!("write one: {{from: \"{address}\", to: …}}; or correct the name");
                return Err(Finding::new(Cause::NoRoute, what, who, remedy));
            }
            None => {
                self.callers(source)?;
                self.among_themselves(source, provider, taker)?;
                if !way.is_service {
                    let nobody = self.somebody(source, taker);
                    // A pattern of the bridge might have listened.
                    nobody
                        .map_err(|nobody| matched_without_route(way, source).unwrap_or(nobody))?;
                    self.reached(source, taker)?;
                    self.messages(source)?;
                }
                if way.running.as_ref().is_some_and(|it| it.state == "degraded") {
                    state(way)?;
                }
                several(way, &[source])?;
                matched_without_route(way, source).map_or(Ok(()), Err)?;
            }
            Some(destination) => {
                if let Some(board) = &way.board {
                    return self.board(board, source, destination);
                }
                self.passed.extend(lacking(way, source, Some(destination))?);
                if way.is_service {
                    self.side(destination)?;
                    self.callers(destination)?;
                    self.passed.extend(state(way)?);
                } else {
                    self.taken(destination)?;
                    self.passed.extend(state(way)?);
                    // A refused program is the cause only where no message of others comes now.
                    self.messages(source).map_err(|idle| refused.clone().unwrap_or(idle))?;
                    self.passed.extend(rate(way)?);
                }
                several(way, &[source, destination])?;
                self.passed.extend(refused.map(|it| format!("{}; {}", it.what, it.remedy)));
            }
        }
        Ok(())
    }

    /// A control board: its states, its ports, who takes its movements, and its clients.
    fn board(&mut self, board: &Board, source: &End, at_board: &End) -> Step {
        let way = self.way;
        self.passed.extend(lacking(way, source, Some(at_board))?);
        self.side(at_board)?;
        if !lacks_clients(way) {
            self.passed.extend(state(way)?);
        }
        self.passed.extend(board.open(&way.node)?);
        self.messages(source)?;
        let movements = &board.movements;
        broken(movements)?;
        if let Some(end) = movements.destination.as_ref().filter(|_| board.moves()) {
            let mut walk = Walk { way: movements, passed: Vec::new() };
            let taken = walk.taken(end);
            self.passed.append(&mut walk.passed);
            taken?;
            if !lacks_clients(movements) {
                self.passed.extend(state(movements)?);
            }
        }
        board.has_clients()?;
        several(way, &[source, at_board])
    }

    /// Somebody who takes the messages of a route.
    fn taken(&mut self, end: &End) -> Step {
        self.side(end)?;
        other_master(self.way, end)?;
        self.somebody(end, Role::Listener)?;
        self.reached(end, Role::Listener)?;
        self.types(end, Role::Listener)?;
        self.quality(end, Role::Listener)
    }

    fn pass(&mut self, what: impl Into<String>) {
        let what = what.into();
        if !self.passed.contains(&what) {
            self.passed.push(what);
        }
    }

    /// The servers of a side, and the side itself.
    fn side(&mut self, end: &End) -> Step {
        let does = if end.away.is_some() { "accepts a connection" } else { "answers" };
        // Where another program has a port, no broker can be started.
        let is_taken = |it: &&ServerCheck| matches!(it.answer, Answer::Foreign(_));
        for check in end.servers.iter().filter(is_taken).chain(&end.servers) {
            match opened(check, &end.address, self.way) {
                Ok(()) => self.pass(format!("{} {does}", check.words())),
                // A connection needs neither a master nor a name server.
                Err(away) if flows(self.way) => {
                    self.pass(format!("messages pass, but {}", away.what));
                }
                Err(away) => return Err(away),
            }
        }
        if let Some(graph) = end.graph.as_ref().filter(|it| !it.carried_by.is_empty()) {
            let Graph { domain_id, carried_by, unresolved, .. } = graph;
            let but = unresolved.first().map(|it| format!(", but {it}")).unwrap_or_default();
            self.pass(format!("ROS 2 in domain {domain_id}, on {carried_by}{but}"));
        }
        let Some(away) = end.away.as_ref().filter(|_| !flows(self.way)) else { return Ok(()) };
        if let Some(stopped) = &self.way.stopped {
            return Err(stopped.clone());
        }
        let middleware = &end.address.middleware;
        let what = format!("{middleware} does not work: {away}");
        if let Some(time) = end.slow {
            let what = format!(
                "{middleware} is slow: {away}: it greets as a ZeroMQ broker does, and had no time for us in {} ms",
                time.as_millis()
            );
            if is_carried(self.way) {
                self.pass(format!("messages pass, though {what}"));
                return Ok(());
            }
            let who = "a broker with too much to do, or a machine";
            let remedy = "ask again; `top` shows what keeps the machine busy";
            return Err(Finding::new(Cause::Slow, what, who, remedy));
        }
        let remedy = match end.servers.first() {
            _ if end.is_told => {
                "do what the reason says; keys are those of `endpoints: zeromq: curve`, at the broker and here, and of \
                 WRAPYFI_ZEROMQ_CURVE_SERVER_KEY and WRAPYFI_ZEROMQ_CURVE_SECRET_KEY_FILE for what that leaves out"
                    .to_owned()
            }
            Some(_) if away.contains("--insecure") => {
                "add --insecure to this command, where the network may be trusted".to_owned()
            }
            Some(check) => format!(
                "look what runs on port {} of {}; it has to be a {}, which goes on with kill -CONT PID where it is stopped",
                check.address.port,
                check.address.host,
                check.address.server
            ),
            None if middleware == yarp::NAME => {
                "start a name server: yarpserver --write, or wrapyfi yarpserver --write where there is no YARP; or find the one that runs: \
                 wrapyfi detect --write".to_owned()
            }
            None => "see the reason; `wrapyfi list` shows the same".to_owned(),
        };
        let who = format!("the settings of {middleware}, or its server");
        Err(Finding::new(Cause::Middleware, what, who, remedy))
    }

    /// Somebody in a role at an end.
    fn somebody(&mut self, end: &End, role: Role) -> Step {
        let address = &end.address;
        match end.names {
            None => {}
            Some(0) if self.way.running.as_ref().is_some_and(|it| it.state == "active") => {
                self.pass(format!("the bridge {} has routes of {address}", self.way.node));
                return Ok(());
            }
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
        let has_received = hears_others(self.way);
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
        let is_own = self.way.route.as_ref().is_some_and(|route| route.is_own);
        let elsewhere = match address.middleware == "ros" && !is_own {
            true => "; or this shell has another ROS_MASTER_URI than the bridge",
            false => "",
        };
        let forgotten = |server: &str| {
            format!(
                "{nobody} that the {server} knows: where it was restarted, who comes new does not find {} until that is \
                 started again{elsewhere}",
                provider(end, role)
            )
        };
        if !there.is_empty() {
            let found = format!("{address} has {}", people(&there, role));
            let server = registry(end).filter(|_| end.is_unregistered && is_provider(role));
            self.pass(match server {
                Some(server) => format!("{found}, but {}", forgotten(server)),
                None => found,
            });
            return Ok(());
        }
        if is_carried(self.way) && end.slow.is_some() {
            return Ok(());
        }
        let is_bare = self.way.route.is_none();
        if let Some(RouteInfo { key, .. }) = brought(self.way, address) {
            self.pass(format!("the route {key} of {} brings it", self.way.node));
            return Ok(());
        }
        // On ROS 2 who looks sees as much as the bridge, which may not have missed yet who left.
        let is_believed = match is_bare {
            true => address.middleware != "ros2" || flows(self.way),
            // A broker of others does not tell who listens, but to who publishes; who publishes, only messages tell.
            false if address.middleware == "zeromq" => {
                role != Role::Publisher || hears_others(self.way)
            }
            false => registry(end).is_some() || (is_provider(role) && flows(self.way)),
        };
        if is_believed && is_met(self.way, address, role) {
            let has = match is_carried(self.way) && !is_bare {
                true => "messages pass".to_owned(),
                false => format!("the bridge {} has it", self.way.node),
            };
            // Of a mere name the bridge is one that takes it; readers of a port of YARP are told to nobody.
            let is_told = !is_bare && address.middleware != yarp::NAME;
            self.pass(match registry(end).filter(|_| is_told || is_provider(role)) {
                Some(server) => format!("{has}, but {}", forgotten(server)),
                None => has,
            });
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
        if let Some(unresolved) = end.graph.as_ref().and_then(|graph| graph.unresolved.first()) {
            let what = format!("{nobody}, and {unresolved}");
            let remedy = "write its address in /etc/hosts, or in place of the name".to_owned();
            let who = "whoever knows the machine's address";
            return Err(Finding::new(Cause::UnresolvedHost, what, who, remedy));
        }
        if let Some(Graph {
            range: range @ ("OFF" | "LOCALHOST"), range_setting, widening, ..
        }) = &end.graph
        {
            let sees = if *range == "OFF" { "nobody but itself" } else { "this machine only" };
            let what = format!("{nobody}, and this program sees {sees} ({range_setting})");
            let who = format!("{}, or one on another machine", provider(end, role));
            let remedy = format!("{}; or {widening} at both ends", example(end, role, None));
            // A program on this machine would have been seen.
            let cause = match *range {
                "OFF" => Cause::DiscoveryRange,
                _ => cause_of_nobody(role),
            };
            return Err(Finding::new(cause, what, who, remedy));
        }
        let mut remedy = example(end, role, self.way.running.as_ref().and_then(unopened));
        if is_bare && role == Role::Publisher && address.middleware == "zeromq" {
            // It sends nothing before somebody listens.
            remedy = format!("{remedy}, and beside it: wrapyfi echo {address}");
        }
        let nobody = Finding::new(cause_of_nobody(role), nobody, provider(end, role), remedy);
        let nobody = match is_provider(role) {
            true => brought_by_pattern(self.way, nobody),
            false => nobody,
        };
        Err(refused_alone(self.way, role, nobody))
    }

    /// Addresses of those who are there.
    fn reached(&mut self, end: &End, role: Role) -> Step {
        let registered: Vec<_> = end.registered.iter().filter(|one| one.role == role).collect();
        let there = registered.iter().find(|one| reachable(end, one).is_ok());
        for one in &registered {
            let Err(gone) = reachable(end, one) else { continue };
            // What it was registered for is known to pass: another one of its name does that. One that hangs keeps its
            // connections, and only what comes tells.
            if is_carried(self.way) && (flows(self.way) || one.answer != Answer::AcceptsOnly) {
                self.pass(format!("messages pass all the same, but {}", gone.what));
                return Ok(());
            }
            if there.is_none() {
                return Err(gone);
            }
            self.pass(gone.what);
        }
        if let Some(Registered { host, port, .. }) = there {
            self.pass(format!("{host}:{port} answers"));
        }
        Ok(())
    }

    /// Types of those who are there.
    fn types(&mut self, end: &End, role: Role) -> Step {
        let wanted = end.type_name.as_ref().filter(|it| is_told(it, &end.address));
        let Some(wanted) = wanted else { return Ok(()) };
        let told: Vec<&Discovered> = end.of(role).filter(|one| one.type_name.is_some()).collect();
        let Some(first) = told.first() else { return Ok(()) };
        let same = |one: &&Discovered| {
            one.type_name.as_deref().is_none_or(|theirs| is_same_type(theirs, wanted))
        };
        if told.iter().any(same) {
            self.pass(format!("its type is {wanted}"));
            return Ok(());
        }
        // The type of a port of YARP is the one that its name tells.
        if end.address.middleware == yarp::NAME && flows(self.way) {
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
        let Way { running, foreign, node, .. } = self.way;
        // The bridge that runs the route may have another mapping than this program, and tells what it lacks.
        let told = running.as_ref().and_then(other_mapping);
        let of_bridge = self.way.route.as_ref().and(running.as_ref()).and(foreign.get(node));
        let seen = end.foreign.filter(|(theirs, _)| of_bridge != Some(theirs));
        let Some((theirs, ours)) = told.or(seen) else { return Ok(()) };
        let server = end.of(Role::Server).next();
        let what = format!(
            "{} speaks {}, and services are mapped in the way of {} {}: requests of one are not \
             understood by the other",
            server.map_or_else(|| format!("the server of {}", end.address), owner),
            theirs.rmw(),
            ours.rmw(),
            if told.is_some() { "in the bridge" } else { "here" }
        );
        let is_bridge = told.is_some() || self.way.route.is_some();
        let here = if is_bridge { "where the bridge starts" } else { "here" };
        let remedy = format!(
            "export RMW_IMPLEMENTATION={} {here} (or {} where the server does)",
            theirs.rmw(),
            ours.rmw()
        );
        Err(Finding::new(Cause::ServiceMapping, what, "either end", remedy))
    }

    /// Mapping of services to DDS of those who call.
    fn callers(&mut self, end: &End) -> Step {
        let address = &end.address;
        let Some((theirs, servers)) = end.clients else {
            let served = end.foreign.map(|(server, _)| server.rmw());
            let needs = |rmw| {
                format!("who calls {address} needs RMW_IMPLEMENTATION={rmw}, unlike this shell")
            };
            self.passed.extend(served.map(needs));
            return Ok(());
        };
        let mut clients = end.of(Role::Client);
        let who = match (clients.next(), clients.next()) {
            (Some(only), None) => owner(only),
            _ => "one of its clients".to_owned(),
        };
        let server = if self.way.route.is_some() { "bridge" } else { "server" };
        let (theirs, servers) = (theirs.rmw(), servers.rmw());
        let what = format!(
            "{who} speaks {theirs}, and {address} is served in the way of {servers}: requests of one are not \
             understood by the other"
        );
        let remedy = format!(
            "export RMW_IMPLEMENTATION={theirs} where the {server} starts, or {servers} where {who} does"
        );
        Err(Finding::new(Cause::ServiceMapping, what, "either end", remedy))
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
        let takers: Vec<_> = end.of(taker).collect();
        let pairs = end.of(provider).flat_map(|one| takers.iter().map(move |other| (one, *other)));
        let pairs: Vec<_> = pairs.collect();
        let Some((one, other)) = pairs.first() else { return Ok(()) };
        let mut typed = pairs.iter().filter(|(one, other)| !types_differ(one, other)).peekable();
        let Some((first, second)) = typed.peek() else {
            let name = |one: &Discovered| one.type_name.clone().unwrap_or_default();
            let what = format!(
                "{} has type {}, {} wants {}",
                owner(one),
                name(one),
                owner(other),
                name(other)
            );
            let remedy = "give both the same type, or one of them another name";
            return Err(Finding::new(Cause::Type, what, "either program", remedy));
        };
        let (one, other) = (*first, *second);
        let unmet = |one: &Discovered, other: &Discovered| match (one.qos, other.qos) {
            (Some(offered), Some(asked)) => mismatches(&offered, &asked),
            _ => Vec::new(),
        };
        if typed.any(|(one, other)| unmet(one, other).is_empty()) {
            self.pass("type and quality of service fit");
            return Ok(());
        }
        let (Some(offered), Some(asked)) = (one.qos, other.qos) else { return Ok(()) };
        let Some(policy) = unmet(one, other).first().copied() else { return Ok(()) };
        let what = format!(
            "{} offers {}, {} asks for {}",
            owner(one),
            policy.value(&offered),
            owner(other),
            policy.value(&asked)
        );
        Err(Finding::new(Cause::Qos, what, "either program", between(policy, &offered, &asked)))
    }

    /// Messages that come.
    fn messages(&mut self, source: &End) -> Step {
        if source.heard > 0 {
            self.pass(format!("{} messages came while we listened", source.heard));
        }
        let Some(time) = source.silent.filter(|_| source.heard == 0) else {
            self.passed.extend(counted(self.way, source)?);
            return Ok(());
        };
        if self.way.running.as_ref().is_some_and(|running| running.messages_per_s > 0.0) {
            self.pass(format!("none came here within {} ms, but at the bridge", time.as_millis()));
            return Ok(());
        }
        if let Some(away) = &source.unconnected {
            let what = format!(
                "nothing could be heard on {} within {} ms: no connection to {away}",
                source.address,
                time.as_millis()
            );
            let remedy = "do what the reason says; where it names nothing, the broker or this machine is busy: ask again";
            let who = "the broker, or the keys of this shell";
            return Err(Finding::new(Cause::Middleware, what, who, remedy));
        }
        let publisher = source.of(Role::Publisher).next();
        let not_taken = publisher.and_then(|it| it.traffic).map_or(0, |traffic| traffic.not_taken);
        if not_taken > 0 {
            let what = format!(
                "the broker did not take {not_taken} messages on {}, which are larger than it passes on or than it has \
                 room for, and no other came within {} ms",
                source.address,
                time.as_millis()
            );
            let remedy = "a greater `max_message_mib` on a route of the bridge that runs the broker, as many MiB as they \
                          have (`wrapyfi broker` takes 64), or smaller messages";
            return Err(Finding::new(Cause::Drops, what, "the broker, or the publisher", remedy));
        }
        // A broker tells what came on a topic, not whether who sent it is there still.
        let idle = match source.address.middleware.as_str() {
            "zeromq" => "its publisher is idle, or has ended: a broker does not tell which",
            _ => "the connection is open and idle",
        };
        let what = format!(
            "everything is in place, and no message came on {} within {} ms: {idle}",
            source.address,
            time.as_millis()
        );
        let who = publisher.map_or_else(|| "its publisher".to_owned(), owner);
        let remedy =
            format!("look at that program; `wrapyfi echo {}` shows what comes", source.address);
        Err(Finding::new(Cause::Idle, what, who, remedy))
    }
}

/// Name of the server at which those who have the name of an end are registered, where there is one.
fn registry(end: &End) -> Option<&'static str> {
    let is_registry = |server: &Server| matches!(server, Server::Master | Server::NameServer);
    end.servers.iter().map(|check| check.address.server).find(is_registry).map(Server::name)
}

fn cause_of_nobody(role: Role) -> Cause {
    match role {
        Role::Publisher => Cause::NobodyPublishes,
        Role::Server => Cause::NobodyOffers,
        Role::Listener | Role::Client => Cause::NobodyListens,
    }
}

#[cfg(test)]
#[path = "judge_tests.rs"]
mod tests;
