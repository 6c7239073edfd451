//! Messages that Wrapyfi 0.5.0 published on ROS 2 (`tests/data/ros2`), round trips, contradictions.

use std::path::Path;

use proptest::prelude::*;
use serde_json::Value as Json;
use wrapyfi_interfaces::sensor_msgs::msg;

use super::*;
use crate::types::{
    AudioChunk as Sound, CompressedFormat, Encoding, Image as Picture, Pixels, RawPixels,
    SampleFormat, Stamp, Value,
};

pub(super) fn recorded() -> Vec<Json> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/ros2/wrapyfi.json");
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

pub(super) fn unhex(text: &str) -> Bytes {
    let digit = |c: &u8| char::from(*c).to_digit(16).unwrap() as u8;
    text.as_bytes().chunks(2).map(|pair| digit(&pair[0]) << 4 | digit(&pair[1])).collect()
}

fn encode(payload: &Payload, message_type: MessageType) -> EncodeResult<CdrParts> {
    super::encode(payload, message_type, &Plugins::none())
}

fn decode(cdr: &Bytes, message_type: MessageType, limits: &Limits) -> DecodeResult<Payload> {
    super::decode(cdr, message_type, limits, &Plugins::none())
}

fn payload(cdr: &Bytes, message_type: MessageType) -> Result<Payload, DecodeError> {
    decode(cdr, message_type, &Limits::default())
}

fn image(message: &msg::Image) -> Result<RawPixels, DecodeError> {
    match payload(&message.encode().to_bytes(), MessageType::Image)? {
        Payload::Image(Picture { pixels: Pixels::Raw(raw), .. }) => Ok(raw),
        other => panic!("{other:?}"),
    }
}

fn bytes_of(fields: &Json) -> Bytes {
    fields["data"].as_array().unwrap().iter().map(|byte| byte.as_u64().unwrap() as u8).collect()
}

#[test]
fn recorded_images_and_sounds_decode_to_their_fields_and_encode_to_their_bytes() {
    let mut seen = 0;
    for case in recorded() {
        let message_type: MessageType = case["type"].as_str().unwrap().parse().unwrap();
        if message_type == MessageType::StringJson {
            continue;
        }
        let cdr = unhex(case["hex"].as_str().unwrap());
        let decoded = payload(&cdr, message_type).unwrap();
        let fields = &case["values"];
        let stamp = &fields["header"]["stamp"];
        let stamp = Stamp {
            sec: stamp["sec"].as_i64().unwrap() as i32,
            nanosec: stamp["nanosec"].as_u64().unwrap() as u32,
        };
        let number = |name: &str| fields[name].as_u64().unwrap() as u32;
        let expected = match message_type {
            MessageType::Image => Picture::new(
                stamp,
                RawPixels {
                    width: number("width"),
                    height: number("height"),
                    encoding: Encoding::from_name(fields["encoding"].as_str().unwrap()).unwrap(),
                    step: number("step"),
                    data: bytes_of(fields),
                },
            )
            .into(),
            MessageType::CompressedImage => Picture::new(
                stamp,
                Pixels::Compressed { format: CompressedFormat::Jpeg, data: bytes_of(fields) },
            )
            .into(),
            MessageType::UpstreamAudio => Sound::new(
                stamp,
                number("chunk_size"),
                number("channels") as u8,
                number("sample_rate"),
                SampleFormat::F32Le,
                bytes_of(fields),
            )
            .unwrap()
            .into(),
            other => panic!("{other}"),
        };
        assert_eq!(decoded, expected, "{case}");

        let mut encoded = encode(&decoded, message_type).unwrap().to_bytes().to_vec();
        encoded.resize(encoded.len().next_multiple_of(4), 0);
        assert_eq!(encoded, cdr, "{case}");
        seen += 1;
    }
    assert_eq!(seen, 24);
}

#[test]
fn pixels_are_shared_with_the_message() {
    let raw = RawPixels::dense(64, 64, Encoding::Bgr8, vec![9; 64 * 64 * 3]).unwrap();
    let parts = encode(&Picture::new(Stamp::default(), raw.clone()).into(), MessageType::Image);
    let parts = parts.unwrap();
    assert!(parts.pieces().iter().any(|piece| piece.as_ptr() == raw.data.as_ptr()));
    let cdr = parts.to_bytes();
    let Payload::Image(Picture { pixels: Pixels::Raw(again), .. }) =
        payload(&cdr, MessageType::Image).unwrap()
    else {
        panic!("no raw image")
    };
    assert!(cdr.as_ptr_range().contains(&again.data.as_ptr()));
}

