//! Words that YARP takes for numbers. Its rules are loose, and other programs rely on them:
//! `1-2` is 1, `+` is 0, `1e` is 0.0.

use super::Value;

/// Most hexadecimal digits of a number; with more, the word is a string.
const HEX_DIGITS: usize = 8;

/// The number that `word` is; none where it is something else.
pub(super) fn read(word: &[u8]) -> Option<Value> {
    match word {
        b"inf" => return Some(Value::Float64(f64::INFINITY)),
        b"-inf" => return Some(Value::Float64(f64::NEG_INFINITY)),
        b"nan" => return Some(Value::Float64(f64::NAN)),
        _ => {}
    }
    let first = word.first()?;
    if !(first.is_ascii_digit() || b"+-.".contains(first)) || word == b"." {
        return None;
    }
    let text = std::str::from_utf8(word).ok()?;
    Some(match shape(word)? {
        Shape::Integer => integer(text),
        Shape::Float => Value::Float64(float(text)),
    })
}

#[derive(Clone, Copy)]
enum Shape {
    Integer,
    Float,
}

/// Kind of number that the letters of a word can form; `None` where one letter cannot be part of a
/// number.
fn shape(word: &[u8]) -> Option<Shape> {
    let mut shape = Shape::Integer;
    // Zeros, signs and an x may come first.
    let mut prefix = true;
    let mut hex_from = None;
    let (mut points, mut signs) = (0, 0);
    for (index, &byte) in word.iter().enumerate() {
        match byte {
            b'.' => {
                shape = Shape::Float;
                points += 1;
            }
            b'e' | b'E' if hex_from.is_none() => shape = Shape::Float,
            _ => {}
        }
        if prefix {
            match byte {
                b'x' | b'X' => {
                    hex_from = Some(index + 1);
                    continue;
                }
                b'+' | b'-' => {
                    signs += 1;
                    continue;
                }
                b'0' => continue,
                _ => prefix = false,
            }
        }
        let decimal = byte.is_ascii_digit() || b".eE+-".contains(&byte);
        let hex = hex_from.is_some() && byte.is_ascii_hexdigit();
        if !(decimal || hex) {
            return None;
        }
    }
    let too_long = hex_from.is_some_and(|from| word.len() - from > HEX_DIGITS);
    (points <= 1 && signs <= 1 && !too_long).then_some(shape)
}

/// The integer at the start of a word, its base by its prefix as in C; 0 where there is none. As
/// short as it fits.
fn integer(text: &str) -> Value {
    let (negative, digits) = signed(text);
    let (base, digits) = match digits.as_bytes() {
        [b'0', b'x' | b'X', digit, ..] if digit.is_ascii_hexdigit() => {
            (16, digits.get(2..).unwrap_or_default())
        }
        [b'0', ..] => (8, digits),
        _ => (10, digits),
    };
    let mut number: i64 = 0;
    for digit in digits.chars().map_while(|digit| digit.to_digit(base)) {
        let digit = i64::from(digit);
        let digit = if negative { -digit } else { digit };
        number = number.saturating_mul(i64::from(base)).saturating_add(digit);
    }
    i32::try_from(number).map_or(Value::Int64(number), Value::Int32)
}

/// The float that a whole word is; 0 where some of it is left over.
fn float(text: &str) -> f64 {
    let (negative, digits) = signed(text);
    let Some(hex) = digits.strip_prefix("0x").or_else(|| digits.strip_prefix("0X")) else {
        return text.parse().unwrap_or(0.0);
    };
    let (whole, fraction) = hex.split_once('.').unwrap_or((hex, ""));
    if whole.len() + fraction.len() == 0 {
        return 0.0;
    }
    let mut number = 0.0;
    let mut weight = 1.0;
    for digit in whole.chars().chain(fraction.chars()) {
        let Some(digit) = digit.to_digit(16) else { return 0.0 };
        number = number * 16.0 + f64::from(digit);
    }
    for _ in fraction.chars() {
        weight *= 16.0;
    }
    if negative { -number / weight } else { number / weight }
}

fn signed(text: &str) -> (bool, &str) {
    match text.strip_prefix('-') {
        Some(rest) => (true, rest),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    }
}
