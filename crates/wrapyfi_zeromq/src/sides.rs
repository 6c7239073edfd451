//! The two ports of a broker of ours.

use std::io::ErrorKind;
use std::net::IpAddr;
use std::sync::Arc;

use super::config::{NAME, ZeroMqConfig};
use super::curve::Keys;
use super::error::BrokerError;
use super::front::{Bounds, Front};
use super::options::{self, StopSignal};
use super::supervisor::Supervised;

/// Both sides of a broker, bound, and what stops its thread.
pub(super) struct Sides {
    pub(super) ip: IpAddr,
    pub(super) ports: [u16; 2],
    pub(super) front: Front,
    pub(super) back: Front,
    pub(super) keys: Option<Arc<Keys>>,
    pub(super) stop_signal: StopSignal,
    pub(super) stop: zmq::Socket,
}

impl Sides {
    /// Binds both ports. Messages wait for a peer as far as `hwm` of its side; clients may always have `own_topic`.
    pub(super) fn bind<B: Supervised>(
        config: &ZeroMqConfig,
        hwm: [u16; 2],
        own_topic: Option<&str>,
    ) -> Result<Self, BrokerError> {
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
            let bound = Front::bind(kind, ip, port, bounds);
            let front = bound.map_err(|error| refused(ip, port, &error))?;
            let port = front.port().map_err(failed_to("learn its port"))?;
            Ok::<_, BrokerError>((front.secured(keys.clone()), port))
        };
        let ([front_kind, back_kind], [front_hwm, back_hwm]) = (B::KINDS, hwm);
        let (front, front_port) = bind(front_kind, front, front_hwm)?;
        let (back, back_port) = bind(back_kind, back, back_hwm)?;
        let (stop_signal, stop) =
            StopSignal::new(&zmq::Context::new()).map_err(failed_to("open its control socket"))?;
        let ports = [front_port, back_port];
        Ok(Self { ip, ports, front, back, keys, stop_signal, stop })
    }
}

/// Error for a port of ours that could not be bound.
fn refused(ip: IpAddr, port: u16, error: &std::io::Error) -> BrokerError {
    match error.kind() {
        ErrorKind::AddrInUse => BrokerError::PortTaken { ip, port },
        ErrorKind::AddrNotAvailable => BrokerError::NotHere { ip },
        _ => failed_to(&format!("bind {}", options::endpoint(ip, port)))(error),
    }
}

pub(super) fn failed_to<E: std::fmt::Display>(action: &str) -> impl FnOnce(E) -> BrokerError {
    let action = action.to_owned();
    move |error| BrokerError::Transport { action, reason: error.to_string() }
}
