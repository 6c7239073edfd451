//! Values of bottles as native objects.
//!
//! ```text
//!   int8 … int64      ◀── int ──▶  int32, int64 where it does not fit
//!   float32, float64  ◀── float ─▶ float64
//!   [1] [0] [null]    ◀─▶ True, False, None
//!   string, vocab     ◀─▶ str                    see word.rs
//!   blob              ◀─▶ array of uint8 of one dimension (bytes, too)
//!   list              ◀─▶ list, tuple, set, array
//!   dict              ◀─▶ dict
//! ```

use wrapyfi_yarp::bottle::Vocab;
use wrapyfi_yarp::{Bottle, Dialect, Value as Element};

use super::{fault, word};
use wrapyfi_data::Limits;
use wrapyfi_data::types::{Dtype, Map, Tensor, Value, nested_list};
use wrapyfi_endpoint::codec::EncodeResult;

/// Most numbers of an array that become values of a bottle one by one.
const MOST_NUMBERS: usize = 1 << 20;

/// One element as a value. Bottles nest no deeper than their limit, and so does this.
pub(super) fn to_value(element: &Element, dialect: Dialect) -> Value {
    match element {
        Element::Int8(_) | Element::Int16(_) | Element::Int32(_) | Element::Int64(_) => {
            element.as_i64().unwrap_or_default().into()
        }
        Element::Float32(number) => (*number).into(),
        Element::Float64(number) => (*number).into(),
        Element::Vocab32(Vocab::TRUE) => true.into(),
        Element::Vocab32(Vocab::FALSE) => false.into(),
        Element::Vocab32(vocab) if *vocab == word::null() => Value::Null,
        Element::Vocab32(vocab) => word::of_vocab(*vocab).into(),
        Element::Vocab64(vocab) => word::of_vocab64(*vocab).into(),
        Element::String(text) => word::of_string(text, dialect),
        Element::Blob(bytes) => {
            let bytes = bytes.clone();
            let tensor = Tensor::new(Dtype::U8, vec![bytes.len()], bytes.clone());
            // One dimension of as many bytes as there are: that cannot fail.
            tensor.map_or_else(|_| bytes.into(), Value::from)
        }
        Element::List(list) => to_list(list, dialect),
        Element::Dict(pairs) => {
            let map = to_map(pairs, dialect).filter(|map| map.len() == pairs.len());
            // Pairs without keys, or with a key twice, become a list, so that they are not lost.
            map.map_or_else(|| to_list(pairs, dialect), Into::into)
        }
    }
}

/// A bottle as a list.
pub(super) fn to_list(bottle: &Bottle, dialect: Dialect) -> Value {
    Value::List(bottle.into_iter().map(|element| to_value(element, dialect)).collect())
}

/// A bottle of lists `(key value)` as a dict; `(key a b)` is the list of `a` and `b`. `None` where
/// an element is something else. Of a key that comes twice, the last value counts.
pub(super) fn to_map(bottle: &Bottle, dialect: Dialect) -> Option<Map> {
    let pair = |element: &Element| {
        let [key, values @ ..] = element.as_list()?.values.as_slice() else { return None };
        let key = Some(to_value(key, dialect)).filter(Value::is_hashable)?;
        let value = match values {
            [] => return None,
            [value] => to_value(value, dialect),
            values => values.iter().map(|value| to_value(value, dialect)).collect(),
        };
        Some((key, value))
    };
    bottle.into_iter().map(pair).collect()
}

/// Dialect and limits with which values become elements of a bottle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Writer<'a> {
    pub(super) dialect: Dialect,
    pub(super) limits: &'a Limits,
}

