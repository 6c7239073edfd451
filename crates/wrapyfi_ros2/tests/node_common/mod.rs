//! A node with parameters and everything else that nodes have, and another that asks it.
//!
//! ```text
//!   Offering { NodeEndpoints } ◀── loopback, a domain of the test ──▶ Asking { clients, listeners }
//! ```

use std::collections::BTreeMap;
use std::sync::Arc;

use serde_json::{Value, json};
use wrapyfi_data::types::{MessageType, Payload, RosMessage, RosService, RosType, ServiceKind};
use wrapyfi_endpoint::{Context, Listener, Middleware, Qos, Request, ServiceSpec, TopicSpec, Wake};
use wrapyfi_interfaces::store::{ResolvedType, TypeStore};
use wrapyfi_node::parameters::{ParameterDescriptor, ParameterStore};
use wrapyfi_ros2::graph::{DiscoveredEndpoint, Graph, wait_until};
use wrapyfi_ros2::{CycloneConfig, CycloneGraph, NodeEndpoints, Ros2};

use crate::common::{TIMEOUT, far_config, near_config};

pub const MAX_BYTES: usize = 1 << 20;
/// Time in seconds that is earlier than the clock of any system.
pub const LONG_AGO: i32 = 1_500_000_000;

/// A node and what it offers.
pub struct Offering {
    pub graph: CycloneGraph,
    pub node: NodeEndpoints,
}

impl Offering {
    pub fn new(config: &CycloneConfig) -> Self {
        let graph = CycloneGraph::new(config).unwrap();
        let mut store = ParameterStore::new(graph.node(), BTreeMap::new()).unwrap();
        let rate = ParameterDescriptor::new("rate")
            .with_description("Images per second")
            .with_integer_range(1, 60, 1);
        store.declare(rate, 10).unwrap();
        store.declare(ParameterDescriptor::new("serial").read_only(), "A1").unwrap();
        store.declare(ParameterDescriptor::new("lens.label"), "left").unwrap();
        let shared: Arc<dyn Graph> = Arc::new(graph.clone());
        let node = NodeEndpoints::start(&shared, store, None).unwrap();
        Self { graph, node }
    }
}

/// Another node, which knows the types that ours knows.
pub struct Asking {
    pub graph: CycloneGraph,
    pub ros2: Ros2,
    pub types: TypeStore,
    pub asked: String,
}

impl Asking {
    pub fn new(config: &CycloneConfig, asked: &Offering) -> Self {
        let graph = CycloneGraph::new(config).unwrap();
        let ros2 = Ros2::new(Arc::new(graph.clone()), |name| Ok(name.to_owned()));
        let asked = asked.graph.node().fqn();
        Self { graph, ros2, types: TypeStore::generated(), asked }
    }

    pub fn resolved(&mut self, name: &str) -> ResolvedType {
        self.types.resolve_name(name).unwrap()
    }

    /// The reply of one of the node's services.
    pub fn ask(&mut self, service: &str, type_name: &str, request: &Value) -> Value {
        let kind = RosService::new(&self.resolved(type_name)).unwrap();
        let name = format!("{}/{service}", self.asked);
        let spec = ServiceSpec::new(&name, ServiceKind::Ros(kind));
        let mut client = self.ros2.open_client(&spec, &Context::default()).unwrap();
        let request = kind.request().plan().from_json(request, MAX_BYTES).unwrap();
        let request = RosMessage::from_fields(kind.request(), &request).unwrap();
        fields(client.call(&Request::Message(request), TIMEOUT).unwrap().payload)
    }

    pub fn list(&mut self, prefixes: &[&str], depth: u64) -> Value {
        let request = json!({"prefixes": prefixes, "depth": depth});
        self.ask("list_parameters", "rcl_interfaces/srv/ListParameters", &request)["result"].take()
    }

    pub fn get(&mut self, names: &[&str]) -> Value {
        let request = json!({"names": names});
        self.ask("get_parameters", "rcl_interfaces/srv/GetParameters", &request)["values"].take()
    }

    /// Result for each parameter: set, or the reason that it was not.
    pub fn set(&mut self, parameters: &[Value]) -> Value {
        let request = json!({"parameters": parameters});
        self.ask("set_parameters", "rcl_interfaces/srv/SetParameters", &request)["results"].take()
    }

    /// Opens an end of a topic of a ROS type.
    pub fn topic(&mut self, topic: &str, type_name: &str, qos: Qos) -> TopicSpec {
        let ros_type = RosType::new(&self.resolved(type_name)).unwrap();
        TopicSpec { qos, ..TopicSpec::new(topic, MessageType::Ros(ros_type)) }
    }

    pub fn listen(&mut self, topic: &str, type_name: &str, qos: Qos) -> (Box<dyn Listener>, Wake) {
        let context = Context::default();
        let spec = self.topic(topic, type_name, qos);
        (self.ros2.open_listener(&spec, &context).unwrap(), context.wake)
    }

    /// Endpoints of the other participant, without that of `ros_discovery_info`.
    pub fn endpoints_of(&self, other: &Offering) -> Vec<DiscoveredEndpoint> {
        let mut found = self.graph.endpoints().unwrap();
        found.retain(|endpoint| {
            endpoint.gid[..12] == other.graph.gid()[..12]
                && endpoint.dds_topic != "ros_discovery_info"
        });
        found
    }
}

pub fn pair() -> (Offering, Asking) {
    let offering = Offering::new(&near_config("camera"));
    let asking = Asking::new(&far_config("tool"), &offering);
    (offering, asking)
}

/// The fields of a message of a ROS type.
pub fn fields(payload: Payload) -> Value {
    let Payload::RosMessage(message) = payload else { panic!("{payload:?}") };
    message.fields(MAX_BYTES).unwrap().to_json()
}

pub fn next(listener: &mut dyn Listener, wake: &Wake) -> Value {
    let mut taken = None;
    assert!(wait_until(wake, TIMEOUT, || {
        taken = listener.take().unwrap();
        taken.is_some()
    }));
    fields(taken.unwrap().payload)
}

pub fn boolean(name: &str, value: bool) -> Value {
    json!({"name": name, "value": {"type": 1, "bool_value": value}})
}

pub fn integer(name: &str, value: i64) -> Value {
    json!({"name": name, "value": {"type": 2, "integer_value": value}})
}

pub fn text(name: &str, value: &str) -> Value {
    json!({"name": name, "value": {"type": 4, "string_value": value}})
}

pub fn ok() -> Value {
    json!({"successful": true, "reason": ""})
}

pub fn refused(reason: &str) -> Value {
    json!({"successful": false, "reason": reason})
}
