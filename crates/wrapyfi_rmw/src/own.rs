//! The endpoints of this node itself: rmw counts them as matched, and what they publish is not for this node.

use std::collections::{HashMap, HashSet};

use super::{EndpointType, Gid};
use wrapyfi_endpoint::{AnnouncedQos, mismatches};

/// Endpoints of one node.
#[derive(Debug, Default)]
pub(crate) struct Own {
    /// The middleware counts the node's own endpoints as matched with each other.
    are_counted: bool,
    /// Identities of the node's publishers.
    pub(crate) gids: HashSet<Gid>,
    topics: HashMap<(String, EndpointType), Vec<Kind>>,
}

/// Properties that decide whether two endpoints of a topic match.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Kind {
    pub(crate) type_name: String,
    pub(crate) qos: AnnouncedQos,
}

impl Own {
    /// Endpoints of a node on the middleware `implementation`, none so far.
    pub(crate) fn on(implementation: &str) -> Self {
        // CycloneDDS does not match what is to be ignored.
        Self { are_counted: implementation != "rmw_cyclonedds_cpp", ..Self::default() }
    }

    pub(crate) fn add(&mut self, topic: &str, side: EndpointType, kind: &Kind) {
        self.topics.entry((topic.to_owned(), side)).or_default().push(kind.clone());
    }

    pub(crate) fn remove(&mut self, topic: &str, side: EndpointType, kind: &Kind) {
        let key = (topic.to_owned(), side);
        let Some(kinds) = self.topics.get_mut(&key) else { return };
        if let Some(at) = kinds.iter().position(|one| one == kind) {
            kinds.swap_remove(at);
        }
        if kinds.is_empty() {
            self.topics.remove(&key);
        }
    }

    /// Number of the node's own endpoints that the middleware counts as matched with one on `side`.
    pub(crate) fn matching(&self, topic: &str, side: EndpointType, kind: &Kind) -> usize {
        if !self.are_counted {
            return 0;
        }
        let other = match side {
            EndpointType::Publishers => EndpointType::Subscriptions,
            EndpointType::Subscriptions => EndpointType::Publishers,
        };
        let others = self.topics.get(&(topic.to_owned(), other));
        let matches = |one: &&Kind| {
            one.type_name == kind.type_name
                && match side {
                    EndpointType::Publishers => mismatches(&kind.qos, &one.qos),
                    EndpointType::Subscriptions => mismatches(&one.qos, &kind.qos),
                }
                .is_empty()
        };
        others.map_or(0, |others| others.iter().filter(matches).count())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_endpoint::{Qos, Reliability};

    fn kind(reliability: Reliability) -> Kind {
        let qos = Qos { reliability, ..Qos::default() }.into();
        Kind { type_name: "a/msg/B".to_owned(), qos }
    }

    #[test]
    fn only_those_that_match_are_counted() {
        let (reliable, best_effort) = (kind(Reliability::Reliable), kind(Reliability::BestEffort));
        let mut own = Own::on("rmw_fastrtps_cpp");
        own.add("/a", EndpointType::Subscriptions, &reliable);
        own.add("/a", EndpointType::Subscriptions, &best_effort);
        own.add("/b", EndpointType::Subscriptions, &reliable);
        assert_eq!(own.matching("/a", EndpointType::Publishers, &reliable), 2);
        assert_eq!(own.matching("/a", EndpointType::Publishers, &best_effort), 1);
        assert_eq!(own.matching("/a", EndpointType::Subscriptions, &reliable), 0);
        own.are_counted = false;
        assert_eq!(own.matching("/a", EndpointType::Publishers, &reliable), 0);
        own.are_counted = true;
        own.remove("/a", EndpointType::Subscriptions, &reliable);
        assert_eq!(own.matching("/a", EndpointType::Publishers, &reliable), 1);
        own.remove("/a", EndpointType::Subscriptions, &best_effort);
        own.remove("/b", EndpointType::Subscriptions, &reliable);
        assert!(own.topics.is_empty());
    }
}
