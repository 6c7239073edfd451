//! Quality of service from outside: `qos_overrides./topic.publisher.reliability` and its like.
//!
//! ```text
//!   -p qos_overrides./camera.publisher.depth:=20 ─┐
//!                                                 ├─▶ read-only parameters ─▶ QosOverrides
//!   the endpoint's profile: what may be changed  ─┘   with what is in force    what was changed
//! ```

use wrapyfi_interfaces::named;

use super::{DeclareError, ParameterDescriptor, ParameterStore, SHOWN};
use crate::ParameterValue;

named! {
    /// End of a topic that an endpoint is.
    ///
    /// See [`QosOverrides`].
    #[allow(missing_docs)]
    pub enum EndpointRole {
        Publisher => "publisher",
        Subscription => "subscription",
    }
    /// Word in the names of parameters.
    pub fn word;
}

named! {
    /// Delivery effort.
    ///
    /// See [`QosOverrides`].
    #[allow(missing_docs)] // the names are the documentation
    pub enum ReliabilityOverride {
        SystemDefault => "system_default",
        Reliable => "reliable",
        BestEffort => "best_effort",
        BestAvailable => "best_available",
    }
    /// Word in parameters.
    pub fn word, from_word;
}

named! {
    /// Treatment of a listener that comes late: transient local sends it the last messages.
    ///
    /// See [`QosOverrides`].
    #[allow(missing_docs)] // the names are the documentation
    pub enum DurabilityOverride {
        SystemDefault => "system_default",
        TransientLocal => "transient_local",
        Volatile => "volatile",
        BestAvailable => "best_available",
    }
    /// Word in parameters.
    pub fn word, from_word;
}

named! {
    /// Number of messages that an endpoint keeps until they are delivered.
    ///
    /// See [`QosOverrides`].
    #[allow(missing_docs)] // the names are the documentation
    pub enum HistoryOverride {
        SystemDefault => "system_default",
        KeepLast => "keep_last",
        KeepAll => "keep_all",
    }
    /// Word in parameters.
    pub fn word, from_word;
}

named! {
    /// Way in which a publisher asserts that it is alive.
    ///
    /// See [`QosOverrides`].
    #[allow(missing_docs)] // the names are the documentation
    pub enum LivelinessOverride {
        SystemDefault => "system_default",
        Automatic => "automatic",
        ManualByTopic => "manual_by_topic",
        BestAvailable => "best_available",
    }
    /// Word in parameters.
    pub fn word, from_word;
}

/// Policies of quality of service, each where it is given.
///
/// As the argument of [`ParameterStore::declare_qos_overrides`] these are the policies that may be
/// changed, with what holds otherwise; as its result, those that were changed.
///
/// ```
/// use std::collections::BTreeMap;
/// use wrapyfi_node::parameters::{EndpointRole, ParameterStore, QosOverrides, ReliabilityOverride};
/// use wrapyfi_node::{NodeName, ParameterValue};
/// // As `-p qos_overrides./camera.publisher.depth:=3` gives it.
/// let depth = ("qos_overrides./camera.publisher.depth".to_owned(), ParameterValue::Integer(3));
/// let mut store = ParameterStore::new(&NodeName::new("camera", "/")?, BTreeMap::from([depth]))?;
/// let reliability = Some(ReliabilityOverride::Reliable);
/// let profile = QosOverrides { depth: Some(10), reliability, ..QosOverrides::default() };
/// let changed = store.declare_qos_overrides("/camera", EndpointRole::Publisher, &profile)?;
/// assert_eq!(changed, QosOverrides { depth: Some(3), ..QosOverrides::default() });
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct QosOverrides {
    /// Longest time between two messages, in nanoseconds; 0 is no limit.
    pub deadline_ns: Option<u64>,
    /// Samples kept, where the history keeps the last.
    pub depth: Option<u32>,
    /// Treatment of listeners that come late.
    pub durability: Option<DurabilityOverride>,
    /// History: the last `depth` messages, or all.
    pub history: Option<HistoryOverride>,
    /// Age at which a message is no longer delivered, in nanoseconds; 0 is never. Of publishers
    /// only.
    pub lifespan_ns: Option<u64>,
    /// Way in which the publisher asserts that it is alive.
    pub liveliness: Option<LivelinessOverride>,
    /// Silence after which the publisher counts as dead, in nanoseconds; 0 is never.
    pub liveliness_lease_duration_ns: Option<u64>,
    /// Delivery effort.
    pub reliability: Option<ReliabilityOverride>,
}

/// Error of an override of quality of service.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum QosOverrideError {
    /// The endpoint has no such policy to override, or the policy cannot have the value.
    #[error("{0}")]
    Unfit(String),
    /// The parameter cannot be declared.
    #[error(transparent)]
    Declare(#[from] DeclareError),
}

named! {
    /// A policy, by its name.
    enum Policy {
        Deadline => "deadline",
        Depth => "depth",
        Durability => "durability",
        History => "history",
        Lifespan => "lifespan",
        Liveliness => "liveliness",
        LivelinessLeaseDuration => "liveliness_lease_duration",
        Reliability => "reliability",
    }
    /// Word in the names of parameters.
    pub fn word;
}

