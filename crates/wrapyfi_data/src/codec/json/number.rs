//! Numbers as Python's JSON writes and reads them.

use num_bigint::BigInt;

use crate::types::Value;

/// Digits of the longest integer, Python's own limit on both sides.
pub(super) const MAX_DIGITS: usize = 4300;

/// Reads a number in front of text; also returns the number of bytes that it takes.
pub(super) fn read(text: &[u8]) -> Result<(Value, usize), String> {
    let digits_from = |at: usize| {
        let rest = text.get(at..).unwrap_or_default();
        rest.iter().take_while(|byte| byte.is_ascii_digit()).count()
    };
    let negative = usize::from(text.first() == Some(&b'-'));
    let rest = text.get(negative..).unwrap_or_default();
    if negative == 1 && rest.starts_with(b"Infinity") {
        return Ok((Value::Float(f64::NEG_INFINITY), 9));
    }
    let digits = match rest.first() {
        Some(b'0') => 1,
        _ => digits_from(negative),
    };
    if digits == 0 {
        return Err("a number lacks its digits".into());
    }
    let mut end = negative + digits;
    let integer_end = end;
    if text.get(end) == Some(&b'.') {
        let fraction = digits_from(end + 1);
        if fraction > 0 {
            end += 1 + fraction;
        }
    }
    if matches!(text.get(end), Some(b'e' | b'E')) {
        let sign = usize::from(matches!(text.get(end + 1), Some(b'+' | b'-')));
        let exponent = digits_from(end + 1 + sign);
        if exponent > 0 {
            end += 1 + sign + exponent;
        }
    }
    let number = text.get(..end).and_then(|number| str::from_utf8(number).ok()).unwrap_or_default();
    let value = if end > integer_end {
        // Overflow gives infinity, as in Python.
        number.parse().map(Value::Float).ok()
    } else if digits > MAX_DIGITS {
        return Err(format!("an integer of {digits} digits, the limit is {MAX_DIGITS}"));
    } else if let Ok(integer) = number.parse() {
        Some(Value::Int(integer))
    } else {
        number.parse().map(Value::BigInt).ok()
    };
    value.map(|value| (value, end)).ok_or_else(|| format!("{number:?} is no number"))
}

/// Appends a float as Python's `repr` writes it, NaN and the infinities as `json` does: the shortest
/// digits that read back the same, plain from 1e-4 to below 1e16, otherwise with an exponent of at
/// least two digits.
pub fn write_float(value: f64, out: &mut Vec<u8>) {
    if value.is_nan() {
        return out.extend_from_slice(b"NaN");
    }
    if value.is_infinite() {
        return out.extend_from_slice(if value > 0.0 { b"Infinity" } else { b"-Infinity" });
    }
    // Shortest digits are not unique: where two are equally near, serde_json takes the even one as
    // Python does, unlike `format!`. Writing to a vector does not fail.
    let start = out.len();
    serde_json::to_writer(&mut *out, &value).ok();
    if value != 0.0 && !(1e-4..1e16).contains(&value.abs()) {
        let scientific = scientific(out.get(start..).unwrap_or_default());
        out.truncate(start);
        out.extend_from_slice(scientific.as_bytes());
    }
}

/// A decimal number in any notation with one digit before the point and an exponent.
fn scientific(number: &[u8]) -> String {
    let number = String::from_utf8_lossy(number);
    let (sign, number) = number.strip_prefix('-').map_or(("", &*number), |number| ("-", number));
    let (mantissa, exponent) = number.split_once('e').unwrap_or((number, "0"));
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let digits = [whole, fraction].concat();
    let significant = digits.trim_start_matches('0');
    let zeros = digits.len() - significant.len();
    // Neither overflows: a double has at most some 330 digits before or behind the point.
    let shift = |count: usize| i32::try_from(count).unwrap_or_default();
    let exponent = exponent.parse().unwrap_or(0) + shift(whole.len()) - shift(zeros) - 1;
    let significant = significant.trim_end_matches('0');
    let (first, rest) = significant.split_at_checked(1).unwrap_or((significant, ""));
    let point = if rest.is_empty() { "" } else { "." };
    let exponent_sign = if exponent < 0 { '-' } else { '+' };
    format!("{sign}{first}{point}{rest}e{exponent_sign}{:02}", exponent.abs())
}

