//! Requests and replies of Wrapyfi's functions on ZeroMQ, each one frame.
//!
//! ```text
//!   request       [{"__wrapyfi__": ["tuple", [1, "a"]]}, {"scale": 0.5}]
//!   NativeObject  JSON of the object
//!   Image         {"img": [[[0, 11, 22], …], …]}            or a JPEG file
//!   AudioChunk    {"aud": [64, 1, 44100, [[-0.5], …]]}
//!   error         {"error": "why", "__wrapyfi__": ["datetime", "error: why"]}
//! ```
//!
//! Between two programs of ours a reply on ZeroMQ has another form, which `wrapyfi_zeromq` reads and writes:
//! `docs/reference/wire/zeromq-requests.md` explains that Python never sees it.
//!
//! Python Wrapyfi has no form for errors. Ours is JSON whose `__wrapyfi__` member cannot be read: a
//! Python client of native objects raises `ValueError` with the text in it, one of images or sound
//! `KeyError`, and neither takes it for a value or waits for ever.

mod lists;
mod message;

use std::borrow::Cow;

use bytes::Bytes;

use super::{DecodeError, DecodeResult, EncodeError, EncodeResult, check_form, json, ros};
use crate::{Call, Request, ServiceSpec};
pub use message::{asked_message, returned_message};
use wrapyfi_data::types::{CompressedFormat, DataType, Image, Map, Payload, Pixels, Stamp, Value};

/// Call of a request, for middlewares without messages of ROS.
pub fn call(request: &Request) -> EncodeResult<Cow<'_, Call>> {
    request.call().map_err(|error| unreadable(&error))
}

/// Returned value for middlewares without messages of ROS: a message becomes a map of its fields.
pub fn without_messages(payload: &Payload) -> EncodeResult<Cow<'_, Payload>> {
    let Payload::RosMessage(message) = payload else { return Ok(Cow::Borrowed(payload)) };
    let value = message.to_value(message.cdr.len());
    let value = value.map_err(|error| unreadable(&ros::fault(&error)))?;
    Ok(Cow::Owned(value.into()))
}

fn unreadable(error: &DecodeError) -> EncodeError {
    EncodeError::unrepresentable(
        "ROS",
        format!("a malformed message: {error}"),
        "look at who sends it",
    )
}

/// Writes a request as Wrapyfi's servers read it.
///
/// # Errors
/// When an argument has no form in Wrapyfi's JSON, or the request exceeds the message size.
pub fn encode_request(request: &Request, spec: &ServiceSpec) -> EncodeResult<Vec<u8>> {
    let Call { args, kwargs } = &*call(request)?;
    if let Some((key, _)) = kwargs.iter().find(|(key, _)| key.as_str().is_none()) {
        return Err(EncodeError::Unrepresentable {
            format: "request",
            what: format!("a keyword that is {}", key.kind()),
            path: "$[1]".into(),
            remedy: "name arguments by text".into(),
        });
    }
    let both = Value::List(vec![Value::Tuple(args.clone()), Value::Map(kwargs.clone())]);
    let text = json::encode(&both, &spec.plugins)?;
    EncodeError::check_size(text.len(), spec.limits.message_bytes)?;
    Ok(text)
}

/// Reads a request of any Wrapyfi client.
///
/// # Errors
/// When it is no list of arguments and keyword arguments, or exceeds a limit.
pub fn decode_request(body: &Bytes, spec: &ServiceSpec) -> DecodeResult<Request> {
    let call = json::decode(body, &spec.limits, &spec.plugins)?;
    let wrong = |actual: &str| DecodeError::mismatch("a request [args, kwargs]", actual.to_owned());
    let (Value::List(parts) | Value::Tuple(parts)) = call else { return Err(wrong(call.kind())) };
    match <[Value; 2]>::try_from(parts) {
        Ok([Value::Tuple(args) | Value::List(args), Value::Map(kwargs)]) => {
            Ok(Call { args, kwargs }.into())
        }
        Ok([args, kwargs]) => Err(wrong(&format!("[{}, {}]", args.kind(), kwargs.kind()))),
        Err(parts) => Err(wrong(&format!("a list of {}", parts.len()))),
    }
}

/// Converts a call to the value that `wrapyfi_msgs/srv` carries: `{"args": […], "kwargs": {…}}`.
pub fn to_value(Call { args, kwargs }: &Call) -> Value {
    Value::from(Map::from([
        ("args", Value::List(args.clone())),
        ("kwargs", Value::Map(kwargs.clone())),
    ]))
}

/// Reads [`to_value`]; both members may be absent. A list is the arguments alone.
///
/// # Errors
/// When it is no such map.
pub fn from_value(value: Value) -> DecodeResult<Request> {
    let wrong = |expected: &str, actual: &Value| {
        DecodeError::mismatch(expected.to_owned(), actual.kind().to_owned())
    };
    let call = match value {
        Value::Map(call) => call,
        Value::Null => return Ok(Request::default()),
        Value::List(args) | Value::Tuple(args) => {
            return Ok(Call { args, kwargs: Map::new() }.into());
        }
        other => return Err(wrong("a list of arguments, or a map with args and kwargs", &other)),
    };
    let mut read = Call::default();
    for (key, part) in call {
        match (key.as_str(), part) {
            (Some("args"), Value::List(args) | Value::Tuple(args)) => read.args = args,
            (Some("args"), other) => return Err(wrong("a list under args", &other)),
            (Some("kwargs"), Value::Map(kwargs)) => read.kwargs = kwargs,
            (Some("kwargs"), other) => return Err(wrong("a map under kwargs", &other)),
            _ => {}
        }
    }
    Ok(read.into())
}

