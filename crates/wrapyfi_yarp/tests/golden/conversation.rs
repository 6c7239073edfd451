//! Recorded conversations, played against our ports: the bytes of one side are sent, those of the
//! other one must come back.

use std::time::Duration;

use bytes::{Bytes, BytesMut};
use serde_json::Value;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use wrapyfi_yarp::wire::message::{self, Found, MessageReader};
use wrapyfi_yarp::wire::text::TextReader;
use wrapyfi_yarp::wire::{Body, Command, Progress, number};
use wrapyfi_yarp::{Bottle, Dialect, WireLimits};

use crate::golden::{file, hex};

/// Longest wait for a peer: beyond any pause of a busy machine.
pub(crate) const TIMEOUT: Duration = Duration::from_secs(20);

/// One step of a conversation.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Part {
    /// Bytes of the side that opened the connection.
    Client(Vec<u8>),
    Server(Vec<u8>),
    ClientEnd,
    ServerEnd,
}

/// The steps of a file, in order.
pub(crate) fn parts(name: &str) -> Vec<Part> {
    let recorded = file(name);
    let part = |part: &Value| {
        let client = part["dir"] == "c2s";
        match (part["hex"].as_str(), client) {
            (Some(bytes), true) => Part::Client(hex(bytes)),
            (Some(bytes), false) => Part::Server(hex(bytes)),
            (None, true) => Part::ClientEnd,
            (None, false) => Part::ServerEnd,
        }
    };
    recorded["stream"].as_array().unwrap().iter().map(part).collect()
}

/// The datagrams of a file that carry data, in order.
pub(crate) fn datagrams(name: &str) -> Vec<Vec<u8>> {
    let recorded = file(name);
    let all = recorded["datagrams"].as_array().unwrap().iter();
    let bytes = all.map(|datagram| hex(datagram["hex"].as_str().unwrap()));
    // Those with counter -1 only wake the receiver that sends them.
    bytes.filter(|datagram| datagram[4..8] != [0xff; 4]).collect()
}

/// A data message of a recorded sender.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sent {
    pub(crate) envelope: Option<Bytes>,
    /// PortPayload as a binary carrier brings it.
    pub(crate) payload: Bytes,
    pub(crate) reply: bool,
}

/// The data messages in what a sender wrote, behind its header.
pub(crate) fn messages(stream: &[u8], dialect: Dialect) -> Vec<Sent> {
    let limits = WireLimits::default();
    let mut found = Vec::new();
    let mut take = |command: Command, body: Body| {
        if let Command::Data { reply, envelope } = command {
            let payload = match body {
                Body::Binary(bytes) | Body::File(bytes) => bytes,
                text @ Body::Text(_) => {
                    text.bottle(dialect, &limits).unwrap().encode(dialect).unwrap().into()
                }
            };
            found.push(Sent { envelope, payload, reply });
        }
    };
    if stream.starts_with(b"CONN") {
        let line = stream.iter().position(|&byte| byte == b'\n').unwrap() + 1;
        let mut buffer = BytesMut::from(&stream[line..]);
        let mut reader = TextReader::new(&limits);
        while let Progress::Event(incoming) = reader.poll(&mut buffer).unwrap() {
            take(incoming.command, incoming.body);
        }
    } else {
        let length = i32::from_le_bytes(stream[8..12].try_into().unwrap()) as usize;
        let mut buffer = BytesMut::from(&stream[12 + length..]);
        let mut reader = MessageReader::new(&limits);
        while let Progress::Event(event) = reader.poll(&mut buffer).unwrap() {
            if let Found::Message(incoming) = event {
                take(incoming.command, incoming.body);
            }
        }
    }
    found
}

/// The same message with its payload as one block: what our ports write. Boundaries of blocks mean
/// nothing to readers, but YARP sends the head of an image as a block of its own.
pub(crate) fn in_one_block(part: &[u8]) -> Vec<u8> {
    let index = number::decode(part) == Some(10);
    if !index || part[8] < 3 {
        return part.to_vec();
    }
    let mut buffer = BytesMut::from(part);
    let mut reader = MessageReader::new(&WireLimits::default());
    let Progress::Event(Found::Message(incoming)) = reader.poll(&mut buffer).unwrap() else {
        panic!("{part:?}")
    };
    assert!(buffer.is_empty());
    let Body::Binary(payload) = incoming.body else { panic!() };
    message::whole(&incoming.command, &payload).unwrap()
}

/// The replies in what a server wrote, as a binary carrier brings them.
pub(crate) fn replies(stream: &[u8], text: bool) -> Vec<Bytes> {
    let limits = WireLimits::default();
    let mut found = Vec::new();
    if text {
        for line in std::str::from_utf8(stream).unwrap().lines() {
            if !line.starts_with("Welcome ") && line != "<ACK>" {
                let bottle = Bottle::from_text(line.as_bytes(), &limits).unwrap();
                found.push(bottle.encode(Dialect::V3).unwrap().into());
            }
        }
        return found;
    }
    let mut rest = Bytes::copy_from_slice(&stream[8..]);
    while !rest.is_empty() {
        if rest.starts_with(&number::ACK) {
            rest = rest.slice(8..);
        } else {
            let (_, used) = Bottle::decode(&rest, Dialect::V3, &limits).unwrap();
            found.push(rest.split_to(used));
        }
    }
    found
}

