//! Endpoints that exist: the master keeps nodes that were killed, and a restarted master knows no
//! node at first.
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
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::config::NodeUri;
use super::core::Core;
use super::http::{self, HttpError};
use super::peer_types;
use super::xmlrpc::{SUCCESS, Value, items, text};
use wrapyfi_endpoint::{Discovered, Mutex, Role};

/// Time between two questions to one node.
const ASK_EVERY: Duration = Duration::from_secs(2);
/// Most questions under way at once.
const MAX_ASKED: usize = 32;

/// Topic or service, role, node.
type Key = (String, Role, Option<String>);

fn key(one: &Discovered) -> Key {
    (one.name.clone(), one.role, one.node.clone())
}

/// Nodes by name.
type Nodes = BTreeMap<String, Node>;

/// Topics that the master lists no more, and the publishers that still have them.
pub(super) type Orphans = BTreeMap<String, BTreeSet<NodeUri>>;

/// Answers of nodes about the topics and services that they have, kept because a restarted master
/// forgets them.
#[derive(Default)]
pub(super) struct Presence {
    nodes: Arc<Mutex<Nodes>>,
    /// True where a node has said something else than before.
    said_other: Arc<AtomicBool>,
    /// Publishers and servers, as they were told last.
    before: Vec<Discovered>,
    /// Time since which the master no longer lists an endpoint that it listed before.
    missing_since: BTreeMap<Key, Instant>,
}

/// One node.
#[derive(Default)]
struct Node {
    uri: Option<NodeUri>,
    said: Said,
    /// Time at which the question was asked that was answered last.
    asked_at: Option<Instant>,
    is_asked: bool,
}

/// Answer of a node to the last question.
#[derive(Default, PartialEq)]
enum Said {
    /// No answer: nothing was asked yet, or nothing came.
    #[default]
    Nothing,
    /// The connection was refused: no program is there.
    Refused,
    /// The topics it publishes, and the services of those that were asked for.
    Has(BTreeSet<(Role, String)>),
}

/// Question to one node.
#[derive(Debug, PartialEq, Eq)]
struct Question {
    node: String,
    /// Address at which it was.
    known: Option<NodeUri>,
    /// Services that the master lists no more. Of what it lists, the node's word is not needed.
    services: Vec<String>,
}

impl Presence {
    /// Endpoints that exist: those that the master lists, and those that it has dropped but whose
    /// node still has them, with the publishers of the latter. `None` where they are the same as before: `listed` is not
    /// `newer`, nothing is missing, and no node has said anything new.
    pub(super) fn sift(
        &mut self,
        core: &Arc<Core>,
        listed: &[Discovered],
        newer: bool,
    ) -> Option<(Vec<Discovered>, Orphans)> {
        let now = Instant::now();
        let said_other = self.said_other.swap(false, Ordering::Relaxed);
        let is_other = newer || said_other || !self.missing_since.is_empty();
        let missing = if is_other { self.missing(listed, now) } else { Vec::new() };
        for Question { node, known, services } in self.due(listed, &missing, now) {
            let (core_of_task, nodes) = (Arc::downgrade(core), Arc::clone(&self.nodes));
            let said_other = Arc::clone(&self.said_other);
            core.handle.spawn(async move {
                let Some(core) = core_of_task.upgrade() else { return };
                let (uri, said) = question(&core, &node, known, services).await;
                if answered(&mut nodes.lock(), &node, uri, said, now) {
                    said_other.store(true, Ordering::Relaxed);
                }
            });
        }
        is_other.then(|| self.sorted(listed.to_vec(), missing))
    }

    /// Endpoints that were there before and are not listed any more.
    fn missing(&mut self, listed: &[Discovered], now: Instant) -> Vec<Discovered> {
        let keys: BTreeSet<Key> = listed.iter().map(key).collect();
        let missing: Vec<Discovered> =
            self.before.drain(..).filter(|one| !keys.contains(&key(one))).collect();
        let mut since = BTreeMap::new();
        for one in &missing {
            since.insert(key(one), self.missing_since.get(&key(one)).copied().unwrap_or(now));
        }
        self.missing_since = since;
        missing
    }

    /// Questions to the nodes whose turn it is; they count as asked from now on.
    fn due(&self, listed: &[Discovered], missing: &[Discovered], now: Instant) -> Vec<Question> {
        let mut nodes = self.nodes.lock();
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
        let is_due = |node: &Node| {
            node.asked_at.is_none_or(|at| now.saturating_duration_since(at) >= ASK_EVERY)
        };
        let free = MAX_ASKED.saturating_sub(nodes.values().filter(|node| node.is_asked).count());
        let mut due: Vec<(&String, &mut Node)> = nodes
            .iter_mut()
            .filter(|(name, node)| !node.is_asked && (is_due(node) || doubtful.contains(name)))
            .collect();
        due.sort_by_key(|(name, node)| (!doubtful.contains(name), node.asked_at));
        let ask = |(name, node): (&String, &mut Node)| {
            node.is_asked = true;
            let servers = missing
                .iter()
                .filter(|one| one.role == Role::Server && one.node.as_ref() == Some(name));
            let services = servers.map(|one| one.name.clone()).collect();
            Question { node: name.clone(), known: node.uri.clone(), services }
        };
        due.into_iter().take(free).map(ask).collect()
    }

