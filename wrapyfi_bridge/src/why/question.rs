//! The thing that is asked about, and the facts about it.
//!
//! ```text
//!   route of a file, by name, by its ends or by one of them ─┐
//!   middleware:/name                                         ├─▶ Way
//!   package/msg/Name                                         ┘
//! ```

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use wrapyfi_core::endpoint::{Discovered, DropReason, EndpointAddress, Role};
use wrapyfi_core::engine::{Applier, Kind, Plan, Route, RouteIndex, Typing, may_be_read_as};
use wrapyfi_core::middleware::yarp;
use wrapyfi_core::types::{DataType, MessageType};
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_interfaces::wrapyfi_msgs::msg::RouteInfo;

use super::drops::drops;
use super::look::{Sight, Wanted, graph, look};
use super::{End, Limited, RouteFacts, Unheard, Way, running};
use crate::command::definitions;
use crate::exit::Failure;
use crate::in_force::InForce;
use crate::middlewares::{self, Endpoints, Loaded, Undefined};
use crate::node::Node;
use crate::on_graph::info;
use crate::own_address::OwnAddress;

/// Question of a command.
#[derive(Debug, Clone)]
pub struct Question {
    /// Name of a route, address of an endpoint, or a type.
    pub name: String,
    /// Configuration file that has the route.
    pub config: Option<PathBuf>,
    /// Folders of definitions.
    pub definitions: Vec<PathBuf>,
    /// Address at which others reach the nodes that look.
    pub own: OwnAddress,
}

impl Question {
    /// Finds out what can be found out about it.
    ///
    /// # Errors
    /// Exit code 2 where the name means nothing, or the configuration has other faults.
    pub fn ask(&self) -> Result<Way, Failure> {
        let name = self.name.as_str();
        if let Some(file) = &self.config {
            return self.of_file(file);
        }
        match name.split('/').collect::<Vec<_>>()[..] {
            [package, "msg" | "srv", _] if !package.contains(':') => self.of_type(name),
            _ => {
                let address = address(name).map_err(Failure::Usage)?;
                let mut endpoints = Endpoints::default();
                endpoints.reached_at(self.own);
                let sight = Sight { endpoints: &endpoints, bridge: None };
                Ok(of_address(&address, sight, definitions::store(&self.definitions)?))
            }
        }
    }

    fn of_file(&self, path: &Path) -> Result<Way, Failure> {
        let file = path.display().to_string();
        let mut undefined = Vec::new();
        match middlewares::load_noting(path, &mut undefined) {
            Ok(Loaded { mut endpoints, plan, types, .. }) => {
                endpoints.reached_at(self.own);
                endpoints.check_permitted(Some(path))?;
                let node = Node::bridge().map_err(Failure::usage)?;
                let sight = Sight { endpoints: &endpoints, bridge: None };
                let configured =
                    Configured { file: &file, plan: &plan, node: &node, sight, status: None };
                configured.way(&self.name, types)
            }
            Err(failure) => {
                let is_meant = |one: &&Undefined| one.means(&self.name);
                let found = undefined.iter().find(is_meant).ok_or(failure)?;
                let facts = RouteFacts {
                    name: found.route.clone(),
                    file,
                    undefined: Some((found.type_name.clone(), found.reason.clone())),
                    ..RouteFacts::default()
                };
                let title = found.route.clone();
                Ok(Way { title, route: Some(facts), ..Way::default() })
            }
        }
    }

    fn of_type(&self, name: &str) -> Result<Way, Failure> {
        let mut types = definitions::store(&self.definitions)?;
        definitions::add_standard(name, &self.definitions, &mut types);
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
        let sight = Sight { endpoints: &endpoints, bridge: None };
        let end = look(sight, &wanted, &mut types);
        let users = end.found.iter().filter(|one| one.type_name.as_deref() == Some(name));
        way.known.extend(users.map(|one| format!("ros2:{} has a {} of it", one.name, one.role)));
        Ok(way)
    }
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
    /// Present statuses of the routes in the bridge that looks; a command asks the bridges on the graph.
    pub status: Option<&'c dyn Fn() -> Vec<RouteInfo>>,
}

