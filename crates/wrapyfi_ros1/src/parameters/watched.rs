//! Yields the parameters of a namespace: all of them first, then what changes.
//!
//! ```text
//!   the master: { gain: 2 } ─▶ differs from what is known ─▶ untold ─▶ take
//!   this node sets gain: 3 ──▶ known, and not told; what was asked for before says nothing of it
//! ```

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::values::{Flat, flatten, size, to_value, within};
use crate::node::Node;
use crate::xmlrpc::{self, shortened};
use wrapyfi_data::DecodeError;
use wrapyfi_data::types::{Map, ParameterValue, Properties, Value};
use wrapyfi_endpoint::{
    Context, DropReason, Link, Listener, Mutex, Sample, TakeError, TopicSpec, Wake,
};

/// Answers of the master are younger than this.
const LONGEST_ASKED: Duration = Duration::from_secs(60);
/// Faulty parameters that wait to be told.
const MAX_FAULTS: usize = 100;

/// A listener's part in the node.
pub(crate) struct Watched {
    key: String,
    context: Context,
    state: Mutex<WatchedState>,
}

#[derive(Default)]
struct WatchedState {
    parameters: KnownParameters,
    received_at: Option<Instant>,
}

/// Parameters of a namespace that are known, and the changes that the listener has not taken yet.
#[derive(Debug, Default)]
struct KnownParameters {
    /// The master has said something.
    heard: bool,
    /// Parameters as the master said last, or as this node has set them since.
    known: Properties,
    untold: Properties,
    /// Entries whose value fits no parameter, with the reason, as the master last had them.
    faulty: BTreeMap<String, String>,
    faults: VecDeque<String>,
    /// Set by this node: when the master had it; `None` until it has.
    own: BTreeMap<String, Option<Instant>>,
}

impl KnownParameters {
    /// Takes what the master said to a question of `asked`.
    fn heard(&mut self, flat: Flat, asked: Instant) {
        self.heard = true;
        let Flat { parameters: mut newer, faults } = flat;
        self.own.retain(|_, done| done.is_none_or(|at| at.elapsed() < LONGEST_ASKED));
        for (name, done) in &self.own {
            if done.is_some_and(|at| at < asked) {
                continue;
            }
            // The master may have been asked before it was set.
            let ours = self.known.get(name).cloned().unwrap_or(ParameterValue::NotSet);
            newer.apply(&Properties::from([(name.as_str(), ours)]));
        }
        let changes = self.known.changes_to(&newer);
        for (name, value) in changes {
            self.untold.insert(name, value);
        }
        self.known = newer;
        let before = std::mem::replace(&mut self.faulty, faults.into_iter().collect());
        let news = self.faulty.iter().filter(|(name, why)| before.get(*name) != Some(*why));
        for (_, why) in news {
            if self.faults.len() < MAX_FAULTS {
                self.faults.push_back(why.clone());
            }
        }
    }

    /// Notes that this node is about to set a parameter; false where it is known to have the value
    /// already.
    fn setting(&mut self, name: &str, value: &ParameterValue) -> bool {
        let now = self.known.get(name).unwrap_or(&ParameterValue::NotSet);
        if now == value && !self.untold.names().any(|untold| untold == name) {
            return false;
        }
        self.known.apply(&Properties::from([(name, value.clone())]));
        // A change that was not taken yet is outdated.
        let untold = std::mem::take(&mut self.untold);
        self.untold = untold.into_iter().filter(|(untold, _)| untold != name).collect();
        self.own.insert(name.to_owned(), None);
        true
    }

    /// The master has it, or refused it: then it says itself what it has.
    fn was_set(&mut self, name: &str, done: bool) {
        if done {
            self.own.insert(name.to_owned(), Some(Instant::now()));
        } else {
            self.own.remove(name);
        }
    }
}

impl Watched {
    pub(crate) fn wake(&self) -> &Wake {
        &self.context.wake
    }

    pub(super) fn give(&self, value: &xmlrpc::Value, asked: Instant) {
        let mut state = self.state.lock();
        let flat = flatten(value.clone());
        state.parameters.heard(flat, asked);
        let news = !state.parameters.untold.is_empty() || !state.parameters.faults.is_empty();
        if !news {
            return;
        }
        state.received_at = Some(self.context.clock.now());
        drop(state);
        self.context.counters.received(size(value));
        self.context.wake.ring();
    }
}

