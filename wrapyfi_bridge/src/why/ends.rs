//! Route at its ends: the types and the quality of service that it has there, and its entry in a file.

use wrapyfi_data::types::{DataType, MessageType};
use wrapyfi_endpoint::{Discovered, EndpointAddress, Role};
use wrapyfi_engine::{Kind, Route, Typing, may_be_read_as};
use wrapyfi_yarp_endpoint as yarp;

use super::End;
use crate::middlewares::is_ros;

/// True where listening for a moment disturbs nobody: no port is opened, and nobody is told.
pub(super) fn listens_on(middleware: &str) -> bool {
    middleware == "ros2" || middleware == "zeromq"
}

/// Type that the configuration gives a route at an end, as `--type` has it.
pub(super) fn type_at(route: &Route, end: &EndpointAddress) -> Option<String> {
    if route.typing != Typing::Given || route.is_many() {
        return None;
    }
    Some(match route.kind {
        Kind::Service(kind) => kind.ros_type().to_owned(),
        Kind::Topic(types) => match if *end == route.from { types.from } else { types.to } {
            one if is_ros(end) && one != MessageType::Properties => one.ros_type().to_owned(),
            one => one.to_string(),
        },
    })
}

/// True for a type that the endpoints of a middleware tell: of others nothing on the wire tells which it is.
pub(super) fn is_told(given: &str, end: &EndpointAddress) -> bool {
    match given.parse() {
        Ok(MessageType::Properties) => false,
        Ok(MessageType::NativeObject | MessageType::Image | MessageType::AudioChunk) => true,
        _ => is_ros(end),
    }
}

/// Type that a route in ROS gets from its source; none where that has no types, and a listener wants what its messages
/// may be read as.
pub(super) fn type_of_messages(source: &End, destination: &End) -> Option<String> {
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

/// Quality of service that a route lays down at an end.
pub(super) fn qos_at(route: &Route, end: &EndpointAddress) -> Option<wrapyfi_endpoint::Qos> {
    if end.middleware != "ros2" || !matches!(route.kind, Kind::Topic(_)) {
        return None;
    }
    let spec = route.topic_spec_by(end, wrapyfi_ros2::follow_conventions);
    (!spec.match_peers).then(|| spec.pinned.apply(spec.qos))
}

/// Entry of `routes` with the ends of a route.
pub(super) fn entry(route: &Route) -> String {
    let (from, to) = match route.kind {
        Kind::Topic(_) => ("from", "to"),
        Kind::Service(_) => ("service", "as"),
    };
    format!("{{{from}: {:?}, {to}: {:?}}}", route.from.to_string(), route.to.to_string())
}
