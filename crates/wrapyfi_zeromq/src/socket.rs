//! A socket of ours: a connection to the broker with the part that it is for, used by its owner's threads and by the I/O
//! thread in turn.
//!
//! ```text
//!   owner ──── send ────┐                     ┌─▶ publication, reception or service
//!   I/O thread ─ look ─┼─▶ one at a time ────┤
//!   a wait ──── read ──┘                     └─▶ Connection ── TCP ──▶ broker
//!
//!   owner ── send_small ─▶ in a burst: outbox ─▶ I/O thread ── flush, without the lock ─▶ TCP
//! ```
//!
//! A call of the system for each small message would be most of what it costs. So the messages of a burst are left to
//! the I/O thread, which sends with one call what has come while the call before it ran. A message on its own is
//! written by its owner: to wake a thread would take longer. What a program has published in a burst
//! at the moment of its `kill -9`, 64 messages at most, may be lost with it.

use std::io::Write as _;
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, MutexGuard};
use std::time::{Duration, Instant};

use mio::Registry;

use super::connection::{Connection, SocketRole};
use super::io::{Command, Handle, IoEndpoint, IoProgress};
use super::link::BrokerLink;
use super::options;
use wrapyfi_endpoint::{Context, Mutex, Pollable, Throttle};

/// A socket of one role.
pub(super) struct Socket<R> {
    id: u64,
    pub(super) link: Arc<BrokerLink>,
    pub(super) context: Context,
    io: Arc<Handle>,
    state: Mutex<SocketState<R>>,
    /// Held while the I/O thread sends some of a burst.
    flush: Mutex<()>,
    /// [`SocketRole::seen`] when the connection was last looked at.
    seen: AtomicUsize,
}

struct SocketState<R> {
    connection: Connection,
    role: R,
    burst: Burst,
}

/// Mean time between two messages below which they are a burst.
const BURST_GAP: Duration = Duration::from_micros(20);
/// Longest gap as it counts in the mean, and the mean when there was a pause.
const LONG_GAP: Duration = Duration::from_micros(200);
/// Number of gaps of which the mean is taken, about, for a shorter gap than that and for a longer one: a program that waits
/// for answers between a dozen messages or more is in a burst all the time.
const GAPS: [u32; 2] = [8, 16];
/// Gap that ends a burst: the next message is written by its owner, without waiting for a thread to wake.
const PAUSE: Duration = Duration::from_micros(500);
/// Time after the last message from which on the connection's second descriptor is closed: neither a burst needs it, nor a thread
/// that watches the connection by itself.
const BURST_OVER: Duration = Duration::from_secs(1);

/// Mean time between the messages that an owner sends.
struct Burst {
    last: Option<Instant>,
    gap: Duration,
    /// True while the I/O thread has been asked to send what waits.
    is_asked: bool,
}

impl Default for Burst {
    fn default() -> Self {
        Self { last: None, gap: LONG_GAP, is_asked: false }
    }
}

impl Burst {
    /// True for a message that comes `now`, as one of a burst.
    fn has(&mut self, now: Instant) -> bool {
        let last = self.last.replace(now);
        let gap = last.map_or(PAUSE, |last| now.saturating_duration_since(last));
        let [shorter, longer] = GAPS;
        let count = if gap < self.gap { shorter } else { longer };
        self.gap = match gap < PAUSE {
            true => (self.gap * (count - 1) + gap.min(LONG_GAP)) / count,
            false => LONG_GAP,
        };
        self.gap < BURST_GAP
    }

    /// True where the last message is some time ago, or there was none.
    fn is_over(&self, now: Instant) -> bool {
        let is_long_ago =
            |last: Instant| now.saturating_duration_since(last) >= BURST_OVER && !self.is_asked;
        self.last.is_none_or(is_long_ago)
    }
}

