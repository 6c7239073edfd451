//! Every bottle of the corpora recorded from YARP 3.12.3 and 4.0.0, byte for byte both ways.

mod golden;

use bytes::Bytes;
use golden::{bytes, cases, text};
use wrapyfi_yarp::bottle::{Frame, Vocab64};
use wrapyfi_yarp::{Bottle, Dialect, Limits, Value};

fn limits() -> Limits {
    Limits::default()
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
    for (file, dialect) in [
        ("corpus_bottle.json", Dialect::V3),
        ("v4_corpus_bottle.json", Dialect::V4),
    ] {
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
