//! Properties of all values and all bytes.

use crate::golden::packed;
use bytes::Bytes;
use proptest::collection::vec;
use proptest::prelude::*;
use wrapyfi_yarp::bottle::{BottleScan, Frame, Text, Vocab, Vocab64};
use wrapyfi_yarp::sig::{Image, ImageHeader, Matrix, PixelCode, Rows, Sound, Stamp, Vector};
use wrapyfi_yarp::{Bottle, Dialect, Value, WireLimits};

fn dialects() -> impl Strategy<Value = Dialect> {
    prop_oneof![Just(Dialect::V3), Just(Dialect::V4)]
}

/// Any value; NaN is left out because it differs from itself.
fn values(dialect: Dialect) -> impl Strategy<Value = Value> {
    let float = any::<f64>().prop_filter("differs from itself", |number| !number.is_nan());
    let single = any::<f32>().prop_filter("differs from itself", |number| !number.is_nan());
    let long = any::<i64>().prop_map(move |number| match dialect {
        Dialect::V3 => Value::Int64(number),
        Dialect::V4 => Value::Vocab64(Vocab64(number)),
    });
    let leaf = prop_oneof![
        any::<i8>().prop_map(Value::Int8),
        any::<i16>().prop_map(Value::Int16),
        any::<i32>().prop_map(Value::Int32),
        any::<i64>().prop_map(Value::Int64),
        single.prop_map(Value::Float32),
        float.prop_map(Value::Float64),
        any::<i32>().prop_map(|number| Value::Vocab32(Vocab(number))),
        long,
        vec(any::<u8>(), 0..20).prop_map(|bytes| Value::String(Text::from(bytes))),
        vec(any::<u8>(), 0..20).prop_map(Value::blob),
    ];
    leaf.prop_recursive(4, 40, 6, |inner| {
        prop_oneof![
            vec(inner.clone(), 0..6).prop_map(|values| Value::List(values.into())),
            vec(inner, 0..6).prop_map(|values| Value::Dict(values.into())),
        ]
    })
}

/// A bottle, often of one kind.
fn bottles() -> impl Strategy<Value = (Dialect, Bottle)> {
    dialects().prop_flat_map(|dialect| {
        let mixed = vec(values(dialect), 0..8);
        let equal = (values(dialect), 0..8_usize).prop_map(|(value, count)| vec![value; count]);
        let values = prop_oneof![mixed, equal];
        values.prop_map(move |values| (dialect, Bottle { values }))
    })
}

/// Text made of what matters to the reader.
fn texts() -> impl Strategy<Value = Vec<u8>> {
    let piece = prop_oneof![
        4 => proptest::sample::select(b" \"\\()[]{},.+-0123456789exXabn\n\t".to_vec())
            .prop_map(|byte| vec![byte]),
        1 => any::<u8>().prop_map(|byte| vec![byte]),
        1 => proptest::sample::select(vec!["true", "null", "inf", "0x1f", "1.5e3"])
            .prop_map(|word| word.as_bytes().to_vec()),
    ];
    vec(piece, 0..60).prop_map(|pieces| pieces.concat())
}

/// Bytes that look like bottles: words that stand for codes and small counts among others.
fn damaged() -> impl Strategy<Value = Bytes> {
    let word = prop_oneof![
        3 => proptest::sample::select(vec![
            256, 257, 260, 265, 266, 268, 276, 288, 320, 384, 768, 1, 4, 9, 10, 12, 17, 18, 20, 32,
        ]),
        3 => 0..6_i32,
        1 => any::<i32>(),
    ];
    (vec(word, 0..40), vec(any::<u8>(), 0..4)).prop_map(|(words, rest)| {
        let mut bytes: Vec<u8> = words.into_iter().flat_map(i32::to_le_bytes).collect();
        bytes.extend(rest);
        bytes.into()
    })
}

