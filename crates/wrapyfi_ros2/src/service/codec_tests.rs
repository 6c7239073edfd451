use super::*;
use wrapyfi_data::types::{
    AudioChunk, Encoding, Image, Map, RawPixels, SampleFormat, ServiceKind, Stamp, Tensor, Value,
};

fn codec(kind: ServiceKind) -> ServiceCodec {
    ServiceCodec::new(&ServiceSpec::new("/x", kind)).unwrap()
}

fn request() -> Request {
    let array = Tensor::from_elements(&[2], vec![1.5_f32, 2.5]).unwrap();
    Request::new([1.into(), "a".into(), Value::from(array)]).with(Map::from([("k", 2)]))
}

/// The fields of a request.
fn asked(codec: &ServiceCodec, cdr: &Bytes) -> DynamicMessage {
    codec.fields(codec.service.request(), cdr).unwrap()
}

#[test]
fn arguments_travel_and_come_back() {
    for kind in ServiceKind::ALL {
        let codec = codec(kind);
        for request in [request(), Request::default()] {
            let cdr = codec.encode_request(&request).unwrap();
            assert_eq!(codec.decode_request(&cdr).unwrap(), request, "{kind}");
        }
    }
    let text = |kind, field| {
        let codec = codec(kind);
        let request =
            Request::new([Value::from(Map::from([("a", 1)]))]).with(Map::from([("k", 2)]));
        let message = asked(&codec, &codec.encode_request(&request).unwrap());
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
        let codec = codec(kind);
        let payload: Payload = match kind.data_type() {
            DataType::Image => Image::new(stamp, raw.clone()).into(),
            DataType::AudioChunk => sound.clone().into(),
            _ => Value::from(Map::from([("n", 1)])).into(),
        };
        let got = codec.decode_reply(&codec.encode_reply(&payload).unwrap()).unwrap();
        if kind == ServiceKind::CompressedImage {
            assert_eq!(got.map(|payload| payload.data_type()), Ok(DataType::Image));
        } else {
            assert_eq!(got, Ok(payload), "{kind}");
        }
        let other: Payload = match kind.data_type() {
            DataType::Image => sound.clone().into(),
            _ => Image::new(stamp, raw.clone()).into(),
        };
        let error = codec.encode_reply(&other).unwrap_err();
        assert!(matches!(error, EncodeError::Mismatch { .. }), "{error}");
    }
}

/// A service that is no function: what comes is what goes, and nothing is taken apart.
#[test]
fn services_of_ros_are_bytes() {
    let resolved = TypeStore::generated().resolve_name("std_srvs/srv/SetBool").unwrap();
    let switch = RosService::new(&resolved).unwrap();
    let codec = codec(ServiceKind::Ros(switch));
    // As a big-endian node of another vendor may write it.
    let asked = Bytes::from_static(&[0, 0, 0, 0, 1]);
    let request = codec.decode_request(&asked).unwrap();
    assert_eq!(request, Request::Message(RosMessage::new(switch.request(), asked.clone())));
    assert_eq!(codec.encode_request(&request).unwrap(), asked);
    let replied = Bytes::from_static(&[0, 1, 0, 0, 0, 0, 0, 0, 3, 0, 0, 0, b'n', b'o', 0]);
    let reply = codec.decode_reply(&replied).unwrap().unwrap();
    assert_eq!(codec.encode_reply(&reply).unwrap(), replied);
    let Payload::RosMessage(message) = reply else { panic!("{reply:?}") };
    assert_eq!(message.to_value(100).unwrap().get("message"), Some(&Value::from("no")));
    let error = codec.decode_request(&Bytes::from_static(&[0, 1, 0, 0])).unwrap_err();
    assert!(matches!(error, DecodeError::Malformed { .. }), "{error}");
}

#[test]
fn errors_are_told_where_the_type_has_room() {
    for kind in ServiceKind::ALL {
        let codec = codec(kind);
        match codec.error_reply("no camera") {
            None => assert!(kind.is_upstream(), "{kind}"),
            Some(reply) => {
                let told = codec.decode_reply(&reply).unwrap();
                assert_eq!(told, Err("no camera".to_owned()), "{kind}");
            }
        }
    }
}

#[test]
fn arguments_that_are_none_are_named() {
    let refusal = |codec: &ServiceCodec, field, text: &str| {
        let cdr = written(codec.service.request(), [(field, text.into())]).unwrap();
        codec.decode_request(&cdr).unwrap_err().to_string()
    };
    let ours = codec(ServiceKind::Image);
    for (json, words) in [
        ("[1]", "expected a map with args and kwargs, received list"),
        ("{\"args\": 1}", "expected a list under args, received int"),
        ("{", "malformed JSON"),
        ("{\"__wrapyfi__\": [\"tensor\", 0]}", "tensor"),
    ] {
        let error = refusal(&ours, "request.json", json);
        assert!(error.contains(words), "{json}: {error}");
    }
    let error = refusal(&codec(ServiceKind::UpstreamImage), "request", "[]");
    assert!(error.contains("expected a request [args, kwargs]"), "{error}");
}
