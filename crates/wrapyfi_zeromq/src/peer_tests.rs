//! Peers at the end of a handshake, and what they read and answer.

use std::net::TcpListener;

use super::*;
use crate::ends::Side;

/// A listener at the end of its handshake, to whom all is written.
fn listener(minor: u8) -> Peer {
    let port = TcpListener::bind("127.0.0.1:0").unwrap();
    let stream = TcpStream::connect(port.local_addr().unwrap()).unwrap();
    let address = stream.peer_addr().unwrap();
    let mut peer = Peer::new(stream, address, Instant::now());
    let mut greeting = zmtp::greeting(zmtp::NULL, false);
    greeting[11] = minor;
    peer.inbox = [greeting, zmtp::ready("SUB")].concat();
    peer.understand(&mut Vec::new()).unwrap();
    drop(peer.outbox.drain());
    peer
}

#[test]
fn a_socket_at_the_other_port_is_told_from_one_that_fits_nowhere() {
    for (theirs, wanted) in [
        ("PUB", Some("it is a PUB socket at pub_port, and has to connect to sub_port")),
        ("PAIR", None),
    ] {
        let port = TcpListener::bind("127.0.0.1:0").unwrap();
        let stream = TcpStream::connect(port.local_addr().unwrap()).unwrap();
        let address = stream.peer_addr().unwrap();
        let mut peer = Peer::new(stream, address, Instant::now());
        peer.inbox = [zmtp::greeting(zmtp::NULL, false), zmtp::ready(theirs)].concat();
        let end = peer.understand(&mut Vec::new()).unwrap_err();
        assert_eq!(end.reason().map(|_| end.to_string()).as_deref(), wanted);
    }
}

#[test]
fn silence_is_death_only_for_who_knows_heartbeats() {
    let word = |word: &[u8]| zmtp::command(&[&[4], word].concat());
    for (minor, said, lives) in [
        (0, Vec::new(), true),
        (0, word(b"PONG"), false),
        (0, word(b"PING\0\0"), false),
        (1, Vec::new(), false),
    ] {
        let mut peer = listener(minor);
        peer.inbox = said;
        peer.understand(&mut Vec::new()).unwrap();
        drop(peer.outbox.drain());
        let asked_at = peer.heard_at + options::SILENCE;
        assert!(peer.is_alive(asked_at));
        assert_eq!(peer.outbox.len(), 1, "it is asked");
        drop(peer.outbox.drain());
        assert!(peer.is_alive(asked_at + options::HEARTBEAT_TIMEOUT / 2));
        assert_eq!(peer.is_alive(asked_at + options::HEARTBEAT_TIMEOUT), lives, "{minor}");
        assert!(peer.outbox.is_empty(), "it is asked once");
    }
}

#[test]
fn a_peer_with_much_to_say_is_read_no_further_once_its_turn_is_over() {
    for (begun_before, is_over) in [(Duration::ZERO, false), (2 * TURN, true)] {
        let port = TcpListener::bind("127.0.0.1:0").unwrap();
        let stream = TcpStream::connect(port.local_addr().unwrap()).unwrap();
        let (mut other, address) = port.accept().unwrap();
        other.write_all(&zmtp::greeting(zmtp::NULL, false)).unwrap();
        stream.set_nonblocking(true).unwrap();
        let now = Instant::now();
        let mut peer = Peer::new(stream, address, now);
        let more = peer.read(&mut [0; 8], &mut Vec::new(), true, now - begun_before);
        assert!(matches!(more, Ok(more) if more == is_over));
        assert_eq!(peer.stage == Stage::Greeting, is_over);
    }
}

#[test]
fn half_a_word_ends_also_where_something_waits_for_the_listener() {
    let port = TcpListener::bind("127.0.0.1:0").unwrap();
    let stream = TcpStream::connect(port.local_addr().unwrap()).unwrap();
    let (address, now) = (stream.peer_addr().unwrap(), Instant::now());
    let mut peer = Peer::new(stream, address, now);
    peer.stage = Stage::Open;
    assert!(!peer.outbox.is_empty(), "it does not read");
    assert!(peer.is_alive(now + PROGRESS));
    peer.inbox = vec![0, 9, 1];
    peer.understand(&mut Vec::new()).unwrap();
    assert!(peer.is_alive(now + PROGRESS / 2));
    assert!(!peer.is_alive(now + PROGRESS));
}

#[test]
fn a_connection_within_the_process_is_not_asked_whether_it_lives() {
    let socket = SocketAddr::from(([192, 0, 2, 1], 1));
    let mut peer = listener(1).at(Some(End::of(socket, Side::Broker)));
    let other = End::of(socket, Side::Ours);
    let silent = peer.heard_at + options::SILENCE;
    assert!(peer.is_alive(silent) && peer.outbox.is_empty());
    drop(other);
    assert!(peer.is_alive(silent));
    assert_eq!(peer.outbox.len(), 1);
}
