//! Services under the mapping of `rmw_cyclonedds_cpp`, between two nodes over loopback.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::JoinHandle;
use std::time::Duration;

use wrapyfi_core::endpoint::{CallError, DropReason, Qos, ServeError, Wake};
use wrapyfi_core::middleware::ros2::graph::{
    CdrClient, Graph, Peers, ServiceDescription, TopicDescription, WriterTraits, wait_until,
};
use wrapyfi_core::middleware::ros2::{
    AnyClient, AnyServer, CycloneConfig, CycloneGraph, Ros2, ServiceOptions,
};
use wrapyfi_core::types::RosService;
use wrapyfi_interfaces::dynamic::DynamicMessage;
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::TypeStore;

use crate::ros2_common::{TIMEOUT, bell, far_config, near_config};

const ADD: (&str, &str) =
    ("example_interfaces/srv/AddTwoInts", "int64 a\nint64 b\n---\nint64 sum\n");
const SET_BOOL: (&str, &str) =
    ("std_srvs/srv/SetBool", "bool data\n---\nbool success\nstring message\n");

fn service((name, text): (&str, &str)) -> RosService {
    let mut store = TypeStore::empty();
    let name = TypeName::parse(Dialect::Ros2, name).unwrap();
    store.add_definition(&name, text).unwrap();
    RosService::new(&store.resolve(&name).unwrap()).unwrap()
}

fn ros2(config: &CycloneConfig) -> Ros2 {
    Ros2::new(Arc::new(CycloneGraph::new(config).unwrap()), |name| Ok(name.to_owned()))
}

fn client(ros2: &Ros2, name: &str, timeout: Duration) -> AnyClient {
    let options = ServiceOptions { timeout, ..ServiceOptions::default() };
    AnyClient::open(ros2, name, service(ADD), &options, &Wake::new()).unwrap()
}

fn request(client: &AnyClient, a: i64, b: i64) -> DynamicMessage {
    let mut request = client.request();
    request.set("a", a).unwrap();
    request.set("b", b).unwrap();
    request
}

fn integer(message: &DynamicMessage, name: &str) -> i64 {
    message.get(name).unwrap().as_integer().unwrap().try_into().unwrap()
}

fn answer(server: &mut AnyServer, request: &wrapyfi_core::middleware::ros2::AnyRequest) {
    let mut reply = server.response();
    let sum = integer(&request.fields, "a") + integer(&request.fields, "b");
    reply.set("sum", sum).unwrap();
    server.reply(request.id, &reply).unwrap();
}

/// A server of `add` in a thread of its own.
struct Adder {
    leave: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Adder {
    fn start(ros2: &Ros2, name: &str) -> Self {
        let wake = Wake::new();
        let options = ServiceOptions::default();
        let mut server = AnyServer::open(ros2, name, service(ADD), &options, &wake).unwrap();
        let leave = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&leave);
        let thread = std::thread::spawn(move || {
            while !told.load(Relaxed) {
                while let Some(request) = server.take().unwrap() {
                    answer(&mut server, &request);
                }
                let now = std::time::Instant::now();
                let until = server.deadline().map(|at| at.saturating_duration_since(now));
                wake.wait(until.unwrap_or(TIMEOUT).min(Duration::from_millis(20)));
            }
        });
        Self { leave, thread: Some(thread) }
    }
}

impl Drop for Adder {
    fn drop(&mut self) {
        self.leave.store(true, Relaxed);
        self.thread.take().unwrap().join().unwrap();
    }
}

