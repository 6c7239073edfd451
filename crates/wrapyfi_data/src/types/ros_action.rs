//! A ROS action type known at run time, as small as a name.
//!
//! ```text
//!   Fibonacci.action ─▶ goal, result, feedback        what a program gives and gets
//!                   └─▶ SendGoal, GetResult (services), FeedbackMessage     what ROS 2 sends
//! ```

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::{ResolvedType, TypeStore};
use wrapyfi_interfaces::{Action, Message as _, Service as _};

use super::RosService;
use super::payload::MessageTypeError;
use super::ros_type::{Interned, RosType, RosTypeError, defined, intern, interned};

/// A ROS 2 action type with its parts, kept as [`RosType`] is.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::RosAction;
/// use wrapyfi_interfaces::parser::{Dialect, TypeName};
/// use wrapyfi_interfaces::store::TypeStore;
///
/// let mut store = TypeStore::generated();
/// let name = TypeName::parse(Dialect::Ros2, "demo/action/Count")?;
/// store.add_definition(&name, "int32 to\n---\nint32 reached\n---\nint32 at\n")?;
/// let count = RosAction::new(&store.resolve(&name)?)?;
/// assert_eq!(count.goal().name(), "demo/action/Count_Goal");
/// assert_eq!(count.send_goal().name(), "demo/action/Count_SendGoal");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy)]
pub struct RosAction(&'static Known);

struct Known {
    name: String,
    resolved: ResolvedType,
    goal: RosType,
    result: RosType,
    feedback: RosType,
    send_goal: RosService,
    get_result: RosService,
    feedback_message: RosType,
    function: RosService,
    progress: RosService,
}

const EMPTY: &str = "std_msgs/msg/Empty";

static ACTIONS: Interned<Known> = Mutex::new(BTreeMap::new());

impl RosAction {
    /// The action of this name, where the process knows it already. The hash is that of its service `_SendGoal`, or of a
    /// request of that: DDS shows the latter.
    pub fn known(name: &str, hash: &str) -> Option<Self> {
        let actions = ACTIONS.lock().unwrap_or_else(PoisonError::into_inner);
        let is_meant = |known: &&&'static Known| {
            let (service, request) = (known.send_goal.resolved(), known.send_goal.request());
            let hashes = [&*service.type_hash(), request.type_hash()];
            known.name == name && hashes.contains(&hash)
        };
        actions.values().find(is_meant).map(|known| Self(known))
    }

    /// Enters the action of a definition; the same definition gives the same action.
    ///
    /// # Errors
    /// When the definition is no action, its parts cannot be compiled, or [`super::MAX_ROS_TYPES`] are known.
    pub fn new(resolved: &ResolvedType) -> Result<Self, RosTypeError> {
        let known = intern(&ACTIONS, resolved, |name| {
            let part = |suffix: &str| {
                resolved.part(suffix).ok_or_else(|| {
                    RosTypeError(format!("{name} is no action: write it as package/action/Type"))
                })
            };
            let message = |suffix: &str| RosType::new(&part(suffix)?);
            let service = |suffix: &str| RosService::new(&part(suffix)?);
            let (goal, result) = (message("_Goal")?, message("_Result")?);
            let (feedback, nothing) = (message("_Feedback")?, nothing()?);
            Ok(Known {
                name: name.to_owned(),
                resolved: resolved.clone(),
                goal,
                result,
                function: RosService::of_parts(resolved, goal, result),
                progress: RosService::of_parts(resolved, nothing, feedback),
                feedback,
                send_goal: service("_SendGoal")?,
                get_result: service("_GetResult")?,
                feedback_message: message("_FeedbackMessage")?,
            })
        });
        known.map(Self)
    }

    /// Type of a generated action.
    ///
    /// # Errors
    /// When its definition cannot be compiled, or [`super::MAX_ROS_TYPES`] are known.
    pub fn of<A: Action>() -> Result<Self, RosTypeError> {
        match Self::known(A::ROS_TYPE, A::SendGoal::TYPE_HASH) {
            Some(known) => Ok(known),
            None => Self::new(&defined(A::ROS_TYPE, A::Goal::types())?),
        }
    }

    /// Looks an action type up in `store` by its name, for instance `example_interfaces/action/Fibonacci`.
    ///
    /// # Errors
    /// When the text is no name of an action, or the definition cannot be found or used.
    #[doc(hidden)]
    pub fn resolve(text: &str, store: &mut TypeStore) -> Result<Self, MessageTypeError> {
        Ok(Self::new(&store.resolve_name(text).map_err(Box::new)?)?)
    }

    /// ROS name, for instance `example_interfaces/action/Fibonacci`.
    pub fn name(self) -> &'static str {
        &self.0.name
    }

    /// Definition of the action, with the definitions that it refers to.
    pub fn resolved(self) -> &'static ResolvedType {
        &self.0.resolved
    }

    /// Type of goals.
    pub fn goal(self) -> RosType {
        self.0.goal
    }

    /// Type of results.
    pub fn result(self) -> RosType {
        self.0.result
    }

    /// Type of feedback.
    pub fn feedback(self) -> RosType {
        self.0.feedback
    }

    /// Function that takes a goal and returns a result: the action where there are only services.
    pub fn function(self) -> RosService {
        self.0.function
    }

    /// Function without arguments that returns feedback.
    pub fn progress(self) -> RosService {
        self.0.progress
    }

    /// Service of ROS 2 that takes a goal.
    pub fn send_goal(self) -> RosService {
        self.0.send_goal
    }

    /// Service of ROS 2 that gives the result of a goal.
    pub fn get_result(self) -> RosService {
        self.0.get_result
    }

    /// Type of ROS 2 that carries feedback with the id of its goal.
    pub fn feedback_message(self) -> RosType {
        self.0.feedback_message
    }
}

/// Type of messages without fields.
fn nothing() -> Result<RosType, RosTypeError> {
    let wrong = |error: &dyn std::fmt::Display| RosTypeError(format!("{EMPTY}: {error}"));
    let name = TypeName::parse(Dialect::Ros2, EMPTY).map_err(|error| wrong(&error))?;
    RosType::new(&ResolvedType::from_text(Dialect::Ros2, &name, "").map_err(|error| wrong(&error))?)
}

interned!(RosAction);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_action_is_known_by_the_hash_that_its_server_shows() {
        let name = TypeName::parse(Dialect::Ros2, "demo/action/Known").unwrap();
        let of = |text| {
            RosAction::new(&ResolvedType::from_text(Dialect::Ros2, &name, text).unwrap()).unwrap()
        };
        let (one, other) = (of("int8 a\n---\n---\n"), of("int8 b\n---\n---\n"));
        for action in [one, other] {
            let service = action.send_goal();
            for hash in [&*service.resolved().type_hash(), service.request().type_hash()] {
                assert_eq!(RosAction::known("demo/action/Known", hash), Some(action));
            }
        }
        assert_eq!(RosAction::known("demo/action/Known", one.goal().type_hash()), None);
    }
}
