//! Services of the Fast DDS mapping on the graph: identities, announcement, both halves.

use std::sync::{Arc, Mutex};

use rustdds::rpc::SampleIdentity;
use rustdds::{GUID, RTPSEntity, SequenceNumber, WriteOptions, WriteOptionsBuilder};

use wrapyfi_conformance::until;
use wrapyfi_ros2::environment::DiscoveryRange;
use wrapyfi_ros2::graph::{Graph, GraphError, Peers, RequestId};
use wrapyfi_ros2::{CycloneGraph, RustServices, RustServicesError, ServiceEndpoints};

use crate::common::bell;
use crate::fast_common::{
    Add, Bare, Sum, add_two_ints, cdr, client, config, next, numbers, server, services,
};
use wrapyfi_endpoint::Wake;

fn related(guid: GUID, number: i64) -> WriteOptions {
    let sequence_number = SequenceNumber::new(number);
    let identity = SampleIdentity { writer_guid: guid, sequence_number };
    WriteOptionsBuilder::new().related_sample_identity(identity).build()
}

/// Bytes of wire/decoded, service `add_two_ints` of rmw_fastrtps_cpp, calls 2 + 3 and -7 + 2^40.
const REQUESTS: [(&str, i64, i64); 2] = [
    ("0001000002000000000000000300000000000000", 2, 3),
    ("00010000f9ffffffffffffff0000000000010000", -7, 1 << 40),
];
const REPLY: &str = "000100000500000000000000";

fn unhex(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|n| u8::from_str_radix(&hex[n..n + 2], 16).unwrap()).collect()
}

#[test]
fn requests_and_replies_are_those_of_fast_dds() {
    let service = add_two_ints();
    let bare = Bare::new();
    let (mut requests, replies) = (bare.requests(&service), bare.replies(&service));
    let ours = services("caller");
    let mut client = client(&ours, &service);
    client.await_peers(&Peers::Ready(1));
    let reply_reader = ours.endpoints().readers[0];
    assert_eq!(reply_reader[12..], GUID::from_bytes(reply_reader).entity_id.to_slice());
    assert_eq!(reply_reader[15], 4, "a reader without key");
    for (n, (hex, a, b)) in (1..).zip(REQUESTS) {
        assert_eq!(client.client.send(&[&unhex(hex)]).unwrap(), n);
        let (request, info) = next(&mut requests);
        assert_eq!(request, Add { a, b });
        let carried = info.related_sample_identity().unwrap();
        assert_eq!(carried.writer_guid.to_bytes(), reply_reader);
        let unknown = carried.sequence_number;
        assert_eq!((unknown.high(), unknown.low()), (-1, 0));
        // As Fast DDS answers: the same reader, the number of the request's sample.
        let options = related(carried.writer_guid, n);
        replies.write_with_options(Sum { sum: a + b }, options).unwrap();
        let reply = client.reply().unwrap();
        assert_eq!((reply.sequence, numbers(&reply.cdr)), (n, vec![a + b]));
        if n == 1 {
            assert_eq!(reply.cdr, unhex(REPLY));
        }
    }
}

#[test]
fn our_server_answers_the_reader_that_a_request_names() {
    let service = add_two_ints();
    let bare = Bare::new();
    let (requests, mut replies) = (bare.request_writer(&service), bare.reply_reader(&service));
    let ours = services("adder");
    let mut server = server(&ours, &service);
    server.await_peers(&Peers::Ready(1));
    let reader = replies.guid();
    let unknown = i64::from(SequenceNumber::UNKNOWN);
    // The first may be sent before the bare writer knows our reader.
    let mut first = None;
    until("the first request", || {
        requests.write_with_options(Add { a: 2, b: 3 }, related(reader, unknown)).unwrap();
        first = server.server.take().unwrap();
        first.is_some()
    });
    let request = first.unwrap();
    assert_eq!(request.cdr, unhex(REQUESTS[0].0));
    assert_eq!(request.id.client, reader.to_bytes());
    assert!(server.server.hears(&request.id));
    server.server.reply(&request.id, &[&unhex(REPLY)]).unwrap();
    let (reply, info) = next(&mut replies);
    assert_eq!(reply, Sum { sum: 5 });
    let carried = info.related_sample_identity().unwrap();
    assert_eq!(carried.writer_guid, reader);
    assert_eq!(i64::from(carried.sequence_number), request.id.sequence);
    // A client whose reader is not matched would not hear the reply.
    let mut stranger = reader.to_bytes();
    stranger[14] ^= 0x40;
    assert!(!server.server.hears(&RequestId { client: stranger, sequence: 1 }));
}

