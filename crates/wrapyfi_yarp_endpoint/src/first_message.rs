//! First messages of ports, which show their types.
//!
//! A port that sends nothing costs nothing: so the first message of one that is silent ends its wait,
//! whenever it comes, and no program has to be asked again and again ([`super::learning`]).

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use tokio::sync::{Notify, Semaphore};
use wrapyfi_yarp::port::{Port, Received};

use super::types;
use wrapyfi_endpoint::Mutex;

/// Most ports that are listened to at once, of those that may send often. Fewer would have ports that send
/// once a second wait for each other: 50 of them in turns of 8 take a third of a second longer.
const AT_ONCE: usize = 24;
/// Most ports that are told at once to connect. Each asks the name server where we are, and YARP's has room
/// for five who wait: the others would try again after a second.
const TOLD_AT_ONCE: usize = 4;
/// Most ports that are waited for although they send nothing.
pub(super) const SILENT_AT_ONCE: usize = 64;
/// Types of ports, learnt from the first message that each of them sends.
#[derive(Debug)]
pub(super) struct FirstMessages {
    pub(super) ports: Mutex<BTreeMap<String, Heard>>,
    /// Counts the types that were shown.
    learned: AtomicU64,
    pub(super) room: Semaphore,
    pub(super) telling: Semaphore,
    pub(super) silent: Semaphore,
    /// The port that all send to, once there is something to listen to.
    pub(super) ear: tokio::sync::Mutex<Option<Port>>,
}

impl Default for FirstMessages {
    fn default() -> Self {
        Self {
            ports: Mutex::default(),
            learned: AtomicU64::default(),
            room: Semaphore::new(AT_ONCE),
            telling: Semaphore::new(TOLD_AT_ONCE),
            silent: Semaphore::new(SILENT_AT_ONCE),
            ear: tokio::sync::Mutex::default(),
        }
    }
}

#[derive(Debug)]
pub(super) struct Heard {
    /// The port that it is of, as the directory numbers it.
    pub(super) number: u64,
    pub(super) state: TypeSearch,
    pub(super) failures: u32,
    /// Signal that the first message has come.
    pub(super) bell: Arc<Notify>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum TypeSearch {
    /// The port is listened to, and may be sending.
    Listening,
    /// The port has sent nothing for a while.
    Silent,
    Known(&'static str),
    /// Failed try to listen to the port: the reason and the time.
    Failed(String, Instant),
}

impl FirstMessages {
    /// Number of ports whose type was learnt.
    pub(super) fn learned(&self) -> u64 {
        self.learned.load(Ordering::Acquire)
    }

    /// The type that the first message of a port has shown.
    pub(super) fn type_of(&self, port: &str, number: u64) -> Option<&'static str> {
        match self.ports.lock().get(port)? {
            Heard { number: heard, state: TypeSearch::Known(told), .. } if *heard == number => {
                Some(*told)
            }
            _ => None,
        }
    }

    /// Enters the state of a port, unless another one has its name by now.
    pub(super) fn set(&self, port: &str, number: u64, state: TypeSearch) {
        let mut ports = self.ports.lock();
        if let Some(heard) = ports.get_mut(port).filter(|heard| heard.number == number) {
            if matches!(state, TypeSearch::Failed(..)) {
                heard.failures = heard.failures.saturating_add(1);
            }
            heard.state = state;
        }
    }

    /// Takes a message in: the first one that tells is what counts.
    pub(super) fn hear(&self, received: &Received, limits: &wrapyfi_yarp::WireLimits) {
        let mut ports = self.ports.lock();
        let Some(heard) = ports.get_mut(&*received.from) else { return };
        if matches!(heard.state, TypeSearch::Known(_)) {
            return;
        }
        if let Some(told) = types::of_message(&received.payload, limits) {
            heard.state = TypeSearch::Known(told);
            self.learned.fetch_add(1, Ordering::Release);
            heard.bell.notify_one();
        }
    }

    /// Closes the port that listens.
    pub(super) async fn close(&self) {
        let ear = self.ear.lock().await.take();
        if let Some(ear) = ear {
            ear.close().await;
        }
    }
}
