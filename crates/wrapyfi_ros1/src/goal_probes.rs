//! Asks an action's server for the definition of its goals, where no client shows it.
//!
//! ```text
//!   /a/goal published here, with any type ◀── subscriber of rospy: type, md5sum, message_definition ─▶ Types
//! ```
//!
//! A subscriber of rospy shows its definition when it connects; one of roscpp shows the checksum alone, and what it
//! means must be known from elsewhere.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::conversion::ANY;
use super::node::Node;
use super::publisher::Ros1Publisher;
use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::codec::ros1::Ros1Type;
use wrapyfi_endpoint::{Context, Mutex, TopicSpec};

/// Time for which a server may connect.
const ASKED_FOR: Duration = Duration::from_secs(3);
/// Time after which a server that has shown nothing is asked again.
const AGAIN: Duration = Duration::from_secs(30);

/// Publishers of goals that send none, by action, and when each was opened.
#[derive(Default)]
pub(super) struct GoalProbes(Mutex<BTreeMap<String, (Instant, Option<Ros1Publisher>)>>);

impl GoalProbes {
    /// Asks; true while the answer may come.
    pub(super) fn ask(&self, node: &Arc<Node>, action: &str) -> bool {
        let mut probes = self.0.lock();
        probes.retain(|_, (since, _)| since.elapsed() < AGAIN);
        if let Some((since, probe)) = probes.get_mut(action) {
            let is_asking = since.elapsed() < ASKED_FOR;
            probe.take_if(|_| !is_asking);
            return is_asking;
        }
        let topic = format!("{action}/goal");
        let any = || ANY.to_owned();
        let wire_type = Ros1Type { name: any(), md5: any(), definition: String::new() };
        // No message is ever sent, so that its type does not matter.
        let spec = TopicSpec::new(&*topic, MessageType::Text);
        let probe =
            Ros1Publisher::open(node, &topic, (wire_type, None), &spec, &Context::default());
        let probe = probe.ok();
        let is_asking = probe.is_some();
        probes.insert(action.to_owned(), (Instant::now(), probe));
        is_asking
    }

    /// Ends the question about an action.
    pub(super) fn end(&self, action: &str) {
        self.0.lock().remove(action);
    }
}
