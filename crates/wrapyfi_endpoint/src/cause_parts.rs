//! Parts of causes: endpoints that are waited for, types that differ, faults of connections, routes of other bridges.

use std::fmt;

use super::{EndpointAddress, Role};

/// Program, server or endpoint that a cause is about: the words for people, and the address for programs.
///
/// ```
/// use wrapyfi_endpoint::Named;
/// let port = Named::endpoint("port", "yarp", "/cam");
/// assert_eq!((port.to_string().as_str(), port.address.as_str()), ("port /cam", "yarp:/cam"));
/// let broker = Named::server("the broker at", "tcp://127.0.0.1:5555");
/// assert_eq!(broker.to_string(), "the broker at tcp://127.0.0.1:5555");
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named {
    /// Words of the middleware for it, with its name.
    pub words: String,
    /// Address: `middleware:/name` of an endpoint, else host and port or URI.
    pub address: String,
}

impl Named {
    /// An endpoint or port of a middleware, with the words of the middleware before its name.
    pub fn endpoint(term: &str, middleware: &str, name: &str) -> Self {
        Self { words: format!("{term} {name}"), address: format!("{middleware}:{name}") }
    }

    /// A server or program at an address, with the words before the address.
    pub fn server(term: &str, address: impl fmt::Display) -> Self {
        Self { words: format!("{term} {address}"), address: address.to_string() }
    }
}

impl fmt::Display for Named {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.words)
    }
}

/// An endpoint of another program that is waited for, in the words of its middleware.
///
/// ```
/// use wrapyfi_endpoint::{Absent, Role};
/// let absent = Absent::new(Role::Publisher, "a publisher of", "ros2", "/chatter");
/// assert_eq!(absent.to_string(), "a publisher of /chatter");
/// assert_eq!(absent.named.address, "ros2:/chatter");
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Absent {
    /// Role of the endpoint.
    pub role: Role,
    /// The endpoint.
    pub named: Named,
}

impl Absent {
    /// An endpoint of `name` in a role, with the words of the middleware before the name.
    pub fn new(role: Role, term: &str, middleware: &str, name: &str) -> Self {
        Self { role, named: Named::endpoint(term, middleware, name) }
    }

    /// An endpoint in a role at an address.
    pub fn at(role: Role, address: &EndpointAddress) -> Self {
        let term = match role {
            Role::Publisher => "a publisher on",
            Role::Listener => "a listener on",
            Role::Client | Role::ActionClient => "a client of",
            Role::Server | Role::ActionServer => "a server of",
        };
        Self { role, named: Named::server(term, address) }
    }
}

impl fmt::Display for Absent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.named.fmt(f)
    }
}

/// A type as two programs compare it when they connect.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WireType {
    /// Name of the type.
    pub name: String,
    /// Checksum of its definition.
    pub checksum: String,
}

impl fmt::Display for WireType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} [{}]", self.name, self.checksum)
    }
}

/// Fault of a connection to another program.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PeerFault {
    /// The program has another type.
    #[error("it {verb} {theirs}; wanted is {ours}: have both use the same definition")]
    Unlike {
        /// Use of the type there: `sends` or `is`.
        verb: &'static str,
        /// Type there.
        theirs: WireType,
        /// Type here.
        ours: WireType,
    },
    /// The program sends a type that the wanted one cannot be made from.
    #[error("it sends {theirs}, which cannot be received as {ours}: {reason}")]
    Unreadable {
        /// Type there.
        theirs: String,
        /// Type here.
        ours: String,
        /// Difference, and the remedy.
        reason: String,
    },
    /// The program refuses the connection.
    #[error("it refuses: {says}; wanted is {ours}: have both use the same definition")]
    Refuses {
        /// Reason that it gives.
        says: String,
        /// Type there, where the reason tells it.
        theirs: Option<String>,
        /// Type here.
        ours: WireType,
    },
    /// The connection cannot be made, or broke: the error of the transport.
    #[error("{0}")]
    Transport(String),
}

impl From<String> for PeerFault {
    fn from(error: String) -> Self {
        Self::Transport(error)
    }
}

/// A route of another bridge on the way back to a source.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CarriedBack {
    /// Full name of the bridge's node on ROS 2.
    pub bridge: String,
    /// Address at which the route takes.
    pub from: String,
    /// Address to which it brings.
    pub to: String,
}
