//! Services of the Fast DDS mapping in tests: ours, those of ros2-client, and bare RustDDS.
//!
//! ```text
//!   Ours (RustServices) ◀── loopback, a domain of the test ──▶ Peer (ros2-client), Bare (RustDDS)
//! ```

use std::net::Ipv4Addr;
use std::time::Duration;

use ros2_client::ActionTypeName;
use ros2_client::action::{
    ActionClient, ActionClientQosPolicies, ActionServer, ActionServerQosPolicies,
};
use ros2_client::qos::{Durability, History, QosProfile, WhenFull};
use ros2_client::{Client, Message, Name, Node, NodeOptions, Server, ServiceMapping};
use ros2_client::{Context, ServiceTypeName};
use rustdds::no_key::{DataReader, DataWriter};
use rustdds::{
    CDRDeserializerAdapter, CDRSerializerAdapter, DomainParticipant, DomainParticipantBuilder,
    Publisher, QosPolicies, QosPolicyBuilder, Subscriber, Topic, TopicKind, policy,
};
use serde::{Deserialize, Serialize};
use wrapyfi_conformance::until;
use wrapyfi_endpoint::Wake;
use wrapyfi_ros2::graph::{
    CdrClient, CdrReply, CdrRequest, CdrServer, GraphError, Peers, ServiceDescription, wait_until,
};
use wrapyfi_ros2::{CycloneConfig, RustServices};

use crate::common::{TIMEOUT, bell, domain, name};

/// `example_interfaces/srv/AddTwoInts`, request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Add {
    pub a: i64,
    pub b: i64,
}
impl Message for Add {}

/// Response of the service.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sum {
    pub sum: i64,
}
impl Message for Sum {}

pub fn add_two_ints() -> ServiceDescription {
    ServiceDescription {
        name: "/add_two_ints".into(),
        type_name: "example_interfaces/srv/AddTwoInts".into(),
        type_hash: None,
        request_hash: None,
        response_hash: None,
        depth: 10,
        max_bytes: 1 << 20,
    }
}

pub fn config(node: &str) -> CycloneConfig {
    CycloneConfig::loopback(name(node), domain())
}

pub fn services(node: &str) -> RustServices {
    RustServices::new(&config(node)).unwrap()
}

/// Header and whole numbers, as CDR has them.
pub fn cdr(numbers: &[i64]) -> Vec<u8> {
    let mut cdr = vec![0, 1, 0, 0];
    numbers.iter().for_each(|number| cdr.extend(number.to_le_bytes()));
    cdr
}

/// The numbers of what [`cdr`] wrote.
pub fn numbers(cdr: &[u8]) -> Vec<i64> {
    assert_eq!(cdr[..4], [0, 1, 0, 0]);
    let words = cdr[4..].chunks_exact(8);
    assert!(words.remainder().is_empty());
    words.map(|word| i64::from_le_bytes(word.try_into().unwrap())).collect()
}

/// A client and its bell.
pub struct OurClient {
    pub wake: Wake,
    pub client: Box<dyn CdrClient>,
}

pub fn client(services: &RustServices, service: &ServiceDescription) -> OurClient {
    let wake = Wake::new();
    let client = services.client(service, bell(&wake)).unwrap();
    OurClient { wake, client }
}

impl OurClient {
    pub fn await_peers(&self, wanted: &Peers) {
        let met = wait_until(&self.wake, TIMEOUT, || self.client.servers() == *wanted);
        assert!(met, "{wanted:?} awaited, there is {:?}", self.client.servers());
    }

    pub fn reply(&mut self) -> Result<CdrReply, GraphError> {
        let mut taken = Ok(None);
        let came = wait_until(&self.wake, TIMEOUT, || {
            taken = self.client.take();
            !matches!(taken, Ok(None))
        });
        assert!(came, "no reply");
        taken.map(Option::unwrap)
    }

