//! One request over `text_ack`: to a port's administration, or to a name server.
//!
//! ```text
//!   ─▶ CONNACK admin      ◀─ Welcome admin
//!   ─▶ a, [ver]           ◀─ [ver] 1 2 3, <ACK>     one connection each, which we close
//! ```

use std::io;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

use crate::bottle::TextError;
use crate::port::names::Registration;
use crate::wire::text::{self, Lines};
use crate::wire::{Carrier, Command, Fault, Sender, Step, header};
use crate::{Bottle, Limits};
use wrapyfi_retry::liveness;

/// Error of a request and its answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExchangeError {
    /// Nobody listens at the address.
    #[error("{address} cannot be reached: {source}")]
    Unreachable {
        /// Host and port.
        address: String,
        /// Error of the system.
        source: io::Error,
    },
    /// The connection broke.
    #[error("the connection to {address} failed: {source}")]
    Io {
        /// Host and port.
        address: String,
        /// Error of the system.
        source: io::Error,
    },
    /// The server did not answer in time.
    #[error("{address} did not answer within {timeout:?}")]
    TimedOut {
        /// Host and port.
        address: String,
        /// The time allowed.
        timeout: Duration,
    },
    /// The server closed the connection before its answer ended.
    #[error("{address} closed the connection before its answer ended")]
    Closed {
        /// Host and port.
        address: String,
    },
    /// The answer exceeds a limit.
    #[error("{address} answered with too much: {fault}")]
    TooLong {
        /// Host and port.
        address: String,
        /// Limit that was exceeded.
        fault: Fault,
    },
    /// The answer is none of YARP's.
    #[error("{address} answered {answer:?}, which is no answer of YARP's")]
    Nonsense {
        /// Host and port.
        address: String,
        /// Answer that came, shortened.
        answer: String,
    },
    /// The answer is no bottle.
    #[error("{address} answered with a bottle that cannot be read: {reason}")]
    Unreadable {
        /// Host and port.
        address: String,
        /// Fault of the bottle.
        reason: TextError,
    },
    /// The request cannot be sent.
    #[error("the request cannot be sent: {fault}")]
    Unsendable {
        /// Fault of the request.
        fault: Fault,
    },
}

/// Request and answer with one server: its address, the time for both, and the limits.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Exchange<'a> {
    pub(crate) host: &'a str,
    pub(crate) port: u16,
    pub(crate) timeout: Duration,
    pub(crate) limits: &'a Limits,
}

/// Letters of an answer that an error shows.
const SHOWN: usize = 80;

/// The beginning of an answer.
pub(crate) fn shown(answer: &[u8]) -> String {
    String::from_utf8_lossy(answer).chars().take(SHOWN).collect()
}

impl<'a> Exchange<'a> {
    /// Exchange with a port.
    pub(crate) fn to(port: &'a Registration, timeout: Duration, limits: &'a Limits) -> Self {
        Self { host: &port.host, port: port.port, timeout, limits }
    }

    fn address(&self) -> String {
        format!("{}:{}", self.host, self.port)
    }

    pub(crate) fn io(&self, source: io::Error) -> ExchangeError {
        ExchangeError::Io { address: self.address(), source }
    }

    pub(crate) fn closed(&self) -> ExchangeError {
        ExchangeError::Closed { address: self.address() }
    }

    pub(crate) fn nonsense(&self, answer: &[u8]) -> ExchangeError {
        ExchangeError::Nonsense { address: self.address(), answer: shown(answer) }
    }

    pub(crate) fn too_long(&self, fault: Fault) -> ExchangeError {
        ExchangeError::TooLong { address: self.address(), fault }
    }

    /// Does `work` within the time allowed.
    pub(crate) async fn in_time<T>(
        &self,
        work: impl Future<Output = Result<T, ExchangeError>>,
    ) -> Result<T, ExchangeError> {
        let late = || ExchangeError::TimedOut { address: self.address(), timeout: self.timeout };
        tokio::time::timeout(self.timeout, work).await.unwrap_or_else(|_| Err(late()))
    }

