//! The ROS 2 graph as [`Discovery`] shows it: topics, services and actions of other participants.
//!
//! ```text
//!   DDS built-in topics ─ Graph::endpoints ─┐
//!   ros_discovery_info ── NodeWatch ────────┴─▶ Discovered { /chatter, publisher, type, node, … }
//! ```
//!
//! Fast DDS tells a reader the names of its nodes as soon as it knows of the reader, and again 3 s later. CycloneDDS,
//! which mostly does not know of the writer by then, misses the former: so where it does, another reader is opened.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Instant;

use super::action_discovery::with_actions;
use super::completeness::{Completeness, Prefix};
use super::discovery_info::TOPIC;
use super::graph::{DiscoveredEndpoint, Graph, GraphError, NodeWatch, ServiceMapping};
use super::names::{self, RosName};
use super::ros2::NAME;
use super::vendor::is_rustdds;
use wrapyfi_endpoint::{DiscoverError, Discovered, Discovery, Role};

/// Looks at one graph.
pub(super) struct Ros2Discovery {
    graph: Arc<dyn Graph>,
    nodes: Box<dyn NodeWatch>,
    /// The other watch of the names of nodes, and the participants for which it was opened.
    again: (Option<Box<dyn NodeWatch>>, BTreeSet<Prefix>),
    /// Participants whose publishers, subscriptions and nodes are known.
    told: BTreeSet<Prefix>,
    completeness: Completeness,
    /// Endpoints of the last look, as long as looks are not complete.
    before: Vec<Discovered>,
    /// Endpoints that were listed last, and [`Graph::changes`] from before that.
    listed: Option<(u64, Vec<Discovered>)>,
    carried_by: Option<Arc<str>>,
}

impl Ros2Discovery {
    pub(super) fn new(
        graph: &Arc<dyn Graph>,
        carried_by: Option<Arc<str>>,
    ) -> Result<Self, DiscoverError> {
        let nodes = graph.nodes().map_err(|error| transport(&error))?;
        let again = (None, BTreeSet::new());
        let (graph, told) = (Arc::clone(graph), BTreeSet::new());
        let completeness = Completeness::new(Instant::now());
        let before = Vec::new();
        Ok(Self { graph, nodes, again, told, completeness, before, listed: None, carried_by })
    }

    fn owner(&self, gid: &[u8; 16]) -> Option<&str> {
        self.nodes.owner(gid).or_else(|| self.again.0.as_ref()?.owner(gid))
    }

    /// Asks for the names of nodes on Fast DDS that have not come, once for each participant that tells some.
    fn ask_again(&mut self, found: &[DiscoveredEndpoint]) -> Result<(), GraphError> {
        let is_fast = |it: &&DiscoveredEndpoint| {
            !it.is_own && it.service_mapping == Some(ServiceMapping::FastDds)
        };
        let (told_on, others): (Vec<_>, Vec<_>) =
            found.iter().filter(is_fast).partition(|it| it.dds_topic == TOPIC);
        let unnamed = others.into_iter().filter(|it| self.owner(&it.gid).is_none());
        let unnamed: BTreeSet<Prefix> = unnamed.filter_map(participant).collect();
        let tells = told_on.into_iter().filter(|it| it.is_publisher).filter_map(participant);
        let unnamed: BTreeSet<Prefix> = tells.filter(|it| unnamed.contains(it)).collect();
        if !unnamed.is_subset(&self.again.1) {
            self.again = (Some(self.graph.nodes()?), unnamed);
        }
        Ok(())
    }

    /// Takes note of which participants have told what they have.
    fn note_told(&mut self, found: &[DiscoveredEndpoint]) {
        let of = |meant: &dyn Fn(&DiscoveredEndpoint) -> bool| -> BTreeSet<Prefix> {
            found.iter().filter(|it| meant(it)).filter_map(participant).collect()
        };
        // Publishers and subscriptions are told apart from each other, and every node of ROS has both there.
        let sides =
            [true, false].map(|it| of(&|one| one.is_publisher == it && one.dds_topic == TOPIC));
        self.told = of(&|it| self.owner(&it.gid).is_some());
        self.told.retain(|one| sides.iter().all(|side| side.contains(one)));
    }

