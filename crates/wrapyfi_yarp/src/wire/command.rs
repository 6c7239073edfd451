//! Port commands: what stands in front of every payload.
//!
//! ```text
//!   binary   i32 0       '~' key 0 1                             nothing but the key
//!            i32 length  '~'  0  0 1  "D 42 1700000000.5" NUL    a text; its first byte is the key
//!   text     "D 42 1700000000.5" \r\n
//! ```

use bytes::{Buf as _, Bytes, BytesMut};

use super::{Progress, take};
use crate::bottle::BottleError;
use crate::{Bottle, Dialect, WireLimits};

/// A command, without its payload.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Command {
    /// Data follow (`D`, `d`).
    Data {
        /// True when the sender waits for an answer.
        reply: bool,
        /// The envelope, where one came with this message.
        envelope: Option<Bytes>,
    },
    /// An administrative request follows (`a`).
    Admin,
    /// The connection ends (`q`).
    Quit,
    /// Connect to a port (`/name`): the name.
    Connect(String),
    /// Remove the output to a port (`!/name`): the name.
    RemoveOutput(String),
    /// Remove the input from a port (`~/name`): the name.
    RemoveInput(String),
    /// Describe the port (`*`).
    Describe,
    /// Turn this connection around: the peer becomes a reader of the port's output (`r`).
    Reverse,
    /// Say what commands there are (`?`, `h`).
    Help,
    /// Anything else: its key.
    Unknown(u8),
}

impl Command {
    /// The command of a text; the line of a text carrier, or the text of a binary command.
    pub fn from_text(line: &Bytes) -> Self {
        let name = || String::from_utf8_lossy(line.get(1..).unwrap_or_default()).trim().to_owned();
        match line.first().copied().unwrap_or(0) {
            // "do" is data without a reply; every other second byte separates the envelope.
            b'D' => Self::Data { reply: false, envelope: envelope(line) },
            b'd' => Self::Data { reply: line.get(1) != Some(&b'o'), envelope: envelope(line) },
            b'a' => Self::Admin,
            b'q' => Self::Quit,
            b'/' => Self::Connect(String::from_utf8_lossy(line).trim().to_owned()),
            b'!' => Self::RemoveOutput(name()),
            b'~' => Self::RemoveInput(name()),
            b'*' => Self::Describe,
            b'r' => Self::Reverse,
            b'?' | b'h' => Self::Help,
            other => Self::Unknown(other),
        }
    }

    /// The command of a key without a text.
    pub fn from_key(key: u8) -> Self {
        Self::from_text(&Bytes::copy_from_slice(&[key]))
    }

    /// True when a payload follows.
    pub const fn has_payload(&self) -> bool {
        matches!(self, Self::Data { .. } | Self::Admin)
    }

    /// The line that stands for it on the text carriers.
    pub fn to_text(&self) -> Vec<u8> {
        match self {
            Self::Data { reply, envelope } => {
                let mut line = vec![if *reply { b'd' } else { b'D' }];
                if let Some(envelope) = envelope {
                    line.push(b' ');
                    line.extend_from_slice(envelope);
                }
                line
            }
            Self::Admin => b"a".to_vec(),
            Self::Quit => b"q".to_vec(),
            Self::Connect(name) => name.clone().into_bytes(),
            Self::RemoveOutput(name) => format!("!{name}").into_bytes(),
            Self::RemoveInput(name) => format!("~{name}").into_bytes(),
            Self::Describe => b"*".to_vec(),
            Self::Reverse => b"r".to_vec(),
            Self::Help => b"?".to_vec(),
            // 0 stands for no text at all.
            Self::Unknown(key) => Some(*key).filter(|&key| key != 0).into_iter().collect(),
        }
    }

    /// Appends the command as it stands in front of a binary payload.
    ///
    /// Writes the command as YARP does: data without an envelope and administration have a key,
    /// everything else a text.
    pub fn encode_into(&self, out: &mut Vec<u8>) {
        let key = match self {
            Self::Data { reply, envelope: None } => Some(if *reply { b'd' } else { b'D' }),
            Self::Admin => Some(b'a'),
            _ => None,
        };
        if let Some(key) = key {
            out.extend([0, 0, 0, 0, b'~', key, 0, 1]);
            return;
        }
        let text = self.to_text();
        // Texts are bounded where they come from; readers go by the NUL, not by this.
        let length = i32::try_from(text.len() + 1).unwrap_or(i32::MAX);
        out.extend(length.to_le_bytes());
        out.extend([b'~', 0, 0, 1]);
        out.extend(text);
        out.push(0);
    }
}

/// The envelope of a data command: from the third byte to the first below 32.
fn envelope(line: &Bytes) -> Option<Bytes> {
    let rest = line.get(2..)?;
    let end = rest.iter().position(|&byte| byte < 32).unwrap_or(rest.len());
    (end > 0).then(|| line.slice(2..2 + end))
}

