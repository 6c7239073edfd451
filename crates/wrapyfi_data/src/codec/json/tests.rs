use proptest::prelude::*;

use super::*;
use crate::types::{DateTime, Dtype, Map, NumpyArray};

fn decode(text: &Bytes, limits: &Limits) -> DecodeResult<Value> {
    super::decode(text, limits, &Plugins::none())
}

fn encode(value: &Value) -> EncodeResult<Vec<u8>> {
    super::encode(value, &Plugins::none())
}

fn read(text: &str) -> Result<Value, DecodeError> {
    decode(&Bytes::from(text.to_owned()), &Limits::default())
}

fn reason(text: &str) -> String {
    read(text).unwrap_err().to_string()
}

fn written(value: &Value) -> String {
    String::from_utf8(encode(value).unwrap()).unwrap()
}

#[test]
fn errors_say_where_and_what() {
    for (text, wanted) in [
        ("", "at $: the text ends where a value should be (byte 0)"),
        ("{\"a\": [1, 2, x]}", "at $.a[2]: 'x' where a value should be (byte 13)"),
        ("{\"a\": 1,}", "at $: '}' where a string in double quotes should be"),
        ("{'a': 1}", "'\\'' where a string in double quotes"),
        ("[1 2]", "'2' where ']' should be"),
        ("1 2", "more text follows the value"),
        ("\u{feff}1", "byte order mark"),
        ("\"abc", "a string does not end"),
        ("{\"k\": {\"__wrapyfi__\": [\"tuple\"]}}", "at $.k.__wrapyfi__: tag \"tuple\" without"),
        ("{\"__wrapyfi__\": []}", "a tag without its name"),
        ("{\"__wrapyfi__\": 5}", "begins with its name"),
        ("{\"__wrapyfi__\": [\"set\", [1, [2]]]}", "at $[1]: list cannot be a member of a set"),
        ("{\"__wrapyfi__\": [\"tuple\", 5]}", "int has no members"),
        ("{\"__wrapyfi__\": [\"numpy.ndarray\", 5]}", "'5' where a string"),
        ("{\"__wrapyfi__\": [\"numpy.ndarray\", \"AAA\"]}", "ends inside a group of four"),
        ("{\"a\": {\"__wrapyfi__\": [\"numpy.ndarray\", \"gAROLg==\"]}}", "npy at $.a: a pickle"),
        ("{\"__wrapyfi__\": [\"datetime\", \"NaT\"]}", "\"NaT\" is no date and time"),
        ("{\"__wrapyfi__\": [\"Other\", [tru]]}", "'t' where a value"),
    ] {
        let reason = reason(text);
        assert!(reason.contains(wanted), "{text}: {reason}");
    }
}

#[test]
fn limits_are_kept() {
    let limits = Limits { depth: 3, message_bytes: 60 };
    let read = |text: &str| decode(&Bytes::from(text.to_owned()), &limits);
    assert!(read("[[[1]]]").is_ok());
    let error = read("[0, [[[1]]]]").unwrap_err().to_string();
    assert_eq!(error, "nesting at $[1][0][0] is 4, the limit is 3");
    // A tagged tuple is one level, like the list it stands for.
    let tuple = |inner: &str| format!("{{\"__wrapyfi__\": [\"tuple\", {inner}]}}");
    assert!(read(&tuple("[[[1]]]")).is_ok());
    assert!(read(&tuple("[[[[1]]]]")).is_err());
    assert!(read("{\"__wrapyfi__\": [\"Other\", [[[1]]]]}").is_err());
    let error = read(&" ".repeat(61)).unwrap_err().to_string();
    assert_eq!(error, "message at $ is 61, the limit is 60 (raise max_message_mib)");

    for open in ["[", "{\"a\":", "{\"__wrapyfi__\":[\"tuple\",", "{\"__wrapyfi__\":[\"X\","] {
        let error = decode(&open.repeat(100_000).into(), &Limits::default()).unwrap_err();
        assert!(matches!(error, DecodeError::TooLarge { what: "nesting", .. }), "{error}");
    }
}

