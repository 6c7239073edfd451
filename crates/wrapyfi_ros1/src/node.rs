//! The node: its endpoints by name, what the master should know of them, and its two servers.
//!
//! ```text
//!   open, close ──▶ Node { publications, subscriptions, services, parameters } ──▶ Registrar ──▶ master
//!                     ▲ publisherUpdate      ▲ requestTopic         ▲ connection header
//!                     └── slave API ─────────┘                      └── TCPROS port
//! ```

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Deref;
use std::sync::{Arc, MutexGuard};

use tokio::sync::Notify;

use super::config::NodeUri;
use super::core::Core;
use super::listener_connections::ListenerConnections;
use super::marks::Marked;
use super::parameters::Watched;
use super::publication::Publication;
use super::registrations::{Key, Kind, Registrations};
use super::service_host::ServiceHost;
use wrapyfi_endpoint::{BridgeMark, Cause, Mutex, Role, Wake};

/// The endpoints of a node.
pub(super) struct Node {
    /// State that their connections need.
    pub(super) core: Arc<Core>,
    /// Signal that there is something to register.
    pub(super) work: Notify,
    state: Mutex<NodeState>,
}

impl Deref for Node {
    type Target = Core;

    fn deref(&self) -> &Core {
        &self.core
    }
}

#[derive(Default)]
pub(super) struct NodeState {
    pub(super) registrations: Registrations,
    pub(super) topics: BTreeMap<String, Vec<Arc<Publication>>>,
    pub(super) subscriptions: BTreeMap<String, Subscription>,
    pub(super) services: BTreeMap<String, Arc<ServiceHost>>,
    pub(super) parameters: BTreeMap<String, Vec<Arc<Watched>>>,
    /// Publishers of topics that the master has forgotten, and that are there.
    orphans: BTreeMap<String, BTreeSet<NodeUri>>,
    /// Reason why the master cannot be used now.
    fault: Option<Cause>,
    /// Cause for which the node has ended, if it has.
    pub(super) ended: Option<Cause>,
}

/// Question to the master who publishes a topic.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Question {
    asked: u64,
    updates: u64,
}

/// A topic that is subscribed to: one registration, and its listeners.
#[derive(Default)]
pub(super) struct Subscription {
    /// Addresses of the publishers' nodes, as the master listed them last.
    publishers: Vec<NodeUri>,
    /// The master has told who they are.
    is_known: bool,
    /// Number of times that the master was to be asked, and the one whose answer has this node among them.
    asked: u64,
    listed: Option<u64>,
    /// Number of lists of publishers that the master sent without being asked.
    updates: u64,
    pub(super) listeners: Vec<Arc<ListenerConnections>>,
}

impl Node {
    pub(super) fn new(core: Arc<Core>) -> Arc<Self> {
        Arc::new(Self { core, work: Notify::new(), state: Mutex::default() })
    }

