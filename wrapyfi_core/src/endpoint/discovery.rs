//! What exists on a middleware now: the endpoints of other programs.
//!
//! ```text
//!   Middleware::discover ─▶ Discovery, which looks for as long as it lives
//!                              │ endpoints()
//!                              ▼
//!        [Discovered { name, role, type, QoS, node, traffic }]   whatever the transport tells
//! ```
//!
//! Nothing is invented: what a transport does not tell is `None`.

use std::fmt;
use std::time::Duration;

use serde::Serialize;

use super::{BridgeMark, History, Liveliness, Reliability};

/// Tells the names of endpoints that whoever looks wants to know of.
pub type NameFilter = Box<dyn Fn(&str) -> bool + Send + Sync>;

/// Looks for endpoints until it is dropped. It sees more the longer it looks.
pub trait Discovery: Send {
    /// Says which names matter, before the first look; all do unless it is said. Where endpoints have to
    /// be asked one by one what they are, the others are left alone, and may be left out.
    fn only(&mut self, wanted: NameFilter) {
        _ = wanted;
    }

    /// What is known now, in order of name and role. Endpoints that went are gone from it.
    ///
    /// # Errors
    /// When the transport cannot be asked.
    fn endpoints(&mut self) -> Result<Vec<Discovered>, DiscoverError>;

    /// Why nothing can be found at the moment, for instance a broker that does not answer;
    /// `None` while it looks.
    fn waiting_for(&self) -> Option<String>;

    /// Whether the last [`Discovery::endpoints`] told all that there was, or found that nobody can be
    /// asked; `None` where the transport never knows, because others announce themselves in their time.
    fn is_complete(&self) -> Option<bool> {
        None
    }

    /// The network under the middleware, and why it is that one; `None` where there is no choice.
    fn carried_by(&self) -> Option<&str> {
        None
    }
}

/// An endpoint, or what a transport tells of several that are alike.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Discovered {
    /// Topic or service, as the middleware's addresses name it.
    pub name: String,
    /// What the endpoint does.
    pub role: Role,
    /// Type of its messages, in the middleware's own terms: a ROS type, or one of Wrapyfi's data
    /// types.
    #[serde(rename = "type")]
    pub type_name: Option<String>,
    /// REP-2016 hash that it announces.
    pub type_hash: Option<String>,
    /// Quality of service that it announces.
    pub qos: Option<AnnouncedQos>,
    /// Full name of the node that owns it.
    pub node: Option<String>,
    /// How many endpoints this is.
    pub count: u64,
    /// What was sent, where the transport counts it.
    pub traffic: Option<Traffic>,
    /// The mark of a bridge that made it by pattern.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mark: Option<BridgeMark>,
}

impl Discovered {
    /// An endpoint of which nothing more is known.
    #[must_use]
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

/// What an endpoint does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)]
pub enum Role {
    Publisher,
    Listener,
    Client,
    Server,
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Publisher => "publisher",
            Self::Listener => "listener",
            Self::Client => "client",
            Self::Server => "server",
        })
    }
}

/// Messages of a topic that passed since the broker runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Traffic {
    /// Their number.
    pub messages: u64,
    /// Their size, all frames.
    pub bytes: u64,
}

/// Quality of service as another program announces it. Times are `None` where they are infinite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[allow(missing_docs)]
pub struct AnnouncedQos {
    pub reliability: Reliability,
    pub durability: AnnouncedDurability,
    /// DDS does not announce it; some stacks do.
    pub history: Option<History>,
    pub deadline: Option<Duration>,
    pub lifespan: Option<Duration>,
    pub liveliness: Liveliness,
    pub lease: Option<Duration>,
}

/// What DDS calls durability; ROS nodes use the first two.
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
    /// What differs from what is usual, in a few words: `reliable volatile`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.reliability {
            Reliability::Reliable => "reliable",
            Reliability::BestEffort => "best_effort",
        })?;
        f.write_str(match self.durability {
            AnnouncedDurability::Volatile => " volatile",
            AnnouncedDurability::TransientLocal => " transient_local",
            AnnouncedDurability::Transient => " transient",
            AnnouncedDurability::Persistent => " persistent",
        })?;
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
        match self.liveliness {
            Liveliness::Automatic => {}
            Liveliness::ManualByParticipant => f.write_str(" manual_by_participant")?,
            Liveliness::ManualByTopic => f.write_str(" manual_by_topic")?,
        }
        match self.lease {
            Some(lease) => write!(f, " lease {lease:?}"),
            None => Ok(()),
        }
    }
}

/// Why endpoints cannot be listed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DiscoverError {
    /// The middleware has no way to tell what exists.
    #[error("{middleware} cannot tell which endpoints exist")]
    Unsupported {
        /// Middleware asked.
        middleware: String,
    },
    /// The middleware has not started; it is tried again.
    #[error("{middleware} to start: {reason}")]
    NotStarted {
        /// Middleware asked.
        middleware: String,
        /// Why the last try failed.
        reason: String,
    },
    /// The middleware can never start with its settings.
    #[error("{middleware} does not start: {reason}")]
    Refused {
        /// Middleware asked.
        middleware: String,
        /// What is wrong with them.
        reason: String,
    },
    /// The transport refused.
    #[error("{middleware} could not list its endpoints: {reason}")]
    Transport {
        /// Middleware asked.
        middleware: String,
        /// What the transport said.
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
