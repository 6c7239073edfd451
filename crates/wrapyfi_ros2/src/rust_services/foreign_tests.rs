//! Peers on CycloneDDS, whose services are not ours.

use std::sync::Arc;
use std::time::Duration;

use super::RustServices;
use crate::config::CycloneConfig;
use crate::cyclone::{EndpointQos, Entity, Events, RawReader, RawWriter};
use crate::domain::DomainLease;
use crate::graph::{
    GraphError, Notify, Peers, Replay, ServiceDescription, ServiceMapping, wait_until,
};
use wrapyfi_endpoint::{Durability, History, Qos, Reliability, Wake};
use wrapyfi_node::NodeName;

const TIMEOUT: Duration = Duration::from_secs(30);
const REQUEST: &str = "example_interfaces::srv::dds_::AddTwoInts_Request_";
const RESPONSE: &str = "example_interfaces::srv::dds_::AddTwoInts_Response_";

/// Fields drop in this order.
struct Cyclone {
    writer: RawWriter,
    _reader: RawReader,
    _participant: Entity,
    _domain: DomainLease,
}

/// The writer and the reader of one end of a service, and nothing else of a node.
fn cyclone(config: &CycloneConfig, written: (&str, &str), read: (&str, &str)) -> Cyclone {
    let domain = DomainLease::acquire(config).unwrap();
    let participant = Entity::participant(config.domain_id, "").unwrap();
    let qos = EndpointQos {
        qos: Qos {
            reliability: Reliability::Reliable,
            durability: Durability::Volatile,
            history: History::KeepLast(10),
            ..Qos::default()
        },
        max_blocking: Duration::from_millis(100),
        user_data: "",
        ignore_local: true,
        replay: Replay::History,
        partition: None,
    };
    let events = |name| Events::new(name, Reliability::Reliable, Arc::new(|| {}));
    let reader = RawReader::new(&participant, read, &qos, events(read.0)).unwrap();
    let writer = RawWriter::new(&participant, written, &qos, events(written.0)).unwrap();
    Cyclone { writer, _reader: reader, _participant: participant, _domain: domain }
}

fn bell(wake: &Wake) -> Notify {
    let wake = wake.clone();
    Arc::new(move || wake.ring())
}

/// Configuration of a node on a domain, and a service whose name no other run has.
fn setting(node: &str, test: u32) -> (CycloneConfig, ServiceDescription) {
    let domain_id = 81 + std::process::id() % 10 * 2 + test;
    let config = CycloneConfig::loopback(NodeName::new(node, "/").unwrap(), domain_id);
    (config, adder())
}

/// A service whose name no other run has.
pub(super) fn adder() -> ServiceDescription {
    ServiceDescription {
        name: format!("/add_{}", std::process::id()),
        type_name: "example_interfaces/srv/AddTwoInts".into(),
        type_hash: None,
        request_hash: None,
        response_hash: None,
        depth: 10,
        max_bytes: 1000,
    }
}

#[test]
fn a_client_of_cyclones_is_refused_by_name() {
    let (config, service) = setting("adder", 0);
    let wake = Wake::new();
    let services = RustServices::new(&config).unwrap();
    let mut server = services.server(&service, bell(&wake)).unwrap();
    let (requests, replies) =
        (format!("rq{}Request", service.name), format!("rr{}Reply", service.name));
    let client = cyclone(&config, (&requests, REQUEST), (&replies, RESPONSE));
    let foreign = Peers::Foreign(ServiceMapping::Cyclone);
    assert!(wait_until(&wake, TIMEOUT, || server.clients() == foreign));
    let mut error = None;
    assert!(wait_until(&wake, TIMEOUT, || {
        // A request of rmw_cyclonedds_cpp: its client, its number, then 2 and 3.
        let mut request = vec![0, 1, 0, 0];
        [0x25_8b, 1, 2, 3_i64].iter().for_each(|word| request.extend(word.to_le_bytes()));
        assert!(client.writer.write(&[&request]).is_ok());
        error = server.take().err();
        error.is_some()
    }));
    let expected = GraphError::ForeignMapping {
        service: service.name,
        ours: ServiceMapping::FastDds,
        theirs: ServiceMapping::Cyclone,
    };
    assert_eq!(error, Some(expected));
}

#[test]
fn a_server_of_cyclones_is_foreign_and_its_replies_pass_by() {
    let (config, service) = setting("caller", 1);
    let wake = Wake::new();
    let services = RustServices::new(&config).unwrap();
    let mut client = services.client(&service, bell(&wake)).unwrap();
    let (requests, replies) =
        (format!("rq{}Request", service.name), format!("rr{}Reply", service.name));
    let server = cyclone(&config, (&replies, RESPONSE), (&requests, REQUEST));
    let foreign = Peers::Foreign(ServiceMapping::Cyclone);
    assert!(wait_until(&wake, TIMEOUT, || client.servers() == foreign));
    for _ in 0..20 {
        assert!(server.writer.write(&[&[0, 1, 0, 0], &[7; 24]]).is_ok());
    }
    server.writer.wait_for_acks(5_000_000_000).unwrap();
    assert_eq!(client.take(), Ok(None));
    assert_eq!(services.endpoints().readers.len(), 1);
}