    pub(super) fn state(&self) -> MutexGuard<'_, NodeState> {
        self.state.lock()
    }

    /// Cause for which nothing can be found through the master now.
    pub(super) fn fault(&self) -> Option<Cause> {
        let state = self.state();
        state.ended.clone().or_else(|| state.fault.clone())
    }

    /// Notes how the master is; who waits for it is told of a change.
    pub(super) fn set_fault(&self, fault: Option<Cause>) {
        let wakes = {
            let mut state = self.state();
            if state.fault == fault {
                return;
            }
            match (&fault, &state.fault) {
                (Some(fault), None) => {
                    tracing::warn!("ROS 1: waiting for {fault}; connections stay");
                }
                (None, Some(_)) => tracing::info!("ROS 1: the master answers again"),
                _ => {}
            }
            state.fault = fault;
            state.bells()
        };
        wakes.iter().for_each(Wake::ring);
    }

    /// Ends the node's part in the graph for good.
    pub(super) fn end(&self, reason: String) {
        let (wakes, listeners, publications, hosts) = {
            let mut state = self.state();
            if state.ended.is_some() {
                return;
            }
            state.ended = Some(Cause::Ended(reason));
            state.registrations.unwant_all();
            let listeners: Vec<_> =
                state.subscriptions.values().flat_map(|one| one.listeners.clone()).collect();
            let publications: Vec<_> = state.topics.values().flatten().cloned().collect();
            let hosts: Vec<_> = state.services.values().cloned().collect();
            (state.bells(), listeners, publications, hosts)
        };
        listeners.iter().for_each(|connections| connections.close());
        publications.iter().for_each(|publication| publication.close());
        hosts.iter().for_each(|host| host.close());
        self.work.notify_one();
        wakes.iter().for_each(Wake::ring);
    }

    /// Wants something registered, unless the node has ended.
    fn want(&self, state: &mut NodeState, kind: Kind, name: &str, type_name: &str) {
        if state.ended.is_none() {
            state.registrations.want(Key::new(kind, name), type_name);
            self.work.notify_one();
        }
    }

    fn unwant(&self, state: &mut NodeState, kind: Kind, name: &str) {
        state.registrations.unwant(&Key::new(kind, name));
        self.work.notify_one();
    }

    /// Enters a listener.
    pub(super) fn listen(
        &self,
        topic: &str,
        type_name: &str,
        connections: &Arc<ListenerConnections>,
    ) {
        let mut state = self.state();
        let NodeState { subscriptions, orphans, .. } = &mut *state;
        let subscription = subscriptions.entry(topic.to_owned()).or_default();
        connections.number_among(&subscription.listeners);
        subscription.listeners.push(Arc::clone(connections));
        // Under the lock, so that nothing older comes after what the master says next.
        connections.update(&with_orphans(&subscription.publishers, orphans.get(topic)));
        self.want(&mut state, Kind::Subscriber, topic, type_name);
    }

    /// Takes a listener out; the registration goes with the last one.
    pub(super) fn unlisten(&self, topic: &str, connections: &Arc<ListenerConnections>) {
        connections.close();
        let mut state = self.state();
        let Some(subscription) = state.subscriptions.get_mut(topic) else { return };
        subscription.listeners.retain(|listener| !Arc::ptr_eq(listener, connections));
        if subscription.listeners.is_empty() {
            state.subscriptions.remove(topic);
            self.unwant(&mut state, Kind::Subscriber, topic);
        }
    }

    /// True once the master has told who publishes a topic that is subscribed to.
    pub(super) fn has_asked_for(&self, topic: &str) -> bool {
        self.state().subscriptions.get(topic).is_some_and(|subscription| subscription.is_known)
    }

    /// Asks the master anew who publishes a topic that is subscribed to, once it knows what this node publishes.
    pub(super) fn ask_again(&self, topic: &str) {
        let mut state = self.state();
        let Some(subscription) = state.subscriptions.get_mut(topic) else { return };
        subscription.asked += 1;
        let type_name = subscription.listeners.first().map(|it| it.type_name().to_owned());
        self.want(&mut state, Kind::Subscriber, topic, &type_name.unwrap_or_default());
    }

    /// True once the master has told who publishes a topic, this node among them: who comes later is told of it.
    pub(super) fn is_listed(&self, topic: &str) -> bool {
        let state = self.state();
        state.subscriptions.get(topic).is_some_and(|it| it.listed == Some(it.asked))
    }

    /// Numbers of what the master was asked about a topic and of what it told by itself: for [`Node::set_publishers`].
    pub(super) fn question(&self, topic: &str) -> Question {
        let state = self.state();
        let known = state.subscriptions.get(topic);
        known.map_or_else(Question::default, |it| Question { asked: it.asked, updates: it.updates })
    }

    /// Takes what the master says about who publishes a topic: by itself, or as the answer to a question. News that it
    /// told by itself since then may be newer, and its answer only adds.
    pub(super) fn set_publishers(&self, topic: &str, uris: &[String], answer: Option<Question>) {
        let mut publishers = Vec::with_capacity(uris.len());
        let mut is_among = false;
        for uri in uris {
            match NodeUri::parse(uri) {
                // Messages of this node are not for its own listeners.
                Ok(uri) if uri == self.api => is_among = true,
                Ok(uri) => publishers.push(self.master.whereabouts.of(uri)),
                Err(reason) => {
                    tracing::warn!(topic, "ROS 1: a publisher's address {uri:?} is none: {reason}");
                }
            }
        }
        let mut state = self.state();
        let NodeState { subscriptions, orphans, .. } = &mut *state;
        let Some(subscription) = subscriptions.get_mut(topic) else { return };
        match answer {
            None => subscription.updates += 1,
            Some(Question { asked, updates }) => {
                subscription.listed = is_among.then_some(asked);
                if updates != subscription.updates {
                    publishers.extend_from_slice(&subscription.publishers);
                }
            }
        }
        publishers.sort();
        publishers.dedup();
        (subscription.publishers, subscription.is_known) = (publishers, true);
        subscription.tell(orphans.get(topic));
    }

    /// Takes who publishes what, though the master lists it no more: listeners connect to them too.
    pub(super) fn set_orphans(&self, orphans: BTreeMap<String, BTreeSet<NodeUri>>) {
        let mut state = self.state();
        let before = std::mem::replace(&mut state.orphans, orphans);
        let NodeState { subscriptions, orphans, .. } = &*state;
        for (topic, subscription) in subscriptions {
            let own = orphans.get(topic);
            if before.get(topic) != own {
                subscription.tell(own);
            }
        }
    }

    /// Enters a publication of a topic, or finds the one there is of this type.
    pub(super) fn advertise(
        &self,
        topic: &str,
        md5: &str,
        make: impl FnOnce() -> Publication,
        enter: impl FnOnce(&Publication),
    ) -> Arc<Publication> {
        let mut state = self.state();
        let all = state.topics.entry(topic.to_owned()).or_default();
        let known = all.iter().find(|one| one.wire_type.md5 == md5).cloned();
        let publication = known.unwrap_or_else(|| {
            let made = Arc::new(make());
            all.push(Arc::clone(&made));
            made
        });
        // Under the lock: a publication without publishers may be taken out.
        enter(&publication);
        let type_name = publication.wire_type.name.clone();
        self.want(&mut state, Kind::Publisher, topic, &type_name);
        publication
    }

    /// Takes a publication out that no publisher uses any more.
    pub(super) fn unadvertise(&self, topic: &str, publication: &Arc<Publication>) {
        let mut state = self.state();
        // A publisher may have found it again.
        if publication.in_use() {
            return;
        }
        publication.close();
        if leave(&mut state.topics, topic, publication) {
            self.unwant(&mut state, Kind::Publisher, topic);
        }
    }

    /// Enters a service; false where this node has one of that name.
    pub(super) fn offer(&self, service: &str, host: &Arc<ServiceHost>) -> bool {
        let mut state = self.state();
        if state.services.contains_key(service) {
            return false;
        }
        state.services.insert(service.to_owned(), Arc::clone(host));
        self.want(&mut state, Kind::Service, service, "");
        true
    }

    pub(super) fn withdraw(&self, service: &str) {
        let mut state = self.state();
        state.services.remove(service);
        self.unwant(&mut state, Kind::Service, service);
    }

    /// Tells other bridges that a topic or service of this node was made by pattern, until the mark is dropped.
    pub(super) fn mark(
        self: &Arc<Self>,
        role: Role,
        name: &str,
        mark: &Option<BridgeMark>,
    ) -> Option<Mark> {
        let (name, node) = (name.to_owned(), self.name.full().to_owned());
        let marked = Marked { role, name, node, mark: mark.clone()? };
        let key = Key::new(Kind::Mark, &marked.parameter());
        self.state().registrations.want(key.clone(), &marked.to_string());
        self.work.notify_one();
        Some(Mark(Arc::clone(self), key))
    }

    /// Enters a watch on a parameter.
    pub(super) fn watch(&self, key: &str, watched: &Arc<Watched>) {
        let mut state = self.state();
        state.parameters.entry(key.to_owned()).or_default().push(Arc::clone(watched));
        self.want(&mut state, Kind::Parameter, key, "");
    }

    /// Asks anew for the parameters whose names are meant.
    pub(super) fn rewatch(&self, meant: impl Fn(&str) -> bool) {
        let mut state = self.state();
        let keys: Vec<String> = state.parameters.keys().filter(|key| meant(key)).cloned().collect();
        for key in keys {
            self.want(&mut state, Kind::Parameter, &key, "");
        }
    }

    pub(super) fn unwatch(&self, key: &str, watched: &Arc<Watched>) {
        let mut state = self.state();
        if leave(&mut state.parameters, key, watched) {
            self.unwant(&mut state, Kind::Parameter, key);
        }
    }
}

