//! Tensors from the arrays of `ndarray`, and as these, with feature `ndarray`.

use ndarray::{Array, ArrayBase, ArrayD, ArrayViewD, Data, Dimension, IxDyn};

use super::Tensor;
use crate::types::element::{self, Element};

impl Tensor {
    /// An array with the elements and the shape of `array`, copied into row-major order.
    pub fn from_ndarray<T, S, D>(array: &ArrayBase<S, D>) -> Self
    where
        T: Element,
        S: Data<Elem = T>,
        D: Dimension,
    {
        let elements: Vec<T> = array.iter().copied().collect();
        Self::unchecked(T::DTYPE, array.shape().to_vec(), element::into_bytes(elements))
    }

    /// An array that takes over the elements of `array`: shared where they lie in row-major order,
    /// else copied into it. `array.into()` does the same.
    ///
    /// ```
    /// # mod wrapyfi_core { pub use wrapyfi_data::types; }
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
        // A part of a larger array keeps all its memory alive, but shows its own elements only.
        let begin = first.unwrap_or_default() * size_of::<T>();
        let data = element::into_bytes(elements).slice(begin..begin + count * size_of::<T>());
        Self::unchecked(T::DTYPE, shape, data)
    }

    /// The elements in place. `None` when `T` is not the element type, when the bytes do not lie
    /// aligned for `T`, or when a `bool` is neither 0 nor 1: [`Tensor::to_ndarray`] copies.
    pub fn view<T: Element>(&self) -> Option<ArrayViewD<'_, T>> {
        let elements = self.as_slice()?;
        ArrayViewD::from_shape(IxDyn(&self.shape), elements).ok()
    }

    /// A copy as an `ndarray`. `None` when `T` is not the element type.
    pub fn to_ndarray<T: Element>(&self) -> Option<ArrayD<T>> {
        ArrayD::from_shape_vec(IxDyn(&self.shape), self.to_vec()?).ok()
    }
}

impl<T: Element, D: Dimension> From<Array<T, D>> for Tensor {
    fn from(array: Array<T, D>) -> Self {
        Self::from_ndarray_owned(array)
    }
}

#[cfg(test)]
mod tests {
    use bytes::Bytes;

    use super::*;
    use crate::types::Dtype;

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

        // This part begins behind the first element of the array.
        let part = copy.clone().slice_move(ndarray::s![1, 1.., ..]);
        let before = part.as_ptr();
        let tensor = Tensor::from(part);
        assert_eq!((tensor.shape(), tensor.data().len()), (&[2, 4][..], 32));
        assert_eq!(tensor.view::<f32>().unwrap().as_ptr(), before);
        assert_eq!(tensor.as_slice::<f32>().unwrap()[0], 110.0);

        // Elements in another order are copied.
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
