//! A connection to a port of the broker, made again when it ends.
//!
//! ```text
//!   Down ── the pause is over ──▶ Begun ── the broker takes it ──▶ Up: Peer
//!     ▲                             │ not in time                    │ lost, silent, reads nothing
//!     └──────── a pause ────────────┴────────────────────────────────┘
//! ```
//!
//! As at the broker's ports, ZMTP is spoken here and not by libzmq, which bounds what waits in messages and not in bytes,
//! throws it away without a word when the connection ends, and wakes a thread of its own for each message.

use std::net::{Shutdown, SocketAddr, TcpStream};
use std::os::fd::AsRawFd as _;
use std::sync::Arc;
use std::time::{Duration, Instant};

use mio::unix::SourceFd;
use mio::{Interest, Registry};
use rustix::io::Errno;

use super::curve::{self, Curve, Keys};
use super::ends::{End, Side};
use super::heard::{ConnectionEnd, Heard};
use super::io::{IoProgress, token};
use super::link::{self, BrokerLink};
use super::options;
use super::peer::Peer;
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::{DropReason, Throttle};

/// Shortest time between two looks at a connection to which nothing happens.
const LOOK_EVERY: Duration = Duration::from_millis(500);

/// Messages of a burst that wait for the I/O thread, beyond which the owner of the next one writes them itself.
const BURST_MESSAGES: usize = 64;

/// Bytes read at once.
const READ_BYTES: usize = 16 * 1024;

/// Part that a socket plays on its connection.
pub(super) trait SocketRole: Sized + Send + 'static {
    /// False where nothing is sent but what the protocol has a reader send.
    const IS_SENT_ON: bool = true;

    /// Makes of a new connection the peer that it is.
    fn begin(&mut self, peer: Peer) -> Peer;

    /// Reads what has come; true when that was too much for one turn.
    ///
    /// # Errors
    /// Why the connection ends.
    fn read(&mut self, peer: &mut Peer, now: Instant) -> Result<bool, ConnectionEnd> {
        read(self, peer, now)
    }

    /// Takes something that the broker said.
    fn hear(&mut self, _said: Heard) {}

    /// Queues the next that waits, at an open connection; false where there is none.
    fn write(&mut self, _peer: &mut Peer) -> bool {
        false
    }

    /// True while something waits that [`Self::write`] had no room for.
    fn waits(&self) -> bool {
        false
    }

    /// Takes note of the end of a connection, and of what it had not sent.
    fn ended(&mut self, _peer: &Peer, _reason: DropReason) {}

    /// Instant at which the role must be looked at although nothing happens.
    fn next_look(&self) -> Option<Instant> {
        None
    }

    /// Number of messages that may wait; none: any number.
    fn hwm(&self) -> Option<usize> {
        None
    }

    /// Number whose change is news for the owner, who may read it back.
    fn seen(&self, _connection: &Connection) -> usize {
        0
    }

    /// Takes note of the end of the socket.
    fn end(&mut self) {}
}

