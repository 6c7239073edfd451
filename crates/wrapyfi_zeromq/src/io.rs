//! One thread that watches every socket of a ZeroMQ instance.
//!
//! ```text
//!   open, close ── commands ──┐          ┌─▶ Reception: inbox
//!   connections of listeners, ┼─▶ epoll ─┼─▶ Publication: who listens, what waits
//!   publishers, clients,      │          ├─▶ Exchange: requests, replies
//!   servers ──────────────────┘          └─▶ BrokerLink, wake
//! ```
//!
//! The thread knows each of these as an [`IoEndpoint`]. Publishing itself happens on the caller's thread, as far as the
//! connection takes it and but for bursts, and a thread that waits for a message reads by itself: see `Socket`.
//!
//! A socket's descriptor says once that something happened. So an endpoint that is looked at is read until it has
//! no more, or stays among those to be looked at without waiting. Only what moved is looked at: a thousand endpoints
//! at rest cost nothing.

use std::collections::{BTreeMap, BTreeSet};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use mio::{Events, Poll, Registry, Token, Waker};

use super::options;
use wrapyfi_endpoint::Throttle;
use wrapyfi_endpoint::backoff::{self, Backoff};

/// Demand of an endpoint on the I/O thread.
pub(super) enum Command {
    Open(u64, Box<dyn IoEndpoint>),
    /// There is room in an inbox again, or something to send.
    Look(u64),
    /// A burst of messages to send.
    Flush(u64),
    Close(u64),
}

/// The token of the commands; endpoints are counted from 0.
const COMMANDS: Token = Token(usize::MAX);
/// Events taken at once.
const EVENTS: usize = 256;

/// Writes of one burst in a row, after which the other endpoints have their turn.
const BATCHES: usize = 4;

