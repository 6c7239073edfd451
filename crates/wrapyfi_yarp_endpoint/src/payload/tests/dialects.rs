//! Messages written by YARP 4 are read by an endpoint that expects YARP 3, and the other way round:
//! the length of a message tells them apart.

use super::golden::{file, hex};
use super::*;
use wrapyfi_data::types::Tensor;

/// Payload that a topic reads from the bytes, asserted to be the same where it expects the other
/// dialect.
fn in_both(bytes: &Bytes, spec: &TopicSpec) -> Payload {
    let read = |dialect| {
        let options = YarpOptions::of_topic(spec).unwrap();
        decode(&Bytewise::object(bytes.clone()), None, spec, &options, dialect, NOW)
    };
    let (v3, v4) = (read(Dialect::V3).unwrap(), read(Dialect::V4).unwrap());
    assert_eq!(v3, v4, "{bytes:?}");
    v3
}

fn cases(name: &str) -> Vec<(String, Bytes)> {
    let cases = file(name)["cases"].as_array().unwrap().clone();
    let case = |case: &serde_json::Value| {
        let text = |key: &str| case[key].as_str().unwrap().to_owned();
        (text("name"), hex(&text("binary")).into())
    };
    cases.iter().map(case).collect()
}

#[test]
fn bottles_of_either_are_read() {
    let spec = topic(MessageType::NativeObject, [("bottle", true.into())]);
    for (name, wanted) in [
        ("double", list([3.25.into()])),
        ("doubles", list([1.5.into(), (-0.1).into(), 1e300.into()])),
        ("mixed", list([1.into(), 2.5.into(), "three".into()])),
    ] {
        for corpus in ["corpus_bottle.json", "v4_corpus_bottle.json"] {
            let (_, bytes) = cases(corpus).into_iter().find(|(known, _)| known == name).unwrap();
            assert_eq!(value(&in_both(&bytes, &spec)), wanted, "{corpus} {name}");
        }
    }
}

#[test]
fn sounds_and_vectors_of_either_are_read() {
    let ros = |name| topic(MessageType::Ros(ros(name)), []);
    let sound = topic(MessageType::AudioChunk, []);
    for corpus in ["corpus_sig.json", "v4_corpus_sig.json"] {
        let (mut sounds, mut vectors) = (0, 0);
        for (name, bytes) in cases(corpus) {
            match name.split(':').next().unwrap() {
                "snd_mono" | "snd_stereo" => {
                    let Payload::AudioChunk(sound) = in_both(&bytes, &sound) else { panic!() };
                    assert!([(6, 1, 16_000), (4, 2, 44_100)].contains(&(
                        sound.frames,
                        sound.channels,
                        sound.sample_rate
                    )));
                    sounds += 1;
                }
                "vec" | "vecf" => {
                    let fields = value(&in_both(&bytes, &ros("std_msgs/msg/Float64MultiArray")));
                    let data = fields.get("data").and_then(Value::as_tensor).unwrap();
                    assert_eq!(data.to_vec::<f64>().unwrap(), [-1.0, 0.5, 2.0], "{corpus} {name}");
                    let fields = value(&in_both(&bytes, &ros("std_msgs/msg/Float32MultiArray")));
                    let data = fields.get("data").and_then(Value::as_tensor).unwrap();
                    assert_eq!(data.to_vec::<f32>().unwrap(), [-1.0, 0.5, 2.0], "{corpus} {name}");
                    vectors += 1;
                }
                "mat" => {
                    let fields = value(&in_both(&bytes, &ros("std_msgs/msg/Float64MultiArray")));
                    let data = fields.get("data").and_then(Value::as_tensor).unwrap();
                    assert_eq!(data.to_vec::<f64>().unwrap()[..2], [0.5, 1.5], "{corpus} {name}");
                    vectors += 1;
                }
                _ => {}
            }
        }
        assert!(sounds == 2 && vectors >= 2, "{corpus}: {sounds} sounds, {vectors} vectors");
    }
}

#[test]
fn requests_of_either_are_read() {
    let options = Map::from([("bottle", true)]);
    let kind = wrapyfi_data::types::ServiceKind::NativeObject;
    let spec =
        wrapyfi_endpoint::ServiceSpec { options, ..wrapyfi_endpoint::ServiceSpec::new("/s", kind) };
    let options = YarpOptions::of_service(&spec).unwrap();
    let limits = wrapyfi_yarp::WireLimits::default();
    let bottle = Bottle::from_text(b"[set] [pos] 2 10.5", &limits).unwrap();
    for wrote in [Dialect::V3, Dialect::V4] {
        let bytes = Bytes::from(bottle.encode(wrote).unwrap());
        for expects in [Dialect::V3, Dialect::V4] {
            let request = decode_request(&bytes, &spec, &options, expects).unwrap();
            assert_eq!(
                request.into_call().unwrap().args.last(),
                Some(&10.5.into()),
                "{wrote} {expects}"
            );
        }
    }
}

