//! Answer to "why does nothing flow": the first thing that is missing on the way from source to destination.
//!
//! ```text
//!   name ─ question ─▶ route or endpoint ─ look, each side by itself ─▶ Way: facts
//!                                                                       │ judge, pure
//!                                                                       ▼
//!                                             Diagnosis: what is in place, and the first Finding
//!
//!   actions  facts about the server of an action; action_steps: what it lacks
//!   drops    what the reasons of drops mean
//!   judge    facts -> diagnosis; reach: servers and addresses; state: a route that runs; words: ends and remedies;
//!            bridges: who runs the route; stopped: a bridge whose process is
//!   board    a robot that is served as a control board of YARP
//!   configured  what the configuration alone tells
//!   server_check  a server that has to answer first
//!   look     facts about one end
//!   elsewhere  the same name on ROS 2 in other domains
//!   ends     what a route lays down at an end
//!   meaning  the route that a name means
//!   question what is asked about
//!   running  what a bridge that runs tells of its routes
//! ```
//!
//! Looking opens no port and starts no broker; everything is asked side by side, and nothing for longer than
//! 1.4 s.

mod action_steps;
mod actions;
mod board;
pub(crate) mod bridges;
mod configured;
mod drops;
mod elsewhere;
mod ends;
mod fit;
pub mod judge;
pub mod look;
mod meaning;
pub mod question;
mod reach;
mod running;
pub mod server_check;
mod servers;
mod state;
pub(crate) mod stopped;
mod words;

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use serde::Serialize;
use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::{CauseCode, Discovered, EndpointAddress, Interaction, Qos, Role};
use wrapyfi_engine::LeftOut;
use wrapyfi_interfaces::wrapyfi_msgs::msg::{BridgeStatus, RouteInfo};
use wrapyfi_ros2::graph::ServiceMapping;

pub use self::actions::ActionTime;
use self::server_check::ServerCheck;

/// Longest time that looking at a side may take until it is judged by what is known.
const TIMEOUT: Duration = Duration::from_millis(1400);

/// Way of messages or calls, and what is known about it.
#[derive(Debug, Clone, Default)]
pub struct Way {
    /// The ends, in words.
    pub title: String,
    /// Interaction of messages or calls.
    pub interaction: Interaction,
    /// The route, where one was asked for.
    pub route: Option<RouteFacts>,
    /// End at which messages come in; the server of a service.
    pub source: Option<WayEnd>,
    /// End at which messages go out; `None` where an endpoint alone was asked for.
    pub destination: Option<WayEnd>,
    /// Control board of YARP, whose states the route carries.
    pub board: Option<Box<Board>>,
    /// Full name on ROS 2 of the node of the bridge that runs the route, or would.
    pub node: String,
    /// Status of the route in a bridge that runs it, or of the first route of a pattern that is not well.
    pub running: Option<RouteInfo>,
    /// Nodes of the further bridges in which the route is active.
    pub also: Vec<String>,
    /// Bridges on the graph of ROS 2 of which none has the route, by node; `None` where some may be
    /// unknown.
    pub others: Option<BTreeMap<String, BridgeStatus>>,
    /// Mapping of services of the bridges that have another than ours, by node.
    pub foreign: BTreeMap<String, ServiceMapping>,
    /// The finding that the bridge of the file is stopped, where none that answers has the route.
    pub stopped: Option<Finding>,
    /// Programs of this machine that are stopped while they have connections, by process.
    pub stopped_programs: Vec<(u32, String)>,
    /// Bridge and its pattern that matches a mere name which a program has, and makes no route of it.
    pub matched_without_route: Option<(String, String)>,
    /// Bridge and its pattern that would bring to a mere name which no program has, and the source that it would take.
    pub brought_by_pattern: Option<(String, String, EndpointAddress)>,
    /// Domain of ROS 2 in which a bridge has the route, and its node, where there is no bridge in the own.
    pub other_domain: Option<(u32, String)>,
    /// True where the parameters of the bridge's node made its routes, which stand in no file.
    pub is_of_parameters: bool,
    /// File of which no route means the endpoint that was asked for.
    pub without_route: Option<String>,
    /// Parts that are known to be in place before the walk.
    pub known: Vec<String>,
}

