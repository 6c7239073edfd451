//! State of a socket's connection to the broker, from libzmq's own events.
//!
//! ```text
//!   socket ── events ──▶ Watch (I/O thread) ── state ──▶ BrokerLink (endpoint, status tables)
//! ```
//!
//! A watch must outlive its socket: libzmq reports until the socket is gone, and the thread that
//! reports waits for ever once no program receives. So close the socket, then keep the watch until it
//! is [`Watch::over`].
//!
//! libzmq connects again by itself after a lost connection, but gives up for good where the peer
//! broke the protocol, which includes a frame above the socket's limit. It does not report that;
//! it only fails to report a next try. [`Watch::connect_again`] does that then.

use std::net::SocketAddr;
use std::os::fd::RawFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

use zmq::SocketEvent;

use super::contexts;
use super::curve::Keys;
use super::options::poll_ms;
use wrapyfi_endpoint::{Cause, Context, DropReason, Named, Wake};

const DOWN: u8 = 0;
/// State of a socket whose handshake is over.
pub(super) const UP: u8 = 1;
/// State of a socket whose handshake failed.
const REFUSED: u8 = 2;
/// State of a socket that is closed for good.
pub(super) const ENDED: u8 = 3;
/// State of a socket whose connection no program took, or not yet again.
pub(super) const UNANSWERED: u8 = 4;
/// State of a socket for which the process may open no file.
pub(super) const STARVED: u8 = 5;

/// State of a socket whose broker has CURVE where it has not, or the other way round.
pub(super) const SECURED: u8 = 6;
/// State of a socket whose keys the broker does not take.
pub(super) const KEYS: u8 = 7;

/// State of a listener whose key the broker takes, and does not let listen to the topic.
pub(super) const DENIED: u8 = 8;

/// Event of libzmq with this value: the two sides have different mechanisms.
const MECHANISM_MISMATCH: u32 = 0x1100_0002;

/// Time after a disconnection in which libzmq announces its next try, which it does at once unless
/// it has given up. Also the pause before we try instead.
const GIVEN_UP: Duration = Duration::from_secs(1);
/// Longest time that sockets which are being closed may take to fall silent.
pub(super) const FAREWELL: Duration = Duration::from_secs(1);

/// State of one socket's connection to the broker.
#[derive(Debug)]
pub(super) struct BrokerLink {
    broker: String,
    /// Topic or service that the connection is for; empty where it is for all.
    name: String,
    /// Our keys, where connections have CURVE.
    keys: Option<Arc<Keys>>,
    state: AtomicU8,
}

impl BrokerLink {
    pub(super) fn new(broker: &str, name: &str, keys: Option<&Arc<Keys>>) -> Arc<Self> {
        let (broker, name) = (broker.to_owned(), name.to_owned());
        Arc::new(Self { broker, name, keys: keys.cloned(), state: AtomicU8::new(DOWN) })
    }

    pub(super) fn is_up(&self) -> bool {
        self.state.load(Relaxed) == UP
    }

    /// True while the broker is connected, whether or not our key may have the topic.
    pub(super) fn is_reached(&self) -> bool {
        matches!(self.state(), UP | DENIED)
    }

    /// The last try to reach the broker failed.
    pub(super) fn has_failed(&self) -> bool {
        !matches!(self.state(), DOWN | UP)
    }

    /// Cause for which the broker is not reached; `None` while it is.
    pub(super) fn waiting_for(&self) -> Option<Cause> {
        let server = Named::server("the broker at", &self.broker);
        Some(match self.state.load(Relaxed) {
            UP => return None,
            ENDED => Cause::Ended("ZeroMQ, which was shut down here".to_owned()),
            REFUSED => {
                Cause::OtherServer { server: Named::server("a ZeroMQ broker at", &self.broker) }
            }
            SECURED => {
                let detail = ": one of the two sides has CURVE and the other has not (endpoints: zeromq: curve)";
                Cause::Security { server, detail: detail.to_owned() }
            }
            KEYS => {
                let detail = format!(
                    ", which does not take our CURVE keys: `server_key` must be its public key, and {}",
                    self.to_be_listed(|key| format!("- {{ key: \"{key}\" }}"))
                );
                Cause::Security { server, detail }
            }
            DENIED => Cause::Denied { server, rule: self.denied("listen to", "subscribe") },
            STARVED => {
                let fault = contexts::reason(zmq::Error::EMFILE).into();
                Cause::peer(
                    Named::server("a connection to the broker at", &self.broker),
                    "",
                    Some(fault),
                    "",
                )
            }
            _ => {
                let detail = match self.is_foreign() {
                    true => {
                        ", which does not answer: it has to run there, and Wrapyfi's own listens on 127.0.0.1 unless \
                         WRAPYFI_ZEROMQ_SOCKET_IP is set there"
                    }
                    false => "",
                };
                Cause::ServerAway { server, detail: detail.to_owned() }
            }
        })
    }

