//! `-p name:=value` and `-p node:name:=value`; the value is YAML.

use std::error::Error;

use super::super::error::RuleError;
use super::super::lexer::{Cursor, Lexeme};
use super::super::remap::match_token;
use super::Overrides;
use super::yaml::{Events, Origin};

/// Takes in one rule.
pub(in super::super) fn parse_rule(
    text: &str,
    overrides: &mut Overrides,
) -> Result<(), Box<dyn Error + Send + Sync>> {
    let mut cursor = Cursor::new(text);
    let pattern = cursor.node_prefix().unwrap_or("/**");
    let name = parameter_name(&mut cursor)?;
    cursor.expect(Lexeme::Separator)?;
    if cursor.rest().is_empty() {
        return Err(RuleError::NoReplacement.into());
    }
    let value = Events::new(cursor.rest(), Origin::CommandLine).whole_value()?;
    let node = overrides.begin_node(pattern)?;
    overrides.push(node, name, value)?;
    Ok(())
}

/// Words with dots between them; a word may have slashes, as in
/// `qos_overrides./parameter_events.publisher.depth`.
fn parameter_name<'a>(cursor: &mut Cursor<'a>) -> Result<&'a str, RuleError> {
    let start = cursor.rest();
    word(cursor)?;
    while cursor.peek() != Lexeme::Separator {
        cursor.expect(Lexeme::Dot)?;
        word(cursor)?;
    }
    Ok(cursor.since(start))
}

fn word(cursor: &mut Cursor<'_>) -> Result<(), RuleError> {
    if cursor.peek() != Lexeme::Slash {
        match_token(cursor)?;
    }
    while matches!(cursor.peek(), Lexeme::Token | Lexeme::Slash) {
        cursor.accept();
    }
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
        assert_eq!(parse(":=1").unwrap_err(), "Expecting token or wildcard");
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
