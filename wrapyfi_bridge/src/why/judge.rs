//! Walk along a way: what is in place, and the first thing that is missing. Pure.
//!
//! ```text
//!   route: definition, pattern ─▶ source: server, a program there, address, type, mapping, quality of service
//!       ─▶ route: heard, run by a bridge ─▶ destination: the same ─▶ messages come
//! ```

use wrapyfi_endpoint::{CauseCode, Discovered, Interaction, Role};
use wrapyfi_interfaces::wrapyfi_msgs::msg::RouteInfo;

use crate::middlewares::conventions;
use crate::node::GRAPH;

use super::board::lacks_clients;
use super::bridges::{
    brought_by_pattern, elsewhere, inactive, lacking, matched_without_route, other_master, several,
};
use super::configured::{by_parameters, defined, limit, of_file};
use super::reach::opened;
use super::server_check::{ConnectOutcome, ServerCheck};
use super::state::{
    broken, brought, counted, flows, has_rival, hears_others, is_carried, is_met, is_used, rate,
    refused, refused_alone, runs, state, unopened,
};
use super::stopped::with_stopped_programs;
use super::words::{example, nobody, owner, people, provider, same_name_differently};
use super::{Board, Diagnosis, Elsewhere, Finding, Graph, StepResult, Way, WayEnd};

/// Steps of a walk: what is in place, until something is not.
pub(super) struct Walk<'w> {
    pub(super) way: &'w Way,
    pub(super) passed: Vec<String>,
}

/// Walks along the way.
pub fn judge(way: &Way) -> Diagnosis {
    let mut walk = Walk { way, passed: way.known.clone() };
    let finding = inactive(way)
        .or_else(|| walk.walk().err())
        .map(|finding| with_stopped_programs(finding, way));
    // The nearer cause hides it: it is seen again once that is mended.
    let is_hidden = finding.as_ref().is_some_and(|it| it.cause != CauseCode::SeveralBridges);
    if is_hidden && !way.also.is_empty() {
        let hidden = several(way, &[]).err();
        walk.passed.extend(hidden.map(|it| format!("{}; {}", it.what, it.remedy)));
    }
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
        (Some(node), GRAPH) => node == own,
        (Some(node), _) if conventions(middleware).has_ros_names => {
            wrapyfi_ros1::is_anonymous(node)
        }
        _ => true,
    }
}

