//! Vectors and matrices: `std_msgs/msg/Float64MultiArray`, `Float32MultiArray`, `Int32MultiArray`.
//!
//! ```text
//!   Vector  1 2 3                ◀──▶  dim: [elements: 3]
//!   Matrix  2 3 (1 2 3 4 5 6)    ◀──▶  dim: [rows: 2, columns: 3], row by row
//! ```
//!
//! Numbers of any kind are read, as long as the message can hold them. Written is `VectorOf<int>`
//! for the last type; `VectorOf<float>` for the second one in dialect V4, which V3 lacks: there, as
//! for everything else, it is YARP's `Vector` of float64. Its matrices have no other.

use bytes::Bytes;
use wrapyfi_yarp::sig::{Matrix, Vector};
use wrapyfi_yarp::{Bottle, Dialect, Value as Element};

use super::rules::Rules;
use super::{fault, native};
use wrapyfi_data::types::{Map, Tensor, Value};
use wrapyfi_endpoint::codec::{DecodeError, DecodeResult, EncodeError, EncodeResult};

/// Most dimensions of an array that YARP has a form for.
const DIMENSIONS: usize = 2;

/// Kind of the numbers of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Width {
    Float64,
    Float32,
    Int32,
}

impl Width {
    /// Width of a ROS type which is an array of numbers.
    pub(super) fn of(ros_type: &str) -> Option<Self> {
        match ros_type {
            "std_msgs/msg/Float64MultiArray" => Some(Self::Float64),
            "std_msgs/msg/Float32MultiArray" => Some(Self::Float32),
            "std_msgs/msg/Int32MultiArray" => Some(Self::Int32),
            _ => None,
        }
    }

    /// The numbers in the data of a message; none where it is something else.
    fn read(self, data: &Tensor) -> Option<Vec<f64>> {
        match self {
            Self::Float64 => data.to_vec::<f64>(),
            Self::Float32 => Some(data.to_vec::<f32>()?.into_iter().map(f64::from).collect()),
            Self::Int32 => Some(data.to_vec::<i32>()?.into_iter().map(f64::from).collect()),
        }
    }

    /// Numbers as the data of a message.
    fn data(self, values: Vec<f64>) -> DecodeResult<Tensor> {
        let count = [values.len()];
        let data = match self {
            Self::Float64 => Tensor::from_elements(&count, values),
            Self::Float32 => {
                // to the nearest: that is the message's width
                let values = values.into_iter().map(|value| value as f32).collect();
                Tensor::from_elements(&count, values)
            }
            Self::Int32 => {
                let values: Result<Vec<i32>, _> = values.into_iter().map(integer).collect();
                Tensor::from_elements(&count, values?)
            }
        };
        data.map_err(|error| DecodeError::malformed("vector", error.to_string()))
    }
}

/// A number that is one of 32 bits.
fn integer(value: f64) -> DecodeResult<i32> {
    // Compared with what it was.
    let whole = value as i32;
    if f64::from(whole) == value {
        return Ok(whole);
    }
    Err(DecodeError::mismatch(
        "integers of 32 bits",
        format!("{value}: use std_msgs/msg/Float64MultiArray"),
    ))
}

/// Numbers, and rows and columns where they are a matrix.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Numbers {
    pub(super) values: Vec<f64>,
    pub(super) shape: Option<(usize, usize)>,
}

impl Numbers {
    fn vector(values: Vec<f64>) -> Self {
        Self { values, shape: None }
    }
}

/// Reads a vector, a matrix, or any bottle of numbers or of equal lists of numbers.
pub(super) fn read(bytes: &Bytes, rules: Rules<'_>) -> DecodeResult<Numbers> {
    let bounds = fault::limits(rules.limits);
    if let Ok(Vector(values)) = Vector::<f64>::decode(bytes, rules.dialect, &bounds) {
        return Ok(Numbers::vector(values));
    }
    if let Ok(matrix) = Matrix::decode(bytes, rules.dialect, &bounds) {
        let shape = Some((matrix.rows(), matrix.columns()));
        return Ok(Numbers { values: matrix.values().to_vec(), shape });
    }
    let bottle = native::bottle(bytes, rules)?;
    of_bottle(&bottle).ok_or_else(|| {
        DecodeError::mismatch("a vector or a matrix of numbers", native::as_text(&bottle))
    })
}

/// All elements as numbers.
pub(super) fn plain(bottle: &Bottle) -> Option<Vec<f64>> {
    bottle.into_iter().map(Element::as_f64).collect()
}

fn of_bottle(bottle: &Bottle) -> Option<Numbers> {
    if let Some(values) = plain(bottle) {
        return Some(Numbers::vector(values));
    }
    // A matrix that came as text.
    if let [rows, columns, Element::List(list)] = bottle.values.as_slice() {
        let size = |value: &Element| usize::try_from(value.as_i64()?).ok();
        let (rows, columns) = (size(rows)?, size(columns)?);
        let values =
            plain(list).filter(|values| rows.checked_mul(columns) == Some(values.len()))?;
        return Some(Numbers { values, shape: Some((rows, columns)) });
    }
    let rows: Vec<Vec<f64>> =
        bottle.into_iter().map(|row| plain(row.as_list()?)).collect::<Option<_>>()?;
    let columns = rows.first()?.len();
    let shape = Some((rows.len(), columns));
    rows.iter().all(|row| row.len() == columns).then(|| Numbers { values: rows.concat(), shape })
}

