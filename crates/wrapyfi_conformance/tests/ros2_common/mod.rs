//! Functions that the two testbeds on ROS 2 share.

use std::sync::Arc;
use std::time::Duration;

use wrapyfi_endpoint::{ServiceSpec, Wake};
use wrapyfi_ros2::CycloneGraph;
use wrapyfi_ros2::graph::{CdrClient, Graph as _, Peers, ServiceDescription, wait_until};

/// A client of a foreign node, which knows of the service its name and type only; its server is there.
pub(crate) fn foreign_client(wild: &CycloneGraph, spec: &ServiceSpec) -> Box<dyn CdrClient> {
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
    let bell = wake.clone();
    let client = wild.client(&service, Arc::new(move || bell.ring())).unwrap();
    assert!(wait_until(&wake, Duration::from_secs(30), || {
        matches!(client.servers(), Peers::Ready(_))
    }));
    client
}

/// A request with this body, little-endian.
pub(crate) fn send(client: &mut Box<dyn CdrClient>, body: &[u8]) {
    client.send(&[&[0, 1, 0, 0], body]).unwrap();
}
