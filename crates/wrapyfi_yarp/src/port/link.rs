//! A connection that we open to a port: what writes, asks, and administers.
//!
//! ```text
//!   connect ─▶ header ─▶ answer, or the unix socket ─▶ { command + payload ─▶ [◀─ reply] [◀─ ack] }* ─▶ goodbye
//! ```

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use tokio::net::TcpStream;
use tokio::time::timeout;

use super::stream::Stream;
use super::unix::Meeting;
use crate::bottle::{BottleError, BottleScan, Frame};
use crate::wire::message::{self, read_ack};
use crate::wire::text::{self, AnswerReader, BottleLines, Lines};
use crate::wire::{Body, Carrier, Command, Fault, Progress, Sender, bare, header};
use crate::{Bottle, Dialect, WireLimits};
use wrapyfi_retry::liveness::{self, Silence};

/// Name of those who administer.
pub(super) const ADMIN: &str = "admin";

/// Error of a connection to a port.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The connection could not be made.
    #[error("cannot connect to {address}: {error}")]
    Connect {
        /// Address that was tried.
        address: String,
        /// Error of the system.
        error: std::io::Error,
    },
    /// The peer broke a rule.
    #[error(transparent)]
    Fault(#[from] Fault),
    /// The socket failed.
    #[error("the connection failed: {0}")]
    Io(#[from] std::io::Error),
    /// The peer closed the connection.
    #[error("the peer closed the connection")]
    Closed,
    /// The peer did not answer in time.
    #[error("no answer within {0:?}")]
    Timeout(Duration),
    /// A reply that cannot be read.
    #[error("the reply is no bottle: {0}")]
    Reply(#[from] BottleError),
    /// The message has no form on this carrier.
    #[error("the message cannot be sent over {carrier}: {reason}")]
    Unsendable {
        /// The carrier.
        carrier: Carrier,
        /// Reason in words.
        reason: String,
    },
}

impl LinkError {
    /// True when no program is at the address.
    pub fn is_refused(&self) -> bool {
        let Self::Connect { error, .. } = self else { return false };
        error.kind() == std::io::ErrorKind::ConnectionRefused
    }
}

/// Settings that all links of a network have in common.
#[derive(Debug, Clone)]
pub(crate) struct LinkOptions {
    pub(crate) dialect: Dialect,
    pub(crate) limits: WireLimits,
    /// Longest time of connecting and of the answer to the header.
    pub(crate) timeout: Duration,
    /// Folder of the unix sockets.
    pub(crate) runtime_folder: Option<PathBuf>,
}

impl LinkOptions {
    /// One administrative request to the port at `contact`, over a connection of its own.
    pub(crate) async fn ask(
        &self,
        contact: &str,
        request: &Bottle,
        limit: Duration,
    ) -> Result<Bottle, LinkError> {
        let asked = async { Link::admin(contact, self).await?.ask(&Command::Admin, request).await };
        timeout(limit, asked).await.unwrap_or(Err(LinkError::Timeout(limit)))
    }
}

/// An open connection of a stream carrier.
#[derive(Debug)]
pub(crate) struct Link {
    pub(super) stream: Stream,
    buffer: BytesMut,
    pub(super) carrier: Carrier,
    /// Number in the answer to the header: the receiver's port on udp.
    pub(super) number: i32,
    options: LinkOptions,
    silence: Silence,
}

impl Link {
    /// Connects and shakes hands.
    pub(crate) async fn open(
        address: &str,
        carrier: Carrier,
        sender: &Sender,
        behind_name: &[u8],
        options: &LinkOptions,
    ) -> Result<Self, LinkError> {
        let opening = async {
            let mut link = Self::connect(address, carrier, options).await?;
            let meeting = if carrier.is_unix() {
                let (local, peer) = link.addresses()?;
                Some(Meeting::new(options.runtime_folder.as_deref(), local, peer, false)?)
            } else {
                None
            };
            let mut head = header::encode(carrier, sender, &link.options.limits)?;
            head.extend_from_slice(behind_name);
            link.write_raw(&[&head]).await?;
            if let Some(meeting) = meeting {
                link.stream = Stream::Unix(meeting.connect().await?);
            }
            let read = |buffer: &mut _| header::read_answer(carrier, buffer, &options.limits);
            link.number = link.poll(read).await?;
            Ok(link)
        };
        timeout(options.timeout, opening).await.unwrap_or(Err(LinkError::Timeout(options.timeout)))
    }

    /// Connects to the port at `contact` for administrative requests.
    pub(crate) async fn admin(contact: &str, options: &LinkOptions) -> Result<Self, LinkError> {
        Self::open(contact, Carrier::TextAck, &Sender::new(ADMIN), &[], options).await
    }

    /// Connects without a word.
    pub(crate) async fn connect(
        address: &str,
        carrier: Carrier,
        options: &LinkOptions,
    ) -> Result<Self, LinkError> {
        let connect = |error| LinkError::Connect { address: address.to_owned(), error };
        let stream = TcpStream::connect(address).await.map_err(connect)?;
        stream.set_nodelay(true)?;
        liveness::set_writer(&stream);
        Ok(Self::over(Stream::Tcp(stream), carrier, options.clone()))
    }

    /// A connection turned around: the header was the peer's.
    pub(crate) fn reversed(stream: TcpStream, carrier: Carrier, options: LinkOptions) -> Self {
        liveness::set_writer(&stream);
        Self::over(Stream::Tcp(stream), carrier, options)
    }

    fn over(stream: Stream, carrier: Carrier, options: LinkOptions) -> Self {
        let (buffer, silence) = (BytesMut::new(), Silence::default());
        Self { stream, buffer, carrier, number: 0, options, silence }
    }

    /// The addresses of both ends, its own first.
    pub(super) fn addresses(&self) -> std::io::Result<(SocketAddr, SocketAddr)> {
        let tcp = self.stream.tcp().ok_or(std::io::ErrorKind::Unsupported)?;
        Ok((tcp.local_addr()?, tcp.peer_addr()?))
    }

    /// Writes a message. Not cancel-safe.
    pub(crate) async fn write(
        &mut self,
        command: &Command,
        payload: &Bytes,
    ) -> Result<(), LinkError> {
        if self.carrier.is_text() {
            let body = Body::Binary(payload.clone());
            let bottle = body.bottle(self.options.dialect, &self.options.limits);
            let bottle = bottle.map_err(|error| LinkError::Unsendable {
                carrier: self.carrier,
                reason: error.to_string(),
            })?;
            let message = text::message(command, Some(&bottle.to_text_bytes()));
            return self.write_raw(&[&message]).await;
        }
        let head = match self.carrier.is_unix() {
            true => bare::head(command),
            false => message::head(command, &[payload.len()])?,
        };
        self.write_raw(&[&head, payload]).await
    }

    /// Waits for an acknowledgement, on carriers that have them. Not cancel-safe on text.
    pub(crate) async fn acknowledged(&mut self) -> Result<(), LinkError> {
        match self.carrier {
            Carrier::Tcp => self.poll(read_ack).await,
            Carrier::UnixStreamAck => self.poll(bare::read_ack).await,
            // Lines before it are a reply to no request.
            Carrier::TextAck => self.answer_lines().await.map(drop),
            _ => Ok(()),
        }
    }

    /// The lines of a reply on `text_ack`, up to the acknowledgement.
    pub(crate) async fn answer_lines(&mut self) -> Result<Vec<Bytes>, LinkError> {
        let mut reader = AnswerReader::new(&self.options.limits, |line| line == text::ACK);
        Ok(self.poll(|buffer| reader.poll(buffer)).await?.lines)
    }

    /// Sends a request that is a bottle; its answer, empty where there is none.
    pub(crate) async fn ask(
        &mut self,
        command: &Command,
        request: &Bottle,
    ) -> Result<Bottle, LinkError> {
        let dialect = self.options.dialect;
        let payload = request.encode(dialect).map_err(|error| LinkError::Unsendable {
            carrier: self.carrier,
            reason: error.to_string(),
        })?;
        let answer = self.request(command, &payload.into()).await?.unwrap_or_default();
        if answer.is_empty() {
            return Ok(Bottle::new());
        }
        Ok(Bottle::decode(&answer, dialect, &self.options.limits)?.0)
    }

    /// Sends a request and waits for its reply and acknowledgement; `None` when the peer only
    /// acknowledged. Not cancel-safe: close the connection then.
    pub(super) async fn request(
        &mut self,
        command: &Command,
        payload: &Bytes,
    ) -> Result<Option<Bytes>, LinkError> {
        self.write(command, payload).await?;
        match self.carrier {
            Carrier::TextAck => {
                let lines = self.answer_lines().await?;
                let text = (!lines.is_empty()).then(|| lines.join(&b'\n'));
                text.map(|text| self.bytes_of(text.into())).transpose()
            }
            Carrier::Text => {
                let mut lines = BottleLines::new(&self.options.limits);
                let line = self.poll(|buffer| lines.poll(buffer)).await?;
                self.bytes_of(line).map(Some)
            }
            _ => {
                let reply = self.binary_reply().await?;
                if reply.is_some() {
                    self.acknowledged().await?;
                }
                Ok(reply)
            }
        }
    }

    /// The binary form of a reply that came as text.
    fn bytes_of(&self, text: Bytes) -> Result<Bytes, LinkError> {
        let bad = |reason: String| LinkError::Fault(Fault::BadPayload(reason));
        let (dialect, limits) = (self.options.dialect, &self.options.limits);
        let bottle = Body::Text(text).bottle(dialect, limits);
        let bottle = bottle.map_err(|error| bad(error.to_string()))?;
        Ok(bottle.encode(dialect).map_err(|error| bad(error.to_string()))?.into())
    }

    async fn binary_reply(&mut self) -> Result<Option<Bytes>, LinkError> {
        let begin = |dialect| BottleScan::new(dialect, &self.options.limits);
        let (mut scan, mut other) =
            (begin(self.options.dialect), Some(begin(self.options.dialect.other())));
        // A bottle cannot begin with these letters: as a number they are no list.
        let ack = self.carrier.ack();
        loop {
            if !ack.is_empty() && self.buffer.starts_with(ack) {
                self.acknowledged().await?;
                return Ok(None);
            }
            let more = match self.buffer.len() {
                length @ 0..8 => 8 - length,
                _ => match (scan.advance(&self.buffer), other.take()) {
                    (Ok(Frame::Complete(size)), _) => {
                        return Ok(Some(self.buffer.split_to(size).freeze()));
                    }
                    (Ok(Frame::NeedMore(more)), rest) => {
                        other = rest;
                        more.max(1)
                    }
                    // A code that only the other dialect has shows who wrote this.
                    (Err(BottleError::OtherDialect { .. }), Some(rest)) => {
                        scan = rest;
                        continue;
                    }
                    (Err(error), _) => return Err(error.into()),
                },
            };
            self.fill(more).await?;
        }
    }

    /// Says goodbye and closes.
    pub(crate) async fn quit(mut self) -> Result<(), LinkError> {
        let goodbye = match self.carrier.is_text() {
            true => text::message(&Command::Quit, None),
            false if self.carrier.is_unix() => bare::head(&Command::Quit),
            false => message::quit(),
        };
        self.write_raw(&[&goodbye]).await?;
        self.acknowledged().await
    }

    /// Waits until the peer closes or is gone, throwing away what it says; why. Cancel-safe.
    pub(crate) async fn ended(&mut self) -> LinkError {
        loop {
            self.buffer.clear();
            if let Err(error) = self.fill(1024).await {
                return error;
            }
        }
    }

    /// True when the peer has closed in the meantime, as far as the system knows.
    pub(super) fn is_closed(&self) -> bool {
        // Bytes that answer no request mean that the connection is out of step.
        !self.buffer.is_empty() || self.stream.has_more()
    }

    /// Writes bytes as they are.
    pub(crate) async fn write_raw(&mut self, parts: &[&[u8]]) -> Result<(), LinkError> {
        self.silence.sent();
        tokio::select! {
            biased;
            written = self.stream.write_all(parts) => Ok(written?),
            error = self.silence.gone(self.stream.tcp()) => Err(error.into()),
        }
    }

    /// One line, without its end.
    pub(super) async fn line(&mut self) -> Result<Bytes, LinkError> {
        let mut lines = Lines::new(&self.options.limits);
        self.poll(|buffer| lines.poll(buffer)).await
    }

    /// Reads until `read` has what it looks for. Cancel-safe where `read` keeps what it has found.
    pub(crate) async fn poll<T>(
        &mut self,
        mut read: impl FnMut(&mut BytesMut) -> Result<Progress<T>, Fault>,
    ) -> Result<T, LinkError> {
        loop {
            match read(&mut self.buffer)? {
                Progress::Event(found) => return Ok(found),
                Progress::Need(more) => self.fill(more).await?,
            }
        }
    }

    async fn fill(&mut self, more: usize) -> Result<(), LinkError> {
        self.buffer.reserve(more.max(4 * 1024));
        let read = tokio::select! {
            biased;
            read = self.stream.read(&mut self.buffer) => read?,
            error = self.silence.gone(self.stream.tcp()) => return Err(error.into()),
        };
        match read {
            0 => Err(LinkError::Closed),
            _ => Ok(()),
        }
    }
}