    /// Endpoints that are there, by what the master lists and what nodes said.
    fn sorted(
        &mut self,
        listed: Vec<Discovered>,
        missing: Vec<Discovered>,
    ) -> (Vec<Discovered>, Orphans) {
        let nodes = self.nodes.lock();
        let of = |one: &Discovered| one.node.as_ref().and_then(|node| nodes.get(node));
        let mut all: Vec<Discovered> = listed
            .into_iter()
            .filter(|one| !of(one).is_some_and(|node| matches!(node.said, Said::Refused)))
            .collect();
        let mut orphans = Orphans::new();
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
        (all, orphans)
    }

    /// True when the node was asked after the master had dropped `missing`.
    fn has_answered(&self, missing: &Discovered, node: &Node) -> bool {
        let since = self.missing_since.get(&key(missing));
        since.is_none_or(|since| node.asked_at.is_some_and(|at| at >= *since))
    }
}

/// Notes what came of a question that was asked at `asked_at`; true where it is something else than before.
fn answered(
    nodes: &mut Nodes,
    name: &str,
    uri: Option<NodeUri>,
    said: Said,
    asked_at: Instant,
) -> bool {
    let Some(node) = nodes.get_mut(name) else { return false };
    let is_other = (&node.uri, &node.said) != (&uri, &said);
    *node = Node { uri, said, asked_at: Some(asked_at), is_asked: false };
    is_other
}

