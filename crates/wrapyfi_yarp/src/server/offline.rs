//! A name server without sockets and clock, for tests and fuzzing: no part of the interface.

use std::net::{IpAddr, Ipv4Addr};
use std::time::Duration;

use super::commands::{Asker, NameState};
use super::discovery;
use super::options::NameServerLimits;
use crate::WireLimits;
use crate::port::names::Registration;

/// A name server that is asked by calls.
#[derive(Debug)]
pub struct Offline {
    state: NameState,
    limits: WireLimits,
    now: Duration,
}

impl Offline {
    /// A fresh one, at 127.0.0.1:10000.
    pub fn new(kept: NameServerLimits, limits: WireLimits) -> Self {
        let own = Registration {
            name: "/root".to_owned(),
            host: "127.0.0.1".to_owned(),
            port: 10_000,
            carrier: "tcp".to_owned(),
        };
        Self { state: NameState::new(&own, 10_000, kept), limits, now: Duration::ZERO }
    }

    /// Answer of the name server to a line of the text carriers.
    pub fn ask(&mut self, line: &[u8]) -> Vec<u8> {
        self.now += Duration::from_secs(1);
        let asker = Asker {
            address: Some(IpAddr::V4(Ipv4Addr::LOCALHOST)),
            now: self.now,
            busy: |_| false,
        };
        self.state.apply_text(line, asker, &self.limits).reply.to_text()
    }

    /// Answer of the name server to a datagram of its multicast group.
    #[must_use]
    pub fn hear(&self, datagram: &[u8]) -> Option<Vec<u8>> {
        discovery::reply(datagram, &self.state.registry)
    }

    /// Number of names.
    pub fn names(&self) -> usize {
        self.state.registry.len()
    }
}

/// Addresses of the ports that a client reads from the answer to a one-line request; `None` where
/// the answer does not end or exceeds a limit.
pub fn read_answer(bytes: &[u8], limits: &WireLimits) -> Option<Vec<Registration>> {
    crate::name::read_answer(bytes, limits)
}

/// Name server that a program which looks for one finds in a datagram of the group.
pub fn read_found(datagram: &[u8]) -> Option<Registration> {
    crate::name::multicast::read_answer(datagram)
}
