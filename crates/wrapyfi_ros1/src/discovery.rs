//! Topics that other ROS 1 nodes publish and subscribe to, and services that they offer, as the
//! master lists them.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Weak};
use std::time::Duration;

use tokio::task::JoinSet;

use super::marks::{self, Marks};
use super::master::{MasterError, Owners, SystemState};
use super::node::Node;
use super::peer_types;
use super::presence::Presence;
use wrapyfi_endpoint::restart::restarted;
use wrapyfi_endpoint::{DiscoverError, Discovered, Discovery, Mutex, Role};

/// Time between two looks: the master tells nobody by itself.
pub(super) const LOOK: Duration = Duration::from_millis(250);

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
    /// Reason why nothing is seen.
    fault: Option<String>,
}

impl Ros1Discovery {
    pub(super) fn new(node: &Arc<Node>) -> Self {
        let waiting = format!("master {}", node.master.uri);
        let seen = Arc::new(Mutex::new(Seen { fault: Some(waiting), ..Seen::default() }));
        let (weak, kept, told) = (Arc::downgrade(node), Arc::clone(&seen), Arc::clone(&seen));
        let mut task = JoinSet::new();
        let looks = restarted(
            "the discovery of ROS 1".to_owned(),
            move |what| told.lock().fault = Some(what),
            move || watch(weak.clone(), Arc::clone(&kept)),
        );
        task.spawn_on(looks, &node.handle);
        Self { seen, _task: task }
    }
}

async fn watch(node: Weak<Node>, seen: Arc<Mutex<Seen>>) {
    let mut presence = Presence::default();
    loop {
        let Some(node) = node.upgrade() else { return };
        let now = match look(&node, &mut presence).await {
            Ok(endpoints) => Seen { asked: true, endpoints, fault: None },
            Err(error) => Seen { asked: true, endpoints: Vec::new(), fault: Some(error.awaited()) },
        };
        drop(node);
        *seen.lock() = now;
        tokio::time::sleep(LOOK).await;
    }
}

async fn look(node: &Arc<Node>, presence: &mut Presence) -> Result<Vec<Discovered>, MasterError> {
    let types: BTreeMap<String, String> = node.master.topic_types().await?.into_iter().collect();
    let state = node.master.system_state().await?;
    let marks = marks::read(node.master.get_param(marks::NAMESPACE).await?.as_ref());
    let listed = endpoints(state, &types, &marks, node.name.full());
    let (found, orphans) = presence.sift(&node.core, listed);
    node.set_orphans(orphans);
    let there: BTreeSet<(Role, &str, &str)> = found
        .iter()
        .filter_map(|one| Some((one.role, one.name.as_str(), one.node.as_deref()?)))
        .collect();
    peer_types::keep_only(node, |role, name, node| there.contains(&(role, name, node)));
    Ok(found)
}

/// Everything that is not of the node `own`.
fn endpoints(
    state: SystemState,
    types: &BTreeMap<String, String>,
    marks: &Marks,
    own: &str,
) -> Vec<Discovered> {
    let SystemState { publishers, subscribers, services } = state;
    let mut all = Vec::new();
    let mut add = |owners: Owners, role: Role| {
        for (name, nodes) in owners {
            let known = types.get(&name).filter(|name| *name != "*");
            let type_name = if role == Role::Server { None } else { known };
            for node in nodes.into_iter().filter(|node| node != own) {
                all.push(Discovered {
                    type_name: type_name.cloned(),
                    mark: marks.get(&(role, name.clone(), node.clone())).cloned(),
                    node: Some(node),
                    ..Discovered::new(&name, role)
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

    fn waiting_for(&self) -> Option<String> {
        self.seen.lock().fault.clone()
    }

    fn is_complete(&self) -> Option<bool> {
        Some(self.seen.lock().asked)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let found = endpoints(state, &types.into(), &Marks::new(), "/own");
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
