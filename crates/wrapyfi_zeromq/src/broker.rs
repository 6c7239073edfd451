//! The brokers, in place of Wrapyfi's own: of topics, and of requests and replies.
//!
//! ```text
//!   Broker::start ── binds XPUB pub_port (listeners) and XSUB sub_port (publishers)
//!        │           └─ thread: Proxy
//!   status() ◀────────── counters, subscriptions
//!   drop     ──────────▶ thread ends, ports are free
//!
//!   clients ──connect──▶ ROUTER rep_port │ ServiceProxy │ DEALER req_port ◀──connect── servers
//! ```
//!
//! A broker lives in a thread of its owner: it cannot outlive the process and keep the ports. No name of a service
//! travels: one pair of ports is one service, and several servers on it are asked in turn.

use std::sync::Arc;
use std::time::Instant;

use super::broker_ports::{Bound, BrokerPorts, failed_to};
use super::config::ZeroMqConfig;
use super::error::BrokerError;
use super::inside::Inside;
use super::ledger::Ledger;
use super::monitor::Monitor;
use super::options::SEND_HWM;
use super::proxy::{Proxy, ProxyThread};
use super::service_proxy::ServiceProxy;
use super::status::{BrokerStatus, ServiceBrokerStatus};
use super::supervisor::Supervised;
use super::traffic::Traffic;
use super::turns::{Runs, Turns};
use super::zmtp::Kind;
use wrapyfi_endpoint::{Mutex, Throttle};

/// A running broker with counters `S`: a [`Broker`] or a [`ServiceBroker`]. Dropping it ends it and frees its ports.
///
/// ```
/// use wrapyfi_zeromq::{Broker, ZeroMqConfig};
/// let free = ZeroMqConfig { pub_port: 0, sub_port: 0, ..ZeroMqConfig::default() };
/// let broker = Broker::start(&free)?;
/// assert_ne!(broker.pub_port(), broker.sub_port());
/// assert_eq!(broker.status().messages, 0);
/// # Ok::<(), wrapyfi_zeromq::BrokerError>(())
/// ```
#[derive(Debug)]
pub struct RunningBroker<S> {
    ports: [u16; 2],
    status: Arc<Mutex<S>>,
    _runs: Runs,
}

/// The meeting point of publishers and listeners.
///
/// See [`RunningBroker`].
pub type Broker = RunningBroker<BrokerStatus>;
/// The meeting point of clients and servers.
///
/// See [`RunningBroker`].
pub type ServiceBroker = RunningBroker<ServiceBrokerStatus>;

#[allow(private_bounds)] // what the supervisor needs to know of both is nobody else's
impl<S: Clone> RunningBroker<S>
where
    Self: Supervised,
{
    /// Binds both ports and starts passing messages.
    ///
    /// # Errors
    /// When a port cannot be bound or must not be; both are free again then.
    pub fn start(config: &ZeroMqConfig) -> Result<Self, BrokerError> {
        Self::start_with(config, &Arc::default())
    }

    /// Counters; of topics, subscriptions at most half a second old.
    pub fn status(&self) -> S {
        self.status.lock().clone()
    }

    /// Starts the thread `name` of a broker that is bound.
    fn run<T: Turns>(
        name: &str,
        bound: Bound,
        status: Arc<Mutex<S>>,
        proxy: T,
    ) -> Result<Self, BrokerError> {
        let Bound { ip, ports, keys } = bound;
        let runs = Runs::start(name, proxy).map_err(failed_to("start its thread"))?;
        let public_key = keys.map(|keys| keys.public());
        let ([front, back], [front_port, back_port]) = (Self::SETTINGS, ports);
        let name = T::NAME;
        tracing::info!(%ip, public_key, "{name} runs: {front} {front_port}, {back} {back_port}");
        Ok(Self { ports, status, _runs: runs })
    }
}

impl Broker {
    /// Port to which listeners connect.
    pub fn pub_port(&self) -> u16 {
        self.ports[0]
    }

    /// Port to which publishers connect.
    pub fn sub_port(&self) -> u16 {
        self.ports[1]
    }
}

impl ServiceBroker {
    /// Port to which clients connect.
    pub fn rep_port(&self) -> u16 {
        self.ports[0]
    }

    /// Port to which servers connect.
    pub fn req_port(&self) -> u16 {
        self.ports[1]
    }
}

impl Supervised for Broker {
    const KINDS: [Kind; 2] = [Kind::Xpub, Kind::Xsub];
    const ASKED_AS: [&'static str; 2] = ["SUB", "PUB"];
    /// Socket type of the watcher, which subscribes to nothing.
    const SETTINGS: [&'static str; 2] = ["pub_port", "sub_port"];

    fn ports(config: &ZeroMqConfig) -> [u16; 2] {
        [config.pub_port, config.sub_port]
    }

    fn start_with(config: &ZeroMqConfig, ledger: &Arc<Ledger>) -> Result<Self, BrokerError> {
        let own_topic = config.monitor.then_some(config.monitor_topic.as_str());
        let (ports, bound) =
            BrokerPorts::bind::<Self>(config, [config.send_hwm; 2], own_topic, ledger)?;
        let status = Arc::<Mutex<BrokerStatus>>::default();
        if bound.keys.as_ref().is_some_and(|keys| !keys.has_list()) {
            tracing::warn!(
                "every client that knows the public key of this broker may use all topics: list those that may \
                 (endpoints: zeromq: curve: clients)"
            );
        }
        let proxy = Proxy {
            ports,
            monitor: Monitor::new(own_topic),
            traffic: Traffic::default(),
            status: Arc::clone(&status),
            slow: Throttle::default(),
            repeat_at: Instant::now(),
            is_untold: false,
            tell_at: Instant::now(),
        };
        let proxy = Arc::new(Mutex::new(proxy));
        // With keys each message is sealed for its connection, and a grant decides who may publish it.
        if bound.keys.is_none() {
            let proxy = Arc::<Mutex<Proxy>>::downgrade(&proxy);
            *ledger.broker.lock() = Some(Inside(proxy));
        }
        Self::run("zeromq-broker", bound, status, ProxyThread(proxy))
    }
}

impl Supervised for ServiceBroker {
    const KINDS: [Kind; 2] = [Kind::Router, Kind::Dealer];
    // Asked as a socket that neither side takes: one that the DEALER took would be given a request.
    const ASKED_AS: [&'static str; 2] = ["SUB", "SUB"];
    const SETTINGS: [&'static str; 2] = ["rep_port", "req_port"];

    fn ports(config: &ZeroMqConfig) -> [u16; 2] {
        [config.rep_port, config.req_port]
    }

    fn start_with(config: &ZeroMqConfig, ledger: &Arc<Ledger>) -> Result<Self, BrokerError> {
        // The broker of topics is a program of its own to this one: it would be asked to stop.
        for (topics, topics_port) in Broker::SETTINGS.into_iter().zip(Broker::ports(config)) {
            for (name, port) in Self::SETTINGS.into_iter().zip(Self::ports(config)) {
                if port == topics_port && port != 0 {
                    return Err(BrokerError::SamePort { port, names: [topics, name] });
                }
            }
        }
        let depth = u16::try_from(config.pending.max(1)).unwrap_or(u16::MAX);
        // What a client does not read waits behind that, in the thread of the broker.
        let (ports, bound) = BrokerPorts::bind::<Self>(config, [SEND_HWM, depth], None, ledger)?;
        let status = Arc::<Mutex<ServiceBrokerStatus>>::default();
        let proxy = ServiceProxy::new(ports, config.pending, Arc::clone(&status));
        Self::run("zeromq-services", bound, status, proxy)
    }
}
