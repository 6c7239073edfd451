//! Asks publishers and servers for what the master does not tell.
//!
//! ```text
//!   topic    lookupNode ─▶ requestTopic ─▶ TCPROS header ─▶ type, checksum, definition ─▶ Types; latches
//!   service  lookupService ─▶ TCPROS header with probe=1 ─▶ type
//! ```
//!
//! To be asked is to have a subscriber for a moment, so a publisher is asked once, and only where a route
//! has to know. The definition that it shows is remembered with all others.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::core::Core;
use super::header::Header;
use super::request::request_topic;
use super::tcpros;
use crate::endpoint::Role;

/// Time after which somebody who did not answer is asked again.
const AGAIN: Duration = Duration::from_secs(5);
/// Most answers that are remembered.
const MAX_ANSWERS: usize = 20_000;
/// Most questions under way at once.
const MAX_ASKED: usize = 64;

/// Who is asked: role, topic or service, node.
type Whom = (Role, String, String);

/// Questions and answers.
#[derive(Default)]
pub(super) struct Probes(Mutex<BTreeMap<Whom, Answer>>);

/// What came of a question.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Answer {
    /// Nothing yet.
    Asked,
    /// ROS 1 name of the type, and whether a publisher latches.
    Told { type_name: String, latches: bool },
    /// Why nothing came, and when.
    Failed(String, Instant),
}

impl Probes {
    fn answers(&self) -> MutexGuard<'_, BTreeMap<Whom, Answer>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What `node` says of the type of its topic or service; it is asked where it was not.
pub(super) fn ask(core: &Arc<Core>, role: Role, name: &str, node: &str) -> Answer {
    let whom = (role, name.to_owned(), node.to_owned());
    let mut answers = core.probes.answers();
    match answers.get(&whom) {
        Some(Answer::Failed(_, at)) if at.elapsed() >= AGAIN => {}
        Some(answer) => return answer.clone(),
        None => {}
    }
    let under_way = answers.values().filter(|answer| **answer == Answer::Asked).count();
    if under_way >= MAX_ASKED {
        return Answer::Asked;
    }
    if answers.len() >= MAX_ANSWERS {
        answers.retain(|_, answer| *answer == Answer::Asked);
    }
    let before = answers.insert(whom.clone(), Answer::Asked);
    drop(answers);
    let core_of_task = Arc::downgrade(core);
    core.handle.spawn(async move {
        let Some(core) = core_of_task.upgrade() else { return };
        let (role, name, node) = &whom;
        let told = match role {
            Role::Server => service(&core, name).await,
            _ => topic(&core, name, node).await,
        };
        let answer = match told {
            Ok((type_name, latches)) => Answer::Told { type_name, latches },
            Err(reason) => Answer::Failed(reason, Instant::now()),
        };
        core.probes.answers().insert(whom, answer);
    });
    // What was wrong before is said until it is known to be better.
    before.unwrap_or(Answer::Asked)
}

/// Forgets whoever is not named: a node that comes back may have another type.
pub(super) fn keep_only(core: &Core, there: impl Fn(Role, &str, &str) -> bool) {
    core.probes
        .answers()
        .retain(|(role, name, node), answer| *answer == Answer::Asked || there(*role, name, node));
}

async fn topic(core: &Core, name: &str, node: &str) -> Result<(String, bool), String> {
    let uri = core.master.lookup_node(node).await.map_err(|error| error.to_string())?;
    let uri = uri.ok_or_else(|| format!("the master knows no node {node}"))?;
    let (host, port) = request_topic(core, &uri, name).await?;
    let own = Header::new()
        .with("callerid", core.name.full())
        .with("topic", name)
        .with("type", "*")
        .with("md5sum", "*")
        .with("message_definition", "");
    let mut stream = tcpros::connect(&host, port).await?;
    let header = tcpros::greet(&mut stream, &own).await.map_err(|error| error.to_string())?;
    drop(stream);
    let type_name = told(&header)?;
    let text = header.get("message_definition").unwrap_or_default();
    let md5sum = header.get("md5sum").unwrap_or("*");
    if !text.is_empty() {
        let shown = core.types().show(&type_name, md5sum, text);
        shown.map_err(|error| error.to_string())?;
    }
    Ok((type_name, header.get("latching") == Some("1")))
}

async fn service(core: &Core, name: &str) -> Result<(String, bool), String> {
    let place = core.master.lookup_service(name).await.map_err(|error| error.to_string())?;
    let place = place.ok_or("the master knows it no more")?;
    let own = Header::new()
        .with("callerid", core.name.full())
        .with("service", name)
        .with("md5sum", "*")
        .with("probe", "1");
    let mut stream = tcpros::connect(&place.host, place.port).await?;
    let header = tcpros::greet(&mut stream, &own).await.map_err(|error| error.to_string())?;
    Ok((told(&header)?, false))
}

fn told(header: &Header) -> Result<String, String> {
    if let Some(error) = header.get("error") {
        return Err(format!("it refuses to tell: {}", error.chars().take(200).collect::<String>()));
    }
    match header.get("type") {
        Some(name) if name != "*" && !name.is_empty() => Ok(name.to_owned()),
        _ => Err("it does not tell its type".to_owned()),
    }
}