/// The fields of the message.
pub(super) fn to_fields(numbers: Numbers, width: Width) -> DecodeResult<Map> {
    let Numbers { values, shape } = numbers;
    let count = values.len();
    let dims: Vec<Value> = match shape {
        None => vec![dim("elements", count, count)],
        Some((rows, columns)) => vec![dim("rows", rows, count), dim("columns", columns, columns)],
    };
    let data = width.data(values)?;
    let layout = Map::from([("dim", Value::List(dims)), ("data_offset", 0.into())]);
    Ok(Map::from([("layout", Value::from(layout)), ("data", data.into())]))
}

fn dim(label: &str, size: usize, stride: usize) -> Value {
    let number = |value: usize| Value::from(value as u64);
    Map::from([("label", label.into()), ("size", number(size)), ("stride", number(stride))]).into()
}

/// The numbers in the fields of a message.
pub(super) fn of_fields(fields: &Value, width: Width) -> EncodeResult<Numbers> {
    let data = fields.get("data").and_then(Value::as_tensor).and_then(|data| width.read(data));
    let data = data.unwrap_or_default();
    let layout = fields.get("layout");
    let number = |map: Option<&Value>, key: &str| {
        let value = map.and_then(|map| map.get(key)).and_then(Value::as_i64).unwrap_or(0);
        usize::try_from(value).unwrap_or(usize::MAX)
    };
    let offset = number(layout, "data_offset");
    let dims = layout.and_then(|layout| layout.get("dim")).and_then(Value::as_items);
    let dims = dims.unwrap_or_default();
    let (rows, columns) = match dims {
        [] | [_] => {
            let rest = data.get(offset..).ok_or_else(|| beyond(offset, 0, data.len()))?;
            return Ok(Numbers::vector(rest.to_vec()));
        }
        [rows, columns] => (rows, columns),
        more => {
            let what = format!("an array of {} dimensions", more.len());
            let remedy = format!("YARP has vectors and matrices: use at most {DIMENSIONS}");
            return Err(fault::unwritable("matrix", what, "$.layout.dim", remedy));
        }
    };
    let stride = number(Some(columns), "stride");
    let (rows, columns) = (number(Some(rows), "size"), number(Some(columns), "size"));
    // Strides of zero mean rows without gaps.
    let stride = if stride == 0 { columns } else { stride };
    let wanted = rows.saturating_mul(columns);
    if wanted > data.len() {
        return Err(beyond(offset, wanted, data.len()));
    }
    let mut values = Vec::with_capacity(wanted);
    if columns > 0 {
        for row in 0..rows {
            let start = row.saturating_mul(stride).saturating_add(offset);
            let row = data.get(start..start.saturating_add(columns));
            values.extend_from_slice(row.ok_or_else(|| beyond(offset, wanted, data.len()))?);
        }
    }
    let shape = Some((if columns > 0 { rows } else { 0 }, columns));
    Ok(Numbers { values, shape })
}

fn beyond(offset: usize, wanted: usize, given: usize) -> EncodeError {
    EncodeError::mismatch(
        format!("{wanted} numbers behind offset {offset}, as layout says"),
        format!("data of {given}"),
    )
}

/// Writes a vector or a matrix.
/// Writes a vector of float64.
pub(super) fn write_vector(values: Vec<f64>, rules: Rules<'_>) -> EncodeResult<Vec<u8>> {
    write(Numbers { values, shape: None }, Width::Float64, rules.dialect)
}

/// The numbers of a field of a message.
pub(super) fn field(values: Vec<f64>) -> DecodeResult<Value> {
    let tensor = Tensor::from_elements(&[values.len()], values);
    tensor.map(Value::from).map_err(|error| DecodeError::malformed("vector", error.to_string()))
}

// They were of that width in the message.
pub(super) fn write(numbers: Numbers, width: Width, dialect: Dialect) -> EncodeResult<Vec<u8>> {
    let count = numbers.values.len();
    let written = match (numbers.shape, width, dialect) {
        (None, Width::Int32, _) => {
            Vector::<i32>(numbers.values.into_iter().map(|value| value as i32).collect())
                .encode(dialect)
        }
        (None, Width::Float32, Dialect::V4) => {
            Vector::<f32>(numbers.values.into_iter().map(|value| value as f32).collect())
                .encode(dialect)
        }
        (None, _, _) => Vector(numbers.values).encode(dialect),
        (Some((rows, columns)), _, _) => {
            Matrix::new(rows, columns, numbers.values).and_then(|matrix| matrix.encode(dialect))
        }
    };
    written.map_err(|error| {
        fault::unwritable("vector", format!("{count} numbers"), "$.data", error.to_string())
    })
}
