//! The connection of a publisher or a listener to its port of the broker, made again when it ends.
//!
//! ```text
//!   Down ── the pause is over ──▶ Begun ── the broker takes it ──▶ Up: Peer
//!     ▲                             │ not in time                    │ lost, silent, reads nothing
//!     └──────── a pause ────────────┴────────────────────────────────┘
//! ```
//!
//! As at the broker's ports, ZMTP is spoken here and not by libzmq: that bounds what waits in messages and not in bytes,
//! throws it away without a word when the connection ends, and wakes a thread of its own for each message.

use std::net::{SocketAddr, TcpStream};
use std::os::fd::AsRawFd as _;
use std::sync::Arc;
use std::time::{Duration, Instant};

use mio::unix::SourceFd;
use mio::{Interest, Registry};

use super::curve::{self, Curve, Keys};
use super::heard::{ConnectionEnd, Heard};
use super::io::{IoProgress, token};
use super::link::{self, BrokerLink};
use super::peer::Peer;
use super::shared::ZeroMqState;
use super::{contexts, options};
use wrapyfi_endpoint::Throttle;
use wrapyfi_endpoint::backoff::Backoff;

/// Shortest time between two looks at a connection to which nothing happens.
const LOOK_EVERY: Duration = Duration::from_millis(500);

/// Bytes read at once.
const READ_BYTES: usize = 16 * 1024;

/// A connection to the broker, and the pauses between its tries.
pub(super) struct Connection {
    id: u64,
    broker: SocketAddr,
    /// Topic that it is for.
    topic: String,
    pub(super) link: Arc<BrokerLink>,
    /// Keys of this process, where connections are to have CURVE.
    keys: Option<Arc<Keys>>,
    way: Way,
    backoff: Backoff,
    /// Instant until which what waits is still sent, because the endpoint is closed.
    closes: Option<Instant>,
}

/// State of the connection.
enum Way {
    /// There is none before this instant.
    Down(Instant),
    /// The broker has not yet taken the connection that was begun at this instant.
    Begun(TcpStream, Instant),
    Up(Box<Peer>),
    Ended,
}

/// Result of one turn of a connection.
#[derive(Default)]
pub(super) struct Turn {
    pub(super) progress: IoProgress,
    /// True where the broker has just taken the connection.
    pub(super) is_new: bool,
    /// The end of the connection that was lost or closed in this turn, with what waited for it.
    pub(super) ended: Option<Box<Peer>>,
}

impl Connection {
    /// A connection of `topic` to `broker`, which the I/O thread makes.
    pub(super) fn new(shared: &ZeroMqState, id: u64, broker: SocketAddr, topic: &str) -> Self {
        Self {
            id,
            broker,
            topic: topic.to_owned(),
            link: shared.link(&options::endpoint(broker.ip(), broker.port()), topic),
            keys: shared.keys.clone(),
            way: Way::Down(Instant::now()),
            backoff: Backoff::of_process(id),
            closes: None,
        }
    }

    /// The broker, while it is connected.
    pub(super) fn peer(&self) -> Option<&Peer> {
        if let Way::Up(peer) = &self.way { Some(peer) } else { None }
    }

    /// The broker, while it is connected.
    pub(super) fn peer_mut(&mut self) -> Option<&mut Peer> {
        if let Way::Up(peer) = &mut self.way { Some(peer) } else { None }
    }

    /// Has the connection closed once what waits is sent, or at `until`.
    pub(super) fn close(&mut self, until: Instant) {
        self.link.note(link::ENDED);
        self.closes.get_or_insert(until);
    }

    /// True once the endpoint is closed.
    pub(super) fn is_closed(&self) -> bool {
        self.closes.is_some()
    }

    /// Makes the connection where its time has come, reads it by `read`, and writes what waits. `begin` makes of a new
    /// connection the peer that it is.
    pub(super) fn turn(
        &mut self,
        now: Instant,
        registry: &Registry,
        faults: &mut Throttle,
        begin: impl FnOnce(Peer) -> Peer,
        read: impl FnOnce(&mut Peer) -> Result<bool, ConnectionEnd>,
    ) -> Turn {
        let mut is_new = false;
        match &self.way {
            Way::Down(_) | Way::Begun(..) if self.is_closed() => self.way = Way::Ended,
            Way::Down(at) if *at > now => return Turn::of(IoProgress::after(*at - now)),
            Way::Down(_) => match connect(self.broker, self.id, registry) {
                Ok(stream) => self.way = Way::Begun(stream, now),
                Err(error) => {
                    let turn = self.lose(now, &error);
                    self.tell_starved(&error, now, faults);
                    return turn;
                }
            },
            _ => {}
        }
        if let Way::Begun(stream, since) = &self.way {
            let left = options::HANDSHAKE.saturating_sub(now.saturating_duration_since(*since));
            match is_connected(stream) {
                Ok(true) => {}
                Ok(false) if !left.is_zero() => return Turn::of(IoProgress::after(left)),
                Ok(false) => return self.lose(now, &"it does not take the connection"),
                Err(error) => return self.lose(now, &error),
            }
            if let Way::Begun(stream, _) = std::mem::replace(&mut self.way, Way::Ended) {
                let peer = begin(Peer::new(stream, self.broker, now));
                match self.secure(peer) {
                    Ok(peer) => self.way = Way::Up(Box::new(peer)),
                    Err(breach) => return self.lose(now, &breach),
                }
                is_new = true;
            }
        }
        Turn { is_new, ..self.use_open(now, read) }
    }

