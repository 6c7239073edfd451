//! Messages of real Wrapyfi and real YARP become the right object, and the same bytes again.

use super::*;
use serde_json::Value as Json;
use wrapyfi_data::types::{
    AudioChunk, CompressedFormat, Encoding, Image, Pixels, SampleFormat, Tensor,
};

pub(super) fn file(name: &str) -> Json {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let path = folder.join("../wrapyfi_yarp/tests/golden").join(name);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{name}: {error}"));
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{name}: {error}"))
}

pub(super) fn hex(text: &str) -> Vec<u8> {
    let digits = text.as_bytes().chunks(2);
    digits.map(|two| u8::from_str_radix(str::from_utf8(two).unwrap(), 16).unwrap()).collect()
}

/// Payload and envelope of each data message on a tcp connection.
pub(super) fn sent(name: &str) -> Vec<(Bytes, Option<sig::Stamp>)> {
    let recorded = file(name);
    let parts = recorded["stream"].as_array().unwrap().iter();
    let stream: Vec<u8> = parts
        .filter(|part| part["dir"] == "c2s")
        .filter_map(|part| part["hex"].as_str())
        .flat_map(hex)
        .collect();
    let stream = Bytes::from(stream);
    let word = |at: usize| {
        let four: [u8; 4] = stream[at..at + 4].try_into().unwrap();
        usize::try_from(i32::from_le_bytes(four)).unwrap()
    };
    let mut messages = Vec::new();
    for start in 0..stream.len().saturating_sub(8) {
        if &stream[start..start + 8] != b"YA\x0a\0\0\0RP" {
            continue;
        }
        let blocks = usize::from(stream[start + 8]);
        let sizes = start + 18;
        let length: usize = (0..blocks).map(|block| word(sizes + 4 * block)).sum();
        let body = sizes + 4 * blocks + 4;
        // A command of 8 bytes: length of the text behind it, `~`, key, 0, 1; with an envelope, the
        // key is the first letter of that text.
        let text = word(body);
        let command = body + 8;
        assert_eq!(stream[body + 4], b'~');
        let key = if text > 0 { stream[command] } else { stream[body + 5] };
        if key.eq_ignore_ascii_case(&b'd') {
            let words = stream.slice(command..command + text);
            let envelope =
                words.get(2..words.len().saturating_sub(1)).and_then(sig::Stamp::from_envelope);
            messages.push((stream.slice(command + text..body + length), envelope));
        }
    }
    assert!(!messages.is_empty(), "{name} holds no messages");
    messages
}

fn image(payload: &Payload) -> &Image {
    let Payload::Image(image) = payload else { panic!("{payload:?}") };
    image
}

fn object(i: i64) -> Value {
    let numbers = Tensor::from_elements(&[2, 3], vec![0_f32, 1.0, 2.0, 3.0, 4.0, 5.0]).unwrap();
    Map::from([
        ("i", i.into()),
        ("list", list([1.into(), 2.5.into(), "three".into(), Value::Null, true.into()])),
        ("arr", numbers.into()),
    ])
    .into()
}

#[test]
fn native_objects_of_wrapyfi() {
    let spec = topic(MessageType::NativeObject, []);
    let small = |i: i64| Value::from(Map::from([("i", i)]));
    for (name, wanted) in [
        ("wrapyfi_native.json", object as fn(i64) -> Value),
        ("wrapyfi_native_nopersist.json", small),
    ] {
        for (index, (bytes, _)) in sent(name).into_iter().enumerate() {
            let payload = read(bytes.clone(), &spec).unwrap();
            let index = i64::try_from(index).unwrap();
            assert_eq!(value(&payload), wanted(index), "{name}");
            assert_eq!(bytes_of(&payload, &spec), bytes, "{name}");
        }
    }
    // Over udp the payloads lie in datagrams: 8 bytes of check and number before each.
    let recorded = file("wrapyfi_native_udp.json");
    let datagrams: Vec<Vec<u8>> = recorded["datagrams"]
        .as_array()
        .unwrap()
        .iter()
        .map(|datagram| hex(datagram["hex"].as_str().unwrap()))
        .collect();
    let mut found = 0;
    for datagram in datagrams {
        let start = datagram.windows(4).position(|word| word == 260_i32.to_le_bytes());
        let Some(start) = start else { continue };
        let bytes = Bytes::from(datagram).slice(start..);
        let payload = read(bytes.clone(), &spec).unwrap();
        assert_eq!(value(&payload).get("list"), object(0).get("list"));
        assert_eq!(bytes_of(&payload, &spec), bytes);
        found += 1;
    }
    assert!(found > 0, "no object in the datagrams");
}

