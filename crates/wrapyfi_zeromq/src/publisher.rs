//! A topic published: encodes, sends on the caller's thread, knows whether anybody listens.
//!
//! ```text
//!   caller:      publish ── frames ──▶ XPUB ──▶ broker
//!   I/O thread:  hear ◀── subscriptions ─┘ (same socket, one lock)
//! ```
//!
//! An XPUB instead of Wrapyfi's PUB, because it tells who is subscribed. To the broker's XSUB the
//! two are alike. It holds `send_hwm` messages for a broker that reads slower than we send; what
//! comes then is refused, not dropped.

use std::collections::BTreeSet;
use std::os::fd::RawFd;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::echo::Echo;
use super::io::{Command, Handle};
use super::link::{self, BrokerLink, Watch};
use super::options;
use super::sockopt;
use super::{Shared, transport};
use wrapyfi_data::types::{Image, Payload, Pixels};
use wrapyfi_endpoint::codec::frames;
use wrapyfi_endpoint::{Context, Link, OpenError, PublishError, Publisher, TopicSpec, Wake};

/// Sends one topic through the broker.
pub(super) struct ZeroMqPublisher {
    outlet: Arc<Outlet>,
    spec: TopicSpec,
    depth: usize,
    echo: Arc<Echo>,
    io: Arc<Handle>,
    /// True once the log says that colours are sent in another order than they come in.
    told_order: bool,
}

impl ZeroMqPublisher {
    pub(super) fn open(
        shared: &Shared,
        spec: &TopicSpec,
        context: &Context,
    ) -> Result<Self, OpenError> {
        let mut spec = spec.clone();
        // Beyond this the broker would cut the connection.
        spec.limits.message_bytes = spec.limits.message_bytes.min(shared.max_frame_bytes);
        let io = Arc::clone(shared.io.handle());
        let link = BrokerLink::new(&shared.sub_endpoint);
        let (socket, watch) = shared
            .contexts
            .open(|context| open_socket(context, shared, &link))
            .map_err(|e| transport(&spec.topic, e))?;
        let outlet = Arc::new(Outlet {
            id: io.next_id(),
            topic: spec.topic.as_bytes().to_vec(),
            fd: socket.get_fd().map_err(|e| transport(&spec.topic, e))?,
            link,
            wake: context.wake.clone(),
            state: Mutex::new(State { socket: Some(socket), prefixes: BTreeSet::new() }),
        });
        io.send(Command::Publish(Arc::clone(&outlet), watch));
        shared.ledger.enter(spec.topic.as_bytes(), &context.counters);
        let echo = shared.echoes.of(&spec.topic);
        let depth = usize::from(shared.send_hwm);
        Ok(Self { outlet, spec, depth, echo, io, told_order: false })
    }

    /// Says where the colours of an image change their order; whether it was said.
    fn tell_order(&self, payload: &Payload) -> bool {
        let Payload::Image(Image { pixels: Pixels::Raw(raw), .. }) = payload else { return false };
        let orders = raw.encoding.color_order().zip(self.spec.color_order.color_order());
        let Some((has, sent)) = orders.filter(|(has, sent)| has != sent) else { return false };
        tracing::info!(
            topic = self.spec.topic,
            "{} images are sent as {sent}, which Wrapyfi's listeners take them for; `encoding: {has}` on the \
             route sends them as they are",
            raw.encoding
        );
        true
    }

    fn failed(&self, reason: &dyn std::fmt::Display) -> PublishError {
        PublishError::Transport { topic: self.spec.topic.clone(), reason: reason.to_string() }
    }
}

fn open_socket(
    context: &zmq::Context,
    shared: &Shared,
    link: &Arc<BrokerLink>,
) -> zmq::Result<(zmq::Socket, Watch)> {
    let mut socket = context.socket(zmq::XPUB)?;
    options::set_common(&socket, shared.ip)?;
    socket.set_sndhwm(i32::from(shared.send_hwm))?;
    sockopt::set_xpub_nodrop(&mut socket, true)?;
    socket.set_maxmsgsize(options::frame_limit(super::config::FRAME_SLACK))?;
    // A lost broker takes its subscriptions and the messages queued for it along: the next one
    // starts with what is new, and until then nobody listens.
    socket.set_immediate(true)?;
    link::connect(context, socket, link)
}