/// Access of the endpoints to the I/O thread, which they may outlive.
pub(super) struct Handle {
    commands: mpsc::Sender<Command>,
    waker: Waker,
    /// Connections that are watched, for threads that watch one by themselves for a while.
    pub(super) registry: Registry,
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
            registry: poll.registry().try_clone()?,
            stop: AtomicBool::new(false),
            next_id: AtomicU64::new(0),
        });
        let worker = Worker {
            handle: Arc::clone(&handle),
            commands: inbox,
            poll,
            ends: BTreeMap::new(),
            ready: BTreeSet::new(),
            bursts: BTreeSet::new(),
            timed: Timed::default(),
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

/// A socket as the I/O thread has it.
pub(super) trait IoEndpoint: Send {
    /// Handles what happened to the socket, without waiting.
    fn look(&mut self, now: Instant, registry: &Registry, faults: &mut Throttle) -> IoProgress;

    /// Sends some of a burst of messages; true when more may wait.
    fn flush(&mut self) -> bool;

    /// Has the socket end: a look that follows tells when it is over.
    fn close(&mut self, now: Instant);

    /// Takes note that it is over.
    fn end(self: Box<Self>);
}

/// Result of one look at an endpoint.
#[derive(Default)]
pub(super) struct IoProgress {
    /// There is more to read.
    pub(super) more: bool,
    /// Time until it must be looked at although nothing happens.
    pub(super) timeout: Option<Duration>,
    /// True when the endpoint is gone.
    pub(super) over: bool,
}

/// Times at which endpoints must be looked at although nothing happens to them.
#[derive(Default)]
struct Timed {
    of: BTreeMap<u64, Instant>,
    /// The same, the next first: one of a thousand is found without a look at all.
    order: BTreeSet<(Instant, u64)>,
}

impl Timed {
    fn set(&mut self, id: u64, at: Option<Instant>) {
        let before = match at {
            Some(at) => self.of.insert(id, at),
            None => self.of.remove(&id),
        };
        if let Some(before) = before {
            self.order.remove(&(before, id));
        }
        self.order.extend(at.map(|at| (at, id)));
    }

    fn next(&self) -> Option<Instant> {
        self.order.first().map(|(at, _)| *at)
    }

    /// Endpoints whose time has come.
    fn due(&self, now: Instant) -> impl Iterator<Item = u64> {
        self.order.range(..=(now, u64::MAX)).map(|(_, id)| *id)
    }
}

struct Worker {
    handle: Arc<Handle>,
    commands: mpsc::Receiver<Command>,
    poll: Poll,
    ends: BTreeMap<u64, Box<dyn IoEndpoint>>,
    /// Endpoints to be looked at without waiting.
    ready: BTreeSet<u64>,
    /// Endpoints that have a burst of messages to send.
    bursts: BTreeSet<u64>,
    timed: Timed,
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
                    until = Some(Instant::now() + 2 * options::LINGER);
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
            let next = self.timed.next().into_iter().chain(until).min();
            let left = next.map(|at| at.saturating_duration_since(Instant::now()));
            let is_idle = self.ready.is_empty() && self.bursts.is_empty();
            let wait = if is_idle { left } else { Some(Duration::ZERO) };
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
            self.flush();
        }
    }

    fn obey(&mut self) {
        while let Ok(command) = self.commands.try_recv() {
            match command {
                Command::Open(id, end) => self.add(id, end),
                Command::Look(id) => _ = self.ready.insert(id),
                Command::Flush(id) => _ = self.bursts.insert(id),
                Command::Close(id) => self.close(id),
            }
        }
    }

    fn close(&mut self, id: u64) {
        if let Some(end) = self.ends.get_mut(&id) {
            end.close(Instant::now());
            self.ready.insert(id);
        }
    }

    fn add(&mut self, id: u64, end: Box<dyn IoEndpoint>) {
        self.ends.insert(id, end);
        self.ready.insert(id);
    }

    /// Looks at every endpoint to which something happened, or whose time has come. A fault of one here is no
    /// concern of the others.
    fn look(&mut self) {
        let now = Instant::now();
        let mut due = std::mem::take(&mut self.ready);
        due.extend(self.timed.due(now));
        for id in due {
            let Some(end) = self.ends.get_mut(&id) else {
                self.timed.set(id, None);
                continue;
            };
            let (registry, faults) = (self.poll.registry(), &mut self.faults);
            let look = catch_unwind(AssertUnwindSafe(|| end.look(now, registry, faults)));
            let look = look.unwrap_or_else(|_| self.fault(now));
            if look.over
                && let Some(end) = self.ends.remove(&id)
            {
                // A time that has passed would be looked at again and again.
                self.timed.set(id, None);
                end.end();
                continue;
            }
            if look.more {
                self.ready.insert(id);
            }
            self.timed.set(id, look.timeout.map(|time| now + time));
        }
    }

    /// Sends for each burst what has come by now.
    fn flush(&mut self) {
        let mut bursts = std::mem::take(&mut self.bursts);
        bursts.retain(|id| {
            let Some(end) = self.ends.get_mut(id) else { return false };
            let flush = || (0..BATCHES).all(|_| end.flush());
            catch_unwind(AssertUnwindSafe(flush)).unwrap_or_else(|_| {
                self.fault(Instant::now());
                true
            })
        });
        self.bursts = bursts;
    }

    /// Says that an endpoint panicked, which is looked at again after a pause.
    fn fault(&mut self, now: Instant) -> IoProgress {
        if let Some(unlogged_before) = self.faults.pass(now) {
            tracing::error!(
                unlogged_before,
                "a panic in the ZeroMQ I/O thread, at one endpoint: it goes on"
            );
        }
        IoProgress::after(self.pause.wait())
    }
}

impl IoProgress {
    pub(super) fn after(time: Duration) -> Self {
        Self { timeout: Some(time), ..Self::default() }
    }

    pub(super) fn over() -> Self {
        Self { over: true, ..Self::default() }
    }
}

/// An endpoint as the system reports it.
pub(super) fn token(id: u64) -> Token {
    Token(usize::try_from(id).unwrap_or(usize::MAX - 1))
}
