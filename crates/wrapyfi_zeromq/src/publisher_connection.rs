//! The connection of a publisher to the broker: an XPUB of one topic.
//!
//! ```text
//!   caller:      publish ──▶ outbox ── write ──▶ TCP ──▶ XSUB of the broker
//!                              │ full: refused        connection lost: what waits is counted
//!   I/O thread:  connects, hears subscriptions, writes when there is room
//! ```
//!
//! A broker in this process is given the message on the caller's thread: no copy of it goes through TCP, and no thread is
//! woken that only passes it on.
//!
//! As at the broker's ports, ZMTP is spoken here and not by libzmq, whose XPUB bounds what waits in
//! messages and not in bytes, and throws it away without a word when the connection ends.

use std::net::{SocketAddr, TcpStream};
use std::os::fd::AsRawFd as _;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use mio::unix::SourceFd;
use mio::{Interest, Registry};

use super::curve::{self, Curve, Keys};
use super::heard;
use super::inside::Inside;
use super::io::{Command, Handle, IoEndpoint, IoProgress, token};
use super::ledger::Ledger;
use super::link::{self, BrokerLink};
use super::message::{Message, Outgoing};
use super::own_messages::{Fingerprint, OwnTopic};
use super::peer::Peer;
use super::shared::ZeroMqState;
use super::{contexts, options};
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::{Context, DropReason, Mutex, Throttle};

/// Bytes read at once.
const READ_BYTES: usize = 4096;
/// Shortest time between two looks at a connection to which nothing happens.
const LOOK_EVERY: Duration = Duration::from_millis(500);

/// The connection of one publisher, used by its owner and by the I/O thread in turn.
pub(super) struct PublisherConnection {
    pub(super) id: u64,
    broker: SocketAddr,
    topic: Bytes,
    /// Number of messages that may wait; none: any number.
    hwm: Option<usize>,
    pub(super) link: Arc<BrokerLink>,
    own: Arc<OwnTopic>,
    context: Context,
    io: Arc<Handle>,
    /// Keys of this process, where connections are to have CURVE.
    keys: Option<Arc<Keys>>,
    ledger: Arc<Ledger>,
    state: Mutex<ConnectionState>,
}

struct ConnectionState {
    way: Way,
    backoff: Backoff,
    /// Instant until which what waits is still sent, because the publisher is closed.
    closes: Option<Instant>,
}

/// State of the connection.
enum Way {
    /// There is none before this instant.
    Down(Instant),
    /// The broker has not yet taken the connection that was begun at this instant.
    Begun(TcpStream, Instant),
    /// Messages go to the broker itself, where it is in this process; then the connection only tells who is subscribed.
    Up(Box<Peer>, Option<Inside>),
    Ended,
}

impl PublisherConnection {
    /// A connection to `broker` that the I/O thread makes.
    pub(super) fn new(
        shared: &ZeroMqState,
        topic: &str,
        own: Arc<OwnTopic>,
        context: &Context,
    ) -> Arc<Self> {
        let (io, broker) = (&shared.io.handle, shared.sub_address);
        let (id, now) = (io.next_id(), Instant::now());
        let backoff = Backoff::of_process(id);
        let state = ConnectionState { way: Way::Down(now), backoff, closes: None };
        Arc::new(Self {
            id,
            broker,
            topic: Bytes::copy_from_slice(topic.as_bytes()),
            hwm: Some(usize::from(shared.send_hwm)).filter(|hwm| *hwm > 0),
            link: shared.link(&options::endpoint(broker.ip(), broker.port()), topic),
            keys: shared.keys.clone(),
            ledger: Arc::clone(&shared.ledger),
            own,
            context: context.clone(),
            io: Arc::clone(io),
            state: Mutex::new(state),
        })
    }

    /// Distinct subscriptions that match the topic, as far as the broker told; with `named` those that name at least
    /// the beginning of the topic. Peers that look for topics, a bridge with patterns among them, subscribe to
    /// everything.
    pub(super) fn subscriptions(&self, named: bool) -> usize {
        self.state.lock().subscriptions(named)
    }

    /// True where the broker has said that our key may not publish the topic.
    pub(super) fn is_refused(&self) -> bool {
        matches!(&self.state.lock().way, Way::Up(peer, _) if peer.is_refused)
    }

