//! Topics of any type whose definition is known: messages as named fields.
//!
//! ```text
//!   DDS reader ─ CDR ─▶ TypePlan::decode ─▶ DynamicMessage ─▶ user
//!   user ─▶ DynamicMessage ─▶ TypePlan::encode ─ CDR ─▶ DDS writer, with the type's hash
//! ```
//!
//! Endpoints for tools: nothing is queued but in DDS itself.

use std::sync::Arc;

use bytes::Bytes;
use wrapyfi_interfaces::dynamic::{DynamicMessage, PlanError, TypePlan, ValueError};
use wrapyfi_interfaces::store::ResolvedType;

use super::graph::{CdrReader, CdrWriter, GraphError, Notify, TopicDescription};
use super::ros2::Ros2;
use wrapyfi_endpoint::{OpenError, Qos, Wake};

/// Error of sending or receiving a message of a type known at run time.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AnyError {
    /// The definition cannot be compiled.
    #[error("{type_name} cannot be used: {fault}")]
    Definition {
        /// The type.
        type_name: String,
        /// Fault of the type.
        fault: Box<PlanError>,
    },
    /// The name of the topic is not valid, or the endpoint cannot be opened.
    #[error("{0}")]
    Open(String),
    /// A message does not follow its definition.
    #[error("{topic:?} carries a message that is no {type_name}: {fault}")]
    Malformed {
        /// The topic.
        topic: String,
        /// The type it should have.
        type_name: String,
        /// Fault of the definition.
        fault: String,
    },
    /// A message cannot be written.
    #[error("the message is no {type_name}: {fault}")]
    Unencodable {
        /// The type it should have.
        type_name: String,
        /// Field of the value and its fault.
        fault: Box<ValueError>,
    },
    /// DDS refused.
    #[error(transparent)]
    Graph(#[from] GraphError),
}

/// A message as it was received.
#[derive(Debug, Clone, PartialEq)]
pub struct AnyMessage {
    /// Fields of the message.
    pub fields: DynamicMessage,
    /// Encapsulation header and body.
    pub cdr: Bytes,
    /// Time at which the publisher sent it, in nanoseconds since 1970.
    pub source_timestamp_ns: i64,
}

/// Receives one topic of any type.
pub struct AnyListener {
    reader: Box<dyn CdrReader>,
    plan: TypePlan,
    topic: TopicDescription,
}

/// Sends to one topic of any type.
pub struct AnyPublisher {
    writer: Box<dyn CdrWriter>,
    plan: TypePlan,
    topic: TopicDescription,
}

impl AnyListener {
    /// Starts receiving `topic`; `wake` is rung when something arrives or matches. Messages over
    /// `max_bytes` are dropped on reception.
    ///
    /// # Errors
    /// When the name or the definition cannot be used, or DDS refuses.
    pub fn open(
        ros2: &Ros2,
        topic: &str,
        resolved: &ResolvedType,
        qos: Qos,
        max_bytes: usize,
        wake: &Wake,
    ) -> Result<Self, AnyError> {
        let (topic, plan) = prepare(ros2, topic, resolved, qos, max_bytes)?;
        let reader = ros2.graph().subscribe(&topic, ringing(wake))?;
        Ok(Self { reader, plan, topic })
    }

    /// The next message, if one waits.
    ///
    /// # Errors
    /// The next message was unusable. It is gone; the one after it can be taken.
    pub fn take(&mut self) -> Result<Option<AnyMessage>, AnyError> {
        let Some(sample) = self.reader.take()? else { return Ok(None) };
        let fields = self.plan.decode(&sample.cdr, self.topic.max_bytes).map_err(|fault| {
            AnyError::Malformed {
                topic: self.topic.name.clone(),
                type_name: self.topic.type_name.clone(),
                fault: fault.to_string(),
            }
        })?;
        Ok(Some(AnyMessage {
            fields,
            cdr: sample.cdr,
            source_timestamp_ns: sample.source_timestamp_ns,
        }))
    }

    /// Publishers matched now.
    #[must_use]
    pub fn publishers(&self) -> usize {
        self.reader.matched()
    }

    /// Messages that DDS lost since the last call.
    pub fn lost(&mut self) -> u64 {
        self.reader.lost()
    }

    /// Policy over which the last publisher was refused (`reliability`, …).
    #[must_use]
    pub fn incompatible(&self) -> Option<&'static str> {
        self.reader.incompatible()
    }

    /// Topic as it was opened: absolute name, type, hash.
    #[must_use]
    pub fn topic(&self) -> &TopicDescription {
        &self.topic
    }
}

impl AnyPublisher {
    /// Prepares sending to `topic`; `wake` is rung when subscriptions come or go.
    ///
    /// # Errors
    /// As [`AnyListener::open`].
    pub fn open(
        ros2: &Ros2,
        topic: &str,
        resolved: &ResolvedType,
        qos: Qos,
        max_bytes: usize,
        wake: &Wake,
    ) -> Result<Self, AnyError> {
        let (topic, plan) = prepare(ros2, topic, resolved, qos, max_bytes)?;
        let writer = ros2.graph().advertise(&topic, ringing(wake))?;
        Ok(Self { writer, plan, topic })
    }

    /// Plan by which messages of the type are made, for instance from JSON.
    #[must_use]
    pub fn plan(&self) -> &TypePlan {
        &self.plan
    }

    /// Sends a message; its size in bytes.
    ///
    /// # Errors
    /// When it is not of the type, or was not sent.
    pub fn publish(&mut self, message: &DynamicMessage) -> Result<usize, AnyError> {
        let cdr = self.plan.encode(message).map_err(|fault| AnyError::Unencodable {
            type_name: self.topic.type_name.clone(),
            fault: Box::new(fault),
        })?;
        let pieces: Vec<&[u8]> = cdr.pieces().iter().map(AsRef::as_ref).collect();
        self.writer.write(&pieces)?;
        Ok(cdr.len())
    }

    /// Subscriptions matched now.
    #[must_use]
    pub fn listeners(&self) -> usize {
        self.writer.matched()
    }

    /// Policy over which the last subscription was refused (`reliability`, …).
    #[must_use]
    pub fn incompatible(&self) -> Option<&'static str> {
        self.writer.incompatible()
    }

    /// Topic as it was opened: absolute name, type, hash.
    #[must_use]
    pub fn topic(&self) -> &TopicDescription {
        &self.topic
    }
}

fn prepare(
    ros2: &Ros2,
    topic: &str,
    resolved: &ResolvedType,
    qos: Qos,
    max_bytes: usize,
) -> Result<(TopicDescription, TypePlan), AnyError> {
    let type_name = resolved.name().to_string();
    let plan = resolved.plan().map_err(|fault| AnyError::Definition {
        type_name: type_name.clone(),
        fault: Box::new(fault),
    })?;
    let name = ros2.resolve(topic).map_err(|error: OpenError| AnyError::Open(error.to_string()))?;
    let type_hash = Some(resolved.type_hash());
    Ok((TopicDescription { name, type_name, type_hash, qos, max_bytes }, plan))
}

pub(super) fn ringing(wake: &Wake) -> Notify {
    let wake = wake.clone();
    Arc::new(move || wake.ring())
}
