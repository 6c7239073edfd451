//! Facts about one end: the servers, the endpoints of the side, the addresses of those who have the name.
//!
//! ```text
//!   servers ─ closed: that is all    open ─▶ discovery until it has told, or TIMEOUT ─▶ End
//!                                            ├ ROS 1, YARP: addresses that were registered
//!                                            ├ ROS 2: mapping of services, other domains
//!                                            └ messages, where a program publishes
//! ```

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::driver::Purpose;
use wrapyfi_endpoint::{
    AnnouncedDurability, Context, Discovered, EndpointAddress, Interaction, LearnError, Learned,
    Middleware, QosPreset, Registry, Role, TopicSpec, Wake,
};
use wrapyfi_engine::RouteTypes;
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_ros1::Ros1;
use wrapyfi_ros2::environment::{self, DiscoveryRange};
use wrapyfi_ros2::graph;
use wrapyfi_ros2::{Ros2, unresolved_peers};
use wrapyfi_yarp::name::{NameClient, NameServerConf};
use wrapyfi_yarp::port::names::Registration;
use wrapyfi_yarp::port::{Network, NetworkOptions};

use super::server_check::{ConnectOutcome, ServerCheck, connect};
use super::{Graph, Registered, TIMEOUT, WayEnd, actions, elsewhere};
use crate::discovery_watch::DiscoveryWatch;
use crate::exit::{Failure, Result};
use crate::middlewares::{self, Endpoints, Observer, Server, conventions, described};
use crate::near_names::{beside, name_difference};
use crate::node::GRAPH;
use crate::on_graph::client::{mappings, only_foreign};

/// Time between two looks.
pub(super) const LOOK: Duration = Duration::from_millis(20);
/// Time after which a name that no program has in the own domain of ROS 2 is looked for in others, too: some nodes
/// answer a new one after a second.
const HERE_AT_FIRST: Duration = Duration::from_millis(200);
/// Time for which the names of nodes, and clients, are waited for: some tell theirs a second after their endpoints. What
/// is left of two seconds is for listening.
const NAMED_WITHIN: Duration = Duration::from_millis(1150);
/// Time for which it goes on, after [`TIMEOUT`], where endpoints still come: nodes tell of themselves slowly on a busy
/// machine.
const NEWS: Duration = Duration::from_millis(1000);
/// Time for which a ZeroMQ broker that has greeted is waited for after [`TIMEOUT`]: what is left of two seconds.
const SLOW: Duration = Duration::from_millis(400);
/// Time within which a broker tells what passes there, once it is reached.
const BROKER_TELLS_WITHIN: Duration = Duration::from_secs(1);
/// Time for which messages are listened for, at least.
pub(super) const LISTEN: Duration = Duration::from_millis(600);
/// Time that a look takes at most, with its listening: what is left of two seconds is for the rest of the command.
const MOST: Duration = Duration::from_millis(1750);
const _: () = {
    let named_and_heard = NAMED_WITHIN.as_millis() + LISTEN.as_millis();
    assert!(named_and_heard <= MOST.as_millis() && MOST.as_millis() + 250 <= 2000);
};
/// Most addresses of one name that are connected to.
const MAX_CONNECTED: usize = 8;

/// Question about one end.
#[derive(Debug, Clone)]
pub(super) struct Wanted {
    pub(super) address: EndpointAddress,
    /// Role of who has to be there.
    pub(super) role: Role,
    /// True where the type is what the source announces.
    pub(super) is_learned: bool,
    /// True where messages are to be listened for.
    pub(super) listens: bool,
    /// Types that a route has there by its configuration.
    pub(super) given: Option<RouteTypes>,
    /// True where the name may as well be that of a service.
    pub(super) is_open: bool,
}

impl Wanted {
    /// A question about who has the role.
    pub(super) fn new(address: EndpointAddress, role: Role) -> Self {
        let (is_learned, listens, given, is_open) = (false, false, None, false);
        Self { address, role, is_learned, listens, given, is_open }
    }

