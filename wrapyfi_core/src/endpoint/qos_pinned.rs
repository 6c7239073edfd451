//! Policies that are laid down from outside, whatever else decides the quality of service.

use std::time::Duration;

use super::{Durability, History, Liveliness, Qos, QosPolicy, Reliability};

/// Policies that are fixed one by one; those that are `None` are decided elsewhere: by the profile,
/// or by the peers where they are followed. A time that is `Some(None)` is infinite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PinnedQos {
    /// Delivery effort.
    pub reliability: Option<Reliability>,
    /// What late readers get.
    pub durability: Option<Durability>,
    /// Samples kept.
    pub history: Option<History>,
    /// Longest time between two messages.
    pub deadline: Option<Option<Duration>>,
    /// Age at which a message is no longer delivered.
    pub lifespan: Option<Option<Duration>>,
    /// Who says that the publisher is alive.
    pub liveliness: Option<Liveliness>,
    /// Silence after which it counts as dead.
    pub lease: Option<Option<Duration>>,
}

impl PinnedQos {
    /// `qos` with these policies in place of its own.
    ///
    /// ```
    /// use wrapyfi_core::endpoint::{PinnedQos, Qos, Reliability};
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

    /// Every policy as `qos` has it.
    #[must_use]
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

    /// Whether the policy, or a part of it, is fixed here.
    #[must_use]
    pub fn holds(&self, policy: QosPolicy) -> bool {
        match policy {
            QosPolicy::Reliability => self.reliability.is_some(),
            QosPolicy::Durability => self.durability.is_some(),
            QosPolicy::Deadline => self.deadline.is_some(),
            QosPolicy::Liveliness => self.liveliness.is_some() || self.lease.is_some(),
        }
    }
}
