//! A robot of ROS 2 that is served as a control board of YARP: its two routes, its ports, and who is connected to them.
//!
//! ```text
//!   ros2:/joint_states ─▶ states ─▶ [ yarp:/arm: rpc:i, command:i, state:o, stateExt:o ] ─▶ movements ─▶ ros2:/…/joint_trajectory
//! ```

use std::sync::Arc;

use wrapyfi_endpoint::{CauseCode, EndpointAddress};
use wrapyfi_engine::{Plan, Route};
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_interfaces::wrapyfi_msgs::msg::RouteInfo;
use wrapyfi_yarp::Value;
use wrapyfi_yarp::port::names::Registration;
use wrapyfi_yarp::port::{Network, NetworkOptions};
use wrapyfi_yarp_endpoint as yarp;

use crate::on_graph::info::cause;

use super::look::{LISTEN, port};
use super::question::Configured;
use super::server_check::ServerCheck;
use super::{Board, BoardPort, Finding, RouteFacts, StepResult, Way};
use crate::middlewares::Endpoints;

/// Routes of a board, and the end of the name of its port that is meant.
pub(super) struct Routes<'p> {
    pub(super) states: &'p Route,
    pub(super) movements: &'p Route,
    pub(super) asked: Option<&'static str>,
}

/// End of the name of a board's port, where `address` is one of the board at `board`.
fn end_of_port(address: &EndpointAddress, board: &EndpointAddress) -> Option<&'static str> {
    let ends = yarp::BOARD_PORTS.into_iter().filter(|_| address.middleware == board.middleware);
    ends.into_iter().find(|end| format!("{}{end}", board.name) == address.name)
}

/// Board of a plan that a name means: its name, its address, that of one of its ports, or one of its routes.
pub(super) fn of_name<'p>(
    plan: &'p Plan,
    name: &str,
    address: Option<&EndpointAddress>,
) -> Option<Routes<'p>> {
    let all = || plan.routes.iter().filter(|one| one.serves_board());
    let is_named =
        |one: &Route| one.name == name || one.ends() == name || one.board_name() == Some(name);
    let is_end = |one: &Route| address.is_some_and(|it| one.from == *it || one.to == *it);
    let pair = |board: &EndpointAddress| {
        Some((all().find(|it| it.to == *board)?, all().find(|it| it.from == *board)?))
    };
    let of_one = |one: &Route| pair(&one.to).or_else(|| pair(&one.from));
    if let Some(one) = all().find(|one| is_named(one) || is_end(one)) {
        let (states, movements) = of_one(one)?;
        return Some(Routes { states, movements, asked: None });
    }
    let (one, end) = all().find_map(|one| Some((one, end_of_port(address?, &one.to)?)))?;
    let (states, movements) = of_one(one)?;
    Some(Routes { states, movements, asked: Some(end) })
}

/// True for a route to a board whose port has the address.
pub(super) fn is_of_port(one: &RouteInfo, address: &EndpointAddress) -> bool {
    let board = one.resolved_destination.parse::<EndpointAddress>();
    board.is_ok_and(|board| end_of_port(address, &board).is_some())
}

/// Route of states, among those of a bridge, of the board whose port has the address.
pub(super) fn of_port(all: &[RouteInfo], address: &EndpointAddress) -> Option<RouteInfo> {
    let states = all.iter().find(|one| is_of_port(one, address))?;
    // A plain route to YARP is none.
    let is_back = |one: &RouteInfo| one.resolved_source == states.resolved_destination;
    all.iter().any(is_back).then(|| states.clone())
}

impl Configured<'_> {
    /// Facts about a board: its two routes and its ports, side by side.
    pub(super) fn of_board(&self, routes: &Routes<'_>, types: &mut TypeStore) -> Way {
        let Routes { states, movements, asked } = routes;
        let facts = |route: &Route| RouteFacts {
            name: route.name.clone(),
            file: self.file.to_owned(),
            is_own: self.status.is_some(),
            ..RouteFacts::default()
        };
        let address = states.to.clone();
        let (way, movements_way) = std::thread::scope(|scope| {
            let mut none = TypeStore::empty();
            let moves = scope.spawn(move || self.of_route(movements, facts(movements), &mut none));
            let way = self.of_route(states, facts(states), types);
            (way, moves.join().unwrap_or_default())
        });
        let servers = way.destination.as_ref().map(|end| end.servers.as_slice());
        let ports = ports(&address, *asked, servers.unwrap_or_default(), self.sight.endpoints);
        let title = format!(
            "{address}{}: control board; states from {}, movements to {}",
            asked.unwrap_or_default(),
            states.from,
            movements.to
        );
        let board = Some(Box::new(Board { address, ports, movements: movements_way }));
        Way { title, board, ..way }
    }
}

