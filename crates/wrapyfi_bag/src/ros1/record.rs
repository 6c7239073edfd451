//! Headers of records: fields with their names.
//!
//! ```text
//!   size of the header ┆ size of a field ┆ name=value ┆ … ┆ size of the data ┆ data
//! ```

use super::error::Fault;

/// Kinds of records, by the number in the field `op`.
pub(super) mod op {
    pub(in super::super) const MESSAGE: u8 = 2;
    pub(in super::super) const BAG_HEADER: u8 = 3;
    pub(in super::super) const INDEX: u8 = 4;
    pub(in super::super) const CHUNK: u8 = 5;
    pub(in super::super) const CHUNK_INFO: u8 = 6;
    pub(in super::super) const CONNECTION: u8 = 7;
}

/// Fields of a header that this reader needs.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Header<'h> {
    pub(super) op: u8,
    pub(super) connection: Option<u32>,
    pub(super) time_ns: Option<u64>,
    pub(super) compression: Option<&'h [u8]>,
    pub(super) size: Option<u32>,
    pub(super) count: Option<u32>,
    pub(super) index_at: Option<u64>,
    pub(super) connections: Option<u32>,
    pub(super) chunks: Option<u32>,
    pub(super) encryptor: Option<&'h [u8]>,
    pub(super) topic: Option<&'h [u8]>,
}

impl<'h> Header<'h> {
    /// Reads the fields of a header, which has an `op` that is known.
    pub(super) fn parse(bytes: &'h [u8]) -> Result<Self, Fault> {
        let mut header = Self::default();
        for field in fields(bytes) {
            let (name, value) = field?;
            match name {
                b"op" => match value {
                    [op @ op::MESSAGE..=op::CONNECTION] => header.op = *op,
                    _ => return Err(Fault::Header("it is of no kind that bags have")),
                },
                b"conn" => header.connection = Some(number(value)?),
                b"time" => header.time_ns = Some(nanoseconds(value)?),
                b"compression" => header.compression = Some(value),
                b"size" => header.size = Some(number(value)?),
                b"count" => header.count = Some(number(value)?),
                b"index_pos" => header.index_at = Some(long(value)?),
                b"conn_count" => header.connections = Some(number(value)?),
                b"chunk_count" => header.chunks = Some(number(value)?),
                b"encryptor" => header.encryptor = Some(value),
                b"topic" => header.topic = Some(value),
                _ => {}
            }
        }
        match header.op {
            0 => Err(Fault::Header("it does not say of which kind it is")),
            _ => Ok(header),
        }
    }
}

/// Name and value of each field.
pub(super) fn fields(bytes: &[u8]) -> impl Iterator<Item = Result<(&[u8], &[u8]), Fault>> {
    let mut rest = Some(bytes);
    std::iter::from_fn(move || {
        let bytes = rest.take().filter(|bytes| !bytes.is_empty())?;
        let Some((size, behind)) = bytes.split_first_chunk() else {
            return Some(Err(Fault::Header("a field is cut")));
        };
        let size = usize::try_from(u32::from_le_bytes(*size)).unwrap_or(usize::MAX);
        let Some((field, behind)) = behind.split_at_checked(size) else {
            return Some(Err(Fault::Header("a field is longer than the header")));
        };
        let Some(equals) = field.iter().position(|byte| *byte == b'=') else {
            return Some(Err(Fault::Header("a field has no name")));
        };
        rest = Some(behind);
        let (name, value) = field.split_at(equals);
        Some(Ok((name, value.get(1..).unwrap_or_default())))
    })
}

fn number(value: &[u8]) -> Result<u32, Fault> {
    let value = value.try_into().map_err(|_size| Fault::Header("a number has not four bytes"))?;
    Ok(u32::from_le_bytes(value))
}

fn long(value: &[u8]) -> Result<u64, Fault> {
    let value = value.try_into().map_err(|_size| Fault::Header("a number has not eight bytes"))?;
    Ok(u64::from_le_bytes(value))
}

/// Seconds, then nanoseconds.
fn nanoseconds(value: &[u8]) -> Result<u64, Fault> {
    let time = long(value)?;
    Ok((time & u64::from(u32::MAX)) * 1_000_000_000 + (time >> 32))
}
