//! The mapping, line by line, and what real YARP and real Wrapyfi sent.

mod base;
mod dialects;
mod golden;
mod hostile;
mod messages;
mod pictures;
mod robot;
mod services;

use bytes::Bytes;
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_yarp::port::PortPayload as Bytewise;
use wrapyfi_yarp::{Bottle, Dialect, sig};

use super::*;
use wrapyfi_data::types::{Map, RosMessage, RosType, Value};

/// Time at which messages without a stamp arrive.
const NOW: Stamp = Stamp { sec: 7, nanosec: 8 };

fn topic<const N: usize>(message_type: MessageType, options: [(&str, Value); N]) -> TopicSpec {
    let options = Map::from(options.map(|(name, value)| (Value::from(name), value)));
    TopicSpec { options, ..TopicSpec::new("/t", message_type) }
}

fn ros(name: &str) -> RosType {
    RosType::new(&TypeStore::generated().resolve_name(name).unwrap()).unwrap()
}

fn read(bytes: impl Into<Bytes>, spec: &TopicSpec) -> Result<Payload, DecodeError> {
    let options = YarpOptions::of_topic(spec).unwrap();
    decode(&Bytewise::object(bytes), None, spec, &options, Dialect::V3, NOW)
}

fn written(payload: &Payload, spec: &TopicSpec) -> Result<Outgoing, EncodeError> {
    encode(payload, spec, &YarpOptions::of_topic(spec).unwrap(), Dialect::V3)
}

fn bytes_of(payload: &Payload, spec: &TopicSpec) -> Bytes {
    written(payload, spec).unwrap().payload.bytes
}

/// The bytes of what is typed into `yarp write`.
fn typed(text: &str) -> Vec<u8> {
    let bottle = Bottle::from_text(text.as_bytes(), &wrapyfi_yarp::WireLimits::default()).unwrap();
    bottle.encode(Dialect::V3).unwrap()
}

/// The text that `yarp read` shows.
fn shown(bytes: &Bytes) -> String {
    let limits = wrapyfi_yarp::WireLimits::default();
    Bottle::decode_whole(bytes, Dialect::V3, &limits).unwrap().to_text()
}

fn value(payload: &Payload) -> Value {
    match payload {
        Payload::NativeObject(object) => object.value.clone(),
        Payload::RosMessage(message) => message.to_value(1 << 20).unwrap(),
        other => panic!("{other:?}"),
    }
}

fn message(ros_type: RosType, fields: &Value) -> Payload {
    RosMessage::from_value(ros_type, fields, 1 << 20).unwrap().into()
}

fn list<const N: usize>(items: [Value; N]) -> Value {
    Value::List(items.into())
}

/// Whatever a string holds, it is that string, unless Wrapyfi sends it.
#[test]
fn a_string_of_other_programs_is_itself() {
    let spec = topic(MessageType::NativeObject, []);
    let read = |text: &str, bottle| {
        let options = YarpOptions { bottle, ..YarpOptions::default() };
        let sent = Bytewise::object(typed(text));
        value(&decode(&sent, None, &spec, &options, Dialect::V3, NOW).unwrap())
    };
    for (text, plain, json) in [
        ("\"42\"", Value::from("42"), Value::from(42)),
        ("\"true\"", "true".into(), true.into()),
        ("\"[1]\"", "[1]".into(), list([1.into()])),
        ("\"{\\\"a\\\": 1}\"", "{\"a\": 1}".into(), Map::from([("a", 1)]).into()),
        ("hello", "hello".into(), "hello".into()),
        ("42", list([42.into()]), list([42.into()])),
        ("[ok]", list(["[ok]".into()]), list(["[ok]".into()])),
    ] {
        assert_eq!(read(text, Some(BottleFormat::Plain)), plain, "{text}");
        assert_eq!(read(text, Some(BottleFormat::Json)), json, "{text}");
        assert_eq!(read(text, None), json, "{text}");
    }
}