#[test]
fn a_request_without_identity_is_named_by_its_sample() {
    let service = add_two_ints();
    let bare = Bare::new();
    let (requests, mut replies) = (bare.request_writer(&service), bare.reply_reader(&service));
    let ours = services("adder");
    let mut server = server(&ours, &service);
    server.await_peers(&Peers::Ready(1));
    let mut first = None;
    until("the first request", || {
        requests.write(Add { a: 1, b: 1 }, None).unwrap();
        first = server.server.take().unwrap();
        first.is_some()
    });
    let request = first.unwrap();
    assert_eq!(request.id.client, requests.guid().to_bytes());
    assert!(server.server.hears(&request.id), "a reader of the same participant is matched");
    server.server.reply(&request.id, &[&cdr(&[2])]).unwrap();
    let (_, info) = next(&mut replies);
    assert_eq!(info.related_sample_identity().unwrap().writer_guid, requests.guid());
    let mut elsewhere = request.id.client;
    elsewhere[5] ^= 1;
    assert!(!server.server.hears(&RequestId { client: elsewhere, sequence: 1 }));
}

#[test]
fn replies_to_others_are_passed_over_and_those_to_nobody_said() {
    let service = add_two_ints();
    let bare = Bare::new();
    let (mut requests, replies) = (bare.requests(&service), bare.replies(&service));
    let (ours, theirs) = (services("caller"), services("other"));
    let (mut mine, other) = (client(&ours, &service), client(&theirs, &service));
    mine.await_peers(&Peers::Ready(1));
    let mine_first = ours.endpoints().readers[0];
    mine.client.send(&[&cdr(&[1, 1])]).unwrap();
    let (_, info) = next(&mut requests);
    let own = info.related_sample_identity().unwrap().writer_guid;
    assert_eq!(own.to_bytes(), mine_first);
    let others = GUID::from_bytes(theirs.endpoints().readers[0]);
    let mut nobody = own.to_bytes();
    nobody[3] ^= 0xff;
    let write = |sum, options| replies.write_with_options(Sum { sum }, options).unwrap();
    write(1, related(others, 1));
    write(2, related(GUID::from_bytes(nobody), 1));
    write(3, WriteOptions::default());
    write(4, related(GUID::from_bytes([0; 16]), 1));
    write(5, related(own, 1));
    for _ in 0..2 {
        let error = mine.reply().unwrap_err();
        let expected = GraphError::NoIdentity {
            what: "reply",
            service: service.name.clone(),
            actual: 12,
            least: 24,
        };
        assert_eq!(error, expected);
    }
    let reply = mine.reply().unwrap();
    assert_eq!((reply.sequence, numbers(&reply.cdr)), (1, vec![5]));
    assert_eq!(mine.client.take().unwrap(), None);
    drop(other);
}

#[test]
fn half_a_server_is_no_server() {
    let service = add_two_ints();
    let ours = services("caller");
    let mut client = client(&ours, &service);
    let (a, b) = (Bare::new(), Bare::new());
    let requests = a.requests(&service);
    client.await_peers(&Peers::Half);
    let elsewhere = b.replies(&service);
    let own = GUID::from_bytes(ours.endpoints().readers[0]);
    client.client.send(&[&cdr(&[1, 1])]).unwrap();
    // Once heard, its writer is matched.
    until("a reply of the other half", || {
        elsewhere.write_with_options(Sum { sum: 1 }, related(own, 1)).unwrap();
        client.client.take().unwrap().is_some()
    });
    assert_eq!(client.client.servers(), Peers::Half, "two halves of two participants");
    let replies = a.replies(&service);
    client.await_peers(&Peers::Ready(1));
    drop((requests, replies));
    client.await_peers(&Peers::Half);
    drop(elsewhere);
    client.await_peers(&Peers::None);
}

