//! Blosc 1 buffers, in which zarr packs its chunks unless told otherwise.
//!
//! ```text
//!   version │ format │ flags │ element size │ bytes │ block size │ packed bytes │ starts of blocks │ …
//!      1        1        1          1           4          4             4            4 each
//!
//!   block:  length │ packed │ length │ packed │ …      one piece for each byte of an element, or one
//!             └ a codec ─▶ bytes ─▶ unshuffle ─▶ elements
//!
//!   shuffled by bytes:  first bytes of all elements, then all second bytes, …
//!   shuffled by bits:   first bits of all elements, then all second bits, …
//! ```

use super::chunk::{Fault, lz4, read, wrong_length, zstd};

/// Length of the header.
const HEADER: usize = 16;
/// Elements a block must have at least to be split into pieces.
const LEAST_SPLIT: usize = 128;
/// Largest element whose bytes are packed in pieces.
const MOST_SPLIT: usize = 16;

const BYTE_SHUFFLE: u8 = 1;
const COPIED: u8 = 2;
const BIT_SHUFFLE: u8 = 4;
const WHOLE: u8 = 16;

struct Header {
    flags: u8,
    element: usize,
    block: usize,
}

/// The `expected` bytes in a buffer. The caller has booked them.
pub(super) fn unpack(buffer: &[u8], expected: usize) -> Result<Vec<u8>, Fault> {
    let cut_off =
        || Fault::Broken(format!("a Blosc header is {HEADER} bytes, {} are there", buffer.len()));
    let &[version, _, flags, element, ..] = buffer else { return Err(cut_off()) };
    let number = |at: usize| word(buffer, at).ok_or_else(cut_off);
    let (length, block, packed) = (number(4)?, number(8)?, number(12)?);
    if !(1..=2).contains(&version) {
        return Err(Fault::Broken(format!("it is Blosc of version {version}, 1 and 2 are read")));
    }
    if length != expected {
        return Err(wrong_length(length, expected));
    }
    let buffer = buffer.get(..packed).ok_or_else(|| {
        Fault::Broken(format!("it should be {packed} bytes, {} are there", buffer.len()))
    })?;
    if expected == 0 {
        return Ok(Vec::new());
    }
    if flags & COPIED != 0 {
        let data = buffer.get(HEADER..).unwrap_or_default();
        return if data.len() == expected {
            Ok(data.to_vec())
        } else {
            Err(wrong_length(data.len(), expected))
        };
    }
    if block == 0 {
        return Err(Fault::Broken("its blocks are 0 bytes".into()));
    }
    let header = Header { flags, element: usize::from(element).max(1), block };
    let mut unpacked = Vec::new();
    for index in 0..expected.div_ceil(block) {
        let start = word(buffer, HEADER + 4 * index)
            .and_then(|start| buffer.get(start..))
            .ok_or_else(|| Fault::Broken(format!("block {index} does not lie in it")))?;
        let size = block.min(expected - unpacked.len());
        let shuffled = header.block(start, size).map_err(|fault| match fault {
            Fault::Broken(reason) => Fault::Broken(format!("block {index}: {reason}")),
            other => other,
        })?;
        header.unshuffle(&shuffled, &mut unpacked);
    }
    Ok(unpacked)
}

/// The number at `at`, little-endian.
fn word(bytes: &[u8], at: usize) -> Option<usize> {
    let bytes = bytes.get(at..)?.first_chunk::<4>()?;
    usize::try_from(u32::from_le_bytes(*bytes)).ok()
}

impl Header {
    /// The `size` bytes of a block, still shuffled.
    fn block(&self, mut rest: &[u8], size: usize) -> Result<Vec<u8>, Fault> {
        let splits = self.flags & WHOLE == 0
            && self.element <= MOST_SPLIT
            && self.block / self.element >= LEAST_SPLIT
            && size == self.block;
        let pieces = if splits { self.element } else { 1 };
        let piece = size / pieces;
        let mut block = Vec::new();
        for _ in 0..pieces {
            let packed = word(rest, 0).and_then(|length| rest.get(4..)?.split_at_checked(length));
            let (packed, after) =
                packed.ok_or_else(|| Fault::Broken("a piece is cut off".into()))?;
            if packed.len() == piece {
                block.extend_from_slice(packed);
            } else {
                let unpacked = self.piece(packed, piece)?;
                if unpacked.len() != piece {
                    return Err(Fault::Broken(format!(
                        "a piece holds {} bytes instead of {piece}",
                        unpacked.len()
                    )));
                }
                block.extend_from_slice(&unpacked);
            }
            rest = after;
        }
        if block.len() == size {
            return Ok(block);
        }
        Err(Fault::Broken(format!("{size} bytes do not split into {pieces} pieces")))
    }

    fn piece(&self, packed: &[u8], size: usize) -> Result<Vec<u8>, Fault> {
        Ok(match self.flags >> 5 {
            0 => return Err(Fault::Unknown("Blosc with blosclz".into())),
            1 => lz4(packed, size)?,
            2 => return Err(Fault::Unknown("Blosc with snappy".into())),
            3 => read(flate2::read::ZlibDecoder::new(packed), size)?,
            4 => zstd(packed, size)?,
            other => return Err(Fault::Unknown(format!("Blosc with codec {other}"))),
        })
    }

