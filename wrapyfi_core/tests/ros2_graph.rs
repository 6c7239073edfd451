//! The graph on CycloneDDS, seen from a second node.
//!
//! Two nodes on one domain id of a process share Cyclone's local delivery; to have bytes on the
//! loopback the second one gets a domain of another id with the same external id.
#![cfg(feature = "ros2")]
// In helpers of tests, too, a panic is the right answer.
#![allow(clippy::unwrap_used, clippy::indexing_slicing, clippy::panic)]

use std::sync::Arc;
use std::time::{Duration, Instant};

use wrapyfi_core::endpoint::{Durability, History, Qos, QosPreset, Reliability, Wake};
use wrapyfi_core::middleware::ros2::graph::{
    CdrReader, CdrSample, CdrWriter, Graph, GraphError, NodeIdentity, Notify, TopicDescription,
    wait_until,
};
use wrapyfi_core::middleware::ros2::{CycloneConfig, CycloneError, CycloneGraph, DomainError};

const PATIENCE: Duration = Duration::from_secs(30);
const HASH: &str = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";

fn identity(name: &str) -> NodeIdentity {
    NodeIdentity { name: name.into(), namespace: "/test".into() }
}

fn near(name: &str, domain_id: u32) -> CycloneGraph {
    CycloneGraph::new(&CycloneConfig::loopback(identity(name), domain_id)).unwrap()
}

/// A node on the same wire as `near` ones of `domain_id`, in a stack of its own.
fn far(name: &str, domain_id: u32) -> CycloneGraph {
    CycloneGraph::new(&far_config(name, domain_id)).unwrap()
}

fn far_config(name: &str, domain_id: u32) -> CycloneConfig {
    let mut config = CycloneConfig::loopback(identity(name), 1000 + domain_id);
    config.extra_uri = Some(format!(
        "<CycloneDDS><Domain><Discovery><ExternalDomainId>{domain_id}</ExternalDomainId>\
         </Discovery></Domain></CycloneDDS>"
    ));
    config
}

fn topic(name: &str) -> TopicDescription {
    TopicDescription {
        name: name.into(),
        type_name: "std_msgs/msg/String".into(),
        type_hash: Some(HASH.into()),
        qos: Qos::default(),
        max_bytes: 64 << 20,
    }
}

fn bell(wake: &Wake) -> Notify {
    let wake = wake.clone();
    Arc::new(move || wake.ring())
}

struct Ends {
    wake: Wake,
    writer: Box<dyn CdrWriter>,
    reader: Box<dyn CdrReader>,
}

/// A writer in one node, a reader in the other, matched.
fn connect(from: &CycloneGraph, to: &CycloneGraph, topic: &TopicDescription) -> Ends {
    let wake = Wake::new();
    let writer = from.advertise(topic, bell(&wake)).unwrap();
    let reader = to.subscribe(topic, bell(&wake)).unwrap();
    assert!(wait_until(&wake, PATIENCE, || writer.matched() == 1 && reader.matched() == 1));
    Ends { wake, writer, reader }
}

fn next(reader: &mut dyn CdrReader, wake: &Wake) -> CdrSample {
    let mut sample = None;
    assert!(wait_until(wake, PATIENCE, || {
        sample = reader.take().unwrap();
        sample.is_some()
    }));
    sample.unwrap()
}

/// Header, length, text and its NUL.
fn message(text: &[u8]) -> Vec<Vec<u8>> {
    let length = u32::try_from(text.len() + 1).unwrap().to_le_bytes();
    vec![vec![0, 1, 0, 0], length.to_vec(), text.to_vec(), vec![0]]
}

fn write(writer: &mut dyn CdrWriter, text: &[u8]) -> Result<(), GraphError> {
    let message = message(text);
    let parts: Vec<&[u8]> = message.iter().map(Vec::as_slice).collect();
    writer.write(&parts)
}

fn text(sample: &CdrSample) -> Vec<u8> {
    let cdr = &sample.cdr;
    assert_eq!(cdr[..4], [0, 1, 0, 0]);
    assert_eq!(cdr.len() % 4, 0, "whole words");
    let length = u32::from_le_bytes(cdr[4..8].try_into().unwrap()) as usize;
    assert!(cdr[8 + length - 1..].iter().all(|&byte| byte == 0), "NUL and zero padding");
    cdr[8..8 + length - 1].to_vec()
}

fn pattern(bytes: usize) -> Vec<u8> {
    (0..bytes).map(|n| u8::try_from(n % 251).unwrap() + 1).collect()
}

