//! Topics of a bag in ROS 2: their names, their types, and the plan that carries each message over.
//!
//! ```text
//!   connection ─ definition ─▶ Types ─▶ ROS 2 type, as installed, standard, or made of the definition
//!        │                                 └─▶ plan: bytes of ROS 1 ─▶ CDR
//!        └─ topic ─▶ name that ROS 2 allows, once
//! ```

use std::collections::BTreeMap;

use wrapyfi_endpoint::pattern::ros_name;
use wrapyfi_endpoint::{Durability, History, Qos};
use wrapyfi_interfaces::ros1::{
    Definition, DefinitionError, Options, PairPlan, TranscodeError, Transcoded, Types,
};
use wrapyfi_interfaces::store::ResolvedType;

use crate::ros1::Connection;

/// The ROS 2 side of a topic of a bag.
#[derive(Debug, Clone)]
pub struct Target {
    /// Name of the topic in ROS 2.
    pub topic: String,
    /// Type in ROS 2.
    pub ros2: ResolvedType,
    /// Differences between the topic in the bag and in ROS 2, a sentence each.
    pub notes: Vec<String>,
    plan: PairPlan,
}

/// Outcome of one message.
pub type Converted = Result<Transcoded, TranscodeError>;

/// Conversion of the topics of one bag.
///
/// ```
/// use wrapyfi_bag::Conversion;
/// use wrapyfi_bag::ros1::Connection;
/// use wrapyfi_interfaces::ros1::{Options, Rules, Types};
/// use wrapyfi_interfaces::store::TypeStore;
/// let types = Types::new(Rules::built_in(), TypeStore::empty());
/// let mut conversion = Conversion::new(types, Options::default());
/// let connection = Connection {
///     id: 0,
///     topic: "/robot-1/says".to_owned(),
///     type_name: "demo/Words".to_owned(),
///     md5sum: "*".to_owned(),
///     definition: "string data".to_owned(),
///     caller: None,
///     latching: false,
/// };
/// let target = conversion.target(&connection).unwrap();
/// assert_eq!(target.topic, "/robot_1/says");
/// assert_eq!(target.ros2.name().to_string(), "demo/msg/Words");
/// let mut cdr = Vec::new();
/// conversion.convert(0, b"\x02\0\0\0hi", &mut cdr).unwrap().unwrap();
/// assert_eq!(cdr, b"\0\x01\0\0\x03\0\0\0hi\0");
/// ```
#[derive(Debug)]
pub struct Conversion {
    types: Types,
    options: Options,
    /// Targets by the numbers of connections, or the reason why there is none.
    targets: BTreeMap<u32, Result<Target, String>>,
    /// Name in the bag and hash of the type of each topic of ROS 2.
    taken: BTreeMap<String, (String, String)>,
}

impl Conversion {
    /// Conversion with the types that are at hand, and limits of each message.
    pub fn new(types: Types, options: Options) -> Self {
        Self { types, options, targets: BTreeMap::new(), taken: BTreeMap::new() }
    }

    /// Works out those of the connections whose topics have names that ROS 2 allows: they keep these, whatever becomes one
    /// of them.
    pub fn take_up<'c>(&mut self, connections: impl IntoIterator<Item = &'c Connection>) {
        for connection in connections {
            if ros_name(&connection.topic) == connection.topic {
                // The reason why it has none is told with its messages.
                _ = self.target(connection);
            }
        }
    }

    /// The ROS 2 side of a connection: worked out when it is first asked for.
    ///
    /// # Errors
    /// The reason why it has none, for instance a definition that lacks a type.
    pub fn target(&mut self, connection: &Connection) -> Result<&Target, &str> {
        if !self.targets.contains_key(&connection.id) {
            let target = self.worked_out(connection);
            self.targets.insert(connection.id, target);
        }
        match self.targets.get(&connection.id) {
            Some(target) => target.as_ref().map_err(String::as_str),
            None => Err("it was not worked out"),
        }
    }

    /// Appends the CDR form of a message of a connection to `cdr`; none where the connection has no [`target`](Self::target).
    pub fn convert(&self, connection: u32, data: &[u8], cdr: &mut Vec<u8>) -> Option<Converted> {
        let target = self.targets.get(&connection)?.as_ref().ok()?;
        Some(target.plan.to_cdr(data, &self.options, cdr))
    }

    fn worked_out(&mut self, connection: &Connection) -> Result<Target, String> {
        let Connection { type_name, md5sum, definition, .. } = connection;
        let mut notes = Vec::new();
        let definition = match self.types.show(type_name, md5sum, definition) {
            Err(DefinitionError::Checksum { claimed, computed, .. }) if !definition.is_empty() => {
                notes.push(format!(
                    "the bag says that {type_name} has the checksum {claimed}, its definition has {computed}: it is read as \
                     the definition says"
                ));
                Definition::from_header(type_name, definition)
            }
            shown => shown,
        };
        let definition = definition.map_err(|error| error.to_string())?;
        let ros2 = self.types.ros2_type(&definition.resolved).map_err(|error| error.to_string())?;
        let plan = PairPlan::compile(&definition.resolved, &ros2, self.types.rules())
            .map_err(|error| error.to_string())?;
        notes.extend(plan.notes().iter().filter(|note| note.is_loss()).map(ToString::to_string));
        let from = &connection.topic;
        let wanted = ros_name(&format!("/{from}"));
        let wanted = if wanted.is_empty() { "/_".to_owned() } else { wanted };
        let topic = self.named(&wanted, from, ros2.type_hash());
        if topic != wanted {
            notes.insert(0, format!(
                "{from} is {topic} in ROS 2: {wanted} is that of another topic, another type or another definition of it"
            ));
        } else if topic != *from {
            notes.insert(0, format!("{from} is {topic} in ROS 2"));
        }
        Ok(Target { topic, ros2, notes, plan })
    }

    /// Name in ROS 2 that no other topic, no other type and no other definition of it has: players publish a topic with one
    /// type.
    fn named(&mut self, wanted: &str, topic: &str, type_hash: String) -> String {
        let owner = (topic.to_owned(), type_hash);
        let mut name = wanted.to_owned();
        for number in 2_u32.. {
            match self.taken.get(&name) {
                Some(taken) if *taken != owner => name = format!("{wanted}_{number}"),
                Some(_) => break,
                None => {
                    self.taken.insert(name.clone(), owner);
                    break;
                }
            }
        }
        name
    }
}

