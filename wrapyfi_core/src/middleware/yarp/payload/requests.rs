//! Requests and replies of rpc ports.
//!
//! ```text
//!   Wrapyfi   "[{\"__wrapyfi__\": [\"tuple\", [5]]}, {}]"   ─▶   "{\"i\": 5}"       one string each
//!   others    [set] [pos] 2 10.0                            ─▶   [ok]              plain bottles
//! ```

use bytes::Bytes;
use wrapyfi_yarp::{Bottle, Dialect, Value as Element};

use super::super::options::YarpOptions;
use super::fault;
use crate::codec::{DecodeError, EncodeError, requests};
use crate::endpoint::{Request, ServiceSpec};
use crate::types::{Payload, Stamp};

/// Writes a request: the bytes of a bottle.
///
/// # Errors
/// When an argument has no form in YARP, or the request exceeds the message size.
pub fn encode_request(
    request: &Request,
    spec: &ServiceSpec,
    _options: &YarpOptions,
    dialect: Dialect,
) -> Result<Bytes, EncodeError> {
    string(requests::encode_request(request, spec)?, dialect)
}

/// Reads a request.
///
/// # Errors
/// When it is no request of the service, or exceeds a limit.
pub fn decode_request(
    bytes: &Bytes,
    spec: &ServiceSpec,
    _options: &YarpOptions,
    dialect: Dialect,
) -> Result<Request, DecodeError> {
    requests::decode_request(&only_string(bytes, spec, dialect)?, spec)
}

/// Writes a reply: the bytes of a bottle.
///
/// # Errors
/// When `payload` is not of the service's kind, has no form in YARP, or exceeds the message size.
pub fn encode_reply(
    payload: &Payload,
    spec: &ServiceSpec,
    _options: &YarpOptions,
    dialect: Dialect,
) -> Result<Bytes, EncodeError> {
    string(requests::encode_reply(payload, spec)?, dialect)
}

/// Writes why there is no reply, so that every client ends its call.
#[must_use]
pub fn encode_error(
    text: &str,
    _spec: &ServiceSpec,
    _options: &YarpOptions,
    dialect: Dialect,
) -> Bytes {
    string(requests::encode_error(text), dialect).unwrap_or_default()
}

/// Reads a reply: the payload, or the server's word why there is none. `now` stands in for the time
/// stamp, which replies have not.
///
/// # Errors
/// When it is no reply of the service's kind, or exceeds a limit.
pub fn decode_reply(
    bytes: &Bytes,
    spec: &ServiceSpec,
    _options: &YarpOptions,
    dialect: Dialect,
    now: Stamp,
) -> Result<Result<Payload, String>, DecodeError> {
    requests::decode_reply(&only_string(bytes, spec, dialect)?, spec, now)
}

fn string(text: Vec<u8>, dialect: Dialect) -> Result<Bytes, EncodeError> {
    let bottle = Bottle { values: vec![Element::string(text)] };
    bottle.encode(dialect).map(Bytes::from).map_err(|error| fault::encode(&error))
}

fn only_string(bytes: &Bytes, spec: &ServiceSpec, dialect: Dialect) -> Result<Bytes, DecodeError> {
    let bottle = Bottle::decode_whole(bytes, dialect, &fault::limits(&spec.limits));
    match bottle.map_err(|error| fault::bottle(&error))?.values.as_slice() {
        [Element::String(text)] => Ok(text.clone().into_bytes()),
        other => Err(fault::mismatch("one string", format!("{} values", other.len()))),
    }
}
