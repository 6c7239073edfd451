//! One thread that watches every socket of a ZeroMQ instance.
//!
//! ```text
//!   open, close ── commands ──┐
//!   bell ─────────────────────┤
//!   listeners' SUB ───────────┼─▶ zmq::poll ──▶ Reception: inbox
//!   publishers' subscriptions ┤             ──▶ Outlet: who listens
//!   clients', servers' DEALER ┤             ──▶ Line: requests, replies
//!   connection events ────────┘             ──▶ BrokerLink, wake
//! ```
//!
//! Publishing itself happens on the caller's thread: see `Outlet`.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::line::Line;
use super::link::Watch;
use super::options::{Bell, silence};
use super::publisher::Outlet;
use super::reception::Reception;

/// What endpoints ask of the I/O thread.
pub(super) enum Command {
    Listen(Reception),
    Publish(Arc<Outlet>, Watch),
    Line(Line),
    Close(u64),
}

/// How endpoints reach the I/O thread. They may outlive it.
pub(super) struct Handle {
    commands: mpsc::Sender<Command>,
    bell: Bell,
    stop: AtomicBool,
    next_id: AtomicU64,
}

impl Handle {
    pub(super) fn send(&self, command: Command) {
        // A thread that has ended has closed everything already.
        if self.commands.send(command).is_ok() {
            self.bell.ring();
        }
    }

    pub(super) fn ring(&self) {
        self.bell.ring();
    }

    pub(super) fn next_id(&self) -> u64 {
        self.next_id.fetch_add(1, Relaxed)
    }
}

/// The thread. Dropping this ends it and closes all its sockets.
pub(super) struct Io {
    handle: Arc<Handle>,
    thread: Option<JoinHandle<()>>,
}

impl Io {
    pub(super) fn start(context: &zmq::Context) -> std::io::Result<Self> {
        let (bell, ears) = Bell::new(context)?;
        let (commands, inbox) = mpsc::channel();
        let handle = Arc::new(Handle {
            commands,
            bell,
            stop: AtomicBool::new(false),
            next_id: AtomicU64::new(0),
        });
        let worker = Worker {
            handle: Arc::clone(&handle),
            commands: inbox,
            ears,
            receptions: Vec::new(),
            outlets: Vec::new(),
            lines: Vec::new(),
            closing: Vec::new(),
        };
        let thread =
            std::thread::Builder::new().name("zeromq-io".to_owned()).spawn(|| worker.run())?;
        Ok(Self { handle, thread: Some(thread) })
    }

    pub(super) fn handle(&self) -> &Arc<Handle> {
        &self.handle
    }
}

impl Drop for Io {
    fn drop(&mut self) {
        self.handle.stop.store(true, Relaxed);
        self.handle.bell.ring();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the ZeroMQ I/O thread panicked");
        }
        self.handle.bell.close();
    }
}

struct Worker {
    handle: Arc<Handle>,
    commands: mpsc::Receiver<Command>,
    ears: zmq::Socket,
    receptions: Vec<Reception>,
    outlets: Vec<(Arc<Outlet>, Watch)>,
    lines: Vec<Line>,
    /// Of sockets that are being closed.
    closing: Vec<Watch>,
}

impl Worker {
    fn run(mut self) {
        while !self.handle.stop.load(Relaxed) {
            self.obey();
            match self.turn() {
                Ok(()) | Err(zmq::Error::EINTR | zmq::Error::EAGAIN) => {}
                Err(error) => {
                    tracing::error!(%error, "the ZeroMQ I/O thread stopped");
                    break;
                }
            }
        }
        self.obey();
        // Endpoints may live on; their sockets must not, or the context never ends.
        self.close(|_| true);
        Watch::see_out(self.closing);
    }

    fn obey(&mut self) {
        while let Ok(command) = self.commands.try_recv() {
            match command {
                Command::Listen(reception) => self.receptions.push(reception),
                Command::Publish(outlet, watch) => self.outlets.push((outlet, watch)),
                Command::Line(line) => self.lines.push(line),
                Command::Close(id) => self.close(|other| other == id),
            }
        }
    }

    /// Closes the sockets of the endpoints that are `meant`, and keeps their watches.
    fn close(&mut self, meant: impl Fn(u64) -> bool) {
        let receptions = self.receptions.extract_if(.., |reception| meant(reception.id));
        self.closing.extend(receptions.map(Reception::close));
        let lines = self.lines.extract_if(.., |line| meant(line.id()));
        self.closing.extend(lines.map(Line::close));
        for (outlet, watch) in self.outlets.extract_if(.., |(outlet, _)| meant(outlet.id())) {
            outlet.close();
            self.closing.push(watch);
        }
    }

    /// Waits for something to happen, and handles it.
    fn turn(&mut self) -> zmq::Result<()> {
        let now = Instant::now();
        let receptions = self.receptions.iter_mut().flat_map(|r| [r.retry(now), r.revive(now)]);
        let outlets = self.outlets.iter_mut().map(|(outlet, watch)| outlet.revive(watch, now));
        let lines = self.lines.iter_mut().map(|line| line.revive(now));
        let patience = receptions.chain(outlets).chain(lines).flatten().min();
        let ready = self.poll(patience)?;
        let mut ready = ready.into_iter();
        let mut next = || ready.next().unwrap_or(false);
        if next() {
            silence(&self.ears);
        }
        for reception in &mut self.receptions {
            if next() && reception.watch.take() {
                reception.wake.ring();
            }
            if next() {
                reception.read()?;
            }
        }
        for (outlet, watch) in &mut self.outlets {
            let moved = next() && watch.take();
            let changed = next() && outlet.hear();
            if moved || changed {
                outlet.wake().ring();
            }
        }
        for line in &mut self.lines {
            if next() && line.watch.take() {
                line.ring();
            }
            if next() {
                line.write()?;
                line.read()?;
            }
        }
        self.closing.retain_mut(|watch| {
            watch.take();
            !watch.is_over()
        });
        Ok(())
    }

    /// Which sockets have something to do: bell, then two of each listener, then two of each publisher,
    /// two of each line, then the closing ones.
    fn poll(&self, patience: Option<Duration>) -> zmq::Result<Vec<bool>> {
        let mut items = vec![self.ears.as_poll_item(zmq::POLLIN)];
        for reception in &self.receptions {
            items.extend([reception.watch.poll_item(), reception.poll_item()]);
        }
        for (outlet, watch) in &self.outlets {
            items.extend([watch.poll_item(), outlet.poll_item()]);
        }
        for line in &self.lines {
            items.extend([line.watch.poll_item(), line.poll_item()]);
        }
        items.extend(self.closing.iter().map(Watch::poll_item));
        // Rounded up, so that a deadline is not polled for many times in its last millisecond.
        let wait = patience.map_or(-1, |time| {
            i64::try_from(time.as_millis()).unwrap_or(i64::MAX).saturating_add(1)
        });
        zmq::poll(&mut items, wait)?;
        Ok(items.iter().map(|item| item.is_readable() || item.is_writable()).collect())
    }
}
