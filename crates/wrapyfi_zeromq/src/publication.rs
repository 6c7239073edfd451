//! The part of a publisher at its connection to the broker: an XPUB of one topic.
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

use bytes::Bytes;

use super::connection::{Connection, SocketRole};
use super::inside::Inside;
use super::ledger::Ledger;
use super::message::{Message, Outgoing};
use super::own_messages::{Fingerprint, OwnTopic};
use super::peer::Peer;
use super::shared::ZeroMqState;
use super::socket::Socket;
use wrapyfi_endpoint::{Context, DropReason};

/// A publisher of one topic.
pub(super) struct Publication {
    topic: Bytes,
    /// Number of messages that may wait; none: any number.
    hwm: Option<usize>,
    own: Arc<OwnTopic>,
    context: Context,
    /// True where the connection has CURVE, which seals each message for itself.
    is_sealed: bool,
    ledger: Arc<Ledger>,
    /// The broker, where it is in this process: messages go to it itself, and the connection only tells who is
    /// subscribed.
    inside: Option<Inside>,
}

impl Publication {
    /// A publisher's socket, which the I/O thread connects.
    pub(super) fn open(shared: &ZeroMqState, topic: &str, context: &Context) -> Arc<Socket<Self>> {
        let connection = shared.connection(shared.sub_address, topic);
        let publication = Self {
            topic: Bytes::copy_from_slice(topic.as_bytes()),
            hwm: Some(usize::from(shared.send_hwm)).filter(|hwm| *hwm > 0),
            own: shared.own_messages.of(topic),
            context: context.clone(),
            is_sealed: shared.keys.is_some(),
            ledger: Arc::clone(&shared.ledger),
            inside: None,
        };
        Socket::open(&shared.io.handle, connection, publication, context)
    }

    fn queue(
        &mut self,
        connection: &mut Connection,
        message: &Arc<Message>,
    ) -> Result<(), DropReason> {
        let peer = connection.peer_mut().filter(|peer| takes_messages(peer));
        peer.ok_or(DropReason::SendFailed)?.queue(message, self.hwm)
    }

    /// An equal message that comes after one that was not sent is another program's.
    fn forget(&self, print: Option<Fingerprint>) {
        if let Some(print) = print {
            self.own.forget(print);
        }
    }
}

impl Socket<Publication> {
    /// Distinct subscriptions that match the topic, as far as the broker told; with `named` those that name at least
    /// the beginning of the topic. Peers that look for topics, a bridge with patterns among them, subscribe to
    /// everything.
    pub(super) fn subscriptions(&self, named: bool) -> usize {
        self.with(|_, connection| subscriptions(connection, named))
    }

    /// True where the broker has said that our key may not publish the topic.
    pub(super) fn is_refused(&self) -> bool {
        self.with(|_, connection| connection.peer().is_some_and(|peer| peer.is_refused))
    }

    /// Takes a message of `bytes` bytes, and writes as much as there is room for. Never waits.
    ///
    /// # Errors
    /// Why there is no room for it.
    pub(super) fn publish(&self, frames: Vec<Vec<u8>>, bytes: usize) -> Result<(), DropReason> {
        let (print, inside) = self.with(|role, connection| {
            let takes = connection.peer().is_some_and(takes_messages);
            let inside = takes.then(|| role.inside.clone()).ok_or(DropReason::SendFailed)?;
            // Before it is sent: it may be back before we are.
            Ok::<_, DropReason>((role.own.remember(&frames, &role.context.clock), inside))
        })?;
        let frames: Vec<Bytes> = frames.into_iter().map(Bytes::from).collect();
        let sent = match inside {
            // Not under the lock of the socket: the broker has one of its own.
            Some(broker) => broker.pass(frames).then_some(()).ok_or(DropReason::SendFailed),
            None => self.send(|role, connection| {
                let of = Some((role.topic.clone(), bytes));
                let message = Message::new(frames, role.is_sealed, of, print);
                role.queue(connection, &message)
            }),
        };
        if sent.is_err() {
            self.with(|role, _| role.forget(print));
        }
        sent
    }
}

impl SocketRole for Publication {
    fn begin(&mut self, peer: Peer) -> Peer {
        self.inside = self.ledger.broker.lock().clone().filter(Inside::is_there);
        peer.of_topic(self.topic.clone())
    }

    fn ended(&mut self, peer: &Peer, reason: DropReason) {
        for message in peer.outbox.iter().filter_map(Outgoing::message) {
            if let Some((_, bytes)) = message.of {
                self.context.counters.undelivered(reason, bytes);
            }
            self.forget(message.print);
        }
    }

    fn seen(&self, connection: &Connection) -> usize {
        subscriptions(connection, false)
    }
}

fn subscriptions(connection: &Connection, named: bool) -> usize {
    let topics = connection.peer().into_iter().flat_map(|peer| &peer.topics);
    topics.filter(|topic| !named || !topic.is_empty()).count()
}

/// False for a connection that has just been made anew: a message before its handshake would end it.
fn takes_messages(peer: &Peer) -> bool {
    peer.is_open() && !peer.topics.is_empty()
}