    /// True for a service or an action.
    fn is_called(&self) -> bool {
        self.role.interaction() != Interaction::Topic
    }

    /// True where a program has the name in the role.
    fn is_there(&self, end: &WayEnd) -> bool {
        end.found.iter().any(|one| self.is_met(one))
    }

    /// True where a program has the name in the role, and more is to be told of it: the name of a node, or who takes
    /// from it, where it is asked about by its mere name.
    fn is_half_told(&self, end: &WayEnd) -> bool {
        let lacks = |one: Interaction| {
            end.of(one.provider()).next().is_some() && end.of(one.taker()).next().is_none()
        };
        let is_alone = self.is_open && Interaction::ALL.into_iter().any(lacks);
        is_alone || end.found.iter().any(|one| self.is_met(one) && one.node.is_none())
    }

    /// True for an endpoint that has the name in the role.
    pub(super) fn is_met(&self, one: &Discovered) -> bool {
        let is_role = one.role == self.role || (self.is_open && one.role.is_provider());
        one.name == self.address.name && is_role
    }
}

/// Place from which a program looks: a command, or a bridge with the middlewares that it has.
#[derive(Clone, Copy)]
pub struct Sight<'s> {
    /// Settings of the middlewares.
    pub endpoints: &'s Endpoints,
    /// The middlewares of a bridge; those of a command are started for it.
    pub bridge: Option<&'s Registry>,
    /// ROS 2 of a command that looks at several places.
    pub ros2: Option<&'s Arc<Ros2>>,
    /// True once another look has found what is missing: no caller waits for the rest.
    pub is_answered: &'s AtomicBool,
}

impl<'s> Sight<'s> {
    /// A command's.
    pub fn of_command(endpoints: &'s Endpoints) -> Self {
        static NEVER: AtomicBool = AtomicBool::new(false);
        Self { endpoints, bridge: None, ros2: None, is_answered: &NEVER }
    }

    fn open(&self, middleware: &str) -> Result<Observer> {
        let of_bridge = self.bridge.and_then(|registry| registry.get(middleware).ok());
        match (of_bridge, self.ros2.filter(|_| middleware == GRAPH)) {
            // Who is registered at a master is what a node of its own asks.
            (Some(of_bridge), _) => {
                let ros1 = middlewares::ros1_observer(self.endpoints, middleware);
                Ok((Arc::clone(of_bridge), ros1.transpose().ok().flatten()))
            }
            (None, Some(ros2)) => Ok((Arc::clone(ros2) as Arc<dyn Middleware>, None)),
            (None, None) => middlewares::observer(self.endpoints, middleware),
        }
    }
}

