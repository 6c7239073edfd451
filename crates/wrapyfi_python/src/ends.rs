//! The endpoints of one method, open for one mode.

use std::sync::{Arc, Mutex, PoisonError};

use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};
use wrapyfi_core::Limits;
use wrapyfi_core::communicator::{
    GatheredMessages, Mode, OpenMethod, OptionValue, Options, PayloadError, Resolved, Returned,
    at_once,
};
use wrapyfi_core::endpoint::Request;
use wrapyfi_core::types::{DataType, Encoding, MessageType, Payload, SampleFormat, Stamp, Value};
use wrapyfi_data::codec::Conversion;

use crate::error::{detached, ended, option, wrong_value};
use crate::feedback::{self, Feedback};
use crate::from_python::FromPython;
use crate::to_python::ToPython;

/// Kind of value whose message is made here.
struct AnyKind;

/// A message as it is; `None` is not sent.
struct Message(Option<Payload>);

impl Returned<AnyKind> for Message {
    fn to_payload(&self) -> Result<Option<Payload>, PayloadError> {
        Ok(self.0.clone())
    }

    fn from_payload(payload: Payload) -> Result<Self, PayloadError> {
        Ok(Self(Some(payload)))
    }
}

/// One value of a method: its type, and what converts its objects.
struct Channel {
    data_type: DataType,
    color_order: Encoding,
    codec: Py<PyAny>,
}

/// Endpoints of one method.
#[pyclass(frozen, module = "wrapyfi_rs._native")]
pub(crate) struct Ends {
    method: String,
    channels: Vec<Channel>,
    mode: Mode,
    /// `None` once closed.
    open: Mutex<Option<Arc<OpenMethod>>>,
}

/// Data type, middleware if one is selected, topic, options and codec of a value. The data type `Action` is that of a
/// goal whose method has feedback, `PlainAction` of one that has none.
type Described<'py> = (String, Option<String>, String, Bound<'py, PyDict>, Py<PyAny>);

/// Opens the endpoints of `method` for `mode`. A value is its data type, its middleware or none, its topic, its options,
/// and the codec of its objects.
#[pyfunction]
pub(crate) fn open(
    py: Python<'_>,
    method: String,
    mode: &str,
    values: Vec<Described<'_>>,
) -> PyResult<Ends> {
    let mode: Mode = mode.parse().map_err(|error| option(py, error))?;
    let (mut channels, mut resolved) = (Vec::new(), Vec::new());
    for (data_type, middleware, topic, options, codec) in values {
        let action = match data_type.as_str() {
            "Action" => Some(true),
            "PlainAction" => Some(false),
            _ => None,
        };
        let data_type = match action {
            Some(_) => DataType::NativeObject,
            None => data_type.parse().map_err(|error| option(py, error))?,
        };
        let options = read_options(&options)?;
        let red_first = options.get("encoding") == Some(&OptionValue::Text("rgb8".to_owned()));
        let color_order = if red_first { Encoding::Rgb8 } else { Encoding::Bgr8 };
        channels.push(Channel { data_type, color_order, codec });
        let ros_type = None;
        resolved.push(Resolved { data_type, middleware, topic, ros_type, action, options });
    }
    let opened = detached(py, || crate::context().open(&method, mode, resolved))?;
    Ok(Ends { method, channels, mode, open: Mutex::new(Some(Arc::new(opened))) })
}

/// Options that the core understands; others are for plug-ins, or for nobody, as in Wrapyfi.
fn read_options(written: &Bound<'_, PyDict>) -> PyResult<Options> {
    let mut options = Options::default();
    for (name, value) in written.iter() {
        let value = if let Ok(part) = value.cast::<PyDict>() {
            OptionValue::Map(read_options(part)?)
        } else if value.is_none() {
            OptionValue::Nothing
        } else if let Ok(value) = value.extract() {
            OptionValue::Switch(value)
        } else if let Ok(value) = value.extract() {
            OptionValue::Integer(value)
        } else if let Ok(value) = value.extract() {
            OptionValue::Float(value)
        } else if let Ok(value) = value.extract() {
            OptionValue::Text(value)
        } else {
            continue;
        };
        options = options.with(name.extract::<String>()?, value);
    }
    Ok(options)
}

