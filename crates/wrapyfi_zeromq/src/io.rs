//! One thread that watches every socket of a ZeroMQ instance.
//!
//! ```text
//!   open, close ── commands ──┐
//!   listeners' SUB ───────────┤          ┌─▶ Reception: inbox
//!   publishers' connections ──┼─▶ epoll ─┼─▶ PublisherConnection: who listens, what waits
//!   clients', servers' DEALER ┤          ├─▶ ServiceConnection: requests, replies
//!   connection events ────────┘          └─▶ BrokerLink, wake
//! ```
//!
//! Publishing itself happens on the caller's thread, as far as the connection takes it: see `PublisherConnection`.
//!
//! A socket's descriptor says once that something happened. So an endpoint that is looked at is read until it has
//! no more, or stays among those to be looked at without waiting. Only what moved is looked at: a thousand endpoints
//! at rest cost nothing.

use std::collections::{BTreeMap, BTreeSet};
use std::os::fd::RawFd;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use mio::unix::SourceFd;
use mio::{Events, Interest, Poll, Registry, Token, Waker};

use super::link::{FAREWELL, Watch};
use super::options;
use super::publisher_connection::PublisherConnection;
use super::reception::Reception;
use super::service_connection::ServiceConnection;
use wrapyfi_endpoint::Throttle;
use wrapyfi_endpoint::backoff::{self, Backoff};

/// Demand of an endpoint on the I/O thread.
pub(super) enum Command {
    Listen(Reception),
    Publish(Arc<PublisherConnection>),
    ServiceConnection(ServiceConnection),
    /// There is room in an inbox again, or something to send.
    Look(u64),
    Close(u64),
}

/// The token of the commands; endpoints are counted from 0.
const COMMANDS: Token = Token(usize::MAX);
/// Events taken at once.
const EVENTS: usize = 256;

/// Access of the endpoints to the I/O thread, which they may outlive.
pub(super) struct Handle {
    commands: mpsc::Sender<Command>,
    waker: Waker,
    stop: AtomicBool,
    next_id: AtomicU64,
}

impl Handle {
    pub(super) fn send(&self, command: Command) {
        // A thread that has ended has closed everything already.
        if self.commands.send(command).is_ok() {
            self.ring();
        }
    }

    fn ring(&self) {
        if let Err(error) = self.waker.wake() {
            tracing::error!(%error, "the ZeroMQ I/O thread cannot be woken");
        }
    }

    pub(super) fn next_id(&self) -> u64 {
        self.next_id.fetch_add(1, Relaxed)
    }
}

/// The thread. Dropping this ends it and closes all its sockets.
pub(super) struct Io {
    pub(super) handle: Arc<Handle>,
    thread: Option<JoinHandle<()>>,
}

impl Io {
    pub(super) fn start() -> std::io::Result<Self> {
        let poll = Poll::new()?;
        let (commands, inbox) = mpsc::channel();
        let handle = Arc::new(Handle {
            commands,
            waker: Waker::new(poll.registry(), COMMANDS)?,
            stop: AtomicBool::new(false),
            next_id: AtomicU64::new(0),
        });
        let worker = Worker {
            handle: Arc::clone(&handle),
            commands: inbox,
            poll,
            ends: BTreeMap::new(),
            ready: BTreeSet::new(),
            timed: BTreeMap::new(),
            faults: Throttle::default(),
            pause: Backoff::of_process(4).up_to(backoff::FIRST),
        };
        let thread =
            std::thread::Builder::new().name("zeromq-io".to_owned()).spawn(|| worker.run())?;
        Ok(Self { handle, thread: Some(thread) })
    }
}

impl Drop for Io {
    fn drop(&mut self) {
        self.handle.stop.store(true, Relaxed);
        self.handle.ring();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the ZeroMQ I/O thread panicked");
        }
    }
}

/// Sockets of one endpoint on the I/O thread.
enum End {
    Reception(Reception),
    /// Connection of a publisher, which asks the system for its events by itself.
    PublisherConnection(Arc<PublisherConnection>),
    ServiceConnection(ServiceConnection),
    /// Socket that is being closed.
    Closing(u64, Watch),
}

/// Result of one look at an endpoint.
#[derive(Default)]
pub(super) struct Look {
    /// There is more to read.
    pub(super) more: bool,
    /// Time until it must be looked at although nothing happens.
    pub(super) timeout: Option<Duration>,
    /// True when the endpoint is gone.
    pub(super) over: bool,
}

