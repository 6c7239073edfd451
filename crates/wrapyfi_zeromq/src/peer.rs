//! The other end of a connection of ours: one listener or publisher of the broker, or the broker of a publisher. Its
//! subscriptions or messages, and what waits for it.
//!
//! ```text
//!   bytes ─▶ inbox ── understand ──▶ Heard: subscriptions, messages
//!   queue ─▶ outbox ── write ──▶ TCP                 silent: asked whether it lives
//! ```

use std::collections::BTreeSet;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;

use super::assembly::Assembly;
use super::curve::{Curve, Grant, OVERHEAD};
use super::ends::End;
use super::heard::{ConnectionEnd, Heard};
use super::mechanism::{Mechanism, Secured};
use super::message::Message;
use super::options;
use super::own_messages::Fingerprint;
use super::queue::Queue;
use super::traffic::{DENIED, REFUSED};
use super::zmtp::{self, Breach, HandshakeStep, Kind};
use wrapyfi_endpoint::{Budget, DropReason, PROGRESS, Share, WAITING};

/// Subscriptions of one listener. Those beyond are ignored.
const MAX_SUBSCRIPTIONS: usize = 4096;
/// Bytes of all subscriptions: a sixteenth of what may wait in the process, a quarter of that for one listener.
static SUBSCRIPTIONS: Budget = Budget::part_of(&WAITING, 16);
/// Bytes of memory that a subscription takes beside its topic: in the listener, the index, the counts, and what
/// publishers are told.
const SUBSCRIPTION_BYTES: usize = 512;
/// Subscriptions are topic names: nothing longer is read.
const MAX_FRAME_BYTES: usize = 64 * 1024 + OVERHEAD;
/// Reads from one connection before the others have their turn.
const READS: usize = 16;
/// Time since the turn began after which one peer is read no further: large messages under CURVE take their time, and
/// others would not get through their handshakes.
pub(super) const TURN: Duration = Duration::from_millis(5);
/// Question whether a peer lives: the command, and no time to live.
const PING: &[u8] = b"\x04PING\0\0";

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Greeting,
    Handshake,
    Open,
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
    pub(super) topics: BTreeSet<Bytes>,
    /// Share of the topics in what subscriptions may take.
    subscribed: Share,
    /// Topic that is published; other subscriptions are ignored. None where all topics are.
    only: Option<Bytes>,
    /// True where it is we who have connected.
    connects: bool,
    /// Topics to which we subscribe once the handshake is over.
    subscribes: Vec<String>,
    /// True where the other side has said that our key may not publish that topic.
    pub(super) is_refused: bool,
    pub(super) outbox: Queue,
    /// The connection takes no more until the system says so.
    pub(super) is_blocked: bool,
    /// Share of the message that has begun in the process's budget of waiting bytes.
    begun: Share,
    since: Instant,
    pub(super) heard_at: Instant,
    asked_at: Option<Instant>,
    /// True once it is known to answer a heartbeat: libzmq before 4.2 does not.
    has_heartbeats: bool,
    /// End of the connection at which we are; `None` where its address is not known.
    end: Option<End>,
}

impl<S: Read + Write> Peer<S> {
    pub(super) fn new(stream: S, address: SocketAddr, now: Instant) -> Self {
        let mut peer = Self {
            stream,
            address,
            kind: Kind::Xpub,
            mechanism: Mechanism::Null,
            stage: Stage::Greeting,
            inbox: Vec::new(),
            assembly: None,
            inside: false,
            topics: BTreeSet::new(),
            subscribed: Share::of(&SUBSCRIPTIONS),
            only: None,
            connects: false,
            subscribes: Vec::new(),
            is_refused: false,
            outbox: Queue::default(),
            is_blocked: false,
            begun: Share::default(),
            since: now,
            heard_at: now,
            asked_at: None,
            has_heartbeats: false,
            end: None,
        };
        peer.outbox.push_word(Mechanism::Null.greeting().0);
        peer
    }

    /// The same, of a connection that we have made.
    pub(super) fn connecting(self) -> Self {
        Self { connects: true, ..self }
    }

    /// The same, at that end of a connection, where its address is known.
    pub(super) fn at(self, end: Option<End>) -> Self {
        Self { end, ..self }
    }

    /// The same, of a connection for messages of one topic.
    pub(super) fn of_topic(self, topic: Bytes) -> Self {
        Self { only: Some(topic), ..self }
    }