impl Writer<'_> {
    /// A value as the elements of a bottle: those of a list, the pairs of a dict, or itself alone.
    pub(super) fn bottle(&self, value: &Value) -> EncodeResult<Bottle> {
        match value {
            Value::List(items) | Value::Tuple(items) | Value::Set(items) => {
                self.elements(items, "$", 1)
            }
            Value::Map(map) => self.pairs(map, "$", 1),
            Value::Tensor(_) => match self.element(value, "$", 1)? {
                Element::List(list) => Ok(list),
                single => Ok(Bottle { values: vec![single] }),
            },
            single => Ok(Bottle { values: vec![self.element(single, "$", 1)?] }),
        }
    }

    /// Values as elements.
    pub(super) fn elements(
        &self,
        items: &[Value],
        path: &str,
        depth: usize,
    ) -> EncodeResult<Bottle> {
        let at = |(index, item)| self.element(item, &format!("{path}[{index}]"), depth);
        items.iter().enumerate().map(at).collect()
    }

    /// A dict as lists of key and value.
    pub(super) fn pairs(&self, map: &Map, path: &str, depth: usize) -> EncodeResult<Bottle> {
        let pair = |(key, value): (&Value, &Value)| {
            let inside = match key.as_str() {
                Some(key) => format!("{path}.{key}"),
                None => format!("{path}[{}]", key.kind()),
            };
            let key = self.element(key, &inside, depth + 1)?;
            let value = self.element(value, &inside, depth + 1)?;
            Ok(Element::List(Bottle { values: vec![key, value] }))
        };
        map.iter().map(pair).collect()
    }

    /// One value as an element.
    pub(super) fn element(&self, value: &Value, path: &str, depth: usize) -> EncodeResult<Element> {
        if depth > self.limits.depth {
            let limit = self.limits.depth;
            let what = format!("more than {limit} lists in each other");
            return Err(fault::unwritable("bottle", what, path, "nest it less"));
        }
        let refused = |remedy: &str| {
            Err(fault::unwritable("bottle", format!("a {}", value.kind()), path, remedy))
        };
        Ok(match value {
            Value::Null => Element::Vocab32(word::null()),
            Value::Bool(value) => Element::from(*value),
            Value::Int(number) => match i32::try_from(*number) {
                Ok(small) => Element::Int32(small),
                Err(_) => Element::Int64(*number),
            },
            Value::BigInt(_) => return refused("integers there have at most 64 bits"),
            Value::Float(number) => Element::Float64(*number),
            Value::Str(text) => word::to_element(text, self.dialect),
            Value::Utf16(units) => match word::unescape(units) {
                Some(bytes) => Element::string(bytes),
                None => return refused("its lone surrogates stand for no bytes: remove them"),
            },
            Value::Bytes(bytes) => Element::Blob(bytes.clone()),
            Value::List(items) | Value::Tuple(items) | Value::Set(items) => {
                Element::List(self.elements(items, path, depth + 1)?)
            }
            Value::Map(map) => Element::Dict(self.pairs(map, path, depth + 1)?),
            Value::DateTime(time) => Element::string(time.to_string()),
            Value::DateTime64(text) => Element::string(text.as_str()),
            // Raw bytes, such as the data of a point cloud.
            Value::Tensor(tensor) if tensor.dtype() == Dtype::U8 && tensor.shape().len() == 1 => {
                Element::Blob(tensor.data().clone())
            }
            Value::Tensor(tensor) => {
                let count = tensor.element_count();
                if count > MOST_NUMBERS {
                    let what = format!("an array of {count} numbers, the limit is {MOST_NUMBERS}");
                    let remedy = "use type std_msgs/msg/Float64MultiArray, or JSON (bottle: false)";
                    return Err(fault::unwritable("bottle", what, path, remedy));
                }
                match nested_list(tensor) {
                    Some(numbers) => self.element(&numbers, path, depth)?,
                    None => return refused("send its parts"),
                }
            }
            _ => return refused("send it as JSON (bottle: false)"),
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const V3: Writer<'_> =
        Writer { dialect: Dialect::V3, limits: &Limits { message_bytes: 1 << 20, depth: 8 } };

    fn parsed(text: &str) -> Bottle {
        Bottle::from_text(text.as_bytes(), &wrapyfi_yarp::WireLimits::default()).unwrap()
    }

    #[test]
    fn bottles_are_lists_and_come_back() {
        for (text, value) in [
            ("", Value::List(vec![])),
            ("1 -2 5000000000", [1_i64, -2, 5_000_000_000].into_iter().collect()),
            ("1.5", [1.5].into_iter().collect()),
            ("true false [null]", vec![true.into(), false.into(), Value::Null].into()),
            ("[set] \"a b\" x", ["[set]", "a b", "x"].into_iter().collect()),
            ("{1 255}", vec![Tensor::from_elements(&[2], vec![1_u8, 255]).unwrap().into()].into()),
            (
                "(1 (2)) ()",
                vec![vec![1.into(), vec![2.into()].into()].into(), Value::List(vec![])].into(),
            ),
        ] {
            let bottle = parsed(text);
            assert_eq!(to_list(&bottle, Dialect::V3), value, "{text}");
            assert_eq!(V3.bottle(&value).unwrap().to_text(), text);
        }
    }

    #[test]
    fn dicts_are_pairs() {
        let map = Map::from([("a", Value::from(1)), ("b", Map::from([("c", 2)]).into())]);
        let bottle = V3.bottle(&map.clone().into()).unwrap();
        assert_eq!(bottle.to_text(), "(a 1) (b ((c 2)))");
        assert!(matches!(bottle.find("b"), Some(Element::Dict(_))));
        assert_eq!(to_map(&bottle, Dialect::V3), Some(map));
        let several = to_map(&parsed("(limits 0 10) (limits 3)"), Dialect::V3).unwrap();
        assert_eq!(several, Map::from([("limits", 3)]));
        for none in ["(a 1) b", "(a)", "()", "((a b) 1)"] {
            assert_eq!(to_map(&parsed(none), Dialect::V3), None, "{none}");
        }
        let damaged = Element::Dict(parsed("(a 1) b"));
        assert_eq!(to_value(&damaged, Dialect::V3), to_list(&parsed("(a 1) b"), Dialect::V3));
    }

    #[test]
    fn arrays_are_lists_of_their_numbers() {
        let bytes = Value::Bytes([1, 255].to_vec().into());
        assert_eq!(V3.bottle(&Value::List(vec![bytes])).unwrap().to_text(), "{1 255}");
        let array = Tensor::from_elements(&[2, 2], vec![1_u8, 2, 3, 4]).unwrap();
        assert_eq!(V3.bottle(&array.into()).unwrap().to_text(), "(1 2) (3 4)");
        let scalar = Tensor::from_elements(&[], vec![0.5_f32]).unwrap();
        assert_eq!(V3.bottle(&scalar.into()).unwrap().to_text(), "0.5");
    }

    #[test]
    fn what_has_no_form_is_named_with_its_place() {
        let huge = Tensor::from_elements(&[(1 << 20) + 1], vec![0_i8; (1 << 20) + 1]).unwrap();
        let deep = (0..9).fold(Value::from(1), |value, _| Value::List(vec![value]));
        for (value, wanted) in [
            (Value::from(u64::MAX), "a int at $[0]; integers there have at most 64 bits"),
            (Value::Utf16(vec![0xD800]), "a str at $[0]; its lone surrogates"),
            (huge.into(), "an array of 1048577 numbers, the limit is 1048576 at $[0]"),
            (deep, "more than 8 lists in each other"),
        ] {
            let error = V3.bottle(&Value::List(vec![value])).unwrap_err().to_string();
            assert!(error.contains(wanted), "{error}");
        }
    }

    fn element() -> impl Strategy<Value = Element> {
        let leaf = prop_oneof![
            any::<i32>().prop_map(Element::Int32),
            (i64::from(i32::MAX) + 1..).prop_map(Element::Int64),
            any::<f64>().prop_filter("comparable", |x| !x.is_nan()).prop_map(Element::Float64),
            any::<i32>().prop_map(|code| Element::Vocab32(Vocab(code))),
            any::<bool>().prop_map(Element::from),
            "[a-z\\[\\]]{0,6}".prop_map(Element::string),
            proptest::collection::vec(any::<u8>(), 0..6).prop_map(Element::string),
            proptest::collection::vec(any::<u8>(), 0..6).prop_map(Element::blob),
        ];
        leaf.prop_recursive(3, 24, 4, |inner| {
            let items = proptest::collection::vec(inner.clone(), 0..4);
            let named = proptest::collection::btree_map("[a-z]{1,3}", inner, 0..4);
            let dict = named.prop_map(|named| {
                let pair = |(key, value): (String, Element)| {
                    Element::List(Bottle { values: vec![Element::string(key), value] })
                };
                Element::Dict(named.into_iter().map(pair).collect())
            });
            prop_oneof![items.prop_map(|values| Element::List(Bottle { values })), dict]
        })
    }

    proptest! {
        #[test]
        fn every_bottle_comes_back(values in proptest::collection::vec(element(), 0..5)) {
            let bottle = Bottle { values };
            let value = to_list(&bottle, Dialect::V3);
            prop_assert_eq!(V3.bottle(&value).unwrap(), bottle);
        }
    }
}
