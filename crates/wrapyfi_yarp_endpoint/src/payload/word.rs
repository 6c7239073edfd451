//! Strings and vocabs as text, each way without loss.
//!
//! ```text
//!   vocab ok            ◀──▶  "[ok]"            letters in square brackets
//!   vocab of odd bytes  ◀──▶  "[#0001f2a3]"     its number
//!   string "[ok]"       ◀──▶  "[[ok]"           one bracket more, so that it stays a string
//!   string "caf\xe9"    ◀──▶  caf\udce9         bytes that are not UTF-8 as Python escapes them
//! ```
//!
//! The vocabs of booleans and of `null` are no text: they have values of their own.

use wrapyfi_yarp::Dialect;
use wrapyfi_yarp::Value as Element;
use wrapyfi_yarp::bottle::{Text, Vocab, Vocab64};

use wrapyfi_data::types::Value;

/// Most letters of a vocab of 32 bits.
const SHORT: usize = 4;
/// Code point that Python puts for byte 0 of text that is not UTF-8.
const ESCAPE: u16 = 0xDC00;

/// The vocab that stands for nothing.
pub(super) fn null() -> Vocab {
    Vocab::new("null")
}

/// A vocab that is neither a boolean nor null, as text.
pub(super) fn of_vocab(vocab: Vocab) -> String {
    match letters(vocab.letters()) {
        Some(word) if Vocab::new(&word) == vocab => format!("[{word}]"),
        _ => format!("[#{:08x}]", vocab.0),
    }
}

/// A vocab of 64 bits as text.
pub(super) fn of_vocab64(vocab: Vocab64) -> String {
    match letters(vocab.letters()) {
        Some(word) if word.len() > SHORT && Vocab64::new(&word) == vocab => format!("[{word}]"),
        _ => format!("[#{:016x}]", vocab.0),
    }
}

/// Letters that can stand between brackets.
fn letters(letters: Vec<u8>) -> Option<String> {
    let plain = |letter: &u8| letter.is_ascii_graphic() && !matches!(letter, b'[' | b']');
    let word = letters.iter().all(plain).then_some(letters)?;
    String::from_utf8(word).ok().filter(|word| !word.is_empty())
}

/// The vocab that `text` stands for, where it is exactly what [`of_vocab`] or [`of_vocab64`] writes.
fn vocab(text: &str, dialect: Dialect) -> Option<Element> {
    let word = text.strip_prefix('[')?.strip_suffix(']')?;
    let number = word.strip_prefix('#').and_then(|digits| match digits.len() {
        8 => u32::from_str_radix(digits, 16).ok().map(|n| Element::Vocab32(Vocab(n.cast_signed()))),
        16 => {
            let number = u64::from_str_radix(digits, 16).ok()?;
            Some(Element::Vocab64(Vocab64(number.cast_signed())))
        }
        _ => None,
    });
    let found = number.or_else(|| match word.len() {
        1..=SHORT => Some(Element::Vocab32(Vocab::new(word))),
        5..=8 => Some(Element::Vocab64(Vocab64::new(word))),
        _ => None,
    })?;
    let same = match found {
        Element::Vocab32(Vocab::TRUE | Vocab::FALSE) => false,
        Element::Vocab32(vocab) => vocab != null() && of_vocab(vocab) == text,
        Element::Vocab64(vocab) => dialect == Dialect::V4 && of_vocab64(vocab) == text,
        _ => false,
    };
    same.then_some(found)
}

/// `text` without the brackets that keep a string apart from a vocab, where it ends as a vocab.
fn escaped(text: &str, dialect: Dialect) -> bool {
    let inner = text.trim_start_matches('[');
    let before = text.len() - inner.len();
    let vocab_start = before.checked_sub(1).and_then(|start| text.get(start..));
    vocab_start.is_some_and(|text| vocab(text, dialect).is_some())
}

/// A string of YARP as a value.
pub(super) fn of_string(text: &Text, dialect: Dialect) -> Value {
    match text.as_str() {
        Some(text) if escaped(text, dialect) => format!("[{text}").into(),
        Some(text) => text.into(),
        None => Value::Utf16(escape(text.as_bytes())),
    }
}

/// A text as a string or a vocab of YARP.
pub(super) fn to_element(text: &str, dialect: Dialect) -> Element {
    if let Some(vocab) = vocab(text, dialect) {
        return vocab;
    }
    match text.strip_prefix('[') {
        Some(rest) if escaped(text, dialect) => Element::string(rest),
        _ => Element::string(text),
    }
}

