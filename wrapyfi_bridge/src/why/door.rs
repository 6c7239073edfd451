//! A server that has to answer before anything else can: the broker, the name server, the master.

use std::io::ErrorKind;
use std::net::{IpAddr, SocketAddr, TcpStream};
use std::time::Duration;

use wrapyfi_core::network::{Hosts, is_of_this_machine};

use crate::middlewares::{Door, Server};

/// Longest time that a connection may take to be accepted.
const CONNECT: Duration = Duration::from_millis(800);

/// Result of connecting to an address.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Answer {
    /// Somebody accepted the connection.
    Open,
    /// The host has no address here; the text has the cause and the remedy.
    Unresolved(String),
    /// The machine answers that nobody listens there.
    Refused,
    /// Nothing came back.
    Silent,
    /// No way leads there, in the system's words.
    NoWay(String),
}

/// A server, and what happened when somebody connected to it.
#[derive(Debug, Clone)]
pub struct Knock {
    /// The server.
    pub door: Door,
    /// Result of connecting to it.
    pub answer: Answer,
    /// True where the host is this machine.
    pub is_here: bool,
}

impl Knock {
    /// Connects to a server, and closes at once.
    #[must_use]
    pub fn at(door: Door, hosts: &Hosts) -> Self {
        // A broker that is bound to all interfaces is reached through loopback.
        let host = if door.host == "*" { "127.0.0.1" } else { &door.host };
        let (answer, ip) = connect(host, door.port, hosts);
        let is_here = ip.is_some_and(is_of_this_machine);
        Self { door, answer, is_here }
    }

    /// Server in words, with its address.
    #[must_use]
    pub fn words(&self) -> String {
        let Door { server, host, port, .. } = &self.door;
        format!("{} {host}:{port}", name(*server))
    }
}

/// Name of a server.
#[must_use]
pub fn name(server: Server) -> &'static str {
    match server {
        Server::Broker => "ZeroMQ broker",
        Server::ServiceBroker => "ZeroMQ broker of services",
        Server::NameServer => "YARP name server",
        Server::Master => "ROS 1 master",
    }
}

/// Connects to a host, and closes at once; with the host's address where it has one.
#[must_use]
pub fn connect(host: &str, port: u16, hosts: &Hosts) -> (Answer, Option<IpAddr>) {
    let ip = match resolve(host, hosts) {
        Ok(ip) if ip.is_unspecified() => IpAddr::from([127, 0, 0, 1]),
        Ok(ip) => ip,
        Err(reason) => return (Answer::Unresolved(reason), None),
    };
    let answer = match TcpStream::connect_timeout(&SocketAddr::new(ip, port), CONNECT) {
        Ok(_closed) => Answer::Open,
        Err(error) => match error.kind() {
            ErrorKind::ConnectionRefused => Answer::Refused,
            ErrorKind::TimedOut | ErrorKind::WouldBlock => Answer::Silent,
            _ => Answer::NoWay(error.to_string()),
        },
    };
    (answer, Some(ip))
}

/// Resolves a host, as long as that takes no longer than a connection may: a name server of the system
/// that is away would keep everybody waiting.
fn resolve(host: &str, hosts: &Hosts) -> Result<IpAddr, String> {
    let (tell, told) = std::sync::mpsc::channel();
    let (asked, known) = (host.to_owned(), hosts.clone());
    let thread = std::thread::Builder::new().name("resolve".to_owned());
    let resolve = move || {
        // Nobody waits any more, perhaps.
        _ = tell.send(known.resolve(&asked));
    };
    match thread.spawn(resolve) {
        Ok(_thread) => told.recv_timeout(CONNECT).unwrap_or_else(|_late| {
            Err(Hosts::unresolved(host, &"no answer from the system's name service"))
        }),
        Err(error) => Err(error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doors_are_open_closed_or_nowhere() {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let hosts = Hosts::default();
        assert_eq!(connect("127.0.0.1", port, &hosts).0, Answer::Open);
        drop(listener);
        assert_eq!(connect("127.0.0.1", port, &hosts).0, Answer::Refused);
        let (answer, ip) = connect("no-such-host.invalid", port, &hosts);
        assert!(matches!(answer, Answer::Unresolved(_)) && ip.is_none(), "{answer:?}");
    }
}
