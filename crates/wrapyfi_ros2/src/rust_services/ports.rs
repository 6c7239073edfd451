//! Ports of the participants of a domain (RTPS 2.5, 9.6.1.4), and those that RustDDS must not choose.
//!
//! ```text
//!   index 0   discovery free, data taken  ─▶ kept from RustDDS
//!   index 1   discovery free, data free   ─▶ what RustDDS takes
//! ```
//!
//! RustDDS 0.15 takes the first index whose discovery port is free. If the port for data beside it is taken, it
//! listens on any other one, but its writers go on to announce the one that it does not have: no acknowledgement
//! reaches them, so that a sample that was not heard at once is never repeated, and its call waits in vain. On Linux
//! the ports of domains from 102 on are among those that any socket may be given.

use std::net::{Ipv4Addr, UdpSocket};

/// Participants of this host that have ports of their own; Fast DDS takes as many indices.
pub(super) const PARTICIPANTS: u16 = 100;
/// First port of domain 0, ports of a domain, ports of a participant.
const PORTS: u16 = 7400;
const PORTS_OF_DOMAIN: u16 = 250;
const PORTS_OF_PARTICIPANT: u16 = 2;
/// Ports on which participant 0 hears of others, and their data, from the first of the domain.
const DISCOVERY: u16 = 10;
const DATA: u16 = 11;

/// Port of a domain on which all of its participants hear of others.
pub(super) fn multicast(domain_id: u16) -> Option<u16> {
    PORTS_OF_DOMAIN.checked_mul(domain_id)?.checked_add(PORTS)
}

/// Port on which a participant hears of others.
pub(super) fn discovery(domain_id: u16, index: u16) -> Option<u16> {
    multicast(domain_id)?.checked_add(DISCOVERY + PORTS_OF_PARTICIPANT * index)
}

/// Sockets that keep RustDDS, while they are held, from an index whose port for data is taken.
pub(super) fn keep_half_free(domain_id: u16) -> Vec<UdpSocket> {
    let bind = |port: u16| UdpSocket::bind((Ipv4Addr::UNSPECIFIED, port)).ok();
    let mut kept = Vec::new();
    for port in (0..PARTICIPANTS).map_while(|index| discovery(domain_id, index)) {
        let Some(socket) = bind(port) else { continue };
        if bind(port + (DATA - DISCOVERY)).is_some() {
            break;
        }
        kept.push(socket);
    }
    kept
}
