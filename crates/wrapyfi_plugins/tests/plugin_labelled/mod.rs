//! Pillow, xarray, pint, zarr and dask arrays: what Wrapyfi's plug-ins wrote (`tests/data/native`),
//! decoded and compared with the descriptions beside it, written again; and what must be refused.

mod dask;
mod pillow;
mod pint;
mod xarray;
mod zarr;

use bytes::Bytes;
use proptest::prelude::*;
use serde_json::{Value as Json, json};
use wrapyfi_data::Limits;
use wrapyfi_data::codec::json as codec;
use wrapyfi_data::types::Value;

/// The vectors of a file that Wrapyfi could encode.
pub(crate) fn vectors(group: &str) -> Vec<Json> {
    let path = format!("{}/tests/data/native/{group}.json", env!("CARGO_MANIFEST_DIR"));
    // NaN inside descriptions is legal to Python, which wrote the file.
    let text = std::fs::read_to_string(path).unwrap().replace(" NaN", " \"NaN\"");
    let file: Json = serde_json::from_str(&text).unwrap();
    let vectors = file["vectors"].as_array().unwrap().clone();
    vectors.into_iter().filter(|vector| vector["wire"].is_string()).collect()
}

pub(crate) fn named(group: &str, name: &str) -> Json {
    vectors(group).into_iter().find(|vector| vector["name"] == name).unwrap()
}

pub(crate) fn wire(vector: &Json) -> Bytes {
    Bytes::from(vector["wire"].as_str().unwrap().to_owned())
}

pub(crate) fn decode(wire: &Bytes) -> Value {
    codec::decode(wire, &Limits::default(), &wrapyfi_plugins::standard()).unwrap()
}

pub(crate) fn encode(value: &Value) -> Bytes {
    codec::encode(value, &wrapyfi_plugins::standard()).unwrap().into()
}

/// Through the graph and back.
pub(crate) fn through_the_graph(value: &Value) -> (String, Value) {
    let plugins = wrapyfi_plugins::standard();
    let (text, tensors) = codec::encode_with_tensors(value, &plugins).unwrap();
    let shown = String::from_utf8(text.clone()).unwrap();
    let again =
        codec::decode_with_tensors(&text.into(), &tensors, &Limits::default(), &plugins).unwrap();
    (shown, again)
}

pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

pub(crate) fn base64(bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for chunk in bytes.chunks(3) {
        let word = chunk.iter().fold(0_u32, |word, byte| word << 8 | u32::from(*byte))
            << (8 * (3 - chunk.len()));
        for place in 0..4 {
            let digit = ALPHABET[(word >> (18 - 6 * place) & 63) as usize];
            text.push(if place <= chunk.len() { char::from(digit) } else { '=' });
        }
    }
    text
}

/// Reason that an object was refused. It must then be carried as it is.
pub(crate) fn refusal(object: &Json) -> String {
    let wire = Bytes::from(json!({"objects": [{"__wrapyfi__": object}]}).to_string());
    let value = decode(&wire);
    let reasons: Vec<_> = value.refusals().map(|(_, reason)| reason.to_owned()).collect();
    let [reason] = &*reasons else { panic!("{object} became {value:?}") };
    let key = object[0].as_str().unwrap();
    assert!(reason.starts_with(&format!("{key} at $.objects[0]: ")), "{reason}");
    let untouched: Json = serde_json::from_slice(&encode(&value)).unwrap();
    assert_eq!(untouched, json!({"objects": [{"__wrapyfi__": object}]}));
    reason.clone()
}

pub(crate) fn assert_refused(cases: &[(Json, &str)]) {
    for (object, wanted) in cases {
        let reason = refusal(object);
        assert!(reason.contains(wanted), "{object}: {reason}");
    }
}

proptest! {
    /// A damaged object does no harm.
    #[test]
    fn damaged_objects_do_no_harm(
        which in 0_usize..16, at in 0_usize..4000, byte: u8, cut: bool,
    ) {
        let all: Vec<Json> = ["pillow", "xarray", "pint", "zarr", "dask"].into_iter().flat_map(vectors).collect();
        let mut wire = wire(&all[which % all.len()]).to_vec();
        let at = at % wire.len();
        if cut { wire.truncate(at) } else { wire[at] = byte }
        let limits = Limits { message_bytes: 1 << 20, ..Limits::default() };
        drop(codec::decode(&wire.into(), &limits, &wrapyfi_plugins::standard()));
    }
}
