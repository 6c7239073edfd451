//! State that every connection of the node needs: its names, the master, the threads, and what is known of types.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, MutexGuard, OnceLock};

use tokio::runtime::Handle;
use tokio::sync::watch;
use wrapyfi_interfaces::ros1::{Rules, Types};

use super::config::NodeUri;
use super::header::{Header, NODE};
use super::master::Master;
use super::names::NodeName;
use super::peer_types::PeerTypes;
use wrapyfi_endpoint::{Cause, Mutex};

/// State that all endpoints of a node and their connections share.
pub(super) struct Core {
    pub(super) name: NodeName,
    pub(super) master: Master,
    /// Our XML-RPC server, as others are told.
    pub(super) api: NodeUri,
    /// Our TCPROS port, as others are told.
    pub(super) tcpros: NodeUri,
    pub(super) handle: Handle,
    /// Sender whose receivers are held by what must end before the node may, such as connections whose last bytes are
    /// still on their way.
    pub(super) lingering: watch::Sender<()>,
    next: AtomicU64,
    types: OnceLock<Mutex<Types>>,
    rules: Rules,
    /// Answers of other nodes about the types of their topics and services.
    pub(super) peer_types: PeerTypes,
    /// A node that sends goals to each action that has clients: its publishers know the type of goals.
    pub(super) action_clients: Mutex<BTreeMap<String, String>>,
}

impl Core {
    pub(super) fn new(
        name: NodeName,
        master: Master,
        api: NodeUri,
        tcpros: NodeUri,
        handle: Handle,
        rules: Rules,
    ) -> Arc<Self> {
        Arc::new(Self {
            name,
            master,
            api,
            tcpros,
            handle,
            lingering: watch::channel(()).0,
            next: AtomicU64::new(0),
            types: OnceLock::new(),
            rules,
            peer_types: PeerTypes::default(),
            action_clients: Mutex::default(),
        })
    }

    /// Definitions of ROS 1: what peers showed, what is installed or built in. Read at first use.
    pub(super) fn types(&self) -> MutexGuard<'_, Types> {
        let types =
            self.types.get_or_init(|| Mutex::new(Types::from_environment(self.rules.clone())));
        types.lock()
    }

    /// Begin of a connection header of this node.
    pub(super) fn header(&self) -> Header {
        Header::new().with("callerid", self.name.full())
    }

    /// Begin of a connection header under a name in the node's private namespace, which no other node has. Our own
    /// publishers read the node's name in it, because their `to_peers` name nodes.
    pub(super) fn header_of_part(&self, part: &str) -> Header {
        let node = self.name.full();
        Header::new().with("callerid", format!("{node}/{part}")).with(NODE, node)
    }

    /// Cause for which nodes of other machines do not reach this one: it is announced at an address that they have, too.
    /// The cause that is `awaited` beside it stands first.
    pub(super) fn announces_loopback(&self, awaited: Option<&Cause>) -> Option<Cause> {
        let host = &self.api.host;
        let is_hidden = !self.master.whereabouts.hint(host).is_empty();
        let awaited = awaited.cloned().map(Box::new);
        is_hidden.then(|| Cause::LoopbackAnnounced { awaited, host: host.clone() })
    }

    /// A number that nothing else in this node has.
    pub(super) fn next_id(&self) -> u64 {
        self.next.fetch_add(1, Relaxed)
    }
}
