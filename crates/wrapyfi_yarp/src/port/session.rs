//! A connection that somebody opened to us, of any carrier: the layer under ports and name servers.
//!
//! ```text
//!   TcpStream ─▶ Session::accept ─▶ opening(): who, how      (or a fault, answered and closed)
//!                   │
//!                   └▶ next() ─▶ Event::Data, Admin, Command, Line, Http ─▶ yours to decide
//!                        ▲                                                      │
//!                        └──── acknowledges what was not answered ◀── answer(Answer::…) ┘
//! ```
//!
//! Usual loop, in one task a connection:
//!
//! ```no_run
//! # use wrapyfi_yarp::port::session::{Answer, Event, Session, SessionOptions, SessionError};
//! # async fn f(stream: tokio::net::TcpStream, options: SessionOptions) -> Result<(), SessionError> {
//! let mut session = Session::accept(stream, &options).await?; // waits at most for the handshake
//! while let Some(event) = session.next().await? {
//!     match event {
//!         // `NAME_SERVER query /a`, whatever carrier brought it; `Lines` fits all of them.
//!         Event::Line(line) => session.answer(Answer::Lines(String::from_utf8_lossy(&line).into())).await?,
//!         Event::Data(data) if data.reply => {
//!             let request = data.body.bottle(options.dialect, &options.limits);
//!             session.answer(Answer::Bottle(request.unwrap_or_default())).await?;
//!         }
//!         Event::Admin(_request) => session.answer(Answer::Nothing).await?,
//!         Event::Http(_request) => session.answer(Answer::Raw("HTTP/1.0 200 OK\r\n\r\n".into())).await?,
//!         _ => {} // the next call of `next` acknowledges it
//!     }
//! }
//! # Ok(())
//! # }
//! ```
//!
//! * `next` yields `None` when the peer says goodbye or closes between two messages: both are
//!   normal, and so is a connection without any bytes (`accept` then fails with
//!   [`SessionError::Silent`]). It is cancel-safe: what was read stays.
//! * Each event is acknowledged where its carrier does that (tcp, `text_ack`), once: by `answer`
//!   behind the reply, or by the next `next`. Until then the sender waits: that is how a reader
//!   holds it back.
//! * Handled in here: goodbye, unknown commands and their hint, `?`, messages that do not decode,
//!   fixed text for an unknown header. All of it is counted in [`SessionOptions::counters`].
//! * udp and mcast connections only say where datagrams come: the module `datagrams` takes the
//!   session apart and goes on.

mod event;

use std::io;
use std::net::SocketAddr;

use bytes::{Bytes, BytesMut};
use tokio::net::TcpStream;

use super::open::Admission;
use super::room::{Begun, progress};
use super::spare::Spare;
use super::stream::Stream;
use super::unix::Meeting;
use crate::Bottle;
use crate::wire::bare::{self, BareReader};
use crate::wire::header;
use crate::wire::http::HttpRequest;
use crate::wire::message::{Found, MessageReader};
use crate::wire::text::{self, Lines, TextReader};
use crate::wire::{Body, Carrier, Command, Fault, Incoming, Opening, Sender, Step, admin, number};
use wrapyfi_retry::liveness;

pub use event::{Answer, Data, Event, SessionError, SessionOptions};

/// Bytes read at a time where no length is known.
const READ_BYTES: usize = 8 * 1024;
/// Replies up to here are sent in one piece with their acknowledgement.
const COPY_BYTES: usize = 4 * 1024;

#[derive(Debug)]
enum Reader {
    Binary(MessageReader),
    Bare(BareReader),
    Text(TextReader),
    /// The first request stands in the opening.
    Lines(Option<Bytes>, Lines),
    Http(Option<HttpRequest>),
    /// udp and mcast: no messages on this stream.
    None,
}

/// A connection that was opened to us.
#[derive(Debug)]
pub struct Session {
    stream: Stream,
    peer: SocketAddr,
    buffer: BytesMut,
    spare: Spare,
    opening: Opening,
    carrier: Option<Carrier>,
    reader: Reader,
    envelope: Option<Bytes>,
    room: Begun,
    /// True when an acknowledgement is owed.
    owed: bool,
    ended: bool,
    options: SessionOptions,
}

