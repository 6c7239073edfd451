//! The two ports of a broker of ours.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::net::{IpAddr, SocketAddr};
use std::os::fd::AsFd as _;
use std::sync::Arc;
use std::time::{Duration, Instant};

use mio::Registry;

use super::config::{NAME, ZeroMqConfig};
use super::curve::Keys;
use super::error::BrokerError;
use super::front::{self, Bounds, Front};
use super::ledger::Ledger;
use super::options;
use super::supervisor::Supervised;
use super::turns::Stop;
use wrapyfi_endpoint::give_memory_back;
use wrapyfi_endpoint::network::owner;

/// Both ports of a broker, bound.
pub(super) struct BrokerPorts {
    pub(super) front: Front,
    pub(super) back: Front,
    pub(super) ledger: Arc<Ledger>,
}

/// A broker before its thread runs.
pub(super) struct Bound {
    pub(super) ip: IpAddr,
    pub(super) ports: [u16; 2],
    pub(super) keys: Option<Arc<Keys>>,
}

impl BrokerPorts {
    /// Binds both ports. Messages wait for a peer as far as `hwm` of its side; clients may always have `own_topic`.
    pub(super) fn bind<B: Supervised>(
        config: &ZeroMqConfig,
        hwm: [u16; 2],
        own_topic: Option<&str>,
        ledger: &Arc<Ledger>,
    ) -> Result<(Self, Bound), BrokerError> {
        let keys = config.curve.as_ref().map(|curve| Keys::load(curve, true, own_topic));
        let keys = keys.transpose()?;
        let ip = config.address()?;
        // Others may reach it where that is allowed, or where only known clients are taken.
        if !keys.as_ref().is_some_and(|keys| keys.has_list()) {
            config.insecure.check(NAME, "a broker", ip)?;
        }
        let [front, back] = B::ports(config);
        if front == back && front != 0 {
            return Err(BrokerError::SamePort { port: front, names: B::SETTINGS });
        }
        let bind = |kind, port, hwm| {
            let bounds = Bounds {
                hwm,
                message_bytes: config.max_frame_bytes,
                connections: config.max_connections,
            };
            let bound = Front::bind(kind, ip, port, bounds, keys.clone());
            let front = bound.map_err(|error| refused(ip, port, &error))?;
            let port = front.port().map_err(failed_to("learn its port"))?;
            Ok::<_, BrokerError>((front, port))
        };
        let ([front_kind, back_kind], [front_hwm, back_hwm]) = (B::KINDS, hwm);
        let (front, front_port) = bind(front_kind, front, front_hwm)?;
        let (back, back_port) = bind(back_kind, back, back_hwm)?;
        let bound = Bound { ip, ports: [front_port, back_port], keys };
        Ok((Self { front, back, ledger: Arc::clone(ledger) }, bound))
    }

    /// Wait for something to happen at a port, for `wait_ms` at most.
    pub(super) fn waits(&self, time: Duration) -> Wait {
        let ports = [&self.front, &self.back];
        Wait { ports: ports.map(Front::registry), unread: ports.map(Front::is_unread), time }
    }

    /// Looks for peers that are dead, and gives memory back.
    pub(super) fn tick(&mut self, now: Instant) {
        self.front.tick(now);
        self.back.tick(now);
        give_memory_back(now);
    }

    /// Counts who was refused at the endpoints of this process. Number of connections that were refused or ended, by
    /// reason.
    pub(super) fn settle(&mut self) -> BTreeMap<&'static str, u64> {
        for refusal in self.front.refusals.drain(..).chain(self.back.refusals.drain(..)) {
            self.ledger.refused(&refusal);
        }
        front::cuts([&self.front, &self.back])
    }
}

/// Wait for something to happen at a port.
pub(super) struct Wait {
    ports: [Arc<Registry>; 2],
    /// Sides with more to be read, which are not waited for.
    unread: [bool; 2],
    time: Duration,
}

impl Wait {
    /// The ports where something happened, `None` when it is time to stop.
    pub(super) fn on(self, stop: &Stop) -> std::io::Result<Option<[bool; 2]>> {
        let [front_unread, back_unread] = self.unread;
        let time = if front_unread || back_unread { Duration::ZERO } else { self.time };
        let [front, back] = &self.ports;
        let [front, back, stop] =
            options::readable([front.as_fd(), back.as_fd(), stop.as_fd()], time)?;
        Ok((!stop).then_some([front || front_unread, back || back_unread]))
    }
}

/// Error for a port of ours that could not be bound.
fn refused(ip: IpAddr, port: u16, error: &std::io::Error) -> BrokerError {
    match error.kind() {
        ErrorKind::AddrInUse => BrokerError::PortTaken { ip, port, owner: owner(port) },
        ErrorKind::AddrNotAvailable => BrokerError::NotHere(ip),
        _ => failed_to(&format!("bind {}", options::endpoint(SocketAddr::new(ip, port))))(error),
    }
}

pub(super) fn failed_to<E: std::fmt::Display>(action: &str) -> impl Fn(E) -> BrokerError {
    move |error| BrokerError::Transport(format!("{action}: {error}"))
}