#[test]
fn the_first_error_is_told_where_neither_fits() {
    let spec = topic(MessageType::NativeObject, [("bottle", true.into())]);
    let mut bytes = typed("1 2.5 three");
    bytes.truncate(bytes.len() - 1);
    let error = read(bytes, &spec).unwrap_err().to_string();
    assert!(error.contains("malformed bottle"), "{error}");
    // Whole in V4 alone: what is wrong there is told, not that it is V4.
    let numbers = topic(MessageType::Ros(ros("std_msgs/msg/Float64MultiArray")), []);
    let limits = wrapyfi_yarp::WireLimits::default();
    let words = Bottle::from_text(b"1 2.5 three", &limits).unwrap().encode(Dialect::V4).unwrap();
    let error = read(words, &numbers).unwrap_err().to_string();
    assert!(error.starts_with("expected a vector or a matrix of numbers"), "{error}");
    // Whole in V3, but no sound in any dialect.
    let sound = topic(MessageType::AudioChunk, []);
    let error = read(typed("1 2.5 three"), &sound).unwrap_err().to_string();
    assert!(error.contains("1 2.5 three"), "{error}");
}

#[test]
fn option_dialect_is_how_a_port_writes() {
    let wide = ros("std_msgs/msg/Float64MultiArray");
    let spec = topic(MessageType::Ros(wide), []);
    let data = Tensor::from_elements(&[2], vec![1.5, -2.0]).unwrap();
    let message = message(wide, &Map::from([("data", Value::from(data))]).into());
    let options = YarpOptions::of_topic(&spec).unwrap();
    let code = |dialect| {
        let written = encode(&message, &spec, &options, dialect).unwrap();
        i32::from_le_bytes(written.payload.bytes[..4].try_into().unwrap())
    };
    assert_eq!((code(Dialect::V3), code(Dialect::V4)), (256 + 10, 256 + 20));
}

#[test]
fn arrays_of_other_numbers_have_vectors_of_their_own() {
    let (float, int) = (ros("std_msgs/msg/Float32MultiArray"), ros("std_msgs/msg/Int32MultiArray"));
    let array = |ros_type, data: Tensor| {
        message(ros_type, &Map::from([("data", Value::from(data))]).into())
    };
    let floats = array(float, Tensor::from_elements(&[2], vec![1.5_f32, -2.0]).unwrap());
    let ints = array(int, Tensor::from_elements(&[3], vec![1_i32, -2, i32::MAX]).unwrap());
    for (ros_type, payload, dialect, code, length) in [
        (float, &floats, Dialect::V3, 256 + 10, 8 + 16),
        (float, &floats, Dialect::V4, 256 + 10, 8 + 8),
        (int, &ints, Dialect::V3, 256 + 1, 8 + 12),
        (int, &ints, Dialect::V4, 256 + 1, 8 + 12),
    ] {
        let spec = topic(MessageType::Ros(ros_type), []);
        let options = YarpOptions::of_topic(&spec).unwrap();
        let bytes = encode(payload, &spec, &options, dialect).unwrap().payload.bytes;
        let found = i32::from_le_bytes(bytes[..4].try_into().unwrap());
        assert_eq!((found, bytes.len()), (code, length), "{ros_type} {dialect}");
        let again = decode(&Bytewise::object(bytes), None, &spec, &options, dialect, NOW).unwrap();
        let (again, sent) = (value(&again), value(payload));
        assert_eq!(again.get("data"), sent.get("data"), "{ros_type} {dialect}");
    }
    let spec = topic(MessageType::Ros(int), []);
    let dims = value(&read(typed("2 2 (1 2 3 4)"), &spec).unwrap());
    assert_eq!(dims.get("layout").unwrap().get("dim").unwrap().as_items().unwrap().len(), 2);
    for text in ["1 2.5", "1 2147483648", "1.0 nan"] {
        let error = read(typed(text), &spec).unwrap_err().to_string();
        assert!(error.contains("expected integers of 32 bits"), "{text}: {error}");
    }
}
