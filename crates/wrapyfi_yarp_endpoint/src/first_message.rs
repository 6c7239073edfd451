//! The first message of a port, which shows its type.
//!
//! ```text
//!   learn /imu ─▶ one of 24 at once: /imu ═▶ /wrapyfi/types:in7 ── first message ─▶ its type, disconnected
//!                       │ nothing within 0.05 s: the next one has its turn
//!                       └─▶ stays connected, for as long as it sends nothing (at most 64 ports)
//! ```
//!
//! A port that sends nothing costs nothing: so the first message of one that is silent ends its wait,
//! whenever it comes, and nobody has to be asked again and again.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use tokio::sync::{Notify, Semaphore};
use wrapyfi_yarp::port::{Answer, PortOptions, Received, RpcServer};

use super::directory::Entry;
use super::opening::numbered;
use super::survey::pause;
use super::{Shared, types};
use wrapyfi_endpoint::{LearnError, Mutex};

/// Most ports that are listened to at once, of those that may send often. Fewer would have ports that send
/// once a second wait for each other: 50 of them in turns of 8 take a third of a second longer.
const AT_ONCE: usize = 24;
/// Most ports that are told at once to connect. Each asks the name server where we are, and YARP's has room
/// for five who wait: the others would try again after a second.
const TOLD_AT_ONCE: usize = 4;
/// Most ports that are waited for although they send nothing.
const SILENT_AT_ONCE: usize = 64;
/// Time for which a port counts as one that sends often: twenty messages a second, of which one is
/// heard, are no load.
const WINDOW: Duration = Duration::from_millis(50);
/// Name of the port that listens, before its number.
const EAR: &str = "/wrapyfi/types";

/// Types of ports, learnt from the first message that each of them sends.
#[derive(Debug)]
pub(super) struct FirstMessages {
    ports: Mutex<BTreeMap<String, Heard>>,
    /// Counts the types that were shown.
    learned: AtomicU64,
    room: Semaphore,
    telling: Semaphore,
    silent: Semaphore,
    /// The port that all send to, once there is something to listen to.
    ear: tokio::sync::Mutex<Option<Ear>>,
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
struct Ear {
    name: String,
    port: RpcServer,
}

#[derive(Debug)]
struct Heard {
    /// The port that it is of, as the directory numbers it.
    number: u64,
    state: State,
    failures: u32,
    /// Signal that the first message has come.
    bell: Arc<Notify>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum State {
    /// The port is listened to, and may be sending.
    Listening,
    /// The port has sent nothing for a while.
    Silent,
    Told(&'static str),
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
            Heard { number: heard, state: State::Told(told), .. } if *heard == number => {
                Some(*told)
            }
            _ => None,
        }
    }

    fn set(&self, port: &str, number: u64, state: State) {
        let mut ports = self.ports.lock();
        if let Some(heard) = ports.get_mut(port).filter(|heard| heard.number == number) {
            if matches!(state, State::Failed(..)) {
                heard.failures = heard.failures.saturating_add(1);
            }
            heard.state = state;
        }
    }

    /// Takes a message in: the first one that tells is what counts.
    fn hear(&self, received: &Received, limits: &wrapyfi_yarp::Limits) {
        let mut ports = self.ports.lock();
        let Some(heard) = ports.get_mut(&*received.from) else { return };
        if matches!(heard.state, State::Told(_)) {
            return;
        }
        if let Some(told) = types::of_message(&received.payload, limits) {
            heard.state = State::Told(told);
            self.learned.fetch_add(1, Ordering::Release);
            heard.bell.notify_one();
        }
    }