impl Configured<'_> {
    /// Finds out what can be found out about the route or the endpoint that `name` means.
    ///
    /// # Errors
    /// Exit code 2 where the name means nothing.
    pub fn way(&self, name: &str, types: TypeStore) -> Result<Way, Failure> {
        let Self { file, plan, node, sight, .. } = *self;
        let index = plan.index(|address| node.resolve(address));
        match route(plan, &index, name) {
            Some((route, left_out)) => {
                let mut facts = RouteFacts {
                    name: route.name.clone(),
                    file: file.to_owned(),
                    left_out,
                    node: node.name().fqn(),
                    is_own: self.status.is_some(),
                    ..RouteFacts::default()
                };
                facts.unheard = unheard(&index, &route, node);
                if facts.left_out.is_some() {
                    let title = format!("{name} in {}", route.name);
                    return Ok(Way { title, route: Some(facts), ..Way::default() });
                }
                Ok(self.of_route(&route, facts, types))
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

    /// Facts about a route: both ends, side by side.
    fn of_route(&self, route: &Route, mut facts: RouteFacts, mut types: TypeStore) -> Way {
        let Self { node, sight, .. } = *self;
        let status = || running::of(route, self.status?());
        let (before, begin) = (status(), Instant::now());
        let is_service = matches!(route.kind, Kind::Service(_));
        let (provider, taker) = match is_service {
            false => (Role::Publisher, Role::Listener),
            true => (Role::Server, Role::Client),
        };
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
        let ask = || running::asked(&sight.endpoints.ros2, route);
        // Looking as far as multicast reaches needs an end of all others in the domain.
        let is_beside = self.status.is_none() && !graph(sight.endpoints).is_narrow();
        let (mut source, mut destination, asked) = std::thread::scope(|scope| {
            let source = scope.spawn(|| look(sight, &at_source, &mut types));
            let asked = is_beside.then(|| scope.spawn(ask));
            let destination = look(sight, &at_destination, &mut none);
            let failed = |_panicked| {
                let away = Some("looking at it failed: see the log".to_owned());
                End { away, ..End::new(at_source.address.clone()) }
            };
            let asked = asked.and_then(|asked| asked.join().ok().flatten());
            (source.join().unwrap_or_else(failed), destination, asked)
        });
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
        let asked = || if self.status.is_none() && !is_beside { ask() } else { asked };
        let running = status().or_else(|| {
            let (node, running) = asked()?;
            facts.node = node;
            Some(running)
        });
        if is_learned && !is_service && is_ros(&route.from) && is_ros(&route.to) {
            // A listener may have told it before a publisher came.
            let known = running.as_ref().map(|it| it.type_name.clone());
            source.type_name = known.filter(|name| name.contains('/'));
            let told = || source.of(provider).find_map(|one| one.type_name.clone());
            destination.type_name = source.type_name.clone().or_else(told);
        }
        let mut came_hz = None;
        if let (Some(before), Some(now)) = (before, &running) {
            let came = now.received.saturating_sub(before.received);
            (source.heard, source.silent) = (came, Some(begin.elapsed()));
            came_hz = Some(came as f64 / begin.elapsed().as_secs_f64());
        }
        facts.limited = running.as_ref().and_then(|running| limited(route, running, came_hz));
        let destination = (!route.is_many()).then_some(destination);
        let title = match route.name == route.ends() {
            true => route.ends(),
            false => format!("{}: {}", route.name, route.ends()),
        };
        let (route, source) = (Some(facts), Some(source));
        Way { title, is_service, route, source, destination, running, ..Way::default() }
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
    if address.middleware.starts_with("ros") && !address.name.starts_with('/') {
        address.name.insert(0, '/');
    }
    Ok(address)
}

type LeftOutName = Option<(String, wrapyfi_core::engine::LeftOut)>;

/// Route that a name means: by its name, its ends, or one of them; of a pattern the route that it makes for
/// the name, or the reason that it makes none.
fn route(plan: &Plan, index: &RouteIndex<'_>, name: &str) -> Option<(Route, LeftOutName)> {
    let named = plan.routes.iter().find(|route| route.name == name || route.ends() == name);
    if let Some(route) = named {
        return Some((route.clone(), None));
    }
    let address = address(name).ok()?;
    if let Some(route) = index.written_at(&address) {
        return Some((route.clone(), None));
    }
    let many = || {
        let many = plan.routes.iter().filter(|route| route.is_many());
        many.filter(|route| route.from.middleware == address.middleware)
    };
    for pattern in many() {
        if let Some(target) = pattern.target(&address.name) {
            let mut route = pattern.clone();
            (route.from, route.to, route.names) = (address, target, None);
            return Some((route, None));
        }
    }
    let left_out = |pattern: &Route| Some((pattern.clone(), pattern.left_out(&address.name)?));
    let (pattern, why) = many().find_map(left_out)?;
    Some((pattern, Some((address.to_string(), why))))
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
    let (_, dropped) = drops(running).find(|(reason, _)| *reason == DropReason::RateLimit)?;
    let dropped = dropped as f64 / running.received.max(dropped) as f64;
    Some(Limited { max_rate_hz, came_hz, dropped })
}

/// True where listening for a moment disturbs nobody: no port is opened, and nobody is told.
fn listens_on(middleware: &str) -> bool {
    middleware == "ros2" || middleware == "zeromq"
}

/// Type of a route at an end, as the middleware's endpoints tell theirs.
fn type_at(route: &Route, end: &EndpointAddress) -> Option<String> {
    if route.typing != Typing::Given || route.is_many() {
        return None;
    }
    let is_ros = is_ros(end);
    match route.kind {
        Kind::Service(kind) => is_ros.then(|| kind.ros_type().to_owned()),
        Kind::Topic(types) => {
            let one = if *end == route.from { types.from } else { types.to };
            match one {
                MessageType::Properties => None,
                one if is_ros => Some(one.ros_type().to_owned()),
                // Of other types nothing on the wire tells which it is.
                MessageType::NativeObject | MessageType::Image | MessageType::AudioChunk => {
                    Some(one.to_string())
                }
                _ => None,
            }
        }
    }
}

/// Type that a route in ROS gets from its source; none where that has no types, and a listener wants what its messages
/// may be read as.
fn shown(source: &End, destination: &End) -> Option<String> {
    let learned = source.learned.filter(|_| is_ros(&destination.address))?;
    let is_wanted = |one: &Discovered| {
        let known = one.type_name.as_ref()?.parse::<MessageType>();
        let wanted = known.map_or(DataType::RosMessage, MessageType::data_type);
        Some(may_be_read_as(learned.data_type(), wanted))
    };
    let is_untyped = source.address.middleware == yarp::NAME;
    let fits = destination.of(Role::Listener).any(|one| is_wanted(one) == Some(true));
    (!is_untyped || !fits).then(|| learned.ros_type().to_owned())
}

fn is_ros(end: &EndpointAddress) -> bool {
    matches!(end.middleware.as_str(), "ros" | "ros2")
}

/// Quality of service that a route lays down at an end.
fn qos_at(route: &Route, end: &EndpointAddress) -> Option<wrapyfi_core::endpoint::Qos> {
    if end.middleware != "ros2" || !matches!(route.kind, Kind::Topic(_)) {
        return None;
    }
    let spec = route.topic_spec_by(end, wrapyfi_core::middleware::ros2::follow_conventions);
    (!spec.match_peers).then(|| spec.pinned.apply(spec.qos))
}

/// Facts about an endpoint that no route of a file has.
fn of_address(address: &EndpointAddress, sight: Sight<'_>, mut types: TypeStore) -> Way {
    let wanted = Wanted {
        role: Role::Publisher,
        is_learned: true,
        listens: listens_on(&address.middleware),
        is_open: true,
        ..Wanted::new(address.clone(), false)
    };
    let end = look(sight, &wanted, &mut types);
    let is_service = end.is_service;
    Way { title: address.to_string(), is_service, source: Some(end), ..Way::default() }
}

/// Finds out about a name, from where the bridge runs and with what it runs.
///
/// # Errors
/// As [`Question::ask`].
pub(crate) fn explain(
    node: &Node,
    routes: &Applier,
    in_force: &Mutex<InForce>,
    name: &str,
) -> Result<Way, Failure> {
    let (registry, plan) = (routes.registry(), routes.plan());
    let in_force = in_force.lock().unwrap_or_else(PoisonError::into_inner).clone();
    let InForce { file, endpoints, definitions } = &in_force;
    let configured = Configured {
        file,
        plan: &plan,
        node,
        sight: Sight { endpoints, bridge: Some(&registry) },
        status: Some(&|| routes.status().iter().map(info::of).collect()),
    };
    configured.way(name, definitions::store(definitions)?)
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
        route(plan, &index(plan), name).map(|(route, left_out)| (route.ends(), left_out.is_some()))
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
        assert!(found(&plan, "ros:/raw").is_some_and(|(_, is_left_out)| is_left_out));
        assert_eq!(found(&plan, "yarp:/x"), None);
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
