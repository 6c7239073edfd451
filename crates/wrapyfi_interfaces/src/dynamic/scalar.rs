//! The Rust types behind the primitives of definitions.

use crate::cdr::CdrPrimitive;
use crate::parser::Literal;

/// A primitive, as definitions and fresh messages have it.
pub(super) trait Scalar: CdrPrimitive {
    /// Reads the number from a definition; `None` for a value of another type.
    fn from_literal(literal: &Literal) -> Option<Self>;
}

macro_rules! scalars {
    ($($scalar:ty, |$literal:ident| $from:expr;)*) => {$(
        impl Scalar for $scalar {
            fn from_literal($literal: &Literal) -> Option<Self> {
                $from
            }
        }
    )*};
}

fn integer<T: TryFrom<i128>>(literal: &Literal) -> Option<T> {
    match literal {
        Literal::Integer(value) => T::try_from(*value).ok(),
        _ => None,
    }
}

fn float(literal: &Literal) -> Option<f64> {
    match literal {
        Literal::Float(value) => Some(*value),
        _ => None,
    }
}

scalars! {
    bool, |literal| match literal {
        Literal::Bool(value) => Some(*value),
        _ => None,
    };
    i8, |literal| integer(literal);
    u8, |literal| integer(literal);
    i16, |literal| integer(literal);
    u16, |literal| integer(literal);
    i32, |literal| integer(literal);
    u32, |literal| integer(literal);
    i64, |literal| integer(literal);
    u64, |literal| integer(literal);
    f32, |literal| float(literal).map(|value| value as f32);
    f64, |literal| float(literal);
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
