//! JSON strings: their end, their content, and their writing as by Python.

use memchr::{memchr, memchr2};

/// The member that makes an object a tagged value.
pub(crate) const TAG: &str = "__wrapyfi__";

/// A string as it stands between its quotes, valid as far as finding its end told.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RawString<'a> {
    pub(crate) inner: &'a [u8],
    pub(crate) escaped: bool,
}

/// Content of a string.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Text {
    Valid(String),
    /// Text with lone surrogates, as UTF-16 code units.
    Utf16(Vec<u16>),
}

/// Finds the end of the string whose opening quote stands before `rest`; `None` when it does not
/// end.
pub(crate) fn find_end(rest: &[u8]) -> Option<RawString<'_>> {
    let mut at = 0;
    let mut escaped = false;
    loop {
        at += memchr2(b'"', b'\\', rest.get(at..)?)?;
        if rest.get(at) == Some(&b'"') {
            return Some(RawString { inner: rest.get(..at)?, escaped });
        }
        escaped = true;
        at += 2;
    }
}

impl<'a> RawString<'a> {
    /// Decodes the escapes of the string.
    pub(crate) fn decode(self) -> Result<Text, String> {
        if !self.escaped {
            return plain(self.inner).map(|text| Text::Valid(text.to_owned()));
        }
        let mut text = String::with_capacity(self.inner.len());
        let mut high = None;
        for piece in self.pieces() {
            match (piece?, high.take()) {
                (Piece::Plain(part), None) => text.push_str(part),
                (Piece::Unit(unit @ 0xD800..=0xDBFF), None) => high = Some(unit),
                (Piece::Unit(unit), None) => match char::from_u32(unit.into()) {
                    Some(c) => text.push(c),
                    None => return self.decode_utf16(),
                },
                (Piece::Unit(low), Some(high)) => match char::decode_utf16([high, low]).next() {
                    Some(Ok(c)) => text.push(c),
                    _ => return self.decode_utf16(),
                },
                (Piece::Plain(_), Some(_)) => return self.decode_utf16(),
            }
        }
        if high.is_some() { self.decode_utf16() } else { Ok(Text::Valid(text)) }
    }

    /// Bytes of the string, where nothing is escaped; they are not checked to be UTF-8.
    pub(crate) fn plain(self) -> Option<&'a [u8]> {
        (!self.escaped).then_some(self.inner)
    }

    /// Decodes the file whose bytes the characters U+0000 to U+00FF stand for.
    pub(crate) fn decode_latin1(self) -> Result<Vec<u8>, String> {
        let beyond = |unit: u32| format!("a character U+{unit:04X} stands for no byte");
        let mut file = Vec::with_capacity(self.inner.len());
        for piece in self.pieces() {
            match piece? {
                Piece::Plain(part) if part.is_ascii() => file.extend_from_slice(part.as_bytes()),
                Piece::Plain(part) => {
                    for c in part.chars() {
                        file.push(u8::try_from(c).map_err(|_wide| beyond(c.into()))?);
                    }
                }
                Piece::Unit(unit) => {
                    file.push(u8::try_from(unit).map_err(|_wide| beyond(unit.into()))?);
                }
            }
        }
        // Escapes are six characters for one byte.
        file.shrink_to_fit();
        Ok(file)
    }

    fn decode_utf16(self) -> Result<Text, String> {
        let mut units = Vec::with_capacity(self.inner.len());
        for piece in self.pieces() {
            match piece? {
                Piece::Plain(part) => units.extend(part.encode_utf16()),
                Piece::Unit(unit) => units.push(unit),
            }
        }
        Ok(Text::Utf16(units))
    }

    /// Checks the string as [`RawString::decode`] does, without keeping its content.
    pub(crate) fn check(self) -> Result<(), String> {
        self.pieces().try_for_each(|piece| piece.map(drop))
    }

    fn pieces(self) -> Pieces<'a> {
        Pieces(self.inner)
    }
}

/// Part of a string.
enum Piece<'a> {
    /// Text that stands for itself.
    Plain(&'a str),
    /// A code unit that was escaped.
    Unit(u16),
}

struct Pieces<'a>(&'a [u8]);

impl<'a> Iterator for Pieces<'a> {
    type Item = Result<Piece<'a>, String>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.0.first() != Some(&b'\\') {
            let length = memchr(b'\\', self.0).unwrap_or(self.0.len());
            let (part, rest) = self.0.split_at_checked(length)?;
            self.0 = rest;
            return (length > 0).then(|| plain(part).map(Piece::Plain));
        }
        let (unit, length) = match *self.0 {
            [_, c @ (b'"' | b'\\' | b'/'), ..] => (c.into(), 2),
            [_, b'b', ..] => (0x08, 2),
            [_, b'f', ..] => (0x0C, 2),
            [_, b'n', ..] => (0x0A, 2),
            [_, b'r', ..] => (0x0D, 2),
            [_, b't', ..] => (0x09, 2),
            [_, b'u', a, b, c, d, ..] => match hex([a, b, c, d]) {
                Some(unit) => (unit, 6),
                None => return self.fail("\\u without four hexadecimal digits"),
            },
            _ => return self.fail("an escape that JSON does not have"),
        };
        self.0 = self.0.get(length..).unwrap_or_default();
        Some(Ok(Piece::Unit(unit)))
    }
}

impl Pieces<'_> {
    // The shape of `next`.
    fn fail<T>(&mut self, reason: &str) -> Option<Result<T, String>> {
        self.0 = &[];
        Some(Err(format!("a string has {reason}")))
    }
}

