//! Services of ROS as plain bottles: fields in order.
//!
//! ```text
//!   std_srvs/srv/SetBool   data: true                      ─▶   true
//!                          success: true, message: ""      ◀─   [ok]
//!                          success: false, message: why    ◀─   [fail] why, [nack] why, [nak] why
//!   any other              its fields in order             ─▶   2 10.0
//! ```

use bytes::Bytes;
use wrapyfi_interfaces::dynamic::{DynamicMessage, DynamicValue};
use wrapyfi_yarp::{Bottle, Dialect, Value as Element};

use super::super::options::BottleFormat;
use super::element::{self, Writer};
use super::rules::Rules;
use super::{fault, native, requests, ros};
use wrapyfi_data::plugin::Plugins;
use wrapyfi_data::types::{
    Map, RosType, RosValueError, ServiceKind, Value, fields_of_call, fields_of_return, value_of,
};
use wrapyfi_endpoint::codec::{DecodeError, DecodeResult, EncodeError, EncodeResult};
use wrapyfi_endpoint::{Call, Request, ServiceSpec};

/// The field that the generator of ROS puts into messages without any.
const FILLER: &str = "structure_needs_at_least_one_member";
/// Words by which servers say that it went well, or not.
const GOOD: [&str; 2] = ["ok", "ack"];
const BAD: [&str; 3] = [requests::FAIL, "nack", "nak"];

/// The fields of a request that a call gives.
pub(super) fn call(
    ros_type: RosType,
    request: &Request,
    limit: usize,
) -> EncodeResult<DynamicMessage> {
    let Call { args, kwargs } = &*wrapyfi_endpoint::codec::requests::call(request)?;
    let read = fields_of_call(ros_type, args, kwargs, limit);
    read.map_err(|error| other_fields(ros_type, &error))
}

/// The fields of a reply that a function returned: a dict of them, or their values in order.
pub(super) fn reply(
    ros_type: RosType,
    value: &Value,
    limit: usize,
) -> EncodeResult<DynamicMessage> {
    fields_of_return(ros_type, value, limit).map_err(|error| other_fields(ros_type, &error))
}

fn other_fields(ros_type: RosType, error: &RosValueError) -> EncodeError {
    EncodeError::mismatch(format!("the fields of a {ros_type}"), format!("others: {error}"))
}

/// The values of the fields, in order.
pub(super) fn write(fields: &DynamicMessage, writer: Writer<'_>) -> EncodeResult<Bottle> {
    let Value::Map(fields) = value_of(fields) else { return Ok(Bottle::new()) };
    let values = fields.iter().filter(|(name, _)| name.as_str() != Some(FILLER));
    let at = |(name, value): (&Value, &Value)| {
        writer.element(value, &format!("$.{}", name.as_str().unwrap_or_default()), 1)
    };
    values.map(at).collect()
}

/// As [`write`], with success as `[ok]` or `[fail]`.
pub(super) fn write_reply(fields: &DynamicMessage, writer: Writer<'_>) -> EncodeResult<Bottle> {
    let mut bottle = write(fields, writer)?;
    if let Some((success, message)) = success_and_message(fields) {
        let ([good, ..], [bad, ..]) = (GOOD, BAD);
        let word = if success { good } else { bad };
        bottle.values = vec![Element::vocab(word)];
        if !message.is_empty() {
            bottle.push(message);
        }
    }
    Ok(bottle)
}

/// Answer to the word `help` alone, as YARP's devices give it: what a service of ROS is asked with, and answers.
/// `None` for any other request, and for a service that is asked with one text: that may be the word.
pub(in super::super) fn usage(request: &Bytes, spec: &ServiceSpec) -> Option<Bytes> {
    let ServiceKind::Ros(service) = spec.kind else { return None };
    let limits = fault::limits(&spec.limits);
    let asked = Bottle::decode_whole(request, Dialect::V3, &limits).ok()?;
    let [Element::String(_) | Element::Vocab32(_)] = asked.values.as_slice() else { return None };
    let is_help = asked.get(0).is_some_and(|word| word.is_word("help"));
    let defaults = service.request().plan().default_message();
    let takes_text = matches!(
        defaults.fields().collect::<Vec<_>>().as_slice(),
        [(_, DynamicValue::Text(_) | DynamicValue::Texts(_))]
    );
    if !is_help || takes_text {
        return None;
    }
    let fields = |of: RosType| {
        let fields = of.resolved().definition().map(|text| text.fields.as_slice());
        let fields = fields.unwrap_or_default().iter().filter(|field| field.name != FILLER);
        let fields: Vec<_> =
            fields.map(|field| format!("{} ({})", field.name, field.field_type)).collect();
        if fields.is_empty() { "nothing".to_owned() } else { fields.join(", ") }
    };
    let lines = [
        format!("{} of ROS 2", service.name()),
        format!("takes, in this order or as pairs (name value): {}", fields(service.request())),
        match success_and_message(&service.response().plan().default_message()) {
            Some(_) => "answers [ok], or [fail] and why".to_owned(),
            None => format!("answers: {}", fields(service.response())),
        },
    ];
    let lines = lines.into_iter().map(Element::string);
    let answer = std::iter::once(Element::vocab("many")).chain(lines).collect::<Bottle>();
    // Vocabs of 32 bits and strings are the same in both dialects.
    native::bytes(&answer, Dialect::V3).ok().map(Bytes::from)
}

