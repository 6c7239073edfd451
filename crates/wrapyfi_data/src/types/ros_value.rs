//! ROS messages of any type as native objects, for middlewares and scripts that know dicts.
//!
//! ```text
//!   message ─────▶ dict of its fields      sequences of numbers ─▶ arrays (uint8[] too)
//!   dict ────────▶ JSON ─▶ TypePlan::from_json ─▶ fields
//!     └─ arrays of the field's own number type ─── in bulk ──▲
//! ```

use num_bigint::BigInt;
use serde_json::{Map as Object, Value as Json};
use wrapyfi_interfaces::cdr::CdrError;
use wrapyfi_interfaces::dynamic::{DynamicMessage, DynamicValue, Primitives, ValueError};
use wrapyfi_interfaces::with_elements;

use super::ros_message::RosMessage;
use super::ros_type::RosType;
use super::{Map, Tensor, Value};

/// Largest number of elements in an array whose number type is not that of its field, because each
/// is read by itself.
const MOST_CONVERTED: usize = 1 << 20;
/// Deepest nesting of a dict that becomes a message.
const MAX_DEPTH: usize = 64;

/// Error of converting a native object to a ROS message.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{Map, RosMessage, RosType};
/// use wrapyfi_interfaces::store::TypeStore;
/// let text = RosType::new(&TypeStore::generated().resolve_name("std_msgs/msg/String")?)?;
/// let fields = Map::from([("text", "hello")]).into();
/// let error = RosMessage::from_value(text, &fields, 1 << 20).unwrap_err();
/// assert_eq!(error.to_string(), "text: std_msgs/msg/String has no such field");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RosValueError {
    /// A field is unknown, or its value is not of the field's type.
    #[error("{0}")]
    Field(#[from] ValueError),
    /// The bytes are no message of the type.
    #[error("{0}")]
    Bytes(#[from] CdrError),
    /// More values than fields.
    #[error("{given} values, and {ros_type} has {fields}: leave out {}", given - fields)]
    Count {
        /// Number of values.
        given: usize,
        /// Name of the type.
        ros_type: &'static str,
        /// Number of its fields.
        fields: usize,
    },
    /// A value has no form in a ROS message.
    #[error("{path}: a {kind} has no form in a ROS message; {remedy}")]
    Kind {
        /// Place in the value, from `$`.
        path: String,
        /// Kind of the value.
        kind: String,
        /// Value to give instead.
        remedy: &'static str,
    },
}

impl RosMessage {
    /// Converts the message to a dict of its fields. Sequences of numbers become arrays, so that
    /// large ones are not taken apart.
    ///
    /// # Errors
    /// As [`RosMessage::fields`].
    pub fn to_value(&self, max_bytes: usize) -> Result<Value, CdrError> {
        Ok(value_of(&self.fields(max_bytes)?))
    }

    /// Converts a dict of fields to a message. Missing fields have their default value.
    ///
    /// # Errors
    /// When a field is unknown, a value is not of its field's type, or the message would exceed
    /// `max_bytes`.
    pub fn from_value(
        ros_type: RosType,
        value: &Value,
        max_bytes: usize,
    ) -> Result<Self, RosValueError> {
        let fields = fields_of(ros_type, value, max_bytes)?;
        Ok(Self::from_fields(ros_type, &fields)?)
    }
}

/// Reads fields from a dict; missing ones have their default value.
pub fn fields_of(
    ros_type: RosType,
    value: &Value,
    max_bytes: usize,
) -> Result<DynamicMessage, RosValueError> {
    let mut bulk = Vec::new();
    let json = json(value, &mut Path::root(ros_type, &mut bulk), 0)?;
    let mut fields = ros_type.plan().from_json(&json, max_bytes)?;
    let mut left = max_bytes;
    for (path, values) in bulk {
        left = left
            .checked_sub(values.byte_count())
            .ok_or_else(|| ValueError::TooLarge { path: path.clone(), limit: max_bytes })?;
        fields.set(&path, values)?;
    }
    Ok(fields)
}

/// Reads fields from the arguments of a call: in order, by name, or one dict of them all. A dict that has none of them is
/// the first, where that is a message.
pub fn fields_of_call(
    ros_type: RosType,
    args: &[Value],
    kwargs: &Map,
    max_bytes: usize,
) -> Result<DynamicMessage, RosValueError> {
    let defaults = ros_type.plan().default_message();
    if let ([whole @ Value::Map(dict)], true) = (args, kwargs.is_empty()) {
        let fields = || defaults.fields();
        let is_field = |key: &Value| fields().any(|(name, _)| key.as_str() == Some(name));
        let is_of_first = matches!(fields().next(), Some((_, DynamicValue::Message(_))))
            && !dict.is_empty()
            && !dict.iter().any(|(key, _)| is_field(key));
        if !is_of_first {
            return fields_of(ros_type, whole, max_bytes);
        }
    }
    let mut names = defaults.fields().map(|(name, _)| name);
    let mut pairs = Vec::with_capacity(args.len().saturating_add(kwargs.len()));
    for (at, value) in args.iter().enumerate() {
        let name = names.next().ok_or(RosValueError::Count {
            given: args.len(),
            ros_type: ros_type.name(),
            fields: at,
        })?;
        if kwargs.get(name).is_some() {
            return Err(RosValueError::Kind {
                path: name.to_owned(),
                kind: "second value".to_owned(),
                remedy: "give it in order or by name",
            });
        }
        pairs.push((Value::from(name), value.clone()));
    }
    pairs.extend(kwargs.iter().map(|(name, value)| (name.clone(), value.clone())));
    fields_of(ros_type, &Map::from_iter(pairs).into(), max_bytes)
}

/// Reads the fields of a reply from the value that a function returned: a dict of fields, a list in
/// their order, nothing, or the value of the first.
pub fn fields_of_return(
    ros_type: RosType,
    value: &Value,
    max_bytes: usize,
) -> Result<DynamicMessage, RosValueError> {
    match value {
        Value::Map(_) => fields_of(ros_type, value, max_bytes),
        Value::Null => Ok(ros_type.plan().default_message()),
        Value::List(items) | Value::Tuple(items) => {
            fields_of_call(ros_type, items, &Map::new(), max_bytes)
        }
        one => fields_of_call(ros_type, std::slice::from_ref(one), &Map::new(), max_bytes),
    }
}

/// Converts fields to a dict.
pub fn value_of(fields: &DynamicMessage) -> Value {
    let pairs = fields.fields().map(|(name, field)| (Value::from(name), self::field(field)));
    // A definition has each field once.
    Map(pairs.collect()).into()
}

fn field(value: &DynamicValue) -> Value {
    match value {
        DynamicValue::Bool(value) => (*value).into(),
        DynamicValue::F32(value) => (*value).into(),
        DynamicValue::F64(value) => (*value).into(),
        DynamicValue::Text(text) => text.as_str().into(),
        DynamicValue::Message(inner) => value_of(inner),
        DynamicValue::Primitives(values) => array(values),
        DynamicValue::Texts(texts) => texts.iter().map(String::as_str).collect(),
        DynamicValue::Messages(messages) => messages.iter().map(value_of).collect(),
        integer => integer.as_integer().map(BigInt::from).into(),
    }
}

fn array(values: &Primitives) -> Value {
    let tensor = match values {
        Primitives::Bytes(bytes) => Tensor::new(super::Dtype::U8, [bytes.len()], bytes.clone()),
        others => with_elements!(others, values => {
            Tensor::from_elements(&[values.len()], values.to_vec())
        }),
    };
    // The shape is the number of elements, so the tensor always fits.
    tensor.map_or(Value::Null, Value::Tensor)
}

/// Place of a value, its type's defaults, and the arrays that do not go through JSON.
struct Path<'a> {
    names: Vec<String>,
    /// Fields of the type with their default values, which tell the type of each; `None` inside
    /// sequences.
    defaults: Option<DynamicMessage>,
    bulk: &'a mut Vec<(String, Primitives)>,
}

