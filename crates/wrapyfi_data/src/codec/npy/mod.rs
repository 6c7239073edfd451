//! NumPy's array file, `.npy`, in which Wrapyfi sends arrays.
//!
//! ```text
//!   93 'NUMPY' │ version │ header length │ header: Python dict, padded to 64 │ elements
//!                                            │                                  │
//!                              descr, order, shape ── checked before ──▶ slice, no copy
//!                                                        (copied only to transpose or swap)
//! ```
//!
//! Never read: pickles (object arrays) and `.npz` archives.

mod header;
mod literal;
mod transpose;

use std::borrow::Cow;

use bytes::Bytes;

use super::{DecodeError, Path};
use crate::types::{Dtype, NumpyArray, Tensor, element_count, swap_byte_order};

pub use transpose::{gather, to_row_major};

/// Array of a `.npy` file.
///
/// ```
/// use wrapyfi_data::codec::npy::{self, NpyArray};
/// use wrapyfi_data::types::Tensor;
/// let tensor = Tensor::from_elements(&[2], vec![1.0_f32, 2.0])?;
/// let file = npy::write(&tensor).into();
/// match npy::read(&file)? {
///     NpyArray::Tensor(read) => assert_eq!(read, tensor),
///     NpyArray::Array(other) => panic!("elements {}", other.descr),
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NpyArray {
    /// Plain numbers, row-major and little-endian whatever the file's order was.
    Tensor(Tensor),
    /// Elements of any other kind, row-major, in the byte order that `descr` states.
    Array(NumpyArray),
}

/// Reads a `.npy` file of version 1, 2 or 3. Bytes behind the elements are ignored, as NumPy does.
/// The result shares the bytes of `file` unless elements have to be reordered.
///
/// # Errors
/// When `file` is not a `.npy` file, is shorter than its header says, or holds Python objects.
pub fn read(file: &Bytes) -> Result<NpyArray, DecodeError> {
    read_at(file, &Path::Root)
}

/// As [`read`], with errors that name the place of the file in a larger object.
pub(super) fn read_at(file: &Bytes, path: &Path<'_>) -> Result<NpyArray, DecodeError> {
    read_file(file).map_err(|reason| DecodeError::Malformed {
        format: "npy",
        path: path.to_string(),
        reason,
    })
}

fn read_file(file: &Bytes) -> Result<NpyArray, String> {
    let (text, offset) = header::split(file)?;
    let header = literal::parse_header(&text)?;
    let itemsize = header.descr.itemsize;
    let wanted = element_count(&header.shape)
        .and_then(|count| count.checked_mul(itemsize))
        .ok_or_else(|| format!("shape {:?} is larger than memory can be", header.shape))?;
    let end = offset.checked_add(wanted).filter(|&end| end <= file.len()).ok_or_else(|| {
        format!(
            "shape {:?} of {} needs {wanted} bytes, {} follow the header",
            header.shape,
            header.descr_text,
            file.len().saturating_sub(offset)
        )
    })?;
    let order = if header.fortran_order { Order::ColumnMajor } else { Order::RowMajor };
    build(header.descr, header.descr_text, header.shape, &order, file.slice(offset..end))
}

/// Order in which the elements of an array lie.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Order {
    /// The last index counts fastest.
    RowMajor,
    /// The first index counts fastest.
    ColumnMajor,
    /// Row-major before the axes were put into another order: axis `i` was axis `axes[i]`.
    Permuted(Vec<usize>),
}

