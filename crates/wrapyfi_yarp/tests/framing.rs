//! The framers, whatever the pieces that bytes come in, and whatever the bytes are.

use bytes::{Bytes, BytesMut};
use proptest::prelude::*;
use wrapyfi_yarp::WireLimits;
use wrapyfi_yarp::wire::datagram::{self, Assembler};
use wrapyfi_yarp::wire::header;
use wrapyfi_yarp::wire::message::{self, MessageReader};
use wrapyfi_yarp::wire::mjpeg::{self, MjpegReader};
use wrapyfi_yarp::wire::text::{self, TextReader};
use wrapyfi_yarp::wire::{Carrier, Command, Fault, Opening, Progress, Sender, admin};

fn limits() -> WireLimits {
    WireLimits { max_message_bytes: 4096, max_line_bytes: 256, ..WireLimits::default() }
}

/// Everything that a reader finds in `bytes`, which come in pieces of the given lengths.
fn found<T: std::fmt::Debug>(
    bytes: &[u8],
    pieces: &[usize],
    mut poll: impl FnMut(&mut BytesMut) -> Result<Progress<T>, Fault>,
) -> Vec<String> {
    let (mut buffer, mut rest, mut events) = (BytesMut::new(), bytes, Vec::new());
    let mut pieces = pieces.iter().cycle();
    loop {
        match poll(&mut buffer) {
            Ok(Progress::Event(event)) => events.push(format!("{event:?}")),
            Ok(Progress::Need(more)) => {
                assert!(more > 0, "a reader that needs nothing would go round for ever");
                assert!(more <= 64 * 1024, "{more} bytes are beyond every limit");
                if rest.is_empty() {
                    return events;
                }
                let piece = pieces.next().map_or(1, |&piece| piece.clamp(1, rest.len()));
                let (now, later) = rest.split_at(piece);
                buffer.extend_from_slice(now);
                rest = later;
            }
            Err(fault) => {
                events.push(fault.to_string());
                return events;
            }
        }
    }
}

fn command() -> impl Strategy<Value = Command> {
    let envelope = proptest::option::of("[ -~]{1,20}".prop_map(Bytes::from));
    prop_oneof![
        (any::<bool>(), envelope).prop_map(|(reply, envelope)| Command::Data { reply, envelope }),
        Just(Command::Admin),
        "/[a-z/:.]{0,20}".prop_map(Command::Connect),
        "/[a-z]{0,20}".prop_map(Command::RemoveInput),
        Just(Command::Describe),
        Just(Command::Quit),
    ]
}

fn payload() -> impl Strategy<Value = Bytes> {
    proptest::collection::vec(any::<u8>(), 0..200).prop_map(Bytes::from)
}

fn pieces() -> impl Strategy<Value = Vec<usize>> {
    proptest::collection::vec(1_usize..40, 1..8)
}