/// Finds out about one end.
pub(super) fn look(sight: Sight<'_>, wanted: &Wanted, types: &mut TypeStore) -> WayEnd {
    let (endpoints, looked_since) = (sight.endpoints, Instant::now());
    let mut end = WayEnd::new(wanted.address.clone());
    let middleware = wanted.address.middleware.as_str();
    let habits = conventions(middleware);
    match endpoints.servers(middleware, wanted.role.interaction()) {
        Ok(servers) => {
            // Side by side: a name that does not resolve takes its time.
            end.servers = std::thread::scope(|scope| {
                let check =
                    |address| scope.spawn(move || ServerCheck::at(address, &endpoints.hosts));
                let checks: Vec<_> = servers.into_iter().map(check).collect();
                checks.into_iter().filter_map(|check| check.join().ok()).collect()
            });
        }
        Err(fault) => end.away = Some(fault.to_string()),
    }
    // A port of a broker is no use without the other: what has it may be none.
    if !end.is_open() {
        end.servers.iter_mut().for_each(ServerCheck::ask_kind);
    }
    // Services of ZeroMQ have no names to be found.
    if !end.is_open() || (!habits.has_service_names && wanted.is_called()) {
        let is_own = !end.is_open() && end.servers.iter().any(|check| check.address.is_own);
        let purpose = Purpose::Routes { has_services: false, is_reached: true };
        let config = || endpoints.plan(middleware, 0, purpose);
        // The bridge that would run the broker does not start with the settings here.
        if is_own && let Err(fault) = config() {
            (end.servers, end.away, end.is_told) = (Vec::new(), Some(fault.to_string()), true);
        }
        return end;
    }
    end.graph = (middleware == GRAPH).then(|| graph(endpoints));
    let opened = sight.open(middleware).map_err(|fault| {
        end.is_told = matches!(fault, Failure::Usage(_));
        fault.to_string()
    });
    let discovered = opened.and_then(|(observer, ros1)| {
        let discovery = observer.discover().map_err(|fault| fault.to_string())?;
        Ok((observer, ros1, discovery))
    });
    let (observer, ros1, mut discovery) = match discovered {
        Ok(discovered) => discovered,
        Err(fault) => {
            end.away = Some(fault);
            return end;
        }
    };
    end.is_untyped = observer.routing_properties().untyped;
    if let (Some(graph), Some(carrier)) = (&mut end.graph, discovery.carried_by()) {
        carrier.clone_into(&mut graph.carried_by);
    }
    let meant = wanted.address.name.clone();
    discovery
        .only(Box::new(move |other| other == meant || name_difference(&meant, other).is_some()));
    // From when the side is open: on a busy machine that takes a while, too.
    let begin = Instant::now();
    let deadline = begin + end.graph.as_ref().map_or(TIMEOUT, timeout);
    let servers = end.servers.clone();
    // A broker with much to do is slow with a handshake, too.
    let is_slow = || deadline.elapsed() < SLOW && servers.iter().all(ServerCheck::has_greeted);
    let is_over = || {
        let is_late = Instant::now() >= deadline;
        sight.is_answered.load(Relaxed) || (is_late && (servers.is_empty() || !is_slow()))
    };
    // Until all is told: who is missing is as telling as who is there.
    let mut side = DiscoveryWatch::new(discovery);
    let is_sought = middleware == GRAPH && wanted.role != Role::Client;
    let mut seen = watch(&mut end, &mut side, |end, told| {
        let is_late = is_sought && begin.elapsed() >= HERE_AT_FIRST && !wanted.is_there(end);
        let is_named = !is_sought || begin.elapsed() >= NAMED_WITHIN || !wanted.is_half_told(end);
        (told && is_named) || is_late || is_over()
    });
    if let (Some(graph), Ok(())) = (end.graph.clone(), &seen)
        && is_sought
        && !wanted.is_there(&end)
    {
        // Some nodes answer after a second; meanwhile it is looked for elsewhere, until this is over.
        let is_there = AtomicBool::new(false);
        let is_over = || is_there.load(Relaxed) || is_over();
        std::thread::scope(|scope| {
            let far =
                scope.spawn(|| elsewhere::look(&endpoints.ros2(), &graph, wanted, false, &is_over));
            seen = watch(&mut end, &mut side, |end, told| {
                let is_met = wanted.is_there(end);
                is_there.fetch_or(is_met, Relaxed);
                let is_named = begin.elapsed() >= NAMED_WITHIN || !wanted.is_half_told(end);
                // While others still tell of themselves, it may be among them.
                let late = Instant::now().checked_duration_since(deadline);
                let is_late = late.is_some_and(|late| told || graph.is_narrow() || late >= NEWS);
                sight.is_answered.load(Relaxed) || is_late || (is_met && told && is_named)
            });
            end.elsewhere = far.join().unwrap_or_default();
        });
    }
    if let Some(graph) = &mut end.graph {
        graph.unresolved = unresolved_peers();
    }
    end.is_cut = sight.is_answered.load(Relaxed);
    // A broker that has refused the connection is not slow.
    let has_failed = side.has_told_all();
    drop(side);
    if let Err(fault) = seen {
        let is_broker = !end.servers.is_empty() && end.servers.iter().all(ServerCheck::has_greeted);
        let is_slow = is_broker && !has_failed && begin.elapsed() >= TIMEOUT;
        end.slow = is_slow.then(|| begin.elapsed());
        (end.away, end.is_told) = (Some(fault), is_broker);
        return end;
    }
    tidy(&mut end);
    let mut wanted = wanted.clone();
    if let Some(interaction) = called_as(&end).filter(|_| wanted.is_open) {
        (wanted.role, end.interaction) = (interaction.provider(), interaction);
    }
    let wanted = &wanted;
    addresses(&mut end, endpoints, ros1.as_deref());
    if let (Some(ros2), true) = (sight.ros2, middleware == GRAPH && wanted.role == Role::Server) {
        mapping(&mut end, ros2.graph().as_ref());
    }
    // The master of ROS 1 does not tell the types of services: their servers do.
    if wanted.is_learned || (wanted.is_called() && ros1.is_some()) {
        learn(&mut end, observer.as_ref(), wanted, types);
    }
    if wanted.role == Role::ActionServer {
        let until = (looked_since + MOST).min(Instant::now() + LISTEN);
        let (observer, ros1) = (observer.as_ref(), ros1.as_deref());
        end.action_time = actions::time_of_server(&end, observer, ros1, types, until);
    }
    if let Some(ros1) = ros1 {
        end.differences = differences(&end, &ros1, wanted, types);
    }
    if wanted.listens {
        if end.of(Role::Publisher).next().is_some() {
            listen(&mut end, observer.as_ref(), types, looked_since + MOST);
        } else if !habits.shows_publishers {
            listen_beside(&mut end, observer.as_ref(), looked_since + MOST);
        }
    }
    if wanted.is_there(&end) || end.is_cut {
        end.elsewhere.clear();
    }
    end
}

