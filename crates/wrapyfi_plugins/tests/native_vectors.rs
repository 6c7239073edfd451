//! Native objects that Wrapyfi's own encoder wrote (`tests/data/native`), decoded and compared
//! with the descriptions beside them, then written again.

use bytes::Bytes;
use serde_json::{Value as Json, json};
use wrapyfi_data::Limits;
use wrapyfi_data::codec::json as codec;
use wrapyfi_data::plugin::Plugins;
use wrapyfi_data::types::{Tensor, Value};

/// A vector file of `tests/data/native`.
fn vectors(group: &str) -> Vec<Json> {
    let path = format!("{}/tests/data/native/{group}.json", env!("CARGO_MANIFEST_DIR"));
    // Lone surrogates and NaN inside descriptions are legal to Python, which wrote the file.
    let text = std::fs::read_to_string(path).unwrap().replace("\"\\ud800\"", "\"<U+D800>\"");
    let text = text.replace(" NaN", " null");
    let file: Json = serde_json::from_str(&text).unwrap();
    file["vectors"].as_array().unwrap().clone()
}

fn wire(vector: &Json) -> Option<Bytes> {
    vector["wire"].as_str().map(|wire| Bytes::from(wire.to_owned()))
}

fn decode(wire: &Bytes) -> Result<Value, wrapyfi_data::DecodeError> {
    codec::decode(wire, &Limits::default(), &wrapyfi_plugins::standard())
}

/// `value` in the words of the vector files, as far as they go beyond what the bytes say.
fn describe(value: &Value) -> Json {
    let all = |items: &[Value]| items.iter().map(describe).collect::<Vec<_>>();
    match value {
        Value::Null => json!({"type": "null"}),
        Value::Bool(value) => json!({"type": "bool", "value": value}),
        Value::Int(value) => json!({"type": "int", "value": value.to_string()}),
        Value::BigInt(value) => json!({"type": "int", "value": value.to_string()}),
        Value::Float(value) => {
            json!({"type": "float64", "bits_hex": format!("{:016x}", value.to_bits())})
        }
        Value::Str(text) => json!({
            "type": "str", "utf16_code_units": text.encode_utf16().count(), "value": text
        }),
        Value::Utf16(units) => json!({
            "type": "str",
            "utf16_code_units": units.len(),
            "value": units.iter().map(|unit| format!("<U+{unit:X}>")).collect::<String>(),
        }),
        Value::List(items) => json!({"type": "list", "items": all(items)}),
        Value::Tuple(items) => json!({"type": "tuple", "items": all(items)}),
        Value::Set(items) => json!({"type": "set", "items": all(items)}),
        Value::Map(map) => {
            let pair = |(key, value): (&Value, &Value)| json!([key.as_str(), describe(value)]);
            json!({"type": "dict", "items": map.iter().map(pair).collect::<Vec<_>>()})
        }
        Value::DateTime(when) => json!({
            "type": "datetime",
            "iso": when.to_string(),
            "utc_offset_s": when.offset.map(|offset| f64::from(offset.local_minus_utc())),
        }),
        Value::DateTime64(text) => json!({"type": "numpy.datetime64", "iso": text}),
        Value::Tensor(tensor) => json!({
            "type": "ndarray",
            "dtype": tensor.dtype().npy_descr(),
            "shape": tensor.shape(),
            "row_major_bytes_hex": hex(tensor.data()),
        }),
        Value::Array(array) => json!({
            "type": "ndarray",
            "dtype": array.descr,
            "shape": array.shape,
            "row_major_bytes_hex": hex(&array.data),
        }),
        Value::Tagged(tagged) => {
            let object: Json = serde_json::from_slice(&tagged.json).unwrap();
            describe_json(&object)
        }
        other => panic!("no description of {other:?}"),
    }
}

