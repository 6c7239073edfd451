//! Targets of the plug-ins that unpack pictures and zarr folders.

use std::io::Write as _;

use bytes::Bytes;
use wrapyfi_data::Limits;
use wrapyfi_data::types::{CompressedFormat, Encoding, Pixels, Value};
use wrapyfi_endpoint::codec::{image_file, json as text};

use crate::tensors::base64;
use crate::{LIMITS, bounded};

/// Limit of a message: what is unpacked may be longer than its file, but not than this.
const LIMIT: usize = 256 << 10;
/// Room for what a WebP decoder takes whatever the picture is.
const WEBP_LIMIT: usize = 17 << 20;
/// Limits for reading back a written value, which may be longer.
const WIDE: Limits = Limits { message_bytes: 64 * LIMIT, ..LIMITS };

/// The value of an object with these parts, written and read again; `None` where it was refused.
fn object(parts: &str) -> Option<Value> {
    let message = Bytes::from(format!(r#"{{"__wrapyfi__": [{parts}]}}"#));
    if message.len() > LIMIT {
        return None;
    }
    let limits = Limits { message_bytes: LIMIT, ..LIMITS };
    let read = bounded(message.len() + LIMIT, 8, || {
        text::decode(&message, &limits, &wrapyfi_plugins::standard())
    });
    let value = read.expect("an object that is refused is carried");
    let written = match (&value, text::encode(&value, &wrapyfi_plugins::standard())) {
        (Value::Tagged(_), carried) => {
            assert_eq!(carried.expect("carried"), message);
            return None;
        }
        (_, written) => written.expect("what was read can be written"),
    };
    let again = text::decode(&written.clone().into(), &WIDE, &wrapyfi_plugins::standard())
        .expect("what was written is read");
    let rewritten =
        text::encode(&again, &wrapyfi_plugins::standard()).expect("what was read can be written");
    assert!(written == rewritten, "changed by writing and reading");
    Some(value)
}

/// A Pillow image. The first byte chooses: a file, or a mode and then a byte each for width and
/// height before the pixels.
pub fn plugin_picture(data: &[u8]) {
    const MODES: [&str; 9] = ["RGB", "RGBA", "L", "1", "I;16", "I;16B", "I", "F", "P"];
    let Some((&choice, file)) = data.split_first() else { return };
    let mode = usize::from(choice).checked_sub(1).and_then(|choice| MODES.get(choice));
    let parts = match (mode, file) {
        (Some(mode), &[width, height, ref pixels @ ..]) => {
            let pixels = base64(pixels);
            format!(r#""PILImage", "{pixels}", [{width}, {height}], "{mode}""#)
        }
        (Some(_), _) => return,
        (None, file) if file.starts_with(b"RIFF") => {
            let (file, limits) =
                (Bytes::copy_from_slice(file), Limits { message_bytes: WEBP_LIMIT, ..LIMITS });
            let read = bounded(WEBP_LIMIT, 3, || image_file::decode(&file, &limits, None));
            if let Ok(raw) = read {
                assert!(raw.data.len() <= WEBP_LIMIT);
            }
            return;
        }
        (None, file) => {
            let latin1: String = file.iter().map(|byte| format!("\\u00{byte:02x}")).collect();
            format!(r#""PILImage", "{latin1}""#)
        }
    };
    let Some(value) = object(&parts) else { return };
    let picture = value.as_picture().expect("a picture");
    // A route to sensor_msgs/Image does this with it.
    let limits = Limits { message_bytes: LIMIT, ..LIMITS };
    // JPEG has a target of its own.
    if let Pixels::Compressed { format: CompressedFormat::Png, data } = &picture.image.pixels {
        let decode = || image_file::decode(data, &limits, Some(Encoding::Bgr8));
        if let Ok(raw) = bounded(data.len() + LIMIT, 8, decode) {
            assert!(raw.data.len() <= LIMIT);
            assert_eq!(raw.data.len(), raw.step as usize * raw.height as usize);
        }
    }
}

/// A zarr folder. The first byte chooses: the zip of an array or of a group, or a chunk, which is put
/// into a zip with the right checksum, packed by the compressor that the byte says.
pub fn plugin_zarr(data: &[u8]) {
    const COMPRESSORS: [&str; 6] = ["blosc", "zlib", "gzip", "lz4", "zstd", "bz2"];
    let Some((&choice, file)) = data.split_first() else { return };
    let parts = match choice {
        0 => format!(r#""ZarrData", "{}", "Array", "x""#, base64(file)),
        1 => format!(r#""ZarrData", "{}", "Group", null"#, base64(file)),
        other => {
            let compressor =
                COMPRESSORS.iter().cycle().nth(usize::from(other)).expect("never ends");
            format!(r#""ZarrData", "{}", "Array", null"#, base64(&folder(compressor, file)))
        }
    };
    if let Some(Value::Tensor(tensor)) = object(&parts) {
        assert_eq!(tensor.data().len(), tensor.element_count() * tensor.dtype().size());
        assert!(tensor.data().len() <= LIMIT);
    }
}

/// An array of 30 x 40 integers in one chunk.
fn folder(compressor: &str, chunk: &[u8]) -> Vec<u8> {
    let metadata = format!(
        r#"{{"zarr_format": 2, "shape": [30, 40], "chunks": [30, 40], "dtype": "<i4", "order": "C",
            "compressor": {{"id": "{compressor}"}}, "filters": null, "fill_value": 0}}"#
    );
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let options =
        zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for (name, content) in [(".zarray", metadata.as_bytes()), ("0.0", chunk)] {
        zip.start_file(name, options).expect("a zip in memory");
        zip.write_all(content).expect("a zip in memory");
    }
    zip.finish().expect("a zip in memory").into_inner()
}
