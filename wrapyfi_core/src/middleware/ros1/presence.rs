//! Which endpoints are there: the master keeps nodes that were killed, and one that was restarted
//! knows nobody at first.
//!
//! ```text
//!   master lists it     node refuses connections          ─▶ left out
//!   master lists it not, a moment ago it did
//!                       node says that it still has it    ─▶ kept
//! ```
//!
//! Every node is asked for its publications now and again, and at once where the master lists less of it
//! than before. Only a refused connection means that it is dead: a machine that cannot be reached may be
//! reached again.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::config::NodeUri;
use super::core::Core;
use super::http::{self, HttpError};
use super::probe;
use super::xmlrpc::{SUCCESS, Value, text};
use crate::endpoint::{Discovered, Role};

/// Time between two questions to one node.
const ASK_EVERY: Duration = Duration::from_secs(2);
/// Most questions under way at once.
const MAX_ASKED: usize = 32;

/// Topic or service, role, node.
type Key = (String, Role, Option<String>);

fn key(one: &Discovered) -> Key {
    (one.name.clone(), one.role, one.node.clone())
}

/// What nodes say of themselves.
#[derive(Default)]
pub(super) struct Presence {
    nodes: Arc<Mutex<BTreeMap<String, Node>>>,
    /// Publishers and servers, as they were told last.
    before: Vec<Discovered>,
    /// Those of them that the master lists no more.
    missing_since: BTreeMap<Key, Instant>,
}

/// One node.
#[derive(Default)]
struct Node {
    uri: Option<NodeUri>,
    said: Said,
    /// When the question was asked that was answered last.
    asked_at: Option<Instant>,
    is_asked: bool,
}

/// What came of the last question to a node.
#[derive(Default)]
enum Said {
    /// Nothing was asked yet, or nothing came.
    #[default]
    Nothing,
    /// Nobody is there.
    Refused,
    /// The topics it publishes, and the services of those that were asked for.
    Has(BTreeSet<(Role, String)>),
}

impl Presence {
    fn nodes(&self) -> MutexGuard<'_, BTreeMap<String, Node>> {
        self.nodes.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What is there, by what the master lists.
    pub(super) fn sift(&mut self, core: &Arc<Core>, listed: Vec<Discovered>) -> Vec<Discovered> {
        let keys: BTreeSet<Key> = listed.iter().map(key).collect();
        let missing: Vec<Discovered> =
            self.before.drain(..).filter(|one| !keys.contains(&key(one))).collect();
        let (now, mut since) = (Instant::now(), BTreeMap::new());
        for one in &missing {
            since.insert(key(one), self.missing_since.get(&key(one)).copied().unwrap_or(now));
        }
        self.missing_since = since;
        self.ask(core, &listed, &missing);
        let nodes = self.nodes();
        let of = |one: &Discovered| one.node.as_ref().and_then(|node| nodes.get(node));
        let mut all: Vec<Discovered> = listed
            .into_iter()
            .filter(|one| !of(one).is_some_and(|node| matches!(node.said, Said::Refused)))
            .collect();
        let mut orphans: BTreeMap<String, BTreeSet<NodeUri>> = BTreeMap::new();
        for one in missing {
            let Some(node) = of(&one) else { continue };
            // Until it has answered since, it may be there.
            if self.has_answered(&one, node) {
                let Node { uri: Some(uri), said: Said::Has(has), .. } = node else { continue };
                if !has.contains(&(one.role, one.name.clone())) {
                    continue;
                }
                if one.role == Role::Publisher {
                    orphans.entry(one.name.clone()).or_default().insert(uri.clone());
                }
            }
            all.push(one);
        }
        drop(nodes);
        all.sort_by(|a, b| (&a.name, a.role, &a.node).cmp(&(&b.name, b.role, &b.node)));
        let owns = |one: &&Discovered| matches!(one.role, Role::Publisher | Role::Server);
        self.before = all.iter().filter(owns).cloned().collect();
        core.set_orphans(orphans);
        all
    }

