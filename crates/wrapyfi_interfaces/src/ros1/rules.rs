//! Rules by which types and fields of the two ROS belong together.
//!
//! ```text
//!   the user's rules  ─▶  built-in rules  ─▶  the same name  ─▶  demo_msgs ↔ demo_interfaces
//! ```
//!
//! Rules are written as `ros1_bridge` reads them, so that its files can be used as they are:
//!
//! ```yaml
//! - ros1_package_name: demo_msgs        # a package: types of the same names
//!   ros2_package_name: demo_interfaces
//! - ros1_package_name: demo_msgs        # a message, with its fields
//!   ros1_message_name: Reading
//!   ros2_package_name: demo_interfaces
//!   ros2_message_name: Sample
//!   fields_1_to_2: { header.stamp: stamp, Value: value }
//! ```

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde::Deserialize;

use super::names::{allowed_in_ros2, interfaces_package, msgs_package, renamed};
use crate::parser::{Dialect, InterfaceKind, TypeName};

/// Rules for pairs of types: the user's, then our own.
///
/// ```
/// use wrapyfi_interfaces::parser::{Dialect, TypeName};
/// use wrapyfi_interfaces::ros1::Rules;
/// let rules = r#"[{"ros1_package_name": "demo_msgs", "ros2_package_name": "lab_interfaces"}]"#;
/// let rules: Rules = serde_json::from_str(rules).unwrap();
/// let name = TypeName::parse(Dialect::Ros1, "demo_msgs/Reading").unwrap();
/// assert_eq!(rules.ros2_names(&name)[0].to_string(), "lab_interfaces/msg/Reading");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize)]
#[serde(try_from = "Vec<Rule>")]
pub struct Rules {
    rules: Vec<Rule>,
}

/// One entry of a file of rules.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Rule {
    ros1_package_name: String,
    ros2_package_name: String,
    ros1_message_name: Option<String>,
    ros2_message_name: Option<String>,
    ros1_service_name: Option<String>,
    ros2_service_name: Option<String>,
    ros1_action_name: Option<String>,
    ros2_action_name: Option<String>,
    fields_1_to_2: Option<Fields>,
    request_fields_1_to_2: Option<Fields>,
    response_fields_1_to_2: Option<Fields>,
    goal_fields_1_to_2: Option<Fields>,
    result_fields_1_to_2: Option<Fields>,
    feedback_fields_1_to_2: Option<Fields>,
    /// Key of `ros1_bridge`, which allows rules outside the package they are about; ours always
    /// may.
    #[serde(rename = "enable_foreign_mappings")]
    _enable_foreign_mappings: Option<bool>,
    /// Ours: fields that `fields_1_to_2` does not name are matched by name all the same.
    #[serde(default)]
    match_other_fields: bool,
}

/// Paths of fields: in ROS 1, in ROS 2.
type Fields = BTreeMap<String, String>;

/// Error of a rule that contradicts itself.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: {reason}", place(*number, package))]
struct RuleError {
    /// Number of the rule, counted from 1.
    number: usize,
    /// ROS 1 package of the rule.
    package: String,
    /// Fault and remedy.
    reason: String,
}

fn place(number: usize, package: &str) -> String {
    format!("mapping rule {number} (of {package})")
}

impl TryFrom<Vec<Rule>> for Rules {
    type Error = RuleError;

    fn try_from(rules: Vec<Rule>) -> Result<Self, RuleError> {
        for (index, rule) in rules.iter().enumerate() {
            rule.check().map_err(|reason| RuleError {
                number: index + 1,
                package: rule.ros1_package_name.clone(),
                reason,
            })?;
        }
        Ok(Self { rules })
    }
}

/// Fields that a rule brings together.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct FieldRule {
    /// Paths in ROS 1 and in ROS 2.
    pub(super) pairs: Vec<(String, String)>,
    /// True when other fields are matched by name.
    pub(super) others: bool,
}

/// Rules for types that were moved or renamed on the way to ROS 2, and for Wrapyfi's own, which it calls otherwise in
/// either ROS. Of several types of ROS 1 that became one of ROS 2, the first is taken on the way back.
static BUILT_IN: LazyLock<Rules> = LazyLock::new(|| {
    let rules = serde_json::from_str(include_str!("standard/rules.json"));
    debug_assert!(rules.is_ok(), "{rules:?}");
    rules.unwrap_or_default()
});

impl Rules {
    /// Rules that are built in, without any of the user's.
    pub fn built_in() -> Self {
        Self::default()
    }

    /// Adds rules that come behind those that are there.
    #[must_use]
    pub fn then(mut self, other: Self) -> Self {
        self.rules.extend(other.rules);
        self
    }

    /// Names that a ROS 1 type may have in ROS 2, the likeliest first. The last but one is the same
    /// name, the last that of a package in `_interfaces`, where the package is in `_msgs`.
    pub fn ros2_names(&self, ros1: &TypeName) -> Vec<TypeName> {
        let names = self.by_rank().filter_map(|rule| rule.ros2_name(ros1));
        let same = allowed_in_ros2(ros1);
        let interfaces = same.as_ref().and_then(interfaces_package);
        unique(names.chain(same).chain(interfaces))
    }

