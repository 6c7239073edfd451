//! Sees to it that there is a broker: of topics, or of requests and replies.
//!
//! ```text
//!   start: bind ──ok──▶ our own
//!           └─ taken ──▶ asked ── both its sides ──▶ another program's ── it dies ──▶ bind again …
//!                          └─ anything else ──▶ ZeroMqError: what has the port
//! ```

use std::net::{IpAddr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::config::{BrokerMode, ZeroMqConfig, reachable};
use super::error::{BrokerError, ZeroMqError};
use super::ledger::Ledger;
use super::port_check::{PortHolder, ask_port};
use super::turns::{Runs, Stop, Turns};
use super::zmtp::{self, Kind};
use wrapyfi_endpoint::Mutex;
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::network::{is_of_this_machine, owner};

/// Longest time for which the two ports may be in different hands: two processes that start at
/// once, or one that is just ending.
const SETTLING: Duration = Duration::from_secs(2);

/// Longest time from the end of a foreign broker to the next try to be the broker.
const TAKE_OVER_WITHIN: Duration = Duration::from_millis(400);

/// A broker as its supervisor knows it.
pub(super) trait Supervised: Sized + Send + 'static {
    /// Socket types of its two ports.
    const KINDS: [Kind; 2];
    /// Socket types that we announce when we ask another program's ports for theirs.
    const ASKED_AS: [&'static str; 2];
    /// Names of the two ports in the settings.
    const SETTINGS: [&'static str; 2];

    /// The two ports that are configured.
    fn ports(config: &ZeroMqConfig) -> [u16; 2];

    /// Binds both ports and runs, as one of an instance whose endpoints are told what it loses and whom it refuses.
    fn start_with(config: &ZeroMqConfig, ledger: &Arc<Ledger>) -> Result<Self, BrokerError>;
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
        config: &ZeroMqConfig,
        ledger: &Arc<Ledger>,
        mode: BrokerMode,
    ) -> Result<Self, ZeroMqError> {
        let ip = config.address()?;
        let found = match mode {
            BrokerMode::Embedded => settle(config, ledger, ip)?,
            BrokerMode::Foreign => Found::Foreign { may_take_over: false },
        };
        let mut supervisor = Self { broker: Arc::new(Mutex::new(None)), guard: None };
        match found {
            Found::Own(broker) => *supervisor.broker.lock() = Some(broker),
            Found::Foreign { may_take_over: false } => {}
            Found::Foreign { may_take_over: true } => {
                supervisor.guard(config, ledger, ip)?;
            }
        }
        Ok(supervisor)
    }

    /// Looks at our own broker, if we run one.
    pub(super) fn own<T>(&self, look: impl FnOnce(&B) -> T) -> Option<T> {
        self.broker.lock().as_ref().map(look)
    }

    fn guard(
        &mut self,
        config: &ZeroMqConfig,
        ledger: &Arc<Ledger>,
        ip: IpAddr,
    ) -> Result<(), ZeroMqError> {
        let guard = Guard::<B> {
            config: config.clone(),
            ledger: Arc::clone(ledger),
            front: SocketAddr::new(ip, B::ports(config)[0]),
            slot: Arc::clone(&self.broker),
            backoff: Backoff::of_process(2).up_to(TAKE_OVER_WITHIN),
        };
        let runs = Runs::start("zeromq-guard", guard);
        self.guard = Some(runs.map_err(|error| ZeroMqError::Transport(error.to_string()))?);
        Ok(())
    }
}

/// Binds, or finds out who has the ports.
fn settle<B: Supervised>(
    config: &ZeroMqConfig,
    ledger: &Arc<Ledger>,
    ip: IpAddr,
) -> Result<Found<B>, ZeroMqError> {
    let (give_up_at, mut backoff) = (Instant::now() + SETTLING, Backoff::of_process(3));
    loop {
        let refusal = match B::start_with(config, ledger) {
            Ok(broker) => return Ok(Found::Own(broker)),
            Err(BrokerError::NotHere(ip)) => {
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
        let [front_port, back_port] = B::ports(config);
        let ([front_kind, back_kind], [front_as, back_as]) = (B::KINDS, B::ASKED_AS);
        let has_curve = config.curve.is_some();
        let front = Asked::ask(SocketAddr::new(ip, front_port), front_kind, front_as, has_curve);
        let back = Asked::ask(SocketAddr::new(ip, back_port), back_kind, back_as, has_curve);
        if front.is_broker() && back.is_broker() {
            let by = owner(front_port).map(|it| format!(" ({it})")).unwrap_or_default();
            tracing::info!(%ip, front_port, back_port, "using the ZeroMQ broker that runs already{by}");
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
        return Err(culprit.map_or_else(|| refusal.into(), |side| side.into_error(B::SETTINGS)));
    }
}

/// Answer of the program at one of the two ports.
struct Asked {
    at: SocketAddr,
    expected: &'static str,
    has_curve: bool,
    answer: PortHolder,
}

impl Asked {
    fn ask(at: SocketAddr, expected: Kind, ours: &str, has_curve: bool) -> Self {
        let mechanism = if has_curve { zmtp::CURVE } else { zmtp::NULL };
        let answer = ask_port(SocketAddr::new(reachable(at.ip()), at.port()), ours, mechanism);
        Self { at, expected: expected.name(), has_curve, answer }
    }

    fn is_broker(&self) -> bool {
        match &self.answer {
            PortHolder::Socket(kind) => kind == self.expected,
            // A socket with keys tells its type to those alone whom it knows.
            PortHolder::Secured(mechanism) => self.has_curve && mechanism == zmtp::CURVE,
            _ => false,
        }
    }

    fn is_nobody(&self) -> bool {
        matches!(self.answer, PortHolder::Nobody(_))
    }

    fn into_error(self, settings: [&'static str; 2]) -> ZeroMqError {
        let Self { at, expected, answer, .. } = self;
        let (ip, port) = (at.ip(), at.port());
        ZeroMqError::PortTaken { ip, port, expected, answer, owner: owner(port), settings }
    }
}

/// Watches a foreign broker, and becomes the broker when it dies.
struct Guard<B: Supervised> {
    config: ZeroMqConfig,
    ledger: Arc<Ledger>,
    /// Address of the foreign broker's first port.
    front: SocketAddr,
    slot: Arc<Mutex<Option<B>>>,
    backoff: Backoff,
}

impl<B: Supervised> Turns for Guard<B> {
    const NAME: &'static str = "the thread that watches the foreign ZeroMQ broker";

    /// Stops when told to, and when we are the broker.
    fn turn(&mut self, stop: &Stop) -> std::io::Result<bool> {
        if stop.within(self.backoff.wait())? {
            return Ok(false);
        }
        // Nothing else tells so cheaply that the foreign broker has ended.
        if TcpListener::bind(self.front).is_err() {
            return Ok(true);
        }
        match B::start_with(&self.config, &self.ledger) {
            Ok(broker) => {
                let [front_port, back_port] = B::ports(&self.config);
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
        Ok(true)
    }

    fn failed(&mut self, _why: Option<String>) {}
}