/// Looks at the ports of a board.
fn ports(
    board: &EndpointAddress,
    asked: Option<&str>,
    servers: &[ServerCheck],
    endpoints: &Endpoints,
) -> Vec<BoardPort> {
    let look = |end: &'static str| {
        let name = format!("{}{end}", board.name);
        let is_asked = asked.is_none_or(|it| it == end);
        let is_input = yarp::BOARD_INPUTS.contains(&end);
        let found = port(&name, servers, endpoints).ok().flatten();
        let at = found.map(|(host, port)| {
            let host = endpoints.hosts.resolve(&host).map_or(host, |ip| ip.to_string());
            Registration { name: name.clone(), host, port, carrier: "tcp".to_owned() }
        });
        let contact = at.as_ref().map(Registration::contact);
        let connected = at.and_then(|at| connections(&name, at, is_input));
        BoardPort { name, is_asked, is_input, at: contact, connected }
    };
    std::thread::scope(|scope| {
        let looks = yarp::BOARD_PORTS.map(|end| scope.spawn(move || look(end)));
        looks.into_iter().filter_map(|look| look.join().ok()).collect()
    })
}

/// Programs that are connected to a port, by the names that they tell; `None` where it does not answer.
fn connections(name: &str, at: Registration, is_input: bool) -> Option<Vec<String>> {
    /// Name of those that ask such questions, as we do.
    const ASKS: &str = "admin";
    let known = Arc::new(move |_name: &str| Some(at.clone()));
    let network = Network::new(NetworkOptions { known, ..NetworkOptions::default() });
    let request = ["list", if is_input { "in" } else { "out" }].map(Value::vocab);
    let request = request.into_iter().collect();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().ok()?;
    let asked = async { tokio::time::timeout(LISTEN, network.admin(name, &request)).await };
    let told = runtime.block_on(asked).ok()?.ok()?;
    let names = told.into_iter().filter_map(|value| value.as_str().map(str::to_owned));
    Some(names.filter(|name| name != ASKS).collect())
}

impl Board {
    /// True where who is asked about takes part in movements.
    pub(super) fn moves(&self) -> bool {
        self.ports.iter().any(|port| port.is_asked && port.is_input)
    }

    /// The ports as the name server has them: those that are open, in words.
    pub(super) fn open(&self, node: &str) -> Result<Vec<String>, Finding> {
        let mut open = Vec::new();
        for BoardPort { name, at, connected, .. } in &self.ports {
            let Some(at) = at else {
                let what = format!("the YARP name server has no port {name}");
                let remedy = format!(
                    "look in the log of {node}; a name server that was started anew is told within seconds"
                );
                return Err(Finding::new(CauseCode::NobodyOffers, what, "the bridge", remedy));
            };
            let Some(connected) = connected else {
                let what = format!("{name} is registered at {at}, and nobody answers there");
                let remedy = format!("end what has the name, then: yarp name unregister {name}");
                let who = "the program that has registered it";
                return Err(Finding::new(CauseCode::PeerUnreachable, what, who, remedy));
            };
            let clients = match connected.is_empty() {
                true => "nobody is connected".to_owned(),
                false => format!("connected: {}", connected.join(", ")),
            };
            open.push(format!("{name} at {at} answers; {clients}"));
        }
        Ok(open)
    }

    /// A program who is connected to a port that was asked about.
    pub(super) fn has_clients(&self) -> StepResult {
        let mut asked = self.ports.iter().filter(|port| port.is_asked);
        let nobody = |port: &BoardPort| port.connected.as_ref().is_none_or(Vec::is_empty);
        if !asked.clone().all(nobody) {
            return Ok(());
        }
        let only = asked.next().filter(|_| asked.next().is_none());
        let name = only.map_or(&self.address.name, |port| &port.name);
        let what = format!("the board is open, and no client is connected to {name}");
        let remedy = match only.is_some_and(|port| !port.is_input) {
            true => format!("yarp read ... {name}"),
            false => format!(
                "yarp rpc {}{}; or open remote_controlboard with --remote {0}",
                self.address.name,
                yarp::BOARD_PORTS.first().unwrap_or(&"")
            ),
        };
        let who = "a client: remote_controlboard, yarpmotorgui, yarp rpc";
        Err(Finding::new(CauseCode::NobodyListens, what, who, remedy))
    }
}

/// True where the route of a board waits for clients alone.
pub(super) fn lacks_clients(way: &Way) -> bool {
    way.running.as_ref().is_some_and(|it| cause(it) == Some(CauseCode::NobodyCalls))
}
