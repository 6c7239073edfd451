//! Steps of the walk at one end: whether the programs that are there are reached, and fit the route and each other.

use wrapyfi_endpoint::{AnnouncedQos, CauseCode, Discovered, Role, mismatches};
use wrapyfi_ros2::remedy;

use super::ends::is_told;
use super::judge::Walk;
use super::reach::reachable;
use super::server_check::ConnectOutcome;
use super::state::{flows, is_carried, other_mapping};
use super::words::{between, is_same_type, owner, types_differ};
use super::{Finding, Registered, StepResult, Way, WayEnd};

impl Walk<'_> {
    /// Addresses of those who are there.
    pub(super) fn reached(&mut self, end: &WayEnd, role: Role) -> StepResult {
        let registered: Vec<_> = end.registered.iter().filter(|one| one.role == role).collect();
        let there = registered.iter().find(|one| reachable(end, one).is_ok());
        for one in &registered {
            let Err(gone) = reachable(end, one) else { continue };
            // What it was registered for is known to pass: another one of its name does that. One that hangs keeps its
            // connections, and only what comes tells.
            if is_carried(self.way)
                && (flows(self.way) || one.answer != ConnectOutcome::AcceptsOnly)
            {
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
    pub(super) fn types(&mut self, end: &WayEnd, role: Role) -> StepResult {
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
        if end.is_untyped && flows(self.way) {
            return Ok(());
        }
        let theirs = first.type_name.as_deref().unwrap_or_default();
        let verb = if role.is_provider() { "has" } else { "wants" };
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
        Err(Finding::new(CauseCode::Type, what, "the route, or that program", remedy))
    }

    /// Mapping of services to DDS.
    pub(super) fn mapping(&mut self, end: &WayEnd) -> StepResult {
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
        Err(Finding::new(CauseCode::ServiceMapping, what, "either end", remedy))
    }

    /// Mapping of services to DDS of those who call.
    pub(super) fn callers(&mut self, end: &WayEnd) -> StepResult {
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
        Err(Finding::new(CauseCode::ServiceMapping, what, "either end", remedy))
    }

    /// Quality of service of those who are there, against that of the route.
    pub(super) fn quality(&mut self, end: &WayEnd, role: Role) -> StepResult {
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
        Err(Finding::new(CauseCode::Qos, what, "the route, or that program", remedy))
    }

    /// Types and quality of service of the programs at one endpoint.
    pub(super) fn among_themselves(
        &mut self,
        end: &WayEnd,
        provider: Role,
        taker: Role,
    ) -> StepResult {
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
            return Err(Finding::new(CauseCode::Type, what, "either program", remedy));
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
        Err(Finding::new(CauseCode::Qos, what, "either program", between(policy, &offered, &asked)))
    }
}