    /// Use of the topic that a broker does not let our key have, and the change of its `list` that does.
    pub(super) fn denied(&self, what: &str, list: &str) -> String {
        let name = &self.name;
        let grant =
            self.to_be_listed(|key| format!("{list}: [{name:?}] in the entry of our key {key}"));
        format!("does not let our CURVE key {what} {name:?}: {grant}")
    }

    /// Condition under which a broker with a list takes our key, in words, with the `line` that it must have.
    fn to_be_listed(&self, line: impl FnOnce(&str) -> String) -> String {
        match self.keys.as_ref().filter(|keys| keys.is_kept()).map(|keys| keys.public()) {
            Some(key) => {
                let line = line(&key);
                format!("its `clients` (endpoints: zeromq: curve) must have {line}")
            }
            None => "its `clients` must have a key of ours that stays, and this program makes another one with each start \
                     until WRAPYFI_ZEROMQ_CURVE_SECRET_KEY_FILE is set"
                .to_owned(),
        }
    }

    /// True when the broker's address is not on loopback.
    fn is_foreign(&self) -> bool {
        let address = self.broker.rsplit("://").next().and_then(|text| text.parse().ok());
        address.is_some_and(|address: SocketAddr| !address.ip().is_loopback())
    }

    /// The state, to see whether it has changed.
    pub(super) fn state(&self) -> u8 {
        self.state.load(Relaxed)
    }

    /// Takes note that the connection ended; true when the state changed.
    pub(super) fn disconnected(&self) -> bool {
        // Lost before the handshake was over: refused, for a wrong socket type without further
        // notice.
        self.note(match self.state() {
            UP | DENIED => DOWN,
            state @ (SECURED | KEYS) => state,
            _ if self.keys.is_some() => KEYS,
            _ => REFUSED,
        })
    }

    /// Takes note of a state; true when it is another one. None follows the end.
    pub(super) fn note(&self, state: u8) -> bool {
        let before = self.state();
        if before == ENDED {
            return false;
        }
        self.state.store(state, Relaxed);
        state != before
    }

    /// Takes note of an event of libzmq; true when the state changed.
    fn happened(&self, event: u16, value: u32) -> bool {
        let is = |kind: SocketEvent| event == kind.to_raw();
        if is(SocketEvent::HANDSHAKE_SUCCEEDED) {
            // The answer of a broker that is quick may have been read before this event.
            self.state() != DENIED && self.note(UP)
        } else if is(SocketEvent::HANDSHAKE_FAILED_PROTOCOL) && value == MECHANISM_MISMATCH {
            self.note(SECURED)
        } else if is(SocketEvent::HANDSHAKE_FAILED_NO_DETAIL)
            || is(SocketEvent::HANDSHAKE_FAILED_PROTOCOL)
            || is(SocketEvent::HANDSHAKE_FAILED_AUTH)
        {
            self.note(if self.keys.is_some() { KEYS } else { REFUSED })
        } else if is(SocketEvent::CLOSED) {
            self.note(UNANSWERED)
        } else {
            is(SocketEvent::DISCONNECTED) && self.disconnected()
        }
    }
}

/// Receives the events of one socket. Belongs to the thread that polls.
pub(super) struct Watch {
    events: zmq::Socket,
    pub(super) link: Arc<BrokerLink>,
    /// Set while no further try has been announced.
    lost: Option<Lost>,
    /// True when the socket is gone and will not report any more.
    pub(super) over: bool,
}

struct Lost {
    at: Instant,
    was_up: bool,
}

/// Connects `socket` to the broker of `link`, with CURVE where there are keys, watched from the first moment.
pub(super) fn connect(
    context: &zmq::Context,
    socket: zmq::Socket,
    link: &Arc<BrokerLink>,
    keys: Option<&Arc<Keys>>,
) -> zmq::Result<(zmq::Socket, Watch)> {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    if let Some(keys) = keys {
        keys.give_to(&socket)?;
    }
    let name = format!("inproc://events-{}", NEXT.fetch_add(1, Relaxed));
    let events = context.socket(zmq::PAIR)?;
    events.set_linger(0)?;
    socket.monitor(&name, i32::from(SocketEvent::ALL.to_raw()))?;
    events.connect(&name)?;
    let watch = Watch { events, link: Arc::clone(link), lost: None, over: false };
    if let Err(error) = socket.connect(&link.broker) {
        drop(socket);
        watch.see_out();
        return Err(error);
    }
    Ok((socket, watch))
}

impl Watch {
    /// Descriptor that says that an event waits.
    pub(super) fn fd(&self) -> Option<RawFd> {
        self.events.get_fd().ok()
    }