impl Policy {
    /// Values that the policy can have, in words.
    fn allowed(self) -> String {
        match self {
            Self::Depth => format!("an integer from 0 to {}", i32::MAX),
            Self::Deadline | Self::Lifespan | Self::LivelinessLeaseDuration => {
                "a time in nanoseconds: an integer from 0".to_owned()
            }
            Self::Durability => DurabilityOverride::ALL.map(DurabilityOverride::word).join(", "),
            Self::History => HistoryOverride::ALL.map(HistoryOverride::word).join(", "),
            Self::Liveliness => LivelinessOverride::ALL.map(LivelinessOverride::word).join(", "),
            Self::Reliability => ReliabilityOverride::ALL.map(ReliabilityOverride::word).join(", "),
        }
    }
}

impl QosOverrides {
    /// Value of a policy, where it is given.
    fn get(&self, policy: Policy) -> Option<ParameterValue> {
        let word = |word: &str| ParameterValue::String(word.to_owned());
        let time = |ns: u64| ParameterValue::Integer(i64::try_from(ns).unwrap_or(i64::MAX));
        match policy {
            Policy::Deadline => self.deadline_ns.map(time),
            Policy::Depth => self.depth.map(|depth| ParameterValue::Integer(depth.into())),
            Policy::Durability => self.durability.map(|it| word(it.word())),
            Policy::History => self.history.map(|it| word(it.word())),
            Policy::Lifespan => self.lifespan_ns.map(time),
            Policy::Liveliness => self.liveliness.map(|it| word(it.word())),
            Policy::LivelinessLeaseDuration => self.liveliness_lease_duration_ns.map(time),
            Policy::Reliability => self.reliability.map(|it| word(it.word())),
        }
    }

    /// Sets a policy, where it can have the value.
    fn set(&mut self, policy: Policy, value: &ParameterValue) -> Option<()> {
        let integer = match *value {
            ParameterValue::Integer(value) => u64::try_from(value).ok(),
            _ => None,
        };
        let word = match value {
            ParameterValue::String(word) => word,
            _ => "",
        };
        match policy {
            Policy::Deadline => self.deadline_ns = Some(integer?),
            Policy::Depth => {
                let depth = u32::try_from(integer?).ok()?;
                self.depth = Some(depth).filter(|depth| i32::try_from(*depth).is_ok());
                self.depth?;
            }
            Policy::Durability => self.durability = Some(DurabilityOverride::from_word(word)?),
            Policy::History => self.history = Some(HistoryOverride::from_word(word)?),
            Policy::Lifespan => self.lifespan_ns = Some(integer?),
            Policy::Liveliness => self.liveliness = Some(LivelinessOverride::from_word(word)?),
            Policy::LivelinessLeaseDuration => {
                self.liveliness_lease_duration_ns = Some(integer?);
            }
            Policy::Reliability => self.reliability = Some(ReliabilityOverride::from_word(word)?),
        }
        Some(())
    }
}

impl ParameterStore {
    /// Declares a read-only parameter for each policy that `profile` gives, and returns those that
    /// the command line changes. Parameters that are declared already keep their values.
    ///
    /// # Errors
    /// When the command line names a policy that `profile` does not give, or a value that it cannot
    /// have.
    pub fn declare_qos_overrides(
        &mut self,
        topic: &str,
        role: EndpointRole,
        profile: &QosOverrides,
    ) -> Result<QosOverrides, QosOverrideError> {
        let prefix = format!("qos_overrides.{topic}.{role}.");
        // A subscription has no lifespan.
        let has = |one: &Policy| *one != Policy::Lifespan || role == EndpointRole::Publisher;
        let may_change =
            || Policy::ALL.into_iter().filter(|one| has(one) && profile.get(*one).is_some());
        let mut changed = QosOverrides::default();
        // All policies are checked before any is declared, so that an error declares none.
        for (parameter, value) in self.overrides() {
            let Some(name) = parameter.strip_prefix(&prefix) else { continue };
            let policy = may_change().find(|policy| policy.word() == name).ok_or_else(|| {
                let allowed = match may_change().map(Policy::word).collect::<Vec<_>>() {
                    none if none.is_empty() => "none".to_owned(),
                    names => names.join(", "),
                };
                QosOverrideError::Unfit(format!(
                    "parameter {parameter}: the {role} of {topic} has no policy {name:?} to override; \
                     it has {allowed}"
                ))
            })?;
            changed.set(policy, value).ok_or_else(|| {
                let (found, allowed) = (value.parameter_type(), policy.allowed());
                let value: String = value.to_string().chars().take(SHOWN).collect();
                QosOverrideError::Unfit(format!(
                    "parameter {parameter}: policy {policy} of the {role} of {topic} cannot be {value} \
                     ({found}); it can be {allowed}"
                ))
            })?;
        }
        for policy in may_change() {
            let name = format!("{prefix}{}", policy.word());
            let Some(default) = profile.get(policy) else { continue };
            if self.describe(&name).is_none() {
                let descriptor = ParameterDescriptor::new(name)
                    .with_description(format!("Policy {} of the {role} of {topic}.", policy.word()))
                    .read_only();
                self.declare(descriptor, default)?;
            }
        }
        Ok(changed)
    }
}
