//! Bags that tests write, right and wrong.

use std::io::Write as _;

use super::record::op;

/// A field of a header.
pub(crate) type Field<'f> = (&'f str, &'f [u8]);

/// A record: its header and its data.
pub(crate) fn record(fields: &[Field<'_>], data: &[u8]) -> Vec<u8> {
    [sized(&header(fields)), sized(data)].concat()
}

pub(crate) fn header(fields: &[Field<'_>]) -> Vec<u8> {
    let fields = fields.iter().map(|(name, value)| sized(&[name.as_bytes(), b"=", value].concat()));
    fields.collect::<Vec<_>>().concat()
}

fn sized(bytes: &[u8]) -> Vec<u8> {
    [&u32::try_from(bytes.len()).unwrap().to_le_bytes()[..], bytes].concat()
}

/// The first record, as long as rosbag makes it.
pub(crate) fn begin(index_at: u64) -> Vec<u8> {
    let fields: [Field<'_>; 4] = [
        ("op", &[op::BAG_HEADER]),
        ("index_pos", &index_at.to_le_bytes()),
        ("conn_count", &1_u32.to_le_bytes()),
        ("chunk_count", &1_u32.to_le_bytes()),
    ];
    [b"#ROSBAG V2.0\n", &record(&fields, &[b' '; 100])[..]].concat()
}

pub(crate) fn connection(id: u32, topic: &str, definition: &str) -> Vec<u8> {
    let fields: [Field<'_>; 3] =
        [("op", &[op::CONNECTION]), ("conn", &id.to_le_bytes()), ("topic", topic.as_bytes())];
    let data = header(&[
        ("topic", topic.as_bytes()),
        ("type", b"demo/Data"),
        ("md5sum", b"*"),
        ("message_definition", definition.as_bytes()),
        ("latching", b"1"),
    ]);
    record(&fields, &data)
}

pub(crate) fn message(id: u32, seconds: u32, data: &[u8]) -> Vec<u8> {
    let time = u64::from(seconds).to_le_bytes();
    record(&[("op", &[op::MESSAGE]), ("conn", &id.to_le_bytes()), ("time", &time)], data)
}

/// A chunk that claims to unpack to `claimed` bytes.
pub(crate) fn packed(compression: &str, claimed: usize, data: &[u8]) -> Vec<u8> {
    let size = u32::try_from(claimed).unwrap().to_le_bytes();
    let fields: [Field<'_>; 3] =
        [("op", &[op::CHUNK]), ("compression", compression.as_bytes()), ("size", &size)];
    record(&fields, data)
}

/// A chunk of records.
pub(crate) fn chunk(compression: &str, records: &[u8]) -> Vec<u8> {
    packed(compression, records.len(), &pack(compression, records))
}

pub(crate) fn pack(compression: &str, records: &[u8]) -> Vec<u8> {
    match compression {
        "bz2" => {
            let mut out = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::fast());
            out.write_all(records).unwrap();
            out.finish().unwrap()
        }
        "lz4" => {
            let mut out = lz4_flex::frame::FrameEncoder::new(Vec::new());
            out.write_all(records).unwrap();
            out.finish().unwrap()
        }
        _ => records.to_vec(),
    }
}

/// Records of `count` messages of connection 0, each of which has its number in its four bytes.
pub(crate) fn messages(numbers: std::ops::Range<u32>) -> Vec<u8> {
    numbers.flat_map(|number| message(0, number, &number.to_le_bytes())).collect()
}
