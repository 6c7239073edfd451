use super::*;
use crate::types::{
    AudioChunk, Encoding, Image, Map, RawPixels, SampleFormat, ServiceKind, Stamp, Tensor, Value,
};

fn function(kind: ServiceKind) -> Function {
    Function::new(&ServiceSpec::new("/x", kind)).unwrap()
}

fn request() -> Request {
    let array = Tensor::from_elements(&[2], vec![1.5_f32, 2.5]).unwrap();
    Request::new([1.into(), "a".into(), Value::from(array)]).with(Map::from([("k", 2)]))
}

#[test]
fn arguments_travel_and_come_back() {
    for kind in ServiceKind::ALL {
        let function = function(kind);
        let empty = function.service.request().default_message();
        for request in [request(), Request::default()] {
            let message = function.write_request(&request, empty.clone()).unwrap();
            assert_eq!(function.read_request(&message).unwrap().0, request, "{kind}");
        }
    }
    let text = |kind, field| {
        let function = function(kind);
        let empty = function.service.request().default_message();
        let request =
            Request::new([Value::from(Map::from([("a", 1)]))]).with(Map::from([("k", 2)]));
        let message = function.write_request(&request, empty).unwrap();
        message.get(field).and_then(|text| text.as_str()).unwrap().to_owned()
    };
    assert_eq!(
        text(ServiceKind::NativeObject, "request.json"),
        r#"{"args": [{"a": 1}], "kwargs": {"k": 2}}"#
    );
    assert_eq!(
        text(ServiceKind::UpstreamNativeObject, "request"),
        r#"[{"__wrapyfi__": ["tuple", [{"a": 1}]]}, {"k": 2}]"#
    );
}

#[test]
fn what_is_returned_comes_back() {
    let raw = RawPixels::dense(2, 1, Encoding::Bgr8, vec![1, 2, 3, 4, 5, 6]).unwrap();
    let stamp = Stamp { sec: 7, nanosec: 5 };
    let sound = AudioChunk::new(stamp, 1, 2, 8000, SampleFormat::F32Le, vec![0; 8]).unwrap();
    for kind in ServiceKind::ALL {
        let function = function(kind);
        let empty = function.service.response().default_message();
        let payload: Payload = match kind.data_type() {
            DataType::Image => Image::new(stamp, raw.clone()).into(),
            DataType::AudioChunk => sound.clone().into(),
            _ => Value::from(Map::from([("n", 1)])).into(),
        };
        let message = function.write_reply(&payload, empty.clone()).unwrap();
        let (got, _) = function.read_reply(&message).unwrap();
        if kind == ServiceKind::CompressedImage {
            assert_eq!(got.map(|payload| payload.data_type()), Ok(DataType::Image));
        } else {
            assert_eq!(got, Ok(payload), "{kind}");
        }
        let other: Payload = match kind.data_type() {
            DataType::Image => sound.clone().into(),
            _ => Image::new(stamp, raw.clone()).into(),
        };
        let error = function.write_reply(&other, empty).unwrap_err();
        assert!(matches!(error, EncodeError::Mismatch { .. }), "{error}");
    }
}

#[test]
fn errors_are_told_where_the_type_has_room() {
    for kind in ServiceKind::ALL {
        let function = function(kind);
        match function.service.error_reply("no camera") {
            None => assert!(kind.is_upstream(), "{kind}"),
            Some(reply) => {
                let (told, _) = function.read_reply(&reply).unwrap();
                assert_eq!(told, Err("no camera".to_owned()), "{kind}");
            }
        }
    }
}

#[test]
fn arguments_that_are_none_are_named() {
    let ours = function(ServiceKind::Image);
    let mut message = ours.service.request().default_message();
    for (json, words) in [
        ("[1]", "expected a map with args and kwargs, received list"),
        ("{\"args\": 1}", "expected a list under args, received int"),
        ("{", "malformed JSON"),
        ("{\"__wrapyfi__\": [\"tensor\", 0]}", "tensor"),
    ] {
        message.set("request.json", json).unwrap();
        let error = ours.read_request(&message).unwrap_err().to_string();
        assert!(error.contains(words), "{json}: {error}");
    }
    let theirs = function(ServiceKind::UpstreamImage);
    let mut message = theirs.service.request().default_message();
    message.set("request", "[]").unwrap();
    let error = theirs.read_request(&message).unwrap_err().to_string();
    assert!(error.contains("expected a request [args, kwargs]"), "{error}");
}
