//! Arrays: numbers as [`Tensor`], everything else NumPy can hold as [`NumpyArray`].
//!
//! ```text
//!   elements / ndarray ──▶ Tensor { dtype, shape, device, bytes } ──▶ view (no copy, if aligned)
//!   received bytes ──────▶        checked: bytes fit shape         └─▶ to_ndarray (copies)
//! ```

use std::sync::Arc;

use bytes::Bytes;
use ndarray::{Array, ArrayBase, ArrayD, ArrayViewD, Data, Dimension, IxDyn};

use super::Origin;
use super::dtype::Dtype;
use super::element::{self, Element};
use super::shape::{ShapeError, check_length, element_count};

/// An n-dimensional array of numbers: row-major, little-endian.
///
/// `data.len()` is always `shape.iter().product() * dtype.size()`; [`Tensor::new`] checks it.
///
/// ```
/// use wrapyfi_core::types::{Dtype, Tensor};
/// let tensor = Tensor::from_elements(&[2, 2], vec![1.0_f32, 2.0, 3.0, 4.0])?;
/// assert_eq!((tensor.dtype(), tensor.data().len()), (Dtype::F32, 16));
/// assert_eq!(tensor.view::<f32>().unwrap()[[1, 0]], 3.0);
/// # Ok::<(), wrapyfi_core::types::ShapeError>(())
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
        Ok(Self { dtype, shape, device: String::new(), origin: None, data })
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

    /// An array with the elements and the shape of `array`, copied into row-major order.
    pub fn from_ndarray<T, S, D>(array: &ArrayBase<S, D>) -> Self
    where
        T: Element,
        S: Data<Elem = T>,
        D: Dimension,
    {
        let elements: Vec<T> = array.iter().copied().collect();
        Self {
            dtype: T::DTYPE,
            shape: array.shape().to_vec(),
            device: String::new(),
            origin: None,
            data: element::into_bytes(elements),
        }
    }

    /// An array that takes over the elements of `array`: shared where they lie in row-major order,
    /// else copied into it. `array.into()` does the same.
    ///
    /// ```
    /// use wrapyfi_core::types::Tensor;
    /// let array = ndarray::Array2::<f32>::zeros((480, 640));
    /// let before = array.as_ptr();
    /// let tensor = Tensor::from_ndarray_owned(array);
    /// assert_eq!(tensor.view::<f32>().unwrap().as_ptr(), before);
    /// ```
    pub fn from_ndarray_owned<T: Element, D: Dimension>(array: Array<T, D>) -> Self {
        if !array.is_standard_layout() {
            return Self::from_ndarray(&array);
        }
        let (shape, count) = (array.shape().to_vec(), array.len());
        let (elements, first) = array.into_raw_vec_and_offset();
        // A part of a larger array keeps the whole of it, but shows no more than itself.
        let begin = first.unwrap_or_default() * size_of::<T>();
        let data = element::into_bytes(elements).slice(begin..begin + count * size_of::<T>());
        Self { dtype: T::DTYPE, shape, device: String::new(), origin: None, data }
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
    #[must_use]
    pub fn origin(&self) -> Option<&Origin> {
        self.origin.as_deref()
    }

    /// Plug-in key of the library it belongs to; `None` for NumPy.
    #[must_use]
    pub fn framework(&self) -> Option<&str> {
        self.origin().map(|origin| origin.key.as_str())
    }

    /// Element type.
    #[must_use]
    pub fn dtype(&self) -> Dtype {
        self.dtype
    }

    /// Extent of each dimension; empty for a single number.
    #[must_use]
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// Device label; empty for the CPU.
    #[must_use]
    pub fn device(&self) -> &str {
        &self.device
    }

    /// Elements, row-major, little-endian.
    #[must_use]
    pub fn data(&self) -> &Bytes {
        &self.data
    }

    /// Number of elements.
    #[must_use]
    pub fn element_count(&self) -> usize {
        element_count(&self.shape).unwrap_or_default()
    }

    /// The elements in place. `None` when `T` is not the element type, when the bytes do not lie
    /// aligned for `T`, or when a `bool` is neither 0 nor 1: [`Tensor::to_ndarray`] copies.
    #[must_use]
    pub fn view<T: Element>(&self) -> Option<ArrayViewD<'_, T>> {
        let elements = self.as_slice()?;
        ArrayViewD::from_shape(IxDyn(&self.shape), elements).ok()
    }

    /// The elements in place, in row-major order; conditions as for [`Tensor::view`].
    #[must_use]
    pub fn as_slice<T: Element>(&self) -> Option<&[T]> {
        if T::DTYPE != self.dtype { None } else { element::from_bytes(&self.data) }
    }

    /// A copy of the elements in row-major order, however they lie. `None` when `T` is not the
    /// element type.
    #[must_use]
    pub fn to_vec<T: Element>(&self) -> Option<Vec<T>> {
        (T::DTYPE == self.dtype).then(|| element::copy_from_bytes(&self.data))
    }

    /// A copy as an `ndarray`. `None` when `T` is not the element type.
    #[must_use]
    pub fn to_ndarray<T: Element>(&self) -> Option<ArrayD<T>> {
        ArrayD::from_shape_vec(IxDyn(&self.shape), self.to_vec()?).ok()
    }
}

