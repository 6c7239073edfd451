//! The other end of a connection of ours: one listener or publisher of the broker, or the broker of a publisher. Its
//! subscriptions or messages, and what waits for it.
//!
//! ```text
//!   bytes ─▶ inbox ── understand ──▶ Heard: subscriptions, messages
//!   queue ─▶ outbox ── write ──▶ TCP                 silent: asked whether it lives
//! ```

use std::collections::{BTreeSet, VecDeque};
use std::io::{ErrorKind, IoSlice, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Instant;

use bytes::Bytes;

use super::assembly::{Assembly, TooLarge};
use super::curve::{self, Curve, Grant, OVERHEAD, Step};
use super::options;
use super::own_messages::Fingerprint;
use super::zmtp::{self, Breach};
use wrapyfi_endpoint::{DropReason, PROGRESS, Share};

/// Subscriptions of one listener. What is beyond is ignored.
const MAX_SUBSCRIPTIONS: usize = 4096;
/// Subscriptions are topic names: nothing longer is read.
const MAX_FRAME_BYTES: usize = 64 * 1024 + OVERHEAD;
/// Reads from one connection before the others have their turn.
const READS: usize = 16;
/// Question whether a peer lives: the command, and no time to live.
const PING: &[u8] = b"\x04PING\0\0";
/// Bytes of memory that a connection with CURVE keeps for its next message.
const KEPT: usize = 64 * 1024;
/// Pieces given to one write.
const SLICES: usize = 64;

/// Socket type that our end of a connection has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Publishes, and hears subscriptions.
    Xpub,
    /// Subscribes, and hears messages.
    Xsub,
    /// Hears requests, and answers each where it came from.
    Router,
    /// Asks one after the other, and hears replies.
    Dealer,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Self::Xpub => "XPUB",
            Self::Xsub => "XSUB",
            Self::Router => "ROUTER",
            Self::Dealer => "DEALER",
        }
    }

    /// True where a socket of ours of this type may have that peer.
    fn takes(self, theirs: &[u8]) -> bool {
        match self {
            Self::Xpub => matches!(theirs, b"SUB" | b"XSUB"),
            Self::Xsub => matches!(theirs, b"PUB" | b"XPUB"),
            Self::Router => matches!(theirs, b"REQ" | b"DEALER" | b"ROUTER"),
            Self::Dealer => matches!(theirs, b"REP" | b"DEALER" | b"ROUTER"),
        }
    }
}

