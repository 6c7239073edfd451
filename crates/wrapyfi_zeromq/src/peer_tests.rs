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
    peer.outbox.clear();
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
        peer.outbox.clear();
        let asked_at = peer.heard_at + options::SILENCE;
        assert!(peer.is_alive(asked_at));
        assert_eq!(peer.outbox.clear(), 1, "it is asked");
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
    assert_eq!(peer.outbox.clear(), 1);
}

/// Takes at most `room` bytes, and has none to read.
#[derive(Default)]
struct Wire {
    taken: Vec<u8>,
    room: usize,
}

impl Read for Wire {
    fn read(&mut self, _buffer: &mut [u8]) -> std::io::Result<usize> {
        Err(ErrorKind::WouldBlock.into())
    }
}

impl Write for Wire {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let count = bytes.len().min(self.room);
        self.room -= count;
        self.taken.extend_from_slice(&bytes[..count]);
        if count == 0 { Err(ErrorKind::WouldBlock.into()) } else { Ok(count) }
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn small_messages_go_whole_and_in_order_whoever_writes_them() {
    let mut peer = Peer::new(Wire::default(), "127.0.0.1:1".parse().unwrap(), Instant::now());
    peer.outbox.clear();
    let (mut wanted, mut written_by_other) = (Vec::new(), 0);
    for n in 0..600_usize {
        let frames = [vec![b'/'; n % 4], vec![n as u8; n * n % 300]];
        let bytes = frames.iter().map(Vec::len).sum();
        zmtp::append(&frames, &mut wanted);
        // Another takes the batch that goes next, as the I/O thread does, while this message comes.
        let taken = if n % 3 == 0 { peer.outbox.batch() } else { None };
        if n % 50 == 49 {
            let message = Message::new(frames.to_vec(), false, Some((Bytes::new(), bytes)), None);
            peer.queue(&message, None).unwrap();
        } else {
            peer.queue_small(&frames, bytes, None, None).unwrap();
        }
        if let Some((batch, written)) = taken {
            let rest = &batch[written..];
            let count = rest.len().min(n * 7 % 400);
            peer.stream.taken.extend_from_slice(&rest[..count]);
            drop(batch);
            peer.outbox.note_written(count);
            written_by_other += count;
        } else if n % 11 == 0 {
            (peer.stream.room, peer.is_blocked) = (n * 11 % 300, false);
            peer.write().unwrap();
        }
    }
    assert!(
        peer.outbox.waiting() > 64 && written_by_other > 10_000,
        "{} {written_by_other}",
        peer.outbox.waiting()
    );
    assert!(peer.outbox.is_within_batch(), "a batch of which a part is written");
    assert_eq!(
        peer.outbox.unsent().count(),
        peer.outbox.waiting(),
        "what is written does not wait"
    );
    let left: usize = peer.outbox.unsent().map(|(bytes, _)| bytes).sum();
    assert!(wanted.len() - peer.stream.taken.len() - left < 5 * peer.outbox.waiting() + 400);
    assert_eq!(
        peer.queue_small(&[vec![1]], 1, None, Some(peer.outbox.waiting())),
        Err(DropReason::Stalled)
    );
    (peer.stream.room, peer.is_blocked) = (usize::MAX, false);
    peer.write().unwrap();
    assert!(peer.stream.taken == wanted, "{} of {}", peer.stream.taken.len(), wanted.len());
    assert_eq!((peer.outbox.waiting(), peer.outbox.words(), peer.outbox.clear()), (0, 0, 0));
}

/// Whoever takes nothing and asks, beside messages that wait, has no more than a few answers waiting.
#[test]
fn pings_are_answered_a_few_times_while_batches_wait() {
    let mut peer = Peer::new(Wire::default(), "127.0.0.1:1".parse().unwrap(), Instant::now());
    peer.outbox.clear();
    for n in 0..100 {
        peer.queue_small(&[vec![1; 200]], 200, None, None).unwrap();
        peer.obey(b"\x04PING\0\0", &mut Vec::new());
        assert_eq!(peer.outbox.words(), 5.min(n + 1));
    }
    assert_eq!(peer.outbox.waiting(), 100);
}
