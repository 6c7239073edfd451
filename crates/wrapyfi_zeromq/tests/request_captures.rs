//! Requests and replies recorded between two Python Wrapyfi programs: understood, and written again.

use std::path::Path;

use bytes::Bytes;
use serde_json::Value as Json;
use sha2::{Digest, Sha256};
use wrapyfi_data::types::{Encoding, Map, Payload, Pixels, ServiceKind, Stamp, Value};
use wrapyfi_endpoint::codec::{jpeg, requests};
use wrapyfi_endpoint::{Request, ServiceSpec};

const NOW: Stamp = Stamp { sec: 7, nanosec: 5 };

struct Capture {
    requests: Vec<Bytes>,
    replies: Vec<Bytes>,
    /// SHA-256 of what the server's function returned.
    sent: Vec<String>,
    /// The same at the client.
    received: Vec<String>,
}

fn capture(name: &str) -> Capture {
    let path = format!("{}/tests/data/reqrep_{name}.json", env!("CARGO_MANIFEST_DIR"));
    let file: Json = serde_json::from_slice(&std::fs::read(Path::new(&path)).unwrap()).unwrap();
    let list = |key: &str| file[key].as_array().unwrap().clone();
    let bodies = |kind: &str| -> Vec<Bytes> {
        let records = list("records");
        let frames = list("frames");
        let meant = frames.iter().zip(&records).filter(|(_, record)| record["kind"] == kind);
        meant
            .map(|(frames, _)| {
                let frames: Vec<Bytes> = frames.as_array().unwrap().iter().map(unhex).collect();
                let [_id, empty, body] = &frames[..] else { panic!("{frames:?}") };
                assert!(empty.is_empty());
                body.clone()
            })
            .collect()
    };
    let hashes = |key: &str| -> Vec<String> {
        list(key).iter().filter_map(|line| line["sha256"].as_str().map(str::to_owned)).collect()
    };
    let capture = Capture {
        requests: bodies("request"),
        replies: bodies("reply"),
        sent: hashes("sender_log"),
        received: hashes("receiver_log"),
    };
    assert_eq!((capture.requests.len(), capture.replies.len()), (2, 2), "{name}");
    assert_eq!((capture.sent.len(), capture.received.len()), (2, 2), "{name}");
    capture
}

fn unhex(frame: &Json) -> Bytes {
    let digits = frame.as_str().unwrap();
    (0..digits.len())
        .step_by(2)
        .map(|at| u8::from_str_radix(&digits[at..at + 2], 16).unwrap())
        .collect()
}

fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Reads a capture; its requests and replies are written again byte for byte.
fn replies(name: &str, kind: ServiceKind) -> (Vec<Payload>, Capture) {
    let capture = capture(name);
    let spec = ServiceSpec::new("/unused", kind);
    for (n, body) in capture.requests.iter().enumerate() {
        let request = requests::decode_request(body, &spec).unwrap();
        let number = i64::try_from(n).unwrap();
        let expected = Request::new([number.into()]).with(Map::from([("tag", "request")]));
        assert_eq!(request, expected, "{name}");
        assert_eq!(requests::encode_request(&request, &spec).unwrap(), *body, "{name}");
    }
    let payloads = capture
        .replies
        .iter()
        .map(|body| {
            let payload = requests::decode_reply(body, &spec, NOW).unwrap().unwrap();
            assert_eq!(requests::encode_reply(&payload, &spec).unwrap(), *body, "{name}");
            payload
        })
        .collect();
    (payloads, capture)
}

#[test]
fn native_objects() {
    for name in ["native_small", "native_rich"] {
        for (n, payload) in replies(name, ServiceKind::NativeObject).0.into_iter().enumerate() {
            let Payload::NativeObject(value) = payload else { panic!("{payload:?}") };
            assert_eq!(value.get("seq"), Some(&Value::Int(i64::try_from(n).unwrap())));
            if name == "native_rich" {
                assert!(matches!(value.get("tuple"), Some(Value::Tuple(_))), "{value:?}");
                assert!(matches!(value.get("set"), Some(Value::Set(_))), "{value:?}");
                assert!(matches!(value.get("when"), Some(Value::DateTime(_))), "{value:?}");
                assert!(matches!(value.get("array"), Some(Value::Tensor(_))), "{value:?}");
            }
        }
    }
}

fn raw(payload: &Payload) -> &wrapyfi_data::types::RawPixels {
    match payload {
        Payload::Image(image) => match &image.pixels {
            Pixels::Raw(raw) => raw,
            other => panic!("{other:?}"),
        },
        other => panic!("{other:?}"),
    }
}

#[test]
fn images() {
    for (name, encoding) in [("image_rgb", Encoding::Bgr8), ("image_fp", Encoding::F32C3)] {
        let (payloads, capture) = replies(name, ServiceKind::Image);
        for (n, payload) in payloads.iter().enumerate() {
            let raw = raw(payload);
            assert_eq!((raw.height, raw.width, raw.encoding), (4, 6, encoding), "{name}");
            assert_eq!(sha256(&raw.data), capture.sent[n], "{name}");
            assert_eq!(sha256(&raw.data), capture.received[n], "{name}");
        }
    }
}

#[test]
fn a_jpeg_stays_a_file_where_one_is_asked_for() {
    let (payloads, capture) = replies("image_jpeg", ServiceKind::CompressedImage);
    for (payload, body) in payloads.iter().zip(&capture.replies) {
        let Payload::Image(image) = payload else { panic!("{payload:?}") };
        let Pixels::Compressed { data, .. } = &image.pixels else { panic!("{image:?}") };
        assert_eq!(data, body);
        let picture = jpeg::decode(data, &wrapyfi_data::Limits::default(), None).unwrap();
        assert_eq!((picture.height, picture.width), (16, 24));
    }
}

#[test]
fn sound() {
    for (name, frames, channels, rate) in
        [("audio_mono", 64, 1, 44_100), ("audio_stereo", 32, 2, 16_000)]
    {
        let (payloads, capture) = replies(name, ServiceKind::AudioChunk);
        for (n, payload) in payloads.iter().enumerate() {
            let Payload::AudioChunk(sound) = payload else { panic!("{payload:?}") };
            assert_eq!((sound.frames, sound.channels, sound.sample_rate), (frames, channels, rate));
            assert_eq!(sha256(&sound.data), capture.sent[n], "{name}");
            assert_eq!(sha256(&sound.data), capture.received[n], "{name}");
        }
    }
}

/// A client of one kind reports the reply of a server of another kind as an error; it guesses
/// nothing.
#[test]
fn replies_of_another_kind_are_refused() {
    let image = ServiceSpec::new("/unused", ServiceKind::Image);
    let sound = ServiceSpec::new("/unused", ServiceKind::AudioChunk);
    for (name, spec) in [
        ("audio_mono", &image),
        ("native_small", &image),
        ("image_rgb", &sound),
        ("image_jpeg", &sound),
        ("native_rich", &sound),
    ] {
        for body in capture(name).replies {
            let error = requests::decode_reply(&body, spec, NOW).unwrap_err().to_string();
            assert!(error.contains("expected a reply {"), "{name}: {error}");
        }
    }
}
