//! The thing that is asked about, and the facts about it.
//!
//! ```text
//!   route of a file, by name, by its ends or by one of them ─┐
//!   middleware:/name                                         ├─▶ Way
//!   package/msg/Name                                         ┘
//! ```

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

use wrapyfi_core::endpoint::{DropReason, EndpointAddress, Role};
use wrapyfi_core::engine::{Kind, LeftOut, Plan, Route, RouteIndex, TO_BE_ACTIVATED, Typing};
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_interfaces::wrapyfi_msgs::msg::RouteInfo;

use super::drops::count;
use super::ends::{entry, listens_on, qos_at, shown, type_at};
use super::judge::may_be_bridge;
use super::look::{Sight, Wanted, graph, look, patience, widen};
use super::state::{came, leads_to, takes};
use super::{End, Finding, Limited, RouteFacts, Unheard, Way, bridges, roles, running, stopped};
use crate::cli::WhyArgs;
use crate::command::definitions;
use crate::exit::Failure;
use crate::in_force::{InForce, Running};
use crate::lifecycle::State;
use crate::middlewares::{self, Endpoints, Loaded, Undefined, is_ros};
use crate::node::Node;
use crate::on_graph::info;

/// Time within which most bridges have told their routes: they are heard for as long even where the answer is known.
const AT_ONCE: Duration = Duration::from_millis(300);

/// Finds out what can be found out about what a command is asked.
///
/// # Errors
/// Exit code 2 where the name means nothing, or the configuration has other faults.
pub fn ask(asked: &WhyArgs) -> Result<Way, Failure> {
    let name = asked.name.as_str();
    if let Some(file) = &asked.config {
        return of_file(asked, file);
    }
    match name.split('/').collect::<Vec<_>>()[..] {
        [package, "msg" | "srv", _] if !package.contains(':') => of_type(asked),
        _ => {
            let address = address(name).map_err(Failure::Usage)?;
            let mut endpoints = Endpoints::default();
            endpoints.reached_at(asked.own);
            let sight = Sight::of_command(&endpoints);
            Ok(of_address(&address, sight, definitions::of_command(&asked.definitions)?))
        }
    }
}

fn of_file(asked: &WhyArgs, path: &Path) -> Result<Way, Failure> {
    let file = path.display().to_string();
    let mut undefined = None;
    match middlewares::load_noting(path, &asked.name, &mut undefined) {
        Ok(Loaded { mut endpoints, plan, types, .. }) => {
            endpoints.reached_at(asked.own);
            endpoints.check_permitted(Some(path))?;
            let node = Node::bridge().map_err(Failure::usage)?;
            let sight = Sight::of_command(&endpoints);
            let (removed, status) = (&Plan::default(), None);
            let configured =
                Configured { file: &file, plan: &plan, node: &node, sight, removed, status };
            configured.way(&asked.name, types)
        }
        Err(failure) => {
            let Undefined { route: title, type_name, reason } = undefined.ok_or(failure)?;
            let undefined = Some((type_name, reason));
            let facts =
                RouteFacts { name: title.clone(), file, undefined, ..RouteFacts::default() };
            Ok(Way { title, route: Some(facts), ..Way::default() })
        }
    }
}

fn of_type(asked: &WhyArgs) -> Result<Way, Failure> {
    let name = asked.name.as_str();
    let mut types = definitions::of_command(&asked.definitions)?;
    let mut way = Way { title: name.to_owned(), ..Way::default() };
    if let Err(error) = types.resolve_name(name) {
        let undefined = Some((name.to_owned(), error.to_string()));
        way.route = Some(RouteFacts { undefined, ..RouteFacts::default() });
        return Ok(way);
    }
    way.known.push("its definition is found".to_owned());
    let address = EndpointAddress { middleware: "ros2".to_owned(), name: "/".to_owned() };
    // Nobody has to have the name.
    let wanted = Wanted { role: Role::Client, ..Wanted::new(address, false) };
    let endpoints = Endpoints::default();
    let sight = Sight::of_command(&endpoints);
    let end = look(sight, &wanted, &mut types);
    let users = end.found.iter().filter(|one| one.type_name.as_deref() == Some(name));
    way.known.extend(users.map(|one| format!("ros2:{} has a {} of it", one.name, one.role)));
    Ok(way)
}

