//! The target of files: bags of ROS 1, up to the recording that is made of them, and recordings.

use std::io::Cursor;

use wrapyfi_bag::recording::{Compression, Reader, Writer};
use wrapyfi_bag::ros1::{BagReader, Limits};
use wrapyfi_bag::{Conversion, ConvertOptions, convert};
use wrapyfi_interfaces::ros1::{Options, Rules, Types};
use wrapyfi_interfaces::store::TypeStore;

use crate::measure;

/// Largest message and largest packed chunk.
const MESSAGE_BYTES: usize = 1 << 16;
const CHUNK_BYTES: u64 = 1 << 18;
/// Memory of readers, of decoders, of the chunk that is written, and of the standard types.
const COMMON: usize = 64 << 20;
/// Memory for each byte of the file, as of the target `ros1_definition`: it may be a definition.
const LINES: usize = 1024;

/// A bag of ROS 1: read to its end and converted, whatever is broken in it; what was written is read again, with as many
/// messages. Else an MCAP file: read until it ends or is refused.
pub fn bag(data: &[u8]) {
    let (_, peak) = measure(|| match data.starts_with(b"#ROSBAG") {
        true => converted(data),
        false => _ = read(data),
    });
    let allowed = data.len() * LINES + COMMON;
    assert!(peak <= allowed, "{} bytes of a file took {peak}, allowed are {allowed}", data.len());
}

fn converted(data: &[u8]) {
    let limits = Limits { message_bytes: MESSAGE_BYTES, chunk_bytes: CHUNK_BYTES };
    let mut bag = match BagReader::open(Cursor::new(data), limits) {
        Ok(bag) => bag,
        Err(error) => return assert!(!error.to_string().is_empty()),
    };
    let types = Types::new(Rules::built_in(), TypeStore::empty());
    let options = Options { message_bytes: MESSAGE_BYTES, ..Options::default() };
    let mut conversion = Conversion::new(types, options);
    let mut out = Writer::new(Cursor::new(Vec::new()), Compression::None).unwrap();
    let all = ConvertOptions::default();
    let report = convert(&mut bag, &mut conversion, &mut out, &all, &mut |_| true).unwrap();
    assert!(report.messages <= data.len() as u64);
    assert_eq!(report.damage.is_none(), report.damage.to_string().is_empty());
    let (file, metadata) = out.finish("fuzzed.mcap", "jazzy").unwrap();
    assert_eq!(metadata.messages(), report.messages);
    assert_eq!(read(&file.into_inner()), Some(report.messages));
}

/// Number of messages; none where the file is refused.
fn read(data: &[u8]) -> Option<u64> {
    let mut recording = Reader::open(Cursor::new(data), MESSAGE_BYTES.max(8 << 20)).ok()?;
    let mut count = 0;
    loop {
        match recording.next_message() {
            Ok(Some(message)) => {
                assert!(recording.topics().get(message.topic).is_some());
                count += 1;
            }
            Ok(None) => return Some(count),
            Err(error) => {
                assert!(!error.to_string().is_empty());
                return None;
            }
        }
    }
}
