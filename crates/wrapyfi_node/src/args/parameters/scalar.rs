//! Scalars by the rules of YAML 1.1 as ROS 2 reads it, and lists of one type.
//!
//! ```text
//!   yes, On, y ─▶ bool     010, 0x10, -5 ─▶ integer     1e3, .inf, 2^63 ─▶ double     rest ─▶ text
//! ```

use super::super::error::YamlError;
use wrapyfi_data::types::ParameterValue;

/// Reads an unquoted scalar, whose type follows from its form.
pub(super) fn plain(text: &str) -> ParameterValue {
    bool_of(text)
        .map(ParameterValue::Bool)
        .or_else(|| integer_of(text).map(ParameterValue::Integer))
        .or_else(|| double_of(text).map(ParameterValue::Double))
        .unwrap_or_else(|| ParameterValue::String(text.to_owned()))
}

/// Appends a scalar to a list. The first gives its type, so an empty list has none.
pub(super) fn append(
    list: &mut ParameterValue,
    scalar: ParameterValue,
    line: usize,
) -> Result<(), YamlError> {
    use ParameterValue as V;
    match (&mut *list, scalar) {
        (V::NotSet, V::Bool(value)) => *list = V::BoolArray(vec![value]),
        (V::NotSet, V::Integer(value)) => *list = V::IntegerArray(vec![value]),
        (V::NotSet, V::Double(value)) => *list = V::DoubleArray(vec![value]),
        (V::NotSet, V::String(value)) => *list = V::StringArray(vec![value]),
        (V::BoolArray(values), V::Bool(value)) => values.push(value),
        (V::IntegerArray(values), V::Integer(value)) => values.push(value),
        (V::DoubleArray(values), V::Double(value)) => values.push(value),
        (V::StringArray(values), V::String(value)) => values.push(value),
        (_, other) => {
            let kind = match other {
                V::Bool(_) => "bool",
                V::Integer(_) => "integer",
                V::Double(_) => "double",
                _ => "string",
            };
            return Err(YamlError::MixedSequence { kind, line });
        }
    }
    Ok(())
}

fn bool_of(text: &str) -> Option<bool> {
    match text {
        "Y" | "y" | "yes" | "Yes" | "YES" | "true" | "True" | "TRUE" | "on" | "On" | "ON" => {
            Some(true)
        }
        "N" | "n" | "no" | "No" | "NO" | "false" | "False" | "FALSE" | "off" | "Off" | "OFF" => {
            Some(false)
        }
        _ => None,
    }
}

/// Reads an integer. A leading `0x` means hexadecimal, another leading `0` octal; a number that
/// does not fit is no integer.
fn integer_of(text: &str) -> Option<i64> {
    let (negative, digits) = split_sign(text);
    let magnitude = if let Some(hex) = hex_digits(digits) {
        u64::from_str_radix(hex, 16).ok()?
    } else if !digits.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    } else if digits.len() > 1 && digits.starts_with('0') {
        u64::from_str_radix(digits, 8).ok()?
    } else {
        digits.parse().ok()?
    };
    let magnitude = i128::from(magnitude);
    i64::try_from(if negative { -magnitude } else { magnitude }).ok()
}

fn double_of(text: &str) -> Option<f64> {
    match text {
        ".nan" | ".NaN" | ".NAN" => return Some(f64::NAN),
        ".inf" | ".Inf" | ".INF" | "+.inf" | "+.Inf" | "+.INF" => return Some(f64::INFINITY),
        "-.inf" | "-.Inf" | "-.INF" => return Some(f64::NEG_INFINITY),
        _ => {}
    }
    let (negative, digits) = split_sign(text);
    if let Some(hex) = hex_digits(digits) {
        // Only integers too large for 64 bits come here; a number of more than 128 bits is text.
        // The nearest double is what is wanted.
        let value = u128::from_str_radix(hex, 16).ok()? as f64;
        return Some(if negative { -value } else { value });
    }
    let value: f64 = text.parse().ok()?;
    // A number in digits that no double comes near is left as the text it was. `inf` is no digits.
    let is_number = digits.starts_with(|c: char| c.is_ascii_digit() || c == '.');
    let mantissa = digits.split(['e', 'E']).next().unwrap_or(digits);
    let is_zero = !mantissa.contains(|c| matches!(c, '1'..='9'));
    let too_large = is_number && value.is_infinite();
    let too_small = is_number && !is_zero && value.abs() < f64::MIN_POSITIVE;
    if too_large || too_small { None } else { Some(value) }
}

fn split_sign(text: &str) -> (bool, &str) {
    match text.strip_prefix('-') {
        Some(digits) => (true, digits),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    }
}

fn hex_digits(digits: &str) -> Option<&str> {
    let hex = digits.strip_prefix("0x").or_else(|| digits.strip_prefix("0X"))?;
    (!hex.is_empty() && hex.bytes().all(|byte| byte.is_ascii_hexdigit())).then_some(hex)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_have_three_bases_and_64_bits() {
        for (text, value) in [
            ("0", 0),
            ("-0x10", -16),
            ("+5", 5),
            ("010", 8),
            ("9223372036854775807", i64::MAX),
            ("-9223372036854775808", i64::MIN),
            ("0x7fffffffffffffff", i64::MAX),
        ] {
            assert_eq!(plain(text), ParameterValue::Integer(value), "{text}");
        }
    }

    #[test]
    fn doubles_are_what_c_reads_whole() {
        for (text, value) in [
            ("08", 8.0),
            ("1.", 1.0),
            (".5", 0.5),
            ("-1e3", -1000.0),
            ("inf", f64::INFINITY),
            ("-Infinity", f64::NEG_INFINITY),
            ("-.INF", f64::NEG_INFINITY),
            ("0e0", 0.0),
            ("0xffffffffffffffff", 18_446_744_073_709_551_615.0),
        ] {
            assert_eq!(plain(text), ParameterValue::Double(value), "{text}");
        }
    }

    #[test]
    fn everything_else_is_text() {
        for text in ["", "-", "0x", "0x+5", "1_000", "1e999", "1e-999", "-.NaN", ".", "--1", "1 2"]
        {
            assert_eq!(plain(text), ParameterValue::String(text.to_owned()), "{text}");
        }
        let giant = "9".repeat(100_000);
        assert_eq!(plain(&giant), ParameterValue::String(giant.clone()));
    }
}
