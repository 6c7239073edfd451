//! Native objects as Wrapyfi 0.5.0 published them, and as we carry them.

use serde_json::Value as Json;
use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::wrapyfi_msgs::msg;

use super::tests::{recorded, unhex};
use super::*;
use crate::types::{Map, NativeObject, Stamp, Tensor, Value};

fn encode(payload: &Payload, message_type: MessageType) -> EncodeResult<CdrParts> {
    super::encode(payload, message_type, &Plugins::none())
}

fn decode(cdr: &Bytes, message_type: MessageType, limits: &Limits) -> DecodeResult<Payload> {
    super::decode(cdr, message_type, limits, &Plugins::none())
}

fn limits() -> Limits {
    Limits::default()
}

/// Object that `Drive.native` returned in the recordings, with its `seq` and array.
fn expected(seq: i64, array: Tensor) -> Value {
    let member = |key: &str, value| (Value::Str(key.into()), value);
    let list = Value::List(vec![Value::Int(1), Value::Float(2.5), Value::Null, Value::Bool(true)]);
    Value::Map(Map(vec![
        member("seq", Value::Int(seq)),
        member("text", Value::Str("hé".into())),
        member("arr", Value::Tensor(array)),
        member("t", list),
    ]))
}

fn array(first: f32) -> Tensor {
    let elements = (0..6).map(|i| first + i as f32).collect();
    Tensor::from_elements(&[2, 3], elements).unwrap()
}

#[test]
fn recorded_objects_decode_to_their_values_and_encode_to_their_bytes() {
    let cases: Vec<Json> = recorded().into_iter().filter(|case| case["case"] == "native").collect();
    assert_eq!(cases.len(), 3);
    for case in cases {
        let cdr = unhex(case["hex"].as_str().unwrap());
        let text: Json = serde_json::from_str(case["values"]["data"].as_str().unwrap()).unwrap();
        let seq = text["seq"].as_i64().unwrap();
        let decoded = decode(&cdr, MessageType::StringJson, &limits()).unwrap();
        assert_eq!(decoded, expected(seq, array(0.0)).into(), "{case}");
        let mut encoded = encode(&decoded, MessageType::StringJson).unwrap().to_bytes().to_vec();
        encoded.resize(encoded.len().next_multiple_of(4), 0);
        assert_eq!(encoded, cdr, "{case}");
    }
}

#[test]
fn arrays_travel_beside_the_text() {
    let payload = Payload::from(expected(7, array(0.5).with_device("cuda:0")));
    let cdr = encode(&payload, MessageType::NativeObject).unwrap().to_bytes();
    let message = msg::NativeObject::decode(&cdr, cdr.len()).unwrap();
    assert_eq!(
        message.json,
        r#"{"seq": 7, "text": "h\u00e9", "arr": {"__wrapyfi__": ["tensor", 0]}, "t": [1, 2.5, null, true]}"#
    );
    let [tensor] = &message.tensors[..] else { panic!("{:?}", message.tensors) };
    assert_eq!((tensor.dtype.as_str(), tensor.device.as_str()), ("float32", "cuda:0"));
    assert_eq!((&tensor.shape, tensor.data.len()), (&vec![2, 3], 24));
    assert_eq!(decode(&cdr, MessageType::NativeObject, &limits()).unwrap(), payload);
}

#[test]
fn the_header_of_an_object_returns() {
    let stamp = Stamp { sec: 5, nanosec: 7 };
    let object = NativeObject { stamp, frame_id: "map".into(), value: 5.into() };
    let cdr = encode(&object.clone().into(), MessageType::NativeObject).unwrap().to_bytes();
    assert_eq!(decode(&cdr, MessageType::NativeObject, &limits()), Ok(object.into()));
}