/// The announced bytes behind the pixels are Wrapyfi's memory, and byte 42 is a flag that only old
/// versions read.
fn comparable(bytes: &Bytes, pixels: usize) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    bytes[42] = 0;
    bytes[60 + pixels..].fill(0);
    bytes
}

#[test]
fn images_of_wrapyfi() {
    for (name, encoding, size) in [
        ("wrapyfi_image_rgb.json", Encoding::Bgr8, 3),
        ("wrapyfi_image_mono.json", Encoding::Mono8, 1),
        ("wrapyfi_image_float.json", Encoding::F32C1, 4),
        ("wrapyfi_image_rgbfloat.json", Encoding::F32C3, 12),
    ] {
        let spec = topic(MessageType::Image, [("wrapyfi_images", true.into())]);
        let packed = topic(MessageType::Image, [("packed_rows", true.into())]);
        for (bytes, _) in sent(name) {
            let payload = read(bytes.clone(), &spec).unwrap();
            let Pixels::Raw(raw) = &image(&payload).pixels else { panic!("{name}") };
            assert_eq!((raw.width, raw.height, raw.step), (7, 3, 7 * size), "{name}");
            assert_eq!(raw.encoding, encoding);
            let pixels = usize::try_from(21 * size).unwrap();
            // Shared with the message, not copied.
            assert_eq!(raw.data.as_ptr(), bytes[60..].as_ptr());
            assert_eq!(*raw.data, bytes[60..60 + pixels]);
            let again = bytes_of(&payload, &spec);
            assert_eq!(comparable(&again, pixels), comparable(&bytes, pixels), "{name}");
            // With the rows alone, the pixels are what their code says.
            let payload = read(bytes.clone(), &packed).unwrap();
            let Pixels::Raw(raw) = &image(&payload).pixels else { panic!("{name}") };
            let wanted = if encoding == Encoding::Bgr8 { Encoding::Rgb8 } else { encoding };
            assert_eq!(raw.encoding, wanted);
            let again = bytes_of(&payload, &packed);
            assert_eq!(comparable(&again, pixels), comparable(&bytes, pixels), "{name}");
        }
    }
}

#[test]
fn jpeg_images_of_wrapyfi() {
    let spec = topic(MessageType::CompressedImage, []);
    for (bytes, _) in sent("wrapyfi_image_jpg.json") {
        let payload = read(bytes.clone(), &spec).unwrap();
        let Pixels::Compressed { format, data } = &image(&payload).pixels else { panic!("a file") };
        assert_eq!(*format, CompressedFormat::Jpeg);
        assert!(data.ends_with(&[0xFF, 0xD9]));
        assert_eq!(bytes_of(&payload, &spec), bytes);
        // The program that wants pixels gets them.
        let raw = wrapyfi_endpoint::codec::jpeg::decode(data, &spec.limits, None).unwrap();
        assert_eq!((raw.width, raw.height), (16, 8));
    }
}

