//! The section of one middleware, read out of the text of the whole configuration, so that lines and columns stay.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{DeserializeOwned, DeserializeSeed, IgnoredAny, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_saphyr::{Location, Spanned};

use super::reading::Reading;
use crate::network::{Insecure, Place};

/// A section of `endpoints`, by the name under which it stands there.
pub trait NamedSection {
    /// Key of the section below `endpoints`.
    const NAME: &'static str;

    /// Example of the value of a key in the section, or of the whole section by its name, as YAML: `{ port: 7000 }`.
    fn example_of(key: &str) -> Option<&'static str> {
        _ = key;
        None
    }
}

/// Reads the section `S` of a configuration, and nothing else of it. The value is the default where the text has no such
/// section.
///
/// ```
/// use wrapyfi_endpoint::config::{NamedSection, section_of};
/// #[derive(Default, serde::Deserialize)]
/// #[serde(deny_unknown_fields, default)]
/// struct Radio { port: u16 }
/// impl NamedSection for Radio { const NAME: &'static str = "radio"; }
/// let text = "endpoints:\n  radio: { port: many }\nroutes: 5\n";
/// let reading = section_of::<Radio>(text);
/// assert_eq!(reading.problems[0].position, Some((2, 18)));
/// ```
pub fn section_of<S: NamedSection + DeserializeOwned + Default>(text: &str) -> Reading<S> {
    let Reading { value, problems, wrong_items } = Reading::<OfFile<S>>::new(text, &S::example_of);
    Reading {
        value: value.map(|OfFile(section)| section.unwrap_or_default()),
        problems,
        wrong_items,
    }
}

/// The section out of a file.
#[derive(Debug)]
struct OfFile<S>(Option<S>);

impl<'de, S: NamedSection + Deserialize<'de>> Deserialize<'de> for OfFile<S> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Below(&["endpoints", S::NAME], PhantomData).deserialize(deserializer).map(Self)
    }
}

/// Value below these keys, the outermost first; everything beside them is passed over.
struct Below<'k, S>(&'k [&'static str], PhantomData<S>);

impl<'de, S: Deserialize<'de>> DeserializeSeed<'de> for Below<'_, S> {
    type Value = Option<S>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Option<S>, D::Error> {
        match self.0 {
            [] => S::deserialize(deserializer).map(Some),
            _ => deserializer.deserialize_map(self),
        }
    }
}

impl<'de, S: Deserialize<'de>> Visitor<'de> for Below<'_, S> {
    type Value = Option<S>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("keys with values")
    }

    fn visit_unit<E>(self) -> Result<Option<S>, E> {
        Ok(None)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Option<S>, A::Error> {
        let mut found = None;
        while let Some(key) = entries.next_key::<String>()? {
            match self.0 {
                [wanted, below @ ..] if key == *wanted => {
                    found = entries.next_value_seed(Below(below, PhantomData))?;
                }
                _ => _ = entries.next_value::<IgnoredAny>()?,
            }
        }
        Ok(found)
    }
}

/// A setting that stands in no file.
pub fn in_no_file<T>(value: T) -> Spanned<T> {
    Spanned::new(value, Location::UNKNOWN, Location::UNKNOWN)
}

/// `insecure` of a section: whether other machines may reach what listens at its address.
#[derive(Debug, Clone, Copy)]
pub struct InsecureWord(pub Insecure);

impl Default for InsecureWord {
    fn default() -> Self {
        Self(Insecure { is_allowed: false, place: Place::File })
    }
}

impl<'de> Deserialize<'de> for InsecureWord {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let is_allowed = bool::deserialize(deserializer)?;
        Ok(Self(Insecure { is_allowed, ..Self::default().0 }))
    }
}

impl InsecureWord {
    /// Adds what the section says to what the environment does.
    pub fn say(self, insecure: &mut Insecure, names_address: bool) {
        insecure.said(self.0.place, names_address, self.0.is_allowed);
    }
}
