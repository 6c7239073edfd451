//! Arrays: numbers as [`Tensor`], everything else NumPy can hold as [`NumpyArray`].

use bytes::Bytes;

/// Element type of a [`Tensor`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
#[allow(missing_docs)] // the names are the documentation
pub enum Dtype {
    Bool,
    I8,
    I16,
    I32,
    I64,
    U8,
    U16,
    U32,
    U64,
    F16,
    BF16,
    F32,
    F64,
    C64,
    C128,
}

/// An n-dimensional array of numbers: row-major, little-endian.
///
/// `data.len()` is always `shape.iter().product() * dtype.size()`; [`Tensor::new`] checks it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tensor {
    pub(crate) dtype: Dtype,
    pub(crate) shape: Vec<usize>,
    pub(crate) device: String,
    pub(crate) data: Bytes,
}

/// A NumPy array whose elements are not plain numbers: structured, text, bytes, void,
/// `datetime64`, `timedelta64`, `longdouble`. Carried with its `descr` so that it can be written
/// back exactly.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NumpyArray {
    /// `descr` of the `.npy` header as Python literal, e.g. `'<M8[ns]'` or `[('a', '<i4')]`.
    pub descr: String,
    /// Size of one element in bytes.
    pub itemsize: usize,
    /// Extent of each dimension.
    pub shape: Vec<usize>,
    /// Elements in row-major order, in the byte order that `descr` states.
    pub data: Bytes,
}
