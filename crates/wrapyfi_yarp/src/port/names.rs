//! Resolution of port names to addresses: the seam to a name server, and a table for those without.
//!
//! ```text
//!   ports ──register, announce, query, unregister──▶ dyn Names ◀── client of a real name server
//!                                                         ▲
//!                                                  NameTable: addresses in this process
//! ```

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::pin::Pin;

use crate::name::NameError;
use wrapyfi_retry::Mutex;

/// A future in a box: what lets [`Names`] be an object.
pub type Later<'a, T> = Pin<Box<dyn Future<Output = Result<T, NameError>> + Send + 'a>>;

/// Entry of a port at a name server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Registration {
    /// `/name`.
    pub name: String,
    /// Address or host.
    pub host: String,
    /// Number; 0 from [`NameTable`] for "take any and register it".
    pub port: u16,
    /// `tcp`, or `mcast` for groups.
    pub carrier: String,
}

/// Demands of a new registration.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct NameRequest {
    /// `/name`, or `...` for one that the server chooses.
    pub name: String,
    /// `tcp` when `None`.
    pub carrier: Option<String>,
    /// The address that others reach it at; the server takes the one it sees when `None`.
    pub host: Option<String>,
    /// The number; the server chooses when `None`.
    pub port: Option<u16>,
}

/// A name server, as ports need it. Each call is one request, bounded in time by whoever implements
/// it.
pub trait Names: Send + Sync + 'static {
    /// Registers a name; one that exists is replaced.
    fn register<'a>(&'a self, request: &'a NameRequest) -> Later<'a, Registration>;

    /// The port of a name; `None` when it is unknown.
    fn query<'a>(&'a self, name: &'a str) -> Later<'a, Option<Registration>>;

    /// Forgets a name.
    fn unregister<'a>(&'a self, name: &'a str) -> Later<'a, ()>;

    /// Says that a port lives, or seems dead: makes persistent connections happen.
    fn announce<'a>(&'a self, name: &'a str, alive: bool) -> Later<'a, ()>;

    /// Sets a property of a name.
    fn set<'a>(&'a self, name: &'a str, key: &'a str, values: &'a [String]) -> Later<'a, ()>;

    /// The values of a property; none when there is none.
    fn get<'a>(&'a self, name: &'a str, key: &'a str) -> Later<'a, Vec<String>>;
}

#[derive(Debug, Default)]
struct Table {
    ports: BTreeMap<String, Registration>,
    properties: BTreeMap<(String, String), Vec<String>>,
    anonymous: u32,
    groups: u8,
}

/// Names in this process alone: fixed addresses, and ports that register here.
#[derive(Debug, Default)]
pub struct NameTable(Mutex<Table>);

impl NameTable {
    /// An empty table.
    pub fn new() -> Self {
        Self::default()
    }

    /// The table with a port at a fixed address.
    #[must_use]
    pub fn with(self, name: &str, address: SocketAddr) -> Self {
        self.insert(name, address);
        self
    }

    /// Adds a port at a fixed address.
    pub fn insert(&self, name: &str, address: SocketAddr) {
        let registration = Registration {
            name: name.to_owned(),
            host: address.ip().to_string(),
            port: address.port(),
            carrier: "tcp".to_owned(),
        };
        self.0.lock().ports.insert(name.to_owned(), registration);
    }
}

/// A number that no UDP socket of this machine has.
fn free_number() -> u16 {
    let socket = std::net::UdpSocket::bind((std::net::Ipv4Addr::UNSPECIFIED, 0));
    socket.and_then(|socket| socket.local_addr()).map_or(11_000, |address| address.port())
}

impl Names for NameTable {
    fn register<'a>(&'a self, request: &'a NameRequest) -> Later<'a, Registration> {
        let mut table = self.0.lock();
        let name = if request.name == "..." {
            table.anonymous += 1;
            format!("/tmp/port/{}", table.anonymous)
        } else {
            request.name.clone()
        };
        let carrier = request.carrier.clone().unwrap_or_else(|| "tcp".to_owned());
        let (host, port) = if carrier == "mcast" {
            table.groups = table.groups.wrapping_add(1);
            // Other processes with tables of their own have the same groups, and other numbers.
            let port = request.port.unwrap_or_else(free_number);
            (format!("224.1.1.{}", table.groups.max(1)), port)
        } else {
            let host = request.host.clone().unwrap_or_else(|| "127.0.0.1".to_owned());
            (host, request.port.unwrap_or(0))
        };
        let registration = Registration { name: name.clone(), host, port, carrier };
        table.ports.insert(name, registration.clone());
        Box::pin(async { Ok(registration) })
    }

    fn query<'a>(&'a self, name: &'a str) -> Later<'a, Option<Registration>> {
        let found = self.0.lock().ports.get(name).cloned();
        Box::pin(async { Ok(found) })
    }

    fn unregister<'a>(&'a self, name: &'a str) -> Later<'a, ()> {
        self.0.lock().ports.remove(name);
        Box::pin(async { Ok(()) })
    }

    fn announce<'a>(&'a self, _name: &'a str, _alive: bool) -> Later<'a, ()> {
        Box::pin(async { Ok(()) })
    }

    fn set<'a>(&'a self, name: &'a str, key: &'a str, values: &'a [String]) -> Later<'a, ()> {
        self.0.lock().properties.insert((name.to_owned(), key.to_owned()), values.to_vec());
        Box::pin(async { Ok(()) })
    }

    fn get<'a>(&'a self, name: &'a str, key: &'a str) -> Later<'a, Vec<String>> {
        let key = (name.to_owned(), key.to_owned());
        let values = self.0.lock().properties.get(&key).cloned().unwrap_or_default();
        Box::pin(async { Ok(values) })
    }
}