/// Writes a reply as Wrapyfi's clients read it.
///
/// # Errors
/// When `payload` is not of the service's kind, has no form there, or exceeds the message size.
pub fn encode_reply(payload: &Payload, spec: &ServiceSpec) -> EncodeResult<Vec<u8>> {
    let wanted = spec.kind.data_type();
    let payload = &*without_messages(payload)?;
    check_form(payload, spec.kind.message_type())?;
    let body = match (wanted, payload) {
        (DataType::NativeObject, Payload::NativeObject(value)) => {
            json::encode(value, &spec.plugins)?
        }
        (DataType::Image, Payload::Image(image)) => match &image.pixels {
            Pixels::Compressed { data, .. } => data.to_vec(),
            Pixels::Raw(raw) => lists::write_image(raw.clone(), spec)?,
        },
        (DataType::AudioChunk, Payload::AudioChunk(sound)) => lists::write_sound(sound, spec)?,
        _ => return Err(other_kind(payload, spec)),
    };
    EncodeError::check_size(body.len(), spec.limits.message_bytes)?;
    Ok(body)
}

/// Reads a reply of any Wrapyfi server: the payload, or the words of an error.
/// `now` stands in for the time stamp, which has no place in it.
///
/// # Errors
/// When it is no reply of the service's kind, or exceeds a limit.
pub fn decode_reply(
    body: &Bytes,
    spec: &ServiceSpec,
    now: Stamp,
) -> DecodeResult<Result<Payload, String>> {
    DecodeError::check_size(body.len(), spec.limits.message_bytes)?;
    if let Some(text) = error_text(body) {
        return Ok(Err(text));
    }
    Ok(Ok(match spec.kind.data_type() {
        DataType::NativeObject => {
            json::decode(body, &spec.limits, &spec.plugins).map(Payload::from)?
        }
        DataType::Image => {
            let pixels = match CompressedFormat::sniff(body) {
                Some(format) => Pixels::Compressed { format, data: body.clone() },
                None => Pixels::Raw(lists::read_image(body, spec)?),
            };
            Image::new(now, pixels).into()
        }
        DataType::AudioChunk => Payload::AudioChunk(lists::read_sound(body, now)?),
        #[allow(unreachable_patterns)] // for kinds that no service returns
        other => {
            let (expected, actual) = ("a kind that services return", other.to_string());
            return Err(DecodeError::mismatch(expected, actual));
        }
    }))
}

/// Beginning of a reason that there is no reply, at most `most` bytes long.
pub fn beginning(text: &str, most: usize) -> &str {
    let ends = (0..=most.min(text.len())).rev();
    ends.take(4).find_map(|end| text.get(..end)).unwrap_or_default()
}

/// Writes the reason that there is no reply, in a form that ends the call of every Wrapyfi client.
pub fn encode_error(text: &str) -> Vec<u8> {
    // By hand: a dict with this member has no form in Wrapyfi's JSON.
    let quoted = |text: &str| {
        json::encode(&Value::from(text), &wrapyfi_plugins::standard()).unwrap_or_default()
    };
    let mut error = b"{\"error\": ".to_vec();
    error.extend(quoted(text));
    error.extend_from_slice(b", \"__wrapyfi__\": [\"datetime\", ");
    error.extend(quoted(&format!("{ERROR}{text}")));
    error.extend_from_slice(b"]}");
    error
}

/// Text before the reason in the tagged date of an error. Python fails to read such a date, which
/// ends the call.
const ERROR: &str = "error: ";
/// First bytes of [`encode_error`]'s text; Python writes them only for an object with that key
/// first.
const ERROR_START: &[u8] = b"{\"error\": \"";
/// Longest error that is read, in bytes; errors are a few sentences.
const MAX_ERROR_BYTES: usize = 64 * 1024;

/// Reads the text of an error that [`encode_error`] wrote.
fn error_text(body: &Bytes) -> Option<String> {
    if !body.starts_with(ERROR_START) || body.len() > MAX_ERROR_BYTES {
        return None;
    }
    let object: serde_json::Value = serde_json::from_slice(body).ok()?;
    let text = object.get("error")?.as_str()?;
    let tag = object.get("__wrapyfi__")?;
    let tagged = tag.get(0)?.as_str() == Some("datetime")
        && tag.get(1)?.as_str()?.strip_prefix(ERROR) == Some(text);
    tagged.then(|| text.to_owned())
}

fn other_kind(payload: &Payload, spec: &ServiceSpec) -> EncodeError {
    EncodeError::mismatch(spec.kind.data_type().to_string(), payload.data_type().to_string())
}

#[cfg(test)]
mod tests;
