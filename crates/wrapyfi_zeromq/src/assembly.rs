//! Messages of several frames, put together as their bytes come.
//!
//! ```text
//!   header ── begin ──▶ frame that lacks bytes ── fill, straight from the connection ──▶ frames ── last ──▶ message
//!                          │ more than the limit, all frames together: the connection ends
//! ```
//!
//! libzmq bounds one frame but not their number: a message whose frames never end would be kept whole, outside of
//! every budget.

use std::io::{ErrorKind, Read};

use bytes::Bytes;

use super::zmtp::Header;

/// Frames of one message.
const MAX_FRAMES: usize = 4096;
/// Bytes of memory that a frame takes beside its own.
const FRAME_BYTES: usize = size_of::<Bytes>();
/// Bytes that are made room for at once: a length that is announced is no reason to take memory.
const STEP: usize = 1 << 20;

/// Bounds that a message does not keep to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a message of more than {limit} bytes, or of more than {MAX_FRAMES} frames")]
pub(super) struct TooLarge {
    limit: usize,
}

/// The message that is being received.
pub(super) struct Assembly {
    /// Bytes of one message, all frames.
    pub(super) limit: usize,
    frames: Vec<Bytes>,
    /// Frame that lacks bytes.
    open: Option<Open>,
    /// Bytes of the frames, with those that the open one announces.
    bytes: usize,
}

struct Open {
    body: Vec<u8>,
    /// Bytes that are still to come.
    missing: usize,
    more: bool,
}

impl Assembly {
    pub(super) fn new(limit: usize) -> Self {
        Self { limit, frames: Vec::new(), open: None, bytes: 0 }
    }

    /// Bytes of memory that the message takes so far.
    pub(super) fn held(&self) -> usize {
        let open = self.open.as_ref().map_or(0, |open| open.missing);
        self.bytes - open + self.frames.len() * FRAME_BYTES
    }

    /// True within a message.
    pub(super) fn has_begun(&self) -> bool {
        self.open.is_some() || !self.frames.is_empty()
    }

    /// True where the next bytes belong to a frame that has begun.
    pub(super) fn is_open(&self) -> bool {
        self.open.is_some()
    }

    /// Begins a frame of which `body` has come, or more than all of it; the message where that was its last, and the
    /// number of bytes that were taken.
    ///
    /// # Errors
    /// When the message is too large.
    pub(super) fn begin(
        &mut self,
        header: &Header,
        body: &[u8],
    ) -> Result<(Option<Vec<Bytes>>, usize), TooLarge> {
        self.admit(header.length)?;
        if let Some(whole) = body.get(..header.length) {
            return Ok((self.end(Bytes::copy_from_slice(whole), header.more), whole.len()));
        }
        let mut begun = Vec::with_capacity(header.length.min(STEP.max(body.len())));
        begun.extend_from_slice(body);
        let missing = header.length - body.len();
        self.open = Some(Open { body: begun, missing, more: header.more });
        Ok((None, body.len()))
    }

    /// Adds a whole frame; the message where it was its last.
    ///
    /// # Errors
    /// When the message is too large.
    pub(super) fn add(&mut self, frame: Bytes, more: bool) -> Result<Option<Vec<Bytes>>, TooLarge> {
        self.admit(frame.len())?;
        Ok(self.end(frame, more))
    }

    /// Counts a frame that begins.
    fn admit(&mut self, length: usize) -> Result<(), TooLarge> {
        let bytes = self.bytes.checked_add(length).filter(|bytes| *bytes <= self.limit);
        self.bytes = bytes.ok_or(TooLarge { limit: self.limit })?;
        if self.frames.len() >= MAX_FRAMES {
            return Err(TooLarge { limit: self.limit });
        }
        Ok(())
    }

    /// Reads bytes of the open frame; their number, and the message where they were its last.
    pub(super) fn fill(&mut self, from: impl Read) -> std::io::Result<(usize, Option<Vec<Bytes>>)> {
        let Some(open) = &mut self.open else { return Ok((0, None)) };
        let before = open.body.len();
        if open.body.capacity() == before {
            // Twice as much each time: the system moves large blocks without a copy.
            open.body.reserve_exact(open.missing.min(before.max(STEP)));
        }
        let room = open.missing.min(open.body.capacity() - before);
        let read = from.take(room as u64).read_to_end(&mut open.body);
        let count = open.body.len() - before;
        open.missing -= count;
        match read {
            Ok(_) if count < room => return Err(ErrorKind::UnexpectedEof.into()),
            Err(error) if count == 0 || error.kind() != ErrorKind::WouldBlock => return Err(error),
            _ => {}
        }
        if open.missing > 0 {
            return Ok((count, None));
        }
        let message = self.open.take().and_then(|open| self.end(open.body.into(), open.more));
        Ok((count, message))
    }

    /// Adds a frame that is complete; the message where it was its last.
    fn end(&mut self, frame: Bytes, more: bool) -> Option<Vec<Bytes>> {
        self.frames.push(frame);
        if more {
            return None;
        }
        self.bytes = 0;
        Some(std::mem::take(&mut self.frames))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(length: usize, more: bool) -> Header {
        Header { is_command: false, more, length, size: 2 }
    }

    #[test]
    fn a_frame_is_filled_as_its_bytes_come() {
        let mut assembly = Assembly::new(5_000_000);
        assert_eq!(assembly.begin(&header(2, true), b"/a+"), Ok((None, 2)));
        let large = vec![7; 3 * STEP];
        assert_eq!(assembly.begin(&header(large.len(), false), &large[..10]), Ok((None, 10)));
        assert!(assembly.is_open() && assembly.held() < 200, "{}", assembly.held());
        let mut rest = &large[10..];
        let mut message = None;
        while message.is_none() {
            let some = rest.len().min(1000);
            let (count, whole) = assembly.fill(Stalls(&rest[..some])).unwrap();
            rest = &rest[count..];
            message = whole;
        }
        let message = message.unwrap();
        assert_eq!((&message[0][..], &message[1][..]), (&b"/a"[..], &large[..]));
        assert!(!assembly.has_begun() && assembly.held() == 0);
    }

    /// Bytes, after which nothing is there for now.
    struct Stalls<'a>(&'a [u8]);

    impl Read for Stalls<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
            match self.0.read(buffer)? {
                0 if !buffer.is_empty() => Err(ErrorKind::WouldBlock.into()),
                count => Ok(count),
            }
        }
    }

    #[test]
    fn frames_that_never_end_are_refused() {
        let mut assembly = Assembly::new(1000);
        let endless = std::iter::repeat_with(|| assembly.begin(&header(100, true), &[0; 100]));
        assert_eq!(endless.take_while(Result::is_ok).count(), 10);
        let mut assembly = Assembly::new(1000);
        let empty = std::iter::repeat_with(|| assembly.begin(&header(0, true), &[]));
        assert_eq!(empty.take_while(Result::is_ok).count(), MAX_FRAMES);
        let mut assembly = Assembly::new(1000);
        assert!(assembly.begin(&header(1001, false), &[]).is_err(), "before memory is taken");
        assert!(assembly.begin(&header(usize::MAX, false), &[]).is_err());
    }
}
