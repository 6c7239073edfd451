//! Learns the type of a port from its first message.
//!
//! ```text
//!   learn /imu ─▶ one of 24 at once: /imu ═▶ /wrapyfi/types:in7 ── first message ─▶ its type, disconnected
//!                       │ nothing within 0.05 s: the next one has its turn
//!                       └─▶ stays connected, for as long as it sends nothing (at most 64 ports)
//! ```

use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::Notify;
use wrapyfi_yarp::port::{Answer, PortOptions, Received};

use super::first_message::{Heard, SILENT_AT_ONCE, TypeSearch};
use super::opening::numbered;
use super::registered_port::Entry;
use super::shared::InstanceState;
use super::survey::pause;
use wrapyfi_endpoint::LearnError;

/// Time for which a port counts as one that sends often: twenty messages a second, of which one is
/// heard, are no load.
const WINDOW: Duration = Duration::from_millis(50);
/// Name of the port that listens, before its number.
const EAR: &str = "/wrapyfi/types";

/// The type of what a port sends, by its first message. Returns at once: where that has to be waited for,
/// a later call has the answer.
///
/// # Errors
/// Why the type is not known yet.
pub(super) fn learn(shared: &Arc<InstanceState>, port: &str) -> Result<String, LearnError> {
    let name = port.to_owned();
    let Some(entry) = shared.directory.entry(port) else {
        // Its name went since it was found, and may come again.
        let reason = "no program has opened it".to_owned();
        return Err(LearnError::Silent { name, reason });
    };
    let (number, now) = (entry.number, Instant::now());
    if shared.survey.is_being_asked(port) {
        // It may promise a type, or send nothing at all.
        return Err(LearnError::Asked(name));
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
            TypeSearch::Known(told) => return Ok((*told).to_owned()),
            TypeSearch::Listening => return Err(LearnError::Asked(name)),
            TypeSearch::Silent => {
                let reason = "it has sent nothing yet, and its first message will tell".to_owned();
                return Err(LearnError::Silent { name, reason });
            }
            TypeSearch::Failed(reason, at)
                if now.saturating_duration_since(*at) < pause(heard.failures) =>
            {
                return Err(LearnError::Silent { name, reason: reason.clone() });
            }
            TypeSearch::Failed(..) => heard.failures,
        },
    };
    // The program that listens has to be reached.
    if let Err(refused) = shared.may_listen() {
        return Err(LearnError::Silent { name, reason: refused.to_string() });
    }
    ports.retain(|name, _| shared.directory.knows(name));
    let bell = Arc::new(Notify::new());
    let heard = Heard { number, state: TypeSearch::Listening, failures, bell: Arc::clone(&bell) };
    ports.insert(name.clone(), heard);
    drop(ports);
    let (tasks, to_listen) = (Arc::clone(shared), name.clone());
    tasks.tasks.spawn_aside(listen(Arc::clone(shared), to_listen, entry, bell));
    Err(LearnError::Asked(name))
}

/// Listens to a port until it has sent a message that tells its type, or is another one.
async fn listen(shared: Arc<InstanceState>, port: String, entry: Entry, first: Arc<Notify>) {
    let (number, contact) = (entry.number, entry.contact());
    let heard = &shared.types.heard;
    let Ok(turn) = heard.room.acquire().await else { return };
    let ear = match ear(&shared).await {
        Ok(ear) => ear,
        Err(reason) => return heard.set(&port, number, TypeSearch::Failed(reason, Instant::now())),
    };
    let target = format!("tcp:/{ear}");
    let told = heard.telling.acquire().await;
    let connected = shared.network.add_output(&port, contact.as_deref(), &target).await;
    drop(told);
    if let Err(error) = connected {
        tracing::debug!(port, %error, "is not listened to");
        let reason = error.to_string();
        return heard.set(&port, number, TypeSearch::Failed(reason, Instant::now()));
    }
    let waited = tokio::time::timeout(WINDOW, first.notified()).await;
    drop(turn);
    if waited.is_err() {
        match heard.silent.try_acquire() {
            Ok(_place) => {
                // Its message may have come just now.
                if heard.type_of(&port, number).is_none() {
                    heard.set(&port, number, TypeSearch::Silent);
                    stays(&shared, &port, number, &first).await;
                }
            }
            Err(_full) => {
                let reason = format!(
                    "it has sent nothing for {} ms, and {SILENT_AT_ONCE} others that are silent are \
                     waited for",
                    WINDOW.as_millis()
                );
                heard.set(&port, number, TypeSearch::Failed(reason, Instant::now()));
            }
        }
    }
    if let Err(error) = shared.network.remove_output(&port, contact.as_deref(), &ear).await {
        tracing::debug!(port, %error, "stays connected until it sends again");
    }
}

/// Waits for the first message of a silent port, for as long as it is that port.
async fn stays(shared: &InstanceState, port: &str, number: u64, first: &Notify) {
    let changes = shared.directory.watch(port);
    while shared.directory.entry(port).is_some_and(|entry| entry.number == number) {
        tokio::select! {
            () = first.notified() => return,
            () = changes.notified() => {}
        }
    }
}

/// The name of the port that all send to, which is opened where it is not open.
async fn ear(shared: &Arc<InstanceState>) -> Result<String, String> {
    let mut ear = shared.types.heard.ear.lock().await;
    if let Some(open) = &*ear {
        return Ok(open.name().to_owned());
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
    // It belongs to no endpoint.
    shared.own.insert(&name);
    *ear = Some(port);
    Ok(name)
}
