//! Wrapyfi over ZeroMQ: publish and listen, call and serve, and the brokers.
//!
//! ```text
//!                            broker (ours or a foreign one)
//!   Publisher XPUB ──connect──▶ sub_port XSUB │ XPUB pub_port ◀──connect── XSUB Listener
//!                                             └── ZEROMQ/CONNECTIONS: {"/topic": count}
//!   Client DEALER ──connect──▶ rep_port ROUTER │ DEALER req_port ◀──connect── DEALER Server
//! ```
//!
//! Both sides interwork with Python Wrapyfi in any mixture: its publishers and listeners with our
//! broker, ours with its broker.
//!
//! | module | one idea |
//! | --- | --- |
//! | `config`, `error`, `status` | settings and environment, errors of the start, brokers at one moment |
//! | `supervisor` | there is a broker: ours, or a foreign one until it dies |
//! | `broker`, `turns` | the brokers of topics, and of requests and replies; the life of their threads |
//! | `proxy`, `monitor`, `traffic` | the thread of the one, its counts |
//! | `broker_ports` | the two ports of a broker, bound |
//! | `front`, `subscribers`, `wanted`, `assembly`, `ledger` | one of its sides, its listeners by topic, what its publishers are told, messages from their frames, whose messages it lost and whose peers it refused |
//! | `discovery` | which topics a broker has |
//! | `port_check` | what has a port |
//! | `service_proxy` | the thread of the other |
//! | `io`, `link` | the thread that receives, connection state |
//! | `listener`, `publisher`, `client`, `server`, `shared` | the endpoints, what they share |
//! | `socket`, `connection` | a socket of ours, its connection to the broker |
//! | `publication`, `reception`, `exchange`, `inside` | the parts that sockets play: publisher, listener, client and server; the way into a broker of the same process |
//! | `peer`, `mechanism`, `message`, `heard`, `zmtp` | the other end of a connection: its security, what waits for it, what comes of it; the protocol |
//! | `curve`, `curve_config` | CURVE: keys, a connection with them; its settings |
//! | [`codec`] | payloads as the frames of a message, by the settings of the topic |
//! | `envelope` | what is around a request and a reply |
//! | `section` | the section of a configuration, and what starts from it |
//! | `own_messages` | our own messages are not received |
//! | `offline` | readers of foreign bytes without sockets, for fuzzing |
//! | `options` | what all sockets share |

mod assembly;
mod broker;
mod broker_ports;
mod client;
pub mod codec;
mod config;
mod connection;
#[cfg_attr(not(feature = "curve"), path = "curve_absent.rs")]
mod curve;
mod curve_config;
mod deadline;
mod discovery;
mod ends;
mod envelope;
mod error;
mod exchange;
mod front;
mod heard;
mod inside;
mod io;
mod ledger;
mod link;
mod listener;
mod mechanism;
mod message;
mod monitor;
#[cfg(feature = "fuzzing")]
pub mod offline;
mod options;
mod own_messages;
mod peer;
mod port_check;
mod proxy;
mod publication;
mod publisher;
mod queue;
mod reception;
#[cfg(feature = "driver")]
mod section;
mod server;
mod service_proxy;
mod shared;
mod socket;
mod source;
mod status;
mod subscribers;
mod supervisor;
mod traffic;
mod turns;
mod wanted;
mod zmtp;

use std::net::SocketAddr;
use std::sync::Arc;

pub use broker::{Broker, RunningBroker, ServiceBroker};
pub use config::{BrokerMode, NAME, ZeroMqConfig};
pub use curve_config::{CurveClient, CurveConfig, CurveError};
pub use error::{BrokerError, ZeroMqError};
pub use port_check::PortHolder;
#[cfg(feature = "driver")]
pub use section::DRIVER;
pub use source::source;
pub use status::{BrokerStatus, ServiceBrokerStatus};
pub use traffic::TopicTraffic;

use shared::ZeroMqState;
use wrapyfi_endpoint::{
    Builder, Cause, Client, Context, DiscoverError, Discovery, Listener, Middleware,
    MiddlewareSettings, Mutex, OpenError, OpenResult, Opened, Publisher, Role, Server, ServiceSpec,
    StartError, TopicSpec,
};

/// Finds out what has a port, within a second.
#[doc(hidden)]
#[must_use]
pub fn what_has(address: SocketAddr) -> PortHolder {
    // A socket that fits nowhere: no broker takes it for one at the wrong port.
    port_check::ask_port(address, "PAIR", zmtp::NULL)
}

/// Longest topic name: it is sent with every message.
const MAX_TOPIC_BYTES: usize = 1024;