    /// Takes a message of `bytes` bytes, and writes as much as there is room for. Never waits.
    ///
    /// # Errors
    /// Why there is no room for it.
    pub(super) fn send(&self, frames: Vec<Vec<u8>>, bytes: usize) -> Result<(), DropReason> {
        // Before it is sent: it may be back before we are.
        let print = self.own.remember(&frames, &self.context.clock);
        let frames: Vec<Bytes> = frames.into_iter().map(Bytes::from).collect();
        let sent = self.open().and_then(|inside| match inside {
            // Not under the lock of the connection: the broker has one of its own.
            Some(broker) => broker.pass(frames).then_some(()).ok_or(DropReason::SendFailed),
            None => {
                let of = Some((self.topic.clone(), bytes));
                self.queue(&Message::new(frames, self.keys.is_some(), of, print))
            }
        });
        if sent.is_err() {
            self.forget(print);
        }
        sent
    }

    /// The broker, where messages go to it itself.
    fn open(&self) -> Result<Option<Inside>, DropReason> {
        match &self.state.lock().way {
            Way::Up(peer, inside) if takes_messages(peer) => Ok(inside.clone()),
            _ => Err(DropReason::SendFailed),
        }
    }

    fn queue(&self, message: &Arc<Message>) -> Result<(), DropReason> {
        let mut state = self.state.lock();
        let Way::Up(peer, _) = &mut state.way else { return Err(DropReason::SendFailed) };
        if !takes_messages(peer) {
            return Err(DropReason::SendFailed);
        }
        peer.queue(message, self.hwm)?;
        if let Err(error) = peer.write() {
            self.lose(&mut state, Instant::now(), &error);
            drop(state);
            self.context.wake.ring();
            self.io.send(Command::Look(self.id));
        }
        Ok(())
    }

    fn step(
        &self,
        state: &mut ConnectionState,
        now: Instant,
        registry: &Registry,
        faults: &mut Throttle,
    ) -> IoProgress {
        let closes = state.closes;
        match &state.way {
            Way::Down(_) | Way::Begun(..) if closes.is_some() => state.way = Way::Ended,
            Way::Down(at) if *at > now => return IoProgress::after(*at - now),
            Way::Down(_) => match connect(self.broker, self.id, registry) {
                Ok(stream) => state.way = Way::Begun(stream, now),
                Err(error) => {
                    let look = self.lose(state, now, &error);
                    if error.raw_os_error() == Some(zmq::Error::EMFILE.to_raw()) {
                        self.link.note(link::STARVED);
                        if let Some(unlogged_before) = faults.pass(now) {
                            let topic = String::from_utf8_lossy(&self.topic);
                            let why = contexts::reason(zmq::Error::EMFILE);
                            tracing::warn!(%topic, unlogged_before, "a ZeroMQ publisher cannot connect: {why}");
                        }
                    }
                    return look;
                }
            },
            _ => {}
        }
        if let Way::Begun(stream, since) = &state.way {
            let left = options::HANDSHAKE.saturating_sub(now.saturating_duration_since(*since));
            match is_connected(stream) {
                Ok(true) => {}
                Ok(false) if !left.is_zero() => return IoProgress::after(left),
                Ok(false) => return self.lose(state, now, &"it does not take the connection"),
                Err(error) => return self.lose(state, now, &error),
            }
            if let Way::Begun(stream, _) = std::mem::replace(&mut state.way, Way::Ended) {
                let peer = Peer::new(stream, self.broker, now).of_topic(self.topic.clone());
                match self.secure(peer) {
                    Ok(peer) => {
                        let inside = self.ledger.broker.lock().clone();
                        let inside = inside.filter(Inside::is_there);
                        state.way = Way::Up(Box::new(peer), inside);
                    }
                    Err(breach) => return self.lose(state, now, &breach),
                }
            }
        }
        let Way::Up(peer, _) = &mut state.way else { return IoProgress::over() };
        let mut heard = Vec::new();
        // At the end too: what is left unread would make the system throw away what it has not sent.
        let read = peer.read(&mut [0; READ_BYTES], &mut heard, true, now);
        if read.is_ok() && peer.is_open() && closes.is_none() {
            _ = self.link.note(link::UP);
            state.backoff.reset();
        }
        peer.is_blocked = false;
        if !peer.is_alive(now) {
            return self.lose(state, now, &"it does not answer");
        }
        let written = peer.write();
        if peer.outbox.stands_still(now) {
            return self.lose(state, now, &"it reads nothing");
        }
        let more = match (read, written) {
            (Ok(more), Ok(())) => more,
            (Err(why), _) => {
                if matches!(why, heard::ConnectionEnd::Mechanism { .. }) {
                    self.link.note(link::SECURED);
                }
                return self.lose(state, now, &why);
            }
            (_, Err(error)) => return self.lose(state, now, &error),
        };
        let waits = peer.is_open() && !peer.outbox.is_empty();
        if let Some(closes) = closes {
            if waits && closes > now {
                return IoProgress::after(closes - now);
            }
            return self.end(state);
        }
        let quiet = options::SILENCE.saturating_sub(now.saturating_duration_since(peer.heard_at));
        IoProgress { more, timeout: Some(quiet.max(LOOK_EVERY)), over: false }
    }

