//! Strings: bytes and a length in ROS 1; with a NUL at the end, which is counted, in CDR.
//!
//! | in a string | becomes | counted in |
//! | --- | --- | --- |
//! | NUL | its end, as ROS 2's middlewares have it | `cut_texts` |
//! | bytes that are no UTF-8 | U+FFFD | `bad_texts` |

use super::error::TranscodeError;
use super::op::Text;
use super::run::Work;
use crate::cdr::CdrError;

/// Text in place of bytes that are no UTF-8.
const REPLACEMENT: &str = "\u{fffd}";
const REPLACEMENT_UNIT: u16 = 0xfffd;

impl<const F: bool, const T: bool> Work<'_, F, T> {
    /// Copies one string.
    pub(super) fn copy_text(&mut self, op: &Text) -> Result<(), TranscodeError> {
        if op.from_wide {
            return self.copy_wide(op);
        }
        let length = self.sequence(1, op.at)?;
        let bytes = self.take(length, op.at)?;
        let bytes = match (F, bytes.split_last()) {
            (true, Some((0, text))) => text,
            (true, Some((last, _))) => {
                let path = self.path(op.at);
                return Err(CdrError::Unterminated { path, length, last: *last }.into());
            }
            _ => bytes,
        };
        // The search for a byte is far faster than finding where it is.
        let text = if bytes.contains(&0) {
            self.done.cut_texts = self.done.cut_texts.saturating_add(1);
            bytes.split(|byte| *byte == 0).next().unwrap_or_default()
        } else {
            bytes
        };
        match std::str::from_utf8(text) {
            Ok(valid) if op.to_wide => self.put_wide(op, std::iter::once(Ok(valid))),
            Ok(_valid) => self.put_bytes(op, text),
            Err(_not_utf8) => {
                self.done.bad_texts = self.done.bad_texts.saturating_add(1);
                self.put_repaired(op, text)
            }
        }
    }

    /// Writes bytes as they are, with their length and their end.
    fn put_bytes(&mut self, op: &Text, bytes: &[u8]) -> Result<(), TranscodeError> {
        self.put_length(op, bytes.len())?;
        self.to.put(bytes);
        self.end_text();
        Ok(())
    }

    /// Length of a string that is not wide, in either form.
    fn put_length(&mut self, op: &Text, length: usize) -> Result<(), TranscodeError> {
        if T {
            self.bound(op.at, length, op.bound)?;
        }
        self.room(length.saturating_add(8), op.at)?;
        // Source and limit are in memory, so the length fits unless the caller allows 4 GiB.
        let counted = u32::try_from(length.saturating_add(usize::from(T)));
        self.to.count(counted.map_err(|_beyond| self.length(op.at, u32::MAX, 1, length))?);
        Ok(())
    }

    fn end_text(&mut self) {
        if T {
            self.to.put(&[0]);
        }
    }

    fn put_repaired(&mut self, op: &Text, text: &[u8]) -> Result<(), TranscodeError> {
        if op.to_wide {
            return self.put_wide(op, pieces(text));
        }
        let pieces = pieces(text).map(|piece| piece.unwrap_or(REPLACEMENT));
        let length = pieces.clone().map(str::len).sum();
        self.put_length(op, length)?;
        pieces.for_each(|piece| self.to.put(piece.as_bytes()));
        self.end_text();
        Ok(())
    }

    /// Writes a wide string: UTF-16 code units in four bytes each, without a terminator.
    fn put_wide<'t>(
        &mut self,
        op: &Text,
        pieces: impl Iterator<Item = Result<&'t str, ()>> + Clone,
    ) -> Result<(), TranscodeError> {
        let units = pieces.flat_map(|piece| {
            let (text, bad) = match piece {
                Ok(text) => (text, None),
                Err(()) => ("", Some(REPLACEMENT_UNIT)),
            };
            text.encode_utf16().chain(bad)
        });
        let count = units.clone().count();
        self.bound(op.at, count, op.bound)?;
        self.room(count.saturating_mul(4).saturating_add(8), op.at)?;
        self.to.count(u32::try_from(count).unwrap_or(u32::MAX));
        units.for_each(|unit| self.to.put(&u32::from(unit).to_le_bytes()));
        Ok(())
    }

    /// Reads a wide string and writes it as UTF-8. ROS 1 has no wide strings, so the target is ROS 1.
    fn copy_wide(&mut self, op: &Text) -> Result<(), TranscodeError> {
        let count = self.sequence(4, op.at)?;
        let bytes = self.take(count.saturating_mul(4), op.at)?;
        let (units, _) = bytes.as_chunks::<4>();
        // A unit beyond 16 bits becomes a lone surrogate, which is no UTF-16 either.
        let units =
            units.iter().map(|unit| u16::try_from(u32::from_le_bytes(*unit)).unwrap_or(0xd800));
        let mut length = 0_usize;
        let mut is_bad = false;
        for c in char::decode_utf16(units.clone()) {
            let c = c.unwrap_or_else(|_lone| {
                is_bad = true;
                char::REPLACEMENT_CHARACTER
            });
            length = length.saturating_add(c.len_utf8());
        }
        self.done.bad_texts = self.done.bad_texts.saturating_add(u32::from(is_bad));
        self.put_length(op, length)?;
        let mut buffer = [0; 4];
        for c in char::decode_utf16(units) {
            self.to
                .put(c.unwrap_or(char::REPLACEMENT_CHARACTER).encode_utf8(&mut buffer).as_bytes());
        }
        self.end_text();
        Ok(())
    }
}

/// Valid pieces, with an error for each piece between them that is not.
fn pieces(text: &[u8]) -> impl Iterator<Item = Result<&str, ()>> + Clone {
    text.utf8_chunks().flat_map(|chunk| {
        let bad = (!chunk.invalid().is_empty()).then_some(Err(()));
        std::iter::once(Ok(chunk.valid())).chain(bad)
    })
}
