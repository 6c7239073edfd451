//! Options of a registered value, after `$` is replaced.

use std::collections::BTreeMap;
use std::fmt;

use crate::StartError;
use wrapyfi_data::types::Value;

/// The value of an option as written.
///
/// See [`Options`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Literal {
    /// `true` or `false`.
    Switch(bool),
    /// A whole number.
    Integer(i64),
    /// A number that is no integer.
    Float(f64),
    /// Text, or `$argument`.
    Text(&'static str),
    /// Options inside an option.
    Map(&'static [(&'static str, Literal)]),
}

/// The value of an option.
///
/// ```
/// use wrapyfi_endpoint::method::OptionValue;
/// assert_eq!(OptionValue::Text("tcp".into()).to_string(), "\"tcp\"");
/// assert_eq!(OptionValue::Nothing.to_string(), "None");
/// ```
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum OptionValue {
    /// `None` of an argument: as if the option were not written.
    Nothing,
    /// A value that is on or off.
    Switch(bool),
    /// A whole number.
    Integer(i64),
    /// A number that is no integer.
    Float(f64),
    /// Text.
    Text(String),
    /// Options inside an option.
    Map(Options),
}

impl fmt::Display for OptionValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing => f.write_str("None"),
            Self::Switch(value) => value.fmt(f),
            Self::Integer(value) => value.fmt(f),
            Self::Float(value) => value.fmt(f),
            Self::Text(value) => write!(f, "{value:?}"),
            Self::Map(_) => f.write_str("a map"),
        }
    }
}

impl OptionValue {
    /// Option of the value of an argument; `None` for values that are no option.
    pub fn from_value(value: &Value) -> Option<Self> {
        match value {
            Value::Null => Some(Self::Nothing),
            Value::Bool(value) => Some(Self::Switch(*value)),
            Value::Int(value) => Some(Self::Integer(*value)),
            Value::Float(value) => Some(Self::Float(*value)),
            Value::Str(text) => Some(Self::Text(text.clone())),
            Value::Map(map) => {
                let mut options = Options::default();
                for (key, value) in map.iter() {
                    options.0.insert(key.as_str()?.to_owned(), Self::from_value(value)?);
                }
                Some(Self::Map(options))
            }
            _ => None,
        }
    }