    /// The same, of a connection from which we hear messages of at most `limit` bytes.
    pub(super) fn of_messages(self, kind: Kind, limit: usize) -> Self {
        let assembly = Assembly::new(limit);
        // A request or a reply that is passed over would be waited for: who sends it learns of it by the connection.
        let assembly = if kind == Kind::Xsub { assembly.passing_over() } else { assembly };
        Self { kind, assembly: Some(assembly), ..self }
    }

    /// The same, which subscribes to `topics`.
    pub(super) fn subscribing(self, topics: Vec<String>) -> Self {
        Self { subscribes: topics, ..self }
    }

    /// The same, with CURVE; `hello` is our first command, where we begin.
    pub(super) fn secured(mut self, curve: Curve, hello: Option<Vec<u8>>) -> Self {
        let plain = self.assembly.take();
        self.assembly = plain.as_ref().map(Secured::around);
        self.mechanism = Mechanism::curve(curve, hello, plain);
        self.outbox = Queue::default();
        self.outbox.push_word(self.mechanism.greeting().0);
        self
    }

    /// Permissions of the peer's key, where it has some.
    pub(super) fn grant(&self) -> Option<&Arc<Grant>> {
        self.mechanism.grant()
    }

    /// True for a topic that the peer may hear of.
    pub(super) fn may_hear(&self, topic: &[u8]) -> bool {
        self.grant().is_none_or(|grant| grant.may_subscribe(topic))
    }

    /// Queues a command of the handshake.
    fn say(&mut self, command: &[u8]) {
        self.outbox.push_word(zmtp::command(command));
    }

    /// Queues a command on the connection that is open.
    fn tell(&mut self, command: &[u8]) {
        if let Some(bytes) = self.mechanism.command(command) {
            self.outbox.push_word(bytes);
        }
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
        let is_of_publisher = message.of.is_some();
        if is_of_publisher && hwm.is_some_and(|hwm| self.outbox.waiting() >= hwm) {
            return Err(DropReason::Stalled);
        }
        if !is_of_publisher && self.outbox.words() > 4 {
            // The broker repeats its counts: an old message need not wait beside a newer one.
            return Ok(());
        }
        let sealed =
            self.mechanism.sealed(&message.parts).map_err(|_never| DropReason::SendFailed)?;
        match self.outbox.push(message, sealed) {
            Err(reason) if is_of_publisher => Err(reason),
            _ => Ok(()),
        }
    }

    /// Takes a small message of a publisher of ours, of `bytes` bytes, into its queue, which no other peer is to get.
    ///
    /// # Errors
    /// Why there is no room for it.
    pub(super) fn queue_small(
        &mut self,
        frames: &[Vec<u8>],
        bytes: usize,
        print: Option<Fingerprint>,
        hwm: Option<usize>,
    ) -> Result<(), DropReason> {
        if hwm.is_some_and(|hwm| self.outbox.waiting() >= hwm) {
            return Err(DropReason::Stalled);
        }
        let append = |out: &mut Vec<u8>| self.mechanism.append(frames, out);
        let appended = self.outbox.push_small(bytes, print, append)?;
        // A connection whose sealing has failed, which does not happen, sends what the broker ends it for.
        appended.and_then(Result::ok).ok_or(DropReason::SendFailed)
    }

    pub(super) fn write(&mut self) -> std::io::Result<()> {
        if self.is_blocked {
            return Ok(());
        }
        let stream = &mut self.stream;
        self.is_blocked = !self.outbox.write(|slices| stream.write_vectored(slices))?;
        Ok(())
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
    ) -> Result<bool, ConnectionEnd> {
        for _ in 0..READS {
            let read = match &mut self.assembly {
                Some(assembly) if assembly.is_open() => {
                    assembly.fill(&mut self.stream).map(|(count, message)| (count, Some(message)))
                }
                _ => self.stream.read(scratch).map(|count| (count, None)),
            };
            match read {
                Ok((0, _)) => return Err(ConnectionEnd::Left),
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
                    if !self.hold_begun() {
                        let is_passed_over = self.give_up_begun(DropReason::OverBudget);
                        self.tell_not_taken(heard);
                        if !is_passed_over || !self.hold_begun() {
                            return Err(ConnectionEnd::OverBudget);
                        }
                    }
                    if !is_within && count < scratch.len() && !to_the_end {
                        return Ok(false);
                    }
                    if now.elapsed() >= TURN {
                        return Ok(true);
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(false),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error.into()),
            }
        }
        Ok(true)
    }