impl NodeState {
    /// The bells of all endpoints.
    fn bells(&self) -> Vec<Wake> {
        let listeners = self.subscriptions.values().flat_map(|one| &one.listeners);
        let publications = self.topics.values().flatten();
        let watched = self.parameters.values().flatten();
        listeners
            .map(|connections| connections.wake().clone())
            .chain(publications.flat_map(|publication| publication.wakes()))
            .chain(self.services.values().map(|host| host.wake().clone()))
            .chain(watched.map(|watched| watched.wake().clone()))
            .collect()
    }
}

/// Mark of an endpoint that was made by pattern, at the master while this lives.
pub(super) struct Mark(Arc<Node>, Key);

impl Drop for Mark {
    fn drop(&mut self) {
        self.0.state().registrations.unwant(&self.1);
        self.0.work.notify_one();
    }
}

/// Takes one out of those of a name; true where it was the last.
fn leave<T>(all: &mut BTreeMap<String, Vec<Arc<T>>>, name: &str, one: &Arc<T>) -> bool {
    let Some(of_name) = all.get_mut(name) else { return false };
    of_name.retain(|other| !Arc::ptr_eq(other, one));
    of_name.is_empty() && all.remove(name).is_some()
}

fn with_orphans(listed: &[NodeUri], orphans: Option<&BTreeSet<NodeUri>>) -> Vec<NodeUri> {
    let more = orphans.into_iter().flatten().filter(|uri| !listed.contains(uri));
    listed.iter().chain(more).cloned().collect()
}

impl Subscription {
    /// Tells the listeners who publishes.
    fn tell(&self, orphans: Option<&BTreeSet<NodeUri>>) {
        let publishers = with_orphans(&self.publishers, orphans);
        self.listeners.iter().for_each(|connections| connections.update(&publishers));
    }
}
