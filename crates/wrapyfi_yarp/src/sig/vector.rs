//! Vectors and matrices: many numbers of one kind.
//!
//! ```text
//!   vector   266 │ n │ f64 f64 …                       the same bytes as a bottle of n numbers
//!   matrix   256 3 │ 1 rows │ 1 columns │ 266 │ n │ f64 …      row by row
//! ```

use super::fields::{ints, put};
use crate::{Dialect, Limits};

/// Bytes before the numbers of a vector.
const VECTOR_HEADER_BYTES: usize = 8;
/// Bytes before the numbers of a matrix.
const MATRIX_HEADER_BYTES: usize = 32;
/// Bytes before the vector in a matrix.
const MATRIX_SIZES_BYTES: usize = 24;

/// Error of reading or writing a vector or matrix.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum VectorError {
    /// The bytes end early.
    #[error("{what} of {needed} bytes, {given} were given: the message was cut short")]
    Truncated {
        /// Vector or matrix.
        what: &'static str,
        /// Header and numbers.
        needed: usize,
        /// Number of bytes that there are.
        given: usize,
    },
    /// Something else.
    #[error("byte {at} holds {found}, {what} has {wanted} there: {hint}")]
    Other {
        /// Name of the part that differs.
        what: &'static str,
        /// Offset of the part in bytes.
        at: usize,
        /// Number that was found.
        found: i32,
        /// Number that was expected.
        wanted: i32,
        /// Hint at the type that the bytes may hold instead.
        hint: &'static str,
    },
    /// A size below zero.
    #[error("{what} whose size is {value}: the message is damaged")]
    Negative {
        /// Vector or matrix.
        what: &'static str,
        /// The size.
        value: i32,
    },
    /// Numbers that do not fill the matrix.
    #[error("{count} numbers for {rows} rows of {columns}: a matrix has as many as fit exactly")]
    Shape {
        /// Rows.
        rows: usize,
        /// Columns.
        columns: usize,
        /// Numbers.
        count: usize,
    },
    /// Larger than a message may be.
    #[error("{what} of {length} bytes, the limit is {limit}: raise Limits::max_message_bytes")]
    TooLong {
        /// Vector or matrix.
        what: &'static str,
        /// Bytes of header and numbers.
        length: usize,
        /// [`Limits::max_message_bytes`].
        limit: usize,
    },
    /// A size that 31 bits cannot say.
    #[error("{what} of {value} cannot be written: YARP's sizes end at {max}", max = i32::MAX)]
    Unwritable {
        /// Vector or matrix.
        what: &'static str,
        /// Numbers, rows or columns.
        value: usize,
    },
    /// A vector of float32, which YARP 3 cannot send.
    #[error("dialect v3 has no vectors of float32: send float64, or set dialect v4")]
    NoFloat32,
}

/// Numbers that vectors are made of: `i32`, `f64`, and `f32` in YARP 4.
pub trait Number: sealed::Sealed + Copy {
    /// Bytes of a number.
    const BYTES: usize;

    /// Code of a list of such numbers.
    #[doc(hidden)]
    fn list_code(dialect: Dialect) -> i32;
    /// All numbers of little-endian bytes.
    #[doc(hidden)]
    fn all(bytes: &[u8]) -> Vec<Self>;
    /// Appends numbers as little-endian bytes.
    #[doc(hidden)]
    fn append(numbers: &[Self], out: &mut Vec<u8>);
    /// True when the dialect can send such vectors.
    #[doc(hidden)]
    fn writable(dialect: Dialect) -> bool;
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for i32 {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

macro_rules! number {
    ($type:ty, $bytes:literal, v3: $v3:literal $(written: $written:literal)?, v4: $v4:literal) => {
        impl Number for $type {
            const BYTES: usize = $bytes;

            fn list_code(dialect: Dialect) -> i32 {
                match dialect {
                    Dialect::V3 => 256 + $v3,
                    Dialect::V4 => 256 + $v4,
                }
            }

            fn all(bytes: &[u8]) -> Vec<Self> {
                let (numbers, _) = bytes.as_chunks::<$bytes>();
                numbers.iter().map(|number| <$type>::from_le_bytes(*number)).collect()
            }

            fn append(numbers: &[Self], out: &mut Vec<u8>) {
                out.reserve(numbers.len() * $bytes);
                for number in numbers {
                    out.extend_from_slice(&number.to_le_bytes());
                }
            }

            fn writable(dialect: Dialect) -> bool {
                let v3 = true $(&& $written)?;
                v3 || dialect == Dialect::V4
            }
        }
    };
}

number!(i32, 4, v3: 1, v4: 1);
number!(f64, 8, v3: 10, v4: 20);
number!(f32, 4, v3: 128 written: false, v4: 10);

/// A vector: YARP's `VectorOf`, and `Vector` where the numbers are `f64`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Vector<T>(pub Vec<T>);

impl<T: Number> Vector<T> {
    /// Reads a vector; what follows it is left alone. As in YARP, numbers of another kind are
    /// refused: read such a message as a bottle.
    ///
    /// # Errors
    /// When the bytes are not a vector of such numbers in that dialect, or exceed `limits`.
    pub fn decode(bytes: &[u8], dialect: Dialect, limits: &Limits) -> Result<Self, VectorError> {
        numbers("a vector", bytes, 0, dialect, limits).map(Self)
    }

    /// The vector as bytes. An empty one is written, but YARP's readers refuse it.
    ///
    /// # Errors
    /// When the dialect lacks such vectors, or the length exceeds 31 bits.
    pub fn encode(&self, dialect: Dialect) -> Result<Vec<u8>, VectorError> {
        let mut out = Vec::with_capacity(VECTOR_HEADER_BYTES + self.0.len() * T::BYTES);
        append("a vector", &self.0, &mut out, dialect)?;
        Ok(out)
    }
}

/// A matrix of `f64`, row by row: YARP's `Matrix`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Matrix {
    rows: usize,
    columns: usize,
    values: Vec<f64>,
}

impl Matrix {
    /// A matrix of its numbers, row by row.
    ///
    /// # Errors
    /// When there are not `rows` x `columns` numbers.
    pub fn new(rows: usize, columns: usize, values: Vec<f64>) -> Result<Self, VectorError> {
        if rows.checked_mul(columns) != Some(values.len()) {
            return Err(VectorError::Shape { rows, columns, count: values.len() });
        }
        Ok(Self { rows, columns, values })
    }

