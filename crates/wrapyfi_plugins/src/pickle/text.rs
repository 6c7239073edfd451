//! Text in a pickle: Python's escapes, lone surrogates, Latin-1.

use super::arena::{Kind, Span};

/// Text as UTF-8 in which, as in Python's `surrogatepass`, surrogates may stand alone. `None` where
/// it is not even that.
pub(super) fn utf8(bytes: &[u8], span: Span) -> Option<Kind> {
    if str::from_utf8(bytes).is_ok() {
        return Some(Kind::Str(span));
    }
    let mut units = Vec::with_capacity(bytes.len());
    let mut rest = bytes;
    loop {
        let (valid, invalid) = match str::from_utf8(rest) {
            Ok(valid) => (valid, &[][..]),
            Err(error) => {
                let (valid, invalid) = rest.split_at_checked(error.valid_up_to())?;
                (str::from_utf8(valid).ok()?, invalid)
            }
        };
        units.extend(valid.encode_utf16());
        match *invalid {
            [] => return Some(Kind::Utf16(units.into())),
            // What U+D800 to U+DFFF would be in UTF-8.
            [0xED, second @ 0xA0..=0xBF, third @ 0x80..=0xBF, ..] => {
                units.push(0xD000 | u16::from(second & 0x3F) << 6 | u16::from(third & 0x3F));
                rest = invalid.get(3..)?;
            }
            _ => return None,
        }
    }
}

/// Bytes as characters, one each: what strings of Python 2 become.
pub(super) fn latin1(bytes: &[u8], span: Option<Span>) -> Kind {
    match span {
        Some(span) if bytes.is_ascii() => Kind::Str(span),
        _ => Kind::OwnedStr(bytes.iter().copied().map(char::from).collect()),
    }
}

/// Characters as bytes, one each; `None` where one is beyond U+00FF.
pub(super) fn to_latin1(text: &str) -> Option<Vec<u8>> {
    text.chars().map(|c| u8::try_from(c).ok()).collect()
}

/// Text of protocol 0: Latin-1 with `\uXXXX` and `\UXXXXXXXX`.
pub(super) fn raw_unicode_escape(line: &[u8], span: Span) -> Result<Kind, &'static str> {
    if line.is_ascii() && !line.contains(&b'\\') {
        return Ok(Kind::Str(span));
    }
    let mut units: Vec<u16> = Vec::with_capacity(line.len());
    let mut rest = line;
    while let Some((&byte, after)) = rest.split_first() {
        rest = after;
        let digits = match (byte, after.first()) {
            (b'\\', Some(b'u')) => 4,
            (b'\\', Some(b'U')) => 8,
            (b'\\', Some(&other)) => {
                units.extend([u16::from(b'\\'), u16::from(other)]);
                rest = after.get(1..).unwrap_or_default();
                continue;
            }
            _ => {
                units.push(byte.into());
                continue;
            }
        };
        let code = after.get(1..=digits).and_then(hex).ok_or("an escape lacks its hex digits")?;
        rest = after.get(1 + digits..).unwrap_or_default();
        match char::from_u32(code) {
            Some(c) => units.extend_from_slice(c.encode_utf16(&mut [0; 2])),
            // The code is a lone surrogate.
            None => units.push(u16::try_from(code).ok().ok_or("an escape beyond U+10FFFF")?),
        }
    }
    Ok(match String::from_utf16(&units) {
        Ok(text) => Kind::OwnedStr(text.into()),
        Err(_) => Kind::Utf16(units.into()),
    })
}

fn hex(digits: &[u8]) -> Option<u32> {
    digits.iter().try_fold(0, |value, &digit| Some(value << 4 | char::from(digit).to_digit(16)?))
}

/// A quoted string of protocol 0 as Python 2 wrote it: bytes with escapes.
pub(super) fn quoted(line: &[u8]) -> Result<Vec<u8>, &'static str> {
    let inner = match line {
        [first @ (b'\'' | b'"'), inner @ .., last] if first == last => inner,
        _ => return Err("the string is not quoted"),
    };
    let mut bytes = Vec::with_capacity(inner.len());
    let mut rest = inner;
    while let Some((&byte, after)) = rest.split_first() {
        rest = after;
        if byte != b'\\' {
            bytes.push(byte);
            continue;
        }
        let (&escape, after) = after.split_first().ok_or("the string ends in a backslash")?;
        rest = after;
        match escape {
            b'\n' => {}
            b'\\' | b'\'' | b'"' => bytes.push(escape),
            b'a' => bytes.push(7),
            b'b' => bytes.push(8),
            b'f' => bytes.push(12),
            b'n' => bytes.push(b'\n'),
            b'r' => bytes.push(b'\r'),
            b't' => bytes.push(b'\t'),
            b'v' => bytes.push(11),
            b'x' => {
                let value = after.get(..2).and_then(hex).and_then(|v| u8::try_from(v).ok());
                bytes.push(value.ok_or("\\x lacks its two digits")?);
                rest = after.get(2..).unwrap_or_default();
            }
            b'0'..=b'7' => {
                let more = after.iter().take(2).take_while(|d| matches!(d, b'0'..=b'7')).count();
                let digits = after.get(..more).unwrap_or_default();
                let octal = |value: u32, digit: &u8| value << 3 | u32::from(digit - b'0');
                let value = digits.iter().fold(u32::from(escape - b'0'), octal);
                bytes.push(value.to_le_bytes()[0]);
                rest = after.get(more..).unwrap_or_default();
            }
            other => bytes.extend([b'\\', other]),
        }
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn units(kind: Kind) -> Vec<u16> {
        match kind {
            Kind::Utf16(units) => units.into(),
            Kind::OwnedStr(text) => text.encode_utf16().collect(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn surrogates_pass() {
        let all = Span { start: 0, end: 0 };
        let decoded = |bytes: &[u8]| utf8(bytes, all).map(units);
        assert_eq!(decoded(b"a\xED\xA0\x80\xC3\xA9"), Some(vec![0x61, 0xD800, 0xE9]));
        assert_eq!(decoded(b"\xED\xBF\xBF"), Some(vec![0xDFFF]));
        for bad in [&b"\xED\xA0"[..], b"\xFF", b"\xED\xC0\x80", b"\xC3"] {
            assert_eq!(decoded(bad), None, "{bad:?}");
        }
    }

    #[test]
    fn escapes_of_protocol_0() {
        let text = |line: &[u8]| raw_unicode_escape(line, Span { start: 0, end: 0 }).map(units);
        assert_eq!(text(b"a\\u4f60\xE9").unwrap(), [0x61, 0x4F60, 0xE9]);
        assert_eq!(text(b"\\U0001f916").unwrap(), [0xD83E, 0xDD16]);
        assert_eq!(text(b"\\ud800").unwrap(), [0xD800]);
        assert_eq!(text(b"\\\\u0041\\").unwrap(), "\\\\u0041\\".encode_utf16().collect::<Vec<_>>());
        assert!(text(b"\\u41").is_err() && text(b"\\U00110000").is_err());

        assert_eq!(quoted(br#"'a\'\x41\101\n\\\q'"#).unwrap(), b"a'AA\n\\\\q");
        assert_eq!(quoted(b"''").unwrap(), b"");
        for bad in [&b"'"[..], b"x", b"'a\"", br"'\x4'", br"'\'", b""] {
            assert!(quoted(bad).is_err(), "{bad:?}");
        }
    }
}
