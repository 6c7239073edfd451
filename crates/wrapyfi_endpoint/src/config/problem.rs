//! Faults of a configuration, each with its place and the remedy.

use wrapyfi_data::did_you_mean;

/// Largest configuration file, in bytes.
pub const MAX_CONFIG_BYTES: usize = 1 << 20;

/// All faults of a configuration, in the order of their lines. The file is refused as a whole.
///
/// ```
/// use wrapyfi_endpoint::config::Reading;
/// let ports = Reading::<Vec<u16>>::new("- 5555\n- many\n", &|_| None);
/// let error = ports.whole("ports.yaml").unwrap_err();
/// assert_eq!(error.problems[0].position, Some((2, 3)));
/// assert!(error.to_string().starts_with("ports.yaml:2:3: "), "{error}");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}", lines(.file, .problems))]
pub struct ConfigError {
    /// File name as given.
    pub file: String,
    /// Faults, at least one.
    pub problems: Vec<Problem>,
}

/// One fault.
///
/// See [`ConfigError`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Line and column, from 1; `None` for a fault of the whole file.
    pub position: Option<(u64, u64)>,
    /// Fault and remedy.
    pub message: String,
}

/// Example of a value by its key.
pub type Examples<'a> = &'a dyn Fn(&str) -> Option<&'static str>;

/// A line for each problem, with its place.
fn lines(file: &str, problems: &[Problem]) -> String {
    let line = |problem: &Problem| match problem.position {
        Some((line, column)) => format!("{file}:{line}:{column}: {}", problem.message),
        None => format!("{file}: {}", problem.message),
    };
    problems.iter().map(line).collect::<Vec<_>>().join("\n")
}

impl Problem {
    /// A fault at a place that a [`Spanned`](super::Spanned) value remembers; one that stands in no file has none.
    #[must_use]
    pub fn at(location: serde_saphyr::Location, message: String) -> Self {
        let position = Some((location.line(), location.column())).filter(|(line, _)| *line > 0);
        Self { position, message }
    }

    /// Fault of a configuration that is longer than [`MAX_CONFIG_BYTES`].
    pub fn too_large(bytes: usize) -> Self {
        let message =
            format!("configuration is {bytes} bytes long, the limit is {MAX_CONFIG_BYTES}");
        Self { position: None, message }
    }

    /// The parser's error in a user's words: keys instead of fields, with a suggestion, and with an example of what to
    /// write where the value of `key` is of another kind.
    pub(super) fn read(
        text: &str,
        error: &serde_saphyr::Error,
        key: Option<&str>,
        examples: Examples<'_>,
    ) -> Self {
        use serde_saphyr::Error;
        let error = error.without_snippet();
        let position = error.location().map(|at| (at.line(), at.column()));
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
            Error::DuplicateMappingKey { key: Some(key), .. } => {
                format!("key `{key}` is given twice: leave one of them out")
            }
            Error::MultipleDocuments { .. } => {
                "a second document begins here, and a configuration is one: leave out the line `---` or `...` \
                 above it"
                    .to_owned()
            }
            Error::SerdeInvalidType { unexpected, expected, .. }
            | Error::SerdeInvalidValue { unexpected, expected, .. } => {
                // What the reader calls a value whose place it remembers.
                match expected.contains("span-aware") {
                    true => format!("{unexpected} is no value of this key"),
                    false => format!("found {unexpected}, expected {expected}"),
                }
            }
            other => in_words(other),
        };
        let line = position
            .and_then(|(line, _)| text.lines().nth(usize::try_from(line).ok()?.checked_sub(1)?))
            .map(str::trim)
            .filter(|line| !line.is_empty());
        let message = match line {
            Some(line) if line.contains("!!binary") => {
                "`!!binary` has no place in a configuration: write the text itself".to_owned()
            }
            _ => message,
        };
        // The text of the line helps more than its number.
        let line = line
            .map(|line| format!(", in `{}`", line.chars().take(80).collect::<String>()))
            .unwrap_or_default();
        let example = key
            .filter(|_| is_of_key)
            .and_then(|key| Some(format!("; write for example `{key}: {}`", examples(key)?)))
            .unwrap_or_default();
        Self { position, message: format!("{message}{example}{line}") }
    }
}

/// The parser's first line without its position, and without its names for what a user writes.
fn in_words(error: &serde_saphyr::Error) -> String {
    use serde_saphyr::Error;
    let text = match error {
        Error::Eof { .. } => {
            return format!(
                "no configuration is written here; the shortest one is `routes: {}`",
                "[{ from: \"zeromq:/a\", to: \"ros2:/a\", type: Text }]"
            );
        }
        Error::RecursiveReferencesRequireWeakTypes { .. } => {
            return "the value contains itself: `*` may name only what ends before it".to_owned();
        }
        Error::UnknownAnchor { .. } => {
            return "`*` names a value that nothing above it names with `&`".to_owned();
        }
        Error::TaggedScalarCannotDeserializeIntoString { .. } | Error::UnsupportedTag { .. } => {
            return "a tag (`!`) has no place in a configuration: write the value without it"
                .to_owned();
        }
        Error::Unexpected { expected: "string scalar", .. } => "expected a text".to_owned(),
        other => other.render_with_formatter(&serde_saphyr::UserMessageFormatter),
    };
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
        "recursion limit exceeded" => "lists and keys stand too deep inside each other".to_owned(),
        _ => text.to_owned(),
    }
}
