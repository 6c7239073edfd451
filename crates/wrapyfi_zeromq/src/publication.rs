//! The part of a publisher at its connection to the broker: an XPUB of one topic.
//!
//! ```text
//!   caller:      publish ──▶ outbox ── write ──▶ TCP ──▶ XSUB of the broker
//!                              │ full: refused        connection lost: what waits is counted
//!   I/O thread:  connects, hears subscriptions, writes when there is room, and bursts of small messages
//! ```
//!
//! A broker in this process is given the message on the caller's thread: no copy of it goes through TCP, and no thread is
//! woken that only passes it on.

use std::sync::Arc;

use bytes::Bytes;

use super::connection::{Connection, SocketRole};
use super::inside::Inside;
use super::ledger::Ledger;
use super::message::Message;
use super::own_messages::{Fingerprint, OwnTopic};
use super::peer::Peer;
use super::shared::ZeroMqState;
use super::socket::Socket;
use wrapyfi_endpoint::{Context, DropReason};

/// Bytes up to which a message of a burst is left to the I/O thread, and lies with others: 64 of them together are little among what may wait.
const SMALL_BYTES: usize = 1024;

/// A publisher of one topic.
pub(super) struct Publication {
    topic: Bytes,
    /// Number of messages that may wait; none: any number.
    hwm: Option<usize>,
    own: Arc<OwnTopic>,
    context: Context,
    ledger: Arc<Ledger>,
    /// The broker, where it is in this process: messages go to it itself, and the connection only tells who is
    /// subscribed.
    inside: Option<Inside>,
}

/// Listeners and broker that there are for a message of a publisher.
pub(super) struct Audience {
    /// Distinct subscriptions that match the topic.
    pub(super) subscriptions: usize,
    /// True where the broker is in this process.
    is_inside: bool,
}

impl Audience {
    /// Number as which a socket keeps an audience: twice the subscriptions, and one where the broker is in this process.
    fn number(&self) -> usize {
        2 * self.subscriptions + usize::from(self.is_inside)
    }

    /// Audience that a socket keeps as `number`.
    fn of(number: usize) -> Self {
        Self { subscriptions: number / 2, is_inside: number % 2 == 1 }
    }
}

/// A publisher's socket, with what it needs outside of the socket's lock.
pub(super) struct PublicationSocket {
    socket: Arc<Socket<Publication>>,
    own: Arc<OwnTopic>,
    /// True where the connection has CURVE, which seals each message for itself.
    is_sealed: bool,
}

impl std::ops::Deref for PublicationSocket {
    type Target = Socket<Publication>;

    fn deref(&self) -> &Self::Target {
        &self.socket
    }
}

impl PublicationSocket {
    /// A publisher's socket, which the I/O thread connects.
    pub(super) fn open(shared: &ZeroMqState, topic: &str, context: &Context) -> Self {
        let connection = shared.connection(shared.sub_address, topic);
        let own = shared.own_messages.of(topic);
        let publication = Publication {
            topic: Bytes::copy_from_slice(topic.as_bytes()),
            hwm: Some(usize::from(shared.send_hwm)).filter(|hwm| *hwm > 0),
            own: Arc::clone(&own),
            context: context.clone(),
            ledger: Arc::clone(&shared.ledger),
            inside: None,
        };
        let socket = Socket::open(&shared.io.handle, connection, publication, context);
        Self { socket, own, is_sealed: shared.keys.is_some() }
    }

    /// Distinct subscriptions that match the topic, as far as the broker told; with `named` those that name at least
    /// the beginning of the topic. Peers that look for topics, a bridge with patterns among them, subscribe to
    /// everything.
    pub(super) fn subscriptions(&self, named: bool) -> usize {
        self.with(|_, connection| subscriptions(connection, named))
    }

    /// Listeners and broker that there are for the next message.
    pub(super) fn audience(&self) -> Audience {
        Audience::of(self.seen())
    }

    /// Takes a message of `bytes` bytes for `audience`, which goes out at once where there is room, or with others of a
    /// burst; true where the broker has said that our key may not publish the topic. Never waits for the broker.
    ///
    /// # Errors
    /// Why there is no room for it.
    pub(super) fn publish(
        &self,
        audience: &Audience,
        frames: Vec<Vec<u8>>,
        bytes: usize,
    ) -> Result<bool, DropReason> {
        // The message may be back before it is sent as a whole, and its token is there by then.
        let print = self.own.remember(&frames, &self.context.clock);
        let sent = match audience.is_inside {
            true => self.pass(frames),
            false => self.post(frames, bytes, print),
        };
        // An equal message that comes after one that was not sent is another program's.
        sent.inspect_err(|_| self.own.forget(print))
    }

    /// Queues a message; true where the broker refuses it.
    fn post(
        &self,
        frames: Vec<Vec<u8>>,
        bytes: usize,
        print: Option<Fingerprint>,
    ) -> Result<bool, DropReason> {
        if bytes <= SMALL_BYTES {
            return self.send_small(|role, connection| {
                let peer = role.peer(connection)?;
                peer.queue_small(&frames, bytes, print, role.hwm).map(|()| peer.is_refused)
            });
        }
        let message = Message::new(frames, self.is_sealed, Some((Bytes::new(), bytes)), print);
        self.send(|role, connection| {
            let peer = role.peer(connection)?;
            peer.queue(&message, role.hwm).map(|()| peer.is_refused)
        })
    }

    /// Gives a message to the broker of this process; true where that refuses it.
    fn pass(&self, frames: Vec<Vec<u8>>) -> Result<bool, DropReason> {
        let (broker, is_refused) = self.with(|role, connection| {
            let peer = connection.peer().filter(|peer| takes_messages(peer));
            role.inside.clone().zip(peer.map(|peer| peer.is_refused)).ok_or(DropReason::SendFailed)
        })?;
        // Not under the lock of the socket: the broker has one of its own.
        let is_passed = broker.pass(frames.into_iter().map(Bytes::from).collect());
        is_passed.then_some(is_refused).ok_or(DropReason::SendFailed)
    }
}

impl Publication {
    /// The broker, where messages go to it through its connection.
    fn peer<'c>(&self, connection: &'c mut Connection) -> Result<&'c mut Peer, DropReason> {
        let peer = connection.peer_mut().filter(|peer| takes_messages(peer));
        // A broker that has just come into this process is given the next: it would be there first.
        peer.filter(|_| self.inside.is_none()).ok_or(DropReason::SendFailed)
    }
}

impl SocketRole for Publication {
    fn begin(&mut self, peer: Peer) -> Peer {
        self.inside = self.ledger.broker.lock().clone().filter(Inside::is_there);
        peer.of_topic(self.topic.clone())
    }

    fn ended(&mut self, peer: &Peer, reason: DropReason) {
        for (bytes, print) in peer.outbox.unsent() {
            self.context.counters.undelivered(reason, bytes);
            self.own.forget(print);
        }
    }

    fn hwm(&self) -> Option<usize> {
        self.hwm
    }

    fn seen(&self, connection: &Connection) -> usize {
        let is_inside = self.inside.is_some();
        Audience { subscriptions: subscriptions(connection, false), is_inside }.number()
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
