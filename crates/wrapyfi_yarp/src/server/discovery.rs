//! Answers those who look for a name server by multicast.

use std::net::{IpAddr, Ipv4Addr, SocketAddrV4};
use std::sync::Arc;

use tokio::net::UdpSocket;

use super::registry::Registry;
use super::reply::registration;
use super::shared::ServerState;
use crate::name::multicast::{self, MAX_QUESTION};
use crate::name::{DISCOVERY_GROUP, Target};

/// A socket that hears questions, on the interface of `ip`.
pub(super) fn socket(ip: IpAddr, port: u16) -> std::io::Result<UdpSocket> {
    match ip {
        IpAddr::V4(ip) => multicast::join(ip, port),
        // The group is IPv4's.
        IpAddr::V6(ip) if ip.is_loopback() => multicast::join(Ipv4Addr::LOCALHOST, port),
        IpAddr::V6(_) => multicast::join(Ipv4Addr::UNSPECIFIED, port),
    }
}

/// Answers as long as it runs. Only queries are, and only of names that are known: a group that
/// any program may write to must not change anything, nor make us talk.
pub(super) async fn answer(socket: UdpSocket, port: u16, shared: Arc<ServerState>) {
    let group = SocketAddrV4::new(DISCOVERY_GROUP, port);
    let mut buffer = [0; MAX_QUESTION];
    loop {
        let length = match socket.recv_from(&mut buffer).await {
            Ok((length, _)) => length,
            Err(error) => {
                tracing::warn!(target: "wrapyfi_yarp::server", %error, "no longer found by multicast");
                return;
            }
        };
        let question = buffer.get(..length).unwrap_or_default();
        let reply = reply(question, &shared.state.lock().registry);
        let Some(reply) = reply else { continue }; // our own answers come back to us, too
        if let Err(error) = socket.send_to(&reply, group).await {
            tracing::debug!(target: "wrapyfi_yarp::server", %error, "multicast answer not sent");
        }
    }
}

/// Answer to a datagram; none where it is no question, no program has the name, or the answer would not read as it is
/// meant.
pub(super) fn reply(datagram: &[u8], registry: &Registry) -> Option<Vec<u8>> {
    let name = multicast::read_question(datagram)?.strip_prefix(b"query ")?;
    let name = String::from_utf8_lossy(name);
    let Target { network, name, .. } = Target::parse(name.trim());
    let found = registry.find(&name, &network)?;
    let answer = multicast::answer(&registration(&found));
    // A name, host or carrier with blanks in it, which any program may register, reads as another port.
    (multicast::read_answer(&answer).as_ref() == Some(&found)).then_some(answer)
}