#[test]
fn services_are_announced_under_a_hidden_node() {
    let service = add_two_ints();
    // Without a tag: RustDDS has none.
    let watcher = CycloneGraph::new(&config("watcher")).unwrap();
    let mut nodes = watcher.nodes().unwrap();
    let ours = services("bridge");
    let heard = Arc::new(Mutex::new(Vec::<ServiceEndpoints>::new()));
    let hears = Arc::clone(&heard);
    ours.on_change(move |endpoints| hears.lock().unwrap().push(endpoints.clone()));
    assert_eq!(ours.endpoints(), ServiceEndpoints::default());
    let a = server(&ours, &service);
    let b = client(&ours, &service);
    let there = ours.endpoints();
    assert_eq!((there.readers.len(), there.writers.len()), (2, 2));
    let mut all_owned = |gids: &ServiceEndpoints, owner: Option<&str>| {
        until("the announcement", || {
            nodes.update();
            gids.readers.iter().chain(&gids.writers).all(|gid| nodes.owner(gid) == owner)
        });
    };
    all_owned(&there, Some("/robot/_bridge_services"));
    // And their names and types, by the same GUIDs.
    until("the endpoints", || {
        let found = watcher.endpoints().unwrap();
        let named = |gid: &[u8; 16]| found.iter().find(|endpoint| endpoint.gid == *gid).cloned();
        let (Some(requests), Some(replies)) = (named(&there.readers[0]), named(&there.writers[0]))
        else {
            return false;
        };
        assert_eq!(requests.dds_topic, format!("rq{}Request", service.name));
        assert_eq!(requests.dds_type, "example_interfaces::srv::dds_::AddTwoInts_Request_");
        assert_eq!(replies.dds_topic, format!("rr{}Reply", service.name));
        assert_eq!(replies.dds_type, "example_interfaces::srv::dds_::AddTwoInts_Response_");
        true
    });
    drop(a);
    let left = ours.endpoints();
    assert_eq!((left.readers.len(), left.writers.len()), (1, 1));
    let gone =
        ServiceEndpoints { readers: vec![there.readers[0]], writers: vec![there.writers[0]] };
    all_owned(&gone, None);
    all_owned(&left, Some("/robot/_bridge_services"));
    drop(b);
    all_owned(&left, None);
    let counts: Vec<_> = heard.lock().unwrap().iter().map(|change| change.readers.len()).collect();
    assert_eq!(counts, [0, 1, 2, 1, 0]);
}

#[test]
fn callbacks_may_create_and_drop_services() {
    let service = add_two_ints();
    let ours = services("caller");
    let held = Arc::new(Mutex::new(None));
    let (made, wake) = (Arc::new(Mutex::new(false)), Wake::new());
    let callback = {
        let (ours, held, made) = (ours.clone(), Arc::clone(&held), Arc::clone(&made));
        let (service, wake) = (service.clone(), wake.clone());
        Arc::new(move || {
            // On the participant's own thread.
            let kept: Option<Box<dyn Send>> = held.lock().unwrap().take();
            if kept.is_some() {
                drop(ours.client(&service, bell(&wake)).unwrap());
                drop(kept);
                *made.lock().unwrap() = true;
                wake.ring();
            }
        })
    };
    let listening = ours.client(&service, callback).unwrap();
    let other = server(&ours, &service);
    *held.lock().unwrap() = Some(Box::new(other.server) as Box<dyn Send>);
    let adder = services("adder");
    let theirs = server(&adder, &service);
    until("the callback", || *made.lock().unwrap());
    drop(listening);
    assert_eq!(ours.gid(), None);
    drop(theirs);
}

#[test]
fn what_rustdds_cannot_do_is_said() {
    let mut wanted = config("n");
    wanted.discovery_range = DiscoveryRange::Off;
    assert!(matches!(RustServices::new(&wanted), Err(RustServicesError::Off)));
    wanted.discovery_range = DiscoveryRange::Subnet;
    wanted.interface = Some("no_such_interface".into());
    let error = RustServices::new(&wanted).err().unwrap();
    assert!(error.to_string().contains("lo"), "{error}");
    wanted.interface = None;
    wanted.static_peers.push("192.0.2.1".into());
    drop(RustServices::new(&wanted).unwrap());
}
