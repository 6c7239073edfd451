//! Sees to it that there is a broker.
//!
//! ```text
//!   start: bind ──ok──▶ our own
//!           └─ taken ──▶ probe ── XPUB and XSUB ──▶ somebody else's ── it dies ──▶ bind again …
//!                          └─ anything else ──▶ StartError: what has the port
//! ```

use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::StartError;
use super::broker::{Broker, BrokerConfig, BrokerError};
use super::config::{BrokerMode, ZeroMqConfig, reachable};
use super::link::{self, BrokerLink, Watch};
use super::options::{self, Bell};
use super::probe::{Answer, probe};
use crate::Limits;

/// How long two processes that start at once, or one that is just ending, may leave the two ports
/// in different hands.
const SETTLING: Duration = Duration::from_secs(2);

/// Our broker, if we run one, and the thread that takes over from a foreign one.
pub(super) struct Keeper {
    broker: Arc<Mutex<Option<Broker>>>,
    bell: Option<Bell>,
    thread: Option<JoinHandle<()>>,
}

enum Found {
    Own(Broker),
    Foreign { may_take_over: bool },
}

impl Keeper {
    /// Runs the broker, or finds the one that is there.
    pub(super) fn start(config: &ZeroMqConfig, ip: IpAddr) -> Result<Self, StartError> {
        let found = match config.broker {
            BrokerMode::Embedded => settle(&config.broker_config(), ip)?,
            BrokerMode::Foreign => Found::Foreign { may_take_over: false },
        };
        let mut keeper = Self { broker: Arc::default(), bell: None, thread: None };
        match found {
            Found::Own(broker) => *keeper.lock() = Some(broker),
            Found::Foreign { may_take_over: false } => {}
            Found::Foreign { may_take_over: true } => keeper.guard(config.broker_config(), ip)?,
        }
        Ok(keeper)
    }

    /// Looks at our own broker, if we run one.
    pub(super) fn own<T>(&self, look: impl FnOnce(&Broker) -> T) -> Option<T> {
        self.lock().as_ref().map(look)
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Option<Broker>> {
        self.broker.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn guard(&mut self, config: BrokerConfig, ip: IpAddr) -> Result<(), StartError> {
        let context = zmq::Context::new();
        let (bell, ears) = Bell::new(&context)?;
        let guard = Guard::new(&context, config, ip, ears, Arc::clone(&self.broker))?;
        self.bell = Some(bell);
        self.thread = Some(
            std::thread::Builder::new()
                .name("zeromq-guard".to_owned())
                .spawn(move || {
                    if let Err(error) = guard.run() {
                        tracing::error!(%error, "nobody watches the foreign ZeroMQ broker now");
                    }
                })
                .map_err(|error| StartError::Transport { reason: error.to_string() })?,
        );
        Ok(())
    }
}

impl Drop for Keeper {
    fn drop(&mut self) {
        if let Some(bell) = &self.bell {
            bell.ring();
        }
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread that watches the ZeroMQ broker panicked");
        }
    }
}

/// Binds, or finds out who has the ports.
fn settle(config: &BrokerConfig, ip: IpAddr) -> Result<Found, StartError> {
    let give_up_at = Instant::now() + SETTLING;
    loop {
        let refusal = match Broker::start(config) {
            Ok(broker) => return Ok(Found::Own(broker)),
            Err(BrokerError::NotHere { ip }) => {
                tracing::info!(%ip, "not an address of this machine: using the broker there");
                return Ok(Found::Foreign { may_take_over: false });
            }
            Err(refusal @ (BrokerError::PortTaken { .. } | BrokerError::NotLoopback { .. })) => {
                refusal
            }
            Err(other) => return Err(other.into()),
        };
        let may_take_over = matches!(refusal, BrokerError::PortTaken { .. });
        if !may_take_over && !is_here(ip) {
            tracing::info!(%ip, "not an address of this machine: using the broker there");
            return Ok(Found::Foreign { may_take_over });
        }
        let front = Side::ask(ip, config.pub_port, "SUB", "XPUB");
        let back = Side::ask(ip, config.sub_port, "PUB", "XSUB");
        if front.is_broker() && back.is_broker() {
            let (pub_port, sub_port) = (config.pub_port, config.sub_port);
            tracing::info!(%ip, pub_port, sub_port, "using the ZeroMQ broker that runs already");
            return Ok(Found::Foreign { may_take_over });
        }
        if !may_take_over {
            return Err(refusal.into());
        }
        let half_there = [&front, &back].iter().all(|side| side.is_broker() || side.is_nobody());
        if half_there && Instant::now() < give_up_at {
            std::thread::sleep(Limits::RECONNECT_MIN);
            continue;
        }
        let culprit = [front, back].into_iter().find(|side| !side.is_broker() && !side.is_nobody());
        return Err(culprit.map_or_else(|| refusal.into(), |side| side.into_error(ip)));
    }
}

/// What has one of the two ports.
struct Side {
    port: u16,
    expected: &'static str,
    answer: Answer,
}

impl Side {
    fn ask(ip: IpAddr, port: u16, ours: &str, expected: &'static str) -> Self {
        Self { port, expected, answer: probe(SocketAddr::new(reachable(ip), port), ours) }
    }

