//! Images and sounds, one line of the table each.

use proptest::prelude::*;

use super::*;
use wrapyfi_data::types::{
    AudioChunk, CompressedFormat, Encoding, Image, Pixels, RawPixels, SampleFormat,
};

fn picture(encoding: Encoding, width: u32, height: u32, padding: u32) -> Payload {
    let row = width * u32::try_from(encoding.bytes_per_pixel()).unwrap();
    let step = row + padding;
    let bytes = (0..step * height).map(|at| u8::try_from(at % 251).unwrap()).collect::<Vec<_>>();
    let raw = RawPixels::new(width, height, encoding, step, bytes).unwrap();
    Image::new(NOW, raw).into()
}

fn raw(payload: &Payload) -> RawPixels {
    let Payload::Image(image) = payload else { panic!("{payload:?}") };
    let Pixels::Raw(raw) = &image.pixels else { panic!("{image:?}") };
    raw.clone()
}

#[test]
fn every_encoding_has_a_pixel_code() {
    let spec = topic(MessageType::Image, []);
    for (encoding, code) in [
        (Encoding::Mono8, b"mono"),
        (Encoding::Mono16, b"mo16"),
        (Encoding::Rgb8, b"rgb\0"),
        (Encoding::Bgr8, b"bgr\0"),
        (Encoding::Rgba8, b"rgba"),
        (Encoding::Bgra8, b"bgra"),
        (Encoding::I32C1, b"int\0"),
        (Encoding::F32C1, b"dec\0"),
        (Encoding::F32C3, b"rgb."),
        (Encoding::BayerRggb8, b"rggb"),
        (Encoding::BayerBggr8, b"bggr"),
        (Encoding::BayerGbrg8, b"gbrg"),
        (Encoding::BayerGrbg8, b"grbg"),
        (Encoding::BayerRggb16, b"rg16"),
        (Encoding::BayerBggr16, b"bg16"),
        (Encoding::BayerGbrg16, b"gb16"),
        (Encoding::BayerGrbg16, b"gr16"),
    ] {
        let payload = picture(encoding, 7, 3, 0);
        let bytes = bytes_of(&payload, &spec);
        assert_eq!(&bytes[20..24], code);
        assert_eq!(read(bytes, &spec).unwrap(), payload);
    }
    assert_eq!(Encoding::ALL.len(), 17);
}

#[test]
fn pixels_without_a_name_in_ros_are_named() {
    let spec = topic(MessageType::Image, []);
    let hue = sig::Image::from_packed(sig::PixelCode::Hsv, 1, 1, vec![1, 2, 3].into());
    let error =
        read(hue.unwrap().encode(sig::Rows::Announced).unwrap(), &spec).unwrap_err().to_string();
    assert!(error.ends_with("received one of pixels [hsv], which have no name in ROS"), "{error}");
    let error = read(typed("1 2 3"), &spec).unwrap_err().to_string();
    assert!(error.starts_with("expected an image"), "{error}");
}

#[test]
fn wrapyfi_calls_every_order_of_colours_rgb() {
    for (order, encoding, first) in [
        (Encoding::Bgr8, Encoding::Bgr8, 0),
        (Encoding::Bgr8, Encoding::Rgb8, 2),
        (Encoding::Rgb8, Encoding::Bgr8, 2),
        (Encoding::Rgb8, Encoding::Rgb8, 0),
    ] {
        let mut spec = topic(MessageType::Image, [("wrapyfi_images", true.into())]);
        spec.color_order = order;
        let payload = picture(encoding, 3, 2, 0);
        let bytes = bytes_of(&payload, &spec);
        assert_eq!((&bytes[20..24], bytes[60]), (&b"rgb\0"[..], first));
        let back = raw(&read(bytes, &spec).unwrap());
        assert_eq!(back.encoding, order);
    }
    let spec = topic(MessageType::Image, [("wrapyfi_images", true.into())]);
    let error = written(&picture(Encoding::Mono16, 2, 2, 0), &spec).unwrap_err().to_string();
    assert!(error.starts_with("image cannot hold a mono16 image of 2x2"), "{error}");
}