/// Decimal digits, unless Python would refuse to read so many.
pub(super) fn big_integer(value: &BigInt) -> Option<String> {
    // A digit takes more than 3.3 bits: the exact count is only worth asking for near the limit.
    if value.bits() > MAX_DIGITS as u64 * 10 / 3 {
        return None;
    }
    let digits = value.to_string();
    (digits.trim_start_matches('-').len() <= MAX_DIGITS).then_some(digits)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn python_repr() {
        for (value, text) in [
            (0.0, "0.0"),
            (-0.0, "-0.0"),
            (3.0, "3.0"),
            (0.1, "0.1"),
            (1e-4, "0.0001"),
            (0.000_099_999, "9.9999e-05"),
            (1e-7, "1e-07"),
            (1e15, "1000000000000000.0"),
            (9_007_199_254_740_993.0, "9007199254740992.0"),
            (1e16, "1e+16"),
            (1e22, "1e+22"),
            (1.234_567_890_123_456_8e17, "1.2345678901234568e+17"),
            (5e-324, "5e-324"),
            (f64::MAX, "1.7976931348623157e+308"),
            (-1.5e-10, "-1.5e-10"),
            (1e100, "1e+100"),
            (79_629_874_276_513.63, "79629874276513.62"), // exactly .625
            (123e-10, "1.23e-08"),
            (-1.152_921_504_606_847e18, "-1.152921504606847e+18"),
        ] {
            let mut out = Vec::new();
            write_float(value, &mut out);
            assert_eq!(String::from_utf8(out).unwrap(), text);
        }
    }

    #[test]
    fn grammar() {
        for (text, value, length) in [
            ("-0", Value::Int(0), 2),
            ("0123", Value::Int(0), 1),
            ("1.", Value::Int(1), 1),
            ("1e", Value::Int(1), 1),
            ("1e5,", Value::Float(1e5), 3),
            ("-1.5E+3]", Value::Float(-1500.0), 7),
            ("1e999", Value::Float(f64::INFINITY), 5),
            ("-Infinity", Value::Float(f64::NEG_INFINITY), 9),
            ("-9223372036854775808", Value::Int(i64::MIN), 20),
            ("9223372036854775808", Value::BigInt((1_u64 << 63).into()), 19),
        ] {
            assert_eq!(read(text.as_bytes()), Ok((value, length)), "{text}");
        }
        for text in ["-", "-x", "", "+1", ".5"] {
            assert!(read(text.as_bytes()).is_err(), "{text}");
        }
        let longest = "9".repeat(MAX_DIGITS);
        let (Value::BigInt(value), _) = read(longest.as_bytes()).unwrap() else { panic!() };
        assert_eq!(big_integer(&value).unwrap(), longest);
        assert_eq!(big_integer(&(value + 1)), None);
        assert!(read(format!("{longest}9").as_bytes()).is_err());
    }

    proptest! {
        #[test]
        fn floats_read_back_bit_by_bit(value in proptest::num::f64::ANY) {
            let mut out = Vec::new();
            write_float(value, &mut out);
            if value.is_finite() {
                let (read, length) = read(&out).unwrap();
                prop_assert_eq!(length, out.len());
                prop_assert_eq!(read.as_f64().unwrap().to_bits(), value.to_bits());
            }
        }

        #[test]
        fn floats_of_everyday_size_are_plain(value in -1e17_f64..1e17, shift in 0..22) {
            let value = value / 10_f64.powi(shift);
            if (1e-4..1e16).contains(&value.abs()) {
                let mut out = Vec::new();
                write_float(value, &mut out);
                let plain = String::from_utf8(out).unwrap();
                prop_assert!(!plain.contains('e'), "{}", plain);
                prop_assert_eq!(plain.len(), format!("{value:?}").len());
            }
        }
    }
}
