//! Diagnosis of an endpoint's peers: why some do not fit, and for whom an endpoint without any
//! waits.
//!
//! ```text
//!   matched > 0 ─────────────────────────────▶ nothing
//!   those there do not fit ──────────────────▶ "a publisher of /chatter that fits (/talker offers …)"
//!   the topic exists with another type ──────▶ "… with type A (those there carry B)"
//!   neither ─────────────────────────────────▶ "a publisher of /chatter", and the peer whose name does not resolve
//! ```

use crate::ros2::NAME;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, MutexGuard};
use std::time::{Duration, Instant};

use super::graph::{
    DiscoveredEndpoint, Graph, GraphResult, NodeWatch, Notify, PeerWatch, TopicDescription,
};
use super::matching::unmet;
use super::peer_relay::unresolved_peers;
use wrapyfi_endpoint::{
    Absent, AnnouncedQos, Cause, Durability, Link, Mutex, PinnedQos, Qos, QosPolicy, Role,
    Throttle, TopicSpec,
};

/// Time for which a peer waits for the name of its node before it is reported without.
const NAME_TIMEOUT: Duration = Duration::from_secs(1);

/// Peers that are reported at once, each in a sentence; of the others their number is.
const AT_ONCE: usize = 5;

/// `RIHS01_` and 64 digits.
const HASH_CHARS: usize = 71;

/// Names of nodes, for all endpoints of one. Begins to listen when the first name is wanted.
pub(super) struct Names {
    graph: Arc<dyn Graph>,
    nodes: Mutex<Option<Box<dyn NodeWatch>>>,
}

impl Names {
    pub(super) fn new(graph: &Arc<dyn Graph>) -> Arc<Self> {
        Arc::new(Self { graph: Arc::clone(graph), nodes: Mutex::new(None) })
    }

    fn listen(&self) -> MutexGuard<'_, Option<Box<dyn NodeWatch>>> {
        let mut nodes = self.nodes.lock();
        if nodes.is_none() {
            let listening = self.graph.nodes();
            *nodes = listening
                .inspect_err(|error| tracing::debug!(%error, "names of nodes stay unknown"))
                .ok();
        }
        nodes
    }

    pub(super) fn owner(&self, gid: &[u8; 16]) -> Option<String> {
        let mut nodes = self.listen();
        let nodes = nodes.as_mut()?;
        nodes.update();
        nodes.owner(gid).map(str::to_owned)
    }
}

/// Knows the other side of an endpoint's topic.
pub(super) struct Diagnosis {
    watch: Box<dyn PeerWatch>,
    names: Arc<Names>,
    topic: String,
    type_name: &'static str,
    /// Hash of the definition that is used here.
    type_hash: Option<String>,
    /// True where publishers are waited for.
    awaits_publisher: bool,
    /// Follows its peers, so that only what no peer offers stays unmet.
    matches: bool,
    /// Policies that are set elsewhere, whatever the peers announce.
    pinned: PinnedQos,
    /// Peers that do not fit, each with the time since which, and true once it was reported.
    unfit: BTreeMap<[u8; 16], (Instant, bool)>,
    /// Time before which nothing is reported.
    quiet_until: Option<Instant>,
}

impl Diagnosis {
    /// `on_change` is called from a DDS thread when peers come, change or go.
    pub(super) fn new(
        names: &Arc<Names>,
        topic: &TopicDescription,
        spec: &TopicSpec,
        awaits_publisher: bool,
        on_change: Notify,
    ) -> GraphResult<Self> {
        Ok(Self {
            watch: names.graph.watch(&topic.name, awaits_publisher, on_change)?,
            names: Arc::clone(names),
            topic: topic.name.clone(),
            type_name: spec.message_type.ros_type(),
            type_hash: topic.type_hash.clone(),
            awaits_publisher,
            matches: spec.match_peers,
            pinned: spec.pinned,
            unfit: BTreeMap::new(),
            quiet_until: None,
        })
    }

