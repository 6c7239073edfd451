//! Decompression of a chunk's bytes.

use std::io::Read;

use bytes::Bytes;

use super::blosc;
use crate::malformed;
use wrapyfi_data::plugin::PluginError;
use wrapyfi_data::types::Value;

/// The compressor that `.zarray` names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Compressor {
    None,
    Blosc,
    Zlib,
    Gzip,
    Lz4,
    Zstd,
}

/// Fault of a chunk that cannot be unpacked.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Fault {
    /// The chunk is broken; the text says how.
    Broken(String),
    /// The chunk is packed in a way that is not read; the text names it.
    Unknown(String),
}

impl From<String> for Fault {
    fn from(reason: String) -> Self {
        Self::Broken(reason)
    }
}

impl Compressor {
    /// Reads the member `compressor`.
    pub(super) fn from_metadata(compressor: Option<&Value>) -> Result<Self, PluginError> {
        let id = match compressor {
            None | Some(Value::Null) => return Ok(Self::None),
            Some(compressor) => compressor.get("id").and_then(Value::as_str),
        };
        let id = id.ok_or_else(|| malformed("$.compressor of .zarray has no id"))?;
        Ok(match id {
            "blosc" => Self::Blosc,
            "zlib" => Self::Zlib,
            "gzip" => Self::Gzip,
            "lz4" => Self::Lz4,
            "zstd" => Self::Zstd,
            other => return Err(unknown(&format!("compressor {other:?}"))),
        })
    }

    /// The `expected` bytes that `packed` stands for. The caller has booked them.
    pub(super) fn unpack(self, packed: &Bytes, expected: usize) -> Result<Bytes, Fault> {
        let unpacked: Bytes = match self {
            Self::None => packed.clone(),
            Self::Blosc => blosc::unpack(packed, expected)?.into(),
            Self::Zlib => read(flate2::read::ZlibDecoder::new(&**packed), expected)?.into(),
            Self::Gzip => read(flate2::read::GzDecoder::new(&**packed), expected)?.into(),
            Self::Lz4 => {
                // The length stands before the block.
                let (length, block) =
                    packed.split_first_chunk::<4>().ok_or("it is cut off".to_owned())?;
                let length = u32::from_le_bytes(*length) as usize;
                if length != expected {
                    return Err(wrong_length(length, expected));
                }
                lz4(block, expected)?.into()
            }
            Self::Zstd => zstd(packed, expected)?.into(),
        };
        if unpacked.len() == expected {
            Ok(unpacked)
        } else {
            Err(wrong_length(unpacked.len(), expected))
        }
    }
}

pub(super) fn unknown(what: &str) -> PluginError {
    PluginError::unsupported(
        format!("{what} of a zarr array"),
        "use none, zlib, gzip, lz4, zstd, or blosc with one of these",
    )
}

pub(super) fn wrong_length(length: usize, expected: usize) -> Fault {
    Fault::Broken(format!("it holds {length} bytes, its chunk is {expected}"))
}

/// Reads all that `source` gives, at most one byte more than `expected`.
pub(super) fn read(source: impl Read, expected: usize) -> Result<Vec<u8>, String> {
    // The vector grows with the bytes that come, not with the claimed size.
    let mut unpacked = Vec::new();
    let most = (expected as u64).saturating_add(1);
    source.take(most).read_to_end(&mut unpacked).map_err(|error| error.to_string())?;
    Ok(unpacked)
}

/// One LZ4 block of `expected` bytes.
pub(super) fn lz4(block: &[u8], expected: usize) -> Result<Vec<u8>, String> {
    /// Largest factor by which an LZ4 block becomes longer.
    const MOST: usize = 255;
    if expected / MOST > block.len() {
        return Err(format!("{} bytes of LZ4 cannot become {expected}", block.len()));
    }
    let mut unpacked = vec![0; expected];
    let length = lz4_flex::block::decompress_into(block, &mut unpacked)
        .map_err(|error| error.to_string())?;
    unpacked.truncate(length);
    Ok(unpacked)
}

/// One Zstandard frame of at most `expected` bytes.
pub(super) fn zstd(frame: &[u8], expected: usize) -> Result<Vec<u8>, String> {
    /// Window that small frames may ask for all the same.
    const WINDOW: u64 = 1 << 20;
    let window = (expected as u64).max(WINDOW);
    let decoder = ruzstd::decoding::StreamingDecoder::new_with_max_window_size(frame, window)
        .map_err(|error| error.to_string())?;
    read(decoder, expected)
}
