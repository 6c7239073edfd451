//! Serialised messages through RustDDS as they are.
//!
//! ```text
//!   Bytes ── RawCdr ──▶ RustDDS puts the encapsulation header in front
//!   Received ◀── RawCdr { limit } ── RustDDS has cut it off: it is put back, body copied once
//! ```
//!
//! RustDDS gives the adapter of a writer one encoding for all that it writes: little-endian CDR, as
//! every ROS 2 message is.

use std::convert::Infallible;

use bytes::{Bytes, BytesMut};
use rustdds::RepresentationIdentifier;
use rustdds::no_key::{Decode, DeserializerAdapter, SerializerAdapter};

/// Encapsulation header of plain CDR, little-endian.
pub(super) const CDR_LE: [u8; 4] = [0, 1, 0, 0];
/// The same, big-endian.
const CDR_BE: [u8; 4] = [0, 0, 0, 0];

/// Passes bodies on.
pub(super) struct RawCdr;

/// Content of one sample that a reader received.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Received {
    /// Encapsulation header and body.
    Message(Bytes),
    /// Size in bytes, with the header, of a message over the limit: not copied.
    TooLarge(usize),
}

/// Copies bodies that keep within `limit` bytes, header included.
#[derive(Debug, Clone, Copy)]
pub(super) struct Within {
    pub(super) limit: usize,
}

impl SerializerAdapter<Bytes> for RawCdr {
    type Error = Infallible;

    fn output_encoding() -> RepresentationIdentifier {
        RepresentationIdentifier::CDR_LE
    }

    fn to_bytes(body: &Bytes) -> Result<Bytes, Infallible> {
        Ok(body.clone())
    }
}

impl DeserializerAdapter<Received> for RawCdr {
    type Error = Infallible;
    type Decoded = Received;

    fn supported_encodings() -> &'static [RepresentationIdentifier] {
        &[RepresentationIdentifier::CDR_LE, RepresentationIdentifier::CDR_BE]
    }

    fn transform_decoded(decoded: Received) -> Received {
        decoded
    }
}

impl Decode<'_, Received> for Within {
    type Error = Infallible;

    fn decode_bytes(
        self,
        body: &[u8],
        encoding: RepresentationIdentifier,
    ) -> Result<Received, Infallible> {
        let header = if encoding == RepresentationIdentifier::CDR_BE { CDR_BE } else { CDR_LE };
        let size = header.len().saturating_add(body.len());
        if size > self.limit {
            return Ok(Received::TooLarge(size));
        }
        let mut message = BytesMut::with_capacity(size);
        message.extend_from_slice(&header);
        message.extend_from_slice(body);
        Ok(Received::Message(message.freeze()))
    }
}

/// Fault of a message that is to be written.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(super) enum BodyError {
    /// The first four bytes are no header that RustDDS can write.
    #[error(
        "its encapsulation header is {0:02x?}, RustDDS writes {CDR_LE:02x?} only (little-endian CDR)"
    )]
    Encapsulation(Vec<u8>),
    /// Longer than RTPS can say.
    #[error("it has {0} bytes, an RTPS sample at most {max}", max = MAX_BYTES)]
    TooLong(usize),
}

/// RTPS counts the bytes of a sample in 32 bits; RustDDS adds to that number in places.
const MAX_BYTES: usize = i32::MAX as usize;

/// Body of a message given in pieces, header first, padded with zeros to whole words as Fast DDS
/// pads it. One copy.
///
/// # Errors
/// When the header is another than [`CDR_LE`], or the message is too long.
pub(super) fn body(parts: &[&[u8]]) -> Result<Bytes, BodyError> {
    let size = parts.iter().fold(0_usize, |sum, part| sum.saturating_add(part.len()));
    if size > MAX_BYTES {
        return Err(BodyError::TooLong(size));
    }
    let mut header = Vec::with_capacity(CDR_LE.len());
    let mut body = BytesMut::with_capacity(size.next_multiple_of(4));
    for part in parts {
        let (begin, rest) = part.split_at(part.len().min(CDR_LE.len() - header.len()));
        header.extend_from_slice(begin);
        body.extend_from_slice(rest);
    }
    // The two bytes after the encoding are options that a reader ignores; RustDDS writes zeros.
    if header.get(..2) != Some(&CDR_LE[..2]) || header.len() < CDR_LE.len() {
        return Err(BodyError::Encapsulation(header));
    }
    body.resize(body.len().next_multiple_of(4), 0);
    Ok(body.freeze())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_may_be_cut_anywhere() {
        let whole = [0, 1, 0, 0, 1, 2, 3, 4, 5];
        let padded: &[u8] = &[1, 2, 3, 4, 5, 0, 0, 0];
        for cut in 0..=whole.len() {
            let (a, b) = whole.split_at(cut);
            assert_eq!(body(&[a, b]).as_deref(), Ok(padded), "cut at {cut}");
        }
        assert_eq!(body(&[&[0, 1, 0, 0]]).as_deref(), Ok(&[][..]));
        assert_eq!(body(&[&[0, 1], &[0, 3], &[7, 7, 7, 7]]).as_deref(), Ok(&[7; 4][..]));
    }

    #[test]
    fn another_encapsulation_is_refused() {
        for wrong in [&[][..], &[0, 1, 0], &[0, 0, 0, 0, 1], &[0, 7, 0, 0, 1]] {
            let header = wrong.get(..4).unwrap_or(wrong).to_vec();
            assert_eq!(body(&[wrong]), Err(BodyError::Encapsulation(header)));
        }
    }

    #[test]
    fn what_is_over_the_limit_is_not_copied() {
        let decode = |limit, encoding| Within { limit }.decode_bytes(&[9, 8], encoding).unwrap();
        let le = RepresentationIdentifier::CDR_LE;
        let be = RepresentationIdentifier::CDR_BE;
        let message = |bytes: &'static [u8]| Received::Message(Bytes::from_static(bytes));
        assert_eq!(decode(6, le), message(&[0, 1, 0, 0, 9, 8]));
        assert_eq!(decode(6, be), message(&[0, 0, 0, 0, 9, 8]));
        assert_eq!(decode(5, le), Received::TooLarge(6));
    }
}
