//! Actions of ROS 1: the messages of their topics, and the action of ROS 2 that one becomes.
//!
//! ```text
//!   demo/CountActionGoal     Header header
//!                            actionlib_msgs/GoalID goal_id
//!                            demo/CountGoal goal ──────────▶ demo/action/Count_Goal
//!   demo/CountActionResult, demo/CountActionFeedback: with actionlib_msgs/GoalStatus status
//! ```
//!
//! A publisher shows these messages. Where none has, they are made of a `.action` file of ROS 1, or of the action of
//! ROS 2.

use std::collections::BTreeMap;

use super::definition::{Definition, parse_name};
use super::error::{DefinitionError, PairError};
use super::types::{Types, is_missing};
use crate::parser::{
    Container, Dialect, Element, Field, InterfaceKind, MessageDefinition, TypeName, action_messages,
};
use crate::store::{Looked, ResolveError, ResolvedType};

/// Part of an action: what a message on one of its topics carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ActionPart {
    Goal,
    Result,
    Feedback,
}

impl ActionPart {
    const ALL: [Self; 3] = [Self::Goal, Self::Result, Self::Feedback];

    /// Words of the part in the names of types and of fields.
    fn words(self) -> (&'static str, &'static str) {
        match self {
            Self::Goal => ("Goal", "goal"),
            Self::Result => ("Result", "result"),
            Self::Feedback => ("Feedback", "feedback"),
        }
    }

    /// Part that a name like `demo/action/Count_Goal` means.
    fn of(name: &TypeName) -> Option<Self> {
        let suffix = name.name().strip_prefix(name.file_stem())?.strip_prefix('_')?;
        let is_action = name.kind() == InterfaceKind::Action;
        Self::ALL.into_iter().find(|part| is_action && part.words().0 == suffix)
    }

    /// Field beside the header and the part, with its type in `actionlib_msgs`.
    fn companion(self) -> (&'static str, &'static str) {
        match self {
            Self::Goal => ("goal_id", "GoalID"),
            Self::Result | Self::Feedback => ("status", "GoalStatus"),
        }
    }
}

/// Message that carries a part of an action on ROS 1.
#[derive(Debug, Clone, PartialEq)]
pub struct ActionMessage {
    /// The message, such as `demo/CountActionGoal`.
    pub message: Definition,
    /// The part in it, under the name of a part of an action: `demo/action/Count_Goal`.
    pub part: ResolvedType,
}

impl ActionMessage {
    /// Takes a message of an action apart.
    ///
    /// # Errors
    /// When it is none: its fields must be a header, id or status of a goal, and the part.
    pub fn new(message: Definition) -> Result<Self, DefinitionError> {
        let no_action = |name: &TypeName| DefinitionError::Kind {
            name: name.clone(),
            expected: "message of an action (header, goal_id or status, and goal, result or feedback)",
        };
        let name = message.name().clone();
        let part = part_of_message(&message).ok_or_else(|| no_action(&name))?;
        Ok(Self { part, message })
    }

    /// The same message with these definitions of the types inside.
    fn with_types(
        self,
        types: &BTreeMap<TypeName, MessageDefinition>,
    ) -> Result<Self, DefinitionError> {
        let Definition { resolved, .. } = self.message;
        let mut known = resolved.definitions().clone();
        known.extend(types.clone());
        let resolved =
            ResolvedType::among(Dialect::Ros1, resolved.name(), &known, &Looked::default())?;
        Self::new(Definition::new(resolved, &BTreeMap::new())?)
    }
}

/// The part in a message of an action.
fn part_of_message(message: &Definition) -> Option<ResolvedType> {
    let name = message.name();
    let (part, stem) = ActionPart::ALL.into_iter().find_map(|part| {
        let suffix = format!("Action{}", part.words().0);
        Some((part, name.name().strip_suffix(&suffix)?))
    })?;
    let fields = message.resolved.definition()?.fields.as_slice();
    let nested = |field: &Field| match (&field.field_type.element, field.field_type.container) {
        (Element::Nested(nested), Container::Single) => Some(nested.clone()),
        _ => None,
    };
    let [header, companion, carried] = fields else { return None };
    let (field, type_name) = part.companion();
    let is_envelope = nested(header)? == TypeName::well_known("std_msgs", "Header")
        && companion.name == field
        && nested(companion)? == TypeName::well_known("actionlib_msgs", type_name)
        && carried.name == part.words().1;
    let carried = nested(carried).filter(|_| is_envelope)?;
    let as_part = part_name(&action_name(name, stem)?, part);
    renamed(message.resolved.definitions(), &carried, &as_part).ok()
}

