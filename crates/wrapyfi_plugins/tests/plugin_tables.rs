//! Tables that Wrapyfi's own plug-ins wrote (`tests/data/native`): pandas 2 and 3, PyArrow, decoded
//! and compared with the descriptions beside them, then written and read again.

use std::sync::Arc;

use arrow_array::cast::AsArray as _;
use arrow_array::types::{
    Float16Type, Float32Type, Float64Type, Int8Type, Int32Type, Int64Type,
    TimestampMicrosecondType, TimestampNanosecondType, UInt64Type,
};
use arrow_array::{Array, ArrayRef, RecordBatch};
use arrow_schema::{DataType, Field, Schema, TimeUnit};
use bytes::Bytes;
use proptest::prelude::*;
use serde_json::{Value as Json, json};
use wrapyfi_data::Limits;
use wrapyfi_data::codec::json as codec;
use wrapyfi_data::plugin::Plugins;
use wrapyfi_data::types::{Origin, Table, Value};

/// A vector file of `tests/data/native`.
fn vectors(group: &str) -> Vec<Json> {
    let path = format!("{}/tests/data/native/{group}.json", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(path).unwrap().replace(" NaN", " null");
    let file: Json = serde_json::from_str(&text).unwrap();
    file["vectors"].as_array().unwrap().clone()
}

fn decode(wire: &str) -> Value {
    codec::decode(&Bytes::from(wire.to_owned()), &Limits::default(), &wrapyfi_plugins::standard())
        .unwrap()
}

/// Through `wrapyfi_msgs/msg/NativeObject`: its JSON, and the tensors beside it.
fn through_the_graph(value: &Value) -> Value {
    let plugins = wrapyfi_plugins::standard();
    let (text, tensors) = codec::encode_with_tensors(value, &plugins).unwrap();
    codec::decode_with_tensors(&text.into(), &tensors, &Limits::default(), &plugins).unwrap()
}

fn again(value: &Value) -> Value {
    let text = codec::encode(value, &wrapyfi_plugins::standard())
        .unwrap_or_else(|error| panic!("{error}"));
    let read =
        codec::decode(&text.into(), &Limits::default(), &wrapyfi_plugins::standard()).unwrap();
    assert_eq!(read.refusals().map(|(_, reason)| reason).collect::<Vec<_>>(), [""; 0]);
    read
}

/// Elements as the vector files have them.
fn elements(array: &ArrayRef) -> Vec<Json> {
    let array = match array.data_type() {
        DataType::Dictionary(key, _) if **key == DataType::Int8 => {
            let dictionary = array.as_dictionary::<Int8Type>();
            let values = elements(dictionary.values());
            return dictionary
                .keys()
                .iter()
                .map(|key| values[key.unwrap() as usize].clone())
                .collect();
        }
        _ => array,
    };
    (0..array.len())
        .map(|row| {
            if array.is_null(row) {
                return Json::Null;
            }
            match array.data_type() {
                DataType::Int64 => json!(array.as_primitive::<Int64Type>().value(row)),
                DataType::Int32 => json!(array.as_primitive::<Int32Type>().value(row)),
                DataType::Boolean => json!(array.as_boolean().value(row)),
                DataType::Utf8 => json!(array.as_string::<i32>().value(row)),
                DataType::Float64 => {
                    let value = array.as_primitive::<Float64Type>().value(row);
                    if value.is_nan() { json!("NaN") } else { json!(value) }
                }
                DataType::Timestamp(unit, None) => {
                    let time = match unit {
                        TimeUnit::Nanosecond => {
                            array.as_primitive::<TimestampNanosecondType>().value_as_datetime(row)
                        }
                        _ => {
                            array.as_primitive::<TimestampMicrosecondType>().value_as_datetime(row)
                        }
                    };
                    json!(time.unwrap().format("%Y-%m-%d %H:%M:%S").to_string())
                }
                DataType::Float16 => json!(array.as_primitive::<Float16Type>().value(row).to_f64()),
                DataType::Float32 => json!(array.as_primitive::<Float32Type>().value(row)),
                DataType::UInt64 => json!(array.as_primitive::<UInt64Type>().value(row)),
                DataType::LargeUtf8 => json!(array.as_string::<i64>().value(row)),
                DataType::List(_) => elements(&array.as_list::<i32>().value(row)).into(),
                DataType::LargeList(_) => elements(&array.as_list::<i64>().value(row)).into(),
                DataType::FixedSizeList(..) => {
                    elements(&array.as_fixed_size_list().value(row)).into()
                }
                DataType::Struct(fields) => {
                    let row_of = |(field, column): (&Arc<Field>, &ArrayRef)| {
                        (field.name().clone(), elements(column)[row].clone())
                    };
                    let columns = array.as_struct().columns();
                    Json::Object(fields.iter().zip(columns).map(row_of).collect())
                }
                other => panic!("no description of {other}"),
            }
        })
        .collect()
}

/// A frame, series or index in the words of the vector files.
fn describe(table: &Table) -> Json {
    let kind = table.origin.get("kind").unwrap();
    let has_index = table.origin.get("index") == Some("column");
    let schema = table.batch.schema();
    let skipped = usize::from(has_index);
    let index: Vec<Json> = if has_index {
        elements(table.batch.column(0)).iter().map(|v| json!(v.as_str().unwrap())).collect()
    } else {
        (0..table.batch.num_rows()).map(|row| json!(row.to_string())).collect()
    };
    let columns: Vec<_> = schema.fields().iter().zip(table.batch.columns()).skip(skipped).collect();
    let dtype = |field: &Field| json!(field.metadata().get("dtype").unwrap());
    match kind {
        "Series" => {
            let (field, array) = columns[0];
            let name =
                if table.origin.get("labels").is_some() { Json::Null } else { json!(field.name()) };
            json!({
                "type": "pandas.Series", "name": name, "dtype": dtype(field), "index": index,
                "data": elements(array),
            })
        }
        _ => {
            let name = |field: &Field| field.name().clone();
            let data =
                |(field, array): &(&Arc<Field>, &ArrayRef)| (name(field), json!(elements(array)));
            json!({
                "type": "pandas.DataFrame",
                "index": index,
                "columns": columns.iter().map(|(field, _)| name(field)).collect::<Vec<_>>(),
                "columns_dtypes": columns.iter().map(|(f, _)| (name(f), dtype(f))).collect::<serde_json::Map<_, _>>(),
                "data": columns.iter().map(data).collect::<serde_json::Map<_, _>>(),
            })
        }
    }
}

#[test]
fn frames_of_pandas_2_and_3_are_read_and_written() {
    let mut checked = 0;
    for vector in ["pandas", "pandas3"].into_iter().flat_map(vectors) {
        let name = vector["name"].as_str().unwrap();
        // Times alone are a `datetime` on the wire: tests/native_vectors.rs.
        if name.starts_with("timestamp") {
            continue;
        }
        let value = decode(vector["wire"].as_str().unwrap());
        let Value::Table(table) = &value else { panic!("{name}: {value:?}") };
        if name == "index_alone" {
            assert_eq!(table.origin.get("kind"), Some("Index"));
            assert_eq!(elements(table.batch.column(0)), [json!(1), json!(2)]);
        } else {
            assert_eq!(describe(table), vector["decoded"], "{name}");
        }
        assert_eq!(again(&value), value, "{name}");
        let (text, _) = codec::encode_with_tensors(&value, &wrapyfi_plugins::standard()).unwrap();
        let text = String::from_utf8(text).unwrap();
        assert!(text.starts_with("{\"__wrapyfi__\": [\"table\", "), "{name}: {text}");
        assert_eq!(through_the_graph(&value), value, "{name}");
        checked += 1;
    }
    assert_eq!(checked, 16);
}

/// Columns of Arrow's types, zones, several levels of labels, periods and regular times.
#[test]
fn every_kind_of_column_and_index_of_pandas_is_read_and_written() {
    for vector in vectors("pandas_types") {
        let name = vector["name"].as_str().unwrap();
        let value = decode(vector["wire"].as_str().unwrap());
        let Value::Table(table) = &value else { panic!("{name}: {value:?}") };
        // Text of PyArrow comes back as objects, which are the same to pandas.
        assert_eq!(
            codec::encode(&again(&value), &wrapyfi_plugins::standard()),
            codec::encode(&value, &wrapyfi_plugins::standard()),
            "{name}"
        );
        assert_eq!(through_the_graph(&value), value, "{name}");
        let (text, _) = codec::encode_with_tensors(&value, &wrapyfi_plugins::standard()).unwrap();
        let begin = br#"{"__wrapyfi__": ["table", "#;
        assert!(text.starts_with(begin), "{name}: {}", String::from_utf8_lossy(&text));

        let facts = &vector["facts"];
        let levels = match table.origin.get("index") {
            Some("column") => 1,
            Some(text) => text.strip_prefix("levels ").map_or(0, |count| count.parse().unwrap()),
            None => 0,
        };
        let schema = table.batch.schema();
        let dtypes = schema.fields().iter().skip(levels);
        let dtypes: Vec<_> = dtypes.map(|field| json!(field.metadata()["dtype"])).collect();
        if let Some(wanted) = facts["dtypes"].as_array() {
            assert_eq!(&dtypes, wanted, "{name}");
        }
        assert_eq!(json!(table.origin.get("freq")), facts["index"]["freq"], "{name}");
        assert_eq!(table.batch.num_rows(), facts["index"]["labels"].as_array().unwrap().len());
        if facts["index"]["type"] == "MultiIndex" {
            let names = facts["index"]["names"].as_array().unwrap();
            assert_eq!(levels, names.len(), "{name}");
            for (field, wanted) in schema.fields().iter().zip(names) {
                assert_eq!(field.name(), wanted.as_str().unwrap_or_default(), "{name}");
            }
        }
    }
}

#[test]
fn lists_structs_and_scalars_of_pyarrow_are_read_and_written() {
    for vector in vectors("pyarrow_types") {
        let name = vector["name"].as_str().unwrap();
        let value = decode(vector["wire"].as_str().unwrap());
        let Value::Table(table) = &value else { panic!("{name}: {value:?}") };
        assert_eq!(again(&value), value, "{name}");
        assert_eq!(through_the_graph(&value), value, "{name}");
        let (text, _) = codec::encode_with_tensors(&value, &wrapyfi_plugins::standard()).unwrap();
        let begin = br#"{"__wrapyfi__": ["table", "#;
        assert!(text.starts_with(begin), "{name}: {}", String::from_utf8_lossy(&text));
        if name.starts_with("scalar") {
            assert_eq!(table.origin.get("kind"), Some("Scalar"), "{name}");
        }
        // Bytes, times and decimals are no JSON.
        if !["binary", "times", "time", "day", "delta", "decimal", "bytes", "table", "null"]
            .iter()
            .any(|kind| name.contains(kind))
        {
            let wanted = vector["facts"]["values"].as_array().unwrap();
            assert_eq!(&elements(table.batch.column(0)), wanted, "{name}");
        }
    }
}

#[test]
fn arrays_and_tables_of_pyarrow_are_read_and_written() {
    let mut checked = 0;
    for vector in vectors("pyarrow") {
        let name = vector["name"].as_str().unwrap();
        let value = decode(vector["wire"].as_str().unwrap());
        let Value::Table(table) = &value else { panic!("{name}: {value:?}") };
        if name == "table" {
            assert_eq!(table.batch.schema().field(0).name(), "a");
            assert_eq!(elements(table.batch.column(0)), [json!(1)]);
        } else {
            let values = vector["original"]["values"].as_array().unwrap();
            assert_eq!(&elements(table.batch.column(0)), values, "{name}");
        }
        assert_eq!(again(&value), value, "{name}");
        assert_eq!(through_the_graph(&value), value, "{name}");
        checked += 1;
    }
    assert_eq!(checked, 5);
}

/// Series come back as series, where Wrapyfi itself makes frames of them.
#[test]
fn frames_and_series_of_dask_are_read_and_written() {
    for vector in vectors("dask").into_iter().filter(|vector| vector["name"] != "array") {
        let name = vector["name"].as_str().unwrap();
        let value = decode(vector["wire"].as_str().unwrap());
        let Value::Table(table) = &value else { panic!("{name}: {value:?}") };
        assert_eq!(describe(table), vector["original"]["computed"], "{name}");
        assert_eq!(table.origin.get("partitions"), Some("2"));
        assert_eq!(again(&value), value, "{name}");
        assert_eq!(through_the_graph(&value), value, "{name}");
    }
}

/// Message of the legacy key, made by hand because pandas 1 cannot be installed any more.
#[test]
fn json_of_old_pandas_is_read_and_written() {
    use base64_simd::STANDARD;
    let split = r#"{"columns":["a","b"],"index":["x","y"],"data":[[1,"p"],[2,null]]}"#;
    let wire = format!(
        r#"{{"__wrapyfi__": ["PandasLegacyData", "{}", "DataFrame"]}}"#,
        STANDARD.encode_to_string(split)
    );
    let value = decode(&wire);
    let table = value.as_table().unwrap_or_else(|| panic!("{value:?}"));
    assert_eq!(describe(table)["data"], json!({"a": [1, 2], "b": ["p", null]}));
    assert_eq!(describe(table)["index"], json!(["x", "y"]));
    assert_eq!(again(&value), value);
}

fn refusal(wire: &str) -> String {
    let value = decode(wire);
    let reasons: Vec<_> = value.refusals().map(|(_, reason)| reason.to_owned()).collect();
    assert_eq!(reasons.len(), 1, "{value:?}");
    // It travels on as it came.
    assert_eq!(codec::encode(&value, &wrapyfi_plugins::standard()).unwrap(), wire.as_bytes());
    reasons[0].clone()
}

/// Offsets of 21 bytes, where three need 24, and of 27.
#[test]
fn buffers_that_end_within_an_element_do_no_harm() {
    let vectors = vectors("pyarrow_types");
    let vector = vectors.iter().find(|vector| vector["name"] == "large_list").unwrap();
    let wire = vector["wire"].as_str().unwrap();
    let offsets = wire.split('"').find(|part| part.len() == 32).unwrap();
    let short = wire.replace(offsets, &offsets[..28]);
    assert_eq!(decode(&short).refusals().count(), 1, "{short}");
    let long = wire.replace(offsets, &format!("{offsets}AAAA"));
    assert_eq!(decode(&long), decode(wire), "{long}");
}

#[test]
fn what_cannot_be_a_table_is_refused_with_its_reason() {
    for (pickle, words) in [
        // cos\nsystem\n(S'true'\ntR.
        ("cos\\nsystem\\n(S'true'\\ntR.", "os.system"),
        ("\\u0080\\u0005\\u008c\\u0008builtins\\u008c\\u0004eval\\u0093.", "builtins.eval"),
        ("\\u0080\\u0005K\\u0001.", "an object"),
        ("\\u0080\\u0005", "ends early"),
    ] {
        for key in ["PandasData", "PyArrowArray"] {
            let wire = format!(r#"{{"__wrapyfi__": ["{key}", "{pickle}"]}}"#);
            let reason = refusal(&wire);
            assert!(
                reason.starts_with(&format!("{key} at $: ")) && reason.contains(words),
                "{reason}"
            );
        }
    }
    for (body, words) in [
        (r#""!""#, "malformed JSON"),
        (r#""e30=", "DataFrame""#, "columns"),
        (r#""e30=", "Panel""#, "Panel"),
        ("5", "text"),
    ] {
        let reason = refusal(&format!(r#"{{"__wrapyfi__": ["PandasLegacyData", {body}]}}"#));
        assert!(reason.contains(words), "{words}: {reason}");
    }
}

/// A byte changed at each place of what pandas and PyArrow wrote: an error or a value, and what is a value can be
/// written.
#[test]
fn damaged_tables_do_no_harm() {
    let limits = Limits { message_bytes: 1 << 20, ..Limits::default() };
    for vector in ["pandas", "pandas3", "pyarrow", "pyarrow_types"].into_iter().flat_map(vectors) {
        let Some(wire) = vector["wire"].as_str() else { continue };
        // One of the four at a place, the next one at the next: the fuzz targets try the others.
        for (at, damage) in (0..wire.len()).zip([b'K', b'0', b'\\', b')'].into_iter().cycle()) {
            let mut damaged = wire.as_bytes().to_vec();
            damaged[at] = damage;
            if let Ok(value) = codec::decode(&damaged.into(), &limits, &wrapyfi_plugins::standard())
            {
                drop(codec::encode(&value, &wrapyfi_plugins::standard()));
            }
        }
    }
}

fn columns() -> impl Strategy<Value = Vec<(String, ArrayRef)>> {
    (1..8_usize).prop_flat_map(|rows| {
        let column = prop_oneof![
            proptest::collection::vec(any::<Option<i64>>(), rows)
                .prop_map(|v| Arc::new(arrow_array::Int64Array::from(v)) as ArrayRef),
            proptest::collection::vec(any::<u8>(), rows)
                .prop_map(|v| Arc::new(arrow_array::UInt8Array::from(v)) as ArrayRef),
            proptest::collection::vec(-1e9..1e9_f64, rows)
                .prop_map(|v| Arc::new(arrow_array::Float64Array::from(v)) as ArrayRef),
            proptest::collection::vec(any::<Option<bool>>(), rows)
                .prop_map(|v| Arc::new(arrow_array::BooleanArray::from(v)) as ArrayRef),
            proptest::collection::vec(any::<Option<String>>(), rows)
                .prop_map(|v| Arc::new(arrow_array::StringArray::from(v)) as ArrayRef),
            proptest::collection::vec(proptest::option::of(0..1_i64 << 60), rows).prop_map(|v| {
                Arc::new(arrow_array::TimestampNanosecondArray::from(v)) as ArrayRef
            }),
        ];
        proptest::collection::btree_map("[a-z]{1,6}", column, 1..5)
            .prop_map(|columns| columns.into_iter().collect())
    })
}

proptest! {
    #[test]
    fn any_columns_return_from_pandas_and_from_pyarrow(columns in columns()) {
        let batch = RecordBatch::try_from_iter_with_nullable(
            columns.into_iter().map(|(name, array)| (name, array, true)),
        ).unwrap();
        let frame = again(&Table::frame(batch.clone()).into());
        let frame = frame.as_table().unwrap();
        prop_assert_eq!(frame.batch.columns(), batch.columns());
        for kind in ["Table", "RecordBatch"] {
            let origin = Arc::new(Origin::new("PyArrowArray").with("kind", kind));
            let table = Value::from(Table { batch: batch.clone(), origin });
            prop_assert_eq!(&again(&table), &table);
            prop_assert_eq!(&through_the_graph(&table), &table);
        }
    }
}

#[test]
fn a_part_of_an_array_is_written_as_that_part() {
    let array = arrow_array::Int64Array::from(vec![Some(1), None, Some(3), None]);
    let part: ArrayRef = Arc::new(array.slice(1, 2));
    let schema = Schema::new(vec![Field::new("n", DataType::Int64, true)]);
    let batch = RecordBatch::try_new(Arc::new(schema), vec![part]).unwrap();
    for key in ["PandasData", "PyArrowArray"] {
        let table = Table { batch: batch.clone(), origin: Arc::new(Origin::new(key)) };
        let read = again(&table.into());
        let column = read.as_table().unwrap().batch.column(0).clone();
        assert_eq!(elements(&column), [Json::Null, json!(3)], "{key}");
    }
}

#[test]
fn without_plugins_a_table_cannot_be_written() {
    let batch = RecordBatch::try_from_iter([(
        "a",
        Arc::new(arrow_array::Int64Array::from(vec![1])) as ArrayRef,
    )]);
    let table = Value::from(Table::frame(batch.unwrap()));
    let error = codec::encode(&table, &Plugins::none()).unwrap_err().to_string();
    assert!(error.contains("\"PandasData\""), "{error}");
}
