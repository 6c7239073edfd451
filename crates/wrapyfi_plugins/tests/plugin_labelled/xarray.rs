//! xarray's labelled arrays.

use bytes::Bytes;
use proptest::prelude::*;
use serde_json::{Value as Json, json};
use wrapyfi_data::codec::json as codec;
use wrapyfi_data::types::{Labelled, LabelledContent, Map, Tensor, Value, Variable};

use super::{assert_refused, base64, decode, encode, named, through_the_graph, vectors, wire};

/// A labelled array as xarray's `to_dict` describes it.
fn describe_labelled(labelled: &Labelled) -> Json {
    fn plain(value: &Value) -> Json {
        match value {
            Value::Null => Json::Null,
            Value::Bool(value) => json!(value),
            Value::Int(value) => json!(value),
            Value::Float(value) if value.is_nan() => json!("NaN"),
            Value::Float(value) => json!(value),
            Value::Str(value) => json!(value),
            Value::DateTime(value) => json!(value.to_string().replace('T', " ")),
            Value::List(items) => items.iter().map(plain).collect(),
            Value::Map(map) => {
                map.iter().map(|(k, v)| (k.as_str().unwrap().to_owned(), plain(v))).collect()
            }
            Value::Tensor(tensor) => {
                let numbers: Vec<Json> = if let Some(floats) = tensor.to_vec::<f64>() {
                    floats.into_iter().map(|x| plain(&x.into())).collect()
                } else {
                    tensor.to_vec::<i64>().unwrap().into_iter().map(|x| json!(x)).collect()
                };
                match *tensor.shape() {
                    [_] => numbers.into(),
                    [_, columns] => numbers.chunks(columns).map(|row| json!(row)).collect(),
                    _ => panic!("{:?}", tensor.shape()),
                }
            }
            other => panic!("{other:?}"),
        }
    }
    let variable = |variable: &Variable| {
        let attrs = plain(&variable.attrs.clone().into());
        json!({"dims": variable.dims, "attrs": attrs, "data": plain(&variable.data)})
    };
    let all = |named: &[(String, Variable)]| -> Json {
        named.iter().map(|(name, member)| (name.clone(), variable(member))).collect()
    };
    let coords = all(&labelled.coords);
    match &labelled.content {
        LabelledContent::Array(array) => {
            let mut object = variable(array);
            object["coords"] = coords;
            object["name"] = json!(labelled.name);
            object
        }
        LabelledContent::Dataset { dims, variables, attrs } => {
            let dims: Json = dims.iter().map(|(k, v)| (k.clone(), json!(v))).collect();
            let attrs = plain(&attrs.clone().into());
            json!({"coords": coords, "attrs": attrs, "dims": dims, "data_vars": all(variables)})
        }
    }
}

