//! Errors of starting ZeroMQ and its brokers.

use std::net::IpAddr;

use super::curve_config::CurveError;
use super::port_check::PortHolder;
use wrapyfi_endpoint::network::ReachedByOthers;

/// Error of starting a broker.
///
/// ```
/// use wrapyfi_zeromq::{Broker, ZeroMqConfig};
/// let same = ZeroMqConfig { pub_port: 5557, sub_port: 5557, ..ZeroMqConfig::default() };
/// let error = Broker::start(&same).err().unwrap();
/// assert!(error.to_string().ends_with("are both 5557: give each a port of its own"));
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BrokerError {
    /// The host has no address.
    #[error("the broker's {0}")]
    Host(String),
    /// Other machines could reach it.
    #[error(transparent)]
    NotLoopback(#[from] ReachedByOthers),
    /// The keys of CURVE have a fault.
    #[error(transparent)]
    Curve(#[from] CurveError),
    /// Another program has the port.
    #[error(
        "port {port} on {ip} is taken{}: stop what uses it, or choose another port",
        shown(owner)
    )]
    PortTaken {
        /// Address asked for.
        ip: IpAddr,
        /// Port asked for.
        port: u16,
        /// Program that has it, where the system tells.
        owner: Option<Box<str>>,
    },
    /// The address belongs to another machine.
    #[error("{0} is not an address of this machine: run the broker there and only connect here")]
    NotHere(IpAddr),
    /// Two sides on one port.
    #[error("{} and {} are both {port}: give each a port of its own", names[0], names[1])]
    SamePort {
        /// The port.
        port: u16,
        /// The two settings.
        names: [&'static str; 2],
    },
    /// Anything else ZeroMQ or the system refused: the action, and the message of the system.
    #[error("the ZeroMQ broker could not {0}")]
    Transport(String),
}

/// Error of starting ZeroMQ.
///
/// ```
/// use wrapyfi_zeromq::{BrokerMode, ZeroMq, ZeroMqConfig};
/// let broker = BrokerMode::Foreign;
/// let error = ZeroMq::start(&ZeroMqConfig { broker, sub_port: 0, ..ZeroMqConfig::default() });
/// let error = error.err().unwrap();
/// assert_eq!(error.to_string(), "with a foreign broker sub_port must be its port, not 0");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ZeroMqError {
    /// A port belongs to something that is no broker.
    #[error(
        "port {port} on {ip} is taken by {answer}; a broker would be {expected}: {}{}",
        answer.remedy(settings),
        shown(owner)
    )]
    PortTaken {
        /// Address of the broker.
        ip: IpAddr,
        /// The port.
        port: u16,
        /// Socket type of a broker there.
        expected: &'static str,
        /// Program that answered on the port.
        answer: PortHolder,
        /// Its process, where the system tells.
        owner: Option<Box<str>>,
        /// Names of the two ports in the settings.
        settings: [&'static str; 2],
    },
    /// No broker runs, and ours cannot.
    #[error(transparent)]
    Broker(#[from] BrokerError),
    /// Both ports are needed to connect to a broker elsewhere.
    #[error("with a foreign broker {0} must be its port, not 0")]
    NoPort(&'static str),
    /// The monitor topic cannot be a topic.
    #[error("monitor topic {topic:?} is not valid: {reason}")]
    MonitorTopic {
        /// Name as configured.
        topic: String,
        /// The rule it breaks.
        reason: String,
    },
    /// The system refused.
    #[error("ZeroMQ could not start: {0}")]
    Transport(String),
}

/// Program that has a port, behind what is said of the port.
fn shown(owner: &Option<Box<str>>) -> String {
    owner.as_deref().map(|it| format!(" ({it})")).unwrap_or_default()
}

impl ZeroMqError {
    /// True when no later try can succeed, because the settings are wrong.
    pub fn is_hopeless(&self) -> bool {
        matches!(
            self,
            Self::NoPort(_)
                | Self::MonitorTopic { .. }
                | Self::Broker(
                    BrokerError::NotLoopback(_)
                        | BrokerError::SamePort { .. }
                        | BrokerError::Curve(_)
                )
        )
    }
}
