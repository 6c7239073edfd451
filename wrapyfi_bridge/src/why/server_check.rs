//! A server that has to answer before anything else can: the broker, the name server, the master.

use std::io::ErrorKind;
use std::net::{IpAddr, SocketAddr, TcpStream};
use std::sync::Arc;
use std::time::Duration;

use wrapyfi_endpoint::network::{Hosts, is_of_this_machine};

use crate::middlewares::{Server, ServerAddress};

/// Longest time that a connection may take to be accepted.
const CONNECT: Duration = Duration::from_millis(800);

/// First and last byte of what a ZeroMQ socket begins with, and its length.
const SIGNATURE: (u8, u8, usize) = (0xff, 0x7f, 10);

/// Result of connecting to an address.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ConnectOutcome {
    /// The peer accepted the connection.
    Open,
    /// The host has no address here; the text has the cause and the remedy.
    Unresolved(String),
    /// The machine answers that no program listens there.
    Refused,
    /// Nothing came back.
    Silent,
    /// The peer accepted the connection, and did not answer on it.
    AcceptsOnly,
    /// Another program has the port of a broker, in words.
    Foreign(String),
    /// No way leads there, in the system's words.
    NoWay(String),
}

/// A server, and what happened when this program connected to it.
#[derive(Debug, Clone)]
pub struct ServerCheck {
    /// The server.
    pub address: ServerAddress,
    /// Result of connecting to it.
    pub answer: ConnectOutcome,
    /// True where the host is this machine.
    pub is_here: bool,
    /// Connection on which a ZeroMQ broker greets.
    pub greeting: Option<Arc<TcpStream>>,
}

impl ServerCheck {
    /// Connects to a server.
    #[must_use]
    pub fn at(address: ServerAddress, hosts: &Hosts) -> Self {
        // A broker that is bound to all interfaces is reached through loopback.
        let host = if address.host == "*" { "127.0.0.1" } else { &address.host };
        let (answer, ip, stream) = connected(host, address.port, hosts);
        let is_here = ip.is_some_and(is_of_this_machine);
        let is_broker = matches!(address.server, Server::Broker | Server::ServiceBroker);
        let greeting = stream.filter(|it| is_broker && it.set_nonblocking(true).is_ok());
        Self { address, answer, is_here, greeting: greeting.map(Arc::new) }
    }

    /// True once a ZeroMQ socket has greeted, which it does as soon as it has time for us.
    pub fn has_greeted(&self) -> bool {
        let (first, last, length) = SIGNATURE;
        let mut begun = [0; SIGNATURE.2];
        let count = self.greeting.as_ref().and_then(|it| it.peek(&mut begun).ok());
        count == Some(length) && begun.first() == Some(&first) && begun.last() == Some(&last)
    }

    /// Asks what has the port of a broker of topics, where a program accepts connections.
    pub fn ask_kind(&mut self) {
        let is_broker =
            self.address.server == Server::Broker && self.answer == ConnectOutcome::Open;
        let stream = self.greeting.as_ref().filter(|_| is_broker);
        let Some(at) = stream.and_then(|it| it.peer_addr().ok()) else { return };
        let answer = wrapyfi_zeromq::what_has(at);
        let is_foreign = match &answer {
            wrapyfi_zeromq::PortHolder::Socket(kind) => {
                !matches!(kind.as_str(), "XPUB" | "PUB" | "XSUB" | "SUB")
            }
            answer => *answer == wrapyfi_zeromq::PortHolder::NotZeroMq,
        };
        if is_foreign {
            self.answer = ConnectOutcome::Foreign(answer.to_string());
        }
    }

    /// Server in words, with its address.
    pub fn words(&self) -> String {
        let ServerAddress { server, host, port, .. } = &self.address;
        format!("{server} {host}:{port}")
    }
}

/// Connects to a host, and closes at once.
pub fn connect(host: &str, port: u16, hosts: &Hosts) -> ConnectOutcome {
    connected(host, port, hosts).0
}

fn connected(
    host: &str,
    port: u16,
    hosts: &Hosts,
) -> (ConnectOutcome, Option<IpAddr>, Option<TcpStream>) {
    let ip = match resolve(host, hosts) {
        Ok(ip) if ip.is_unspecified() => IpAddr::from([127, 0, 0, 1]),
        Ok(ip) => ip,
        Err(reason) => return (ConnectOutcome::Unresolved(reason), None, None),
    };
    let answer = match TcpStream::connect_timeout(&SocketAddr::new(ip, port), CONNECT) {
        Ok(stream) => return (ConnectOutcome::Open, Some(ip), Some(stream)),
        Err(error) => match error.kind() {
            ErrorKind::ConnectionRefused => ConnectOutcome::Refused,
            // The system accepts for a program that is stopped, until as many wait as it may have.
            ErrorKind::TimedOut | ErrorKind::WouldBlock if is_of_this_machine(ip) => {
                ConnectOutcome::AcceptsOnly
            }
            ErrorKind::TimedOut | ErrorKind::WouldBlock => ConnectOutcome::Silent,
            _ => ConnectOutcome::NoWay(error.to_string()),
        },
    };
    (answer, Some(ip), None)
}

/// Resolves a host, as long as that takes no longer than a connection may: a name server of the system
/// that is away would keep everybody waiting.
fn resolve(host: &str, hosts: &Hosts) -> Result<IpAddr, String> {
    let (tell, told) = std::sync::mpsc::channel();
    let (asked, known) = (host.to_owned(), hosts.clone());
    let thread = std::thread::Builder::new().name("resolve".to_owned());
    let resolve = move || {
        // No caller waits any more, perhaps.
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
    use crate::middlewares::Reach;

    #[test]
    fn doors_are_open_closed_or_nowhere() {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let hosts = Hosts::default();
        assert_eq!(connect("127.0.0.1", port, &hosts), ConnectOutcome::Open);
        drop(listener);
        assert_eq!(connect("127.0.0.1", port, &hosts), ConnectOutcome::Refused);
        let answer = connect("no-such-host.invalid", port, &hosts);
        assert!(matches!(answer, ConnectOutcome::Unresolved(_)), "{answer:?}");
    }

    #[test]
    fn a_socket_of_zeromq_greets_and_another_program_does_not() {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let host = "127.0.0.1".to_owned();
        let (server, start) = (Server::Broker, String::new());
        let reach = Reach::default();
        let address = ServerAddress { server, host, port, is_own: false, start, reach };
        for (said, is_greeting) in [
            (&b"\xff\0\0\0\0\0\0\0\x01\x7f\x03"[..], true),
            (b"HTTP/1.1 400", false),
            (b"\xff", false),
        ] {
            let check = ServerCheck::at(address.clone(), &Hosts::default());
            assert!(!check.has_greeted());
            let (mut peer, _) = listener.accept().unwrap();
            std::io::Write::write_all(&mut peer, said).unwrap();
            let begin = std::time::Instant::now();
            while check.has_greeted() != is_greeting && begin.elapsed() < CONNECT {
                std::thread::sleep(Duration::from_millis(1));
            }
            assert_eq!(check.has_greeted(), is_greeting, "{said:?}");
        }
    }
}
