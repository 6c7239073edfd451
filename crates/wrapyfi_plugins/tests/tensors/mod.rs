//! Common parts of the tests of tensor plug-ins: recorded messages, and files made by hand.

use std::io::{Cursor, Write as _};

use bytes::Bytes;
use serde_json::{Value as Json, json};
use wrapyfi_data::Limits;
use wrapyfi_data::codec::json as codec;
use wrapyfi_data::types::Value;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// A vector file of `tests/data/native`.
pub fn vectors(group: &str) -> Vec<Json> {
    let path = format!("{}/tests/data/native/{group}.json", env!("CARGO_MANIFEST_DIR"));
    let file: Json = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    file["vectors"].as_array().unwrap().clone()
}

pub fn vector(group: &str, name: &str) -> Json {
    vectors(group).into_iter().find(|vector| vector["name"] == name).unwrap()
}

pub fn wire(vector: &Json) -> Option<Bytes> {
    vector["wire"].as_str().map(|wire| Bytes::from(wire.to_owned()))
}

pub fn decode(wire: &Bytes) -> Value {
    codec::decode(wire, &Limits::default(), &wrapyfi_plugins::standard()).unwrap()
}

pub fn encode(value: &Value) -> Bytes {
    codec::encode(value, &wrapyfi_plugins::standard()).unwrap().into()
}

/// Reason that an object was refused.
pub fn refusal(wire: impl Into<Bytes>) -> String {
    let value = decode(&wire.into());
    let (_, reason) = value.refusals().next().unwrap_or_else(|| panic!("decoded: {value:?}"));
    reason.to_owned()
}

pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

pub fn object(key: &str, file: &[u8], rest: &[&str]) -> Bytes {
    let mut body = vec![json!(key), json!(base64(file))];
    body.extend(rest.iter().map(|part| json!(part)));
    json!({ "__wrapyfi__": body }).to_string().into()
}

pub fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for chunk in bytes.chunks(3) {
        let group = [0, 1, 2].map(|i| u32::from(chunk.get(i).copied().unwrap_or(0)));
        let group = group[0] << 16 | group[1] << 8 | group[2];
        for place in 0..4 {
            let letter = LETTERS[(group >> (18 - 6 * place) & 63) as usize];
            text.push(if place <= chunk.len() { char::from(letter) } else { '=' });
        }
    }
    text
}

/// A torch file with these members, made by another zip writer.
pub fn torch_file(members: &[(&str, &[u8], CompressionMethod)]) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, content, method) in members {
        zip.start_file(*name, SimpleFileOptions::default().compression_method(*method)).unwrap();
        zip.write_all(content).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

/// `data.pkl` of a float tensor over storage 0 of `numel` elements; numbers as Python's LONG1.
pub fn pickled(numel: i64, offset: i64, size: &[i64], stride: &[i64]) -> Vec<u8> {
    fn int(out: &mut Vec<u8>, value: i64) {
        out.extend(b"\x8a\x08");
        out.extend(value.to_le_bytes());
    }
    fn tuple(out: &mut Vec<u8>, values: &[i64]) {
        out.push(b'(');
        values.iter().for_each(|value| int(out, *value));
        out.push(b't');
    }
    let mut out = b"\x80\x02ctorch._utils\n_rebuild_tensor_v2\n((X\x07\0\0\0storagectorch\nFloatStorage\nX\x01\0\0\x000X\x03\0\0\0cpu".to_vec();
    int(&mut out, numel);
    out.extend(b"tQ");
    int(&mut out, offset);
    tuple(&mut out, size);
    tuple(&mut out, stride);
    out.extend(b"\x89ccollections\nOrderedDict\n)RtR.");
    out
}

pub const STORED: CompressionMethod = CompressionMethod::Stored;
pub const DEFLATED: CompressionMethod = CompressionMethod::Deflated;

pub fn torch_wire(pickle: &[u8], storage: &[u8], method: CompressionMethod) -> Bytes {
    let file = torch_file(&[("m/data.pkl", pickle, method), ("m/data/0", storage, method)]);
    object("PytorchTensor", &file, &["cpu"])
}

pub fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}