impl Session {
    /// Reads the header of `stream` and answers it, except on udp and mcast.
    ///
    /// # Errors
    /// As [`SessionError`]; what must be said to the peer was said, faults are counted.
    pub async fn accept(stream: TcpStream, options: &SessionOptions) -> Result<Self, SessionError> {
        let accepted =
            tokio::time::timeout(options.handshake_timeout, Self::shake_hands(stream, options));
        let timeout = Fault::HandshakeTimeout(options.handshake_timeout);
        let accepted = accepted.await.unwrap_or(Err(timeout.into()));
        if let Err(SessionError::Fault(fault)) = &accepted {
            options.counters.count(fault);
        }
        accepted
    }

    async fn shake_hands(
        stream: TcpStream,
        options: &SessionOptions,
    ) -> Result<Self, SessionError> {
        stream.set_nodelay(true)?;
        liveness::set_reader(&stream);
        let (own, peer) = (stream.local_addr()?, stream.peer_addr()?);
        let mut stream = Stream::Tcp(stream);
        let mut buffer = BytesMut::with_capacity(READ_BYTES);
        let opening = loop {
            match Opening::poll(&mut buffer, &options.limits) {
                Ok(Step::Event(opening)) => break opening,
                Ok(Step::Need(more)) => {
                    buffer.reserve(more.max(READ_BYTES));
                    if stream.read(&mut buffer).await? == 0 {
                        return Err(SessionError::Silent);
                    }
                }
                Err(fault) => {
                    if matches!(fault, Fault::UnknownHeader(_)) {
                        stream.write_all(&[header::UNKNOWN_HEADER_HELP.as_bytes()]).await?;
                        stream.shutdown().await?;
                    }
                    return Err(fault.into());
                }
            }
        };
        let name = match &opening {
            Opening::Messages { sender, .. } => sender.name.as_str(),
            Opening::Names(_) | Opening::Http(_) => "",
        };
        Admission::check(options.admission.as_ref(), name, &peer.ip().to_string())?;
        let limits = &options.limits;
        let (carrier, reader) = match &opening {
            Opening::Names(line) => (None, Reader::Lines(Some(line.clone()), Lines::new(limits))),
            Opening::Http(request) => (None, Reader::Http(Some(request.clone()))),
            Opening::Messages { carrier, sender, .. } => {
                // YARP answers first and then finds that it lacks the modifier: its `connect` says
                // Success, and nothing comes. Without an answer it says that it cannot connect.
                if let Some(modifier) = sender.foreign_modifier() {
                    return Err(Fault::MissingModifier(modifier.to_owned()).into());
                }
                if !carrier.is_connectionless() {
                    let answer = header::answer(*carrier, sender, options.own_port);
                    stream.write_all(&[&answer]).await?;
                }
                if carrier.is_unix() {
                    let folder = options.runtime_folder.as_deref();
                    let bound = Meeting::new(folder, own, peer, true)?.bind()?;
                    stream = Stream::Unix(bound.accept().await?);
                }
                let reader = match carrier {
                    Carrier::Tcp | Carrier::FastTcp => Reader::Binary(MessageReader::new(limits)),
                    Carrier::Text | Carrier::TextAck => Reader::Text(TextReader::new(limits)),
                    Carrier::UnixStream | Carrier::UnixStreamAck => {
                        Reader::Bare(BareReader::new(options.dialect, limits))
                    }
                    Carrier::Udp | Carrier::Mcast | Carrier::Mjpeg => Reader::None,
                };
                (Some(*carrier), reader)
            }
        };
        let (envelope, owed, ended, options) = (None, false, false, options.clone());
        let room = Begun::new(options.rooms);
        Ok(Self {
            stream,
            peer,
            buffer,
            spare: Spare::default(),
            opening,
            carrier,
            reader,
            envelope,
            room,
            owed,
            ended,
            options,
        })
    }

    /// Sender and carrier of the connection.
    pub fn opening(&self) -> &Opening {
        &self.opening
    }

