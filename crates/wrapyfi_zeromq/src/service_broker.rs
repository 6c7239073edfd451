//! The meeting point of clients and servers, in place of Wrapyfi's own.
//!
//! ```text
//!   clients ──connect──▶ ROUTER rep_port │ ServiceProxy │ DEALER req_port ◀──connect── servers
//! ```
//!
//! No name of a service travels: one pair of ports is one service, and several servers on it are
//! asked in turn.

use std::net::IpAddr;
use std::sync::Arc;

use super::config::ZeroMqConfig;
use super::error::BrokerError;
use super::ledger::Ledger;
use super::options::SEND_HWM;
use super::service_proxy::ServiceProxy;
use super::sides::{Sides, failed_to};
use super::status::ServiceBrokerStatus;
use super::supervisor::Supervised;
use super::turns::Runs;
use super::zmtp::Kind;
use wrapyfi_endpoint::Mutex;

/// A running broker of requests and replies. Dropping it ends it and frees its ports.
#[derive(Debug)]
pub struct ServiceBroker {
    ip: IpAddr,
    rep_port: u16,
    req_port: u16,
    status: Arc<Mutex<ServiceBrokerStatus>>,
    _runs: Runs,
}

impl ServiceBroker {
    /// Binds both ports and starts passing requests and replies.
    ///
    /// # Errors
    /// When a port cannot be bound or must not be; both are free again then.
    pub fn start(config: &ZeroMqConfig) -> Result<Self, BrokerError> {
        Self::start_with(config, &Arc::default())
    }

    /// Address it is bound to.
    #[must_use]
    pub fn ip(&self) -> IpAddr {
        self.ip
    }

    /// Port to which clients connect.
    #[must_use]
    pub fn rep_port(&self) -> u16 {
        self.rep_port
    }

    /// Port to which servers connect.
    #[must_use]
    pub fn req_port(&self) -> u16 {
        self.req_port
    }

    /// Counters of the broker.
    #[must_use]
    pub fn status(&self) -> ServiceBrokerStatus {
        self.status.lock().clone()
    }
}

impl Supervised for ServiceBroker {
    const KINDS: [Kind; 2] = [Kind::Router, Kind::Dealer];
    // Asked as a socket that neither side takes: one that the DEALER took would be given a request.
    const ASKED_AS: [&'static str; 2] = ["SUB", "SUB"];
    const WATCHER: zmq::SocketType = zmq::DEALER;
    const SETTINGS: [&'static str; 2] = ["rep_port", "req_port"];

    fn ports(config: &ZeroMqConfig) -> [u16; 2] {
        [config.rep_port, config.req_port]
    }

    fn start_with(config: &ZeroMqConfig, ledger: &Arc<Ledger>) -> Result<Self, BrokerError> {
        let depth = u16::try_from(config.pending.max(1)).unwrap_or(u16::MAX);
        // What a client does not read waits behind that, in the thread of the broker.
        let sides = Sides::bind::<Self>(config, [SEND_HWM, depth], None)?;
        let Sides { ip, ports: [rep_port, req_port], front, back, stop_signal, stop, .. } = sides;
        let status = Arc::<Mutex<ServiceBrokerStatus>>::default();
        let (shown, ledger) = (Arc::clone(&status), Arc::clone(ledger));
        let proxy = ServiceProxy::new(front, back, stop, config.pending, shown, ledger);
        let runs = Runs::start("zeromq-services", stop_signal, proxy)
            .map_err(failed_to("start its thread"))?;
        tracing::info!(%ip, rep_port, req_port, "ZeroMQ broker of requests and replies runs");
        Ok(Self { ip, rep_port, req_port, status, _runs: runs })
    }
}