/// Success and message of a reply that has these fields and no others: most services of ROS.
fn success_and_message(fields: &DynamicMessage) -> Option<(bool, &str)> {
    let mut fields = fields.fields();
    match (fields.next()?, fields.next()?, fields.next()) {
        (("success", DynamicValue::Bool(success)), ("message", message), None) => {
            Some((*success, message.as_str()?))
        }
        _ => None,
    }
}

/// Arguments that are all pairs of a field's name and its value.
pub(super) fn by_name(args: &[Value], ros_type: RosType) -> Option<Map> {
    let defaults = ros_type.plan().default_message();
    let pairs = match args {
        [] => return None,
        [Value::Map(map)] => map.clone(),
        args => ros::as_pairs(args)?,
    };
    let known = |(name, _): (&Value, &Value)| {
        name.as_str().is_some_and(|name| defaults.fields().any(|(field, _)| field == name))
    };
    let all_known = pairs.iter().all(known);
    match all_known.then(|| ros::named(pairs.into(), &defaults))? {
        Value::Map(pairs) => Some(pairs),
        _ => None,
    }
}

/// Reads arguments in order, of which those for a field that is true or false may be 1 or 0.
pub(super) fn read_truths(args: &mut [Value], ros_type: RosType) {
    let defaults = ros_type.plan().default_message();
    let fields = defaults.fields().filter(|(name, _)| *name != FILLER);
    for (value, (_, field)) in args.iter_mut().zip(fields) {
        *value = ros::truth(std::mem::replace(value, Value::Null), Some(field));
    }
}

/// Reads a reply: a dict of its fields, or the server's word that there is none.
pub(super) fn read_reply(
    bottle: &Bottle,
    ros_type: RosType,
    plugins: &Plugins,
    rules: Rules<'_>,
) -> DecodeResult<Result<Value, String>> {
    let defaults = ros_type.plan().default_message();
    let given = match success_and_message(&defaults).and_then(|_| judged(bottle)) {
        Some(fields) => fields,
        None => match requests::failure(bottle) {
            Some(text) => return Ok(Err(text)),
            None => match dict_of_json(bottle, ros_type, plugins, rules) {
                Some(fields) => fields,
                None => in_order(bottle, &defaults, ros_type, rules.dialect)?,
            },
        },
    };
    let named = ros::named(given.into(), &defaults);
    let fields =
        fields_of_return(ros_type, &named, rules.limits.message_bytes).map_err(|error| {
            DecodeError::mismatch(format!("the fields of a {ros_type}"), format!("others: {error}"))
        })?;
    Ok(Ok(value_of(&fields)))
}

/// Success and message in `[ok] …` and `[fail] …`.
fn judged(bottle: &Bottle) -> Option<Map> {
    let (first, rest) = bottle.values.split_first()?;
    let is = |words: &[&str]| words.iter().any(|word| first.is_word(word));
    let success = match (is(&GOOD), is(&BAD)) {
        (true, _) => true,
        (_, true) => false,
        _ => return None,
    };
    Some(Map::from([("success", Value::from(success)), ("message", joined(rest).into())]))
}

/// Values as one text: the only string itself, or the text form of them all.
pub(super) fn joined(values: &[Element]) -> String {
    match values {
        [Element::String(text)] => text.to_string_lossy().into_owned(),
        values => Bottle { values: values.to_vec() }.to_text(),
    }
}

/// Fields in the one string that a function of Wrapyfi answers with: a dict of them, as JSON.
fn dict_of_json(
    bottle: &Bottle,
    ros_type: RosType,
    plugins: &Plugins,
    rules: Rules<'_>,
) -> Option<Map> {
    let [Element::String(text)] = bottle.values.as_slice() else { return None };
    if !text.as_bytes().starts_with(b"{") {
        return None;
    }
    let value = native::decode(bottle, BottleFormat::Json, plugins, rules).ok()?;
    by_name(&[value], ros_type)
}

fn in_order(
    bottle: &Bottle,
    defaults: &DynamicMessage,
    ros_type: RosType,
    dialect: Dialect,
) -> DecodeResult<Map> {
    let values: Vec<Value> =
        bottle.values.iter().map(|value| element::to_value(value, dialect)).collect();
    if let Some(fields) = by_name(&values, ros_type) {
        return Ok(fields);
    }
    let names: Vec<&str> =
        defaults.fields().map(|(name, _)| name).filter(|name| *name != FILLER).collect();
    let last = names.last().and_then(|name| defaults.get(name));
    match (names.as_slice(), last) {
        // Nothing is asked, and `[ok]` is no more than a courtesy.
        ([], _) => Ok(Map::new()),
        ([only], Some(DynamicValue::Primitives(_))) if !matches!(*values, [Value::List(_)]) => {
            Ok(Map::from([(*only, Value::List(values))]))
        }
        (names, Some(DynamicValue::Text(_))) if values.len() > names.len() => {
            let rest = names.len() - 1;
            let text = joined(bottle.values.get(rest..).unwrap_or_default());
            let values = values.into_iter().take(rest).chain([text.into()]);
            Ok(names.iter().copied().zip(values).collect())
        }
        (names, _) if values.len() > names.len() => Err(DecodeError::mismatch(
            format!("{} values, the fields of a {ros_type}", names.len()),
            format!("{} values", values.len()),
        )),
        (names, _) => Ok(names.iter().copied().zip(values).collect()),
    }
}
