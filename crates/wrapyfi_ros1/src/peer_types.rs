//! Asks publishers and servers for what the master does not tell.
//!
//! ```text
//!   topic    lookupNode ─▶ requestTopic ─▶ TCPROS header ─▶ type, checksum, definition ─▶ Types; latches
//!   service  lookupService ─▶ TCPROS header with probe=1 ─▶ type, checksum
//! ```
//!
//! To be asked is to have a subscriber for a moment, so a publisher is asked once, and only where a route
//! has to know. The definition that it shows is remembered with all others.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::time::timeout;
use wrapyfi_interfaces::ros1::Definition;

use super::config::NodeUri;
use super::core::Core;
use super::header::Header;
use super::http;
use super::tcpros::{self, GreetingError};
use super::xmlrpc::{Reply, SUCCESS, Value, shortened, text};
use wrapyfi_endpoint::{Mutex, Role};

/// Longest time that one of them has to answer.
const ANSWER: Duration = Duration::from_secs(3);
/// Time after which a node that did not answer is asked again.
const AGAIN: Duration = Duration::from_secs(5);
/// Most answers that are remembered.
const MAX_ANSWERS: usize = 20_000;
/// Most questions under way at once.
const MAX_ASKED: usize = 64;

/// Checksum of a type without fields.
const OF_NO_FIELDS: &str = "d41d8cd98f00b204e9800998ecf8427e";

/// Key of a question: role, topic or service, and the node that is asked.
pub(super) type Whom = (Role, String, String);

/// Questions and answers.
pub(super) type PeerTypes = Mutex<BTreeMap<Whom, TypeQuestion>>;

/// State of a question.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum TypeQuestion {
    /// Question that was asked and has no answer yet.
    Asked,
    Known(TypeInfo),
    /// Failed question: the reason and the time.
    Failed(Unanswered, Instant),
}

/// Reason that a publisher or a server has not told its type.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Unanswered {
    /// It could not be asked.
    Away(String),
    /// Its connection header, or the definition of the type that it names, cannot be read.
    Unreadable(Option<String>, String),
}

impl From<String> for Unanswered {
    fn from(reason: String) -> Self {
        Self::Away(reason)
    }
}

impl From<GreetingError> for Unanswered {
    fn from(error: GreetingError) -> Self {
        match error {
            GreetingError::Header(error) => Self::Unreadable(None, error.to_string()),
            error => Self::Away(error.to_string()),
        }
    }
}

/// Type that a publisher or a server has told of its topic or service.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TypeInfo {
    /// ROS 1 name of the type.
    pub(super) type_name: String,
    /// Definition that a publisher has shown, which another one of the same type may have in another version.
    pub(super) definition: Option<Arc<Definition>>,
    /// Checksum that a server has told, which shows no definition.
    pub(super) md5sum: Option<String>,
    /// A publisher sends its last message to each new subscriber.
    pub(super) latches: bool,
    /// Address that gave the answer.
    place: NodeUri,
}

/// Returns the answer of `node` about the type of its topic or service, and asks the node where
/// none is known.
pub(super) fn ask(core: &Arc<Core>, role: Role, name: &str, node: &str) -> TypeQuestion {
    let whom = (role, name.to_owned(), node.to_owned());
    let mut answers = core.peer_types.lock();
    match answers.get(&whom) {
        Some(TypeQuestion::Failed(_, at)) if at.elapsed() >= AGAIN => {}
        Some(answer) => return answer.clone(),
        None => {}
    }
    let under_way = answers.values().filter(|answer| **answer == TypeQuestion::Asked).count();
    if under_way >= MAX_ASKED {
        return TypeQuestion::Asked;
    }
    if answers.len() >= MAX_ANSWERS {
        answers.retain(|_, answer| *answer == TypeQuestion::Asked);
    }
    let before = answers.insert(whom.clone(), TypeQuestion::Asked);
    drop(answers);
    let (core_of_task, failure_before) = (Arc::downgrade(core), before.clone());
    let failed = |why| TypeQuestion::Failed(why, Instant::now());
    core.handle.spawn(async move {
        let Some(core) = core_of_task.upgrade() else { return };
        let (role, name, node) = &whom;
        let told = timeout(ANSWER, async {
            match role {
                Role::Server => service(&core, name).await,
                _ => topic(&core, name, node).await,
            }
        });
        let silent = || Err(format!("it did not answer within {} s", ANSWER.as_secs()).into());
        let answer = match told.await.unwrap_or_else(|_elapsed| silent()) {
            Ok(told) => TypeQuestion::Known(told),
            Err(Unanswered::Away(reason)) => failed(Unanswered::Away(shortened(&reason))),
            Err(Unanswered::Unreadable(type_name, reason)) => {
                let why = Unanswered::Unreadable(type_name, shortened(&reason));
                // Once, as long as it stays the same.
                if !matches!(&failure_before, Some(TypeQuestion::Failed(before, _)) if *before == why) {
                    tracing::warn!(
                        "ROS 1: what {node} tells of {name} cannot be read: {}",
                        shortened(&reason)
                    );
                }
                failed(why)
            }
        };
        core.peer_types.lock().insert(whom, answer);
    });
    // The failure before stands until a better answer is known.
    before.unwrap_or(TypeQuestion::Asked)
}

/// Forgets each node that `there` does not know: a node that comes back may have another type.
pub(super) fn keep_only(core: &Core, there: impl Fn(Role, &str, &str) -> bool) {
    core.peer_types.lock().retain(|(role, name, node), answer| {
        *answer == TypeQuestion::Asked || there(*role, name, node)
    });
}

