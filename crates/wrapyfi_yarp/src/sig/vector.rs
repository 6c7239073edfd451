//! Vectors and matrices: many numbers of one kind.
//!
//! ```text
//!   vector   266 │ n │ f64 f64 …                       the same bytes as a bottle of n numbers
//!   matrix   256 3 │ 1 rows │ 1 columns │ 266 │ n │ f64 …      row by row
//! ```

use super::error::{SigError, check, size, written};
use super::fields::{ints, put};
use crate::{Dialect, WireLimits};

/// Bytes before the numbers of a vector.
const VECTOR_HEADER_BYTES: usize = 8;
/// Bytes before the numbers of a matrix.
const MATRIX_HEADER_BYTES: usize = 32;
/// Bytes before the vector in a matrix.
const MATRIX_SIZES_BYTES: usize = 24;

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
    pub fn decode(bytes: &[u8], dialect: Dialect, limits: &WireLimits) -> Result<Self, SigError> {
        numbers("a vector", bytes, 0, dialect, limits).map(Self)
    }

    /// The vector as bytes. An empty one is written, but YARP's readers refuse it.
    ///
    /// # Errors
    /// When the dialect lacks such vectors, or the length exceeds 31 bits.
    pub fn encode(&self, dialect: Dialect) -> Result<Vec<u8>, SigError> {
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
    pub fn new(rows: usize, columns: usize, values: Vec<f64>) -> Result<Self, SigError> {
        if rows.checked_mul(columns) != Some(values.len()) {
            let what = format!("{} numbers for {rows} rows of {columns}", values.len());
            return Err(SigError::Unsupported(format!(
                "{what}: a matrix has as many as fit exactly"
            )));
        }
        Ok(Self { rows, columns, values })
    }

    /// Reads a matrix; what follows it is left alone.
    ///
    /// # Errors
    /// When the bytes are not a matrix in that dialect, or exceed `limits`.
    pub fn decode(bytes: &[u8], dialect: Dialect, limits: &WireLimits) -> Result<Self, SigError> {
        const WHAT: &str = "a matrix";
        let Some([list, three, row_tag, rows, column_tag, columns]) = ints(bytes, 0) else {
            let (needed, given) = (MATRIX_HEADER_BYTES, bytes.len());
            return Err(SigError::Truncated { what: WHAT, needed, given });
        };
        let is = |(at, found, wanted)| ("it is something else", at, found, wanted);
        check(WHAT, [(0, list, 256), (4, three, 3), (8, row_tag, 1), (16, column_tag, 1)].map(is))?;
        let (rows, columns) = (size(WHAT, "rows", rows)?, size(WHAT, "columns", columns)?);
        let values = numbers(WHAT, bytes, MATRIX_SIZES_BYTES, dialect, limits)?;
        Self::new(rows, columns, values)
    }

    /// The matrix as bytes.
    ///
    /// # Errors
    /// When a size exceeds 31 bits.
    pub fn encode(&self, dialect: Dialect) -> Result<Vec<u8>, SigError> {
        let mut out = Vec::with_capacity(MATRIX_HEADER_BYTES + self.values.len() * f64::BYTES);
        let size = |part, value| written("a matrix", part, value);
        put(&mut out, &[256, 3, 1, size("rows", self.rows)?, 1, size("columns", self.columns)?]);
        append("a matrix", &self.values, &mut out, dialect)?;
        Ok(out)
    }

    /// Rows.
    pub const fn rows(&self) -> usize {
        self.rows
    }

    /// Columns.
    pub const fn columns(&self) -> usize {
        self.columns
    }

    /// All numbers, row by row.
    pub fn values(&self) -> &[f64] {
        &self.values
    }
}

/// A list of numbers of one kind at byte `start`.
fn numbers<T: Number>(
    what: &'static str,
    bytes: &[u8],
    start: usize,
    dialect: Dialect,
    limits: &WireLimits,
) -> Result<Vec<T>, SigError> {
    let given = bytes.len();
    let header = start + VECTOR_HEADER_BYTES;
    let Some([found, count]) = ints(bytes, start) else {
        return Err(SigError::Truncated { what, needed: header, given });
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
        return Err(SigError::Other { what, part: hint, at: start, found, wanted });
    }
    let count = size(what, "size", count)?;
    let needed = count.saturating_mul(T::BYTES).saturating_add(header);
    let limit = limits.max_message_bytes;
    if needed > limit {
        return Err(SigError::TooLong { what, length: needed, limit });
    }
    let numbers = bytes.get(header..needed);
    Ok(T::all(numbers.ok_or(SigError::Truncated { what, needed, given })?))
}

fn append<T: Number>(
    what: &'static str,
    numbers: &[T],
    out: &mut Vec<u8>,
    dialect: Dialect,
) -> Result<(), SigError> {
    if !T::writable(dialect) {
        let what = "dialect v3 has no vectors of float32: send float64, or set dialect v4";
        return Err(SigError::Unsupported(what.to_owned()));
    }
    put(out, &[T::list_code(dialect), written(what, "size", numbers.len())?]);
    T::append(numbers, out);
    Ok(())
}
