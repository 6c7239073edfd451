//! Registered methods over ROS 2: what every middleware must do, and what the options of ROS 2 do.

use std::sync::Arc;

use crate::communicator_common as common;
use wrapyfi_conformance::reserve_domain;
use wrapyfi_core::communicator::{CommunicatorContext, Mode, communicator};
use wrapyfi_node::NodeName;
use wrapyfi_ros2::{CycloneConfig, CycloneGraph, Ros2};

const MWARE: &str = "ros2";

/// Two nodes that hear each other, in a domain that no other test has. The second one is in a DDS stack of its own: within
/// one stack no byte would be on a wire.
fn contexts() -> (CommunicatorContext, CommunicatorContext) {
    let domain = reserve_domain();
    let id = u32::from(domain.number);
    let context = |name, domain_id, extra_uri| {
        let node = NodeName::new(name, "/robot").unwrap();
        let config = CycloneConfig { extra_uri, ..CycloneConfig::loopback(node, domain_id) };
        let graph = CycloneGraph::new(&config).unwrap();
        let ros2 = Ros2::new(Arc::new(graph), |topic| Ok(topic.to_owned()));
        CommunicatorContext::builder().only(Arc::new(ros2)).build()
    };
    let external = format!(
        "<CycloneDDS><Domain><Discovery><ExternalDomainId>{id}</ExternalDomainId></Discovery></Domain></CycloneDDS>"
    );
    let both = (context("here", id, None), context("there", 1000 + id, Some(external)));
    // Reserved until the process ends: each test has a process of its own.
    std::mem::forget(domain);
    both
}

#[test]
fn what_is_published_is_heard() {
    let (here, there) = contexts();
    common::what_is_published_is_heard(MWARE, &here, &there);
}

#[test]
fn transceive_meets_reemit() {
    let (here, there) = contexts();
    common::transceive_meets_reemit(MWARE, &here, &there);
}

#[test]
fn modes_change() {
    let (here, there) = contexts();
    common::modes_change(MWARE, &here, &there);
}

#[test]
fn a_request_is_replied() {
    let (here, there) = contexts();
    common::a_request_is_replied(MWARE, &here, &there);
}

#[test]
fn a_wait_ends_in_time() {
    common::a_wait_ends_in_time(MWARE, &contexts().0);
}

struct Speaker;

#[communicator]
impl Speaker {
    #[register(
        NativeObject,
        "ros2",
        "/speaker",
        timeout_ms = 30000,
        message_type = "std_msgs/msg/String",
        qos = "$qos",
        queue_size = 3
    )]
    fn say(&self, qos: &str) -> Vec<u8> {
        qos.as_bytes().to_vec()
    }
}

/// As Python Wrapyfi speaks on ROS 2, with a profile that is written.
#[test]
fn type_and_quality_of_service_can_be_written() {
    let (here, there) = contexts();
    let (mut ours, mut theirs) = (Speaker.communicator_in(&here), Speaker.communicator_in(&there));
    theirs.activate(SpeakerMethod::Say, Mode::Listen).unwrap();
    ours.activate(SpeakerMethod::Say, Mode::Publish).unwrap();
    let control = ours.control();
    std::thread::scope(|scope| {
        let said = scope.spawn(|| ours.say("latched").unwrap());
        while control.status(SpeakerMethod::Say).iter().all(|value| value.ends.is_empty()) {
            std::thread::yield_now();
        }
        let heard = theirs.say("latched").unwrap();
        assert_eq!(heard, said.join().unwrap());
        assert_eq!(heard.as_deref(), Some(&b"latched"[..]));
    });
    let error = ours.say("latched").map(drop);
    assert!(error.is_ok());
    ours.close();
    let error = ours.say("best").unwrap_err().to_string();
    assert!(
        error.contains("option qos is \"best\", and should be default, sensor_data"),
        "{error}"
    );
}
