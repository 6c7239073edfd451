//! A type that nobody here has, asked from a node that publishes it.
//!
//! ```text
//!   master ─ who publishes? ─▶ node ─ where? ─▶ its header ─ message_definition ─▶ the ROS 2 type
//! ```
//!
//! The connection ends with the header: nothing is registered and no message is received.

use std::sync::Arc;
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};

use tokio::time::{sleep, timeout};
use wrapyfi_interfaces::parser::TypeName;
use wrapyfi_interfaces::ros1::Types;
use wrapyfi_interfaces::store::ResolvedType;

use super::config::NodeUri;
use super::core::Core;
use super::header::Header;
use super::request::{request_topic, shortened};
use super::{Ros1, form, tcpros};

/// Pause between two looks at the master.
const LOOK: Duration = Duration::from_millis(100);
/// Longest time that one publisher has to show its definition.
const EACH: Duration = Duration::from_secs(2);

/// Why a type was not learned.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum AskTypeError {
    /// The name of the topic breaks the rules.
    #[error("{topic:?} is no name of a ROS 1 topic: {reason}")]
    Topic {
        /// As given.
        topic: String,
        /// What is wrong.
        reason: String,
    },
    /// Nobody showed it in time.
    #[error(
        "no publisher of {topic} showed a definition of {name} within {} ms: {reason}; start the \
         publisher first, or give a folder with the definition",
        patience.as_millis()
    )]
    NotShown {
        /// The topic.
        topic: String,
        /// The ROS 2 type.
        name: String,
        /// How long they were asked.
        patience: Duration,
        /// What was found last.
        reason: String,
    },
    /// The node ended meanwhile.
    #[error("the ROS 1 node has ended")]
    Ended,
}

impl Ros1 {
    /// The ROS 2 type `name`, made from what a publisher of `topic` shows. Asks again and again for as
    /// long as `patience`, once at least; blocks the caller.
    ///
    /// # Errors
    /// When nobody shows it in time.
    pub fn learn(
        &self,
        topic: &str,
        name: &TypeName,
        patience: Duration,
    ) -> Result<ResolvedType, AskTypeError> {
        let topic = self.core.name.resolve(topic).map_err(|error| AskTypeError::Topic {
            topic: topic.to_owned(),
            reason: error.reason,
        })?;
        let (core, name) = (Arc::clone(&self.core), name.clone());
        let (tell, told) = channel();
        // A task, and a channel of threads: the caller may itself be a task of some runtime.
        self.core.handle.spawn(async move {
            // The caller waits.
            _ = tell.send(ask(&core, topic, name, patience).await);
        });
        told.recv().unwrap_or(Err(AskTypeError::Ended))
    }
}

/// Asks again and again.
async fn ask(
    core: &Core,
    topic: String,
    name: TypeName,
    patience: Duration,
) -> Result<ResolvedType, AskTypeError> {
    let begin = Instant::now();
    loop {
        let reason = match shown(core, &topic, &name).await {
            Ok(found) => return Ok(found),
            Err(reason) => reason,
        };
        if begin.elapsed() >= patience {
            let name = name.to_string();
            return Err(AskTypeError::NotShown { topic, name, patience, reason });
        }
        sleep(LOOK).await;
    }
}

/// Asks every publisher once.
async fn shown(core: &Core, topic: &str, name: &TypeName) -> Result<ResolvedType, String> {
    let state = core.master.system_state().await.map_err(|error| error.to_string())?;
    let nodes = state.publishers.into_iter().find(|(known, _)| known == topic);
    let mut reason = "nobody publishes it".to_owned();
    for node in nodes.into_iter().flat_map(|(_, nodes)| nodes) {
        let Ok(Some(uri)) = core.master.lookup_node(&node).await else { continue };
        let header = match timeout(EACH, header(core, &uri, topic)).await {
            Ok(Ok(header)) => header,
            Ok(Err(error)) => {
                reason = format!("{node}: {error}");
                continue;
            }
            Err(_) => {
                reason = format!("{node} did not answer within {} s", EACH.as_secs());
                continue;
            }
        };
        match read(&mut core.types(), &header, name) {
            Ok(found) => return Ok(found),
            Err(error) => reason = format!("{node}: {error}"),
        }
    }
    Err(reason)
}

/// What a publisher says of its topic.
async fn header(core: &Core, uri: &NodeUri, topic: &str) -> Result<Header, String> {
    let (host, port) = request_topic(core, uri, topic).await?;
    let mut stream = tcpros::connect(&host, port).await?;
    let own = Header::new()
        .with("callerid", core.name.full())
        .with("topic", topic)
        .with("type", form::ANY)
        .with("md5sum", form::ANY);
    let header = tcpros::greet(&mut stream, &own).await.map_err(|error| error.to_string())?;
    match header.get("error") {
        Some(error) => Err(shortened(error)),
        None => Ok(header),
    }
}

/// The type of that name, from the definition in a header.
fn read(types: &mut Types, header: &Header, name: &TypeName) -> Result<ResolvedType, String> {
    let get = |field| header.get(field).unwrap_or_default();
    let shown = types.show(get("type"), get("md5sum"), get("message_definition"));
    let definition = shown.map_err(|error| shortened(&error.to_string()))?;
    let rules = types.rules();
    let belongs = rules.ros2_names(definition.name()).contains(name)
        || rules.ros1_names(name).contains(definition.name());
    if !belongs {
        return Err(format!(
            "it publishes {}, the counterpart of another type",
            definition.ros1_name()
        ));
    }
    types.ros2_type_named(name).map_err(|error| shortened(&error.to_string()))
}