fn exchange(a: &CycloneGraph, b: &CycloneGraph) {
    let chatter = topic("/chatter");
    for (from, to) in [(a, b), (b, a)] {
        let mut ends = connect(from, to, &chatter);
        for size in [0, 1, 2, 3, 1500, 63_990, 64_010, 65_600, 1 << 20, 6_220_800] {
            let sent = pattern(size);
            write(&mut *ends.writer, &sent).unwrap();
            let got = next(&mut *ends.reader, &ends.wake);
            assert!(text(&got) == sent, "{size} bytes changed");
            assert!(got.source_timestamp_ns > 1_500_000_000_000_000_000);
        }
        assert_eq!(ends.reader.lost(), 0);
    }
}

#[test]
fn messages_of_all_sizes_go_both_ways_in_one_stack() {
    exchange(&near("a", 140), &near("b", 140));
}

#[test]
fn messages_of_all_sizes_go_both_ways_over_loopback() {
    exchange(&near("a", 141), &far("b", 141));
}

#[test]
fn a_late_reader_gets_what_is_kept() {
    let (a, b) = (near("a", 142), far("b", 142));
    let mut latched = topic("/latched");
    latched.qos = QosPreset::Latched.into();
    latched.qos.history = History::KeepLast(3);
    let wake = Wake::new();
    let mut writer = a.advertise(&latched, bell(&wake)).unwrap();
    for n in 0..5_u8 {
        write(&mut *writer, &[b'0' + n]).unwrap();
    }
    let mut reader = b.subscribe(&latched, bell(&wake)).unwrap();
    for n in 2..5_u8 {
        assert_eq!(text(&next(&mut *reader, &wake)), [b'0' + n]);
    }
    assert_eq!(reader.take().unwrap(), None);
}

#[test]
fn a_node_does_not_hear_itself() {
    let (a, b) = (near("a", 143), near("b", 143));
    let chatter = topic("/chatter");
    let wake = Wake::new();
    let mut own = a.subscribe(&chatter, bell(&wake)).unwrap();
    let mut ends = connect(&a, &b, &chatter);
    write(&mut *ends.writer, b"x").unwrap();
    assert_eq!(text(&next(&mut *ends.reader, &ends.wake)), b"x");
    assert_eq!((own.matched(), own.take().unwrap()), (0, None));
}

#[test]
fn matches_come_and_go() {
    let (a, b) = (near("a", 144), far("b", 144));
    let chatter = topic("/chatter");
    let Ends { wake, writer, reader } = connect(&a, &b, &chatter);
    let second = b.subscribe(&chatter, bell(&wake)).unwrap();
    assert!(wait_until(&wake, PATIENCE, || writer.matched() == 2));
    drop(reader);
    assert!(wait_until(&wake, PATIENCE, || writer.matched() == 1));
    drop(second);
    assert!(wait_until(&wake, PATIENCE, || writer.matched() == 0));
    let third = b.subscribe(&chatter, bell(&wake)).unwrap();
    assert!(wait_until(&wake, PATIENCE, || third.matched() == 1));
    drop(writer);
    assert!(wait_until(&wake, PATIENCE, || third.matched() == 0));
}

#[test]
fn another_type_does_not_match_and_is_listed_with_its_hash() {
    let (a, b) = (near("a", 145), far("b", 145));
    let wake = Wake::new();
    let mut other = topic("/chatter");
    other.type_name = "std_msgs/msg/Int32".into();
    let writer = a.advertise(&topic("/chatter"), bell(&wake)).unwrap();
    let reader = b.subscribe(&other, bell(&wake)).unwrap();
    let seen =
        || b.endpoints().unwrap().into_iter().find(|e| e.is_publisher && e.topic == "/chatter");
    assert!(wait_until(&wake, PATIENCE, || seen().is_some()));
    let seen = seen().unwrap();
    assert_eq!(seen.type_name, "std_msgs/msg/String");
    assert_eq!(seen.type_hash.as_deref(), Some(HASH));
    assert_eq!(seen.gid[..12], a.gid()[..12]);
    assert_eq!((writer.matched(), reader.matched()), (0, 0));
}

