//! Pillow's images.

use bytes::Bytes;
use proptest::prelude::*;
use serde_json::{Value as Json, json};
use wrapyfi_data::Limits;
use wrapyfi_data::codec::{image_file, json as codec};
use wrapyfi_data::types::{
    CompressedFormat, Encoding, Image, Picture, Pixels, RawPixels, Stamp, Tensor, Value,
};

use super::{assert_refused, base64, decode, encode, hex, named, through_the_graph, vectors, wire};

/// A picture in the words of the vectors: mode, size and pixels as Pillow has them.
fn describe_picture(value: &Value) -> Json {
    let picture = value.as_picture().unwrap();
    let raw = match &picture.image.pixels {
        Pixels::Raw(raw) => raw.clone(),
        Pixels::Compressed { data, .. } => {
            image_file::decode(data, &Limits::default(), Some(Encoding::Rgb8)).unwrap()
        }
    };
    let mode = picture.mode.as_deref().unwrap_or(match raw.encoding {
        Encoding::Rgb8 => "RGB",
        Encoding::Rgba8 => "RGBA",
        Encoding::Mono8 => "L",
        Encoding::F32C1 => "F",
        other => panic!("{other}"),
    });
    let bytes = if mode == "1" {
        let row = |row: &[u8]| {
            row.chunks(8)
                .map(|eight| {
                    eight.iter().enumerate().fold(0, |bits, (i, p)| bits | (p & 1) << (7 - i))
                })
                .collect::<Vec<u8>>()
        };
        raw.data.chunks(raw.width as usize).flat_map(row).collect()
    } else {
        raw.data.to_vec()
    };
    json!({"mode": mode, "size_w_h": [raw.width, raw.height], "raw_bytes_hex": hex(&bytes)})
}

/// JPEG decoders may differ by rounding.
fn assert_near(a: &str, b: &str, tolerance: u8, name: &str) {
    let bytes = |hex: &str| -> Vec<u8> {
        hex.as_bytes()
            .chunks(2)
            .map(|two| u8::from_str_radix(std::str::from_utf8(two).unwrap(), 16).unwrap())
            .collect()
    };
    let (a, b) = (bytes(a), bytes(b));
    assert_eq!(a.len(), b.len(), "{name}");
    assert!(a.iter().zip(&b).all(|(a, b)| a.abs_diff(*b) <= tolerance), "{name}: {a:?} {b:?}");
}

