//! Policies that are fixed from outside, whatever else decides the quality of service.

use std::time::Duration;

use super::{Durability, History, Liveliness, Qos, QosPolicy, Reliability};

/// Policies that are fixed one by one. A policy that is `None` is decided elsewhere: by the
/// profile, or by the peers where they are followed. A time that is `Some(None)` is infinite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PinnedQos {
    /// Effort of delivery.
    pub reliability: Option<Reliability>,
    /// Treatment of listeners that come late.
    pub durability: Option<Durability>,
    /// Number of messages kept.
    pub history: Option<History>,
    /// Longest time between two messages.
    pub deadline: Option<Option<Duration>>,
    /// Age at which a message is no longer delivered.
    pub lifespan: Option<Option<Duration>>,
    /// Way in which the publisher asserts that it is alive.
    pub liveliness: Option<Liveliness>,
    /// Silence after which the publisher counts as dead.
    pub lease: Option<Option<Duration>>,
}

impl PinnedQos {
    /// Replaces the policies of `qos` by these.
    ///
    /// ```
    /// use wrapyfi_endpoint::{PinnedQos, Qos, Reliability};
    /// let pinned =
    ///     PinnedQos { reliability: Some(Reliability::BestEffort), ..PinnedQos::default() };
    /// assert_eq!(pinned.apply(Qos::default()).reliability, Reliability::BestEffort);
    /// assert_eq!(PinnedQos::default().apply(Qos::default()), Qos::default());
    /// ```
    #[must_use]
    pub fn apply(&self, qos: Qos) -> Qos {
        Qos {
            reliability: self.reliability.unwrap_or(qos.reliability),
            durability: self.durability.unwrap_or(qos.durability),
            history: self.history.unwrap_or(qos.history),
            deadline: self.deadline.unwrap_or(qos.deadline),
            lifespan: self.lifespan.unwrap_or(qos.lifespan),
            liveliness: self.liveliness.unwrap_or(qos.liveliness),
            lease: self.lease.unwrap_or(qos.lease),
        }
    }

    /// Fixes all policies as `qos` has them.
    pub fn all_of(qos: &Qos) -> Self {
        Self {
            reliability: Some(qos.reliability),
            durability: Some(qos.durability),
            history: Some(qos.history),
            deadline: Some(qos.deadline),
            lifespan: Some(qos.lifespan),
            liveliness: Some(qos.liveliness),
            lease: Some(qos.lease),
        }
    }

    /// True when the policy, or a part of it, is fixed here.
    pub fn holds(&self, policy: QosPolicy) -> bool {
        match policy {
            QosPolicy::Reliability => self.reliability.is_some(),
            QosPolicy::Durability => self.durability.is_some(),
            QosPolicy::Deadline => self.deadline.is_some(),
            QosPolicy::Liveliness => self.liveliness.is_some() || self.lease.is_some(),
        }
    }
}
