//! Nodes on CycloneDDS: their announcement, their configuration, their coming and going.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Instant;

use wrapyfi_endpoint::{QosPreset, Wake};
use wrapyfi_ros2::environment::{self, DiscoveryRange};
use wrapyfi_ros2::graph::{Graph, GraphError, wait_until};
use wrapyfi_ros2::{CycloneConfig, CycloneError, CycloneGraph, DomainError};

use crate::common::{
    TIMEOUT, bell, connect, discovery, domain, far, far_config, name, near, near_config, next,
    pattern, text, topic, write,
};

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
    let (a, b) = (near("camera"), far("watcher"));
    let wake = Wake::new();
    let mut info = topic("ros_discovery_info");
    info.type_name = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_".into();
    info.qos = QosPreset::Latched.into();
    let mut infos = b.subscribe_dds(&info, bell(&wake)).unwrap();
    let announcer = a.gid();
    let mut until = |what: &str, condition: &dyn Fn(&[Entry]) -> bool| {
        let held = wait_until(&wake, TIMEOUT, || {
            std::iter::from_fn(|| infos.take().unwrap()).any(|sample| {
                let (gid, nodes) = participant_info(&sample.cdr);
                gid == announcer && condition(&nodes)
            })
        });
        assert!(held, "{what}");
    };

    until("the node alone", &|nodes| {
        matches!(nodes, [(ns, name, r, w)]
            if ns == "/robot" && name == "camera" && r.is_empty() && w.is_empty())
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
    let first = near("a");
    let mut other = near_config("b");
    other.static_peers.push("127.0.0.2".into());
    let clash = CycloneGraph::new(&other).err();
    assert!(
        matches!(clash, Some(CycloneError::Domain(DomainError::Clash { id, .. })) if id == domain()),
        "{clash:?}"
    );
    drop(first);
    CycloneGraph::new(&other).unwrap();
}

#[test]
fn a_later_source_overrides_an_earlier_one() {
    // OFF gives each process a tag of its own and no peers; the later source takes both back.
    let tag = "<Tag>wrapyfi_test</Tag>";
    let mut config = near_config("a");
    config.discovery_range = DiscoveryRange::Off;
    config.extra_uri = Some(discovery(&format!(
        "{tag}<ParticipantIndex>auto</ParticipantIndex><Peers><Peer address='localhost'/></Peers>"
    )));
    let mut other = far_config("b");
    other.extra_uri = other.extra_uri.map(|uri| format!("{uri},{}", discovery(tag)));
    let [tagged, plain] = [config, other].map(|config| CycloneGraph::new(&config).unwrap());
    let mut ends = connect(&tagged, &plain, &topic("/chatter"));
    write(&mut *ends.writer, b"heard").unwrap();
    assert_eq!(text(&next(&mut *ends.reader, &ends.wake)), b"heard");
}

#[test]
fn broken_configuration_and_topics_are_refused() {
    let mut config = near_config("a");
    config.extra_uri = Some("<CycloneDDS><Nonsense/></CycloneDDS>".into());
    let fault = CycloneGraph::new(&config).err();
    assert!(
        matches!(fault, Some(CycloneError::Domain(DomainError::Refused { id, .. })) if id == domain()),
        "{fault:?}"
    );
    let node = near("a");
    let mut plain = topic("/a");
    plain.type_name = "String".into();
    for wrong in [topic("/a\0b"), topic("a"), plain] {
        let fault = node.advertise(&wrong, bell(&Wake::new())).err();
        assert!(matches!(fault, Some(GraphError::Stack { operation: "naming", .. })), "{fault:?}");
    }
}

#[test]
fn nodes_come_and_go_under_traffic() {
    let steady = near("steady");
    let chatter = topic("/chatter");
    let wake = Wake::new();
    let stop = Arc::new(AtomicBool::new(false));
    let mut writer = steady.advertise(&chatter, bell(&wake)).unwrap();
    let stopped = Arc::clone(&stop);
    let talker = std::thread::spawn(move || {
        let sent = pattern(3000);
        while !stopped.load(Relaxed) {
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
        let node = near("guest");
        let bell_of = Wake::new();
        let mut reader = node.subscribe(&chatter, bell(&bell_of)).unwrap();
        let own = node.advertise(&topic("/guest"), bell(&bell_of)).unwrap();
        assert_eq!(text(&next(&mut *reader, &bell_of)).len(), 3000);
        if round % 2 == 0 {
            drop(node);
            drop((own, reader));
        }
    }
    stop.store(true, Relaxed);
    talker.join().unwrap();
    println!("100 rounds in {:?}", started.elapsed());
}

#[test]
fn domains_come_and_go() {
    for _ in 0..100 {
        let node = near("a");
        drop(node.advertise(&topic("/chatter"), bell(&Wake::new())).unwrap());
    }
}

#[test]
fn the_finest_trace_is_survived() {
    let file = std::env::temp_dir().join(format!("wrapyfi_trace_{}.log", std::process::id()));
    let mut config = near_config("a");
    config.extra_uri = Some(format!(
        "<CycloneDDS><Domain><Tracing><Verbosity>finest</Verbosity><OutputFile>{}</OutputFile>\
         </Tracing></Domain></CycloneDDS>",
        file.display()
    ));
    let a = CycloneGraph::new(&config).unwrap();
    exchange_small(&a, &far("b"));
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
            "ROS_DOMAIN_ID" => Some(domain().to_string()),
            "ROS_AUTOMATIC_DISCOVERY_RANGE" => Some(range.into()),
            "ROS_STATIC_PEERS" => Some("127.0.0.1;127.0.0.2".into()),
            "CYCLONEDDS_URI" => Some(on_lo.into()),
            _ => None,
        })
        .unwrap();
        assert_eq!(read.discovery.range, expected);
        let config = CycloneConfig::from_environment(name("a"), &read);
        CycloneGraph::new(&config).unwrap_or_else(|error| panic!("{range}: {error}"));
    }
}
