//! Arrays: `.zarray`, and chunks into their places.
//!
//! ```text
//!   shape (3, 5), chunks (2, 3):   0.0 │ 0.1     every chunk is whole: what lies beyond the edges
//!                                  ────┼────     is padding
//!                                  1.0 │ 1.1
//! ```

use bytes::Bytes;
use serde_json::json;

use super::chunk::{Compressor, Fault, unknown};
use super::store::Store;
use crate::malformed;
use wrapyfi_data::Limits;
use wrapyfi_data::codec::{json, npy};
use wrapyfi_data::plugin::{PluginError, Plugins};
use wrapyfi_data::types::{Dtype, NumpyArray, Tensor, Value, element_count, swap_byte_order};

/// Most bytes of a `.zarray`: it has a handful of members.
const MAX_METADATA: usize = 1 << 16;
/// Most dimensions an array may have, as in NumPy.
const MAX_DIMENSIONS: usize = 64;

/// `.zarray`, understood.
struct Metadata {
    shape: Vec<usize>,
    chunks: Vec<usize>,
    /// As in a `.npy` header: `<i4`.
    dtype: String,
    itemsize: usize,
    column_major: bool,
    separator: char,
    compressor: Compressor,
    /// One element, in the byte order of `dtype`; empty for zeros.
    fill: Vec<u8>,
}

impl Store<'_> {
    /// The array in the folder `path`, empty or ending in `/`.
    pub(super) fn array(&self, path: &str) -> Result<Value, PluginError> {
        let name = format!("{path}.zarray");
        let file = self.read(&name)?.ok_or_else(|| self.missing_file(path, ".zarray"))?;
        let metadata = Metadata::read(&file, self.context.limits).map_err(|error| match error {
            PluginError::Malformed { reason, .. } => malformed(format!("{name}: {reason}")),
            other => other,
        })?;
        self.fill(path, &metadata)
    }

    fn fill(&self, path: &str, metadata: &Metadata) -> Result<Value, PluginError> {
        let Metadata { shape, itemsize, fill, .. } = metadata;
        let (array, chunk) = metadata.sizes()?;
        let what = || format!("the zarr array {path:?} of shape {shape:?}");
        self.context.unpack(what(), array as u64)?;
        let limit = self.context.limits.message_bytes;
        if chunk > limit {
            let what = format!("a chunk {:?} of a zarr array", metadata.chunks);
            return Err(PluginError::too_large(what, chunk, limit));
        }
        // The elements follow a `.npy` header, so that they are read like any array.
        let mut file = npy::header_for(&metadata.dtype, shape);
        let start = file.len();
        file.resize(start + array, 0);
        let elements = file.get_mut(start..).unwrap_or_default();
        if !fill.is_empty() {
            elements.chunks_exact_mut(*itemsize).for_each(|element| element.copy_from_slice(fill));
        }
        let mut unpacked = 0_usize;
        for (name, _) in self.archive.iter() {
            let Some(index) = name.strip_prefix(path).filter(|name| !name.starts_with('.')) else {
                continue;
            };
            let origin = metadata
                .place(index)
                .map_err(|reason| malformed(format!("zip member {name:?}: {reason}")))?;
            // Padding counts too, or a small file could unpack to any amount of it.
            let before = unpacked.max(array);
            unpacked = unpacked.saturating_add(chunk);
            self.context.unpack(what(), (unpacked.max(array) - before) as u64)?;
            let Some(packed) = self.read(name)? else { continue };
            let data = metadata.compressor.unpack(&packed, chunk).map_err(|fault| match fault {
                Fault::Broken(reason) => malformed(format!("zip member {name:?}: {reason}")),
                Fault::Unknown(what) => unknown(&what),
            })?;
            metadata.put(data, &origin, elements);
        }
        match npy::read(&file.into()).map_err(malformed)? {
            npy::NpyArray::Tensor(tensor) => Ok(tensor.into()),
            npy::NpyArray::Array(array) => Ok(array.into()),
        }
    }
}

