//! A socket of ours: a connection to the broker with the part that it is for, used by its owner's threads and by the I/O
//! thread in turn.
//!
//! ```text
//!   owner ──── send ────┐                     ┌─▶ publication, reception or service
//!   I/O thread ─ look ─┼─▶ one at a time ────┤
//!   a wait ──── read ──┘                     └─▶ Connection ── TCP ──▶ broker
//! ```

use std::os::fd::AsFd;
use std::sync::Arc;
use std::time::Instant;

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
}

struct SocketState<R> {
    connection: Connection,
    role: R,
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
            state: Mutex::new(SocketState { connection, role }),
        });
        io.send(Command::Open(socket.id, Box::new(Arc::clone(&socket))));
        socket
    }

    /// Has threads that wait for the socket's bell read it by themselves: no thread is woken then that only passes
    /// messages on.
    pub(super) fn read_by_waiters(self: &Arc<Self>) {
        self.context.wake.attach(self);
    }

    /// Result of `what` on the role, with the connection as it is now.
    pub(super) fn with<T>(&self, what: impl FnOnce(&mut R, &Connection) -> T) -> T {
        let SocketState { connection, role } = &mut *self.state.lock();
        what(role, connection)
    }

    /// Has the role take what `put` gives it, and writes as much as there is room for. Never waits.
    pub(super) fn send<T>(&self, put: impl FnOnce(&mut R, &mut Connection) -> T) -> T {
        let mut state = self.state.lock();
        let SocketState { connection, role } = &mut *state;
        let put = put(role, connection);
        let (now, link) = (Instant::now(), connection.link.state());
        let is_for_io = !connection.write(role, &self.io.registry, now);
        let has_changed = link != connection.link.state() || connection.is_wanted_back();
        drop(state);
        self.tell(has_changed, is_for_io);
        put
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
        let SocketState { connection, role } = &mut *state;
        let before = (role.seen(connection), connection.link.state());
        let progress = connection.turn(role, now, registry, faults);
        let has_changed = before != (role.seen(connection), connection.link.state());
        drop(state);
        self.tell(has_changed, false);
        progress
    }

    fn close(&mut self, now: Instant) {
        self.state.lock().connection.close(now + options::LINGER);
    }

    fn end(self: Box<Self>) {
        self.state.lock().role.end();
    }
}

impl<R: SocketRole> Pollable for Socket<R> {
    fn lend(&self) -> Option<Arc<dyn AsFd + Send + Sync>> {
        let SocketState { connection, role } = &mut *self.state.lock();
        if role.next_look().is_some() {
            return None;
        }
        Some(connection.lend(&self.io.registry)?)
    }

    fn read(&self) -> bool {
        let mut state = self.state.lock();
        let SocketState { connection, role } = &mut *state;
        if !connection.is_lent() {
            return false;
        }
        let link = connection.link.state();
        let progress = connection.use_open(role, Instant::now(), &self.io.registry);
        let is_lent = connection.is_lent();
        let is_for_io = progress.more || !is_lent || role.next_look().is_some();
        let has_changed = link != connection.link.state();
        drop(state);
        self.tell(has_changed, is_for_io);
        is_lent
    }

    fn give_back(&self) {
        let SocketState { connection, role } = &mut *self.state.lock();
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