/// Looks as far as multicast reaches for a program that is missing where this program sees less; true where it did. An
/// end of the domain that is open in this process would have it see as little as that.
pub(super) fn widen(endpoints: &Endpoints, wanted: &Wanted, end: &mut WayEnd) -> bool {
    let is_missing = wanted.role != Role::Client && !wanted.is_there(end) && !end.is_cut;
    let Some(graph) = end.graph.as_ref().filter(|graph| is_missing && graph.is_narrow()) else {
        return false;
    };
    let until = Instant::now() + elsewhere::WIDE;
    let is_over = || Instant::now() >= until;
    end.elsewhere.extend(elsewhere::look(&endpoints.ros2(), graph, wanted, true, &is_over));
    true
}

/// Time for which the own domain is looked at: as much is left for [`widen`] as it takes.
pub(super) fn timeout(graph: &Graph) -> Duration {
    if graph.is_narrow() { TIMEOUT - elsewhere::WIDE } else { TIMEOUT }
}

/// Network of ROS 2 as this program sees it.
pub(super) fn graph(endpoints: &Endpoints) -> Graph {
    let environment = environment::read(|name| std::env::var(name).ok());
    let (domain_id, range) = match &environment {
        Ok(read) => (read.domain_id, read.discovery.range),
        Err(_) => (0, DiscoveryRange::default()),
    };
    let is_local = std::env::var("ROS_LOCALHOST_ONLY").is_ok_and(|value| value == "1");
    let range_setting = match is_local {
        true => "ROS_LOCALHOST_ONLY=1",
        false if range == DiscoveryRange::Off => "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF",
        false => "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST",
    };
    // The older variable goes before the other one.
    let widening = match is_local {
        true => "unset ROS_LOCALHOST_ONLY",
        false => "export ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET",
    };
    let (domain_id, range) = (endpoints.ros2().domain_id(domain_id), range.word());
    Graph {
        domain_id,
        range,
        range_setting,
        widening,
        carried_by: String::new(),
        unresolved: vec![],
    }
}

