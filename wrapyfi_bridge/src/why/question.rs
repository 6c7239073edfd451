//! The thing that is asked about, and the facts about it.
//!
//! ```text
//!   route of a file, by name, by its ends or by one of them ─┐
//!   middleware:/name                                         ├─▶ Way
//!   package/msg/Name                                         ┘
//! ```

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

use wrapyfi_endpoint::{CauseCode, DropReason, EndpointAddress, Interaction, Mutex, Role};
use wrapyfi_engine::{Plan, Route, RouteIndex, Typing};
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_interfaces::wrapyfi_msgs::msg::RouteInfo;
use wrapyfi_ros2::Ros2;

use super::bridges::rivals;
use super::drops::count;
use super::ends::{entry, listens_on, qos_at, type_at, type_of_messages};
use super::judge::may_be_bridge;
use super::look::{LOOK, Sight, Wanted, graph, look, timeout, widen};
use super::meaning::{address, left_out, of_other_kinds, other_way, route};
use super::state::{came, lacks_listener, leads_to, receives_from};
use super::{
    Finding, Limited, RouteFacts, Unheard, Way, WayEnd, board, bridges, elsewhere, running, stopped,
};
use crate::cli::WhyArgs;
use crate::command::definitions;
use crate::exit::{Failure, Result};
use crate::in_force::{InForce, Running};
use crate::lifecycle::State;
use crate::middlewares::{self, Endpoints, Loaded, Undefined, conventions, is_ros, ros2_hidden};
use crate::node::{GRAPH, Node};
use crate::on_graph::info::{cause, is_destination, is_source};

/// Time within which most bridges have told their routes: they are heard for as long even where the answer is known.
const AT_ONCE: Duration = Duration::from_millis(300);

/// Finds out what can be found out about what a command is asked.
///
/// # Errors
/// Exit code 2 where the name means nothing, or the configuration has other faults.
pub fn ask(asked: &WhyArgs) -> Result<Way> {
    let way = match &asked.config {
        Some(file) => of_file(asked, file)?,
        None => of_name(asked)?,
    };
    Ok(Way { stopped_programs: stopped::programs(), ..way })
}

fn of_name(asked: &WhyArgs) -> Result<Way> {
    let name = asked.name.as_str();
    let has_colon = |text: &str| text.chars().any(|letter| letter == ':');
    match name.split('/').collect::<Vec<_>>()[..] {
        [package, "msg" | "srv", _] if !has_colon(package) => of_type(asked),
        _ => {
            let address = address(name).map_err(|fault| match has_colon(name) {
                true => Failure::Usage(fault),
                false => Failure::Usage(format!("{fault}; for the name of a route add --config")),
            })?;
            let mut endpoints = Endpoints::default();
            endpoints.reached_at(asked.own);
            let sight = Sight::of_command(&endpoints);
            Ok(way_of_address(&address, sight, &mut definitions::of_command(&asked.definitions)?))
        }
    }
}

