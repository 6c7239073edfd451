//! Versions of the types inside one: nodes that were built from different versions of a package each mean theirs.
//!
//! ```text
//!   demo/Query ─ as found: demo/Part of the node that was heard last ─▶ fits? ─▶ that
//!                    └─ with each other demo/Part that is known ──────▶ fits? ─▶ that
//! ```
//!
//! A checksum tells the one that fits, or a type of ROS 2 of which no field may be lost.

use std::collections::BTreeMap;

use super::action_types::{ActionMessage, carrier_of};
use super::definition::{Definition, nested};
use super::error::PairError;
use super::plan::PairPlan;
use super::types::Types;
use crate::parser::{Dialect, FieldType, InterfaceKind, MessageDefinition, TypeName};
use crate::store::{Looked, ResolvedType, ros1_builtin};

/// Most combinations of definitions that are tried for one type.
const MAX_VARIANTS: usize = 64;

/// True for definitions that are the same but for their comments.
fn is_same(one: &MessageDefinition, other: &MessageDefinition) -> bool {
    fn fields(of: &MessageDefinition) -> impl Iterator<Item = (&String, &FieldType)> {
        of.fields.iter().map(|field| (&field.name, &field.field_type))
    }
    fn constants(of: &MessageDefinition) -> impl Iterator<Item = (&String, &String)> {
        of.constants.iter().map(|constant| (&constant.name, &constant.written))
    }
    fields(one).eq(fields(other)) && constants(one).eq(constants(other))
}

impl Types {
    /// Definition and plan for what is published to ROS 1 from a type of ROS 2 that is at hand, under the likeliest name
    /// that it has there: where publishers have shown several definitions of it, or of the types inside, the last one that
    /// loses no field counts. That of a part of an action is the message around it, and the plan that of the part.
    ///
    /// # Errors
    /// As [`Types::definition`] and [`PairPlan::compile`].
    pub fn counterpart(
        &mut self,
        ros2: &ResolvedType,
    ) -> Result<(Definition, PairPlan), PairError> {
        let names = self.ros1_names(ros2.name());
        let is_part = ros2.name().kind() == InterfaceKind::Action;
        let shown = names.iter().find_map(|name| match is_part {
            true => self.announced.get(&carrier_of(name)?),
            false => self.announced.get(name),
        });
        let is_shown = shown.is_some();
        for definition in shown.into_iter().flatten().rev() {
            if let Ok(pair) = self.pair(definition.clone(), ros2)
                && pair.1.is_whole()
            {
                return Ok(pair);
            }
        }
        let definition = self.likeliest(ros2.name(), |types, name| match is_part {
            true => Ok(types.action_message_of(name, Some(ros2))?.message),
            false => {
                types.definition_or(name, |types, name| Ok(types.derived_for_ros1(ros2, name)?))
            }
        })?;
        let found = self.pair(definition, ros2)?;
        // What its own publishers show is what its subscribers want.
        if is_shown || found.1.is_whole() {
            return Ok(found);
        }
        let variants = self.variants(&found.0.resolved, false).into_iter();
        let mut pairs = variants.filter_map(|variant| {
            self.pair(Definition::new(variant, &BTreeMap::new()).ok()?, ros2).ok()
        });
        Ok(pairs.find(|(_, plan)| plan.is_whole()).unwrap_or(found))
    }

    /// The plan between a message of ROS 1, or the part of an action in it, and a type of ROS 2.
    fn pair(
        &self,
        definition: Definition,
        ros2: &ResolvedType,
    ) -> Result<(Definition, PairPlan), PairError> {
        if ros2.name().kind() != InterfaceKind::Action {
            let plan = PairPlan::compile(&definition.resolved, ros2, self.rules())?;
            return Ok((definition, plan));
        }
        let ActionMessage { message, part } = ActionMessage::new(definition)?;
        let plan = PairPlan::compile(&part, ros2, self.rules())?;
        Ok((message, plan))
    }

    /// A type of ROS 1 with other definitions of the types inside it than it has: those that publishers have shown, and
    /// with `all` those of a folder or made from ROS 2, which a node that tells a checksum may mean, too.
    pub(super) fn variants(&mut self, of: &ResolvedType, all: bool) -> Vec<ResolvedType> {
        let is_inside = |name: &TypeName| {
            name.kind() == InterfaceKind::Message
                && name != of.name()
                && ros1_builtin(name).is_none()
        };
        let mut versions = BTreeMap::<TypeName, Vec<MessageDefinition>>::new();
        let mut names: Vec<_> =
            of.definitions().keys().filter(|it| is_inside(it)).cloned().collect();
        while let Some(name) = names.pop() {
            if versions.contains_key(&name) {
                continue;
            }
            let mut found = Vec::<MessageDefinition>::new();
            let own = of.definitions().get(&name).cloned();
            for one in own.into_iter().chain(self.known_versions(&name, all)) {
                if !found.iter().any(|known| is_same(known, &one)) {
                    names.extend(nested(&one).filter(|it| is_inside(it)).cloned());
                    found.push(one);
                }
            }
            versions.insert(name, found);
        }
        let count = versions.values().fold(1, |all: usize, one| all.saturating_mul(one.len()));
        let variant = |number: usize| {
            let (mut rest, mut known) = (number, of.definitions().clone());
            for (name, all) in &versions {
                let chosen = all.get(rest % all.len().max(1)).cloned();
                known.extend(chosen.map(|chosen| (name.clone(), chosen)));
                rest /= all.len().max(1);
            }
            ResolvedType::among(Dialect::Ros1, of.name(), &known, &Looked::default()).ok()
        };
        (1..count.min(MAX_VARIANTS)).filter_map(variant).collect()
    }

    /// Definitions of a type of ROS 1 that are known, as for [`Types::variants`].
    fn known_versions(&mut self, name: &TypeName, all: bool) -> Vec<MessageDefinition> {
        let shown = self.announced.values().flatten().rev();
        let shown = shown.filter_map(|one| one.resolved.definitions().get(name)).cloned();
        let mut versions: Vec<_> = shown.collect();
        if all {
            let stored = self.ros1.resolve(name).ok();
            let found = stored.into_iter().chain(self.made_for_ros1(name).ok());
            versions.extend(found.filter_map(|one| one.definition().cloned()));
        }
        versions
    }
}
