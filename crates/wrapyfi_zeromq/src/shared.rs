//! State of an instance that its endpoints share.

use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, Weak};

use super::connection::Connection;
use super::curve::Keys;
use super::io::Io;
use super::ledger::Ledger;
use super::link::BrokerLink;
use super::own_messages::OwnMessages;
use wrapyfi_endpoint::{Cause, Mutex};

/// State that endpoints need while they are opened.
pub(super) struct ZeroMqState {
    pub(super) ip: IpAddr,
    /// Address of the broker for listeners.
    pub(super) pub_address: SocketAddr,
    /// Address of the broker for publishers.
    pub(super) sub_address: SocketAddr,
    pub(super) send_hwm: u16,
    pub(super) max_frame_bytes: usize,
    pub(super) own_messages: OwnMessages,
    pub(super) ledger: Arc<Ledger>,
    pub(super) io: Io,
    pub(super) keys: Option<Arc<Keys>>,
    /// Connections of topics to the broker.
    pub(super) links: Mutex<Vec<Weak<BrokerLink>>>,
}

impl ZeroMqState {
    /// A connection of a topic to a port of the broker.
    pub(super) fn connection(&self, broker: SocketAddr, topic: &str) -> Connection {
        let link = self.link(broker, topic);
        Connection::new(self.io.handle.next_id(), broker, topic, link, self.keys.as_ref())
    }

    /// A connection that says nothing of whether the broker is there for topics.
    pub(super) fn unlisted(&self, broker: SocketAddr, name: &str) -> Connection {
        let link = BrokerLink::new(broker, name, self.keys.as_ref());
        Connection::new(self.io.handle.next_id(), broker, name, link, self.keys.as_ref())
    }

    /// State of a connection to the broker that is made for a topic.
    fn link(&self, broker: SocketAddr, topic: &str) -> Arc<BrokerLink> {
        let link = BrokerLink::new(broker, topic, self.keys.as_ref());
        let mut links = self.links.lock();
        links.retain(|link| link.strong_count() > 0);
        links.push(Arc::downgrade(&link));
        link
    }

    /// The broker, where none of the connections for topics has reached it.
    pub(super) fn waiting_for(&self) -> Option<Cause> {
        let links = self.links.lock();
        let mut links = links.iter().filter_map(Weak::upgrade).peekable();
        let first = links.peek()?.waiting_for();
        if links.any(|link| link.is_reached()) { None } else { first }
    }
}