#[test]
fn an_image_must_fit_its_header() {
    let good = msg::Image {
        height: 2,
        width: 2,
        encoding: "rgb8".into(),
        step: 6,
        data: vec![0; 12].into(),
        ..msg::Image::default()
    };
    assert!(image(&good).is_ok());
    let error = image(&msg::Image { height: 3, ..good.clone() }).unwrap_err();
    assert_eq!(
        error.to_string(),
        "malformed CDR at $.data: rgb8 image of 2x3 needs 18 bytes, 12 are there"
    );
    let narrow = msg::Image { step: 5, data: vec![0; 10].into(), ..good.clone() };
    assert!(image(&narrow).unwrap_err().to_string().contains("a step of 5 bytes"));
    let huge = msg::Image { width: u32::MAX, height: u32::MAX, step: u32::MAX, ..good.clone() };
    assert!(matches!(image(&huge), Err(DecodeError::Malformed { .. })));
    let error = image(&msg::Image { encoding: "yuv422".into(), ..good }).unwrap_err();
    assert_eq!(
        error.to_string(),
        "expected an image encoded as mono8, mono16, rgb8, bgr8, rgba8, bgra8, 32SC1, 32FC1, 32FC3, \
         bayer_rggb8, bayer_bggr8, bayer_gbrg8, bayer_grbg8, bayer_rggb16, bayer_bggr16, \
         bayer_gbrg16, bayer_grbg16, received \"yuv422\""
    );
}

#[test]
fn big_endian_pixels_and_samples_are_swapped() {
    let raw = image(&msg::Image {
        height: 2,
        width: 1,
        encoding: "mono16".into(),
        is_bigendian: 1,
        step: 3, // rows need not end on a whole value
        data: vec![1, 2, 0, 3, 4, 0].into(),
        ..msg::Image::default()
    });
    assert_eq!(*raw.unwrap().data, [2, 1, 0, 4, 3, 0]);
    let bytes = image(&msg::Image {
        height: 1,
        width: 2,
        encoding: "mono8".into(),
        is_bigendian: 1,
        step: 2,
        data: vec![1, 2].into(),
        ..msg::Image::default()
    });
    assert_eq!(*bytes.unwrap().data, [1, 2]);
    let sound = ROS2AudioMessage {
        chunk_size: 2,
        channels: 1,
        is_bigendian: 1,
        encoding: "S16BE".into(),
        data: vec![0x3f, 0x80, 0, 0, 0, 0, 0, 0].into(),
        ..ROS2AudioMessage::default()
    };
    let Payload::AudioChunk(sound) =
        payload(&sound.encode().to_bytes(), MessageType::UpstreamAudio).unwrap()
    else {
        panic!("no sound")
    };
    assert_eq!(sound.format, SampleFormat::F32Le);
    assert_eq!(*sound.data, [0, 0, 0x80, 0x3f, 0, 0, 0, 0]);
}

#[test]
fn formats_of_compressed_images() {
    let format = |format: &str, data: &[u8]| {
        let message = msg::CompressedImage {
            format: format.into(),
            data: Bytes::copy_from_slice(data),
            ..msg::CompressedImage::default()
        };
        match payload(&message.encode().to_bytes(), MessageType::CompressedImage) {
            Ok(Payload::Image(Picture { pixels: Pixels::Compressed { format, .. }, .. })) => {
                Ok(format)
            }
            Ok(other) => panic!("{other:?}"),
            Err(error) => Err(error.to_string()),
        }
    };
    assert_eq!(format("jpeg", b"?"), Ok(CompressedFormat::Jpeg));
    assert_eq!(format("JPG", b"?"), Ok(CompressedFormat::Jpeg));
    assert_eq!(format("png", b"?"), Ok(CompressedFormat::Png));
    assert_eq!(format("rgb8; jpeg compressed bgr8", b"?"), Ok(CompressedFormat::Jpeg));
    assert_eq!(format("rgb8; png compressed bgr8", b"?"), Ok(CompressedFormat::Png));
    assert_eq!(format("jpeg", b"\x89PNG\r\n\x1a\n"), Ok(CompressedFormat::Png), "mislabelled");
    assert_eq!(
        format("tiff", b"II"),
        Err("expected a jpeg or png image, received format \"tiff\"".to_owned())
    );
    assert!(format("16UC1; compressedDepth png", b"?").is_err());
}

