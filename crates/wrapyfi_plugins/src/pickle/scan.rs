//! The pickle's bytes, taken one operand at a time.

use super::arena::Span;
use super::error::PickleError;

/// Bytes of a pickle and how far they were read.
pub(super) struct Scanner<'a> {
    pub(super) data: &'a [u8],
    pub(super) at: usize,
}

type Result<T> = std::result::Result<T, PickleError>;

impl<'a> Scanner<'a> {
    fn rest(&self) -> &'a [u8] {
        self.data.get(self.at..).unwrap_or_default()
    }

    /// The next `N` bytes.
    pub(super) fn array<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N]> {
        match self.rest().first_chunk() {
            Some(bytes) => {
                self.at += N;
                Ok(*bytes)
            }
            None => Err(self.truncated(what, N as u64)),
        }
    }

    /// The number in the next `width` bytes, 8 at most.
    pub(super) fn unsigned(&mut self, what: &'static str, width: u8) -> Result<u64> {
        let span = self.span(what, width.into())?;
        Ok(self.get(span).iter().rev().fold(0, |high, &byte| high << 8 | u64::from(byte)))
    }

    /// The next `length` bytes, whatever length the pickle claims.
    pub(super) fn span(&mut self, what: &'static str, length: u64) -> Result<Span> {
        let start = self.at;
        let end = usize::try_from(length).ok().and_then(|length| start.checked_add(length));
        match end.filter(|&end| end <= self.data.len()) {
            Some(end) => {
                self.at = end;
                Ok(Span { start, end })
            }
            None => Err(self.truncated(what, length)),
        }
    }

    /// Bytes up to the end of the line, which is not among them.
    pub(super) fn line(&mut self, what: &'static str) -> Result<Span> {
        let start = self.at;
        let rest = self.rest();
        match memchr::memchr(b'\n', rest) {
            Some(length) => {
                self.at += length + 1;
                Ok(Span { start, end: start + length })
            }
            None => Err(self.truncated(what, rest.len() as u64 + 1)),
        }
    }

    pub(super) fn get(&self, span: Span) -> &'a [u8] {
        self.data.get(span.start..span.end).unwrap_or_default()
    }

    fn truncated(&self, what: &'static str, needed: u64) -> PickleError {
        PickleError::Truncated { what, at: self.at, needed, left: self.rest().len() }
    }
}