impl Metadata {
    fn read(file: &Bytes, limits: &Limits) -> Result<Self, PluginError> {
        if file.len() > MAX_METADATA {
            return Err(PluginError::too_large(".zarray", file.len(), MAX_METADATA));
        }
        let limits = Limits { message_bytes: MAX_METADATA, ..*limits };
        let text = json::decode(file, &limits, &Plugins::none()).map_err(malformed)?;
        let member = |name: &str| text.get(name).filter(|member| **member != Value::Null);
        if member("zarr_format").and_then(Value::as_i64) != Some(2) {
            return Err(malformed("$.zarr_format is not 2"));
        }
        if member("filters").is_some_and(|filters| filters.as_items() != Some(&[])) {
            return Err(unknown("filters"));
        }
        let (shape, chunks) = (extents(&text, "shape")?, extents(&text, "chunks")?);
        if shape.len() != chunks.len() {
            let reason = format!("shape {shape:?} and chunks {chunks:?} differ in dimensions");
            return Err(malformed(reason));
        }
        if chunks.contains(&0) {
            return Err(malformed(format!("chunks {chunks:?} are empty")));
        }
        let column_major = match member("order").and_then(Value::as_str) {
            Some("C") => false,
            Some("F") => true,
            _ => return Err(malformed("$.order is neither C nor F")),
        };
        let separator = match member("dimension_separator").map(Value::as_str) {
            None | Some(Some(".")) => '.',
            Some(Some("/")) => '/',
            _ => return Err(malformed("$.dimension_separator is neither . nor /")),
        };
        let dtype = member("dtype").and_then(Value::as_str).ok_or_else(|| {
            let remedy = "use numbers or text";
            PluginError::unsupported("a structured zarr array", remedy)
        })?;
        let (itemsize, number) = element(dtype)?;
        let fill = fill_bytes(member("fill_value"), dtype, itemsize, number)?;
        let compressor = Compressor::from_metadata(member("compressor"))?;
        let dtype = dtype.to_owned();
        Ok(Self { shape, chunks, dtype, itemsize, column_major, separator, compressor, fill })
    }

    /// Bytes of the array and of one chunk.
    fn sizes(&self) -> Result<(usize, usize), PluginError> {
        let bytes = |what: &str, shape: &[usize]| {
            let bytes = element_count(shape).and_then(|count| count.checked_mul(self.itemsize));
            bytes.ok_or_else(|| malformed(format!("{what} {shape:?} is larger than memory can be")))
        };
        Ok((bytes("shape", &self.shape)?, bytes("a chunk", &self.chunks)?))
    }

    /// Indices of the first element of the chunk with this name.
    fn place(&self, name: &str) -> Result<Vec<usize>, String> {
        if self.shape.is_empty() {
            let found = name == "0";
            return found
                .then(Vec::new)
                .ok_or_else(|| "it is no chunk: there is only \"0\"".into());
        }
        let mut parts = name.split(self.separator);
        let place = self.shape.iter().zip(&self.chunks).map(|(&extent, &chunk)| {
            let part = parts.next()?;
            // As zarr writes it: another spelling would be the same chunk twice.
            let canonical =
                part.bytes().all(|c| c.is_ascii_digit()) && (part == "0" || !part.starts_with('0'));
            let index: usize = part.parse().ok().filter(|_| canonical)?;
            index.checked_mul(chunk).filter(|&first| first < extent)
        });
        let place: Option<Vec<usize>> = place.collect();
        place.filter(|_| parts.next().is_none()).ok_or_else(|| {
            format!("it is no chunk of shape {:?} in chunks {:?}", self.shape, self.chunks)
        })
    }

    /// Puts a chunk into its place of the array's `elements`.
    fn put(&self, chunk: Bytes, origin: &[usize], elements: &mut [u8]) {
        let chunk = if self.column_major {
            npy::to_row_major(chunk, &self.chunks, self.itemsize)
        } else {
            chunk
        };
        let axes: Vec<Axis> = {
            let (mut in_chunk, mut in_array) = (self.itemsize, self.itemsize);
            let extents = self.chunks.iter().zip(&self.shape).zip(origin).rev();
            let mut axes: Vec<_> = extents
                .map(|((&chunk, &whole), &first)| {
                    let axis = Axis { count: chunk.min(whole - first), first, in_chunk, in_array };
                    in_chunk *= chunk;
                    in_array *= whole;
                    axis
                })
                .collect();
            axes.reverse();
            axes
        };
        let start = axes.iter().map(|axis| axis.first * axis.in_array).sum();
        copy(&chunk, 0, elements, start, &axes, self.itemsize);
    }
}

