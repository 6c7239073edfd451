//! Requests and replies, one line of the table each.

use super::*;
use wrapyfi_data::types::{
    AudioChunk, Encoding, Image, Pixels, RawPixels, SampleFormat, ServiceKind,
};
use wrapyfi_endpoint::{Request, ServiceSpec};

fn service<const N: usize>(kind: &str, options: [(&str, Value); N]) -> ServiceSpec {
    let kind = ServiceKind::resolve(kind, &mut TypeStore::generated()).unwrap();
    let options = Map::from(options.map(|(name, value)| (Value::from(name), value)));
    ServiceSpec { options, ..ServiceSpec::new("/s", kind) }
}

fn ask(request: &Request, spec: &ServiceSpec) -> String {
    let options = YarpOptions::of_service(spec).unwrap();
    shown(&encode_request(request, spec, &options, Dialect::V3).unwrap())
}

fn asked(text: &str, spec: &ServiceSpec) -> Request {
    let options = YarpOptions::of_service(spec).unwrap();
    decode_request(&typed(text).into(), spec, &options, Dialect::V3).unwrap()
}

fn answer(value: Value, spec: &ServiceSpec) -> String {
    let options = YarpOptions::of_service(spec).unwrap();
    shown(&encode_reply(&value.into(), spec, &options, Dialect::V3).unwrap())
}

fn answered(text: &str, spec: &ServiceSpec) -> Result<Value, String> {
    let options = YarpOptions::of_service(spec).unwrap();
    let reply = decode_reply(&typed(text).into(), spec, &options, Dialect::V3, NOW).unwrap();
    reply.map(|payload| value(&payload))
}

#[test]
fn help_tells_how_a_service_is_asked() {
    let told = |kind: &str, text: &str| {
        usage(&typed(text).into(), &service(kind, [])).map(|answer| shown(&answer))
    };
    assert_eq!(
        told("std_srvs/srv/SetBool", "help").unwrap(),
        "[many] \"std_srvs/srv/SetBool of ROS 2\" \"takes, in this order or as pairs (name value): data \
         (bool)\" \"answers [ok], or [fail] and why\""
    );
    assert!(told("std_srvs/srv/Trigger", "[help]").unwrap().contains("nothing"));
    for (kind, text) in [
        ("std_srvs/srv/SetBool", "true"),
        ("std_srvs/srv/SetBool", "help me"),
        ("NativeObject", "help"),
        // Texts, which may be that word.
        ("rcl_interfaces/srv/GetParameters", "help"),
    ] {
        assert_eq!(told(kind, text), None, "{kind} {text}");
    }
}

#[test]
fn a_service_that_says_no_has_failed() {
    let spec = service("std_srvs/srv/SetBool", []);
    for text in ["[nak] busy", "[nack] busy", "[fail] busy", "nak busy"] {
        let told = answered(text, &spec).unwrap();
        assert_eq!(told.get("success"), Some(&false.into()), "{text}");
        assert_eq!(told.get("message"), Some(&"busy".into()), "{text}");
    }
}

