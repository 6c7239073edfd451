//! Services of the Fast DDS mapping against nodes of ros2-client, and among our own.

use crate::common;
use crate::fast_common;

use std::net::{Ipv4Addr, UdpSocket};
use std::time::Instant;

use wrapyfi_conformance::until;
use wrapyfi_ros2::graph::{GraphError, Peers};

use crate::fast_common::{
    Add, END, Peer, Sum, add_two_ints, answer, cdr, client, numbers, server, services,
};

/// Clients and servers that come one after the other, as at the start of nodes.
const STARTS: usize = 20;

#[test]
fn our_client_calls_a_server_of_ros2_client() {
    let service = add_two_ints();
    let mut peer = Peer::new("adder");
    let theirs = peer.server(&service);
    let ours = services("caller");
    let mut client = client(&ours, &service);
    client.await_peers(&Peers::Ready(1));
    for (a, b) in [(2, 3), (-7, 1 << 40), (0, 0), (i64::MAX, 0)] {
        let sequence = client.client.send(&[&cdr(&[a, b])]).unwrap();
        until("the request", || answer(&theirs));
        let reply = client.reply().unwrap();
        assert_eq!((reply.sequence, numbers(&reply.cdr)), (sequence, vec![a + b]));
    }
}

#[test]
fn a_client_of_ros2_client_calls_our_server() {
    let service = add_two_ints();
    let ours = services("adder");
    let mut server = server(&ours, &service);
    let mut peer = Peer::new("caller");
    let theirs = peer.client(&service);
    server.await_peers(&Peers::Ready(1));
    // Its writer may know our reader later than our reader its writer, and loses requests until
    // then, as ros2-client does.
    until("any request", || {
        theirs.send_request(Add { a: 0, b: 0 }).unwrap();
        server.server.take().unwrap().is_some()
    });
    // What else of those is on the way is behind the first whose numbers are others.
    for (a, b) in [(2, 3), (-7, 1 << 40), (1, 0)] {
        let id = theirs.send_request(Add { a, b }).unwrap();
        while numbers(&server.answer().cdr) != [a, b] {}
        until("the reply", || theirs.receive_response().unwrap() == Some((id, Sum { sum: a + b })));
    }
    assert_eq!(server.server.lost(), 0);
}

#[test]
fn the_first_call_of_our_client_is_answered() {
    let service = add_two_ints();
    let ours = services("adder");
    let mut server = server(&ours, &service);
    let answers = std::thread::spawn(move || {
        for _ in 0..STARTS {
            server.answer();
        }
        server
    });
    for n in 0..STARTS {
        let n = i64::try_from(n).unwrap();
        let theirs = services("caller");
        let mut client = client(&theirs, &service);
        client.await_peers(&Peers::Ready(1));
        assert_eq!(client.call(n, 1000), n + 1000);
    }
    let server = answers.join().unwrap();
    server.await_peers(&Peers::None);
}

#[test]
fn the_first_call_to_our_server_is_answered() {
    let service = add_two_ints();
    let mut peer = Peer::new("caller");
    let theirs = peer.client(&service);
    for n in 0..STARTS {
        let n = i64::try_from(n).unwrap();
        let ours = services("adder");
        let mut server = server(&ours, &service);
        server.await_peers(&Peers::Ready(1));
        theirs.send_request(Add { a: n, b: 1 }).unwrap();
        server.answer();
        let mut reply = None;
        until("the reply", || {
            reply = theirs.receive_response().unwrap();
            reply.is_some()
        });
        assert_eq!(reply.map(|(_, sum)| sum), Some(Sum { sum: n + 1 }));
    }
}

#[test]
fn the_first_call_to_a_server_of_ros2_client_is_answered() {
    let service = add_two_ints();
    let mut peer = Peer::new("adder");
    let theirs = peer.server(&service);
    for n in 0..STARTS {
        let n = i64::try_from(n).unwrap();
        let ours = services("caller");
        let mut client = client(&ours, &service);
        client.await_peers(&Peers::Ready(1));
        client.client.send(&[&cdr(&[n, 2])]).unwrap();
        until("the request", || answer(&theirs));
        assert_eq!(numbers(&client.reply().unwrap().cdr), [n + 2], "start {n}");
    }
}

