//! Arrays as NumPy pickles them. Names of modules are those of NumPy 1, which NumPy 2 still knows.

use bytes::Bytes;

use super::super::npy;
use super::write::Writer;
use crate::types::{Dtype, NumpyArray, Tensor};

impl Writer {
    /// A `numpy.ndarray` with its elements in the pickle. `bfloat16`, which NumPy does not know,
    /// becomes `float32`. The device label is left out.
    pub fn array(&mut self, tensor: &Tensor) {
        let (_, elements) = npy::parts(tensor);
        self.reconstruct(&tensor.shape, |w| w.dtype(tensor.dtype), &elements);
    }

    /// A `numpy.ndarray` with its elements beside the pickle, without a copy; in the pickle before
    /// protocol 5.
    pub fn array_beside(&mut self, tensor: &Tensor) {
        let elements = match tensor.dtype {
            Dtype::BF16 => npy::parts(tensor).1.into_owned().into(),
            _ => tensor.data.clone(),
        };
        let descr = format!("'{}'", tensor.dtype.npy_descr().unwrap_or("<f4"));
        self.described_beside(&descr, &tensor.shape, elements);
    }

    /// A `numpy.ndarray` of elements beside the pickle, by their `descr`: `'<M8[ns]'`.
    pub(crate) fn described_beside(&mut self, descr: &str, shape: &[usize], elements: Bytes) {
        self.call("numpy.core.numeric", "_frombuffer", |args| {
            args.buffer(elements);
            args.described(descr);
            args.shape(shape);
            args.str("C");
        });
    }

    /// Writes any other array with elements of a fixed size into the pickle. Structured elements
    /// cannot be written.
    pub fn other_array(&mut self, array: &NumpyArray) {
        self.reconstruct(&array.shape, |w| w.described(&array.descr), &array.data);
    }

    /// A `numpy.ndarray` of Python objects: as many as the shape says, row-major.
    pub fn object_array(&mut self, shape: &[usize], items: impl FnOnce(&mut Self)) {
        self.empty_array();
        self.state(|state| {
            state.tuple(|parts| {
                parts.int(1);
                parts.shape(shape);
                parts.described("'|O8'");
                parts.bool(false);
                parts.list(items);
            });
        });
    }

    /// A `numpy.dtype`, little-endian; `float32` for `bfloat16`.
    pub fn dtype(&mut self, dtype: Dtype) {
        // Every other type has a code.
        self.described(&format!("'{}'", dtype.npy_descr().unwrap_or("<f4")));
    }

    /// A `tuple` of extents.
    pub fn shape(&mut self, shape: &[usize]) {
        self.tuple(|extents| shape.iter().for_each(|&extent| extents.size(extent)));
    }

    fn empty_array(&mut self) {
        self.call("numpy.core.multiarray", "_reconstruct", |args| {
            args.global("numpy", "ndarray");
            args.shape(&[0]);
            args.bytes(b"b");
        });
    }

    fn reconstruct(&mut self, shape: &[usize], dtype: impl FnOnce(&mut Self), elements: &[u8]) {
        self.empty_array();
        self.state(|state| {
            state.tuple(|parts| {
                parts.int(1);
                parts.shape(shape);
                dtype(parts);
                parts.bool(false);
                parts.bytes(elements);
            });
        });
    }

    /// A `numpy.dtype` by its `descr`: `'<f4'`, `'<U5'`, `'<M8[ns]'`.
    fn described(&mut self, descr: &str) {
        let Some(code) = Code::parse(descr) else {
            let what = format!("elements of type {descr}");
            return self.fail(what, "send one array for each member of the structure");
        };
        let Code { order, kind, size, unit } = code;
        self.call("numpy", "dtype", |args| {
            args.str(&format!("{kind}{size}"));
            args.bool(false);
            args.bool(true);
        });
        // What NumPy itself writes: size and alignment only where the code leaves them open.
        let (bytes, alignment, flags) = match kind {
            'S' | 'a' | 'V' => (Some(size), 1, 0),
            'U' => (Some(size.saturating_mul(4)), 4, 8),
            'O' => (None, -1, 63),
            _ => (None, -1, 0),
        };
        self.state(|state| {
            state.tuple(|parts| {
                parts.int(if unit.is_some() { 4 } else { 3 });
                parts.str(order);
                parts.none();
                parts.none();
                parts.none();
                match bytes {
                    Some(bytes) => parts.size(bytes),
                    None => parts.int(-1),
                }
                parts.int(alignment);
                parts.int(flags);
                if let Some((name, count)) = unit {
                    parts.tuple(|metadata| {
                        metadata.dict(|_| {});
                        metadata.tuple(|unit| {
                            unit.bytes(name.as_bytes());
                            unit.size(count);
                            unit.int(1);
                            unit.int(1);
                        });
                    });
                }
            });
        });
    }
}

/// A simple `descr`, taken apart.
struct Code<'a> {
    order: &'a str,
    kind: char,
    size: usize,
    /// Name and count of the unit of a time.
    unit: Option<(&'a str, usize)>,
}

impl<'a> Code<'a> {
    fn parse(descr: &'a str) -> Option<Self> {
        let code = descr.trim_matches(['\'', '"']);
        let (order, rest) = code.split_at_checked(1)?;
        if !matches!(order, "<" | ">" | "|") {
            return None;
        }
        let kind = rest.chars().next().filter(char::is_ascii_alphabetic)?;
        let rest = rest.get(1..)?;
        let (digits, unit) = rest.split_at(rest.find('[').unwrap_or(rest.len()));
        let unit = match unit.strip_prefix('[').map(|unit| unit.strip_suffix(']')) {
            None if matches!(kind, 'M' | 'm') => Some(("generic", 1)),
            None => None,
            Some(unit) => {
                let unit = unit?;
                let name = unit.trim_start_matches(|c: char| c.is_ascii_digit());
                let count = unit.get(..unit.len() - name.len())?;
                Some((name, if count.is_empty() { 1 } else { count.parse().ok()? }))
            }
        };
        Some(Self { order, kind, size: digits.parse().ok()?, unit })
    }
}
