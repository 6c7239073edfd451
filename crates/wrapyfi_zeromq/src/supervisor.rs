//! Sees to it that there is a broker: of topics, or of requests and replies.
//!
//! ```text
//!   start: bind ──ok──▶ our own
//!           └─ taken ──▶ asked ── both its sides ──▶ somebody else's ── it dies ──▶ bind again …
//!                          └─ anything else ──▶ ZeroMqError: what has the port
//! ```

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::config::{BrokerMode, reachable};
use super::curve::Keys;
use super::error::{BrokerError, ZeroMqError};
use super::link::{self, BrokerLink, Watch};
use super::options::{self, StopSignal};
use super::port_check::{Answer, ask_port};
use super::turns::{Runs, Turns};
use super::zmtp;
use wrapyfi_endpoint::Mutex;
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::network::is_of_this_machine;

/// Longest time for which the two ports may be in different hands: two processes that start at
/// once, or one that is just ending.
const SETTLING: Duration = Duration::from_secs(2);

/// A broker as its supervisor knows it.
pub(super) trait Supervised: Sized + Send + 'static {
    /// Settings of the broker.
    type Config: Clone + Send + 'static;
    /// Socket type of a broker at the first port.
    const FRONT: Side;
    /// Socket type of a broker at the second port.
    const BACK: Side;
    /// A socket that may connect to the first port, for the connection's events only.
    const WATCHER: zmq::SocketType;
    /// Names of the two ports in the settings.
    const SETTINGS: &'static str;

    /// Binds both ports.
    fn start(config: &Self::Config) -> Result<Self, BrokerError>;

    /// The two ports.
    fn ports(config: &Self::Config) -> (u16, u16);

    /// True for a broker with CURVE.
    fn has_curve(config: &Self::Config) -> bool;
}

/// One side of a broker.
pub(super) struct Side {
    /// Socket type that we announce when we ask a port for its own.
    pub(super) ours: &'static str,
    /// Socket type that a broker answers with.
    pub(super) expected: &'static str,
}

/// Our broker, if we run one, and the thread that takes over from a foreign one.
pub(super) struct Supervisor<B: Supervised> {
    // Before the broker, so that it is not made once more.
    guard: Option<Runs>,
    broker: Arc<Mutex<Option<B>>>,
}

enum Found<B> {
    Own(B),
    Foreign { may_take_over: bool },
}

impl<B: Supervised> Supervisor<B> {
    /// Runs the broker, or finds the one that is there.
    pub(super) fn start(
        config: &B::Config,
        mode: BrokerMode,
        ip: IpAddr,
        keys: Option<&Arc<Keys>>,
    ) -> Result<Self, ZeroMqError> {
        let found = match mode {
            BrokerMode::Embedded => settle(config, ip)?,
            BrokerMode::Foreign => Found::Foreign { may_take_over: false },
        };
        let mut supervisor = Self { broker: Arc::new(Mutex::new(None)), guard: None };
        match found {
            Found::Own(broker) => *supervisor.broker.lock() = Some(broker),
            Found::Foreign { may_take_over: false } => {}
            Found::Foreign { may_take_over: true } => supervisor.guard(config.clone(), ip, keys)?,
        }
        Ok(supervisor)
    }

    /// Looks at our own broker, if we run one.
    pub(super) fn own<T>(&self, look: impl FnOnce(&B) -> T) -> Option<T> {
        self.broker.lock().as_ref().map(look)
    }

    fn guard(
        &mut self,
        config: B::Config,
        ip: IpAddr,
        keys: Option<&Arc<Keys>>,
    ) -> Result<(), ZeroMqError> {
        let context = zmq::Context::new();
        let (stop_signal, stop) = StopSignal::new(&context)?;
        let endpoint = options::endpoint(reachable(ip), B::ports(&config).0);
        let link = BrokerLink::new(&endpoint, keys);
        let guard =
            Guard::<B>::new(&context, config, (ip, &link, keys), stop, Arc::clone(&self.broker))?;
        let runs = Runs::start("zeromq-guard", stop_signal, guard);
        self.guard =
            Some(runs.map_err(|error| ZeroMqError::Transport { reason: error.to_string() })?);
        Ok(())
    }
}