#[test]
fn incompatible_quality_of_service_names_its_policy() {
    let (a, b) = (near("a", 146), far("b", 146));
    let wake = Wake::new();
    let mut offered = topic("/best_effort");
    offered.qos.reliability = Reliability::BestEffort;
    let writer = a.advertise(&offered, bell(&wake)).unwrap();
    let reader = b.subscribe(&topic("/best_effort"), bell(&wake)).unwrap();
    assert!(wait_until(&wake, PATIENCE, || {
        writer.incompatible() == Some("reliability") && reader.incompatible() == Some("reliability")
    }));
    let offered = topic("/volatile");
    let mut asked = offered.clone();
    asked.qos.durability = Durability::TransientLocal;
    let writer = a.advertise(&offered, bell(&wake)).unwrap();
    let reader = b.subscribe(&asked, bell(&wake)).unwrap();
    assert!(wait_until(&wake, PATIENCE, || {
        writer.incompatible() == Some("durability") && reader.incompatible() == Some("durability")
    }));
    assert_eq!((writer.matched(), reader.matched()), (0, 0));
}

#[test]
fn a_message_over_the_limit_is_refused_and_the_next_one_comes() {
    let (a, b) = (near("a", 147), far("b", 147));
    let mut small = topic("/small");
    small.max_bytes = 1000;
    let Ends { wake, mut writer, mut reader } = connect(&a, &b, &small);
    write(&mut *writer, &pattern(991)).unwrap();
    write(&mut *writer, &pattern(992)).unwrap();
    write(&mut *writer, b"after").unwrap();
    assert_eq!(text(&next(&mut *reader, &wake)).len(), 991);
    let mut fault = None;
    assert!(wait_until(&wake, PATIENCE, || {
        fault = reader.take().err();
        fault.is_some()
    }));
    assert_eq!(
        fault,
        Some(GraphError::TooLarge { topic: "rt/small".into(), actual: 1004, limit: 1000 })
    );
    assert_eq!(text(&next(&mut *reader, &wake)), b"after");
}

#[test]
fn a_message_far_over_the_limit_is_discarded_by_its_header() {
    let mut config = far_config("b", 157);
    config.max_message_bytes = 25_000;
    let (a, b) = (near("a", 157), CycloneGraph::new(&config).unwrap());
    for size in [100_001, 6_000_000] {
        let Ends { wake, mut writer, mut reader } = connect(&a, &b, &topic("/chatter"));
        write(&mut *writer, &pattern(size)).unwrap();
        write(&mut *writer, &pattern(99_000)).unwrap();
        assert_eq!(text(&next(&mut *reader, &wake)).len(), 99_000);
    }
}

#[test]
fn one_reader_that_is_not_taken_from_stops_nobody() {
    let (a, b) = (near("a", 148), far("b", 148));
    let mut kept = topic("/kept");
    kept.qos.history = History::KeepAll;
    let mut slow = connect(&a, &b, &kept);
    let mut quick = connect(&a, &b, &topic("/quick"));
    for n in 0..200_u32 {
        write(&mut *slow.writer, &n.to_le_bytes().repeat(5_000)).unwrap();
        write(&mut *quick.writer, b"quick").unwrap();
        assert_eq!(text(&next(&mut *quick.reader, &quick.wake)), b"quick");
    }
    for n in 0..200_u32 {
        assert!(text(&next(&mut *slow.reader, &slow.wake)).starts_with(&n.to_le_bytes()));
    }
}

#[test]
fn messages_outlive_everything_they_came_through() {
    let (a, b) = (near("a", 149), near("b", 149));
    let mut ends = connect(&a, &b, &topic("/chatter"));
    let sent = pattern(100_000);
    write(&mut *ends.writer, &sent).unwrap();
    let kept = next(&mut *ends.reader, &ends.wake);
    drop((ends, a, b));
    assert!(std::thread::spawn(move || text(&kept)).join().unwrap() == sent);
}

/// Node namespace and name, readers, writers.
type Entry = (String, String, Vec<Vec<u8>>, Vec<Vec<u8>>);

/// Participant GID and nodes of a `ParticipantEntitiesInfo`.
fn participant_info(cdr: &[u8]) -> (Vec<u8>, Vec<Entry>) {
    struct Cursor<'a>(&'a [u8], usize);
    impl Cursor<'_> {
        fn bytes(&mut self, n: usize) -> Vec<u8> {
            self.1 += n;
            self.0[self.1 - n..self.1].to_vec()
        }
        fn length(&mut self) -> usize {
            self.1 = self.1.next_multiple_of(4);
            u32::from_le_bytes(self.bytes(4).try_into().unwrap()) as usize
        }
        fn string(&mut self) -> String {
            let length = self.length();
            let mut bytes = self.bytes(length);
            assert_eq!(bytes.pop(), Some(0));
            String::from_utf8(bytes).unwrap()
        }
        fn gids(&mut self) -> Vec<Vec<u8>> {
            (0..self.length()).map(|_| self.bytes(16)).collect()
        }
    }
    let mut cursor = Cursor(cdr, 4);
    let gid = cursor.bytes(16);
    let nodes = (0..cursor.length())
        .map(|_| (cursor.string(), cursor.string(), cursor.gids(), cursor.gids()))
        .collect();
    (gid, nodes)
}