#[test]
fn the_first_call_is_answered_whoever_came_first() {
    let near = ros2(&near_config("near"));
    for start in 0..20 {
        let far = ros2(&far_config("far"));
        // A call may also go to a server that is about to end: each start has its own name.
        let name = format!("add_{start}");
        let mut early = client(&near, &name, TIMEOUT);
        let wait = early.call(&request(&early, start, 1)).unwrap();
        let server = Adder::start(&far, &name);
        // Begun when the server was not there.
        let reply = loop {
            if let Some((ticket, result)) = early.poll() {
                assert_eq!(ticket, wait);
                break result.unwrap();
            }
            std::thread::yield_now();
        };
        assert_eq!(integer(&reply, "sum"), start + 1);
        // Begun at once by a client that has discovered nothing yet.
        let mut late = client(&near, &name, TIMEOUT);
        let reply = late.call_and_wait(&request(&late, start, 2)).unwrap();
        assert_eq!(integer(&reply, "sum"), start + 2);
        drop(server);
    }
}

#[test]
fn replies_go_to_the_client_that_asked() {
    let (near, far) = (ros2(&near_config("near")), ros2(&far_config("far")));
    let _server = Adder::start(&far, "add");
    let mut clients: Vec<_> = (0..3).map(|_| client(&near, "add", TIMEOUT)).collect();
    // Also within one node.
    clients.push(client(&far, "add", TIMEOUT));
    for round in 0..20 {
        let tickets: Vec<_> = clients
            .iter_mut()
            .zip(0..)
            .map(|(client, n)| client.call(&request(client, 100 * n, round)).unwrap())
            .collect();
        for ((client, n), ticket) in clients.iter_mut().zip(0..).zip(tickets) {
            let mut got = None;
            assert!(wait_until(&Wake::new(), TIMEOUT, || {
                got = client.poll();
                got.is_some()
            }));
            let (answered, reply) = got.unwrap();
            assert_eq!((answered, integer(&reply.unwrap(), "sum")), (ticket, 100 * n + round));
        }
    }
    assert!(clients.iter().all(|client| client.late() == 0));
}

#[test]
fn what_keeps_a_call_waiting_is_said() {
    let (near, far) = (ros2(&near_config("near")), ros2(&far_config("far")));
    let mut lonely = client(&near, "add", Duration::from_millis(50));
    let error = lonely.call_and_wait(&request(&lonely, 1, 2)).unwrap_err();
    assert_eq!(
        error.to_string(),
        "\"/robot/add\" was not answered within 50 ms: no node offers it"
    );

    let wake = Wake::new();
    let options = ServiceOptions::default();
    let mut slow = AnyServer::open(&far, "add", service(ADD), &options, &wake).unwrap();
    assert!(wait_until(&wake, TIMEOUT, || lonely.servers() == Peers::Ready(1)));
    // On a busy machine the first ones may not even be sent in time.
    let not_answered = |error: &CallError| error.to_string().ends_with("has not answered");
    assert!(wait_until(&wake, TIMEOUT, || {
        let error = lonely.call_and_wait(&request(&lonely, 1, 2)).unwrap_err();
        not_answered(&error)
    }));
    let mut taken = None;
    assert!(wait_until(&wake, TIMEOUT, || {
        taken = slow.take().unwrap();
        taken.is_some()
    }));
    answer(&mut slow, &taken.unwrap());
    assert!(wait_until(&wake, TIMEOUT, || {
        slow.flush();
        lonely.poll().is_none() && lonely.late() == 1
    }));

    drop(slow);
    assert!(wait_until(&wake, TIMEOUT, || lonely.servers() == Peers::None));
}

