use proptest::prelude::*;

use super::*;
use crate::types::{AudioChunk, Encoding, Image, RawPixels, SampleFormat, Stamp, Value};

fn bytes(payload: &Payload, message_type: MessageType) -> Vec<u8> {
    encode(payload, message_type, 7, &Limits::default(), &Plugins::none()).unwrap().concat()
}

fn read(message: &[u8], message_type: MessageType) -> Result<Payload, DecodeError> {
    let message = Bytes::copy_from_slice(message);
    decode(&message, message_type, &Limits::default(), &Plugins::none())
}

const WHEN: Stamp = Stamp { sec: 1_795_214_428, nanosec: 500_000_000 };

/// As genpy 0.6.16 writes `String(data='{"a": 1}')`.
#[test]
fn an_object_is_a_string() {
    let payload = Payload::from(Value::from(crate::types::Map::from([("a", 1)])));
    let expected = b"\x08\0\0\0{\"a\": 1}";
    for kind in [MessageType::NativeObject, MessageType::StringJson] {
        assert_eq!(bytes(&payload, kind), expected);
        assert_eq!(read(expected, kind), Ok(payload.clone()));
        let plain = b"\x0e\0\0\0Hello World: 5";
        assert_eq!(read(plain, kind), Ok(Value::from("Hello World: 5").into()));
    }
}

/// As genpy 0.6.16 writes the same `sensor_msgs/Image`.
#[test]
fn an_image_has_its_fields_and_its_pixels() {
    let raw = RawPixels::dense(2, 1, Encoding::Bgr8, vec![0, 0, 255, 1, 2, 3]).unwrap();
    let payload = Payload::Image(Image { frame_id: "cam".into(), ..Image::new(WHEN, raw) });
    let expected = b"\x07\0\0\0\x5c\xcc\x00\x6b\x00\x65\xcd\x1d\x03\0\0\0cam\x01\0\0\0\x02\0\0\0\
        \x04\0\0\0bgr8\x00\x06\0\0\0\x06\0\0\0\x00\x00\xff\x01\x02\x03";
    assert_eq!(bytes(&payload, MessageType::Image), expected);
    assert_eq!(read(expected, MessageType::Image), Ok(payload));
}

/// Wrapyfi's listeners want the wrong label and the right length. The bytes and the checksum are those of
/// genpy 0.6.16 for the definition.
#[test]
fn sound_is_mislabelled_as_wrapyfi_insists() {
    let samples: Vec<u8> = [0.5_f32, -0.5].iter().flat_map(|n| n.to_le_bytes()).collect();
    let chunk = AudioChunk::new(WHEN, 2, 1, 44_100, SampleFormat::F32Le, samples).unwrap();
    let message = bytes(&chunk.clone().into(), MessageType::AudioChunk);
    let mut expected =
        b"\x07\0\0\0\x5c\xcc\x00\x6b\x00\x65\xcd\x1d\0\0\0\0\x02\0\0\0\x01\x44\xac\0\0\
        \x05\0\0\0S16LE\x00\0\0\0\0\0\0\0\0\x04\0\0\0\x08\0\0\0"
            .to_vec();
    expected.extend_from_slice(&chunk.data);
    assert_eq!(message, expected);
    assert_eq!(read(&message, MessageType::UpstreamAudio), Ok(chunk.clone().into()));
    let integers = chunk.to_format(SampleFormat::S16Le);
    let again = bytes(&integers.into(), MessageType::AudioChunk);
    assert_eq!(again.len(), message.len(), "floats all the same");
    let known = Ros1Type::of(MessageType::AudioChunk).unwrap();
    assert_eq!(known.md5, "b4f9a59da632adf088673f2154727d2f");
}

#[test]
fn types_are_those_that_ros_1_knows() {
    let image = Ros1Type::of(MessageType::Image).unwrap();
    assert!(image.definition.ends_with("string frame_id\n"), "{}", image.definition);
    assert!(image.fits("*") && image.fits(&image.md5.clone()) && !image.fits("0"));
    assert_eq!(Ros1Type::of(MessageType::StringJson).unwrap().name, "std_msgs/String");
    assert_eq!(Ros1Type::of(MessageType::Properties), None);
}

#[test]
fn what_is_cut_or_too_long_is_told() {
    let payload = Payload::from(Value::from("text"));
    let whole = bytes(&payload, MessageType::StringJson);
    for end in 0..whole.len() {
        let error = read(&whole[..end], MessageType::StringJson).unwrap_err();
        assert!(matches!(error, DecodeError::Malformed { .. }), "{error}");
    }
    let longer = [&whole[..], b"x"].concat();
    let error = read(&longer, MessageType::StringJson).unwrap_err().to_string();
    assert!(error.contains("1 bytes are left behind the last field"), "{error}");
    let small = Limits { message_bytes: 5, ..Limits::default() };
    let refused = encode(&payload, MessageType::StringJson, 0, &small, &Plugins::none());
    assert!(matches!(refused, Err(EncodeError::TooLarge { .. })));
    let other = encode(&payload, MessageType::Image, 0, &Limits::default(), &Plugins::none());
    assert!(other.unwrap_err().to_string().contains("sensor_msgs/Image"));
}

proptest! {
    #[test]
    fn any_bytes_are_read_or_refused(message in proptest::collection::vec(any::<u8>(), 0..200)) {
        for kind in MessageType::ALL {
            if let Ok(payload) = read(&message, kind) {
                let again = bytes(&payload, kind);
                prop_assert!(read(&again, kind).is_ok(), "{kind}");
            }
        }
    }
}