impl Publisher for ZeroMqPublisher {
    /// While nobody is subscribed nothing is encoded: [`PublishError::NoConsumer`].
    fn publish(&mut self, payload: &Payload) -> Result<usize, PublishError> {
        if let Some(what) = self.outlet.link.waiting_for() {
            return Err(self.failed(&format_args!("waiting for {what}")));
        }
        if self.outlet.hear() {
            self.outlet.wake.ring();
        }
        if self.outlet.subscriptions() == 0 {
            return Err(PublishError::NoConsumer { topic: self.spec.topic.clone() });
        }
        if !self.told_order {
            self.told_order = self.tell_order(payload);
        }
        let frames = frames::encode(payload, &self.spec)?;
        let bytes = frames.iter().map(Vec::len).sum();
        // Before it is sent: it may be back before we are.
        let print = self.echo.remember(&frames);
        self.outlet.send(frames).map_err(|error| {
            if let Some(print) = print {
                self.echo.forget(print);
            }
            match error {
                zmq::Error::EAGAIN => {
                    PublishError::QueueFull { topic: self.spec.topic.clone(), depth: self.depth }
                }
                other => self.failed(&other),
            }
        })?;
        Ok(bytes)
    }

    fn link(&self) -> Link {
        Link {
            peers: Some(self.outlet.subscriptions()),
            waiting_for: self.outlet.link.waiting_for(),
            keeps_last: false,
        }
    }
}

impl Drop for ZeroMqPublisher {
    fn drop(&mut self) {
        self.io.send(Command::Close(self.outlet.id));
    }
}

/// The socket of a publisher, used by its owner and by the I/O thread in turn.
pub(super) struct Outlet {
    id: u64,
    topic: Vec<u8>,
    /// Readable when the socket has something to say. Polled without the lock, which libzmq
    /// allows for the descriptor but not for the socket.
    fd: RawFd,
    link: Arc<BrokerLink>,
    wake: Wake,
    state: Mutex<State>,
}

struct State {
    /// `None` once the ZeroMQ instance is gone.
    socket: Option<zmq::Socket>,
    /// Subscriptions that match our topic. The broker passes on those of all topics.
    prefixes: BTreeSet<Vec<u8>>,
}

impl Outlet {
    pub(super) fn id(&self) -> u64 {
        self.id
    }

    pub(super) fn wake(&self) -> &Wake {
        &self.wake
    }

    pub(super) fn fd(&self) -> RawFd {
        self.fd
    }

    /// Distinct subscriptions that match the topic, as far as the broker told.
    fn subscriptions(&self) -> usize {
        self.lock().prefixes.len()
    }

    /// Takes all waiting subscriptions; true when they changed who listens.
    pub(super) fn hear(&self) -> bool {
        self.lock().hear(&self.topic)
    }

    /// Connects again if libzmq has given up on the broker. The time until it may have is
    /// returned.
    pub(super) fn revive(&self, watch: &mut Watch, now: Instant) -> Option<Duration> {
        if let Some(socket) = &self.lock().socket {
            watch.revive(socket, &self.wake, now);
        }
        watch.patience(now)
    }

    /// Sends without waiting. Only the first frame can find the queue full: there is room for
    /// whole messages or none.
    fn send(&self, frames: Vec<Vec<u8>>) -> zmq::Result<()> {
        let mut state = self.lock();
        let Some(socket) = &state.socket else { return Err(zmq::Error::ETERM) };
        let mut rest = frames.into_iter().peekable();
        let mut sent = Ok(());
        while let (Ok(()), Some(frame)) = (&sent, rest.next()) {
            let more = if rest.peek().is_some() { zmq::SNDMORE } else { 0 };
            sent = socket.send(frame, more | zmq::DONTWAIT);
        }
        // Sending may have taken the signal the I/O thread waits for, also where there was no room.
        if state.hear(&self.topic) {
            self.wake.ring();
        }
        sent
    }

    /// Closes the socket, even if the publisher lives on.
    pub(super) fn close(&self) {
        self.link.end();
        let mut state = self.lock();
        state.socket = None;
        state.prefixes.clear();
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn hear(&mut self, topic: &[u8]) -> bool {
        let Some(socket) = &self.socket else { return false };
        let before = self.prefixes.len();
        while let Ok(frame) = socket.recv_msg(zmq::DONTWAIT) {
            match frame.split_first() {
                Some((1, prefix)) if topic.starts_with(prefix) => {
                    self.prefixes.insert(prefix.to_vec());
                }
                Some((0, prefix)) => {
                    self.prefixes.remove(prefix);
                }
                _ => {}
            }
        }
        self.prefixes.len() != before
    }
}
