//! Parameter files.
//!
//! ```text
//!   /ns:                 names, joined by slashes, down to
//!     talker:
//!       ros__parameters: the parameters of /ns/talker:
//!         a: 1           a
//!         group:
//!           x: 2.5       group.x
//! ```

use super::super::error::{ParamsFileError, YamlError};
use super::yaml::{Events, Item, MAX_DEPTH, Origin, RawScalar};
use super::{MAX_NAME_BYTES, Overrides};
use crate::name::{absolute, check_namespace, check_node_name};

/// Largest parameter file in bytes.
pub const MAX_FILE_BYTES: usize = 1024 * 1024;
/// The key that separates names of nodes from names of parameters.
const PARAMETERS_KEY: &str = "ros__parameters";

impl Overrides {
    /// Takes in a parameter file.
    pub(in super::super) fn add_file(&mut self, content: &[u8]) -> Result<(), ParamsFileError> {
        if content.len() > MAX_FILE_BYTES {
            return Err(ParamsFileError::TooLarge(MAX_FILE_BYTES));
        }
        let text = std::str::from_utf8(content)
            .map_err(|error| ParamsFileError::NotUtf8(error.valid_up_to()))?;
        Ok(read(text.trim_start_matches('\u{feff}'), self)?)
    }
}

/// Takes in all documents of a file.
fn read(text: &str, overrides: &mut Overrides) -> Result<(), YamlError> {
    let mut reader = Reader { events: Events::new(text, Origin::File), overrides };
    loop {
        match reader.events.next()? {
            Item::End => return Ok(()),
            Item::MappingStart(_) => reader.nodes("", 1)?,
            Item::Scalar(scalar) => {
                scalar.key()?;
                return Err(YamlError::ValueBeforeParameters(scalar.line));
            }
            Item::SequenceStart(line) => return Err(YamlError::SequenceAsKey(line)),
            other => return Err(reader.events.unknown(&other)),
        }
    }
}

struct Reader<'a, 'o> {
    events: Events<'a>,
    overrides: &'o mut Overrides,
}

impl Reader<'_, '_> {
    /// Reads a mapping above `ros__parameters`; its keys are names below `path`.
    fn nodes(&mut self, path: &str, depth: usize) -> Result<(), YamlError> {
        while let Some(key) = self.key(depth)? {
            let name = key.key()?;
            if name == PARAMETERS_KEY {
                if path.is_empty() {
                    return Err(YamlError::NoNodeName(key.line));
                }
                check_pattern(path)?;
                self.node_parameters(path, depth)?;
                continue;
            }
            let slash = if path.is_empty() || path.ends_with('/') { "" } else { "/" };
            let below = bounded(format!("{path}{slash}{name}"))?;
            match self.events.next()? {
                Item::MappingStart(_) => self.nodes(&below, depth + 1)?,
                Item::Scalar(value) => return Err(YamlError::ValueBeforeParameters(value.line)),
                Item::SequenceStart(line) => {
                    return Err(YamlError::SequenceBeforeParameters(line));
                }
                other => return Err(self.events.unknown(&other)),
            }
        }
        Ok(())
    }

    /// Reads the parameters behind `ros__parameters`.
    fn node_parameters(&mut self, pattern: &str, depth: usize) -> Result<(), YamlError> {
        let node = self.overrides.begin_node(pattern)?;
        match self.events.next()? {
            Item::MappingStart(_) => self.parameters(node, "", depth + 1),
            Item::Scalar(value) => Err(YamlError::ValueBeforeParameters(value.line)),
            Item::SequenceStart(line) => Err(YamlError::SequenceBeforeParameters(line)),
            other => Err(self.events.unknown(&other)),
        }
    }

    /// Reads a mapping below `ros__parameters`; `group` is the start of its names.
    fn parameters(&mut self, node: usize, group: &str, depth: usize) -> Result<(), YamlError> {
        while let Some(key) = self.key(depth)? {
            let name = key.key()?;
            let dot = if group.is_empty() { "" } else { "." };
            let name = bounded(format!("{group}{dot}{name}"))?;
            match self.events.next()? {
                Item::MappingStart(_) => self.parameters(node, &name, depth + 1)?,
                first => {
                    let value = self.events.value(first)?;
                    self.overrides.push(node, &name, value)?;
                }
            }
        }
        Ok(())
    }

