//! Errors of the core as exceptions of `wrapyfi_rs.errors`.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;
use wrapyfi_core::communicator::MethodError;

use crate::interrupt;

macro_rules! exceptions {
    ($($function:ident => $class:literal;)*) => {$(
        pub(crate) fn $function(py: Python<'_>, text: impl ToString) -> PyErr {
            static CLASS: PyOnceLock<Py<PyType>> = PyOnceLock::new();
            match CLASS.import(py, "wrapyfi_rs.errors", $class) {
                Ok(class) => PyErr::from_type(class.clone(), (text.to_string(),)),
                Err(error) => error,
            }
        }
    )*};
}

exceptions! {
    call_failed => "CallError";
    ended => "EndedError";
    fault => "InternalError";
    option => "OptionError";
    no_form => "ObjectError";
    not_open => "OpenError";
    timed_out => "WaitTimeout";
    wrong_value => "ValueMismatch";
}

/// Exception for an error of a method; what interrupted the wait goes first.
pub(crate) fn raise(py: Python<'_>, error: &MethodError) -> PyErr {
    if let Some(raised) = interrupt::raised() {
        return raised;
    }
    match error {
        MethodError::Argument { .. } | MethodError::Publish { .. } | MethodError::Reply { .. } => {
            no_form(py, error)
        }
        MethodError::Send { .. } | MethodError::WrongType { .. } => wrong_value(py, error),
        MethodError::Option { .. } | MethodError::MissingArgument { .. } => option(py, error),
        MethodError::Unanswered { .. } => call_failed(py, error),
        MethodError::TimedOut { .. } => timed_out(py, error),
        MethodError::Ended { .. } | MethodError::Cancelled { .. } => ended(py, error),
        _ => not_open(py, error),
    }
}

/// Runs `work` without the lock of the interpreter. A panic in it becomes an exception.
pub(crate) fn detached<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T, MethodError> + Send,
) -> PyResult<T> {
    match py.detach(|| catch_unwind(AssertUnwindSafe(work))) {
        Ok(result) => result.map_err(|error| raise(py, &error)),
        Err(panic) => Err(fault(py, panic_text(&*panic))),
    }
}

fn panic_text(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().copied();
    let text = text.or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    format!("a fault in wrapyfi_rs, please report it: {}", text.unwrap_or("a panic"))
}
