//! Faults of a configuration file, each with its place and the remedy.

use std::fmt;

use wrapyfi_data::did_you_mean;

/// All faults of a configuration, in the order of their lines. The file is refused as a whole.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConfigError {
    /// File name as given.
    pub file: String,
    /// Faults, at least one.
    pub problems: Vec<Problem>,
}

/// One fault.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Line and column, from 1; `None` for a fault of the whole file.
    pub position: Option<(u64, u64)>,
    /// Fault and remedy.
    pub message: String,
}

/// Example of a value by its key.
pub(super) type Examples<'a> = &'a dyn Fn(&str) -> Option<&'static str>;

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, problem) in self.problems.iter().enumerate() {
            if index > 0 {
                writeln!(f)?;
            }
            match problem.position {
                Some((line, column)) => {
                    write!(f, "{}:{line}:{column}: {}", self.file, problem.message)?;
                }
                None => write!(f, "{}: {}", self.file, problem.message)?,
            }
        }
        Ok(())
    }
}

impl std::error::Error for ConfigError {}

impl Problem {
    /// A fault at a place that a [`Spanned`](super::Spanned) value remembers.
    #[must_use]
    pub fn at(location: serde_saphyr::Location, message: String) -> Self {
        Self { position: Some((location.line(), location.column())), message }
    }
}

impl ConfigError {
    /// Error of a file that is longer than the limit, in bytes.
    #[must_use]
    pub fn too_large(file: &str, actual: usize, limit: usize) -> Self {
        let message = format!("configuration is {actual} bytes long, the limit is {limit}");
        Self { file: file.to_owned(), problems: vec![Problem { position: None, message }] }
    }

    /// The parser's error in a user's words: keys instead of fields, with a suggestion.
    pub fn from_yaml(file: &str, text: &str, error: &serde_saphyr::Error) -> Self {
        Self::with_examples(file, text, error, &|_| None)
    }

    /// As [`ConfigError::from_yaml`], with an example of what to write where the value of a key is of another kind.
    fn with_examples(
        file: &str,
        text: &str,
        error: &serde_saphyr::Error,
        examples: Examples<'_>,
    ) -> Self {
        use serde_saphyr::Error;
        let error = error.without_snippet();
        let position = error.location().map(|at| (at.line(), at.column()));
        let key = position.and_then(|position| Entry::at(text, position)).map(|entry| entry.key);
        let is_of_key =
            !matches!(error, Error::SerdeUnknownField { .. } | Error::SerdeMissingField { .. });
        let message = match error {
            Error::SerdeUnknownField { field, expected, .. } => {
                let hint = did_you_mean(field, expected);
                format!("unknown key `{field}`; {hint}keys here: {}", expected.join(", "))
            }
            Error::SerdeUnknownVariant { variant, expected, .. } => {
                let hint = did_you_mean(variant, expected);
                format!("unknown value `{variant}`; {hint}values here: {}", expected.join(", "))
            }
            Error::SerdeMissingField { field, .. } => format!("key `{field}` is missing"),
            Error::SerdeInvalidType { unexpected, expected, .. }
            | Error::SerdeInvalidValue { unexpected, expected, .. } => {
                format!("found {unexpected}, expected {expected}")
            }
            other => in_words(&other.render()),
        };
        // The text of the line helps more than its number.
        let line = position
            .and_then(|position| line_of(text, position))
            .map(|line| format!(", in `{}`", line.trim().chars().take(80).collect::<String>()))
            .unwrap_or_default();
        let example = key.filter(|_| is_of_key).and_then(|key| Some((key, examples(key)?)));
        let example = example
            .map(|(key, value)| format!("; write for example `{key}: {value}`"))
            .unwrap_or_default();
        let message = format!("{message}{example}{line}");
        Self { file: file.to_owned(), problems: vec![Problem { position, message }] }
    }
}

impl ConfigError {
    /// Most faults that are told at once.
    const MOST: usize = 20;

    /// All faults that ended the reading of a text: those behind the first are found by reading `again` without the
    /// entries that were wrong.
    pub(super) fn all(
        file: &str,
        text: &str,
        first: &serde_saphyr::Error,
        again: impl Fn(&str) -> Option<serde_saphyr::Error>,
        examples: Examples<'_>,
    ) -> Self {
        let mut all = Self::with_examples(file, text, first, examples);
        let mut rest = text.to_owned();
        while all.problems.len() < Self::MOST {
            let last = all.problems.last().and_then(|problem| problem.position);
            let Some(entry) = last.and_then(|position| Entry::at(&rest, position)) else { break };
            let (start, Some(length)) = (entry.start, entry.length) else { break };
            rest.replace_range(start..start + length, &" ".repeat(length));
            let Some(error) = again(&rest) else { break };
            let more = Self::with_examples(file, text, &error, examples).problems;
            // What is told about a place before, or about none, is the consequence of what was left out.
            let is_there = |problem: &Problem| {
                problem.position > last
                    && problem.position.is_some_and(|at| line_of(&rest, at).is_some())
            };
            if !more.iter().all(is_there) {
                break;
            }
            all.problems.extend(more);
        }
        all
    }
}

