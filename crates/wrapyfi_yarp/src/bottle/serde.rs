//! Bottles in any format that serde knows, and back, without loss.
//!
//! ```text
//!   1 2.5 word true (1 2)      [1, 2.5, "word", true, [1, 2]]         what JSON has itself
//!   [set] {1 2}                [{"vocab": "set"}, {"blob": [1, 2]}]   what it has not: named
//!   ((k v)) as a dictionary    [{"dict": [["k", "v"]]}]
//! ```
//!
//! The names are `int8`, `int16`, `int64` (where 32 bits would do), `float32`, `float64` (not a
//! number, infinite), `vocab`, `vocab64`, `string` (bytes that are not UTF-8), `blob` and `dict`. An
//! object without one of these names is read as a dictionary, null as the vocab `[null]`.

use std::fmt;

use bytes::Bytes;
use serde::de::{Error, MapAccess, SeqAccess, Visitor};
use serde::ser::SerializeMap;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::{Bottle, Text, Value, Vocab, Vocab64};

/// Elements for which memory is reserved because a format says that they come.
const RESERVED: usize = 1024;

impl Serialize for Bottle {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(&self.values)
    }
}

impl<'de> Deserialize<'de> for Bottle {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct List;

        impl<'de> Visitor<'de> for List {
            type Value = Bottle;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a list of values")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Bottle, A::Error> {
                list(seq)
            }
        }

        deserializer.deserialize_seq(List)
    }
}

impl Serialize for Value {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Int8(number) => named(serializer, "int8", number),
            Self::Int16(number) => named(serializer, "int16", number),
            Self::Int32(number) => serializer.serialize_i32(*number),
            // Without a name, a number that fits comes back as an int32.
            Self::Int64(number) if i32::try_from(*number).is_ok() => {
                named(serializer, "int64", number)
            }
            Self::Int64(number) => serializer.serialize_i64(*number),
            Self::Float32(number) if number.is_finite() => named(serializer, "float32", number),
            Self::Float32(number) => named(serializer, "float32", infinite((*number).into())),
            Self::Float64(number) if number.is_finite() => serializer.serialize_f64(*number),
            Self::Float64(number) => named(serializer, "float64", infinite(*number)),
            Self::Vocab32(Vocab::TRUE) => serializer.serialize_bool(true),
            Self::Vocab32(Vocab::FALSE) => serializer.serialize_bool(false),
            Self::Vocab32(vocab) => {
                match word(vocab.letters(), |word| Vocab::new(word) == *vocab) {
                    Some(word) => named(serializer, "vocab", &word),
                    None => named(serializer, "vocab", &vocab.0),
                }
            }
            Self::Vocab64(vocab) => {
                match word(vocab.letters(), |word| Vocab64::new(word) == *vocab) {
                    Some(word) => named(serializer, "vocab64", &word),
                    None => named(serializer, "vocab64", &vocab.0),
                }
            }
            Self::String(text) => match text.as_str() {
                Some(text) => serializer.serialize_str(text),
                None => named(serializer, "string", text.as_bytes()),
            },
            Self::Blob(bytes) => named(serializer, "blob", bytes),
            Self::List(list) => list.serialize(serializer),
            Self::Dict(list) => named(serializer, "dict", list),
        }
    }
}

fn named<S: Serializer, T: Serialize + ?Sized>(
    serializer: S,
    name: &str,
    value: &T,
) -> Result<S::Ok, S::Error> {
    let mut map = serializer.serialize_map(Some(1))?;
    map.serialize_entry(name, value)?;
    map.end()
}

fn infinite(number: f64) -> &'static str {
    if number.is_nan() {
        "nan"
    } else if number > 0.0 {
        "inf"
    } else {
        "-inf"
    }
}

/// The letters as text, where text returns them.
fn word(letters: Vec<u8>, returns: impl Fn(&str) -> bool) -> Option<String> {
    String::from_utf8(letters).ok().filter(|word| returns(word))
}

impl<'de> Deserialize<'de> for Value {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(Any)
    }
}

struct Any;

