//! Tests of every adapter of the graph, between two nodes.

use wrapyfi_endpoint::{Durability, History, QosPreset, Reliability, Wake};
use wrapyfi_ros2::graph::{
    CdrClient, CdrReply, CdrRequest, CdrServer, Graph, GraphError, Peers, ServiceDescription,
    wait_until,
};

use super::{Ends, HASH, TIMEOUT, bell, connect, message, next, pattern, text, topic, write};

/// Sizes around those at which stacks cut messages into pieces; where `whole_words`, what arrives is padded to them.
pub fn messages_of_all_sizes_go_both_ways(a: &dyn Graph, b: &dyn Graph, whole_words: bool) {
    let mut chatter = topic("/chatter");
    // Sizes that no queue of DDS holds ten of at once are sent one by one.
    chatter.qos.history = History::KeepLast(1);
    for (from, to) in [(a, b), (b, a)] {
        let mut ends = connect(from, to, &chatter);
        for size in [0, 1, 2, 3, 1500, 63_990, 64_010, 65_600, 1 << 20, 6_220_800] {
            let sent = pattern(size);
            write(&mut *ends.writer, &sent).unwrap();
            let got = next(&mut *ends.reader, &ends.wake);
            assert!(text(&got) == sent, "{size} bytes changed");
            assert!(!whole_words || got.cdr.len().is_multiple_of(4), "{size} bytes");
            assert!(got.source_timestamp_ns > 1_500_000_000_000_000_000);
            let gid = ends.reader.publisher_gid(got.publisher).unwrap();
            // A graph of rmw tells an endpoint when it knows its node, which may be after its first message.
            let mut peer = None;
            assert!(wait_until(&ends.wake, TIMEOUT, || {
                peer = to.endpoints().unwrap().into_iter().find(|peer| peer.gid == gid);
                peer.is_some()
            }));
            let peer = peer.unwrap();
            assert!(peer.is_publisher && !peer.is_own, "{peer:?}");
            assert_eq!((peer.topic.as_str(), peer.type_hash.as_deref()), ("/chatter", Some(HASH)));
        }
        assert_eq!(ends.reader.lost(), 0);
    }
}