struct Worker {
    handle: Arc<Handle>,
    commands: mpsc::Receiver<Command>,
    poll: Poll,
    ends: BTreeMap<u64, End>,
    /// Endpoints to be looked at without waiting.
    ready: BTreeSet<u64>,
    /// Times at which endpoints must be looked at although nothing happens to them.
    timed: BTreeMap<u64, Instant>,
    faults: Throttle,
    /// Pauses of an endpoint that did something wrong, all of them short.
    pause: Backoff,
}

impl Worker {
    /// Runs until it is told to stop.
    fn run(mut self) {
        let (mut backoff, mut until) = (Backoff::of_process(0), None);
        loop {
            match catch_unwind(AssertUnwindSafe(|| self.turns(&mut backoff, until))) {
                Err(_) => {
                    tracing::error!("the ZeroMQ I/O thread panicked: it goes on after a pause");
                    std::thread::sleep(backoff.wait());
                    self.ready.extend(self.ends.keys());
                }
                Ok(()) if until.is_some() => break,
                Ok(()) => {
                    // Endpoints may live on; their sockets must not, or the context never ends.
                    self.obey();
                    let ids: Vec<u64> = self.ends.keys().copied().collect();
                    ids.into_iter().for_each(|id| self.close(id));
                    until = Some(Instant::now() + options::LINGER + FAREWELL);
                }
            }
        }
        if !self.ends.is_empty() {
            tracing::warn!(sockets = self.ends.len(), "ZeroMQ sockets did not close in time");
        }
    }

    /// Handles what happens until the thread is told to stop; with `until`, until all is closed or that time has come.
    fn turns(&mut self, backoff: &mut Backoff, until: Option<Instant>) {
        let mut events = Events::with_capacity(EVENTS);
        loop {
            let is_over = match until {
                None => self.handle.stop.load(Relaxed),
                Some(until) => self.ends.is_empty() || until <= Instant::now(),
            };
            if is_over {
                return;
            }
            let next = self.timed.values().copied().chain(until).min();
            let left = next.map(|at| at.saturating_duration_since(Instant::now()));
            let wait = if self.ready.is_empty() { left } else { Some(Duration::ZERO) };
            if let Err(error) = self.poll.poll(&mut events, wait)
                && error.kind() != std::io::ErrorKind::Interrupted
            {
                tracing::error!(%error, "the ZeroMQ I/O thread cannot wait for its sockets");
                std::thread::sleep(backoff.wait());
            }
            for event in &events {
                match event.token() {
                    COMMANDS => self.obey(),
                    Token(id) => _ = self.ready.insert(id as u64),
                }
            }
            self.look();
        }
    }

    fn obey(&mut self) {
        while let Ok(command) = self.commands.try_recv() {
            match command {
                Command::Listen(reception) => self.add(reception.id, End::Reception(reception)),
                Command::Publish(connection) => {
                    self.add(connection.id, End::PublisherConnection(connection));
                }
                Command::ServiceConnection(connection) => {
                    self.add(connection.handle.id, End::ServiceConnection(connection));
                }
                Command::Look(id) => _ = self.ready.insert(id),
                Command::Close(id) => self.close(id),
            }
        }
    }

    fn close(&mut self, id: u64) {
        if let Some(end) = self.ends.remove(&id) {
            self.watch(&end, false);
            self.add(id, end.close(Instant::now()));
        }
    }

    fn add(&mut self, id: u64, end: End) {
        self.ends.insert(id, end);
        if let Some(end) = self.ends.get(&id) {
            self.watch(end, true);
        }
        self.ready.insert(id);
    }

    /// Asks the system to report events of an endpoint's sockets, or to stop that.
    fn watch(&self, end: &End, on: bool) {
        let (id, descriptors) = end.descriptors();
        for fd in descriptors {
            let registry = self.poll.registry();
            let result = match on {
                true => registry.register(&mut SourceFd(&fd), id, Interest::READABLE),
                false => registry.deregister(&mut SourceFd(&fd)),
            };
            if let Err(error) = result {
                tracing::error!(%error, on, "the ZeroMQ I/O thread cannot watch a socket");
            }
        }
    }

    /// Looks at every endpoint to which something happened, or whose time has come. What one of them does wrong
    /// here is no concern of the others.
    fn look(&mut self) {
        let now = Instant::now();
        let mut due = std::mem::take(&mut self.ready);
        due.extend(self.timed.iter().filter(|(_, at)| **at <= now).map(|(id, _)| *id));
        for id in due {
            let Some(end) = self.ends.get_mut(&id) else {
                self.timed.remove(&id);
                continue;
            };
            let (registry, faults) = (self.poll.registry(), &mut self.faults);
            let look = match catch_unwind(AssertUnwindSafe(|| end.look(now, registry, faults))) {
                Ok(Ok(look)) => look,
                Ok(Err(zmq::Error::EINTR | zmq::Error::EAGAIN)) => Look::again(),
                Ok(Err(error)) => self.fault(now, &error),
                Err(_) => self.fault(now, &"a panic"),
            };
            if look.over
                && let Some(end) = self.ends.remove(&id)
            {
                self.watch(&end, false);
                // A time that has passed would be looked at again and again.
                self.timed.remove(&id);
                if let End::ServiceConnection(connection) = end {
                    self.add(id, End::Closing(id, connection.end()));
                }
                continue;
            }
            if look.more {
                self.ready.insert(id);
            }
            match look.timeout {
                Some(time) => _ = self.timed.insert(id, now + time),
                None => _ = self.timed.remove(&id),
            }
        }
    }