#[test]
fn objects_are_json_and_any_other_bottle_is_read() {
    let json = topic(MessageType::NativeObject, []);
    let pair = Map::from([("speed", 1.5)]);
    let object = Payload::from(Value::from(pair));
    let bytes = bytes_of(&object, &json);
    assert_eq!(shown(&bytes), r#""{\"speed\": 1.5}""#);
    assert_eq!(read(bytes, &json).unwrap(), object);
    assert_eq!(written(&object, &json).unwrap().stamp, None);
    for (text, wanted) in [
        ("1 2.5 three", list([1.into(), 2.5.into(), "three".into()])),
        ("[set] [pos] 2 true", list(["[set]".into(), "[pos]".into(), 2.into(), true.into()])),
        ("(a 1) (b 2)", list([list(["a".into(), 1.into()]), list(["b".into(), 2.into()])])),
        ("", list([])),
        ("5", list([5.into()])),
        ("\"5\"", 5.into()),
        ("hello", "hello".into()),
        ("\"nan of it\"", "nan of it".into()),
        ("\"[1, 2]\"", list([1.into(), 2.into()])),
    ] {
        assert_eq!(value(&read(typed(text), &json).unwrap()), wanted, "{text}");
    }
    assert_eq!(value(&read(typed("\"{'a'\""), &json).unwrap()), "{'a'".into());
    // A text that was meant to be an object is refused as a text.
    let cut = typed(r#""{\"__wrapyfi__\": [""#);
    assert!(matches!(read(cut, &json), Err(DecodeError::Malformed { .. })));
    assert_eq!(
        read(typed("hello"), &topic(MessageType::StringJson, [])).unwrap(),
        Value::from("hello").into()
    );
}

#[test]
fn objects_are_plain_bottles_on_request() {
    let plain = topic(MessageType::NativeObject, [("bottle", true.into())]);
    for (object, text) in [
        (list(["[set]".into(), 2.into(), 1.5.into()]), "[set] 2 1.5"),
        (list([list([1.into()]), Value::Null]), "(1) [null]"),
    ] {
        let bytes = bytes_of(&object.clone().into(), &plain);
        assert_eq!(shown(&bytes), text);
        assert_eq!(value(&read(bytes, &plain).unwrap()), object);
    }
    assert_eq!(shown(&bytes_of(&Value::from(3).into(), &plain)), "3");
    assert_eq!(value(&read(typed("\"{}\""), &plain).unwrap()), list(["{}".into()]));

    let property = topic(MessageType::NativeObject, [("bottle", "property".into())]);
    let dict = Value::from(Map::from([("a", Value::from(1)), ("b", "x".into())]));
    let bytes = bytes_of(&dict.clone().into(), &property);
    assert_eq!(shown(&bytes), "(a 1) (b x)");
    assert_eq!(value(&read(bytes, &property).unwrap()), dict);
    let error = read(typed("1 2"), &property).unwrap_err().to_string();
    assert_eq!(error, "expected pairs of key and value, received a bottle of 2: 1 2");
    let error = written(&list([1.into()]).into(), &property).unwrap_err().to_string();
    assert!(error.starts_with("expected a dict"), "{error}");
}

#[test]
fn texts_are_strings_and_bottles_their_text_form() {
    let text = topic(MessageType::Text, []);
    let hello = Payload::from(Value::from("[ok] it's \"here\""));
    let bytes = bytes_of(&hello, &text);
    assert_eq!(shown(&bytes), r#""[ok] it's \"here\"""#);
    assert_eq!(read(bytes, &text).unwrap(), hello);
    for (sent, wanted) in [("[ok]", "[ok]"), ("1 2.5 (a b)", "1 2.5 (a b)"), ("", "")] {
        assert_eq!(value(&read(typed(sent), &text).unwrap()), Value::from(wanted));
    }
    let latin = Bottle { values: vec![wrapyfi_yarp::Value::string(b"caf\xe9".to_vec())] };
    let latin = latin.encode(Dialect::V3).unwrap();
    assert_eq!(value(&read(latin, &text).unwrap()), Value::from("caf\u{fffd}"));

    let parsed = topic(MessageType::Text, [("bottle", true.into())]);
    let command = Payload::from(Value::from("[set] [pos] 2 10.0"));
    let bytes = bytes_of(&command, &parsed);
    assert_eq!(*bytes, *typed("[set] [pos] 2 10.0"));
    assert_eq!(read(bytes, &parsed).unwrap(), command);
    let error = written(&Value::from(1).into(), &text).unwrap_err().to_string();
    assert_eq!(error, "expected a text, was given a int");
}

#[test]
fn properties_are_the_dict_of_a_native_object() {
    let spec = topic(MessageType::Properties, []);
    let properties = wrapyfi_data::types::Properties::from([("gain", 2.5)]);
    let bytes = bytes_of(&properties.clone().into(), &spec);
    assert_eq!(shown(&bytes), r#""{\"gain\": 2.5}""#);
    assert_eq!(read(bytes, &spec).unwrap(), properties.into());
}

#[test]
fn an_envelope_is_the_stamp_and_the_other_way_round() {
    let ros_type = ros("std_msgs/msg/Header");
    // Header has no header of its own, but a stamp.
    let spec = topic(MessageType::Ros(ros_type), []);
    let payload = message(ros_type, &Map::from([("frame_id", "map")]).into());
    assert_eq!(written(&payload, &spec).unwrap().stamp, None);
    let payload = read(typed("(frame_id map)"), &spec).unwrap();
    assert_eq!(written(&payload, &spec).unwrap().stamp.unwrap().time_s, NOW.as_secs_f64());

    let object = topic(MessageType::NativeObject, []);
    let sent = Bytewise::object(typed("1 2"));
    let envelope = Some(sig::Stamp { count: 1, time_s: 12.5 });
    let options = YarpOptions::default();
    let payload = decode(&sent, envelope, &object, &options, Dialect::V3, NOW).unwrap();
    let Payload::NativeObject(read) = &payload else { panic!("{payload:?}") };
    assert_eq!(read.stamp, Stamp { sec: 12, nanosec: 500_000_000 });
    assert_eq!(written(&payload, &object).unwrap().stamp.unwrap().time_s, 12.5);

    let sound = topic(MessageType::AudioChunk, []);
    let silence =
        sig::Sound::from_interleaved(&[0, 0], 1, 8000).unwrap().encode(Dialect::V3).unwrap();
    let silence = Bytewise::object(silence);
    let options = YarpOptions::default();
    for (envelope, stamp) in [
        (Some(1_700_000_000.5), Stamp { sec: 1_700_000_000, nanosec: 500_000_000 }),
        (Some(0.0), NOW),
        (Some(f64::NAN), NOW),
        (Some(-1.0), NOW),
        (None, NOW),
    ] {
        let envelope = envelope.map(|time_s| sig::Stamp { count: 42, time_s });
        let payload = decode(&silence, envelope, &sound, &options, Dialect::V3, NOW).unwrap();
        let Payload::AudioChunk(chunk) = &payload else { panic!("{payload:?}") };
        assert_eq!(chunk.stamp, stamp);
        let back = written(&payload, &sound).unwrap().stamp.unwrap();
        assert_eq!((back.count, back.time_s), (0, stamp.as_secs_f64()));
    }
}

#[test]
fn another_kind_and_another_size_are_refused() {
    let spec = topic(MessageType::Image, []);
    let error = written(&Value::Null.into(), &spec).unwrap_err().to_string();
    assert_eq!(error, "expected Image, was given NativeObject");
    let joints = ros("sensor_msgs/msg/JointState");
    let other = message(ros("std_msgs/msg/Header"), &Map::new().into());
    let error = written(&other, &topic(MessageType::Ros(joints), [])).unwrap_err().to_string();
    assert_eq!(error, "expected sensor_msgs/msg/JointState, was given a std_msgs/msg/Header");

    let mut small = topic(MessageType::Text, []);
    small.limits.message_bytes = 20;
    assert!(matches!(
        read(typed("\"a text that is longer\""), &small),
        Err(DecodeError::TooLarge { limit: 20, .. })
    ));
    let long = Value::from("a text that is longer").into();
    assert!(matches!(written(&long, &small), Err(EncodeError::TooLarge { limit: 20, .. })));
}