#[test]
fn messages_of_all_sizes_go_both_ways() {
    let mut service = add_two_ints();
    service.max_bytes = 8 << 20;
    let (ours, theirs) = (services("adder"), services("caller"));
    let (mut server, mut client) = (server(&ours, &service), client(&theirs, &service));
    client.await_peers(&Peers::Ready(1));
    // On the loopback interface, replies of more than 65343 bytes with their header are cut.
    for size in [0, 4, 8, 1000, 1368, 1372, 65_336, 65_340, 70_000, (128 << 10) - 4] {
        let mut sent = vec![0, 1, 0, 0];
        sent.extend((0..size).map(|n| u8::try_from(n % 251).unwrap()));
        let (head, tail) = sent.split_at(sent.len() / 2);
        let sequence = client.client.send(&[head, tail]).unwrap();
        let request = server.request().unwrap();
        assert!(request.cdr == sent, "{size} bytes changed on the way there");
        until("the client's reader", || server.server.hears(&request.id));
        server.server.reply(&request.id, &[&request.cdr]).unwrap();
        let reply = client.reply().unwrap();
        assert_eq!(reply.sequence, sequence);
        assert!(reply.cdr == sent, "{size} bytes changed on the way back");
    }
    for size in [128_usize << 10, 1 << 20, 4_000_000] {
        let mut sent = vec![0, 1, 0, 0];
        sent.extend((0..size).map(|n| u8::try_from(n % 251).unwrap()));
        let sequence = client.client.send(&[&sent]).unwrap();
        let request = server.request().unwrap();
        assert!(request.cdr == sent, "{size} bytes changed on the way there");
        until("the client's reader", || server.server.hears(&request.id));
        let error = server.server.reply(&request.id, &[&request.cdr]).unwrap_err();
        assert!(error.to_string().contains("over the limit of 131072 bytes"), "{error}");
        server.server.reply(&request.id, &[&cdr(&[1])]).unwrap();
        let reply = client.reply().unwrap();
        assert_eq!((reply.sequence, numbers(&reply.cdr)), (sequence, vec![1]));
    }
}

#[test]
fn what_is_too_large_is_dropped_and_said() {
    let small = add_two_ints();
    let (ours, theirs) = (services("adder"), services("caller"));
    let mut narrow = small.clone();
    narrow.max_bytes = 20;
    let (mut server, mut client) = (server(&ours, &narrow), client(&theirs, &narrow));
    client.await_peers(&Peers::Ready(1));
    client.client.send(&[&cdr(&[1, 2, 3])]).unwrap();
    let too_large = |actual| GraphError::TooLarge { topic: small.name.clone(), actual, limit: 20 };
    assert_eq!(server.request().unwrap_err(), too_large(28));
    client.client.send(&[&cdr(&[1, 2])]).unwrap();
    let request = server.request().unwrap();
    until("the client's reader", || server.server.hears(&request.id));
    server.server.reply(&request.id, &[&cdr(&[1, 2, 3, 4])]).unwrap();
    assert_eq!(client.reply().unwrap_err(), too_large(36));
    assert_eq!(client.call_with(&mut server), 3);
}

impl fast_common::OurClient {
    fn call_with(&mut self, server: &mut fast_common::OurServer) -> i64 {
        let sequence = self.client.send(&[&cdr(&[1, 2])]).unwrap();
        server.answer();
        let reply = self.reply().unwrap();
        assert_eq!(reply.sequence, sequence);
        numbers(&reply.cdr)[0]
    }
}

#[test]
fn another_encapsulation_is_refused_before_it_is_sent() {
    let ours = services("caller");
    let mut client = client(&ours, &add_two_ints());
    for wrong in [&[0, 0, 0, 0, 0, 0, 0, 1][..], &[0, 1], &[]] {
        let error = client.client.send(&[wrong]).unwrap_err();
        assert!(matches!(&error, GraphError::Stack { operation: "writing", .. }), "{error}");
        assert!(error.to_string().contains("little-endian CDR"), "{error}");
    }
}

/// Readers of one topic on RustDDS share what they have heard of a writer: a reply that comes just when another client
/// joins would be lost to the first.
#[test]
fn clients_of_one_service_share_endpoints_and_each_hears_its_own_replies() {
    let service = add_two_ints();
    let (adder, caller) = (services("adder"), services("caller"));
    let mut server = server(&adder, &service);
    let mut first = client(&caller, &service);
    first.await_peers(&Peers::Ready(1));
    let asked = first.client.send(&[&cdr(&[1, 2])]).unwrap();
    let request = server.request().unwrap();
    // Joins while the first waits.
    let mut second = client(&caller, &service);
    second.await_peers(&Peers::Ready(1));
    assert_eq!(caller.endpoints().readers.len(), 1);
    let also_asked = second.client.send(&[&cdr(&[3, 4])]).unwrap();
    until("the client's reader", || server.server.hears(&request.id));
    server.server.reply(&request.id, &[&cdr(&[3])]).unwrap();
    server.answer();
    // The second takes both from the reader.
    let reply = second.reply().unwrap();
    assert_eq!((reply.sequence, numbers(&reply.cdr)), (also_asked, vec![7]));
    let reply = first.reply().unwrap();
    assert_eq!((reply.sequence, numbers(&reply.cdr)), (asked, vec![3]));
    drop(first);
    assert_eq!(second.call_with(&mut server), 3);
    drop(second);
    assert_eq!(caller.endpoints().readers.len(), 0);
}

