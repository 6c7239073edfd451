//! `XArrayData`: xarray's `DataArray` and `Dataset`.
//!
//! ```text
//!   ["XArrayData", base64 of Dataset.to_dict() as JSON, "DataArray" | "Dataset", name]
//!
//!   {"coords": {"x": {"dims": ["x"], "attrs": {}, "data": [10, 20]}}, "attrs": {}, "dims": {"x": 2},
//!    "data_vars": {"t": {"dims": ["x"], "attrs": {"u": "K"}, "data": [0.5, NaN]}}}
//!                                                                     └ Tensor: float64, int64, bool
//!   {"data": "2024-01-01T00:00:00", "dtype": "datetime"}                DateTime, anywhere
//! ```
//!
//! A `DataArray` is a data set of one array, whose name stands behind it.

use super::{Body, Part, Plugin, PluginError, Plugins, Unpacking};
use crate::malformed;
use wrapyfi_data::codec::{DecodeError, json};
use wrapyfi_data::types::{
    DateTime, Labelled, LabelledContent, Map, Value, Variable, nested_list, rectangular,
};

/// xarray's labelled arrays.
pub(super) struct XArray;

const ARRAY: &str = "DataArray";
const DATASET: &str = "Dataset";

impl Plugin for XArray {
    fn key(&self) -> &str {
        "XArrayData"
    }

    fn decode(&self, body: &Body<'_>, context: &Unpacking<'_>) -> Result<Value, PluginError> {
        let kind = body.text(1)?;
        let file = body.base64(0)?;
        let text = json::decode(&file, &context.limits_within(file.len()), &Plugins::none())
            .map_err(|error| match error {
                DecodeError::TooLarge { what, path, actual, limit } => PluginError::TooLarge {
                    what: format!("{what} at {path} of part 0"),
                    actual,
                    limit,
                },
                other => malformed(other.to_string()),
            })?;
        drop(file);
        let Value::Map(dataset) = text else {
            return Err(malformed(format!("a {} where a dict should be", text.kind())));
        };
        let mut found = Dataset::read(dataset).map_err(malformed)?;
        let coords = std::mem::take(&mut found.coords);
        let (name, content) = match &*kind {
            DATASET => (None, found.into_content().map_err(malformed)?),
            ARRAY => {
                let name = body.text(2)?;
                let array = found.variables.into_iter().find(|(found, _)| *found == name);
                let array =
                    array.ok_or_else(|| malformed(format!("$.data_vars lacks {name:?}")))?;
                (Some(name), LabelledContent::Array(array.1))
            }
            other => {
                return Err(PluginError::unsupported(
                    format!("an xarray {other:?}"),
                    format!("send a {ARRAY} or a {DATASET}"),
                ));
            }
        };
        Ok(Labelled { name, content, coords }.into())
    }

    fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError> {
        let labelled =
            value.as_labelled().ok_or_else(|| PluginError::not_mine("labelled array", value))?;
        let coords = variables_text(&labelled.coords)?;
        let (attrs, dims, variables, kind, name) = match &labelled.content {
            LabelledContent::Dataset { dims, variables, attrs } => {
                (attrs_text(attrs)?, dims.clone(), variables_text(variables)?, DATASET, None)
            }
            LabelledContent::Array(array) => {
                let name = labelled.name.clone().ok_or_else(|| {
                    PluginError::unsupported(
                        "a DataArray without a name",
                        "give it one: Wrapyfi looks it up by name",
                    )
                })?;
                let variables = Map::from([(&*name, variable_text(array)?)]);
                let dims = extents(array, &labelled.coords);
                (Map::new(), dims, variables, ARRAY, Some(name))
            }
        };
        let text = Value::Map(Map::from_iter([
            ("coords", Value::Map(coords)),
            ("attrs", attrs.into()),
            ("dims", json::extents_body(&dims).into()),
            ("data_vars", variables.into()),
        ]));
        let text = json::encode(&text, &Plugins::none())
            .map_err(|error| PluginError::unsupported("this array", error.to_string()))?;
        let name = name.map_or(Part::Value(Value::Null), Part::Text);
        Ok(vec![Part::base64(text), Part::Text(kind.into()), name])
    }
}

/// The dict of xarray's `to_dict`.
struct Dataset {
    coords: Vec<(String, Variable)>,
    variables: Vec<(String, Variable)>,
    dims: Option<Value>,
    attrs: Map,
}

