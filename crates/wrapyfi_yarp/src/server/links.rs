//! Makes and ends the connections that subscriptions ask for.
//!
//! ```text
//!   Link { "/cam", "tcp://view" } ──▶ one task a pair ──▶ "/cam": [list] [out], [list] [out], [add]
//! ```
//!
//! Demands for a pair that is being connected are met afterwards, the last one only. A connection
//! that fails is not tried again: the next announcement of either port does that.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use tokio::sync::Semaphore;
use tokio::task::JoinSet;

use super::connect::Pair;
use super::shared::Shared;
use super::subscriptions::Link;

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
    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sees to a connection, soon.
    pub(super) fn submit(&self, link: Link, shared: &Arc<Shared>) {
        let mut waiting = self.waiting();
        if waiting.ended {
            return;
        }
        while waiting.tasks.try_join_next().is_some() {}
        let pair = (link.src, link.dest);
        if waiting.wishes.insert(pair.clone(), Some(link.connect)).is_none() {
            let turns = Arc::clone(&self.turns);
            waiting.tasks.spawn(see_to(pair, Arc::downgrade(shared), turns));
        }
    }

    /// The last wish for a pair; a pair without one is forgotten.
    fn wish(&self, pair: &(String, String)) -> Option<bool> {
        let mut waiting = self.waiting();
        let wish = waiting.wishes.get_mut(pair).and_then(Option::take);
        if wish.is_none() {
            waiting.wishes.remove(pair);
        }
        wish
    }

    /// Ends everything.
    pub(super) fn end(&self) {
        let mut waiting = self.waiting();
        waiting.ended = true;
        waiting.tasks.abort_all();
        waiting.wishes.clear();
    }
}

async fn see_to(pair: (String, String), shared: Weak<Shared>, turns: Arc<Semaphore>) {
    // The semaphore is never closed.
    let Ok(_turn) = turns.acquire().await else { return };
    while let Some(shared) = shared.upgrade() {
        let Some(wish) = shared.links.wish(&pair) else { return };
        enact(&pair.0, &pair.1, wish, &shared).await;
    }
}

async fn enact(src: &str, dest: &str, wish: bool, shared: &Arc<Shared>) {
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
            shared.counters.add(if wish { "link_made" } else { "link_ended" });
            tracing::info!(target: "wrapyfi_yarp::server", src, dest, connected = wish, "link");
        }
        // The port that left is not found any more: there is nothing left to end.
        Err(error) if !wish => {
            tracing::debug!(target: "wrapyfi_yarp::server", %error, src, dest, "not disconnected");
        }
        Err(error) => {
            shared.counters.add("link_failed");
            tracing::warn!(target: "wrapyfi_yarp::server", "{src} not connected to {dest}: {error}");
        }
    }
}
