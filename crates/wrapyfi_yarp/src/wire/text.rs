//! Lines: the text carriers, and requests to a name server.
//!
//! ```text
//!   D 42 1700000000.5 \r\n     a command
//!   1 2.5 "a b" \r\n           its payload, for as many lines as quotes and brackets are open
//!   <ACK> \r\n                 the answer, on text_ack
//! ```

use bytes::{Buf, Bytes, BytesMut};

use super::command::{Body, Command, Incoming};
use super::{Fault, Progress};
use crate::WireLimits;

/// The acknowledgement of a message on `text_ack`, without its line's end.
pub const ACK: &[u8] = b"<ACK>";

/// Text that a port sends on the text carriers to a command that it does not know.
pub const UNKNOWN_COMMAND_HELP: &str = "\
Port command not understood.\r
Type d to send data to the port's owner.\r
Type ? for help.\r
";

/// Text that a port sends on the text carriers to `?`.
pub const COMMAND_HELP: &str = "\
This is a YARP port.  Here are the commands it responds to:\r
*       Gives a description of this port\r
d       Signals the beginning of input for the port's owner\r
do      The same as \"d\" except replies should be suppressed (\"data-only\")\r
q       Disconnects\r
r       Reverse connection type to be a reader\r
/port   Requests to send output to /port\r
!/port  Requests to stop sending output to /port\r
~/port  Requests to stop receiving input from /port\r
a       Signals the beginning of an administrative message\r
?       Gives this help\r
";

/// Takes the line off that ends at the `\n` at `end`: without its end, without NULs.
pub(super) fn cut_line(buffer: &mut BytesMut, end: usize) -> Bytes {
    let mut line = buffer.split_to(end.min(buffer.len()));
    if !buffer.is_empty() {
        buffer.advance(1);
    }
    if line.last() == Some(&b'\r') {
        line.truncate(line.len() - 1);
    }
    if line.contains(&0) {
        return line.iter().copied().filter(|&byte| byte != 0).collect();
    }
    line.freeze()
}

/// A request to a name server without the word in front of it.
pub(super) fn without_prefix(line: Bytes) -> Bytes {
    const PREFIX: &[u8] = b"NAME_SERVER";
    match line.strip_prefix(PREFIX) {
        Some(rest) if rest.first().is_none_or(|&byte| byte == b' ' || byte == b'\t') => {
            let blanks = rest.iter().take_while(|byte| byte.is_ascii_whitespace()).count();
            line.slice(PREFIX.len() + blanks..)
        }
        _ => line,
    }
}

/// Reads single lines.
#[derive(Debug, Clone)]
pub struct Lines {
    limit: usize,
    scanned: usize,
}

impl Lines {
    /// A reader of lines of up to [`WireLimits::max_line_bytes`].
    pub fn new(limits: &WireLimits) -> Self {
        Self { limit: limits.max_line_bytes, scanned: 0 }
    }

    /// The next line, without its end.
    ///
    /// # Errors
    /// When it is too long.
    pub fn poll(&mut self, buffer: &mut BytesMut) -> Result<Progress<Bytes>, Fault> {
        let fresh = buffer.get(self.scanned..).unwrap_or_default();
        let found = fresh.iter().position(|&byte| byte == b'\n');
        match found.map(|at| self.scanned + at) {
            Some(end) if end <= self.limit => {
                self.scanned = 0;
                Ok(Progress::Event(cut_line(buffer, end)))
            }
            None if buffer.len() <= self.limit => {
                self.scanned = buffer.len();
                Ok(Progress::Need(1))
            }
            _ => Err(Fault::LineTooLong(self.limit)),
        }
    }

    /// The next request of a connection to a name server, without `NAME_SERVER`.
    ///
    /// # Errors
    /// As [`Lines::poll`].
    pub fn poll_request(&mut self, buffer: &mut BytesMut) -> Result<Progress<Bytes>, Fault> {
        Ok(self.poll(buffer)?.map(without_prefix))
    }
}

/// Reads an answer of several lines, up to the one that ends it.
#[derive(Debug, Clone)]
pub(crate) struct AnswerReader {
    lines: Lines,
    got: Vec<Bytes>,
    bytes: usize,
    limit: usize,
    is_end: fn(&[u8]) -> bool,
}