#[test]
fn empty_images_and_steps_that_contradict() {
    let spec = topic(MessageType::Image, []);
    for (width, height) in [(0, 0), (0, 5), (5, 0)] {
        let empty = RawPixels::dense(width, height, Encoding::Rgb8, Bytes::new()).unwrap();
        let payload = Image::new(NOW, empty).into();
        assert_eq!(read(bytes_of(&payload, &spec), &spec).unwrap(), payload, "{width}x{height}");
    }
    let mut wrong = raw(&picture(Encoding::Rgb8, 2, 2, 0));
    wrong.height = 3;
    let error = written(&Image::new(NOW, wrong).into(), &spec).unwrap_err().to_string();
    assert!(error.contains("needs 18 bytes, 12 are there"), "{error}");
}

#[test]
fn files_come_and_go_in_every_form() {
    let compressed = topic(MessageType::CompressedImage, []);
    let picture = picture(Encoding::Mono8, 16, 8, 0);
    let error = written(&picture, &compressed).unwrap_err();
    assert!(matches!(error, EncodeError::Mismatch { .. }), "{error}");
    let file = compressed.conversion().convert(picture, || NOW).unwrap();
    let payload = read(bytes_of(&file, &compressed), &compressed).unwrap();
    let Payload::Image(Image { pixels: Pixels::Compressed { format, data }, .. }) = &payload else {
        panic!("{payload:?}");
    };
    assert_eq!(*format, CompressedFormat::Jpeg);
    // A topic of pixels takes files as they come.
    let spec = topic(MessageType::Image, []);
    let options = YarpOptions::default();
    let blob = Bottle { values: vec![wrapyfi_yarp::Value::Blob(data.clone())] };
    let blob = Bytewise::bottle(&blob, Dialect::V3).unwrap();
    for sent in [Bytewise::raw(data.clone()), blob] {
        let taken = decode(&sent, None, &spec, &options, Dialect::V3, NOW).unwrap();
        assert_eq!(taken, payload);
    }
    let text = decode(&Bytewise::raw("no file"), None, &spec, &options, Dialect::V3, NOW);
    let error = text.unwrap_err().to_string();
    assert_eq!(error, "expected a jpeg or png file, received 7 other bytes");
    let objects = topic(MessageType::NativeObject, []);
    let other = decode(&Bytewise::raw(data.clone()), None, &objects, &options, Dialect::V3, NOW);
    assert!(matches!(other, Err(DecodeError::Mismatch { .. })));
    for wrong in ["\"not base64!\"", "\"\"", "\"aGVsbG8=\""] {
        assert!(read(typed(wrong), &compressed).is_err(), "{wrong}");
    }
}

#[test]
fn pictures_are_files_on_mjpeg() {
    let pixels: Vec<u8> = (0..48).collect();
    let dense = RawPixels::dense(4, 4, Encoding::Rgb8, pixels).unwrap();
    let image = Image { stamp: NOW, frame_id: String::new(), pixels: Pixels::Raw(dense) };
    let plain = Image { stamp: Stamp::default(), ..image.clone() };
    for message_type in [MessageType::Image, MessageType::CompressedImage] {
        let spec = topic(message_type, [("carrier", "mjpeg".into())]);
        let sent = written(&image.clone().into(), &spec).unwrap();
        assert_eq!(sent.payload.kind, PayloadKind::Raw);
        assert!(sent.payload.bytes.starts_with(&[0xff, 0xd8, 0xff]));
        assert_eq!(sent.stamp.unwrap().time_s, NOW.as_secs_f64());
        assert_eq!(written(&plain.clone().into(), &spec).unwrap().stamp, None);
        let options = YarpOptions::default();
        let back = decode(&sent.payload, sent.stamp, &spec, &options, Dialect::V3, NOW).unwrap();
        assert_eq!(written(&back, &spec).unwrap().payload, sent.payload);
    }
}