impl<R: SocketRole> Socket<R> {
    /// Hands a connection to the I/O thread, which makes it.
    pub(super) fn open(
        io: &Arc<Handle>,
        connection: Connection,
        role: R,
        context: &Context,
    ) -> Arc<Self> {
        let socket = Arc::new(Self {
            id: connection.id,
            link: Arc::clone(&connection.link),
            context: context.clone(),
            io: Arc::clone(io),
            state: Mutex::new(SocketState { connection, role, burst: Burst::default() }),
            flush: Mutex::new(()),
            seen: AtomicUsize::new(0),
        });
        io.send(Command::Open(socket.id, Box::new(Arc::clone(&socket))));
        socket
    }

    /// Has threads that wait for the socket's bell read it by themselves: no thread is woken then that only passes
    /// messages on.
    pub(super) fn read_by_waiters(self: &Arc<Self>) {
        self.context.wake.attach(self);
    }

    /// [`SocketRole::seen`] as it was when the connection was last looked at: no lock is needed to ask.
    pub(super) fn seen(&self) -> usize {
        self.seen.load(Relaxed)
    }

    /// Result of `what` on the role, with the connection as it is now.
    pub(super) fn with<T>(&self, what: impl FnOnce(&mut R, &Connection) -> T) -> T {
        let SocketState { connection, role, .. } = &mut *self.state.lock();
        what(role, connection)
    }

    /// Has the role take what `put` gives it, and writes as much as there is room for. Never waits for the broker, at most
    /// for a few calls of the I/O thread, which sends some of a burst.
    pub(super) fn send<T>(&self, put: impl FnOnce(&mut R, &mut Connection) -> T) -> T {
        let mut state = self.settled();
        let SocketState { connection, role, .. } = &mut *state;
        let put = put(role, connection);
        self.write(state);
        put
    }

    /// The same for a small message: one of a burst is left to the I/O thread. An owner that is faster than that thread
    /// waits until it has sent some.
    pub(super) fn send_small<T>(&self, put: impl FnOnce(&mut R, &mut Connection) -> T) -> T {
        let mut state = self.state.lock();
        if state.connection.is_crowded(state.role.hwm()) {
            drop(state);
            self.write(self.settled());
            state = self.state.lock();
        }
        let SocketState { connection, role, burst } = &mut *state;
        let put = put(role, connection);
        let is_in_burst = burst.has(Instant::now());
        // While the I/O thread is at it, it sends this one too.
        if !is_in_burst && !burst.is_asked {
            self.write(state);
            return put;
        }
        let is_to_ask = !burst.is_asked && !connection.is_blocked();
        burst.is_asked |= is_to_ask;
        drop(state);
        if is_to_ask {
            self.io.send(Command::Flush(self.id));
        }
        put
    }

    /// The state while the I/O thread does not write without the lock.
    fn settled(&self) -> MutexGuard<'_, SocketState<R>> {
        let mut state = self.state.lock();
        while state.connection.is_flushing() {
            drop(state);
            drop(self.flush.lock());
            state = self.state.lock();
        }
        state
    }

    /// Writes as much of what waits as there is room for.
    fn write(&self, mut state: MutexGuard<'_, SocketState<R>>) {
        let SocketState { connection, role, .. } = &mut *state;
        let link = connection.link.state();
        let is_for_io = !connection.write(role, &self.io.registry, Instant::now());
        let has_changed = link != connection.link.state() || connection.is_wanted_back();
        drop(state);
        self.tell(has_changed, is_for_io);
    }

    /// Has the socket closed once what waits is sent, or some time has passed.
    pub(super) fn close(&self) {
        self.io.send(Command::Close(self.id));
    }

    fn tell(&self, has_changed: bool, is_for_io: bool) {
        if has_changed {
            self.context.wake.ring();
        }
        if is_for_io {
            self.io.send(Command::Look(self.id));
        }
    }
}

impl<R: SocketRole> IoEndpoint for Arc<Socket<R>> {
    fn look(&mut self, now: Instant, registry: &Registry, faults: &mut Throttle) -> IoProgress {
        let mut state = self.state.lock();
        let SocketState { connection, role, burst } = &mut *state;
        if burst.is_over(now) {
            connection.end_burst();
        }
        let before = (role.seen(connection), connection.link.state());
        let progress = connection.turn(role, now, registry, faults);
        let after = (role.seen(connection), connection.link.state());
        self.seen.store(after.0, Relaxed);
        let has_changed = before != after;
        drop(state);
        self.tell(has_changed, false);
        progress
    }