    /// Whether the node was asked after the master had dropped this.
    fn has_answered(&self, missing: &Discovered, node: &Node) -> bool {
        let since = self.missing_since.get(&key(missing));
        since.is_none_or(|since| node.asked_at.is_some_and(|at| at >= *since))
    }

    /// Asks those whose turn it is.
    fn ask(&self, core: &Arc<Core>, listed: &[Discovered], missing: &[Discovered]) {
        let mut nodes = self.nodes();
        let named = listed.iter().chain(missing).filter_map(|one| one.node.as_ref());
        let named: BTreeSet<&String> = named.collect();
        nodes.retain(|name, node| node.is_asked || named.contains(name));
        for name in named {
            nodes.entry(name.clone()).or_default();
        }
        let doubtful: BTreeSet<&String> = missing
            .iter()
            .filter_map(|one| {
                let name = one.node.as_ref()?;
                nodes.get(name).filter(|node| !self.has_answered(one, node)).map(|_| name)
            })
            .collect();
        let is_due = |node: &Node| node.asked_at.is_none_or(|at| at.elapsed() >= ASK_EVERY);
        let free = MAX_ASKED.saturating_sub(nodes.values().filter(|node| node.is_asked).count());
        let mut due: Vec<(&String, &mut Node)> = nodes
            .iter_mut()
            .filter(|(name, node)| !node.is_asked && (is_due(node) || doubtful.contains(name)))
            .collect();
        due.sort_by_key(|(name, node)| (!doubtful.contains(name), node.asked_at));
        for (name, node) in due.into_iter().take(free) {
            node.is_asked = true;
            let asked_at = Instant::now();
            // Of what the master lists, the node's word is not needed.
            let servers = missing
                .iter()
                .filter(|one| one.role == Role::Server && one.node.as_ref() == Some(name));
            let services: Vec<String> = servers.map(|one| one.name.clone()).collect();
            let (known, name) = (node.uri.clone(), name.clone());
            let (core_of_task, nodes) = (Arc::downgrade(core), Arc::clone(&self.nodes));
            core.handle.spawn(async move {
                let Some(core) = core_of_task.upgrade() else { return };
                let (uri, said) = question(&core, &name, known, services).await;
                let mut nodes = nodes.lock().unwrap_or_else(PoisonError::into_inner);
                if let Some(node) = nodes.get_mut(&name) {
                    *node = Node { uri, said, asked_at: Some(asked_at), is_asked: false };
                }
            });
        }
    }
}

/// What a node says, where the master has it now, else where it was.
async fn question(
    core: &Arc<Core>,
    name: &str,
    known: Option<NodeUri>,
    services: Vec<String>,
) -> (Option<NodeUri>, Said) {
    let uri = match core.master.lookup_node(name).await {
        Ok(Some(uri)) => uri,
        Ok(None) | Err(_) => match known {
            Some(uri) => uri,
            None => return (None, Said::Nothing),
        },
    };
    let reply = http::call(&uri, "getPublications", vec![text(core.name.full())]).await;
    let said = match reply {
        Err(HttpError::Refused { .. }) => Said::Refused,
        Ok(reply) if reply.status == SUCCESS => {
            let mut has: BTreeSet<(Role, String)> =
                topics(&reply.value).map(|topic| (Role::Publisher, topic)).collect();
            for service in services {
                if probe::still_serves(core, &service, name).await {
                    has.insert((Role::Server, service));
                }
            }
            Said::Has(has)
        }
        _ => Said::Nothing,
    };
    (Some(uri), said)
}

/// Names in `[[topic, type], …]`.
fn topics(value: &Value) -> impl Iterator<Item = String> {
    let pairs = if let Value::Array(pairs) = value { pairs.as_slice() } else { &[] };
    pairs.iter().filter_map(|pair| match pair {
        Value::Array(pair) => match pair.first() {
            Some(Value::String(topic)) => Some(topic.clone()),
            _ => None,
        },
        _ => None,
    })
}