    /// Grows when peers come, change or go.
    pub(super) fn changes(&self) -> u64 {
        self.watch.changes()
    }

    /// Peers that carry the endpoint's type.
    pub(super) fn peers(&self) -> Vec<DiscoveredEndpoint> {
        let mut peers = self.watch.peers();
        peers.retain(|peer| peer.type_name == self.type_name);
        peers
    }

    /// Begins to listen for the names of nodes: something will be said about a peer soon.
    pub(super) fn prepare_names(&self) {
        drop(self.names.listen());
    }

    /// The link of an endpoint with `matched` peers and quality of service `own`.
    pub(super) fn link(
        &self,
        matched: usize,
        incompatible: Option<&'static str>,
        own: &Qos,
        keeps_last: bool,
    ) -> Link {
        // A writer that keeps its samples for late readers has something to do without any.
        let idle = matched == 0 && (!keeps_last || incompatible.is_some());
        let waiting_for = idle.then(|| self.missing(own, incompatible));
        Link { peers: Some(matched), waiting_for, keeps_last }
    }

    fn missing(&self, own: &Qos, incompatible: Option<&'static str>) -> Cause {
        let absent = match self.awaits_publisher {
            true => Absent::new(Role::Publisher, "a publisher of", NAME, &self.topic),
            false => Absent::new(Role::Listener, "a subscriber of", NAME, &self.topic),
        };
        let all = self.watch.peers();
        let of_type = |wanted: bool| {
            all.iter().filter(move |peer| (peer.type_name == self.type_name) == wanted)
        };
        let unfit = of_type(true).find_map(|peer| {
            let policies = unmet(self.awaits_publisher, own, &peer.qos);
            policies.first().map(|&policy| (peer, policy))
        });
        match (unfit, incompatible, of_type(false).next()) {
            (Some((peer, policy)), ..) => {
                let theirs = policy.value(&peer.qos);
                let ours = policy.value(&AnnouncedQos::from(*own));
                Cause::Qos { absent, peer: self.name(peer), theirs, ours }
            }
            // A policy that is none of ROS's.
            (None, Some(policy), _) if of_type(true).next().is_some() => {
                Cause::Policy { absent, policy }
            }
            (None, _, Some(other)) => {
                let (theirs, ours) = (other.type_name.clone(), self.type_name.to_owned());
                Cause::Type { absent, peer: None, theirs, ours }
            }
            (None, _, None) => match unresolved_peers().into_iter().next() {
                Some(why) => Cause::UnresolvedHost { absent, why },
                None => Cause::Nobody(absent),
            },
        }
    }

    /// Peers that do not fit and were not reported yet, each in a sentence, and when to ask again. A few
    /// at once, and then nothing for a while, whatever strangers do.
    pub(super) fn complaints(&mut self, own: &Qos, now: Instant) -> (Vec<String>, Option<Instant>) {
        let peers = self.peers();
        let faults: Vec<_> = peers
            .iter()
            .filter_map(|peer| self.fault(peer, own).map(|fault| (peer, fault)))
            .collect();
        let gids: BTreeSet<_> = faults.iter().map(|(peer, _)| peer.gid).collect();
        self.unfit.retain(|gid, _| gids.contains(gid));
        for gid in gids {
            self.unfit.entry(gid).or_insert((now, false));
        }
        if self.quiet_until.is_some_and(|until| now < until) {
            return (Vec::new(), self.quiet_until);
        }
        let (mut due, mut next) = (Vec::new(), None);
        for (peer, fault) in faults {
            let Some((since, reported)) = self.unfit.get_mut(&peer.gid) else { continue };
            if *reported {
                continue;
            }
            if now < *since + NAME_TIMEOUT && self.names.owner(&peer.gid).is_none() {
                next = Some(now + NAME_TIMEOUT / 10);
                continue;
            }
            *reported = true;
            due.push((peer, fault));
        }
        let mut texts: Vec<_> = due
            .iter()
            .take(AT_ONCE)
            .map(|&(peer, fault)| self.complaint(peer, fault, own))
            .collect();
        if due.len() > AT_ONCE {
            let more = due.len() - AT_ONCE;
            texts.push(format!("{more} more {}s on {} do not match", self.peer(), self.topic));
        }
        if !texts.is_empty() {
            self.quiet_until = Some(now + Throttle::EVERY);
        }
        (texts, next)
    }

