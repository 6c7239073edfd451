//! NumPy's arrays as tensors, through `numpy` itself: it is imported when an object needs it.

use bytes::Bytes;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyString, PyTuple};
use wrapyfi_core::types::{Dtype, NumpyArray, Tensor, Value};

use crate::error::no_form;
use crate::memory::Memory;

macro_rules! members {
    ($($(#[$doc:meta])* $function:ident: $module:literal, $name:literal;)*) => {$(
        $(#[$doc])*
        pub(crate) fn $function(py: Python<'_>) -> PyResult<&Bound<'_, PyAny>> {
            static MEMBER: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
            MEMBER.import(py, $module, $name)
        }
    )*};
}

members! {
    array_type: "numpy", "ndarray";
    scalar_type: "numpy", "generic";
    datetime64: "numpy", "datetime64";
    frombuffer: "numpy", "frombuffer";
    datetime_type: "datetime", "datetime";
    literal_eval: "ast", "literal_eval";
    descr_to_dtype: "numpy.lib.format", "descr_to_dtype";
    dtype_to_descr: "numpy.lib.format", "dtype_to_descr";
}

/// Value of an array, or of a scalar of NumPy's. Its elements are copied once, by NumPy.
pub(crate) fn array_value(array: &Bound<'_, PyAny>) -> PyResult<Value> {
    let py = array.py();
    let mut array = array.clone();
    let mut dtype = array.getattr(intern!(py, "dtype"))?;
    if dtype.getattr(intern!(py, "hasobject"))?.extract()? {
        let advice = "an array of Python objects: send numbers, text of a fixed length, or a list";
        return Err(no_form(py, advice));
    }
    let name: String = dtype.getattr(intern!(py, "name"))?.extract()?;
    let known = Dtype::from_name(&name);
    let order: String = dtype.getattr(intern!(py, "byteorder"))?.extract()?;
    if known.is_some() && (order == ">" || (order == "=" && cfg!(target_endian = "big"))) {
        dtype = dtype.call_method1(intern!(py, "newbyteorder"), ("<",))?;
        array = array.call_method1(intern!(py, "astype"), (&dtype,))?;
    }
    let shape: Vec<usize> = array.getattr(intern!(py, "shape"))?.extract()?;
    let elements = array.call_method0(intern!(py, "tobytes"))?.extract::<PyBackedBytes>()?;
    let elements = Bytes::from_owner(elements);
    let misfit = |error: &dyn std::fmt::Display| no_form(py, error);
    match known {
        Some(known) => {
            Tensor::new(known, shape, elements).map(Value::from).map_err(|error| misfit(&error))
        }
        None => {
            let descr = dtype_to_descr(py)?.call1((&dtype,))?.repr()?.to_string();
            let itemsize = dtype.getattr(intern!(py, "itemsize"))?.extract()?;
            let made = NumpyArray::new(descr, itemsize, shape, elements);
            made.map(Value::from).map_err(|error| misfit(&error))
        }
    }
}

/// Array of NumPy's over the elements, which the script may change.
pub(crate) fn array<'py>(
    py: Python<'py>,
    dtype: &Bound<'py, PyAny>,
    shape: &[usize],
    elements: Bytes,
) -> PyResult<Bound<'py, PyAny>> {
    let shape = PyTuple::new(py, shape)?;
    if elements.is_empty() {
        let zeros = py.import(intern!(py, "numpy"))?.getattr(intern!(py, "zeros"))?;
        return zeros.call1((shape, dtype));
    }
    let flat = frombuffer(py)?.call1((Memory::of(elements), dtype))?;
    flat.call_method1(intern!(py, "reshape"), (shape,))
}

/// Array of NumPy's for a tensor, whose elements are `code` to NumPy.
pub(crate) fn from_tensor<'py>(
    py: Python<'py>,
    tensor: Tensor,
    code: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let dtype = PyString::intern(py, code).into_any();
    let (shape, elements) = (tensor.shape().to_vec(), tensor.data().clone());
    // The elements belong to the array alone then.
    drop(tensor);
    array(py, &dtype, &shape, elements)
}

/// Array of NumPy's whose elements are no plain numbers.
pub(crate) fn from_described<'py>(
    py: Python<'py>,
    found: NumpyArray,
) -> PyResult<Bound<'py, PyAny>> {
    let descr = literal_eval(py)?.call1((&found.descr,))?;
    let dtype = descr_to_dtype(py)?.call1((descr,))?;
    array(py, &dtype, &found.shape, found.data)
}

/// True when `object` is an array of NumPy's own class or a scalar of NumPy's: its subclasses know more than their elements.
pub(crate) fn is_array(object: &Bound<'_, PyAny>) -> PyResult<bool> {
    let py = object.py();
    Ok(object.get_type().is(array_type(py)?) || object.is_instance(scalar_type(py)?)?)
}