/// One dimension of a chunk in its array; strides in bytes.
struct Axis {
    count: usize,
    first: usize,
    in_chunk: usize,
    in_array: usize,
}

/// Copies everything below one index of the axes before; row by row along the last one.
fn copy(chunk: &[u8], from: usize, array: &mut [u8], to: usize, axes: &[Axis], itemsize: usize) {
    match axes {
        [] | [_] => {
            let length = axes.first().map_or(1, |axis| axis.count) * itemsize;
            if let (Some(source), Some(target)) =
                (chunk.get(from..from + length), array.get_mut(to..to + length))
            {
                target.copy_from_slice(source);
            }
        }
        [axis, inner @ ..] => {
            for index in 0..axis.count {
                let (from, to) = (from + index * axis.in_chunk, to + index * axis.in_array);
                copy(chunk, from, array, to, inner, itemsize);
            }
        }
    }
}

fn extents(metadata: &Value, name: &str) -> Result<Vec<usize>, PluginError> {
    let extent = |extent: &Value| usize::try_from(extent.as_i64()?).ok();
    let found = metadata.get(name).and_then(Value::as_items);
    let found = found.filter(|extents| extents.len() <= MAX_DIMENSIONS);
    found.and_then(|extents| extents.iter().map(extent).collect()).ok_or_else(|| {
        malformed(format!("$.{name} is no list of at most {MAX_DIMENSIONS} extents from 0 on"))
    })
}

/// Bytes of an element and, of numbers, their type and whether they are big-endian.
fn element(dtype: &str) -> Result<(usize, Option<Dtype>), PluginError> {
    let shown: String = dtype.chars().take(40).collect();
    let plain =
        |c: char| c.is_ascii_alphanumeric() || matches!(c, '<' | '>' | '|' | '=' | '[' | ']');
    if !dtype.chars().all(plain) {
        return Err(malformed(format!("$.dtype {shown:?} is not known")));
    }
    let empty = npy::header_for(dtype, &[0]).into();
    let (itemsize, number) = match npy::read(&empty) {
        Ok(npy::NpyArray::Tensor(tensor)) => (tensor.dtype().size(), Some(tensor.dtype())),
        Ok(npy::NpyArray::Array(array)) => (array.itemsize, None),
        Err(error) => return Err(malformed(format!("$.dtype {shown:?}: {error}"))),
    };
    if itemsize == 0 {
        return Err(malformed(format!("$.dtype {shown:?} has elements of 0 bytes")));
    }
    Ok((itemsize, number))
}

/// One element as `fill_value` says; empty for zeros.
fn fill_bytes(
    fill: Option<&Value>,
    dtype: &str,
    itemsize: usize,
    number: Option<Dtype>,
) -> Result<Vec<u8>, PluginError> {
    let Some(fill) = fill else { return Ok(Vec::new()) };
    let refuse = || malformed(format!("$.fill_value is no {dtype} that is read here"));
    let Some(number) = number else {
        // Text and times rarely have another fill value than 0 or "", and its form depends on the
        // type.
        let nothing = matches!(fill, Value::Int(0)) || fill.as_str() == Some("");
        return nothing.then(Vec::new).ok_or_else(refuse);
    };
    let mut element = number_bytes(fill, number).ok_or_else(refuse)?;
    debug_assert_eq!(element.len(), itemsize);
    if dtype.starts_with('>') {
        swap_byte_order(&mut element, number.scalar_size());
    }
    Ok(if element.iter().all(|&byte| byte == 0) { Vec::new() } else { element })
}

