//! Rules that name what their types do not have.
//!
//! ```text
//!   rule ─▶ types that it names, where both are known ─▶ fields compared ─▶ words of what is wrong
//!                               one is not ─────────────▶ words of which one
//! ```

use super::definition::{Definition, ServiceDefinition};
use super::error::{DefinitionError, PairError};
use super::names::ros1_name;
use super::plan::PairPlan;
use super::types::Types;
use crate::parser::{InterfaceKind, TypeName};
use crate::store::{ResolvedType, TypeStore};

/// Suffixes of the parts of an action.
const PARTS: [&str; 3] = ["_Goal", "_Result", "_Feedback"];

impl Types {
    /// Sentences about the rules for one message, service or action that cannot work: of a type that is defined nowhere here, or
    /// a field that a type does not have. Types of ROS 2 are looked for in `ros2`, those of ROS 1 here; none is made.
    pub fn check_rules(&mut self, ros2: &mut TypeStore) -> Vec<String> {
        let pairs = self.rules().named_pairs();
        let doubts = pairs.into_iter().filter_map(|(place, one, two)| {
            let doubt = self.check_rule(&one, &two, ros2).err()?;
            Some(format!("{place}: {doubt}"))
        });
        doubts.collect()
    }

    fn check_rule(
        &mut self,
        one: &TypeName,
        two: &TypeName,
        ros2: &mut TypeStore,
    ) -> Result<(), String> {
        let resolved = match (ros2.resolve_defined(two), self.ros2_known(two)) {
            (Ok(found), _) | (Err(_), Ok(Some(found))) => found,
            (Err(error), _) => return Err(error.to_string()),
        };
        let parts = self.parts_in_ros1(one).map_err(|error| match error {
            DefinitionError::Resolve(_) | DefinitionError::Unknown { .. } => format!(
                "{} of ROS 1 is defined nowhere here: whether the rule fits is seen when a node shows it",
                ros1_name(one)
            ),
            error => error.to_string(),
        })?;
        let in_ros2: Vec<Option<ResolvedType>> = match one.kind() {
            InterfaceKind::Message => vec![Some(resolved)],
            InterfaceKind::Service => {
                ["_Request", "_Response"].map(|suffix| resolved.part(suffix)).into()
            }
            InterfaceKind::Action => PARTS.map(|suffix| resolved.part(suffix)).into(),
        };
        let compile = |(one, two): (&ResolvedType, Option<ResolvedType>)| -> Result<_, PairError> {
            two.map(|two| PairPlan::compile(one, &two, self.rules())).transpose()
        };
        let compiled: Result<Vec<_>, _> = parts.iter().zip(in_ros2).map(compile).collect();
        compiled.map(drop).map_err(|error| error.to_string())
    }

    /// Message, request and response, or parts of an action, of a type of ROS 1 as it is defined here.
    fn parts_in_ros1(&mut self, name: &TypeName) -> Result<Vec<ResolvedType>, DefinitionError> {
        Ok(match name.kind() {
            InterfaceKind::Service => {
                let found = self.found_for_ros1(name, ServiceDefinition::from_store)?;
                vec![found.request, found.response]
            }
            InterfaceKind::Message => {
                vec![self.found_for_ros1(name, Definition::from_store)?.resolved]
            }
            InterfaceKind::Action => {
                let part = |suffix| Ok(self.action_message_of(&name.derived(suffix), None)?.part);
                PARTS.into_iter().map(part).collect::<Result<_, DefinitionError>>()?
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::Rules;
    use super::*;
    use crate::parser::Dialect;

    #[test]
    fn rules_that_fit_no_type_or_field_are_named() {
        let rule = |one: &str, two: &str, more: &str| {
            format!(
                r#"{{"ros1_package_name": "{one}", "ros2_package_name": "{two}", "ros1_message_name": "Log",
                    "ros2_message_name": "Log"{more}}}"#
            )
        };
        let stamp = |one: &str, two: &str| {
            format!(r#", "match_other_fields": true, "fields_1_to_2": {{"{one}": "{two}"}}"#)
        };
        let (right, wrong) = (stamp("header.stamp", "stamp"), stamp("header.stmp", "stamp"));
        let rules = [
            rule("rosgraph_msgs", "rcl_interfaces", &right),
            rule("rosgraph_msgs", "rcl_interfaces", &wrong),
            rule("rosgraph_msgs", "nowhere", &right),
            rule("nobody_has", "rcl_interfaces", &right),
        ];
        let found = rules.map(|rule| {
            let rules: Rules = serde_json::from_str(&format!("[{rule}]")).unwrap();
            let mut ros2 = TypeStore::generated();
            Types::new(rules, TypeStore::empty()).check_rules(&mut ros2)
        });
        let [right, wrong, no_ros2, no_ros1] = found;
        assert_eq!(right, Vec::<String>::new());
        let said = "mapping rule 1 (of rosgraph_msgs): the mapping rule of rosgraph_msgs/msg/Log names the field \
                    \"header.stmp\", which it does not have: did you mean `header.stamp`?";
        assert_eq!(wrong, [said]);
        assert!(no_ros2[0].contains("nowhere/msg/Log"), "{no_ros2:?}");
        assert!(no_ros1[0].contains("nobody_has/Log of ROS 1 is defined nowhere"), "{no_ros1:?}");
    }

    #[test]
    fn fields_of_services_are_looked_at_too() {
        let rules = r#"[{"ros1_package_name": "std_srvs", "ros1_service_name": "SetBool",
            "ros2_package_name": "std_srvs", "ros2_service_name": "SetBool",
            "response_fields_1_to_2": {"success": "sucess"}}]"#;
        let mut types = Types::new(serde_json::from_str(rules).unwrap(), TypeStore::empty());
        let mut ros2 = TypeStore::empty();
        let name = TypeName::parse(Dialect::Ros2, "std_srvs/srv/SetBool").unwrap();
        ros2.add_definition(&name, "bool data\n---\nbool success\nstring message\n").unwrap();
        let found = types.check_rules(&mut ros2);
        assert!(found[0].contains("\"sucess\"") && found[0].contains("`success`"), "{found:?}");
    }
}
