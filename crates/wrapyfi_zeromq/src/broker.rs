//! The meeting point of publishers and listeners, in place of Wrapyfi's own.
//!
//! ```text
//!   Broker::start ── binds XPUB pub_port (listeners) and XSUB sub_port (publishers)
//!        │           └─ thread: Proxy
//!   status() ◀────────── counters, subscriptions
//!   drop     ──────────▶ thread ends, ports are free
//! ```
//!
//! The broker lives in a thread of its owner: it cannot outlive the process and keep the ports.

use std::io::ErrorKind;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Instant;

use super::config::{self, BrokerConfig};
use super::curve::Keys;
use super::curve_config::{CurveConfig, CurveError};
use super::error::BrokerError;
use super::front::{Bounds, Front};
use super::ledger::Ledger;
use super::monitor::Monitor;
use super::options::{self, StopSignal};
use super::proxy::Proxy;
use super::status::BrokerStatus;
use super::supervisor::{Side, Supervised};
use super::traffic::Traffic;
use super::turns::Runs;
use super::zmtp::Kind;
use wrapyfi_endpoint::network::Insecure;
use wrapyfi_endpoint::{Mutex, Throttle};

/// A running broker. Dropping it ends it and frees its ports.
#[derive(Debug)]
pub struct Broker {
    ip: IpAddr,
    pub_port: u16,
    sub_port: u16,
    status: Arc<Mutex<BrokerStatus>>,
    _runs: Runs,
}

impl Broker {
    /// Binds both ports and starts passing messages.
    ///
    /// # Errors
    /// When a port cannot be bound or must not be; both are free again then.
    pub fn start(config: &BrokerConfig) -> Result<Self, BrokerError> {
        Self::start_with(config, Arc::default())
    }

    /// As [`Self::start`], of an instance whose publishers are told what the broker loses of theirs.
    fn start_with(config: &BrokerConfig, ledger: Arc<Ledger>) -> Result<Self, BrokerError> {
        let keys = keys(config.curve.as_ref(), config.monitor_topic.as_deref())?;
        let ip = loopback(&config.ip, config.insecure, keys.as_ref())?;
        if config.pub_port == config.sub_port && config.pub_port != 0 {
            let names = ("pub_port", "sub_port");
            return Err(BrokerError::SamePort { port: config.pub_port, names });
        }
        let context = zmq::Context::new();
        let bounds = Bounds {
            hwm: config.hwm,
            message_bytes: config.max_frame_bytes,
            connections: config.max_connections,
        };
        let (front, pub_port) = bind(Kind::Xpub, (ip, config.pub_port), bounds)?;
        let (back, sub_port) = bind(Kind::Xsub, (ip, config.sub_port), bounds)?;
        let (stop_signal, stop) =
            StopSignal::new(&context).map_err(failed_to("open its control socket"))?;
        let status = Arc::<Mutex<BrokerStatus>>::default();
        if keys.as_ref().is_some_and(|keys| !keys.has_list()) {
            tracing::warn!(
                "every client that knows the public key of this broker may use all topics: list those that may \
                 (endpoints: zeromq: curve: clients)"
            );
        }
        let public_key = keys.as_ref().map(|keys| keys.public());
        let proxy = Proxy {
            front: front.secured(keys.clone()),
            back: back.secured(keys),
            stop,
            monitor: Monitor::new(config.monitor_topic.as_deref()),
            traffic: Traffic::default(),
            status: BrokerStatus::default(),
            shown: Arc::clone(&status),
            ledger,
            slow: Throttle::default(),
            repeat_at: Instant::now(),
        };
        let runs = Runs::start("zeromq-broker", stop_signal, proxy)
            .map_err(failed_to("start its thread"))?;
        tracing::info!(%ip, pub_port, sub_port, public_key, "ZeroMQ broker runs");
        Ok(Self { ip, pub_port, sub_port, status, _runs: runs })
    }

    /// Address it is bound to.
    #[must_use]
    pub fn ip(&self) -> IpAddr {
        self.ip
    }

    /// Port to which listeners connect.
    #[must_use]
    pub fn pub_port(&self) -> u16 {
        self.pub_port
    }

    /// Port to which publishers connect.
    #[must_use]
    pub fn sub_port(&self) -> u16 {
        self.sub_port
    }

    /// Counters and subscriptions; the latter at most half a second old.
    #[must_use]
    pub fn status(&self) -> BrokerStatus {
        self.status.lock().clone()
    }
}

impl Supervised for Broker {
    type Config = (BrokerConfig, Arc<Ledger>);

    const FRONT: Side = Side { ours: "SUB", expected: "XPUB" };
    const BACK: Side = Side { ours: "PUB", expected: "XSUB" };
    /// Socket type of the watcher, which subscribes to nothing.
    const WATCHER: zmq::SocketType = zmq::SUB;
    const SETTINGS: &'static str = "pub_port, sub_port";

    fn start(config: &Self::Config) -> Result<Self, BrokerError> {
        Self::start_with(&config.0, Arc::clone(&config.1))
    }

    fn ports((config, _): &Self::Config) -> (u16, u16) {
        (config.pub_port, config.sub_port)
    }

    fn has_curve((config, _): &Self::Config) -> bool {
        config.curve.is_some()
    }
}

/// Keys of a broker, where it is to have some.
pub(super) fn keys(
    curve: Option<&CurveConfig>,
    own_topic: Option<&str>,
) -> Result<Option<Arc<Keys>>, CurveError> {
    curve.map(|curve| Keys::load(curve, true, own_topic)).transpose()
}

/// The address of `host`, which others may reach only where that is allowed, or where only known clients are taken.
pub(super) fn loopback(
    host: &str,
    insecure: Insecure,
    keys: Option<&Arc<Keys>>,
) -> Result<IpAddr, BrokerError> {
    let ip = config::resolve(host)?;
    if !keys.is_some_and(|keys| keys.has_list()) {
        insecure.check(config::NAME, "a broker", ip)?;
    }
    Ok(ip)
}

/// Binds one side of a broker, and tells to which port.
pub(super) fn bind(
    kind: Kind,
    (ip, port): (IpAddr, u16),
    bounds: Bounds,
) -> Result<(Front, u16), BrokerError> {
    let front = Front::bind(kind, ip, port, bounds).map_err(|error| refused(ip, port, &error))?;
    let port = front.port().map_err(failed_to("learn its port"))?;
    Ok((front, port))
}

/// Error for a port of ours that could not be bound.
fn refused(ip: IpAddr, port: u16, error: &std::io::Error) -> BrokerError {
    match error.kind() {
        ErrorKind::AddrInUse => BrokerError::PortTaken { ip, port },
        ErrorKind::AddrNotAvailable => BrokerError::NotHere { ip },
        _ => failed_to(&format!("bind {}", options::endpoint(ip, port)))(error),
    }
}

pub(super) fn failed_to<E: std::fmt::Display>(action: &str) -> impl FnOnce(E) -> BrokerError {
    let action = action.to_owned();
    move |error| BrokerError::Transport { action, reason: error.to_string() }
}