/// The line at a position.
fn line_of(text: &str, (line, _): (u64, u64)) -> Option<&str> {
    text.lines().nth(usize::try_from(line).ok()?.checked_sub(1)?)
}

/// An entry `key: value`.
struct Entry<'t> {
    key: &'t str,
    /// Byte of the file at which it begins.
    start: usize,
    /// Number of its bytes, in braces with the comma behind it; `None` where it has more lines or its end is not plain.
    length: Option<usize>,
}

impl<'t> Entry<'t> {
    /// The entry that has its key or its value at a line and column.
    fn at(text: &'t str, (line, column): (u64, u64)) -> Option<Self> {
        let (line, column) = (usize::try_from(line).ok()?, usize::try_from(column).ok()?);
        let above = text.split_inclusive('\n').take(line.checked_sub(1)?);
        let start: usize = above.map(str::len).sum();
        let mut lines = text.get(start..)?.lines();
        let line = lines.next()?;
        let at = line.char_indices().nth(column.checked_sub(1)?).map_or(line.len(), |(at, _)| at);
        let before = line.get(..at)?.trim_end();
        let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
        let begin = match before.strip_suffix(':') {
            Some(key) => key.trim_end_matches(is_word).len(),
            None => at,
        };
        let entry = line.get(begin..)?;
        let (key, value) = entry.split_once(':')?;
        let is_key = !key.is_empty() && key.chars().all(is_word);
        if !is_key || !(value.is_empty() || value.starts_with(' ')) {
            return None;
        }
        let next = lines.find(|line| !line.trim().is_empty()).unwrap_or_default();
        let length = length(line.get(..begin)?, entry, next);
        Some(Self { key, start: start + begin, length })
    }
}

/// Length of an entry with the line before it and the next line that is not empty.
fn length(before: &str, entry: &str, next: &str) -> Option<usize> {
    let end = if before.trim_end().ends_with(['{', ',']) {
        let end = entry.find([',', '}'])?;
        end + usize::from(entry.get(end..)?.starts_with(','))
    } else {
        let indent = next.len() - next.trim_start().len();
        let is_first_of_many = before.trim_end().ends_with('-');
        if indent > before.len() || (is_first_of_many && indent != before.len()) {
            return None;
        }
        entry.len()
    };
    // A list or a text in quotes may have a comma or a line break inside.
    let is_plain = !entry.get(..end)?.contains(['[', '{', '"', '\'', '|', '>']);
    is_plain.then_some(end)
}

/// Example of a value that a key of routes, limits or the whole file may have.
pub(super) fn example(key: &str) -> Option<&'static str> {
    Some(match key {
        "page" => "{ port: 8642 }",
        "limits" => "{ waiting_mib: 1024 }",
        "defaults" => "{ queue_depth: 10 }",
        "hosts" => "{ robot-base: 192.168.1.7 }",
        "definitions" => "[interfaces]",
        "allow" | "deny" => "[\"/camera/.*\"]",
        "options" => "{ carrier: udp }",
        "overflow" => "{ block_ms: 100 }",
        "qos" => "sensor_data",
        "stamp" => "source",
        "timeout_ms" => "5000",
        "block_ms" => "100",
        "queue_depth" | "depth" => "10",
        "max_rate_hz" => "30",
        "max_message_mib" => "64",
        "max_routes" => "1000",
        "port" => "8642",
        "lazy" | "merge" | "loop_guard" | "default_deny" => "true",
        _ => return None,
    })
}

/// The parser's first line without its position, and without Rust's names for numbers.
fn in_words(text: &str) -> String {
    let text = text.lines().next().unwrap_or_default();
    let text = text.split_once(" at line ").map_or(text, |(text, _)| text);
    match text {
        "invalid u16" => "expected a whole number from 0 to 65535".to_owned(),
        "invalid u32" | "invalid u64" | "invalid usize" => "expected a whole number".to_owned(),
        "invalid f64" | "invalid float" | "invalid floating point" => {
            "expected a number".to_owned()
        }
        "invalid boolean" => "expected true or false".to_owned(),
        "expected mapping start" => "expected keys with values".to_owned(),
        "expected sequence start" => "expected a list".to_owned(),
        _ => text.to_owned(),
    }
}