fn of_file(asked: &WhyArgs, path: &Path) -> Result<Way> {
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

fn of_type(asked: &WhyArgs) -> Result<Way> {
    let name = asked.name.as_str();
    let mut types = definitions::of_command(&asked.definitions)?;
    let mut way = Way { title: name.to_owned(), ..Way::default() };
    if let Err(error) = types.resolve_name(name) {
        let undefined = Some((name.to_owned(), error.to_string()));
        way.route = Some(RouteFacts { undefined, ..RouteFacts::default() });
        return Ok(way);
    }
    way.known.push("its definition is found".to_owned());
    let address = EndpointAddress { middleware: GRAPH.to_owned(), name: "/".to_owned() };
    // No program has to have the name.
    let wanted = Wanted::new(address, Role::Client);
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
    pub status: Option<&'c (dyn Fn() -> Vec<RouteInfo> + Sync)>,
}

impl Configured<'_> {
    /// Finds out what can be found out about the route or the endpoint that `name` means.
    ///
    /// # Errors
    /// Exit code 2 where the name means nothing.
    pub fn way(&self, name: &str, mut types: TypeStore) -> Result<Way> {
        let Self { file, plan, node, sight, removed, .. } = *self;
        if let Some(routes) = board::of_name(plan, name, address(name).ok().as_ref()) {
            return Ok(self.of_board(&routes, &mut types));
        }
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
                let way = self.of_meant(&route, facts, name, &mut types);
                // A pattern of the other kind may leave the name out.
                let provider = way.interaction.provider();
                let is_there = |end: &WayEnd| end.of(provider).next().is_some();
                let is_written = |one: &Route| one.name == route.name && !one.is_many();
                let is_written = route.is_many() || plan.routes.iter().any(is_written);
                let is_found = is_written
                    || way.running.is_some()
                    || way.source.as_ref().is_some_and(is_there);
                let found = || left_out(plan, &address(name).ok().filter(|_| !is_found)?);
                let Some((pattern, left_out)) = found() else { return Ok(way) };
                let asked = name;
                let (name, file) = (pattern.name, file.to_owned());
                let title = format!("{asked} in {name}");
                let facts = RouteFacts { name, file, left_out, ..RouteFacts::default() };
                Ok(Way { title, route: Some(facts), ..Way::default() })
            }
            None => match address(name) {
                Ok(address) => {
                    let way = way_of_address(&address, sight, &mut types);
                    // A bridge may have another name for an end than the file.
                    let key = way.running.as_ref().map(|running| running.key.as_str());
                    if let Some(route) =
                        plan.routes.iter().find(|one| Some(one.name.as_str()) == key)
                    {
                        let (name, file) = (route.name.clone(), file.to_owned());
                        let facts = RouteFacts { name, file, ..RouteFacts::default() };
                        return Ok(self.of_route(route, facts, &mut types));
                    }
                    Ok(Way { without_route: Some(file.to_owned()), ..way })
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

    /// Facts about a route; of the routes that patterns make from a name and to it, about the one that is meant.
    fn of_meant(&self, route: &Route, facts: RouteFacts, name: &str, types: &mut TypeStore) -> Way {
        let address = address(name).ok();
        let running = self.status.map(|status| status()).unwrap_or_default();
        let text = address.as_ref().map(ToString::to_string).unwrap_or_default();
        let rivals = rivals(&running, &text);
        let runs = running.iter().any(|one| is_source(one, &text) || is_destination(one, &text));
        let other = address.filter(|_| !runs);
        let other = other.and_then(|address| other_way(self.plan, route, &address));
        let again = RouteFacts { unheard: None, ..facts.clone() };
        let (mut way, there) = std::thread::scope(|scope| {
            // Folders of definitions are looked in where these do not suffice.
            let mut usual = TypeStore::from_environment().or_generated();
            let facts_there = again.clone();
            let there = other
                .as_ref()
                .map(|other| scope.spawn(move || self.of_route(other, facts_there, &mut usual)));
            let way = self.of_route(route, facts, types);
            (way, there.and_then(|there| there.join().ok()))
        });
        if let (Some(there), Some(other)) = (there.filter(|it| is_rather(it, &way)), &other) {
            let is_known = there.source.as_ref().is_none_or(|end| end.undefined.is_none());
            way = if is_known { there } else { self.of_route(other, again, types) };
        }
        way.known.extend(rivals);
        way
    }

    /// Facts about a route: both ends, side by side, by the names that the bridge which runs it has for them.
    pub(super) fn of_route(
        &self,
        route: &Route,
        mut facts: RouteFacts,
        types: &mut TypeStore,
    ) -> Way {
        let Self { plan, node, sight, .. } = *self;
        // Of patterns for topics, services and actions with the same ends, that which runs is meant.
        let others = of_other_kinds(plan, route);
        let ends = [&route.from, &route.to].map(|end| node.resolve(end));
        let differs = |told: &RouteInfo| {
            let is_renamed = || running::resolved(told).is_some_and(|resolved| resolved != ends);
            !running::is_alike(route, told) || (!route.is_many() && is_renamed())
        };
        let (is_answered, is_left) = (AtomicBool::new(false), AtomicBool::new(false));
        let find = |all: Vec<RouteInfo>| {
            let of_others = || others.iter().find_map(|other| running::of(other, all.clone()));
            let told = running::of(route, all.clone()).or_else(of_others)?;
            // What a bridge has by other names, or as the other kind, is looked at instead.
            for flag in [&is_left, &is_answered] {
                flag.fetch_or(differs(&told), Relaxed);
            }
            Some(told)
        };
        let as_told = |told: &RouteInfo| {
            let other = others.iter().find(|other| running::is_alike(other, told));
            (other.unwrap_or(route), running::resolved(told).unwrap_or_else(|| ends.clone()))
        };
        let status = || find(self.status?());
        let (before, begin) = (status(), Instant::now());
        let (mut route, mut ends) = match before.as_ref().filter(|told| differs(told)) {
            Some(told) => as_told(told),
            None => (route, ends.clone()),
        };
        let begin_look = || [&is_left, &is_answered].map(|flag| flag.store(false, Relaxed));
        begin_look();
        let ros2 = observed(sight, plan.uses(GRAPH));
        let from = Sight { ros2: ros2.as_ref(), is_answered: &is_answered, ..sight };
        let (mut looked, heard) =
            beside_bridges(from, &find, Some(&|all| running::of(route, all)), || {
                self.look(route, &ends, from, &is_left, types)
            });
        if let Some((_, told)) = heard.running.as_ref().filter(|(_, told)| differs(told)) {
            (route, ends) = as_told(told);
            begin_look();
            looked = self.look(route, &ends, from, &is_left, types);
        }
        drop(ros2);
        facts.name.clone_from(&route.name);
        let is_renamed = |(written, there): &(&EndpointAddress, &EndpointAddress)| {
            node.resolve(written) != **there && !route.is_many()
        };
        let renamed = [&route.from, &route.to].into_iter().zip(&ends).filter(is_renamed);
        let mut known: Vec<_> = renamed
            .map(|(written, there)| {
                format!("the bridge has {there} for {written}, by its namespace or a remap rule")
            })
            .collect();
        let interaction = route.interaction();
        let (provider, taker) = (interaction.provider(), interaction.taker());
        let is_learned = route.typing == Typing::Learned && !route.is_many();
        let [mut source, mut destination] = looked;
        known.extend([&source, &destination].into_iter().flat_map(|end| end.differences.clone()));
        if self.status.is_none() {
            let [from, to] = ends;
            if !widen(sight.endpoints, &Wanted::new(from, provider), &mut source) {
                widen(sight.endpoints, &Wanted::new(to, taker), &mut destination);
            }
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
        let served = || source.of(Role::ActionServer).find_map(|one| one.type_name.clone());
        destination.type_name = type_at(route, &route.to)
            .or_else(|| type_of_messages(&source, &destination))
            .or_else(served);
        destination.learned = source.learned;
        source.qos = qos_at(route, &route.from);
        destination.qos = qos_at(route, &route.to);
        let (node, running) = match heard.running {
            Some((node, running)) => (node, Some(running)),
            None => (node.name().fqn(), status()),
        };
        if is_learned
            && interaction == Interaction::Topic
            && is_ros(&route.from)
            && is_ros(&route.to)
        {
            // A listener may have told the route before a publisher came.
            let known = || Some(running.as_ref()?.type_name.clone());
            let known = || known().filter(|name| name.chars().any(|letter| letter == '/'));
            destination.type_name = destination.type_name.or_else(known);
        }
        let mut came_hz = None;
        if let (Some(before), Some(now)) = (before, &running) {
            let came = came(now).saturating_sub(came(&before));
            source.heard = came;
            // Elsewhere no other program would call it idle, for no program can listen.
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
        // The file's own domain goes before that of the environment, here as in the bridge.
        let of_environment = match &sight.endpoints.ros2().domain_id {
            Some(_) => None,
            None => Some(graph(sight.endpoints).domain_id),
        };
        let stopped =
            running.is_none().then(|| stopped::bridge(Some(&facts.file), of_environment)).flatten();
        let (route, source) = (Some(facts), Some(source));
        let running::BridgeReports { others, also, foreign, other_domain, .. } = heard;
        let way = Way { title, interaction, route, source, destination, ..Way::default() };
        Way { node, running, others, also, foreign, stopped, other_domain, known, ..way }
    }

    /// Looks at the two ends of a route, which have these names, until it is known that they have others.
    fn look(
        &self,
        route: &Route,
        [from, to]: &[EndpointAddress; 2],
        sight: Sight<'_>,
        is_left: &AtomicBool,
        types: &mut TypeStore,
    ) -> [WayEnd; 2] {
        let interaction = route.interaction();
        let (provider, taker) = (interaction.provider(), interaction.taker());
        let given = (route.typing == Typing::Given).then_some(route.types);
        let at_source = Wanted {
            given,
            is_learned: route.typing == Typing::Learned && !route.is_many(),
            listens: provider == Role::Publisher
                && !route.is_many()
                && self.status.is_none()
                && listens_on(&from.middleware),
            ..Wanted::new(from.clone(), provider)
        };
        let at_destination = Wanted { given, ..Wanted::new(to.clone(), taker) };
        // Nothing is learned at the destination.
        let mut none = TypeStore::empty();
        std::thread::scope(|scope| {
            let source = scope.spawn(|| {
                // What is missing at the destination does not end a look at the source, which comes before it.
                let own = Sight { is_answered: is_left, ..sight };
                let end = look(own, &at_source, types);
                sight.is_answered.fetch_or(!end.is_open(), Relaxed);
                end
            });
            let destination = look(sight, &at_destination, &mut none);
            let failed = |_panicked| {
                let away = Some("looking at it failed: see the log".to_owned());
                WayEnd { away, ..WayEnd::new(from.clone()) }
            };
            [source.join().unwrap_or_else(failed), destination]
        })
    }
}

/// True where the route to a name is meant, rather than the route from there.
fn is_rather(to: &Way, from: &Way) -> bool {
    let has =
        |end: &Option<WayEnd>, role| end.as_ref().is_some_and(|end| end.of(role).next().is_some());
    let (provider, taker) = (from.interaction.provider(), from.interaction.taker());
    let runs = |way: &Way| way.running.is_some();
    if runs(from) || runs(to) {
        return !runs(from);
    }
    if has(&from.source, provider) || has(&to.source, provider) {
        return !has(&from.source, provider);
    }
    has(&to.destination, taker) || !has(&from.destination, taker)
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

/// ROS 2 of a command that looks and hears the bridges; a bridge has its own.
fn observed(sight: Sight<'_>, uses_ros2: bool) -> Option<Arc<Ros2>> {
    let is_asked = uses_ros2 && sight.bridge.is_none();
    is_asked.then(|| ros2_hidden(&sight.endpoints.ros2()).map(Arc::new).ok()).flatten()
}

/// Result of a look, with what the bridges on the graph of ROS 2 tell meanwhile where a command looks: their own word
/// for a route goes before what others tell of it. Where there is no bridge, those of other domains are heard, too.
fn beside_bridges<R>(
    sight: Sight<'_>,
    find: running::Find<'_>,
    find_elsewhere: Option<running::Find<'_>>,
    look: impl FnOnce() -> R,
) -> (R, running::BridgeReports) {
    let graph = graph(sight.endpoints);
    let (begin, timeout) = (Instant::now(), timeout(&graph));
    let (has_looked, is_alone) = (&AtomicBool::new(false), &AtomicBool::new(true));
    let is_late = || begin.elapsed() >= timeout;
    let is_over = &|bridges: usize, is_found: bool| {
        is_alone.store(bridges == 0, Relaxed);
        // Another bridge may have the route, too.
        let is_enough = sight.is_answered.load(Relaxed) || (is_found && has_looked.load(Relaxed));
        is_late() || (is_enough && begin.elapsed() >= AT_ONCE)
    };
    // Only where it is likely that none is here: each domain that is looked at takes a participant.
    let look_in_other_domains = || {
        let is_over = || is_late() || !is_alone.load(Relaxed) || sight.is_answered.load(Relaxed);
        while !is_over() && begin.elapsed() < 2 * AT_ONCE {
            std::thread::sleep(LOOK);
        }
        let find = find_elsewhere.filter(|_| !is_over())?;
        elsewhere::bridge(&sight.endpoints.ros2(), &graph, find, &is_over)
    };
    std::thread::scope(|scope| {
        let hear = |ros2| scope.spawn(move || running::heard(ros2, find, is_over));
        let heard = sight.ros2.map(|ros2| hear(ros2.as_ref()));
        let looking = heard.as_ref().map(|_| scope.spawn(look_in_other_domains));
        let seen = look();
        has_looked.store(true, Relaxed);
        let heard = heard.and_then(|heard| heard.join().ok()).unwrap_or_default();
        let other_domain = looking.and_then(|looking| looking.join().ok()).flatten();
        (seen, running::BridgeReports { other_domain, ..heard })
    })
}

/// A bridge that would offer a service, were it activated.
pub(crate) fn inactive_at(service: &EndpointAddress) -> Option<Finding> {
    /// Time within which a bridge that is there has told.
    const TELLS_WITHIN: Duration = Duration::from_millis(700);
    let ros2 = ros2_hidden(&Endpoints::default().ros2()).ok()?;
    let (text, begin) = (service.to_string(), Instant::now());
    let is_it = |one: &RouteInfo| one.source == text && cause(one) == Some(CauseCode::Inactive);
    let find = |all: Vec<RouteInfo>| all.into_iter().find(is_it);
    let heard =
        running::heard(&ros2, &find, &|_bridges, found| found || begin.elapsed() >= TELLS_WITHIN);
    let (node, running) = heard.running?;
    let (running, foreign) = (Some(running), heard.foreign);
    bridges::inactive(&Way { node, running, foreign, ..Way::default() })
}

/// Facts about an endpoint that no route of a file has; where no program is there, with the route of a bridge that
/// would be.
fn way_of_address(address: &EndpointAddress, sight: Sight<'_>, types: &mut TypeStore) -> Way {
    let wanted = Wanted {
        is_learned: true,
        listens: listens_on(&address.middleware),
        is_open: true,
        ..Wanted::new(address.clone(), Role::Publisher)
    };
    let text = address.to_string();
    let carries = |one: &RouteInfo, wanted| running::interaction(one) == wanted;
    let waits_for_source = |one: &RouteInfo| {
        let is_waiting = one.state == "waiting" && !lacks_listener(one);
        carries(one, Interaction::Topic) && is_waiting && one.resolved_source == text
    };
    let is_one = |one: &RouteInfo| {
        let refuses = |one: &RouteInfo| one.resolved_source == text && !one.refused.is_empty();
        // No broker of ZeroMQ tells who serves.
        let calls =
            |one: &RouteInfo| !carries(one, Interaction::Topic) && one.resolved_destination == text;
        leads_to(one, &text) || refuses(one) || calls(one) || receives_from(one, &text)
    };
    let beside = Mutex::new(BTreeSet::new());
    let find = |all: Vec<RouteInfo>| {
        beside.lock().extend(rivals(&all, &text));
        // What runs tells the name's type, and who is there.
        let is_from =
            |one: &RouteInfo| carries(one, Interaction::Topic) && one.resolved_source == text;
        let found = all.iter().find(|one| is_one(one));
        let found = found.or_else(|| all.iter().find(|one| is_from(one)));
        found.cloned().or_else(|| board::of_port(&all, address))
    };
    let (ros2, is_answered) = (observed(sight, true), AtomicBool::new(false));
    let from = Sight { ros2: ros2.as_ref(), is_answered: &is_answered, ..sight };
    let (mut end, heard) = beside_bridges(from, &find, None, || {
        let end = look(from, &wanted, types);
        is_answered.store(true, Relaxed);
        end
    });
    drop(ros2);
    if sight.bridge.is_none() {
        widen(sight.endpoints, &wanted, &mut end);
    }
    let there: Vec<_> = end.found.iter().filter(|one| wanted.is_met(one)).collect();
    let is_missing = there.is_empty();
    let told = heard.running.filter(|(node, running)| {
        // A board that is not open yet.
        if board::is_of_port(running, address) {
            return is_missing;
        }
        // Who is there may be that bridge alone, whose route waits.
        let is_bridge = || {
            let is_one = there.iter().map(|one| one.count.max(1)).sum::<u64>() <= 1;
            is_one && there.iter().all(|one| may_be_bridge(one, &address.middleware, node))
        };
        // Where a program publishes, it is not what the route takes; where none does, its waiting tells nothing.
        let waits_for_source = waits_for_source(running);
        let is_needed = if is_missing { is_one(running) } else { waits_for_source };
        let is_needed = is_needed || !running.refused.is_empty();
        let is_carried_twice = running.state == "active" && !heard.also.is_empty();
        let is_used = is_carried_twice || receives_from(running, &text);
        // Not every side tells who listens.
        let is_unseen = running.state == "active" && end.of(Role::Listener).next().is_none();
        let is_alone = || is_one(running) && running.state != "active" && is_bridge();
        is_needed || is_used || is_unseen || is_alone()
    });
    let also = if told.is_some() { heard.also } else { Vec::new() };
    let (node, running) = told.map(|(node, running)| (node, Some(running))).unwrap_or_default();
    let interaction = match &running {
        Some(running) if is_missing || !receives_from(running, &text) => {
            running::interaction(running)
        }
        _ => end.interaction,
    };
    // Its broker may be in the bridge that is stopped.
    let is_silent = end.away.is_some() && !conventions(&end.address.middleware).shows_publishers;
    let stopped = is_silent.then(|| stopped::bridge(None, None)).flatten();
    let mut known: Vec<_> = std::mem::take(&mut *beside.lock()).into_iter().collect();
    if running.is_none() && is_missing {
        let begins = heard.others.iter().find_map(bridges::unconfigured);
        known.extend(begins.map(|it| format!("{}; {}", it.what, it.remedy)));
    }
    let others = heard.others.as_ref().filter(|_| running.is_none());
    let matched_without_route =
        others.filter(|_| !is_missing).and_then(|all| bridges::pattern_of(address, all));
    let brought_by_pattern =
        others.filter(|_| is_missing).and_then(|all| bridges::pattern_to(address, all));
    let (source, foreign) = (Some(end), heard.foreign);
    let rest = Way { matched_without_route, brought_by_pattern, ..Way::default() };
    let title = text;
    Way { title, interaction, node, running, also, source, foreign, stopped, known, ..rest }
}

impl Running {
    /// Finds out about a name, from where the bridge runs and with what it runs.
    ///
    /// # Errors
    /// As [`ask`].
    pub(crate) fn explain(&self, name: &str) -> Result<Way> {
        let (registry, plan) = (self.routes.registry(), self.routes.plan());
        let in_force = self.in_force.lock().clone();
        let InForce { file, is_of_parameters, endpoints, definitions, removed } = &in_force;
        let configured = Configured {
            file,
            plan: &plan,
            node: &self.node,
            sight: Sight { bridge: Some(&registry), ..Sight::of_command(endpoints) },
            removed,
            status: Some(&|| self.infos()),
        };
        let way = configured.way(name, definitions::of_command(definitions)?)?;
        let (node, is_of_parameters) = (self.node.name().fqn(), *is_of_parameters);
        Ok(Way { node, is_of_parameters, stopped_programs: stopped::programs(), ..way })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::why::meaning::tests::{index, plan};

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