/// A tagged object as Wrapyfi leaves it where the plug-in is missing: an ordinary `dict`.
fn describe_json(json: &Json) -> Json {
    match json {
        Json::String(text) => describe(&Value::from(text.as_str())),
        Json::Array(items) => {
            json!({"type": "list", "items": items.iter().map(describe_json).collect::<Vec<_>>()})
        }
        Json::Object(object) => {
            let pair = |(key, value): (&String, &Json)| json!([key, describe_json(value)]);
            json!({"type": "dict", "items": object.iter().map(pair).collect::<Vec<_>>()})
        }
        other => panic!("no description of {other:?}"),
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The description in a vector, cut down to what [`describe`] says, byte order as a tensor has it.
fn expected(described: &Json) -> Json {
    let mut described = described.clone();
    let kind = described["type"].as_str().unwrap_or_default().to_owned();
    let Some(object) = described.as_object_mut() else { return described };
    for extra in ["dtype_name", "ndim", "size", "memory_order", "values_row_major", "unit"] {
        object.remove(extra);
    }
    match &*kind {
        "float64" => drop(object.remove("value")),
        "ndarray" => match object["dtype"].clone() {
            Json::String(descr) if is_number(&descr) => {
                if let Some(code) = descr.strip_prefix('>') {
                    let scalar: usize = code[1..].parse().unwrap();
                    let digits = object["row_major_bytes_hex"].as_str().unwrap().as_bytes();
                    let swapped =
                        digits.chunks(scalar * 2).flat_map(|scalar| scalar.chunks(2).rev());
                    let swapped = String::from_utf8(swapped.flatten().copied().collect()).unwrap();
                    object["row_major_bytes_hex"] = swapped.into();
                    object["dtype"] = format!("<{code}").into();
                }
            }
            Json::String(descr) => object["dtype"] = format!("'{descr}'").into(),
            structured => object["dtype"] = python_literal(&structured).into(),
        },
        "dict" => {
            for pair in object["items"].as_array_mut().unwrap() {
                pair[1] = expected(&pair[1]);
            }
        }
        "list" | "tuple" | "set" => {
            for item in object["items"].as_array_mut().unwrap() {
                *item = expected(item);
            }
        }
        _ => {}
    }
    described
}

fn is_number(descr: &str) -> bool {
    matches!(
        &descr[1..],
        "b1" | "i1"
            | "i2"
            | "i4"
            | "i8"
            | "u1"
            | "u2"
            | "u4"
            | "u8"
            | "f2"
            | "f4"
            | "f8"
            | "c8"
            | "c16"
    )
}

/// A structured `descr` as the header has it; sub-array shapes are described as Python text.
fn python_literal(descr: &Json) -> String {
    let fields = descr.as_array().unwrap().iter().map(|field| {
        let parts = field.as_array().unwrap().iter().enumerate().map(|(index, part)| {
            let part = part.as_str().unwrap();
            if index == 2 { part.to_owned() } else { format!("'{part}'") }
        });
        format!("({})", parts.collect::<Vec<_>>().join(", "))
    });
    format!("[{}]", fields.collect::<Vec<_>>().join(", "))
}

/// Equal, NaN included, and sets in any order.
fn same(a: &Value, b: &Value) -> bool {
    describe(a) == describe(b)
}

#[test]
fn every_builtin_and_array_decodes_as_described() {
    let mut checked = 0;
    for vector in ["builtins", "numpy", "errors"].into_iter().flat_map(vectors) {
        let name = vector["name"].as_str().unwrap();
        let Some(mut wire) = wire(&vector) else { continue };
        if name == "deep_1500" {
            // The file tells how it is made instead of holding it.
            wire = [vec![b'['; 1500], vec![b']'; 1500]].concat().into();
        }
        match (decode(&wire), vector.get("decoded").filter(|decoded| !decoded.is_null())) {
            (Ok(value), Some(decoded)) => {
                assert_eq!(describe(&value), expected(decoded), "{name}");
                let again =
                    Bytes::from(codec::encode(&value, &wrapyfi_plugins::standard()).unwrap());
                assert!(same(&decode(&again).unwrap(), &value), "{name}: {again:?}");
                checked += 1;
            }
            (Err(error), None) => {
                assert!(vector["decode_error"].is_string(), "{name}: {error}");
                checked += 1;
            }
            (Ok(value), None) => panic!("{name}: Wrapyfi refuses what gave {value:?}"),
            (Err(error), Some(_)) => panic!("{name}: {error}"),
        }
    }
    assert!(checked > 130, "{checked} vectors checked");
}

/// Text that Wrapyfi can read back is written the same again, except arrays in an order that
/// tensors do not have.
#[test]
fn what_wrapyfi_wrote_is_written_the_same() {
    let mut checked = 0;
    for vector in ["builtins", "numpy"].into_iter().flat_map(vectors) {
        let name = vector["name"].as_str().unwrap();
        let reordered = ["array_fortran", "array_transposed", "array_transposed_slice"];
        let given_up = reordered.contains(&name)
            || name.starts_with("array_big_endian")
            // Members that the decoder drops.
            || ["dict_key_collision", "user_dict_tag_with_siblings"].contains(&name);
        let Some(wire) = wire(&vector).filter(|_| !given_up) else { continue };
        if let Ok(value) = decode(&wire) {
            assert_eq!(
                Bytes::from(codec::encode(&value, &wrapyfi_plugins::standard()).unwrap()),
                wire,
                "{name}"
            );
            checked += 1;
        }
    }
    assert!(checked > 100, "{checked} vectors checked");
}

#[test]
fn text_with_tensors_beside_it_says_the_same() {
    for vector in ["builtins", "numpy"].into_iter().flat_map(vectors) {
        let Some(Ok(value)) = wire(&vector).map(|wire| decode(&wire)) else { continue };
        let (text, tensors): (_, Vec<Tensor>) =
            codec::encode_with_tensors(&value, &wrapyfi_plugins::standard()).unwrap();
        let again = codec::decode_with_tensors(
            &text.into(),
            &tensors,
            &Limits::default(),
            &wrapyfi_plugins::standard(),
        );
        assert!(same(&again.unwrap(), &value), "{}", vector["name"]);
    }
}

#[test]
fn plugin_objects_pass_through_untouched() {
    let mut checked = 0;
    for group in [
        "dask",
        "jax",
        "mxnet",
        "paddle",
        "pandas",
        "pandas3",
        "pillow",
        "pint",
        "pyarrow",
        "stubs",
        "tensorflow",
        "torch",
        "xarray",
        "zarr",
    ] {
        for vector in vectors(group) {
            let Some(wire) = wire(&vector) else { continue };
            let tag: Json = serde_json::from_slice(&wire).unwrap();
            let tag = tag["__wrapyfi__"][0].as_str().unwrap().to_owned();
            // As a process without any plug-in does.
            match codec::decode(&wire, &Limits::default(), &Plugins::none()) {
                Ok(Value::Tagged(tagged)) => {
                    assert_eq!((&tagged.key, &tagged.json), (&tag, &wire));
                    assert_eq!(
                        Bytes::from(
                            codec::encode(&tagged.into(), &wrapyfi_plugins::standard()).unwrap()
                        ),
                        wire
                    );
                    checked += 1;
                }
                // pandas timestamps are datetimes to Wrapyfi, and NaT is one that it cannot read.
                Ok(Value::DateTime(when)) => {
                    assert_eq!(vector["decoded"]["iso"], when.to_string());
                }
                other => {
                    assert_eq!(vector["name"], "timestamp_nat", "{group}: {other:?}");
                    assert!(other.is_err());
                }
            }
        }
    }
    assert!(checked > 60, "{checked} vectors checked");
}

/// Damage to what Wrapyfi wrote is refused or read as something else; nothing else happens.
#[test]
fn damaged_objects_do_no_harm() {
    let limits = Limits { message_bytes: 1 << 20, ..Limits::default() };
    for vector in ["builtins", "numpy"].into_iter().flat_map(vectors) {
        let Some(wire) = wire(&vector) else { continue };
        for (at, &byte) in wire.iter().enumerate() {
            let mut damaged = wire.to_vec();
            for damage in [byte ^ 1, byte.wrapping_add(64), b'"', b'9', b'[', b'\\'] {
                damaged[at] = damage;
                drop(codec::decode(
                    &Bytes::copy_from_slice(&damaged),
                    &limits,
                    &wrapyfi_plugins::standard(),
                ));
            }
            if wire.starts_with(b"{") || wire.starts_with(b"[") {
                assert!(
                    codec::decode(&wire.slice(..at), &limits, &wrapyfi_plugins::standard())
                        .is_err(),
                    "{:?}",
                    &wire[..at]
                );
            }
        }
    }
}