/// Routes, seen from where they run or would run.
pub struct Configured<'c> {
    /// Name of the configuration.
    pub file: &'c str,
    /// The routes.
    pub plan: &'c Plan,
    /// Node of the bridge, whose namespace and remappings names go through.
    pub node: &'c Node,
    /// Settings of the middlewares, and those of a bridge that runs the routes.
    pub sight: Sight<'c>,
    /// Routes of the file that the bridge was told to leave out.
    pub removed: &'c Plan,
    /// Present statuses of the routes in the bridge that looks; a command asks the bridges on the graph.
    pub status: Option<&'c dyn Fn() -> Vec<RouteInfo>>,
}

impl Configured<'_> {
    /// Finds out what can be found out about the route or the endpoint that `name` means.
    ///
    /// # Errors
    /// Exit code 2 where the name means nothing.
    pub fn way(&self, name: &str, mut types: TypeStore) -> Result<Way, Failure> {
        let Self { file, plan, node, sight, removed, .. } = *self;
        let running = self.status.map(|status| status()).unwrap_or_default();
        let found = [plan, removed].into_iter().find_map(|plan| {
            let index = plan.index(|address| node.resolve(address));
            let (route, left_out) = route(plan, &index, &running, name)?;
            let unheard = unheard(&index, &route, node);
            let taken_from =
                std::ptr::eq(plan, removed).then(|| (node.name().fqn(), entry(&route)));
            let (name, file, is_own) = (route.name.clone(), file.to_owned(), self.status.is_some());
            let rest = RouteFacts::default();
            let facts = RouteFacts { name, file, is_own, left_out, unheard, taken_from, ..rest };
            Some((route, facts))
        });
        match found {
            Some((_, facts)) if facts.left_out.is_some() => {
                let title = format!("{name} in {}", facts.name);
                Ok(Way { title, route: Some(facts), ..Way::default() })
            }
            Some((route, facts)) => {
                let way = self.of_route(&route, facts.clone(), &mut types);
                // Relative names are other ones in the namespace of the bridge.
                if let Some(there) = self.of_namespace(&route, &way) {
                    return Ok(
                        Configured { node: &there, ..*self }.of_route(&route, facts, &mut types)
                    );
                }
                // Of a pattern for topics and one for services with the same ends, that which runs is meant.
                let other = || of_other_kind(plan, &route).filter(|_| way.running.is_none());
                let other = other().map(|other| {
                    let (name, file) = (other.name.clone(), file.to_owned());
                    let is_own = self.status.is_some();
                    let facts = RouteFacts { name, file, is_own, ..RouteFacts::default() };
                    self.of_route(&other, facts, &mut types)
                });
                Ok(other.filter(|other| other.running.is_some()).unwrap_or(way))
            }
            None => match address(name) {
                Ok(address) => {
                    let without_route = Some(file.to_owned());
                    Ok(Way { without_route, ..of_address(&address, sight, types) })
                }
                Err(_) => {
                    let known: Vec<_> =
                        plan.routes.iter().take(20).map(|route| route.name.as_str()).collect();
                    let known = known.join("\n  ");
                    Err(Failure::Usage(format!(
                        "{file} has no route {name:?}, and it is no middleware:/name; its routes are\n  \
                         {known}"
                    )))
                }
            },
        }
    }

    /// Node of the bridge on the graph that runs the route, where an end has another name for it than here.
    fn of_namespace(&self, route: &Route, way: &Way) -> Option<Node> {
        way.running.as_ref().filter(|_| self.status.is_none())?;
        let there = Node::at(&way.node).ok()?;
        let differs = |end: &EndpointAddress| there.resolve(end) != self.node.resolve(end);
        (differs(&route.from) || differs(&route.to)).then_some(there)
    }

    /// Facts about a route: both ends, side by side.
    fn of_route(&self, route: &Route, mut facts: RouteFacts, types: &mut TypeStore) -> Way {
        let Self { node, sight, .. } = *self;
        let status = || running::of(route, self.status?());
        let (before, begin) = (status(), Instant::now());
        let is_service = matches!(route.kind, Kind::Service(_));
        let (provider, taker) = roles(is_service);
        let is_learned = route.typing == Typing::Learned && !route.is_many();
        let wanted = |end: &EndpointAddress, role| Wanted {
            role,
            is_learned: is_learned && role == provider,
            listens: role == Role::Publisher
                && !route.is_many()
                && self.status.is_none()
                && listens_on(&end.middleware),
            ..Wanted::new(node.resolve(end), is_service)
        };
        let (at_source, at_destination) = (wanted(&route.from, provider), wanted(&route.to, taker));
        // Nothing is learned at the destination.
        let mut none = TypeStore::empty();
        let find = |all| running::of(route, all);
        let uses_ros2 = self.plan.uses("ros2");
        let ((mut source, mut destination), heard) =
            beside_bridges(sight, uses_ros2, &find, |sight| {
                std::thread::scope(|scope| {
                    let source = scope.spawn(|| {
                        let own = Sight { is_answered: &AtomicBool::new(false), ..sight };
                        let end = look(own, &at_source, types);
                        sight.is_answered.store(!end.is_open(), Relaxed);
                        end
                    });
                    let destination = look(sight, &at_destination, &mut none);
                    let failed = |_panicked| {
                        let away = Some("looking at it failed: see the log".to_owned());
                        End { away, ..End::new(at_source.address.clone()) }
                    };
                    (source.join().unwrap_or_else(failed), destination)
                })
            });
        if self.status.is_none() && !widen(sight.endpoints, &at_source, &mut source) {
            widen(sight.endpoints, &at_destination, &mut destination);
        }
        if let Some(names) = &route.names {
            let of_role = source.found.iter().filter(|one| one.role == provider);
            let mut matching: Vec<_> =
                of_role.map(|one| &one.name).filter(|name| route.target(name).is_some()).collect();
            matching.dedup();
            source.names = Some(matching.len());
            facts.limit = Some((names.max_routes, matching.len()));
        }
        source.type_name = type_at(route, &route.from);
        destination.type_name = type_at(route, &route.to).or_else(|| shown(&source, &destination));
        destination.learned = source.learned;
        source.qos = qos_at(route, &route.from);
        destination.qos = qos_at(route, &route.to);
        let (node, running) = match heard.running {
            Some((node, running)) => (node, Some(running)),
            None => (node.name().fqn(), status()),
        };
        if is_learned && !is_service && is_ros(&route.from) && is_ros(&route.to) {
            // A listener may have told the route before a publisher came.
            let known = || Some(running.as_ref()?.type_name.clone());
            let known = || known().filter(|name| name.contains('/'));
            destination.type_name = destination.type_name.or_else(known);
        }
        let mut came_hz = None;
        if let (Some(before), Some(now)) = (before, &running) {
            let came = came(now).saturating_sub(came(&before));
            source.heard = came;
            // Elsewhere nobody else would call it idle, for nobody can listen.
            source.silent = listens_on(&route.from.middleware).then(|| begin.elapsed());
            came_hz = Some(came as f64 / begin.elapsed().as_secs_f64());
        }
        facts.limited = running.as_ref().and_then(|running| limited(route, running, came_hz));
        if running.is_none() {
            // A name over the limit of its pattern has no status of its own.
            let own = self.status.map(|status| status()).unwrap_or_default();
            let others = heard.others.iter().flatten().flat_map(|(_, it)| &it.routes);
            let mut all = own.iter().chain(others).filter(|one| one.key == route.name);
            facts.limit = facts.limit.or_else(|| all.find_map(running::over));
        }
        let runs_others = heard.others.iter().flatten().find_map(|(node, status)| {
            let is_of_file = |one: &Route| running::of(one, status.routes.clone()).is_some();
            let runs_file = status.state == State::Active.label()
                && (status.routes.is_empty() || self.plan.routes.iter().any(is_of_file));
            runs_file.then(|| (node.clone(), entry(route)))
        });
        facts.taken_from = facts.taken_from.or(runs_others);
        let destination = (!route.is_many()).then_some(destination);
        let title = match route.name == route.ends() {
            true => route.ends(),
            false => format!("{}: {}", route.name, route.ends()),
        };
        let stopped = running.is_none().then(|| stopped::bridge(Some(&facts.file))).flatten();
        let (route, source) = (Some(facts), Some(source));
        let running::Heard { others, also, foreign, .. } = heard;
        let way = Way { title, is_service, route, source, destination, ..Way::default() };
        Way { node, running, others, also, foreign, stopped, ..way }
    }
}

