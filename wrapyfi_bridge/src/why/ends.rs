//! Route at its ends: the types and the quality of service that it has there, and its entry in a file.

use wrapyfi_data::types::{DataType, MessageType};
use wrapyfi_endpoint::{Discovered, EndpointAddress, Interaction, Role};
use wrapyfi_engine::{Route, RouteTypes, Typing, may_be_read_as};

use super::WayEnd;
use crate::middlewares::{conventions, is_ros};
use crate::node::GRAPH;

/// True where listening for a moment disturbs no program: no port is opened, and no server is told.
pub(super) fn listens_on(middleware: &str) -> bool {
    conventions(middleware).name_service.is_none()
}

/// Type that the configuration gives a route at an end, as `--type` has it.
pub(super) fn type_at(route: &Route, end: &EndpointAddress) -> Option<String> {
    if route.typing != Typing::Given || route.is_many() {
        return None;
    }
    Some(match route.types {
        RouteTypes::Service(kind) => kind.ros_type().to_owned(),
        RouteTypes::Action(kind) => kind?.name().to_owned(),
        RouteTypes::Topic(types) => match if *end == route.from { types.from } else { types.to } {
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
pub(super) fn type_of_messages(source: &WayEnd, destination: &WayEnd) -> Option<String> {
    let learned = source.learned.filter(|_| is_ros(&destination.address))?;
    let is_wanted = |one: &Discovered| {
        let known = one.type_name.as_ref()?.parse::<MessageType>();
        let wanted = known.map_or(DataType::RosMessage, MessageType::data_type);
        Some(may_be_read_as(learned.data_type(), wanted))
    };
    let fits = destination.of(Role::Listener).any(|one| is_wanted(one) == Some(true));
    (!source.is_untyped || !fits).then(|| learned.ros_type().to_owned())
}

/// Quality of service that a route lays down at an end.
pub(super) fn qos_at(route: &Route, end: &EndpointAddress) -> Option<wrapyfi_endpoint::Qos> {
    if end.middleware != GRAPH || route.interaction() != Interaction::Topic {
        return None;
    }
    let spec = route.topic_spec_by(end, wrapyfi_ros2::follow_conventions);
    (!spec.match_peers).then(|| spec.pinned.apply(spec.qos))
}

/// Entry of `routes` with the ends of a route.
pub(super) fn entry(route: &Route) -> String {
    let [from, to] = route.interaction().keys();
    format!("{{{from}: {:?}, {to}: {:?}}}", route.from.to_string(), route.to.to_string())
}