/// Palettes and inks: what Pillow has, and the colours that a viewer shows.
#[test]
fn palettes_and_inks_are_read_and_written() {
    for vector in vectors("pillow_types") {
        let name = vector["name"].as_str().unwrap();
        let (value, facts) = (decode(&wire(&vector)), &vector["facts"]);
        let picture = value.as_picture().unwrap_or_else(|| panic!("{name}: {value:?}"));
        let (text, again) = through_the_graph(&value);
        assert_eq!(again, value, "{name}");
        if name.contains("cmyk") {
            assert!(
                text.contains(r#""encoding": "8UC4", "width": 3, "height": 2, "mode": "CMYK""#),
                "{text}"
            );
        }
        if let Pixels::Raw(raw) = &picture.image.pixels {
            if !name.ends_with("gif") {
                assert_eq!(picture.mode.as_deref(), facts["mode"].as_str(), "{name}");
                assert_eq!(json!(hex(&raw.data)), facts["raw_bytes_hex"], "{name}");
            }
            // As a file, for Python.
            let file = decode(&encode(&value));
            if name.contains("cmyk") {
                assert_eq!(file, value, "{name}");
            }
        }
        let shown = Image::from_value(&value, Encoding::Rgb8, Stamp::default()).unwrap();
        let shown = match shown.pixels {
            Pixels::Raw(raw) if raw.encoding == Encoding::Mono8 => {
                raw.data.iter().flat_map(|&grey| [grey; 3]).collect::<Vec<u8>>()
            }
            // GIF has no pixel that is half there.
            Pixels::Raw(raw) if raw.encoding == Encoding::Rgba8 => {
                raw.data.as_chunks::<4>().0.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect()
            }
            Pixels::Raw(raw) => raw.data.to_vec(),
            Pixels::Compressed { data, .. } => {
                let limits = Limits::default();
                image_file::decode(&data, &limits, Some(Encoding::Rgb8)).unwrap().data.to_vec()
            }
        };
        // Without its palette Pillow shows a picture in black; here are its greys.
        if name != "raw_p" {
            assert_eq!(json!(hex(&shown)), facts["rgb_hex"], "{name}");
        }
    }
}

#[test]
fn every_pillow_image_is_what_was_sent() {
    let mut checked = 0;
    for vector in vectors("pillow") {
        let name = vector["name"].as_str().unwrap();
        let value = decode(&wire(&vector));
        // Not what Wrapyfi makes of it, which are wrong pixels where they came without a file.
        let (found, original) = (describe_picture(&value), &vector["original"]);
        assert_eq!(found["mode"], original["mode"], "{name}");
        assert_eq!(found["size_w_h"], original["size_w_h"], "{name}");
        let tolerance = if original["format"] == "JPEG" { 3 } else { 0 };
        let bytes = |description: &Json| description["raw_bytes_hex"].as_str().unwrap().to_owned();
        assert_near(&bytes(&found), &bytes(original), tolerance, name);

        // Written as a file, which is the form that Wrapyfi reads right.
        let written = encode(&value);
        let tag: Json = serde_json::from_slice(&written).unwrap();
        assert_eq!(tag["__wrapyfi__"].as_array().unwrap().len(), 2, "{name}");
        let again = decode(&written);
        if name == "raw_1bit" {
            // The file says one bit itself; until it is opened it is a PNG like any other.
            let picture = again.as_picture().unwrap();
            assert!(matches!(picture.image.pixels, Pixels::Compressed { .. }));
        } else {
            assert_eq!(describe_picture(&again), found, "{name}");
        }
        assert_eq!(through_the_graph(&value).1, value, "{name}");
        checked += 1;
    }
    assert_eq!(checked, 8);
}

#[test]
fn files_that_ros_knows_stay_as_they_are() {
    for (name, format) in
        [("file_png", CompressedFormat::Png), ("file_jpeg", CompressedFormat::Jpeg)]
    {
        let vector = named("pillow", name);
        let value = decode(&wire(&vector));
        let picture = value.as_picture().unwrap();
        assert!(
            matches!(&picture.image.pixels, Pixels::Compressed { format: found, .. } if *found == format)
        );
        assert_eq!(encode(&value), wire(&vector), "{name}");
        let (text, again) = through_the_graph(&value);
        let head = format!("{{\"__wrapyfi__\": [\"picture\", {{\"format\": \"{format}\", ");
        assert!(text.starts_with(&head), "{text}");
        assert_eq!(again, value);
    }
}

#[test]
fn pictures_are_readable_in_the_graph() {
    let (text, _) = through_the_graph(&decode(&wire(&named("pillow", "raw_rgb"))));
    assert_eq!(
        text,
        r#"{"__wrapyfi__": ["picture", {"encoding": "rgb8", "width": 3, "height": 2, "data": {"__wrapyfi__": ["tensor", 0]}}]}"#
    );
    let tensors = [Tensor::from_elements(&[2, 3], vec![0_u8; 6]).unwrap()];
    for (body, wanted) in [
        (r#"{"encoding": "rgb8", "width": 3, "height": 2, "data": T}"#, "needs 18 bytes, 6"),
        (r#"{"encoding": "mono8", "width": 6, "height": 1, "data": T}"#, "of shape [1, 6]"),
        (r#"{"encoding": "mono8", "width": -3, "height": 2, "data": T}"#, "width is no number"),
        (r#"{"encoding": "yuv", "width": 3, "height": 2, "data": T}"#, "\"yuv\" is none of"),
        (r#"{"format": "png", "data": T}"#, "a file is uint8 of one dimension"),
        (r#"{"format": "bmp", "data": T}"#, "neither jpeg nor png"),
        (r#"{"width": 3}"#, "data is no tensor"),
    ] {
        let body = body.replace('T', r#"{"__wrapyfi__": ["tensor", 0]}"#);
        let text = format!(r#"{{"__wrapyfi__": ["picture", {body}]}}"#);
        let error = codec::decode_with_tensors(
            &text.into(),
            &tensors,
            &Limits::default(),
            &wrapyfi_plugins::standard(),
        );
        let error = error.unwrap_err().to_string();
        assert!(error.contains(wanted), "{body}: {error}");
    }
}

#[test]
fn hostile_pictures_are_refused() {
    let big = base64(&[0; 30]);
    assert_refused(&[
        (json!(["PILImage"]), "the object has 0 parts"),
        (json!(["PILImage", 5]), "text should be there"),
        (json!(["PILImage", "%PDF-1.7"]), "begins with \"%PDF-1.7\""),
        (json!(["PILImage", ""]), "a file of 0 bytes"),
        (json!(["PILImage", "\u{2603}"]), "stands for no byte"),
        (json!(["PILImage", "BM\u{0}\u{0}"]), "malformed BMP"),
        (json!(["PILImage", "GIF89a"]), "malformed GIF"),
        (json!(["PILImage", "II*\u{0}\u{8}\u{0}\u{0}\u{0}"]), "malformed TIFF"),
        (json!(["PILImage", big, [-3, 2], "RGB"]), "[width, height]"),
        (json!(["PILImage", big, [3, 2, 1], "RGB"]), "[width, height]"),
        (json!(["PILImage", big, [3.5, 2], "RGB"]), "[width, height]"),
        (json!(["PILImage", big, "3x2", "RGB"]), "no text"),
        (json!(["PILImage", big, [4_294_967_296_u64, 1], "L"]), "[width, height]"),
        (
            json!(["PILImage", big, [4_294_967_295_u64, 4_294_967_295_u64], "F"]),
            "larger than memory",
        ),
        (json!(["PILImage", big, [100_000, 100_000], "L"]), "10000000000 bytes, 30 are there"),
        (json!(["PILImage", big, [4_294_967_295_u64, 4_294_967_295_u64], "1"]), "30 are there"),
        (json!(["PILImage", big, [3, 2], "RGB"]), "needs 18 bytes, 30 are there"),
        (json!(["PILImage", big, [5, 2], "LA"]), "mode \"LA\""),
        (json!(["PILImage", big, [5, 2], 7]), "text should be there"),
        (json!(["PILImage", "AAEC", [2, 1], "RGB"]), "needs 6 bytes, 3 are there"),
        (json!(["PILImage", "AAE", [3, 1], "L"]), "part 0"),
    ]);
}

/// Small files that stand for large pictures: all of a message together stay below its limit.
#[test]
fn many_small_files_cannot_fill_the_memory() {
    // A GIF of 1000 x 1000 pixels in some hundred bytes would do; a BMP of bits is simpler to make.
    let (width, height) = (4096_u32, 512_u32);
    let mut file = b"BM".to_vec();
    file.extend([0; 8]);
    for word in [62_u32, 40, width, height, 1 | 1 << 16, 0, 0, 0, 0, 2, 2, 0, 0x00FF_FFFF] {
        file.extend(word.to_le_bytes());
    }
    file.extend(vec![0_u8; (width / 8 * height) as usize]);
    let text: String = file.iter().map(|byte| char::from(*byte)).collect();
    let object = json!({"__wrapyfi__": ["PILImage", text]});
    let limits = Limits { message_bytes: 16 << 20, ..Limits::default() };
    let message = Bytes::from(json!([object, object, object, object]).to_string());
    let value = codec::decode(&message, &limits, &wrapyfi_plugins::standard()).unwrap();
    let refused: Vec<_> = value.refusals().map(|(_, reason)| reason.to_owned()).collect();
    assert!(refused.len() >= 2, "{refused:?}");
    for reason in &refused {
        assert!(reason.contains("BMP of 4096x512") && reason.contains("the limit is"), "{reason}");
    }
    let one =
        codec::decode(&Bytes::from(object.to_string()), &limits, &wrapyfi_plugins::standard())
            .unwrap();
    assert!(one.as_picture().is_some(), "{:?}", one.refusals().next());
}

#[test]
fn pictures_that_no_file_holds_say_what_to_do() {
    let picture = |encoding, width, data: Vec<u8>| {
        let raw = RawPixels::dense(width, 1, encoding, data).unwrap();
        Value::from(Picture { image: Image::new(Stamp::default(), raw), mode: None })
    };
    let error =
        codec::encode(&picture(Encoding::F32C3, 1, vec![0; 12]), &wrapyfi_plugins::standard())
            .unwrap_err()
            .to_string();
    assert!(error.contains("32FC3") && error.contains("send it as an array"), "{error}");
    // Nothing can be misread in an image without pixels.
    let empty = encode(&picture(Encoding::Bgr8, 0, vec![]));
    assert_eq!(&empty[..], br#"{"__wrapyfi__": ["PILImage", "", [0, 1], "RGB"]}"#);
    assert!(decode(&empty).as_picture().is_some());
}

proptest! {
    #[test]
    fn pictures_come_back(
        encoding in proptest::sample::select(vec![
            Encoding::Mono8, Encoding::Mono16, Encoding::Rgb8, Encoding::Rgba8,
            Encoding::I32C1, Encoding::F32C1,
        ]),
        width in 1_u32..9,
        height in 1_u32..9,
        seed: u64,
    ) {
        let size = (width * height) as usize * encoding.bytes_per_pixel();
        let data: Vec<u8> = (0..size as u64).map(|i| (i.wrapping_mul(seed) >> 9) as u8).collect();
        let raw = RawPixels::dense(width, height, encoding, data).unwrap();
        let picture = Picture { image: Image::new(Stamp::default(), raw.clone()), mode: None };
        let value = Value::from(picture);
        prop_assert_eq!(&through_the_graph(&value).1, &value);
        let again = decode(&encode(&value));
        let pixels = match &again.as_picture().unwrap().image.pixels {
            Pixels::Raw(raw) => raw.clone(),
            Pixels::Compressed { data, .. } => {
                image_file::decode(data, &Limits::default(), Some(Encoding::Rgb8)).unwrap()
            }
        };
        prop_assert_eq!(pixels, raw);
    }
}
