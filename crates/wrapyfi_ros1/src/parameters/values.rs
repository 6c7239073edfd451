//! Names and values of parameters: those of ROS 1's master, and ours.
//!
//! ```text
//!   /camera/lens/label = "left"      ◀──▶  lens.label  STRING
//!   /camera/ids        = [1, 2]      ◀──▶  ids         INTEGER_ARRAY
//!   /camera/rows       = [[1], [2]]   ──▶  none: said, and left out
//! ```

use crate::xmlrpc::Value as Xml;
use wrapyfi_data::types::{Map, ParameterValue, Properties, Value};

/// Parameters of a namespace, flattened to names with dots.
#[derive(Debug, Default)]
pub(super) struct Flat {
    pub(super) parameters: Properties,
    /// Entries whose value fits no parameter: name and reason.
    pub(super) faults: Vec<(String, String)>,
}

/// Names and values of a namespace.
pub(super) fn flatten(value: Xml) -> Flat {
    let mut flat = Flat::default();
    match value {
        Xml::Struct(members) => {
            members.into_iter().for_each(|(name, value)| flat.enter(name, value));
        }
        other => {
            let kind = to_value(other);
            let why = format!("properties are a namespace of parameters, not {}", kind.kind());
            flat.faults.push((String::new(), why));
        }
    }
    flat
}

impl Flat {
    /// Adds a parameter, or those below it: as deep as XML-RPC may nest.
    fn enter(&mut self, name: String, value: Xml) {
        if let Xml::Struct(members) = value {
            for (inner, value) in members {
                self.enter(format!("{name}.{inner}"), value);
            }
            return;
        }
        let one = Value::Map(Map::from([(name.as_str(), to_value(value))]));
        match Properties::from_value(&one) {
            Ok(one) => {
                for (name, value) in one {
                    if self.parameters.insert(name.as_str(), value).is_some() {
                        let why = format!("parameter {name:?} is there twice, once with a dot");
                        self.faults.push((name, why));
                    }
                }
            }
            Err(error) => self.faults.push((name, error.to_string())),
        }
    }
}

/// A parameter of a namespace as ROS 1 names it: `camera.rate` is `camera/rate`.
pub(crate) fn under(key: &str, name: &str) -> String {
    let parts = name.split(['.', '/']).filter(|part| !part.is_empty());
    parts.fold(key.trim_end_matches('/').to_owned(), |path, part| format!("{path}/{part}"))
}

/// The name in a namespace of the parameter `path`; `None` where it is elsewhere.
pub(super) fn within(key: &str, path: &str) -> Option<String> {
    let rest = path.strip_prefix(key.trim_end_matches('/'))?.strip_prefix('/')?;
    Some(rest.trim_end_matches('/').replace('/', "."))
}

/// `None` for one that is to be deleted.
pub(crate) fn to_xml(value: &ParameterValue) -> Option<Xml> {
    fn list<T>(items: &[T], one: impl Fn(&T) -> Xml) -> Xml {
        Xml::Array(items.iter().map(one).collect())
    }
    let integer = |number: i64| i32::try_from(number).map_or(Xml::Long(number), Xml::Integer);
    Some(match value {
        ParameterValue::NotSet => return None,
        ParameterValue::Bool(value) => Xml::Boolean(*value),
        ParameterValue::Integer(value) => integer(*value),
        ParameterValue::Double(value) => Xml::Double(*value),
        ParameterValue::String(value) => Xml::String(value.clone()),
        ParameterValue::ByteArray(value) => Xml::Base64(value.clone()),
        ParameterValue::BoolArray(all) => list(all, |value| Xml::Boolean(*value)),
        ParameterValue::IntegerArray(all) => list(all, |value| integer(*value)),
        ParameterValue::DoubleArray(all) => list(all, |value| Xml::Double(*value)),
        ParameterValue::StringArray(all) => list(all, |value| Xml::String(value.clone())),
    })
}