    fn unshuffle(&self, block: &[u8], out: &mut Vec<u8>) {
        let elements = block.len() / self.element;
        if self.flags & BYTE_SHUFFLE != 0 && self.element > 1 {
            let (shuffled, rest) = block.split_at(elements * self.element);
            let columns = |index| shuffled.iter().skip(index).step_by(elements.max(1));
            out.extend((0..elements).flat_map(columns));
            out.extend_from_slice(rest);
        } else if self.flags & BIT_SHUFFLE != 0 && elements > 0 && elements.is_multiple_of(8) {
            let (shuffled, rest) = block.split_at(elements * self.element);
            out.extend(unshuffle_bits(shuffled, elements, self.element));
            out.extend_from_slice(rest);
        } else {
            // Blosc leaves blocks alone whose elements do not fill whole bytes of bits.
            out.extend_from_slice(block);
        }
    }
}

/// Undoes the shuffle by bits of a multiple of eight elements of `size` bytes: bit `b` of byte `j` of
/// the elements lies in row `8 * j + b`, one bit for each element, the first one lowest.
fn unshuffle_bits(shuffled: &[u8], elements: usize, size: usize) -> Vec<u8> {
    let row = elements / 8;
    let byte = |element: usize, byte: usize| {
        (0..8).fold(0, |value, bit| {
            let place = (8 * byte + bit) * row + element / 8;
            value | (shuffled.get(place).map_or(0, |bits| bits >> (element % 8) & 1) << bit)
        })
    };
    (0..elements)
        .flat_map(|element| (0..size).map(move |at| (element, at)))
        .map(|(element, at)| byte(element, at))
        .collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A buffer of one block that its codec could not make smaller.
    fn buffer(flags: u8, element: u8, block: &[u8]) -> Vec<u8> {
        let length = u32::try_from(block.len()).unwrap();
        let mut buffer = vec![2, 1, flags | WHOLE | 1 << 5, element];
        for number in [length, length, length + 24, 20, length] {
            buffer.extend(number.to_le_bytes());
        }
        buffer.extend(block);
        buffer
    }

    #[test]
    fn bytes_and_bits_return_to_their_elements() {
        let shuffled = [1, 2, 3, 10, 20, 30, 99];
        assert_eq!(
            unpack(&buffer(BYTE_SHUFFLE, 2, &shuffled), 7).unwrap(),
            [1, 10, 2, 20, 3, 30, 99]
        );
        // Eight elements of two bytes: only bit 0 of element 0, and bit 8 of element 7.
        let mut bits = [0; 16];
        (bits[0], bits[8]) = (1, 0x80);
        let mut elements = [0; 16];
        (elements[0], elements[15]) = (1, 1);
        assert_eq!(unpack(&buffer(BIT_SHUFFLE, 2, &bits), 16).unwrap(), elements);
        // Seven elements are left as they are.
        assert_eq!(unpack(&buffer(BIT_SHUFFLE, 2, &bits[..14]), 14).unwrap(), bits[..14]);
    }

    #[test]
    fn what_lies_is_refused() {
        let whole = buffer(BYTE_SHUFFLE, 2, &[1, 2, 3, 4]);
        for end in 0..whole.len() {
            assert!(unpack(&whole[..end], 4).is_err(), "{end}");
        }
        let broken = |at: usize, value: u32| {
            let mut buffer = whole.clone();
            buffer[at..at + 4].copy_from_slice(&value.to_le_bytes());
            match unpack(&buffer, 4) {
                Err(Fault::Broken(reason)) => reason,
                other => panic!("{other:?}"),
            }
        };
        assert!(broken(4, u32::MAX).contains("holds 4294967295 bytes, its chunk is 4"));
        assert!(broken(8, 0).contains("0 bytes"));
        assert!(broken(8, 1).contains("block 0"));
        assert!(broken(12, 100).contains("should be 100 bytes, 28 are there"));
        assert!(broken(16, 500).contains("block 0 does not lie in it"));
        assert!(broken(20, 500).contains("cut off"));
        assert!(broken(20, 3).contains("block 0"));
    }

    #[test]
    fn codecs_that_are_not_read_are_named() {
        for (codec, name) in [(0_u8, "blosclz"), (2, "snappy"), (7, "codec 7")] {
            let mut buffer = buffer(0, 1, &[1, 2, 3, 4]);
            buffer[2] = codec << 5 | WHOLE;
            buffer[20] = 3;
            let error = unpack(&buffer, 4).unwrap_err();
            assert!(matches!(&error, Fault::Unknown(what) if what.contains(name)), "{error:?}");
        }
    }

    proptest! {
        #[test]
        fn damaged_buffers_do_no_harm(
            codec in 0_u8..5, shuffle in 0_u8..6, element in 0_u8..20,
            at in 0_usize..3000, byte: u8, cut in 0_usize..3000,
        ) {
            // Two blocks of 1024 bytes in one piece each, packed as well as LZ4 can.
            let content = vec![7; 1024];
            let packed = lz4_flex::block::compress(&content);
            let length = u32::try_from(packed.len()).unwrap();
            let mut buffer = vec![2, 1, shuffle | WHOLE | codec << 5, element];
            for number in [2048, 1024, 16 + 8 + 2 * (4 + length), 24, 28 + length] {
                buffer.extend(number.to_le_bytes());
            }
            for _ in 0..2 {
                buffer.extend(length.to_le_bytes());
                buffer.extend(&packed);
            }
            if codec == 1 && shuffle & COPIED == 0 {
                prop_assert_eq!(unpack(&buffer, 2048).unwrap().len(), 2048);
            }
            let at = at % buffer.len();
            let cut = cut % buffer.len();
            buffer[at] = byte;
            for buffer in [&buffer[..], &buffer[..cut]] {
                if let Ok(unpacked) = unpack(buffer, 2048) {
                    prop_assert_eq!(unpacked.len(), 2048);
                }
            }
        }
    }
}