    /// Closes the port that listens.
    pub(super) async fn close(&self) {
        let ear = self.ear.lock().await.take();
        if let Some(ear) = ear {
            ear.port.close().await;
        }
    }
}

/// The type of what a port sends, by its first message. Returns at once: where that has to be waited for,
/// a later call has the answer.
///
/// # Errors
/// Why the type is not known yet.
pub(super) fn learn(shared: &Arc<Shared>, port: &str) -> Result<String, LearnError> {
    let name = port.to_owned();
    let Some(entry) = shared.directory.entry(port) else {
        // Its name went since it was found, and may come again.
        let reason = "no program has opened it".to_owned();
        return Err(LearnError::Silent { name, reason });
    };
    let (number, now) = (entry.number, Instant::now());
    if shared.survey.is_being_asked(port) {
        // It may promise a type, or send nothing at all.
        return Err(LearnError::Asked { name });
    }
    let said = shared.survey.answer_of(port);
    let promised = said.as_ref().and_then(|said| said.type_name.as_deref());
    if let Some(known) = shared.types.of(port, number, promised) {
        return Ok(known);
    }
    let mut ports = shared.types.heard.ports.lock();
    let known = ports.get(port).filter(|heard| heard.number == number);
    let failures = match known {
        None => 0,
        Some(heard) => match &heard.state {
            State::Told(told) => return Ok((*told).to_owned()),
            State::Listening => return Err(LearnError::Asked { name }),
            State::Silent => {
                let reason = "it has sent nothing yet, and its first message will tell".to_owned();
                return Err(LearnError::Silent { name, reason });
            }
            State::Failed(reason, at)
                if now.saturating_duration_since(*at) < pause(heard.failures) =>
            {
                return Err(LearnError::Silent { name, reason: reason.clone() });
            }
            State::Failed(..) => heard.failures,
        },
    };
    // Whoever listens has to be reached.
    if let Err(refused) = shared.may_listen() {
        return Err(LearnError::Silent { name, reason: refused.to_string() });
    }
    ports.retain(|name, _| shared.directory.knows(name));
    let bell = Arc::new(Notify::new());
    let heard = Heard { number, state: State::Listening, failures, bell: Arc::clone(&bell) };
    ports.insert(name.clone(), heard);
    drop(ports);
    let (tasks, to_listen) = (Arc::clone(shared), name.clone());
    tasks.tasks.spawn_aside(listen(Arc::clone(shared), to_listen, entry, bell));
    Err(LearnError::Asked { name })
}

/// Listens to a port until it has sent a message that tells its type, or is another one.
async fn listen(shared: Arc<Shared>, port: String, entry: Entry, first: Arc<Notify>) {
    let Entry { number, contact, .. } = entry;
    let heard = &shared.types.heard;
    let Ok(turn) = heard.room.acquire().await else { return };
    let ear = match ear(&shared).await {
        Ok(ear) => ear,
        Err(reason) => return heard.set(&port, number, State::Failed(reason, Instant::now())),
    };
    let target = format!("tcp:/{ear}");
    let told = heard.telling.acquire().await;
    let connected = shared.network.add_output(&port, contact.as_deref(), &target).await;
    drop(told);
    if let Err(error) = connected {
        tracing::debug!(port, %error, "is not listened to");
        let reason = error.to_string();
        return heard.set(&port, number, State::Failed(reason, Instant::now()));
    }
    let waited = tokio::time::timeout(WINDOW, first.notified()).await;
    drop(turn);
    if waited.is_err() {
        match heard.silent.try_acquire() {
            Ok(_place) => {
                // Its message may have come just now.
                if heard.type_of(&port, number).is_none() {
                    heard.set(&port, number, State::Silent);
                    stays(&shared, &port, number, &first).await;
                }
            }
            Err(_full) => {
                let reason = format!(
                    "it has sent nothing for {} ms, and {SILENT_AT_ONCE} others that are silent are \
                     waited for",
                    WINDOW.as_millis()
                );
                heard.set(&port, number, State::Failed(reason, Instant::now()));
            }
        }
    }
    if let Err(error) = shared.network.remove_output(&port, contact.as_deref(), &ear).await {
        tracing::debug!(port, %error, "stays connected until it sends again");
    }
}

/// Waits for the first message of a silent port, for as long as it is that port.
async fn stays(shared: &Shared, port: &str, number: u64, first: &Notify) {
    let changes = shared.directory.watch(port);
    while shared.directory.entry(port).is_some_and(|entry| entry.number == number) {
        tokio::select! {
            () = first.notified() => return,
            () = changes.notified() => {}
        }
    }
}

/// The name of the port that all send to, which is opened where it is not open.
async fn ear(shared: &Arc<Shared>) -> Result<String, String> {
    let mut ear = shared.types.heard.ear.lock().await;
    if let Some(open) = &*ear {
        return Ok(open.name.clone());
    }
    let weak = Arc::downgrade(shared);
    let handler = move |received: Received, _reply| {
        if let Some(shared) = weak.upgrade() {
            shared.types.heard.hear(&received, shared.network.limits());
        }
        std::future::ready(Answer::Nothing)
    };
    let opened = shared.network.serve(&numbered(EAR), &PortOptions::default(), handler).await;
    let port = opened.map_err(|error| error.to_string())?;
    let name = port.name().to_owned();
    // It is nobody's endpoint.
    shared.own.insert(&name);
    *ear = Some(Ear { name: name.clone(), port });
    Ok(name)
}
