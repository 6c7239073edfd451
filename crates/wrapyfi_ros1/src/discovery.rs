//! Topics that other ROS 1 nodes publish and subscribe to, services that they offer, and actions that they offer and
//! use, as the master lists them.
//!
//! ```text
//!   one node   publishes /a/status, feedback, result, subscribes to goal, cancel ─▶ a server of action /a
//!              the other way round                                               ─▶ a client of it
//! ```
//!
//! The five topics are listed, too: a route that names one of them carries it.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

use tokio::task::JoinSet;

use super::http::KeptConnection;
use super::marks::{self, Marks};
use super::master::{
    Master, MasterResult, Owners, PARAMETER, PARAMETER_NAMES, Repeated, SYSTEM_STATE, SystemState,
    TOPIC_TYPES, if_granted, shaped,
};
use super::node::Node;
use super::node_parameters;
use super::peer_types;
use super::presence::{Orphans, Presence};
use super::xmlrpc::text;
use wrapyfi_endpoint::restart::restarted;
use wrapyfi_endpoint::{Cause, DiscoverError, Discovered, Discovery, Mutex, Named, Role};

/// Time between two looks: the master announces no changes.
pub(super) const LOOK: Duration = Duration::from_millis(250);
/// Time after the last change in which every look does all its work: questions to nodes that have just gone are answered by then.
const CALM_AFTER: Duration = Duration::from_secs(15);
/// Time between two questions for the names of parameters, and, from twice that time after the last change on, for types and marks: the
/// answers are long.
const DETAILS: Duration = Duration::from_secs(1);

/// Looks until it is dropped.
pub(super) struct Ros1Discovery {
    seen: Arc<Mutex<Seen>>,
    /// The task that looks.
    _task: JoinSet<()>,
}

#[derive(Default)]
struct Seen {
    /// The master was asked, whatever came of it.
    asked: bool,
    endpoints: Vec<Discovered>,
    /// Cause for which nothing is seen.
    fault: Option<Cause>,
}

impl Seen {
    /// Notes what a look found: other endpoints than before, if any.
    fn note(&mut self, endpoints: Option<Vec<Discovered>>, fault: Option<Cause>) {
        (self.asked, self.fault) = (true, fault);
        if let Some(endpoints) = endpoints {
            self.endpoints = endpoints;
        }
    }
}

impl Ros1Discovery {
    pub(super) fn new(node: &Arc<Node>) -> Self {
        let server = Named::server("master", &node.master.uri);
        let waiting = Cause::ServerAway { server, detail: String::new() };
        let seen = Arc::new(Mutex::new(Seen { fault: Some(waiting), ..Seen::default() }));
        let (weak, kept, told) = (Arc::downgrade(node), Arc::clone(&seen), Arc::clone(&seen));
        let mut task = JoinSet::new();
        let looks = restarted(
            "the discovery of ROS 1".to_owned(),
            move |what| told.lock().fault = Some(Cause::Restarting(what)),
            move || watch(weak.clone(), Arc::clone(&kept)),
        );
        task.spawn_on(looks, &node.handle);
        Self { seen, _task: task }
    }
}

async fn watch(node: Weak<Node>, seen: Arc<Mutex<Seen>>) {
    let (mut told, mut presence, mut keys) =
        (Told::default(), Presence::default(), Keys::default());
    loop {
        let Some(node) = node.upgrade() else { return };
        let looked = look(&node, &mut told, &mut presence, &mut keys).await;
        let fault = looked.as_ref().err().map(|error| error.cause(&node.master.uri));
        // Endpoints that are not seen any more are listed anew when they are.
        told.is_newer |= fault.is_some();
        drop(node);
        seen.lock().note(looked.unwrap_or_else(|_told| Some(Vec::new())), fault);
        tokio::time::sleep(LOOK).await;
    }
}

/// Names of the parameters, and when the master told them.
#[derive(Default)]
struct Keys {
    asked_at: Option<Instant>,
    names: Repeated<BTreeSet<String>>,
}

impl Keys {
    /// Asks the master now and again; true where the names are others. There may be thousands. A master without a parameter
    /// server has none.
    async fn ask(&mut self, master: &Master, kept: &mut KeptConnection) -> bool {
        if self.asked_at.is_some_and(|at| at.elapsed() < DETAILS) {
            return false;
        }
        let read = |reply| {
            let names: Vec<String> = shaped(PARAMETER_NAMES, reply)?;
            Ok(names.into_iter().collect())
        };
        let asked = master.ask_again(kept, &mut self.names, PARAMETER_NAMES, [], read).await;
        self.asked_at = Some(Instant::now());
        asked.unwrap_or_else(|_none| self.names.take().is_some())
    }

    fn names(&self) -> &BTreeSet<String> {
        static NONE: BTreeSet<String> = BTreeSet::new();
        self.names.as_ref().map_or(&NONE, |(_, names)| names)
    }
}

