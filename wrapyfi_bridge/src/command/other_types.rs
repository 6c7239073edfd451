//! Programs on a topic of ROS 2 that announce another type than a command has there.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::{Discovered, Discovery, Middleware, codec::ros};

use crate::node::GRAPH;

/// Time between two looks at discovery while messages go on.
const LOOK_EVERY: Duration = Duration::from_millis(500);

/// Tells in words who announces another type on a topic; each endpoint once.
pub(super) struct OtherTypes {
    discovery: Option<Box<dyn Discovery>>,
    topic: String,
    type_name: &'static str,
    /// Hash of the definition; `None` where the endpoint itself tells who has another.
    type_hash: Option<&'static str>,
    reported: BTreeSet<String>,
    next_look: Instant,
}

impl OtherTypes {
    /// Watches a topic; where types are not announced by their names in ROS 2, or nothing is told, there
    /// are no other_types.
    pub(super) fn new(middleware: &dyn Middleware, topic: &str, message_type: MessageType) -> Self {
        let topic = format!("/{}", topic.trim_start_matches('/'));
        let has_type = middleware.name() == GRAPH && message_type != MessageType::Properties;
        let discovery = has_type.then(|| middleware.discover_closely(Some(&topic)));
        let discovery = discovery.and_then(|discovery| {
            discovery.inspect_err(|error| tracing::debug!(%error, "looking for other types")).ok()
        });
        Self {
            discovery,
            topic,
            type_name: message_type.ros_type(),
            type_hash: Some(ros::type_hash(message_type)),
            reported: BTreeSet::new(),
            next_look: Instant::now(),
        }
    }

    /// The same for the type's name alone: a listener tells of other definitions itself.
    pub(super) fn of_other_names(self) -> Self {
        Self { type_hash: None, ..self }
    }

    /// Looks, where the last look is long enough ago.
    pub(super) fn look(&mut self) {
        if Instant::now() >= self.next_look {
            self.look_now();
        }
    }

    pub(super) fn look_now(&mut self) {
        self.next_look = Instant::now() + LOOK_EVERY;
        let Some(discovery) = &mut self.discovery else { return };
        match discovery.endpoints() {
            Ok(found) => {
                for endpoint in found.iter().filter(|endpoint| endpoint.name == self.topic) {
                    if let Some(text) = contradiction(endpoint, self.type_name, self.type_hash)
                        && self.reported.insert(text.clone())
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
fn contradiction(
    endpoint: &Discovered,
    type_name: &str,
    type_hash: Option<&str>,
) -> Option<String> {
    let who = format!(
        "{} of {} ({})",
        endpoint.role,
        endpoint.name,
        endpoint.node.as_deref().unwrap_or("node not announced")
    );
    let other = endpoint.type_name.as_deref()?;
    if other != type_name {
        return Some(format!(
            "a {who} has type {other}, here it is {type_name}: they do not hear each other"
        ));
    }
    match (&endpoint.type_hash, type_hash) {
        (Some(theirs), Some(ours)) if theirs != ours => Some(format!(
            "a {who} was built from another definition of {other}: its hash is {theirs}, here it \
             is {ours}; fields may be misread"
        )),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use wrapyfi_endpoint::Role;

    use super::*;

    #[test]
    fn other_types_and_other_definitions_are_named() {
        let told = |type_name: &str, hash: Option<&str>| {
            let endpoint = Discovered {
                type_name: Some(type_name.into()),
                type_hash: hash.map(str::to_owned),
                node: Some("/base".into()),
                ..Discovered::new("/cmd_vel", Role::Listener)
            };
            contradiction(&endpoint, "geometry_msgs/msg/Twist", Some("RIHS01_aa"))
        };
        assert_eq!(told("geometry_msgs/msg/Twist", Some("RIHS01_aa")), None);
        assert_eq!(told("geometry_msgs/msg/Twist", None), None, "older nodes announce no hash");
        let other = told("geometry_msgs/msg/TwistStamped", None).unwrap();
        assert!(other.contains("/base") && other.contains("TwistStamped"), "{other}");
        let rebuilt = told("geometry_msgs/msg/Twist", Some("RIHS01_bb")).unwrap();
        assert!(rebuilt.contains("RIHS01_bb") && rebuilt.contains("RIHS01_aa"), "{rebuilt}");
    }
}
