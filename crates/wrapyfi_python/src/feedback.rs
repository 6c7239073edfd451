//! Feedback of goals, of methods that serve an action and of calls that hear it.

use std::time::Duration;

use pyo3::prelude::*;
use wrapyfi_core::communicator::{Feedback as Sender, GatheredMessages, OpenMethod, at_once};
use wrapyfi_core::endpoint::Request;
use wrapyfi_core::types::Value;

use crate::error::{fault, no_form, raise};
use crate::from_python::FromPython;

/// Longest time between two questions to Python whether a signal has come.
const ASK_EVERY: Duration = Duration::from_millis(50);

/// Feedback that a method which serves an action gives its client while it runs.
#[pyclass(frozen, module = "wrapyfi_rs._native")]
pub(crate) struct Feedback {
    sender: Sender,
    codec: Py<PyAny>,
}

impl Feedback {
    pub(crate) fn new(sender: Sender, codec: Py<PyAny>) -> Self {
        Self { sender, codec }
    }
}

#[pymethods]
impl Feedback {
    /// Sends the fields of a feedback, or the value of its first field.
    fn send(&self, py: Python<'_>, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let value = FromPython { codec: self.codec.bind(py) }.value(value)?;
        py.detach(|| self.sender.send(&value)).map_err(|error| no_form(py, error))
    }

    /// True when a client wants the goal to end, and when it has ended: the method returns soon.
    #[getter]
    fn is_canceled(&self, py: Python<'_>) -> bool {
        py.detach(|| self.sender.is_canceled())
    }

    /// Makes the goal one that was aborted, for this reason.
    fn abort(&self, py: Python<'_>, reason: String) {
        py.detach(|| self.sender.abort(reason));
    }
}

/// Replies to a goal, whose feedback `hears` is called with. The goal is cancelled by what that raises, and by a signal.
pub(crate) fn call<'py>(
    py: Python<'py>,
    open: &OpenMethod,
    request: &Request,
    hears: impl Fn(&Value) -> PyResult<Bound<'py, PyAny>>,
) -> PyResult<GatheredMessages> {
    let (sender, mut heard) = Sender::channel();
    std::thread::scope(|scope| {
        // The thread that calls is the one in which Python runs handlers of signals.
        let asked = scope.spawn(move || at_once(open.call(false, request, Some(&sender))));
        let mut raised = None;
        let outcome = loop {
            let is_over = asked.is_finished();
            let next = py.detach(|| heard.recv_timeout(ASK_EVERY));
            let said = match &next {
                Some(value) => hears(value).map(drop),
                None => py.check_signals(),
            };
            if raised.is_none() {
                raised = said.err();
            }
            if raised.is_some() {
                // Again and again, as the wait may have yet to begin.
                open.cancel();
            }
            if next.is_none() && is_over {
                break asked.join();
            }
        };
        match (raised, outcome) {
            (Some(raised), _) => Err(raised),
            (None, Ok(outcome)) => outcome.map_err(|error| raise(py, &error)),
            (None, Err(_)) => Err(fault(py, "a fault in wrapyfi_rs, please report it: a panic")),
        }
    })
}