/// Binds, or finds out who has the ports.
fn settle<B: Supervised>(config: &B::Config, ip: IpAddr) -> Result<Found<B>, ZeroMqError> {
    let (give_up_at, mut backoff) = (Instant::now() + SETTLING, Backoff::of_process(3));
    loop {
        let refusal = match B::start(config) {
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
        if !may_take_over && !is_of_this_machine(ip) {
            tracing::info!(%ip, "not an address of this machine: using the broker there");
            return Ok(Found::Foreign { may_take_over });
        }
        let (front_port, back_port) = B::ports(config);
        let has_curve = B::has_curve(config);
        let front = Asked::ask(ip, front_port, &B::FRONT, has_curve);
        let back = Asked::ask(ip, back_port, &B::BACK, has_curve);
        if front.is_broker() && back.is_broker() {
            tracing::info!(%ip, front_port, back_port, "using the ZeroMQ broker that runs already");
            return Ok(Found::Foreign { may_take_over });
        }
        if !may_take_over {
            return Err(refusal.into());
        }
        let half_there = [&front, &back].iter().all(|side| side.is_broker() || side.is_nobody());
        if half_there && Instant::now() < give_up_at {
            // Of two that start at once one is first.
            std::thread::sleep(backoff.wait());
            continue;
        }
        let culprit = [front, back].into_iter().find(|side| !side.is_broker() && !side.is_nobody());
        return Err(culprit.map_or_else(|| refusal.into(), |side| side.into_error(ip, B::SETTINGS)));
    }
}

/// Answer of the program at one of the two ports.
struct Asked {
    port: u16,
    expected: &'static str,
    has_curve: bool,
    answer: Answer,
}

impl Asked {
    fn ask(ip: IpAddr, port: u16, side: &Side, has_curve: bool) -> Self {
        let Side { ours, expected } = *side;
        let mechanism = if has_curve { zmtp::CURVE } else { zmtp::NULL };
        let answer = ask_port(SocketAddr::new(reachable(ip), port), ours, mechanism);
        Self { port, expected, has_curve, answer }
    }

    fn is_broker(&self) -> bool {
        match &self.answer {
            Answer::Socket(kind) => kind == self.expected,
            // A socket with keys tells its type to those alone whom it knows.
            Answer::Secured(mechanism) => self.has_curve && mechanism == zmtp::CURVE,
            _ => false,
        }
    }

    fn is_nobody(&self) -> bool {
        matches!(self.answer, Answer::Nobody(_))
    }

    fn into_error(self, ip: IpAddr, settings: &'static str) -> ZeroMqError {
        let Self { port, expected, answer, .. } = self;
        ZeroMqError::PortTaken { ip, port, expected, answer, settings }
    }
}

/// Watches a foreign broker, and becomes the broker when it dies.
struct Guard<B: Supervised> {
    config: B::Config,
    stop: zmq::Socket,
    watch: Watch,
    /// Connected for its connection events only.
    socket: zmq::Socket,
    slot: Arc<Mutex<Option<B>>>,
    backoff: Backoff,
    try_at: Instant,
}

impl<B: Supervised> Guard<B> {
    fn new(
        context: &zmq::Context,
        config: B::Config,
        (ip, link, keys): (IpAddr, &Arc<BrokerLink>, Option<&Arc<Keys>>),
        stop: zmq::Socket,
        slot: Arc<Mutex<Option<B>>>,
    ) -> zmq::Result<Self> {
        let socket = context.socket(B::WATCHER)?;
        options::set_common(&socket, ip)?;
        socket.set_linger(0)?;
        let (socket, watch) = link::connect(context, socket, link, keys)?;
        let mut backoff = Backoff::of_process(2);
        let try_at = Instant::now() + backoff.wait();
        Ok(Self { config, stop, watch, socket, slot, backoff, try_at })
    }
}

impl<B: Supervised> Turns for Guard<B> {
    const NAME: &'static str = "the thread that watches the foreign ZeroMQ broker";

    /// Stops when told to, and when we are the broker.
    fn turn(&mut self) -> zmq::Result<bool> {
        let wait = match self.watch.link.is_up() {
            true => -1,
            false => {
                let left = self.try_at.saturating_duration_since(Instant::now());
                i64::try_from(left.as_millis()).unwrap_or(i64::MAX).saturating_add(1)
            }
        };
        let mut items = [self.stop.as_poll_item(zmq::POLLIN), self.watch.poll_item()];
        zmq::poll(&mut items, wait)?;
        let [rang, _] = items;
        if rang.is_readable() {
            return Ok(false);
        }
        if self.watch.take() {
            self.backoff.reset();
            self.try_at = Instant::now() + self.backoff.wait();
        }
        if self.watch.link.is_up() || Instant::now() < self.try_at {
            return Ok(true);
        }
        match B::start(&self.config) {
            Ok(broker) => {
                let (front_port, back_port) = B::ports(&self.config);
                tracing::warn!(
                    front_port,
                    back_port,
                    "the foreign ZeroMQ broker is gone: this process is the broker now"
                );
                *self.slot.lock() = Some(broker);
                return Ok(false);
            }
            Err(error) => tracing::debug!(%error, "no broker yet"),
        }
        self.try_at = Instant::now() + self.backoff.wait();
        Ok(true)
    }

    fn stop(&self) -> &zmq::Socket {
        &self.stop
    }

    fn failed(&mut self, _why: Option<String>) {}

    fn end(self) {
        let Self { socket, watch, .. } = self;
        drop(socket);
        Watch::see_out(vec![watch]);
    }
}
