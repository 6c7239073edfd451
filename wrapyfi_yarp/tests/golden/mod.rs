//! Files recorded from real YARP.
#![allow(dead_code)] // each test program uses some of it

use std::path::Path;

use bytes::Bytes;
use serde_json::Value;

/// A recorded file.
pub(crate) fn file(name: &str) -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{name}: {error}"));
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// The cases of a corpus.
pub(crate) fn cases(name: &str) -> Vec<Value> {
    let cases = file(name)["cases"].as_array().unwrap().clone();
    assert!(!cases.is_empty(), "{name} has no cases");
    cases
}

pub(crate) fn text<'a>(case: &'a Value, key: &str) -> &'a str {
    case[key].as_str().unwrap()
}

pub(crate) fn bytes(case: &Value, key: &str) -> Bytes {
    hex(text(case, key)).into()
}

pub(crate) fn hex(text: &str) -> Vec<u8> {
    let digits = text.as_bytes().chunks(2);
    digits.map(|two| u8::from_str_radix(std::str::from_utf8(two).unwrap(), 16).unwrap()).collect()
}

/// What the side that opened the connection sent, in order.
pub(crate) fn sent(name: &str, direction: &str) -> Vec<u8> {
    let stream = file(name)["stream"].as_array().unwrap().clone();
    let of_side = stream.iter().filter(|part| part["dir"] == direction);
    of_side.filter_map(|part| part["hex"].as_str()).flat_map(hex).collect()
}
