//! Every bottle of the corpora recorded from YARP 3.12.3 and 4.0.0, byte for byte both ways.

use crate::golden::{bytes, cases, payloads, text};
use bytes::Bytes;
use wrapyfi_yarp::bottle::{BottleError, Frame, Vocab64};
use wrapyfi_yarp::{Bottle, Dialect, Value, WireLimits};

fn limits() -> WireLimits {
    WireLimits::default()
}

fn check(file: &str, dialect: Dialect) {
    for case in cases(file) {
        let name = text(&case, "name");
        let binary = bytes(&case, "binary");
        let (bottle, used) = Bottle::decode(&binary, dialect, &limits())
            .unwrap_or_else(|error| panic!("{file}: {name}: {error}"));
        assert_eq!(used, binary.len(), "{file}: {name}");
        assert_eq!(bottle.len(), case["size"].as_u64().unwrap() as usize, "{file}: {name}");
        assert_eq!(bottle.encode(dialect).unwrap(), binary, "{file}: {name}: written");
        assert_eq!(bottle.to_text(), text(&case, "text"), "{file}: {name}: as text");
        assert_eq!(
            Bottle::frame(&binary, dialect, &limits()),
            Ok(Frame::Complete(binary.len())),
            "{file}: {name}: framed"
        );
    }
}

#[test]
fn corpus_bottle() {
    check("corpus_bottle.json", Dialect::V3);
}

#[test]
fn v4_corpus_bottle() {
    check("v4_corpus_bottle.json", Dialect::V4);
}

#[test]
fn corpus_bottle_text() {
    let file = "corpus_bottle_text.json";
    for case in cases(file) {
        let input = text(&case, "in");
        let bottle = Bottle::from_text(input.as_bytes(), &limits()).unwrap();
        assert_eq!(bottle.to_text(), text(&case, "out"), "{file}: {input:?}");
        let binary = bottle.encode(Dialect::V3).unwrap();
        assert_eq!(binary, bytes(&case, "binary"), "{file}: {input:?}: {bottle:?}");
    }
}

/// The text of a bottle reads as that bottle, but for the widths of numbers, which text has not.
#[test]
fn text_of_corpus_bottle() {
    for (file, dialect) in
        [("corpus_bottle.json", Dialect::V3), ("v4_corpus_bottle.json", Dialect::V4)]
    {
        for case in cases(file) {
            let written = text(&case, "text");
            let read = Bottle::from_text_as(written.as_bytes(), dialect, &limits()).unwrap();
            assert_eq!(read.to_text(), written, "{file}");
        }
    }
    let read = Bottle::from_text_as(b"[abcdefgh]", Dialect::V4, &limits()).unwrap();
    assert_eq!(read.values, [Value::Vocab64(Vocab64::new("abcdefgh"))]);
}

/// A list of one kind may also come with a code before each element.
#[test]
fn unspecialised_lists_are_read() {
    let long: Bytes = [256, 2, 1, 7, 1, 8].into_iter().flat_map(i32::to_le_bytes).collect();
    let (bottle, _) = Bottle::decode(&long, Dialect::V3, &limits()).unwrap();
    assert_eq!(bottle.values, [Value::Int32(7), Value::Int32(8)]);
}

/// Native objects and JPEG pictures of Wrapyfi are one string.
#[test]
fn wrapyfi_strings() {
    for file in ["wrapyfi_native.json", "wrapyfi_image_jpg.json"] {
        for payload in payloads(file, "c2s") {
            let bottle = Bottle::decode_whole(&payload, Dialect::V3, &limits()).unwrap();
            let [Value::String(text)] = bottle.values.as_slice() else { panic!("{bottle:?}") };
            assert!(text.as_str().is_some(), "{file}");
            for dialect in [Dialect::V3, Dialect::V4] {
                assert_eq!(bottle.encode(dialect).unwrap(), payload, "{file}: {dialect}");
            }
        }
    }
}

#[test]
fn bottles_of_connections() {
    for file in ["tcp_all_bottles.json", "fast_tcp_all_bottles.json"] {
        for payload in payloads(file, "c2s") {
            let bottle = Bottle::decode_whole(&payload, Dialect::V3, &limits()).unwrap();
            assert_eq!(bottle.encode(Dialect::V3).unwrap(), payload, "{file}");
        }
    }
    for payload in payloads("v4_tcp_basic.json", "c2s") {
        let bottle = Bottle::decode_whole(&payload, Dialect::V4, &limits()).unwrap();
        assert_eq!(bottle.encode(Dialect::V4).unwrap(), payload);
    }
}

#[test]
fn bad_bottle_code() {
    let payloads = payloads("bad_bottle_code.json", "c2s");
    let error = Bottle::decode_whole(&payloads[0], Dialect::V3, &limits()).unwrap_err();
    assert!(error.to_string().starts_with("type code 99 at byte 8 is none"), "{error}");
    let framed = Bottle::frame(&payloads[0], Dialect::V3, &limits());
    assert_eq!(framed, Err(error));
    // The next message on that connection is sound.
    assert_eq!(Bottle::decode_whole(&payloads[1], Dialect::V3, &limits()).unwrap().to_text(), "42");
}

/// A YARP 4 writer makes a YARP 3 reader wait for ever. Here it is an error that says what to do.
#[test]
fn v4_writer_v3_reader() {
    let payloads = payloads("v4_writer_v3_reader.json", "c2s");
    let double = &payloads[2];
    let error = Bottle::decode_whole(double, Dialect::V3, &limits()).unwrap_err();
    let BottleError::OtherDialect { dialect: Dialect::V3, .. } = error else { panic!("{error:?}") };
    let text = error.to_string();
    assert!(text.contains("code 276") && text.contains("set its dialect to v4"), "{text}");
    assert!(text.contains("float64"), "{text}");
    assert_eq!(Bottle::frame(double, Dialect::V3, &limits()), Err(error));
    let (bottle, dialect) = Bottle::decode_either(double, Dialect::V3, &limits()).unwrap();
    assert_eq!((bottle.to_text().as_str(), dialect), ("3.25", Dialect::V4));
}

/// The other way round the code is the same as that of a shorter number: only the length tells.
#[test]
fn v3_writer_v4_reader() {
    let payloads = payloads("v3_writer_v4_reader.json", "c2s");
    let double = &payloads[2];
    let error = Bottle::decode_whole(double, Dialect::V4, &limits()).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("after 12 of 16 bytes") && text.ends_with("other than v4"), "{text}");
    let (bottle, dialect) = Bottle::decode_either(double, Dialect::V4, &limits()).unwrap();
    assert_eq!((bottle.to_text().as_str(), dialect), ("3.25", Dialect::V3));
}
