//! State of an instance that its endpoints share.

use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, Weak};

use super::contexts::Contexts;
use super::curve::Keys;
use super::io::Io;
use super::ledger::Ledger;
use super::link::BrokerLink;
use super::options;
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
    pub(super) contexts: Contexts,
    pub(super) keys: Option<Arc<Keys>>,
    /// Connections of topics to the broker.
    pub(super) links: Mutex<Vec<Weak<BrokerLink>>>,
}

impl ZeroMqState {
    /// Address of the broker for listeners, as libzmq's sockets connect to it.
    pub(super) fn pub_endpoint(&self) -> String {
        options::endpoint(self.pub_address.ip(), self.pub_address.port())
    }

    /// State of a connection to the broker that is made for a topic.
    pub(super) fn link(&self, broker: &str, topic: &str) -> Arc<BrokerLink> {
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
