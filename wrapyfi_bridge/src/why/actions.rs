//! Facts about the server of an action.
//!
//! ```text
//!   some of the five parts ─▶ of one node alone?          a second publisher of the status ─▶ all goals are lost
//!   use_sim_time ─▶ does anybody publish /clock?          stamps of the status ─▶ do the clocks agree?
//! ```

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use wrapyfi_data::types::{Map, Payload, RosMessage, RosService, ServiceKind, Value};
use wrapyfi_endpoint::{
    Context, Discovered, LearnError, Middleware, Request, Role, ServiceSpec, TopicSpec,
};
use wrapyfi_interfaces::Message as _;
use wrapyfi_interfaces::rcl_interfaces::srv::{GetParameters, GetParameters_Response};
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_ros1::Ros1;

use super::WayEnd;
use crate::middlewares::is_ros;
use crate::node::GRAPH;

/// Time that the server's node has to tell a parameter.
const TOLD_WITHIN: Duration = Duration::from_millis(300);
/// Most bytes of an answer or of a status array that are read.
const MAX_BYTES: usize = 16 << 20;
/// Difference between two clocks from which on it is told, in seconds.
pub(super) const MOST_APART_S: f64 = 2.0;
/// Time between two looks for a status.
const LOOK: Duration = Duration::from_millis(20);
/// Topic of simulated time.
pub(super) const CLOCK: &str = "/clock";
const STATUS: &str = "actionlib_msgs/GoalStatusArray";
const CANCEL: &str = "actionlib_msgs/GoalID";

/// Facts about the time of an action's server.
#[derive(Debug, Clone, Default)]
pub struct ActionTime {
    /// Node whose `use_sim_time` is true, or the master of ROS 1.
    pub simulated_by: Option<String>,
    /// True where somebody publishes `/clock`.
    pub has_clock: bool,
    /// Seconds by which the clock of a server on ROS 1 is ahead of the one here.
    pub ahead_s: Option<f64>,
}

