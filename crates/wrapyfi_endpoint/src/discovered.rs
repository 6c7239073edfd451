//! Endpoints of other programs, as a transport tells of them. A field that it does not tell is `None`.

use std::fmt;
use std::time::Duration;

use serde::Serialize;

use super::{BridgeMark, History, Interaction, Liveliness, QosPolicy, Reliability, Role};

/// An endpoint, or several that are alike and that the transport lists as one.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::{Discovered, Role};
/// let camera = Discovered {
///     type_name: Some("sensor_msgs/msg/Image".into()),
///     ..Discovered::new("/camera", Role::Publisher)
/// };
/// assert_eq!((camera.count, camera.node), (1, None));
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Discovered {
    /// Topic or service, as the middleware's addresses name it.
    pub name: String,
    /// Role of the endpoint.
    pub role: Role,
    /// Type of the endpoint's messages, in the middleware's own terms: a ROS type, or one of
    /// Wrapyfi's data types.
    #[serde(rename = "type")]
    pub type_name: Option<String>,
    /// REP-2016 hash that the endpoint announces.
    pub type_hash: Option<String>,
    /// Quality of service that the endpoint announces.
    #[doc(hidden)]
    pub qos: Option<AnnouncedQos>,
    /// Full name of the node that owns the endpoint.
    pub node: Option<String>,
    /// Number of endpoints that this entry stands for.
    pub count: u64,
    /// Messages that passed through the topic, where the transport counts them.
    #[doc(hidden)]
    pub traffic: Option<Traffic>,
    /// Mark of the bridge that made the endpoint by pattern.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[doc(hidden)]
    pub mark: Option<BridgeMark>,
}

impl Discovered {
    /// An endpoint of which nothing more is known.
    pub fn new(name: impl Into<String>, role: Role) -> Self {
        Self {
            name: name.into(),
            role,
            type_name: None,
            type_hash: None,
            qos: None,
            node: None,
            count: 1,
            traffic: None,
            mark: None,
        }
    }
}

/// Words of enums in logs and tables: those that they have in JSON.
macro_rules! shown_as_in_json {
    ($($shown:ty),*) => {$(
        impl fmt::Display for $shown {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.serialize(f)
            }
        }
    )*};
}
shown_as_in_json!(Interaction, Role, Reliability, AnnouncedDurability, Liveliness, QosPolicy);

/// Messages of a topic that passed through the broker since it started.
///
/// See [`Discovered::traffic`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Traffic {
    /// Number of messages.
    pub messages: u64,
    /// Size of the messages in bytes, all frames.
    pub bytes: u64,
    /// Number of messages that the broker did not take, because they were too large or it had no room.
    pub not_taken: u64,
}

/// Quality of service as another program announces it. Times are `None` where they are infinite.
///
/// ```
/// use wrapyfi_endpoint::{AnnouncedQos, Qos, QosPreset};
/// let latched = AnnouncedQos::from(Qos::from(QosPreset::Latched));
/// assert_eq!(latched.to_string(), "reliable transient_local keep_last(1)");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[allow(missing_docs)]
pub struct AnnouncedQos {
    pub reliability: Reliability,
    pub durability: AnnouncedDurability,
    /// History; DDS does not announce it, some stacks do.
    pub history: Option<History>,
    pub deadline: Option<Duration>,
    pub lifespan: Option<Duration>,
    pub liveliness: Liveliness,
    pub lease: Option<Duration>,
}

/// Durability as DDS defines it; ROS nodes use the first two kinds.
///
/// ```
/// use wrapyfi_endpoint::AnnouncedDurability;
/// let durability = AnnouncedDurability::Transient;
/// assert!(durability > AnnouncedDurability::TransientLocal); // keeps more
/// assert_eq!(durability.to_string(), "transient");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)]
pub enum AnnouncedDurability {
    Volatile,
    TransientLocal,
    Transient,
    Persistent,
}

impl fmt::Display for AnnouncedQos {
    /// Writes reliability, durability and each policy that is not the default: `reliable volatile`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.reliability, self.durability)?;
        match self.history {
            Some(History::KeepLast(depth)) => write!(f, " keep_last({depth})")?,
            Some(History::KeepAll) => f.write_str(" keep_all")?,
            None => {}
        }
        for (name, time) in [("deadline", self.deadline), ("lifespan", self.lifespan)] {
            if let Some(time) = time {
                write!(f, " {name} {time:?}")?;
            }
        }
        if self.liveliness != Liveliness::Automatic {
            write!(f, " {}", self.liveliness)?;
        }
        self.lease.map_or(Ok(()), |lease| write!(f, " lease {lease:?}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_unusual_is_spelled_out() {
        let usual = AnnouncedQos {
            reliability: Reliability::Reliable,
            durability: AnnouncedDurability::Volatile,
            history: None,
            deadline: None,
            lifespan: None,
            liveliness: Liveliness::Automatic,
            lease: None,
        };
        assert_eq!(usual.to_string(), "reliable volatile");
        let unusual = AnnouncedQos {
            durability: AnnouncedDurability::TransientLocal,
            history: Some(History::KeepLast(7)),
            deadline: Some(Duration::from_millis(100)),
            liveliness: Liveliness::ManualByTopic,
            lease: Some(Duration::from_secs(2)),
            ..usual
        };
        assert_eq!(
            unusual.to_string(),
            "reliable transient_local keep_last(7) deadline 100ms manual_by_topic lease 2s"
        );
    }
}
