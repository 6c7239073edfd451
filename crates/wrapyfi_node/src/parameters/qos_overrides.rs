//! Quality of service from outside: `qos_overrides./topic.publisher.reliability` and its like.
//!
//! ```text
//!   -p qos_overrides./camera.publisher.depth:=20 ─┐
//!                                                 ├─▶ read-only parameters ─▶ PinnedQos
//!   the endpoint's quality of service            ─┘   with what is in force   what is fixed
//! ```

use wrapyfi_interfaces::named;

use super::qos_profile::{Changed, Policy};
use super::{DeclareError, ParameterDescriptor, ParameterStore, SHOWN};
use wrapyfi_endpoint::{PinnedQos, Qos};

named! {
    /// End of a topic that an endpoint is.
    #[allow(missing_docs)]
    pub enum EndpointRole {
        Publisher => "publisher",
        Subscription => "subscription",
    }
    /// Word in the names of parameters.
    pub fn word;
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

impl ParameterStore {
    /// Declares a read-only parameter for each policy of an endpoint that has `base` and, where it
    /// `follows` them, those of its peers. Parameters that are declared already keep their values.
    /// Returns the policies that are fixed as the command line changes them, and true when the endpoint
    /// follows its peers in the rest: because it does so anyway, or because a policy is to be the best
    /// available.
    ///
    /// ```
    /// use std::collections::BTreeMap;
    /// use wrapyfi_endpoint::{History, Qos};
    /// use wrapyfi_node::parameters::{EndpointRole, ParameterStore};
    /// use wrapyfi_node::{NodeName, ParameterValue};
    /// // As `-p qos_overrides./camera.publisher.depth:=3` gives it.
    /// let depth = ("qos_overrides./camera.publisher.depth".to_owned(), ParameterValue::Integer(3));
    /// let mut store = ParameterStore::new(&NodeName::new("camera", "/")?, BTreeMap::from([depth]))?;
    /// let (base, role) = (Qos::default(), EndpointRole::Publisher);
    /// let (pinned, follows) = store.declare_qos_overrides("/camera", role, &base, false)?;
    /// assert_eq!(pinned.apply(base), Qos { history: History::KeepLast(3), ..base });
    /// assert!(!follows);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// When the command line names a policy that the endpoint does not have, or a value that it cannot
    /// have.
    pub fn declare_qos_overrides(
        &mut self,
        topic: &str,
        role: EndpointRole,
        base: &Qos,
        follows: bool,
    ) -> Result<(PinnedQos, bool), QosOverrideError> {
        let prefix = format!("qos_overrides.{topic}.{role}.");
        // A subscription has no lifespan.
        let has = |one: &Policy| *one != Policy::Lifespan || role == EndpointRole::Publisher;
        let policies: Vec<Policy> = Policy::ALL.into_iter().filter(has).collect();
        let mut changed = Changed::new(base, follows);
        // All policies are checked before any is declared, so that an error declares none.
        for (parameter, value) in self.overrides() {
            let Some(name) = parameter.strip_prefix(&prefix) else { continue };
            let policy = policies.iter().copied().find(|policy| policy.word() == name);
            let policy = policy.ok_or_else(|| {
                let words: Vec<_> = policies.iter().map(|policy| policy.word()).collect();
                let allowed = words.join(", ");
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
        for policy in policies {
            let name = format!("{prefix}{}", policy.word());
            if self.describe(&name).is_none() {
                let descriptor = ParameterDescriptor::new(name)
                    .with_description(format!("Policy {} of the {role} of {topic}.", policy.word()))
                    .read_only();
                self.declare(descriptor, policy.value(base, follows))?;
            }
        }
        Ok(changed.end())
    }
}
