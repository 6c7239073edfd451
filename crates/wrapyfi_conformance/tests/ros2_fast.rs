//! Requests and replies of the suite against ROS 2 services as Fast DDS has them.
//!
//! The topics of these nodes are those of `tests/ros2.rs`: only what RustDDS carries is looked at.

use std::sync::Arc;

use wrapyfi_conformance::{
    Capabilities, Domain, Testbed, WireEnd, conformance_tests, reserve_domain,
};
use wrapyfi_endpoint::{Middleware, ServiceSpec};
use wrapyfi_node::NodeName;
use wrapyfi_ros2::graph::{CdrClient, ServiceMapping};
use wrapyfi_ros2::{CycloneConfig, CycloneGraph, Ros2};

use crate::ros2_common::{foreign_client, send};

struct FastNodes {
    asking: Option<Box<dyn CdrClient>>,
    wild: Option<CycloneGraph>,
    near: Option<Ros2>,
    far: Option<Ros2>,
    domain: Domain,
}

fn graph(name: &str, domain: u32) -> CycloneGraph {
    let node = NodeName::new(name, "/conformance").unwrap();
    let mut config = CycloneConfig::loopback(node, domain);
    config.services = Some(ServiceMapping::FastDds);
    CycloneGraph::new(&config).unwrap()
}

fn node(side: WireEnd, domain: u32) -> Ros2 {
    let name = if side == WireEnd::Near { "near" } else { "far" };
    Ros2::new(Arc::new(graph(name, domain)), |name| Ok(name.to_owned()))
}

impl Testbed for FastNodes {
    const CAPABILITIES: Capabilities =
        Capabilities { drops_large_replies_unread: true, ..Capabilities::FULL };

    fn start() -> Self {
        let domain = reserve_domain();
        let (near, far) = (node(WireEnd::Near, domain.id), node(WireEnd::Far, domain.id));
        Self { asking: None, wild: None, near: Some(near), far: Some(far), domain }
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

    fn inject_request(&mut self, spec: &ServiceSpec, body: &[u8]) {
        let wild = self.wild.get_or_insert_with(|| graph("wild", self.domain.id));
        let client = self.asking.get_or_insert_with(|| foreign_client(wild, spec));
        send(client, body);
    }
}

// Replies of this mapping have at most 128 KiB.
conformance_tests! {
    services of FastNodes,
    known_faults {
        every_kind_is_returned: "is over the limit of 131072 bytes of the Fast DDS mapping",
    },
}