    /// Names that a ROS 2 type may have in ROS 1, the likeliest first.
    pub fn ros1_names(&self, ros2: &TypeName) -> Vec<TypeName> {
        let names = self.by_rank().filter_map(|rule| rule.ros1_name(ros2));
        unique(names.chain(Some(ros2.clone())).chain(msgs_package(ros2)))
    }

    /// True when the two are names of one type.
    pub(super) fn are_counterparts(&self, ros1: &TypeName, ros2: &TypeName) -> bool {
        self.ros2_names(ros1).contains(ros2) || self.ros1_names(ros2).contains(ros1)
    }

    /// Fields of the two that belong together, where a rule says so.
    pub(super) fn fields(&self, ros1: &TypeName, ros2: &TypeName) -> Option<FieldRule> {
        let rules = self.rules.iter().chain(&BUILT_IN.rules);
        rules
            .filter(|rule| rule.ros2_name(ros1).as_ref() == Some(ros2))
            .find_map(|rule| rule.field_rule(ros1))
    }

    /// Types of ROS 1 and ROS 2 that the user's rules name, each with the number and package of its rule.
    pub(super) fn named_pairs(&self) -> Vec<(String, TypeName, TypeName)> {
        let named = |(index, rule): (usize, &Rule)| {
            let one = &rule.ros1_package_name;
            let kinds = [InterfaceKind::Message, InterfaceKind::Service, InterfaceKind::Action];
            let (kind, names) = kinds.into_iter().find_map(|kind| {
                let (one, two) = rule.names(kind);
                Some((kind, (one.as_ref()?, two.as_ref()?)))
            })?;
            let of =
                |dialect, package, name| TypeName::with_kind(dialect, package, kind, name).ok();
            let ros1 = of(Dialect::Ros1, one, names.0)?;
            let ros2 = of(Dialect::Ros2, &rule.ros2_package_name, names.1)?;
            Some((place(index + 1, one), ros1, ros2))
        };
        self.rules.iter().enumerate().filter_map(named).collect()
    }

    /// Rules with the likeliest first: of the user for one type, of the user for a package, built-in ones.
    fn by_rank(&self) -> impl Iterator<Item = &Rule> {
        let by_user = |whole| self.rules.iter().filter(move |rule| rule.is_of_type() == whole);
        by_user(true).chain(by_user(false)).chain(&BUILT_IN.rules)
    }
}

fn unique(names: impl Iterator<Item = TypeName>) -> Vec<TypeName> {
    let mut unique = Vec::new();
    for name in names {
        if !unique.contains(&name) {
            unique.push(name);
        }
    }
    unique
}

impl Rule {
    fn check(&self) -> Result<(), String> {
        self.check_keys()?;
        let named = |key: &str, name: Option<&str>, is_name: &dyn Fn(&str) -> bool| match name {
            Some(name) if !is_name(name) => Err(format!(
                "{key} is {name:?}, which no type can have: the rule would have no effect"
            )),
            _ => Ok(()),
        };
        for (dialect, package_key, package, types) in [
            (
                Dialect::Ros1,
                "ros1_package_name",
                &self.ros1_package_name,
                [
                    ("ros1_message_name", &self.ros1_message_name),
                    ("ros1_service_name", &self.ros1_service_name),
                    ("ros1_action_name", &self.ros1_action_name),
                ],
            ),
            (
                Dialect::Ros2,
                "ros2_package_name",
                &self.ros2_package_name,
                [
                    ("ros2_message_name", &self.ros2_message_name),
                    ("ros2_service_name", &self.ros2_service_name),
                    ("ros2_action_name", &self.ros2_action_name),
                ],
            ),
        ] {
            let is_name = |package: &str, name: &str| {
                let is_plain = !package.contains('/') && !name.contains('/');
                let kind = if dialect == Dialect::Ros2 { "/msg" } else { "" };
                is_plain && TypeName::parse(dialect, &format!("{package}{kind}/{name}")).is_ok()
            };
            named(package_key, Some(package), &|package| is_name(package, "Name"))?;
            for (key, name) in types {
                named(key, name.as_deref(), &|name| is_name("package", name))?;
            }
        }
        Ok(())
    }