/// The parts of a server: words behind the name of the action, and its role in them.
pub(super) fn parts(middleware: &str) -> [(&'static str, Role); 5] {
    match middleware {
        GRAPH => [
            ("/_action/send_goal", Role::Server),
            ("/_action/cancel_goal", Role::Server),
            ("/_action/get_result", Role::Server),
            ("/_action/feedback", Role::Publisher),
            ("/_action/status", Role::Publisher),
        ],
        _ => [
            ("/goal", Role::Listener),
            ("/cancel", Role::Listener),
            ("/status", Role::Publisher),
            ("/feedback", Role::Publisher),
            ("/result", Role::Publisher),
        ],
    }
}

/// True for an endpoint that nothing but an action has: the names of its topics on ROS 1 are those of others, too.
fn is_sure(one: &Discovered, middleware: &str) -> bool {
    middleware == GRAPH || [Some(STATUS), Some(CANCEL)].contains(&one.type_name.as_deref())
}

/// Node that has some parts of a server, and the words of those that it has; `None` where one has all.
pub(super) fn half(end: &WayEnd) -> Option<(Option<String>, BTreeSet<&'static str>)> {
    let address = &end.address;
    // Of a node that the master alone knows, the type is not told.
    let is_whole = |one: &Discovered| one.type_name.is_some();
    if !is_ros(address) || end.of(Role::ActionServer).any(is_whole) {
        return None;
    }
    let (mut nodes, mut sure) = (BTreeMap::<_, BTreeSet<_>>::new(), BTreeSet::new());
    for (word, role) in parts(&address.middleware) {
        let name = format!("{}{word}", address.name);
        for one in end.found.iter().filter(|one| one.role == role && one.name == name) {
            nodes.entry(one.node.clone()).or_default().insert(word);
            if is_sure(one, &address.middleware) {
                sure.insert(one.node.clone());
            }
        }
    }
    let surely = nodes.into_iter().filter(|one| sure.contains(&one.0));
    surely.max_by_key(|(_, words)| words.len())
}

/// True where a program has parts of an action of this name.
pub(super) fn has_parts(end: &WayEnd) -> bool {
    half(end).is_some()
}

/// Endpoints that publish the status of an action on ROS 1.
pub(super) fn statuses(end: &WayEnd) -> impl Iterator<Item = &Discovered> {
    let name = format!("{}/status", end.address.name);
    let is_it = move |one: &&Discovered| {
        one.name == name && one.role == Role::Publisher && one.type_name.as_deref() == Some(STATUS)
    };
    end.found.iter().filter(is_it)
}

/// Looks at the time of the server that an end has.
pub(super) fn time_of_server(
    end: &WayEnd,
    middleware: &dyn Middleware,
    ros1: Option<&Ros1>,
    types: &mut TypeStore,
    until: Instant,
) -> ActionTime {
    let Some(server) = end.of(Role::ActionServer).next() else { return ActionTime::default() };
    let is_clock = |one: &Discovered| one.name == CLOCK && one.role == Role::Publisher;
    let has_clock = end.found.iter().any(is_clock);
    let simulated_by = match ros1 {
        Some(ros1) => ros1.simulates_time().then(|| "the ROS 1 master".to_owned()),
        None => server.node.clone().filter(|node| is_simulated(middleware, node) == Some(true)),
    };
    let ahead_s = ros1
        .filter(|_| simulated_by.is_none())
        .and_then(|_| ahead(statuses(end).next()?, middleware, types, until));
    ActionTime { simulated_by, has_clock, ahead_s }
}

/// Parameter `use_sim_time` of a node of ROS 2; `None` where it does not tell.
fn is_simulated(middleware: &dyn Middleware, node: &str) -> Option<bool> {
    let kind = ServiceKind::Ros(RosService::of::<GetParameters>().ok()?);
    let spec = ServiceSpec::new(format!("{node}/get_parameters"), kind);
    let mut client = middleware.open_client(&spec, &Context::default()).ok()?;
    let names = Value::List(vec![Value::from("use_sim_time")]);
    let request = Request::default().with(Map::from([("names", names)]));
    let reply = client.call(&request, TOLD_WITHIN).ok()?;
    let Payload::RosMessage(message) = &reply.payload else { return None };
    let reply = GetParameters_Response::decode(&message.cdr, MAX_BYTES).ok()?;
    reply.values.first().map(|value| value.bool_value)
}

/// Seconds by which the stamps of status arrays are ahead of the clock here: of the last that came until then, unless one
/// agrees.
fn ahead(
    status: &Discovered,
    middleware: &dyn Middleware,
    types: &mut TypeStore,
    until: Instant,
) -> Option<f64> {
    let mut learned = middleware.learn_topic(status, types);
    while matches!(learned, Err(LearnError::Asked(_))) && Instant::now() < until {
        std::thread::sleep(LOOK);
        learned = middleware.learn_topic(status, types);
    }
    let learned = learned.ok()?;
    let spec = TopicSpec::new(status.name.clone(), learned.message_type(true));
    let context = Context::default();
    let mut listener = middleware.open_listener(&spec, &context).ok()?;
    let mut last = None;
    while Instant::now() < until {
        while let Ok(Some(sample)) = listener.take() {
            let Payload::RosMessage(message) = &sample.payload else { continue };
            let now = SystemTime::now().duration_since(UNIX_EPOCH).ok()?.as_secs_f64();
            last = stamp(message).map(|stamp| stamp - now);
            if last.is_some_and(|ahead| ahead.abs() < MOST_APART_S) {
                return last;
            }
        }
        context.wake.wait(LOOK);
    }
    last
}

/// Stamp of a message's header in seconds.
fn stamp(message: &RosMessage) -> Option<f64> {
    let fields = message.fields(MAX_BYTES).ok()?;
    let part = |name: &str| fields.get(name)?.as_integer();
    Some(part("header.stamp.sec")? as f64 + part("header.stamp.nanosec")? as f64 / 1e9)
}
