//! Types of a whole graph of ROS, as its nodes show them.
//!
//! ```text
//!   ros:   publishers, servers of actions show definitions; folders of ROS_PACKAGE_PATH ─┐
//!   ros2:  names and hashes; ~/get_type_description of the node ─────────────────────────┴─▶ Learned, an endpoint each
//! ```

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::str::FromStr;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use wrapyfi_data::types::ServiceKind;
use wrapyfi_endpoint::{Discovered, Interaction, LearnError, LearnResult, Middleware, Role, Wake};
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::{ResolvedType, TypeStore};
use wrapyfi_ros1::{self as ros1, Ros1};
use wrapyfi_ros2 as ros2;

use crate::discovery_watch::DiscoveryWatch;
use crate::exit::{Failure, Result};
use crate::middlewares::{Endpoints, description_of, observer};
use crate::own_address::OwnAddress;
use crate::shutdown::Shutdown;

/// Longest look for endpoints.
const LOOK_WITHIN: Duration = Duration::from_secs(3);
/// Time that all endpoints together have to show their types.
const LEARN_WITHIN: Duration = Duration::from_secs(10);
/// Pause between two looks.
const PAUSE: Duration = Duration::from_millis(20);
/// Names of the topics of an action on ROS 1, behind its own.
const OF_ACTION: [&str; 5] = ["goal", "cancel", "status", "feedback", "result"];

/// A graph of ROS on the command line: `ros:` or `ros2:`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RosGraph(&'static str);

impl RosGraph {
    /// The graph of ROS 1.
    pub const ROS1: Self = Self(ros1::NAME);

    /// Name of its middleware.
    pub fn middleware(self) -> &'static str {
        self.0
    }
}

impl FromStr for RosGraph {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let name = text.strip_suffix('/').unwrap_or(text);
        let name = name.strip_suffix(':').unwrap_or(name);
        let known = [ros1::NAME, ros2::NAME].into_iter().find(|known| *known == name);
        known.map(Self).ok_or_else(|| "must be ros: (ROS 1) or ros2:".to_owned())
    }
}

impl fmt::Display for RosGraph {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:", self.0)
    }
}

/// An endpoint, and the type of ROS 2 that it has or becomes.
#[derive(Debug)]
pub(crate) struct Learned {
    pub(crate) endpoint: Discovered,
    pub(crate) told: LearnResult<ResolvedType>,
}

impl Learned {
    /// Node that has the endpoint.
    pub(crate) fn node(&self) -> &str {
        self.endpoint.node.as_deref().unwrap_or("a node that does not tell its name")
    }
}

/// A graph that was looked at, and the node that goes on looking.
pub(crate) struct Look {
    pub(crate) middleware: Arc<dyn Middleware>,
    /// The same where it is ROS 1.
    pub(crate) ros1: Option<Arc<Ros1>>,
    pub(crate) found: Vec<Discovered>,
}

impl Look {
    /// Looks until the graph has told what it has.
    ///
    /// # Errors
    /// Exit code 3 where its master does not answer, 1 or 2 where it does not start.
    pub(crate) fn at(graph: RosGraph, own: OwnAddress, shutdown: &Shutdown) -> Result<Self> {
        let side = graph.middleware();
        let mut endpoints = Endpoints::default();
        endpoints.reached_at(own);
        let (middleware, ros1) = observer(&endpoints, side)?;
        let mut watch = DiscoveryWatch::new(middleware.discover().context(side)?);
        let (begun, wake) = (Instant::now(), Wake::new());
        let found = loop {
            watch.look().context(side)?;
            if watch.has_everybody_told() || shutdown.requested() || begun.elapsed() >= LOOK_WITHIN
            {
                break std::mem::take(&mut watch.found);
            }
            wake.wait(PAUSE);
        };
        if let Some(what) = watch.discovery.waiting_for() {
            return Err(Failure::TimedOut(format!("{side}: no answer from {what}")));
        }
        Ok(Self { middleware, ros1, found })
    }

    /// Endpoints that carry something of their own: without the five topics of an action.
    fn own(&self) -> Vec<Discovered> {
        let of_actions = of_actions(&self.found);
        let is_own = |one: &&Discovered| {
            one.role.interaction() != Interaction::Topic || !of_actions.contains(&one.name)
        };
        self.found.iter().filter(is_own).cloned().collect()
    }

    /// The type of each endpoint: of those that show definitions first, because others refer to these. All are asked at
    /// once, and waited for as long as one may still answer.
    pub(crate) fn learn(&self, types: &mut TypeStore, shutdown: &Shutdown) -> Vec<Learned> {
        let own = self.own();
        let (shown, others): (Vec<_>, Vec<_>) = own
            .into_iter()
            .partition(|one| matches!(one.role, Role::Publisher | Role::ActionServer));
        let (offered, taken) = others.into_iter().partition(|one| one.role.is_provider());
        let mut described = BTreeMap::new();
        let mut learned = Vec::new();
        for mut open in [shown, offered, taken] {
            let end = Instant::now() + LEARN_WITHIN;
            while !open.is_empty() {
                let is_over = Instant::now() >= end || shutdown.requested();
                let mut waiting = Vec::new();
                for endpoint in open {
                    match self.learn_one(&endpoint, types, &mut described) {
                        Err(LearnError::Asked(_)) if !is_over => waiting.push(endpoint),
                        told => learned.push(Learned { endpoint, told }),
                    }
                }
                open = waiting;
                if !open.is_empty() {
                    std::thread::sleep(PAUSE);
                }
            }
        }
        learned
    }