    /// The sender; `anon` where the carrier has no name, `web` over HTTP.
    pub fn sender(&self) -> Sender {
        match &self.opening {
            Opening::Messages { sender, .. } => sender.clone(),
            Opening::Names(_) => Sender::new("anon"),
            Opening::Http(_) => Sender::new("web"),
        }
    }

    /// The carrier's name with its qualifiers, as `[list]` tells it.
    pub fn carrier_text(&self) -> String {
        match &self.opening {
            Opening::Messages { carrier, sender, .. } => sender.carrier_text(*carrier),
            Opening::Names(_) => "name_ser".to_owned(),
            Opening::Http(_) => "http".to_owned(),
        }
    }

    /// True when answers are lines of text.
    pub fn is_text(&self) -> bool {
        self.carrier.is_none_or(Carrier::is_text)
    }

    /// The peer's address.
    pub fn peer(&self) -> SocketAddr {
        self.peer
    }

    /// The socket alone; none where it is a unix socket.
    #[must_use]
    pub fn into_tcp(self) -> Option<TcpStream> {
        match self.stream {
            Stream::Tcp(stream) => Some(stream),
            Stream::Unix(_) => None,
        }
    }

    /// The next thing that the peer wants; `None` at the end. Acknowledges the last one first,
    /// where it was not answered.
    ///
    /// # Errors
    /// As [`SessionError`], faults are counted; close the connection then.
    pub async fn next(&mut self) -> Result<Option<Event>, SessionError> {
        loop {
            if self.owed {
                self.answer(Answer::Nothing).await?;
            }
            if self.ended {
                return Ok(None);
            }
            let incoming = match self.poll() {
                Ok(Some(Step::Event(Item::Message(incoming)))) => incoming,
                Ok(Some(Step::Event(Item::Event(event)))) => return Ok(Some(event)),
                Ok(Some(Step::Need(more))) => {
                    if !self.fill(more).await? {
                        return self.end();
                    }
                    continue;
                }
                Ok(None) => return Ok(None),
                Err(fault) => return Err(self.fault(fault)),
            };
            self.owed = true;
            match incoming.command {
                Command::Data { reply, envelope } => {
                    if envelope.is_some() {
                        self.envelope = envelope;
                    }
                    let envelope = self.envelope.clone();
                    if let Body::Binary(payload) = &incoming.body {
                        self.spare.keep(payload);
                    }
                    return Ok(Some(Event::Data(Data { body: incoming.body, envelope, reply })));
                }
                Command::Admin => {
                    match incoming.body.bottle(self.options.dialect, &self.options.limits) {
                        Ok(request) => return Ok(Some(Event::Admin(request))),
                        Err(error) => {
                            self.options.counters.count(&Fault::BadPayload(error.to_string()));
                            self.answer(Answer::Bottle(admin::not_understood())).await?;
                        }
                    }
                }
                Command::Quit => {
                    self.answer(Answer::Nothing).await?;
                    self.ended = true;
                }
                Command::Help => self.say(text::COMMAND_HELP).await?,
                Command::Unknown(_) => self.say(text::UNKNOWN_COMMAND_HELP).await?,
                command => return Ok(Some(Event::Command(command))),
            }
        }
    }

    async fn say(&mut self, lines: &str) -> Result<(), SessionError> {
        let answer = if self.is_text() { Answer::Lines(lines.to_owned()) } else { Answer::Nothing };
        self.answer(answer).await
    }

    fn end(&mut self) -> Result<Option<Event>, SessionError> {
        self.ended = true;
        self.cut_short().map_or(Ok(None), |fault| Err(self.fault(fault)))
    }

    /// Fault of the peer where the stream ends now; `None` where it may end here.
    fn cut_short(&self) -> Option<Fault> {
        let rest = self.buffer.len();
        match &self.reader {
            Reader::Binary(reader) => reader.end(rest),
            Reader::Bare(reader) => reader.end(rest),
            Reader::Text(reader) => reader.end(rest),
            // The last line of a hurried peer may lack its end.
            Reader::Lines(..) | Reader::Http(_) | Reader::None => None,
        }
    }

    fn fault(&self, fault: Fault) -> SessionError {
        self.options.counters.count(&fault);
        fault.into()
    }