#[test]
fn many_short_values_are_refused_before_they_fill_memory() {
    let limits = Limits { message_bytes: 100_000, ..Limits::default() };
    let zeros = |count: usize| Bytes::from(format!("[{}0]", "0,".repeat(count - 1)));
    // Lists grow by doubling, as far as there is room.
    let most = 1 << (1_600_000 / size_of::<Value>()).ilog2();
    assert!(decode(&zeros(most), &limits).is_ok());
    let error = decode(&zeros(most + 1), &limits).expect_err("no room").to_string();
    assert!(error.starts_with("memory of the values at $ is "), "{error}");
    assert!(error.ends_with("the limit is 1600000 (raise max_message_mib)"), "{error}");
    let pairs = format!("{{{}\"\":0}}", "\"\":0,".repeat(9000));
    assert!(decode(&pairs.into(), &limits).is_err());
    for costly in ["[[0]]", "{\"\":[]}", "[[[[0]]]]", "\"\""] {
        let list = format!("[{}0]", format!("{costly},").repeat(95_000 / (costly.len() + 1)));
        let decoded = decode(&list.into(), &limits).map(drop);
        assert!(matches!(decoded, Err(DecodeError::TooLarge { .. })), "{costly}: {decoded:?}");
    }
}

#[test]
fn every_truncation_is_an_error() {
    let text = "{\"a\": [1.5e3, true, null, \"x\\u00e9\"], \"t\": {\"__wrapyfi__\": [\"tuple\", \
                [{\"__wrapyfi__\": [\"Plug\", \"\\u0080\", {\"k\": -1}], \"s\": NaN}]]}, \
                \"d\": {\"__wrapyfi__\": [\"datetime\", \"2024-01-02T03:04:05\"]}}";
    assert!(read(text).is_ok());
    for end in 0..text.len() {
        assert!(read(&text[..end]).is_err(), "{}", &text[..end]);
    }
}

#[test]
fn a_large_claim_in_an_array_allocates_nothing() {
    let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (536870912,), }";
    let file = [b"\x93NUMPY\x01\x00\x41\x00", header.as_bytes()].concat();
    let base64 = base64_simd::STANDARD.encode_to_string(&file);
    let reason = reason(&format!("{{\"__wrapyfi__\": [\"numpy.ndarray\", \"{base64}\"]}}"));
    assert!(reason.contains("needs 4294967296 bytes, 0 follow"), "{reason}");
}

#[test]
fn base64_with_escapes_or_line_breaks_is_read() {
    let tensor = Tensor::new(Dtype::U8, [3], vec![255, 255, 255]).unwrap();
    let text = written(&tensor.clone().into());
    assert!(text.contains("///"), "{text}");
    let escaped = text.replace('/', "\\/").replace("k05V", "k0\\n5V");
    assert_eq!(read(&escaped).unwrap(), Value::Tensor(tensor));
}

#[test]
fn unknown_tags_pass_through_byte_by_byte() {
    let object = "{ \"x\":1,\"__wrapyfi__\" : [\"Plug\", \"\\u00FF\",\t[1]] }";
    let value = read(&format!("[0, {object}]")).unwrap();
    let Value::Tagged(tagged) = &value.as_items().unwrap()[1] else { panic!("{value:?}") };
    assert_eq!((&*tagged.key, &*tagged.json), ("Plug", object.as_bytes()));
    assert_eq!(written(&value), format!("[0, {object}]"));
}

#[test]
fn nested_tuples_and_sets_are_tagged_at_every_level() {
    let value = Value::Tuple(vec![
        1.into(),
        Value::Tuple(vec![2.into(), Value::List(vec![Value::Tuple(vec![])])]),
        Value::Set(vec![Value::Tuple(vec![3.into()])]),
    ]);
    assert_eq!(
        written(&value),
        "{\"__wrapyfi__\": [\"tuple\", [1, {\"__wrapyfi__\": [\"tuple\", [2, [{\"__wrapyfi__\": \
         [\"tuple\", []]}]]]}, {\"__wrapyfi__\": [\"set\", [{\"__wrapyfi__\": [\"tuple\", \
         [3]]}]]}]]}"
    );
    assert_eq!(read(&written(&value)).unwrap(), value);
}

