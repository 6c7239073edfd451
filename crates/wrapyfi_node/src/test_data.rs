//! Recorded messages and replies of ROS 2 nodes (`tests/data/node/wire.json`).

use std::path::Path;

use bytes::Bytes;
use serde_json::Value;
use wrapyfi_interfaces::Message;

pub(crate) const RMWS: [&str; 2] = ["rmw_cyclonedds_cpp", "rmw_fastrtps_cpp"];

fn unhex(text: &str) -> Vec<u8> {
    let digit = |c: &u8| char::from(*c).to_digit(16).unwrap() as u8;
    text.as_bytes().chunks(2).map(|pair| digit(&pair[0]) << 4 | digit(&pair[1])).collect()
}

/// Topics and payloads of a group, without the header that Cyclone's requests and replies have.
pub(crate) fn group(rmw: &str, name: &str) -> Vec<(String, Bytes)> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/node/wire.json");
    let wire: Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let entry = |entry: &Value| {
        let topic = entry[0].as_str().unwrap().to_owned();
        let mut payload = unhex(entry[1].as_str().unwrap());
        if rmw == "rmw_cyclonedds_cpp" && !topic.starts_with("rt/") {
            payload.drain(4..20);
        }
        (topic, payload.into())
    };
    wire[rmw][name].as_array().unwrap().iter().map(entry).collect()
}

/// Padded as DDS does.
pub(crate) fn padded(cdr: &[u8]) -> Bytes {
    let mut padded = cdr.to_vec();
    padded.resize(padded.len().next_multiple_of(4), 0);
    padded.into()
}

/// A recorded message, without what Fast DDS leaves in its padding.
pub(crate) fn clean<M: Message>(rmw: &str, cdr: &Bytes) -> Bytes {
    match rmw {
        "rmw_cyclonedds_cpp" => cdr.clone(),
        _ => padded(&M::decode(cdr, 1 << 20).unwrap().encode().to_bytes()),
    }
}
