//! Nodes that only the test hears which started them, and messages between them.
//!
//! ```text
//!   near, far ─▶ loopback, a domain that is reserved for the test ─▶ near and far hear each other, no one else hears them
//! ```
//!
//! Two nodes on one domain id of a process share Cyclone's local delivery; to have bytes on the
//! loopback the far one gets a domain of another id with the same external id.

pub mod bodies;

use std::sync::Arc;

use wrapyfi_conformance::{Reserved, reserve_domain};
use wrapyfi_endpoint::{Qos, Wake};
use wrapyfi_node::NodeName;
use wrapyfi_ros2::graph::{
    CdrReader, CdrSample, CdrWriter, Graph, GraphError, Notify, TopicDescription, wait_until,
};
use wrapyfi_ros2::{CycloneConfig, CycloneGraph};

pub use wrapyfi_conformance::TIMEOUT;
pub const HASH: &str = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";

/// Domain of the test that runs on this thread.
pub fn domain() -> u32 {
    thread_local!(static TEST: Reserved = reserve_domain());
    TEST.with(|domain| domain.number.into())
}

pub fn name(name: &str) -> NodeName {
    NodeName::new(name, "/robot").unwrap()
}

/// A node on the wire of a test, in the DDS stack of this number.
pub fn config(node: &str, stack: u32) -> CycloneConfig {
    let domain = domain();
    let mut config = CycloneConfig::loopback(name(node), 1000 * stack + domain);
    if stack > 0 {
        config.extra_uri =
            Some(discovery(&format!("<ExternalDomainId>{domain}</ExternalDomainId>")));
    }
    config
}

pub fn near_config(node: &str) -> CycloneConfig {
    config(node, 0)
}

pub fn far_config(node: &str) -> CycloneConfig {
    config(node, 1)
}

/// A configuration source with these settings of discovery.
pub fn discovery(settings: &str) -> String {
    format!("<CycloneDDS><Domain><Discovery>{settings}</Discovery></Domain></CycloneDDS>")
}

pub fn near(node: &str) -> CycloneGraph {
    CycloneGraph::new(&near_config(node)).unwrap()
}

pub fn far(node: &str) -> CycloneGraph {
    CycloneGraph::new(&far_config(node)).unwrap()
}

/// A topic of strings.
pub fn topic(name: &str) -> TopicDescription {
    TopicDescription {
        name: name.into(),
        type_name: "std_msgs/msg/String".into(),
        type_hash: Some(HASH.into()),
        qos: Qos::default(),
        max_bytes: 64 << 20,
        hears_own: false,
    }
}

pub fn bell(wake: &Wake) -> Notify {
    let wake = wake.clone();
    Arc::new(move || wake.ring())
}

pub struct Ends {
    pub wake: Wake,
    pub writer: Box<dyn CdrWriter>,
    pub reader: Box<dyn CdrReader>,
}

/// A writer in one node, a reader in the other, matched.
pub fn connect(from: &dyn Graph, to: &dyn Graph, topic: &TopicDescription) -> Ends {
    let wake = Wake::new();
    let writer = from.advertise(topic, bell(&wake)).unwrap();
    let reader = to.subscribe(topic, bell(&wake)).unwrap();
    assert!(wait_until(&wake, TIMEOUT, || writer.matched() == 1 && reader.matched() == 1));
    Ends { wake, writer, reader }
}

pub fn next(reader: &mut dyn CdrReader, wake: &Wake) -> CdrSample {
    let mut sample = None;
    assert!(wait_until(wake, TIMEOUT, || {
        sample = reader.take().unwrap();
        sample.is_some()
    }));
    sample.unwrap()
}

/// Header, length, text and its NUL.
pub fn message(text: &[u8]) -> Vec<Vec<u8>> {
    let length = u32::try_from(text.len() + 1).unwrap().to_le_bytes();
    vec![vec![0, 1, 0, 0], length.to_vec(), text.to_vec(), vec![0]]
}

pub fn write(writer: &mut dyn CdrWriter, text: &[u8]) -> Result<(), GraphError> {
    let message = message(text);
    let parts: Vec<&[u8]> = message.iter().map(Vec::as_slice).collect();
    writer.write(&parts)
}

/// The text of a message; what a stack pads it with is zeros.
pub fn text(sample: &CdrSample) -> Vec<u8> {
    let cdr = &sample.cdr;
    assert_eq!(cdr[..4], [0, 1, 0, 0]);
    let length = u32::from_le_bytes(cdr[4..8].try_into().unwrap()) as usize;
    assert!(cdr[8 + length - 1..].iter().all(|&byte| byte == 0), "NUL and zero padding");
    cdr[8..8 + length - 1].to_vec()
}

pub fn pattern(bytes: usize) -> Vec<u8> {
    (0..bytes).map(|n| u8::try_from(n % 251).unwrap() + 1).collect()
}
