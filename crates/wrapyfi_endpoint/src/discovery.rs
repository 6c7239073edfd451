//! Discovery: the endpoints of other programs that exist on a middleware now.
//!
//! ```text
//!   Middleware::discover ─▶ Discovery, which looks for as long as it lives
//!                              │ endpoints()
//!                              ▼
//!        [Discovered { name, role, type, QoS, node, traffic }]   whatever the transport tells
//! ```
//!
//! A field that the transport does not tell is `None`.

use std::fmt;
use std::time::Duration;

use serde::Serialize;

use super::{BridgeMark, History, Liveliness, QosPolicy, Reliability};

/// Predicate that is true for the names of endpoints that the owner of a [`Discovery`] asks for.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::NameFilter;
/// let cameras: NameFilter = Box::new(|name| name.starts_with("/camera/"));
/// assert!(cameras("/camera/left") && !cameras("/arm"));
/// ```
pub type NameFilter = Box<dyn Fn(&str) -> bool + Send + Sync>;

/// A look for endpoints that goes on until it is dropped, and sees more the longer it goes on.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types};
/// #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
/// # }
/// use wrapyfi_core::endpoint::{Context, Discovery, Middleware, Role, TopicSpec};
/// use wrapyfi_core::middleware::memory::Memory;
/// use wrapyfi_core::types::MessageType;
/// let bus = Memory::new("memory");
/// let spec = TopicSpec::new("/camera", MessageType::Image);
/// let _publisher = bus.open_publisher(&spec, &Context::default())?;
/// let mut discovery = bus.discover()?;
/// let found = discovery.endpoints()?;
/// assert_eq!((found[0].name.as_str(), found[0].role), ("/camera", Role::Publisher));
/// assert_eq!(discovery.is_complete(), Some(true));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Discovery: Send {
    /// Restricts discovery to the names that `wanted` accepts; call it before the first look.
    /// Endpoints of other names may be left out, and are not asked where each has to be asked.
    fn only(&mut self, wanted: NameFilter) {
        _ = wanted;
    }

    /// Endpoints that exist now as far as is known, in order of name and role.
    ///
    /// # Errors
    /// When the transport cannot be asked.
    fn endpoints(&mut self) -> Result<Vec<Discovered>, DiscoverError>;

    /// Reason that nothing can be found at the moment, for instance a broker that does not answer;
    /// `None` while it looks.
    fn waiting_for(&self) -> Option<String> {
        None
    }

    /// True when the last [`Discovery::endpoints`] listed all endpoints, or nobody can be asked;
    /// `None` where the transport never knows, because endpoints announce themselves in their own
    /// time.
    fn is_complete(&self) -> Option<bool> {
        None
    }

    /// Network under the middleware, and the reason for it; `None` where there is no choice.
    fn carried_by(&self) -> Option<&str> {
        None
    }
}

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

/// Role of an endpoint.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::Role;
/// assert_eq!(Role::Publisher.to_string(), "publisher");
/// assert!(Role::Publisher < Role::Server); // the order of lists
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)]
pub enum Role {
    Publisher,
    Listener,
    Client,
    Server,
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
shown_as_in_json!(Role, Reliability, AnnouncedDurability, Liveliness, QosPolicy);

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

/// Error of listing endpoints.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::DiscoverError;
/// let error = DiscoverError::Unsupported("zeromq".into());
/// assert_eq!(error.to_string(), "zeromq cannot tell which endpoints exist");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DiscoverError {
    /// The middleware has no way to list endpoints.
    #[error("{0} cannot tell which endpoints exist")]
    Unsupported(String),
    /// The middleware has not started; it is tried again.
    #[error("{middleware} to start: {reason}")]
    NotStarted {
        /// Middleware asked.
        middleware: String,
        /// Reason that the last try failed.
        reason: String,
    },
    /// The middleware can never start with its settings.
    #[error("{middleware} does not start: {reason}")]
    Refused {
        /// Middleware asked.
        middleware: String,
        /// Setting that is wrong, and the remedy.
        reason: String,
    },
    /// The transport refused.
    #[error("{middleware} could not list its endpoints: {reason}")]
    Transport {
        /// Middleware asked.
        middleware: String,
        /// Error of the transport, in its words.
        reason: String,
    },
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
