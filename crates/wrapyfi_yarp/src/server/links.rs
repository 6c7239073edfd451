//! Makes and ends the connections that subscriptions ask for.
//!
//! ```text
//!   Link { "/cam", "tcp://view" } ──▶ one task a pair ──▶ "/cam": [list] [out], [list] [out], [add]
//! ```
//!
//! Demands for a pair that is being connected are met afterwards, the last one only. A connection
//! that fails is not tried again: the next announcement of either port does that.
//!
//! Connections are made and ended as `yarp connect` and `yarp disconnect` do: the sender opens them
//! itself, and with a carrier that pulls (`mjpeg`) the receiver is asked instead. A port that does not
//! answer is doubted from then on.

use std::collections::BTreeMap;
use std::sync::{Arc, Weak};

use tokio::sync::Semaphore;
use tokio::task::JoinSet;

use wrapyfi_retry::Mutex;

use super::shared::ServerState;
use super::subscriptions::Link;
use crate::name::{NameError, Target, is_pull, name_fault};
use crate::port::AdminError;
use crate::port::names::Registration;
use crate::task::erased;
use crate::{Bottle, Value, WireLimits};

/// Pairs that are seen to at a time: each may wait for a port that does not answer.
const AT_A_TIME: usize = 32;

/// The pairs that are being seen to.
#[derive(Debug)]
pub(super) struct Links {
    waiting: Mutex<Waiting>,
    turns: Arc<Semaphore>,
}

#[derive(Debug, Default)]
struct Waiting {
    /// Last demand for each pair since its task began: `None` while there is no new one.
    wishes: BTreeMap<(String, String), Option<bool>>,
    tasks: JoinSet<()>,
    ended: bool,
}

impl Default for Links {
    fn default() -> Self {
        Self { waiting: Mutex::default(), turns: Arc::new(Semaphore::new(AT_A_TIME)) }
    }
}

impl Links {
    /// Sees to a connection, soon.
    pub(super) fn submit(&self, link: Link, shared: &Weak<ServerState>) {
        let mut waiting = self.waiting.lock();
        if waiting.ended {
            return;
        }
        while waiting.tasks.try_join_next().is_some() {}
        let pair = (link.src, link.dest);
        if waiting.wishes.insert(pair.clone(), Some(link.connect)).is_none() {
            let turns = Arc::clone(&self.turns);
            waiting.tasks.spawn(erased(see_to(pair, Weak::clone(shared), turns)));
        }
    }

    /// The last wish for a pair; a pair without one is forgotten.
    fn wish(&self, pair: &(String, String)) -> Option<bool> {
        let mut waiting = self.waiting.lock();
        let wish = waiting.wishes.get_mut(pair).and_then(Option::take);
        if wish.is_none() {
            waiting.wishes.remove(pair);
        }
        wish
    }

    /// Ends everything.
    pub(super) fn end(&self) {
        let mut waiting = self.waiting.lock();
        waiting.ended = true;
        waiting.tasks.abort_all();
        waiting.wishes.clear();
    }
}

async fn see_to(pair: (String, String), shared: Weak<ServerState>, turns: Arc<Semaphore>) {
    // The semaphore is never closed.
    let Ok(_turn) = turns.acquire().await else { return };
    while let Some(shared) = shared.upgrade() {
        let Some(wish) = shared.links.wish(&pair) else { return };
        enact(&pair.0, &pair.1, wish, &shared).await;
    }
}

async fn enact(src: &str, dest: &str, wish: bool, shared: &ServerState) {
    let done = async {
        let pair = Pair::find(shared, src, dest)?;
        // As YARP: look first, and let the connecting look again.
        if pair.is_connected().await? == wish {
            return Ok(());
        }
        if wish { pair.connect().await } else { pair.disconnect().await }
    };
    match done.await {
        Ok(()) => {
            shared.core.fault_counts.add(if wish { "link_made" } else { "link_ended" });
            tracing::info!(target: "wrapyfi_yarp::server", src, dest, connected = wish, "link");
        }
        // The port that left is not found any more: there is nothing left to end.
        Err(error) if !wish => {
            tracing::debug!(target: "wrapyfi_yarp::server", %error, src, dest, "not disconnected");
        }
        Err(error) => {
            shared.core.fault_counts.add("link_failed");
            tracing::warn!(target: "wrapyfi_yarp::server", "{src} not connected to {dest}: {error}");
        }
    }
}