    /// Opens a connection.
    pub(crate) async fn open(&self) -> Result<TcpStream, ExchangeError> {
        let refused = |source| ExchangeError::Unreachable { address: self.address(), source };
        let stream = TcpStream::connect((self.host, self.port)).await.map_err(refused)?;
        stream.set_nodelay(true).map_err(|error| self.io(error))?;
        liveness::set_reader(&stream);
        Ok(stream)
    }

    /// Reads more; at least a byte.
    pub(crate) async fn fill(
        &self,
        stream: &mut TcpStream,
        buffer: &mut BytesMut,
    ) -> Result<(), ExchangeError> {
        buffer.reserve(4096);
        match stream.read_buf(buffer).await.map_err(|error| self.io(error))? {
            0 => Err(self.closed()),
            _ => Ok(()),
        }
    }

    /// The next line.
    async fn line(
        &self,
        stream: &mut TcpStream,
        lines: &mut Lines,
        buffer: &mut BytesMut,
    ) -> Result<Bytes, ExchangeError> {
        loop {
            match lines.poll(buffer).map_err(|fault| self.too_long(fault))? {
                Step::Event(line) => return Ok(line),
                Step::Need(_) => self.fill(stream, buffer).await?,
            }
        }
    }

    /// Says who we are, and waits for the welcome.
    pub(crate) async fn greet(
        &self,
        carrier: Carrier,
        sender: &str,
    ) -> Result<(TcpStream, BytesMut), ExchangeError> {
        let unsendable = |fault| ExchangeError::Unsendable { fault };
        let head =
            header::encode(carrier, &Sender::new(sender), self.limits).map_err(unsendable)?;
        let mut stream = self.open().await?;
        stream.write_all(&head).await.map_err(|error| self.io(error))?;
        let mut buffer = BytesMut::new();
        let mut lines = Lines::new(self.limits);
        let welcome = self.line(&mut stream, &mut lines, &mut buffer).await?;
        if !welcome.starts_with(b"Welcome ") {
            return Err(self.nonsense(&welcome));
        }
        Ok((stream, buffer))
    }

    /// Sends a command with its payload on a connection that was greeted, and reads the lines of
    /// the answer.
    pub(crate) async fn ask(
        &self,
        stream: &mut TcpStream,
        buffer: &mut BytesMut,
        command: &Command,
        payload: Option<&[u8]>,
    ) -> Result<Vec<Bytes>, ExchangeError> {
        let mut request = command.to_text();
        request.extend_from_slice(b"\r\n");
        if let Some(payload) = payload {
            request.extend_from_slice(payload);
            request.extend_from_slice(b"\r\n");
        }
        stream.write_all(&request).await.map_err(|error| self.io(error))?;
        let mut lines = Lines::new(self.limits);
        let (mut answer, mut size, limit) = (Vec::new(), 0_usize, self.limits.max_message_bytes);
        loop {
            let line = self.line(stream, &mut lines, buffer).await?;
            if &*line == text::ACK {
                return Ok(answer);
            }
            size = size.saturating_add(line.len() + size_of::<Bytes>());
            if size > limit {
                return Err(self.too_long(Fault::MessageTooLarge { size, limit }));
            }
            answer.push(line);
        }
    }

    /// One request on a connection of its own.
    pub(crate) async fn lines(
        &self,
        sender: &str,
        command: &Command,
        payload: Option<&[u8]>,
    ) -> Result<Vec<Bytes>, ExchangeError> {
        self.in_time(async {
            let (mut stream, mut buffer) = self.greet(Carrier::TextAck, sender).await?;
            self.ask(&mut stream, &mut buffer, command, payload).await
        })
        .await
    }

    /// One request whose answer is a bottle.
    pub(crate) async fn bottle(
        &self,
        command: &Command,
        request: &Bottle,
    ) -> Result<Bottle, ExchangeError> {
        let lines = self.lines("admin", command, Some(&request.to_text_bytes())).await?;
        let text = lines.join(&b'\n');
        Bottle::from_text(&text, self.limits)
            .map_err(|reason| ExchangeError::Unreadable { address: self.address(), reason })
    }
}