    /// Counts what has begun; false when there is no room for it.
    fn hold_begun(&self) -> bool {
        let begun: usize = self.assemblies().map(Assembly::held).sum();
        self.begun.hold(self.inbox.len() + begun)
    }

    /// Gives up the message that has begun; false where the connection has to end: with CURVE only a frame that was
    /// read tells whether another follows.
    fn give_up_begun(&mut self, reason: DropReason) -> bool {
        let plain = self.plain_assembly();
        let is_passed_over = plain.is_some_and(|plain| plain.pass_over(reason));
        is_passed_over && self.mechanism.secured().is_none()
    }

    /// The assembly of messages as they are once they are opened.
    fn plain_assembly(&mut self) -> Option<&mut Assembly> {
        match &mut self.mechanism {
            Mechanism::Null => self.assembly.as_mut(),
            Mechanism::Curve(secured) => secured.plain.as_mut(),
        }
    }

    /// Tells of a message that is passed over.
    fn tell_not_taken(&mut self, heard: &mut Vec<Heard>) {
        let told = self.plain_assembly().and_then(Assembly::not_taken);
        heard.extend(told.map(Heard::NotTaken));
    }

    /// Takes what has come as far as it is complete.
    fn understand(&mut self, heard: &mut Vec<Heard>) -> Result<(), ConnectionEnd> {
        if self.stage == Stage::Greeting {
            let Some((greeting, rest)) = self.inbox.split_first_chunk::<{ zmtp::GREETING }>()
            else {
                // A peer whose first byte is wrong will not send the rest.
                let fits = self.inbox.first().is_none_or(|first| *first == 0xff);
                return if fits { Ok(()) } else { Err(Breach.into()) };
            };
            let (theirs, has_heartbeats) = zmtp::read_greeting(greeting)?;
            self.inbox = rest.to_vec();
            self.mechanism.greeting().1.into_iter().for_each(|rest| self.outbox.push_word(rest));
            let ours = self.mechanism.name();
            if theirs != ours {
                return Err(ConnectionEnd::Mechanism { theirs, ours });
            }
            self.has_heartbeats = has_heartbeats;
            self.stage = Stage::Handshake;
            self.mechanism
                .begin(self.kind.name())
                .into_iter()
                .for_each(|first| self.outbox.push_word(first));
        }
        let inbox = std::mem::take(&mut self.inbox);
        let mut rest = &inbox[..];
        loop {
            if self.stage == Stage::Open
                && let Some(assembly) = &mut self.assembly
                && let Some(header) = zmtp::header(rest).filter(|header| !header.is_command)
            {
                let body = rest.get(header.size..).unwrap_or_default();
                let begun = assembly.begin(&header, body);
                if begun.is_err() && self.mechanism.secured().is_some() {
                    self.give_up_begun(DropReason::Oversize);
                }
                self.tell_not_taken(heard);
                let (message, taken) = begun?;
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
    fn handshake(&mut self, body: &[u8]) -> Result<(), ConnectionEnd> {
        let theirs = match self.mechanism.handshake(body, self.kind.name()) {
            Ok(HandshakeStep::Say(command)) => {
                self.say(&command);
                return Ok(());
            }
            Ok(HandshakeStep::Open(last, theirs)) => {
                last.iter().for_each(|last| self.say(last));
                theirs
            }
            Err(end) => {
                if let Some(told) = end.farewell() {
                    self.say(told);
                }
                return Err(end);
            }
        };
        let (theirs, ours) = (zmtp::socket_type(&theirs).ok_or(Breach)?, self.kind);
        if !ours.accepts(theirs) {
            let theirs = String::from_utf8_lossy(theirs).into_owned();
            return Err(match ours.other().accepts(theirs.as_bytes()) {
                true => ConnectionEnd::OtherPort { theirs, ours },
                false => Breach.into(),
            });
        }
        self.stage = Stage::Open;
        if self.connects {
            // Each of two of ours asks only who is silent: no program would know that the other answers.
            self.tell(PING);
        }
        std::mem::take(&mut self.subscribes).iter().try_for_each(|topic| self.subscribe_to(topic))
    }

    /// Subscribes to what begins with `topic`, on a connection that is open.
    ///
    /// # Errors
    /// When too much waits in this process.
    pub(super) fn subscribe_to(&mut self, topic: &str) -> Result<(), ConnectionEnd> {
        let is_sealed = self.mechanism.secured().is_some();
        let word = Message::subscription(true, topic.as_bytes(), is_sealed);
        self.queue(&word, None).map_err(|_full| ConnectionEnd::OverBudget)
    }

    /// Takes a message as it came, which with CURVE is one frame of one.
    fn arrived(&mut self, frames: Vec<Bytes>, heard: &mut Vec<Heard>) -> Result<(), ConnectionEnd> {
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
    fn open(&mut self, mut sealed: Vec<u8>, heard: &mut Vec<Heard>) -> Result<(), ConnectionEnd> {
        let Mechanism::Curve(secured) = &mut self.mechanism else { return Ok(()) };
        let opened = secured.open(&mut sealed)?;
        let Some(plain) = secured.plain.as_mut().filter(|_| !opened.is_command) else {
            let body = sealed.get(OVERHEAD..).unwrap_or_default();
            self.hear(opened.is_command, opened.more, body, heard);
            return Ok(());
        };
        let added = plain.add(Bytes::from(sealed).slice(OVERHEAD..), opened.more);
        self.tell_not_taken(heard);
        let Some(message) = added? else { return Ok(()) };
        let topic = message.first().cloned().unwrap_or_default();
        // Requests and replies have no topic; who may send them is decided by the handshake.
        let is_denied = self.kind == Kind::Xsub
            && self.mechanism.grant().is_some_and(|grant| !grant.may_publish(&topic));
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
        let plain = self.mechanism.secured().and_then(|secured| secured.plain.as_ref());
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
                if self.outbox.words() <= 4 {
                    self.tell(&pong.concat());
                }
            }
            Some((b"SUBSCRIBE", topic)) => self.subscribe(&[&[1][..], topic].concat(), heard),
            Some((b"CANCEL", topic)) => self.subscribe(&[&[0][..], topic].concat(), heard),
            _ => {}
        }
    }

    fn subscribe(&mut self, word: &[u8], heard: &mut Vec<Heard>) {
        let (topic, on) = match word.split_first() {
            Some((on @ (0 | 1), topic)) => (Bytes::copy_from_slice(topic), *on == 1),
            _ => return heard.push(Heard::Ignored),
        };
        if self.kind != Kind::Xpub {
            return heard.push(Heard::Ignored);
        }
        if let Some(only) = self.only.as_ref().filter(|only| !only.starts_with(&topic)) {
            self.is_refused |= topic.strip_prefix(REFUSED.as_bytes()) == Some(&**only);
            return;
        }
        if let Some(asked) = topic.strip_prefix(DENIED.as_bytes()) {
            if on && !self.may_hear(asked) {
                let is_sealed = self.mechanism.secured().is_some();
                // Bounded: the queue takes few such answers while none is read.
                _ = self.queue(&Message::new(vec![topic], is_sealed, None, None), None);
            }
            return;
        }
        if on && !self.may_hear(&topic) {
            return heard.push(Heard::Denied(topic.into()));
        }
        let bytes = topic.len() + SUBSCRIPTION_BYTES;
        if !on {
            if self.topics.remove(&topic) {
                self.subscribed.give(bytes);
                heard.push(Heard::Unsubscribed(topic));
            }
        } else if !self.topics.contains(&topic) {
            if self.topics.len() >= MAX_SUBSCRIPTIONS || !self.subscribed.take(bytes) {
                return heard.push(Heard::NoRoom(topic));
            }
            self.topics.insert(topic.clone());
            heard.push(Heard::Subscribed(topic));
        }
    }

    /// True where the other end is in this process, which needs no question whether it lives.
    pub(super) fn is_inside(&self) -> bool {
        self.end.as_ref().is_some_and(End::has_other)
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
        if silent < options::SILENCE || self.is_inside() {
            self.asked_at = None;
            return true;
        }
        match self.asked_at {
            // A listener that does not read cannot have heard the question.
            _ if !self.outbox.is_empty() => self.asked_at = None,
            None => {
                self.asked_at = Some(now);
                self.tell(PING);
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
#[path = "peer_tests.rs"]
mod tests;