/// Looks until `is_over`, which is told whether the side has told all.
fn watch(
    end: &mut WayEnd,
    side: &mut DiscoveryWatch,
    mut is_over: impl FnMut(&WayEnd, bool) -> bool,
) -> Result<(), String> {
    let wake = Wake::new();
    let begin = Instant::now();
    let mut reached = None;
    loop {
        side.look().map_err(|error| error.to_string())?;
        end.found.clone_from(&side.found);
        let waits = side.discovery.waiting_for();
        // A server that accepts connections may need a moment to answer.
        let told = side.has_told_all() && waits.is_none();
        if waits.is_none() {
            reached.get_or_insert_with(Instant::now);
        }
        if is_over(end, told) || begin.elapsed() >= TIMEOUT + NEWS {
            let is_new = reached.is_some_and(|at| at.elapsed() < BROKER_TELLS_WITHIN);
            return match waits {
                Some(what) => Err(format!("no answer from {what}")),
                // Its table would have come, or what passes on one that has no table.
                None if is_new
                    && !told
                    && !conventions(&end.address.middleware).shows_publishers =>
                {
                    Err("no word from the broker of what passes there".to_owned())
                }
                None => Ok(()),
            };
        }
        wake.wait(LOOK);
    }
}

/// Interaction of the service or action, and of no topic, that has the name, or else one that is nearly it.
fn called_as(end: &WayEnd) -> Option<Interaction> {
    let name = &end.address.name;
    let with = |interaction: Interaction, is_meant: &dyn Fn(&str) -> bool| {
        end.found.iter().any(|one| one.role.interaction() == interaction && is_meant(&one.name))
    };
    let topic = Interaction::Topic;
    let is_it = |other: &str| other == name;
    let is_near = |other: &str| name_difference(name, other).is_some();
    let is_called = |interaction: &Interaction| {
        let has_parts = *interaction == Interaction::Action && actions::has_parts(end);
        has_parts
            || with(*interaction, &is_it)
            || (with(*interaction, &is_near) && !with(topic, &is_near))
    };
    let mut called = [Interaction::Action, Interaction::Service].into_iter().filter(is_called);
    called.next().filter(|_| !with(topic, &is_it))
}

/// Names as routes and commands have them: ours of ROS 2 are no foreign endpoints, and frames on ZeroMQ
/// that look like a compressed image are one of the two kinds of images.
fn tidy(end: &mut WayEnd) {
    let is_guessed = !conventions(&end.address.middleware).shows_publishers;
    for one in &mut end.found {
        if is_guessed && one.type_name.as_deref() == Some("CompressedImage") {
            one.type_name = Some("Image".to_owned());
        }
    }
}

/// Addresses that were registered under the name, and whether a program is there.
fn addresses(end: &mut WayEnd, endpoints: &Endpoints, ros1: Option<&Ros1>) {
    let is_afar = end.servers.iter().any(|check| !check.is_here);
    let name = end.address.name.clone();
    let mut all = match ros1 {
        Some(ros1) => match ros1.registered(&name) {
            Ok(found) => found
                .into_iter()
                .map(|one| (one.role, one.node, one.host, one.port))
                .collect::<Vec<_>>(),
            Err(_) => Vec::new(),
        },
        None => {
            let roles = [Role::Publisher, Role::Server, Role::Listener];
            let there = roles.iter().find_map(|role| end.of(*role).next());
            let role = there.map_or(Role::Publisher, |one| one.role);
            // A calibration has no port of its own.
            let owner = there.and_then(|one| one.node.clone()).unwrap_or_else(|| name.clone());
            let is_provided = there.is_some() && role != Role::Listener;
            let Ok(found) = port(&owner, &end.servers, endpoints) else { return };
            end.is_unregistered = is_provided && found.is_none();
            found.into_iter().map(|(host, port)| (role, owner.clone(), host, port)).collect()
        }
    };
    // Nodes that were killed: their names remain, and discovery leaves them out.
    for (role, node, ..) in &all {
        let is_known = end.of(*role).next().is_some();
        if !is_known {
            let one = Discovered { node: Some(node.clone()), ..Discovered::new(&name, *role) };
            end.found.push(one);
        }
    }
    all.truncate(MAX_CONNECTED);
    end.registered = std::thread::scope(|scope| {
        let checks: Vec<_> = all
            .into_iter()
            .map(|(role, who, host, port)| {
                scope.spawn(move || {
                    let answer = match connect(&host, port, &endpoints.hosts) {
                        ConnectOutcome::Open if !answers(ros1, &who, &host, port, endpoints) => {
                            ConnectOutcome::AcceptsOnly
                        }
                        answer => answer,
                    };
                    Registered { role, who, host, port, is_told_afar: is_afar, answer }
                })
            })
            .collect();
        checks.into_iter().filter_map(|check| check.join().ok()).collect()
    });
}