#[test]
fn large_arrays_are_shared_both_ways() {
    let tensor = Tensor::from_elements(&[100, 100], vec![1.0_f32; 10_000]).unwrap();
    let parts = encode(&Value::Tensor(tensor.clone()).into(), MessageType::NativeObject).unwrap();
    assert!(parts.pieces().iter().any(|piece| piece.as_ptr() == tensor.data().as_ptr()));
    let cdr = parts.to_bytes();
    let decoded = decode(&cdr, MessageType::NativeObject, &limits()).unwrap();
    let Payload::NativeObject(value) = decoded else { panic!("no object") };
    let Value::Tensor(again) = value.value else { panic!("{value:?}") };
    assert!(cdr.as_ptr_range().contains(&again.data().as_ptr()));
    assert_eq!(again, tensor);
}

#[test]
fn a_tensor_must_fit_its_header() {
    let refused = |tensor: msg::Tensor| {
        let json = r#"{"__wrapyfi__": ["tensor", 0]}"#.to_owned();
        let message = msg::NativeObject { json, tensors: vec![tensor], ..Default::default() };
        let cdr = message.encode().to_bytes();
        decode(&cdr, MessageType::NativeObject, &limits()).unwrap_err().to_string()
    };
    let tensor = |dtype: &str, shape: &[u64]| msg::Tensor {
        dtype: dtype.into(),
        shape: shape.to_vec(),
        data: Bytes::from_static(&[0; 8]),
        ..msg::Tensor::default()
    };
    assert_eq!(
        refused(tensor("float32", &[3])),
        "malformed CDR at $.tensors[0].data: float32 array [3] needs 12 bytes, 8 are there"
    );
    assert!(refused(tensor("object", &[1])).contains("tensors[0].dtype: \"object\" is none of"));
    assert!(refused(tensor("uint8", &[u64::MAX, 16])).contains("tensors[0].data"));
}

#[test]
fn a_bad_text_is_malformed() {
    let cdr = Bytes::from_static(b"\0\x01\0\0\x09\0\0\0{}");
    let error = decode(&cdr, MessageType::StringJson, &limits()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "malformed CDR at $.data: data claims 9 elements, which need 9 bytes, 2 are left: \
         corrupt, or of another type"
    );
}

/// Drivers write a degree sign as Latin-1 has it.
#[test]
fn bytes_of_a_text_that_are_not_utf_8_are_replaced() {
    let cdr = Bytes::from_static(b"\0\x01\0\0\x04\0\0\x0045\xb0\0");
    for kind in [MessageType::StringJson, MessageType::Text] {
        assert_eq!(decode(&cdr, kind, &limits()), Ok(Value::from("45\u{fffd}").into()), "{kind}");
    }
    let cdr = Bytes::from_static(b"\0\x01\0\0\x0b\0\0\0{\"t\": \"\xb0\"}\0");
    let read = decode(&cdr, MessageType::StringJson, &limits()).unwrap();
    assert_eq!(read, Value::from(Map::from([("t", "\u{fffd}")])).into());
}

/// Texts of `ros2 run demo_nodes_cpp talker`, and texts that look like JSON and are none.
#[test]
fn a_text_that_is_no_json_is_a_text() {
    let read = |text: &str| {
        let cdr = encode(&Value::from(text).into(), MessageType::Text).unwrap().to_bytes();
        decode(&cdr, MessageType::StringJson, &limits())
    };
    for text in ["Hello World: 5", "", "[INFO] ready", "{'a': 1}", "grüße", "{\"a\": 1} and more"]
    {
        assert_eq!(read(text), Ok(Value::from(text).into()));
        // Into ROS 2 it is JSON again, as Python Wrapyfi reads it there.
        let json = encode(&Value::from(text).into(), MessageType::StringJson).unwrap().to_bytes();
        assert_eq!(decode(&json, MessageType::StringJson, &limits()), Ok(Value::from(text).into()));
    }
    assert_eq!(read("\"quoted\""), Ok(Value::from("quoted").into()));
    assert_eq!(read("5"), Ok(Value::from(5).into()));
    // Texts that are meant as objects, or exceed a limit, are errors.
    let error = read(r#"{"__wrapyfi__": []}"#).unwrap_err();
    assert!(matches!(error, DecodeError::Malformed { format: "JSON", .. }), "{error}");
    let error = read(&"[".repeat(100)).unwrap_err();
    assert!(matches!(error, DecodeError::TooLarge { what: "nesting", .. }), "{error}");
}
