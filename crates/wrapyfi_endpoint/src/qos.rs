//! Quality of service, in ROS 2's terms.

use std::fmt;
use std::time::Duration;

use serde::{Deserialize, Serialize, Serializer};
use wrapyfi_interfaces::named;

use super::discovered::{AnnouncedDurability, AnnouncedQos};

/// Effort of delivery: reliable sends lost messages again.
///
/// See [`Qos`].
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::{Qos, Reliability};
/// let camera = Qos { reliability: Reliability::BestEffort, ..Qos::default() };
/// assert_eq!(camera.to_string(), "best_effort volatile keep_last(10)");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)]
pub enum Reliability {
    Reliable,
    BestEffort,
}

/// Treatment of a listener that comes late: transient local sends it the last messages.
///
/// See [`Qos`].
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::{Durability, Qos};
/// let map = Qos { durability: Durability::TransientLocal, ..Qos::default() };
/// assert_eq!(map.to_string(), "reliable transient_local keep_last(10)");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)]
pub enum Durability {
    Volatile,
    TransientLocal,
}

/// Number of messages that an endpoint keeps until they are delivered.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::{History, Qos};
/// let all = Qos { history: History::KeepAll, ..Qos::default() };
/// assert_eq!(all.to_string(), "reliable volatile keep_all");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum History {
    /// The newest messages, as many as the number.
    KeepLast(u32),
    /// All messages.
    KeepAll,
}

/// Way in which a publisher asserts that it is alive.
///
/// See [`Qos`].
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use std::time::Duration;
/// use wrapyfi_core::endpoint::{Liveliness, Qos};
/// let lease = Some(Duration::from_secs(1));
/// let motors = Qos { liveliness: Liveliness::ManualByTopic, lease, ..Qos::default() };
/// assert_ne!(motors.liveliness, Qos::default().liveliness);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Liveliness {
    /// Asserted by the publisher's process for as long as it runs.
    Automatic,
    /// Asserted by a call in the publisher's process. ROS 2 has given it up; other DDS programs
    /// announce it.
    #[serde(skip_deserializing)]
    ManualByParticipant,
    /// Asserted by each message that the publisher sends.
    ManualByTopic,
}

/// Quality of service of one endpoint. Times are `None` where they are infinite.
///
/// Wrapyfi's own ROS 2 endpoints are reliable, volatile, keep-last 5; the default here is ROS 2's
/// default profile, keep-last 10.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use std::time::Duration;
/// use wrapyfi_core::endpoint::{Durability, History, Liveliness, Qos, Reliability};
/// let qos = Qos {
///     reliability: Reliability::BestEffort,
///     durability: Durability::Volatile,
///     history: History::KeepLast(1),
///     deadline: Some(Duration::from_millis(100)),
///     liveliness: Liveliness::Automatic,
///     ..Qos::default()
/// };
/// assert_eq!(qos.to_string(), "best_effort volatile keep_last(1) deadline 100ms");
/// assert_eq!(Qos::default().history, History::KeepLast(10));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Qos {
    /// Effort of delivery.
    pub reliability: Reliability,
    /// Treatment of listeners that come late.
    pub durability: Durability,
    /// Number of messages kept.
    pub history: History,
    /// Longest time between two messages: promised by a publisher, asked for by a listener.
    #[serde(rename = "deadline_ms", serialize_with = "milliseconds")]
    pub deadline: Option<Duration>,
    /// Age at which a message is no longer delivered; a policy of publishers only.
    #[serde(rename = "lifespan_ms", serialize_with = "milliseconds")]
    pub lifespan: Option<Duration>,
    /// Way in which the publisher asserts that it is alive.
    pub liveliness: Liveliness,
    /// Silence after which the publisher counts as dead.
    #[serde(rename = "lease_ms", serialize_with = "milliseconds")]
    pub lease: Option<Duration>,
}

fn milliseconds<S: Serializer>(time: &Option<Duration>, serializer: S) -> Result<S::Ok, S::Error> {
    match time {
        Some(time) => serializer.serialize_some(&(time.as_secs_f64() * 1e3)),
        None => serializer.serialize_none(),
    }
}

impl From<Qos> for AnnouncedQos {
    /// Policies that an endpoint with this quality of service announces.
    fn from(qos: Qos) -> Self {
        Self {
            reliability: qos.reliability,
            durability: match qos.durability {
                Durability::Volatile => AnnouncedDurability::Volatile,
                Durability::TransientLocal => AnnouncedDurability::TransientLocal,
            },
            history: Some(qos.history),
            deadline: qos.deadline,
            lifespan: qos.lifespan,
            liveliness: qos.liveliness,
            lease: qos.lease,
        }
    }
}

impl fmt::Display for Qos {
    /// Writes the policies, `reliable volatile keep_last(10)`, and the times that are finite.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        AnnouncedQos::from(*self).fmt(f)
    }
}

named! {
    /// A named profile, as `rmw_qos_profiles` names them.
    ///
    /// ```
    /// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
    /// use wrapyfi_core::endpoint::{Qos, QosPreset};
    /// let latched = Qos::from(QosPreset::Latched);
    /// assert_eq!(latched.to_string(), "reliable transient_local keep_last(1)");
    /// assert_eq!(Qos::from(QosPreset::Default), Qos::default());
    /// ```
    #[derive(Serialize)]
    #[serde(rename_all = "snake_case")]
    #[non_exhaustive]
    pub enum QosPreset {
        /// Reliable, volatile, keep-last 10.
        Default => "default",
        /// Best effort, volatile, keep-last 5.
        SensorData => "sensor_data",
        /// Reliable, transient local, keep-last 1: what ROS 1 called latched.
        Latched => "latched",
    }
    /// Word in configurations and options.
    pub fn name, from_name;
}

impl From<QosPreset> for Qos {
    fn from(preset: QosPreset) -> Self {
        let (reliability, durability, depth) = match preset {
            QosPreset::Default => (Reliability::Reliable, Durability::Volatile, 10),
            QosPreset::SensorData => (Reliability::BestEffort, Durability::Volatile, 5),
            QosPreset::Latched => (Reliability::Reliable, Durability::TransientLocal, 1),
        };
        Self {
            reliability,
            durability,
            history: History::KeepLast(depth),
            deadline: None,
            lifespan: None,
            liveliness: Liveliness::Automatic,
            lease: None,
        }
    }
}

impl Default for Qos {
    fn default() -> Self {
        QosPreset::Default.into()
    }
}