/// Facts about a route from its configuration.
#[derive(Debug, Clone, Default)]
pub struct RouteFacts {
    /// Name of the route.
    pub name: String,
    /// File of the configuration.
    pub file: String,
    /// Type of which this program has no definition, and the cause.
    pub undefined: Option<(String, String)>,
    /// Name that the pattern leaves out, and why.
    pub left_out: Option<(String, LeftOut)>,
    /// Limit of the pattern, and number of names that match.
    pub limit: Option<(usize, usize)>,
    /// Route of the same bridge that publishes where this one listens, and does not hear.
    pub unheard: Option<Unheard>,
    /// True where the bridge that runs the route looks; a command sees the endpoints of that bridge, too.
    pub is_own: bool,
    /// Node of a bridge that runs others of the file's routes, and the entry of this one for its `~/add_route`.
    pub taken_from: Option<(String, String)>,
    /// Limit of the rate, and the messages that it has left out.
    pub limited: Option<Limited>,
}

/// Limit of a route's rate, and what it does.
#[derive(Debug, Clone, Copy)]
pub struct Limited {
    /// Setting `max_rate_hz`.
    pub max_rate_hz: f64,
    /// Messages a second that came in while this program looked; `None` where the bridge runs elsewhere.
    pub came_hz: Option<f64>,
    /// Share of all messages since the start that the limit has left out, from 0 to 1.
    pub dropped: f64,
}

/// A route of the same bridge that this one does not hear.
#[derive(Debug, Clone)]
pub struct Unheard {
    /// Full name of the bridge's node on ROS 2.
    pub node: String,
    /// Both routes, and the remedy, in words.
    pub text: String,
    /// Addresses of a circle that the routes of the file make, from one back to itself.
    pub circle: Vec<String>,
}

/// One end of the way.
#[derive(Debug, Clone, Default)]
pub struct WayEnd {
    /// Address of the end.
    pub address: EndpointAddress,
    /// Type that the route has here, as `--type` has it.
    pub type_name: Option<String>,
    /// Type that the source of a route without a type of its own announces, or shows by its messages.
    pub learned: Option<MessageType>,
    /// True where messages carry no type, and the type of the end is what its name tells.
    pub is_untyped: bool,
    /// Fields that a route loses because the definitions of ROS 1 and ROS 2 differ, a sentence each.
    pub differences: Vec<String>,
    /// Quality of service that the route lays down; `None` where it follows its peers.
    pub qos: Option<Qos>,
    /// Servers that have to answer first, and whether they did.
    pub servers: Vec<ServerCheck>,
    /// Reason that the side does not work, in its own words.
    pub away: Option<String>,
    /// True where the look ended early, because another one had found what is missing: who is not there may be.
    pub is_cut: bool,
    /// True where that reason names what to mend: settings here, or those of what greets as ZeroMQ does.
    pub is_told: bool,
    /// Time after which a handshake with such a broker was not over.
    pub slow: Option<Duration>,
    /// Endpoints of the whole side.
    pub found: Vec<Discovered>,
    /// Mapping of services that servers of the name speak, and ours.
    pub foreign: Option<(ServiceMapping, ServiceMapping)>,
    /// Mapping of services that a client of the name speaks, and that of its servers, which is another.
    pub clients: Option<(ServiceMapping, ServiceMapping)>,
    /// True where the bridge that looks knows programs with the name, and the master or name server does not.
    pub is_unregistered: bool,
    /// Programs that the master or the name server lists under the name, with their addresses.
    pub registered: Vec<Registered>,
    /// Endpoints of the name that are found in another domain or range.
    pub elsewhere: Vec<Elsewhere>,
    /// Network of ROS 2.
    pub graph: Option<Graph>,
    /// Type that the source announces and of which this program has no definition, and the cause.
    pub undefined: Option<(String, String)>,
    /// Time for which this program listened and nothing came.
    pub silent: Option<Duration>,
    /// Event that the connection of who listened still waited for at the end.
    pub unconnected: Option<String>,
    /// Number of messages that came in that time.
    pub heard: u64,
    /// Number of names that match, of a pattern.
    pub names: Option<usize>,
    /// Interaction of those who have the name.
    pub interaction: Interaction,
    /// Time of the server of an action.
    pub action_time: ActionTime,
}

impl WayEnd {
    /// An end of which nothing is known yet.
    pub fn new(address: EndpointAddress) -> Self {
        Self { address, ..Self::default() }
    }

    /// True where the servers of the side answer, and it works.
    fn is_open(&self) -> bool {
        self.away.is_none()
            && self.servers.iter().all(|check| check.answer == server_check::ConnectOutcome::Open)
    }

    /// True where nothing listens any more at any address of a node: it was killed, and its name remains.
    fn was_killed(&self, node: &str) -> bool {
        let mut addresses = self.registered.iter().filter(|one| one.who == node).peekable();
        let is_refused = |one: &Registered| one.answer == server_check::ConnectOutcome::Refused;
        addresses.peek().is_some() && addresses.all(is_refused)
    }