/// A command without text.
pub(super) const COMMAND: usize = 8;
/// Longest text of a command: an envelope or a name with their key.
pub const MAX_COMMAND_TEXT: usize = 64 * 1024;

/// Reads the command in front of a binary payload.
#[derive(Debug, Clone, Default)]
pub(super) struct CommandReader {
    /// Bytes of its text that were looked at; `None` before the text.
    scanned: Option<usize>,
}

/// The bytes begin no command.
#[derive(Debug)]
pub(super) struct NoCommand;

impl CommandReader {
    /// Reads on, at most `left` bytes, from which those are taken off that were read.
    pub(super) fn poll(
        &mut self,
        buffer: &mut BytesMut,
        left: &mut usize,
    ) -> Result<Progress<Command>, NoCommand> {
        let scanned = match self.scanned {
            Some(scanned) => scanned,
            None => {
                let Some(bytes) = take(buffer, COMMAND) else {
                    return Ok(Progress::Need(COMMAND - buffer.len()));
                };
                *left = left.saturating_sub(COMMAND);
                match bytes.get(4..6) {
                    Some(&[b'~', 0]) => 0,
                    Some(&[b'~', key]) => return Ok(Progress::Event(Command::from_key(key))),
                    _ => return Err(NoCommand),
                }
            }
        };
        let most = (*left).min(MAX_COMMAND_TEXT);
        let within = buffer.len().min(most);
        let fresh = buffer.get(scanned..within).unwrap_or_default();
        let Some(at) = fresh.iter().position(|&byte| byte == 0) else {
            self.scanned = Some(within);
            return if within == most { Err(NoCommand) } else { Ok(Progress::Need(1)) };
        };
        let line = buffer.split_to(scanned + at).freeze();
        buffer.advance(1);
        *left = left.saturating_sub(line.len() + 1);
        Ok(Progress::Event(Command::from_text(&line)))
    }

    /// Least number of bytes that are missing where the stream ends with `rest` unread; `None` before a command.
    pub(super) fn missing(&self, rest: usize) -> Option<usize> {
        match self.scanned {
            Some(_) => Some(1),
            None => (rest > 0).then(|| COMMAND.saturating_sub(rest)),
        }
    }
}

/// The payload of a message, in the form it came in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Body {
    /// A serialised object: a bottle, an image, a sound, …
    Binary(Bytes),
    /// A bottle as text.
    Text(Bytes),
    /// A JPEG file.
    File(Bytes),
}

impl Body {
    /// The bottle in it.
    ///
    /// # Errors
    /// When it is none, or exceeds a limit.
    pub fn bottle(&self, dialect: Dialect, limits: &WireLimits) -> Result<Bottle, BottleError> {
        match self {
            Self::Binary(bytes) | Self::File(bytes) => {
                Ok(Bottle::decode(bytes, dialect, limits)?.0)
            }
            Self::Text(text) => Bottle::from_text_as(text, dialect, limits),
        }
    }

    /// Size in bytes, as it came.
    pub fn len(&self) -> usize {
        match self {
            Self::Binary(bytes) | Self::Text(bytes) | Self::File(bytes) => bytes.len(),
        }
    }

    /// True when there are no bytes.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A message as a peer sent it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Incoming {
    /// Command of the message.
    pub command: Command,
    /// PortPayload; empty for commands without one.
    pub body: Body,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(line: &'static str) -> Command {
        Command::from_text(&Bytes::from_static(line.as_bytes()))
    }

    #[test]
    fn a_text_is_known_by_its_first_byte() {
        let envelope = Some(Bytes::from_static(b"42 1700000000.5"));
        assert_eq!(text("D 42 1700000000.5"), Command::Data { reply: false, envelope });
        assert_eq!(text("d"), Command::Data { reply: true, envelope: None });
        assert_eq!(text("do"), Command::Data { reply: false, envelope: None });
        assert_eq!(text("/dst"), Command::Connect("/dst".into()));
        assert_eq!(text("~/src "), Command::RemoveInput("/src".into()));
        assert_eq!(text("zzz"), Command::Unknown(b'z'));
        assert_eq!(text(""), Command::Unknown(0));
    }

    #[test]
    fn an_envelope_ends_at_the_first_control_byte() {
        let Command::Data { envelope, .. } = text("D 4\t2") else { panic!() };
        assert_eq!(envelope.unwrap(), "4");
        assert_eq!(text("D \n"), Command::Data { reply: false, envelope: None });
    }

    #[test]
    fn what_is_written_is_read_again() {
        for line in ["d", "D", "D 1 2.5", "a", "q", "/x", "!/x", "~/x", "*", "r", "?"] {
            assert_eq!(Command::from_text(&text(line).to_text().into()), text(line), "{line}");
        }
    }
}
