//! Values as objects of Python.
//!
//! ```text
//!   None, bool, int, float, str, list, tuple, set, dict, datetime, arrays ─▶ here
//!   tables, pictures, arrays of other libraries, …  ─▶ JSON with arrays beside it ─▶ the codec of the value, in Python
//!   objects of unknown plug-ins ─▶ their JSON ─▶ the codec, which may have a plug-in
//! ```

use pyo3::IntoPyObjectExt;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList, PySet, PyTuple};
use wrapyfi_core::codec;
use wrapyfi_core::plugin::standard;
use wrapyfi_core::types::{Map, Value};

use crate::error::wrong_value;
use crate::memory::Memory;
use crate::numpy;

/// Writer of objects, with the codec that makes those of other libraries.
pub(crate) struct ToPython<'a, 'py> {
    pub(crate) codec: &'a Bound<'py, PyAny>,
}

impl<'py> ToPython<'_, 'py> {
    /// Object for a value.
    pub(crate) fn object(&self, value: Value) -> PyResult<Bound<'py, PyAny>> {
        let py = self.codec.py();
        match value {
            Value::Null => Ok(py.None().into_bound(py)),
            Value::Bool(value) => value.into_bound_py_any(py),
            Value::Int(value) => value.into_bound_py_any(py),
            Value::BigInt(value) => value.into_bound_py_any(py),
            Value::Float(value) => value.into_bound_py_any(py),
            Value::Str(text) => text.into_bound_py_any(py),
            Value::Utf16(units) => {
                let bytes: Vec<u8> = units.iter().flat_map(|unit| unit.to_le_bytes()).collect();
                PyBytes::new(py, &bytes).call_method1("decode", ("utf-16-le", "surrogatepass"))
            }
            Value::Bytes(bytes) => Ok(PyBytes::new(py, &bytes).into_any()),
            Value::List(items) => Ok(PyList::new(py, self.items(items)?)?.into_any()),
            Value::Tuple(items) => Ok(PyTuple::new(py, self.items(items)?)?.into_any()),
            Value::Set(items) => Ok(PySet::new(py, self.items(items)?)?.into_any()),
            Value::Map(map) => self.dict(map).map(Bound::into_any),
            Value::DateTime(when) => {
                let class = numpy::datetime_type(py)?;
                class.call_method1(intern!(py, "fromisoformat"), (when.to_string(),))
            }
            Value::DateTime64(text) => numpy::datetime64(py)?.call1((text,)),
            Value::Array(array) => numpy::from_described(py, array),
            Value::Tensor(tensor) if tensor.origin().is_none() => {
                match tensor.dtype().npy_descr() {
                    Some(code) => numpy::from_tensor(py, tensor, code),
                    None => self.foreign(tensor.into()),
                }
            }
            Value::Tagged(tagged) => {
                let json = PyBytes::new(py, &tagged.json);
                let refused = tagged.refused.as_deref();
                self.codec.call_method1(intern!(py, "tagged"), (&tagged.key, json, refused))
            }
            other => self.foreign(other),
        }
    }

    /// Keyword arguments of a call.
    pub(crate) fn dict(&self, map: Map) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(self.codec.py());
        for (key, value) in map {
            dict.set_item(self.object(key)?, self.object(value)?)?;
        }
        Ok(dict)
    }

    /// Objects for values.
    pub(crate) fn items(&self, items: Vec<Value>) -> PyResult<Vec<Bound<'py, PyAny>>> {
        items.into_iter().map(|item| self.object(item)).collect()
    }

    /// Object of a library.
    fn foreign(&self, value: Value) -> PyResult<Bound<'py, PyAny>> {
        let py = self.codec.py();
        let (json, tensors) = codec::json::encode_with_tensors(&value, &standard())
            .map_err(|error| wrong_value(py, error))?;
        // The elements belong to the arrays alone then.
        drop(value);
        let tensors = tensors.into_iter().map(|tensor| {
            let (shape, device) = (tensor.shape().to_vec(), tensor.device().to_owned());
            let (name, elements) = (tensor.dtype().name(), tensor.data().clone());
            drop(tensor);
            (name, shape, device, Memory::of(elements))
        });
        let tensors: Vec<_> = tensors.collect();
        self.codec.call_method1(intern!(py, "decode"), (PyBytes::new(py, &json), tensors))
    }
}
