//! XML-RPC, in which ROS 1 nodes talk to their master and to each other: text to values.
//!
//! ```text
//!   POST body ── bounds ──▶ dxr ──▶ MethodCall { method, params }
//!                size, nesting, elements; no DOCTYPE, no CDATA
//!   Reply { status, text, value } ──▶ [1, "ready", value] ──▶ dxr ──▶ body of the answer
//! ```
//!
//! No socket. Every ROS 1 method answers with a list of three: a status, words, and the value.

mod bounds;

use dxr::{Fault, FaultResponse, MethodCall, MethodResponse, TryFromValue};

pub use bounds::{BoundsError, MAX_BYTES, MAX_DEPTH, MAX_ELEMENTS};
pub use dxr::Value;

/// Status of a call that did what it was asked for.
pub const SUCCESS: i32 = 1;
/// Status of a call that could not do it.
pub const FAILURE: i32 = 0;
/// Status of a call that was wrong.
pub const ERROR: i32 = -1;

/// A method and what it is called with.
#[derive(Debug, Clone, PartialEq)]
pub struct XmlRpcCall {
    /// The method, for instance `requestTopic`.
    pub method: String,
    /// Parameters of the method; the first is the caller's name by custom.
    pub params: Vec<Value>,
}

/// Answer of a ROS 1 method.
#[derive(Debug, Clone, PartialEq)]
pub struct Reply {
    /// [`SUCCESS`], [`FAILURE`] or [`ERROR`].
    pub status: i32,
    /// Words for people.
    pub text: String,
    /// The value that was asked for.
    pub value: Value,
}

/// Error of a text that is read or written as XML-RPC of ROS 1.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum XmlRpcError {
    /// Larger, deeper or otherwise than any node sends.
    #[error(transparent)]
    Bounds(#[from] BoundsError),
    /// The text is no XML-RPC of ROS 1, or tells a fault, as the words say.
    #[error("{0}")]
    Unusable(String),
}

impl Reply {
    /// A value that was asked for.
    #[must_use]
    pub fn success(text: impl Into<String>, value: Value) -> Self {
        Self { status: SUCCESS, text: text.into(), value }
    }

    /// Answer of a method that could not do it, with the reason.
    #[must_use]
    pub fn failure(text: impl Into<String>, value: Value) -> Self {
        Self { status: FAILURE, text: text.into(), value }
    }

    /// Answer without a value, with the reason; `0` stands in the value's place.
    #[must_use]
    pub fn error(text: impl Into<String>) -> Self {
        Self { status: ERROR, text: text.into(), value: Value::Integer(0) }
    }
}

/// A text as a value.
pub fn text(text: impl Into<String>) -> Value {
    Value::String(text.into())
}

/// The items of a list; none where `value` is no list.
pub(crate) fn items(value: &Value) -> &[Value] {
    if let Value::Array(items) = value { items } else { &[] }
}

/// Several texts as a value.
pub fn texts<T: Into<String>>(items: impl IntoIterator<Item = T>) -> Value {
    Value::Array(items.into_iter().map(text).collect())
}

/// Writes a call.
///
/// # Errors
/// When a value has no form in XML.
pub fn encode_call(method: &str, params: Vec<Value>) -> Result<String, XmlRpcError> {
    let call = MethodCall { name: method.into(), params };
    written(call.to_xml())
}

/// Reads a call.
///
/// # Errors
/// When it exceeds a limit, or is none.
pub fn decode_call(body: &[u8]) -> Result<XmlRpcCall, XmlRpcError> {
    let xml = bounds::check(body)?;
    let call = MethodCall::from_xml(xml).map_err(|_e| malformed("call", xml))?;
    Ok(XmlRpcCall { method: call.name.into_owned(), params: call.params })
}

/// Writes an answer.
///
/// # Errors
/// When a value has no form in XML.
pub fn encode_reply(reply: Reply) -> Result<String, XmlRpcError> {
    let value =
        Value::Array(vec![Value::Integer(reply.status), Value::String(reply.text), reply.value]);
    written(MethodResponse { value }.to_xml())
}

/// Writes that a call could not be run at all.
///
/// # Errors
/// When the text has no form in XML.
pub fn encode_fault(text: &str) -> Result<String, XmlRpcError> {
    written(FaultResponse { fault: Fault::new(1, text.to_owned()) }.to_xml())
}

/// Reads an answer.
///
/// # Errors
/// When it exceeds a limit, is none, or is a fault.
pub fn decode_reply(body: &[u8]) -> Result<Reply, XmlRpcError> {
    let xml = bounds::check(body)?;
    let Ok(MethodResponse { value }) = MethodResponse::from_xml(xml) else {
        return Err(match FaultResponse::from_xml(xml) {
            Ok(FaultResponse { fault }) => {
                let text = shortened(fault.string());
                XmlRpcError::Unusable(format!("fault {}: {text}", fault.code()))
            }
            Err(_) => malformed("answer", xml),
        });
    };
    match <(i32, String, Value)>::try_from_value(&value) {
        Ok((status, text, value)) => Ok(Reply { status, text, value }),
        Err(_) => {
            let actual = shortened(&format!("{value:?}"));
            let text = format!("the answer is no [status, text, value] but {actual}");
            Err(XmlRpcError::Unusable(text))
        }
    }
}

fn written(xml: Result<String, dxr::Error>) -> Result<String, XmlRpcError> {
    let unwritable = |error: dxr::Error| {
        let reason = shortened(&error.to_string());
        XmlRpcError::Unusable(format!("cannot be written as XML-RPC: {reason}"))
    };
    xml.map(|xml| format!("<?xml version=\"1.0\"?>\n{xml}\n")).map_err(unwritable)
}

fn malformed(what: &str, xml: &str) -> XmlRpcError {
    XmlRpcError::Unusable(format!("this is no XML-RPC {what}: {:?}", shortened(xml)))
}

/// Foreign text for a log line.
pub(crate) fn shortened(text: &str) -> String {
    const SHOWN: usize = 400;
    match text.char_indices().nth(SHOWN) {
        None => text.to_owned(),
        Some((end, _)) => format!("{}…", text.get(..end).unwrap_or_default()),
    }
}

#[cfg(test)]
mod tests;