#[test]
fn sound_of_wrapyfi() {
    let spec = topic(MessageType::AudioChunk, []);
    let messages = sent("wrapyfi_audio.json");
    assert_eq!(messages.len(), 4);
    for (index, (bytes, _)) in messages.into_iter().enumerate() {
        let payload = read(bytes.clone(), &spec).unwrap();
        let Payload::AudioChunk(sound) = &payload else { panic!("{payload:?}") };
        assert_eq!((sound.frames, sound.channels, sound.sample_rate), (10, 1, 8000));
        assert_eq!(sound.format, SampleFormat::S16Le);
        assert_eq!(sound.data.as_ptr(), bytes[48..].as_ptr());
        assert_eq!(bytes_of(&payload, &spec), bytes);
        // The first one is Wrapyfi's sound of zeros; the others are ten steps from -1 to 1.
        let steps: Vec<u8> = (0_u8..10)
            .map(|step| if index == 0 { 0.0 } else { f32::from(step) * 2.0 / 9.0 - 1.0 })
            .flat_map(f32::to_le_bytes)
            .collect();
        let floats = AudioChunk::new(NOW, 10, 1, 8000, SampleFormat::F32Le, steps).unwrap();
        assert_eq!(bytes_of(&floats.into(), &spec), bytes);
    }
}

#[test]
fn requests_and_replies_of_wrapyfi() {
    use wrapyfi_data::types::ServiceKind;
    use wrapyfi_endpoint::{Request, ServiceSpec};
    let spec = ServiceSpec::new("/s", ServiceKind::NativeObject);
    let options = YarpOptions::default();
    for ((bytes, _), argument) in sent("wrapyfi_native_rpc.json").into_iter().zip([5, 6]) {
        let request = decode_request(&bytes, &spec, &options, Dialect::V3).unwrap();
        assert_eq!(request, Request::new([argument.into()]));
        assert_eq!(encode_request(&request, &spec, &options, Dialect::V3).unwrap(), bytes);
    }
    let recorded = file("wrapyfi_native_rpc.json");
    let parts = recorded["stream"].as_array().unwrap().iter();
    // Replies come without a frame, before the acknowledgement of 8 bytes.
    let replies: Vec<Bytes> = parts
        .filter(|part| part["dir"] == "s2c")
        .filter_map(|part| part["hex"].as_str())
        .map(|text| hex(text).into())
        .filter(|reply: &Bytes| reply.starts_with(&260_i32.to_le_bytes()))
        .collect();
    assert_eq!(replies.len(), 2);
    for (reply, i) in replies.into_iter().zip([5, 6]) {
        let reply = reply.slice(..reply.len() - 8);
        let payload = decode_reply(&reply, &spec, &options, Dialect::V3, NOW).unwrap().unwrap();
        assert_eq!(value(&payload), object(i));
        assert_eq!(encode_reply(&payload, &spec, &options, Dialect::V3).unwrap(), reply);
    }
}

#[test]
fn images_of_yarp() {
    let spec = topic(MessageType::Image, []);
    let mut seen = Vec::new();
    for (bytes, _) in sent("images_tcp.json") {
        match read(bytes.clone(), &spec) {
            Ok(payload) => {
                let Pixels::Raw(raw) = &image(&payload).pixels else { panic!("pixels") };
                seen.push(raw.encoding.name());
                let mut again = bytes_of(&payload, &spec).to_vec();
                if !raw.data.is_empty() {
                    assert_eq!(raw.data.as_ptr(), bytes[60..].as_ptr());
                    // Rows without padding are written with quantum 1.
                    again[40] = bytes[40];
                }
                again[42] = bytes[42];
                if bytes.len() > 60 {
                    assert_eq!(again, *bytes, "{}", raw.encoding);
                }
            }
            Err(error) => {
                let error = error.to_string();
                assert!(error.contains("which have no name in ROS"), "{error}");
                seen.push("none");
            }
        }
    }
    let is_recorded = |it: &Encoding| *it != Encoding::Bgra8 && !it.name().starts_with("bayer");
    for encoding in Encoding::ALL.into_iter().filter(is_recorded) {
        assert!(seen.contains(&encoding.name()), "{encoding} not in {seen:?}");
    }
    let stamps: Vec<_> = sent("images_tcp_envelope.json")
        .into_iter()
        .map(|(bytes, envelope)| {
            let options = YarpOptions { frame_id: "camera".into(), ..YarpOptions::default() };
            let bytes = Bytewise::object(bytes);
            let payload = decode(&bytes, envelope, &spec, &options, Dialect::V3, NOW).unwrap();
            assert_eq!(image(&payload).frame_id, "camera");
            let time = written(&payload, &spec).unwrap().stamp.unwrap().time_s;
            assert_eq!(Some(time), envelope.map(|stamp| stamp.time_s));
            image(&payload).stamp
        })
        .collect();
    assert!(stamps.len() == 3 && stamps.is_sorted(), "{stamps:?}");
}