/// Forgets what servers of a service have told: the one there is of another type.
pub(super) fn forget_service(core: &Core, service: &str) {
    keep_only(core, |role, name, _| (role, name) != (Role::Server, service));
}

/// Compares what publishers of a topic have told with the header that one of them greets a listener with. One that
/// came back with another type or definition is asked again, and so are all where one refuses and does not say who.
pub(super) fn compare(core: &Core, topic: &str, header: &Header) {
    let caller = header.get("callerid");
    core.peer_types.lock().retain(|(role, name, node), answer| {
        let TypeQuestion::Known(told) = answer else { return true };
        let is_meant = *role == Role::Publisher && name == topic;
        if !is_meant || caller.is_some_and(|caller| caller != node) {
            return true;
        }
        let shown = told.definition.as_ref().map(|definition| definition.md5sum.as_str());
        let is_same = |shown: &str| header.get("md5sum").is_some_and(|now| now == shown);
        header.get("type") == Some(told.type_name.as_str()) && shown.is_none_or(is_same)
    });
}

async fn topic(core: &Core, name: &str, node: &str) -> Result<TypeInfo, Unanswered> {
    let uri = core.master.lookup_node(node).await.map_err(|error| error.to_string())?;
    let uri = uri.ok_or_else(|| format!("the master knows no node {node}"))?;
    let (host, port) = request_topic(core, &uri, name).await?;
    // Under the node's own name rospy would end the connection of a listener that is there.
    let own = core
        .header_of_part("probe")
        .with("topic", name)
        .with("type", "*")
        .with("md5sum", "*")
        .with("message_definition", "");
    let place = NodeUri { host, port };
    let header = greeted(&place, &own).await?;
    let type_name = type_in(&header)?;
    let text = header.get("message_definition").unwrap_or_default();
    let md5sum = header.get("md5sum").unwrap_or("*");
    // A type without fields has an empty text, too.
    let is_shown = !text.is_empty() || md5sum == OF_NO_FIELDS;
    let shown = is_shown.then(|| core.types().show(&type_name, md5sum, text));
    let definition = shown
        .transpose()
        .map_err(|error| Unanswered::Unreadable(Some(type_name.clone()), error.to_string()))?
        .map(Arc::new);
    Ok(TypeInfo { type_name, definition, md5sum: None, latches: header.is_set("latching"), place })
}

/// Asks the node at `uri` for the host and port at which it sends `topic` by TCPROS.
pub(super) async fn request_topic(
    core: &Core,
    uri: &NodeUri,
    topic: &str,
) -> Result<(String, u16), String> {
    let protocols = Value::Array(vec![Value::Array(vec![text("TCPROS")])]);
    let params = vec![text(core.name.full()), text(topic), protocols];
    let reply = http::call(uri, "requestTopic", params).await;
    let Reply { status, text: words, value } =
        reply.map_err(|error| format!("it {}", error.what))?;
    if status != SUCCESS {
        return Err(format!("it does not send the topic: {}", shortened(&words)));
    }
    match &value {
        Value::Array(parts) => match parts.as_slice() {
            [Value::String(_), Value::String(host), Value::Integer(port), ..] => {
                let port = u16::try_from(*port).map_err(|_e| format!("port {port} is none"))?;
                Ok((core.master.whereabouts.of_host(host), port))
            }
            [] => Err("it does not speak TCPROS".to_owned()),
            _ => Err("it names no way to the topic".to_owned()),
        },
        _ => Err("it names no way to the topic".to_owned()),
    }
}

async fn service(core: &Core, name: &str) -> Result<TypeInfo, Unanswered> {
    let place = core.master.lookup_service(name).await.map_err(|error| error.to_string())?;
    let place = place.ok_or_else(|| "the master knows it no more".to_owned())?;
    let header = greeted(&place, &probe_header(core, name)).await?;
    let md5sum = header.get("md5sum").filter(|it| *it != "*").map(str::to_owned);
    Ok(TypeInfo { type_name: type_in(&header)?, definition: None, md5sum, latches: false, place })
}

/// Checksum that the server of a service has told; `None` where none was asked.
pub(super) fn told_md5sum(core: &Core, service: &str) -> Option<String> {
    core.peer_types.lock().iter().find_map(|((role, name, _), answer)| match answer {
        TypeQuestion::Known(told) if *role == Role::Server && name == service => {
            told.md5sum.clone()
        }
        _ => None,
    })
}

/// True when a server that has told its type still answers for the service at the same address.
pub(super) async fn still_serves(core: &Core, service: &str, node: &str) -> bool {
    let whom = (Role::Server, service.to_owned(), node.to_owned());
    let told = match core.peer_types.lock().get(&whom) {
        Some(TypeQuestion::Known(told)) => told.clone(),
        _ => return false,
    };
    let own = probe_header(core, service);
    let greeting = timeout(ANSWER, greeted(&told.place, &own));
    greeting.await.is_ok_and(|header| header.is_ok_and(|header| header.get("error").is_none()))
}

/// Header with which a server is asked for its type, without a call.
pub(super) fn probe_header(core: &Core, service: &str) -> Header {
    core.header().with("service", service).with("md5sum", "*").with("probe", "1")
}

/// The header of who is at `place`; the connection ends with it.
pub(super) async fn greeted(place: &NodeUri, own: &Header) -> Result<Header, GreetingError> {
    tcpros::greeted(&place.host, place.port, own).await.map(|(_, header)| header)
}

fn type_in(header: &Header) -> Result<String, String> {
    if let Some(error) = header.get("error") {
        return Err(format!("it refuses to tell: {error}"));
    }
    match header.get("type") {
        Some(name) if name != "*" && !name.is_empty() => Ok(name.to_owned()),
        _ => Err("it does not tell its type".to_owned()),
    }
}