    fn flush(&mut self) -> bool {
        let flush = self.flush.lock();
        let mut state = self.state.lock();
        let Some((stream, batch, written)) = state.connection.begin_flush() else {
            state.burst.is_asked = false;
            drop(flush);
            // At the limit of open files there is no second descriptor, and another thing may go first: then it is written as any other.
            self.write(state);
            return false;
        };
        drop(state);
        let bytes = batch.get(written..).unwrap_or_default();
        let (count, size) = ((&*stream).write(bytes).unwrap_or(0), bytes.len());
        // Its memory is used again.
        drop(batch);
        let mut state = self.state.lock();
        let has_more = state.connection.end_flush(count);
        state.burst.is_asked = has_more;
        drop(flush);
        match count < size {
            // The connection has no room or has ended: the next call tells.
            true => self.write(state),
            false => drop(state),
        }
        has_more
    }

    fn close(&mut self, now: Instant) {
        self.state.lock().connection.close(now + options::LINGER);
    }

    fn end(self: Box<Self>) {
        self.state.lock().role.end();
    }
}

impl<R: SocketRole> Pollable for Socket<R> {
    fn is_sent_on(&self) -> bool {
        R::IS_SENT_ON
    }

    fn lend(&self) -> Option<Arc<dyn AsFd + Send + Sync>> {
        let SocketState { connection, role, .. } = &mut *self.state.lock();
        if role.next_look().is_some() {
            return None;
        }
        Some(connection.lend(&self.io.registry)?)
    }

    fn read(&self) -> bool {
        let mut state = self.state.lock();
        let SocketState { connection, role, .. } = &mut *state;
        if !connection.is_lent() {
            return false;
        }
        let link = connection.link.state();
        let progress = connection.use_open(role, Instant::now(), &self.io.registry);
        // While a message waits for room in the inbox, while bytes wait for room to be sent, and at its end the connection is
        // not read however readable it is: the I/O thread knows when to go on.
        let is_kept = connection.is_lent()
            && role.next_look().is_none()
            && !connection.is_wanted_back()
            && !connection.is_closed();
        let is_for_io = progress.more || !is_kept;
        let has_changed = link != connection.link.state();
        drop(state);
        self.tell(has_changed, is_for_io);
        is_kept
    }

    fn give_back(&self) {
        let SocketState { connection, role, .. } = &mut *self.state.lock();
        if !connection.give_back(role, &self.io.registry) {
            self.tell(true, true);
        }
    }
}

/// Has the I/O thread look at a socket.
pub(super) struct LookWaker(pub(super) u64, pub(super) Arc<Handle>);

impl std::task::Wake for LookWaker {
    fn wake(self: Arc<Self>) {
        self.1.send(Command::Look(self.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_messages_close_together_are_a_burst_and_a_pause_ends_it() {
        let (mut burst, mut now) = (Burst::default(), Instant::now());
        let mut come = |burst: &mut Burst, gap_us: u64| {
            now += Duration::from_micros(gap_us);
            burst.has(now)
        };
        assert!((0..1000).all(|_| !come(&mut burst, 100)), "10 000 a second are sent one by one");
        let one_by_one = (0..100).filter(|_| !come(&mut burst, 3)).count();
        assert!((8..30).contains(&one_by_one), "{one_by_one}");
        let gap_us = |count| if count % 16 == 0 { 400 } else { 3 };
        assert!((0..100).all(|count| come(&mut burst, gap_us(count))), "it waits for answers");
        assert!(!come(&mut burst, 1_000_000), "the first after a pause");
        let mut some = |burst: &mut Burst| [990, 2, 2, 2, 2].map(|gap_us| come(burst, gap_us));
        assert!((0..100).map(|_| some(&mut burst)).all(|all| all == [false; 5]), "some at 1 kHz");
    }
}