#[test]
fn the_node_and_its_endpoints_are_announced() {
    let (a, b) = (near("camera", 150), far("watcher", 150));
    let wake = Wake::new();
    let mut info = topic("ros_discovery_info");
    info.type_name = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_".into();
    info.qos = QosPreset::Latched.into();
    let mut infos = b.subscribe_dds(&info, bell(&wake)).unwrap();
    let announcer = a.gid();
    let mut until = |what: &str, condition: &dyn Fn(&[Entry]) -> bool| {
        let held = wait_until(&wake, PATIENCE, || {
            std::iter::from_fn(|| infos.take().unwrap()).any(|sample| {
                let (gid, nodes) = participant_info(&sample.cdr);
                gid == announcer && condition(&nodes)
            })
        });
        assert!(held, "{what}");
    };

    until("the node alone", &|nodes| {
        matches!(nodes, [(ns, name, r, w)]
            if ns == "/test" && name == "camera" && r.is_empty() && w.is_empty())
    });
    let writer = a.advertise(&topic("/image"), bell(&Wake::new())).unwrap();
    let reader = a.subscribe(&topic("/trigger"), bell(&Wake::new())).unwrap();
    let gid_of = |publisher: bool, name: &str| {
        let all = a.endpoints().unwrap();
        let found = all.iter().find(|e| e.is_publisher == publisher && e.topic == name).unwrap();
        found.gid.to_vec()
    };
    let (w, r) = (gid_of(true, "/image"), gid_of(false, "/trigger"));
    until("both endpoints", &|nodes| {
        matches!(nodes, [(_, _, readers, writers)]
            if readers[..] == [r.clone()] && writers[..] == [w.clone()])
    });
    drop(writer);
    until(
        "the writer is gone",
        &|nodes| matches!(nodes, [(_, _, readers, writers)] if readers.len() == 1 && writers.is_empty()),
    );
    drop(reader);
    drop(a);
    until("the node is gone", &<[Entry]>::is_empty);
}

#[test]
fn one_domain_has_one_configuration() {
    let first = near("a", 151);
    let mut other = CycloneConfig::loopback(identity("b"), 151);
    other.discovery.static_peers.push("127.0.0.2".into());
    let clash = CycloneGraph::new(&other).err();
    assert!(
        matches!(clash, Some(CycloneError::Domain(DomainError::Clash { id: 151, .. }))),
        "{clash:?}"
    );
    drop(first);
    CycloneGraph::new(&other).unwrap();
}

#[test]
fn a_later_source_overrides_an_earlier_one() {
    use wrapyfi_core::middleware::ros2::environment::DiscoveryRange;
    // OFF gives each process a tag of its own and no peers; the later source takes both back.
    let off = |name: &str, id: u32| {
        let mut config = CycloneConfig::loopback(identity(name), id);
        config.discovery.range = DiscoveryRange::Off;
        config.extra_uri = Some(
            "<CycloneDDS><Domain><Discovery><ExternalDomainId>152</ExternalDomainId>\
             <Tag>ours</Tag><ParticipantIndex>auto</ParticipantIndex>\
             <Peers><Peer address='localhost'/></Peers></Discovery></Domain></CycloneDDS>"
                .into(),
        );
        config
    };
    let tagged = CycloneGraph::new(&off("a", 152)).unwrap();
    let mut config = CycloneConfig::loopback(identity("b"), 1152);
    config.extra_uri = Some(
        "<CycloneDDS><Domain><Discovery><ExternalDomainId>152</ExternalDomainId>\
         <Tag>ours</Tag></Discovery></Domain></CycloneDDS>"
            .into(),
    );
    let plain = CycloneGraph::new(&config).unwrap();
    let mut ends = connect(&tagged, &plain, &topic("/chatter"));
    write(&mut *ends.writer, b"heard").unwrap();
    assert_eq!(text(&next(&mut *ends.reader, &ends.wake)), b"heard");
}

