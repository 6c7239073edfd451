//! Services under the mapping of `rmw_cyclonedds_cpp`, between two nodes over loopback.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::JoinHandle;
use std::time::Duration;

use wrapyfi_data::Limits;
use wrapyfi_data::types::{
    Map, MessageType, Payload, RosMessage, RosService, RosType, ServiceKind, Value,
};
use wrapyfi_endpoint::{
    CallError, Cause, Client, Context, DropReason, IncomingRequest, Middleware, Qos, Request,
    ServeError, Server, ServiceSpec, TopicSpec, Wake,
};
use wrapyfi_interfaces::dynamic::DynamicValue;
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_ros2::graph::{
    CdrClient, Graph, Peers, ServiceDescription, ServiceMapping, TopicDescription, WriterTraits,
    wait_until,
};
use wrapyfi_ros2::{CycloneConfig, CycloneGraph, Ros2};

use crate::common::{TIMEOUT, bell, far_config, near_config};

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

const MAX_BYTES: usize = 1 << 20;

fn spec(name: &str, definition: (&str, &str)) -> ServiceSpec {
    ServiceSpec::new(name, ServiceKind::Ros(service(definition)))
}

fn client(ros2: &Ros2, name: &str) -> (Box<dyn Client>, Context) {
    let context = Context::default();
    (ros2.open_client(&spec(name, ADD), &context).unwrap(), context)
}

fn server(ros2: &Ros2, spec: &ServiceSpec) -> (Box<dyn Server>, Context) {
    let context = Context::default();
    (ros2.open_server(spec, &context).unwrap(), context)
}

fn message<const N: usize>(ros_type: RosType, fields: [(&str, i64); N]) -> RosMessage {
    let mut message = ros_type.plan().default_message();
    for (name, value) in fields {
        message.set(name, value).unwrap();
    }
    RosMessage::from_fields(ros_type, &message).unwrap()
}

fn request(a: i64, b: i64) -> Request {
    Request::Message(message(service(ADD).request(), [("a", a), ("b", b)]))
}

fn integer(message: &RosMessage, name: &str) -> i64 {
    let fields = message.fields(MAX_BYTES).unwrap();
    fields.get(name).unwrap().as_integer().unwrap().try_into().unwrap()
}

fn sum(payload: &Payload) -> i64 {
    let Payload::RosMessage(reply) = payload else { panic!("{payload:?}") };
    integer(reply, "sum")
}

fn answer(server: &mut dyn Server, asked: &IncomingRequest) {
    let Request::Message(request) = &asked.request else { panic!("{asked:?}") };
    let sum = integer(request, "a") + integer(request, "b");
    let reply = message(service(ADD).response(), [("sum", sum)]);
    server.reply(asked.id, Ok(reply.into())).unwrap();
}

