//! Readers of foreign bytes without sockets, for fuzzing: no part of the interface.

use std::collections::BTreeMap;
use std::io::{ErrorKind, Read, Result, Write};
use std::net::{Ipv4Addr, SocketAddr};
use std::time::Instant;

use bytes::Bytes;

use super::discovery;
use super::heard::Heard;
use super::monitor::Monitor;
use super::peer::Peer;
use super::port_check::{self, PortHolder};
use super::traffic::TopicTraffic;
use super::zmtp::{self, Kind};

/// Answer of a port whose program says `bytes` and closes.
pub fn port_answer(bytes: &[u8]) -> PortHolder {
    port_check::ask(
        &mut Pieces { rest: bytes, piece: bytes.len().max(1), pauses: false, paused: false },
        "SUB",
        zmtp::NULL,
    )
}

/// Words of a connection to a port of the broker.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Conversation {
    /// Messages, by their frames.
    pub messages: Vec<Vec<Bytes>>,
    /// Subscriptions (`true`) and their ends.
    pub subscriptions: Vec<(bool, Vec<u8>)>,
    /// Number of messages that are no subscriptions, where these are expected.
    pub ignored: usize,
    /// Cause of the end of the connection, where the port ended it.
    pub ended: Option<String>,
}

/// A connection to a port of the broker, which says `bytes`, so many at a time. `kind` chooses the port: that of
/// listeners, of publishers, of clients or of servers, whose messages have at most `limit` bytes.
#[must_use]
pub fn converse(kind: usize, limit: usize, bytes: &[u8], piece: usize) -> Conversation {
    let stream = Pieces { rest: bytes, piece: piece.max(1), pauses: true, paused: false };
    let (address, now) = (SocketAddr::from((Ipv4Addr::LOCALHOST, 1)), Instant::now());
    let peer = Peer::new(stream, address, now);
    let mut peer = match kind {
        0 => peer,
        1 => peer.of_messages(Kind::Xsub, limit),
        2 => peer.of_messages(Kind::Router, limit),
        _ => peer.of_messages(Kind::Dealer, limit),
    };
    let (mut scratch, mut heard, mut found) = ([0; 4096], Vec::new(), Conversation::default());
    loop {
        match peer.read(&mut scratch, &mut heard, true, now) {
            Ok(false) if peer.stream.rest.is_empty() => break,
            Ok(_) => {}
            Err(end) => {
                found.ended = Some(end.to_string());
                break;
            }
        }
        if let Err(error) = peer.write() {
            found.ended = Some(error.to_string());
            break;
        }
    }
    for one in heard {
        match one {
            Heard::Message(frames) => found.messages.push(frames),
            Heard::Subscribed(topic) => found.subscriptions.push((true, topic.to_vec())),
            Heard::Unsubscribed(topic) => found.subscriptions.push((false, topic.to_vec())),
            Heard::Ignored | Heard::NoRoom(_) | Heard::Denied(_) | Heard::NotTaken(_) => {
                found.ignored += 1;
            }
        }
    }
    found
}

/// Counts as the broker tells them after these subscriptions (`true`) and their ends.
pub fn counts_after<'t>(
    own: &str,
    words: impl IntoIterator<Item = (bool, &'t [u8])>,
) -> Option<String> {
    let now = Instant::now();
    let mut monitor = Monitor::new(Some(own));
    for (is_on, topic) in words {
        if is_on {
            monitor.subscribed(topic, now);
        } else {
            monitor.unsubscribed(topic, now);
        }
    }
    monitor.message()
}

/// A connection that says so many bytes at a time, and takes all that is said to it.
struct Pieces<'b> {
    rest: &'b [u8],
    piece: usize,
    /// Nothing is there for now after each piece; else the connection is closed after the last.
    pauses: bool,
    paused: bool,
}

impl Read for Pieces<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        if self.pauses && (self.rest.is_empty() || !self.paused) {
            self.paused = true;
            return Err(ErrorKind::WouldBlock.into());
        }
        self.paused = false;
        let (now, later) = self.rest.split_at(self.rest.len().min(self.piece).min(buffer.len()));
        self.rest = later;
        let mut now = now;
        now.read(buffer)
    }
}

impl Write for Pieces<'_> {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<()> {
        Ok(())
    }
}

/// Topics with their listeners, from what a broker told.
pub fn read_counts(body: &[u8]) -> Option<BTreeMap<String, u64>> {
    discovery::read_counts(body)
}

/// Topics with their traffic, from what a broker of ours told.
pub fn read_table(body: &[u8]) -> Option<BTreeMap<String, TopicTraffic>> {
    discovery::read_table(body)
}