    /// Reads a connection that the broker has taken, by `read`, and writes what waits.
    pub(super) fn use_open(
        &mut self,
        now: Instant,
        read: impl FnOnce(&mut Peer) -> Result<bool, ConnectionEnd>,
    ) -> Turn {
        let closes = self.closes;
        let Way::Up(peer) = &mut self.way else { return Turn::of(IoProgress::over()) };
        // At the end too: what is left unread would make the system throw away what it has not sent.
        let read = read(peer);
        if read.is_ok() && peer.is_open() && closes.is_none() {
            _ = self.link.note(link::UP);
            self.backoff.reset();
        }
        peer.is_blocked = false;
        if !peer.is_alive(now) {
            return self.lose(now, &"it does not answer");
        }
        let written = peer.write();
        if peer.outbox.stands_still(now) {
            return self.lose(now, &"it reads nothing");
        }
        let more = match (read, written) {
            (Ok(more), Ok(())) => more,
            (Err(why), _) => return self.lose_for(now, &why),
            (_, Err(error)) => return self.lose(now, &error),
        };
        let waits = peer.is_open() && !peer.outbox.is_empty();
        if let Some(closes) = closes {
            if waits && closes > now {
                return Turn::of(IoProgress::after(closes - now));
            }
            let Way::Up(peer) = std::mem::replace(&mut self.way, Way::Ended) else {
                return Turn::of(IoProgress::over());
            };
            return Turn { ended: Some(peer), ..Turn::of(IoProgress::over()) };
        }
        let quiet = options::SILENCE.saturating_sub(now.saturating_duration_since(peer.heard_at));
        Turn::of(IoProgress { more, timeout: Some(quiet.max(LOOK_EVERY)), over: false })
    }

    /// Ends the connection because of what the broker said.
    pub(super) fn lose_for(&mut self, now: Instant, why: &ConnectionEnd) -> Turn {
        if matches!(why, ConnectionEnd::Mechanism { .. }) {
            self.link.note(link::SECURED);
        }
        self.lose(now, why)
    }

    /// Ends the connection; another try follows after a pause.
    pub(super) fn lose(&mut self, now: Instant, why: &dyn std::fmt::Display) -> Turn {
        tracing::debug!(broker = %self.broker, topic = self.topic, %why, "a connection ended");
        let pause = self.backoff.wait();
        let ended = match std::mem::replace(&mut self.way, Way::Down(now + pause)) {
            Way::Up(peer) => {
                self.link.disconnected();
                Some(peer)
            }
            _ => {
                self.link.note(link::UNANSWERED);
                None
            }
        };
        Turn { ended, ..Turn::of(IoProgress::after(pause)) }
    }

    /// Says that the process may open no more files, where that is the `error`.
    fn tell_starved(&self, error: &std::io::Error, now: Instant, faults: &mut Throttle) {
        if error.raw_os_error() == Some(zmq::Error::EMFILE.to_raw()) {
            self.link.note(link::STARVED);
            if let Some(unlogged_before) = faults.pass(now) {
                let (topic, why) = (&self.topic, contexts::reason(zmq::Error::EMFILE));
                tracing::warn!(topic, unlogged_before, "a ZeroMQ topic cannot connect: {why}");
            }
        }
    }

    /// A connection that begins, with CURVE where there are keys.
    fn secure(&self, peer: Peer) -> Result<Peer, curve::Breach> {
        let Some(keys) = &self.keys else { return Ok(peer) };
        let (curve, hello) = Curve::client(keys)?;
        Ok(peer.secured(curve, Some(hello)))
    }
}

impl Turn {
    fn of(progress: IoProgress) -> Self {
        Self { progress, ..Self::default() }
    }
}

/// Reads what has come, until nothing is left; true when that was too much for one turn.
///
/// # Errors
/// Why the connection ends.
pub(super) fn read(
    peer: &mut Peer,
    heard: &mut Vec<Heard>,
    now: Instant,
) -> Result<bool, ConnectionEnd> {
    peer.read(&mut [0; READ_BYTES], heard, true, now)
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