    /// Reads a matrix; what follows it is left alone.
    ///
    /// # Errors
    /// When the bytes are not a matrix in that dialect, or exceed `limits`.
    pub fn decode(bytes: &[u8], dialect: Dialect, limits: &Limits) -> Result<Self, VectorError> {
        const WHAT: &str = "a matrix";
        let Some([list, three, row_tag, rows, column_tag, columns]) = ints(bytes, 0) else {
            let (needed, given) = (MATRIX_HEADER_BYTES, bytes.len());
            return Err(VectorError::Truncated { what: WHAT, needed, given });
        };
        let fixed = [(0, list, 256), (4, three, 3), (8, row_tag, 1), (16, column_tag, 1)];
        for (at, found, wanted) in fixed {
            if found != wanted {
                let hint = "it is something else";
                return Err(VectorError::Other { what: WHAT, at, found, wanted, hint });
            }
        }
        let (rows, columns) = (size(WHAT, rows)?, size(WHAT, columns)?);
        let values = numbers(WHAT, bytes, MATRIX_SIZES_BYTES, dialect, limits)?;
        Self::new(rows, columns, values)
    }

    /// The matrix as bytes.
    ///
    /// # Errors
    /// When a size exceeds 31 bits.
    pub fn encode(&self, dialect: Dialect) -> Result<Vec<u8>, VectorError> {
        let size = |value: usize| {
            i32::try_from(value).ok().ok_or(VectorError::Unwritable { what: "a matrix", value })
        };
        let mut out = Vec::with_capacity(MATRIX_HEADER_BYTES + self.values.len() * f64::BYTES);
        put(&mut out, &[256, 3, 1, size(self.rows)?, 1, size(self.columns)?]);
        append("a matrix", &self.values, &mut out, dialect)?;
        Ok(out)
    }

    /// Rows.
    #[must_use]
    pub const fn rows(&self) -> usize {
        self.rows
    }

    /// Columns.
    #[must_use]
    pub const fn columns(&self) -> usize {
        self.columns
    }

    /// All numbers, row by row.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// The number in a row and column, counted from 0.
    #[must_use]
    pub fn get(&self, row: usize, column: usize) -> Option<f64> {
        if column >= self.columns {
            return None;
        }
        self.values.get(row.checked_mul(self.columns)?.checked_add(column)?).copied()
    }
}

/// A list of numbers of one kind at byte `start`.
fn numbers<T: Number>(
    what: &'static str,
    bytes: &[u8],
    start: usize,
    dialect: Dialect,
    limits: &Limits,
) -> Result<Vec<T>, VectorError> {
    let given = bytes.len();
    let header = start + VECTOR_HEADER_BYTES;
    let Some([found, count]) = ints(bytes, start) else {
        return Err(VectorError::Truncated { what, needed: header, given });
    };
    let wanted = T::list_code(dialect);
    if found != wanted {
        let hint = if found == T::list_code(dialect.other()) {
            match dialect {
                Dialect::V3 => "the sender may speak YARP 4: set dialect v4",
                Dialect::V4 => "the sender may speak YARP 3: set dialect v3",
            }
        } else {
            "numbers of another kind, or something else: read it as a bottle"
        };
        return Err(VectorError::Other { what, at: start, found, wanted, hint });
    }
    let count = size(what, count)?;
    let needed = count.saturating_mul(T::BYTES).saturating_add(header);
    let limit = limits.max_message_bytes;
    if needed > limit {
        return Err(VectorError::TooLong { what, length: needed, limit });
    }
    let numbers = bytes.get(header..needed);
    Ok(T::all(numbers.ok_or(VectorError::Truncated { what, needed, given })?))
}

fn append<T: Number>(
    what: &'static str,
    numbers: &[T],
    out: &mut Vec<u8>,
    dialect: Dialect,
) -> Result<(), VectorError> {
    if !T::writable(dialect) {
        return Err(VectorError::NoFloat32);
    }
    let value = numbers.len();
    let count = i32::try_from(value).ok().ok_or(VectorError::Unwritable { what, value })?;
    put(out, &[T::list_code(dialect), count]);
    T::append(numbers, out);
    Ok(())
}

fn size(what: &'static str, value: i32) -> Result<usize, VectorError> {
    usize::try_from(value).ok().ok_or(VectorError::Negative { what, value })
}