impl Walk<'_> {
    fn walk(&mut self) -> StepResult {
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
        let (provider, taker) = (way.interaction.provider(), way.interaction.taker());
        self.side(source)?;
        let is_brought = brought(way, &source.address).is_some();
        if way.route.is_none() && !is_brought && !is_met(way, &source.address, provider) {
            // The bridge that would be there says why it is not.
            state(way)?;
        }
        self.somebody(source, provider)?;
        other_master(way, source)?;
        // Of a name that no program has, the limit is no reason.
        way.route.as_ref().map_or(Ok(()), limit)?;
        self.reached(source, provider)?;
        self.types(source, provider)?;
        self.only_server(source)?;
        self.mapping(source)?;
        defined(&source.undefined)?;
        self.quality(source, provider)?;
        if way.interaction == Interaction::Action {
            self.server_of_action(source)?;
        }
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
                return Err(Finding::new(CauseCode::NoRoute, what, who, remedy));
            }
            None => {
                self.callers(source)?;
                self.among_themselves(source, provider, taker)?;
                if way.interaction == Interaction::Topic {
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
                if way.interaction != Interaction::Topic {
                    self.side(destination)?;
                    self.only_server(destination)?;
                    self.callers(destination)?;
                    if way.interaction == Interaction::Action {
                        self.types(destination, taker)?;
                        self.only_status(destination)?;
                    }
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
    fn board(&mut self, board: &Board, source: &WayEnd, at_board: &WayEnd) -> StepResult {
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

    /// A program who takes the messages of a route.
    fn taken(&mut self, end: &WayEnd) -> StepResult {
        self.side(end)?;
        other_master(self.way, end)?;
        self.somebody(end, Role::Listener)?;
        self.reached(end, Role::Listener)?;
        self.types(end, Role::Listener)?;
        self.quality(end, Role::Listener)
    }

    pub(super) fn pass(&mut self, what: impl Into<String>) {
        let what = what.into();
        if !self.passed.contains(&what) {
            self.passed.push(what);
        }
    }

    /// The servers of a side, and the side itself.
    fn side(&mut self, end: &WayEnd) -> StepResult {
        let does = if end.away.is_some() { "accepts a connection" } else { "answers" };
        // Where another program has a port, no broker can be started.
        let is_taken = |it: &&ServerCheck| matches!(it.answer, ConnectOutcome::Foreign(_));
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
            return Err(Finding::new(CauseCode::Slow, what, who, remedy));
        }
        let remedy = match end.servers.first() {
            _ if end.is_told => {
                let keys =
                    conventions(middleware).keys.map(|keys| format!("; keys are those of {keys}"));
                format!("do what the reason says{}", keys.unwrap_or_default())
            }
            Some(check) => format!(
                "look what runs on port {} of {}; it has to be a {}, which goes on with kill -CONT PID where it is stopped",
                check.address.port, check.address.host, check.address.server
            ),
            None => conventions(middleware)
                .name_service
                .and_then(|server| server.find)
                .unwrap_or("see the reason; `wrapyfi list` shows the same")
                .to_owned(),
        };
        let who = format!("the settings of {middleware}, or its server");
        Err(Finding::new(CauseCode::Middleware, what, who, remedy))
    }

    /// A program in a role at an end.
    fn somebody(&mut self, end: &WayEnd, role: Role) -> StepResult {
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
        if role == Role::ActionServer {
            self.parts_of_action(end)?;
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
                    CauseCode::OwnPublication,
                    format!("{nobody} but this bridge, which ignores its own publications"),
                ),
                false => (
                    CauseCode::Cycle,
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
        let server = conventions(&address.middleware).name_service;
        let variable = server.and_then(|it| it.server_variable).filter(|_| !is_own);
        let elsewhere = variable
            .map(|it| format!("; or this shell has another {it} than the bridge"))
            .unwrap_or_default();
        let forgotten = |server: &str| {
            format!(
                "{nobody} that the {server} knows: where it was restarted, who comes new does not find {} until that is \
                 started again{elsewhere}",
                provider(end, role)
            )
        };
        if !there.is_empty() {
            let found = format!("{address} has {}", people(&there, role));
            let server = registry(end).filter(|_| end.is_unregistered && role.is_provider());
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
            true => address.middleware != GRAPH || flows(self.way),
            // A broker of others does not tell who listens, but to who publishes; who publishes, only messages tell.
            false if !conventions(&address.middleware).shows_publishers => {
                role != Role::Publisher || hears_others(self.way)
            }
            // A look that another finding ended may have missed who is there.
            false => {
                registry(end).is_some() || ((role.is_provider() || end.is_cut) && flows(self.way))
            }
        };
        if is_believed && is_met(self.way, address, role) {
            let has = match is_carried(self.way) && !is_bare {
                true => "messages pass".to_owned(),
                false => format!("the bridge {} has it", self.way.node),
            };
            // Of a mere name the bridge is one that takes it; readers of a port of YARP are not announced.
            let is_told = !is_bare && server.is_some_and(|it| it.knows_listeners);
            self.pass(match registry(end).filter(|_| is_told || role.is_provider()) {
                Some(server) => format!("{has}, but {}", forgotten(server)),
                None => has,
            });
            return Ok(());
        }
        // Services of ZeroMQ have no names: the program that answers at the broker is one.
        if self.way.interaction != Interaction::Topic
            && !conventions(&address.middleware).has_service_names
        {
            return Ok(());
        }
        if let Some(found) = same_name_differently(end, role) {
            return Err(found);
        }
        if let Some(Elsewhere { cause, place, remedy, endpoint }) = end.elsewhere.first() {
            let here = end
                .graph
                .as_ref()
                .map_or(String::new(), |graph| format!(" (domain {})", graph.domain_id));
            let what = format!(
                "{nobody} here{here}; in {place} there is {}",
                people(&[endpoint], endpoint.role)
            );
            return Err(Finding::new(*cause, what, owner(endpoint), remedy.clone()));
        }
        if let Some(unresolved) = end.graph.as_ref().and_then(|graph| graph.unresolved.first()) {
            let what = format!("{nobody}, and {unresolved}");
            let remedy = "write its address in /etc/hosts, or in place of the name".to_owned();
            let who = "whoever knows the machine's address";
            return Err(Finding::new(CauseCode::UnresolvedHost, what, who, remedy));
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
                "OFF" => CauseCode::DiscoveryRange,
                _ => cause_of_nobody(role),
            };
            return Err(Finding::new(cause, what, who, remedy));
        }
        let mut remedy =
            example(end, role, self.way.running.as_ref().and_then(unopened).as_deref());
        if is_bare && role == Role::Publisher && !conventions(&address.middleware).shows_publishers
        {
            // It sends nothing before a program listens.
            remedy = format!("{remedy}, and beside it: wrapyfi echo {address}");
        }
        let nobody = Finding::new(cause_of_nobody(role), nobody, provider(end, role), remedy);
        let nobody = match role.is_provider() {
            true => brought_by_pattern(self.way, nobody),
            false => nobody,
        };
        Err(refused_alone(self.way, role, nobody))
    }

    /// Messages that come.
    fn messages(&mut self, source: &WayEnd) -> StepResult {
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
            return Err(Finding::new(CauseCode::Middleware, what, who, remedy));
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
            return Err(Finding::new(
                CauseCode::Drops,
                what,
                "the broker, or the publisher",
                remedy,
            ));
        }
        // A broker tells what came on a topic, not whether who sent it is there still.
        let idle = match conventions(&source.address.middleware).shows_publishers {
            false => "its publisher is idle, or has ended: a broker does not tell which",
            true => "the connection is open and idle",
        };
        let what = format!(
            "everything is in place, and no message came on {} within {} ms: {idle}",
            source.address,
            time.as_millis()
        );
        let who = publisher.map_or_else(|| "its publisher".to_owned(), owner);
        let remedy =
            format!("look at that program; `wrapyfi echo {}` shows what comes", source.address);
        Err(Finding::new(CauseCode::Idle, what, who, remedy))
    }
}

/// Name of the server at which those who have the name of an end are registered, where there is one.
fn registry(end: &WayEnd) -> Option<&'static str> {
    conventions(&end.address.middleware).name_service?;
    end.servers.first().map(|check| check.address.server.name())
}

fn cause_of_nobody(role: Role) -> CauseCode {
    match role {
        Role::Publisher => CauseCode::NobodyPublishes,
        Role::Server | Role::ActionServer => CauseCode::NobodyOffers,
        Role::Listener | Role::Client | Role::ActionClient => CauseCode::NobodyListens,
    }
}

#[cfg(test)]
#[path = "judge_tests.rs"]
mod tests;
