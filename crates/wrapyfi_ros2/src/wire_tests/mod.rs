//! Every payload that was captured from nodes of ROS 2 Jazzy is read and written again, byte for byte.
//!
//! ```text
//!   tests/data/wire/*.json ─ Record ─▶ topics     messages, requests, replies: definitions, CDR
//!                                  ─▶ discovery   names, USER_DATA, who has left
//! ```
//!
//! The pairing of replies with requests is tested in `rust_services`. A payload of a kind that
//! the test does not know makes it fail.

mod definitions;
mod discovery;
mod topics;

use std::collections::BTreeMap;
use std::path::Path;

use bytes::Bytes;
use serde_json::Value;

/// The files, and how many payloads each has.
pub(super) const FILES: [(&str, usize); 5] = [
    ("rmw_cyclonedds_cpp_data", 81),
    ("rmw_fastrtps_cpp_data", 80),
    ("rmw_cyclonedds_cpp_discovery", 36),
    ("rmw_fastrtps_cpp_discovery", 36),
    ("mixed", 41),
];

/// One submessage with data.
pub(super) struct Record {
    /// File and group in which it stands, for messages.
    pub(super) place: String,
    /// DDS topic, or which writer of discovery sent it.
    pub(super) kind: String,
    /// True when a node on Fast DDS sent it, else one on CycloneDDS did.
    pub(super) fast: bool,
    /// Encapsulation header and body; `None` where the capture holds the beginning only.
    pub(super) payload: Option<Bytes>,
    /// Parameter list before the payload.
    pub(super) inline_qos: Bytes,
    json: Value,
}

impl Record {
    fn text(&self, key: &str) -> &str {
        self.json[key].as_str().unwrap_or_else(|| panic!("{}: no {key}", self.place))
    }

    /// GUID of the writer.
    pub(super) fn writer(&self) -> [u8; 16] {
        gid(self.text("writer_guid"))
    }

    #[cfg(feature = "fastdds-services")]
    pub(super) fn sequence(&self) -> i64 {
        self.json["sn"].as_i64().unwrap()
    }
}

/// All records of a file by group.
pub(super) fn records(file: &str) -> BTreeMap<String, Vec<Record>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/wire").join(file);
    let text = std::fs::read_to_string(path.with_extension("json")).unwrap();
    let groups: BTreeMap<String, Vec<Value>> = serde_json::from_str(&text).unwrap();
    let record = |(index, json): (usize, Value), group: &str| {
        let hex = |key: &str| json[key].as_str().map(unhex);
        Record {
            place: format!("{file} {group} {index}"),
            kind: json["kind"].as_str().unwrap().to_owned(),
            fast: json["vendor"] == "010f",
            payload: hex("payload_hex"),
            inline_qos: hex("inline_qos_hex").unwrap_or_default(),
            json,
        }
    };
    let read = |(group, all): (String, Vec<Value>)| {
        let all = all.into_iter().enumerate().map(|one| record(one, &group)).collect();
        (group, all)
    };
    groups.into_iter().map(read).collect()
}

fn unhex(hex: &str) -> Bytes {
    let digits = hex.as_bytes().chunks(2);
    digits.map(|two| u8::from_str_radix(std::str::from_utf8(two).unwrap(), 16).unwrap()).collect()
}

/// `prefix:entity` in hexadecimal.
fn gid(text: &str) -> [u8; 16] {
    unhex(&text.replace(':', ""))[..].try_into().unwrap()
}

/// The parameters of a list, little-endian, up to the sentinel.
pub(super) fn parameters(mut list: &[u8]) -> Vec<(u16, Vec<u8>)> {
    let mut found = Vec::new();
    loop {
        let (head, rest) = list.split_first_chunk::<4>().unwrap();
        let (id, size) = ([head[0], head[1]], [head[2], head[3]]);
        let (value, rest) = rest.split_at(u16::from_le_bytes(size).into());
        if u16::from_le_bytes(id) == 1 {
            assert!(rest.is_empty(), "bytes behind the sentinel");
            return found;
        }
        found.push((u16::from_le_bytes(id), value.to_vec()));
        list = rest;
    }
}

/// The bytes of such a list.
pub(super) fn list_of(parameters: &[(u16, Vec<u8>)]) -> Vec<u8> {
    let mut list = Vec::new();
    for (id, value) in parameters {
        list.extend(id.to_le_bytes());
        list.extend(u16::try_from(value.len()).unwrap().to_le_bytes());
        list.extend(value);
    }
    list.extend([1, 0, 0, 0]);
    list
}

/// All payloads have their test: topics and services, or discovery.
#[test]
fn every_captured_payload_is_read_and_written() {
    let mut definitions = definitions::Definitions::new();
    for (file, count) in FILES {
        let all: Vec<Record> = records(file).into_values().flatten().collect();
        assert_eq!(all.len(), count, "{file}");
        for record in &all {
            if discovery::is_discovery(record) {
                discovery::check(record, &mut definitions);
            } else {
                topics::check(record, &mut definitions);
            }
        }
    }
}