#[test]
fn a_server_that_goes_is_missed_and_another_is_found() {
    let service = add_two_ints();
    let caller = services("caller");
    let mut client = client(&caller, &service);
    assert_eq!(client.client.servers(), Peers::None);
    let adder = services("adder");
    for _ in 0..3 {
        let mut server = server(&adder, &service);
        client.await_peers(&Peers::Ready(1));
        assert_eq!(client.call_with(&mut server), 3);
        // The participant goes with its last service.
        assert!(adder.gid().is_some());
        let started = Instant::now();
        drop(server);
        assert!(started.elapsed() < 2 * END, "{:?} to end", started.elapsed());
        assert_eq!(adder.gid(), None);
        client.await_peers(&Peers::None);
    }
    let mut peer = Peer::new("adder");
    let theirs = peer.server(&service);
    client.await_peers(&Peers::Ready(1));
    drop(theirs);
    client.await_peers(&Peers::None);
}

#[test]
fn a_new_server_of_a_participant_is_given_no_old_requests() {
    let service = add_two_ints();
    let (adder, caller) = (services("adder"), services("caller"));
    let mut other = service.clone();
    other.name += "_other";
    // Keeps the participant, and with it what RustDDS keeps of the topic.
    let keeps = server(&adder, &other);
    let mut client = client(&caller, &service);
    let mut first = server(&adder, &service);
    client.await_peers(&Peers::Ready(1));
    for n in 0..3 {
        client.client.send(&[&cdr(&[n, n])]).unwrap();
        assert_eq!(numbers(&first.request().unwrap().cdr), [n, n]);
    }
    drop(first);
    client.await_peers(&Peers::None);
    let mut second = server(&adder, &service);
    client.await_peers(&Peers::Ready(1));
    client.client.send(&[&cdr(&[40, 2])]).unwrap();
    assert_eq!(numbers(&second.answer().cdr), [40, 2]);
    assert_eq!(numbers(&client.reply().unwrap().cdr), [42]);
    drop(keeps);
}

#[test]
fn many_clients_of_one_server_hear_their_own_replies() {
    let service = add_two_ints();
    let adder = services("adder");
    let mut server = server(&adder, &service);
    let callers = [services("a"), services("b")];
    let mut clients: Vec<_> = (0..12).map(|n| client(&callers[n % 2], &service)).collect();
    // Those of a node share endpoints.
    server.await_peers(&Peers::Ready(2));
    for client in &clients {
        client.await_peers(&Peers::Ready(1));
    }
    let mut sent = Vec::new();
    for (n, client) in (0..).zip(&mut clients) {
        sent.push([100, 200].map(|added| {
            let number = client.client.send(&[&cdr(&[n, added])]).unwrap();
            (number, vec![n + added])
        }));
    }
    for _ in 0..clients.len() * 2 {
        server.answer();
    }
    for (client, expected) in clients.iter_mut().zip(sent) {
        for expected in expected {
            let reply = client.reply().unwrap();
            assert_eq!((reply.sequence, numbers(&reply.cdr)), expected);
        }
        assert_eq!(client.client.take().unwrap(), None);
    }
    clients.truncate(1);
    server.await_peers(&Peers::Ready(1));
    drop(clients);
    server.await_peers(&Peers::None);
}

/// Fast DDS learns of the end of a participant from a message with a key hash alone.
#[test]
fn a_participant_that_ends_says_so_as_fast_dds_reads_it() {
    let config = fast_common::config("leaver");
    // A port of this host at which no participant is.
    let domain = u16::try_from(config.domain_id).unwrap();
    let port = |index: u16| 7400 + 250 * domain + 10 + 2 * index;
    let socket =
        (60..99).find_map(|index| UdpSocket::bind((Ipv4Addr::LOCALHOST, port(index))).ok());
    let socket = socket.unwrap();
    socket.set_read_timeout(Some(common::TIMEOUT)).unwrap();
    let ours = services("leaver");
    let server = server(&ours, &add_two_ints());
    let reader = ours.endpoints().readers[0];
    drop((server, ours));
    let mut datagram = [0; 65_536];
    let mut hash = vec![0x70, 0, 16, 0];
    hash.extend(&reader[..12]);
    hash.extend([0, 0, 1, 0xc1]);
    loop {
        let (size, _) = socket.recv_from(&mut datagram).expect("no message with the key hash");
        let has = |wanted: &[u8]| datagram[..size].windows(wanted.len()).any(|is| is == wanted);
        // PID_STATUS_INFO: disposed and unregistered.
        if has(&hash) && has(&[0x71, 0, 4, 0, 0, 0, 0, 3]) {
            return;
        }
    }
}
