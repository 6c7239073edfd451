//! Requests and replies of rpc ports.
//!
//! ```text
//!   Wrapyfi   "[{\"__wrapyfi__\": [\"tuple\", [5]]}, {}]"   ─▶   "{\"i\": 5}"     one string each
//!   others    [set] [pos] 2 10.0                            ─▶   [ok]            plain bottles
//! ```
//!
//! Plain bottles are those of option `bottle`, and of services of ROS: `positional` maps their
//! fields. Servers of YARP say `[fail]` where there is no answer.

use bytes::Bytes;
use wrapyfi_yarp::{Bottle, Dialect, Value as Element};

use super::super::options::{BottleFormat, YarpOptions};
use super::element::{self, Writer};
use super::rules::Rules;
use super::{fault, native, positional};
use wrapyfi_data::types::{
    AudioChunk, DataType, Dtype, Image, Map, Payload, SampleFormat, ServiceKind, Stamp, Tensor,
    Value,
};
use wrapyfi_endpoint::codec::{
    DecodeError, DecodeResult, EncodeError, EncodeResult, json, requests,
};
use wrapyfi_endpoint::{Call, Request, ServiceSpec};

/// First word of the reply of a server that fails.
pub(super) const FAIL: &str = "fail";

/// BottleFormat in which the service's requests are written: JSON unless the service is one of ROS.
/// Pictures and sound are always JSON.
fn format(spec: &ServiceSpec, options: &YarpOptions) -> BottleFormat {
    let usual = match spec.kind {
        ServiceKind::Ros(_) => BottleFormat::Bottle,
        _ => BottleFormat::Json,
    };
    match spec.kind.data_type() {
        DataType::NativeObject => options.bottle.unwrap_or(usual),
        _ => BottleFormat::Json,
    }
}

/// True when requests and replies of the service are JSON, which has no dialects.
pub fn is_json(spec: &ServiceSpec, options: &YarpOptions) -> bool {
    !matches!(spec.kind, ServiceKind::Ros(_)) && format(spec, options) == BottleFormat::Json
}

/// Writes a request: the bytes of a bottle. Option `command` goes before its arguments.
///
/// # Errors
/// When an argument has no form in YARP, or the request exceeds the message size.
pub fn encode_request(
    request: &Request,
    spec: &ServiceSpec,
    options: &YarpOptions,
    dialect: Dialect,
) -> EncodeResult<Bytes> {
    let writer = Writer { dialect, limits: &spec.limits };
    let arguments = match (format(spec, options), spec.kind) {
        (BottleFormat::Json, _) => native::single(requests::encode_request(request, spec)?),
        (_, ServiceKind::Ros(service)) => {
            let fields = positional::call(service.request(), request, spec.limits.message_bytes)?;
            positional::write(&fields, writer)?
        }
        _ => {
            let Call { args, kwargs } = &*requests::call(request)?;
            let mut bottle = writer.elements(args, "$", 1)?;
            if !kwargs.is_empty() {
                bottle.push(Element::Dict(writer.pairs(kwargs, "$", 2)?));
            }
            bottle
        }
    };
    let mut bottle = words(options, writer)?;
    bottle.extend(arguments);
    finish(&bottle, spec, dialect)
}

/// Reads a request, of either dialect. A user who types one sends its arguments in order; a dict in
/// last place has those with names. The words of option `command` are taken off.
///
/// # Errors
/// When it is no request of the service, or exceeds a limit.
pub fn decode_request(
    bytes: &Bytes,
    spec: &ServiceSpec,
    options: &YarpOptions,
    dialect: Dialect,
) -> DecodeResult<Request> {
    DecodeError::check_size(bytes.len(), spec.limits.message_bytes)?;
    native::in_either(bytes, Rules::new(options, dialect, &spec.limits), |rules| {
        decode_request_as(bytes, spec, rules)
    })
}

fn decode_request_as(bytes: &Bytes, spec: &ServiceSpec, rules: Rules<'_>) -> DecodeResult<Request> {
    let mut bottle = native::bottle(bytes, rules)?;
    let words = words(rules.options, rules.writer()).unwrap_or_default();
    if !words.is_empty() && bottle.values.starts_with(&words.values) {
        bottle.values.drain(..words.len());
    }
    if format(spec, rules.options) == BottleFormat::Json
        && let [Element::String(text)] = bottle.values.as_slice()
        && text.as_bytes().trim_ascii_start().starts_with(b"[")
    {
        return requests::decode_request(&text.clone().into_bytes(), spec);
    }
    let mut args: Vec<Value> =
        bottle.values.iter().map(|value| element::to_value(value, rules.dialect)).collect();
    if let ServiceKind::Ros(service) = spec.kind {
        if let Some(kwargs) = positional::by_name(&args, service.request()) {
            return Ok(Request::default().with(kwargs));
        }
        positional::read_truths(&mut args, service.request());
    }
    let kwargs = match args.pop() {
        Some(Value::Map(map)) if map.iter().all(|(key, _)| key.as_str().is_some()) => map,
        last => {
            args.extend(last);
            Map::new()
        }
    };
    Ok(Call { args, kwargs }.into())
}

