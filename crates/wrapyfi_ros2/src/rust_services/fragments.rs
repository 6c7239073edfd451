//! A sample in fragments that say whose it is, as RTPS datagrams.
//!
//! ```text
//!   sample, identity ─▶ RTPS │ INFO_DST │ INFO_TS │ DATA_FRAG { inline QoS, a few fragments }   ┐
//!                       RTPS │ INFO_DST │ INFO_TS │ DATA_FRAG { inline QoS, the next few }      ┘ …
//! ```
//!
//! RustDDS 0.15 puts a byte too many in front of the inline QoS of a fragment, so these are made
//! here. OMG DDSI-RTPS 2.5, 8.3.8.3, 9.4.5.4 and 9.6.4.

use super::adapter::CDR_LE;
use super::identity;
use crate::discovery_info::Gid;

/// Bytes of a fragment: those of RustDDS, because all fragments of a writer are of one size.
pub(super) const FRAGMENT: usize = 256;
/// Bytes of a datagram beside its fragments.
pub(super) const AROUND: usize = 20 + (4 + 12) + (4 + 8) + (4 + 32) + INLINE_QOS;
/// The identity under both ids that Fast DDS writes, and the end of the list.
const INLINE_QOS: usize = 2 * (4 + identity::BYTES) + 4;

const INFO_DST: u8 = 0x0e;
const INFO_TS: u8 = 0x09;
const DATA_FRAG: u8 = 0x16;
/// Little-endian.
const LITTLE: u8 = 1;
/// Flag of a fragment with inline QoS.
const WITH_QOS: u8 = 2;
/// `PID_RELATED_SAMPLE_IDENTITY`, and what Fast DDS had before there was one.
const RELATED: [u16; 2] = [0x0083, 0x800f];
const SENTINEL: u16 = 1;
/// Bytes of a DATA_FRAG from behind this number to the inline QoS.
const TO_QOS: u16 = 28;

/// A sample of a writer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Identified<'a> {
    /// GUID of the writer that sends it.
    pub(super) writer: Gid,
    /// The writer's number for it.
    pub(super) number: i64,
    /// Related sample identity: whose it is.
    pub(super) related: (Gid, i64),
    /// RTPS time: seconds and 2^-32 seconds.
    pub(super) stamp: u64,
    /// Message without its encapsulation header; whole words.
    pub(super) body: &'a [u8],
}

impl Identified<'_> {
    /// The sample for one reader, at most `room` bytes in each datagram where that is enough for
    /// one fragment.
    pub(super) fn datagrams(&self, reader: Gid, room: usize) -> impl Iterator<Item = Vec<u8>> {
        let payload = self.payload_len();
        // 16 bits count the bytes of a submessage.
        let most = room.min(usize::from(u16::MAX)).saturating_sub(AROUND);
        let each = (most / FRAGMENT).max(1);
        let count = payload.div_ceil(FRAGMENT);
        (0..count)
            .step_by(each)
            .filter_map(move |first| self.datagram(reader, first, each.min(count - first)))
    }

    fn payload_len(&self) -> usize {
        CDR_LE.len().saturating_add(self.body.len())
    }

    /// `None` where the sample has more bytes than RTPS can say.
    fn datagram(&self, reader: Gid, first: usize, fragments: usize) -> Option<Vec<u8>> {
        let begin = first * FRAGMENT;
        let end = (begin + fragments * FRAGMENT).min(self.payload_len());
        let (prefix, reader_id) = reader.split_at(12);
        let (own_prefix, writer_id) = self.writer.split_at(12);
        let mut out = Vec::with_capacity(AROUND + end - begin);
        out.extend_from_slice(b"RTPS");
        // Version 2.4 and RustDDS's vendor id, as its own messages have.
        out.extend_from_slice(&[2, 4, 0x01, 0x12]);
        out.extend_from_slice(own_prefix);
        out.extend_from_slice(&[INFO_DST, LITTLE, 12, 0]);
        out.extend_from_slice(prefix);
        out.extend_from_slice(&[INFO_TS, LITTLE, 8, 0]);
        put_halves(&mut out, self.stamp);
        let length = u16::try_from(32 + INLINE_QOS + end - begin).ok()?;
        out.extend_from_slice(&[DATA_FRAG, LITTLE | WITH_QOS]);
        out.extend_from_slice(&length.to_le_bytes());
        out.extend_from_slice(&[0, 0]);
        out.extend_from_slice(&TO_QOS.to_le_bytes());
        out.extend_from_slice(reader_id);
        out.extend_from_slice(writer_id);
        put_halves(&mut out, self.number.cast_unsigned());
        out.extend_from_slice(&u32::try_from(first + 1).ok()?.to_le_bytes());
        out.extend_from_slice(&u16::try_from(fragments).ok()?.to_le_bytes());
        out.extend_from_slice(&u16::try_from(FRAGMENT).ok()?.to_le_bytes());
        out.extend_from_slice(&u32::try_from(self.payload_len()).ok()?.to_le_bytes());
        for id in RELATED {
            out.extend_from_slice(&id.to_le_bytes());
            out.extend_from_slice(&u16::try_from(identity::BYTES).ok()?.to_le_bytes());
            out.extend_from_slice(&self.related.0);
            put_halves(&mut out, self.related.1.cast_unsigned());
        }
        out.extend_from_slice(&SENTINEL.to_le_bytes());
        out.extend_from_slice(&[0, 0]);
        // The encapsulation header is the beginning of the first fragment.
        let header = CDR_LE.get(begin..).unwrap_or_default();
        out.extend_from_slice(header);
        let body = begin.saturating_sub(CDR_LE.len())..end - CDR_LE.len();
        out.extend_from_slice(self.body.get(body)?);
        Some(out)
    }
}

