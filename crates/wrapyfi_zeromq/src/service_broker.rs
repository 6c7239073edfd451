//! The meeting point of clients and servers, in place of Wrapyfi's own.
//!
//! ```text
//!   clients ──connect──▶ ROUTER rep_port │ ServiceProxy │ DEALER req_port ◀──connect── servers
//! ```
//!
//! No name of a service travels: one pair of ports is one service, and several servers on it are
//! asked in turn.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::sync::Arc;

use serde::Serialize;

use super::broker::{BrokerError, bind, failed_to, keys, loopback};
use super::config::ZeroMqConfig;
use super::curve_config::CurveConfig;
use super::front::Bounds;
use super::options::StopSignal;
use super::peer::Kind;
use super::service_connection::SEND_HWM;
use super::service_proxy::ServiceProxy;
use super::supervisor::{Side, Supervised};
use super::turns::Runs;
use wrapyfi_endpoint::network::Insecure;
use wrapyfi_endpoint::{Mutex, ServiceSpec};

/// Settings of a [`ServiceBroker`]; the fields mean what they mean in [`ZeroMqConfig`].
#[derive(Debug, Clone, PartialEq, Eq)]
#[allow(missing_docs)]
pub struct ServiceBrokerConfig {
    pub ip: String,
    /// 0 means any free port, here and in `req_port`.
    pub rep_port: u16,
    pub req_port: u16,
    /// Requests held while no server takes them; those beyond are answered with an error.
    pub pending: usize,
    pub max_frame_bytes: usize,
    pub max_connections: usize,
    pub insecure: Insecure,
    pub curve: Option<CurveConfig>,
}

impl Default for ServiceBrokerConfig {
    fn default() -> Self {
        ZeroMqConfig::default().service_broker_config()
    }
}

impl ServiceBrokerConfig {
    /// Requests held unless said otherwise.
    pub const PENDING: usize = ServiceSpec::PENDING;
}

/// A running broker of requests and replies. Dropping it ends it and frees its ports.
#[derive(Debug)]
pub struct ServiceBroker {
    ip: IpAddr,
    rep_port: u16,
    req_port: u16,
    status: Arc<Mutex<ServiceBrokerStatus>>,
    _runs: Runs,
}

/// A broker of requests and replies at one moment.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct ServiceBrokerStatus {
    /// Requests passed on to servers.
    pub requests: u64,
    /// Replies passed on to clients.
    pub replies: u64,
    /// Bytes passed on both ways, all frames.
    pub bytes: u64,
    /// Requests that wait for a server now.
    pub waiting: u64,
    /// Requests answered with an error because too many waited.
    pub overloaded: u64,
    /// Requests dropped because their callers had given up.
    pub expired: u64,
    /// Messages dropped because they were no request or no reply.
    pub malformed: u64,
    /// Replies dropped because their clients were gone, or did not read.
    pub unheard: u64,
    /// Connections that were refused or ended, by reason: `too_many`, `oversize`, `over_budget`; with CURVE
    /// `mechanism`, `curve`, `unknown_key`, `not_allowed` (to call or to serve).
    pub cut: BTreeMap<&'static str, u64>,
    /// Reason why the broker does not work now; it goes on trying.
    pub failure: Option<String>,
}

impl ServiceBroker {
    /// Binds both ports and starts passing requests and replies.
    ///
    /// # Errors
    /// When a port cannot be bound or must not be; both are free again then.
    pub fn start(config: &ServiceBrokerConfig) -> Result<Self, BrokerError> {
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
        let proxy = ServiceProxy::new(front, back, stop, config.pending, Arc::clone(&status));
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
    type Config = ServiceBrokerConfig;

    // Asked as a socket that neither side takes: one that the DEALER took would be given a request.
    const FRONT: Side = Side { ours: "SUB", expected: "ROUTER" };
    const BACK: Side = Side { ours: "SUB", expected: "DEALER" };
    const WATCHER: zmq::SocketType = zmq::DEALER;
    const SETTINGS: &'static str = "rep_port, req_port";

    fn start(config: &Self::Config) -> Result<Self, BrokerError> {
        Self::start(config)
    }

    fn ports(config: &Self::Config) -> (u16, u16) {
        (config.rep_port, config.req_port)
    }

    fn has_curve(config: &Self::Config) -> bool {
        config.curve.is_some()
    }
}