/// Answers of the master at the last look: of a system that stands still they are the same, four times a second.
#[derive(Default)]
struct Told {
    kept: KeptConnection,
    types: Repeated<BTreeMap<String, String>>,
    state: Repeated<SystemState>,
    marks: Repeated<Marks>,
    /// True where one of them is newer than `listed`.
    is_newer: bool,
    /// Time at which `listed` became another.
    changed_at: Option<Instant>,
    /// Time at which types and marks were asked for.
    detailed_at: Option<Instant>,
    /// Endpoints that all three tell of.
    listed: Vec<Discovered>,
    /// Those that exist, and the actions that they are: without parameters.
    found: Vec<Discovered>,
}

impl Told {
    /// Asks the master; true where `listed` is another, or was until a moment ago.
    async fn ask(&mut self, node: &Node) -> MasterResult<bool> {
        let is_changing = self.changed_at.is_none_or(|at| at.elapsed() < 2 * DETAILS);
        let Self { kept, types, state, marks, is_newer, listed, detailed_at, .. } = self;
        let pairs = |reply| {
            let pairs: Vec<(String, String)> = shaped(TOPIC_TYPES, reply)?;
            Ok(pairs.into_iter().collect())
        };
        let read_marks = |reply| Ok(marks::read(if_granted(reply).as_ref()));
        let master = &node.master;
        let namespace = [text(marks::NAMESPACE)];
        // Each by itself: one of them may fail behind another that is new.
        *is_newer |= master.ask_again(kept, state, SYSTEM_STATE, [], SystemState::of).await?;
        // Types and marks come and go with what is registered, or soon after it.
        if *is_newer || is_changing || detailed_at.is_none_or(|at| at.elapsed() >= DETAILS) {
            *is_newer |= master.ask_again(kept, types, TOPIC_TYPES, [], pairs).await?;
            *is_newer |= master.ask_again(kept, marks, PARAMETER, namespace, read_marks).await?;
            *detailed_at = Some(Instant::now());
        }
        if *is_newer
            && let (Some((_, types)), Some((_, state)), Some((_, marks))) = (types, state, marks)
        {
            *listed = endpoints(state, types, marks, node.name.full());
        }
        if std::mem::take(is_newer) {
            self.changed_at = Some(Instant::now());
        }
        Ok(self.changed_at.is_none_or(|at| at.elapsed() < CALM_AFTER))
    }
}

/// Endpoints that exist; `None` where they are the same as at the last look.
async fn look(
    node: &Arc<Node>,
    told: &mut Told,
    presence: &mut Presence,
    keys: &mut Keys,
) -> MasterResult<Option<Vec<Discovered>>> {
    let is_newer = told.ask(node).await?;
    let sifted = presence.sift(&node.core, &told.listed, is_newer);
    let has_other_keys = keys.ask(&node.master, &mut told.kept).await;
    if sifted.is_none() && !has_other_keys {
        return Ok(None);
    }
    if let Some((found, orphans)) = sifted {
        told.found = found;
        note(node, told, orphans);
        if !is_newer {
            // A node said it, of which the master tells nothing.
            told.changed_at = Some(Instant::now());
        }
    }
    let mut found = told.found.clone();
    node_parameters::add(&mut found, keys.names());
    Ok(Some(found))
}

/// Notes endpoints that are others than before, and enters the actions that they are.
fn note(node: &Node, told: &mut Told, orphans: Orphans) {
    let found = &mut told.found;
    node.set_orphans(orphans);
    let there: BTreeSet<(Role, &str, &str)> = found
        .iter()
        .filter_map(|one| Some((one.role, one.name.as_str(), one.node.as_deref()?)))
        .collect();
    peer_types::keep_only(node, |role, name, node| there.contains(&(role, name, node)));
    let none = Marks::new();
    let actions = actions(found, told.marks.as_ref().map_or(&none, |(_, marks)| marks));
    let clients = actions.iter().filter(|one| one.role == Role::ActionClient);
    let clients = clients.filter_map(|one| Some((one.name.clone(), one.node.clone()?)));
    *node.action_clients.lock() = clients.collect();
    found.extend(actions);
}

/// Servers and clients of actions: nodes that have all five topics of one.
fn actions(found: &[Discovered], marks: &Marks) -> Vec<Discovered> {
    let there: BTreeSet<(Role, &str, Option<&str>)> =
        found.iter().map(|one| (one.role, one.name.as_str(), one.node.as_deref())).collect();
    let action = |one: &Discovered| {
        let name = one.name.strip_suffix("/result")?;
        let type_name = one.type_name.as_deref().and_then(action_type);
        let (role, other) = match one.role {
            Role::Publisher => (Role::ActionServer, Role::Listener),
            Role::Listener => (Role::ActionClient, Role::Publisher),
            _ => return None,
        };
        let has = |role, word: &str| {
            there.contains(&(role, format!("{name}/{word}").as_str(), one.node.as_deref()))
        };
        let from_server = ["status", "feedback"].into_iter().all(|word| has(one.role, word));
        let from_client = ["goal", "cancel"].into_iter().all(|word| has(other, word));
        let mark = marks.get(&(role, name.to_owned(), one.node.clone()?)).cloned();
        let (type_name, node) = (type_name.map(str::to_owned), one.node.clone());
        (from_server && from_client).then(|| Discovered {
            type_name,
            node,
            mark,
            ..Discovered::new(name, role)
        })
    };
    found.iter().filter_map(action).collect()
}