/// True when two messages of the text carriers mean the same: numbers may be printed differently.
fn same_text(found: &[u8], expected: &[u8]) -> bool {
    let read = |bytes: &[u8]| {
        let mut buffer = BytesMut::from(bytes);
        let mut reader = TextReader::new(&WireLimits::default());
        let mut commands = Vec::new();
        while let Progress::Event(incoming) = reader.poll(&mut buffer).unwrap() {
            let bottle = incoming.body.bottle(Dialect::V3, &WireLimits::default()).unwrap();
            commands.push((incoming.command, bottle.encode(Dialect::V3).unwrap()));
        }
        (commands, buffer)
    };
    !expected.starts_with(b"CONN") && read(found) == read(expected)
}

/// Asserts that our side writes `expected`.
pub(crate) async fn expect(stream: &mut TcpStream, expected: &[u8], text: bool, what: &str) {
    let shown = String::from_utf8_lossy(expected).into_owned();
    if !text || expected.starts_with(b"CONN") {
        let mut found = vec![0; expected.len()];
        match tokio::time::timeout(TIMEOUT, stream.read_exact(&mut found)).await {
            Ok(Ok(_)) => {}
            other => panic!("{what}: {other:?} instead of {shown:?}"),
        }
        let found_text = String::from_utf8_lossy(&found);
        assert!(found == expected, "{what}:\n found    {found_text:?}\n expected {shown:?}");
        return;
    }
    let lines = expected.iter().filter(|&&byte| byte == b'\n').count();
    let mut found = Vec::new();
    while found.iter().filter(|&&byte| byte == b'\n').count() < lines {
        let byte = tokio::time::timeout(TIMEOUT, stream.read_u8()).await;
        let byte = byte.unwrap_or_else(|_| panic!("{what}: no {shown:?}"));
        found.push(byte.unwrap_or_else(|error| panic!("{what}: {error} instead of {shown:?}")));
    }
    let same = found == expected || same_text(&found, expected);
    assert!(same, "{what}: {:?} instead of {shown:?}", String::from_utf8_lossy(&found));
}

/// Asserts that our side closes, having said nothing more.
pub(crate) async fn expect_end(stream: &mut TcpStream, what: &str) {
    let mut rest = Vec::new();
    let read = tokio::time::timeout(TIMEOUT, stream.read_to_end(&mut rest)).await;
    let read = read.unwrap_or_else(|_| panic!("{what}: not closed"));
    // A reset ends a connection, too.
    drop(read);
    assert!(rest.is_empty(), "{what}: {:?} at the end", String::from_utf8_lossy(&rest));
}

/// Plays the client; our server's answers must be those of `parts`.
pub(crate) async fn play_client(stream: &mut TcpStream, parts: &[Part], what: &str) {
    for (at, part) in parts.iter().enumerate() {
        let what = format!("{what}, part {at}");
        match part {
            // The server may be gone, as it was when this was recorded.
            Part::Client(bytes) => drop(stream.write_all(bytes).await),
            Part::Server(bytes) => expect(stream, bytes, false, &what).await,
            Part::ClientEnd => drop(stream.shutdown().await),
            Part::ServerEnd => expect_end(stream, &what).await,
        }
    }
    stream.shutdown().await.ok();
    expect_end(stream, what).await;
}

/// Plays the server; our client's bytes must be those of `parts`, up to the end of either side.
pub(crate) async fn play_server(stream: &mut TcpStream, parts: &[Part], text: bool, what: &str) {
    play_parts(stream, parts, text, what).await;
    stream.shutdown().await.ok();
    expect_end(stream, what).await;
}

/// As [`play_server`], and leaves the connection as it is after the last part.
pub(crate) async fn play_parts(stream: &mut TcpStream, parts: &[Part], text: bool, what: &str) {
    for (at, part) in parts.iter().enumerate() {
        let what = format!("{what}, part {at}");
        match part {
            Part::Client(bytes) => expect(stream, &in_one_block(bytes), text, &what).await,
            Part::Server(bytes) => stream.write_all(bytes).await.unwrap(),
            Part::ClientEnd | Part::ServerEnd => break,
        }
    }
}

/// `parts` with the number that a receiver answered to the header replaced.
pub(crate) fn with_port(parts: Vec<Part>, port: u16) -> Vec<Part> {
    let mut first = true;
    let exchange = |part| match part {
        Part::Server(bytes) if first && number::decode(&bytes).is_some() => {
            first = false;
            let mut bytes = bytes;
            bytes[..8].copy_from_slice(&number::encode(i32::from(port)));
            Part::Server(bytes)
        }
        other => other,
    };
    parts.into_iter().map(exchange).collect()
}

/// All bytes of one side.
pub(crate) fn side(parts: &[Part], client: bool) -> Vec<u8> {
    let of_side = parts.iter().filter_map(|part| match part {
        Part::Client(bytes) if client => Some(bytes),
        Part::Server(bytes) if !client => Some(bytes),
        _ => None,
    });
    of_side.flatten().copied().collect()
}