proptest! {
    #[test]
    fn messages_are_the_same_in_any_pieces(
        messages in proptest::collection::vec((command(), payload()), 1..5),
        pieces in pieces(),
    ) {
        let mut bytes = Vec::new();
        for (command, payload) in &messages {
            bytes.extend(message::whole(command, payload).unwrap());
        }
        let read = |pieces: &[usize]| {
            let mut reader = MessageReader::new(&limits());
            found(&bytes, pieces, |buffer| reader.poll(buffer))
        };
        let whole = read(&[bytes.len()]);
        prop_assert_eq!(&whole, &read(&pieces));
        prop_assert_eq!(whole.len(), messages.len());
        for (event, (command, payload)) in whole.iter().zip(&messages) {
            prop_assert!(event.contains(&format!("command: {command:?}")), "{}", event);
            prop_assert!(event.contains(&format!("Binary({payload:?})")), "{}", event);
        }
    }

    #[test]
    fn lines_are_the_same_in_any_pieces(
        messages in proptest::collection::vec((command(), "[a-z0-9 ().]{0,20}"), 1..5),
        pieces in pieces(),
    ) {
        let mut bytes = Vec::new();
        for (command, payload) in &messages {
            let payload = command.has_payload().then_some(payload.as_bytes());
            bytes.extend(text::message(command, payload));
        }
        let read = |pieces: &[usize]| {
            let mut reader = TextReader::new(&limits());
            found(&bytes, pieces, |buffer| reader.poll(buffer))
        };
        prop_assert_eq!(read(&[bytes.len()]), read(&pieces));
    }

    #[test]
    fn headers_say_who_and_how(name in "/[a-z/]{1,30}", pieces in pieces(), at in 0_usize..6) {
        let carrier = Carrier::ALL[at];
        let mut sender = Sender::new(name);
        sender.qualify("tcp+recv.priority+flag");
        let mut bytes = header::encode(carrier, &sender, &limits()).unwrap();
        if carrier == Carrier::Mcast {
            bytes.extend(header::encode_group("224.1.1.3:10004".parse().unwrap()));
        }
        let mut buffer = BytesMut::new();
        let opening = bytes.iter().find_map(|&byte| {
            buffer.extend_from_slice(&[byte]);
            match Opening::poll(&mut buffer, &limits()).unwrap() {
                Progress::Event(opening) => Some(opening),
                Progress::Need(_) => None,
            }
        });
        let text = format!("{:?}", opening.unwrap());
        prop_assert!(text.contains(&format!("{carrier:?}")), "{}", text);
        prop_assert!(text.contains(&format!("{sender:?}")), "{}", text);
        prop_assert!(buffer.is_empty());
        let openings = found(&bytes, &pieces, |buffer| Opening::poll(buffer, &limits()));
        prop_assert_eq!(openings.len(), 1);
    }

    #[test]
    fn garbage_is_no_reason_to_panic(
        bytes in proptest::collection::vec(any::<u8>(), 0..600),
        start in 0_usize..8,
        pieces in pieces(),
    ) {
        let starts: [&[u8]; 8] = [
            b"", b"YA\xe4\x1e\0\0RP", b"CONNECT ", b"NAME_SER", b"GET / HTTP\n",
            b"YA\x0a\0\0\0RP\x02\x01\xff\xff\xff\xff\xff\xff\xff\xff", b"HTTP/1.0 200 OK\n",
            b"YA\x62\x1e\0\0RP\x05\0\0\0",
        ];
        let bytes = [starts[start], &bytes].concat();
        let limits = limits();
        found(&bytes, &pieces, |buffer| Opening::poll(buffer, &limits));
        let mut reader = MessageReader::new(&limits);
        let events = found(&bytes, &pieces, |buffer| reader.poll(buffer));
        let mut reader = MessageReader::new(&limits);
        prop_assert_eq!(events, found(&bytes, &[bytes.len()], |buffer| reader.poll(buffer)));
        let mut reader = TextReader::new(&limits);
        found(&bytes, &pieces, |buffer| reader.poll(buffer));
        let mut reader = MjpegReader::new(&limits);
        found(&bytes, &pieces, |buffer| reader.poll(buffer));
        let mut assembler = Assembler::new(&limits);
        for datagram in bytes.chunks(pieces[0] + 8) {
            assembler.push(datagram).ok();
            assembler.push(&datagram::seal(0, datagram)).ok();
        }
        // A byte that is no text becomes three.
        prop_assert!(Sender::parse(&bytes).name.len() <= 3 * bytes.len());
        let text = String::from_utf8_lossy(&bytes);
        if let Some((carrier, name)) = admin::split_destination(&text) {
            prop_assert!(carrier.is_none() || name.starts_with('/'));
        }
        let picture = mjpeg::with_envelope(&Bytes::copy_from_slice(&bytes), b"1 2.5");
        prop_assert!(picture.len() >= bytes.len());
    }

    #[test]
    fn datagrams_come_together_however_they_are_cut(
        payload in payload(),
        largest in 9_usize..300,
    ) {
        let command = Command::Data { reply: false, envelope: None };
        let head = message::head(&command, &[payload.len()]).unwrap();
        let mut assembler = Assembler::new(&limits());
        let datagrams = datagram::split(&head, &payload, largest);
        let (last, first) = datagrams.split_last().unwrap();
        for datagram in first {
            prop_assert!(datagram.len() <= largest);
            prop_assert_eq!(assembler.push(datagram), Ok(None));
        }
        let incoming = assembler.push(last).unwrap().unwrap();
        prop_assert_eq!(incoming.command, command);
        prop_assert_eq!(incoming.body.len(), payload.len());
    }
}

