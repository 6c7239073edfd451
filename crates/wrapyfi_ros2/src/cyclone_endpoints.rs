//! Writers and readers of a node on CycloneDDS.
//!
//! ```text
//!   CycloneWriter ─ RawWriter ─┐                 CycloneReader ─ RawReader ─┐
//!         └──── Listed ────────┴──▶ Node ◀──────────── Listed ──────────────┘
//! ```
//!
//! Each keeps the node alive and is listed in it.

use std::sync::Arc;

use super::cyclone::{Events, RawReader, RawWriter, Taken, WriteFault};
use super::discovery_info::{Announcing, EndpointKind, Gid};
use super::graph::{CdrReader, CdrSample, CdrWriter, GraphError, QosEvents};
use super::pacing::{MAX_BLOCKING, Pacing};
use wrapyfi_node::NodeName;

/// An endpoint's entry in its node, removed on drop.
pub(super) struct Listed {
    node: Arc<dyn Announcing>,
    /// Node of another middleware that the endpoint stands for.
    other: Option<Arc<NodeName>>,
    kind: EndpointKind,
    gid: Gid,
}

impl Listed {
    pub(super) fn new(
        node: Arc<dyn Announcing>,
        other: Option<Arc<NodeName>>,
        kind: EndpointKind,
        gid: Gid,
    ) -> Self {
        node.info().add(other.as_deref(), kind, gid);
        Self { node, other, kind, gid }
    }
}

impl Drop for Listed {
    fn drop(&mut self) {
        self.node.info().remove(self.other.as_deref(), self.kind, &self.gid);
    }
}

/// Fields drop in this order: the writer, then its entry.
pub(super) struct CycloneWriter {
    pub(super) pacing: Pacing,
    pub(super) raw: RawWriter,
    pub(super) topic: String,
    pub(super) _listed: Listed,
}

impl CdrWriter for CycloneWriter {
    fn write(&mut self, parts: &[&[u8]]) -> Result<(), GraphError> {
        let bytes = parts.iter().map(|part| part.len()).sum();
        if !self.pacing.admit(&self.raw, bytes) {
            return Err(timeout(&self.topic));
        }
        let written = self.raw.write_spaced(parts, self.pacing.pause(bytes));
        written.map_err(|fault| refused(&self.topic, &fault))
    }

    fn slowed(&self) -> Option<wrapyfi_endpoint::Cause> {
        self.pacing.slowed()
    }

    fn matched(&self) -> usize {
        self.raw.events().matched()
    }

    fn incompatible(&self) -> Option<&'static str> {
        self.raw.events().incompatible()
    }

    fn qos_events(&self) -> QosEvents {
        qos_events(self.raw.events())
    }
}

/// Writes a message to `topic`.
pub(super) fn write(raw: &RawWriter, topic: &str, parts: &[&[u8]]) -> Result<(), GraphError> {
    raw.write(parts).map_err(|fault| refused(topic, &fault))
}

/// Error of a message to `topic` that Cyclone did not take.
fn refused(topic: &str, fault: &WriteFault) -> GraphError {
    match fault {
        WriteFault::Code(code) if code.is_timeout() => timeout(topic),
        WriteFault::Code(code) => GraphError::stack("writing", topic, code),
        WriteFault::Message(reason) => GraphError::stack("writing", topic, reason),
    }
}

fn timeout(topic: &str) -> GraphError {
    let timeout_ms = u64::try_from(MAX_BLOCKING.as_millis()).unwrap_or(u64::MAX);
    GraphError::Timeout { topic: topic.to_owned(), timeout_ms }
}

/// Fields drop in this order: the reader, then its entry.
pub(super) struct CycloneReader {
    pub(super) raw: RawReader,
    pub(super) topic: String,
    pub(super) max_bytes: usize,
    pub(super) _listed: Listed,
}

impl CdrReader for CycloneReader {
    fn take(&mut self) -> Result<Option<CdrSample>, GraphError> {
        match self.raw.take(self.max_bytes) {
            Ok(Taken::Nothing) => Ok(None),
            Ok(Taken::Message(sample, _)) => Ok(Some(sample)),
            Ok(Taken::TooLarge(actual)) => Err(GraphError::TooLarge {
                topic: self.topic.clone(),
                actual,
                limit: self.max_bytes,
            }),
            Err(code) => Err(GraphError::stack("taking", &self.topic, &code)),
        }
    }

    fn matched(&self) -> usize {
        self.raw.events().matched()
    }

    fn publishers(&self) -> Option<Vec<u64>> {
        self.raw.writer_handles().ok()
    }

    fn publisher_gid(&self, publisher: u64) -> Option<[u8; 16]> {
        self.raw.writer(publisher).map(|peer| peer.guid)
    }

    fn lost(&mut self) -> u64 {
        self.raw.take_lost()
    }

    fn incompatible(&self) -> Option<&'static str> {
        self.raw.events().incompatible()
    }

    fn qos_events(&self) -> QosEvents {
        qos_events(self.raw.events())
    }
}

fn qos_events(events: &Events) -> QosEvents {
    QosEvents {
        deadlines_missed: events.take_missed_deadlines(),
        liveliness_lost: events.take_lost_liveliness(),
    }
}
