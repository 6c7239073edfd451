//! Memory of a message as Python's buffer protocol has it: an array over it is writable and copies nothing.

#![expect(unsafe_code, reason = "the buffer protocol hands out pointers")]

use std::ffi::c_int;

use bytes::{Bytes, BytesMut};
use pyo3::exceptions::PyBufferError;
use pyo3::ffi::{Py_buffer, PyBuffer_FillInfo};
use pyo3::prelude::*;

/// Bytes that belong to Python alone from now on.
#[pyclass(frozen, module = "wrapyfi_rs._native")]
pub(crate) struct Memory {
    /// Never touched again here, and never moved: its bytes are on the heap.
    bytes: BytesMut,
    start: SendPointer,
}

/// Start of the bytes.
struct SendPointer(*mut u8);

// SAFETY: the pointer is only handed to Python, whose arrays synchronise as NumPy's do.
unsafe impl Send for SendPointer {}
// SAFETY: the same.
unsafe impl Sync for SendPointer {}

impl Memory {
    /// Takes the bytes over; they are copied where somebody else has them too, because scripts may write into them.
    pub(crate) fn of(bytes: Bytes) -> Self {
        let mut bytes = bytes.try_into_mut().unwrap_or_else(|shared| BytesMut::from(&shared[..]));
        let start = SendPointer(bytes.as_mut_ptr());
        Self { bytes, start }
    }
}

#[pymethods]
impl Memory {
    /// Describes the bytes to whoever wants to see them.
    ///
    /// # Safety
    /// As the protocol says: `view` is null, or points to a description that may be overwritten.
    unsafe fn __getbuffer__(
        slf: &Bound<'_, Self>,
        view: *mut Py_buffer,
        flags: c_int,
    ) -> PyResult<()> {
        if view.is_null() {
            return Err(PyBufferError::new_err("no view to describe the bytes in"));
        }
        let memory = slf.get();
        let length = isize::try_from(memory.bytes.len())?;
        // SAFETY: `view` is valid; the bytes live as long as the object, to which the view holds a reference, are
        // writable since they were taken over, and are seen by nothing in Rust.
        let filled = unsafe {
            PyBuffer_FillInfo(view, slf.as_ptr(), memory.start.0.cast(), length, 0, flags)
        };
        match filled {
            0 => Ok(()),
            _ => Err(PyErr::fetch(slf.py())),
        }
    }
}