fn read_one(bytes: &[u8]) -> Result<Progress<message::Found>, Fault> {
    MessageReader::new(&limits()).poll(&mut BytesMut::from(bytes))
}

/// An index of blocks with these lengths.
fn index(lengths: &[i32]) -> Vec<u8> {
    let mut bytes = b"YA\x0a\0\0\0RP".to_vec();
    bytes.extend([lengths.len() as u8, 1]);
    bytes.extend([0xff; 8]);
    for length in lengths.iter().chain(&[0]) {
        bytes.extend(length.to_le_bytes());
    }
    bytes
}

#[test]
fn lengths_that_lie_are_refused_before_anything_is_kept() {
    assert_eq!(read_one(&index(&[8, -1])), Err(Fault::NegativeLength(-1)));
    let too_large = Fault::MessageTooLarge { size: 8 + 5000, limit: 4096 };
    assert_eq!(read_one(&index(&[8, 5000])), Err(too_large));
    let huge = index(&vec![i32::MAX; 255]);
    assert!(matches!(read_one(&huge), Err(Fault::MessageTooLarge { .. })));
    let left = message::Found::Left(Fault::BadCommand(4));
    assert_eq!(read_one(&index(&[4])), Ok(Progress::Event(left)));
    let none = message::Found::Left(Fault::BadCommand(0));
    assert_eq!(read_one(&index(&[])), Ok(Progress::Event(none)));
}

#[test]
fn names_that_lie_are_refused() {
    for length in [-1, 0, 1001, i32::MAX] {
        let mut bytes = b"YA\xe4\x1e\0\0RP".to_vec();
        bytes.extend(i32::to_le_bytes(length));
        let fault = Opening::poll(&mut BytesMut::from(&bytes[..]), &WireLimits::default());
        assert_eq!(fault, Err(Fault::NameLength { length: i64::from(length), limit: 1000 }));
    }
    let mut buffer = BytesMut::from("CONNECT ");
    buffer.extend_from_slice(&[b'x'; 1100]);
    assert!(Opening::poll(&mut buffer, &WireLimits::default()).is_err());
    let long = Sender::new("x".repeat(1000));
    assert!(header::encode(Carrier::Tcp, &long, &WireLimits::default()).is_err());
}

#[test]
fn a_peer_without_any_index_is_given_up() {
    let mut reader = MessageReader::new(&limits());
    let mut buffer = BytesMut::from(&vec![b'x'; message::MAX_STRAY_BYTES + 16][..]);
    assert!(matches!(reader.poll(&mut buffer), Err(Fault::NoIndex(_))));
}

#[test]
fn a_command_text_without_end_is_left_out() {
    let mut bytes = index(&[20]);
    bytes.extend(b"\x08\0\0\0~\0\0\x01D no NUL here");
    let left = message::Found::Left(Fault::BadCommand(20));
    let mut reader = MessageReader::new(&limits());
    bytes.truncate(34 - 8 + 20);
    bytes.extend(message::quit());
    let mut buffer = BytesMut::from(&bytes[..]);
    assert_eq!(reader.poll(&mut buffer), Ok(Progress::Event(left)));
    let Ok(Progress::Event(message::Found::Message(quit))) = reader.poll(&mut buffer) else {
        panic!()
    };
    assert_eq!(quit.command, Command::Quit);
}