    fn learn_one(
        &self,
        one: &Discovered,
        types: &mut TypeStore,
        described: &mut BTreeMap<(String, String), ResolvedType>,
    ) -> LearnResult<ResolvedType> {
        if self.ros1.is_none() {
            return self.learn_by_hash(one, types, described);
        }
        let defined = |name: &str, types: &mut TypeStore| {
            types.resolve_name(name).map_err(|error| LearnError::Undefined {
                type_name: name.to_owned(),
                reason: error.to_string(),
            })
        };
        let middleware = &self.middleware;
        match one.role.interaction() {
            Interaction::Topic => match middleware.learn_topic(one, types)? {
                wrapyfi_endpoint::Learned::Ros(kind) => Ok(kind.resolved().clone()),
                wrapyfi_endpoint::Learned::Wrapyfi(kind) => defined(kind.ros_type(), types),
            },
            Interaction::Service => match middleware.learn_service(one, types)? {
                ServiceKind::Ros(kind) => Ok(kind.resolved().clone()),
                kind => defined(kind.ros_type(), types),
            },
            Interaction::Action => {
                middleware.learn_action(one, types).map(|kind| kind.resolved().clone())
            }
        }
    }

    /// The definition that is found here where the endpoint announces its hash, else what its node describes.
    fn learn_by_hash(
        &self,
        one: &Discovered,
        types: &mut TypeStore,
        described: &mut BTreeMap<(String, String), ResolvedType>,
    ) -> LearnResult<ResolvedType> {
        let untold = || LearnError::Untold(ros2::NAME.to_owned());
        let name = one.type_name.clone().ok_or_else(untold)?;
        let parsed = TypeName::parse(Dialect::Ros2, &name).map_err(|_fault| untold())?;
        let here = types.resolve_defined(&parsed);
        let Some(hash) = &one.type_hash else {
            return here.map_err(|error| LearnError::Undefined {
                type_name: name,
                reason: error.to_string(),
            });
        };
        if let Ok(here) = here
            && hashes(&here).any(|own| own == *hash)
        {
            return Ok(here);
        }
        let key = (name.clone(), hash.clone());
        if let Some(known) = described.get(&key) {
            return Ok(known.clone());
        }
        let told =
            description_of(&*self.middleware, one).map_err(|error| LearnError::Undefined {
                type_name: name,
                reason: format!("its node does not describe it ({error:#})"),
            })?;
        described.insert(key, told.clone());
        Ok(told)
    }
}

/// Hashes by which nodes of ROS 2 announce a type: its own, and of a service or an action that of a request.
fn hashes(resolved: &ResolvedType) -> impl Iterator<Item = String> {
    let part = |suffix| resolved.part(suffix).map(|part| part.type_hash());
    let parts = ["_Request", "_SendGoal", "_SendGoal_Request"].map(part);
    std::iter::once(resolved.type_hash()).chain(parts.into_iter().flatten())
}

/// Topics that belong to an action.
fn of_actions(found: &[Discovered]) -> BTreeSet<String> {
    let actions = found.iter().filter(|one| one.role.interaction() == Interaction::Action);
    actions.flat_map(|one| OF_ACTION.map(|word| format!("{}/{word}", one.name))).collect()
}

/// True for a type of a package that every ROS has, such as `nav_msgs/msg/Path`.
pub(crate) fn is_common(name: &str) -> bool {
    let parts: Vec<&str> = name.split('/').collect();
    let [_, kind, stem] = parts[..] else { return false };
    TypeStore::names_like(kind, stem).iter().any(|known| known == name)
}

/// True where the node itself shows the definition: others are known by what lies here.
pub(crate) fn shows(role: Role, graph: RosGraph) -> bool {
    graph != RosGraph::ROS1 || matches!(role, Role::Publisher | Role::ActionServer)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_graph_is_named_as_in_endpoints() {
        for text in ["ros:", "ros", "ros:/"] {
            assert_eq!(text.parse(), Ok(RosGraph::ROS1), "{text}");
        }
        assert_eq!("ros2:".parse::<RosGraph>().unwrap().to_string(), "ros2:");
        for text in ["", "yarp:", "ros3", "ros:/scan"] {
            assert!(text.parse::<RosGraph>().is_err(), "{text}");
        }
    }

    #[test]
    fn types_of_every_ros_are_common() {
        for name in ["nav_msgs/msg/Path", "std_msgs/msg/String", "std_srvs/srv/SetBool"] {
            assert!(is_common(name), "{name}");
        }
        for name in ["my_msgs/msg/Path", "Path", "nav_msgs/Path"] {
            assert!(!is_common(name), "{name}");
        }
    }

    #[test]
    fn topics_of_an_action_are_not_topics_of_their_own() {
        let found = [
            Discovered::new("/move/goal", Role::Listener),
            Discovered::new("/goal", Role::Publisher),
            Discovered::new("/move", Role::ActionServer),
        ];
        let of_actions = of_actions(&found);
        assert!(of_actions.contains("/move/goal") && !of_actions.contains("/goal"));
    }

    #[test]
    fn a_service_is_announced_by_its_request() {
        let set = TypeStore::generated().resolve_name("std_srvs/srv/SetBool").unwrap();
        let request = set.part("_Request").unwrap().type_hash();
        assert!(hashes(&set).any(|hash| hash == request));
        assert!(hashes(&set).any(|hash| hash == set.type_hash()));
    }
}
