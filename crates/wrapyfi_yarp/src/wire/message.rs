//! Messages of the binary carriers, in streams and in datagrams.
//!
//! ```text
//!   "YA" 10 "RP" │ n  1  ff×8 │ i32 length × n │ i32 0 │ command │ payload
//!      index                    the n lengths cover ────┴─────────┴─────────
//! ```
//!
//! The lengths are what a message is cut by. YARP itself only believes the payload: what it reads
//! in spite of wrong lengths is refused here, but the message behind it is found again.

use bytes::{Buf, Bytes, BytesMut};

pub use super::command::MAX_COMMAND_TEXT;
use super::command::{Body, COMMAND, Command, CommandReader, Incoming, NoCommand};
use super::{Fault, Progress, i32_at, number, take};
use crate::WireLimits;

/// Value of the number that begins an index: the bytes of its head.
const INDEX: i32 = 10;
/// Number and head of an index.
const HEAD: usize = number::SIZE + 10;
/// Bytes without an index after which a peer is given up.
pub const MAX_STRAY_BYTES: usize = 1 << 20;

/// Result of reading from the buffer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Found {
    /// A message. On tcp it is acknowledged once it is taken.
    Message(Incoming),
    /// Something to count; reading goes on, and nothing is acknowledged.
    Left(Fault),
}

#[derive(Debug, Clone)]
enum MessageState {
    Index,
    Command { reader: CommandReader, left: usize },
    PortPayload { command: Command, left: usize },
    Skip { left: usize },
}

/// Reads messages off a stream.
#[derive(Debug, Clone)]
pub struct MessageReader {
    state: MessageState,
    max_message_bytes: usize,
    /// Bytes left out since the last index.
    stray: usize,
}

impl MessageReader {
    /// A reader that refuses messages beyond `limits`.
    pub fn new(limits: &WireLimits) -> Self {
        Self { state: MessageState::Index, max_message_bytes: limits.max_message_bytes, stray: 0 }
    }

    /// Reads on.
    ///
    /// # Errors
    /// A [`Fault`] after which nothing on this stream can be trusted.
    pub fn poll(&mut self, buffer: &mut BytesMut) -> Result<Progress<Found>, Fault> {
        loop {
            match &mut self.state {
                MessageState::Index => {
                    if buffer.len() < number::SIZE {
                        return Ok(Progress::Need(number::SIZE - buffer.len()));
                    }
                    if number::decode(buffer) != Some(INDEX) {
                        // As YARP: numbers that are none are passed over, eight bytes at a time.
                        buffer.advance(number::SIZE);
                        self.stray += number::SIZE;
                        if self.stray > MAX_STRAY_BYTES {
                            return Err(Fault::NoIndex(self.stray));
                        }
                        continue;
                    }
                    let Some(total) = index(buffer, self.max_message_bytes)? else {
                        return Ok(Progress::Need(missing(buffer)));
                    };
                    let stray = std::mem::take(&mut self.stray);
                    self.state = match total {
                        0..COMMAND => MessageState::Skip { left: total },
                        left => MessageState::Command { reader: CommandReader::default(), left },
                    };
                    if stray > 0 {
                        return Ok(Progress::Event(Found::Left(Fault::NoIndex(stray))));
                    }
                    if total < COMMAND {
                        return Ok(Progress::Event(Found::Left(Fault::BadCommand(total))));
                    }
                }
                MessageState::Command { reader, left } => match reader.poll(buffer, left) {
                    Ok(Progress::Event(command)) => {
                        self.state = MessageState::PortPayload { command, left: *left };
                    }
                    Ok(Progress::Need(more)) => return Ok(Progress::Need(more)),
                    Err(NoCommand) => {
                        let left = *left;
                        self.state = MessageState::Skip { left };
                        return Ok(Progress::Event(Found::Left(Fault::BadCommand(left + COMMAND))));
                    }
                },
                MessageState::PortPayload { command, left } => {
                    let Some(bytes) = take(buffer, *left) else {
                        return Ok(Progress::Need(*left - buffer.len()));
                    };
                    let command = std::mem::replace(command, Command::Quit);
                    self.state = MessageState::Index;
                    let body = Body::Binary(bytes.freeze());
                    return Ok(Progress::Event(Found::Message(Incoming { command, body })));
                }
                MessageState::Skip { left } => {
                    let skipped = (*left).min(buffer.len());
                    buffer.advance(skipped);
                    *left -= skipped;
                    if *left > 0 {
                        return Ok(Progress::Need(*left));
                    }
                    self.state = MessageState::Index;
                }
            }
        }
    }