    /// Says what went wrong at an endpoint, which is looked at again after a pause.
    fn fault(&mut self, now: Instant, what: &dyn std::fmt::Display) -> Look {
        if let Some(unlogged_before) = self.faults.pass(now) {
            tracing::error!(
                unlogged_before,
                "{what} in the ZeroMQ I/O thread, at one endpoint: it goes on"
            );
        }
        Look::after(self.pause.wait())
    }
}

impl Look {
    fn again() -> Self {
        Self { more: true, ..Self::default() }
    }

    pub(super) fn after(time: Duration) -> Self {
        Self { timeout: Some(time), ..Self::default() }
    }

    pub(super) fn over() -> Self {
        Self { over: true, ..Self::default() }
    }
}

impl End {
    /// The endpoint's descriptors, and what they say when something happened.
    fn descriptors(&self) -> (Token, Vec<RawFd>) {
        let (id, socket, watch) = match self {
            Self::PublisherConnection(connection) => {
                return (Token(index(connection.id)), Vec::new());
            }
            Self::Reception(reception) => {
                (reception.id, reception.socket.get_fd().ok(), &reception.watch)
            }
            Self::ServiceConnection(connection) => {
                (connection.handle.id, connection.socket.get_fd().ok(), &connection.watch)
            }
            Self::Closing(id, watch) => (*id, None, watch),
        };
        let descriptors = socket.into_iter().chain(watch.fd()).collect();
        (Token(index(id)), descriptors)
    }

    fn look(
        &mut self,
        now: Instant,
        registry: &Registry,
        faults: &mut Throttle,
    ) -> zmq::Result<Look> {
        // Connecting again may take the signal of what waits to be read.
        let mut look = Look { more: self.is_lost(now), ..Look::default() };
        look.timeout = match self {
            Self::Reception(reception) => {
                if reception.watch.take() {
                    reception.inbox.context().wake.ring();
                }
                let mut held = reception.retry(now);
                if held.is_none() {
                    look.more |= reception.read()?;
                    let stopped = reception.held.is_some();
                    // Room that was made before the listener could know that it is waited for.
                    held = reception.retry(now);
                    look.more |= stopped && held.is_none();
                }
                held.into_iter().chain(reception.revive(now)).min()
            }
            Self::PublisherConnection(connection) => {
                return Ok(connection.look(now, registry, faults));
            }
            Self::ServiceConnection(connection) => {
                if connection.watch.take() {
                    connection.handle.context.wake.ring();
                }
                connection.write()?;
                connection.read()?;
                // Last: reading or writing may have taken the signal of what the other could not do before.
                look.more |= connection.has_more()?;
                let lingers = connection.lingers(now);
                look.over = lingers == Some(Duration::ZERO);
                connection.revive(now).into_iter().chain(lingers).min()
            }
            Self::Closing(_, watch) => {
                watch.take();
                look.over = watch.over;
                None
            }
        };
        Ok(look)
    }

    /// True when this look will connect the endpoint's socket again.
    fn is_lost(&self, now: Instant) -> bool {
        match self {
            Self::PublisherConnection(_) => false,
            Self::Reception(Reception { watch, .. })
            | Self::ServiceConnection(ServiceConnection { watch, .. })
            | Self::Closing(_, watch) => watch.time_left(now) == Some(Duration::ZERO),
        }
    }

    /// Closes the endpoint; what is left of it must be kept until it is over.
    fn close(self, now: Instant) -> Self {
        match self {
            Self::Reception(reception) => Self::Closing(reception.id, reception.close()),
            Self::ServiceConnection(mut connection) => {
                connection.close(now);
                Self::ServiceConnection(connection)
            }
            Self::PublisherConnection(connection) => {
                connection.close(now);
                Self::PublisherConnection(connection)
            }
            closing @ Self::Closing(..) => closing,
        }
    }
}

/// Number of an endpoint as the system reports it.
pub(super) fn index(id: u64) -> usize {
    usize::try_from(id).unwrap_or(usize::MAX - 1)
}
