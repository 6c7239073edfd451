//! Tables as text for a terminal.

use std::fmt;

use arrow_array::cast::AsArray as _;
use arrow_array::types::{
    Decimal128Type, DurationMicrosecondType, DurationMillisecondType, DurationNanosecondType,
    DurationSecondType, Float16Type, Float32Type, Float64Type, TimestampMicrosecondType,
    TimestampMillisecondType, TimestampNanosecondType, TimestampSecondType,
};
use arrow_array::{Array, ArrayRef, downcast_integer};
use arrow_schema::{DataType, TimeUnit};

use super::Table;

/// Rows, and columns, that are shown of a larger table.
const SHOWN: usize = 10;
/// Characters of a cell.
const WIDTH: usize = 24;

/// Kind, size, and the first rows and columns: `DataFrame, 3 rows of 2 columns`.
impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (rows, columns) = (self.batch.num_rows(), self.batch.num_columns());
        let kind = self.origin.get("kind").unwrap_or("DataFrame");
        write!(f, "{kind}, {rows} rows of {columns} columns")?;
        let schema = self.batch.schema();
        let shown = schema.fields().iter().zip(self.batch.columns()).take(SHOWN);
        let texts: Vec<Vec<String>> = shown
            .map(|(field, array)| {
                let cells = (0..rows.min(SHOWN)).map(|row| cell(array, row));
                std::iter::once(field.name().clone()).chain(cells).map(cut).collect()
            })
            .collect();
        let widths: Vec<usize> = texts
            .iter()
            .map(|column| column.iter().map(|text| text.chars().count()).max().unwrap_or(0))
            .collect();
        for line in 0..=rows.min(SHOWN) {
            let cells = texts.iter().zip(&widths).map(|(column, width)| {
                let text = column.get(line).map(String::as_str).unwrap_or_default();
                format!("{text:<width$}")
            });
            let cells = cells.collect::<Vec<_>>().join("  ");
            let more = if columns > SHOWN { "  …" } else { "" };
            write!(f, "\n  {}{more}", cells.trim_end())?;
        }
        if rows > SHOWN { f.write_str("\n  …") } else { Ok(()) }
    }
}

fn cut(text: String) -> String {
    if text.chars().count() <= WIDTH {
        return text;
    }
    text.chars().take(WIDTH - 1).chain(['…']).collect()
}

/// An element as text, `-` for one that is missing.
fn cell(array: &ArrayRef, row: usize) -> String {
    if array.is_null(row) {
        return "-".to_owned();
    }
    macro_rules! number {
        ($kind:ty) => {
            array.as_primitive::<$kind>().value(row).to_string()
        };
    }
    macro_rules! time {
        ($kind:ty) => {{
            let times = array.as_primitive::<$kind>();
            // In UTC, whatever the zone: its rules are not at hand.
            let zone = if times.timezone().is_some() { "Z" } else { "" };
            let time = times.value_as_datetime(row);
            time.map_or_else(|| times.value(row).to_string(), |time| format!("{time}{zone}"))
        }};
    }
    let listed = |items: &ArrayRef| {
        let more = if items.len() > SHOWN { ", …" } else { "" };
        let items = (0..items.len().min(SHOWN)).map(|row| cell(items, row));
        format!("[{}{more}]", items.collect::<Vec<_>>().join(", "))
    };
    downcast_integer! { array.data_type() => (number),
        DataType::Boolean => array.as_boolean().value(row).to_string(),
        DataType::Float16 => number!(Float16Type),
        DataType::Float32 => number!(Float32Type),
        DataType::Float64 => number!(Float64Type),
        DataType::Decimal128(..) => array.as_primitive::<Decimal128Type>().value_as_string(row),
        DataType::Utf8 => array.as_string::<i32>().value(row).to_owned(),
        DataType::LargeUtf8 => array.as_string::<i64>().value(row).to_owned(),
        DataType::Binary => format!("{} bytes", array.as_binary::<i32>().value(row).len()),
        DataType::Timestamp(TimeUnit::Second, _) => time!(TimestampSecondType),
        DataType::Timestamp(TimeUnit::Millisecond, _) => time!(TimestampMillisecondType),
        DataType::Timestamp(TimeUnit::Microsecond, _) => time!(TimestampMicrosecondType),
        DataType::Timestamp(TimeUnit::Nanosecond, _) => time!(TimestampNanosecondType),
        DataType::Duration(TimeUnit::Second) => number!(DurationSecondType) + " s",
        DataType::Duration(TimeUnit::Millisecond) => number!(DurationMillisecondType) + " ms",
        DataType::Duration(TimeUnit::Microsecond) => number!(DurationMicrosecondType) + " us",
        DataType::Duration(TimeUnit::Nanosecond) => number!(DurationNanosecondType) + " ns",
        DataType::Dictionary(..) => {
            let dictionary = array.as_any_dictionary();
            // A valid key implies that the dictionary has values.
            let key = dictionary.normalized_keys().get(row).copied().unwrap_or_default();
            cell(dictionary.values(), key)
        }
        DataType::List(_) => listed(&array.as_list::<i32>().value(row)),
        DataType::LargeList(_) => listed(&array.as_list::<i64>().value(row)),
        DataType::FixedSizeList(..) => listed(&array.as_fixed_size_list().value(row)),
        DataType::Struct(fields) => {
            let members = fields.iter().zip(array.as_struct().columns());
            let members =
                members.map(|(field, array)| format!("{}: {}", field.name(), cell(array, row)));
            format!("{{{}}}", members.collect::<Vec<_>>().join(", "))
        }
        other => other.to_string(),
    }
}
