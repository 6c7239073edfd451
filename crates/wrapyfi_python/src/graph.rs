//! Endpoints, types, causes and definitions for Python, found out as by the commands of `wrapyfi`.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Duration;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use wrapyfi_bridge::cli::{ListArgs, WhyArgs};
use wrapyfi_bridge::command::{self, definitions as store};
use wrapyfi_bridge::exit::Failure;
use wrapyfi_bridge::own_address::OwnAddress;
use wrapyfi_bridge::shutdown::Shutdown;
use wrapyfi_core::endpoint::EndpointAddress;
use wrapyfi_core::types::{Map, MessageType, RosType, Value, fields_of_return};
use wrapyfi_data::types::RosMessage;

use crate::error::{ended, fault, not_open, option, timed_out, wrong_value};
use crate::interrupt;
use crate::to_python::ToPython;

/// Time between two looks whether the answer or a signal has come.
const LOOK_EVERY: Duration = Duration::from_millis(10);

/// A look at a middleware that another thread may end.
#[pyclass(frozen, module = "wrapyfi_rs._native")]
#[derive(Default)]
pub(crate) struct Look(AtomicBool);

#[pymethods]
impl Look {
    #[new]
    fn new() -> Self {
        Self::default()
    }

    /// Ends the look with an exception, now or as soon as it begins.
    fn cancel(&self) {
        self.0.store(true, Relaxed);
    }
}

/// Runs what a command does, without the lock of the interpreter. A signal ends it, and so does `look`.
fn found<T: Send>(
    py: Python<'_>,
    look: Option<&Look>,
    find: impl FnOnce(&Shutdown) -> Result<T, Failure> + Send,
) -> PyResult<T> {
    let shutdown = Shutdown::default();
    let outcome = py.detach(|| {
        std::thread::scope(|scope| {
            let finder = scope.spawn(|| find(&shutdown));
            while !finder.is_finished() {
                if interrupt::is_interrupted() || look.is_some_and(|look| look.0.load(Relaxed)) {
                    shutdown.request();
                }
                std::thread::sleep(LOOK_EVERY);
            }
            finder.join()
        })
    });
    if let Some(raised) = interrupt::raised() {
        return Err(raised);
    }
    match outcome {
        Ok(outcome) => outcome.map_err(|failure| match failure {
            Failure::Usage(text) | Failure::Absent(text) => option(py, text),
            Failure::TimedOut(text) => timed_out(py, text),
            other => not_open(py, other),
        }),
        Err(_) => Err(fault(py, "a fault in wrapyfi_rs, please report it: a panic")),
    }
}

fn seconds(py: Python<'_>, written: f64) -> PyResult<Duration> {
    Duration::try_from_secs_f64(written).map_err(|error| option(py, error))
}

fn address(py: Python<'_>, endpoint: &str) -> PyResult<EndpointAddress> {
    endpoint.parse().map_err(|error| option(py, error))
}

/// Endpoints that exist now, each as JSON with the name of its middleware.
#[pyfunction]
pub(crate) fn endpoints(
    py: Python<'_>,
    middleware: Option<String>,
    wait_s: Option<f64>,
) -> PyResult<Vec<(&'static str, String)>> {
    let wait = wait_s.map(|wait| seconds(py, wait)).transpose()?;
    let args = ListArgs { middleware, json: true, wait, own: OwnAddress::default() };
    let found = found(py, None, |shutdown| command::list::endpoints(&args, shutdown))?;
    let lines = found.into_iter().map(|(middleware, one)| {
        let line = serde_json::to_string(&one).map_err(|error| fault(py, error))?;
        Ok((middleware, line))
    });
    lines.collect()
}

/// Data type, type and type of ROS of a topic, by name, as its ends tell it.
#[pyfunction]
#[pyo3(signature = (endpoint, timeout_s, look=None))]
pub(crate) fn topic_type(
    py: Python<'_>,
    endpoint: &str,
    timeout_s: Option<f64>,
    look: Option<&Look>,
) -> PyResult<(String, String, &'static str)> {
    let endpoint = address(py, endpoint)?;
    let timeout = timeout_s.map(|timeout| seconds(py, timeout)).transpose()?;
    let found = found(py, look, |shutdown| command::echo::type_of(&endpoint, timeout, shutdown))?;
    let kind: MessageType = found.ok_or_else(|| ended(py, "interrupted"))?;
    Ok((kind.data_type().to_string(), kind.to_string(), kind.ros_type()))
}

