//! Column-major elements into row-major ones.

use bytes::Bytes;

/// The elements of a column-major array with this shape in row-major order. Shared where both
/// orders are the same.
pub(crate) fn to_row_major(data: Bytes, shape: &[usize], itemsize: usize) -> Bytes {
    let long_axes = shape.iter().filter(|&&extent| extent != 1).count();
    if long_axes < 2 || data.is_empty() {
        return data;
    }
    // `data` holds all elements, so no product of extents overflows.
    let strides: Vec<usize> = shape
        .iter()
        .scan(itemsize, |next, &extent| {
            let stride = *next;
            *next *= extent;
            Some(stride)
        })
        .collect();
    let mut row_major = Vec::with_capacity(data.len());
    copy_axis(&data, shape, &strides, itemsize, 0, &mut row_major);
    row_major.into()
}

/// Appends everything below one index of the axes before: at most 64 deep, as many as there are
/// dimensions.
fn copy_axis(
    data: &[u8],
    shape: &[usize],
    strides: &[usize],
    itemsize: usize,
    offset: usize,
    out: &mut Vec<u8>,
) {
    let (Some((&extent, inner_shape)), Some((&stride, inner_strides))) =
        (shape.split_first(), strides.split_first())
    else {
        out.extend_from_slice(data.get(offset..offset + itemsize).unwrap_or_default());
        return;
    };
    for index in 0..extent {
        copy_axis(data, inner_shape, inner_strides, itemsize, offset + index * stride, out);
    }
}
