//! Nodes that only the tests of this process hear, and messages between them.
//!
//! ```text
//!   near, far ─▶ loopback, domain 1 to 100, tag of this process ─▶ near and far hear each other,
//!                                                                  nobody else hears them
//! ```
//!
//! Two nodes on one domain id of a process share Cyclone's local delivery; to have bytes on the
//! loopback the far one gets a domain of another id with the same external id.

pub mod bodies;

use std::process;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::sync::{Arc, LazyLock};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use wrapyfi_endpoint::{Qos, Wake};
use wrapyfi_node::NodeName;
use wrapyfi_ros2::graph::{
    CdrReader, CdrSample, CdrWriter, Graph, GraphError, Notify, TopicDescription, wait_until,
};
use wrapyfi_ros2::{CycloneConfig, CycloneGraph};

/// Long enough for the slowest machine; reached only by failures.
pub const TIMEOUT: Duration = Duration::from_secs(30);
pub const HASH: &str = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";

/// Discovery ignores participants with another tag, so that runs at the same time, even on one
/// domain, do not hear each other. The time is for processes of one id in several containers.
pub static TAG: LazyLock<String> = LazyLock::new(|| {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos();
    format!("wrapyfi_test_{}_{now}", process::id())
});

/// Domain of the test that runs on this thread. Those of a process differ, those of processes at the same
/// time mostly do, which keeps the 33 ports of a domain free; ports above domain 100 are ephemeral.
pub fn domain() -> u32 {
    static TESTS: AtomicU32 = AtomicU32::new(0);
    thread_local!(static TEST: u32 = TESTS.fetch_add(1, Relaxed));
    1 + TEST.with(|test| process::id().wrapping_mul(37).wrapping_add(*test)) % 100
}

pub fn name(name: &str) -> NodeName {
    NodeName::new(name, "/robot").unwrap()
}

/// A node on the domain of a test.
pub fn near_config(node: &str) -> CycloneConfig {
    let mut config = CycloneConfig::loopback(name(node), domain());
    config.extra_uri = Some(discovery(&format!("<Tag>{}</Tag>", *TAG)));
    config
}

/// A node on the same wire as the near ones of a test, in a stack of its own.
pub fn far_config(node: &str) -> CycloneConfig {
    let domain_id = domain();
    let mut config = CycloneConfig::loopback(name(node), 1000 + domain_id);
    config.extra_uri = Some(discovery(&format!(
        "<ExternalDomainId>{domain_id}</ExternalDomainId><Tag>{}</Tag>",
        *TAG
    )));
    config
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
