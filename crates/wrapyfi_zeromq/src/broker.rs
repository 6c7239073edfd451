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

use std::net::IpAddr;
use std::sync::Arc;
use std::time::Instant;

use super::config::ZeroMqConfig;
use super::error::BrokerError;
use super::ledger::Ledger;
use super::monitor::Monitor;
use super::proxy::Proxy;
use super::sides::{Sides, failed_to};
use super::status::BrokerStatus;
use super::supervisor::Supervised;
use super::traffic::Traffic;
use super::turns::Runs;
use super::zmtp::Kind;
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
    pub fn start(config: &ZeroMqConfig) -> Result<Self, BrokerError> {
        Self::start_with(config, &Arc::default())
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
    const KINDS: [Kind; 2] = [Kind::Xpub, Kind::Xsub];
    const ASKED_AS: [&'static str; 2] = ["SUB", "PUB"];
    /// Socket type of the watcher, which subscribes to nothing.
    const WATCHER: zmq::SocketType = zmq::SUB;
    const SETTINGS: [&'static str; 2] = ["pub_port", "sub_port"];

    fn ports(config: &ZeroMqConfig) -> [u16; 2] {
        [config.pub_port, config.sub_port]
    }

    fn start_with(config: &ZeroMqConfig, ledger: &Arc<Ledger>) -> Result<Self, BrokerError> {
        let own_topic = config.monitor.then_some(config.monitor_topic.as_str());
        let sides = Sides::bind::<Self>(config, [config.send_hwm; 2], own_topic)?;
        let Sides { ip, ports: [pub_port, sub_port], front, back, keys, stop_signal, stop } = sides;
        let status = Arc::<Mutex<BrokerStatus>>::default();
        if keys.as_ref().is_some_and(|keys| !keys.has_list()) {
            tracing::warn!(
                "every client that knows the public key of this broker may use all topics: list those that may \
                 (endpoints: zeromq: curve: clients)"
            );
        }
        let proxy = Proxy {
            front,
            back,
            stop,
            monitor: Monitor::new(own_topic),
            traffic: Traffic::default(),
            status: Arc::clone(&status),
            ledger: Arc::clone(ledger),
            slow: Throttle::default(),
            repeat_at: Instant::now(),
        };
        let runs = Runs::start("zeromq-broker", stop_signal, proxy)
            .map_err(failed_to("start its thread"))?;
        let public_key = keys.map(|keys| keys.public());
        tracing::info!(%ip, pub_port, sub_port, public_key, "ZeroMQ broker runs");
        Ok(Self { ip, pub_port, sub_port, status, _runs: runs })
    }
}