/// Reads an address; ROS 1 is `ros`, and `ros1` as well.
fn address(text: &str) -> Result<EndpointAddress, String> {
    let mut address: EndpointAddress = text
        .parse()
        .map_err(|error: wrapyfi_core::endpoint::ParseAddressError| error.to_string())?;
    if address.middleware == "ros1" {
        address.middleware = "ros".to_owned();
    }
    let known = middlewares::names();
    if !known.contains(&address.middleware.as_str()) {
        return Err(middlewares::unknown(&address.middleware).to_string());
    }
    // Elsewhere a name is what is written.
    if is_ros(&address) && !address.name.starts_with('/') {
        address.name.insert(0, '/');
    }
    Ok(address)
}

type LeftOutName = Option<(String, LeftOut)>;

/// Route that a name means: by its name, its ends, or one of them; of a pattern the route that it makes for
/// the name, or the reason that it makes none. Of two routes with the same end it is the one that is `running`.
fn route(
    plan: &Plan,
    index: &RouteIndex<'_>,
    running: &[RouteInfo],
    name: &str,
) -> Option<(Route, LeftOutName)> {
    let named = plan.routes.iter().find(|route| route.name == name || route.ends() == name);
    let between = || made_between(plan, name, running.iter().find(|one| one.key == name));
    let with_written = |route: Route| {
        let one = index.instead_of(&route).filter(|_| !route.is_many());
        let left_out = one.map(|one| (route.ends(), LeftOut::Written(one.name.clone())));
        Some((route, left_out))
    };
    if let Some(route) = named.cloned().or_else(between) {
        return with_written(route);
    }
    let address = address(name).ok()?;
    let text = address.to_string();
    let runs = || {
        let from = running.iter().find(|one| one.source == text);
        let one = from.or_else(|| running.iter().find(|one| one.destination == text))?;
        made_between(plan, &one.key, Some(one))
    };
    let make = |made: fn(&Route, &EndpointAddress) -> Option<Route>| {
        plan.routes.iter().find_map(|pattern| made(pattern, &address))
    };
    let written = index.written_at(&address).cloned();
    let any = || make(Route::made_from).or_else(|| make(Route::made_to));
    if let Some(route) = written.or_else(runs).or_else(any) {
        return with_written(route);
    }
    let mut many = plan.routes.iter().filter(|one| one.from.middleware == address.middleware);
    let left_out = |pattern: &Route| Some((pattern.clone(), pattern.left_out(&address.name)?));
    if let Some((pattern, why)) = many.find_map(left_out) {
        return Some((pattern, Some((text, why))));
    }
    let mut many = plan.routes.iter().filter(|one| one.to.middleware == address.middleware);
    many.find_map(|pattern| Some((pattern.clone(), Some(pattern.left_out_to(&address.name)?))))
}