    /// Converts a literal, whose texts go through `replace`.
    ///
    /// # Errors
    /// As `replace`.
    pub fn from_literal<E>(
        literal: Literal,
        replace: &mut impl FnMut(&'static str) -> Result<Self, E>,
    ) -> Result<Self, E> {
        Ok(match literal {
            Literal::Switch(value) => Self::Switch(value),
            Literal::Integer(value) => Self::Integer(value),
            Literal::Float(value) => Self::Float(value),
            Literal::Text(text) => replace(text)?,
            Literal::Map(pairs) => Self::Map(Options::from_literals(pairs, replace)?),
        })
    }
}

/// Options by name.
///
/// ```
/// use wrapyfi_endpoint::method::{OptionValue, Options};
/// let options = Options::default()
///     .with("queue_size", OptionValue::Integer(5))
///     .with("should_wait", OptionValue::Switch(false));
/// assert_eq!(options.number::<u16>("queue_size"), Ok(Some(5)));
/// assert_eq!(options.text("carrier"), Ok(None)); // not written
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Options(BTreeMap<String, OptionValue>);

/// Error of an option with a value that it cannot have.
///
/// ```
/// use wrapyfi_endpoint::method::{OptionValue, Options};
/// let options = Options::default().with("should_wait", OptionValue::Integer(1));
/// let error = options.switch("should_wait").unwrap_err();
/// assert_eq!(error.to_string(), "option should_wait is 1, and should be true or false");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("option {name} is {found}, and should be {wanted}")]
pub struct OptionError {
    /// Name of the option.
    pub name: String,
    /// Value that was given.
    pub found: String,
    /// Values that the option may have.
    pub wanted: String,
}

impl From<OptionError> for StartError {
    fn from(error: OptionError) -> Self {
        Self::Option(error.to_string())
    }
}

impl OptionError {
    /// Error of the option `name`, which is `found` and should be what is `wanted`.
    pub fn new(name: &str, found: impl fmt::Display, wanted: impl Into<String>) -> Self {
        Self { name: name.to_owned(), found: found.to_string(), wanted: wanted.into() }
    }
}

impl Options {
    /// Options as they are written, whose texts go through `replace`.
    ///
    /// # Errors
    /// As `replace`.
    pub fn from_literals<E>(
        pairs: &[(&'static str, Literal)],
        replace: &mut impl FnMut(&'static str) -> Result<OptionValue, E>,
    ) -> Result<Self, E> {
        let mut options = Self::default();
        for &(name, literal) in pairs {
            options.0.insert(name.to_owned(), OptionValue::from_literal(literal, replace)?);
        }
        Ok(options)
    }

    /// Value of an option; `None` where it is not written or `None`.
    pub fn get(&self, name: &str) -> Option<&OptionValue> {
        self.0.get(name).filter(|value| **value != OptionValue::Nothing)
    }

    /// All options, by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &OptionValue)> {
        self.0.iter().map(|(name, value)| (name.as_str(), value))
    }

    /// Sets an option.
    #[must_use]
    pub fn with(mut self, name: impl Into<String>, value: OptionValue) -> Self {
        self.0.insert(name.into(), value);
        self
    }

    /// Options of one side: those inside the option `side` replace the others.
    #[must_use]
    pub fn with_side(&self, side: &str) -> Self {
        let mut merged = self.clone();
        if let Some(OptionValue::Map(options)) = self.get(side) {
            merged.0.extend(options.0.clone());
        }
        merged.0.remove("listener_kwargs");
        merged.0.remove("publisher_kwargs");
        merged
    }

    /// Value of an option that is on or off.
    ///
    /// # Errors
    /// When the value is of another kind.
    pub fn switch(&self, name: &str) -> Result<Option<bool>, OptionError> {
        self.read(name, "true or false", |value| match value {
            OptionValue::Switch(value) => Some(*value),
            _ => None,
        })
    }

    /// Value of an option that is a whole number, as `T`.
    ///
    /// # Errors
    /// When the value is of another kind, or does not fit `T`.
    pub fn number<T: TryFrom<i64>>(&self, name: &str) -> Result<Option<T>, OptionError> {
        self.read(name, "a whole number in its range", |value| match value {
            OptionValue::Integer(value) => T::try_from(*value).ok(),
            _ => None,
        })
    }

    /// Value of an option that is a text.
    ///
    /// # Errors
    /// When the value is of another kind.
    pub fn text(&self, name: &str) -> Result<Option<&str>, OptionError> {
        self.read(name, "a text", |value| match value {
            OptionValue::Text(text) => Some(text.as_str()),
            _ => None,
        })
    }

    /// Value of an option that is a text, read as `T`.
    ///
    /// # Errors
    /// When the value is no text, or no word of `T`.
    pub fn word<T: std::str::FromStr>(&self, name: &str) -> Result<Option<T>, OptionError>
    where
        T::Err: fmt::Display,
    {
        let Some(text) = self.text(name)? else { return Ok(None) };
        text.parse().map(Some).map_err(|error: T::Err| {
            OptionError::new(name, format_args!("{text:?}"), format!("another one: {error}"))
        })
    }

    /// Value of an option that holds options.
    ///
    /// # Errors
    /// When the value is of another kind.
    pub fn map(&self, name: &str) -> Result<Option<&Self>, OptionError> {
        self.read(name, "a map", |value| match value {
            OptionValue::Map(map) => Some(map),
            _ => None,
        })
    }

    /// Options inside the option `name`; none where it is not written.
    ///
    /// # Errors
    /// When the value is of another kind.
    pub fn part(&self, name: &str) -> Result<Self, OptionError> {
        Ok(self.map(name)?.cloned().unwrap_or_default())
    }

    fn read<'a, T>(
        &'a self,
        name: &str,
        wanted: &str,
        read: impl FnOnce(&'a OptionValue) -> Option<T>,
    ) -> Result<Option<T>, OptionError> {
        self.get(name)
            .map(|value| read(value).ok_or_else(|| OptionError::new(name, value, wanted)))
            .transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_read_by_form_and_faults_are_named() {
        let options = Options::default()
            .with("should_wait", OptionValue::Switch(false))
            .with("port", OptionValue::Integer(70_000))
            .with("unset", OptionValue::Nothing);
        assert_eq!(options.switch("should_wait"), Ok(Some(false)));
        assert_eq!(options.text("unset"), Ok(None));
        let error = options.number::<u16>("port").unwrap_err().to_string();
        assert_eq!(error, "option port is 70000, and should be a whole number in its range");
        assert!(options.text("port").is_err());
    }

    #[test]
    fn one_side_wins_over_both() {
        let side = Options::default().with("topic", OptionValue::Text("/b".into()));
        let options = Options::default()
            .with("topic", OptionValue::Text("/a".into()))
            .with("listener_kwargs", OptionValue::Map(side));
        assert_eq!(options.with_side("listener_kwargs").text("topic"), Ok(Some("/b")));
        assert_eq!(options.with_side("publisher_kwargs").text("topic"), Ok(Some("/a")));
    }
}
