//! A frame between pandas and Arrow: columns with labels, and an index.
//!
//! ```text
//!   Frame { kind, index, columns } ◀─▶ Table { batch: [index column,] columns…, origin }
//! ```
//!
//! Properties that Arrow has no place for are the origin's attributes, as JSON where they are no
//! text:
//!
//! | attribute | says | without it |
//! | --- | --- | --- |
//! | `kind` | `DataFrame`, `Series` or `Index` | `DataFrame` |
//! | `index` | `range START STOP STEP`, `column`: the first column, or `levels N`: the first N columns, each a dictionary of its labels | a range over the rows |
//! | `index_name` | name of a range; names of the levels, where one is no text | none |
//! | `freq` | step of the times in the index: `15min`, `QS-FEB` | none |
//! | `labels` | labels of the columns | the fields' names |
//! | `columns_name` | name of the labels | none |

use std::collections::BTreeSet;
use std::sync::Arc;

use arrow_array::{Array as _, ArrayRef};
use arrow_schema::{Field, Schema};
use wrapyfi_interfaces::named;

use super::super::PluginError;
use super::cells;
use crate::malformed;
use wrapyfi_data::types::arrow::batch;
use wrapyfi_data::types::{Origin, Table, Value};

/// Name of pandas's type in a field's metadata.
pub(super) const DTYPE: &str = "dtype";

named! {
    /// Class of pandas that a frame is.
    pub(super) enum Kind {
        Frame => "DataFrame",
        Series => "Series",
        Index => "Index",
    }
    /// Name of the pandas type.
    pub fn name, from_name;
}

/// Values of one column, or of an index.
#[derive(Debug, Clone)]
pub(super) struct Column {
    /// Label of a column, name of an index or series: text, a number, `None`, or a tuple of such
    /// where labels have several levels.
    pub(super) label: Value,
    /// pandas's name of the type: `int64`, `object`, `datetime64[ns]`, `category`, `Int64`, …
    pub(super) dtype: String,
    pub(super) array: ArrayRef,
}

/// Labels of the rows.
#[derive(Debug, Clone)]
pub(super) enum Index {
    Range {
        start: i64,
        stop: i64,
        step: i64,
        name: Value,
    },
    /// A column, and the step of its times where they are regular.
    Column(Box<Column>, Option<String>),
    /// Several levels, each a dictionary of its labels.
    Levels(Vec<Column>),
}

/// A data frame, a series (one column) or an index (no column).
#[derive(Debug, Clone)]
pub(super) struct Frame {
    pub(super) kind: Kind,
    pub(super) index: Index,
    pub(super) columns: Vec<Column>,
    /// Name of the row of labels.
    pub(super) columns_name: Value,
}

impl Index {
    /// Number of rows.
    pub(super) fn len(&self) -> usize {
        match self {
            Self::Range { start, stop, step, .. } => range_length(*start, *stop, *step),
            Self::Column(column, _) => column.array.len(),
            Self::Levels(levels) => levels.first().map_or(0, |level| level.array.len()),
        }
    }
}

/// As Python's `len(range(start, stop, step))`; nothing for a step of 0.
pub(super) fn range_length(start: i64, stop: i64, step: i64) -> usize {
    let span = i128::from(stop) - i128::from(start);
    let step = i128::from(step);
    if step == 0 || (span > 0) != (step > 0) {
        return 0;
    }
    usize::try_from((span + step - step.signum()) / step).unwrap_or(usize::MAX)
}

/// The integers of Python's `range(start, stop, step)`.
pub(super) fn range_labels(start: i64, stop: i64, step: i64) -> impl Iterator<Item = i64> {
    let count = i64::try_from(range_length(start, stop, step)).unwrap_or(0);
    (0..count).map(move |n| start.wrapping_add(n.wrapping_mul(step)))
}

impl Frame {
    /// The frame as a table of the plug-in `key`.
    pub(super) fn into_table(self, key: &str) -> Result<Table, PluginError> {
        let rows = self.index.len();
        let mut origin = Origin::new(key).with("kind", self.kind.name());
        let labels: Vec<&Value> = self.columns.iter().map(|column| &column.label).collect();
        let texts: BTreeSet<&str> = labels.iter().filter_map(|label| label.as_str()).collect();
        if texts.len() < labels.len() {
            origin = origin.with("labels", to_json(&labels.iter().copied().cloned().collect())?);
        }
        if self.columns_name != Value::Null {
            origin = origin.with("columns_name", to_json(&self.columns_name)?);
        }
        let mut columns = Vec::new();
        match self.index {
            Index::Range { start: 0, step: 1, name: Value::Null, .. } => {}
            Index::Range { start, stop, step, name } => {
                origin = origin.with("index", format!("range {start} {stop} {step}"));
                if name != Value::Null {
                    origin = origin.with("index_name", to_json(&name)?);
                }
            }
            Index::Column(column, freq) => {
                origin = origin.with("index", "column");
                if !matches!(column.label, Value::Str(_)) {
                    origin = origin.with("index_name", to_json(&column.label)?);
                }
                if let Some(freq) = freq {
                    origin = origin.with("freq", freq);
                }
                columns.push(*column);
            }
            Index::Levels(levels) => {
                origin = origin.with("index", format!("levels {}", levels.len()));
                if levels.iter().any(|level| !matches!(level.label, Value::Str(_))) {
                    let names = levels.iter().map(|level| level.label.clone()).collect();
                    origin = origin.with("index_name", to_json(&names)?);
                }
                columns.extend(levels);
            }
        }
        columns.extend(self.columns);
        let fields = columns.iter().map(|column| {
            let name = match &column.label {
                Value::Str(label) => label.clone(),
                Value::Null => String::new(),
                Value::Tuple(levels) => {
                    let levels: Vec<_> = levels.iter().map(to_json).collect();
                    format!("({})", levels.into_iter().flatten().collect::<Vec<_>>().join(", "))
                }
                other => to_json(other).unwrap_or_default(),
            };
            Field::new(name, column.array.data_type().clone(), true)
                .with_metadata([(DTYPE.to_owned(), column.dtype.clone())])
        });
        let schema = Schema::new(fields.collect::<Vec<_>>());
        let arrays = columns.into_iter().map(|column| column.array).collect();
        let batch = batch(schema, arrays, rows).map_err(malformed)?;
        Ok(Table { batch, origin: Arc::new(origin) })
    }