#[test]
fn keys_become_text_as_in_python() {
    let map = Map::from_iter([
        (Value::Int(-2), 1),
        (1.5.into(), 2),
        (f64::NAN.into(), 3),
        (true.into(), 4),
        (Value::Null, 5),
        (Value::Utf16(vec![0xD800]), 6),
    ]);
    let text = "{\"-2\": 1, \"1.5\": 2, \"NaN\": 3, \"true\": 4, \"null\": 5, \"\\ud800\": 6}";
    assert_eq!(written(&map.into()), text);
}

#[test]
fn what_cannot_be_written_is_refused_with_a_remedy() {
    let nested = (0..400).fold(Value::Null, |inner, _| Value::List(vec![inner]));
    for (value, wanted) in [
        (
            Value::from(Map::from([("a", Value::from(vec![Bytes::from("xy").into()]))])),
            "JSON cannot hold 2 raw bytes at $.a[0]; send an array of uint8",
        ),
        (
            Map::from([(Value::Tuple(vec![]), 1)]).into(),
            "a tuple as key of a dict at $; use text, a number, a bool or None",
        ),
        (Value::Set(vec![Value::List(vec![])]), "a list as member of a set at $[0]"),
        (
            Map::from([(TAG, Value::from(vec!["tuple".into()]))]).into(),
            "a dict that a receiver takes for a tagged value at $.__wrapyfi__; use another key",
        ),
        (
            Value::from(num_bigint::BigInt::from(10).pow(4300)),
            "an integer of more than 4300 digits at $; send it as text",
        ),
        (nested, "nested deeper"),
    ] {
        let error = encode(&value).unwrap_err().to_string();
        assert!(error.contains(wanted), "{error}");
    }
    // Under these the receiver keeps the dict as it is.
    for harmless in [Value::Null, "x".into(), vec![Value::Int(1)].into()] {
        let value = Value::from(Map::from([(TAG, harmless)]));
        assert_eq!(read(&written(&value)).unwrap(), value);
    }
}

#[test]
fn tensors_travel_beside_the_text() {
    let tensor = |n: u8| Tensor::new(Dtype::U8, [1], vec![n]).unwrap();
    let dates = NumpyArray::new("'<M8[D]'", 8, [1], vec![0; 8]).unwrap();
    let value = Value::from(vec![
        tensor(1).with_device("cuda:0").into(),
        Value::Tuple(vec![tensor(2).into(), Value::Array(dates)]),
    ]);
    let (text, tensors) = encode_with_tensors(&value, &Plugins::none()).unwrap();
    assert_eq!(tensors, [tensor(1).with_device("cuda:0"), tensor(2)]);
    assert_eq!(text.capacity(), text.len());
    let text = Bytes::from(text);
    assert!(text.starts_with(b"[{\"__wrapyfi__\": [\"tensor\", 0]}, "), "{text:?}");
    let limits = Limits::default();
    assert_eq!(decode_with_tensors(&text, &tensors, &limits, &Plugins::none()).unwrap(), value);

    let error = decode_with_tensors(&text, &tensors[..1], &limits, &Plugins::none())
        .unwrap_err()
        .to_string();
    assert!(error.contains("at $[1][0]: tensor 1 of 1 tensors"), "{error}");
    for index in ["-1", "\"0\"", "18446744073709551616"] {
        let text = format!("{{\"__wrapyfi__\": [\"tensor\", {index}]}}");
        assert!(decode_with_tensors(&text.into(), &tensors, &limits, &Plugins::none()).is_err());
    }
    // Elsewhere `tensor` is a plug-in like any other, which must not turn into an index.
    let plain = decode(&text, &limits).unwrap();
    assert!(matches!(plain.as_items().unwrap()[0], Value::Tagged(_)));
    assert!(encode_with_tensors(&plain, &Plugins::none()).is_err());
}