    fn look(&mut self) -> Result<Vec<Discovered>, DiscoverError> {
        let mut is_news = false;
        for nodes in std::iter::once(&mut self.nodes).chain(&mut self.again.0) {
            is_news |= nodes.update();
        }
        let changes = self.graph.changes();
        // Many times a second, of hundreds of endpoints.
        if let (false, Some(now), Some((before, listed))) = (is_news, changes, &self.listed)
            && now == *before
        {
            return Ok(listed.clone());
        }
        // News that an error keeps from being listed are not told again.
        self.listed = None;
        let found = self.graph.endpoints().map_err(|error| transport(&error))?;
        self.ask_again(&found).map_err(|error| transport(&error))?;
        if !self.completeness.is_complete() {
            self.note_told(&found);
        }
        let foreign = found.into_iter().filter(|endpoint| !endpoint.is_own);
        let found: Vec<_> = foreign
            .filter_map(|endpoint| {
                let node = self.owner(&endpoint.gid).map(str::to_owned);
                let is_second = is_rustdds(&endpoint.gid);
                Some((is_second, discovered(endpoint, node)?))
            })
            .collect();
        let mut found = with_actions(in_one_mapping(found));
        found.sort_by(|a, b| (&a.name, a.role, &a.node).cmp(&(&b.name, b.role, &b.node)));
        self.listed = changes.map(|changes| (changes, found.clone()));
        Ok(found)
    }
}

fn participant(endpoint: &DiscoveredEndpoint) -> Option<Prefix> {
    endpoint.gid.first_chunk().copied()
}

fn transport(error: &GraphError) -> DiscoverError {
    DiscoverError::Transport { middleware: NAME.to_owned(), reason: error.to_string() }
}

impl Discovery for Ros2Discovery {
    fn endpoints(&mut self) -> Result<Vec<Discovered>, DiscoverError> {
        let found = self.look()?;
        if !self.completeness.is_complete() {
            let Self { graph, told, completeness, before, .. } = self;
            let (now, participants) = (Instant::now(), graph.participants());
            completeness.note(now, participants, found != *before, |one| told.contains(one));
            *before = if completeness.is_complete() { Vec::new() } else { found.clone() };
        }
        Ok(found)
    }

    fn has_everybody_told(&self) -> Option<bool> {
        Some(self.completeness.is_complete())
    }

    fn carried_by(&self) -> Option<&str> {
        self.carried_by.as_deref()
    }
}

/// Endpoints, those with true without the ends of services that a node has elsewhere as well: in both mappings.
fn in_one_mapping(found: Vec<(bool, Discovered)>) -> Vec<Discovered> {
    let key = |it: &Discovered| (it.name.clone(), it.role, it.node.clone());
    let firsts: BTreeSet<_> =
        found.iter().filter(|(is_second, _)| !is_second).map(|(_, it)| key(it)).collect();
    let is_told = |(is_second, it): &(bool, Discovered)| {
        let is_service = matches!(it.role, Role::Server | Role::Client);
        !(*is_second && is_service && it.node.is_some() && firsts.contains(&key(it)))
    };
    found.into_iter().filter(is_told).map(|(_, it)| it).collect()
}

/// One endpoint in ROS's terms. A service is seen once on each side: by the requests that its
/// server reads, and by those that a client writes.
fn discovered(endpoint: DiscoveredEndpoint, node: Option<String>) -> Option<Discovered> {
    let mut qos = endpoint.qos;
    let (name, role, type_name) = match names::from_dds(&endpoint.dds_topic) {
        RosName::Topic(name) => {
            let role = if endpoint.is_publisher { Role::Publisher } else { Role::Listener };
            (name.to_owned(), role, endpoint.type_name)
        }
        RosName::Requests(name) => {
            let role = if endpoint.is_publisher { Role::Client } else { Role::Server };
            let service = names::service_type_from_dds(&endpoint.dds_type);
            // Only what its stack assumes: ROS 2 announces none.
            qos.history = None;
            (name.to_owned(), role, service.unwrap_or(endpoint.dds_type))
        }
        RosName::Replies(_) => return None,
        // Discovery's own, on every participant.
        RosName::Dds(TOPIC) => return None,
        RosName::Dds(name) => {
            let role = if endpoint.is_publisher { Role::Publisher } else { Role::Listener };
            // A name without a leading slash is no ROS name, and cannot be mistaken for one.
            (name.to_owned(), role, endpoint.dds_type)
        }
    };
    Some(Discovered {
        name,
        role,
        type_name: Some(type_name),
        type_hash: endpoint.type_hash,
        qos: Some(qos),
        node,
        count: 1,
        traffic: None,
        mark: endpoint.mark,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_service_in_both_mappings_is_one() {
        let end = |role, node: Option<&str>| {
            let node = node.map(str::to_owned);
            Discovered { node, ..Discovered::new("/s", role) }
        };
        let (server, client) = (end(Role::Server, Some("/a")), end(Role::Client, Some("/a")));
        let unnamed = end(Role::Server, None);
        let topic = end(Role::Publisher, Some("/a"));
        let found = vec![
            (true, server.clone()),
            (false, server.clone()),
            (true, client.clone()),
            (false, unnamed.clone()),
            (true, unnamed.clone()),
            (false, topic.clone()),
            (true, topic.clone()),
        ];
        let told = [server, client, unnamed.clone(), unnamed, topic.clone(), topic];
        assert_eq!(in_one_mapping(found), told);
    }
}