#[pymethods]
impl Ends {
    /// Values that other programs published, `None` where there is none.
    fn listen<'py>(&self, py: Python<'py>) -> PyResult<Vec<Option<Bound<'py, PyAny>>>> {
        let open = self.there(py)?;
        let messages = detached(py, || {
            let gathered = at_once(open.gather(false))?;
            self.taken(&open, gathered)
        })?;
        self.objects(py, messages)
    }

    /// Reason for each value that its middleware is not here, `None` where it is.
    fn absent(&self, py: Python<'_>) -> PyResult<Vec<Option<String>>> {
        let open = self.there(py)?;
        Ok((0..self.channels.len()).map(|index| open.absent(index).map(str::to_owned)).collect())
    }

    /// True where the mode listens.
    fn listens(&self) -> bool {
        self.mode.listens()
    }

    /// Waits for the first listener of each value that waits.
    fn await_listeners(&self, py: Python<'_>) -> PyResult<()> {
        let open = self.there(py)?;
        detached(py, || at_once(open.await_listeners(false)))
    }

    /// Publishes these values.
    fn publish<'py>(&self, py: Python<'py>, values: &Bound<'py, PyList>) -> PyResult<()> {
        let open = self.there(py)?;
        for (index, (channel, value)) in self.channels.iter().zip(values.iter()).enumerate() {
            if open.skips(index) {
                continue;
            }
            let message = channel.message(&value).inspect_err(|error| {
                let note = format!("value {} that {} returned", index + 1, self.method);
                _ = error.value(py).call_method1("add_note", (note,));
            })?;
            detached(py, || at_once(open.send::<AnyKind, _>(false, index, &message)))?;
        }
        Ok(())
    }

    /// Replies of the servers to a call with these arguments. Where the call is a goal, `feedback` is called with each
    /// feedback; what it raises cancels the goal.
    #[pyo3(signature = (args, kwargs, feedback=None))]
    fn call<'py>(
        &self,
        py: Python<'py>,
        args: &Bound<'py, PyTuple>,
        kwargs: &Bound<'py, PyDict>,
        feedback: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Vec<Option<Bound<'py, PyAny>>>> {
        let open = self.there(py)?;
        let Some(channel) = self.channels.first() else { return Ok(Vec::new()) };
        let from = FromPython { codec: channel.codec.bind(py) };
        let args = args.iter().map(|arg| from.value(&arg)).collect::<PyResult<Vec<_>>>()?;
        let request = match from.value(kwargs.as_any())? {
            Value::Map(kwargs) => Request::new(args).with(kwargs),
            _ => Request::new(args),
        };
        let messages = match feedback {
            None => detached(py, || {
                let gathered = at_once(open.call(false, &request, None))?;
                self.taken(&open, gathered)
            })?,
            Some(hears) => {
                let hears = |value: &Value| {
                    hears
                        .call1((ToPython { codec: channel.codec.bind(py) }.object(value.clone())?,))
                };
                let gathered = feedback::call(py, &open, &request, hears)?;
                detached(py, || self.taken(&open, gathered))?
            }
        };
        self.objects(py, messages)
    }

    /// True where a client can ask.
    fn serves(&self, py: Python<'_>) -> PyResult<bool> {
        Ok(self.there(py)?.serves())
    }

    /// Runs `body` with the arguments of the next call and the feedback of its goal, and answers with the values that it returns, a list; False where
    /// nobody calls and the method does not wait. What `body` raises is told to the client, and raised here.
    fn serve(&self, py: Python<'_>, body: &Bound<'_, PyAny>) -> PyResult<bool> {
        let open = self.there(py)?;
        let Some(mut request) = detached(py, || at_once(open.hear(false)))? else {
            return Ok(false);
        };
        let call = request.take_call();
        let feedback = request.feedback();
        let returned = self.run(py, body, (call.args, call.kwargs), feedback);
        let messages = match returned {
            Ok(messages) => messages,
            Err(error) => {
                let reason = error.to_string();
                py.detach(|| request.refuse(&reason));
                return Err(error);
            }
        };
        for (index, message) in messages.iter().enumerate() {
            let answered = open.answer::<AnyKind, _>(false, &mut request, index, message);
            detached(py, || at_once(answered))?;
        }
        py.detach(|| drop(request));
        Ok(true)
    }

    /// Ends the waits that have begun with an exception; the endpoints stay open.
    fn cancel(&self) {
        if let Some(open) = &*self.open.lock().unwrap_or_else(PoisonError::into_inner) {
            open.cancel();
        }
    }

    /// Closes the endpoints; calls that wait end with an exception.
    fn close(&self, py: Python<'_>) {
        let open = self.open.lock().unwrap_or_else(PoisonError::into_inner).take();
        py.detach(|| {
            if let Some(open) = &open {
                open.end();
            }
            drop(open);
        });
    }

    /// Forgets the endpoints, which are those of the parent process after a fork.
    fn forget(&self) {
        let open = self.open.lock().unwrap_or_else(PoisonError::into_inner).take();
        std::mem::forget(open);
    }
}

