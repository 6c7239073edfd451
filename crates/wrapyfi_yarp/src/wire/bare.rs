//! Messages of carrier `unix_stream`: no lengths stand in front of them.
//!
//! ```text
//!   command │ payload │ command │ payload │ …       [◀─ reply]  [◀─ "ACK" NUL, where it is asked for]
//!             where it ends is found by reading it: it is a bottle, or reads like one
//! ```
//!
//! A message that cannot be read ends the connection, because nothing tells where the next one begins.

use bytes::{Buf as _, BytesMut};

use super::command::{Body, Command, Incoming};
use super::message::{COMMAND, MAX_COMMAND_TEXT};
use super::{Fault, Step, take};
use crate::bottle::{BottleScan, Frame};
use crate::{Dialect, Limits};

/// The acknowledgement of a message.
pub const ACK: [u8; 4] = *b"ACK\0";

#[derive(Debug, Clone)]
enum State {
    Command,
    Text { scanned: usize },
    PortPayload { command: Command, scan: Box<BottleScan> },
}

/// Reads messages off a stream.
#[derive(Debug, Clone)]
pub struct BareReader {
    state: State,
    dialect: Dialect,
    limits: Limits,
}

impl BareReader {
    /// A reader of payloads in `dialect`, or the other one once its codes show, that refuses what exceeds `limits`.
    pub fn new(dialect: Dialect, limits: &Limits) -> Self {
        Self { state: State::Command, dialect, limits: limits.clone() }
    }

    /// Reads on.
    ///
    /// # Errors
    /// A [`Fault`] after which nothing on this stream can be trusted.
    pub fn poll(&mut self, buffer: &mut BytesMut) -> Result<Step<Incoming>, Fault> {
        loop {
            let command = match &mut self.state {
                State::Command => {
                    let Some(bytes) = take(buffer, COMMAND) else {
                        return Ok(Step::Need(COMMAND - buffer.len()));
                    };
                    match bytes.get(4..6) {
                        Some(&[b'~', 0]) => {
                            self.state = State::Text { scanned: 0 };
                            continue;
                        }
                        Some(&[b'~', key]) => Command::from_key(key),
                        _ => return Err(Fault::BadCommand(COMMAND)),
                    }
                }
                State::Text { scanned } => {
                    let within = buffer.len().min(MAX_COMMAND_TEXT);
                    let fresh = buffer.get(*scanned..within).unwrap_or_default();
                    let Some(at) = fresh.iter().position(|&byte| byte == 0) else {
                        if within == MAX_COMMAND_TEXT {
                            return Err(Fault::BadCommand(COMMAND + within));
                        }
                        *scanned = within;
                        return Ok(Step::Need(1));
                    };
                    let line = buffer.split_to(*scanned + at).freeze();
                    buffer.advance(1);
                    Command::from_text(&line)
                }
                State::PortPayload { command, scan } => {
                    let found = match scan.advance(buffer) {
                        Ok(found) => found,
                        // A code that one dialect lacks shows that the sender speaks the other.
                        Err(error) => {
                            let mut other = BottleScan::new(self.dialect.other(), &self.limits);
                            let again = other.advance(buffer);
                            let found =
                                again.map_err(|_neither| Fault::BadPayload(error.to_string()))?;
                            self.dialect = self.dialect.other();
                            **scan = other;
                            found
                        }
                    };
                    let size = match found {
                        Frame::Complete(size) => size,
                        Frame::NeedMore(more) => return Ok(Step::Need(more.max(1))),
                    };
                    let command = std::mem::replace(command, Command::Quit);
                    self.state = State::Command;
                    let body = Body::Binary(buffer.split_to(size).freeze());
                    return Ok(Step::Event(Incoming { command, body }));
                }
            };
            if !command.has_payload() {
                self.state = State::Command;
                let body = Body::Binary(bytes::Bytes::new());
                return Ok(Step::Event(Incoming { command, body }));
            }
            let scan = Box::new(BottleScan::new(self.dialect, &self.limits));
            self.state = State::PortPayload { command, scan };
        }
    }