impl Dataset {
    fn read(dataset: Map) -> Result<Self, String> {
        let (mut coords, mut variables) = (Vec::new(), None);
        let (mut dims, mut attrs) = (None, Map::new());
        for (key, member) in dataset {
            match key.as_str() {
                Some("coords") => coords = named(member, "$.coords")?,
                Some("data_vars") => variables = Some(named(member, "$.data_vars")?),
                Some("dims") => dims = Some(member),
                Some("attrs") => attrs = attributes(member, "$.attrs")?,
                // `from_dict` ignores what it does not know, such as `encoding`.
                _ => {}
            }
        }
        let variables = variables.ok_or("$.data_vars is missing")?;
        Ok(Self { coords, variables, dims, attrs })
    }

    fn into_content(self) -> Result<LabelledContent, String> {
        let dims = match self.dims {
            None => Vec::new(),
            Some(Value::Map(dims)) => {
                let reason = "$.dims holds something that is no extent, from 0 on, by name";
                json::extents(&dims).ok_or(reason)?
            }
            Some(other) => return Err(format!("$.dims is a {}, no dict", other.kind())),
        };
        let Self { variables, attrs, .. } = self;
        Ok(LabelledContent::Dataset { dims, variables, attrs })
    }
}

fn named(members: Value, path: &str) -> Result<Vec<(String, Variable)>, String> {
    let Value::Map(members) = members else {
        return Err(format!("{path} is a {}, no dict", members.kind()));
    };
    let variable = |(name, member): (Value, Value)| {
        let Value::Str(name) = name else {
            return Err(format!("{path} has a name that is no valid text"));
        };
        let path = format!("{path}.{}", short(&name));
        Ok((name, variable(member, &path)?))
    };
    members.into_iter().map(variable).collect()
}

/// Beginning of a name for an error, because names come from foreign messages.
fn short(name: &str) -> &str {
    name.char_indices().nth(40).map_or(name, |(end, _)| name.get(..end).unwrap_or(name))
}

fn variable(member: Value, path: &str) -> Result<Variable, String> {
    let Value::Map(member) = member else {
        return Err(format!("{path} is a {}, no dict", member.kind()));
    };
    let (mut dims, mut data, mut attrs) = (None, None, Map::new());
    for (key, part) in member {
        match key.as_str() {
            Some("dims") => dims = Some(dimensions(&part, path)?),
            Some("data") => data = Some(part),
            Some("attrs") => attrs = attributes(part, &format!("{path}.attrs"))?,
            _ => {}
        }
    }
    let dims = dims.ok_or_else(|| format!("{path}.dims is missing"))?;
    let data = array(data.ok_or_else(|| format!("{path}.data is missing"))?);
    let depth = match &data {
        Value::Tensor(tensor) => Some(tensor.shape().len()),
        Value::List(_) => None,
        _ => Some(0),
    };
    match depth {
        Some(found) if found != dims.len() => {
            let wanted = dims.len();
            Err(format!("{path}.data has {found} dimensions, {path}.dims names {wanted}"))
        }
        _ => Ok(Variable { dims, data, attrs }),
    }
}

/// Reads a list of names, or a single one, as xarray takes it.
fn dimensions(dims: &Value, path: &str) -> Result<Vec<String>, String> {
    let text = |name: &Value| name.as_str().map(str::to_owned);
    let names = match dims {
        Value::Str(name) => Some(vec![name.clone()]),
        other => other.as_items().and_then(|dims| dims.iter().map(text).collect()),
    };
    names.ok_or_else(|| format!("{path}.dims is no list of names"))
}

fn attributes(attrs: Value, path: &str) -> Result<Map, String> {
    match dated(attrs) {
        Value::Map(attrs) => Ok(attrs),
        other => Err(format!("{path} is a {}, no dict", other.kind())),
    }
}

/// Converts nested lists of numbers to a tensor; other data and a single number stay as they are.
fn array(data: Value) -> Value {
    match data {
        Value::List(items) => match rectangular(&items) {
            Some(tensor) => tensor.into(),
            None => dated(Value::List(items)),
        },
        other => dated(other),
    }
}