pub fn a_late_reader_gets_what_is_kept(a: &dyn Graph, b: &dyn Graph) {
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

pub fn a_node_does_not_hear_itself(a: &dyn Graph, b: &dyn Graph) {
    let chatter = topic("/chatter");
    let wake = Wake::new();
    let mut own = a.subscribe(&chatter, bell(&wake)).unwrap();
    let mut ends = connect(a, b, &chatter);
    write(&mut *ends.writer, b"x").unwrap();
    assert_eq!(text(&next(&mut *ends.reader, &ends.wake)), b"x");
    assert_eq!((own.matched(), own.take().unwrap()), (0, None));
}

/// `b` is the node `/robot/b`.
pub fn matches_come_and_go_and_are_watched(a: &dyn Graph, b: &dyn Graph) {
    let chatter = topic("/chatter");
    let wake = Wake::new();
    let mut nodes = a.nodes().unwrap();
    let watch = a.watch("/chatter", false, bell(&wake)).unwrap();
    let Ends { wake: matches, writer, reader } = connect(a, b, &chatter);
    assert!(wait_until(&wake, TIMEOUT, || watch.peers().len() == 1));
    let before = watch.changes();
    let second = b.subscribe(&chatter, bell(&matches)).unwrap();
    assert!(wait_until(&matches, TIMEOUT, || writer.matched() == 2));
    assert!(wait_until(&wake, TIMEOUT, || watch.peers().len() == 2 && watch.changes() > before));
    assert!(wait_until(&wake, TIMEOUT, || {
        nodes.update();
        watch.peers().iter().all(|peer| nodes.owner(&peer.gid) == Some("/robot/b"))
    }));
    drop(reader);
    assert!(wait_until(&matches, TIMEOUT, || writer.matched() == 1));
    drop(second);
    assert!(wait_until(&matches, TIMEOUT, || writer.matched() == 0));
    assert!(wait_until(&wake, TIMEOUT, || watch.peers().is_empty()));
    let third = b.subscribe(&chatter, bell(&matches)).unwrap();
    assert!(wait_until(&matches, TIMEOUT, || third.matched() == 1));
    drop(writer);
    assert!(wait_until(&matches, TIMEOUT, || third.matched() == 0));
}

pub fn who_does_not_fit_is_told_why(a: &dyn Graph, b: &dyn Graph) {
    let mut effort = topic("/best_effort");
    effort.qos.reliability = Reliability::BestEffort;
    let wake = Wake::new();
    let writer = a.advertise(&effort, bell(&wake)).unwrap();
    let reader = b.subscribe(&topic("/best_effort"), bell(&wake)).unwrap();
    assert!(wait_until(&wake, TIMEOUT, || {
        [writer.incompatible(), reader.incompatible()] == [Some("reliability"); 2]
    }));
    let mut kept = topic("/volatile");
    let writer = a.advertise(&kept, bell(&wake)).unwrap();
    kept.qos.durability = Durability::TransientLocal;
    let reader = b.subscribe(&kept, bell(&wake)).unwrap();
    assert!(wait_until(&wake, TIMEOUT, || {
        [writer.incompatible(), reader.incompatible()] == [Some("durability"); 2]
    }));
    assert_eq!((writer.matched(), reader.matched()), (0, 0));
}

pub fn a_message_over_the_limit_is_named_and_the_next_one_comes(a: &dyn Graph, b: &dyn Graph) {
    let mut small = topic("/small");
    small.max_bytes = 1000;
    let mut ends = connect(a, b, &small);
    write(&mut *ends.writer, &pattern(991)).unwrap();
    write(&mut *ends.writer, &pattern(992)).unwrap();
    write(&mut *ends.writer, b"after").unwrap();
    assert_eq!(text(&next(&mut *ends.reader, &ends.wake)).len(), 991);
    let mut fault = None;
    assert!(wait_until(&ends.wake, TIMEOUT, || {
        fault = ends.reader.take().err();
        fault.is_some()
    }));
    let Some(GraphError::TooLarge { topic, actual: 1001..=1004, limit: 1000 }) = fault else {
        panic!("{fault:?}")
    };
    assert!(topic.ends_with("/small"), "{topic}");
    assert_eq!(text(&next(&mut *ends.reader, &ends.wake)), b"after");
}

/// A service of a type that no package defines.
pub struct Turn {
    wake: Wake,
    client: Box<dyn CdrClient>,
    server: Box<dyn CdrServer>,
}

/// A service of a type that no package defines.
pub fn turn(max_bytes: usize) -> ServiceDescription {
    ServiceDescription {
        name: "/turn".into(),
        type_name: "nowhere_interfaces/srv/Turn".into(),
        type_hash: Some(HASH.into()),
        request_hash: Some(HASH.into()),
        response_hash: None,
        depth: 10,
        max_bytes,
    }
}

impl Turn {
    pub fn between(a: &dyn Graph, b: &dyn Graph, max_bytes: usize) -> Self {
        let service = turn(max_bytes);
        let wake = Wake::new();
        let client = a.client(&service, bell(&wake)).unwrap();
        assert_eq!(client.servers(), Peers::None);
        let server = b.server(&service, bell(&wake)).unwrap();
        assert!(wait_until(&wake, TIMEOUT, || client.servers() == Peers::Ready(1)));
        Self { wake, client, server }
    }

    fn ask(&mut self, bytes: usize) -> (i64, Vec<u8>) {
        let parts = message(&pattern(bytes));
        let parts: Vec<&[u8]> = parts.iter().map(Vec::as_slice).collect();
        (self.client.send(&parts).unwrap(), parts.concat())
    }

    fn request(&mut self) -> Result<CdrRequest, GraphError> {
        let mut taken = Ok(None);
        assert!(wait_until(&self.wake, TIMEOUT, || {
            taken = self.server.take();
            !matches!(taken, Ok(None))
        }));
        taken.map(Option::unwrap)
    }

    fn answer(&mut self, request: &CdrRequest, reply: &[u8]) {
        assert!(wait_until(&self.wake, TIMEOUT, || self.server.hears(&request.id)));
        self.server.reply(&request.id, &[reply]).unwrap();
    }

    fn reply(&mut self) -> Result<CdrReply, GraphError> {
        let mut taken = Ok(None);
        assert!(wait_until(&self.wake, TIMEOUT, || {
            taken = self.client.take();
            !matches!(taken, Ok(None))
        }));
        taken.map(Option::unwrap)
    }
}

pub fn services_of_a_type_that_nobody_defines_carry_megabytes(a: &dyn Graph, b: &dyn Graph) {
    let mut turn = Turn::between(a, b, 64 << 20);
    for bytes in [0, 1, 200_000, 32 << 20] {
        let (sequence, sent) = turn.ask(bytes);
        let request = turn.request().unwrap();
        assert!(request.cdr.starts_with(&sent), "{bytes} bytes changed");
        turn.answer(&request, &request.cdr);
        let reply = turn.reply().unwrap();
        assert_eq!(reply.sequence, sequence);
        assert!(reply.cdr.starts_with(&request.cdr), "{bytes} bytes changed");
    }
    let Turn { wake, client, server } = turn;
    assert_eq!(server.clients(), Peers::Ready(1));
    drop(server);
    assert!(wait_until(&wake, TIMEOUT, || client.servers() == Peers::None));
}

pub fn requests_and_replies_over_the_limit_are_named_and_the_next_one_comes(
    a: &dyn Graph,
    b: &dyn Graph,
) {
    let mut turn = Turn::between(a, b, 1000);
    let too_large = |fault: GraphError| {
        let GraphError::TooLarge { topic, actual: 2000..2020, limit: 1000 } = fault else {
            panic!("{fault}")
        };
        assert_eq!(topic, "/turn");
    };
    turn.ask(2000);
    too_large(turn.request().unwrap_err());
    turn.ask(3);
    let request = turn.request().unwrap();
    turn.answer(&request, &message(&pattern(2000)).concat());
    too_large(turn.reply().unwrap_err());
    let (sequence, sent) = turn.ask(4);
    let request = turn.request().unwrap();
    turn.answer(&request, &sent);
    let reply = turn.reply().unwrap();
    assert_eq!((reply.sequence, reply.cdr.starts_with(&sent)), (sequence, true));
}

/// `a` is the node `/robot/a`; `b` sees whose the mark is.
pub fn the_mark_of_a_bridge_is_seen(a: &dyn Graph, b: &dyn Graph) {
    use wrapyfi_ros2::graph::WriterTraits;
    let mark = "0196a3b2c4d5e6f7:ros,yarp".parse().unwrap();
    let traits = WriterTraits { mark: Some(&mark), ..WriterTraits::default() };
    let wake = Wake::new();
    let mut nodes = b.nodes().unwrap();
    let watch = b.watch("/marked", true, bell(&wake)).unwrap();
    let _marked = a.advertise_with(&topic("/marked"), traits, bell(&wake)).unwrap();
    let _plain = a.advertise(&topic("/plain"), bell(&wake)).unwrap();
    assert!(wait_until(&wake, TIMEOUT, || {
        nodes.update();
        let peers = watch.peers();
        peers.iter().any(|peer| {
            peer.mark.as_ref() == Some(&mark) && nodes.owner(&peer.gid) == Some("/robot/a")
        })
    }));
    let on = |graph: &dyn Graph, topic: &str| {
        graph.endpoints().unwrap().into_iter().find(|one| one.is_publisher && one.topic == topic)
    };
    assert!(wait_until(&wake, TIMEOUT, || on(b, "/plain").is_some()));
    assert_eq!(on(b, "/plain").unwrap().mark, None);
    // A node finds its own endpoints on the graph as it does those of others.
    assert!(wait_until(&wake, TIMEOUT, || on(a, "/marked").is_some_and(|one| one.is_own)));
}