/// Name of an action in the package of `name`.
fn action_name(name: &TypeName, stem: &str) -> Option<TypeName> {
    TypeName::with_kind(Dialect::Ros1, name.package(), InterfaceKind::Action, stem).ok()
}

fn part_name(action: &TypeName, part: ActionPart) -> TypeName {
    action.derived(&format!("_{}", part.words().0))
}

/// Message that carries a part of an action, such as `demo/CountActionGoal` of `demo/action/Count_Goal`.
pub(super) fn carrier_of(part: &TypeName) -> Option<TypeName> {
    let (stem, word) = (part.file_stem(), ActionPart::of(part)?.words().0);
    parse_name(InterfaceKind::Message, &format!("{}/{stem}Action{word}", part.package())).ok()
}

/// The type `from` of these definitions under another name.
fn renamed(
    definitions: &BTreeMap<TypeName, MessageDefinition>,
    from: &TypeName,
    to: &TypeName,
) -> Result<ResolvedType, ResolveError> {
    let mut known = definitions.clone();
    if let Some(definition) = definitions.get(from) {
        known.insert(to.clone(), MessageDefinition { name: to.clone(), ..definition.clone() });
    }
    ResolvedType::among(Dialect::Ros1, to, &known, &Looked::default())
}

impl Types {
    /// Names that an action of ROS 1 may have in ROS 2, given by its ROS 1 name `package/Type`, the likeliest first.
    ///
    /// # Errors
    /// When it is no name.
    pub fn ros2_action_names(&self, type_name: &str) -> Result<Vec<TypeName>, DefinitionError> {
        Ok(self.rules().ros2_names(&parse_name(InterfaceKind::Action, type_name)?))
    }

    /// The action of ROS 2 for one of ROS 1, given by its ROS 1 name `package/Type`: as installed, else made from it. Its
    /// messages are those that its own server, and a client of it, have `shown`, as far as they have.
    ///
    /// # Errors
    /// [`DefinitionError::Unknown`] for the part that nobody has, and when a definition is there and cannot be used.
    pub fn ros2_action(
        &mut self,
        type_name: &str,
        shown: &[&Definition],
    ) -> Result<ResolvedType, PairError> {
        let ros1 = parse_name(InterfaceKind::Action, type_name)?;
        let names = self.rules().ros2_names(&ros1);
        let name = names.first().unwrap_or(&ros1).clone();
        let mut known = BTreeMap::new();
        let made = self.made_action(&ros1, &name, shown, &mut known);
        for name in &names {
            if let Some(found) = self.installed(name, &known)? {
                return Ok(found);
            }
        }
        made
    }

    /// Makes the action `name` of ROS 2. The types inside go into `known`, also where a part is missing.
    fn made_action(
        &mut self,
        ros1: &TypeName,
        name: &TypeName,
        shown: &[&Definition],
        known: &mut BTreeMap<TypeName, MessageDefinition>,
    ) -> Result<ResolvedType, PairError> {
        let told = shown.iter().flat_map(|one| one.resolved.definitions().clone()).collect();
        let mut part = |part| {
            let ros1 = part_name(ros1, part);
            let own = shown.iter().find(|one| Some(one.name()) == carrier_of(&ros1).as_ref());
            let message = match own {
                Some(own) => ActionMessage::new((*own).clone())?,
                None => self.action_message_of(&ros1, None)?.with_types(&told)?,
            };
            let made = self.made_for_ros2(&message.part, &part_name(name, part))?;
            known.extend(made.definitions().clone());
            let no_action = || DefinitionError::Kind { name: name.clone(), expected: "action" };
            Ok::<_, PairError>(made.definition().cloned().ok_or_else(no_action)?)
        };
        // Of a type that a client has in another version, that of the server stays: it comes last.
        let (goal, result) = (part(ActionPart::Goal), part(ActionPart::Result));
        let feedback = part(ActionPart::Feedback);
        let messages = action_messages(name, goal?, result?, feedback?);
        let mut all = known.clone();
        all.extend(messages.into_iter().map(|message| (message.name.clone(), message)));
        Ok(ResolvedType::among(Dialect::Ros2, name, &all, &Looked::default())?)
    }

