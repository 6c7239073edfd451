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

use std::sync::Arc;
use std::time::Instant;

use bytes::Bytes;
use mio::Registry;

use super::connection::{self, Connection, Turn};
use super::inside::Inside;
use super::io::{Command, Handle, IoEndpoint, IoProgress};
use super::ledger::Ledger;
use super::link::BrokerLink;
use super::message::{Message, Outgoing};
use super::options;
use super::own_messages::{Fingerprint, OwnTopic};
use super::peer::Peer;
use super::shared::ZeroMqState;
use wrapyfi_endpoint::{Context, DropReason, Mutex, Throttle};

/// The connection of one publisher, used by its owner and by the I/O thread in turn.
pub(super) struct PublisherConnection {
    pub(super) id: u64,
    topic: Bytes,
    /// Number of messages that may wait; none: any number.
    hwm: Option<usize>,
    pub(super) link: Arc<BrokerLink>,
    own: Arc<OwnTopic>,
    context: Context,
    io: Arc<Handle>,
    /// True where the connection has CURVE, which seals each message for itself.
    is_sealed: bool,
    ledger: Arc<Ledger>,
    state: Mutex<ConnectionState>,
}

struct ConnectionState {
    connection: Connection,
    /// The broker, where it is in this process: messages go to it itself, and the connection only tells who is
    /// subscribed.
    inside: Option<Inside>,
}

impl PublisherConnection {
    /// A connection to `broker` that the I/O thread makes.
    pub(super) fn new(
        shared: &ZeroMqState,
        topic: &str,
        own: Arc<OwnTopic>,
        context: &Context,
    ) -> Arc<Self> {
        let io = Arc::clone(&shared.io.handle);
        let id = io.next_id();
        let connection = Connection::new(shared, id, shared.sub_address, topic);
        Arc::new(Self {
            id,
            topic: Bytes::copy_from_slice(topic.as_bytes()),
            hwm: Some(usize::from(shared.send_hwm)).filter(|hwm| *hwm > 0),
            link: Arc::clone(&connection.link),
            is_sealed: shared.keys.is_some(),
            ledger: Arc::clone(&shared.ledger),
            own,
            context: context.clone(),
            io,
            state: Mutex::new(ConnectionState { connection, inside: None }),
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
        self.state.lock().connection.peer().is_some_and(|peer| peer.is_refused)
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
                self.queue(&Message::new(frames, self.is_sealed, of, print))
            }
        });
        if sent.is_err() {
            self.forget(print);
        }
        sent
    }

    /// The broker, where messages go to it itself.
    fn open(&self) -> Result<Option<Inside>, DropReason> {
        let state = self.state.lock();
        match state.connection.peer() {
            Some(peer) if takes_messages(peer) => Ok(state.inside.clone()),
            _ => Err(DropReason::SendFailed),
        }
    }

    fn queue(&self, message: &Arc<Message>) -> Result<(), DropReason> {
        let mut state = self.state.lock();
        let peer = state.connection.peer_mut().filter(|peer| takes_messages(peer));
        let peer = peer.ok_or(DropReason::SendFailed)?;
        peer.queue(message, self.hwm)?;
        if let Err(error) = peer.write() {
            let lost = state.connection.lose(Instant::now(), &error);
            drop(state);
            self.count_lost(&lost);
            self.context.wake.ring();
            self.io.send(Command::Look(self.id));
        }
        Ok(())
    }

    /// Counts what waited for a connection that has ended.
    fn count_lost(&self, turn: &Turn) {
        let reason =
            if turn.progress.over { DropReason::Closed } else { DropReason::ConnectionLost };
        let waiting = turn.ended.iter().flat_map(|peer| peer.outbox.iter());
        for message in waiting.filter_map(Outgoing::message) {
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
        let turn = state.connection.turn(
            now,
            registry,
            faults,
            |peer| peer.of_topic(self.topic.clone()),
            |peer| connection::read(peer, &mut Vec::new(), now),
        );
        if turn.is_new {
            state.inside = self.ledger.broker.lock().clone().filter(Inside::is_there);
        }
        let after = (state.subscriptions(false), self.link.state());
        drop(state);
        self.count_lost(&turn);
        if before != after {
            self.context.wake.ring();
        }
        Ok(turn.progress)
    }

    /// Has the connection closed once what waits is sent, or some time has passed.
    fn close(&mut self, now: Instant) {
        self.state.lock().connection.close(now + options::LINGER);
    }
}

impl ConnectionState {
    fn subscriptions(&self, named: bool) -> usize {
        let topics = self.connection.peer().into_iter().flat_map(|peer| &peer.topics);
        topics.filter(|topic| !named || !topic.is_empty()).count()
    }
}

/// False for a connection that has just been made anew: a message before its handshake would end it.
fn takes_messages(peer: &Peer) -> bool {
    peer.is_open() && !peer.topics.is_empty()
}
