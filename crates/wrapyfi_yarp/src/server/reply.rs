//! Replies of a name server, in their two forms.
//!
//! ```text
//!   old:     registration name /cam ip 10.0.0.1 port 10002 type tcp
//!            *** end of message
//!   bottle:  port (name "/cam") (ip "10.0.0.1") (port_number 10002) (carrier tcp)
//! ```
//!
//! The old form is lines, whatever the carrier: over binary tcp, too. That makes a reader of bottles
//! fail, and YARP's own server does it.

use super::registry::Refusal;
use crate::port::names::Registration;
use crate::{Bottle, Value};

/// An answer.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Reply {
    /// Lines, without their ends and without the one that closes them.
    Lines(Vec<Vec<u8>>),
    /// One bottle.
    Bottle(Bottle),
}

/// The line after the last line of an answer.
pub(crate) const END: &str = "*** end of message";

impl Reply {
    /// Reply without lines.
    pub(crate) const fn nothing() -> Self {
        Self::Lines(Vec::new())
    }

    /// `[ok]`.
    pub(crate) fn ok() -> Self {
        Self::Bottle(Bottle::from(vec![Value::vocab("ok")]))
    }

    /// `[fail]`.
    pub(crate) fn fail() -> Self {
        Self::Bottle(Bottle::from(vec![Value::vocab("fail")]))
    }

    /// Reply that a command was refused, in the form in which it was asked.
    pub(crate) fn refused(refusal: &Refusal, bottle: bool) -> Self {
        if bottle {
            let reason = Value::string(refusal.to_string());
            Self::Bottle(Bottle::from(vec![Value::vocab("fail"), reason]))
        } else {
            Self::Lines(vec![format!("refused: {refusal}").into_bytes()])
        }
    }

    /// The reply as a text carrier sends it.
    pub(crate) fn to_text(&self) -> Vec<u8> {
        match self {
            Self::Lines(lines) => {
                let lines = lines.iter().map(Vec::as_slice).chain([END.as_bytes()]);
                lines.flat_map(|line| [line, b"\r\n"]).flatten().copied().collect()
            }
            Self::Bottle(bottle) => [&bottle.to_text_bytes()[..], b"\r\n"].concat(),
        }
    }
}

/// A line of the old form: the text of a bottle without any quotes. Line ends inside strings are
/// escaped by then.
pub(crate) fn line(values: Vec<Value>) -> Vec<u8> {
    let mut text = Bottle::from(values).to_text_bytes();
    text.retain(|&byte| byte != b'"');
    text
}

/// Address of a port as a line.
pub(crate) fn registration(contact: &Registration) -> Vec<u8> {
    let Registration { name, host, port, carrier } = contact;
    line(vec![
        "registration".into(),
        "name".into(),
        name.as_str().into(),
        "ip".into(),
        host.as_str().into(),
        "port".into(),
        i32::from(*port).into(),
        "type".into(),
        carrier.as_str().into(),
    ])
}

/// Address of a port as elements of a bottle.
pub(crate) fn port(contact: Option<&Registration>) -> Vec<Value> {
    let pair = |key: &str, value: Value| Value::from(Bottle::from(vec![key.into(), value]));
    let Some(Registration { name, host, port, carrier }) = contact else {
        let error = vec!["error".into(), Value::Int32(-2), "port not known".into()];
        return vec!["port".into(), Bottle::from(error).into()];
    };
    vec![
        "port".into(),
        pair("name", name.as_str().into()),
        pair("ip", host.as_str().into()),
        pair("port_number", i32::from(*port).into()),
        pair("carrier", carrier.as_str().into()),
    ]
}

/// The text of a value as it is stored: strings without quotes, lists, vocabs and blobs without
/// their brackets.
pub(crate) fn stored(value: &Value) -> String {
    match value {
        Value::String(text) => text.to_string_lossy().into_owned(),
        Value::List(list) | Value::Dict(list) => list.to_text(),
        other => {
            let text = Bottle::from(vec![other.clone()]).to_text();
            let inner = match other {
                Value::Blob(_) => text.strip_prefix('{').and_then(|rest| rest.strip_suffix('}')),
                Value::Vocab32(_) | Value::Vocab64(_) => {
                    text.strip_prefix('[').and_then(|rest| rest.strip_suffix(']'))
                }
                _ => None,
            };
            inner.map_or_else(|| text.clone(), str::to_owned)
        }
    }
}
