//! Files recorded from real YARP.

pub(crate) mod conversation;

use std::path::Path;

use bytes::Bytes;
use serde_json::Value;
use wrapyfi_yarp::sig::{Image, ImageHeader};

/// The image with rows at multiples of `quantum` bytes.
pub(crate) fn with_quantum(image: &Image, quantum: u16) -> Image {
    let ImageHeader { pixel, width, height, .. } = *image.header();
    let header = ImageHeader::new(pixel, width, height, quantum).unwrap();
    let mut data = Vec::new();
    for row in image.rows() {
        data.extend_from_slice(row);
        data.resize(data.len() + header.stride - row.len(), 0);
    }
    Image::from_parts(header, data.into()).unwrap()
}

/// Pixels without what is between rows.
pub(crate) fn packed(image: &Image) -> Bytes {
    image.rows().flatten().copied().collect()
}

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

/// Bytes that one side sent in a recording, in order.
pub(crate) fn sent(name: &str, direction: &str) -> Vec<u8> {
    let stream = file(name)["stream"].as_array().unwrap().clone();
    let of_side = stream.iter().filter(|part| part["dir"] == direction);
    of_side.filter_map(|part| part["hex"].as_str()).flat_map(hex).collect()
}

/// Payloads of the data messages that the side sent, in order, of a binary carrier: the index of
/// each message is taken at its word.
pub(crate) fn payloads(name: &str, direction: &str) -> Vec<Bytes> {
    const COMMAND: usize = 8;
    let stream = Bytes::from(sent(name, direction));
    let starts = stream.windows(8).enumerate().filter(|(_, word)| *word == b"YA\x0a\0\0\0RP");
    let mut payloads = Vec::new();
    for (start, _) in starts {
        let blocks = usize::from(stream[start + 8]);
        let lengths = stream[start + 18..].chunks(4).take(blocks);
        let length: i32 = lengths.map(|four| i32::from_le_bytes(four.try_into().unwrap())).sum();
        let body = start + 18 + 4 * blocks + 4;
        let body = stream.slice(body..body + usize::try_from(length).unwrap());
        // An envelope follows the command as text, its length before the tilde.
        let text = i32::from_le_bytes(body[..4].try_into().unwrap());
        let payload = body.slice(COMMAND + usize::try_from(text).unwrap()..);
        if body[5] != 0 || body.get(COMMAND) == Some(&b'D') {
            payloads.push(payload);
        }
    }
    assert!(!payloads.is_empty(), "{name} holds no messages");
    payloads
}