/// Two registered ports, and how they are to be connected.
pub(super) struct Pair<'a> {
    shared: &'a ServerState,
    src: Registration,
    dest: Registration,
    /// Carrier with its qualifiers.
    carrier: String,
    pull: bool,
}

impl<'a> Pair<'a> {
    /// Finds two ports. Either may have a carrier before it (`fast_tcp://view`); that of the
    /// receiver counts, then that of the sender, then the one that the receiver is registered with.
    pub(super) fn find(shared: &'a ServerState, src: &str, dest: &str) -> Result<Self, AdminError> {
        let (from, to) = (Target::parse(src), Target::parse(dest));
        let (mut src, mut dest) = (lookup(shared, &from)?, lookup(shared, &to)?);
        let named = [to.carrier, from.carrier].into_iter().find(|carrier| !carrier.is_empty());
        let carrier = named.unwrap_or_else(|| dest.carrier.clone());
        let pull = is_pull(&carrier);
        // A network chooses an address; the ports know each other by their names.
        (src.name, dest.name) = (rooted(from.name), rooted(to.name));
        Ok(Self { shared, src, dest, carrier, pull })
    }

    /// True when the ports are connected by the carrier that [`Pair::connect`] would use.
    pub(super) async fn is_connected(&self) -> Result<bool, AdminError> {
        let now = self.listed().await?;
        Ok(now.find("carrier").is_some_and(|carrier| carrier.is_word(&self.carrier)))
    }

    /// Connects the ports.
    pub(super) async fn connect(&self) -> Result<(), AdminError> {
        let (asked, other) = self.sides();
        self.listed().await?;
        let (contact, target) = (asked.contact(), format!("{}:/{}", self.carrier, other.name));
        let added = self.shared.core.network.add_output(&asked.name, Some(&contact), &target).await;
        if let Err(AdminError::Refused { .. }) = added {
            self.shared.verify(&self.dest.name);
        }
        self.heard(asked, added)
    }

    /// Ends the connection; [`AdminError::Refused`] where there is none.
    pub(super) async fn disconnect(&self) -> Result<(), AdminError> {
        let (asked, other) = self.sides();
        let now = self.listed().await?;
        let pulled = now.find("push").is_some_and(|push| push.as_i64() == Some(0));
        let silent = now.find("connectionless").is_some_and(|flag| flag.as_i64() == Some(1));
        if silent && pulled != self.pull {
            // The other side would go on sending: no other program tells it.
            self.ask(other, [Value::vocab("del"), asked.name.as_str().into()]).await?;
        }
        let contact = asked.contact();
        let ended =
            self.shared.core.network.remove_output(&asked.name, Some(&contact), &other.name).await;
        self.heard(asked, ended)
    }

    /// Port that is asked, and the port that the question is about.
    fn sides(&self) -> (&Registration, &Registration) {
        if self.pull { (&self.dest, &self.src) } else { (&self.src, &self.dest) }
    }

    /// Connection between the two as it is now, in the asked port's words; empty where there is none.
    async fn listed(&self) -> Result<Bottle, AdminError> {
        let (asked, other) = self.sides();
        let side = Value::vocab(if self.pull { "in" } else { "out" });
        self.ask(asked, [Value::vocab("list"), side, other.name.as_str().into()]).await
    }

    /// Asks a port's administration.
    async fn ask(
        &self,
        port: &Registration,
        request: impl IntoIterator<Item = Value>,
    ) -> Result<Bottle, AdminError> {
        let (contact, request) = (port.contact(), request.into_iter().collect());
        let asked = self.shared.core.network.admin_at(&port.name, Some(&contact), &request).await;
        self.heard(port, asked)
    }

    /// Answer of a port, which is doubted where there is none.
    fn heard<T>(
        &self,
        port: &Registration,
        answer: Result<T, AdminError>,
    ) -> Result<T, AdminError> {
        if let Err(AdminError::Port { .. }) = answer {
            self.shared.verify(&port.name);
        }
        answer
    }
}

/// Finds a port, whatever stands before its name.
fn lookup(shared: &ServerState, target: &Target) -> Result<Registration, AdminError> {
    let name = rooted(target.name.clone());
    if let Some(reason) = name_fault(&name, WireLimits::default().max_name_bytes) {
        return Err(NameError::BadName { name, reason }.into());
    }
    let found = shared.state.lock().registry.find(&name, &target.network);
    found.ok_or(AdminError::Unknown(name))
}

/// `tcp:/cam` names /cam as well as `tcp://cam` does.
fn rooted(name: String) -> String {
    if name.starts_with('/') || name == "..." { name } else { format!("/{name}") }
}
