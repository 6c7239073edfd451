//! `echo` and `pub` of any ROS type whose definition is found.
//!
//! ```text
//!   --definitions DIR, AMENT_PREFIX_PATH, built in ─▶ TypeStore ─▶ ResolvedType ─▶ AnyListener, AnyPublisher
//!   discovery ─▶ the type of a topic, and who announces another one ─▶ a warning in words
//! ```

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use wrapyfi_core::endpoint::{Discovered, Discovery, Role};
use wrapyfi_core::middleware::ros2::graph::TopicDescription;
use wrapyfi_core::types::{MessageType, RosType};
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::ros1::{Rules, Types};
use wrapyfi_interfaces::store::{ResolveError, ResolvedType, TypeStore};

use crate::exit::Failure;

pub mod echo;
pub mod publish;
pub(super) mod yaml;

/// Time between two looks at discovery while messages go on.
const LOOK_EVERY: Duration = Duration::from_millis(500);

/// Definitions of ROS types: in `folders` first, then where `AMENT_PREFIX_PATH` says, then those
/// this program is built with, so that the common ones need no ROS.
pub(crate) fn definitions(folders: &[PathBuf]) -> Result<TypeStore, Failure> {
    let mut store = TypeStore::empty().or_generated();
    for folder in folders {
        if !folder.is_dir() {
            return Err(Failure::Usage(format!("{}: there is no such folder", folder.display())));
        }
        store.add_folder(folder);
    }
    store.add_ament_path(&std::env::var_os("AMENT_PREFIX_PATH").unwrap_or_default());
    Ok(store)
}

/// The definition of `name`, in the places of [`definitions`] or as [`add_standard`] has it.
pub(super) fn resolve(name: &str, folders: &[PathBuf]) -> Result<ResolvedType, Failure> {
    let mut store = definitions(folders)
        .map_err(|failure| Failure::Usage(format!("--definitions {failure}")))?;
    add_standard(name, folders, &mut store);
    store.resolve_name(name).map_err(|error| undefined(&error))
}

fn undefined(error: &ResolveError) -> Failure {
    Failure::Usage(format!("{error} (--definitions DIR)"))
}

/// The type `name` as one that every middleware carries.
pub(super) fn message_type(name: &str, folders: &[PathBuf]) -> Result<MessageType, Failure> {
    let resolved = resolve(name, folders)?;
    RosType::new(&resolved).map(MessageType::Ros).map_err(Failure::usage)
}

/// Adds the message `name` to a store that does not find it. Where no ROS 2 is installed, most of its
/// types are at hand as those of ROS 1, built in or below `ROS_PACKAGE_PATH`.
pub(crate) fn add_standard(name: &str, folders: &[PathBuf], store: &mut TypeStore) {
    if store.resolve_name(name).is_ok() {
        return;
    }
    let Ok(parsed) = TypeName::parse(Dialect::Ros2, name) else { return };
    let Ok(theirs) = definitions(folders) else { return };
    let mut types = Types::new(Rules::built_in(), theirs);
    types.add_ros1_path(&std::env::var_os("ROS_PACKAGE_PATH").unwrap_or_default());
    // The fault of the type is reported by the store, when it is asked.
    if let Ok(found) = types.ros2_type_named(&parsed) {
        store.add_resolved(&found);
    }
}

/// Tells in words who announces another type on our topic; each endpoint once.
struct Strangers {
    discovery: Box<dyn Discovery>,
    told: BTreeSet<String>,
    next_look: Instant,
}

impl Strangers {
    fn new(discovery: Box<dyn Discovery>) -> Self {
        Self { discovery, told: BTreeSet::new(), next_look: Instant::now() }
    }

    /// Looks, where the last look is long enough ago.
    fn look(&mut self, topic: &TopicDescription) {
        if Instant::now() >= self.next_look {
            self.look_now(topic);
        }
    }

    fn look_now(&mut self, topic: &TopicDescription) {
        self.next_look = Instant::now() + LOOK_EVERY;
        match self.discovery.endpoints() {
            Ok(found) => {
                for endpoint in found.iter().filter(|endpoint| endpoint.name == topic.name) {
                    if let Some(text) = contradiction(endpoint, topic)
                        && self.told.insert(text.clone())
                    {
                        tracing::warn!("{text}");
                    }
                }
            }
            Err(error) => tracing::debug!(%error, "looking for other types"),
        }
    }
}

/// Difference between the announcement of another endpoint of the topic and ours, in words.
fn contradiction(endpoint: &Discovered, topic: &TopicDescription) -> Option<String> {
    let who = format!(
        "{} of {} ({})",
        endpoint.role,
        topic.name,
        endpoint.node.as_deref().unwrap_or("node not announced")
    );
    let other = endpoint.type_name.as_deref()?;
    if other != topic.type_name {
        return Some(format!(
            "a {who} has type {other}, here it is {}: they do not hear each other",
            topic.type_name
        ));
    }
    match (&endpoint.type_hash, &topic.type_hash) {
        (Some(theirs), Some(ours)) if theirs != ours => Some(format!(
            "a {who} was built from another definition of {other}: its hash is {theirs}, here it \
             is {ours}; fields may be misread"
        )),
        _ => None,
    }
}

/// Types that the endpoints of a topic announce.
fn types_of<'a>(found: &'a [Discovered], topic: &str) -> BTreeSet<&'a str> {
    found
        .iter()
        .filter(|endpoint| {
            endpoint.name == topic && matches!(endpoint.role, Role::Publisher | Role::Listener)
        })
        .filter_map(|endpoint| endpoint.type_name.as_deref())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn endpoint(type_name: &str, hash: Option<&str>) -> Discovered {
        Discovered {
            name: "/cmd_vel".into(),
            role: Role::Listener,
            type_name: Some(type_name.into()),
            type_hash: hash.map(str::to_owned),
            qos: None,
            node: Some("/base".into()),
            count: 1,
            traffic: None,
            mark: None,
        }
    }

    #[test]
    fn other_types_and_other_definitions_are_named() {
        let topic = TopicDescription {
            name: "/cmd_vel".into(),
            type_name: "geometry_msgs/msg/Twist".into(),
            type_hash: Some("RIHS01_aa".into()),
            qos: wrapyfi_core::endpoint::Qos::default(),
            max_bytes: 1,
        };
        let told = |type_name, hash| contradiction(&endpoint(type_name, hash), &topic);
        assert_eq!(told("geometry_msgs/msg/Twist", Some("RIHS01_aa")), None);
        assert_eq!(told("geometry_msgs/msg/Twist", None), None, "older nodes announce no hash");
        let other = told("geometry_msgs/msg/TwistStamped", None).unwrap();
        assert!(other.contains("/base") && other.contains("TwistStamped"), "{other}");
        let rebuilt = told("geometry_msgs/msg/Twist", Some("RIHS01_bb")).unwrap();
        assert!(rebuilt.contains("RIHS01_bb") && rebuilt.contains("RIHS01_aa"), "{rebuilt}");
    }
}
