//! The suite against ROS 2: two nodes on one wire, each in a DDS stack of its own; and its part about services against the
//! mapping of Fast DDS, of whose nodes the topics are the same.

use std::collections::BTreeMap;
use std::sync::Arc;

use wrapyfi_conformance::{Capabilities, TIMEOUT, Testbed, WireEnd, conformance_tests};
use wrapyfi_endpoint::codec::ros;
use wrapyfi_endpoint::{Middleware, ServiceSpec, TopicSpec, Wake};
use wrapyfi_ros2::graph::{
    CdrClient, CdrWriter, Graph, Peers, ServiceDescription, ServiceMapping, TopicDescription,
    wait_until,
};
use wrapyfi_ros2::{CycloneGraph, Ros2};

use crate::common::{bell, config};

struct Nodes<const FAST: bool> {
    raw: BTreeMap<String, Box<dyn CdrWriter>>,
    asking: Option<Box<dyn CdrClient>>,
    wild: Option<CycloneGraph>,
    near: Option<Ros2>,
    far: Option<Ros2>,
}

/// A node in the DDS stack of this number. Services of Fast DDS are on a wire also between nodes of one stack.
fn graph<const FAST: bool>(name: &str, stack: u32) -> CycloneGraph {
    let mut config = config(name, if FAST { 0 } else { stack });
    config.services = FAST.then_some(ServiceMapping::FastDds).or(config.services);
    CycloneGraph::new(&config).unwrap()
}

fn node<const FAST: bool>(side: WireEnd) -> Ros2 {
    let (name, stack) = if side == WireEnd::Near { ("near", 0) } else { ("far", 1) };
    Ros2::new(Arc::new(graph::<FAST>(name, stack)), |name| Ok(name.to_owned()))
}

/// A client of a foreign node, which knows of the service its name and type only; its server is there.
fn foreign_client(wild: &CycloneGraph, spec: &ServiceSpec) -> Box<dyn CdrClient> {
    let service = ServiceDescription {
        name: spec.service.clone(),
        type_name: spec.kind.ros_type().into(),
        type_hash: None,
        request_hash: None,
        response_hash: None,
        depth: 10,
        max_bytes: spec.limits.message_bytes,
    };
    let wake = Wake::new();
    let client = wild.client(&service, bell(&wake)).unwrap();
    assert!(wait_until(&wake, TIMEOUT, || { matches!(client.servers(), Peers::Ready(_)) }));
    client
}

/// A request with this body, little-endian.
fn send(client: &mut Box<dyn CdrClient>, body: &[u8]) {
    client.send(&[&[0, 1, 0, 0], body]).unwrap();
}

impl<const FAST: bool> Testbed for Nodes<FAST> {
    const CAPABILITIES: Capabilities =
        Capabilities { drops_large_replies_unread: true, ..Capabilities::FULL };

    fn start() -> Self {
        let (near, far) = (Some(node::<FAST>(WireEnd::Near)), Some(node::<FAST>(WireEnd::Far)));
        Self { raw: BTreeMap::new(), asking: None, wild: None, near, far }
    }

    fn side(&self, side: WireEnd) -> &dyn Middleware {
        match side {
            WireEnd::Near => self.near.as_ref().unwrap(),
            WireEnd::Far => self.far.as_ref().unwrap(),
        }
    }

    fn restart(&mut self, side: WireEnd) {
        let place = if side == WireEnd::Near { &mut self.near } else { &mut self.far };
        *place = None;
        *place = Some(node::<FAST>(side));
    }

    fn inject(&mut self, spec: &TopicSpec, body: &[u8]) {
        let wild = self.wild.get_or_insert_with(|| graph::<FAST>("wild", 2));
        let writer = self.raw.entry(spec.topic.clone()).or_insert_with(|| {
            let topic = TopicDescription {
                name: spec.topic.clone(),
                type_name: spec.message_type.ros_type().into(),
                type_hash: Some(ros::type_hash(spec.message_type).into()),
                qos: spec.qos,
                max_bytes: spec.limits.message_bytes,
                hears_own: false,
            };
            let wake = Wake::new();
            let writer = wild.advertise(&topic, bell(&wake)).unwrap();
            assert!(wait_until(&wake, TIMEOUT, || writer.matched() > 0));
            writer
        });
        writer.write(&[&[0, 1, 0, 0], body]).unwrap();
    }

    fn inject_request(&mut self, spec: &ServiceSpec, body: &[u8]) {
        let wild = self.wild.get_or_insert_with(|| graph::<FAST>("wild", 2));
        let client = self.asking.get_or_insert_with(|| foreign_client(wild, spec));
        send(client, body);
    }

    fn invalid_names() -> Vec<String> {
        ["", "/", "a b", "/a//b", "/a/", "~x", "/1a", "/a-b", "/\u{fc}", "{nope}/a", "{node"]
            .map(str::to_owned)
            .into_iter()
            .chain([format!("/{}", "a".repeat(247))])
            .collect()
    }
}

conformance_tests!(Nodes<false>);

#[cfg(feature = "fastdds-services")]
mod fast {
    use super::*;

    // Replies of this mapping have at most 128 KiB.
    conformance_tests! {
        services of Nodes<true>,
        known_faults {
            every_kind_is_returned: "is over the limit of 131072 bytes of the Fast DDS mapping",
        },
    }
}
