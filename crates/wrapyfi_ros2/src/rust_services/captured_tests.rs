//! Pairing of replies and requests: identities of both vendors, over all captured services.

use std::collections::BTreeSet;

use rustdds::rpc::SampleIdentity;
use rustdds::{GUID, SequenceNumber};

use super::identity;
use crate::graph::RequestId;
use crate::names::{self, RosName};
use crate::service_header;
use crate::wire_tests::{FILES, Record, list_of, parameters, records};

/// Under these two ids Fast DDS writes the identity.
const IDS: [u16; 2] = [0x0083, 0x800f];

/// The identity in 24 bytes: GUID, and the two halves of the number.
fn related(bytes: &[u8]) -> SampleIdentity {
    let (guid, number) = bytes.split_first_chunk::<16>().unwrap();
    let (high, low) = number.split_first_chunk::<4>().unwrap();
    let low = u32::from_le_bytes(low.try_into().unwrap());
    SampleIdentity {
        writer_guid: GUID::from_bytes(*guid),
        sequence_number: SequenceNumber::from_high_low(i32::from_le_bytes(*high), low),
    }
}

fn bytes(identity: &SampleIdentity) -> Vec<u8> {
    let number = identity.sequence_number;
    let (high, low) = (number.high().to_le_bytes(), number.low().to_le_bytes());
    [&identity.writer_guid.to_bytes()[..], &high, &low].concat()
}

/// Inline QoS with an identity, as Fast DDS writes it.
fn inline_qos(identity: &SampleIdentity) -> Vec<u8> {
    list_of(&IDS.map(|id| (id, bytes(identity))))
}

/// The request that a record of Fast DDS is, or that it answers; the parameter list is reproduced.
fn named_by_fast(record: &Record, is_request: bool) -> RequestId {
    let place = &record.place;
    let found = parameters(&record.inline_qos);
    assert_eq!(found.iter().map(|(id, _)| *id).collect::<Vec<_>>(), IDS, "{place}");
    assert_eq!(found[0].1, found[1].1, "{place}");
    let carried = related(&found[0].1);
    assert_eq!(bytes(&carried).len(), identity::BYTES);
    let (id, ours) = if is_request {
        let id = identity::request_id(Some(carried), record.writer(), record.sequence());
        (id, identity::of_request(GUID::from_bytes(id.client)))
    } else {
        let (client, sequence) = identity::reply_to(Some(carried)).unwrap();
        let id = RequestId { client, sequence };
        (id, identity::of_reply(&id))
    };
    assert_eq!(inline_qos(&ours), record.inline_qos, "{place}");
    id
}

/// The same of CycloneDDS, whose payload is reproduced where the topics are.
fn named_by_cyclone(record: &Record) -> RequestId {
    let split = service_header::split(record.payload.as_ref().unwrap()).unwrap();
    let mut client = [0; 16];
    client[..8].copy_from_slice(&split.client.to_le_bytes());
    RequestId { client, sequence: split.sequence }
}

#[test]
fn every_captured_reply_names_a_captured_request() {
    let (mut requests_seen, mut replies_seen, mut unpaired) = (0, 0, 0);
    for (file, _) in FILES {
        for (group, all) in records(file) {
            let mut asked = BTreeSet::new();
            for record in all {
                let is_request = match names::from_dds(&record.kind) {
                    RosName::Requests(_) => true,
                    RosName::Replies(_) => false,
                    _ => continue,
                };
                let id = if record.fast {
                    named_by_fast(&record, is_request)
                } else {
                    named_by_cyclone(&record)
                };
                let key = (id.client, id.sequence);
                if is_request {
                    assert!(asked.insert(key), "{}: asked twice", record.place);
                    requests_seen += 1;
                } else if asked.contains(&key) {
                    replies_seen += 1;
                } else {
                    // A server on CycloneDDS that took the beginning of a request for its identity.
                    assert_eq!(group, "mixed_cyc_server_fast_client", "{}", record.place);
                    unpaired += 1;
                }
            }
        }
    }
    assert_eq!((requests_seen, replies_seen, unpaired), (68, 52, 4));
}