    /// Fault of a stream that ends here with `rest` bytes unread; `None` where it may end.
    #[must_use]
    pub fn end(&self, rest: usize) -> Option<Fault> {
        match &self.state {
            MessageState::Index if rest == 0 && self.stray == 0 => None,
            MessageState::Index => Some(Fault::NoIndex(self.stray + rest)),
            MessageState::Command { left, .. }
            | MessageState::PortPayload { left, .. }
            | MessageState::Skip { left } => Some(Fault::Truncated(left.saturating_sub(rest))),
        }
    }
}

/// Bytes that the index at the start of `buffer` needs in all.
fn missing(buffer: &BytesMut) -> usize {
    let whole = match (buffer.get(number::SIZE), buffer.get(number::SIZE + 1)) {
        (Some(&blocks), Some(&replies)) => HEAD + 4 * (usize::from(blocks) + usize::from(replies)),
        _ => HEAD,
    };
    whole.saturating_sub(buffer.len()).max(1)
}

/// Takes an index off; the sum of its blocks, or `None` when it is incomplete.
fn index(buffer: &mut BytesMut, limit: usize) -> Result<Option<usize>, Fault> {
    let (Some(&blocks), Some(&replies)) = (buffer.get(number::SIZE), buffer.get(number::SIZE + 1))
    else {
        return Ok(None);
    };
    let size = HEAD + 4 * (usize::from(blocks) + usize::from(replies));
    if buffer.len() < size {
        return Ok(None);
    }
    let mut total = 0_usize;
    for block in 0..usize::from(blocks) {
        let length = i32_at(buffer, HEAD + 4 * block).unwrap_or(0);
        let length = usize::try_from(length).map_err(|_negative| Fault::NegativeLength(length))?;
        total = total.saturating_add(length);
    }
    if total > limit {
        return Err(Fault::MessageTooLarge { size: total, limit });
    }
    buffer.advance(size);
    Ok(Some(total))
}

/// Bytes in front of the payload: index and command. `blocks` are the lengths of the payload's
/// parts, one for a bottle; boundaries mean nothing to readers.
///
/// # Errors
/// When there are more than 254 parts, or they are larger than an index can say.
pub fn head(command: &Command, blocks: &[usize]) -> Result<Vec<u8>, Fault> {
    let mut encoded = Vec::with_capacity(40);
    command.encode_into(&mut encoded);
    let count = blocks.len() + 1;
    let total = blocks.iter().fold(encoded.len(), |sum, &block| sum.saturating_add(block));
    let limit = i32::MAX.unsigned_abs() as usize;
    let too_large = Fault::MessageTooLarge { size: total, limit };
    let number = u8::try_from(count).map_err(|_many| too_large.clone())?;
    if total > limit {
        return Err(too_large);
    }
    let mut bytes = Vec::with_capacity(HEAD + 4 * count + 4 + encoded.len());
    bytes.extend(number::encode(INDEX));
    bytes.extend([number, 1]);
    bytes.extend([0xff; 8]);
    for length in [encoded.len()].iter().chain(blocks) {
        bytes.extend(i32::try_from(*length).unwrap_or(i32::MAX).to_le_bytes());
    }
    bytes.extend([0; 4]);
    bytes.extend(encoded);
    Ok(bytes)
}

/// The message that ends a connection.
pub fn quit() -> Vec<u8> {
    // One block of ten bytes: this cannot be too large.
    head(&Command::Quit, &[]).unwrap_or_default()
}

/// Reads an acknowledgement off: a number, and as many bytes as it says, which mean nothing.
///
/// # Errors
/// When something else stands there: 8 bytes that are no number, or a negative one.
pub fn read_ack(buffer: &mut BytesMut) -> Result<Progress<()>, Fault> {
    if buffer.len() < number::SIZE {
        return Ok(Progress::Need(number::SIZE - buffer.len()));
    }
    let value = number::decode(buffer).unwrap_or(-1);
    let behind = usize::try_from(value).map_err(|_negative| Fault::NegativeLength(value))?;
    let size = number::SIZE.saturating_add(behind);
    if behind > MAX_COMMAND_TEXT {
        return Err(Fault::MessageTooLarge { size: behind, limit: MAX_COMMAND_TEXT });
    }
    Ok(match take(buffer, size) {
        Some(_) => Progress::Event(()),
        None => Progress::Need(size - buffer.len()),
    })
}

/// A message in one piece, for those that are small.
///
/// # Errors
/// As [`head`].
pub fn whole(command: &Command, payload: &Bytes) -> Result<Vec<u8>, Fault> {
    let mut bytes = head(command, &[payload.len()])?;
    bytes.extend_from_slice(payload);
    Ok(bytes)
}