/// Writes a reply: the bytes of a bottle.
///
/// # Errors
/// When `payload` is not of the service's kind, has no form in YARP, or exceeds the message size.
pub fn encode_reply(
    payload: &Payload,
    spec: &ServiceSpec,
    options: &YarpOptions,
    dialect: Dialect,
) -> EncodeResult<Bytes> {
    let writer = Writer { dialect, limits: &spec.limits };
    let payload = &*requests::without_messages(payload)?;
    let value = match (spec.kind.data_type(), payload) {
        (DataType::NativeObject, Payload::NativeObject(object)) => object.value.clone(),
        (DataType::Image, Payload::Image(image)) => {
            image.to_value(spec.color_order, &spec.limits)?
        }
        (DataType::AudioChunk, Payload::AudioChunk(sound)) => tuple(sound)?,
        (wanted, other) => {
            return Err(EncodeError::mismatch(wanted.to_string(), other.data_type().to_string()));
        }
    };
    let bottle = match (format(spec, options), spec.kind) {
        (BottleFormat::Json, _) => native::single(json::encode(&value, &spec.plugins)?),
        (_, ServiceKind::Ros(service)) => {
            let limit = spec.limits.message_bytes;
            positional::write_reply(&positional::reply(service.response(), &value, limit)?, writer)?
        }
        (_, ServiceKind::NativeObject | ServiceKind::UpstreamNativeObject)
            if value == Value::Null =>
        {
            Bottle::new()
        }
        _ => writer.bottle(&value)?,
    };
    finish(&bottle, spec, dialect)
}

/// Wrapyfi's `(chunk, channels, rate, array)`.
fn tuple(sound: &AudioChunk) -> EncodeResult<Value> {
    let sound = sound.to_format(SampleFormat::F32Le);
    let array = Tensor::new(Dtype::F32, sound.shape(), sound.data).map_err(|error| {
        let remedy = "make chunks with AudioChunk::new";
        fault::unwritable("sound", error.to_string(), "$", remedy)
    })?;
    Ok(Value::Tuple(vec![
        sound.frames.into(),
        sound.channels.into(),
        sound.sample_rate.into(),
        array.into(),
    ]))
}

/// Writes why there is no reply, so that every client ends its call: Wrapyfi's in the JSON that
/// makes them raise an error, others by `[fail]` and the text.
pub fn encode_error(
    text: &str,
    spec: &ServiceSpec,
    options: &YarpOptions,
    dialect: Dialect,
) -> Bytes {
    let bottle = match format(spec, options) {
        BottleFormat::Json => native::single(requests::encode_error(text)),
        // The text form of a bottle writes double quotes with a backslash before each.
        _ => Bottle { values: vec![Element::vocab(FAIL), Element::string(text.replace('"', "'"))] },
    };
    // Neither a vocab of 32 bits nor a string lacks a form.
    native::bytes(&bottle, dialect).unwrap_or_default().into()
}

/// Reads a reply, of either dialect: the payload, or the server's word why there is none. `now` stands
/// in for the time stamp, which replies have not.
///
/// # Errors
/// When it is no reply of the service's kind, or exceeds a limit.
pub fn decode_reply(
    bytes: &Bytes,
    spec: &ServiceSpec,
    options: &YarpOptions,
    dialect: Dialect,
    now: Stamp,
) -> DecodeResult<Result<Payload, String>> {
    DecodeError::check_size(bytes.len(), spec.limits.message_bytes)?;
    native::in_either(bytes, Rules::new(options, dialect, &spec.limits), |rules| {
        decode_reply_as(bytes, spec, rules, now)
    })
}

fn decode_reply_as(
    bytes: &Bytes,
    spec: &ServiceSpec,
    rules: Rules<'_>,
    now: Stamp,
) -> DecodeResult<Result<Payload, String>> {
    let bottle = native::bottle(bytes, rules)?;
    let format = format(spec, rules.options);
    if let (BottleFormat::Json, [Element::String(text)]) = (format, bottle.values.as_slice()) {
        // Pictures and sound come as native objects, too: as arrays.
        let native = ServiceSpec { kind: ServiceKind::NativeObject, ..spec.clone() };
        return match requests::decode_reply(&text.clone().into_bytes(), &native, now)? {
            Ok(Payload::NativeObject(object)) => of_kind(object.value, spec, now).map(Ok),
            other => Ok(other),
        };
    }
    if let ServiceKind::Ros(service) = spec.kind {
        let read = positional::read_reply(&bottle, service.response(), &spec.plugins, rules)?;
        return Ok(read.map(Payload::from));
    }
    if let Some(text) = failure(&bottle) {
        return Ok(Err(text));
    }
    let value = native::decode(&bottle, format, &spec.plugins, rules)?;
    of_kind(value, spec, now).map(Ok)
}

/// Makes the payload of a function of its returned value: pictures and sound come as arrays.
fn of_kind(value: Value, spec: &ServiceSpec, now: Stamp) -> DecodeResult<Payload> {
    Ok(match spec.kind.data_type() {
        DataType::Image => Image::from_value(&value, spec.color_order, now)?.into(),
        DataType::AudioChunk => AudioChunk::from_value(&value, now)?.into(),
        _ => value.into(),
    })
}

/// Error of a server that failed: `[fail] "no such joint"`. The word is a vocab, because a string
/// may be anything.
pub(super) fn failure(bottle: &Bottle) -> Option<String> {
    let (first, rest) = bottle.values.split_first()?;
    if *first != Element::vocab(FAIL) {
        return None;
    }
    Some(match rest {
        [] => "the server answered [fail] without a reason".to_owned(),
        rest => positional::joined(rest),
    })
}

/// The words of option `command`.
fn words(options: &YarpOptions, writer: Writer<'_>) -> EncodeResult<Bottle> {
    options.command.as_deref().map_or(Ok(Bottle::new()), |text| native::typed(text, writer))
}

fn finish(bottle: &Bottle, spec: &ServiceSpec, dialect: Dialect) -> EncodeResult<Bytes> {
    let bytes = native::bytes(bottle, dialect)?;
    EncodeError::check_size(bytes.len(), spec.limits.message_bytes)?;
    Ok(bytes.into())
}
