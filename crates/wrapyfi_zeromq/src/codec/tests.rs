use super::*;
use wrapyfi_data::Limits;
use wrapyfi_data::types::{
    AudioChunk, CompressedFormat, Dtype, Encoding, Image, MessageType, ParameterValue, Pixels,
    Properties, RawPixels, SampleFormat, Tensor, Value,
};

const RECEIVED: Stamp = Stamp { sec: 7, nanosec: 8 };

fn spec(message_type: MessageType) -> TopicSpec {
    TopicSpec::new("/t", message_type)
}

/// Decodes a message of the given body, with a header where the type has one.
fn body(message_type: MessageType, body: impl Into<Bytes>) -> Result<Payload, DecodeError> {
    let mut frames = vec![Bytes::from("/t")];
    if message_type.data_type() != DataType::NativeObject {
        frames.push("{timestamp:1.5}".into());
    }
    frames.push(body.into());
    decode(&frames, &spec(message_type), RECEIVED)
}

fn json_of(dtype: Dtype, shape: &[usize], data: Vec<u8>) -> Vec<u8> {
    json::encode(&Tensor::new(dtype, shape, data).unwrap().into(), &wrapyfi_plugins::standard())
        .unwrap()
}

fn frames_of(payload: &Payload, spec: &TopicSpec) -> Vec<Bytes> {
    encode(payload, spec).unwrap().into_iter().map(Bytes::from).collect()
}

