//! Bottles as JSON and back.

use crate::golden::{bytes, cases, text};
use serde_json::json;
use wrapyfi_yarp::bottle::{Property, Text, Vocab, Vocab64};
use wrapyfi_yarp::{Bottle, Dialect, Limits, Value};

/// Every recorded bottle returns from JSON with the same bytes: no type is lost.
#[test]
fn corpora_return_from_json() {
    for (file, dialect) in
        [("corpus_bottle.json", Dialect::V3), ("v4_corpus_bottle.json", Dialect::V4)]
    {
        for case in cases(file) {
            let binary = bytes(&case, "binary");
            let bottle = Bottle::decode_whole(&binary, dialect, &Limits::default()).unwrap();
            let json = serde_json::to_string(&bottle).unwrap();
            let again: Bottle = serde_json::from_str(&json).unwrap();
            assert_eq!(again.encode(dialect).unwrap(), binary, "{}: {json}", text(&case, "name"));
        }
    }
}

#[test]
fn what_json_has_itself_is_plain() {
    let bottle = Bottle::from_text(b"1 2.5 word true false (1 2) 3000000000", &Limits::default());
    let json = serde_json::to_value(bottle.unwrap()).unwrap();
    assert_eq!(json, json!([1, 2.5, "word", true, false, [1, 2], 3_000_000_000_i64]));
}

#[test]
fn what_json_lacks_has_a_name() {
    for (value, json) in [
        (Value::Int8(-5), json!({"int8": -5})),
        (Value::Int64(7), json!({"int64": 7})),
        (Value::Float32(1.5), json!({"float32": 1.5})),
        (Value::Float32(f32::INFINITY), json!({"float32": "inf"})),
        (Value::Float64(f64::NEG_INFINITY), json!({"float64": "-inf"})),
        (Value::vocab("set"), json!({"vocab": "set"})),
        (Value::Vocab32(Vocab(-7)), json!({"vocab": -7})),
        (Value::Vocab64(Vocab64::new("abcdefgh")), json!({"vocab64": "abcdefgh"})),
        (Value::String(Text::from(vec![0xff])), json!({"string": [255]})),
        (Value::blob(vec![1, 2]), json!({"blob": [1, 2]})),
        (Value::Dict(vec![Value::Int32(1)].into()), json!({"dict": [1]})),
    ] {
        assert_eq!(serde_json::to_value(&value).unwrap(), json);
        assert_eq!(serde_json::from_value::<Value>(json).unwrap(), value);
    }
}

#[test]
fn other_objects_are_dictionaries() {
    let value: Value =
        serde_json::from_str(r#"{"speed": 3, "name": "arm", "none": null}"#).unwrap();
    let Value::Dict(pairs) = &value else { panic!("{value:?}") };
    assert_eq!(pairs.to_text(), "(speed 3) (name arm) (none [null])");
    assert_eq!(serde_json::from_str::<Value>("{}").unwrap(), Value::Dict(Bottle::new()));
}

#[test]
fn what_cannot_be_a_value_is_refused() {
    for (text, reason) in [
        ("18446744073709551615", "larger than YARP's integers"),
        (r#"{"int8": 5, "more": 1}"#, "it names a type"),
        (r#"{"int8": 500}"#, "500"),
        (r#"{"float64": "much"}"#, "none of nan, inf, -inf"),
        (r#"{"vocab": 5000000000}"#, "32 bits"),
        (r#"{"vocab": []}"#, "letters or a number"),
    ] {
        let error = serde_json::from_str::<Value>(text).unwrap_err().to_string();
        assert!(error.contains(reason), "{text}: {error}");
    }
}

#[test]
fn properties_keep_what_they_are_told() {
    let bottle = Bottle::from_text(b"(k1 1) loose () (limits 0 10)", &Limits::default()).unwrap();
    let (mut property, left_out) = Property::from_bottle(bottle);
    assert_eq!(left_out, 2);
    assert_eq!(property.get("k1"), Some(&Value::Int32(1)));
    assert_eq!(property.group("limits").unwrap().len(), 3);
    property.set("k1", 2.5);
    property.set("new", "text");
    assert!(property.remove("limits") && !property.remove("limits"));
    assert_eq!(property.to_bottle().to_text(), "(k1 2.5) (new text)");
    let bytes = property.encode(Dialect::V3).unwrap().into();
    let again = Property::decode(&bytes, Dialect::V3, &Limits::default()).unwrap();
    assert_eq!(again, (property, 0));
}