/// Answer of a node about its topics and services, at the address that the master has now, else at
/// `known`.
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
        Err(HttpError { is_refused: true, .. }) => Said::Refused,
        Ok(reply) if reply.status == SUCCESS => {
            let mut has: BTreeSet<(Role, String)> =
                topics(&reply.value).map(|topic| (Role::Publisher, topic)).collect();
            for service in services {
                if peer_types::still_serves(core, &service, name).await {
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
    items(value).iter().filter_map(|pair| match items(pair) {
        [Value::String(topic), ..] => Some(topic.clone()),
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::super::discovery::LOOK;
    use super::*;

    /// Time between two looks of the engine at what there is.
    const LOOK_EVERY: Duration = Duration::from_millis(500);
    /// Time after which the engine lets a source go that no look has shown.
    const GONE_AFTER: Duration = Duration::from_secs(5);

    fn one(name: &str, role: Role, node: &str) -> Discovered {
        Discovered { node: Some(node.to_owned()), ..Discovered::new(name, role) }
    }

    fn publisher(topic: &str, node: &str) -> Discovered {
        one(topic, Role::Publisher, node)
    }

    /// A presence, a clock, and what nodes answer at once: the topics they publish and the services they
    /// have, nothing where no program is there.
    struct Scene {
        presence: Presence,
        now: Instant,
        answers: BTreeMap<String, BTreeSet<(Role, String)>>,
        asked: Vec<Question>,
        orphans: Orphans,
    }

    impl Scene {
        fn new() -> Self {
            let (answers, asked, orphans) = (BTreeMap::new(), Vec::new(), Orphans::new());
            Self { presence: Presence::default(), now: Instant::now(), answers, asked, orphans }
        }

        fn answers(&mut self, node: &str, has: &[(Role, &str)]) {
            let has = has.iter().map(|(role, name)| (*role, (*name).to_owned())).collect();
            self.answers.insert(node.to_owned(), has);
        }

        /// One look at the master, whose questions are answered by the next one.
        fn look(&mut self, listed: &[Discovered]) -> Vec<String> {
            self.now += LOOK;
            let missing = self.presence.missing(listed, self.now);
            self.asked = self.presence.due(listed, &missing, self.now);
            let (all, orphans) = self.presence.sorted(listed.to_vec(), missing);
            self.orphans = orphans;
            for Question { node, .. } in &self.asked {
                let said = self.answers.get(node).cloned().map_or(Said::Refused, Said::Has);
                let uri = Some(NodeUri { host: node.clone(), port: 1 });
                answered(&mut self.presence.nodes.lock(), node, uri, said, self.now);
            }
            all.into_iter().map(|one| one.name).collect()
        }

        fn asked(&self) -> Vec<&str> {
            self.asked.iter().map(|question| question.node.as_str()).collect()
        }
    }

    #[test]
    fn what_the_master_keeps_of_a_dead_node_leaves_within_ten_seconds() {
        let mut scene = Scene::new();
        let listed = [
            publisher("/x", "/talker"),
            one("/y", Role::Listener, "/talker"),
            publisher("/z", "/other"),
        ];
        scene.answers("/talker", &[(Role::Publisher, "/x")]);
        scene.answers("/other", &[(Role::Publisher, "/z")]);
        for _ in 0..100 {
            assert_eq!(scene.look(&listed), ["/x", "/y", "/z"]);
        }
        scene.answers.remove("/talker");
        let died_at = scene.now;
        while scene.look(&listed) != ["/z"] {
            assert!(scene.now - died_at < Duration::from_secs(60), "it never leaves");
        }
        // A route ends when its source has been gone for a while, as the engine's looks show.
        let noticed = scene.now - died_at;
        let ended = noticed + LOOK_EVERY + GONE_AFTER;
        assert!(ended <= Duration::from_secs(10), "{ended:?}, noticed after {noticed:?}");
        // It comes back under its name.
        scene.answers("/talker", &[(Role::Publisher, "/x")]);
        while scene.look(&listed) != ["/x", "/y", "/z"] {
            assert!(scene.now - died_at < Duration::from_secs(60), "it never comes back");
        }
    }

    #[test]
    fn what_a_new_master_does_not_know_is_kept_where_its_node_still_has_it() {
        let mut scene = Scene::new();
        let listed = [
            publisher("/x", "/talker"),
            publisher("/y", "/talker"),
            one("/light", Role::Server, "/talker"),
            publisher("/z", "/dead"),
        ];
        scene.answers("/talker", &[(Role::Publisher, "/x"), (Role::Server, "/light")]);
        scene.answers("/dead", &[(Role::Publisher, "/z")]);
        let all = ["/light", "/x", "/y", "/z"];
        assert_eq!(scene.look(&listed), all);
        assert_eq!(scene.look(&listed), all);
        scene.answers.remove("/dead");
        // An endpoint whose node has not answered since may still be there, and the node is asked
        // at once.
        assert_eq!(scene.look(&[]), all);
        assert_eq!(scene.asked(), ["/dead", "/talker"]);
        assert_eq!(scene.asked[1].services, ["/light"]);
        assert_eq!(scene.orphans, Orphans::new());
        for _ in 0..20 {
            assert_eq!(scene.look(&[]), ["/light", "/x"]);
            let uri = NodeUri { host: "/talker".to_owned(), port: 1 };
            let orphans = [("/x".to_owned(), [uri].into())];
            assert_eq!(scene.orphans, Orphans::from(orphans));
        }
        // It publishes no more.
        scene.answers("/talker", &[]);
        while !scene.look(&[]).is_empty() {}
        assert_eq!(scene.orphans, Orphans::new());
    }

    #[test]
    fn doubtful_nodes_are_asked_first_and_not_all_at_once() {
        let mut scene = Scene::new();
        let count = MAX_ASKED + 8;
        let listed: Vec<_> =
            (0..count).map(|number| publisher("/x", &format!("/n{number:03}"))).collect();
        for one in &listed {
            scene.answers(one.node.as_deref().unwrap_or_default(), &[(Role::Publisher, "/x")]);
        }
        scene.look(&listed);
        assert_eq!(scene.asked().len(), MAX_ASKED);
        scene.look(&listed);
        assert_eq!(scene.asked().len(), 8, "those that had to wait");
        scene.look(&listed);
        assert_eq!(scene.asked().len(), 0, "nobody is asked twice at once");
        // The first is listed no more.
        scene.look(&listed[1..]);
        assert_eq!(scene.asked(), ["/n000"]);
        // When all are due again, it is no more doubtful than others.
        scene.now += ASK_EVERY;
        scene.look(&listed[2..]);
        assert_eq!(scene.asked().len(), MAX_ASKED);
        assert_eq!(scene.asked()[0], "/n001");
    }

    #[test]
    fn a_node_that_is_being_asked_is_not_asked_again() {
        let mut presence = Presence::default();
        let (now, listed) = (Instant::now(), [publisher("/x", "/slow")]);
        assert_eq!(presence.due(&listed, &[], now).len(), 1);
        assert_eq!(presence.due(&listed, &[], now + 10 * ASK_EVERY), []);
        // A machine that is not reached may be reached again: nothing said leaves it there.
        let (all, _) = presence.sorted(listed.to_vec(), Vec::new());
        assert_eq!(all.len(), 1);
        answered(&mut presence.nodes.lock(), "/slow", None, Said::Nothing, now);
        assert_eq!(presence.sorted(listed.to_vec(), Vec::new()).0.len(), 1);
        assert_eq!(presence.due(&listed, &[], now + ASK_EVERY).len(), 1);
    }
}