/// True where the program that accepts connections at a registered address answers: on ROS 1 the API of the node, else
/// the port of YARP.
fn answers(ros1: Option<&Ros1>, node: &str, host: &str, port: u16, endpoints: &Endpoints) -> bool {
    match ros1 {
        Some(ros1) => ros1.answers_within(LISTEN, node),
        None => {
            let host = endpoints.hosts.resolve(host).map_or(host.to_owned(), |ip| ip.to_string());
            let at = Registration { name: String::new(), host, port, carrier: "tcp".to_owned() };
            let known = Arc::new(move |_name: &str| Some(at.clone()));
            let network = Network::new(NetworkOptions { known, ..NetworkOptions::default() });
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
            let asked = async { tokio::time::timeout(LISTEN, network.exists("")).await };
            runtime.is_ok_and(|runtime| runtime.block_on(asked) == Ok(true))
        }
    }
}

/// Address under which YARP's name server, one of `servers`, has a port; an error where it says nothing in time.
pub(super) fn port(
    name: &str,
    servers: &[ServerCheck],
    endpoints: &Endpoints,
) -> Result<Option<(String, u16)>, ()> {
    let server = servers.iter().find(|check| check.address.server == Server::NameServer);
    let Some(ServerCheck { address, .. }) = server else { return Err(()) };
    let conf = NameServerConf { host: address.host.clone(), port: address.port };
    let client = NameClient::new(conf)
        .with_hosts(endpoints.hosts.iter().map(|(host, ip)| (host.to_owned(), ip)))
        .with_timeout(LISTEN);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let found = runtime.map_err(drop)?.block_on(client.query(name)).map_err(drop)?;
    Ok(found.map(|found| (found.host, found.port)))
}

/// Mapping of the servers, where all of them have another than this node, and that of a client whom no server
/// understands.
fn mapping(end: &mut WayEnd, ros2: &dyn graph::Graph) {
    let of = |is_client| mappings(ros2, &end.address.name, is_client);
    let (ours, servers) = (ros2.service_mapping(), of(false));
    let first = servers.first().copied();
    let client = of(true).into_iter().find(|one| servers.iter().all(|it| it != one));
    end.foreign = only_foreign(ours, &servers).zip(ours);
    end.clients = client.zip(first);
}

/// Type that is announced or shown, and its definition.
fn learn(end: &mut WayEnd, middleware: &dyn Middleware, wanted: &Wanted, types: &mut TypeStore) {
    let Some(one) = end.of(wanted.role).next().cloned() else { return };
    let learn = |types: &mut TypeStore| match wanted.role.interaction() {
        Interaction::Service => {
            let kind = middleware.learn_service(&one, types);
            kind.map(|kind| (Some(kind.ros_type().to_owned()), None))
        }
        Interaction::Action => {
            let kind = middleware.learn_action(&one, types);
            kind.map(|kind| (Some(kind.name().to_owned()), None))
        }
        Interaction::Topic => {
            let told = middleware.learn_topic(&one, types);
            told.map(|told| (None, Some(told.message_type(false))))
        }
    };
    let begin = Instant::now();
    let mut learned = learn(types);
    while matches!(learned, Err(LearnError::Asked(_))) && begin.elapsed() < LISTEN {
        std::thread::sleep(LOOK);
        learned = learn(types);
    }
    if matches!(learned, Err(LearnError::Undefined { .. })) {
        described(middleware, &one, types);
        learned = learn(types);
    }
    let shown = match learned {
        Ok((shown, learned)) => {
            end.learned = learned;
            shown
        }
        Err(LearnError::Undefined { type_name, reason }) => {
            end.undefined = wanted.is_learned.then(|| (type_name.clone(), reason));
            Some(type_name)
        }
        Err(_) => None,
    };
    for one in end.found.iter_mut().filter(|one| wanted.is_met(one)) {
        one.type_name = one.type_name.take().or_else(|| shown.clone());
    }
}