    pub fn call(&mut self, a: i64, b: i64) -> i64 {
        let sequence = self.client.send(&[&cdr(&[a, b])]).unwrap();
        let reply = self.reply().unwrap();
        assert_eq!(reply.sequence, sequence);
        assert!(reply.source_timestamp_ns > 1_500_000_000_000_000_000);
        numbers(&reply.cdr)[0]
    }
}

/// A server and its bell.
pub struct OurServer {
    pub wake: Wake,
    pub server: Box<dyn CdrServer>,
}

pub fn server(services: &RustServices, service: &ServiceDescription) -> OurServer {
    let wake = Wake::new();
    let server = services.server(service, bell(&wake)).unwrap();
    OurServer { wake, server }
}

impl OurServer {
    pub fn await_peers(&self, wanted: &Peers) {
        let met = wait_until(&self.wake, TIMEOUT, || self.server.clients() == *wanted);
        assert!(met, "{wanted:?} awaited, there is {:?}", self.server.clients());
    }

    pub fn request(&mut self) -> Result<CdrRequest, GraphError> {
        let mut taken = Ok(None);
        let came = wait_until(&self.wake, TIMEOUT, || {
            taken = self.server.take();
            !matches!(taken, Ok(None))
        });
        assert!(came, "no request");
        taken.map(Option::unwrap)
    }

    /// Answers the next request with the sum of its numbers, when its client would hear it.
    pub fn answer(&mut self) -> CdrRequest {
        let request = self.request().unwrap();
        let heard = wait_until(&self.wake, TIMEOUT, || self.server.hears(&request.id));
        assert!(heard, "the client's reader is never matched");
        let sum = numbers(&request.cdr).iter().sum();
        self.server.reply(&request.id, &[&cdr(&[sum])]).unwrap();
        request
    }
}

/// A ros2-client node, whose services are in the mapping that it calls enhanced.
pub struct Peer(Node);

impl Peer {
    pub fn new(node: &str) -> Self {
        let context = Context::from_domain_participant(participant()).unwrap();
        let node = ros2_client::NodeName::new("/", node).unwrap();
        Self(context.new_node(node, NodeOptions::new().enable_rosout(false)).unwrap())
    }

    pub fn server(&mut self, service: &ServiceDescription) -> Server<Add, Sum> {
        let name = Name::parse(&service.name).unwrap();
        let kind = ServiceTypeName::new("example_interfaces", "AddTwoInts");
        let mapping = ServiceMapping::Enhanced;
        self.0.create_server(mapping, &name, &kind, profile(), profile()).unwrap()
    }

    pub fn client(&mut self, service: &ServiceDescription) -> Client<Add, Sum> {
        let name = Name::parse(&service.name).unwrap();
        let kind = ServiceTypeName::new("example_interfaces", "AddTwoInts");
        let mapping = ServiceMapping::Enhanced;
        self.0.create_client(mapping, &name, &kind, profile(), profile()).unwrap()
    }
}

/// `example_interfaces/action/Fibonacci`, goal.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Order {
    pub order: i32,
}
impl Message for Order {}

/// Result and feedback of the action.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sequence {
    pub sequence: Vec<i32>,
}
impl Message for Sequence {}

impl Peer {
    pub fn fibonacci_client(&mut self, name: &str) -> ActionClient<Order, Sequence, Sequence> {
        let (name, kind) = fibonacci(name);
        let qos = ActionClientQosPolicies {
            goal_service: profile(),
            result_service: profile(),
            cancel_service: profile(),
            feedback_subscription: profile(),
            status_subscription: profile().durability(Durability::TransientLocal),
        };
        self.0.create_action_client(ServiceMapping::Enhanced, &name, &kind, qos).unwrap()
    }

    pub fn fibonacci_server(&mut self, name: &str) -> ActionServer<Order, Sequence, Sequence> {
        let (name, kind) = fibonacci(name);
        let qos = ActionServerQosPolicies {
            goal_service: profile(),
            result_service: profile(),
            cancel_service: profile(),
            feedback_publisher: profile(),
            status_publisher: profile().durability(Durability::TransientLocal),
        };
        self.0.create_action_server(ServiceMapping::Enhanced, &name, &kind, qos).unwrap()
    }
}

