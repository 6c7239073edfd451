//! Messages of several frames, put together as their bytes come.
//!
//! ```text
//!   header ── begin ──▶ frame that lacks bytes ── fill, straight from the connection ──▶ frames ── last ──▶ message
//!                          │ more than the limit, all frames together:
//!                          └─▶ passed over, and counted by its topic; beyond [`PASSED_OVER`] times that, or where
//!                              nothing names whose it is, the connection ends
//! ```
//!
//! libzmq bounds one frame but not their number: a message whose frames never end would be kept whole, outside of
//! every budget.

use std::io::{ErrorKind, Read};

use bytes::Bytes;

use super::zmtp::Header;
use wrapyfi_endpoint::DropReason;

/// Frames of one message.
const MAX_FRAMES: usize = 4096;
/// Bytes of memory that a frame takes beside its own.
const FRAME_BYTES: usize = size_of::<Bytes>();
/// Bytes that are made room for at once, until as many have come: a length that is announced is no reason to take memory.
const STEP: usize = 1 << 20;

/// Bytes of a message that are passed over before its connection ends, as a multiple of the limit: its publisher need
/// not connect again, and what it publishes then is not missed.
const PASSED_OVER: usize = 16;
/// Bytes that are passed over at once.
const SKIP: usize = 64 * 1024;

/// Message that is not taken: the first frame, as far as it came, and the reason.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct NotTaken {
    pub(super) topic: Bytes,
    pub(super) reason: DropReason,
}

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
    /// Number of the frames, with the open one.
    count: usize,
    /// Bytes of the largest frame that has come.
    largest: usize,
    /// True where a message that is not taken is passed over.
    passes_over: bool,
    /// True within a message that is passed over.
    is_passed_over: bool,
    /// Message that was last found not to be taken.
    not_taken: Option<NotTaken>,
}

struct Open {
    body: Vec<u8>,
    /// Bytes that are still to come.
    missing: usize,
    more: bool,
}

impl Assembly {
    pub(super) fn new(limit: usize) -> Self {
        Self {
            limit,
            frames: Vec::new(),
            open: None,
            bytes: 0,
            count: 0,
            largest: 0,
            passes_over: false,
            is_passed_over: false,
            not_taken: None,
        }
    }

    /// The same, which passes over a message that is not taken.
    pub(super) fn passing_over(self) -> Self {
        Self { passes_over: true, ..self }
    }

    /// Bytes of memory that the message takes so far.
    pub(super) fn held(&self) -> usize {
        if self.is_passed_over {
            return 0;
        }
        let open = self.open.as_ref().map_or(0, |open| open.missing);
        self.bytes - open + self.frames.len() * FRAME_BYTES
    }

    /// True within a message.
    pub(super) fn has_begun(&self) -> bool {
        self.open.is_some() || self.count > 0
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
        let is_taken = self.admit(header.length)?;
        if let Some(whole) = body.get(..header.length) {
            let frame = if is_taken { Bytes::copy_from_slice(whole) } else { Bytes::new() };
            return Ok((self.end(frame, header.more), whole.len()));
        }
        let mut begun = Vec::new();
        if is_taken {
            begun.reserve_exact(header.length.min(STEP.max(body.len()).max(self.largest)));
            begun.extend_from_slice(body);
        }
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

    /// Counts a frame that begins; false where it is passed over.
    fn admit(&mut self, length: usize) -> Result<bool, TooLarge> {
        self.bytes = self.bytes.saturating_add(length);
        self.count += 1;
        let is_within = |bytes| self.bytes <= bytes && self.count <= MAX_FRAMES;
        let (is_taken, is_passed_over) =
            (is_within(self.limit), is_within(self.limit.saturating_mul(PASSED_OVER)));
        if !is_taken && !self.is_passed_over {
            self.pass_over(DropReason::Oversize);
        }
        if is_taken || (is_passed_over && self.passes_over) {
            return Ok(!self.is_passed_over);
        }
        Err(TooLarge { limit: self.limit })
    }

    /// Gives up the message that has begun; false where its connection has to end, because none is passed over.
    pub(super) fn pass_over(&mut self, reason: DropReason) -> bool {
        let topic = std::mem::take(&mut self.frames).into_iter().next().unwrap_or_default();
        self.not_taken = Some(NotTaken { topic, reason });
        self.is_passed_over = true;
        if let Some(open) = &mut self.open {
            open.body = Vec::new();
        }
        self.passes_over
    }

    /// Message that was found not to be taken, told once.
    pub(super) fn not_taken(&mut self) -> Option<NotTaken> {
        self.not_taken.take()
    }

    /// Reads bytes of the open frame; their number, and the message where they were its last.
    pub(super) fn fill(
        &mut self,
        mut from: impl Read,
    ) -> std::io::Result<(usize, Option<Vec<Bytes>>)> {
        let Some(open) = &mut self.open else { return Ok((0, None)) };
        if self.is_passed_over {
            let mut scratch = [0; SKIP];
            let room = open.missing.min(SKIP);
            let count = from.read(scratch.get_mut(..room).unwrap_or_default())?;
            open.missing -= count;
            if open.missing == 0
                && let Some(open) = self.open.take()
            {
                self.end(Bytes::new(), open.more);
            }
            return Ok((count, None));
        }
        let before = open.body.len();
        if open.body.capacity() == before {
            // Twice as much each time.
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
        if !self.is_passed_over {
            self.largest = self.largest.max(frame.len());
            self.frames.push(frame);
        }
        if more {
            return None;
        }
        (self.bytes, self.count) = (0, 0);
        let is_whole = !std::mem::take(&mut self.is_passed_over);
        is_whole.then(|| std::mem::take(&mut self.frames))
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
        // The next of that size is not moved while it grows.
        assert_eq!(assembly.begin(&header(large.len(), false), &large[..10]), Ok((None, 10)));
        assert_eq!(assembly.open.as_ref().unwrap().body.capacity(), large.len());
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
    fn a_message_over_the_limit_is_passed_over_and_known_by_its_topic() {
        let mut assembly = Assembly::new(100).passing_over();
        for first in [60, 150] {
            assert_eq!(assembly.begin(&header(2, true), b"/a+"), Ok((None, 2)));
            assert_eq!(assembly.begin(&header(first, true), &[0; 200]), Ok((None, first)));
            assert_eq!(assembly.begin(&header(500, false), &[0; 20]), Ok((None, 20)));
            let told = NotTaken { topic: "/a".into(), reason: DropReason::Oversize };
            assert_eq!((assembly.not_taken(), assembly.not_taken()), (Some(told), None));
            assert!(assembly.is_open() && assembly.has_begun() && assembly.held() == 0);
            assert_eq!(assembly.fill(&[0; 480][..]).unwrap(), (480, None));
            assert!(!assembly.has_begun());
        }
        let next = assembly.begin(&header(2, false), b"/b").unwrap();
        assert_eq!(next, (Some(vec!["/b".into()]), 2));
        assert!(assembly.begin(&header(2, true), b"/a").is_ok());
        assert!(assembly.begin(&header(PASSED_OVER * 100, false), &[]).is_err());
        assert_eq!(assembly.not_taken().unwrap().topic, "/a", "it is known all the same");
        let mut assembly = Assembly::new(100).passing_over();
        assert!(assembly.begin(&header(2, true), b"/a").is_ok());
        assert!(assembly.begin(&header(80, false), &[0; 30]).is_ok());
        assert!(assembly.pass_over(DropReason::OverBudget));
        assert_eq!((assembly.held(), assembly.fill(&[0; 50][..]).unwrap()), (0, (50, None)));
        assert!(!assembly.has_begun());
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
