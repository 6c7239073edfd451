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

use super::broker::{bind, failed_to, keys, loopback};
use super::config::ServiceBrokerConfig;
use super::error::BrokerError;
use super::front::Bounds;
use super::ledger::Ledger;
use super::options::{SEND_HWM, StopSignal};
use super::service_proxy::ServiceProxy;
use super::status::ServiceBrokerStatus;
use super::supervisor::{Side, Supervised};
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
    pub fn start(config: &ServiceBrokerConfig) -> Result<Self, BrokerError> {
        Self::start_with(config, Arc::default())
    }

    /// As [`Self::start`], of an instance whose endpoints are told whom the broker refuses.
    fn start_with(config: &ServiceBrokerConfig, ledger: Arc<Ledger>) -> Result<Self, BrokerError> {
        let keys = keys(config.curve.as_ref(), None)?;
        let ip = loopback(&config.ip, config.insecure, keys.as_ref())?;
        let (rep_port, req_port) = (config.rep_port, config.req_port);
        if rep_port == req_port && rep_port != 0 {
            let names = ("rep_port", "req_port");
            return Err(BrokerError::SamePort { port: rep_port, names });
        }
        let context = zmq::Context::new();
        let bounds = Bounds {
            // What a client does not read waits behind that, in the thread of the broker.
            hwm: SEND_HWM,
            message_bytes: config.max_frame_bytes,
            connections: config.max_connections,
        };
        let (front, rep_port) = bind(Kind::Router, (ip, rep_port), bounds)?;
        let depth = u16::try_from(config.pending.max(1)).unwrap_or(u16::MAX);
        let bounds = Bounds { hwm: depth, ..bounds };
        let (back, req_port) = bind(Kind::Dealer, (ip, req_port), bounds)?;
        let (stop_signal, stop) =
            StopSignal::new(&context).map_err(failed_to("open its control socket"))?;
        let status = Arc::<Mutex<ServiceBrokerStatus>>::default();
        let (front, back) = (front.secured(keys.clone()), back.secured(keys));
        let shown = Arc::clone(&status);
        let proxy = ServiceProxy::new(front, back, stop, config.pending, shown, ledger);
        let runs = Runs::start("zeromq-services", stop_signal, proxy)
            .map_err(failed_to("start its thread"))?;
        tracing::info!(%ip, rep_port, req_port, "ZeroMQ broker of requests and replies runs");
        Ok(Self { ip, rep_port, req_port, status, _runs: runs })
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
    type Config = (ServiceBrokerConfig, Arc<Ledger>);

    // Asked as a socket that neither side takes: one that the DEALER took would be given a request.
    const FRONT: Side = Side { ours: "SUB", expected: "ROUTER" };
    const BACK: Side = Side { ours: "SUB", expected: "DEALER" };
    const WATCHER: zmq::SocketType = zmq::DEALER;
    const SETTINGS: &'static str = "rep_port, req_port";

    fn start(config: &Self::Config) -> Result<Self, BrokerError> {
        Self::start_with(&config.0, Arc::clone(&config.1))
    }

    fn ports((config, _): &Self::Config) -> (u16, u16) {
        (config.rep_port, config.req_port)
    }

    fn has_curve((config, _): &Self::Config) -> bool {
        config.curve.is_some()
    }
}
