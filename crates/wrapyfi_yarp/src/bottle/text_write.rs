//! Bottles to text, byte for byte as YARP writes it.

use std::io::Write as _;

use super::{Bottle, Value};

/// Digits of a float: as many as YARP asks its C library for, so that its text is met exactly.
const DIGITS: i32 = 21;

/// Appends the elements, a blank between two.
pub(super) fn bottle(bottle: &Bottle, out: &mut Vec<u8>) {
    for (index, value) in bottle.values.iter().enumerate() {
        if index > 0 {
            out.push(b' ');
        }
        self::value(value, out);
    }
}

/// Appends one element.
pub(super) fn value(value: &Value, out: &mut Vec<u8>) {
    match value {
        Value::Int8(_) | Value::Int16(_) | Value::Int32(_) | Value::Int64(_) => {
            integer(value.as_i64().unwrap_or_default(), out);
        }
        Value::Float32(number) => float(f64::from(*number), out),
        Value::Float64(number) => float(*number, out),
        Value::Vocab32(vocab) => {
            self::vocab(i64::from(vocab.0), &vocab.letters(), out);
        }
        Value::Vocab64(vocab) => self::vocab(vocab.0, &vocab.letters(), out),
        Value::String(text) => string(text.as_bytes(), out),
        Value::Blob(bytes) => blob(bytes, out),
        Value::List(list) | Value::Dict(list) => {
            out.push(b'(');
            bottle(list, out);
            out.push(b')');
        }
    }
}

/// True when `key` names this element: a string, a vocab or a number, without the marks around it.
pub(super) fn is_key(value: &Value, key: &str) -> bool {
    let mut text = Vec::new();
    match value {
        Value::String(text) => return text.as_bytes() == key.as_bytes(),
        Value::Blob(_) | Value::List(_) | Value::Dict(_) => return false,
        other => self::value(other, &mut text),
    }
    let bare = text.strip_prefix(b"[").and_then(|text| text.strip_suffix(b"]")).unwrap_or(&text);
    bare == key.as_bytes()
}

fn integer(number: i64, out: &mut Vec<u8>) {
    // Writing to memory cannot fail.
    write!(out, "{number}").ok();
}

/// A vocab by its number. Of one that begins with letters beyond ASCII, the number is negative, and
/// YARP writes no letters.
fn vocab(number: i64, letters: &[u8], out: &mut Vec<u8>) {
    match number {
        0 => out.extend_from_slice(b"false"),
        0x31 => out.extend_from_slice(b"true"),
        _ => {
            out.push(b'[');
            if number > 0 {
                out.extend_from_slice(letters);
            }
            out.push(b']');
        }
    }
}

fn blob(bytes: &[u8], out: &mut Vec<u8>) {
    out.reserve(bytes.len().saturating_mul(4));
    out.push(b'{');
    for (index, byte) in bytes.iter().enumerate() {
        if index > 0 {
            out.push(b' ');
        }
        integer(i64::from(*byte), out);
    }
    out.push(b'}');
}

fn string(text: &[u8], out: &mut Vec<u8>) {
    let word = |byte: &u8| byte.is_ascii_alphabetic() || *byte == b'_';
    let further = |byte: &u8| word(byte) || byte.is_ascii_digit() || b".-".contains(byte);
    let bare = text.first().is_some_and(word) && text.iter().all(further);
    if bare && text != b"true" && text != b"false" {
        out.extend_from_slice(text);
        return;
    }
    out.reserve(text.len() + 2);
    out.push(b'"');
    for &byte in text {
        match byte {
            b'\n' => out.extend_from_slice(b"\\n"),
            b'\r' => out.extend_from_slice(b"\\r"),
            0 => out.extend_from_slice(b"\\0"),
            b'\\' | b'"' => out.extend_from_slice(&[b'\\', byte]),
            other => out.push(other),
        }
    }
    out.push(b'"');
}

/// Writes a float as C's `%.21g` does, with a point or an exponent in it so that it stays a float.
fn float(number: f64, out: &mut Vec<u8>) {
    if number.is_nan() {
        out.extend_from_slice(b"nan");
        return;
    }
    if number.is_infinite() {
        out.extend_from_slice(if number > 0.0 { b"inf".as_slice() } else { b"-inf" });
        return;
    }
    let text = significant(number, DIGITS);
    out.extend_from_slice(text.as_bytes());
    if !text.contains(['.', 'e']) {
        out.extend_from_slice(b".0");
    }
}

/// A number to so many significant digits, without zeros at its end: C's `%.*g`.
pub(crate) fn significant(number: f64, digits: i32) -> String {
    let precision = usize::try_from(digits - 1).unwrap_or(0);
    let text = format!("{number:.precision$e}");
    // The exponent decides on the form only after rounding.
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    if exponent < -4 || exponent >= digits {
        let sign = if exponent < 0 { '-' } else { '+' };
        return format!("{}e{sign}{:02}", trimmed(mantissa), exponent.unsigned_abs());
    }
    let decimals = usize::try_from(digits - 1 - exponent).unwrap_or(0);
    trimmed(&format!("{number:.decimals$}")).to_owned()
}

fn trimmed(digits: &str) -> &str {
    if !digits.contains('.') {
        return digits;
    }
    digits.trim_end_matches('0').trim_end_matches('.')
}