/// Quality of service that publishers of a topic offered: reliable, as all of ROS 1 is, and transient local where they latched.
/// Those that latched kept one message each.
pub fn offered<'c>(connections: impl Iterator<Item = &'c Connection>) -> Vec<Qos> {
    let (latching, others): (Vec<_>, Vec<_>) = connections.partition(|one| one.latching);
    let kept = u32::try_from(latching.len()).unwrap_or(u32::MAX);
    let latched = Qos {
        durability: Durability::TransientLocal,
        history: History::KeepLast(kept.max(1)),
        ..Qos::default()
    };
    let latched = (!latching.is_empty()).then_some(latched);
    let others = (!others.is_empty()).then(Qos::default);
    latched.into_iter().chain(others).collect()
}

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::ros1::Rules;
    use wrapyfi_interfaces::store::TypeStore;

    use super::*;

    fn connection(id: u32, topic: &str, type_name: &str, definition: &str) -> Connection {
        Connection {
            id,
            topic: topic.to_owned(),
            type_name: type_name.to_owned(),
            md5sum: "*".to_owned(),
            definition: definition.to_owned(),
            caller: None,
            latching: false,
        }
    }

    fn conversion() -> Conversion {
        let types = Types::new(Rules::built_in(), TypeStore::empty());
        Conversion::new(types, Options::default())
    }

    #[test]
    fn each_topic_has_a_name_of_its_own() {
        let mut conversion = conversion();
        let mut name = |one: Connection| conversion.target(&one).unwrap().topic.clone();
        assert_eq!(name(connection(0, "/a-b", "x/A", "bool a")), "/a_b");
        assert_eq!(name(connection(1, "/a_b", "x/A", "bool a")), "/a_b_2");
        assert_eq!(name(connection(2, "/a-b", "x/A", "bool a")), "/a_b");
        assert_eq!(name(connection(3, "/a-b", "x/B", "bool b")), "/a_b_3");
        assert_eq!(name(connection(4, "chatter", "x/A", "bool a")), "/chatter");
        assert_eq!(name(connection(5, "", "x/A", "bool a")), "/_");
        // Another definition of the same type.
        assert_eq!(name(connection(6, "/chatter", "x/A", "bool a\nbool b")), "/chatter_2");
        assert_eq!(name(connection(7, "/a_b", "x/A", "bool a")), "/a_b_2");
    }

    #[test]
    fn a_name_that_ros_2_allows_is_kept_whatever_comes_first() {
        let all = [connection(0, "/a-b", "x/A", "bool a"), connection(1, "/a_b", "x/A", "bool a")];
        let mut conversion = conversion();
        conversion.take_up(&all);
        let names = all.map(|one| conversion.target(&one).unwrap().topic.clone());
        assert_eq!(names, ["/a_b_2", "/a_b"]);
    }

    #[test]
    fn a_definition_that_lacks_a_type_is_told() {
        let mut conversion = conversion();
        let lacking = connection(0, "/a", "x/A", "Unknown other");
        let reason = conversion.target(&lacking).unwrap_err();
        assert!(reason.contains("Unknown"), "{reason}");
        assert!(conversion.convert(0, b"", &mut Vec::new()).is_none());
    }

    #[test]
    fn a_checksum_that_lies_is_told_and_the_definition_counts() {
        let mut conversion = conversion();
        let mut lying = connection(0, "/a", "x/A", "uint8 a");
        lying.md5sum = "0123456789abcdef0123456789abcdef".to_owned();
        let target = conversion.target(&lying).unwrap();
        assert!(target.notes.iter().any(|note| note.contains("checksum")), "{:?}", target.notes);
    }

    #[test]
    fn latched_topics_keep_a_message_of_each_publisher() {
        let mut latched = connection(0, "/tf_static", "x/A", "bool a");
        latched.latching = true;
        let other = connection(1, "/tf_static", "x/A", "bool a");
        let text = |all: &[Connection]| {
            let all: Vec<_> = offered(all.iter()).iter().map(ToString::to_string).collect();
            all.join(", ")
        };
        assert_eq!(
            text(&[latched.clone(), latched.clone()]),
            "reliable transient_local keep_last(2)"
        );
        assert_eq!(
            text(&[latched, other]),
            "reliable transient_local keep_last(1), reliable volatile keep_last(10)"
        );
    }
}