    fn poll(&mut self) -> Result<Option<Step<Item>>, Fault> {
        Ok(Some(match &mut self.reader {
            Reader::Binary(reader) => match reader.poll(&mut self.buffer)? {
                Step::Event(Found::Message(message)) => Step::Event(Item::Message(message)),
                Step::Event(Found::Left(fault)) => {
                    self.options.counters.count(&fault);
                    return self.poll();
                }
                Step::Need(more) => Step::Need(more),
            },
            Reader::Bare(reader) => reader.poll(&mut self.buffer)?.map(Item::Message),
            Reader::Text(reader) => reader.poll(&mut self.buffer)?.map(Item::Message),
            Reader::Lines(first, lines) => {
                let first = first.take().map(|line| Ok(Step::Event(line)));
                let line = first.unwrap_or_else(|| lines.poll_request(&mut self.buffer))?;
                line.map(|line| Item::Event(Event::Line(line)))
            }
            Reader::Http(request) => match request.take() {
                Some(request) => Step::Event(Item::Event(Event::Http(request))),
                None => return Ok(None),
            },
            Reader::None => return Ok(None),
        }))
    }

    /// Reads at least one byte, straight to where it stays; false at the end.
    async fn fill(&mut self, more: usize) -> Result<bool, SessionError> {
        let begun = self.buffer.len();
        self.room.hold(begun).map_err(|fault| self.fault(fault))?;
        let has_begun = begun > 0 || matches!(self.cut_short(), Some(Fault::Truncated(_)));
        self.spare.make_room(&mut self.buffer, more.max(READ_BYTES));
        let read = self.stream.read(&mut self.buffer);
        match progress(has_begun, self.options.progress_timeout, read)
            .await
            .map_err(|fault| self.fault(fault))?
        {
            Ok(count) => Ok(count > 0),
            // A text sender that closes with our `Welcome` unread resets the connection.
            Err(error) if error.kind() == io::ErrorKind::ConnectionReset => Ok(false),
            Err(error) => Err(error.into()),
        }
    }

    /// Answers the last event, and acknowledges it where its carrier does that.
    ///
    /// Not cancel-safe: when dropped half-way, close the connection.
    ///
    /// # Errors
    /// As [`SessionError`].
    pub async fn answer(&mut self, answer: Answer) -> Result<(), SessionError> {
        let owed = std::mem::take(&mut self.owed);
        let ack: &[u8] = match self.carrier {
            Some(Carrier::Tcp) if owed => &number::ACK,
            Some(Carrier::TextAck) if owed => b"<ACK>\r\n",
            Some(Carrier::UnixStreamAck) if owed => &bare::ACK,
            _ => &[],
        };
        let reply: Bytes = match answer {
            Answer::Bottle(bottle) if self.is_text() => text_line(&bottle),
            Answer::Bottle(bottle) => bottle.encode(self.options.dialect)?.into(),
            Answer::Object(bytes) if self.is_text() => {
                match Body::Binary(bytes).bottle(self.options.dialect, &self.options.limits) {
                    Ok(bottle) => text_line(&bottle),
                    Err(error) => {
                        self.options.counters.count(&Fault::BadPayload(error.to_string()));
                        text_line(&Bottle::new())
                    }
                }
            }
            Answer::Object(bytes) | Answer::Raw(bytes) => bytes,
            Answer::Lines(lines) => lines.into(),
            Answer::Nothing => Bytes::new(),
        };
        if reply.len() <= COPY_BYTES {
            let mut bytes = Vec::with_capacity(reply.len() + ack.len());
            bytes.extend_from_slice(&reply);
            bytes.extend_from_slice(ack);
            self.stream.write_all(&[&bytes]).await?;
        } else {
            self.stream.write_all(&[&reply, ack]).await?;
        }
        if matches!(self.reader, Reader::Http(_)) {
            self.stream.shutdown().await?;
            self.ended = true;
        }
        Ok(())
    }
}

enum Item {
    Message(Incoming),
    Event(Event),
}

fn text_line(bottle: &Bottle) -> Bytes {
    let mut line = bottle.to_text_bytes();
    line.extend(b"\r\n");
    line.into()
}