#[test]
fn properties_are_the_dict_of_a_native_object() {
    let properties = Properties::from_iter([
        ("gain", ParameterValue::from(2.5)),
        ("raw", vec![1_u8, 255].into()),
        ("gone", ParameterValue::NotSet),
    ]);
    let frames = frames_of(&properties.clone().into(), &spec(MessageType::Properties));
    assert_eq!(frames.len(), 2);
    let read = |message_type| decode(&frames, &spec(message_type), RECEIVED).unwrap();
    assert_eq!(read(MessageType::NativeObject), properties.to_value().into());
    assert_eq!(read(MessageType::Properties), properties.into());
    let frames = [Bytes::from("/t"), Bytes::from(r#"{"gain": {"low": 1}}"#)];
    let nested = decode(&frames, &spec(MessageType::Properties), RECEIVED).unwrap();
    assert_eq!(nested, Properties::from([("gain.low", 1_i64)]).into());
    for wrong in ["[1]", r#"{"a": {"__wrapyfi__": ["set", [1]]}}"#] {
        let frames = [Bytes::from("/t"), Bytes::from(wrong)];
        let error = decode(&frames, &spec(MessageType::Properties), RECEIVED).unwrap_err();
        assert!(error.to_string().starts_with("expected properties"), "{error}");
    }
    let frames = vec![Bytes::from("{}"); 3];
    assert!(decode(&frames, &spec(MessageType::Properties), RECEIVED).is_err());
}

#[test]
fn arrays_become_pictures_by_type_and_shape() {
    for (dtype, shape, encoding) in [
        (Dtype::U8, &[2, 3][..], Encoding::Mono8),
        (Dtype::U8, &[2, 3, 1], Encoding::Mono8),
        (Dtype::U8, &[2, 3, 3], Encoding::Bgr8),
        (Dtype::U8, &[2, 3, 4], Encoding::Bgra8),
        (Dtype::U16, &[2, 3], Encoding::Mono16),
        (Dtype::F32, &[2, 3], Encoding::F32C1),
        (Dtype::F32, &[2, 3, 3], Encoding::F32C3),
    ] {
        let data: Vec<u8> = (0..shape.iter().product::<usize>() * dtype.size())
            .map(|i| u8::try_from(i).unwrap())
            .collect();
        let payload = body(MessageType::Image, json_of(dtype, shape, data.clone())).unwrap();
        let Payload::Image(Image { stamp, pixels: Pixels::Raw(raw), .. }) = &payload else {
            panic!("{payload:?}");
        };
        assert_eq!(*stamp, Stamp { sec: 1, nanosec: 500_000_000 });
        assert_eq!((raw.width, raw.height, raw.encoding), (3, 2, encoding));
        assert_eq!(raw.data, data);
        let again = frames_of(&payload, &spec(MessageType::Image));
        assert_eq!(decode(&again, &spec(MessageType::Image), RECEIVED).unwrap(), payload);
    }
}

#[test]
fn other_arrays_are_named_with_their_numbers() {
    for (dtype, shape) in [
        (Dtype::U8, &[4][..]),
        (Dtype::U8, &[1, 2, 2]),
        (Dtype::F64, &[2, 2]),
        (Dtype::U16, &[2, 2, 3]),
        (Dtype::U8, &[1, 1, 1, 3]),
    ] {
        let data = vec![0; shape.iter().product::<usize>() * dtype.size()];
        let error = body(MessageType::Image, json_of(dtype, shape, data)).unwrap_err();
        assert!(matches!(error, DecodeError::Mismatch { .. }), "{error}");
        assert!(error.to_string().ends_with(&format!("{dtype} of shape {shape:?}")), "{error}");
    }
    let error = body(MessageType::Image, "[1, 2]").unwrap_err();
    assert_eq!(error.to_string(), "expected an image as array, received list");
}

#[test]
fn the_colour_order_of_the_topic_decides() {
    let red = RawPixels::new(1, 2, Encoding::Rgb8, 4, vec![255, 1, 0, 9, 255, 1, 0, 9]).unwrap();
    let red = Payload::from(Image::new(RECEIVED, red));
    for (color_order, first, last) in [(Encoding::Bgr8, 0, 255), (Encoding::Rgb8, 255, 0)] {
        let spec = TopicSpec { color_order, ..spec(MessageType::Image) };
        let Payload::Image(image) = decode(&frames_of(&red, &spec), &spec, RECEIVED).unwrap()
        else {
            panic!("an image");
        };
        let Pixels::Raw(raw) = image.pixels else { panic!("pixels") };
        assert_eq!(raw.encoding, color_order);
        assert_eq!(*raw.data, [first, 1, last, first, 1, last]);
    }
}

#[test]
fn files_and_pixels_have_a_type_each() {
    let raw = RawPixels::dense(16, 8, Encoding::Mono8, vec![50; 128]).unwrap();
    let raw = Payload::from(Image::new(RECEIVED, raw));
    let (compressed, pixels) = (spec(MessageType::CompressedImage), spec(MessageType::Image));
    let file = compressed.conversion().convert(raw.clone(), || RECEIVED).unwrap();
    let frames = frames_of(&file, &compressed);
    assert_eq!(CompressedFormat::sniff(&frames[2]), Some(CompressedFormat::Jpeg));
    assert_eq!(decode(&frames, &compressed, RECEIVED).unwrap(), file);
    let again = pixels.conversion().convert(file.clone(), || RECEIVED).unwrap();
    let again = decode(&frames_of(&again, &pixels), &pixels, RECEIVED).unwrap();
    assert!(matches!(again, Payload::Image(Image { pixels: Pixels::Raw(_), .. })));
    for (other, spec) in [(&raw, &compressed), (&file, &pixels)] {
        let error = encode(other, spec).unwrap_err();
        assert!(matches!(error, EncodeError::Mismatch { .. }), "{error}");
    }
}

#[test]
fn sound_of_other_types_is_converted() {
    let chunk = |dtype: Dtype, data: Vec<u8>| {
        let array = Tensor::new(dtype, [2], data).unwrap();
        let tuple = Value::Tuple(vec![2.into(), 1.into(), 8000.0.into(), array.into()]);
        match body(
            MessageType::AudioChunk,
            json::encode(&tuple, &wrapyfi_plugins::standard()).unwrap(),
        )? {
            Payload::AudioChunk(AudioChunk { format, data, .. }) => {
                Ok::<_, DecodeError>((format, data))
            }
            other => panic!("{other:?}"),
        }
    };
    let s16 = |samples: [i16; 2]| {
        (SampleFormat::S16Le, Bytes::from(samples.map(i16::to_le_bytes).concat()))
    };
    let f32 = |samples: [f32; 2]| {
        (SampleFormat::F32Le, Bytes::from(samples.map(f32::to_le_bytes).concat()))
    };
    let i32s = [i32::MIN, 1 << 30].map(i32::to_le_bytes).concat();
    let f64s = [0.5_f64, -1.0].map(f64::to_le_bytes).concat();
    assert_eq!(chunk(Dtype::F64, f64s).unwrap(), f32([0.5, -1.0]));
    assert_eq!(chunk(Dtype::F16, vec![0, 0x38, 0, 0xBC]).unwrap(), f32([0.5, -1.0]));
    assert_eq!(chunk(Dtype::I32, i32s).unwrap(), f32([-1.0, 0.5]));
    assert_eq!(chunk(Dtype::I16, vec![1, 0, 0, 0x80]).unwrap(), s16([1, i16::MIN]));
    assert_eq!(chunk(Dtype::I8, vec![1, 0x80]).unwrap(), s16([256, i16::MIN]));
    assert_eq!(chunk(Dtype::U8, vec![128, 0]).unwrap(), s16([0, i16::MIN]));
    assert_eq!(chunk(Dtype::U16, vec![0, 0x80, 0, 0]).unwrap(), s16([0, i16::MIN]));
    let error = chunk(Dtype::I64, vec![0; 16]).unwrap_err();
    assert_eq!(error.to_string(), "expected sound as float32 or int16, received int64");
}

#[test]
fn sound_must_be_as_long_as_it_says() {
    let array = Value::from(Tensor::new(Dtype::F32, [2, 3], vec![0; 24]).unwrap());
    let chunk = |items: [Value; 3]| {
        let mut items = items.to_vec();
        items.push(array.clone());
        let text = json::encode(&Value::Tuple(items), &wrapyfi_plugins::standard()).unwrap();
        body(MessageType::AudioChunk, text)
    };
    assert!(chunk([2.into(), 3.into(), 1.into()]).is_ok());
    for (items, wanted) in [
        ([3, 3, 1], "3 frames x 3 channels are 9 samples, not [2, 3]"),
        ([-1, 3, 1], "chunk is -1, not from 0 to"),
        ([2, 0, 1], "channels is 0, not from 1 to 255"),
        ([2, 300, 1], "channels is 300"),
        ([2, 3, 0], "rate is 0, not from 1"),
        ([i64::MAX, 3, 1], "chunk is 9223372036854775807"),
    ] {
        let error = chunk(items.map(Value::Int)).unwrap_err();
        assert!(matches!(error, DecodeError::Malformed { .. }), "{error}");
        assert!(error.to_string().contains(wanted), "{error}");
    }
    let error = body(MessageType::AudioChunk, "[1, 2, 3, 4]").unwrap_err();
    assert!(error.to_string().ends_with("received (int, int, int, int)"), "{error}");
    let error = body(MessageType::AudioChunk, "{}").unwrap_err();
    assert!(error.to_string().ends_with("received dict"), "{error}");
}

#[test]
fn mono_sound_keeps_the_shape_of_its_array() {
    for shape in [vec![2], vec![2, 1]] {
        let array = Tensor::new(Dtype::F32, shape.clone(), vec![0; 8]).unwrap();
        let tuple = Value::Tuple(vec![2.into(), 1.into(), 8000.into(), array.into()]);
        let text = json::encode(&tuple, &wrapyfi_plugins::standard()).unwrap();
        let sound = body(MessageType::AudioChunk, text.clone()).unwrap();
        let Payload::AudioChunk(chunk) = &sound else { panic!("{sound:?}") };
        assert_eq!(chunk.shape(), shape);
        let frames = frames_of(&sound, &spec(MessageType::AudioChunk));
        assert_eq!(frames.last().unwrap()[..], text[..]);
    }
}

#[test]
fn integer_sound_goes_out_as_floats() {
    let data = [0_i16, -16_384].map(i16::to_le_bytes).concat();
    let sound = AudioChunk::new(RECEIVED, 1, 2, 8000, SampleFormat::S16Le, data).unwrap();
    let spec = spec(MessageType::UpstreamAudio);
    let frames = frames_of(&sound.into(), &spec);
    let Payload::AudioChunk(sound) = decode(&frames, &spec, RECEIVED).unwrap() else { panic!() };
    assert_eq!((sound.frames, sound.channels, sound.format), (1, 2, SampleFormat::F32Le));
    assert_eq!(*sound.data, *[0.0_f32, -0.5].map(f32::to_le_bytes).concat());
}

#[test]
fn the_number_of_frames_is_part_of_the_type() {
    let frame = || Bytes::from("{}");
    for (message_type, frames) in [
        (MessageType::NativeObject, vec![]),
        (MessageType::NativeObject, vec![frame(); 3]),
        (MessageType::Image, vec![frame(); 2]),
        (MessageType::AudioChunk, vec![frame(); 4]),
    ] {
        let error = decode(&frames, &spec(message_type), RECEIVED).unwrap_err();
        assert!(matches!(error, DecodeError::Mismatch { .. }), "{error}");
    }
    let error = encode(&Value::Null.into(), &spec(MessageType::Image)).unwrap_err();
    assert_eq!(error.to_string(), "expected Image, was given NativeObject");
}

#[test]
fn the_message_size_is_kept_in_both_directions() {
    let limits = Limits { message_bytes: 16, ..Limits::default() };
    let spec = TopicSpec { limits, ..spec(MessageType::NativeObject) };
    let long = Payload::from(Value::from("0123456789012345"));
    let error = encode(&long, &spec).unwrap_err();
    assert_eq!(error, EncodeError::TooLarge { actual: 20, limit: 16 });
    let error = decode(&[frame("/t"), frame("\"0123456789012345\"")], &spec, RECEIVED).unwrap_err();
    assert!(error.to_string().contains("20, the limit is 16 (raise max_message_mib)"), "{error}");
}

fn frame(text: &'static str) -> Bytes {
    Bytes::from_static(text.as_bytes())
}

#[test]
fn an_unreadable_time_becomes_the_time_of_reception() {
    let frames = [frame("/t"), frame("?"), frame("\u{fffd}")];
    assert!(decode(&frames, &spec(MessageType::Image), RECEIVED).is_err());
    let jpeg = Bytes::from_static(&[0xFF, 0xD8, 0xFF, 0xE0]);
    let frames = [frame("/t"), frame("{timestamp:soon}"), jpeg];
    let Payload::Image(image) = decode(&frames, &spec(MessageType::Image), RECEIVED).unwrap()
    else {
        panic!("an image");
    };
    assert_eq!(image.stamp, RECEIVED);
}

#[test]
fn headers_survive() {
    let stamp = Stamp { sec: 1_795_214_428, nanosec: 963_405_123 };
    let raw = RawPixels::dense(1, 1, Encoding::Rgb8, vec![255, 0, 0]).unwrap();
    let image = Image { frame_id: "left \"eye\"".into(), ..Image::new(stamp, raw) };
    let object = NativeObject { stamp, frame_id: "map".into(), value: 5.into() };
    let sound = AudioChunk::new(stamp, 1, 1, 8000, SampleFormat::F32Le, vec![0; 4]).unwrap();
    let sound = AudioChunk { frame_id: "ear".into(), ..sound };
    for payload in [Payload::from(image.clone()), object.into(), sound.into()] {
        let message_type = payload.data_type().name().parse().unwrap();
        // The sender says the order of the colours, whatever the receiver assumes.
        let rgb = TopicSpec { color_order: Encoding::Rgb8, ..spec(message_type) };
        let frames = frames_of(&payload, &rgb);
        assert_eq!(frames.len(), 3);
        assert_eq!(decode(&frames, &spec(message_type), RECEIVED), Ok(payload));
    }
    // Towards Wrapyfi red is last, and the header says so.
    let frames = frames_of(&image.into(), &spec(MessageType::Image));
    assert_eq!(
        frames[1],
        r#"{timestamp:1795214428.963405123, encoding:"bgr8", frame_id:"left \"eye\""}"#
    );
    let rgb = TopicSpec { color_order: Encoding::Rgb8, ..spec(MessageType::Image) };
    let Ok(Payload::Image(Image { pixels: Pixels::Raw(raw), .. })) =
        decode(&frames, &rgb, RECEIVED)
    else {
        panic!("pixels")
    };
    assert_eq!((raw.encoding, &raw.data[..]), (Encoding::Bgr8, &[0, 0, 255][..]));
}

#[test]
fn objects_without_a_header_have_two_frames_as_wrapyfi_s() {
    let frames = frames_of(&Value::from(5).into(), &spec(MessageType::NativeObject));
    assert_eq!(frames.len(), 2);
    // A time alone is a header, too.
    let frames = ["/t", "5", "1795214428.5"].map(Bytes::from);
    let read = decode(&frames, &spec(MessageType::NativeObject), RECEIVED).unwrap();
    let Payload::NativeObject(object) = read else { panic!("{read:?}") };
    assert_eq!((object.stamp.sec, object.stamp.nanosec), (1_795_214_428, 500_000_000));
    assert_eq!(object.value, Value::from(5));
    // An image is no object with a header.
    let frames = ["/t", "{timestamp:1.5}", "[]"].map(Bytes::from);
    let error = decode(&frames, &spec(MessageType::NativeObject), RECEIVED).unwrap_err();
    let told = "NativeObject in 2 frames, or 3 with a header at the end";
    assert!(error.to_string().contains(told), "{error}");
    let frames = frames_of(&Value::from(5).into(), &spec(MessageType::NativeObject));
    let error = decode(&frames, &spec(MessageType::Image), RECEIVED).unwrap_err();
    assert!(error.to_string().contains("together, which look like NativeObject"), "{error}");
}

#[test]
fn types_by_their_frames() {
    assert_eq!(looks_like(3, &[0xFF, 0xD8, 0xFF, 0xE0]), Some("CompressedImage"));
    let image = b"{\"__wrapyfi__\": [\"numpy.ndarray\", \"k05V";
    assert_eq!(looks_like(3, image), Some("Image"));
    assert_eq!(looks_like(3, b"{\"__wrapyfi__\": [\"tuple\", [1"), Some("AudioChunk"));
    assert_eq!(looks_like(3, b"{timestamp:1.5, frame_id"), Some("NativeObject"));
    assert_eq!(looks_like(3, b"1795214428.9634051"), Some("NativeObject"));
    assert_eq!(looks_like(2, b"\x00\x01"), None);
    assert_eq!(looks_like(5, b"{"), None);
}