#[test]
fn sounds_of_yarp() {
    let spec = topic(MessageType::AudioChunk, []);
    let mut shapes = Vec::new();
    for (bytes, _) in sent("sound_tcp.json") {
        let Ok(payload) = read(bytes.clone(), &spec) else {
            shapes.push((0, 0, 0));
            continue;
        };
        let Payload::AudioChunk(sound) = &payload else { panic!("{payload:?}") };
        shapes.push((sound.frames, sound.channels, sound.sample_rate));
        if sound.channels == 2 {
            let samples: Vec<i16> =
                sound.data.as_chunks().0.iter().map(|two| i16::from_le_bytes(*two)).collect();
            assert_eq!(samples, [1, -256, 2, -512, 3, -768, 4, -1024]);
        }
        assert_eq!(bytes_of(&payload, &spec), bytes);
    }
    assert!(
        shapes.iter().any(|(_, channels, rate)| (*channels, *rate) == (1, 16_000)),
        "{shapes:?}"
    );
    assert!(shapes.contains(&(4, 2, 44_100)), "{shapes:?}");
}

#[test]
fn states_of_yarp() {
    let spec = topic(MessageType::Ros(ros("sensor_msgs/msg/JointState")), []);
    let options = YarpOptions::default();
    for (name, measured) in [("state_tcp.json", 0), ("state_ext_tcp.json", 3)] {
        for (bytes, envelope) in sent(name) {
            let sent_at = envelope.unwrap();
            let bytes = Bytewise::object(bytes);
            let payload = decode(&bytes, envelope, &spec, &options, Dialect::V3, NOW).unwrap();
            let fields = value(&payload);
            let count = |field: &str| {
                fields.get(field).and_then(Value::as_tensor).map_or(0, Tensor::element_count)
            };
            assert_eq!(count("position"), 3, "{name}");
            assert_eq!((count("velocity"), count("effort")), (measured, measured), "{name}");
            let stamp = written(&payload, &spec).unwrap().stamp.unwrap();
            assert!((stamp.time_s - sent_at.time_s).abs() < 1e-6, "{name}");
        }
    }
}

#[test]
fn vectors_and_matrices_of_yarp() {
    let numbers = topic(MessageType::Ros(ros("std_msgs/msg/Float64MultiArray")), []);
    let any = topic(MessageType::NativeObject, []);
    let messages = sent("vector_matrix_stamp_tcp.json");
    let mut seen = Vec::new();
    for (bytes, _) in messages {
        let Ok(payload) = read(bytes.clone(), &numbers) else {
            // A Property: pairs, not numbers.
            assert!(matches!(value(&read(bytes, &any).unwrap()), Value::List(_)));
            seen.push("other");
            continue;
        };
        let fields = value(&payload);
        let dims = fields.get("layout").unwrap().get("dim").unwrap().as_items().unwrap();
        let again = bytes_of(&payload, &numbers);
        seen.push(if dims.len() == 2 { "matrix" } else { "vector" });
        if bytes[0] == 10 || dims.len() == 2 {
            assert_eq!(again, bytes);
        }
    }
    assert!(seen.contains(&"matrix") && seen.contains(&"vector") && seen.contains(&"other"));
}
