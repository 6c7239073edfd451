//! A table of names in place of a name server.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::Mutex;

use wrapyfi_yarp::port::names::{Later, NameRequest, Names, Registration};

#[derive(Debug, Default)]
struct Table {
    ports: BTreeMap<String, Registration>,
    properties: BTreeMap<(String, String), Vec<String>>,
    anonymous: u32,
    groups: u8,
}

/// Names in this process alone: fixed addresses, and ports that register here.
#[derive(Debug, Default)]
pub(crate) struct NameTable(Mutex<Table>);

impl NameTable {
    /// An empty table.
    pub(crate) fn new() -> Self {
        Self::default()
    }

    /// The table with a port at a fixed address.
    #[must_use]
    pub(crate) fn with(self, name: &str, address: SocketAddr) -> Self {
        self.insert(name, address);
        self
    }

    /// Adds a port at a fixed address.
    pub(crate) fn insert(&self, name: &str, address: SocketAddr) {
        let registration = Registration {
            name: name.to_owned(),
            host: address.ip().to_string(),
            port: address.port(),
            carrier: "tcp".to_owned(),
        };
        self.0.lock().unwrap().ports.insert(name.to_owned(), registration);
    }
}

/// A number that no UDP socket of this machine has.
fn free_number() -> u16 {
    let socket = std::net::UdpSocket::bind((std::net::Ipv4Addr::UNSPECIFIED, 0));
    socket.and_then(|socket| socket.local_addr()).map_or(11_000, |address| address.port())
}

impl Names for NameTable {
    fn register<'a>(&'a self, request: &'a NameRequest) -> Later<'a, Registration> {
        let mut table = self.0.lock().unwrap();
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
        let found = self.0.lock().unwrap().ports.get(name).cloned();
        Box::pin(async { Ok(found) })
    }

    fn unregister<'a>(&'a self, name: &'a str) -> Later<'a, ()> {
        self.0.lock().unwrap().ports.remove(name);
        Box::pin(async { Ok(()) })
    }

    fn announce<'a>(&'a self, _name: &'a str, _alive: bool) -> Later<'a, ()> {
        Box::pin(async { Ok(()) })
    }

    fn set<'a>(&'a self, name: &'a str, key: &'a str, values: &'a [String]) -> Later<'a, ()> {
        self.0
            .lock()
            .unwrap()
            .properties
            .insert((name.to_owned(), key.to_owned()), values.to_vec());
        Box::pin(async { Ok(()) })
    }

    fn get<'a>(&'a self, name: &'a str, key: &'a str) -> Later<'a, Vec<String>> {
        let key = (name.to_owned(), key.to_owned());
        let values = self.0.lock().unwrap().properties.get(&key).cloned().unwrap_or_default();
        Box::pin(async { Ok(values) })
    }
}