/// Data type and type of a service, as its servers tell it.
#[pyfunction]
#[pyo3(signature = (endpoint, timeout_s, look=None))]
pub(crate) fn service_type(
    py: Python<'_>,
    endpoint: &str,
    timeout_s: f64,
    look: Option<&Look>,
) -> PyResult<(String, String)> {
    let (endpoint, timeout) = (address(py, endpoint)?, seconds(py, timeout_s)?);
    let ask = |shutdown: &Shutdown| command::service::call::type_of(&endpoint, timeout, shutdown);
    let kind = found(py, look, ask)?.ok_or_else(|| ended(py, "interrupted"))?;
    Ok((kind.data_type().to_string(), kind.to_string()))
}

/// Type of an action, as its servers tell it.
#[pyfunction]
#[pyo3(signature = (endpoint, timeout_s, look=None))]
pub(crate) fn action_type(
    py: Python<'_>,
    endpoint: &str,
    timeout_s: f64,
    look: Option<&Look>,
) -> PyResult<String> {
    let (endpoint, timeout) = (address(py, endpoint)?, seconds(py, timeout_s)?);
    let ask = |shutdown: &Shutdown| command::action::type_of(&endpoint, timeout, shutdown);
    let kind = found(py, look, ask)?.ok_or_else(|| ended(py, "interrupted"))?;
    Ok(kind.to_string())
}

/// Reason why nothing flows at a name, as JSON and in words.
#[pyfunction]
pub(crate) fn why(
    py: Python<'_>,
    name: String,
    config: Option<std::path::PathBuf>,
    node: Option<String>,
) -> PyResult<(String, String)> {
    let args = WhyArgs {
        name,
        config,
        node,
        definitions: Vec::new(),
        json: true,
        own: OwnAddress::default(),
    };
    let diagnosis = found(py, None, |_| command::why::diagnosis(&args))?;
    let json = serde_json::to_string(&diagnosis).map_err(|error| fault(py, error))?;
    Ok((json, diagnosis.to_string()))
}

/// A type of ROS: its name, the values of its fields in a new message, and of each field its name and type.
type Definition<'py> = (String, Bound<'py, PyDict>, Vec<(String, String)>);

/// Definitions of a type of ROS and of all that it has inside.
#[pyfunction]
pub(crate) fn definitions<'py>(
    py: Python<'py>,
    name: &str,
    codec: &Bound<'py, PyAny>,
) -> PyResult<Vec<Definition<'py>>> {
    let unknown = |error: &dyn std::fmt::Display| option(py, error);
    let mut types = store::store(&[]);
    let all = types.resolve_name(name).map_err(|error| unknown(&error))?;
    let of = |resolved: &_, fields: Vec<(String, String)>| {
        let ros_type = RosType::new(resolved).map_err(|error| unknown(&error))?;
        let empty = Value::from(Map::default());
        let message = fields_of_return(ros_type, &empty, usize::MAX)
            .map_err(|error| unknown(&error))
            .and_then(|fields| {
                RosMessage::from_fields(ros_type, &fields).map_err(|error| unknown(&error))
            })?;
        let value = message.to_value(message.cdr.len()).map_err(|error| wrong_value(py, error))?;
        let fresh = match value {
            Value::Map(fresh) => ToPython { codec }.dict(fresh)?,
            _ => PyDict::new(py),
        };
        Ok::<_, PyErr>((ros_type.name().to_owned(), fresh, fields))
    };
    let mut found = Vec::new();
    for (inner, definition) in all.definitions() {
        let fields = definition.fields.iter();
        let fields = fields.map(|field| (field.name.clone(), field.field_type.to_string()));
        let resolved = types.resolve(inner).map_err(|error| unknown(&error))?;
        found.push(of(&resolved, fields.collect())?);
    }
    Ok(found)
}
