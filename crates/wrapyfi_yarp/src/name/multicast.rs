//! Finding a name server without any configuration.
//!
//! ```text
//!   ─▶ 224.2.1.1:10000   CRC, 0, "NAME_SERVER query /root\n"
//!   ◀─ 224.2.1.1:10000   CRC, 0, "registration name /root ip 10.0.0.1 port 10000 type tcp\n"
//! ```
//!
//! Questions and answers both go to the group, as datagrams of the mcast carrier. Only `yarp detect`
//! asks; ports read `yarp.conf`.

use std::net::{Ipv4Addr, SocketAddrV4};
use std::time::Duration;

use tokio::net::UdpSocket;

use super::reply;
use crate::port::datagrams::multicast_socket;
use crate::port::names::Registration;
use crate::wire::datagram;

/// The group on which name servers answer.
pub const DISCOVERY_GROUP: Ipv4Addr = Ipv4Addr::new(224, 2, 1, 1);

/// A question or an answer is one line.
pub(crate) const MAX_QUESTION: usize = 2048;

/// Settings of the search for a name server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NameServerSearch {
    /// The UDP port of the group: the base port of the network, 10000 nearly everywhere.
    pub port: u16,
    /// Name of the name server: the namespace.
    pub namespace: String,
    /// Interface on which to ask; any where it is unspecified.
    pub interface: Ipv4Addr,
    /// Number of questions.
    pub tries: u32,
    /// Time to wait after each question.
    pub wait: Duration,
}

impl Default for NameServerSearch {
    /// Search as `yarp detect` makes it: three questions, three quarters of a second each.
    fn default() -> Self {
        Self {
            port: super::environment::DEFAULT_PORT,
            namespace: super::conf::DEFAULT_NAMESPACE.to_owned(),
            interface: Ipv4Addr::UNSPECIFIED,
            tries: 3,
            wait: Duration::from_millis(750),
        }
    }
}

/// Asks the group where the name server is; none where no program answers. Datagrams that are no answer
/// are left out.
///
/// # Errors
/// When the system does not let us join the group.
pub async fn discover(options: &NameServerSearch) -> std::io::Result<Option<Registration>> {
    let socket = join(options.interface, options.port)?;
    let question = question(&options.namespace);
    let group = SocketAddrV4::new(DISCOVERY_GROUP, options.port);
    let mut buffer = [0; MAX_QUESTION];
    for _ in 0..options.tries {
        socket.send_to(&question, group).await?;
        let answer = tokio::time::timeout(options.wait, async {
            loop {
                let (length, _) = socket.recv_from(&mut buffer).await?;
                if let Some(found) = read_answer(buffer.get(..length).unwrap_or_default())
                    && found.name == options.namespace
                {
                    return Ok(found);
                }
            }
        });
        match answer.await {
            Ok(found) => return found.map(Some),
            Err(_) => tracing::debug!(target: "wrapyfi_yarp::name", "no name server answered"),
        }
    }
    Ok(None)
}

/// A socket that hears the group, together with all others that do.
pub(crate) fn join(interface: Ipv4Addr, port: u16) -> std::io::Result<UdpSocket> {
    let socket = multicast_socket(SocketAddrV4::new(DISCOVERY_GROUP, port), interface)?;
    socket.join_multicast_v4(&DISCOVERY_GROUP, &interface)?;
    UdpSocket::from_std(socket.into())
}

/// Question for the address of the name server called `namespace`, as a datagram.
pub(crate) fn question(namespace: &str) -> Vec<u8> {
    datagram::seal(0, format!("NAME_SERVER query {namespace}\n").as_bytes())
}

/// The command in a question; none where the datagram is something else.
pub(crate) fn read_question(bytes: &[u8]) -> Option<&[u8]> {
    let (0, line) = datagram::open(bytes).ok()? else { return None };
    let line = line.split(|&byte| byte == b'\n').next()?;
    line.strip_prefix(b"NAME_SERVER ")
}

/// An answer of one line.
pub(crate) fn answer(line: &[u8]) -> Vec<u8> {
    datagram::seal(0, &[line, b"\n"].concat())
}

/// Address of the name server; `None` where the datagram is no answer to the question.
pub(crate) fn read_answer(bytes: &[u8]) -> Option<Registration> {
    let (0, line) = datagram::open(bytes).ok()? else { return None };
    reply::registration(line.split(|&byte| byte == b'\n').next()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(hex: &str) -> Vec<u8> {
        let pairs = hex.as_bytes().chunks(2).map(|pair| std::str::from_utf8(pair).unwrap());
        pairs.map(|pair| u8::from_str_radix(pair, 16).unwrap()).collect()
    }

    #[test]
    fn questions_and_answers_are_those_of_ns_multicast_discovery() {
        let captured: serde_json::Value =
            serde_json::from_str(include_str!("../../tests/golden/ns_multicast_discovery.json"))
                .unwrap();
        let hex = |at: usize| bytes(captured["datagrams"][at]["hex"].as_str().unwrap());
        assert_eq!(question("/root"), hex(0));
        assert_eq!(read_question(&hex(0)), Some(&b"query /root"[..]));
        let found = read_answer(&hex(1)).unwrap();
        assert_eq!(
            (found.name.as_str(), found.host.as_str(), found.port),
            ("/root", "127.0.0.1", 10_000)
        );
        let line = b"registration name /root ip 127.0.0.1 port 10000 type tcp";
        assert_eq!(answer(line), hex(1));
        // Wake-up packets are neither.
        assert_eq!((read_question(&hex(2)), read_answer(&hex(2))), (None, None));
        assert_eq!((read_question(b""), read_answer(&[0; 7])), (None, None));
    }
}