    /// A connection that begins, with CURVE where there are keys.
    fn secure(&self, peer: Peer) -> Result<Peer, curve::Breach> {
        let Some(keys) = &self.keys else { return Ok(peer) };
        let (curve, hello) = Curve::client(keys)?;
        Ok(peer.secured(curve, Some(hello)))
    }

    /// Ends the connection; another try follows after a pause. Messages that waited are lost.
    fn lose(
        &self,
        state: &mut ConnectionState,
        now: Instant,
        why: &dyn std::fmt::Display,
    ) -> IoProgress {
        tracing::debug!(broker = %self.broker, %why, "the connection of a publisher ended");
        let pause = state.backoff.wait();
        match std::mem::replace(&mut state.way, Way::Down(now + pause)) {
            Way::Up(peer, _) => {
                self.link.disconnected();
                self.count_lost(&peer, DropReason::ConnectionLost);
            }
            _ => _ = self.link.note(link::UNANSWERED),
        }
        IoProgress::after(pause)
    }

    /// Ends the connection for good.
    fn end(&self, state: &mut ConnectionState) -> IoProgress {
        if let Way::Up(peer, _) = std::mem::replace(&mut state.way, Way::Ended) {
            self.count_lost(&peer, DropReason::Closed);
        }
        IoProgress::over()
    }

    fn count_lost(&self, peer: &Peer, reason: DropReason) {
        for message in peer.outbox.iter().filter_map(Outgoing::message) {
            if let Some((_, bytes)) = message.of {
                self.context.counters.undelivered(reason, bytes);
            }
            self.forget(message.print);
        }
    }

    /// An equal message that comes after one that was not sent is another program's.
    fn forget(&self, print: Option<Fingerprint>) {
        if let Some(print) = print {
            self.own.forget(print);
        }
    }
}

impl IoEndpoint for Arc<PublisherConnection> {
    /// Connects, hears, and writes what waits.
    fn look(
        &mut self,
        now: Instant,
        registry: &Registry,
        faults: &mut Throttle,
    ) -> zmq::Result<IoProgress> {
        let mut state = self.state.lock();
        let before = (state.subscriptions(false), self.link.state());
        let look = self.step(&mut state, now, registry, faults);
        let after = (state.subscriptions(false), self.link.state());
        drop(state);
        if before != after {
            self.context.wake.ring();
        }
        Ok(look)
    }

    /// Has the connection closed once what waits is sent, or some time has passed.
    fn close(&mut self, now: Instant) {
        self.link.note(link::ENDED);
        self.state.lock().closes.get_or_insert(now + options::LINGER);
    }
}

impl ConnectionState {
    fn subscriptions(&self, named: bool) -> usize {
        match &self.way {
            Way::Up(peer, _) => {
                peer.topics.iter().filter(|topic| !named || !topic.is_empty()).count()
            }
            _ => 0,
        }
    }
}

/// False for a connection that has just been made anew: a message before its handshake would end it.
fn takes_messages(peer: &Peer) -> bool {
    peer.is_open() && !peer.topics.is_empty()
}

/// Begins a connection, whose events the I/O thread is told.
fn connect(broker: SocketAddr, id: u64, registry: &Registry) -> std::io::Result<TcpStream> {
    let stream = TcpStream::from(mio::net::TcpStream::connect(broker)?);
    options::set_stream(&stream)?;
    let interest = Interest::READABLE | Interest::WRITABLE;
    registry.register(&mut SourceFd(&stream.as_raw_fd()), token(id), interest)?;
    Ok(stream)
}

/// True when the other side has taken the connection, false while it has not.
fn is_connected(stream: &TcpStream) -> std::io::Result<bool> {
    if let Some(error) = stream.take_error()? {
        return Err(error);
    }
    match stream.peer_addr() {
        // The system may have chosen the port itself, where no program has it: then it is connected to itself.
        Ok(broker) if broker == stream.local_addr()? => {
            Err(std::io::ErrorKind::ConnectionRefused.into())
        }
        Ok(_) => Ok(true),
        Err(error) if error.kind() == std::io::ErrorKind::NotConnected => Ok(false),
        Err(error) => Err(error),
    }
}
