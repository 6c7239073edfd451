//! pint's quantities.

use proptest::prelude::*;
use serde_json::json;
use wrapyfi_data::codec::json as codec;
use wrapyfi_data::types::{Quantity, Value};
use wrapyfi_data::{DecodeError, Limits};

use super::{assert_refused, base64, decode, encode, through_the_graph, vectors, wire};

#[test]
fn every_quantity_is_what_was_sent() {
    let mut checked = 0;
    for vector in vectors("pint") {
        let name = vector["name"].as_str().unwrap();
        let value = decode(&wire(&vector));
        let quantity = value.as_quantity().unwrap();
        let decoded = &vector["decoded"];
        assert_eq!(quantity.units, decoded["units"].as_str().unwrap(), "{name}");
        let magnitude = match &quantity.magnitude {
            Value::Int(value) => json!({"type": "int", "value": value.to_string()}),
            Value::Float(value) => json!({
                "type": "float64", "value": value, "bits_hex": format!("{:016x}", value.to_bits())
            }),
            other => panic!("{other:?}"),
        };
        assert_eq!(magnitude, decoded["magnitude"], "{name}");
        assert_eq!(encode(&value), wire(&vector), "{name}");
        let (text, again) = through_the_graph(&value);
        assert!(text.starts_with(r#"{"__wrapyfi__": ["quantity", {"magnitude": "#), "{text}");
        assert_eq!(again, value);
        checked += 1;
    }
    assert_eq!(checked, 3);
}

#[test]
fn hostile_quantities_are_refused() {
    let pint = |text: &str| json!(["PintData", base64(text.as_bytes()), "Quantity"]);
    let nested =
        format!("{{\"magnitude\": {{\"__wrapyfi__\": {}}}, \"units\": \"m\"}}", pint("{}"));
    assert_refused(&[
        (json!(["PintData"]), "the object has 0 parts"),
        (json!(["PintData", "e30="]), "the object has 1 parts"),
        (json!(["PintData", "e30=", "Unit"]), "a pint \"Unit\""),
        (json!(["PintData", "e3", "Quantity"]), "part 0"),
        (json!(["PintData", 5, "Quantity"]), "text should be there"),
        (pint("{"), "malformed JSON"),
        (pint("[]"), "no magnitude"),
        (pint("{}"), "no magnitude"),
        (pint(r#"{"magnitude": [1], "units": "m"}"#), "magnitude is a list"),
        (pint(r#"{"magnitude": 1}"#), "no units"),
        (pint(r#"{"magnitude": 1, "units": 2}"#), "no units"),
        (pint(&nested), "magnitude is a plug-in object"),
        (pint(&"[".repeat(70)), "nesting"),
    ]);
    let wrong = Quantity { magnitude: Value::List(vec![]), units: "m".into() };
    assert!(through_the_graph_fails(&wrong.into()));
}

/// A magnitude that is no number must not be read back from the graph.
fn through_the_graph_fails(value: &Value) -> bool {
    let plugins = wrapyfi_plugins::standard();
    let Ok((text, tensors)) = codec::encode_with_tensors(value, &plugins) else { return true };
    let read = codec::decode_with_tensors(&text.into(), &tensors, &Limits::default(), &plugins);
    matches!(read, Err(DecodeError::Malformed { .. }))
}

proptest! {
    #[test]
    fn quantities_come_back(magnitude: i64, float: f64, units in ".{0,12}") {
        prop_assume!(!float.is_nan());
        for magnitude in [Value::from(magnitude), float.into()] {
            let value = Value::from(Quantity { magnitude, units: units.clone() });
            prop_assert_eq!(&decode(&encode(&value)), &value);
        }
    }
}