    /// The frame that a table is, of whichever library.
    pub(super) fn from_table(table: &Table) -> Result<Self, PluginError> {
        let origin = &table.origin;
        let mut columns: Vec<Column> = table
            .batch
            .schema_ref()
            .fields()
            .iter()
            .zip(table.batch.columns())
            .map(|(field, array)| Column {
                label: field.name().as_str().into(),
                dtype: field.metadata().get(DTYPE).cloned().unwrap_or_default(),
                array: Arc::clone(array),
            })
            .collect();
        let rows = i64::try_from(table.batch.num_rows()).unwrap_or(i64::MAX);
        let name = |key: &str| origin.get(key).map_or(Ok(Value::Null), from_json);
        let index = match origin.get("index") {
            Some("column") if !columns.is_empty() => {
                let mut column = columns.remove(0);
                if origin.get("index_name").is_some() {
                    column.label = name("index_name")?;
                }
                Index::Column(Box::new(column), origin.get("freq").map(str::to_owned))
            }
            Some(text) => match text.split(' ').collect::<Vec<_>>()[..] {
                ["levels", count] => {
                    let count =
                        count.parse().ok().filter(|count| (1..=columns.len()).contains(count));
                    let count = count.ok_or_else(|| wrong("index", text))?;
                    let rest = columns.split_off(count);
                    let mut levels = std::mem::replace(&mut columns, rest);
                    if let Some(names) = name("index_name")?.as_items() {
                        for (level, name) in levels.iter_mut().zip(names) {
                            level.label = name.clone();
                        }
                    }
                    Index::Levels(levels)
                }
                ["range", start, stop, step] => {
                    let number =
                        |text: &str| text.parse().map_err(|_no_number| wrong("index", text));
                    let (start, stop, step) = (number(start)?, number(stop)?, number(step)?);
                    if step == 0 {
                        return Err(wrong("index", text));
                    }
                    Index::Range { start, stop, step, name: name("index_name")? }
                }
                _ => return Err(wrong("index", text)),
            },
            None => Index::Range { start: 0, stop: rows, step: 1, name: name("index_name")? },
        };
        if let Some(text) = origin.get("labels") {
            let labels = from_json(text)?;
            let labels = labels.as_items().filter(|labels| labels.len() == columns.len());
            let labels = labels.ok_or_else(|| wrong("labels", text))?;
            for (column, label) in columns.iter_mut().zip(labels) {
                column.label = label.clone();
            }
        }
        let kind = match (origin.get("kind"), columns.len(), &index) {
            (Some("Series"), 1, _) => Kind::Series,
            (Some("Index"), 0, _) => Kind::Index,
            (Some("Series" | "Index"), count, _) => {
                return Err(wrong("kind", &format!("that of {count} columns")));
            }
            _ => Kind::Frame,
        };
        if kind != Kind::Index && index.len() != table.batch.num_rows() && !columns.is_empty() {
            return Err(wrong("index", &format!("{} labels for {rows} rows", index.len())));
        }
        // Names of several levels are a tuple, as pandas has them; a list is taken for one.
        let columns_name = match name("columns_name")? {
            Value::List(names) => Value::Tuple(names),
            other => other,
        };
        Ok(Self { kind, index, columns, columns_name })
    }
}

fn to_json(value: &Value) -> Result<String, PluginError> {
    cells::to_text(value).map_err(|error| {
        PluginError::unsupported(format!("a label of type {}", value.kind()), error)
    })
}

fn from_json(text: &str) -> Result<Value, PluginError> {
    cells::from_text(text).map_err(|error| wrong("label", &error))
}

fn wrong(attribute: &str, text: &str) -> PluginError {
    PluginError::unsupported(
        format!("a table whose attribute {attribute:?} is {text:?}"),
        "leave it out, or see the documentation of plug-ins",
    )
}

#[cfg(test)]
mod tests {
    use super::range_length;

    #[test]
    fn ranges_are_as_long_as_pythons() {
        for ((start, stop, step), length) in [
            ((0, 3, 1), 3),
            ((0, 0, 1), 0),
            ((0, 5, 2), 3),
            ((5, 0, -2), 3),
            ((5, 0, 1), 0),
            ((0, 5, 0), 0),
            ((i64::MIN, i64::MAX, 1), usize::MAX),
        ] {
            assert_eq!(range_length(start, stop, step), length, "{start} {stop} {step}");
        }
    }
}