/// The middleware `zeromq`.
///
/// Dropping it closes the sockets of all its endpoints and ends its broker, within a second.
pub struct ZeroMq {
    // Dropped in this order: sockets may still send while the broker runs.
    shared: ZeroMqState,
    supervisor: supervisor::Supervisor<Broker>,
    /// Settings, with the ports that the broker has.
    config: ZeroMqConfig,
    /// Broker of requests and replies, from the first server on.
    services: Mutex<Option<supervisor::Supervisor<ServiceBroker>>>,
}

impl ZeroMq {
    /// Starts the I/O thread and, where none runs yet, the broker.
    ///
    /// # Errors
    /// When the ports belong to something else, or the settings contradict themselves. A foreign
    /// broker that is not there yet is no error: it is waited for.
    #[doc(hidden)]
    pub fn start(config: &ZeroMqConfig) -> Result<Self, ZeroMqError> {
        check_topic(&config.monitor_topic).map_err(|reason| ZeroMqError::MonitorTopic {
            topic: config.monitor_topic.clone(),
            reason,
        })?;
        let ip = config.address()?;
        let serves = config.broker == BrokerMode::Embedded;
        let keys = config.curve.as_ref().map(|curve| curve::Keys::load(curve, serves, None));
        let keys = keys.transpose().map_err(BrokerError::Curve)?;
        let why = match keys.as_ref().is_some_and(|keys| keys.is_of_another()) {
            _ if serves => None,
            _ if config.broker_by_variable => Some("WRAPYFI_ZEROMQ_START_PROXY_BROKER says so"),
            true => {
                Some("`server_key` (WRAPYFI_ZEROMQ_CURVE_SERVER_KEY) is another's key than ours")
            }
            false => None,
        };
        if let Some(why) = why {
            tracing::warn!(%ip, "no ZeroMQ broker is started here, one has to run there: {why}");
        }
        let ledger = Arc::<ledger::Ledger>::default();
        let supervisor = supervisor::Supervisor::<Broker>::start(config, &ledger, config.broker)?;
        let mut config = config.clone();
        if let Some(ports) = supervisor.own(|broker| (broker.pub_port(), broker.sub_port())) {
            (config.pub_port, config.sub_port) = ports;
        }
        check_ports([("pub_port", config.pub_port), ("sub_port", config.sub_port)])?;
        let io = io::Io::start().map_err(|error| ZeroMqError::Transport(error.to_string()))?;
        let ip = config::reachable(ip);
        let shared = ZeroMqState {
            ip,
            pub_address: SocketAddr::new(ip, config.pub_port),
            sub_address: SocketAddr::new(ip, config.sub_port),
            send_hwm: config.send_hwm,
            max_frame_bytes: config.max_frame_bytes,
            own_messages: own_messages::OwnMessages::default(),
            ledger,
            io,
            keys,
            links: Mutex::default(),
        };
        Ok(Self { shared, supervisor, config, services: Mutex::default() })
    }

    /// Port to which listeners connect.
    pub fn pub_port(&self) -> u16 {
        self.config.pub_port
    }

    /// Port to which publishers connect.
    pub fn sub_port(&self) -> u16 {
        self.config.sub_port
    }

    /// State of the broker, where it is this process that runs it now.
    #[doc(hidden)]
    pub fn broker_status(&self) -> Option<BrokerStatus> {
        self.supervisor.own(Broker::status)
    }

    /// Sees to it that there is a broker of requests and replies, as the first server does by
    /// itself: its ports for clients and for servers. With a foreign broker those that are
    /// configured.
    ///
    /// # Errors
    /// As [`ZeroMq::start`].
    #[doc(hidden)]
    pub fn start_services(&self) -> Result<(u16, u16), ZeroMqError> {
        let mut services = self.services.lock();
        let supervisor = match &mut *services {
            Some(supervisor) => supervisor,
            none => {
                let mode = self.config.service_broker;
                none.insert(supervisor::Supervisor::start(&self.config, &self.shared.ledger, mode)?)
            }
        };
        let own = supervisor.own(|broker| (broker.rep_port(), broker.req_port()));
        let (rep_port, req_port) = own.unwrap_or((self.config.rep_port, self.config.req_port));
        check_ports([("rep_port", rep_port), ("req_port", req_port)])?;
        Ok((rep_port, req_port))
    }

    /// State of the broker of requests and replies, where it is this process that runs it now.
    #[doc(hidden)]
    pub fn service_broker_status(&self) -> Option<ServiceBrokerStatus> {
        let services = self.services.lock();
        services.as_ref().and_then(|supervisor| supervisor.own(ServiceBroker::status))
    }