/// Name of the action whose results have this type.
pub(super) fn action_type(result_type: &str) -> Option<&str> {
    result_type.strip_suffix("ActionResult").filter(|name| !name.ends_with('/'))
}

/// Everything that is not of the node `own`.
fn endpoints(
    state: &SystemState,
    types: &BTreeMap<String, String>,
    marks: &Marks,
    own: &str,
) -> Vec<Discovered> {
    let SystemState { publishers, subscribers, services } = state;
    let mut all = Vec::new();
    let mut add = |owners: &Owners, role: Role| {
        for (name, nodes) in owners {
            let known = types.get(name).filter(|name| *name != "*");
            let type_name = if role == Role::Server { None } else { known };
            for node in nodes.iter().filter(|node| *node != own) {
                all.push(Discovered {
                    type_name: type_name.cloned(),
                    mark: marks.get(&(role, name.clone(), node.clone())).cloned(),
                    node: Some(node.clone()),
                    ..Discovered::new(name, role)
                });
            }
        }
    };
    add(publishers, Role::Publisher);
    add(subscribers, Role::Listener);
    add(services, Role::Server);
    all
}

impl Discovery for Ros1Discovery {
    fn endpoints(&mut self) -> Result<Vec<Discovered>, DiscoverError> {
        Ok(self.seen.lock().endpoints.clone())
    }

    fn waiting_for(&self) -> Option<Cause> {
        self.seen.lock().fault.clone()
    }

    fn is_complete(&self) -> Option<bool> {
        Some(self.seen.lock().asked)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_endpoint::BridgeMark;

    /// A node that lacks one of the topics is neither, and so are two that have all five together.
    #[test]
    fn a_node_with_all_five_topics_has_the_action() {
        let of = |name: &str, nodes: &[&str]| {
            (name.to_owned(), nodes.iter().map(|node| (*node).to_owned()).collect::<Vec<_>>())
        };
        let state = SystemState {
            publishers: vec![
                of("/a/status", &["/server"]),
                of("/a/feedback", &["/server"]),
                of("/a/result", &["/server"]),
                of("/a/goal", &["/client", "/bag"]),
                of("/a/cancel", &["/client"]),
                of("/b/result", &["/half"]),
                of("/b/status", &["/other_half"]),
            ],
            subscribers: vec![
                of("/a/goal", &["/server"]),
                of("/a/cancel", &["/server"]),
                of("/a/status", &["/client", "/rostopic"]),
                of("/a/feedback", &["/client"]),
                of("/a/result", &["/client"]),
            ],
            services: Vec::new(),
        };
        let types = [("/a/result".to_owned(), "demo/CountActionResult".to_owned())];
        let mark = BridgeMark { bridge: 7, path: Vec::new() };
        let key = (Role::ActionServer, "/a".to_owned(), "/server".to_owned());
        let marks = Marks::from([(key, mark.clone())]);
        let found = endpoints(&state, &types.into(), &marks, "/own");
        let found = actions(&found, &marks);
        let short = found.iter().map(|one| {
            let node = one.node.as_deref().unwrap_or_default();
            (one.name.as_str(), one.role, one.type_name.as_deref(), node, one.mark.clone())
        });
        assert_eq!(
            short.collect::<Vec<_>>(),
            [
                ("/a", Role::ActionServer, Some("demo/Count"), "/server", Some(mark)),
                ("/a", Role::ActionClient, Some("demo/Count"), "/client", None),
            ]
        );
    }

    #[test]
    fn others_are_listed_with_their_types() {
        let of = |name: &str, nodes: &[&str]| {
            (name.to_owned(), nodes.iter().map(|node| (*node).to_owned()).collect::<Vec<_>>())
        };
        let state = SystemState {
            publishers: vec![of("/b", &["/talker", "/own"]), of("/a", &["/other"])],
            subscribers: vec![of("/b", &["/ear"])],
            services: vec![of("/add", &["/adder"])],
        };
        let types =
            [("/b", "std_msgs/String"), ("/a", "*")].map(|(a, b)| (a.to_owned(), b.to_owned()));
        let found = endpoints(&state, &types.into(), &Marks::new(), "/own");
        let short = found.iter().map(|one| {
            let node = one.node.as_deref().unwrap_or_default();
            (one.name.as_str(), one.role, one.type_name.as_deref(), node)
        });
        assert_eq!(
            short.collect::<Vec<_>>(),
            [
                ("/b", Role::Publisher, Some("std_msgs/String"), "/talker"),
                ("/a", Role::Publisher, None, "/other"),
                ("/b", Role::Listener, Some("std_msgs/String"), "/ear"),
                ("/add", Role::Server, None, "/adder"),
            ]
        );
    }
}