/// A number of JSON as an element, little-endian.
// Floats of fewer digits round, as NumPy has them.
fn number_bytes(value: &Value, dtype: Dtype) -> Option<Vec<u8>> {
    let float = || match value.as_str() {
        Some("NaN") => Some(f64::NAN),
        Some("Infinity") => Some(f64::INFINITY),
        Some("-Infinity") => Some(f64::NEG_INFINITY),
        _ => value.as_f64(),
    };
    let pair = || match value.as_items() {
        Some([real, imaginary]) => {
            let part = |value| number_bytes(value, Dtype::F64);
            let part = |value| Some(f64::from_le_bytes(part(value)?.try_into().ok()?));
            Some([part(real)?, part(imaginary)?])
        }
        Some(_) => None,
        None => Some([float()?, 0.0]),
    };
    let whole = || match value {
        Value::Int(whole) => Some(i128::from(*whole)),
        Value::BigInt(whole) => i128::try_from(whole).ok(),
        Value::Float(float) if float.fract() == 0.0 && float.abs() < 9e15 => Some(*float as i128),
        _ => None,
    };
    Some(match dtype {
        Dtype::Bool => vec![u8::from(value.as_bool().or_else(|| Some(whole()? != 0))?)],
        Dtype::I8 => i8::try_from(whole()?).ok()?.to_le_bytes().into(),
        Dtype::I16 => i16::try_from(whole()?).ok()?.to_le_bytes().into(),
        Dtype::I32 => i32::try_from(whole()?).ok()?.to_le_bytes().into(),
        Dtype::I64 => i64::try_from(whole()?).ok()?.to_le_bytes().into(),
        Dtype::U8 => u8::try_from(whole()?).ok()?.to_le_bytes().into(),
        Dtype::U16 => u16::try_from(whole()?).ok()?.to_le_bytes().into(),
        Dtype::U32 => u32::try_from(whole()?).ok()?.to_le_bytes().into(),
        Dtype::U64 => u64::try_from(whole()?).ok()?.to_le_bytes().into(),
        Dtype::F16 => half::f16::from_f64(float()?).to_le_bytes().into(),
        Dtype::BF16 => half::bf16::from_f64(float()?).to_le_bytes().into(),
        Dtype::F32 => (float()? as f32).to_le_bytes().into(),
        Dtype::F64 => float()?.to_le_bytes().into(),
        Dtype::C64 => pair()?.iter().flat_map(|&part| (part as f32).to_le_bytes()).collect(),
        Dtype::C128 => pair()?.iter().flat_map(|part| part.to_le_bytes()).collect(),
        _ => return None,
    })
}

/// A file of the folder: its name and its bytes.
pub(super) type File = (String, Bytes);

/// `.zarray` and the one chunk of a tensor; an array without elements has none.
pub(super) fn write(tensor: &Tensor) -> (String, Option<File>) {
    let (header, data) = npy::shared_parts(tensor);
    drop(header);
    // `bfloat16` is written as `float32`, as everywhere.
    let dtype = tensor.dtype().npy_descr().unwrap_or("<f4");
    let fill = match tensor.dtype() {
        Dtype::Bool => json!(false),
        Dtype::F16 | Dtype::BF16 | Dtype::F32 | Dtype::F64 => json!(0.0),
        Dtype::C64 | Dtype::C128 => json!([0.0, 0.0]),
        _ => json!(0),
    };
    whole(tensor.shape(), dtype, &fill, data)
}

/// The same of an array whose elements are no numbers; `None` for structures.
pub(super) fn write_other(array: &NumpyArray) -> Option<(String, Option<File>)> {
    let dtype = array.descr.strip_prefix('\'')?.strip_suffix('\'')?;
    Some(whole(&array.shape, dtype, &json!(null), array.data.clone()))
}

fn whole(
    shape: &[usize],
    dtype: &str,
    fill: &serde_json::Value,
    data: Bytes,
) -> (String, Option<File>) {
    let chunks: Vec<usize> = shape.iter().map(|&extent| extent.max(1)).collect();
    let metadata = json!({
        "chunks": chunks,
        "compressor": null,
        "dtype": dtype,
        "fill_value": fill,
        "filters": null,
        "order": "C",
        "shape": shape,
        "zarr_format": 2,
    });
    let name = vec!["0"; shape.len().max(1)].join(".");
    (metadata.to_string(), (!data.is_empty()).then_some((name, data)))
}