pub(super) fn to_value(value: Xml) -> Value {
    match value {
        Xml::Integer(value) => Value::from(i64::from(value)),
        Xml::Long(value) => Value::from(value),
        Xml::Boolean(value) => value.into(),
        Xml::String(value) => Value::from(value),
        Xml::Double(value) => Value::from(value),
        Xml::Base64(value) => Value::Bytes(value.into()),
        Xml::Array(items) => Value::List(items.into_iter().map(to_value).collect()),
        Xml::Struct(members) => {
            let members =
                members.into_iter().map(|(name, value)| (Value::from(name), to_value(value)));
            Value::Map(members.collect::<Map>())
        }
        Xml::DateTime(value) => Value::from(value.to_string()),
        _ => Value::Null,
    }
}

/// About as many bytes as it takes on the wire.
pub(super) fn size(value: &Xml) -> usize {
    match value {
        Xml::String(text) => text.len(),
        Xml::Base64(bytes) => bytes.len(),
        Xml::Array(items) => items.iter().map(size).sum(),
        Xml::Struct(members) => members.iter().map(|(name, value)| name.len() + size(value)).sum(),
        _ => 8,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_paths_and_return() {
        assert_eq!(under("/x", "gain"), "/x/gain");
        assert_eq!(under("/x/", "camera.rate"), "/x/camera/rate");
        assert_eq!(under("/x", "a/b..c"), "/x/a/b/c");
        assert_eq!(within("/x", "/x/camera/rate/").as_deref(), Some("camera.rate"));
        assert_eq!(within("/", "/gain").as_deref(), Some("gain"));
        assert_eq!(
            [within("/x", "/xy/gain"), within("/x", "/y"), within("/x", "/x")],
            [None, None, None]
        );
    }

    #[test]
    fn values_return() {
        for value in [
            ParameterValue::Bool(true),
            ParameterValue::Integer(-5),
            ParameterValue::Integer(1 << 40),
            ParameterValue::Double(2.5),
            ParameterValue::String("text".into()),
            ParameterValue::ByteArray(vec![0, 255]),
            ParameterValue::BoolArray(vec![true, false]),
            ParameterValue::IntegerArray(vec![1, 2]),
            ParameterValue::DoubleArray(vec![1.5, 2.0]),
            ParameterValue::StringArray(vec!["a".into(), "b".into()]),
        ] {
            let members = [("p".to_owned(), to_xml(&value).unwrap())].into();
            let flat = flatten(Xml::Struct(members));
            assert_eq!((flat.parameters.get("p"), flat.faults.len()), (Some(&value), 0));
        }
        assert_eq!(to_xml(&ParameterValue::NotSet), None);
    }

    #[test]
    fn what_no_parameter_can_be_is_named_and_the_rest_read() {
        let list = |items: Vec<Xml>| Xml::Array(items);
        let text = |text: &str| Xml::String(text.to_owned());
        let members = [
            ("rows".to_owned(), list(vec![list(vec![Xml::Integer(1)])])),
            ("mixed".to_owned(), list(vec![Xml::Integer(1), text("a")])),
            (
                "structs".to_owned(),
                list(vec![Xml::Struct([("a".to_owned(), Xml::Integer(1))].into())]),
            ),
            ("camera".to_owned(), Xml::Struct([("rate".to_owned(), Xml::Integer(30))].into())),
        ];
        let flat = flatten(Xml::Struct(members.into()));
        assert_eq!(flat.parameters, Properties::from([("camera.rate", 30_i64)]));
        let mut names: Vec<&str> = flat.faults.iter().map(|(name, _)| name.as_str()).collect();
        names.sort_unstable();
        assert_eq!(names, ["mixed", "rows", "structs"]);
        assert!(
            flat.faults.iter().all(|(name, why)| why.contains(name.as_str())),
            "{:?}",
            flat.faults
        );
        let single = flatten(Xml::Integer(5));
        assert_eq!(single.faults[0].1, "properties are a namespace of parameters, not int");
    }
}