/// Numbers and times are two words, the higher one first.
fn put_halves(out: &mut Vec<u8>, value: u64) {
    for half in [value >> 32, value & u64::from(u32::MAX)] {
        out.extend_from_slice(half.to_le_bytes().first_chunk::<4>().unwrap_or(&[0; 4]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WRITER: Gid = [1, 0x12, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 0, 0, 5, 3];
    const READER: Gid = [1, 0x0f, 9, 9, 9, 9, 9, 9, 9, 9, 9, 9, 0, 0, 0x13, 4];

    fn sample(body: &[u8]) -> Identified<'_> {
        Identified {
            writer: WRITER,
            number: (1 << 32) + 7,
            related: (READER, 5),
            stamp: (3 << 32) + 4,
            body,
        }
    }

    #[test]
    fn a_datagram_is_laid_out_as_the_standard_says() {
        let body: Vec<u8> = (0..300).map(|n| (n % 251) as u8).collect();
        let sent: Vec<_> = sample(&body).datagrams(READER, 0).collect();
        assert_eq!(sent.len(), 2);
        let mut expected = b"RTPS\x02\x04\x01\x12".to_vec();
        expected.extend_from_slice(&WRITER[..12]);
        expected.extend_from_slice(&[0x0e, 1, 12, 0]);
        expected.extend_from_slice(&READER[..12]);
        expected.extend_from_slice(&[9, 1, 8, 0, 3, 0, 0, 0, 4, 0, 0, 0]);
        // Header, endianness and inline QoS; 32 + 60 + 48 bytes.
        expected.extend_from_slice(&[0x16, 3, 140, 0, 0, 0, 28, 0]);
        expected.extend_from_slice(&READER[12..]);
        expected.extend_from_slice(&WRITER[12..]);
        expected.extend_from_slice(&[1, 0, 0, 0, 7, 0, 0, 0]);
        // Fragment 2, one of them, 256 bytes each, of 304.
        expected.extend_from_slice(&[2, 0, 0, 0, 1, 0, 0, 1, 48, 1, 0, 0]);
        for id in [[0x83, 0], [0x0f, 0x80]] {
            expected.extend_from_slice(&id);
            expected.extend_from_slice(&[24, 0]);
            expected.extend_from_slice(&READER);
            expected.extend_from_slice(&[0, 0, 0, 0, 5, 0, 0, 0]);
        }
        expected.extend_from_slice(&[1, 0, 0, 0]);
        assert_eq!(expected.len(), AROUND);
        expected.extend_from_slice(&body[252..]);
        assert_eq!(sent[1], expected);
        assert_eq!(sent[0][AROUND..AROUND + 4], CDR_LE);
        assert_eq!(sent[0][AROUND + 4..], body[..252]);
    }

    #[test]
    fn all_fragments_are_sent_once_and_in_order() {
        for words in [1, 62, 63, 64, 127, 1000, 100_000] {
            let body: Vec<u8> = (0..4 * words).map(|n| (n % 251) as u8).collect();
            for room in [0, 1400, 65_507, usize::MAX] {
                let (mut whole, mut next) = (Vec::new(), 1_u32);
                for datagram in sample(&body).datagrams(READER, room) {
                    assert!(datagram.len() <= room.clamp(AROUND + FRAGMENT, 65_507));
                    let word =
                        |at: usize| u32::from_le_bytes(datagram[at..at + 4].try_into().unwrap());
                    let start = 20 + 16 + 12 + 24;
                    assert_eq!(word(start), next);
                    assert_eq!(word(start + 8) as usize, body.len() + 4);
                    next += word(start + 4) & 0xffff;
                    whole.extend_from_slice(&datagram[AROUND..]);
                }
                assert_eq!(next as usize - 1, (body.len() + 4).div_ceil(FRAGMENT));
                assert_eq!((&whole[..4], &whole[4..]), (&CDR_LE[..], &body[..]));
            }
        }
    }
}
