//! Numbers and booleans from JSON.

use serde_json::{Number, Value};

use super::ValueError;
use super::json_in::kind;
use crate::parser::Primitive;

/// A primitive that JSON can give.
pub(super) trait FromJson: Sized {
    /// Reads `json` as `primitive`, which this is the Rust type of.
    fn from_json(primitive: Primitive, json: &Value) -> Result<Self, ValueError>;
}

impl FromJson for bool {
    fn from_json(_: Primitive, json: &Value) -> Result<Self, ValueError> {
        json.as_bool().ok_or_else(|| kind("true or false".to_owned(), json))
    }
}

macro_rules! integers {
    ($($integer:ty),*) => {$(
        impl FromJson for $integer {
            fn from_json(primitive: Primitive, json: &Value) -> Result<Self, ValueError> {
                let value = json.as_number().and_then(integer);
                let value = value
                    .ok_or_else(|| kind(format!("an integer for {}", primitive.name()), json))?;
                Self::try_from(value).map_err(|_out| ValueError::Range {
                    path: String::new(),
                    value: json.to_string(),
                    expected: primitive.name(),
                    low: Self::MIN.to_string(),
                    high: Self::MAX.to_string(),
                })
            }
        }
    )*};
}

integers!(i8, u8, i16, u16, i32, u32, i64, u64);

/// The integer a number is; `2.0` is one too, since JavaScript does not tell it from `2`.
fn integer(number: &Number) -> Option<i128> {
    if let Some(value) = number.as_i128() {
        return Some(value);
    }
    /// Up to here every integer is a double.
    const EXACT: f64 = 9_007_199_254_740_992.0;
    let value = number.as_f64()?;
    (value.trunc() == value && value.abs() <= EXACT).then_some(value as i128)
}

impl FromJson for f64 {
    fn from_json(primitive: Primitive, json: &Value) -> Result<Self, ValueError> {
        let value = match json {
            Value::Number(number) => number.as_f64(),
            Value::String(text) => match text.as_str() {
                "NaN" | "nan" | ".nan" => Some(Self::NAN),
                "Infinity" | "inf" | ".inf" => Some(Self::INFINITY),
                "-Infinity" | "-inf" | "-.inf" => Some(Self::NEG_INFINITY),
                _ => None,
            },
            _ => None,
        };
        let expected =
            || format!("a number, \"NaN\", \"Infinity\" or \"-Infinity\" for {}", primitive.name());
        value.ok_or_else(|| kind(expected(), json))
    }
}

impl FromJson for f32 {
    fn from_json(primitive: Primitive, json: &Value) -> Result<Self, ValueError> {
        let wide = f64::from_json(primitive, json)?;
        let value = wide as Self;
        if value.is_infinite() && wide.is_finite() {
            return Err(ValueError::Range {
                path: String::new(),
                value: wide.to_string(),
                expected: primitive.name(),
                low: format!("{:e}", Self::MIN),
                high: format!("{:e}", Self::MAX),
            });
        }
        Ok(value)
    }
}
