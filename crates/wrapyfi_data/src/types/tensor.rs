//! Arrays: numbers as [`Tensor`], everything else NumPy can hold as [`NumpyArray`].
//!
//! ```text
//!   elements / ndarray ──▶ Tensor { dtype, shape, device, bytes } ──▶ view (no copy, if aligned)
//!   received bytes ──────▶        checked: bytes fit shape         └─▶ to_ndarray (copies)
//! ```

#[cfg(feature = "ndarray")]
mod arrays;

use std::sync::Arc;

use bytes::Bytes;

use super::Origin;
use super::dtype::Dtype;
use super::element::{self, Element};
use super::shape::{ShapeError, check_length, element_count};

/// An n-dimensional array of numbers: row-major, little-endian.
///
/// `data.len()` is always `shape.iter().product() * dtype.size()`; [`Tensor::new`] checks it.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{Dtype, Tensor};
/// let tensor = Tensor::from_elements(&[2, 2], vec![1.0_f32, 2.0, 3.0, 4.0])?;
/// assert_eq!((tensor.dtype(), tensor.data().len()), (Dtype::F32, 16));
/// assert_eq!(tensor.as_slice::<f32>().unwrap()[2], 3.0);
/// # Ok::<(), wrapyfi_data::types::ShapeError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tensor {
    pub(crate) dtype: Dtype,
    pub(crate) shape: Vec<usize>,
    pub(crate) device: String,
    pub(crate) origin: Option<Arc<Origin>>,
    pub(crate) data: Bytes,
}

impl Tensor {
    /// An array over `data`: row-major, little-endian. The bytes are shared, not copied.
    ///
    /// # Errors
    /// When `data` is not exactly as long as `shape` and `dtype` ask for.
    pub fn new(
        dtype: Dtype,
        shape: impl Into<Vec<usize>>,
        data: impl Into<Bytes>,
    ) -> Result<Self, ShapeError> {
        let (shape, data) = (shape.into(), data.into());
        check_length(&shape, dtype.size(), data.len(), || format!("{dtype} array {shape:?}"))?;
        Ok(Self::unchecked(dtype, shape, data))
    }

    /// A tensor whose data are known to fit its shape.
    pub(crate) fn unchecked(dtype: Dtype, shape: Vec<usize>, data: Bytes) -> Self {
        Self { dtype, shape, device: String::new(), origin: None, data }
    }

    /// An array that takes over `elements` in row-major order.
    ///
    /// # Errors
    /// When `shape` does not hold exactly that many elements.
    pub fn from_elements<T: Element>(
        shape: &[usize],
        elements: Vec<T>,
    ) -> Result<Self, ShapeError> {
        Self::new(T::DTYPE, shape, element::into_bytes(elements))
    }

    /// The same array labelled with the device it came from or shall go to, for instance `cuda:0`.
    #[must_use]
    pub fn with_device(mut self, device: impl Into<String>) -> Self {
        self.device = device.into();
        self
    }

    /// The same array as an object of a library: `PytorchTensor`, `JAXTensor`, … Without an origin
    /// it is NumPy's.
    #[must_use]
    pub fn with_origin(mut self, origin: impl Into<Arc<Origin>>) -> Self {
        self.origin = Some(origin.into());
        self
    }

    /// The library object it was or shall become; `None` for NumPy's array.
    pub fn origin(&self) -> Option<&Origin> {
        self.origin.as_deref()
    }

    /// Plug-in key of the library whose tensor this was; `None` for NumPy.
    pub fn framework(&self) -> Option<&str> {
        self.origin().map(|origin| origin.key.as_str())
    }

    /// Element type.
    pub fn dtype(&self) -> Dtype {
        self.dtype
    }

    /// Extent of each dimension; empty for a single number.
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// Device label; empty for the CPU.
    pub fn device(&self) -> &str {
        &self.device
    }

    /// Elements, row-major, little-endian.
    pub fn data(&self) -> &Bytes {
        &self.data
    }

    /// Number of elements.
    pub fn element_count(&self) -> usize {
        element_count(&self.shape).unwrap_or_default()
    }

    /// The elements in place, in row-major order; conditions as for `Tensor::view`, with the feature `ndarray`.
    pub fn as_slice<T: Element>(&self) -> Option<&[T]> {
        if T::DTYPE != self.dtype { None } else { element::from_bytes(&self.data) }
    }

    /// A copy of the elements in row-major order, however they lie. `None` when `T` is not the
    /// element type.
    pub fn to_vec<T: Element>(&self) -> Option<Vec<T>> {
        (T::DTYPE == self.dtype).then(|| element::copy_from_bytes(&self.data))
    }
}

/// A NumPy array whose elements are not plain numbers: structured, text, bytes, void,
/// `datetime64`, `timedelta64`, `longdouble`. Carried with its `descr` so that it can be written
/// back exactly.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{NumpyArray, Value};
/// // numpy.array(["1970-01-02"], "datetime64[D]")
/// let dates = NumpyArray::new("'<M8[D]'", 8, [1], 1_i64.to_le_bytes().to_vec())?;
/// assert_eq!(Value::from(dates).kind(), "numpy.ndarray");
/// # Ok::<(), wrapyfi_data::types::ShapeError>(())
/// ```
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

impl NumpyArray {
    /// An array over `data`.
    ///
    /// # Errors
    /// When `data` is not exactly as long as `shape` and `itemsize` ask for.
    pub fn new(
        descr: impl Into<String>,
        itemsize: usize,
        shape: impl Into<Vec<usize>>,
        data: impl Into<Bytes>,
    ) -> Result<Self, ShapeError> {
        let (descr, shape, data) = (descr.into(), shape.into(), data.into());
        check_length(&shape, itemsize, data.len(), || format!("{descr} array {shape:?}"))?;
        Ok(Self { descr, itemsize, shape, data })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_must_fit_the_shape() {
        let error = Tensor::new(Dtype::F32, [2, 3], vec![0; 20]).unwrap_err();
        assert_eq!(error.to_string(), "float32 array [2, 3] needs 24 bytes, 20 are there");
        let error = Tensor::new(Dtype::F32, [usize::MAX, 3], vec![0; 20]).unwrap_err();
        assert!(matches!(error, ShapeError::Overflow { .. }), "{error}");
        assert_eq!(Tensor::new(Dtype::C128, [usize::MAX, 0], vec![]).unwrap().element_count(), 0);
        assert_eq!(Tensor::new(Dtype::I64, [], vec![7; 8]).unwrap().element_count(), 1);
    }
}
