//! Full definition texts: a type and all it refers to in one string, as ROS 1 publishers send it
//! in their connection header and MCAP files hold it (`ros1msg`, `ros2msg`).
//!
//! ```text
//!   Header header                 the type itself, without its name
//!   Pose pose
//!   ====================…         80 of them
//!   MSG: std_msgs/Header          every other type
//!   …
//! ```

use std::collections::BTreeMap;

use super::ResolveError;
use crate::parser::{Dialect, MessageDefinition, TypeName, parse_interface};

/// Fewest `=` in a row that separate two definitions.
const SEPARATOR: &str = "========";

/// All messages in a full definition text of `name`.
pub(super) fn parse_full(
    dialect: Dialect,
    name: &TypeName,
    text: &str,
) -> Result<BTreeMap<TypeName, MessageDefinition>, ResolveError> {
    ResolveError::check_size(name, text, "the sender's text is broken")?;
    let mut definitions = BTreeMap::new();
    let mut add = |name: &TypeName, text: &str, skipped: usize| {
        let messages = parse_interface(dialect, name, text).map_err(|mut source| {
            source.line += skipped;
            ResolveError::Parse {
                place: "full definition text".to_owned(),
                source: Box::new(source),
            }
        })?;
        definitions.extend(messages.into_iter().map(|message| (message.name.clone(), message)));
        Ok::<_, ResolveError>(())
    };
    let mut current = name.clone();
    let mut first = 0; // lines before the current definition
    let mut body = String::new();
    let mut lines = text.lines().enumerate().peekable();
    while let Some((index, line)) = lines.next() {
        let is_separator =
            line.starts_with(SEPARATOR) && line.trim_end().bytes().all(|byte| byte == b'=');
        if !is_separator {
            body.push_str(line);
            body.push('\n');
            continue;
        }
        add(&current, &body, first)?;
        body.clear();
        let Some((_, head)) = lines.next() else { return Ok(definitions) };
        current = head
            .strip_prefix("MSG:")
            .and_then(|name| TypeName::parse(dialect, name.trim()).ok())
            .ok_or_else(|| ResolveError::Separator {
                name: name.clone(),
                line: index + 2,
                text: head.trim().to_owned(),
            })?;
        first = index + 2;
    }
    add(&current, &body, first)?;
    Ok(definitions)
}

/// Name in ROS 1 of two messages of ROS 2.
pub(crate) fn ros1_builtin(name: &TypeName) -> Option<&'static str> {
    match (name.package(), name.name()) {
        ("builtin_interfaces", "Time") => Some("time"),
        ("builtin_interfaces", "Duration") => Some("duration"),
        _ => None,
    }
}
