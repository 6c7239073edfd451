//! The frame around a `.npy` header: magic, version, length, padding.

use std::borrow::Cow;

const MAGIC: &[u8] = b"\x93NUMPY";
/// Elements begin at a multiple of this.
const ALIGN: usize = 64;
/// Longest header that is read. NumPy's own limit is 10 000 characters.
const MAX_HEADER: usize = 1 << 20;
/// Room that NumPy leaves so that the first extent can grow in place.
const GROWTH_DIGITS: usize = 21;

/// Splits off the header: its text, and the offset at which the elements begin.
pub(super) fn split(file: &[u8]) -> Result<(Cow<'_, str>, usize), String> {
    let Some(rest) = file.strip_prefix(MAGIC) else {
        return Err(what_else(file).to_owned());
    };
    let (version, length, prefix) = match *rest {
        [version @ 1, _, a, b, ..] => (version, u32::from(u16::from_le_bytes([a, b])), 10),
        [version @ (2 | 3), _, a, b, c, d, ..] => (version, u32::from_le_bytes([a, b, c, d]), 12),
        [] | [1..=3, ..] => return Err("the file ends inside the header's length".into()),
        [version, ..] => return Err(format!("version {version} is not 1, 2 or 3")),
    };
    let length = length as usize;
    if length > MAX_HEADER {
        return Err(format!("a header of {length} bytes, the limit is {MAX_HEADER}"));
    }
    let text = file.get(prefix..).and_then(|rest| rest.get(..length)).ok_or_else(|| {
        format!("a header of {length} bytes, {} are there", file.len().saturating_sub(prefix))
    })?;
    let text = match str::from_utf8(text) {
        // Versions 1 and 2 are Latin-1, which agrees with UTF-8 in ASCII only.
        Ok(text) if version == 3 || text.is_ascii() => Cow::Borrowed(text),
        Err(_) if version == 3 => return Err("the header is not UTF-8".into()),
        _ => Cow::Owned(text.iter().copied().map(char::from).collect()),
    };
    Ok((text, prefix + length))
}

/// Words for a file that is no `.npy` file, by its first bytes.
fn what_else(file: &[u8]) -> &'static str {
    match *file {
        [] => "no bytes",
        [b'P', b'K', ..] => "an .npz archive, only single arrays are read",
        [0x80, ..] => "a pickle, which is never executed",
        _ => "does not begin with \\x93NUMPY",
    }
}

/// A complete header for elements in row-major order, byte for byte as NumPy writes it.
pub(super) fn write(descr: &str, shape: &[usize]) -> Vec<u8> {
    let mut text = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': (");
    let mut first_digits = None;
    for (index, extent) in shape.iter().enumerate() {
        let before = text.len();
        let separator = if index > 0 { " " } else { "" };
        text += &format!("{separator}{extent},");
        first_digits.get_or_insert(text.len() - before - 1);
    }
    if shape.len() > 1 {
        text.pop();
    }
    text.push_str("), }");
    if let Some(digits) = first_digits {
        text.extend(std::iter::repeat_n(' ', GROWTH_DIGITS.saturating_sub(digits)));
    }

    let latin1: Option<Vec<u8>> = text.chars().map(|c| u8::try_from(c).ok()).collect();
    let (mut version, text) = match latin1 {
        Some(text) => (1, text),
        None => (3, text.into_bytes()),
    };
    let prefix_and_padding = |prefix: usize| {
        // One newline ends the text; a header that happens to fit gets a whole block of padding.
        let used = prefix + text.len() + 1;
        (prefix, ALIGN - used % ALIGN)
    };
    let (mut prefix, mut padding) = prefix_and_padding(10);
    if version == 1 && text.len() + 1 + padding > usize::from(u16::MAX) {
        version = 2;
    }
    if version > 1 {
        (prefix, padding) = prefix_and_padding(12);
    }
    let length = text.len() + padding + 1;
    let mut header = Vec::with_capacity(prefix + length);
    header.extend_from_slice(MAGIC);
    header.extend_from_slice(&[version, 0]);
    let length_bytes = u32::try_from(length).unwrap_or(u32::MAX).to_le_bytes();
    header.extend(length_bytes.iter().take(prefix - MAGIC.len() - 2));
    header.extend_from_slice(&text);
    header.extend(std::iter::repeat_n(b' ', padding));
    header.push(b'\n');
    header
}