    /// Endpoints of this name in a role.
    fn of(&self, role: Role) -> impl Iterator<Item = &Discovered> {
        let named = move |one: &&Discovered| one.name == self.address.name && one.role == role;
        self.found.iter().filter(named)
    }
}

/// Address at which an endpoint is to be reached.
#[derive(Debug, Clone)]
pub struct Registered {
    /// Role of the endpoint.
    pub role: Role,
    /// Node or port that has the address.
    pub who: String,
    /// Host that it announced.
    pub host: String,
    /// Port that it announced.
    pub port: u16,
    /// True where the server that told the address is on another machine.
    pub is_told_afar: bool,
    /// Outcome of a connection to the address.
    pub answer: server_check::ConnectOutcome,
}

/// An endpoint that exists where the route does not look.
#[derive(Debug, Clone)]
pub struct Elsewhere {
    /// Cause for which it is not found: another domain, or the range of discovery.
    pub cause: CauseCode,
    /// Place, in words: `domain 7`.
    pub place: String,
    /// Setting that leads there, in words.
    pub remedy: String,
    /// The endpoint.
    pub endpoint: Discovered,
}

/// Network of ROS 2 as this program sees it.
#[derive(Debug, Clone)]
pub struct Graph {
    /// DDS domain.
    pub domain_id: u32,
    /// Range of discovery, as `ROS_AUTOMATIC_DISCOVERY_RANGE` has it.
    pub range: &'static str,
    /// Setting that says the range.
    pub range_setting: &'static str,
    /// Command that lets the nodes of other machines be seen.
    pub widening: &'static str,
    /// Name of what carries the graph.
    pub carried_by: String,
    /// Hosts that others are looked for on and whose names do not resolve, a sentence each.
    pub unresolved: Vec<String>,
}

impl Graph {
    /// True where nodes of other machines are not seen.
    fn is_narrow(&self) -> bool {
        self.range != "SUBNET"
    }
}

/// A board, beside the way of its states.
#[derive(Debug, Clone, Default)]
pub struct Board {
    /// Address of the board.
    pub address: EndpointAddress,
    /// Its ports.
    pub ports: Vec<BoardPort>,
    /// Way of its movements.
    pub movements: Way,
}

/// A port of a board.
#[derive(Debug, Clone, Default)]
pub struct BoardPort {
    /// Name of the port.
    pub name: String,
    /// True where this port was asked about, or the whole board.
    pub is_asked: bool,
    /// True for a port that takes requests or commands.
    pub is_input: bool,
    /// Address that the name server has for it.
    pub at: Option<String>,
    /// Ports that are connected to it; `None` where it does not answer.
    pub connected: Option<Vec<String>>,
}

/// Result of the walk.
#[derive(Debug, Clone, Serialize)]
pub struct Diagnosis {
    /// The ends, in words.
    pub way: String,
    /// Parts that are in place, in the order of the way.
    pub passed: Vec<String>,
    /// The first thing that is missing; `None` where nothing is.
    #[serde(flatten)]
    pub finding: Option<Finding>,
}

/// The first thing that is missing.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Kind of the cause.
    pub cause: CauseCode,
    /// Cause in words.
    pub what: String,
    /// Person or program that could provide what is missing.
    pub who: String,
    /// Command or line that mends it.
    pub remedy: String,
}

/// Remedy for bridges whose nodes have the same name.
pub(crate) const OTHER_NODE: &str =
    "start one of them with another name: wrapyfi bridge … --ros-args -r __node:=OTHER";

/// Fault of two bridges with the same node, in words.
pub(crate) fn same_node(node: &str) -> String {
    format!(
        "another bridge has the node name {node}, too: whoever asks one of them, for its parameters or by \
         a service, hears the other"
    )
}

/// Result of one step along the way: nothing where all is in place.
type StepResult = Result<(), Finding>;

impl Finding {
    fn new(
        cause: CauseCode,
        what: String,
        who: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self { cause, what, who: who.into(), remedy: remedy.into() }
    }
}

impl fmt::Display for Diagnosis {
    /// Writes what is in place, a line each, and then the finding.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.way)?;
        for step in &self.passed {
            writeln!(f, "  ok       {step}")?;
        }
        match &self.finding {
            None => f.write_str("  nothing is missing"),
            Some(Finding { what, who, remedy, .. }) => {
                writeln!(f, "  MISSING  {what}")?;
                writeln!(f, "  who      {who}")?;
                write!(f, "  mend     {remedy}")
            }
        }
    }
}