/// Route that a pattern makes, by its name: its ends. Topics and services may have the same ones: it is of the kind of
/// the route that is `running`.
fn made_between(plan: &Plan, name: &str, running: Option<&RouteInfo>) -> Option<Route> {
    let (first, second) = name.split_once(" -> ")?;
    let (first, second) = (address(first).ok()?, address(second).ok()?);
    let is_meant =
        |pattern: &&Route| running.is_none_or(|running| running::is_kind(pattern, running));
    plan.routes.iter().filter(is_meant).find_map(|pattern| {
        let (from, to) = match pattern.kind {
            Kind::Topic(_) => (&first, &second),
            Kind::Service(_) => (&second, &first),
        };
        pattern.made_from(from).filter(|made| made.to == *to)
    })
}

/// Route of the other kind with the ends of one that a pattern makes.
fn of_other_kind(plan: &Plan, made: &Route) -> Option<Route> {
    let is_written = plan.routes.iter().any(|one| one.name == made.name);
    let is_other = |one: &&Route| one.role() != made.role() && !is_written;
    plan.routes.iter().filter(is_other).find_map(|pattern| {
        let other = pattern.made_from(&made.from)?;
        (other.to == made.to).then_some(other)
    })
}

/// Route of the same file that publishes where this one listens.
fn unheard(index: &RouteIndex<'_>, route: &Route, node: &Node) -> Option<Unheard> {
    let found = index.unheard().into_iter().find(|one| one.listening == route.name)?;
    let node = node.name().fqn().to_owned();
    Some(Unheard { node, text: found.to_string(), circle: circle(index, route) })
}

