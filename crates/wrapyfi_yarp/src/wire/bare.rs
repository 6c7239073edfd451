//! Messages of carrier `unix_stream`: no lengths stand in front of them.
//!
//! ```text
//!   command │ payload │ command │ payload │ …       [◀─ reply]  [◀─ "ACK" NUL, where it is asked for]
//!             where it ends is found by reading it: it is a bottle, or reads like one
//! ```
//!
//! A message that cannot be read ends the connection, because nothing tells where the next one begins.

use bytes::BytesMut;

use super::command::{Body, COMMAND, Command, CommandReader, Incoming, NoCommand};
use super::{Fault, Progress, take};
use crate::bottle::{BottleScan, Frame};
use crate::{Dialect, WireLimits};

/// The acknowledgement of a message.
pub const ACK: [u8; 4] = *b"ACK\0";

#[derive(Debug, Clone)]
enum BareState {
    Command(CommandReader),
    PortPayload { command: Command, scan: Box<BottleScan> },
}

/// Reads messages off a stream.
#[derive(Debug, Clone)]
pub struct BareReader {
    state: BareState,
    dialect: Dialect,
    limits: WireLimits,
}

impl BareReader {
    /// A reader of payloads in `dialect`, or the other one once its codes show, that refuses what exceeds `limits`.
    pub fn new(dialect: Dialect, limits: &WireLimits) -> Self {
        Self {
            state: BareState::Command(CommandReader::default()),
            dialect,
            limits: limits.clone(),
        }
    }

    /// Reads on.
    ///
    /// # Errors
    /// A [`Fault`] after which nothing on this stream can be trusted.
    pub fn poll(&mut self, buffer: &mut BytesMut) -> Result<Progress<Incoming>, Fault> {
        loop {
            // Nothing tells where the message ends.
            let mut left = usize::MAX;
            let command = match &mut self.state {
                BareState::Command(reader) => match reader.poll(buffer, &mut left) {
                    Ok(Progress::Event(command)) => command,
                    Ok(Progress::Need(more)) => return Ok(Progress::Need(more)),
                    Err(NoCommand) => return Err(Fault::BadCommand(COMMAND)),
                },
                BareState::PortPayload { command, scan } => {
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
                        Frame::NeedMore(more) => return Ok(Progress::Need(more.max(1))),
                    };
                    let command = std::mem::replace(command, Command::Quit);
                    self.state = BareState::Command(CommandReader::default());
                    let body = Body::Binary(buffer.split_to(size).freeze());
                    return Ok(Progress::Event(Incoming { command, body }));
                }
            };
            if !command.has_payload() {
                self.state = BareState::Command(CommandReader::default());
                let body = Body::Binary(bytes::Bytes::new());
                return Ok(Progress::Event(Incoming { command, body }));
            }
            let scan = Box::new(BottleScan::new(self.dialect, &self.limits));
            self.state = BareState::PortPayload { command, scan };
        }
    }

    /// Fault of a stream that ends here with `rest` bytes unread; `None` where it may end.
    #[must_use]
    pub fn end(&self, rest: usize) -> Option<Fault> {
        match &self.state {
            BareState::Command(reader) => reader.missing(rest).map(Fault::Truncated),
            BareState::PortPayload { .. } => Some(Fault::Truncated(1)),
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
pub fn read_ack(buffer: &mut BytesMut) -> Result<Progress<()>, Fault> {
    match take(buffer, ACK.len()) {
        Some(bytes) if bytes[..] == ACK => Ok(Progress::Event(())),
        Some(bytes) => {
            Err(Fault::BadPayload(format!("{:?} stands where an acknowledgement must", &bytes[..])))
        }
        None => Ok(Progress::Need(ACK.len() - buffer.len())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Bottle;
    use crate::wire::message::MAX_COMMAND_TEXT;

    fn read(bytes: &[u8], piece: usize) -> Result<Vec<Incoming>, Fault> {
        let mut reader = BareReader::new(Dialect::V3, &WireLimits::default());
        let (mut buffer, mut found) = (BytesMut::new(), Vec::new());
        for piece in bytes.chunks(piece) {
            buffer.extend_from_slice(piece);
            while let Progress::Event(incoming) = reader.poll(&mut buffer)? {
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
        let second = whole[1].body.bottle(Dialect::V3, &WireLimits::default()).unwrap();
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