/// An answer: its lines, and the one that ended it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Lined {
    pub(crate) lines: Vec<Bytes>,
    pub(crate) end: Bytes,
}

impl AnswerReader {
    pub(crate) fn new(limits: &WireLimits, is_end: fn(&[u8]) -> bool) -> Self {
        let (lines, limit) = (Lines::new(limits), limits.max_message_bytes);
        Self { lines, got: Vec::new(), bytes: 0, limit, is_end }
    }

    /// Reads on; what follows the answer stays in the buffer.
    ///
    /// # Errors
    /// When a line or the whole is too long.
    pub(crate) fn poll(&mut self, buffer: &mut BytesMut) -> Result<Progress<Lined>, Fault> {
        loop {
            let Progress::Event(line) = self.lines.poll(buffer)? else {
                return Ok(Progress::Need(1));
            };
            if (self.is_end)(&line) {
                let lines = std::mem::take(&mut self.got);
                return Ok(Progress::Event(Lined { lines, end: line }));
            }
            // An empty line costs memory, too.
            self.bytes = self.bytes.saturating_add(line.len() + size_of::<Bytes>());
            if self.bytes > self.limit {
                return Err(Fault::MessageTooLarge { size: self.bytes, limit: self.limit });
            }
            self.got.push(line);
        }
    }
}

/// Scan for the end of a bottle's text, at which quotes and brackets are closed; goes on where it
/// stopped.
#[derive(Debug, Clone, Copy, Default)]
struct Closed {
    depth: usize,
    quoted: bool,
    escaped: bool,
}

impl Closed {
    fn scan(&mut self, text: &[u8]) {
        for &byte in text {
            if std::mem::take(&mut self.escaped) {
                continue;
            }
            match byte {
                b'\\' => self.escaped = true,
                b'"' => self.quoted = !self.quoted,
                b'(' | b'{' if !self.quoted => self.depth += 1,
                b')' | b'}' if !self.quoted => self.depth = self.depth.saturating_sub(1),
                _ => {}
            }
        }
    }

    /// True when a line that ends here is the last one.
    fn at_line_end(&mut self) -> bool {
        // A backslash at the end of a line joins the next one to it.
        !std::mem::take(&mut self.escaped) && !self.quoted && self.depth == 0
    }
}

/// Reads the text of one bottle: a line, or several while quotes or brackets are open.
#[derive(Debug, Clone)]
pub struct BottleLines {
    lines: Lines,
    text: Option<BytesMut>,
    closed: Closed,
}

impl BottleLines {
    /// A reader of texts of up to [`WireLimits::max_line_bytes`], all lines together.
    pub fn new(limits: &WireLimits) -> Self {
        Self { lines: Lines::new(limits), text: None, closed: Closed::default() }
    }

    /// The next text, without its end.
    ///
    /// # Errors
    /// When it is too long.
    pub fn poll(&mut self, buffer: &mut BytesMut) -> Result<Progress<Bytes>, Fault> {
        loop {
            let Progress::Event(line) = self.lines.poll(buffer)? else {
                return Ok(Progress::Need(1));
            };
            self.closed.scan(&line);
            let joins = self.closed.escaped;
            let last = self.closed.at_line_end();
            if last && self.text.is_none() {
                self.closed = Closed::default();
                return Ok(Progress::Event(line));
            }
            let text = self.text.get_or_insert_default();
            if text.len() + line.len() >= self.lines.limit {
                return Err(Fault::LineTooLong(self.lines.limit));
            }
            match line.split_last() {
                Some((_, before)) if joins => text.extend_from_slice(before),
                _ => text.extend_from_slice(&line),
            }
            if last {
                let text = self.text.take().unwrap_or_default();
                self.closed = Closed::default();
                return Ok(Progress::Event(text.freeze()));
            }
            if !joins {
                text.extend_from_slice(b"\n");
            }
        }
    }

    /// True between two texts.
    fn is_between(&self) -> bool {
        self.text.is_none()
    }
}

/// Reads messages of the text carriers.
#[derive(Debug, Clone)]
pub struct TextReader {
    command: Option<Command>,
    lines: Lines,
    payload: BottleLines,
}

impl TextReader {
    /// A reader that refuses lines beyond `limits`.
    pub fn new(limits: &WireLimits) -> Self {
        Self { command: None, lines: Lines::new(limits), payload: BottleLines::new(limits) }
    }

