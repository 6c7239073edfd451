//! Arrow's types of fixed width, and their arrays over the bytes of tensors.

use std::sync::Arc;

use arrow_array::cast::AsArray as _;
use arrow_array::{Array as _, ArrayRef, RecordBatch, RecordBatchOptions};
use arrow_buffer::{BooleanBuffer, Buffer, NullBuffer};
use arrow_data::ArrayData;
use arrow_schema::{ArrowError, DataType, Schema, TimeUnit};
use bytes::Bytes;

use super::{Dtype, Tensor};

/// Types whose values are plain numbers: name, Arrow's type, what a tensor holds. The numbers of
/// NumPy have its names.
const NUMBERS: [(&str, DataType, Dtype); 18] = [
    ("bool", DataType::Boolean, Dtype::Bool),
    ("int8", DataType::Int8, Dtype::I8),
    ("int16", DataType::Int16, Dtype::I16),
    ("int32", DataType::Int32, Dtype::I32),
    ("int64", DataType::Int64, Dtype::I64),
    ("uint8", DataType::UInt8, Dtype::U8),
    ("uint16", DataType::UInt16, Dtype::U16),
    ("uint32", DataType::UInt32, Dtype::U32),
    ("uint64", DataType::UInt64, Dtype::U64),
    ("float16", DataType::Float16, Dtype::F16),
    ("float32", DataType::Float32, Dtype::F32),
    ("float64", DataType::Float64, Dtype::F64),
    ("date32", DataType::Date32, Dtype::I32),
    ("date64", DataType::Date64, Dtype::I64),
    ("time32[s]", DataType::Time32(TimeUnit::Second), Dtype::I32),
    ("time32[ms]", DataType::Time32(TimeUnit::Millisecond), Dtype::I32),
    ("time64[us]", DataType::Time64(TimeUnit::Microsecond), Dtype::I64),
    ("time64[ns]", DataType::Time64(TimeUnit::Nanosecond), Dtype::I64),
];

const UNITS: [(&str, TimeUnit); 4] = [
    ("s", TimeUnit::Second),
    ("ms", TimeUnit::Millisecond),
    ("us", TimeUnit::Microsecond),
    ("ns", TimeUnit::Nanosecond),
];

/// A unit of time by NumPy's and PyArrow's name: `s`, `ms`, `us` or `ns`.
pub fn unit(name: &str) -> Option<TimeUnit> {
    UNITS.iter().find(|(known, _)| *known == name).map(|(_, unit)| *unit)
}

/// Name of a unit of time.
pub fn unit_name(unit: TimeUnit) -> &'static str {
    UNITS.iter().find(|(_, known)| *known == unit).map_or("", |(name, _)| name)
}

/// Type of plain numbers with this name.
pub fn number_type(name: &str) -> Option<DataType> {
    NUMBERS.iter().find(|(known, ..)| *known == name).map(|(_, found, _)| found.clone())
}

/// Name of a type of plain numbers.
pub fn number_name(data_type: &DataType) -> Option<&'static str> {
    NUMBERS.iter().find(|(_, known, _)| known == data_type).map(|(name, ..)| *name)
}

/// Element type of the tensor that holds the values of a type; `None` for one without a fixed width.
pub fn dtype_of(data_type: &DataType) -> Option<Dtype> {
    match data_type {
        DataType::Timestamp(..) | DataType::Duration(_) => Some(Dtype::I64),
        other => NUMBERS.iter().find(|(_, known, _)| known == other).map(|(.., dtype)| *dtype),
    }
}

/// A decimal number, such as `-1.50`, in units of `10^-scale`.
pub fn decimal(text: &str, scale: i8) -> Option<i128> {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    if !fraction.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    let digits = format!("{whole}{fraction}");
    let zeros = i64::from(scale) - i64::try_from(fraction.len()).ok()?;
    let text = match usize::try_from(zeros) {
        Ok(zeros) => digits + &"0".repeat(zeros),
        // The digits that have no place must be zeros.
        Err(_negative) if fraction.is_empty() => {
            let place = usize::try_from(zeros.unsigned_abs()).ok()?;
            let (rest, cut) = digits.split_at_checked(digits.len().saturating_sub(place))?;
            let is_zero = cut.bytes().all(|b| b == b'0');
            is_zero.then(|| if rest.is_empty() { "0".to_owned() } else { rest.to_owned() })?
        }
        Err(_negative) => return None,
    };
    text.parse().ok()
}

/// Elements of an array of fixed width, missing ones included.
pub fn elements(array: &ArrayRef) -> Option<Tensor> {
    let dtype = dtype_of(array.data_type())?;
    if let Some(values) = array.as_boolean_opt() {
        let bytes: Vec<u8> = values.iter().map(|value| u8::from(value == Some(true))).collect();
        return Tensor::new(dtype, [array.len()], bytes).ok();
    }
    let data = array.to_data();
    let begin = data.offset().checked_mul(dtype.size())?;
    let length = array.len().checked_mul(dtype.size())?;
    let bytes = data.buffers().first()?.as_slice().get(begin..begin.checked_add(length)?)?;
    Tensor::new(dtype, [array.len()], Bytes::copy_from_slice(bytes)).ok()
}

/// An array of fixed width whose elements stay where they lie, or are copied where they lie unaligned.
///
/// # Errors
/// When `data` is shorter than `length` elements.
pub fn fixed(
    data_type: DataType,
    length: usize,
    data: Bytes,
    nulls: Option<NullBuffer>,
) -> Result<ArrayData, ArrowError> {
    let data = match data_type {
        DataType::Boolean => {
            data.iter().map(|&byte| byte != 0).collect::<BooleanBuffer>().into_inner()
        }
        _ => Buffer::from(data),
    };
    ArrayData::builder(data_type)
        .len(length)
        .add_buffer(data)
        .nulls(nulls)
        .align_buffers(true)
        .build()
}

/// Columns as a table, also where there are none.
pub fn batch(
    schema: Schema,
    columns: Vec<ArrayRef>,
    rows: usize,
) -> Result<RecordBatch, ArrowError> {
    let options = RecordBatchOptions::new().with_row_count(Some(rows));
    RecordBatch::try_new_with_options(Arc::new(schema), columns, &options)
}

#[cfg(test)]
mod tests {
    use super::decimal;

    #[test]
    fn decimals_are_read_exactly_or_not_at_all() {
        for (text, scale, number) in [
            ("1.50", 2, Some(150)),
            ("-1.5", 2, Some(-150)),
            ("7", 0, Some(7)),
            ("-1200", -2, Some(-12)),
            ("0", -2, Some(0)),
            ("1250", -2, None),
            ("1.234", 2, None),
            ("1.x", 2, None),
            ("", 0, None),
            ("1e3", 0, None),
            (&"9".repeat(40), 0, None),
        ] {
            assert_eq!(decimal(text, scale), number, "{text} {scale}");
        }
    }
}