impl<'a> Path<'a> {
    fn root(ros_type: RosType, bulk: &'a mut Vec<(String, Primitives)>) -> Self {
        Self { names: Vec::new(), defaults: Some(ros_type.plan().default_message()), bulk }
    }

    fn words(&self) -> String {
        std::iter::once("$")
            .chain(self.names.iter().map(String::as_str))
            .collect::<Vec<_>>()
            .join(".")
    }

    /// Takes an array whose numbers are of the field's type; false for others, which go through
    /// JSON.
    fn take(&mut self, tensor: &Tensor) -> bool {
        let path = self.names.join(".");
        let field = self.defaults.as_ref().and_then(|defaults| defaults.get(&path));
        let Some(DynamicValue::Primitives(kind)) = field else { return false };
        let values: Option<Primitives> = match kind {
            Primitives::Bytes(_) => (tensor.dtype() == super::Dtype::U8)
                .then(|| Primitives::Bytes(tensor.data().clone())),
            others => with_elements!(others, like => to_vec_like(tensor, like).map(Into::into)),
        };
        let Some(values) = values else { return false };
        self.bulk.push((path, values));
        true
    }
}

/// The elements where they are of the type of `_like`.
fn to_vec_like<T: super::Element>(tensor: &Tensor, _like: &[T]) -> Option<Vec<T>> {
    tensor.to_vec()
}