#[test]
fn sounds_are_told_by_their_size() {
    let sound = |format: SampleFormat| {
        let data = vec![0; 3 * 2 * format.bytes_per_sample()];
        Sound::new(Stamp { sec: 1, nanosec: 2 }, 3, 2, 44_100, format, data).unwrap()
    };
    for format in [SampleFormat::F32Le, SampleFormat::S16Le] {
        let original = Payload::from(sound(format));
        let cdr = encode(&original, MessageType::AudioChunk).unwrap().to_bytes();
        let message = AudioChunk::decode(&cdr, cdr.len()).unwrap();
        assert_eq!(message.encoding, format.name());
        assert_eq!(message.step as usize, 2 * format.bytes_per_sample());
        assert_eq!(payload(&cdr, MessageType::AudioChunk).unwrap(), original);
    }
    // What it is in a script; upstream's message is as upstream writes it.
    let mono = Sound::new(Stamp::default(), 2, 1, 8000, SampleFormat::F32Le, vec![0; 8]).unwrap();
    for (is_flat, said) in [(true, "flat"), (false, "")] {
        let original = Payload::from(Sound { is_flat, ..mono.clone() });
        let cdr = encode(&original, MessageType::AudioChunk).unwrap().to_bytes();
        assert_eq!(AudioChunk::decode(&cdr, cdr.len()).unwrap().coding_format, said);
        assert_eq!(payload(&cdr, MessageType::AudioChunk).unwrap(), original);
        let cdr = encode(&original, MessageType::UpstreamAudio).unwrap().to_bytes();
        assert_eq!(ROS2AudioMessage::decode(&cdr, cdr.len()).unwrap().coding_format, "");
    }
    // Python Wrapyfi takes nothing but floats, and calls them S16LE.
    let integers = sound(SampleFormat::S16Le);
    let cdr = encode(&integers.clone().into(), MessageType::UpstreamAudio).unwrap().to_bytes();
    let message = ROS2AudioMessage::decode(&cdr, cdr.len()).unwrap();
    assert_eq!((message.encoding.as_str(), message.step, message.data.len()), ("S16LE", 8, 24));
    assert_eq!(
        payload(&cdr, MessageType::UpstreamAudio).unwrap(),
        integers.to_format(SampleFormat::F32Le).into()
    );

    let odd = AudioChunk { chunk_size: 3, channels: 2, ..AudioChunk::default() };
    let error = payload(&odd.encode().to_bytes(), MessageType::AudioChunk).unwrap_err();
    assert_eq!(
        error.to_string(),
        "malformed CDR at $.data: 3 samples of 2 channels need 24 bytes as float32 or 12 as \
         int16, 0 are there (encoding \"\", coding_format \"\")"
    );
    let silent = AudioChunk::default();
    assert!(payload(&silent.encode().to_bytes(), MessageType::AudioChunk).is_err(), "0 channels");
}

#[test]
fn other_payloads_are_a_mismatch() {
    let raw = RawPixels::dense(1, 1, Encoding::Mono8, vec![0]).unwrap();
    let raw = Payload::from(Picture::new(Stamp::default(), raw));
    let jpeg = Pixels::Compressed { format: CompressedFormat::Jpeg, data: Bytes::new() };
    let jpeg = Payload::from(Picture::new(Stamp::default(), jpeg));
    let refused = |payload: &Payload, message_type| {
        encode(payload, message_type).map(|_| ()).unwrap_err().to_string()
    };
    assert_eq!(
        refused(&raw, MessageType::CompressedImage),
        "expected a jpeg or png image for sensor_msgs/msg/CompressedImage, was given a raw mono8 \
         image"
    );
    assert_eq!(
        refused(&jpeg, MessageType::Image),
        "expected a raw image for sensor_msgs/msg/Image, was given a jpeg image"
    );
    assert_eq!(
        refused(&Value::Null.into(), MessageType::AudioChunk),
        "expected wrapyfi_msgs/msg/AudioChunk, was given a native object"
    );
}

#[test]
fn a_contradictory_payload_is_not_sent() {
    let raw =
        RawPixels { width: 2, height: 2, encoding: Encoding::Mono8, step: 2, data: Bytes::new() };
    let error = encode(&Picture::new(Stamp::default(), raw).into(), MessageType::Image);
    assert_eq!(
        error.unwrap_err().to_string(),
        "CDR cannot hold a contradictory image (mono8 image of 2x2 needs 4 bytes, 0 are there) at \
         $.data; make it with RawPixels::new"
    );
}

#[test]
fn too_large_messages_are_refused_by_size() {
    let text = Text { data: "x".repeat(100) }.encode().to_bytes();
    let limits = Limits { message_bytes: 64, ..Limits::default() };
    assert_eq!(
        decode(&text, MessageType::StringJson, &limits).unwrap_err(),
        DecodeError::TooLarge { what: "message", path: "$".into(), actual: 109, limit: 64 }
    );
}

#[test]
fn every_type_has_a_hash() {
    for message_type in MessageType::TOPICS {
        assert_eq!(type_hash(message_type).len(), "RIHS01_".len() + 64);
    }
}

proptest! {
    #[test]
    fn images_return(
        encoding in prop::sample::select(&Encoding::ALL[..]),
        (width, height, padding) in (0_u32..20, 0_u32..20, 0_u32..5),
        (sec, nanosec, fill) in any::<(i32, u32, u8)>(),
        frame_id in "[^\0]{0,9}",
    ) {
        let step = width * encoding.bytes_per_pixel() as u32 + padding;
        let data = vec![fill; (step * height) as usize];
        let raw = RawPixels::new(width, height, encoding, step, data).unwrap();
        let original = Payload::from(Picture {
            stamp: Stamp { sec, nanosec },
            frame_id,
            pixels: raw.into(),
        });
        let cdr = encode(&original, MessageType::Image).unwrap().to_bytes();
        prop_assert_eq!(payload(&cdr, MessageType::Image).unwrap(), original);
    }

    #[test]
    fn any_bytes_are_read_or_refused(mut bytes in prop::collection::vec(any::<u8>(), 4..120)) {
        bytes[..4].copy_from_slice(&[0, 1, 0, 0]);
        let cdr = Bytes::from(bytes);
        for message_type in MessageType::TOPICS {
            if let Ok(decoded) = payload(&cdr, message_type) {
                prop_assert_eq!(decoded.data_type(), message_type.data_type());
            }
        }
    }
}
