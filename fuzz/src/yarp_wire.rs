//! The target of connections between YARP's ports.

use bytes::BytesMut;
use wrapyfi_yarp::wire::bare::BareReader;
use wrapyfi_yarp::wire::datagram::{self, Assembler};
use wrapyfi_yarp::wire::header;
use wrapyfi_yarp::wire::http::MAX_HEAD;
use wrapyfi_yarp::wire::message::{self, Found, MessageReader};
use wrapyfi_yarp::wire::mjpeg::MjpegReader;
use wrapyfi_yarp::wire::text::{self, Lines, TextReader};
use wrapyfi_yarp::wire::{Body, Carrier, Fault, Incoming, Opening, Progress};
use wrapyfi_yarp::{Dialect, WireLimits};

use crate::bounded;

fn limits() -> WireLimits {
    WireLimits { max_message_bytes: 1 << 16, max_line_bytes: 1 << 12, ..WireLimits::default() }
}

/// A connection to a port, from its first byte; bit 7 of the byte in front chooses the answer of a
/// camera instead, the rest says how many bytes come at a time.
pub fn yarp_connection(data: &[u8]) {
    let [choice, bytes @ ..] = data else { return };
    let piece = usize::from(choice & 0x7f) + 1;
    // Buffers double, and are copied when events keep a part of them.
    bounded(bytes.len(), 16, || {
        if choice & 0x80 != 0 {
            let mut reader = MjpegReader::new(&limits());
            read(
                bytes,
                piece,
                &mut BytesMut::new(),
                |buffer| reader.poll(buffer),
                |picture| {
                    assert!(picture.jpeg.len() <= bytes.len());
                },
            );
            return;
        }
        connection(bytes, piece);
    });
    // The same bytes as a datagram, damaged or not.
    let mut assembler = Assembler::new(&limits());
    for datagram in [bytes, &datagram::seal(0, bytes), &datagram::seal(1, bytes)] {
        if let Ok(Some(incoming)) = assembler.push(datagram) {
            again(&incoming);
        }
    }
}

/// Hands out `bytes` in pieces; what is left of them in the end.
fn read<'a, T>(
    mut bytes: &'a [u8],
    piece: usize,
    buffer: &mut BytesMut,
    mut poll: impl FnMut(&mut BytesMut) -> Result<Progress<T>, Fault>,
    mut event: impl FnMut(T),
) -> &'a [u8] {
    loop {
        match poll(buffer) {
            Ok(Progress::Event(found)) => event(found),
            Ok(Progress::Need(more)) => {
                let most = limits().max_message_bytes + MAX_HEAD;
                assert!((1..=most).contains(&more), "a reader asks for {more} bytes");
                if bytes.is_empty() {
                    return bytes;
                }
                let (now, later) = bytes.split_at(piece.min(bytes.len()));
                buffer.extend_from_slice(now);
                bytes = later;
            }
            Err(_) => return bytes,
        }
    }
}

fn connection(bytes: &[u8], piece: usize) {
    let mut buffer = BytesMut::new();
    let (mut rest, mut opening) = (bytes, None);
    while opening.is_none() {
        match Opening::poll(&mut buffer, &limits()) {
            Ok(Progress::Event(found)) => opening = Some(found),
            Ok(Progress::Need(_)) if !rest.is_empty() => {
                let (now, later) = rest.split_at(piece.min(rest.len()));
                buffer.extend_from_slice(now);
                rest = later;
            }
            Ok(Progress::Need(_)) | Err(_) => return,
        }
    }
    match opening {
        Some(Opening::Messages { carrier, sender, group }) => {
            assert_eq!(group.is_some(), carrier == Carrier::Mcast);
            assert!(sender.name.len() <= 3 * limits().max_name_bytes, "replaced bytes are three");
            if let Ok(written) = header::encode(carrier, &sender, &limits()) {
                assert!(!written.is_empty());
            }
            if carrier.is_text() {
                let mut reader = TextReader::new(&limits());
                read(rest, piece, &mut buffer, |buffer| reader.poll(buffer), |found| again(&found));
            } else if carrier.is_unix() {
                let mut reader = BareReader::new(Dialect::V3, &limits());
                read(rest, piece, &mut buffer, |buffer| reader.poll(buffer), |found| again(&found));
            } else {
                let mut reader = MessageReader::new(&limits());
                let poll = |buffer: &mut BytesMut| reader.poll(buffer);
                read(rest, piece, &mut buffer, poll, |found| match found {
                    Found::Message(incoming) => again(&incoming),
                    Found::Left(fault) => assert!(!fault.name().is_empty()),
                });
            }
        }
        Some(Opening::Names(line)) => {
            assert!(!line.contains(&b'\n'));
            let mut lines = Lines::new(&limits());
            let poll = |buffer: &mut BytesMut| lines.poll_request(buffer);
            read(rest, piece, &mut buffer, poll, |line| assert!(!line.contains(&b'\n')));
        }
        Some(Opening::Http(request)) => assert!(request.path.starts_with('/')),
        None => {}
    }
}

/// Asserts that a message that was read can be written, and reads the same again.
fn again(incoming: &Incoming) {
    let Incoming { command, body } = incoming;
    match body {
        Body::Binary(payload) | Body::File(payload) => {
            let written = message::whole(command, payload).unwrap();
            let wide = WireLimits { max_message_bytes: written.len(), ..limits() };
            let mut reader = MessageReader::new(&wide);
            let found = reader.poll(&mut BytesMut::from(&written[..]));
            assert_eq!(found, Ok(Progress::Event(Found::Message(incoming.clone()))));
        }
        Body::Text(payload) => {
            let payload = command.has_payload().then_some(&payload[..]);
            let written = text::message(command, payload);
            let wide = WireLimits { max_line_bytes: 4 * limits().max_line_bytes, ..limits() };
            let mut reader = TextReader::new(&wide);
            let found = reader.poll(&mut BytesMut::from(&written[..]));
            let Ok(Progress::Event(found)) = found else { panic!("{found:?}") };
            assert_eq!(found.command, *command);
        }
    }
}
