//! Nodes of other middlewares as nodes of ROS 2: what is offered under the names of a node's parameters is that node's.
//!
//! ```text
//!   server of /x/list_parameters, …          ─▶ node /x on the graph, with this service
//!   publisher of events at /x/parameter_events ─▶ /parameter_events, as node /x tells them
//! ```
//!
//! `ros2 param` asks for a node first, and then for its services; who follows parameters hears one topic of all nodes.

use std::time::Instant;

use wrapyfi_interfaces::Message as _;
use wrapyfi_interfaces::rcl_interfaces::msg::ParameterEvent;

use super::node_endpoints::topic_of_events;
use super::publisher::Ros2Publisher;
use super::ros2::Ros2;
use wrapyfi_data::EncodeError;
use wrapyfi_data::types::{MessageType, Payload, RosMessage, ServiceKind};
use wrapyfi_endpoint::{
    Context, Link, OpenError, OpenResult, PublishError, Published, Publisher, Review, ServiceSpec,
    TopicSpec,
};
use wrapyfi_node::NodeName;
use wrapyfi_node::parameters::ParameterService;

/// The middleware for what stands for the node `name`; `None` where that is no node's name, or our own.
fn for_other(ros2: &Ros2, name: &str) -> OpenResult<Option<Ros2>> {
    let Some((namespace, base)) = name.rsplit_once('/') else { return Ok(None) };
    let namespace = if namespace.is_empty() { "/" } else { namespace };
    let Ok(node) = NodeName::new(base, namespace) else { return Ok(None) };
    if node == *ros2.graph.node() {
        return Ok(None);
    }
    let graph = ros2.graph.for_other(&node);
    let graph =
        graph.map_err(|error| OpenError::transport(super::NAME, name, error.to_string()))?;
    Ok(Some(ros2.for_other(graph)))
}

/// The middleware that a server is opened on: that of another node where it is one of the services of its parameters.
pub(super) fn of_server(ros2: &Ros2, spec: &ServiceSpec) -> OpenResult<Option<Ros2>> {
    let ServiceKind::Ros(service) = spec.kind else { return Ok(None) };
    let name = ros2.resolve(&spec.service)?;
    let Some((node, last)) = name.rsplit_once('/') else { return Ok(None) };
    let is_known = |it: &ParameterService| it.name() == last && it.type_name() == service.name();
    match ParameterService::ALL.iter().any(is_known) {
        true => for_other(ros2, node),
        false => Ok(None),
    }
}

/// Tells of changes of the parameters of another node.
pub(super) struct OtherNodeEvents {
    publisher: Ros2Publisher,
    node: String,
}

impl OtherNodeEvents {
    /// A publisher, where topic and type are those of another node's events.
    pub(super) fn open(
        ros2: &Ros2,
        spec: &TopicSpec,
        context: &Context,
    ) -> OpenResult<Option<Self>> {
        let MessageType::Ros(ros_type) = spec.message_type else { return Ok(None) };
        let name = ros2.resolve(&spec.topic)?;
        let node = name.strip_suffix("/parameter_events").filter(|node| !node.is_empty());
        let Some(node) = node.filter(|_| ros_type.name() == ParameterEvent::ROS_TYPE) else {
            return Ok(None);
        };
        let Some(other) = for_other(ros2, node)? else { return Ok(None) };
        let topic = topic_of_events();
        // The quality of service is that of all nodes' events, whatever a listener asks for.
        let spec = TopicSpec { qos: topic.qos, match_peers: false, ..spec.clone() };
        let publisher = Ros2Publisher::open(&other.graph, &other.names, &topic, &spec, context);
        let publisher = publisher.map_err(|error| super::transport(&spec, &error))?;
        Ok(Some(Self { publisher, node: node.to_owned() }))
    }
}

impl Publisher for OtherNodeEvents {
    /// Names of nodes differ between the middlewares: `/robot-1` there is `/robot_1` here.
    fn publish(&mut self, payload: &Payload) -> Published {
        let Payload::RosMessage(message) = payload else { return self.publisher.publish(payload) };
        let event = ParameterEvent::decode(&message.cdr, message.cdr.len());
        let event = event.map_err(|error| {
            let what = format!("a malformed {}: {error}", message.ros_type);
            PublishError::Encode(EncodeError::unrepresentable(
                "ROS 2",
                what,
                "look at its publisher",
            ))
        })?;
        let event = ParameterEvent { node: self.node.clone(), ..event };
        let cdr = event.encode();
        self.publisher.publish(&RosMessage::new(message.ros_type, cdr).into())
    }

    fn link(&self) -> Link {
        self.publisher.link()
    }

    fn review(&mut self, now: Instant) -> Review {
        self.publisher.review(now)
    }
}