/// The first of the faulty parameters, and the number of the others, in words.
fn left_out(faults: &VecDeque<String>) -> String {
    const NAMED: usize = 5;
    let named: Vec<String> = faults.iter().take(NAMED).map(|why| shortened(why)).collect();
    let more = match faults.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!("; and {more} more"),
    };
    named.join("; ") + &more
}

/// Notes that this node is about to set `path`, or to delete it; false where every listener here
/// knows that it is so already.
pub(super) fn setting(node: &Node, path: &str, value: Option<&xmlrpc::Value>) -> bool {
    let one = |name: &str| {
        let value = value.cloned().map_or(Value::Null, to_value);
        let read = Properties::from_value(&Value::Map(Map::from([(name, value)])));
        read.ok()?.get(name).cloned()
    };
    let mut needed = None;
    for_each(node, path, |watched, name| {
        let Some(value) = one(name) else { return };
        let differs = watched.state.lock().parameters.setting(name, &value);
        needed = Some(needed.unwrap_or(false) | differs);
    });
    // A parameter without a listener has no known value.
    needed.unwrap_or(true)
}

/// The master has what this node has set, unless it refused.
pub(super) fn was_set(node: &Node, path: &str, done: bool) {
    for_each(node, path, |watched, name| watched.state.lock().parameters.was_set(name, done));
}

/// Every listener here to whose namespace a parameter belongs, and its name there.
fn for_each(node: &Node, path: &str, mut act: impl FnMut(&Watched, &str)) {
    let all: Vec<Arc<Watched>> = node.state().parameters.values().flatten().cloned().collect();
    for watched in all {
        if let Some(name) = within(&watched.key, path) {
            act(&watched, &name);
        }
    }
}

/// Listens to one namespace.
pub(crate) struct ParameterListener {
    node: Arc<Node>,
    watched: Arc<Watched>,
    /// Something was reported.
    has_reported: bool,
    /// The next message is all that is known: who is told now was not told what led there.
    whole: bool,
}

impl ParameterListener {
    pub(crate) fn open(node: &Arc<Node>, key: &str, _: &TopicSpec, context: &Context) -> Self {
        let watched = Arc::new(Watched {
            key: key.to_owned(),
            context: context.clone(),
            state: Mutex::default(),
        });
        node.watch(key, &watched);
        Self { node: Arc::clone(node), watched, has_reported: false, whole: false }
    }
}

impl Listener for ParameterListener {
    fn take(&mut self) -> Result<Option<Sample>, TakeError> {
        let mut state = self.watched.state.lock();
        if let Some(why) = state.parameters.faults.pop_front() {
            let expected = "a parameter that ROS 2 has a type for".to_owned();
            return Err(DecodeError::mismatch(expected, why));
        }
        let begins = self.whole && state.parameters.heard && !state.parameters.known.is_empty();
        if state.parameters.untold.is_empty() && !begins {
            return Ok(None);
        }
        let changes = std::mem::take(&mut state.parameters.untold);
        let news = if self.whole { state.parameters.known.clone() } else { changes };
        self.whole = false;
        self.has_reported = true;
        let received_at = state.received_at.unwrap_or_else(Instant::now);
        let wire_bytes = news.size();
        Ok(Some(Sample { payload: news.into(), wire_bytes, received_at, origin: None }))
    }

    fn discard(&mut self) -> bool {
        let mut state = self.watched.state.lock();
        let faults = std::mem::take(&mut state.parameters.faults);
        if !faults.is_empty() {
            let others = faults.len() as u64 - 1;
            self.watched.context.counters.dropped_many(DropReason::NoConsumer, others);
            let (key, left_out) = (&self.watched.key, left_out(&faults));
            tracing::warn!(
                key,
                "ROS 1: parameters that ROS 2 has no type for are left out: {left_out}"
            );
            return true;
        }
        // The program that comes later begins with all of them. What no listener has taken still waits.
        self.whole = self.has_reported;
        false
    }

