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
        use serde_saphyr::Error;
        let error = error.without_snippet();
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
        let position = error.location().map(|at| (at.line(), at.column()));
        // The text of the line helps more than its number.
        let line = position
            .and_then(|(line, _)| text.lines().nth(usize::try_from(line).ok()?.checked_sub(1)?))
            .map(|line| format!(", in `{}`", line.trim().chars().take(80).collect::<String>()))
            .unwrap_or_default();
        let message = format!("{message}{line}");
        Self { file: file.to_owned(), problems: vec![Problem { position, message }] }
    }
}

/// The parser's first line without its position, and without Rust's names for numbers.
fn in_words(text: &str) -> String {
    let text = text.lines().next().unwrap_or_default();
    let text = text.split_once(" at line ").map_or(text, |(text, _)| text);
    match text {
        "invalid u16" => "expected a whole number from 0 to 65535".to_owned(),
        "invalid u32" | "invalid u64" | "invalid usize" => "expected a whole number".to_owned(),
        "invalid f64" | "invalid float" => "expected a number".to_owned(),
        _ => text.to_owned(),
    }
}