    fn is_broker(&self) -> bool {
        matches!(&self.answer, Answer::Socket(kind) if kind == self.expected)
    }

    fn is_nobody(&self) -> bool {
        matches!(self.answer, Answer::Nobody(_))
    }

    fn into_error(self, ip: IpAddr) -> StartError {
        let Self { port, expected, answer } = self;
        StartError::PortTaken { ip, port, expected, answer }
    }
}

/// True for an address of this machine.
fn is_here(ip: IpAddr) -> bool {
    UdpSocket::bind((ip, 0)).is_ok()
}

/// Watches a foreign broker, and becomes the broker when it dies.
struct Guard {
    config: BrokerConfig,
    ears: zmq::Socket,
    watch: Watch,
    /// Connected for its connection events only: it subscribes to nothing.
    socket: zmq::Socket,
    slot: Arc<Mutex<Option<Broker>>>,
}

impl Guard {
    fn new(
        context: &zmq::Context,
        config: BrokerConfig,
        ip: IpAddr,
        ears: zmq::Socket,
        slot: Arc<Mutex<Option<Broker>>>,
    ) -> zmq::Result<Self> {
        let endpoint = options::endpoint(reachable(ip), config.pub_port);
        let socket = context.socket(zmq::SUB)?;
        options::set_common(&socket, ip)?;
        socket.set_linger(0)?;
        let (socket, watch) = link::connect(context, socket, &BrokerLink::new(&endpoint))?;
        Ok(Self { config, ears, watch, socket, slot })
    }

    fn run(mut self) -> zmq::Result<()> {
        let result = self.watch();
        let Self { socket, watch, .. } = self;
        drop(socket);
        Watch::see_out(vec![watch]);
        result
    }

    /// Returns when told to stop, or when we are the broker.
    fn watch(&mut self) -> zmq::Result<()> {
        let mut pause = Limits::RECONNECT_MIN;
        let mut try_at = Instant::now() + pause;
        loop {
            let wait = match self.watch.link().is_up() {
                true => -1,
                false => {
                    let left = try_at.saturating_duration_since(Instant::now());
                    i64::try_from(left.as_millis()).unwrap_or(i64::MAX).saturating_add(1)
                }
            };
            let mut items = [self.ears.as_poll_item(zmq::POLLIN), self.watch.poll_item()];
            match zmq::poll(&mut items, wait) {
                Ok(_) | Err(zmq::Error::EINTR) => {}
                Err(error) => return Err(error),
            }
            let [rang, _] = items;
            if rang.is_readable() {
                return Ok(());
            }
            if self.watch.take() {
                pause = Limits::RECONNECT_MIN;
                try_at = Instant::now() + pause;
            }
            if self.watch.link().is_up() || Instant::now() < try_at {
                continue;
            }
            match Broker::start(&self.config) {
                Ok(broker) => {
                    tracing::warn!(
                        pub_port = self.config.pub_port,
                        sub_port = self.config.sub_port,
                        "the foreign ZeroMQ broker is gone: this process is the broker now"
                    );
                    *self.slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(broker);
                    return Ok(());
                }
                Err(error) => tracing::debug!(%error, "no broker yet"),
            }
            pause = (pause * 2).min(Limits::RECONNECT_MAX);
            try_at = Instant::now() + pause;
        }
    }
}