#[test]
fn broken_configuration_and_names_are_refused() {
    let mut config = CycloneConfig::loopback(identity("a"), 153);
    config.extra_uri = Some("<CycloneDDS><Nonsense/></CycloneDDS>".into());
    let fault = CycloneGraph::new(&config).err();
    assert!(
        matches!(fault, Some(CycloneError::Domain(DomainError::Refused { id: 153, .. }))),
        "{fault:?}"
    );
    let bad = CycloneGraph::new(&CycloneConfig::loopback(identity("a b"), 153)).err();
    assert!(matches!(bad, Some(CycloneError::Name { .. })), "{bad:?}");
    let node = near("a", 153);
    let nul = node.advertise(&topic("/a\0b"), bell(&Wake::new())).err();
    assert!(matches!(nul, Some(GraphError::Stack { operation: "naming", .. })), "{nul:?}");
}

#[test]
fn nodes_come_and_go_under_traffic() {
    let steady = near("steady", 154);
    let chatter = topic("/chatter");
    let wake = Wake::new();
    let stop = Arc::new(std::sync::atomic::AtomicBool::new(false));
    let mut writer = steady.advertise(&chatter, bell(&wake)).unwrap();
    let stopped = Arc::clone(&stop);
    let talker = std::thread::spawn(move || {
        let sent = pattern(3000);
        while !stopped.load(std::sync::atomic::Ordering::Relaxed) {
            // A subscriber that goes away in the middle may cost a time-out, nothing else.
            match write(&mut *writer, &sent) {
                Ok(()) | Err(GraphError::Timeout { .. }) => {}
                Err(error) => panic!("{error}"),
            }
            std::thread::yield_now();
        }
    });
    let started = Instant::now();
    for round in 0..100 {
        let node = near("guest", 154);
        let bell_of = Wake::new();
        let mut reader = node.subscribe(&chatter, bell(&bell_of)).unwrap();
        let own = node.advertise(&topic("/guest"), bell(&bell_of)).unwrap();
        assert_eq!(text(&next(&mut *reader, &bell_of)).len(), 3000);
        if round % 2 == 0 {
            drop(node);
            drop((own, reader));
        }
    }
    stop.store(true, std::sync::atomic::Ordering::Relaxed);
    talker.join().unwrap();
    println!("100 rounds in {:?}", started.elapsed());
}

#[test]
fn domains_come_and_go() {
    for _ in 0..100 {
        let node = near("a", 155);
        drop(node.advertise(&topic("/chatter"), bell(&Wake::new())).unwrap());
    }
}

#[test]
fn the_finest_trace_is_survived() {
    let file = std::env::temp_dir().join(format!("wrapyfi_trace_{}.log", std::process::id()));
    let mut config = CycloneConfig::loopback(identity("a"), 156);
    config.extra_uri = Some(format!(
        "<CycloneDDS><Domain><Tracing><Verbosity>finest</Verbosity><OutputFile>{}</OutputFile>\
         </Tracing></Domain></CycloneDDS>",
        file.display()
    ));
    let a = CycloneGraph::new(&config).unwrap();
    exchange_small(&a, &far("b", 156));
    drop(a);
    assert!(std::fs::read_to_string(&file).unwrap().contains("rt/chatter"));
    std::fs::remove_file(file).unwrap();
}

fn exchange_small(a: &CycloneGraph, b: &CycloneGraph) {
    for (from, to) in [(a, b), (b, a)] {
        let mut ends = connect(from, to, &topic("/chatter"));
        write(&mut *ends.writer, b"small").unwrap();
        assert_eq!(text(&next(&mut *ends.reader, &ends.wake)), b"small");
    }
}

#[test]
fn cyclone_accepts_the_settings_of_every_range() {
    use wrapyfi_core::middleware::ros2::environment::{self, DiscoveryRange};
    // As from the environment, but kept on lo by the user's own source.
    let on_lo = "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo'/>\
                 </Interfaces><AllowMulticast>false</AllowMulticast></General></Domain></CycloneDDS>";
    for (range, expected) in [
        ("SUBNET", DiscoveryRange::Subnet),
        ("LOCALHOST", DiscoveryRange::Localhost),
        ("OFF", DiscoveryRange::Off),
        ("SYSTEM_DEFAULT", DiscoveryRange::SystemDefault),
    ] {
        let read = environment::read(|name| match name {
            "ROS_DOMAIN_ID" => Some("158".into()),
            "ROS_AUTOMATIC_DISCOVERY_RANGE" => Some(range.into()),
            "ROS_STATIC_PEERS" => Some("127.0.0.1;127.0.0.2".into()),
            "CYCLONEDDS_URI" => Some(on_lo.into()),
            _ => None,
        })
        .unwrap();
        assert_eq!(read.discovery.range, expected);
        let config = CycloneConfig::from_environment(identity("a"), &read);
        CycloneGraph::new(&config).unwrap_or_else(|error| panic!("{range}: {error}"));
    }
}