    /// Notes the name of the action whose message this is; see [`Types::note_names`].
    pub(super) fn note_action(&mut self, message: &Definition) {
        if let Some(part) = part_of_message(message) {
            self.note_names([part.name(), &part.name().interface()]);
        }
    }

    /// Message that carries a part of an action on ROS 1, by the name of the part there, such as
    /// `demo/action/Count_Goal`. What nobody has is made from the part in ROS 2, where that is `at_hand`.
    pub(super) fn action_message_of(
        &mut self,
        name: &TypeName,
        at_hand: Option<&ResolvedType>,
    ) -> Result<ActionMessage, DefinitionError> {
        let no_part =
            || DefinitionError::Kind { name: name.clone(), expected: "part of an action" };
        let (part, message) = ActionPart::of(name).zip(carrier_of(name)).ok_or_else(no_part)?;
        match self.definition_of(&message) {
            Err(DefinitionError::Unknown { looked, .. }) => {
                let carried = self.action_part(name, part, at_hand, looked)?;
                self.composed(&message, part, &carried).and_then(ActionMessage::new)
            }
            found => ActionMessage::new(found?),
        }
    }

    /// The message inside, such as `demo/CountGoal`: known by itself, else of a `.action` file or of ROS 2.
    fn action_part(
        &mut self,
        name: &TypeName,
        part: ActionPart,
        at_hand: Option<&ResolvedType>,
        looked: Looked,
    ) -> Result<ResolvedType, DefinitionError> {
        let (action, word) = (name.interface(), part.words().0);
        let suffix = format!("_{word}");
        let plain = format!("{}/{}{word}", name.package(), action.name());
        let plain = parse_name(InterfaceKind::Message, &plain)?;
        match self.definition_of(&plain) {
            Err(DefinitionError::Unknown { .. }) => {}
            found => return Ok(found?.resolved),
        }
        match self.found_for_ros1(&action, |store, name| Ok(store.resolve(name)?)) {
            Err(DefinitionError::Resolve(error)) if is_missing(&error, &action) => {}
            found => {
                let found = found?;
                return Ok(renamed(found.definitions(), name, &plain)?);
            }
        }
        if let Some(part) = at_hand {
            return Ok(self.derived_for_ros1(part, &plain)?);
        }
        for ros2 in self.rules().ros2_names(&action) {
            let known = self.ros2_known(&ros2)?;
            if let Some(part) = known.and_then(|known| known.part(&suffix)) {
                return Ok(self.derived_for_ros1(&part, &plain)?);
            }
        }
        Err(DefinitionError::Unknown { name: name.clone(), looked })
    }

    /// A message of an action around the part that it carries.
    fn composed(
        &mut self,
        message: &TypeName,
        part: ActionPart,
        carried: &ResolvedType,
    ) -> Result<Definition, DefinitionError> {
        let (field, companion) = part.companion();
        let header = TypeName::well_known("std_msgs", "Header");
        let companion = TypeName::well_known("actionlib_msgs", companion);
        let mut known = carried.definitions().clone();
        for nested in [&header, &companion] {
            known.extend(self.definition_of(nested)?.resolved.definitions().clone());
        }
        let single = |name, nested: &TypeName| {
            Field::new(name, Element::Nested(nested.clone()), Container::Single)
        };
        let fields = vec![
            single("header", &header),
            single(field, &companion),
            single(part.words().1, carried.name()),
        ];
        known.insert(message.clone(), MessageDefinition::new(message.clone(), fields));
        let resolved = ResolvedType::among(Dialect::Ros1, message, &known, &Looked::default())?;
        Definition::new(resolved, &BTreeMap::new())
    }
}

#[cfg(test)]
#[path = "action_types_tests.rs"]
mod tests;
