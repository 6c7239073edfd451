//! Opening of a port: its name, its socket, and who is told.
//!
//! ```text
//!   listen ─▶ number ─▶ register ─▶ set offers, accepts, ips, process ─▶ announce
//! ```

use std::fmt;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

use tokio::net::TcpListener;

use super::names::{NameRequest, Registration};
use super::network::Network;
use super::outbox::Overflow;
use crate::name::NameError;
use crate::name::environment::{EnvironmentError, PortNaming};
use crate::wire::{Carrier, Fault};

/// Address that a port listens on, its registration, and how it keeps messages for its targets.
#[derive(Debug, Clone)]
pub struct PortOptions {
    /// Listen here, instead of at any free number.
    pub address: Option<SocketAddr>,
    /// Register the name.
    pub register: bool,
    /// Tell those who ask what the port is that it answers requests, as YARP's `setRpcMode` does.
    pub rpc: bool,
    /// Take connections of carrier mjpeg. It brings nothing if the messages are no pictures: such a
    /// connection is then refused, and the log says why.
    pub pictures: bool,
    /// Programs that may connect to the port; everybody where there is none.
    pub senders: Option<Admission>,
    /// Ports that the port may send to; every port where there is none.
    pub readers: Option<Admission>,
    /// Most messages that wait for one target, at least 1.
    pub queue: usize,
    /// Message that gives way when the queue is full.
    pub overflow: Overflow,
}

/// Test of the name and the address of the program at the other end of a connection.
#[derive(Clone)]
pub struct Admission(Arc<Test>);

type Test = dyn Fn(&str, &str) -> bool + Send + Sync;

impl Admission {
    /// Admits programs for which `test` of their name and address is true.
    pub fn new(test: impl Fn(&str, &str) -> bool + Send + Sync + 'static) -> Self {
        Self(Arc::new(test))
    }

    /// Lets a program in.
    ///
    /// # Errors
    /// [`Fault::NotAdmitted`] where it is none of those that are admitted.
    pub(super) fn check(this: Option<&Self>, name: &str, address: &str) -> Result<(), Fault> {
        match this {
            Some(Self(test)) if !test(name, address) => {
                Err(Fault::NotAdmitted { name: name.to_owned(), address: address.to_owned() })
            }
            _ => Ok(()),
        }
    }
}

/// Two tests are the same where one is a copy of the other.
impl fmt::Debug for Admission {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Admission")
    }
}

impl Default for PortOptions {
    fn default() -> Self {
        let (rpc, pictures) = (false, true);
        let (address, senders, readers) = (None, None, None);
        let (queue, overflow) = (16, Overflow::default());
        Self { address, register: true, rpc, pictures, senders, readers, queue, overflow }
    }
}

/// Error of opening a port.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The name is none.
    #[error(
        "{name:?} is no port name: it begins with a slash and has no blanks, no slash at its end and \
         at most {limit} bytes, or is `...` for a name that the server chooses"
    )]
    Name {
        /// Name as given.
        name: String,
        /// Most bytes.
        limit: usize,
    },
    /// A port of that name lives.
    #[error("a port {0} lives already: close it, or take another name")]
    Taken(String),
    /// A variable of the environment cannot be followed.
    #[error(transparent)]
    Environment(#[from] EnvironmentError),
    /// The name server did not register it.
    #[error("cannot register port {name}: {error}")]
    Register {
        /// The port.
        name: String,
        /// Error of the name server.
        error: NameError,
    },
    /// The address cannot be listened on.
    #[error("port {name} cannot listen on {address}: {error}")]
    Listen {
        /// The port.
        name: String,
        /// Address that was tried.
        address: SocketAddr,
        /// Error of the system.
        error: io::Error,
    },
}

/// Name and address of a port that listens.
#[derive(Debug)]
pub(crate) struct Opened {
    pub(crate) name: String,
    pub(crate) address: SocketAddr,
    /// Address as others know it: host and number.
    pub(crate) contact: String,
    /// Number that peers are told.
    pub(crate) number: u16,
}

/// Registers and listens.
pub(super) async fn open(
    network: &Network,
    name: &str,
    options: &PortOptions,
) -> Result<(Opened, TcpListener), OpenError> {
    let limit = network.limits().max_name_bytes;
    let anonymous = name == "...";
    let well_formed = name.len() > 1
        && name.len() <= limit
        && name.starts_with('/')
        && !name.ends_with('/')
        && !name.contains(|letter: char| letter.is_whitespace() || "()\"\\,".contains(letter));
    if !anonymous && !well_formed {
        return Err(OpenError::Name { name: name.to_owned(), limit });
    }
    let shared = &*network.0;
    let naming = match options.register {
        true => shared.environment.port_naming(name)?,
        // No program hears of it.
        false => PortNaming { name: name.to_owned(), port: None },
    };
    let name = naming.name.as_str();
    if options.register && !anonymous && network.exists(name).await {
        return Err(OpenError::Taken(name.to_owned()));
    }
    let host = match &shared.host {
        Some(host) => Some(host.clone()),
        None => shared.environment.own_ip(None)?.map(|ip| ip.to_string()),
    };
    // Any free number, and that is registered: those that a name server gives away are given away again
    // when it is started anew, and a program that is told one where we listen does not start.
    let any = || SocketAddr::new(shared.listen, naming.port.unwrap_or(0));
    let wanted = options.address.unwrap_or_else(any);
    let failed = |error| OpenError::Listen { name: name.to_owned(), address: wanted, error };
    let listener = TcpListener::bind(wanted).await.map_err(failed)?;
    let address = listener.local_addr().map_err(failed)?;
    let mut registered = None;
    if options.register {
        let own_host = (!address.ip().is_unspecified()).then(|| address.ip().to_string());
        let request = NameRequest {
            name: name.to_owned(),
            host: host.or(own_host),
            port: Some(address.port()),
            ..NameRequest::default()
        };
        let answer = shared.names.register(&request).await;
        let failed = |error| OpenError::Register { name: name.to_owned(), error };
        registered = Some(answer.map_err(failed)?);
    }
    let (name, host) = match registered {
        Some(Registration { name, host, .. }) => (name, host),
        None => (name.to_owned(), address.ip().to_string()),
    };
    let number = address.port();
    let contact = format!("{host}:{number}");
    Ok((Opened { name, address, contact, number }, listener))
}

/// Tells what the port can do, and that it lives. Nothing depends on it but tools that look, and
/// persistent connections: what fails is said to the log.
pub(super) async fn announce(network: &Network, name: &str, host: IpAddr) {
    let names = network.names();
    let carriers: Vec<String> = Carrier::ALL.map(|carrier| carrier.name().to_owned()).into();
    let process = vec![std::process::id().to_string()];
    let ips = if host.is_unspecified() { Vec::new() } else { vec![host.to_string()] };
    let properties =
        [("offers", &carriers), ("accepts", &carriers), ("ips", &ips), ("process", &process)];
    for (key, values) in properties.into_iter().filter(|(_, values)| !values.is_empty()) {
        if let Err(error) = names.set(name, key, values).await {
            tracing::debug!(target: "wrapyfi_yarp::port", name, key, %error, "property not set");
        }
    }
    if let Err(error) = names.announce(name, true).await {
        tracing::warn!(target: "wrapyfi_yarp::port", name, %error, "port not announced");
    }
}