#[test]
fn a_long_text_keeps_no_memory_that_it_does_not_need() {
    let tensor = Tensor::new(Dtype::F32, [100], vec![7; 400]).unwrap();
    for value in [Value::from(tensor), Value::from("a\n".repeat(100))] {
        let text = encode(&value).unwrap();
        assert_eq!(text.capacity(), text.len());
    }
}

fn any_scalar() -> impl Strategy<Value = Value> {
    let float = proptest::num::f64::ANY.prop_filter("NaN differs from itself", |x| !x.is_nan());
    prop_oneof![
        Just(Value::Null),
        any::<bool>().prop_map(Value::from),
        any::<i64>().prop_map(Value::from),
        any::<[i64; 3]>()
            .prop_map(|[a, b, c]| { Value::from(num_bigint::BigInt::from(a) * b * c) }),
        float.prop_map(Value::from),
        any::<String>().prop_map(Value::from),
        proptest::collection::vec(any::<u16>(), 1..4).prop_map(|units| {
            String::from_utf16(&units).map_or_else(|_| Value::Utf16(units), Value::Str)
        }),
        (0_i64..250_000_000_000_000_000, any::<bool>()).prop_map(|(micros, aware)| {
            let local = chrono::DateTime::from_timestamp_micros(micros).unwrap().naive_utc();
            let offset = aware.then(|| chrono::FixedOffset::east_opt(-19_800).unwrap());
            Value::DateTime(DateTime { local, offset })
        }),
        Just(Value::DateTime64("2024-01-02T03:04:05.123456789".into())),
    ]
}

fn any_value() -> impl Strategy<Value = Value> {
    let array = proptest::collection::vec(any::<f32>(), 0..20)
        .prop_map(|elements| Tensor::from_elements(&[elements.len()], elements).unwrap().into());
    let tagged = "[a-z]{1,8}"
        .prop_filter("tags that are known", |key| {
            !["set", "tuple", "datetime"].contains(&&**key) && !neutral::is_tag(key)
        })
        .prop_map(|key| {
            let json = format!("{{\"__wrapyfi__\": [\"{key}\", \"body\"]}}");
            Value::Tagged(crate::types::Tagged::new(key, json))
        });
    let leaf = prop_oneof![8 => any_scalar(), 1 => array, 1 => tagged];
    leaf.prop_recursive(4, 40, 6, |inner| {
        let items = proptest::collection::vec(inner.clone(), 0..6);
        let pairs = proptest::collection::vec((any::<String>(), inner), 0..6);
        prop_oneof![
            items.clone().prop_map(Value::List),
            items.prop_map(Value::Tuple),
            proptest::collection::vec(any_scalar(), 0..6)
                .prop_map(|members| Value::Set(crate::types::unique_members(members))),
            pairs.prop_map(|pairs| Value::Map(pairs.into_iter().collect())),
        ]
    })
}

proptest! {
    #[test]
    fn written_then_read_is_the_same(value in any_value()) {
        let text = encode(&value).unwrap();
        prop_assert!(text.is_ascii());
        prop_assert_eq!(decode(&text.into(), &Limits::default()).unwrap(), value.clone());
        let (text, tensors) = encode_with_tensors(&value, &Plugins::none()).unwrap();
        let again = decode_with_tensors(&text.into(), &tensors, &Limits::default(), &Plugins::none());
        prop_assert_eq!(again.unwrap(), value);
    }

    #[test]
    fn any_text_is_read_or_refused(text in "[\\[\\]{}\",:0-9a-z_ \\\\-]{0,60}") {
        drop(read(&text));
    }

    #[test]
    fn any_bytes_are_read_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..60)) {
        drop(decode(&bytes.into(), &Limits::default()));
    }
}