fn json(value: &Value, path: &mut Path<'_>, depth: usize) -> Result<Json, RosValueError> {
    let refused = |path: &Path<'_>, remedy: &'static str| RosValueError::Kind {
        path: path.words(),
        kind: value.kind().to_owned(),
        remedy,
    };
    if depth > MAX_DEPTH {
        return Err(refused(path, "nest at most 64 deep"));
    }
    Ok(match value {
        Value::Bool(value) => Json::Bool(*value),
        Value::Int(value) => Json::Number((*value).into()),
        Value::BigInt(value) => match u64::try_from(value) {
            Ok(value) => Json::Number(value.into()),
            Err(_) => return Err(refused(path, "integers there have at most 64 bits")),
        },
        Value::Float(value) => float(*value),
        Value::Str(text) => Json::String(text.clone()),
        Value::Bytes(bytes) => {
            let tensor = Tensor::new(super::Dtype::U8, [bytes.len()], bytes.clone()).ok();
            match tensor {
                Some(tensor) => numbers(&tensor, path, depth)?,
                None => return Err(refused(path, "give an array of uint8")),
            }
        }
        Value::Tensor(tensor) => numbers(tensor, path, depth)?,
        Value::List(items) | Value::Tuple(items) => {
            let defaults = path.defaults.take();
            let read: Result<Vec<Json>, _> = items
                .iter()
                .enumerate()
                .map(|(at, item)| {
                    path.names.push(at.to_string());
                    let read = json(item, path, depth + 1);
                    path.names.pop();
                    read
                })
                .collect();
            path.defaults = defaults;
            Json::Array(read?)
        }
        Value::Map(map) => {
            let mut object = Object::new();
            for (key, member) in map.iter() {
                let Some(name) = key.as_str() else {
                    return Err(RosValueError::Kind {
                        path: path.words(),
                        kind: format!("key of type {}", key.kind()),
                        remedy: "fields have names",
                    });
                };
                path.names.push(name.to_owned());
                let taken = matches!(member, Value::Tensor(tensor) if path.take(tensor));
                let read = if taken { Ok(None) } else { json(member, path, depth + 1).map(Some) };
                path.names.pop();
                if let Some(read) = read? {
                    object.insert(name.to_owned(), read);
                }
            }
            Json::Object(object)
        }
        _ => return Err(refused(path, "give numbers, text, lists, arrays or dicts")),
    })
}

fn float(value: f64) -> Json {
    let word = match value {
        f64::INFINITY => "Infinity",
        f64::NEG_INFINITY => "-Infinity",
        nan if nan.is_nan() => "NaN",
        number => return number.into(),
    };
    word.into()
}