    /// Reads the next key of a mapping; `None` at its end.
    fn key(&mut self, depth: usize) -> Result<Option<RawScalar>, YamlError> {
        match self.events.next()? {
            Item::Scalar(key) if depth > MAX_DEPTH => {
                Err(YamlError::TooDeep { max: MAX_DEPTH, line: key.line })
            }
            Item::Scalar(key) => Ok(Some(key)),
            Item::MappingEnd => Ok(None),
            Item::SequenceStart(line) => Err(YamlError::SequenceAsKey(line)),
            other => Err(self.events.unknown(&other)),
        }
    }
}

fn bounded(name: String) -> Result<String, YamlError> {
    if name.len() > MAX_NAME_BYTES {
        return Err(YamlError::NameTooLong(MAX_NAME_BYTES));
    }
    Ok(name)
}

/// Checks the name of a node in a file: parts are names, `*` or `**`.
fn check_pattern(pattern: &str) -> Result<(), YamlError> {
    let pattern = absolute(pattern);
    let (namespace, node) = pattern.rsplit_once('/').unwrap_or(("", &pattern));
    if !is_wildcard(node) {
        check_node_name(node)?;
    }
    for part in namespace.split('/').skip(1).filter(|part| !is_wildcard(part)) {
        if part.is_empty() {
            return Err(YamlError::RepeatedSlash(format!("{namespace}/")));
        }
        check_namespace(&format!("/{part}"))?;
    }
    Ok(())
}

fn is_wildcard(part: &str) -> bool {
    matches!(part, "*" | "**")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ParameterValue;

    fn error(text: &str) -> String {
        read(text, &mut Overrides::default()).unwrap_err().to_string()
    }

    #[test]
    fn shapes_that_are_no_parameters_say_where() {
        for (text, expected) in [
            ("- 1\n", "Sequences cannot be key at line 1"),
            ("text\n", "Cannot have a value before ros__parameters at line 1"),
            ("ros__parameters: {}\n", "There are no node names before ros__parameters at line 1"),
            ("a:\n  ros__parameters:\n", "Cannot have a value before ros__parameters at line 2"),
            ("a: [1]\n", "Sequences can only be values and not keys in params. Error at line 1"),
            ("a: {ros__parameters: {b: *c}}\n", "Will not support aliasing at line 1"),
            ("a: {ros__parameters: {b: [{c: 1}]}}\n", "Unknown YAML event at line 1"),
            ("a: {ros__parameters: {? [b] : 1}}\n", "Sequences cannot be key at line 1"),
            ("a: {ros__parameters: {? : 1}}\n", "No key at line 1"),
            (
                "a b: {ros__parameters: {}}\n",
                "node name must not contain characters other than alphanumerics or '_'",
            ),
            ("/a//b: {ros__parameters: {}}\n", "/a// contains repeated forward slash"),
            (
                "/a*/b: {ros__parameters: {}}\n",
                "namespace must not contain characters other than alphanumerics, '_', or '/'",
            ),
        ] {
            assert_eq!(error(text), expected, "{text}");
        }
    }

    #[test]
    fn an_absent_value_is_not_a_tilde() {
        let mut overrides = Overrides::default();
        read("a: {ros__parameters: {b: ~, c: '~', d: ''}}\n", &mut overrides).unwrap();
        let found = overrides.for_node("/a");
        assert_eq!(found.get("b"), Some(&ParameterValue::String("~".into())));
        assert_eq!(found.get("c"), Some(&ParameterValue::String("~".into())));
        assert_eq!(found.get("d"), Some(&ParameterValue::String(String::new())));
        for text in ["b: ", "b: {c: , d: 1}", "b: !!str", "b: [1, ]\n    c: []\n    d:", "b: &x "] {
            let text = format!("a:\n  ros__parameters:\n    {text}\n");
            let error = error(&text);
            assert!(error.starts_with("No value at line "), "{text}{error}");
        }
    }

    #[test]
    fn nesting_has_a_floor() {
        let deep = format!("a: {{ros__parameters: {}1{}}}", "{b: ".repeat(90), "}".repeat(90));
        assert_eq!(error(&deep), "nested deeper than 64 at line 1");
        // The YAML parser reads ahead, and refuses so many open lists itself.
        let list = format!("a: {{ros__parameters: {{b: {}}}}}", "[".repeat(90));
        assert_eq!(error(&list), "Error parsing a event near line 1");
        let mut block = String::from("a:\n ros__parameters:\n");
        for depth in 2..60 {
            block.push_str(&format!("{}b:\n", " ".repeat(depth)));
        }
        block.push_str(&format!("{}c: {}1{}", " ".repeat(60), "{d: ".repeat(20), "}".repeat(20)));
        assert_eq!(error(&block), "nested deeper than 64 at line 61");
    }
}
