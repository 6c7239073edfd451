//! Callbacks that do what they may: panic, and drop the endpoint they were called for.
#![allow(unsafe_code)]

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::ptr;
use std::sync::mpsc;
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use wrapyfi_endpoint::{Durability, History, Qos, Reliability};
use wrapyfi_node::NodeName;

use super::{BuiltinReader, EndpointQos, Entity, Events, RawReader, RawWriter, topic};
use crate::config::CycloneConfig;
use crate::domain::DomainLease;
use crate::graph::{Notify, Replay};

const WAIT: Duration = Duration::from_secs(20);
const NAMES: (&str, &str) = ("rt/callbacks", "std_msgs::msg::dds_::String_");

/// A participant in a domain that no other run has. Fields drop in this order.
struct Peer {
    participant: Entity,
    _domain: DomainLease,
}

fn peer(test: u32) -> Peer {
    let domain_id = 101 + std::process::id() % 10 * 3 + test;
    let config = CycloneConfig::loopback(NodeName::new("n", "/").unwrap(), domain_id);
    let domain = DomainLease::acquire(&config).unwrap();
    Peer { participant: Entity::participant(domain_id, "").unwrap(), _domain: domain }
}

fn qos(user_data: &str) -> EndpointQos<'_> {
    EndpointQos {
        qos: Qos {
            reliability: Reliability::Reliable,
            durability: Durability::Volatile,
            history: History::KeepLast(1),
            ..Qos::default()
        },
        max_blocking: Duration::from_millis(100),
        user_data,
        ignore_local: false,
        replay: Replay::History,
        partition: None,
    }
}

fn events(notify: Notify) -> Arc<Events> {
    Events::new(NAMES.0, Reliability::Reliable, notify)
}

/// Pages of memory that the process holds.
fn pages() -> usize {
    let text = std::fs::read_to_string("/proc/self/statm").unwrap();
    text.split(' ').nth(1).unwrap().parse().unwrap()
}

#[test]
fn what_cyclone_lent_goes_back_where_a_callback_panics() {
    let peer = peer(0);
    let reader = BuiltinReader::new(&peer.participant, true, Arc::new(|| {})).unwrap();
    // Each sample of discovery holds a copy of this.
    let large = "x".repeat(60_000);
    let round = || {
        let events = events(Arc::new(|| {}));
        let writer = RawWriter::new(&peer.participant, NAMES, &qos(&large), events).unwrap();
        let panicked =
            catch_unwind(AssertUnwindSafe(|| reader.take(|_, _| resume_unwind(Box::new(())))));
        assert!(panicked.is_err(), "no news of a writer");
        drop(writer);
        reader.take(|_, _| {}).unwrap();
    };
    (0..50).for_each(|_| round());
    let before = pages();
    (0..2000).for_each(|_| round());
    let grown = pages().saturating_sub(before) * 4096;
    assert!(grown < 60_000_000, "{grown} bytes more after 2000 panics");
}

#[test]
fn a_callback_may_drop_its_own_endpoint() {
    let peer = peer(1);
    let slot = Arc::new(Mutex::new(None::<RawReader>));
    let (dropped, told) = mpsc::channel();
    let notify: Notify = {
        let slot = Arc::clone(&slot);
        Arc::new(move || {
            let reader = slot.lock().unwrap().take();
            if reader.is_some() {
                drop(reader);
                dropped.send(()).unwrap();
            }
        })
    };
    let reader = RawReader::new(&peer.participant, NAMES, &qos(""), events(notify)).unwrap();
    *slot.lock().unwrap() = Some(reader);
    let (made, writer) = mpsc::channel();
    // Apart from this thread, which a deletion that waits for itself would hold for ever.
    thread::spawn(move || {
        let events = events(Arc::new(|| {}));
        let writer = RawWriter::new(&peer.participant, NAMES, &qos(""), events).unwrap();
        made.send((writer, peer)).unwrap();
    });
    told.recv_timeout(WAIT).expect("the callback did not come back from dropping its reader");
    let (writer, _peer) = writer.recv_timeout(WAIT).unwrap();
    let end = Instant::now() + WAIT;
    while !writer.readers().unwrap().is_empty() {
        assert!(Instant::now() < end, "the reader is there after it was dropped");
        thread::yield_now();
    }
}

#[test]
fn topics_are_not_offered_to_shared_memory() {
    let peer = peer(2);
    let topic = topic::create(&peer.participant, NAMES.0, NAMES.1).unwrap();
    let mut sertype = ptr::null();
    // SAFETY: writes one pointer, valid while the topic lives.
    let code = unsafe { cyclors::dds_get_entity_sertype(topic.handle(), &raw mut sertype) };
    assert_eq!(code, 0);
    // SAFETY: the type is alive, its table is static.
    let functions = unsafe { &*(*sertype).serdata_ops };
    assert!(functions.from_psmx.is_none() && functions.from_loaned_sample.is_none());
}
