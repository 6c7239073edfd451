//! Rust types that can be elements of a tensor, and their bytes.

use std::borrow::Cow;

use bytes::Bytes;
use half::{bf16, f16};
use zerocopy::{IntoBytes, TryFromBytes};

use super::dtype::Dtype;

/// A Rust type that is an element of a [`super::Tensor`]: the numbers, `bool`, `half::f16`,
/// `half::bf16`, and `[f32; 2]`, `[f64; 2]` (real, imaginary) for complex numbers.
///
/// Sealed: the list of [`Dtype`]s is closed.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{Dtype, Element, ShapeError, Tensor};
///
/// fn row<T: Element>(elements: Vec<T>) -> Result<Tensor, ShapeError> {
///     Tensor::from_elements(&[1, elements.len()], elements)
/// }
///
/// assert_eq!(row(vec![0.5_f64, 1.5])?.dtype(), Dtype::F64);
/// assert_eq!(<u8 as Element>::DTYPE, Dtype::U8);
/// # Ok::<(), ShapeError>(())
/// ```
pub trait Element: sealed::Sealed + Copy + Send + Sync + 'static {
    /// Element type of the Rust type.
    const DTYPE: Dtype;
}

mod sealed {
    use zerocopy::{Immutable, IntoBytes, TryFromBytes};

    pub trait Sealed: TryFromBytes + IntoBytes + Immutable {}
}

macro_rules! elements {
    ($($rust:ty => $dtype:ident,)*) => {$(
        impl Element for $rust {
            const DTYPE: Dtype = Dtype::$dtype;
        }
        impl sealed::Sealed for $rust {}
    )*};
}

elements! {
    bool => Bool, [f32; 2] => C64, [f64; 2] => C128,
    i8 => I8, i16 => I16, i32 => I32, i64 => I64,
    u8 => U8, u16 => U16, u32 => U32, u64 => U64,
    f16 => F16, bf16 => BF16, f32 => F32, f64 => F64,
}

/// Elements in place; `None` when they are unaligned or no valid `bool`s, or when this machine is
/// big-endian.
pub(super) fn from_bytes<T: Element>(bytes: &[u8]) -> Option<&[T]> {
    if cfg!(target_endian = "big") && T::DTYPE.scalar_size() > 1 {
        return None;
    }
    <[T]>::try_ref_from_bytes(bytes).ok()
}

/// Copies the elements. Bytes left over at the end are dropped.
pub(super) fn copy_from_bytes<T: Element>(bytes: &[u8]) -> Vec<T> {
    if let Some(elements) = from_bytes(bytes) {
        return elements.to_vec();
    }
    let mut bytes = Cow::Borrowed(bytes);
    if cfg!(target_endian = "big") {
        swap_byte_order(bytes.to_mut(), T::DTYPE.scalar_size());
    }
    // A byte that is no `bool` of Rust is `true`, as in NumPy.
    let read = |element| T::try_read_from_bytes(element).or_else(|_| T::try_read_from_bytes(&[1]));
    bytes.chunks_exact(T::DTYPE.size()).filter_map(|element| read(element).ok()).collect()
}

/// Bytes of `elements`, little-endian, without a copy on little-endian machines.
pub fn into_bytes<T: Element>(elements: Vec<T>) -> Bytes {
    struct Owner<T>(Vec<T>);
    impl<T: Element> AsRef<[u8]> for Owner<T> {
        fn as_ref(&self) -> &[u8] {
            self.0.as_bytes()
        }
    }
    if cfg!(target_endian = "big") {
        let mut bytes = elements.as_bytes().to_vec();
        swap_byte_order(&mut bytes, T::DTYPE.scalar_size());
        return bytes.into();
    }
    Bytes::from_owner(Owner(elements))
}

/// Turns big-endian scalars of `width` bytes into little-endian ones and back.
pub fn swap_byte_order(bytes: &mut [u8], width: usize) {
    if width > 1 {
        bytes.chunks_exact_mut(width).for_each(<[u8]>::reverse);
    }
}