/// Cause of the end of a connection.
#[derive(Debug, thiserror::Error)]
pub(super) enum End {
    #[error("it left")]
    Left,
    #[error(transparent)]
    Breach(#[from] Breach),
    #[error("it offers {theirs} where this side speaks {ours} (endpoints: zeromq: curve)")]
    Mechanism { theirs: String, ours: &'static str },
    #[error(transparent)]
    Curve(#[from] curve::Breach),
    #[error("it sends {0}")]
    TooLarge(#[from] TooLarge),
    #[error("too much waits in this process (limits: waiting_mib)")]
    OverBudget,
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

impl End {
    /// Reason under which it is counted; none for what happens to every connection.
    pub(super) fn reason(&self) -> Option<&'static str> {
        match self {
            Self::TooLarge(_) => Some(DropReason::Oversize.as_str()),
            Self::OverBudget => Some(DropReason::OverBudget.as_str()),
            Self::Mechanism { .. } => Some("mechanism"),
            Self::Curve(breach) => Some(breach.reason()),
            Self::Left | Self::Breach(_) | Self::Io(_) => None,
        }
    }
}

/// Something that a peer said.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Heard {
    Subscribed(Vec<u8>),
    Unsubscribed(Vec<u8>),
    /// Something that is no subscription.
    Ignored,
    /// Subscription or message of a topic that the peer's key may not have.
    Denied(Vec<u8>),
    /// Frames of a message.
    Message(Vec<Bytes>),
}

/// A message as it goes on the wire.
#[derive(Debug)]
pub(super) struct Message {
    pub(super) parts: Vec<Bytes>,
    pub(super) wire_bytes: usize,
    /// Topic and size as its publisher counts it; none for what the broker says itself.
    pub(super) of: Option<(Bytes, usize)>,
    /// Fingerprint by which it is known again when it comes back, where somebody here listens.
    pub(super) print: Option<Fingerprint>,
    /// A listener missed it already: it is counted once.
    missed: AtomicBool,
}

/// A message that a listener did not get.
#[derive(Debug, Clone)]
pub(super) struct Loss {
    pub(super) reason: DropReason,
    pub(super) listener: SocketAddr,
    /// Topic and size, where no other listener missed it before.
    pub(super) first: Option<(Bytes, usize)>,
}

impl Message {
    /// A message of a publisher, with its topic and size.
    pub(super) fn new<F: AsRef<[u8]> + Send + 'static>(
        frames: Vec<F>,
        of: Option<(Bytes, usize)>,
        print: Option<Fingerprint>,
    ) -> Arc<Self> {
        let parts = zmtp::encode(frames);
        let wire_bytes = parts.iter().map(Bytes::len).sum();
        Arc::new(Self { parts, wire_bytes, of, print, missed: AtomicBool::new(false) })
    }

    pub(super) fn loss(&self, reason: DropReason, listener: SocketAddr) -> Loss {
        let first = if self.missed.swap(true, Relaxed) { None } else { self.of.clone() };
        Loss { reason, listener, first }
    }
}

/// Something that the broker says itself.
pub(super) fn control(bytes: Vec<u8>) -> Arc<Message> {
    let (wire_bytes, parts) = (bytes.len(), vec![bytes.into()]);
    Arc::new(Message { parts, wire_bytes, of: None, print: None, missed: AtomicBool::new(true) })
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Greeting,
    Handshake,
    Open,
}

/// Security of a connection.
enum Mechanism {
    Null,
    Curve(Box<Secured>),
}

/// State of a connection with CURVE.
struct Secured {
    curve: Curve,
    /// Our first command, where we begin.
    hello: Option<Vec<u8>>,
    /// The message that has begun, of frames that were opened.
    plain: Option<Assembly>,
    /// Number of messages at the head of the outbox that are of the handshake, and go as they are.
    clear: usize,
    /// The first message of the outbox behind those, sealed when its turn comes: its number is that of its place.
    sealed: Vec<u8>,
}

impl Secured {
    fn seal(&mut self, message: &Message) -> Result<(), End> {
        let wire = message.parts.concat();
        let mut rest = &wire[..];
        while let Some((frame, size)) = zmtp::split_frame(rest, usize::MAX)? {
            self.curve.seal(frame.is_command, frame.more, frame.body, &mut self.sealed)?;
            rest = rest.get(size..).unwrap_or_default();
        }
        Ok(())
    }
}

/// One peer.
pub(super) struct Peer<S = TcpStream> {
    pub(super) stream: S,
    pub(super) address: SocketAddr,
    kind: Kind,
    mechanism: Mechanism,
    stage: Stage,
    inbox: Vec<u8>,
    /// The message that has begun, where we are to hear messages.
    assembly: Option<Assembly>,
    /// Within a message of several frames, which is no subscription.
    inside: bool,
    pub(super) topics: BTreeSet<Vec<u8>>,
    /// Topic that is published; other subscriptions are ignored. None where all topics are.
    only: Option<Bytes>,
    pub(super) outbox: VecDeque<Arc<Message>>,
    /// Messages in it that are counted against the high-water mark.
    waiting: usize,
    /// Bytes of the first that are written.
    written: usize,
    /// Number of bytes that were ever written.
    pub(super) written_bytes: u64,
    /// The connection takes no more until the system says so.
    pub(super) is_blocked: bool,
    share: Share,
    /// Share of the message that has begun in the process's budget of waiting bytes.
    begun: Share,
    since: Instant,
    pub(super) heard_at: Instant,
    asked_at: Option<Instant>,
    /// True once it is known to answer a heartbeat: libzmq before 4.2 does not.
    has_heartbeats: bool,
}

impl<S: Read + Write> Peer<S> {
    pub(super) fn new(stream: S, address: SocketAddr, now: Instant) -> Self {
        Self {
            stream,
            address,
            kind: Kind::Xpub,
            mechanism: Mechanism::Null,
            stage: Stage::Greeting,
            inbox: Vec::new(),
            assembly: None,
            inside: false,
            topics: BTreeSet::new(),
            only: None,
            outbox: VecDeque::from([control(zmtp::greeting(zmtp::NULL, false))]),
            waiting: 0,
            written: 0,
            written_bytes: 0,
            is_blocked: false,
            share: Share::default(),
            begun: Share::default(),
            since: now,
            heard_at: now,
            asked_at: None,
            has_heartbeats: false,
        }
    }

    /// The same, of a connection for messages of one topic.
    pub(super) fn of_topic(self, topic: Bytes) -> Self {
        Self { only: Some(topic), ..self }
    }

    /// The same, of a connection from which we hear messages of at most `limit` bytes.
    pub(super) fn of_messages(self, kind: Kind, limit: usize) -> Self {
        Self { kind, assembly: Some(Assembly::new(limit)), ..self }
    }

    /// The same, with CURVE; `hello` is our first command, where we begin.
    pub(super) fn secured(mut self, curve: Curve, hello: Option<Vec<u8>>) -> Self {
        let mut greeting = zmtp::greeting(zmtp::CURVE, curve.is_server());
        if curve.is_server() {
            // libzmq leaves at another mechanism before it tells its own, and nobody would know why.
            greeting.truncate(zmtp::VERSIONED);
        }
        self.outbox = VecDeque::from([control(greeting)]);
        let plain = self.assembly.take();
        let sealed = |plain: &Assembly| Assembly::new(plain.limit().saturating_add(OVERHEAD));
        self.assembly = plain.as_ref().map(sealed);
        let secured = Secured { curve, hello, plain, clear: 1, sealed: Vec::new() };
        Self { mechanism: Mechanism::Curve(Box::new(secured)), ..self }
    }

    /// Permissions of the peer's key, where it has some.
    pub(super) fn grant(&self) -> Option<&Arc<Grant>> {
        match &self.mechanism {
            Mechanism::Null => None,
            Mechanism::Curve(secured) => secured.curve.grant(),
        }
    }

    /// True for a topic that the peer may hear of.
    pub(super) fn may_hear(&self, topic: &[u8]) -> bool {
        self.grant().is_none_or(|grant| grant.may_subscribe(topic))
    }

    /// Queues a command of the handshake.
    fn say(&mut self, command: &[u8]) {
        if let Mechanism::Curve(secured) = &mut self.mechanism {
            secured.clear += 1;
        }
        self.outbox.push_back(control(zmtp::command(command)));
    }

    /// True when the handshake is over.
    pub(super) fn is_open(&self) -> bool {
        self.stage == Stage::Open
    }

    /// Takes a message into its queue.
    ///
    /// # Errors
    /// Why there is no room for it.
    pub(super) fn queue(
        &mut self,
        message: &Arc<Message>,
        hwm: Option<usize>,
    ) -> Result<(), DropReason> {
        if message.of.is_some() {
            if hwm.is_some_and(|hwm| self.waiting >= hwm) {
                return Err(DropReason::Stalled);
            }
            if !self.share.take(message.wire_bytes) {
                return Err(DropReason::OverBudget);
            }
            self.waiting += 1;
        } else if self.outbox.len() > self.waiting + 4 {
            // The broker repeats its counts: an old message need not wait beside a newer one.
            return Ok(());
        }
        self.outbox.push_back(Arc::clone(message));
        Ok(())
    }

    pub(super) fn write(&mut self) -> std::io::Result<()> {
        while let Some(first) = self.outbox.front()
            && !self.is_blocked
        {
            let written = match &mut self.mechanism {
                Mechanism::Curve(secured) if secured.clear == 0 => {
                    if secured.sealed.is_empty() {
                        secured.seal(first).map_err(std::io::Error::other)?;
                    }
                    self.stream.write(secured.sealed.get(self.written..).unwrap_or_default())
                }
                Mechanism::Curve(secured) => {
                    let clear = secured.clear;
                    self.write_clear(clear)
                }
                Mechanism::Null => self.write_clear(usize::MAX),
            };
            match written {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(count) => {
                    self.written += count;
                    self.written_bytes += count as u64;
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => self.is_blocked = true,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
            while let Some(first) = self.outbox.front() {
                let bytes = match &self.mechanism {
                    Mechanism::Curve(secured) if secured.clear == 0 => secured.sealed.len(),
                    _ => first.wire_bytes,
                };
                // What is not sealed yet is not written.
                if self.written < bytes || self.written == 0 {
                    break;
                }
                self.written -= bytes;
                if let Mechanism::Curve(secured) = &mut self.mechanism {
                    secured.clear = secured.clear.saturating_sub(1);
                    secured.sealed.clear();
                    secured.sealed.shrink_to(KEPT);
                }
                if first.of.is_some() {
                    self.share.give(first.wire_bytes);
                    self.waiting -= 1;
                }
                self.outbox.pop_front();
            }
        }
        Ok(())
    }

    /// Writes the first messages of the outbox as they are.
    fn write_clear(&mut self, messages: usize) -> std::io::Result<usize> {
        let mut skip = self.written;
        let mut slices = Vec::with_capacity(SLICES);
        for part in self.outbox.iter().take(messages).flat_map(|message| &message.parts) {
            match part.get(skip..) {
                Some(rest) if !rest.is_empty() => {
                    slices.push(IoSlice::new(rest));
                    skip = 0;
                }
                _ => skip -= part.len(),
            }
            if slices.len() == SLICES {
                break;
            }
        }
        self.stream.write_vectored(&slices)
    }

    /// Reads what has come; true when there is more. Without `to_the_end` it is read as far as one look shows that
    /// nothing is left.
    ///
    /// # Errors
    /// Why the connection ends.
    pub(super) fn read(
        &mut self,
        scratch: &mut [u8],
        heard: &mut Vec<Heard>,
        to_the_end: bool,
        now: Instant,
    ) -> Result<bool, End> {
        for _ in 0..READS {
            let read = match &mut self.assembly {
                Some(assembly) if assembly.is_open() => {
                    assembly.fill(&mut self.stream).map(|(count, message)| (count, Some(message)))
                }
                _ => self.stream.read(scratch).map(|count| (count, None)),
            };
            match read {
                Ok((0, _)) => return Err(End::Left),
                Ok((count, within)) => {
                    self.heard_at = now;
                    let is_within = within.is_some();
                    match within {
                        Some(Some(frames)) => self.arrived(frames, heard)?,
                        Some(None) => {}
                        None => {
                            self.inbox.extend_from_slice(scratch.get(..count).unwrap_or_default());
                            self.understand(heard)?;
                        }
                    }
                    let begun: usize = self.assemblies().map(Assembly::held).sum();
                    if !self.begun.hold(self.inbox.len() + begun) {
                        return Err(End::OverBudget);
                    }
                    if !is_within && count < scratch.len() && !to_the_end {
                        return Ok(false);
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(false),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error.into()),
            }
        }
        Ok(true)
    }

    /// Takes what has come as far as it is complete.
    fn understand(&mut self, heard: &mut Vec<Heard>) -> Result<(), End> {
        if self.stage == Stage::Greeting {
            let Some((greeting, rest)) = self.inbox.split_first_chunk::<{ zmtp::GREETING }>()
            else {
                // A peer whose first byte is wrong will not send the rest.
                let fits = self.inbox.first().is_none_or(|first| *first == 0xff);
                return if fits { Ok(()) } else { Err(Breach.into()) };
            };
            let (theirs, has_heartbeats) = zmtp::read_greeting(greeting)?;
            self.inbox = rest.to_vec();
            let (ours, hello) = match &mut self.mechanism {
                Mechanism::Null => (zmtp::NULL, None),
                Mechanism::Curve(secured) => {
                    if secured.curve.is_server() {
                        let rest = zmtp::greeting(zmtp::CURVE, true).split_off(zmtp::VERSIONED);
                        secured.clear += 1;
                        self.outbox.push_back(control(rest));
                    }
                    (zmtp::CURVE, secured.hello.take())
                }
            };
            if theirs != ours {
                return Err(End::Mechanism { theirs, ours });
            }
            self.has_heartbeats = has_heartbeats;
            self.stage = Stage::Handshake;
            match hello {
                Some(hello) => self.say(&hello),
                None if ours == zmtp::NULL => {
                    self.outbox.push_back(control(zmtp::ready(self.kind.name())));
                }
                None => {}
            }
        }
        let inbox = std::mem::take(&mut self.inbox);
        let mut rest = &inbox[..];
        loop {
            if self.stage == Stage::Open
                && let Some(assembly) = &mut self.assembly
                && let Some(header) = zmtp::header(rest).filter(|header| !header.is_command)
            {
                let body = rest.get(header.size..).unwrap_or_default();
                let (message, taken) = assembly.begin(&header, body)?;
                rest = body.get(taken..).unwrap_or_default();
                if let Some(frames) = message {
                    self.arrived(frames, heard)?;
                }
                continue;
            }
            let Some((frame, size)) = zmtp::split_frame(rest, MAX_FRAME_BYTES)? else { break };
            match (self.stage, &self.mechanism) {
                (Stage::Open, Mechanism::Null) => {
                    self.hear(frame.is_command, frame.more, frame.body, heard);
                }
                (Stage::Open, Mechanism::Curve(_)) => self.open(frame.body.to_vec(), heard)?,
                _ if frame.is_command => self.handshake(frame.body)?,
                _ => return Err(Breach.into()),
            }
            rest = rest.get(size..).unwrap_or_default();
        }
        self.inbox = rest.to_vec();
        Ok(())
    }

    /// Takes a command of the handshake.
    fn handshake(&mut self, body: &[u8]) -> Result<(), End> {
        let theirs = match &mut self.mechanism {
            Mechanism::Null => {
                let (name, properties) = zmtp::short_text(body).ok_or(Breach)?;
                if name != b"READY" {
                    return Err(Breach.into());
                }
                properties.to_vec()
            }
            Mechanism::Curve(secured) => {
                let ours = zmtp::properties(self.kind.name());
                match secured.curve.handshake(body, &ours) {
                    Ok(Step::Say(command)) => {
                        self.say(&command);
                        return Ok(());
                    }
                    Ok(Step::Open(last, theirs)) => {
                        if let Some(last) = last {
                            self.say(&last);
                        }
                        theirs
                    }
                    Err(breach) => {
                        if let Some(told) = breach.told() {
                            self.say(told);
                        }
                        return Err(breach.into());
                    }
                }
            }
        };
        if !zmtp::socket_type(&theirs).is_some_and(|it| self.kind.takes(it)) {
            return Err(Breach.into());
        }
        self.stage = Stage::Open;
        if self.only.is_some() {
            // Each of two of ours asks only who is silent: nobody would know that the other answers.
            self.outbox.push_back(control(zmtp::command(PING)));
        }
        Ok(())
    }

    /// Takes a message as it came, which with CURVE is one frame of one.
    fn arrived(&mut self, frames: Vec<Bytes>, heard: &mut Vec<Heard>) -> Result<(), End> {
        match &self.mechanism {
            Mechanism::Null => heard.push(Heard::Message(frames)),
            Mechanism::Curve(_) => {
                for frame in frames {
                    self.open(frame.into(), heard)?;
                }
            }
        }
        Ok(())
    }

    /// Opens a frame that was sealed.
    fn open(&mut self, mut sealed: Vec<u8>, heard: &mut Vec<Heard>) -> Result<(), End> {
        let Mechanism::Curve(secured) = &mut self.mechanism else { return Ok(()) };
        let opened = secured.curve.open(&mut sealed)?;
        let Some(plain) = secured.plain.as_mut().filter(|_| !opened.is_command) else {
            let body = sealed.get(OVERHEAD..).unwrap_or_default();
            self.hear(opened.is_command, opened.more, body, heard);
            return Ok(());
        };
        let Some(message) = plain.add(Bytes::from(sealed).slice(OVERHEAD..), opened.more)? else {
            return Ok(());
        };
        let topic = message.first().cloned().unwrap_or_default();
        // Requests and replies have no topic; who may send them is decided by the handshake.
        let is_denied = self.kind == Kind::Xsub
            && secured.curve.grant().is_some_and(|grant| !grant.may_publish(&topic));
        heard.push(if is_denied { Heard::Denied(topic.into()) } else { Heard::Message(message) });
        Ok(())
    }

    /// Takes a frame that is no part of a message for us.
    fn hear(&mut self, is_command: bool, more: bool, body: &[u8], heard: &mut Vec<Heard>) {
        if is_command {
            return self.obey(body, heard);
        }
        match (self.inside, more) {
            (false, false) => self.subscribe(body, heard),
            (false, true) => heard.push(Heard::Ignored),
            (true, _) => {}
        }
        self.inside = more;
    }

    /// Messages that have begun, as they come and as they are opened.
    fn assemblies(&self) -> impl Iterator<Item = &Assembly> {
        let plain = match &self.mechanism {
            Mechanism::Null => None,
            Mechanism::Curve(secured) => secured.plain.as_ref(),
        };
        self.assembly.iter().chain(plain)
    }

    fn obey(&mut self, body: &[u8], heard: &mut Vec<Heard>) {
        match zmtp::short_text(body) {
            Some((b"PONG", _)) => self.has_heartbeats = true,
            Some((b"PING", rest)) => {
                self.has_heartbeats = true;
                // Two bytes of time to live, then a context that is sent back.
                let context = rest.get(2..).unwrap_or_default();
                let pong =
                    [&b"\x04PONG"[..], context.get(..context.len().min(16)).unwrap_or_default()];
                if self.outbox.len() <= self.waiting + 4 {
                    self.outbox.push_back(control(zmtp::command(&pong.concat())));
                }
            }
            Some((b"SUBSCRIBE", topic)) => self.subscribe(&[&[1][..], topic].concat(), heard),
            Some((b"CANCEL", topic)) => self.subscribe(&[&[0][..], topic].concat(), heard),
            _ => {}
        }
    }

    fn subscribe(&mut self, word: &[u8], heard: &mut Vec<Heard>) {
        let (topic, on) = match word.split_first() {
            Some((1, topic)) if self.topics.len() < MAX_SUBSCRIPTIONS => (topic.to_vec(), true),
            Some((0, topic)) => (topic.to_vec(), false),
            _ => return heard.push(Heard::Ignored),
        };
        if self.kind != Kind::Xpub {
            return heard.push(Heard::Ignored);
        }
        if self.only.as_ref().is_some_and(|only| !only.starts_with(&topic)) {
            return;
        }
        if on && !self.may_hear(&topic) {
            return heard.push(Heard::Denied(topic));
        }
        let changed =
            if on { self.topics.insert(topic.clone()) } else { self.topics.remove(&topic) };
        if changed {
            heard.push(if on { Heard::Subscribed(topic) } else { Heard::Unsubscribed(topic) });
        }
    }

    /// False when the peer is dead. One that was silent for some time is asked: once where it may not know what is
    /// asked, and only TCP tells then that it is gone.
    pub(super) fn is_alive(&mut self, now: Instant) -> bool {
        if self.stage != Stage::Open {
            return now.saturating_duration_since(self.since) < options::HANDSHAKE;
        }
        let silent = now.saturating_duration_since(self.heard_at);
        // A peer that reads but stopped within a message is dead all the same.
        let has_begun = self.assemblies().any(Assembly::has_begun);
        if silent >= PROGRESS && (has_begun || !self.inbox.is_empty()) {
            return false;
        }
        if silent < options::SILENCE {
            self.asked_at = None;
            return true;
        }
        match self.asked_at {
            // A listener that does not read cannot have heard the question.
            _ if !self.outbox.is_empty() => self.asked_at = None,
            None => {
                self.asked_at = Some(now);
                self.outbox.push_back(control(zmtp::command(PING)));
            }
            Some(at) if self.has_heartbeats => {
                return now.saturating_duration_since(at) < options::HEARTBEAT_TIMEOUT;
            }
            Some(_) => {}
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

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
            assert_eq!(peer.outbox.len(), 1, "it is asked");
            peer.outbox.clear();
            assert!(peer.is_alive(asked_at + options::HEARTBEAT_TIMEOUT / 2));
            assert_eq!(peer.is_alive(asked_at + options::HEARTBEAT_TIMEOUT), lives, "{minor}");
            assert!(peer.outbox.is_empty(), "it is asked once");
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
}
