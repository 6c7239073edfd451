//! Column-major elements into row-major ones.

use bytes::Bytes;

/// The elements of a column-major array with this shape in row-major order. Shared where both
/// orders are the same.
pub fn to_row_major(data: Bytes, shape: &[usize], itemsize: usize) -> Bytes {
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
    gather(&data, shape, &strides, itemsize, 0).into()
}

/// The elements of a strided view of `data` in row-major order. Strides and `offset` count bytes;
/// the caller has checked that every element lies in `data`, and that there is one.
pub fn gather(
    data: &[u8],
    shape: &[usize],
    strides: &[usize],
    itemsize: usize,
    offset: usize,
) -> Vec<u8> {
    let bytes = shape.iter().product::<usize>() * itemsize;
    let mut row_major = Vec::with_capacity(bytes);
    copy_axis(data, shape, strides, itemsize, offset, &mut row_major);
    row_major
}

/// The elements of a row-major array whose axes were put into another order: `shape` is the one
/// after that, and its axis `i` was axis `axes[i]` before.
pub(super) fn permute(
    data: &Bytes,
    shape: &[usize],
    axes: &[usize],
    itemsize: usize,
) -> Result<Bytes, String> {
    let not_one = || format!("{axes:?} is no order of {} axes", shape.len());
    let mut before = vec![None; shape.len()];
    for (&axis, &extent) in axes.iter().zip(shape) {
        match before.get_mut(axis) {
            Some(place @ None) => *place = Some(extent),
            _ => return Err(not_one()),
        }
    }
    if axes.len() != shape.len() {
        return Err(not_one());
    }
    if data.is_empty() {
        return Ok(data.clone());
    }
    // `data` holds all elements, so no product of extents overflows.
    let mut next = itemsize;
    let mut strides_before = vec![0; shape.len()];
    for (stride, extent) in strides_before.iter_mut().zip(&before).rev() {
        *stride = next;
        next *= extent.unwrap_or(1);
    }
    let strides: Vec<usize> =
        axes.iter().filter_map(|&axis| strides_before.get(axis).copied()).collect();
    Ok(gather(data, shape, &strides, itemsize, 0).into())
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
    if inner_shape.is_empty() && stride == itemsize {
        out.extend_from_slice(data.get(offset..offset + extent * itemsize).unwrap_or_default());
        return;
    }
    for index in 0..extent {
        copy_axis(data, inner_shape, inner_strides, itemsize, offset + index * stride, out);
    }
}