    /// Reads on.
    ///
    /// # Errors
    /// When a line is too long.
    pub fn poll(&mut self, buffer: &mut BytesMut) -> Result<Progress<Incoming>, Fault> {
        loop {
            if self.command.is_some() {
                let Progress::Event(text) = self.payload.poll(buffer)? else {
                    return Ok(Progress::Need(1));
                };
                let command = self.command.take().unwrap_or(Command::Unknown(0));
                return Ok(Progress::Event(Incoming { command, body: Body::Text(text) }));
            }
            let Progress::Event(line) = self.lines.poll(buffer)? else {
                return Ok(Progress::Need(1));
            };
            let command = Command::from_text(&line);
            if !command.has_payload() {
                let body = Body::Text(Bytes::new());
                return Ok(Progress::Event(Incoming { command, body }));
            }
            self.command = Some(command);
        }
    }

    /// Fault of a stream that ends here with `rest` bytes unread; `None` where it may end.
    #[must_use]
    pub fn end(&self, rest: usize) -> Option<Fault> {
        let whole = self.command.is_none() && self.payload.is_between() && rest == 0;
        (!whole).then_some(Fault::Truncated(1))
    }
}

/// A message for a text carrier: the line of the command, and that of a payload.
pub fn message(command: &Command, payload: Option<&[u8]>) -> Vec<u8> {
    let mut bytes = command.to_text();
    bytes.extend(b"\r\n");
    if let Some(payload) = payload {
        bytes.extend(payload);
        bytes.extend(b"\r\n");
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Vec<Incoming> {
        let (mut reader, mut found) = (TextReader::new(&WireLimits::default()), Vec::new());
        let mut buffer = BytesMut::from(text);
        while let Progress::Event(incoming) = reader.poll(&mut buffer).unwrap() {
            found.push(incoming);
        }
        found
    }

    fn payload(text: &str) -> String {
        match &read(&format!("d\n{text}"))[..] {
            [Incoming { body: Body::Text(text), .. }] => String::from_utf8(text.to_vec()).unwrap(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_payload_ends_with_its_line_unless_something_is_open() {
        assert_eq!(payload("1 2\r\n"), "1 2");
        assert_eq!(payload("\r\n"), "");
        assert_eq!(payload("(1\r\n2)\r\n"), "(1\n2)");
        assert_eq!(payload("\"a\nb\" \\\"\n"), "\"a\nb\" \\\"");
        assert_eq!(payload("1 \\\n2\n"), "1 2");
        assert_eq!(payload("a\0b\n"), "ab");
        assert_eq!(payload("a) 1\n"), "a) 1", "what closes too much is no reason to wait");
    }

    #[test]
    fn commands_without_payload_stand_alone() {
        let commands: Vec<_> = read("*\r\nq\nd\n1\n").into_iter().map(|m| m.command).collect();
        let data = Command::Data { reply: true, envelope: None };
        assert_eq!(commands, [Command::Describe, Command::Quit, data]);
    }

    #[test]
    fn endless_lines_end() {
        let limits = WireLimits { max_line_bytes: 10, ..WireLimits::default() };
        let mut reader = TextReader::new(&limits);
        let mut buffer = BytesMut::from("d\n((((((((");
        assert_eq!(reader.poll(&mut buffer), Ok(Progress::Need(1)));
        buffer.extend_from_slice(b"(((\n");
        assert_eq!(reader.poll(&mut buffer), Err(Fault::LineTooLong(10)));
        let mut buffer = BytesMut::from("d\n");
        let mut reader = TextReader::new(&limits);
        for _ in 0..4 {
            buffer.extend_from_slice(b"(\n");
            assert_eq!(reader.poll(&mut buffer), Ok(Progress::Need(1)));
        }
        buffer.extend_from_slice(b"((\n");
        assert_eq!(reader.poll(&mut buffer), Err(Fault::LineTooLong(10)));
    }

    #[test]
    fn requests_lose_their_prefix() {
        let cut = |text: &'static str| without_prefix(Bytes::from_static(text.as_bytes()));
        assert_eq!(cut("NAME_SERVER query /a"), "query /a");
        assert_eq!(cut("NAME_SERVER"), "");
        assert_eq!(cut("NAME_SERVERS x"), "NAME_SERVERS x");
        assert_eq!(cut("query /a"), "query /a");
    }
}