/// Addresses from the source of a route along the routes of the file, where they lead back to it; else
/// none.
fn circle(index: &RouteIndex<'_>, route: &Route) -> Vec<String> {
    let circles = index.circles();
    // Only there and back is the usual pair of routes.
    let mut longer = circles.iter().filter(|circle| circle.places.len() > 2);
    let begins = |place: &usize| index.at(*place).is_some_and(|one| one.name == route.name);
    let found = longer.find_map(|circle| Some((circle, circle.places.iter().position(begins)?)));
    let Some((circle, begin)) = found else { return Vec::new() };
    let ends = circle.ends.iter().cycle().skip(begin).take(circle.ends.len() + 1);
    ends.map(ToString::to_string).collect()
}

/// Limit of a route's rate where it has left messages out.
fn limited(route: &Route, running: &RouteInfo, came_hz: Option<f64>) -> Option<Limited> {
    let max_rate_hz = route.policy.max_rate_hz?;
    let dropped = Some(count(running, DropReason::RateLimit)).filter(|dropped| *dropped > 0)?;
    let dropped = dropped as f64 / came(running).max(dropped) as f64;
    Some(Limited { max_rate_hz, came_hz, dropped })
}

/// Result of a look, with what the bridges on the graph of ROS 2 tell meanwhile where a command looks: their own word
/// for a route goes before what others tell of it.
fn beside_bridges<R>(
    sight: Sight<'_>,
    uses_ros2: bool,
    find: running::Find<'_>,
    look: impl FnOnce(Sight<'_>) -> R,
) -> (R, running::Heard) {
    let is_asked = uses_ros2 && sight.bridge.is_none();
    let ros2 = is_asked.then(|| sight.endpoints.ros2.hidden().map(Arc::new).ok()).flatten();
    let (begin, patience) = (Instant::now(), patience(&graph(sight.endpoints)));
    let is_answered = &AtomicBool::new(false);
    let sight = Sight { ros2: ros2.as_ref(), is_answered, ..sight };
    let has_looked = &AtomicBool::new(false);
    let is_over = &|is_found: bool| {
        // Another bridge may have the route, too.
        let is_enough = is_answered.load(Relaxed) || (is_found && has_looked.load(Relaxed));
        begin.elapsed() >= if is_enough { AT_ONCE } else { patience }
    };
    std::thread::scope(|scope| {
        let hear = |ros2| scope.spawn(move || running::heard(ros2, find, is_over));
        let heard = ros2.as_deref().map(hear);
        let seen = look(sight);
        has_looked.store(true, Relaxed);
        (seen, heard.and_then(|heard| heard.join().ok()).unwrap_or_default())
    })
}

/// A bridge that would offer a service, were it activated.
pub(crate) fn inactive_at(service: &EndpointAddress) -> Option<Finding> {
    /// Time within which a bridge that is there has told.
    const TELLS_WITHIN: Duration = Duration::from_millis(700);
    let ros2 = Endpoints::default().ros2.hidden().ok()?;
    let (text, begin) = (service.to_string(), Instant::now());
    let is_it = |one: &RouteInfo| one.source == text && one.reason == TO_BE_ACTIVATED;
    let find = |all: Vec<RouteInfo>| all.into_iter().find(is_it);
    let heard = running::heard(&ros2, &find, &|found| found || begin.elapsed() >= TELLS_WITHIN);
    let (node, running) = heard.running?;
    let (running, foreign) = (Some(running), heard.foreign);
    bridges::inactive(&Way { node, running, foreign, ..Way::default() })
}

/// Facts about an endpoint that no route of a file has; where nobody is there, with the route of a bridge that would be.
fn of_address(address: &EndpointAddress, sight: Sight<'_>, mut types: TypeStore) -> Way {
    let wanted = Wanted {
        role: Role::Publisher,
        is_learned: true,
        listens: listens_on(&address.middleware),
        is_open: true,
        ..Wanted::new(address.clone(), false)
    };
    let text = address.to_string();
    let find = |all: Vec<RouteInfo>| {
        let refuses = |one: &RouteInfo| one.source == text && !one.refused.is_empty();
        // No broker of ZeroMQ tells who serves.
        let calls = |one: &RouteInfo| one.kind == "service" && one.destination == text;
        all.into_iter()
            .find(|one| leads_to(one, &text) || refuses(one) || calls(one) || takes(one, &text))
    };
    let (mut end, heard) = beside_bridges(sight, true, &find, |sight| {
        let end = look(sight, &wanted, &mut types);
        sight.is_answered.store(true, Relaxed);
        end
    });
    if sight.bridge.is_none() {
        widen(sight.endpoints, &wanted, &mut end);
    }
    let there: Vec<_> = end.found.iter().filter(|one| wanted.is_met(one)).collect();
    let is_missing = there.is_empty();
    let told = heard.running.filter(|(node, running)| {
        // Who is there may be that bridge alone, whose route waits.
        let is_bridge = || {
            let is_one = there.iter().map(|one| one.count.max(1)).sum::<u64>() <= 1;
            is_one && there.iter().all(|one| may_be_bridge(one, &address.middleware, node))
        };
        is_missing || takes(running, &text) || (running.state != "active" && is_bridge())
    });
    let (node, running) = told.map(|(node, running)| (node, Some(running))).unwrap_or_default();
    let is_service = match &running {
        Some(running) if is_missing || !takes(running, &text) => running.kind == "service",
        _ => end.is_service,
    };
    // Its broker may be in the bridge that is stopped.
    let is_silent = end.away.is_some() && end.address.middleware == "zeromq";
    let stopped = is_silent.then(|| stopped::bridge(None)).flatten();
    let mut known = Vec::new();
    if running.is_none() && is_missing {
        let begins = heard.others.iter().find_map(bridges::unconfigured);
        known.extend(begins.map(|it| format!("{}; {}", it.what, it.remedy)));
    }
    let (source, foreign) = (Some(end), heard.foreign);
    let (title, rest) = (text, Way::default());
    Way { title, is_service, node, running, source, foreign, stopped, known, ..rest }
}

impl Running {
    /// Finds out about a name, from where the bridge runs and with what it runs.
    ///
    /// # Errors
    /// As [`ask`].
    pub(crate) fn explain(&self, name: &str) -> Result<Way, Failure> {
        let (registry, plan) = (self.routes.registry(), self.routes.plan());
        let in_force = self.in_force.lock().clone();
        let InForce { file, is_of_parameters, endpoints, definitions, removed } = &in_force;
        let configured = Configured {
            file,
            plan: &plan,
            node: &self.node,
            sight: Sight { bridge: Some(&registry), ..Sight::of_command(endpoints) },
            removed,
            status: Some(&|| self.routes.status().iter().map(info::of).collect()),
        };
        let way = configured.way(name, definitions::of_command(definitions)?)?;
        let (node, is_of_parameters) = (self.node.name().fqn(), *is_of_parameters);
        Ok(Way { node, is_of_parameters, ..way })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::middlewares::load_text;

    fn plan(routes: &[&str]) -> Plan {
        let lines = routes.iter().map(|route| format!("  - {{ {route} }}\n")).collect::<String>();
        load_text(&format!("routes:\n{lines}"), "x.yaml").unwrap().plan
    }

    fn index(plan: &Plan) -> RouteIndex<'_> {
        let node = Node::bridge().unwrap();
        plan.index(|address| node.resolve(address))
    }

    fn found(plan: &Plan, name: &str) -> Option<(String, bool)> {
        found_beside(plan, &[], name)
    }

    /// As [`found`], where routes run.
    fn found_beside(plan: &Plan, keys: &[&str], name: &str) -> Option<(String, bool)> {
        let info = |key: &&str| {
            let [source, destination] =
                key.split(" -> ").map(str::to_owned).collect::<Vec<_>>().try_into().unwrap();
            RouteInfo { key: (*key).to_owned(), source, destination, ..RouteInfo::default() }
        };
        let running: Vec<_> = keys.iter().map(info).collect();
        let found = route(plan, &index(plan), &running, name);
        found.map(|(route, left_out)| (route.ends(), left_out.is_some()))
    }

    #[test]
    fn a_route_is_found_by_name_and_by_either_end() {
        let plan = plan(&[
            "name: cam, from: 'zeromq:/cam', to: 'ros2:cam', type: Image",
            "from: 'ros:/(.*)', to: 'ros2:/one/$1', deny: ['raw']",
        ]);
        let cam = Some(("zeromq:/cam -> ros2:cam".to_owned(), false));
        for name in ["cam", "zeromq:/cam -> ros2:cam", "zeromq:/cam", "ros2:/cam"] {
            assert_eq!(found(&plan, name), cam, "{name}");
        }
        assert_eq!(found(&plan, "ros1:/x"), Some(("ros:/x -> ros2:/one/x".to_owned(), false)));
        for left_out in ["ros:/raw", "ros2:/one/raw"] {
            assert!(found(&plan, left_out).is_some_and(|(_, is_left_out)| is_left_out));
        }
        assert_eq!(found(&plan, "yarp:/x"), None);
    }

    #[test]
    fn what_a_written_route_takes_from_a_pattern_is_told() {
        let plan = plan(&[
            "name: chat, from: 'ros:/chat', to: 'ros2:/words'",
            "from: 'ros:/(.*)', to: 'ros2:/one/$1'",
        ]);
        let (_, left_out) = route(&plan, &index(&plan), &[], "ros2:/one/chat").unwrap();
        let ends = "ros:/chat -> ros2:/one/chat".to_owned();
        assert_eq!(left_out, Some((ends, LeftOut::Written("chat".to_owned()))));
        assert_eq!(found(&plan, "ros:/chat"), Some(("ros:/chat -> ros2:/words".to_owned(), false)));
    }

    #[test]
    fn a_route_of_a_pattern_is_found_by_its_name_and_in_the_direction_that_runs() {
        let both = plan(&[
            "from: 'ros2:/(.*)', to: 'ros:/$1'",
            "from: 'ros:/(.*)', to: 'ros2:/$1'",
            "service: 'ros2:/(.*)', as: 'ros:/$1'",
            "from: 'yarp:/(.*)', to: 'ros2:/of_yarp/$1', type: Text",
        ]);
        let (there, back) = ("ros2:/x -> ros:/x", "ros:/x -> ros2:/x");
        let only = |ends: &str| Some((ends.to_owned(), false));
        for name in [there, back, "ros:/ask -> ros2:/ask"] {
            assert_eq!(found(&both, name), only(name));
        }
        for (runs, name, meant) in
            [(back, "ros2:/x", back), (there, "ros2:/x", there), (there, "ros:/x", there)]
        {
            assert_eq!(found_beside(&both, &[runs], name), only(meant), "{name} beside {runs}");
        }
        let [key, source, destination, kind] =
            [back, "ros:/x", "ros2:/x", "service"].map(str::to_owned);
        let service = RouteInfo { key, source, destination, kind, ..RouteInfo::default() };
        for name in ["ros2:/x", "ros:/x", back] {
            let found = route(&both, &index(&both), std::slice::from_ref(&service), name);
            assert!(matches!(found.unwrap().0.kind, Kind::Service(_)), "{name}");
        }
        // Of one of two ways nothing runs.
        assert_eq!(found(&both, "ros2:/x"), only(there));
        let of_yarp = plan(&["from: 'yarp:/(.*)', to: 'ros2:/of_yarp/$1', type: Text"]);
        let wanted = only("yarp:/x -> ros2:/of_yarp/x");
        assert_eq!(found(&of_yarp, "ros2:/of_yarp/x"), wanted);
    }

    #[test]
    fn a_circle_is_found_and_a_pair_is_none() {
        let ring = plan(&[
            "name: a, from: 'ros2:/x', to: 'zeromq:/x', type: Text",
            "name: b, from: 'zeromq:/x', to: 'yarp:/x', type: Text",
            "name: c, from: 'yarp:/x', to: 'ros2:/x', type: Text",
        ]);
        let around = circle(&index(&ring), &ring.routes[1]);
        assert_eq!(around, ["zeromq:/x", "yarp:/x", "ros2:/x", "zeromq:/x"]);
        let node = Node::bridge().unwrap();
        assert!(unheard(&index(&ring), &ring.routes[1], &node).is_some());
        let pair = plan(&[
            "from: 'ros2:/x', to: 'zeromq:/x', type: Text",
            "from: 'zeromq:/x', to: 'ros2:/x', type: Text",
        ]);
        assert_eq!(circle(&index(&pair), &pair.routes[0]), [""; 0]);
        assert!(unheard(&index(&pair), &pair.routes[0], &node).is_none());
    }
}