    /// Fault of a stream that ends here with `rest` bytes unread; `None` where it may end.
    #[must_use]
    pub fn end(&self, rest: usize) -> Option<Fault> {
        match &self.state {
            State::Command if rest == 0 => None,
            State::Command => Some(Fault::Truncated(COMMAND.saturating_sub(rest))),
            State::Text { .. } | State::PortPayload { .. } => Some(Fault::Truncated(1)),
        }
    }
}

/// Bytes in front of a payload.
pub fn head(command: &Command) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(2 * COMMAND);
    command.encode_into(&mut bytes);
    bytes
}

/// Reads an acknowledgement off.
///
/// # Errors
/// When something else stands there.
pub fn read_ack(buffer: &mut BytesMut) -> Result<Step<()>, Fault> {
    match take(buffer, ACK.len()) {
        Some(bytes) if bytes[..] == ACK => Ok(Step::Event(())),
        Some(bytes) => {
            Err(Fault::BadPayload(format!("{:?} stands where an acknowledgement must", &bytes[..])))
        }
        None => Ok(Step::Need(ACK.len() - buffer.len())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Bottle;

    fn read(bytes: &[u8], piece: usize) -> Result<Vec<Incoming>, Fault> {
        let mut reader = BareReader::new(Dialect::V3, &Limits::default());
        let (mut buffer, mut found) = (BytesMut::new(), Vec::new());
        for piece in bytes.chunks(piece) {
            buffer.extend_from_slice(piece);
            while let Step::Event(incoming) = reader.poll(&mut buffer)? {
                found.push(incoming);
            }
        }
        reader.end(buffer.len()).map_or(Ok(found), Err)
    }

    fn data(text: &str) -> (Command, Bottle) {
        let envelope = Some(bytes::Bytes::from_static(b"7 1.5"));
        (Command::Data { reply: false, envelope }, Bottle::from(vec![text.into(), 2.5.into()]))
    }

    #[test]
    fn messages_are_the_same_in_any_pieces() {
        let mut bytes = Vec::new();
        for (command, bottle) in [data("one"), data("two")] {
            bytes.extend(head(&command));
            bytes.extend(bottle.encode(Dialect::V3).unwrap());
        }
        bytes.extend(head(&Command::Quit));
        let whole = read(&bytes, bytes.len()).unwrap();
        for piece in [1, 3, 7] {
            assert_eq!(read(&bytes, piece).unwrap(), whole);
        }
        let commands: Vec<&Command> = whole.iter().map(|incoming| &incoming.command).collect();
        assert_eq!(commands, [&data("").0, &data("").0, &Command::Quit]);
        let second = whole[1].body.bottle(Dialect::V3, &Limits::default()).unwrap();
        assert_eq!(second, data("two").1);
    }

    #[test]
    fn what_is_no_message_is_a_fault() {
        let command = head(&data("").0);
        let with = |payload: &[u8]| read(&[&command[..], payload].concat(), 5).unwrap_err().name();
        assert_eq!(read(b"\0\0\0\0!d\0\x01", 8).unwrap_err().name(), "bad_command");
        // No list.
        assert_eq!(with(&[1, 0, 0, 0, 0, 0, 0, 0]), "bad_payload");
        // A blob of 2 GiB, and a list of as many elements.
        assert_eq!(with(&[0, 1, 0, 0, 1, 0, 0, 0, 12, 0, 0, 0, 255, 255, 255, 127]), "bad_payload");
        assert_eq!(with(&[0, 1, 0, 0, 255, 255, 255, 127]), "bad_payload");
        assert_eq!(with(&[0, 1, 0, 0, 2, 0, 0, 0, 1]), "truncated");
        let endless = [&[0, 0, 0, 0, b'~', 0, 0, 1][..], &[b'D'; MAX_COMMAND_TEXT + 1]].concat();
        assert_eq!(read(&endless, 1000).unwrap_err().name(), "bad_command");
        assert_eq!(read_ack(&mut BytesMut::from(&b"ACK!"[..])).unwrap_err().name(), "bad_payload");
    }
}