    /// Checks that the keys belong together.
    fn check_keys(&self) -> Result<(), &'static str> {
        let names = |one: &Option<String>, two: &Option<String>| one.is_some() == two.is_some();
        if !names(&self.ros1_message_name, &self.ros2_message_name) {
            return Err("ros1_message_name and ros2_message_name go together; give both");
        }
        if !names(&self.ros1_service_name, &self.ros2_service_name) {
            return Err("ros1_service_name and ros2_service_name go together; give both");
        }
        if !names(&self.ros1_action_name, &self.ros2_action_name) {
            return Err("ros1_action_name and ros2_action_name go together; give both");
        }
        let named = [&self.ros1_message_name, &self.ros1_service_name, &self.ros1_action_name];
        if named.iter().filter(|name| name.is_some()).count() > 1 {
            return Err("it names two of a message, a service and an action; make two rules of it");
        }
        if self.fields_1_to_2.is_some() && self.ros1_message_name.is_none() {
            return Err("fields_1_to_2 needs ros1_message_name and ros2_message_name");
        }
        let of_parts = [&self.request_fields_1_to_2, &self.response_fields_1_to_2];
        if of_parts.iter().any(|fields| fields.is_some()) && self.ros1_service_name.is_none() {
            return Err("request_fields_1_to_2 and response_fields_1_to_2 need ros1_service_name \
                        and ros2_service_name");
        }
        let of_parts =
            [&self.goal_fields_1_to_2, &self.result_fields_1_to_2, &self.feedback_fields_1_to_2];
        if of_parts.iter().any(|fields| fields.is_some()) && self.ros1_action_name.is_none() {
            return Err(
                "goal_fields_1_to_2, result_fields_1_to_2 and feedback_fields_1_to_2 need \
                        ros1_action_name and ros2_action_name",
            );
        }
        Ok(())
    }

    /// True when the rule is about one type, not a package.
    fn is_of_type(&self) -> bool {
        let named = [&self.ros1_message_name, &self.ros1_service_name, &self.ros1_action_name];
        named.iter().any(|name| name.is_some())
    }

    /// Names of the type that the rule is about, in ROS 1 and in ROS 2, where it is of that kind.
    fn names(&self, kind: InterfaceKind) -> (&Option<String>, &Option<String>) {
        match kind {
            InterfaceKind::Message => (&self.ros1_message_name, &self.ros2_message_name),
            InterfaceKind::Service => (&self.ros1_service_name, &self.ros2_service_name),
            InterfaceKind::Action => (&self.ros1_action_name, &self.ros2_action_name),
        }
    }

    /// Names of the definition files, where the rule is about types of that kind. A rule about a
    /// package is about all of its types.
    fn stems<'s>(&'s self, kind: InterfaceKind, stem: &'s str) -> Option<(&'s str, &'s str)> {
        match self.names(kind) {
            (Some(one), Some(two)) => Some((one, two)),
            _ if self.is_of_type() => None,
            _ => Some((stem, stem)),
        }
    }

    fn ros2_name(&self, ros1: &TypeName) -> Option<TypeName> {
        let (one, two) = self.stems(ros1.kind(), ros1.file_stem())?;
        (ros1.package() == self.ros1_package_name && ros1.file_stem() == one)
            .then(|| renamed(ros1, Dialect::Ros2, &self.ros2_package_name, two))?
    }

    fn ros1_name(&self, ros2: &TypeName) -> Option<TypeName> {
        let (one, two) = self.stems(ros2.kind(), ros2.file_stem())?;
        (ros2.package() == self.ros2_package_name && ros2.file_stem() == two)
            .then(|| renamed(ros2, Dialect::Ros1, &self.ros1_package_name, one))?
    }

    fn field_rule(&self, ros1: &TypeName) -> Option<FieldRule> {
        let fields = match ros1.name().strip_prefix(ros1.file_stem()) {
            Some("_Request") => &self.request_fields_1_to_2,
            Some("_Response") => &self.response_fields_1_to_2,
            Some("_Goal") => &self.goal_fields_1_to_2,
            Some("_Result") => &self.result_fields_1_to_2,
            Some("_Feedback") => &self.feedback_fields_1_to_2,
            _ => &self.fields_1_to_2,
        };
        let pairs = fields.as_ref()?.iter().map(|(one, two)| (one.clone(), two.clone()));
        Some(FieldRule { pairs: pairs.collect(), others: self.match_other_fields })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rule_that_can_have_no_effect_is_refused_with_its_key() {
        let read = |one: &str, two: &str, names: &str| {
            let rule = format!(
                r#"[{{"ros1_package_name": "{one}", "ros2_package_name": "{two}"{names}}}]"#
            );
            serde_json::from_str::<Rules>(&rule).map_err(|error| error.to_string())
        };
        let names = |one: &str, two: &str| {
            format!(r#", "ros1_message_name": "{one}", "ros2_message_name": "{two}""#)
        };
        for (one, two, names, key) in [
            (
                "old_msgs/Thing",
                "new_msgs",
                String::new(),
                "ros1_package_name is \"old_msgs/Thing\"",
            ),
            ("old_msgs", "new-msgs", String::new(), "ros2_package_name is \"new-msgs\""),
            ("old_msgs", "", String::new(), "ros2_package_name is \"\""),
            ("old_msgs", "new_msgs", names("old_msgs/A", "B"), "ros1_message_name is"),
            ("old_msgs", "new_msgs", names("A", "msg/B"), "ros2_message_name is"),
            ("old_msgs", "new_msgs", names("A", ""), "ros2_message_name is"),
        ] {
            let fault = read(one, two, &names).unwrap_err();
            assert!(fault.contains(key) && fault.contains("no effect"), "{fault}");
        }
        assert!(read("old_msgs", "new_msgs", &names("tfMessage", "TFMessage")).is_ok());
    }
}