#[test]
fn too_many_calls_and_requests_are_refused_by_name() {
    let (near, far) = (ros2(&near_config("near")), ros2(&far_config("far")));
    let options = ServiceOptions { pending: 1, ..ServiceOptions::default() };
    let wake = Wake::new();
    let mut server = AnyServer::open(&far, "set", service(SET_BOOL), &options, &wake).unwrap();
    let open = || AnyClient::open(&near, "set", service(SET_BOOL), &options, &Wake::new()).unwrap();
    let (mut first, mut second) = (open(), open());
    let request = first.request();
    first.call(&request).unwrap();
    let error = first.call(&request).unwrap_err();
    assert_eq!(error, CallError::TooMany { service: "/robot/set".into(), limit: 1 });

    let mut taken = None;
    assert!(wait_until(&wake, TIMEOUT, || {
        first.poll();
        taken = server.take().unwrap();
        taken.is_some()
    }));
    let ticket = second.call(&request).unwrap();
    let mut refused = None;
    assert!(wait_until(&wake, TIMEOUT, || {
        assert_eq!(second.poll(), None);
        refused = server.take().err();
        refused.is_some()
    }));
    let overloaded = ServeError::Overloaded { service: "/robot/set".into(), limit: 1 };
    assert_eq!(refused, Some(overloaded.clone()));
    let mut told = None;
    assert!(wait_until(&wake, TIMEOUT, || {
        drop(server.take());
        told = second.poll();
        told.is_some()
    }));
    let (ended, reply) = told.unwrap();
    let reply = reply.unwrap();
    assert_eq!(ended, ticket);
    assert_eq!(reply.get("message").unwrap().as_str().unwrap(), overloaded.to_string());
    assert_eq!(server.counters().drops, [(DropReason::Overloaded, 1)]);
    let again = server.reply(taken.unwrap().id, &server.response());
    assert_eq!(again, Ok(()));
}

/// Half a server says nothing more by itself: its other half would ring.
#[test]
fn nobody_polls_for_the_other_half() {
    let graph = CycloneGraph::new(&near_config("near")).unwrap();
    let far = ros2(&far_config("far"));
    let mut half = client(&far, "add", TIMEOUT);
    let topic = TopicDescription {
        name: "rq/robot/addRequest".into(),
        type_name: "example_interfaces::srv::dds_::AddTwoInts_Request_".into(),
        type_hash: None,
        qos: Qos::default(),
        max_bytes: 64,
    };
    let _reader = graph.subscribe_dds(&topic, bell(&Wake::new())).unwrap();
    assert!(wait_until(&Wake::new(), TIMEOUT, || half.servers() == Peers::Half));
    let begun = std::time::Instant::now();
    half.call(&request(&half, 1, 2)).unwrap();
    // Once the reader has confirmed that it hears.
    assert!(wait_until(&Wake::new(), TIMEOUT, || {
        assert!(half.poll().is_none());
        half.deadline().unwrap() >= begun + TIMEOUT
    }));
}

/// The requests of a service as anybody may write them.
fn raw_client(graph: &CycloneGraph, name: &str, max_bytes: usize) -> Box<dyn CdrClient> {
    let description = ServiceDescription {
        name: name.into(),
        type_name: ADD.0.into(),
        type_hash: None,
        request_hash: None,
        response_hash: None,
        depth: 10,
        max_bytes,
    };
    graph.client(&description, bell(&Wake::new())).unwrap()
}

#[test]
fn requests_of_a_wrong_size_never_reach_the_user() {
    let graph = CycloneGraph::new(&near_config("near")).unwrap();
    let far = ros2(&far_config("far"));
    let wake = Wake::new();
    let options = ServiceOptions { max_bytes: 64, ..ServiceOptions::default() };
    let mut server = AnyServer::open(&far, "add", service(ADD), &options, &wake).unwrap();
    let mut raw = raw_client(&graph, "/robot/add", 1 << 20);
    assert!(wait_until(&wake, TIMEOUT, || raw.servers() == Peers::Ready(1)));
    let mut refused = |parts: &[&[u8]]| {
        raw.send(parts).unwrap();
        let mut error = None;
        assert!(wait_until(&wake, TIMEOUT, || {
            error = server.take().map(|request| assert_eq!(request, None)).err();
            error.is_some()
        }));
        error.unwrap()
    };
    // As a request of Fast DDS arrives: its 16 bytes are taken for the identity.
    let error = refused(&[&[0, 1, 0, 0]]);
    assert!(
        matches!(&error, ServeError::Request { fault, .. } if fault.contains("needs 16 bytes, 0 are left")),
        "{error}"
    );
    let error = refused(&[&[0, 1, 0, 0], &[0; 12]]);
    assert!(
        matches!(&error, ServeError::Request { fault, .. } if fault.contains("needs 16 bytes, 12 are left")),
        "{error}"
    );
    let error = refused(&[&[0, 1, 0, 0], &[0; 20]]);
    assert!(
        matches!(&error, ServeError::Request { fault, .. } if fault.contains("4 bytes are left")),
        "{error}"
    );
    let error = refused(&[&[0, 3, 0, 0], &[0; 16]]);
    assert!(error.to_string().contains("is not plain CDR"), "{error}");
    let error = refused(&[&[0, 1, 0, 0], &[0; 65]]);
    assert!(matches!(error, ServeError::Request { reason: DropReason::Oversize, .. }), "{error}");
    let counted = [DropReason::Malformed, DropReason::Oversize];
    assert_eq!(counted.map(|reason| server.counters().dropped_for(reason)), [4, 1]);
}

