//! Signals while a thread waits in Rust: Python's handlers run, and what they raise ends the wait.

use std::cell::RefCell;

use pyo3::{PyErr, Python};

thread_local! {
    static RAISED: RefCell<Option<PyErr>> = const { RefCell::new(None) };
}

/// True when a handler of a signal has raised, or Python has ended.
pub(crate) fn is_interrupted() -> bool {
    let raised = Python::try_attach(|py| match py.check_signals() {
        Ok(()) => false,
        Err(error) => {
            RAISED.set(Some(error));
            true
        }
    });
    raised.unwrap_or(true)
}

/// Exception of the handler that ended the last wait of this thread.
pub(crate) fn raised() -> Option<PyErr> {
    RAISED.take()
}