    /// Address that a client or a server connects to. A server brings the broker along.
    fn service_address(&self, role: Role, spec: &ServiceSpec) -> OpenResult<SocketAddr> {
        check_topic(&spec.service).map_err(|reason| invalid(&spec.service, reason))?;
        let rep_port = self.config.rep_port;
        let port = match role {
            Role::Client if rep_port != 0 => rep_port,
            _ => {
                let ports = self.start_services().map_err(|error| {
                    OpenError::transport(NAME, &spec.service, error.to_string())
                })?;
                if role == Role::Client { ports.0 } else { ports.1 }
            }
        };
        Ok(SocketAddr::new(self.shared.ip, port))
    }

    fn check(&self, topic: &str) -> OpenResult<()> {
        let mut own = traffic::OWN_TOPICS.into_iter().chain([self.config.monitor_topic.as_str()]);
        let own = own.find(|own| topic.starts_with(own));
        let checked = match own {
            Some(own) => {
                Err(format!("names that start with {own} are the broker's own; use another name"))
            }
            None => check_topic(topic),
        };
        checked.map_err(|reason| invalid(topic, reason))
    }
}

impl Middleware for ZeroMq {
    fn network(&self) -> Option<String> {
        Some(wrapyfi_endpoint::network::server_text(
            &self.shared.ip.to_string(),
            self.config.sub_port,
        ))
    }

    fn name(&self) -> &str {
        NAME
    }

    fn open_listener(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Listener> {
        self.check(&spec.topic)?;
        Ok(Box::new(listener::ZeroMqListener::open(&self.shared, spec, context)))
    }

    fn open_publisher(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Publisher> {
        self.check(&spec.topic)?;
        Ok(Box::new(publisher::ZeroMqPublisher::open(&self.shared, spec, context)))
    }

    /// One pair of ports is one service: `spec.service` is not sent.
    fn open_client(&self, spec: &ServiceSpec, context: &Context) -> Opened<dyn Client> {
        let broker = self.service_address(Role::Client, spec)?;
        Ok(Box::new(client::ZeroMqClient::open(&self.shared, broker, spec, context)))
    }

    fn open_server(&self, spec: &ServiceSpec, context: &Context) -> Opened<dyn Server> {
        let broker = self.service_address(Role::Server, spec)?;
        Ok(Box::new(server::ZeroMqServer::open(&self.shared, broker, spec, context)))
    }

    fn waiting_for(&self) -> Option<Cause> {
        self.shared.waiting_for()
    }

    fn discover(&self) -> Result<Box<dyn Discovery>, DiscoverError> {
        Ok(Box::new(discovery::ZeroMqDiscovery::new(&self.shared, &self.config.monitor_topic)?))
    }

    /// A publisher sends nothing that no program subscribes to, and Wrapyfi's waits until a program names its topic:
    /// so the topic is subscribed to, or everything.
    fn discover_closely(&self, topic: Option<&str>) -> Result<Box<dyn Discovery>, DiscoverError> {
        let discovery = discovery::ZeroMqDiscovery::new(&self.shared, &self.config.monitor_topic)?;
        Ok(Box::new(discovery.subscribed(topic.unwrap_or_default())))
    }
}

impl MiddlewareSettings for ZeroMqConfig {
    type Middleware = ZeroMq;

    fn start(&self) -> Result<ZeroMq, StartError> {
        ZeroMq::start(self).map_err(|error| StartError::of(&error, error.is_hopeless(), false))
    }
}

/// ZeroMQ, as the variables `WRAPYFI_ZEROMQ_*` say; it runs the broker where there is none.
pub fn zeromq() -> Builder<ZeroMqConfig> {
    Builder::new(ZeroMqConfig::from_env().map_err(StartError::refused))
}

impl std::fmt::Debug for ZeroMq {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ZeroMq")
            .field("pub_address", &self.shared.pub_address)
            .field("sub_address", &self.shared.sub_address)
            .finish_non_exhaustive()
    }
}

/// Checks a topic name against the rules that hold whatever the broker's settings are.
///
/// # Errors
/// The rule that the name breaks.
pub fn check_topic(topic: &str) -> Result<(), String> {
    if topic.is_empty() {
        Err("it is empty, which would match every topic; give it a name".to_owned())
    } else if topic.len() > MAX_TOPIC_BYTES {
        Err(format!("it is {} bytes long, the limit is {MAX_TOPIC_BYTES}", topic.len()))
    } else if topic.contains(char::is_control) {
        Err("it contains a control character; remove it".to_owned())
    } else {
        Ok(())
    }
}

fn invalid(topic: &str, reason: String) -> OpenError {
    OpenError::invalid_name(NAME, topic, reason)
}

fn check_ports(ports: [(&'static str, u16); 2]) -> Result<(), ZeroMqError> {
    let unknown = ports.into_iter().find(|(_, port)| *port == 0);
    unknown.map_or(Ok(()), |(field, _)| Err(ZeroMqError::NoPort(field)))
}
