//! State of a connection to the broker, for endpoints and status tables.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

use super::curve::Keys;
use super::options;
use wrapyfi_endpoint::{Cause, Named};

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

/// State of one socket's connection to the broker.
#[derive(Debug)]
pub(super) struct BrokerLink {
    broker: SocketAddr,
    /// Topic or service that the connection is for; empty where it is for all.
    name: String,
    /// Our keys, where connections have CURVE.
    keys: Option<Arc<Keys>>,
    state: AtomicU8,
}

impl BrokerLink {
    pub(super) fn new(broker: SocketAddr, name: &str, keys: Option<&Arc<Keys>>) -> Arc<Self> {
        let name = name.to_owned();
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
        let state = self.state.load(Relaxed);
        // Asked with each message: words are made only where there is something to say.
        if state == UP {
            return None;
        }
        let broker = options::endpoint(self.broker);
        let server = Named::server("the broker at", &broker);
        Some(match state {
            ENDED => Cause::Ended("ZeroMQ, which was shut down here".to_owned()),
            REFUSED => Cause::OtherServer { server: Named::server("a ZeroMQ broker at", &broker) },
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
                let fault = options::OUT_OF_FILES.to_owned().into();
                Cause::peer(
                    Named::server("a connection to the broker at", &broker),
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
        !self.broker.ip().is_loopback()
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
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reason_follows_the_connection() {
        let at = |address: &str| BrokerLink::new(address.parse().unwrap(), "/x", None);
        let away = |link: &BrokerLink| match link.waiting_for() {
            Some(Cause::ServerAway { server, detail }) => (server, detail),
            other => panic!("{other:?}"),
        };
        let link = at("127.0.0.1:5555");
        let here = (Named::server("the broker at", "tcp://127.0.0.1:5555"), String::new());
        assert_eq!(away(&link), here);
        assert!(link.note(UP));
        assert_eq!(link.waiting_for(), None);
        assert!(!link.has_failed());
        let (_, elsewhere) = away(&at("192.0.2.1:5555"));
        assert!(elsewhere.contains("unless WRAPYFI_ZEROMQ_SOCKET_IP is set there"), "{elsewhere}");
        assert!(link.disconnected() && !link.is_up());
        assert!(link.disconnected(), "before the handshake is over");
        assert!(!link.disconnected());
        assert!(matches!(link.waiting_for(), Some(Cause::OtherServer { .. })));
        assert!(!link.is_up() && link.has_failed());
        assert!(link.note(UNANSWERED) && link.has_failed());
        assert!(link.note(ENDED) && !link.note(UP), "none follows the end");
    }
}