/// Converts an array to a list of numbers, row by row whatever its shape, because fields have one
/// dimension.
fn numbers(tensor: &Tensor, path: &mut Path<'_>, depth: usize) -> Result<Json, RosValueError> {
    let shown = path.words();
    let refused = |remedy| RosValueError::Kind {
        path: shown.clone(),
        kind: format!("{} array of {} elements", tensor.dtype(), tensor.element_count()),
        remedy,
    };
    if tensor.element_count() > MOST_CONVERTED {
        return Err(refused("give it the number type of its field"));
    }
    let flat = Tensor::new(tensor.dtype(), [tensor.element_count()], tensor.data().clone())
        .map_err(|_misfit| refused("its bytes do not fit its shape"))?;
    match super::nested_list(&flat) {
        Some(list) => json(&list, path, depth),
        None => Err(refused("complex numbers have no form there")),
    }
}

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::parser::{Dialect, TypeName};
    use wrapyfi_interfaces::store::ResolvedType;

    use super::*;

    fn demo() -> RosType {
        let name = TypeName::parse(Dialect::Ros2, "demo/msg/All").unwrap();
        let text = "bool on\nuint64 count\nfloat32 ratio\nstring text\nuint8[] raw\nfloat64[3] at\n\
                    string[] names\nPart[] parts\nPart part\n\
                    ================\nMSG: demo/Part\nint16 id\nint32[] list\n";
        RosType::new(&ResolvedType::from_text(Dialect::Ros2, &name, text).unwrap()).unwrap()
    }

    #[test]
    fn a_message_is_a_dict_and_back() {
        let part = |id: i64| {
            let list = Tensor::from_elements(&[2], vec![1_i32, -2]).unwrap();
            Value::from(Map::from([("id", Value::from(id)), ("list", list.into())]))
        };
        let raw = Tensor::from_elements(&[3], vec![1_u8, 2, 255]).unwrap();
        let at = Tensor::from_elements(&[3], vec![0.5, f64::NAN, f64::INFINITY]).unwrap();
        let value = Value::from(Map::from([
            ("on", Value::from(true)),
            ("count", Value::from(u64::MAX)),
            ("ratio", 0.25.into()),
            ("text", "ä".into()),
            ("raw", raw.into()),
            ("at", at.into()),
            ("names", Value::from_iter(["a", "b"])),
            ("parts", Value::from(vec![part(1), part(2)])),
            ("part", part(-3)),
        ]));
        let message = RosMessage::from_value(demo(), &value, 1 << 16).unwrap();
        let back = message.to_value(1 << 16).unwrap();
        // NaN is not equal to itself: the bytes are.
        assert_eq!(RosMessage::from_value(demo(), &back, 1 << 16).unwrap(), message);
        for key in ["on", "count", "ratio", "text", "raw", "names", "parts", "part"] {
            assert_eq!(back.get(key), value.get(key), "{key}");
        }
    }

    #[test]
    fn lists_and_other_number_types_are_read_too() {
        let value = Value::from(Map::from([
            ("at", Value::from_iter([1_i64, 2, 3])),
            ("raw", Value::from(Tensor::from_elements(&[2], vec![7_i64, 8]).unwrap())),
        ]));
        let message = RosMessage::from_value(demo(), &value, 1 << 16).unwrap();
        let fields = message.fields(1 << 16).unwrap();
        assert_eq!(fields.get("at"), Some(&vec![1.0, 2.0, 3.0].into()));
        assert_eq!(fields.get("raw"), Some(&vec![7_u8, 8].into()));
        assert_eq!(fields.get("text").and_then(DynamicValue::as_str), Some(""));
    }

    /// A goal of `move_base` is one message, and so may be the one argument of a call.
    #[test]
    fn a_dict_of_other_fields_is_the_first_argument_where_that_is_a_message() {
        let resolved = |name: &str, text: &str| {
            let name = TypeName::parse(Dialect::Ros2, name).unwrap();
            RosType::new(&ResolvedType::from_text(Dialect::Ros2, &name, text).unwrap()).unwrap()
        };
        let part = "================\nMSG: demo/Part\nint16 id\n";
        let (goal, text) =
            (format!("Part part\nbool fast\n{part}"), format!("bool fast\nPart part\n{part}"));
        let (goal, other) = (resolved("demo/msg/Goal", &goal), resolved("demo/msg/Other", &text));
        let read = |ros_type, dict: Map| {
            let message = fields_of_call(ros_type, &[dict.into()], &Map::new(), 1 << 10);
            let id =
                |message: DynamicMessage| message.get("part.id").and_then(DynamicValue::as_integer);
            message.map(id).map_err(|error| error.to_string())
        };
        let id = || Map::from([("id", 7)]);
        assert_eq!(read(goal, id()), Ok(Some(7)));
        assert_eq!(read(goal, Map::from([("part", id())])), Ok(Some(7)));
        assert_eq!(read(goal, Map::new()), Ok(Some(0)));
        assert!(read(goal, Map::from([("idd", 7)])).unwrap_err().contains("part.idd"));
        assert!(read(other, id()).unwrap_err().contains("id"), "the first is no message");
    }

    #[test]
    fn what_does_not_fit_is_told_with_its_path() {
        let bytes = Tensor::from_elements(&[1 << 12], vec![0_u8; 1 << 12]).unwrap();
        let deep = (0..80).fold(Value::Null, |inner, _| Value::from(Map::from([("part", inner)])));
        let cases: Vec<(Value, &str)> = vec![
            (Map::from([("speed", 1)]).into(), "speed"),
            (Map::from([("text", 1)]).into(), "text"),
            (Map::from([("part", Map::from([("id", 70_000)]))]).into(), "part.id"),
            (Map::from([("at", vec![Value::from(1)])]).into(), "at"),
            (Map::from([("raw", bytes)]).into(), "raw"),
            (Map::from([(1, 2)]).into(), "$: a key of type int"),
            (Map::from([("on", Value::Null)]).into(), "$.on: a None"),
            (deep, "nest at most 64 deep"),
            (Value::from(5), "an object with the fields of demo/msg/All"),
        ];
        for (value, wanted) in cases {
            let error = RosMessage::from_value(demo(), &value, 1 << 10).unwrap_err().to_string();
            assert!(error.contains(wanted), "{error} lacks {wanted}");
        }
    }
}