/// Fields that a route loses there because the definitions of ROS 1 and ROS 2 differ.
fn differences(end: &WayEnd, ros1: &Ros1, wanted: &Wanted, types: &mut TypeStore) -> Vec<String> {
    // A publisher shows its definition when it is asked for its type.
    let shown = end.of(wanted.role).next().and_then(|one| match wanted.role.interaction() {
        Interaction::Service => ros1.learn_service(one, types).ok().map(RouteTypes::Service),
        Interaction::Action => None,
        Interaction::Topic => {
            let begin = Instant::now();
            let mut told = ros1.learn_topic(one, types);
            while matches!(told, Err(LearnError::Asked(_))) && begin.elapsed() < LISTEN {
                std::thread::sleep(LOOK);
                told = ros1.learn_topic(one, types);
            }
            Some(RouteTypes::Topic(told.ok()?.message_type(true).into()))
        }
    });
    match wanted.given.or(shown) {
        Some(RouteTypes::Topic(carried)) => {
            ros1.with_types(|types| wrapyfi_ros1::differences::of_topic(types, carried.to))
        }
        Some(RouteTypes::Service(kind)) => {
            ros1.with_types(|types| wrapyfi_ros1::differences::of_service(types, kind))
        }
        Some(RouteTypes::Action(_)) | None => Vec::new(),
    }
}

/// Listens until `until`, for a while at most, to the name with a slash more or less: a publisher of ZeroMQ sends, and
/// shows, only what a program is subscribed to.
fn listen_beside(end: &mut WayEnd, middleware: &dyn Middleware, until: Instant) {
    let spec = TopicSpec::new(beside(&end.address.name), MessageType::NativeObject);
    let context = Context::default();
    let Ok(mut listener) = middleware.open_listener(&spec, &context) else { return };
    let until = until.min(Instant::now() + LISTEN);
    while Instant::now() < until {
        if listener.discard() {
            end.found.push(Discovered::new(&spec.topic, Role::Publisher));
            return;
        }
        context.wake.wait(LOOK);
    }
}

/// Listens for a while, until `until` where nothing comes, where that tells anything: a publisher that keeps its last
/// message sends seldom.
fn listen(end: &mut WayEnd, middleware: &dyn Middleware, types: &mut TypeStore, until: Instant) {
    let keeps = |one: &Discovered| {
        one.qos.is_some_and(|qos| qos.durability != AnnouncedDurability::Volatile)
    };
    let publishers: Vec<_> = end.of(Role::Publisher).cloned().collect();
    let Some(one) = publishers.first() else { return };
    if publishers.iter().any(keeps) {
        return;
    }
    let Ok(learned) = middleware.learn_topic(one, types) else { return };
    let message_type = match learned {
        Learned::Ros(_) => learned.message_type(true),
        Learned::Wrapyfi(known) => known,
    };
    let spec = TopicSpec {
        qos: QosPreset::SensorData.into(),
        ..TopicSpec::new(end.address.name.clone(), message_type)
    };
    let context = Context::default();
    let Ok(mut listener) = middleware.open_listener(&spec, &context) else { return };
    let begin = Instant::now();
    let until = until.max(begin + LISTEN);
    while Instant::now() < until && end.heard == 0 {
        while listener.discard() {
            end.heard += 1;
        }
        context.wake.wait(LOOK);
    }
    end.silent = Some(begin.elapsed());
    end.unconnected = listener.link().waiting_for.map(|it| it.to_string());
}
