//! Quality of service, in ROS 2's terms.

use serde::Serialize;

/// Delivery effort.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)]
pub enum Reliability {
    Reliable,
    BestEffort,
}

/// Whether a late reader gets what was sent before it came.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)]
pub enum Durability {
    Volatile,
    TransientLocal,
}

/// How many samples are kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum History {
    /// The newest `depth` samples.
    KeepLast(u32),
    /// All of them, until delivered.
    KeepAll,
}

/// Quality of service of one endpoint.
///
/// Wrapyfi's own ROS 2 endpoints are reliable, volatile, keep-last 5; the default here is ROS 2's
/// default profile, keep-last 10.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Qos {
    /// Delivery effort.
    pub reliability: Reliability,
    /// What late readers get.
    pub durability: Durability,
    /// Samples kept.
    pub history: History,
}

/// A named profile, as `rmw_qos_profiles` names them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum QosPreset {
    /// Reliable, volatile, keep-last 10.
    Default,
    /// Best effort, volatile, keep-last 5.
    SensorData,
    /// Reliable, transient local, keep-last 1: what ROS 1 called latched.
    Latched,
}

impl From<QosPreset> for Qos {
    fn from(preset: QosPreset) -> Self {
        let (reliability, durability, depth) = match preset {
            QosPreset::Default => (Reliability::Reliable, Durability::Volatile, 10),
            QosPreset::SensorData => (Reliability::BestEffort, Durability::Volatile, 5),
            QosPreset::Latched => (Reliability::Reliable, Durability::TransientLocal, 1),
        };
        Self { reliability, durability, history: History::KeepLast(depth) }
    }
}

impl Default for Qos {
    fn default() -> Self {
        QosPreset::Default.into()
    }
}
