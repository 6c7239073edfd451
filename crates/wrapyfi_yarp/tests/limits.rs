//! Refusals by the limits, and their messages.

use bytes::Bytes;
use wrapyfi_yarp::bottle::{BottleError, EncodeError, Frame, Vocab64};
use wrapyfi_yarp::sig::{Image, PixelCode, Rows, SigError, Sound, Vector};
use wrapyfi_yarp::{Bottle, Dialect, Value, WireLimits};

fn words(words: &[i32]) -> Bytes {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

fn refused(bytes: &Bytes, limits: &WireLimits) -> BottleError {
    Bottle::decode(bytes, Dialect::V3, limits).unwrap_err()
}

#[test]
fn counts_beyond_the_bytes_are_refused_before_memory_is_taken() {
    for code in [256, 257, 260, 266, 268] {
        let error = refused(&words(&[code, i32::MAX, 0, 0]), &WireLimits::default());
        let text = error.to_string();
        assert!(text.starts_with("a list of 2147483647 elements at byte 4"), "{text}");
        assert!(text.contains("8 are left"), "{text}");
    }
    let error = refused(&words(&[260, 1, i32::MAX]), &WireLimits::default());
    assert!(error.to_string().starts_with("a string at byte 12 needs 2147483647"), "{error}");
}

#[test]
fn negative_lengths_are_refused() {
    for bytes in [words(&[257, -1]), words(&[260, 1, -1]), words(&[256, 1, 12, i32::MIN])] {
        let error = refused(&bytes, &WireLimits::default());
        assert!(error.to_string().contains("lengths cannot be negative"), "{error}");
        let framed = Bottle::frame(&bytes, Dialect::V3, &WireLimits::default()).unwrap_err();
        assert!(framed.to_string().contains("lengths cannot be negative"), "{framed}");
    }
}

#[test]
fn nesting_ends_at_the_limit() {
    let nested = |depth: usize| {
        let mut list = [256, 1].repeat(depth - 1);
        list.extend([256, 0]);
        words(&list)
    };
    let limits = WireLimits { max_depth: 3, ..WireLimits::default() };
    assert!(Bottle::decode(&nested(3), Dialect::V3, &limits).is_ok());
    assert_eq!(refused(&nested(4), &limits), BottleError::TooDeep { limit: 3 });
    let framed = Bottle::frame(&nested(4), Dialect::V3, &limits);
    assert_eq!(framed, Err(BottleError::TooDeep { limit: 3 }));
    // Whatever the limit says, the stack holds.
    let endless = WireLimits { max_depth: usize::MAX, ..WireLimits::default() };
    assert!(matches!(refused(&nested(100_000), &endless), BottleError::TooDeep { .. }));
    let text = "(".repeat(100_000) + &")".repeat(100_000);
    let error = Bottle::from_text(text.as_bytes(), &endless).unwrap_err();
    assert_eq!(error, BottleError::TooDeep { limit: WireLimits::DEPTH_CEILING });
}

#[test]
fn elements_end_at_the_limit() {
    let limits = WireLimits { max_elements: 10, ..WireLimits::default() };
    let bottle: Bottle = (0..11).map(Value::Int32).collect();
    let bytes = Bytes::from(bottle.encode(Dialect::V3).unwrap());
    assert_eq!(refused(&bytes, &limits), BottleError::TooManyElements(10));
    let framed = Bottle::frame(&bytes, Dialect::V3, &limits);
    assert_eq!(framed, Err(BottleError::TooManyElements(10)));
    let error = Bottle::from_text(bottle.to_text().as_bytes(), &limits).unwrap_err();
    assert_eq!(error, BottleError::TooManyElements(10));
    // A blob counts as one, in text too.
    let blob = Bottle::from(vec![Value::blob(vec![1; 100])]);
    assert_eq!(Bottle::from_text(blob.to_text().as_bytes(), &limits), Ok(blob));
}

#[test]
fn messages_end_at_the_limit() {
    let limits = WireLimits { max_message_bytes: 50, ..WireLimits::default() };
    // Known long before the bytes arrive.
    let framed = Bottle::frame(&words(&[266, 1_000_000]), Dialect::V3, &limits).unwrap_err();
    assert_eq!(framed, BottleError::TooLong { length: 8_000_008, limit: 50 });
    let image = Image::from_packed(PixelCode::Mono, 8, 8, Bytes::from_static(&[0; 64])).unwrap();
    let error =
        Image::decode(&image.encode(Rows::Announced).unwrap().into(), Rows::Announced, &limits)
            .unwrap_err();
    assert_eq!(error, SigError::TooLong { what: "an image", length: 124, limit: 50 });
    let sound = Sound::from_interleaved(&[0; 8], 1, 8000).unwrap().encode(Dialect::V3).unwrap();
    let error = Sound::decode(&sound.into(), Dialect::V3, &limits).unwrap_err();
    assert_eq!(error, SigError::TooLong { what: "a sound", length: 64, limit: 50 });
    let vector = Vector(vec![0.0; 10]).encode(Dialect::V3).unwrap();
    let error = Vector::<f64>::decode(&vector, Dialect::V3, &limits).unwrap_err();
    assert_eq!(error, SigError::TooLong { what: "a vector", length: 88, limit: 50 });
    let error = Bottle::from_text(&[b'a'; 51], &limits).unwrap_err();
    assert_eq!(error, BottleError::TooLong { length: 51, limit: 50 });
}

#[test]
fn an_acknowledgement_is_no_bottle() {
    // The bytes that come in place of a reply when the peer does not reply.
    let ack = Bytes::from_static(b"YA\0\0\0\0RP");
    assert!(Bottle::frame(&ack, Dialect::V3, &WireLimits::default()).is_err());
    assert!(Bottle::frame(&ack[..4], Dialect::V3, &WireLimits::default()).is_err());
    let short = Bottle::frame(&ack[..3], Dialect::V3, &WireLimits::default());
    assert_eq!(short, Ok(Frame::NeedMore(5)));
}

#[test]
fn what_a_dialect_lacks_is_not_written() {
    let mut bottle = Bottle::from(vec![Value::Int32(1), Value::Vocab64(Vocab64::new("abcdefgh"))]);
    let error = bottle.encode(Dialect::V3).unwrap_err();
    assert_eq!(error, EncodeError::NoVocab64("[abcdefgh]".to_owned()));
    assert!(bottle.encode(Dialect::V4).is_ok());
    bottle.values.remove(0);
    assert!(bottle.encode(Dialect::V3).is_err());
    let error = Vector(vec![1.0_f32]).encode(Dialect::V3).unwrap_err();
    assert!(matches!(&error, SigError::Unsupported(why) if why.contains("float32")), "{error}");
}

#[test]
fn sounds_that_contradict_themselves_are_refused() {
    let sound =
        Sound::from_interleaved(&[1, 2, 3, 4], 2, 8000).unwrap().encode(Dialect::V3).unwrap();
    let with = |at: usize, word: i32| {
        let mut sound = sound.clone();
        sound[at..at + 4].copy_from_slice(&word.to_le_bytes());
        Sound::decode(&sound.into(), Dialect::V3, &WireLimits::default()).unwrap_err()
    };
    let damaged = |what: &str| SigError::Damaged(what.to_owned());
    assert_eq!(with(44, 3), damaged("3 samples for 2 channels of 2"));
    let error = with(28, 4).to_string();
    assert_eq!(error, "a sound of 4 bytes a sample: YARP transmits 2 only");
    assert_eq!(with(12, -2), damaged("a sound whose length in samples is -2"));
    assert!(with(4, 2).to_string().contains("3.8"));
    assert!(matches!(with(4, 9), SigError::Other { wanted: 5, .. }));
}

#[test]
fn images_that_contradict_themselves_are_refused() {
    let image = Image::from_packed(PixelCode::Rgb, 4, 2, Bytes::from_static(&[0; 24])).unwrap();
    let image = image.encode(Rows::Announced).unwrap();
    let with = |words: &[(usize, i32)]| {
        let mut image = image.clone();
        for &(at, word) in words {
            image[at..at + 4].copy_from_slice(&word.to_le_bytes());
        }
        Image::decode(&image.into(), Rows::Announced, &WireLimits::default()).unwrap_err()
    };
    for (words, damage) in [
        ((44, 5), "5 x 2 pixels of 3 bytes do not fit 24 bytes of rows"),
        ((48, 5), "4 x 5 pixels of 3 bytes do not fit 24 bytes of rows"),
        ((32, 4), "pixels [rgb] of 4 bytes, YARP's have 3"),
        ((56, 23), "an image of 24 bytes in a blob of 23"),
        ((44, -4), "an image whose width is -4"),
    ] {
        assert_eq!(with(&[words]), SigError::Damaged(damage.to_owned()));
    }
    assert!(matches!(with(&[(12, 7)]), SigError::Other { at: 12, found: 7, .. }));
    assert!(matches!(
        with(&[(36, 48), (56, 48)]),
        SigError::Truncated { what: "an image", needed: 108, given: 84 }
    ));
}
