//! Objects of Python as values.
//!
//! ```text
//!   None, bool, int, float, str, list, tuple, set, dict, datetime, NumPy ─▶ here
//!   anything else ─▶ the codec of the value, in Python: a plug-in, or `wrapyfi_rs._objects`
//!                     └─▶ JSON with arrays beside it, or the JSON of a plug-in ─▶ Value
//! ```

use bytes::Bytes;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{
    PyBool, PyBytes, PyDict, PyFloat, PyFrozenSet, PyInt, PyList, PySet, PyString, PyTuple,
};
use wrapyfi_core::plugin::standard;
use wrapyfi_core::types::{DateTime, Dtype, MAX_DEPTH, Map, Tagged, Tensor, Value};
use wrapyfi_core::{Limits, codec};

use crate::error::no_form;
use crate::numpy;

/// Reader of objects, with the codec that knows those of other libraries.
pub(crate) struct FromPython<'a, 'py> {
    pub(crate) codec: &'a Bound<'py, PyAny>,
}

impl<'py> FromPython<'_, 'py> {
    /// Value of an object.
    pub(crate) fn value(&self, object: &Bound<'py, PyAny>) -> PyResult<Value> {
        self.inside(object, 0)
    }

    fn inside(&self, object: &Bound<'py, PyAny>, depth: usize) -> PyResult<Value> {
        if object.is_none() {
            return Ok(Value::Null);
        }
        // Subclasses too, as Python's json takes them: an element of NumPy's float64 is a float.
        if let Ok(text) = object.cast::<PyString>() {
            return text_value(text);
        }
        if object.is_exact_instance_of::<PyBool>() {
            return Ok(Value::Bool(object.is_truthy()?));
        }
        if let Ok(number) = object.cast::<PyInt>() {
            return match number.extract::<i64>() {
                Ok(number) => Ok(Value::Int(number)),
                Err(_too_large) => Ok(Value::from(number.extract::<num_bigint::BigInt>()?)),
            };
        }
        if let Ok(number) = object.cast::<PyFloat>() {
            return Ok(Value::Float(number.value()));
        }
        if depth >= MAX_DEPTH {
            return Err(no_form(object.py(), format!("an object nested deeper than {MAX_DEPTH}")));
        }
        if let Ok(dict) = object.cast::<PyDict>() {
            let pairs = dict.iter().map(|(key, value)| {
                Ok((self.inside(&key, depth + 1)?, self.inside(&value, depth + 1)?))
            });
            return Ok(Value::Map(Map::from_iter(pairs.collect::<PyResult<Vec<_>>>()?)));
        }
        if let Ok(list) = object.cast::<PyList>() {
            return self.items(list.iter(), depth).map(Value::List);
        }
        if let Ok(tuple) = object.cast::<PyTuple>() {
            return self.items(tuple.iter(), depth).map(Value::Tuple);
        }
        if let Ok(set) = object.cast::<PySet>() {
            return self.items(set.iter(), depth).map(Value::Set);
        }
        if let Ok(set) = object.cast::<PyFrozenSet>() {
            return self.items(set.iter(), depth).map(Value::Set);
        }
        if let Ok(bytes) = object.cast::<PyBytes>() {
            return Ok(Value::Bytes(Bytes::copy_from_slice(bytes.as_bytes())));
        }
        self.other(object)
    }

    fn items(
        &self,
        items: impl Iterator<Item = Bound<'py, PyAny>>,
        depth: usize,
    ) -> PyResult<Vec<Value>> {
        items.map(|item| self.inside(&item, depth + 1)).collect()
    }

    /// Value of an object that is none of Python's own.
    fn other(&self, object: &Bound<'py, PyAny>) -> PyResult<Value> {
        let py = object.py();
        if numpy::is_array(object)? {
            return match object.is_instance(numpy::datetime64(py)?)? {
                true => Ok(Value::DateTime64(object.str()?.to_string())),
                false => numpy::array_value(object),
            };
        }
        if object.get_type().is(numpy::datetime_type(py)?) {
            let text = object.call_method0(intern!(py, "isoformat"))?.extract::<String>()?;
            let when = text.parse::<DateTime>().map_err(|error| no_form(py, error))?;
            return Ok(Value::DateTime(when));
        }
        let found = self.codec.call_method1(intern!(py, "encode"), (object,))?;
        match found.extract::<(Option<String>, PyBackedBytes, Vec<TensorFields>)>()? {
            (Some(key), json, _) => Ok(Tagged::new(key, Bytes::from_owner(json)).into()),
            (None, json, fields) => {
                let tensors = fields.into_iter().map(|fields| tensor(py, fields));
                let tensors = tensors.collect::<PyResult<Vec<_>>>()?;
                let json = Bytes::from_owner(json);
                let limits = Limits { message_bytes: usize::MAX, ..Limits::default() };
                codec::json::decode_with_tensors(&json, &tensors, &limits, &standard())
                    .map_err(|error| no_form(py, error))
            }
        }
    }
}

/// Element type, shape, device and elements of an array, as `wrapyfi_rs._objects` has them.
type TensorFields = (String, Vec<usize>, String, PyBackedBytes);

fn tensor(py: Python<'_>, (dtype, shape, device, data): TensorFields) -> PyResult<Tensor> {
    let unknown = || no_form(py, format!("an array of {dtype}"));
    let known = Dtype::from_name(&dtype).ok_or_else(unknown)?;
    Tensor::new(known, shape, Bytes::from_owner(data))
        .map(|tensor| tensor.with_device(device))
        .map_err(|error| no_form(py, error))
}

fn text_value(text: &Bound<'_, PyString>) -> PyResult<Value> {
    if let Ok(text) = text.to_str() {
        return Ok(Value::Str(text.to_owned()));
    }
    // Lone surrogates, which Python's texts may hold.
    let units = text.call_method1("encode", ("utf-16-le", "surrogatepass"))?;
    let units: PyBackedBytes = units.extract()?;
    let units = units.as_chunks::<2>().0.iter().map(|unit| u16::from_le_bytes(*unit));
    Ok(Value::Utf16(units.collect()))
}