/// A server of `add` in a thread of its own.
struct Adder {
    leave: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Adder {
    fn start(ros2: &Ros2, name: &str) -> Self {
        let (mut server, Context { wake, .. }) = server(ros2, &spec(name, ADD));
        let leave = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&leave);
        let thread = std::thread::spawn(move || {
            while !told.load(Relaxed) {
                while let Some(request) = server.take().unwrap() {
                    answer(&mut *server, &request);
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

/// Replies that came after the time of their calls.
fn late(context: &Context) -> u64 {
    context.counters.snapshot().dropped_for(DropReason::Late)
}

#[test]
fn the_first_call_is_answered_whoever_came_first() {
    let near = ros2(&near_config("near"));
    for start in 0..20 {
        let far = ros2(&far_config("far"));
        // A call may also go to a server that is about to end: each start has its own name.
        let name = format!("add_{start}");
        let (mut early, _) = client(&near, &name);
        let wait = early.send(&request(start, 1), TIMEOUT).unwrap();
        let server = Adder::start(&far, &name);
        // Begun when the server was not there.
        let reply = loop {
            if let Some((ticket, result)) = early.take() {
                assert_eq!(ticket, wait);
                break result.unwrap();
            }
            std::thread::yield_now();
        };
        assert_eq!(sum(&reply.payload), start + 1);
        // Begun at once by a client that has discovered nothing yet.
        let (mut late, _) = client(&near, &name);
        let reply = late.call(&request(start, 2), TIMEOUT).unwrap();
        assert_eq!(sum(&reply.payload), start + 2);
        drop(server);
    }
}

#[test]
fn replies_go_to_the_client_that_asked() {
    let (near, far) = (ros2(&near_config("near")), ros2(&far_config("far")));
    let _server = Adder::start(&far, "add");
    let mut clients: Vec<_> = (0..3).map(|_| client(&near, "add")).collect();
    // Also within one node.
    clients.push(client(&far, "add"));
    for round in 0..20 {
        let tickets: Vec<_> = clients
            .iter_mut()
            .zip(0..)
            .map(|((client, _), n)| client.send(&request(100 * n, round), TIMEOUT).unwrap())
            .collect();
        for (((client, _), n), ticket) in clients.iter_mut().zip(0..).zip(tickets) {
            let mut got = None;
            assert!(wait_until(&Wake::new(), TIMEOUT, || {
                got = client.take();
                got.is_some()
            }));
            let (answered, reply) = got.unwrap();
            assert_eq!((answered, sum(&reply.unwrap().payload)), (ticket, 100 * n + round));
        }
    }
    assert!(clients.iter().all(|(_, context)| late(context) == 0));
}

#[test]
fn what_keeps_a_call_waiting_is_said() {
    let (near, far) = (ros2(&near_config("near")), ros2(&far_config("far")));
    let (mut lonely, context) = client(&near, "add");
    let soon = Duration::from_millis(50);
    let error = lonely.call(&request(1, 2), soon).unwrap_err();
    assert_eq!(
        error.to_string(),
        "\"/robot/add\" was not answered within 50 ms: no node offers it"
    );

    let (mut slow, Context { wake, .. }) = server(&far, &spec("add", ADD));
    assert!(wait_until(&wake, TIMEOUT, || lonely.link().peers == Some(1)));
    // On a busy machine the first ones may not even be sent in time.
    let not_answered = |error: &CallError| error.to_string().ends_with("has not answered");
    assert!(wait_until(&wake, TIMEOUT, || {
        let error = lonely.call(&request(1, 2), soon).unwrap_err();
        not_answered(&error)
    }));
    let mut taken = None;
    assert!(wait_until(&wake, TIMEOUT, || {
        taken = slow.take().unwrap();
        taken.is_some()
    }));
    answer(&mut *slow, &taken.unwrap());
    assert!(wait_until(&wake, TIMEOUT, || {
        slow.flush();
        lonely.take().is_none() && late(&context) == 1
    }));

    drop(slow);
    assert!(wait_until(&wake, TIMEOUT, || lonely.link().peers == Some(0)));
}

#[test]
fn too_many_calls_and_requests_are_refused_by_name() {
    let (near, far) = (ros2(&near_config("near")), ros2(&far_config("far")));
    let spec = ServiceSpec { pending: 1, ..spec("set", SET_BOOL) };
    let (mut server, Context { wake, counters, .. }) = server(&far, &spec);
    let open = || near.open_client(&spec, &Context::default()).unwrap();
    let (mut first, mut second) = (open(), open());
    let request = Request::Message(message(service(SET_BOOL).request(), []));
    first.send(&request, TIMEOUT).unwrap();
    let error = first.send(&request, TIMEOUT).unwrap_err();
    assert_eq!(error, CallError::TooMany { service: "/robot/set".into(), limit: 1 });

    let mut taken = None;
    assert!(wait_until(&wake, TIMEOUT, || {
        first.take();
        taken = server.take().unwrap();
        taken.is_some()
    }));
    let ticket = second.send(&request, TIMEOUT).unwrap();
    let mut refused = None;
    assert!(wait_until(&wake, TIMEOUT, || {
        assert_eq!(second.take(), None);
        refused = server.take().err();
        refused.is_some()
    }));
    let overloaded = ServeError::Overloaded { service: "/robot/set".into(), limit: 1 };
    assert_eq!(refused, Some(overloaded.clone()));
    let mut told = None;
    assert!(wait_until(&wake, TIMEOUT, || {
        drop(server.take());
        told = second.take();
        told.is_some()
    }));
    let (ended, reply) = told.clone().unwrap();
    assert_eq!(ended, ticket);
    let Payload::RosMessage(reply) = reply.unwrap().payload else { panic!("{told:?}") };
    let fields = reply.fields(MAX_BYTES).unwrap();
    assert_eq!(fields.get("message").unwrap().as_str().unwrap(), overloaded.to_string());
    assert_eq!(counters.snapshot().drops, [(DropReason::Overloaded, 1)]);
    let empty = message(service(SET_BOOL).response(), []);
    let again = server.reply(taken.unwrap().id, Ok(empty.into()));
    assert!(again.is_ok(), "{again:?}");
}

/// Half a server says nothing more by itself: its other half would ring.
#[test]
fn nobody_polls_for_the_other_half() {
    let graph = CycloneGraph::new(&near_config("near")).unwrap();
    let far = ros2(&far_config("far"));
    let (mut half, _) = client(&far, "add");
    let topic = TopicDescription {
        name: "rq/robot/addRequest".into(),
        type_name: "example_interfaces::srv::dds_::AddTwoInts_Request_".into(),
        type_hash: None,
        qos: Qos::default(),
        max_bytes: 64,
        hears_own: false,
    };
    let _reader = graph.subscribe_dds(&topic, bell(&Wake::new())).unwrap();
    assert!(wait_until(&Wake::new(), TIMEOUT, || {
        matches!(half.link().waiting_for, Some(Cause::FoundByHalf(_)))
    }));
    let begun = std::time::Instant::now();
    half.send(&request(1, 2), TIMEOUT).unwrap();
    // Once the reader has confirmed that it hears.
    assert!(wait_until(&Wake::new(), TIMEOUT, || {
        assert!(half.take().is_none());
        half.deadline().unwrap() >= begun + TIMEOUT
    }));
}

fn described(name: &str, max_bytes: usize) -> ServiceDescription {
    ServiceDescription {
        name: name.into(),
        type_name: ADD.0.into(),
        type_hash: None,
        request_hash: None,
        response_hash: None,
        depth: 10,
        max_bytes,
    }
}

/// The requests of a service as any program may write them.
fn raw_client(graph: &CycloneGraph, name: &str, max_bytes: usize) -> Box<dyn CdrClient> {
    graph.client(&described(name, max_bytes), bell(&Wake::new())).unwrap()
}

/// A service of ROS 2 keeps ten requests, and overwrites the oldest for an eleventh.
#[test]
fn more_calls_at_once_than_a_server_keeps_are_all_answered() {
    let (near, far) = (ros2(&near_config("near")), CycloneGraph::new(&far_config("far")).unwrap());
    let wake = Wake::new();
    let mut server = far.server(&described("/robot/add", MAX_BYTES), bell(&wake)).unwrap();
    let (mut client, _) = client(&near, "add");
    assert!(wait_until(&wake, TIMEOUT, || client.link().peers == Some(1)));
    for number in 0..50 {
        client.send(&request(number, 1), TIMEOUT).unwrap();
    }
    let reply = message(service(ADD).response(), [("sum", 7)]);
    let mut answered = 0;
    assert!(wait_until(&wake, TIMEOUT, || {
        let asked: Vec<_> = std::iter::from_fn(|| server.take().unwrap()).collect();
        for one in asked {
            server.reply(&one.id, &[&reply.cdr]).unwrap();
        }
        while let Some((_, result)) = client.take() {
            assert_eq!(sum(&result.unwrap().payload), 7);
            answered += 1;
        }
        answered == 50
    }));
}

#[test]
fn requests_of_a_wrong_size_never_reach_the_user() {
    let graph = CycloneGraph::new(&near_config("near")).unwrap();
    let far = ros2(&far_config("far"));
    let limits = Limits { message_bytes: 64, ..Limits::default() };
    let spec = ServiceSpec { limits, ..spec("add", ADD) };
    let (mut server, Context { wake, counters, .. }) = server(&far, &spec);
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
    let error = refused(&[&[0, 3, 0, 0], &[0; 16]]);
    assert!(error.to_string().contains("is not plain CDR"), "{error}");
    let error = refused(&[&[0, 1, 0, 0], &[0; 65]]);
    assert!(matches!(error, ServeError::Request { reason: DropReason::Oversize, .. }), "{error}");
    let counted = [DropReason::Malformed, DropReason::Oversize];
    assert_eq!(counted.map(|reason| counters.snapshot().dropped_for(reason)), [3, 1]);
}

#[test]
fn what_has_no_identity_is_counted() {
    let graph = CycloneGraph::new(&near_config("near")).unwrap();
    let far = ros2(&far_config("far"));
    let (mut server, Context { wake, counters, .. }) = server(&far, &spec("add", ADD));
    // The same DDS topic and type, reached as a topic.
    let topic = TopicDescription {
        name: "rq/robot/addRequest".into(),
        type_name: "example_interfaces::srv::dds_::AddTwoInts_Request_".into(),
        type_hash: None,
        qos: Qos::default(),
        max_bytes: 64,
        hears_own: false,
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
    assert_eq!(counters.snapshot().dropped_for(DropReason::Malformed), 1);
    assert_eq!(server.link().peers, Some(0));
}

#[test]
fn both_halves_are_in_the_graph_with_their_hashes() {
    let graph = CycloneGraph::new(&near_config("near")).unwrap();
    let far = ros2(&far_config("far"));
    let (_server, Context { wake, .. }) = server(&far, &spec("add", ADD));
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

/// As `ros2 service echo` reads them: of both ends, with what was said or without.
fn events_tell_of_requests_and_replies(services: Option<ServiceMapping>) {
    let configs = ["ours", "theirs", "ear"].map(near_config);
    let [ours, theirs, ear] = configs.map(|it| ros2(&CycloneConfig { services, ..it }));
    let event = RosType::new(&service(ADD).resolved().part("_Event").unwrap()).unwrap();
    for (wanted, has_contents) in [("metadata", false), ("contents", true)] {
        let name = format!("/robot/{wanted}");
        let options = Map::from([("introspection", Value::from(wanted))]);
        let spec = ServiceSpec { options, ..spec(&name, ADD) };
        let context = Context::default();
        let topic = TopicSpec::new(format!("{name}/_service_event"), MessageType::Ros(event));
        let mut listener = ear.open_listener(&topic, &context).unwrap();
        let mut server = ours.open_server(&spec, &context).unwrap();
        let mut client = theirs.open_client(&spec, &context).unwrap();
        assert!(wait_until(&context.wake, TIMEOUT, || listener.link().peers == Some(2)));
        client.send(&request(2, 3), TIMEOUT).unwrap();
        let mut heard = BTreeMap::new();
        assert!(wait_until(&context.wake, TIMEOUT, || {
            if let Some(asked) = server.take().unwrap() {
                answer(&mut *server, &asked);
            }
            assert!(client.take().is_none_or(|(_, reply)| sum(&reply.unwrap().payload) == 5));
            while let Some(sample) = listener.take().unwrap() {
                let Payload::RosMessage(event) = sample.payload else { panic!("{sample:?}") };
                heard.insert(integer(&event, "info.event_type"), event);
            }
            heard.len() == 4
        }));
        let mut ids = BTreeSet::new();
        for (kind, event) in heard {
            let fields = event.fields(MAX_BYTES).unwrap();
            let part = |name| match fields.get(name) {
                Some(DynamicValue::Messages(all)) => all.first().cloned(),
                other => panic!("{other:?}"),
            };
            let field = |name| fields.get(name).map(|value| format!("{value:?}"));
            ids.insert([field("info.client_gid"), field("info.sequence_number")]);
            assert!(integer(&event, "info.stamp.sec") > 1_500_000_000);
            let said = [part("request").is_some(), part("response").is_some()];
            assert_eq!(said, [has_contents && kind < 2, has_contents && kind >= 2], "{kind}");
            if let Some(request) = part("request") {
                assert_eq!(request.get("a").and_then(DynamicValue::as_integer), Some(2));
            }
            if let Some(reply) = part("response") {
                assert_eq!(reply.get("sum").and_then(DynamicValue::as_integer), Some(5));
            }
        }
        assert_eq!(ids.len(), 1, "{ids:?}");
    }
    let options = Map::from([("introspection", Value::from("all"))]);
    let refused = ours.open_server(&ServiceSpec { options, ..spec("x", ADD) }, &Context::default());
    let said = refused.err().unwrap().to_string();
    assert!(said.contains("option introspection must be metadata or contents"), "{said}");
}

#[test]
fn events_of_services_on_cyclonedds() {
    events_tell_of_requests_and_replies(Some(ServiceMapping::Cyclone));
}

#[cfg(feature = "fastdds-services")]
#[test]
fn events_of_services_in_the_mapping_of_fast_dds_and_in_both() {
    events_tell_of_requests_and_replies(Some(ServiceMapping::FastDds));
    events_tell_of_requests_and_replies(None);
}