fn fibonacci(name: &str) -> (Name, ActionTypeName) {
    (Name::parse(name).unwrap(), ActionTypeName::new("example_interfaces", "Fibonacci"))
}

fn profile() -> QosProfile {
    QosProfile::subscription_default()
        .reliability_reliable(WhenFull::DEFAULT)
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth: 10 })
}

/// Answers one request; false where none waits.
pub fn answer(server: &Server<Add, Sum>) -> bool {
    let Some((id, Add { a, b })) = server.receive_request().unwrap() else { return false };
    server.send_response(id, Sum { sum: a.wrapping_add(b) }).unwrap();
    true
}

fn participant() -> DomainParticipant {
    DomainParticipantBuilder::new(u16::try_from(domain()).unwrap())
        .with_only_networks([Ipv4Addr::LOCALHOST])
        .same_host_loopback(true)
        .build()
        .unwrap()
}

/// RustDDS without ROS: says what no ROS 2 node would.
pub struct Bare {
    dds: DomainParticipant,
    publisher: Publisher,
    subscriber: Subscriber,
}

pub type BareWriter<D> = DataWriter<D, CDRSerializerAdapter<D>>;
pub type BareReader<D> = DataReader<D, CDRDeserializerAdapter<D>>;

impl Bare {
    pub fn new() -> Self {
        let dds = participant();
        let publisher = dds.create_publisher(&QosPolicies::qos_none()).unwrap();
        let subscriber = dds.create_subscriber(&QosPolicies::qos_none()).unwrap();
        Self { dds, publisher, subscriber }
    }

    pub fn replies(&self, service: &ServiceDescription) -> BareWriter<Sum> {
        let topic = self.topic(&format!("rr{}Reply", service.name), "Response");
        self.publisher.create_datawriter_no_key(&topic, None).unwrap()
    }

    pub fn requests(&self, service: &ServiceDescription) -> BareReader<Add> {
        let topic = self.topic(&format!("rq{}Request", service.name), "Request");
        self.subscriber.create_datareader_no_key(&topic, None).unwrap()
    }

    pub fn request_writer(&self, service: &ServiceDescription) -> BareWriter<Add> {
        let topic = self.topic(&format!("rq{}Request", service.name), "Request");
        self.publisher.create_datawriter_no_key(&topic, None).unwrap()
    }

    pub fn reply_reader(&self, service: &ServiceDescription) -> BareReader<Sum> {
        let topic = self.topic(&format!("rr{}Reply", service.name), "Response");
        self.subscriber.create_datareader_no_key(&topic, None).unwrap()
    }

    fn topic(&self, name: &str, half: &str) -> Topic {
        let qos = QosPolicyBuilder::new()
            .reliability(policy::Reliability::Reliable {
                max_blocking_time: rustdds::Duration::from_millis(100),
            })
            .durability(policy::Durability::Volatile)
            .history(policy::History::KeepLast { depth: 10 })
            .build();
        let type_name = format!("example_interfaces::srv::dds_::AddTwoInts_{half}_");
        self.dds.create_topic(name.into(), type_name, &qos, TopicKind::NoKey).unwrap()
    }
}

/// The next sample of a bare reader, with its writer's number and identity.
pub fn next<D: serde::de::DeserializeOwned + 'static>(
    reader: &mut BareReader<D>,
) -> (D, rustdds::SampleInfo) {
    let mut taken = None;
    until("a sample", || {
        taken = reader.take_next_sample().unwrap();
        taken.is_some()
    });
    let sample = taken.unwrap();
    let info = sample.sample_info().clone();
    (sample.into_value(), info)
}

/// Time in which the participant of the services has to end.
pub const END: Duration = Duration::from_secs(2);