impl<T: Element, D: Dimension> From<Array<T, D>> for Tensor {
    fn from(array: Array<T, D>) -> Self {
        Self::from_ndarray_owned(array)
    }
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

    #[test]
    fn elements_are_seen_in_place_and_copied_when_unaligned() {
        let tensor = Tensor::from_elements(&[3], vec![1.5_f64, -2.0, f64::INFINITY]).unwrap();
        assert_eq!(tensor.as_slice::<f64>().unwrap(), [1.5, -2.0, f64::INFINITY]);
        assert!(tensor.view::<f32>().is_none());

        let mut shifted = vec![0_u8];
        shifted.extend_from_slice(tensor.data());
        let unaligned = Bytes::from(shifted).slice(1..);
        let tensor = Tensor::new(Dtype::F64, [3], unaligned).unwrap();
        let aligned_by_chance = tensor.data().as_ptr().align_offset(8) == 0;
        assert_eq!(tensor.view::<f64>().is_some(), aligned_by_chance);
        assert_eq!(tensor.to_vec::<f64>().unwrap(), [1.5, -2.0, f64::INFINITY]);
    }

    #[test]
    fn a_transposed_ndarray_becomes_row_major() {
        let array = ndarray::arr2(&[[1_i16, 2, 3], [4, 5, 6]]);
        let tensor = Tensor::from_ndarray(&array.t());
        assert_eq!(tensor.shape(), [3, 2]);
        assert_eq!(tensor.to_vec::<i16>().unwrap(), [1, 4, 2, 5, 3, 6]);
        assert_eq!(tensor.to_ndarray::<i16>().unwrap(), array.t().into_dyn());
    }

    #[test]
    fn an_owned_ndarray_is_taken_over_without_a_copy() {
        let array = ndarray::Array3::<f32>::from_shape_fn((2, 3, 4), |(i, j, k)| {
            f32::from(u8::try_from(i * 100 + j * 10 + k).unwrap())
        });
        let (before, copy) = (array.as_ptr(), array.clone());
        let tensor = Tensor::from(array);
        let view = tensor.view::<f32>().unwrap();
        assert_eq!(view.as_ptr(), before);
        assert_eq!(view, copy.view().into_dyn());
        assert_eq!(tensor.clone().view::<f32>().unwrap().as_ptr(), before);

        // A part of it begins behind its first element.
        let part = copy.clone().slice_move(ndarray::s![1, 1.., ..]);
        let before = part.as_ptr();
        let tensor = Tensor::from(part);
        assert_eq!((tensor.shape(), tensor.data().len()), (&[2, 4][..], 32));
        assert_eq!(tensor.view::<f32>().unwrap().as_ptr(), before);
        assert_eq!(tensor.as_slice::<f32>().unwrap()[0], 110.0);

        // Another order is copied.
        for moved in
            [copy.clone().reversed_axes(), copy.clone().slice_move(ndarray::s![..;-1, .., ..])]
        {
            let expected = moved.clone().into_dyn();
            assert_eq!(Tensor::from(moved).to_ndarray::<f32>().unwrap(), expected);
        }
        let empty = Tensor::from(ndarray::Array2::<u16>::zeros((0, 3)));
        assert_eq!((empty.shape(), empty.data().len()), (&[0, 3][..], 0));
        let single = Tensor::from(ndarray::arr0(7_i64));
        assert_eq!((single.shape(), single.as_slice::<i64>()), (&[][..], Some(&[7][..])));
    }

    #[test]
    fn a_bool_is_one_or_zero() {
        let tensor = Tensor::new(Dtype::Bool, [3], vec![0, 1, 7]).unwrap();
        assert!(tensor.view::<bool>().is_none());
        assert_eq!(tensor.to_vec::<bool>().unwrap(), [false, true, true]);
    }
}
