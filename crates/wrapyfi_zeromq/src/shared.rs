//! State of an instance that its endpoints share.

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

use super::contexts::Contexts;
use super::curve::Keys;
use super::io::Io;
use super::ledger::Ledger;
use super::own_messages::OwnMessages;

/// State that endpoints need while they are opened.
pub(super) struct Shared {
    pub(super) ip: IpAddr,
    pub(super) pub_endpoint: String,
    /// Address of the broker for publishers.
    pub(super) sub_address: SocketAddr,
    pub(super) send_hwm: u16,
    pub(super) max_frame_bytes: usize,
    pub(super) own_messages: OwnMessages,
    pub(super) ledger: Arc<Ledger>,
    pub(super) io: Io,
    pub(super) contexts: Contexts,
    pub(super) keys: Option<Arc<Keys>>,
}