#[test]
fn functions_of_wrapyfi_are_json() {
    let spec = service("NativeObject", []);
    let call = Request::new([5.into()]).with(Map::from([("scale", 0.5)]));
    let text = ask(&call, &spec);
    assert_eq!(text, r#""[{\"__wrapyfi__\": [\"tuple\", [5]]}, {\"scale\": 0.5}]""#);
    assert_eq!(asked(&text, &spec), call);
    assert_eq!(answer(Value::Null, &spec), "null");
    assert_eq!(answered("\"{\\\"i\\\": 5}\"", &spec), Ok(Map::from([("i", 5)]).into()));
    // A user who types a request need not know JSON, nor does a server that answers one.
    assert_eq!(asked("on 0.5", &spec), Request::new(["on".into(), 0.5.into()]));
    assert_eq!(asked("on", &spec), Request::new(["on".into()]));
    assert_eq!(asked("", &spec), Request::default());
    assert_eq!(answered("[ok] 3", &spec), Ok(list(["[ok]".into(), 3.into()])));
    assert_eq!(answered("[fail] \"no lamp\"", &spec), Err("no lamp".into()));
    assert!(answered("[fail]", &spec).unwrap_err().contains("without a reason"));
    let options = YarpOptions::default();
    let error = encode_error("no \"lamp\"", &spec, &options, Dialect::V3);
    let read = decode_reply(&error, &spec, &options, Dialect::V3, NOW).unwrap();
    assert_eq!(read, Err("no \"lamp\"".into()));
}

#[test]
fn plain_bottles_are_arguments_in_order() {
    let spec = service("NativeObject", [("bottle", true.into())]);
    let call = Request::new(["[set]".into(), "[pos]".into(), 2.into(), 10.0.into()]);
    assert_eq!(ask(&call, &spec), "[set] [pos] 2 10.0");
    assert_eq!(asked("[set] [pos] 2 10.0", &spec), call);
    let named = Request::new([1.into()]).with(Map::from([("scale", 0.5)]));
    let options = YarpOptions::of_service(&spec).unwrap();
    let bytes = encode_request(&named, &spec, &options, Dialect::V3).unwrap();
    assert_eq!(shown(&bytes), "1 ((scale 0.5))");
    assert_eq!(decode_request(&bytes, &spec, &options, Dialect::V3).unwrap(), named);
    assert_eq!(answer(list(["[is]".into(), 1.5.into()]), &spec), "[is] 1.5");
    assert_eq!(answer(Value::Null, &spec), "");
    assert_eq!(
        answered("[is] [encs] (1.0 2.0) [ok]", &spec),
        Ok(list(["[is]".into(), "[encs]".into(), list([1.0.into(), 2.0.into()]), "[ok]".into()]))
    );
    let error = encode_error("why", &spec, &options, Dialect::V3);
    assert_eq!(shown(&error), "[fail] why");
    let property = service("NativeObject", [("bottle", "property".into())]);
    assert_eq!(answered("(a 1)", &property), Ok(Map::from([("a", 1)]).into()));
}

#[test]
fn words_of_a_command_go_before_the_arguments() {
    let spec = service("std_srvs/srv/SetBool", [("command", "[set] [stif]".into())]);
    let on = Request::default().with(Map::from([("data", true)]));
    assert_eq!(ask(&on, &spec), "[set] [stif] true");
    assert_eq!(asked("[set] [stif] true", &spec), Request::new([true.into()]));
    assert_eq!(asked("false", &spec), Request::new([false.into()]));
    let trigger = service("std_srvs/srv/Trigger", [("command", "[get] [encs]".into())]);
    assert_eq!(ask(&Request::default(), &trigger), "[get] [encs]");
}

#[test]
fn services_of_ros_succeed_or_fail_in_words() {
    let spec = service("std_srvs/srv/SetBool", []);
    assert_eq!(ask(&Request::new([true.into()]), &spec), "true");
    assert_eq!(
        asked("(data true)", &spec).into_call().unwrap().kwargs,
        Map::from([("data", true)])
    );
    // As older bottles have it.
    for (text, wanted) in [("1", true), ("0", false), ("(data 1)", true)] {
        let call = asked(text, &spec).into_call().unwrap();
        let given = call.kwargs.get("data").or(call.args.first()).cloned();
        assert_eq!(given, Some(Value::from(wanted)), "{text}");
    }
    let read = asked("2", &spec);
    assert_eq!(read, Request::new([2.into()]), "no truth");
    let error = encode_error("no \"lamp\"", &spec, &YarpOptions::default(), Dialect::V3);
    assert_eq!(shown(&error), "[fail] \"no 'lamp'\"");
    let verdict = |success: bool, message: &str| {
        Value::from(Map::from([("success", Value::from(success)), ("message", message.into())]))
    };
    for (text, success, message) in [
        ("[ok]", true, ""),
        ("ok", true, ""),
        ("[ack] \"lamp is on\"", true, "lamp is on"),
        ("[fail] \"no lamp\"", false, "no lamp"),
        ("[nack]", false, ""),
        ("true done", true, "done"),
        ("1 done", true, "done"),
        ("false \"no lamp\" 3", false, "\"no lamp\" 3"),
        ("(success true) (message done)", true, "done"),
        // As a function of Wrapyfi returns a dict.
        (r#""{\"success\": true, \"message\": \"done\"}""#, true, "done"),
    ] {
        assert_eq!(answered(text, &spec), Ok(verdict(success, message)), "{text}");
    }
    assert_eq!(answer(verdict(true, ""), &spec), "[ok]");
    assert_eq!(answer(verdict(false, "no lamp"), &spec), "[fail] \"no lamp\"");
    let options = YarpOptions::default();
    let other = decode_reply(&typed("perhaps").into(), &spec, &options, Dialect::V3, NOW);
    assert!(matches!(other, Err(DecodeError::Mismatch { .. })), "{other:?}");
    let json = service("std_srvs/srv/SetBool", [("bottle", false.into())]);
    assert!(ask(&Request::new([true.into()]), &json).contains("__wrapyfi__"));
    let error = encode_request(&Request::new([1.into(), 2.into()]), &spec, &options, Dialect::V3);
    assert!(matches!(error, Err(EncodeError::Mismatch { .. })), "{error:?}");
}

#[test]
fn other_services_of_ros_have_their_fields_in_order() {
    let spec = service("rcl_interfaces/srv/GetParameters", []);
    let names: Value = ["gain", "rate"].into_iter().collect();
    let call = Request::default().with(Map::from([("names", names)]));
    assert_eq!(ask(&call, &spec), "(gain rate)");
    let options = YarpOptions::default();
    let empty = service("std_srvs/srv/Empty", []);
    assert_eq!(ask(&Request::default(), &empty), "");
    assert!(answered("[ok]", &empty).is_ok());
    assert_eq!(answered("[fail] off", &empty), Err("off".into()));
    let many = decode_reply(&typed("1 2 3").into(), &spec, &options, Dialect::V3, NOW);
    let error = many.unwrap_err().to_string();
    assert!(error.ends_with("received 3 values"), "{error}");
}

#[test]
fn pictures_and_sounds_are_arrays_in_json() {
    let options = YarpOptions::default();
    let round = |payload: &Payload, spec: &ServiceSpec| {
        let bytes = encode_reply(payload, spec, &options, Dialect::V3).unwrap();
        decode_reply(&bytes, spec, &options, Dialect::V3, NOW).unwrap().unwrap()
    };
    let spec = service("Image", []);
    let raw = RawPixels::dense(2, 1, Encoding::Bgr8, vec![1, 2, 3, 4, 5, 6]).unwrap();
    let picture = Payload::from(Image::new(NOW, Pixels::Raw(raw)));
    assert_eq!(round(&picture, &spec), picture);
    let spec = service("AudioChunk", []);
    let data: Vec<u8> = [0.5_f32, -0.5].into_iter().flat_map(f32::to_le_bytes).collect();
    let sound = AudioChunk::new(NOW, 2, 1, 8000, SampleFormat::F32Le, data).unwrap();
    let sound = Payload::from(sound);
    assert_eq!(round(&sound, &spec), sound);
    let wrong = encode_reply(&Value::Null.into(), &spec, &options, Dialect::V3);
    assert!(matches!(wrong, Err(EncodeError::Mismatch { .. })));
}
