//! Options of a registered value, after `$` is replaced.

use std::collections::BTreeMap;
use std::fmt;

use super::describe::Literal;
use crate::types::Value;

/// The value of an option.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum OptionValue {
    /// `None` of an argument: as if the option were not written.
    Nothing,
    /// On or off.
    Switch(bool),
    /// A whole number.
    Integer(i64),
    /// Any other number.
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
    /// What an argument is as an option; `None` for what cannot be one.
    pub(super) fn from_value(value: &Value) -> Option<Self> {
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

    /// A literal whose texts went through `replace`.
    pub(super) fn from_literal<E>(
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
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Options(BTreeMap<String, OptionValue>);

/// An option with a value that means nothing.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("option {name} is {found}, and should be {wanted}")]
pub struct OptionError {
    /// Its name.
    pub name: String,
    /// Its value.
    pub found: String,
    /// What may be written.
    pub wanted: String,
}

impl Options {
    pub(super) fn from_literals<E>(
        pairs: &[(&'static str, Literal)],
        replace: &mut impl FnMut(&'static str) -> Result<OptionValue, E>,
    ) -> Result<Self, E> {
        pairs
            .iter()
            .map(|&(name, literal)| {
                Ok((name.to_owned(), OptionValue::from_literal(literal, replace)?))
            })
            .collect::<Result<_, E>>()
            .map(Self)
    }

    /// The value under a name; `None` where it is not written or `None`.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&OptionValue> {
        self.0.get(name).filter(|value| **value != OptionValue::Nothing)
    }

    /// Every option.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &OptionValue)> {
        self.0.iter().map(|(name, value)| (name.as_str(), value))
    }

    /// The same with one option more, or another value of one.
    #[must_use]
    pub fn with(mut self, name: impl Into<String>, value: OptionValue) -> Self {
        self.0.insert(name.into(), value);
        self
    }

    /// The same with those of `side` over them.
    pub(super) fn with_side(&self, side: &str) -> Self {
        let mut merged = self.clone();
        if let Some(OptionValue::Map(options)) = self.get(side) {
            merged.0.extend(options.0.clone());
        }
        merged.0.remove("listener_kwargs");
        merged.0.remove("publisher_kwargs");
        merged
    }

    /// An on-or-off option.
    ///
    /// # Errors
    /// When it is something else.
    pub fn switch(&self, name: &str) -> Result<Option<bool>, OptionError> {
        self.read(name, "true or false", |value| match value {
            OptionValue::Switch(value) => Some(*value),
            _ => None,
        })
    }

    /// A whole number that fits `T`.
    ///
    /// # Errors
    /// When it is something else.
    pub fn number<T: TryFrom<i64>>(&self, name: &str) -> Result<Option<T>, OptionError> {
        self.read(name, "a whole number in its range", |value| match value {
            OptionValue::Integer(value) => T::try_from(*value).ok(),
            _ => None,
        })
    }

    /// A text.
    ///
    /// # Errors
    /// When it is something else.
    pub fn text(&self, name: &str) -> Result<Option<&str>, OptionError> {
        let value = self.get(name);
        match value {
            Some(OptionValue::Text(text)) => Ok(Some(text)),
            None => Ok(None),
            Some(other) => Err(Self::fault(name, other, "a text")),
        }
    }

    /// A text read as one of the words of `T`.
    ///
    /// # Errors
    /// When it is no text, or none of them.
    pub fn word<T: std::str::FromStr>(&self, name: &str) -> Result<Option<T>, OptionError>
    where
        T::Err: fmt::Display,
    {
        self.text(name)?
            .map(|text| {
                text.parse().map_err(|error: T::Err| OptionError {
                    name: name.to_owned(),
                    found: format!("{text:?}"),
                    wanted: format!("another one: {error}"),
                })
            })
            .transpose()
    }

    /// Options inside an option.
    ///
    /// # Errors
    /// When it is something else.
    pub fn map(&self, name: &str) -> Result<Option<&Self>, OptionError> {
        match self.get(name) {
            Some(OptionValue::Map(map)) => Ok(Some(map)),
            None => Ok(None),
            Some(other) => Err(Self::fault(name, other, "a map")),
        }
    }

    fn read<T>(
        &self,
        name: &str,
        wanted: &str,
        read: impl FnOnce(&OptionValue) -> Option<T>,
    ) -> Result<Option<T>, OptionError> {
        self.get(name)
            .map(|value| read(value).ok_or_else(|| Self::fault(name, value, wanted)))
            .transpose()
    }

    pub(super) fn fault(name: &str, found: &OptionValue, wanted: &str) -> OptionError {
        OptionError { name: name.to_owned(), found: found.to_string(), wanted: wanted.to_owned() }
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
