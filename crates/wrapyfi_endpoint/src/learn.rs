//! The type of a topic or service, learned from the announcements of its endpoints.
//!
//! ```text
//!   Discovered { type: "demo/Pose", … } ── Middleware::learn_topic ──▶ Learned, or why not (yet)
//! ```

use wrapyfi_interfaces::store::TypeStore;

use super::Discovered;
use wrapyfi_data::types::{
    MessageType, MessageTypeError, ParseTypeError, RosAction, RosType, ServiceKind,
};

/// The type of a topic.
///
/// ```
/// use wrapyfi_endpoint::Learned;
/// use wrapyfi_data::types::{MessageType, RosType};
/// use wrapyfi_interfaces::store::TypeStore;
/// let image = RosType::new(&TypeStore::generated().resolve_name("sensor_msgs/msg/Image")?)?;
/// assert_eq!(Learned::Ros(image).message_type(false), MessageType::Image);
/// assert_eq!(Learned::Ros(image).message_type(true), MessageType::Ros(image));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Learned {
    /// A type of ROS 2, or the one that a type of ROS 1 becomes.
    Ros(RosType),
    /// A type of Wrapyfi.
    Wrapyfi(MessageType),
}

impl Learned {
    /// Type for routes: between two ROS, whose bytes are only rearranged, that of the message
    /// itself; elsewhere Wrapyfi's where it has one. A `std_msgs/msg/String` counts as text,
    /// because no setting has called it JSON.
    pub fn message_type(self, between_ros: bool) -> MessageType {
        match self {
            Self::Wrapyfi(known) => known,
            Self::Ros(ros_type) if between_ros => MessageType::Ros(ros_type),
            Self::Ros(ros_type) => match ros_type.name().parse() {
                Ok(MessageType::StringJson) => MessageType::Text,
                Ok(known) => known,
                Err(_) => MessageType::Ros(ros_type),
            },
        }
    }
}

/// Error of learning the type of an endpoint.
///
/// ```
/// use wrapyfi_endpoint::{Discovered, LearnError, Role, topic_of_name};
/// use wrapyfi_interfaces::store::TypeStore;
/// let untyped = Discovered::new("/camera", Role::Publisher);
/// let error = topic_of_name("zeromq", &untyped, &mut TypeStore::generated()).unwrap_err();
/// assert_eq!(error, LearnError::Untold("zeromq".into()));
/// assert_eq!(error.to_string(), "the type, which zeromq does not tell: give `type`");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LearnError {
    /// The transport announces no types, or not that of this endpoint.
    #[error("the type, which {0} does not tell: give `type`")]
    Untold(String),
    /// The endpoint is being asked: the answer comes within moments.
    #[error("{0} to tell its type")]
    Asked(String),
    /// The endpoint could not be asked; it is asked again.
    #[error("the type of {name}: {reason}")]
    Silent {
        /// Topic or service.
        name: String,
        /// Cause.
        reason: String,
    },
    /// The type is announced, but its definition cannot be found or used.
    #[error("a definition of {type_name}: {reason}")]
    Undefined {
        /// The type as it is announced.
        type_name: String,
        /// Cause and remedy.
        reason: String,
    },
}

/// Result of learning a type.
///
/// See [`Middleware::learn_topic`](crate::Middleware::learn_topic).
pub type LearnResult<T> = Result<T, LearnError>;

/// Looks up the message type that an endpoint announces by a name of ROS 2 or of Wrapyfi.
pub fn topic_of_name(
    middleware: &str,
    found: &Discovered,
    types: &mut TypeStore,
) -> LearnResult<Learned> {
    let Some(name) = &found.type_name else {
        return Err(LearnError::Untold(middleware.to_owned()));
    };
    let undefined = |reason: String| LearnError::Undefined { type_name: name.clone(), reason };
    if !name.contains('/') {
        let known = name.parse().map_err(|error: ParseTypeError| undefined(error.to_string()));
        return known.map(Learned::Wrapyfi);
    }
    match types.resolve_name(name) {
        Ok(resolved) => {
            RosType::new(&resolved).map(Learned::Ros).map_err(|error| undefined(error.to_string()))
        }
        // Wrapyfi's own are known without their definition.
        Err(error) => match name.parse() {
            Ok(known) => Ok(Learned::Wrapyfi(known)),
            Err(_) => Err(undefined(error.to_string())),
        },
    }
}

/// Looks up the service type that a server announces by a name of ROS 2 or of Wrapyfi.
pub fn service_of_name(
    middleware: &str,
    found: &Discovered,
    types: &mut TypeStore,
) -> LearnResult<ServiceKind> {
    of_name(middleware, found, |name| ServiceKind::resolve(name, types))
}

/// Looks up the action type that a server announces by a name of ROS 2.
pub fn action_of_name(
    middleware: &str,
    found: &Discovered,
    types: &mut TypeStore,
) -> LearnResult<RosAction> {
    of_name(middleware, found, |name| RosAction::resolve(name, types))
}

fn of_name<T>(
    middleware: &str,
    found: &Discovered,
    resolve: impl FnOnce(&str) -> Result<T, MessageTypeError>,
) -> LearnResult<T> {
    let Some(name) = &found.type_name else {
        return Err(LearnError::Untold(middleware.to_owned()));
    };
    resolve(name).map_err(|error| LearnError::Undefined {
        type_name: name.clone(),
        reason: error.to_string(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Role;

    fn learn(type_name: Option<&str>) -> LearnResult<Learned> {
        let found = Discovered {
            type_name: type_name.map(str::to_owned),
            ..Discovered::new("/x", Role::Publisher)
        };
        topic_of_name("ros2", &found, &mut TypeStore::generated())
    }

    #[test]
    fn a_type_is_wrapyfis_own_only_where_ros_does_not_carry_it_on_both_sides() {
        let image = learn(Some("sensor_msgs/msg/Image")).unwrap();
        assert_eq!(image.message_type(false), MessageType::Image);
        let raw = image.message_type(true);
        assert!(matches!(raw, MessageType::Ros(_)) && raw.ros_type() == "sensor_msgs/msg/Image");
        let text = learn(Some("std_msgs/msg/String")).unwrap();
        assert_eq!(text.message_type(false), MessageType::Text);
        let joints = learn(Some("sensor_msgs/msg/JointState")).unwrap();
        assert_eq!(joints.message_type(false), joints.message_type(true));
        let sound = learn(Some("AudioChunk")).unwrap();
        assert_eq!(sound.message_type(true), MessageType::AudioChunk);
    }

    #[test]
    fn what_cannot_be_learned_says_why() {
        assert!(matches!(learn(None), Err(LearnError::Untold(_))));
        let error = learn(Some("demo/msg/None")).unwrap_err().to_string();
        assert!(error.contains("demo/msg/None is defined nowhere"), "{error}");
        assert!(learn(Some("Imag")).unwrap_err().to_string().contains("Image"));
    }
}