/// Makes an array of its `descr`, its shape and its elements. Shares `data` unless elements have to
/// be reordered.
///
/// # Errors
/// When the `descr` is not known, or `data` is not as long as `shape` says.
pub fn from_parts(
    descr: &str,
    shape: Vec<usize>,
    order: &Order,
    data: Bytes,
) -> Result<NpyArray, String> {
    if shape.len() > literal::MAX_DIMENSIONS {
        let limit = literal::MAX_DIMENSIONS;
        return Err(format!("{} dimensions, the limit is {limit}", shape.len()));
    }
    let parsed = literal::parse_descr(descr)?;
    let wanted = element_count(&shape).and_then(|count| count.checked_mul(parsed.itemsize));
    if wanted != Some(data.len()) {
        let wanted =
            wanted.map_or("more memory than there can be".into(), |w| format!("{w} bytes"));
        return Err(format!("shape {shape:?} of {descr} needs {wanted}, {} came", data.len()));
    }
    build(parsed, descr.to_owned(), shape, order, data)
}

/// Size in bytes of one element of this `descr`.
///
/// # Errors
/// When the `descr` is not known.
pub fn itemsize(descr: &str) -> Result<usize, String> {
    literal::parse_descr(descr).map(|descr| descr.itemsize)
}

/// Makes the array; the caller has checked that `data` is as long as `shape` says.
fn build(
    descr: literal::Descr,
    descr_text: String,
    shape: Vec<usize>,
    order: &Order,
    mut data: Bytes,
) -> Result<NpyArray, String> {
    let literal::Descr { itemsize, number } = descr;
    match order {
        Order::RowMajor => {}
        Order::ColumnMajor => data = transpose::to_row_major(data, &shape, itemsize),
        Order::Permuted(axes) => data = transpose::permute(&data, &shape, axes, itemsize)?,
    }
    let array = if let Some((dtype, big_endian)) = number {
        if big_endian && dtype.scalar_size() > 1 {
            let mut swapped = data.to_vec();
            swap_byte_order(&mut swapped, dtype.scalar_size());
            data = swapped.into();
        }
        Tensor::new(dtype, shape, data).map(NpyArray::Tensor)
    } else {
        NumpyArray::new(descr_text, itemsize, shape, data).map(NpyArray::Array)
    };
    array.map_err(|error| error.to_string())
}

/// Writes a tensor as NumPy's `save` does. `bfloat16`, which NumPy does not know, is written as
/// `float32`, which holds every value of it.
pub fn write(tensor: &Tensor) -> Vec<u8> {
    let (header, data) = parts(tensor);
    [header, data.into_owned()].concat()
}

/// Writes any other array as NumPy's `save` does.
pub fn write_array(array: &NumpyArray) -> Vec<u8> {
    [&*array_header(array), &*array.data].concat()
}

/// Header and elements of a file, for writers that encode them on the way.
pub(super) fn parts(tensor: &Tensor) -> (Vec<u8>, Cow<'_, [u8]>) {
    match tensor.dtype.npy_descr() {
        Some(descr) => {
            (header::write(&format!("'{descr}'"), &tensor.shape), Cow::Borrowed(&*tensor.data))
        }
        None => (header::write("'<f4'", &tensor.shape), Cow::Owned(bfloat16_to_float32(tensor))),
    }
}

/// Header and elements of a file, for writers that keep them; the elements are shared.
pub fn shared_parts(tensor: &Tensor) -> (Vec<u8>, Bytes) {
    match parts(tensor) {
        (header, Cow::Borrowed(_)) => (header, tensor.data.clone()),
        (header, Cow::Owned(data)) => (header, data.into()),
    }
}

/// Header of a file of elements `code`, for instance `<i4`, in row-major order.
pub fn header_for(code: &str, shape: &[usize]) -> Vec<u8> {
    header::write(&format!("'{code}'"), shape)
}

/// Header of a file, for writers that encode the elements on the way.
pub(super) fn array_header(array: &NumpyArray) -> Vec<u8> {
    header::write(&array.descr, &array.shape)
}

fn bfloat16_to_float32(tensor: &Tensor) -> Vec<u8> {
    debug_assert_eq!(tensor.dtype, Dtype::BF16);
    let (elements, _) = tensor.data.as_chunks::<2>();
    // A bfloat16 is the upper half of a float32.
    elements.iter().flat_map(|&[low, high]| [0, 0, low, high]).collect()
}

#[cfg(test)]
mod tests;