fn hex(digits: [u8; 4]) -> Option<u16> {
    digits.iter().try_fold(0, |unit, &digit| {
        let digit = char::from(digit).to_digit(16)?;
        Some(unit << 4 | u16::try_from(digit).ok()?)
    })
}

fn plain(part: &[u8]) -> Result<&str, String> {
    if part.iter().any(|&byte| byte < 0x20) {
        return Err("a string has a control character that is not escaped".into());
    }
    str::from_utf8(part).map_err(|error| format!("a string is not UTF-8: {error}"))
}

/// Appends `text` in quotes, everything but printable ASCII escaped.
pub(crate) fn write(text: &str, out: &mut Vec<u8>) {
    out.push(b'"');
    let mut rest = text;
    while let Some(at) = rest.find(|c: char| !matches!(c, ' '..='~') || c == '"' || c == '\\') {
        let (plain, special) = rest.split_at(at);
        out.extend_from_slice(plain.as_bytes());
        let mut chars = special.chars();
        if let Some(c) = chars.next() {
            c.encode_utf16(&mut [0; 2]).iter().for_each(|&unit| write_unit(unit, out));
        }
        rest = chars.as_str();
    }
    out.extend_from_slice(rest.as_bytes());
    out.push(b'"');
}

/// Appends UTF-16 code units in quotes, surrogates included. Bytes become one character each.
pub(crate) fn write_units<T: Copy + Into<u16>>(units: &[T], out: &mut Vec<u8>) {
    out.push(b'"');
    units.iter().for_each(|&unit| write_unit(unit.into(), out));
    out.push(b'"');
}

fn hex_digit(nibble: u8) -> u8 {
    if nibble < 10 { b'0' + nibble } else { b'a' + nibble - 10 }
}

fn write_unit(unit: u16, out: &mut Vec<u8>) {
    let short = match u8::try_from(unit) {
        Ok(c @ (b'"' | b'\\')) => c,
        Ok(0x08) => b'b',
        Ok(0x0C) => b'f',
        Ok(0x0A) => b'n',
        Ok(0x0D) => b'r',
        Ok(0x09) => b't',
        Ok(c @ b' '..=b'~') => return out.push(c),
        _ => {
            out.extend_from_slice(b"\\u");
            let [high, low] = unit.to_be_bytes();
            return out.extend([high >> 4, high & 15, low >> 4, low & 15].map(hex_digit));
        }
    };
    out.extend_from_slice(&[b'\\', short]);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn decode(text: &str) -> Result<Text, String> {
        find_end(text.as_bytes()).expect("a closing quote").decode()
    }

    #[test]
    fn escapes() {
        for (raw, said) in [
            (r#"a\"b\\c\/\b\f\n\r\t\u0000""#, "a\"b\\c/\u{8}\u{c}\n\r\t\0"),
            (r#"\ud83e\udd16 gr\u00FC\u00dfe 你""#, "🤖 grüße 你"),
            (r#"""#, ""),
        ] {
            assert_eq!(decode(raw), Ok(Text::Valid(said.into())));
        }
    }

    #[test]
    fn lone_surrogates_are_kept() {
        for (raw, units) in [
            (r#"\ud800""#, vec![0xD800]),
            (r#"\udd16\ud83e""#, vec![0xDD16, 0xD83E]),
            (r#"\ud83e\ud83e\udd16""#, vec![0xD83E, 0xD83E, 0xDD16]),
            (r#"\ud800é""#, vec![0xD800, 0xE9]),
            (r#"\ud800\n""#, vec![0xD800, 0x0A]),
        ] {
            assert_eq!(decode(raw), Ok(Text::Utf16(units)));
        }
    }

    #[test]
    fn what_no_string_holds() {
        for raw in ["\n\"", r#"\x""#, r#"\u12g4""#, r#"\u12""#, "\\u0041\t\""] {
            assert!(decode(raw).is_err(), "{raw}");
            assert!(find_end(raw.as_bytes()).unwrap().check().is_err(), "{raw}");
        }
        assert!(find_end(b"\xff\"").unwrap().decode().is_err());
        for open in ["", "abc", "\\", "\\\"", "abc\\\\\\\""] {
            assert!(find_end(open.as_bytes()).is_none(), "{open}");
        }
    }

    #[test]
    fn a_character_beyond_a_byte_is_no_file() {
        let latin1 = |text: &str| find_end(text.as_bytes()).unwrap().decode_latin1();
        assert_eq!(latin1(r#"\u0080\u0005é""#), Ok(vec![0x80, 5, 0xE9]));
        assert_eq!(latin1(r#"\u0100""#), Err("a character U+0100 stands for no byte".into()));
        assert_eq!(latin1(r#"你""#), Err("a character U+4F60 stands for no byte".into()));
    }

    proptest! {
        #[test]
        fn a_file_written_then_read_is_the_same(file: Vec<u8>) {
            let mut out = Vec::new();
            write_units(&file, &mut out);
            prop_assert_eq!(find_end(&out[1..]).unwrap().decode_latin1(), Ok(file));
        }

        #[test]
        fn written_then_read_is_the_same(text: String) {
            let mut out = Vec::new();
            write(&text, &mut out);
            prop_assert!(out.iter().all(|byte| (b' '..=b'~').contains(byte)));
            prop_assert_eq!(&serde_json::from_slice::<String>(&out).unwrap(), &text);
            prop_assert_eq!(find_end(&out[1..]).unwrap().decode(), Ok(Text::Valid(text)));
        }
    }
}