    /// Fault that keeps a peer of the right type apart, if any.
    fn fault(&self, peer: &DiscoveredEndpoint, own: &Qos) -> Option<Fault> {
        let policies = unmet(self.awaits_publisher, own, &peer.qos);
        match (policies.first(), &peer.type_hash, &self.type_hash) {
            (Some(&policy), ..) => Some(Fault::Policy(policy)),
            (None, Some(theirs), Some(ours)) if theirs != ours => Some(Fault::Definition),
            _ => None,
        }
    }

    fn complaint(&self, peer: &DiscoveredEndpoint, fault: Fault, own: &Qos) -> String {
        let (role, topic) = (self.peer(), &self.topic);
        let policy = match fault {
            Fault::Policy(policy) => policy,
            Fault::Definition => return self.other_definition(peer),
        };
        let values = self.values(peer, policy, own);
        let remedy = remedy(policy, self.awaits_publisher, own);
        if self.pinned.holds(policy) {
            format!(
                "{role} on {topic} does not match: {values}; the parameters qos_overrides lay that \
                 down: change them, or {remedy}"
            )
        } else if self.matches {
            format!("{role} on {topic} does not match: {values}; no route offers that: {remedy}")
        } else {
            format!(
                "{role} on {topic} does not match: {values}; write qos: match on the route, or \
                 {remedy}"
            )
        }
    }

    /// DDS matches by the type's name alone: messages are exchanged, and read by another definition.
    fn other_definition(&self, peer: &DiscoveredEndpoint) -> String {
        let hash = |hash: &Option<String>| shortened(hash.as_deref().unwrap_or_default());
        format!(
            "{} on {} of node {} has another definition of {}: its hash is {}, here it is {}. \
             Messages are misread or refused until both sides use the same version of the package",
            self.peer(),
            self.topic,
            self.name(peer),
            self.type_name,
            hash(&peer.type_hash),
            hash(&self.type_hash)
        )
    }

    /// `/talker offers best effort, the route asks for reliable`.
    fn values(&self, peer: &DiscoveredEndpoint, policy: QosPolicy, own: &Qos) -> String {
        let node = self.name(peer);
        let theirs = policy.value(&peer.qos);
        let ours = policy.value(&AnnouncedQos::from(*own));
        if self.awaits_publisher {
            format!("{node} offers {theirs}, the route asks for {ours}")
        } else {
            format!("{node} asks for {theirs}, the route offers {ours}")
        }
    }

    /// The node of a peer, or what stands for it.
    fn name(&self, peer: &DiscoveredEndpoint) -> String {
        let unnamed = || format!("a {} of an unknown node", self.peer());
        self.names.owner(&peer.gid).unwrap_or_else(unnamed)
    }

    /// Reason, in words, for which `peers` make the endpoint go from `old` to `new`.
    pub(super) fn reason(&self, peers: &[DiscoveredEndpoint], old: &Qos, new: &Qos) -> String {
        let shut_out: Vec<_> = peers
            .iter()
            .filter(|peer| unmet(self.awaits_publisher, new, &peer.qos).is_empty())
            .filter_map(|peer| {
                let policies = unmet(self.awaits_publisher, old, &peer.qos);
                policies.first().map(|policy| {
                    let verb = if self.awaits_publisher { "offers" } else { "asks for" };
                    format!("{} {verb} {}", self.name(peer), policy.value(&peer.qos))
                })
            })
            .collect();
        match (shut_out.as_slice(), self.awaits_publisher) {
            ([one], _) => one.clone(),
            ([one, more @ ..], _) => format!("{one}, and {} more", more.len()),
            ([], true) => format!("all {} publishers offer it", peers.len()),
            ([], false) => format!("none of {} subscribers asks for more", peers.len()),
        }
    }