impl<'de> Visitor<'de> for Any {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number, text, a boolean, a list or an object")
    }

    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(Value::from(value))
    }

    fn visit_i64<E>(self, number: i64) -> Result<Value, E> {
        Ok(i32::try_from(number).map_or(Value::Int64(number), Value::Int32))
    }

    fn visit_u64<E: Error>(self, number: u64) -> Result<Value, E> {
        match i64::try_from(number) {
            Ok(number) => self.visit_i64(number),
            Err(_) => Err(E::custom(format!("{number} is larger than YARP's integers can be"))),
        }
    }

    fn visit_f64<E>(self, number: f64) -> Result<Value, E> {
        Ok(Value::Float64(number))
    }

    fn visit_str<E>(self, text: &str) -> Result<Value, E> {
        Ok(Value::string(text))
    }

    fn visit_string<E>(self, text: String) -> Result<Value, E> {
        Ok(Value::string(text))
    }

    fn visit_bytes<E>(self, bytes: &[u8]) -> Result<Value, E> {
        Ok(Value::Blob(Bytes::copy_from_slice(bytes)))
    }

    fn visit_byte_buf<E>(self, bytes: Vec<u8>) -> Result<Value, E> {
        Ok(Value::Blob(bytes.into()))
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::vocab("null"))
    }

    fn visit_none<E>(self) -> Result<Value, E> {
        Ok(Value::vocab("null"))
    }

    fn visit_some<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        Value::deserialize(deserializer)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Value, A::Error> {
        list(seq).map(Value::List)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Value, A::Error> {
        let Some(name) = map.next_key::<String>()? else { return Ok(Value::Dict(Bottle::new())) };
        let value = match name.as_str() {
            "int8" => Value::Int8(map.next_value()?),
            "int16" => Value::Int16(map.next_value()?),
            "int64" => Value::Int64(map.next_value()?),
            "float32" => Value::Float32(map.next_value::<Float>()?.0 as f32),
            "float64" => Value::Float64(map.next_value::<Float>()?.0),
            "vocab" => match map.next_value()? {
                Letters::Word(word) => Value::vocab(&word),
                Letters::Number(number) => Value::Vocab32(Vocab(within(number)?)),
            },
            "vocab64" => Value::Vocab64(match map.next_value()? {
                Letters::Word(word) => Vocab64::new(&word),
                Letters::Number(number) => Vocab64(number),
            }),
            "string" => Value::String(Text::from(map.next_value::<Vec<u8>>()?)),
            "blob" => Value::Blob(map.next_value()?),
            "dict" => Value::Dict(map.next_value()?),
            _ => return dictionary(name, map),
        };
        match map.next_key::<String>()? {
            None => Ok(value),
            Some(other) => Err(A::Error::custom(format!(
                "an object with \"{name}\" has no other key, such as \"{other}\": it names a type"
            ))),
        }
    }
}

/// An object whose first key is known and no name of a type.
fn dictionary<'de, A: MapAccess<'de>>(first: String, mut map: A) -> Result<Value, A::Error> {
    let mut pairs = Bottle::new();
    let mut key = Some(first);
    while let Some(name) = key {
        let value: Value = map.next_value()?;
        pairs.push(Bottle::from(vec![Value::string(name), value]));
        key = map.next_key()?;
    }
    Ok(Value::Dict(pairs))
}

fn list<'de, A: SeqAccess<'de>>(mut seq: A) -> Result<Bottle, A::Error> {
    let mut values = Vec::with_capacity(seq.size_hint().unwrap_or(0).min(RESERVED));
    while let Some(value) = seq.next_element()? {
        values.push(value);
    }
    Ok(Bottle { values })
}

fn within<E: Error>(number: i64) -> Result<i32, E> {
    i32::try_from(number)
        .map_err(|error| E::custom(format!("a vocab has 32 bits, {number} more: {error}")))
}

/// A float that may be written as a word.
struct Float(f64);

impl<'de> Deserialize<'de> for Float {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match Value::deserialize(deserializer)? {
            Value::String(text) => match text.as_str() {
                Some("nan") => Ok(Self(f64::NAN)),
                Some("inf") => Ok(Self(f64::INFINITY)),
                Some("-inf") => Ok(Self(f64::NEG_INFINITY)),
                _ => Err(D::Error::custom(format!("{text:?} is none of nan, inf, -inf"))),
            },
            value => value
                .as_f64()
                .map(Self)
                .ok_or_else(|| D::Error::custom("a float is a number, or nan, inf, -inf")),
        }
    }
}

/// A vocab by its letters, or by its number where letters cannot say it.
enum Letters {
    Word(String),
    Number(i64),
}

impl<'de> Deserialize<'de> for Letters {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let value = Value::deserialize(deserializer)?;
        match (value.as_str(), value.as_i64()) {
            (Some(word), _) => Ok(Self::Word(word.to_owned())),
            (None, Some(number)) => Ok(Self::Number(number)),
            (None, None) => Err(D::Error::custom("a vocab is letters or a number")),
        }
    }
}
