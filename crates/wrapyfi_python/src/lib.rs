//! The core of the Python package `wrapyfi_rs`: endpoints of methods, values to and from objects of Python.
//!
//! ```text
//!   wrapyfi_rs (Python)   decorator, modes, $, configuration, plug-ins written in Python
//!        │ open(method, mode, values) ─▶ Ends: listen, publish, call, serve; Feedback of goals
//!        │ endpoints, topic_type, service_type, action_type, why, definitions; log_lines
//!   this crate            objects ⇄ values; the lock of the interpreter is free while a call waits or codes
//!        │
//!   wrapyfi_core          endpoints of the communicator
//!   wrapyfi_bridge        what its commands find out
//! ```

mod ends;
mod error;
mod feedback;
mod from_python;
mod graph;
mod interrupt;
mod log;
mod memory;
mod numpy;
#[path = "../../wrapyfi_macros/src/options.rs"]
#[expect(dead_code, reason = "kinds of values are for the macro")]
mod options;
mod to_python;

use std::sync::{Mutex, PoisonError};

use pyo3::prelude::*;
use wrapyfi_bridge::command::definitions;
use wrapyfi_core::communicator::CommunicatorContext;

/// Context of this process; another one after a fork, because threads do not survive it.
static CONTEXT: Mutex<Option<CommunicatorContext>> = Mutex::new(None);

fn context() -> CommunicatorContext {
    let mut context = CONTEXT.lock().unwrap_or_else(PoisonError::into_inner);
    let made = || {
        let types = definitions::store(&[]);
        let builder = CommunicatorContext::builder().types(types);
        builder.interrupted_by(interrupt::is_interrupted).build()
    };
    context.get_or_insert_with(made).clone()
}

/// Forgets the context of the parent process: its threads are not here, and would be waited for.
#[pyfunction]
fn forked() {
    let mut context = CONTEXT.lock().unwrap_or_else(PoisonError::into_inner);
    std::mem::forget(context.take());
}

/// Names of the middlewares that are built in.
#[pyfunction]
fn middlewares() -> Vec<String> {
    context().middlewares()
}

/// Names of the options of `register`.
#[pyfunction]
fn option_names() -> Vec<&'static str> {
    options::names().collect()
}

/// Version of the workspace, which the package has too.
#[pyfunction]
fn version() -> &'static str {
    env!("CARGO_PKG_VERSION")
}

/// Panics, for the test that a panic becomes an exception.
#[pyfunction]
fn panic_on_purpose(py: Python<'_>) -> PyResult<()> {
    #[expect(clippy::panic, reason = "a test asks for it")]
    error::detached(py, || panic!("on purpose"))
}

#[pymodule(gil_used = false)]
mod _native {
    #[pymodule_export]
    use super::ends::{Ends, open};
    #[pymodule_export]
    use super::feedback::Feedback;
    #[pymodule_export]
    use super::graph::{Look, action_type, definitions, endpoints, service_type, topic_type, why};
    #[pymodule_export]
    use super::log::log_lines;
    #[pymodule_export]
    use super::{forked, middlewares, option_names, panic_on_purpose, version};
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(_: &Bound<'_, PyModule>) -> PyResult<()> {
        super::log::start();
        Ok(())
    }
}