#[test]
fn sounds_keep_their_samples() {
    let spec = topic(MessageType::AudioChunk, []);
    let samples: Vec<u8> = (i16::MIN..=i16::MAX).flat_map(i16::to_le_bytes).collect();
    let chunk = AudioChunk::new(NOW, 32768, 2, 44_100, SampleFormat::S16Le, samples).unwrap();
    let payload = Payload::from(chunk);
    assert_eq!(read(bytes_of(&payload, &spec), &spec).unwrap(), payload);
    // Floats that Wrapyfi made of integers become those integers again.
    let all = -i16::MAX..=i16::MAX;
    let floats = all.clone().flat_map(|sample| (f32::from(sample) / 32767.0).to_le_bytes());
    let floats: Vec<u8> = floats.collect();
    let floats = AudioChunk::new(NOW, 65_535, 1, 8000, SampleFormat::F32Le, floats).unwrap();
    let bytes = bytes_of(&floats.into(), &spec);
    let Payload::AudioChunk(back) = read(bytes, &spec).unwrap() else { panic!("sound") };
    assert!(back.data.as_chunks().0.iter().map(|two| i16::from_le_bytes(*two)).eq(all));
    let loud: Vec<u8> = [1.5_f32, -2.0, f32::NAN].into_iter().flat_map(f32::to_le_bytes).collect();
    let loud = AudioChunk::new(NOW, 3, 1, 8000, SampleFormat::F32Le, loud).unwrap();
    let Payload::AudioChunk(back) = read(bytes_of(&loud.into(), &spec), &spec).unwrap() else {
        panic!("sound")
    };
    assert_eq!(*back.data, [0xFF, 0x7F, 0x00, 0x80, 0, 0]);
    // Over a text carrier the samples are plain numbers.
    let text = read(typed("2 1 2 8000 (5 -6)"), &spec).unwrap();
    let Payload::AudioChunk(text) = text else { panic!("{text:?}") };
    assert_eq!((text.frames, &*text.data), (2, &[5, 0, 0xFA, 0xFF][..]));
    for (wrong, wanted) in [
        ("2 1 2 0 (5 -6)", "frequency 0, from 1 to 2147483647 are read"),
        ("1 2 3", "expected a sound"),
    ] {
        let error = read(typed(wrong), &spec).unwrap_err().to_string();
        assert!(error.contains(wanted), "{error}");
    }
}

proptest! {
    #[test]
    fn every_picture_comes_back(
        which in 0..Encoding::ALL.len(), width in 1_u32..20, height in 1_u32..6, padding in 0_u32..20,
    ) {
        let spec = topic(MessageType::Image, []);
        let payload = picture(Encoding::ALL[which], width, height, padding);
        let bytes = bytes_of(&payload, &spec);
        let back = raw(&read(bytes.clone(), &spec).unwrap());
        prop_assert_eq!(back.data.as_ptr(), bytes[60..].as_ptr());
        prop_assert_eq!(back, raw(&payload));
        // Packed rows of padded pictures, as Wrapyfi reads them.
        let packed = topic(MessageType::Image, [("packed_rows", true.into())]);
        let back = raw(&read(bytes_of(&payload, &packed), &packed).unwrap());
        prop_assert_eq!(back, raw(&payload).to_dense());
    }
}

#[test]
fn an_image_is_no_sound() {
    let rows = vec![7; 3 * 640 * 480];
    let image = sig::Image::from_packed(sig::PixelCode::Rgb, 640, 480, rows.into()).unwrap();
    let sound = topic(MessageType::AudioChunk, []);
    let error = read(image.encode(sig::Rows::Announced).unwrap(), &sound).unwrap_err();
    assert!(error.to_string().starts_with("expected a sound, received a bottle of 4: "), "{error}");
}
