//! The Rust types behind the primitives of definitions, and their values in definitions and JSON.

use serde_json::{Number, Value};

use super::ValueError;
use super::error::kind;
use crate::cdr::CdrPrimitive;
use crate::parser::{Literal, Primitive};

/// A primitive, as definitions and fresh messages have it.
pub(super) trait Scalar: CdrPrimitive {
    /// Reads the number from a definition; `None` for a value of another type.
    fn from_literal(literal: &Literal) -> Option<Self>;

    /// Reads `json` as `primitive`, which this is the Rust type of.
    fn from_json(primitive: Primitive, json: &Value) -> Result<Self, ValueError>;
}

impl Scalar for bool {
    fn from_literal(literal: &Literal) -> Option<Self> {
        if let Literal::Bool(value) = literal { Some(*value) } else { None }
    }

    fn from_json(_: Primitive, json: &Value) -> Result<Self, ValueError> {
        json.as_bool().ok_or_else(|| kind("true or false".to_owned(), json))
    }
}

macro_rules! integers {
    ($($integer:ty),*) => {$(
        impl Scalar for $integer {
            fn from_literal(literal: &Literal) -> Option<Self> {
                if let Literal::Integer(value) = literal { Self::try_from(*value).ok() } else { None }
            }

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

impl Scalar for f64 {
    fn from_literal(literal: &Literal) -> Option<Self> {
        if let Literal::Float(value) = literal { Some(*value) } else { None }
    }

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

impl Scalar for f32 {
    fn from_literal(literal: &Literal) -> Option<Self> {
        f64::from_literal(literal).map(|value| value as Self)
    }

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

/// Runs `$body` with `$scalar` as the Rust type of `$primitive`.
macro_rules! with_scalar {
    (@ $primitive:expr, $scalar:ident => $body:expr; $($variant:ident: $rust:ty,)*) => {
        match $primitive {
            $($crate::parser::Primitive::$variant => {
                type $scalar = $rust;
                $body
            })*
        }
    };
    ($primitive:expr, $scalar:ident => $body:expr) => {
        $crate::dynamic::scalar::with_scalar!(@ $primitive, $scalar => $body;
            Bool: bool, Byte: u8, Char: u8, Uint8: u8, Int8: i8, Int16: i16, Uint16: u16,
            Int32: i32, Uint32: u32, Int64: i64, Uint64: u64, Float32: f32, Float64: f64,
        )
    };
}
pub(super) use with_scalar;
