//! The suite against ROS 2: two nodes on one wire, each in a DDS stack of its own.
//!
//! Two nodes on one domain id of a process share Cyclone's local delivery; to have bytes on the
//! loopback the far one gets a domain of another id with the same external id.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use wrapyfi_conformance::{
    Capabilities, Domain, Testbed, WireEnd, conformance_tests, reserve_domain,
};
use wrapyfi_endpoint::codec::ros;
use wrapyfi_endpoint::{Middleware, ServiceSpec, TopicSpec, Wake};
use wrapyfi_node::NodeName;
use wrapyfi_ros2::graph::{CdrClient, CdrWriter, Graph, TopicDescription, wait_until};
use wrapyfi_ros2::{CycloneConfig, CycloneGraph, Ros2};

use crate::ros2_common::{foreign_client, send};

struct Nodes {
    raw: BTreeMap<String, Box<dyn CdrWriter>>,
    asking: Option<Box<dyn CdrClient>>,
    wild: Option<CycloneGraph>,
    near: Option<Ros2>,
    far: Option<Ros2>,
    domain: Domain,
}

fn graph(name: &str, domain: u32, stack: u32) -> CycloneGraph {
    let node = NodeName::new(name, "/conformance").unwrap();
    let mut config = CycloneConfig::loopback(node, 1000 * stack + domain);
    if stack > 0 {
        config.extra_uri = Some(format!(
            "<CycloneDDS><Domain><Discovery><ExternalDomainId>{domain}</ExternalDomainId>\
             </Discovery></Domain></CycloneDDS>"
        ));
    }
    CycloneGraph::new(&config).unwrap()
}

fn node(side: WireEnd, domain: u32) -> Ros2 {
    let (name, stack) = if side == WireEnd::Near { ("near", 0) } else { ("far", 1) };
    Ros2::new(Arc::new(graph(name, domain, stack)), |name| Ok(name.to_owned()))
}

impl Testbed for Nodes {
    const CAPABILITIES: Capabilities =
        Capabilities { drops_large_replies_unread: true, ..Capabilities::FULL };

    fn start() -> Self {
        let domain = reserve_domain();
        let (near, far) = (node(WireEnd::Near, domain.id), node(WireEnd::Far, domain.id));
        Self {
            raw: BTreeMap::new(),
            asking: None,
            wild: None,
            near: Some(near),
            far: Some(far),
            domain,
        }
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
        *place = Some(node(side, self.domain.id));
    }

    fn inject(&mut self, spec: &TopicSpec, body: &[u8]) {
        let wild = self.wild.get_or_insert_with(|| graph("wild", self.domain.id, 2));
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
            let bell = wake.clone();
            let writer = wild.advertise(&topic, Arc::new(move || bell.ring())).unwrap();
            assert!(wait_until(&wake, Duration::from_secs(30), || writer.matched() > 0));
            writer
        });
        writer.write(&[&[0, 1, 0, 0], body]).unwrap();
    }

    fn inject_request(&mut self, spec: &ServiceSpec, body: &[u8]) {
        let wild = self.wild.get_or_insert_with(|| graph("wild", self.domain.id, 2));
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

conformance_tests!(Nodes);