    /// Takes all waiting events; true when the connection came or went.
    pub(super) fn take(&mut self) -> bool {
        let mut changed = false;
        while let Ok(frame) = self.events.recv_msg(zmq::DONTWAIT) {
            // First frame: event number and a value, in native byte order. Second: the address.
            if frame.get_more()
                && let Some(number) = frame.first_chunk::<2>()
            {
                let event = u16::from_ne_bytes(*number);
                self.over |= event == SocketEvent::MONITOR_STOPPED.to_raw();
                if event == SocketEvent::DISCONNECTED.to_raw() {
                    self.lost = Some(Lost { at: Instant::now(), was_up: self.link.is_up() });
                } else if event == SocketEvent::CONNECT_RETRIED.to_raw() {
                    self.lost = None;
                }
                let value = frame.get(2..).and_then(|rest| rest.first_chunk::<4>());
                let value = value.map_or(0, |value| u32::from_ne_bytes(*value));
                changed |= self.link.happened(event, value);
            }
        }
        changed
    }

    /// Time until [`Self::connect_again`] may have something to do.
    pub(super) fn time_left(&self, now: Instant) -> Option<Duration> {
        self.lost
            .as_ref()
            .map(|lost| GIVEN_UP.saturating_sub(now.saturating_duration_since(lost.at)))
    }

    /// Connects the socket of topic or service `name` again if libzmq has given up on the broker, and counts the
    /// message that cut a connection which worked. The time until libzmq may have given up is returned.
    pub(super) fn revive(
        &mut self,
        socket: &zmq::Socket,
        name: &str,
        limit: usize,
        context: &Context,
        now: Instant,
    ) -> Option<Duration> {
        if self.connect_again(socket, &context.wake, now) {
            context.counters.dropped(DropReason::Oversize);
            tracing::warn!(
                name,
                limit_mib = limit / wrapyfi_data::Limits::MIB,
                "a message far above the limit cut the connection to the broker, which is opened \
                 again: raise max_message_mib, or send less"
            );
        }
        self.time_left(now)
    }

    /// Connects `socket` again if libzmq has given up on the broker. True when that happened to a
    /// connection that worked: the broker sent what this socket does not accept.
    pub(super) fn connect_again(
        &mut self,
        socket: &zmq::Socket,
        wake: &Wake,
        now: Instant,
    ) -> bool {
        if self.time_left(now) != Some(Duration::ZERO) {
            return false;
        }
        // On a busy machine the announcement may be waiting here.
        if self.take() {
            wake.ring();
        }
        if self.time_left(now) != Some(Duration::ZERO) {
            return false;
        }
        let Some(lost) = self.lost.take() else { return false };
        // First ends what may be left of the old connection: with two, all would arrive twice.
        match socket.disconnect(&self.link.broker) {
            Ok(()) | Err(zmq::Error::ENOENT) => {}
            Err(error) => tracing::debug!(%error, "the old connection to the broker"),
        }
        if let Err(error) = socket.connect(&self.link.broker) {
            tracing::warn!(%error, broker = self.link.broker, "could not connect again");
            self.lost = Some(Lost { at: now, was_up: false });
        }
        lost.was_up
    }

    /// Receives until the socket, closed before, is gone.
    pub(super) fn see_out(mut self) {
        let deadline = Instant::now() + FAREWELL;
        self.take();
        while !self.over {
            let left = poll_ms(deadline.saturating_duration_since(Instant::now()));
            match self.events.poll(zmq::POLLIN, left) {
                Ok(0) => return tracing::warn!("a ZeroMQ socket did not close in time"),
                Ok(_) | Err(zmq::Error::EINTR) => _ = self.take(),
                Err(_) => return,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reason_follows_the_events() {
        let link = BrokerLink::new("tcp://127.0.0.1:5555", "/x", None);
        let away = |link: &BrokerLink| match link.waiting_for() {
            Some(Cause::ServerAway { server, detail }) => (server, detail),
            other => panic!("{other:?}"),
        };
        let here = (Named::server("the broker at", "tcp://127.0.0.1:5555"), String::new());
        assert_eq!(away(&link), here);
        assert!(!link.happened(SocketEvent::CONNECTED.to_raw(), 0));
        assert!(link.happened(SocketEvent::HANDSHAKE_SUCCEEDED.to_raw(), 0));
        assert_eq!(link.waiting_for(), None);
        assert!(!link.has_failed());
        let (_, elsewhere) = away(&BrokerLink::new("tcp://192.0.2.1:5555", "/x", None));
        assert!(elsewhere.contains("unless WRAPYFI_ZEROMQ_SOCKET_IP is set there"), "{elsewhere}");
        assert!(link.happened(SocketEvent::DISCONNECTED.to_raw(), 0));
        assert!(!link.is_up());
        assert!(link.happened(SocketEvent::HANDSHAKE_FAILED_PROTOCOL.to_raw(), 0));
        assert!(!link.happened(SocketEvent::DISCONNECTED.to_raw(), 0));
        assert!(matches!(link.waiting_for(), Some(Cause::OtherServer { .. })));
        assert!(!link.is_up() && link.has_failed());
        assert!(link.happened(SocketEvent::CLOSED.to_raw(), 0));
        assert!(link.has_failed());
        assert!(!link.happened(0x7000, 0));
    }
}