proptest! {
    #[test]
    fn bottles_return((dialect, bottle) in bottles(), behind in vec(any::<u8>(), 0..9)) {
        let mut bytes = bottle.encode(dialect).unwrap();
        let length = bytes.len();
        bytes.extend(behind);
        let bytes = Bytes::from(bytes);
        let limits = WireLimits::default();
        let read = Bottle::decode(&bytes, dialect, &limits);
        prop_assert_eq!(read, Ok((bottle, length)));
        prop_assert_eq!(Bottle::frame(&bytes, dialect, &limits), Ok(Frame::Complete(length)));
    }

    /// However the bytes are cut, the scan asks for no more than the bottle has.
    #[test]
    fn bottles_in_pieces((dialect, bottle) in bottles(), step in 1..9_usize) {
        let bytes = bottle.encode(dialect).unwrap();
        let mut scan = BottleScan::new(dialect, &WireLimits::default());
        let mut there = 0;
        loop {
            match scan.advance(&bytes[..there]).unwrap() {
                Frame::Complete(length) => {
                    prop_assert_eq!(length, bytes.len());
                    break;
                }
                Frame::NeedMore(more) => {
                    prop_assert!(more > 0 && there + more <= bytes.len());
                    there += step.min(more);
                }
            }
        }
    }

    /// The scan and the reader agree on what a bottle is.
    #[test]
    fn damaged_bottles(bytes in damaged(), dialect in dialects()) {
        let limits = WireLimits { max_depth: 5, max_elements: 30, ..WireLimits::default() };
        let read = Bottle::decode(&bytes, dialect, &limits);
        match Bottle::frame(&bytes, dialect, &limits) {
            Ok(Frame::Complete(length)) => {
                let (bottle, used) = read.unwrap();
                prop_assert_eq!(used, length);
                // NaN differs from itself: compared as bytes.
                let written = Bytes::from(bottle.encode(dialect).unwrap());
                let (again, _) = Bottle::decode(&written, dialect, &limits).unwrap();
                prop_assert_eq!(again.encode(dialect).unwrap(), written);
            }
            Ok(Frame::NeedMore(_)) | Err(_) => prop_assert!(read.is_err()),
        }
    }

    #[test]
    fn any_text_is_read(text in texts(), dialect in dialects()) {
        let limits = WireLimits::default();
        let read = Bottle::from_text_as(&text, dialect, &limits);
        // Vocabs are cut to their letters, brackets and all, and lose those beyond ASCII: as in
        // YARP, their text need not read as the same. The string null reads as a vocab.
        let odd = |text: &[u8]| text.contains(&b'[') || text.windows(4).any(|word| word == b"null");
        if let Some(bottle) = read.ok().filter(|bottle| !odd(&bottle.to_text_bytes())) {
            let written = bottle.to_text_bytes();
            let again = Bottle::from_text_as(&written, dialect, &limits).unwrap();
            prop_assert_eq!(again.to_text_bytes(), written);
        }
    }

    #[test]
    fn numbers_return_through_text(integer: i64, float: f64) {
        let bottle = Bottle::from(vec![Value::Int64(integer), Value::Float64(float)]);
        let read = Bottle::from_text(bottle.to_text().as_bytes(), &WireLimits::default()).unwrap();
        prop_assert_eq!(read.values[0].as_i64(), Some(integer));
        let returned = read.values[1].as_f64().unwrap();
        prop_assert!(returned == float || (returned.is_nan() && float.is_nan()), "{}", returned);
    }

    #[test]
    fn strings_return_through_text(text: String) {
        prop_assume!(!["null", "inf", "nan"].contains(&text.as_str()), "as in YARP");
        let bottle = Bottle::from(vec![Value::string(text.as_str())]);
        let read = Bottle::from_text(bottle.to_text().as_bytes(), &WireLimits::default()).unwrap();
        prop_assert_eq!(read, bottle);
    }

    #[test]
    fn images_return(
        pixel in proptest::sample::select(PixelCode::ALL),
        (width, height) in (0..20_usize, 0..9_usize),
        quantum in 0..18_u16,
        fill: u8,
    ) {
        let limits = WireLimits::default();
        let header = ImageHeader::new(pixel, width, height, quantum).unwrap();
        let data = Bytes::from(vec![fill; header.image_bytes()]);
        let image = Image::from_parts(header, data).unwrap();
        let bytes = Bytes::from(image.encode(Rows::Announced).unwrap());
        let read = Image::decode(&bytes, Rows::Announced, &limits).unwrap();
        if header.is_empty() {
            prop_assert_eq!(read.rows().count(), 0);
        } else {
            prop_assert_eq!(&read, &image);
            prop_assert_eq!(read.rows().count(), height);
        }
        let dense = Bytes::from(image.encode(Rows::Packed).unwrap());
        let dense = Image::decode(&dense, Rows::Packed, &limits).unwrap();
        prop_assert_eq!(packed(&dense), packed(&image));
    }

    /// One word of a real header replaced: an image or an error, and never rows beyond the bytes.
    #[test]
    fn damaged_images(at in 0..15_usize, word in prop_oneof![-3..40_i32, any::<i32>()]) {
        let image = Image::from_packed(PixelCode::Rgb, 3, 2, Bytes::from_static(&[7; 18])).unwrap();
        let mut bytes = image.encode(Rows::Announced).unwrap();
        bytes[4 * at..4 * at + 4].copy_from_slice(&word.to_le_bytes());
        if let Ok(image) = Image::decode(&bytes.into(), Rows::Announced, &WireLimits::default()) {
            prop_assert_eq!(image.data().len(), image.header().image_bytes());
            prop_assert!(image.rows().map(<[u8]>::len).sum::<usize>() <= 18);
        }
    }

    #[test]
    fn sounds_return(
        moments in vec(any::<[i16; 3]>(), 0..20),
        channels in 1..4_usize,
        dialect in dialects(),
        frequency: i32,
    ) {
        let samples: Vec<i16> = moments.iter().flat_map(|moment| &moment[..channels]).copied().collect();
        let sound = Sound::from_interleaved(&samples, channels, frequency).unwrap();
        prop_assert_eq!(sound.to_interleaved(), samples);
        let bytes = Bytes::from(sound.encode(dialect).unwrap());
        let read = Sound::decode(&bytes, dialect, &WireLimits::default()).unwrap();
        prop_assert_eq!(read.data(), sound.data());
        prop_assert_eq!(read.encode(dialect).unwrap(), bytes.clone());
        let error = Sound::decode(&bytes, dialect.other(), &WireLimits::default()).unwrap_err();
        prop_assert!(error.to_string().contains(&format!("dialect {dialect}")), "{}", error);
        let (bottle, _) = Bottle::decode(&bytes, dialect, &WireLimits::default()).unwrap();
        prop_assert_eq!(Sound::from_bottle(&bottle).unwrap(), sound);
    }

    #[test]
    fn vectors_return(numbers in vec(-1e9..1e9_f64, 0..50), dialect in dialects()) {
        let limits = WireLimits::default();
        let vector = Vector(numbers.clone());
        let bytes = vector.encode(dialect).unwrap();
        prop_assert_eq!(&Vector::decode(&bytes, dialect, &limits).unwrap(), &vector);
        let rows = numbers.len();
        let matrix = Matrix::new(rows, 1, numbers).unwrap();
        let bytes = matrix.encode(dialect).unwrap();
        prop_assert_eq!(Matrix::decode(&bytes, dialect, &limits).unwrap(), matrix);
    }

    #[test]
    fn stamps_return(count: i32, time_us in 0..4_000_000_000_000_000_i64) {
        let stamp = Stamp { count, time_s: time_us as f64 / 1e6 };
        let read = Stamp::from_envelope(stamp.to_envelope().as_bytes()).unwrap();
        prop_assert_eq!(read.count, count);
        prop_assert!((read.time_s - stamp.time_s).abs() < 1e-4, "{}", read.time_s);
    }

    /// No bytes make any reader panic, or read beyond them.
    #[test]
    fn arbitrary_bytes(bytes in vec(any::<u8>(), 0..200), dialect in dialects()) {
        let (bytes, limits) = (Bytes::from(bytes), WireLimits::default());
        if let Ok((_, used)) = Bottle::decode(&bytes, dialect, &limits) {
            prop_assert!(used <= bytes.len());
        }
        let sound = Sound::decode(&bytes, dialect, &limits);
        prop_assert!(sound.is_err() || bytes.len() >= 48);
        let vector = Vector::<i32>::decode(&bytes, dialect, &limits);
        prop_assert!(vector.is_err() || bytes.len() >= 8);
        prop_assert!(Matrix::decode(&bytes, dialect, &limits).is_err() || bytes.len() >= 32);
        prop_assert!(Image::decode(&bytes, Rows::Announced, &limits).is_err() || bytes.len() >= 60);
        prop_assert!(Stamp::from_envelope(&bytes).is_none() || bytes.len() >= 3);
    }
}