impl Ends {
    fn there(&self, py: Python<'_>) -> PyResult<Arc<OpenMethod>> {
        let open = self.open.lock().unwrap_or_else(PoisonError::into_inner).clone();
        open.ok_or_else(|| ended(py, format!("{} is closed", self.method)))
    }

    fn taken(
        &self,
        open: &OpenMethod,
        mut gathered: GatheredMessages,
    ) -> Result<Vec<Option<Payload>>, wrapyfi_core::communicator::MethodError> {
        let taken = (0..self.channels.len()).map(|index| {
            let message = open.taken::<AnyKind, Message>(&mut gathered, index)?;
            Ok(message.and_then(|Message(payload)| payload))
        });
        taken.collect()
    }

    fn objects<'py>(
        &self,
        py: Python<'py>,
        messages: Vec<Option<Payload>>,
    ) -> PyResult<Vec<Option<Bound<'py, PyAny>>>> {
        let pairs = self.channels.iter().zip(messages);
        let objects = pairs.map(|(channel, message)| {
            message.map(|payload| channel.object(py, payload)).transpose()
        });
        objects.collect()
    }

    fn run(
        &self,
        py: Python<'_>,
        body: &Bound<'_, PyAny>,
        (args, kwargs): (Vec<Value>, wrapyfi_core::types::Map),
        feedback: wrapyfi_core::communicator::Feedback,
    ) -> PyResult<Vec<Message>> {
        let Some(first) = self.channels.first() else { return Ok(Vec::new()) };
        let to = ToPython { codec: first.codec.bind(py) };
        let args = PyTuple::new(py, to.items(args)?)?;
        let feedback = Feedback::new(feedback, first.codec.clone_ref(py));
        let returned: Vec<Bound<'_, PyAny>> =
            body.call1((args, to.dict(kwargs)?, feedback))?.extract()?;
        let pairs = self.channels.iter().zip(&returned);
        pairs.map(|(channel, value)| channel.message(value)).collect()
    }
}

impl Channel {
    /// Message for an object.
    fn message(&self, object: &Bound<'_, PyAny>) -> PyResult<Message> {
        let py = object.py();
        let value = FromPython { codec: self.codec.bind(py) }.value(object)?;
        let to = match (self.data_type, &value) {
            // A dict becomes a message of the type that the topic has.
            (DataType::NativeObject | DataType::RosMessage, _) => {
                return Ok(Message(Some(value.into())));
            }
            (_, Value::Null) => return Ok(Message(None)),
            (DataType::AudioChunk, Value::Tuple(items) | Value::List(items))
                if items.first() == Some(&Value::Null) =>
            {
                return Ok(Message(None));
            }
            (DataType::Image, _) => MessageType::Image,
            (DataType::AudioChunk, _) => MessageType::AudioChunk,
            (DataType::Properties, _) => MessageType::Properties,
        };
        self.converted(py, value.into(), to).map(|payload| Message(Some(payload)))
    }

    /// Object of a message.
    fn object<'py>(&self, py: Python<'py>, payload: Payload) -> PyResult<Bound<'py, PyAny>> {
        let to = ToPython { codec: self.codec.bind(py) };
        // Scripts take samples for floats, as Wrapyfi makes them of everything.
        let payload = match payload {
            Payload::AudioChunk(sound) => sound.to_format(SampleFormat::F32Le).into(),
            other => other,
        };
        match self.converted(py, payload, MessageType::NativeObject)? {
            Payload::NativeObject(object) => to.object(object.value),
            other => Err(wrong_value(py, format!("a message of {}", other.data_type()))),
        }
    }

    fn converted(&self, py: Python<'_>, payload: Payload, to: MessageType) -> PyResult<Payload> {
        // What came was within the limits of its middleware, and what goes will be.
        let limits = Limits { message_bytes: usize::MAX, ..Limits::default() };
        let conversion = Conversion { to, color_order: self.color_order, limits };
        let converted = py.detach(|| conversion.convert(payload, Stamp::now));
        converted.map_err(|error| wrong_value(py, error))
    }
}