#[test]
fn every_labelled_array_is_what_was_sent() {
    let mut checked = 0;
    for vector in vectors("xarray") {
        let name = vector["name"].as_str().unwrap();
        let value = decode(&wire(&vector));
        let labelled = value.as_labelled().unwrap();
        assert_eq!(describe_labelled(labelled), vector["decoded"]["as_dict"], "{name}");
        // Byte for byte.
        assert_eq!(encode(&value), wire(&vector), "{name}");
        let (text, again) = through_the_graph(&value);
        assert!(text.starts_with(r#"{"__wrapyfi__": ["labelled", {"#), "{text}");
        assert_eq!(
            describe_labelled(again.as_labelled().unwrap()),
            vector["decoded"]["as_dict"],
            "{name}"
        );
        checked += 1;
    }
    assert_eq!(checked, 3);
}

#[test]
fn numbers_are_tensors() {
    let value = decode(&wire(&named("xarray", "data_array")));
    let labelled = value.as_labelled().unwrap();
    let LabelledContent::Array(array) = &labelled.content else { panic!("an array") };
    let tensor = array.data.as_tensor().unwrap();
    assert_eq!(tensor.to_vec::<f64>().unwrap(), [0.0, 1.0, 2.0, 3.0]);
    assert_eq!(
        (tensor.shape(), &*array.dims),
        (&[2, 2][..], &["x".to_owned(), "y".to_owned()][..])
    );
    let (_, x) = &labelled.coords[0];
    assert_eq!(x.data.as_tensor().unwrap().to_vec::<i64>().unwrap(), [10, 20]);
}

fn xarray(text: &str, kind: &str) -> Json {
    json!(["XArrayData", base64(text.as_bytes()), kind, "t"])
}

#[test]
fn hostile_labelled_arrays_are_refused() {
    let var = |body: &str| xarray(&format!(r#"{{"data_vars": {{"t": {body}}}}}"#), "DataArray");
    assert_refused(&[
        (json!(["XArrayData"]), "the object has 0 parts"),
        (json!(["XArrayData", "e30=", "DataArray"]), "$.data_vars is missing"),
        (json!(["XArrayData", "e3", "Dataset", null]), "part 0"),
        (xarray("{\"data_vars\": {}}", "Variable"), "an xarray \"Variable\""),
        (xarray("[1]", "Dataset"), "a list where a dict should be"),
        (xarray("{\"data_vars\": 5}", "Dataset"), "$.data_vars is a int, no dict"),
        (xarray("{\"data_vars\": {}}", "DataArray"), "$.data_vars lacks \"t\""),
        (xarray("{\"data_vars\": {}, \"dims\": {\"x\": -1}}", "Dataset"), "$.dims holds"),
        (xarray("{\"data_vars\": {}, \"attrs\": 1}", "Dataset"), "$.attrs is a int"),
        (var("7"), "$.data_vars.t is a int"),
        (var("{}"), "$.data_vars.t.dims is missing"),
        (var(r#"{"dims": ["x"]}"#), "$.data_vars.t.data is missing"),
        (var(r#"{"dims": [1], "data": []}"#), "$.data_vars.t.dims is no list of names"),
        (var(r#"{"dims": ["x"], "data": [[1]]}"#), "has 2 dimensions, $.data_vars.t.dims names 1"),
        (var(r#"{"dims": ["x"], "data": 1}"#), "has 0 dimensions"),
        (xarray(&format!("{}{}", "[".repeat(99), "]".repeat(99)), "Dataset"), "the limit is 64"),
    ]);
}

#[test]
fn text_dates_and_odd_attributes_travel() {
    let text = r#"{"coords": {}, "attrs": {"made": {"data": "2024-01-02T03:04:05", "dtype": "datetime"}, "l": [1, {"a": null}]}, "dims": {"x": 2}, "data_vars": {"s": {"dims": ["x"], "attrs": {}, "data": ["a", "b"]}, "n": {"dims": [], "attrs": {}, "data": 5}, "e": {"dims": ["x", "y"], "attrs": {}, "data": [[], []]}}}"#;
    let wire = Bytes::from(json!({"__wrapyfi__": xarray(text, "Dataset")}).to_string());
    let value = decode(&wire);
    let Some(Labelled { content: LabelledContent::Dataset { attrs, .. }, .. }) =
        value.as_labelled()
    else {
        panic!("{value:?}")
    };
    assert!(matches!(attrs.get("made"), Some(Value::DateTime(_))));
    let again: Json = serde_json::from_slice(&encode(&value)).unwrap();
    assert_eq!(again["__wrapyfi__"][1], base64(text.as_bytes()));
    assert_eq!(through_the_graph(&value).1, value);
}

#[test]
fn what_wrapyfi_cannot_read_back_is_not_written() {
    let variable = |data: Value| Variable { dims: vec![], data, attrs: Map::new() };
    let array = |name: Option<&str>, data: Value| {
        let content = LabelledContent::Array(variable(data));
        Value::from(Labelled { name: name.map(Into::into), content, coords: vec![] })
    };
    for (value, wanted) in [
        (array(None, 1.into()), "a DataArray without a name"),
        (array(Some("t"), Value::Bytes(Bytes::new())), "a bytes in an xarray object"),
        (
            array(Some("t"), Map::from([("data", 1), ("dtype", 2)]).into()),
            "takes it for a point in time",
        ),
    ] {
        let error = codec::encode(&value, &wrapyfi_plugins::standard()).unwrap_err().to_string();
        assert!(error.contains(wanted), "{error}");
    }
}

proptest! {
    #[test]
    fn labelled_arrays_come_back(
        floats in proptest::collection::vec(any::<f64>(), 1..20),
        ints in proptest::collection::vec(any::<i64>(), 0..5),
        name in "[a-zé\"]{1,5}",
        attr in ".{0,8}",
    ) {
        let finite: Vec<f64> = floats.into_iter().map(|x| if x.is_nan() { 0.5 } else { x }).collect();
        let extent = finite.len();
        let data = Tensor::from_elements(&[1, extent], finite).unwrap();
        let attrs = Map::from([("note", attr)]);
        let coord = Tensor::from_elements(&[ints.len()], ints.clone()).unwrap();
        prop_assume!(!ints.is_empty());
        let value = Value::from(Labelled {
            name: Some(name.clone()),
            content: LabelledContent::Array(Variable {
                dims: vec!["a".into(), "b".into()], data: data.into(), attrs,
            }),
            coords: vec![("c".into(), Variable {
                dims: vec!["c".into()], data: coord.into(), attrs: Map::new(),
            })],
        });
        prop_assert_eq!(&decode(&encode(&value)), &value);
        prop_assert_eq!(&through_the_graph(&value).1, &value);
    }
}