/// A connection to the broker, and the pauses between its tries.
pub(super) struct Connection {
    pub(super) id: u64,
    broker: SocketAddr,
    /// Topic or service that it is for; empty where it is for all.
    name: String,
    pub(super) link: Arc<BrokerLink>,
    /// Keys of this process, where connections are to have CURVE.
    keys: Option<Arc<Keys>>,
    way: Way,
    backoff: Backoff,
    /// Instant until which what waits is still sent, because the socket is closed.
    closes: Option<Instant>,
    /// A second descriptor of the connection, for threads that use it without the socket's lock.
    stream: Option<Arc<TcpStream>>,
    /// True while such a thread watches the connection, and the I/O thread does not.
    is_lent: bool,
    /// True while the I/O thread writes without the socket's lock, and nobody else may write.
    is_flushing: bool,
    /// True where the I/O thread is told of what can be read only, and not of room to write.
    is_narrow: bool,
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

impl Connection {
    /// A connection for `name` to `broker`.
    pub(super) fn new(
        id: u64,
        broker: SocketAddr,
        name: &str,
        link: Arc<BrokerLink>,
        keys: Option<&Arc<Keys>>,
    ) -> Self {
        Self {
            id,
            broker,
            name: name.to_owned(),
            link,
            keys: keys.cloned(),
            way: Way::Down(Instant::now()),
            backoff: Backoff::of_process(id),
            closes: None,
            stream: None,
            is_lent: false,
            is_flushing: false,
            is_narrow: false,
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

    /// Makes the connection where its time has come, reads it and writes what waits.
    pub(super) fn turn(
        &mut self,
        role: &mut impl SocketRole,
        now: Instant,
        registry: &Registry,
        faults: &mut Throttle,
    ) -> IoProgress {
        match &self.way {
            Way::Down(_) | Way::Begun(..) if self.is_closed() => self.way = Way::Ended,
            Way::Down(at) if *at > now => return IoProgress::after(*at - now),
            Way::Down(_) => match connect(self.broker, self.id, registry) {
                Ok(stream) => self.way = Way::Begun(stream, now),
                Err(error) => {
                    let progress = self.lose(role, now, &error);
                    self.tell_starved(&error, now, faults);
                    return progress;
                }
            },
            _ => {}
        }
        if let Way::Begun(stream, since) = &self.way {
            let left = options::HANDSHAKE.saturating_sub(now.saturating_duration_since(*since));
            match is_connected(stream) {
                Ok(true) => {}
                Ok(false) if !left.is_zero() => return IoProgress::after(left),
                Ok(false) => return self.lose(role, now, &"it does not take the connection"),
                Err(error) => return self.lose(role, now, &error),
            }
            if let Way::Begun(stream, _) = std::mem::replace(&mut self.way, Way::Ended) {
                let end = stream.local_addr().ok().map(|socket| End::of(socket, Side::Ours));
                let peer = Peer::new(stream, self.broker, now).connecting().at(end);
                let peer = role.begin(peer);
                match self.secure(peer) {
                    Ok(peer) => self.way = Way::Up(Box::new(peer)),
                    Err(breach) => return self.lose(role, now, &breach),
                }
            }
        }
        self.use_open(role, now, registry)
    }

    /// Reads a connection that the broker has taken, and writes what waits.
    pub(super) fn use_open(
        &mut self,
        role: &mut impl SocketRole,
        now: Instant,
        registry: &Registry,
    ) -> IoProgress {
        let closes = self.closes;
        let Way::Up(peer) = &mut self.way else { return IoProgress::over() };
        // At the end too: what is left unread would make the system throw away what it has not sent.
        let read = role.read(peer, now);
        if read.is_ok() && peer.is_open() && closes.is_none() && self.link.state() != link::DENIED {
            _ = self.link.note(link::UP);
            self.backoff.reset();
        }
        peer.is_blocked = false;
        if !peer.is_alive(now) {
            return self.lose(role, now, &"it does not answer");
        }
        let more = match read {
            Ok(more) => more,
            Err(why) => {
                // Words that say why we leave.
                _ = peer.write();
                if matches!(why, ConnectionEnd::Mechanism { .. }) {
                    self.link.note(link::SECURED);
                }
                return self.lose(role, now, &why);
            }
        };
        if !self.write(role, registry, now) {
            return self.pause(now);
        }
        let Way::Up(peer) = &mut self.way else { return IoProgress::over() };
        if peer.outbox.stands_still(now) {
            return self.lose(role, now, &"it reads nothing");
        }
        let waits = peer.is_open() && (!peer.outbox.is_empty() || role.waits());
        if let Some(closes) = closes {
            if waits && closes > now {
                return IoProgress::after(closes - now);
            }
            if let Way::Up(peer) = self.leave(Way::Ended) {
                role.ended(&peer, DropReason::Closed);
            }
            return IoProgress::over();
        }
        let quiet = options::SILENCE.saturating_sub(now.saturating_duration_since(peer.heard_at));
        // Its own words apart, nothing happens to a connection to a broker in this process.
        let is_at_rest = quiet.is_zero() && peer.outbox.is_empty() && peer.is_inside();
        let look = (!is_at_rest).then(|| quiet.max(LOOK_EVERY));
        let held = role.next_look().map(|at| at.saturating_duration_since(now));
        let timeout = held.into_iter().chain(look).min();
        IoProgress { more, timeout, over: false }
    }

    /// Writes as much of what waits as there is room for, and nothing while the I/O thread writes; false where the
    /// connection has ended by it.
    pub(super) fn write(
        &mut self,
        role: &mut impl SocketRole,
        registry: &Registry,
        now: Instant,
    ) -> bool {
        let Way::Up(peer) = &mut self.way else { return true };
        if self.is_flushing {
            return true;
        }
        let written = loop {
            let written = peer.write();
            let has_room = peer.is_open() && peer.outbox.is_empty();
            if written.is_err() || !has_room || !role.write(peer) {
                break written;
            }
        };
        let is_blocked = !peer.outbox.is_empty();
        // Whoever watches the connection is to be told of room.
        let widened = match is_blocked && self.is_narrow && !self.is_lent {
            true => self.watch(registry, Interest::READABLE | Interest::WRITABLE, true),
            false => Ok(()),
        };
        match written.and(widened) {
            Ok(()) => true,
            Err(error) => {
                self.lose(role, now, &error);
                false
            }
        }
    }

    /// Ends the connection; another try follows after a pause.
    fn lose(
        &mut self,
        role: &mut impl SocketRole,
        now: Instant,
        why: &dyn std::fmt::Display,
    ) -> IoProgress {
        tracing::debug!(broker = %self.broker, name = self.name, %why, "a connection ended");
        let pause = self.backoff.wait();
        match self.leave(Way::Down(now + pause)) {
            Way::Up(peer) => {
                self.link.disconnected();
                role.ended(&peer, DropReason::ConnectionLost);
            }
            _ => _ = self.link.note(link::UNANSWERED),
        }
        IoProgress::after(pause)
    }

    /// Puts another state in place of the one that has ended, which is returned.
    fn leave(&mut self, way: Way) -> Way {
        // A thread that watches it has a descriptor of its own, which would keep the connection open until something comes.
        if let (true, Some(stream)) = (self.is_lent, &self.stream) {
            _ = stream.shutdown(Shutdown::Both);
        }
        (self.stream, self.is_lent, self.is_narrow) = (None, false, false);
        self.is_flushing = false;
        std::mem::replace(&mut self.way, way)
    }

    /// Time until the next try, of a connection that has ended.
    fn pause(&self, now: Instant) -> IoProgress {
        match self.way {
            Way::Down(at) => IoProgress::after(at.saturating_duration_since(now)),
            _ => IoProgress::over(),
        }
    }

    /// True while a thread that waits watches the connection by itself.
    pub(super) fn is_lent(&self) -> bool {
        self.is_lent
    }

    /// True while such a thread watches it, and bytes wait for room of which only the I/O thread is told.
    pub(super) fn is_wanted_back(&self) -> bool {
        self.is_lent && self.peer().is_some_and(|peer| !peer.outbox.is_empty())
    }

    /// The connection, for a thread that will watch it by itself; `None` where the I/O thread has to see to it, or
    /// another thread watches it.
    pub(super) fn lend(&mut self, registry: &Registry) -> Option<Arc<TcpStream>> {
        let Way::Up(peer) = &mut self.way else { return None };
        // Bytes that are not sent yet wait for an event that tells of room.
        if self.is_lent || !peer.is_open() || !peer.outbox.is_empty() {
            return None;
        }
        let stream = second(&mut self.stream, peer)?;
        registry.deregister(&mut SourceFd(&peer.stream.as_raw_fd())).ok()?;
        self.is_lent = true;
        Some(stream)
    }

    /// True where so many messages wait, for a queue of `hwm`, that whoever has another writes some of them first.
    pub(super) fn is_crowded(&self, hwm: Option<usize>) -> bool {
        let most = hwm.map_or(BURST_MESSAGES, |hwm| BURST_MESSAGES.min(hwm / 2));
        self.peer().is_some_and(|peer| peer.outbox.waiting() > most)
    }

    /// Gives back what a burst needed: memory, and the second descriptor, where no thread uses it.
    pub(super) fn end_burst(&mut self) {
        if !self.is_lent && !self.is_flushing {
            self.stream = None;
        }
        if let Some(peer) = self.peer_mut() {
            peer.outbox.give_spare_back();
        }
    }

    /// True while the I/O thread writes without the socket's lock.
    pub(super) fn is_flushing(&self) -> bool {
        self.is_flushing
    }

    /// True where what waits goes once the system tells that there is room.
    pub(super) fn is_blocked(&self) -> bool {
        self.peer().is_some_and(|peer| peer.is_blocked)
    }

    /// The batch of small messages that goes next, for the I/O thread to write without the socket's lock into the connection that is
    /// returned, and the number of its bytes that are written already; `None` where no batch goes next, or there is no room
    /// or no descriptor for it. [`Self::end_flush`] has to follow.
    pub(super) fn begin_flush(&mut self) -> Option<(Arc<TcpStream>, Arc<Vec<u8>>, usize)> {
        // A panic may have ended the flush before.
        self.is_flushing = false;
        let Way::Up(peer) = &mut self.way else { return None };
        if !peer.is_open() || peer.is_blocked {
            return None;
        }
        let (bytes, written) = peer.outbox.batch()?;
        let stream = second(&mut self.stream, peer)?;
        self.is_flushing = true;
        Some((stream, bytes, written))
    }

    /// Takes note of the first `count` bytes, which were written; true where more waits.
    pub(super) fn end_flush(&mut self, count: usize) -> bool {
        let (true, Way::Up(peer)) = (std::mem::take(&mut self.is_flushing), &mut self.way) else {
            return false;
        };
        peer.outbox.note_written(count);
        !peer.outbox.is_empty()
    }

    /// Has the I/O thread watch the connection again; false where the connection has ended by it.
    pub(super) fn give_back(&mut self, role: &mut impl SocketRole, registry: &Registry) -> bool {
        let (true, Way::Up(peer)) = (self.is_lent, &self.way) else { return true };
        self.is_lent = false;
        // Room would be told at once.
        let is_narrow = peer.outbox.is_empty();
        let interest =
            if is_narrow { Interest::READABLE } else { Interest::READABLE | Interest::WRITABLE };
        let watched = self.watch(registry, interest, false);
        if let Err(error) = &watched {
            self.lose(role, Instant::now(), error);
        }
        watched.is_ok()
    }

    fn watch(
        &mut self,
        registry: &Registry,
        interest: Interest,
        again: bool,
    ) -> std::io::Result<()> {
        let Way::Up(peer) = &self.way else { return Ok(()) };
        self.is_narrow = !interest.is_writable();
        let (fd, token) = (peer.stream.as_raw_fd(), token(self.id));
        match again {
            true => registry.reregister(&mut SourceFd(&fd), token, interest),
            false => registry.register(&mut SourceFd(&fd), token, interest),
        }
    }

    /// Says that the process may open no more files, where that is the `error`.
    fn tell_starved(&self, error: &std::io::Error, now: Instant, faults: &mut Throttle) {
        if Errno::from_io_error(error) == Some(Errno::MFILE) {
            self.link.note(link::STARVED);
            if let Some(unlogged_before) = faults.pass(now) {
                tracing::warn!(
                    name = self.name,
                    unlogged_before,
                    "a ZeroMQ socket cannot connect: the process is at its limit of open files: raise that (ulimit -n, \
                     LimitNOFILE)"
                );
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

/// Reads what has come, until nothing is left, and has the role hear it, whatever then ends the connection; true when
/// that was too much for one turn.
///
/// # Errors
/// Why the connection ends.
pub(super) fn read(
    role: &mut impl SocketRole,
    peer: &mut Peer,
    now: Instant,
) -> Result<bool, ConnectionEnd> {
    let mut heard = Vec::new();
    let read = peer.read(&mut [0; READ_BYTES], &mut heard, true, now);
    heard.into_iter().for_each(|said| role.hear(said));
    read
}

/// A second descriptor of a connection, which is made once.
fn second(stream: &mut Option<Arc<TcpStream>>, peer: &Peer) -> Option<Arc<TcpStream>> {
    if stream.is_none() {
        *stream = Some(Arc::new(peer.stream.try_clone().ok()?));
    }
    stream.clone()
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
