//! The Rust types behind the primitives of definitions.

use crate::cdr::CdrPrimitive;
use crate::parser::Literal;

/// A primitive, as definitions and fresh messages have it.
pub(super) trait Scalar: CdrPrimitive {
    /// Reads the number from a definition; `None` for a value of another type.
    fn from_literal(literal: &Literal) -> Option<Self>;

    /// Value in a freshly made message.
    const ZERO: Self;
}

macro_rules! scalars {
    ($($scalar:ty, $zero:expr, |$literal:ident| $from:expr;)*) => {$(
        impl Scalar for $scalar {
            const ZERO: Self = $zero;

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
    bool, false, |literal| match literal {
        Literal::Bool(value) => Some(*value),
        _ => None,
    };
    i8, 0, |literal| integer(literal);
    u8, 0, |literal| integer(literal);
    i16, 0, |literal| integer(literal);
    u16, 0, |literal| integer(literal);
    i32, 0, |literal| integer(literal);
    u32, 0, |literal| integer(literal);
    i64, 0, |literal| integer(literal);
    u64, 0, |literal| integer(literal);
    f32, 0.0, |literal| float(literal).map(|value| value as f32);
    f64, 0.0, |literal| float(literal);
}

/// Runs `$body` with `$scalar` as the Rust type of `$primitive`.
macro_rules! with_scalar {
    ($primitive:expr, $scalar:ident => $body:expr) => {
        match $primitive {
            $crate::parser::Primitive::Bool => {
                type $scalar = bool;
                $body
            }
            $crate::parser::Primitive::Byte
            | $crate::parser::Primitive::Char
            | $crate::parser::Primitive::Uint8 => {
                type $scalar = u8;
                $body
            }
            $crate::parser::Primitive::Int8 => {
                type $scalar = i8;
                $body
            }
            $crate::parser::Primitive::Int16 => {
                type $scalar = i16;
                $body
            }
            $crate::parser::Primitive::Uint16 => {
                type $scalar = u16;
                $body
            }
            $crate::parser::Primitive::Int32 => {
                type $scalar = i32;
                $body
            }
            $crate::parser::Primitive::Uint32 => {
                type $scalar = u32;
                $body
            }
            $crate::parser::Primitive::Int64 => {
                type $scalar = i64;
                $body
            }
            $crate::parser::Primitive::Uint64 => {
                type $scalar = u64;
                $body
            }
            $crate::parser::Primitive::Float32 => {
                type $scalar = f32;
                $body
            }
            $crate::parser::Primitive::Float64 => {
                type $scalar = f64;
                $body
            }
        }
    };
}
pub(super) use with_scalar;