/// Replaces the dicts that stand for points in time by these.
fn dated(value: Value) -> Value {
    match value {
        Value::List(items) => Value::List(items.into_iter().map(dated).collect()),
        Value::Map(map) => match (map.get("data"), map.get("dtype").and_then(Value::as_str)) {
            (Some(Value::Str(text)), Some(dtype)) => match (dtype, text.parse()) {
                ("datetime", Ok(when)) => Value::DateTime(when),
                (dtype, _) if dtype.starts_with("datetime64") => Value::DateTime64(text.clone()),
                _ => Value::Map(map),
            },
            _ => Map::from_iter(map.into_iter().map(|(key, member)| (key, dated(member)))).into(),
        },
        other => other,
    }
}

fn variables_text(variables: &[(String, Variable)]) -> Result<Map, PluginError> {
    let text = |(name, member): &(String, Variable)| Ok((name.clone(), variable_text(member)?));
    Ok(Map::from_iter(variables.iter().map(text).collect::<Result<Vec<_>, PluginError>>()?))
}

fn variable_text(variable: &Variable) -> Result<Value, PluginError> {
    Ok(Map::from_iter([
        ("dims", Value::from_iter(variable.dims.iter().cloned())),
        ("attrs", attrs_text(&variable.attrs)?.into()),
        ("data", plain(&variable.data)?),
    ])
    .into())
}

fn attrs_text(attrs: &Map) -> Result<Map, PluginError> {
    let member = |(key, member): (&Value, &Value)| Ok((key.clone(), plain(member)?));
    Ok(Map::from_iter(attrs.iter().map(member).collect::<Result<Vec<_>, PluginError>>()?))
}

/// Converts `value` to plain JSON that Wrapyfi's plug-in reads as the same.
fn plain(value: &Value) -> Result<Value, PluginError> {
    let dated = |when: String| {
        Map::from_iter([("data", Value::from(when)), ("dtype", "datetime".into())]).into()
    };
    let refuse = |what: String, remedy: &str| PluginError::unsupported(what, remedy);
    let items = |items: &[Value]| items.iter().map(plain).collect::<Result<_, _>>();
    Ok(match value {
        Value::Null
        | Value::Bool(_)
        | Value::Int(_)
        | Value::BigInt(_)
        | Value::Float(_)
        | Value::Str(_)
        | Value::Utf16(_) => value.clone(),
        Value::List(members) | Value::Tuple(members) => Value::List(items(members)?),
        Value::Map(map) if map.get("data").is_some() && map.get("dtype").is_some() => {
            let what = "a dict with the keys data and dtype in an xarray object".to_owned();
            return Err(refuse(what, "rename one: Wrapyfi takes it for a point in time"));
        }
        Value::Map(map) => attrs_text(map)?.into(),
        Value::DateTime(when) => dated(when.to_string()),
        // Wrapyfi's reader fails on the form that its writer has for these.
        Value::DateTime64(text) => match text.parse::<DateTime>() {
            Ok(when) => dated(when.to_string()),
            Err(_) => {
                let what = format!("numpy.datetime64 {text:?} in an xarray object");
                return Err(refuse(what, "use a datetime"));
            }
        },
        Value::Tensor(tensor) => nested_list(tensor).ok_or_else(|| {
            let what = format!("{} data in an xarray object", tensor.dtype());
            refuse(what, "use integers, floats or bools")
        })?,
        other => {
            let what = format!("a {} in an xarray object", other.kind());
            return Err(refuse(what, "use numbers, text and datetimes"));
        }
    })
}

/// Extent of each dimension, from the data that have it.
fn extents(array: &Variable, coords: &[(String, Variable)]) -> Vec<(String, usize)> {
    fn shape(data: &Value) -> Vec<usize> {
        match data {
            Value::Tensor(tensor) => tensor.shape().to_vec(),
            Value::List(items) => {
                let inner = items.first().map(shape).unwrap_or_default();
                std::iter::once(items.len()).chain(inner).collect()
            }
            _ => Vec::new(),
        }
    }
    let mut found: Vec<(String, usize)> = Vec::new();
    for variable in std::iter::once(array).chain(coords.iter().map(|(_, coord)| coord)) {
        for (name, extent) in variable.dims.iter().zip(shape(&variable.data)) {
            if found.iter().all(|(known, _)| known != name) {
                found.push((name.clone(), extent));
            }
        }
    }
    found
}