#[test]
fn what_has_no_identity_is_counted() {
    let graph = CycloneGraph::new(&near_config("near")).unwrap();
    let far = ros2(&far_config("far"));
    let wake = Wake::new();
    let options = ServiceOptions::default();
    let mut server = AnyServer::open(&far, "add", service(ADD), &options, &wake).unwrap();
    // The same DDS topic and type, reached as a topic.
    let topic = TopicDescription {
        name: "rq/robot/addRequest".into(),
        type_name: "example_interfaces::srv::dds_::AddTwoInts_Request_".into(),
        type_hash: None,
        qos: Qos::default(),
        max_bytes: 64,
    };
    let mut writer = graph.advertise_dds(&topic, WriterTraits::default(), bell(&wake)).unwrap();
    assert!(wait_until(&wake, TIMEOUT, || writer.matched() == 1));
    writer.write(&[&[0, 1, 0, 0], &[0; 8]]).unwrap();
    let mut error = None;
    assert!(wait_until(&wake, TIMEOUT, || {
        error = server.take().err();
        error.is_some()
    }));
    let text = error.unwrap().to_string();
    let words = "request of 12 bytes on \"/robot/add\" has no identity of at least 20 bytes";
    assert!(text.ends_with(words), "{text}");
    assert_eq!(server.counters().dropped_for(DropReason::Malformed), 1);
    assert_eq!(server.clients(), Peers::Half);
}

#[test]
fn both_halves_are_in_the_graph_with_their_hashes() {
    let graph = CycloneGraph::new(&near_config("near")).unwrap();
    let far = ros2(&far_config("far"));
    let options = ServiceOptions::default();
    let wake = Wake::new();
    let _server = AnyServer::open(&far, "add", service(ADD), &options, &wake).unwrap();
    let mut nodes = graph.nodes().unwrap();
    let mut found = Vec::new();
    assert!(wait_until(&wake, TIMEOUT, || {
        nodes.update();
        found = graph.endpoints().unwrap();
        found.retain(|endpoint| nodes.owner(&endpoint.gid) == Some("/robot/far"));
        found.len() == 2
    }));
    found.sort_by(|a, b| a.dds_topic.cmp(&b.dds_topic));
    let [request, reply] = &found[..] else { panic!("{found:?}") };
    assert_eq!((request.dds_topic.as_str(), request.is_publisher), ("rq/robot/addRequest", false));
    assert_eq!(request.dds_type, "example_interfaces::srv::dds_::AddTwoInts_Request_");
    // As a real node announces them.
    let hashes = [
        "RIHS01_000c5fd92d6b2e1a05949348f584d6d652adea1e92d691792011ac2273508302",
        "RIHS01_de5c030d4af33cba2749310b249737b631594703f9300495f48bffb2b44dcc2f",
    ];
    assert_eq!([&request.type_hash, &reply.type_hash].map(Option::as_deref), hashes.map(Some));
    assert_eq!((reply.dds_topic.as_str(), reply.is_publisher), ("rr/robot/addReply", true));
}