    fn peer(&self) -> &'static str {
        if self.awaits_publisher { "publisher" } else { "subscriber" }
    }
}

/// Fault of a peer of the right type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fault {
    /// The peer's quality of service does not fit.
    Policy(QosPolicy),
    /// The peer's type was made from another definition.
    Definition,
}

/// A hash as strangers announce it, cut to the length that hashes have.
fn shortened(hash: &str) -> String {
    hash.chars().take(HASH_CHARS).collect()
}

/// Remedy at the other end that makes it match an endpoint with `own`, in words: an endpoint that
/// awaits publishers, or else subscribers.
pub fn remedy(policy: QosPolicy, awaits_publisher: bool, own: &Qos) -> String {
    let time = |time: Option<Duration>| time.map_or("none".to_owned(), |time| format!("{time:?}"));
    match (policy, awaits_publisher) {
        (QosPolicy::Reliability, true) => "make the publisher reliable".to_owned(),
        (QosPolicy::Reliability, false) => "make the subscriber best effort".to_owned(),
        (QosPolicy::Durability, true) => "make the publisher transient local".to_owned(),
        (QosPolicy::Durability, false) => match own.durability {
            Durability::TransientLocal => {
                "make the subscriber transient local or volatile".to_owned()
            }
            Durability::Volatile => "make the subscriber volatile".to_owned(),
        },
        (QosPolicy::Deadline, true) => {
            format!("give the publisher a deadline of at most {}", time(own.deadline))
        }
        (QosPolicy::Deadline, false) => match own.deadline {
            Some(own) => format!("give the subscriber a deadline of at least {own:?}"),
            None => "take the deadline from the subscriber".to_owned(),
        },
        (QosPolicy::Liveliness, true) => format!(
            "give the publisher at least {}",
            QosPolicy::Liveliness.value(&AnnouncedQos::from(*own))
        ),
        (QosPolicy::Liveliness, false) => format!(
            "let the subscriber ask for no more than {}",
            QosPolicy::Liveliness.value(&AnnouncedQos::from(*own))
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_endpoint::QosPreset;

    #[test]
    fn the_remedy_is_what_would_fit() {
        let own = Qos { deadline: Some(Duration::from_millis(100)), ..Qos::default() };
        for (policy, awaits_publisher, words) in [
            (QosPolicy::Reliability, true, "make the publisher reliable"),
            (QosPolicy::Reliability, false, "make the subscriber best effort"),
            (QosPolicy::Durability, true, "make the publisher transient local"),
            (QosPolicy::Durability, false, "make the subscriber volatile"),
            (QosPolicy::Deadline, true, "give the publisher a deadline of at most 100ms"),
            (QosPolicy::Deadline, false, "give the subscriber a deadline of at least 100ms"),
            (
                QosPolicy::Liveliness,
                true,
                "give the publisher at least automatic liveliness with no lease",
            ),
            (
                QosPolicy::Liveliness,
                false,
                "let the subscriber ask for no more than automatic liveliness with no lease",
            ),
        ] {
            assert_eq!(remedy(policy, awaits_publisher, &own), words);
        }
        let latched = Qos::from(QosPreset::Latched);
        assert_eq!(
            remedy(QosPolicy::Durability, false, &latched),
            "make the subscriber transient local or volatile"
        );
        assert_eq!(
            remedy(QosPolicy::Deadline, false, &latched),
            "take the deadline from the subscriber"
        );
    }
}