fn escape(bytes: &[u8]) -> Vec<u16> {
    let mut units = Vec::with_capacity(bytes.len());
    for chunk in bytes.utf8_chunks() {
        units.extend(chunk.valid().encode_utf16());
        units.extend(chunk.invalid().iter().map(|&byte| ESCAPE + u16::from(byte)));
    }
    units
}

/// The bytes behind text with Python's escapes; none where it holds other lone surrogates.
pub(super) fn unescape(units: &[u16]) -> Option<Vec<u8>> {
    let mut bytes = Vec::with_capacity(units.len());
    for unit in char::decode_utf16(units.iter().copied()) {
        match unit {
            Ok(letter) => bytes.extend_from_slice(letter.encode_utf8(&mut [0; 4]).as_bytes()),
            Err(lone) => {
                let byte = lone.unpaired_surrogate().checked_sub(ESCAPE)?;
                bytes.push(u8::try_from(byte).ok().filter(|byte| *byte >= 0x80)?);
            }
        }
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn back(value: &Value, dialect: Dialect) -> Element {
        match value {
            Value::Str(text) => to_element(text, dialect),
            Value::Utf16(units) => Element::string(unescape(units).unwrap()),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn words_and_strings_stay_apart() {
        for (element, text) in [
            (Element::vocab("ok"), "[ok]"),
            (Element::vocab("fail"), "[fail]"),
            (Element::vocab("#a"), "[#a]"),
            (Element::Vocab32(Vocab(0x0001_f2a3)), "[#0001f2a3]"),
            (Element::Vocab32(Vocab(0x0062_0061)), "[#00620061]"),
            (Element::string("ok"), "ok"),
            (Element::string("[ok]"), "[[ok]"),
            (Element::string("[[ok]"), "[[[ok]"),
            (Element::string("[]"), "[]"),
            (Element::string("[1]"), "[1]"),
            (Element::string("[null]"), "[null]"),
            (Element::string("[not a word]"), "[not a word]"),
            (Element::string("[success]"), "[success]"),
            (Element::string("[#00000031]"), "[#00000031]"),
            (Element::string(""), ""),
        ] {
            let value = match &element {
                Element::Vocab32(vocab) => of_vocab(*vocab).into(),
                Element::String(string) => of_string(string, Dialect::V3),
                other => panic!("{other:?}"),
            };
            assert_eq!(value, Value::from(text));
            assert_eq!(to_element(text, Dialect::V3), element, "{text}");
        }
        let long = Vocab64::new("success");
        assert_eq!(of_vocab64(long), "[success]");
        assert_eq!(to_element("[success]", Dialect::V4), Element::Vocab64(long));
        let short = Vocab64::new("ok");
        assert_eq!(to_element(&of_vocab64(short), Dialect::V4), Element::Vocab64(short));
    }

    #[test]
    fn latin_letters_survive() {
        let cafe = Text::from(b"caf\xe9 \xc3\xa9".to_vec());
        let value = of_string(&cafe, Dialect::V3);
        let Value::Utf16(units) = &value else { panic!("{value:?}") };
        assert_eq!(String::from_utf16_lossy(units), "caf\u{fffd} é");
        assert_eq!(back(&value, Dialect::V3), Element::String(cafe));
        assert_eq!(unescape(&[0xD800]), None);
        assert_eq!(unescape(&[0xDC41]), None);
    }

    proptest! {
        #[test]
        fn every_string_comes_back(
            bytes in proptest::collection::vec(
                prop_oneof![Just(b'['), Just(b']'), Just(b'#'), Just(b'0'), any::<u8>()], 0..12),
            v4: bool,
        ) {
            let dialect = if v4 { Dialect::V4 } else { Dialect::V3 };
            let text = Text::from(bytes);
            prop_assert_eq!(back(&of_string(&text, dialect), dialect), Element::String(text));
        }

        #[test]
        fn every_vocab_comes_back(number: i64) {
            let short = Vocab(i32::from_le_bytes(*number.to_le_bytes().first_chunk().unwrap()));
            let text = of_vocab(short);
            prop_assert_eq!(to_element(&text, Dialect::V3), Element::Vocab32(short));
            let text = of_vocab64(Vocab64(number));
            prop_assert_eq!(to_element(&text, Dialect::V4), Element::Vocab64(Vocab64(number)));
        }
    }
}