    fn link(&self) -> Link {
        Link { peers: None, waiting_for: self.node.fault(), keeps_last: false }
    }
}

impl Drop for ParameterListener {
    fn drop(&mut self) {
        self.node.unwatch(&self.watched.key, &self.watched);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat<const N: usize>(pairs: [(&str, i64); N]) -> Flat {
        Flat { parameters: Properties::from(pairs), faults: Vec::new() }
    }

    fn told(parameters: &mut KnownParameters) -> Vec<(String, ParameterValue)> {
        std::mem::take(&mut parameters.untold).into_iter().collect()
    }

    fn one(name: &str, value: impl Into<ParameterValue>) -> (String, ParameterValue) {
        (name.to_owned(), value.into())
    }

    #[test]
    fn all_are_told_first_then_what_changed_and_what_vanished() {
        let (mut parameters, now) = (KnownParameters::default(), Instant::now());
        parameters.heard(flat([("a", 1), ("b", 2)]), now);
        assert_eq!(told(&mut parameters), [one("a", 1_i64), one("b", 2_i64)]);
        parameters.heard(flat([("a", 1), ("b", 3)]), now);
        assert_eq!(told(&mut parameters), [one("b", 3_i64)]);
        parameters.heard(flat([("b", 3)]), now);
        assert_eq!(told(&mut parameters), [one("a", ParameterValue::NotSet)]);
        parameters.heard(flat([("b", 3)]), now);
        assert_eq!(told(&mut parameters), []);
    }

    #[test]
    fn what_this_node_sets_is_not_told_and_others_are_heard_after_it() {
        let (mut parameters, before) = (KnownParameters::default(), Instant::now());
        parameters.heard(flat([("a", 1)]), before);
        told(&mut parameters);
        assert!(parameters.setting("a", &ParameterValue::Integer(2)));
        // Asked before it was set, or while.
        parameters.heard(flat([("a", 1)]), before);
        parameters.was_set("a", true);
        parameters.heard(flat([("a", 1)]), before);
        assert_eq!(told(&mut parameters), []);
        assert!(!parameters.setting("a", &ParameterValue::Integer(2)), "it is so already");
        let after = Instant::now() + Duration::from_millis(1);
        parameters.heard(flat([("a", 2)]), after);
        assert_eq!(told(&mut parameters), []);
        parameters.heard(flat([("a", 1)]), after);
        assert_eq!(told(&mut parameters), [one("a", 1_i64)], "set back by somebody else");
        assert!(parameters.setting("a", &ParameterValue::NotSet));
        parameters.was_set("a", true);
        parameters.heard(flat([]), Instant::now() + Duration::from_millis(1));
        assert_eq!(told(&mut parameters), []);
    }

    #[test]
    fn what_the_master_refused_it_says_itself() {
        let (mut parameters, now) = (KnownParameters::default(), Instant::now());
        parameters.heard(flat([("a", 1)]), now);
        told(&mut parameters);
        assert!(parameters.setting("a", &ParameterValue::Integer(2)));
        parameters.was_set("a", false);
        parameters.heard(flat([("a", 1)]), now);
        assert_eq!(told(&mut parameters), [one("a", 1_i64)]);
    }

    #[test]
    fn a_fault_is_told_once_while_it_stays_the_same() {
        let (mut parameters, now) = (KnownParameters::default(), Instant::now());
        for (why, count) in [("no", 1), ("no", 0), ("never", 1)] {
            let faults = vec![("rows".to_owned(), why.to_owned())];
            parameters.heard(Flat { parameters: Properties::new(), faults }, now);
            assert_eq!(std::mem::take(&mut parameters.faults).len(), count, "{why}");
        }
    }

    #[test]
    fn what_is_left_out_is_named_within_bounds() {
        let faults = |count| (0..count).map(|at| format!("p{at}: {}", "x".repeat(5000))).collect();
        assert!(left_out(&faults(1)).starts_with("p0: x"));
        let many = left_out(&faults(100));
        assert!(many.contains("p4: ") && many.ends_with("; and 95 more"), "{many}");
        assert!(many.len() < 5000, "{}", many.len());
    }
}
