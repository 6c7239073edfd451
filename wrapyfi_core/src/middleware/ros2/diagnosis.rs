//! What an endpoint without a peer waits for, in words that fit behind "waiting for".
//!
//! ```text
//!   matched > 0 ─────────────────────────────▶ nothing
//!   refused over quality of service ─────────▶ "… whose reliability is compatible (see qos)"
//!   the topic exists with another type ──────▶ "… with type A (those there carry B)"
//!   neither ─────────────────────────────────▶ "a publisher of /chatter"
//! ```

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::graph::Graph;
use crate::endpoint::Link;

/// How long a look at the list of endpoints is good for: links are asked for often.
const FRESH: Duration = Duration::from_secs(1);

/// Knows what an endpoint is waiting for.
pub(super) struct Diagnosis {
    graph: Arc<dyn Graph>,
    topic: String,
    type_name: &'static str,
    /// True where publishers are waited for.
    awaits_publisher: bool,
    other_type: Mutex<Option<(Instant, Option<String>)>>,
}

impl Diagnosis {
    pub(super) fn new(
        graph: Arc<dyn Graph>,
        topic: String,
        type_name: &'static str,
        awaits_publisher: bool,
    ) -> Self {
        Self { graph, topic, type_name, awaits_publisher, other_type: Mutex::new(None) }
    }

    /// The link of an endpoint with `matched` peers.
    pub(super) fn link(
        &self,
        matched: usize,
        incompatible: Option<&'static str>,
        keeps_last: bool,
    ) -> Link {
        // A writer that keeps its samples for late readers has something to do without any.
        let idle = matched == 0 && (!keeps_last || incompatible.is_some());
        let waiting_for = idle.then(|| self.missing(incompatible));
        Link { peers: Some(matched), waiting_for, keeps_last }
    }

    fn missing(&self, incompatible: Option<&'static str>) -> String {
        let (peer, topic) = (self.peer(), &self.topic);
        if let Some(policy) = incompatible {
            return format!("a {peer} of {topic} whose {policy} is compatible (see qos)");
        }
        match self.other_type() {
            Some(other) => {
                let wanted = self.type_name;
                format!("a {peer} of {topic} with type {wanted} (those there carry {other})")
            }
            None => format!("a {peer} of {topic}"),
        }
    }

    fn peer(&self) -> &'static str {
        if self.awaits_publisher { "publisher" } else { "subscriber" }
    }

    fn other_type(&self) -> Option<String> {
        let mut cached = self.other_type.lock().unwrap_or_else(PoisonError::into_inner);
        match &*cached {
            Some((at, answer)) if at.elapsed() < FRESH => answer.clone(),
            _ => {
                let answer = self.look();
                *cached = Some((Instant::now(), answer.clone()));
                answer
            }
        }
    }

    fn look(&self) -> Option<String> {
        let endpoints = self
            .graph
            .endpoints()
            .inspect_err(|error| tracing::debug!(%error, "cannot list endpoints"))
            .ok()?;
        endpoints
            .into_iter()
            .find(|endpoint| {
                endpoint.is_publisher == self.awaits_publisher
                    && endpoint.topic == self.topic
                    && endpoint.type_name != self.type_name
            })
            .map(|endpoint| endpoint.type_name)
    }
}
