//! `-p name:=value` and `-p node:name:=value`; the value is YAML.

use std::error::Error;

use super::super::error::RuleError;
use super::super::rule::{Rule, check_parameter};
use super::Overrides;
use super::yaml::{Events, Origin};

/// Takes in one rule.
pub(in super::super) fn parse_rule(
    text: &str,
    overrides: &mut Overrides,
) -> Result<(), Box<dyn Error + Send + Sync>> {
    let Rule { node, left, right } = Rule::cut(text)?;
    check_parameter(left)?;
    if right.is_empty() {
        return Err(RuleError::Missing.into());
    }
    let value = Events::new(right, Origin::CommandLine).whole_value()?;
    let node = overrides.begin_node(node.unwrap_or("/**"))?;
    overrides.push(node, left, value)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Overrides, String> {
        let mut overrides = Overrides::default();
        parse_rule(text, &mut overrides).map_err(|error| error.to_string())?;
        Ok(overrides)
    }

    #[test]
    fn names_have_dots_and_slashes() {
        let overrides = parse("n:qos_overrides./parameter_events.depth:=1").unwrap();
        let found = overrides.for_node("/n");
        assert_eq!(found.keys().collect::<Vec<_>>(), ["qos_overrides./parameter_events.depth"]);
        assert_eq!(parse("*:=1").unwrap_err(), "Wildcard '*' is not implemented");
        assert!(parse("a b:=1").unwrap_err().starts_with("\"a b\" is no name"));
    }

    #[test]
    fn values_are_scalars_or_flat_lists() {
        for text in ["a:=[[1]]", "a:=[{b: 1}]", "a:=b: 1", "a:=*b", "a:=[*b]"] {
            assert_eq!(parse(text).unwrap_err(), "Unknown YAML event", "{text}");
        }
        assert_eq!(parse("a:=[1").unwrap_err(), "Error parsing an event");
        let blank = parse("a:= ").unwrap();
        assert_eq!(
            blank.for_node("/x").values().collect::<Vec<_>>(),
            [&crate::ParameterValue::NotSet]
        );
    }
}
