//! A connection that a program opened to a port, of any carrier, or that a port opened to read pictures.
//!
//! ```text
//!   TcpStream ─▶ Session::accept ─▶ who, how      (or a fault, answered and closed)
//!                   │
//!                   └▶ next() ─▶ Event::Data, Admin, Command, Line, Http ─▶ the port's to decide
//!                        ▲                                                      │
//!                        └──── acknowledges what was not answered ◀── answer(Answer::…) ┘
//! ```
//!
//! * `next` yields `None` when the peer says goodbye or closes between two messages: both are
//!   normal, and so is a connection without any bytes (`accept` then fails with
//!   [`LinkError::Closed`]). It is cancel-safe: what was read stays.
//! * Each event is acknowledged where its carrier does that (tcp, `text_ack`), once: by `answer`
//!   behind the reply, or by the next `next`. Until then the sender waits: that is how a reader
//!   holds it back.
//! * Handled in here: goodbye, unknown commands and their hint, `?`, messages that do not decode,
//!   fixed text for an unknown header. All of it is counted.
//! * udp and mcast connections only say where datagrams come: the module `datagrams` goes on.

mod event;

use std::io;
use std::net::{SocketAddr, SocketAddrV4};
use std::sync::Arc;

use bytes::{Bytes, BytesMut};
use tokio::net::TcpStream;
use tokio::time::timeout;

use super::core::Core;
use super::link::LinkError;
use super::open::Admission;
use super::room::{Begun, progress};
use super::spare::Spare;
use super::stream::Stream;
use super::unix::Meeting;
use crate::Bottle;
use crate::wire::bare::BareReader;
use crate::wire::header;
use crate::wire::http::HttpRequest;
use crate::wire::message::{Found, MessageReader};
use crate::wire::mjpeg::{MjpegReader, Picture};
use crate::wire::text::{self, Lines, TextReader};
use crate::wire::{Body, Carrier, Command, Fault, Incoming, Opening, Progress, admin};
use wrapyfi_retry::liveness;

pub use event::Answer;
pub(super) use event::{Data, Event};

/// Bytes read at a time where no length is known.
const READ_BYTES: usize = 8 * 1024;
/// Replies up to here are sent in one piece with their acknowledgement.
const COPY_BYTES: usize = 4 * 1024;

#[derive(Debug)]
enum Reader {
    Binary(MessageReader),
    Bare(BareReader),
    Text(TextReader),
    /// The first request stands in the header.
    Lines(Option<Bytes>, Lines),
    Http(Option<HttpRequest>),
    Mjpeg(MjpegReader),
    /// udp and mcast: no messages on this stream.
    None,
}

/// A connection that was opened to us.
#[derive(Debug)]
pub(super) struct Session {
    core: Arc<Core>,
    pub(super) stream: Stream,
    pub(super) peer: SocketAddr,
    /// Name of the sender; `anon` where the carrier has none, `web` over HTTP.
    pub(super) name: String,
    pub(super) carrier: Option<Carrier>,
    /// Name of the carrier with its qualifiers, as `[list]` tells it.
    pub(super) carrier_text: String,
    /// Group of the datagrams, on mcast.
    pub(super) group: Option<SocketAddrV4>,
    buffer: BytesMut,
    spare: Spare,
    reader: Reader,
    envelope: Option<Bytes>,
    room: Begun,
    /// True when an acknowledgement is owed.
    owed: bool,
    ended: bool,
}

impl Session {
    /// Reads the header of `stream` and answers it, except on udp and mcast.
    ///
    /// # Errors
    /// What must be said to the peer was said, faults are counted.
    pub(super) async fn accept(stream: TcpStream, core: &Arc<Core>) -> Result<Self, LinkError> {
        let limit = core.network.0.timeouts.handshake;
        let accepted = timeout(limit, Self::shake_hands(stream, core)).await;
        let accepted = accepted.unwrap_or(Err(Fault::HandshakeTimeout(limit).into()));
        if let Err(LinkError::Fault(fault)) = &accepted {
            core.fault_counts.count(fault);
        }
        accepted
    }

    async fn shake_hands(stream: TcpStream, core: &Arc<Core>) -> Result<Self, LinkError> {
        stream.set_nodelay(true)?;
        liveness::set_reader(&stream);
        let (own, peer) = (stream.local_addr()?, stream.peer_addr()?);
        let mut stream = Stream::Tcp(stream);
        let mut buffer = BytesMut::with_capacity(READ_BYTES);
        let limits = &*core.limits;
        let opening = loop {
            match Opening::poll(&mut buffer, limits) {
                Ok(Progress::Event(opening)) => break opening,
                Ok(Progress::Need(more)) => {
                    buffer.reserve(more.max(READ_BYTES));
                    if stream.read(&mut buffer).await? == 0 {
                        return Err(LinkError::Closed);
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
        let said = if let Opening::Messages { sender, .. } = &opening { &*sender.name } else { "" };
        Admission::check(core.options.senders.as_ref(), said, &peer.ip().to_string())?;
        let new = |stream, name: &str, text: &str, reader| {
            Self::new(core, (stream, peer), name, text.to_owned(), reader, buffer)
        };
        let (carrier, sender, group) = match opening {
            Opening::Names(line) => {
                let reader = Reader::Lines(Some(line), Lines::new(limits));
                return Ok(new(stream, "anon", "name_ser", reader));
            }
            Opening::Http(request) => {
                return Ok(new(stream, "web", "http", Reader::Http(Some(request))));
            }
            Opening::Messages { carrier, sender, group } => (carrier, sender, group),
        };
        // YARP answers first and then finds that it lacks the modifier: its `connect` says
        // Success, and nothing comes. Without an answer it says that it cannot connect.
        if let Some(modifier) = sender.foreign_modifier() {
            return Err(Fault::MissingModifier(modifier.to_owned()).into());
        }
        if !carrier.is_connectionless() {
            stream.write_all(&[&header::answer(carrier, &sender, core.number)]).await?;
        }
        if carrier.is_unix() {
            let folder = core.network.0.environment.runtime_folder();
            let bound = Meeting::new(folder.as_deref(), own, peer, true)?.bind()?;
            stream = Stream::Unix(bound.accept().await?);
        }
        let reader = match carrier {
            Carrier::Tcp | Carrier::FastTcp => Reader::Binary(MessageReader::new(limits)),
            Carrier::Text | Carrier::TextAck => Reader::Text(TextReader::new(limits)),
            Carrier::UnixStream | Carrier::UnixStreamAck => {
                Reader::Bare(BareReader::new(core.network.dialect(), limits))
            }
            Carrier::Udp | Carrier::Mcast | Carrier::Mjpeg => Reader::None,
        };
        let new = new(stream, &sender.name, &sender.carrier_text(carrier), reader);
        Ok(Self { carrier: Some(carrier), group, ..new })
    }

    fn new(
        core: &Arc<Core>,
        (stream, peer): (Stream, SocketAddr),
        name: &str,
        carrier_text: String,
        reader: Reader,
        buffer: BytesMut,
    ) -> Self {
        Self {
            core: Arc::clone(core),
            stream,
            peer,
            name: name.to_owned(),
            carrier: None,
            carrier_text,
            group: None,
            buffer,
            spare: Spare::default(),
            reader,
            envelope: None,
            room: Begun::new(core.network.0.rooms),
            owed: false,
            ended: false,
        }
    }

    /// The session of pictures that the port `name` sends, which were asked of it.
    pub(super) fn pulled(
        core: &Arc<Core>,
        ends: (Stream, SocketAddr),
        name: &str,
        reader: MjpegReader,
        buffer: BytesMut,
    ) -> Self {
        let text = Carrier::Mjpeg.name().to_owned();
        let new = Self::new(core, ends, name, text, Reader::Mjpeg(reader), buffer);
        Self { carrier: Some(Carrier::Mjpeg), ..new }
    }

    /// True when answers are lines of text.
    pub(super) fn is_text(&self) -> bool {
        self.carrier.is_none_or(Carrier::is_text)
    }

    /// True when each request is a line for a name server.
    pub(super) fn is_one_line(&self) -> bool {
        matches!(self.reader, Reader::Lines(..))
    }

    /// The socket alone; none where it is a unix socket.
    pub(super) fn into_tcp(self) -> Option<TcpStream> {
        match self.stream {
            Stream::Tcp(stream) => Some(stream),
            Stream::Unix(_) => None,
        }
    }

    /// The next thing that the peer wants; `None` at the end. Acknowledges the last one first,
    /// where it was not answered.
    ///
    /// # Errors
    /// Faults are counted; close the connection then.
    pub(super) async fn next(&mut self) -> Result<Option<Event>, LinkError> {
        loop {
            if self.owed {
                self.answer(Answer::Nothing).await?;
            }
            if self.ended {
                return Ok(None);
            }
            let incoming = match self.poll() {
                Ok(Some(Progress::Event(Item::Message(incoming)))) => incoming,
                Ok(Some(Progress::Event(Item::Event(event)))) => return Ok(Some(event)),
                Ok(Some(Progress::Need(more))) => {
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
                    match incoming.body.bottle(self.core.network.dialect(), &self.core.limits) {
                        Ok(request) => return Ok(Some(Event::Admin(request))),
                        Err(error) => {
                            self.core.fault_counts.count(&Fault::BadPayload(error.to_string()));
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

    async fn say(&mut self, lines: &'static str) -> Result<(), LinkError> {
        let lines = Bytes::from_static(lines.as_bytes());
        self.answer(if self.is_text() { Answer::Raw(lines) } else { Answer::Nothing }).await
    }

    fn end(&mut self) -> Result<Option<Event>, LinkError> {
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
            Reader::Mjpeg(reader) => reader.end(rest),
            // The last line of a hurried peer may lack its end.
            Reader::Lines(..) | Reader::Http(_) | Reader::None => None,
        }
    }

    fn fault(&self, fault: Fault) -> LinkError {
        self.core.fault_counts.count(&fault);
        fault.into()
    }

    fn poll(&mut self) -> Result<Option<Progress<Item>>, Fault> {
        Ok(Some(match &mut self.reader {
            Reader::Binary(reader) => match reader.poll(&mut self.buffer)? {
                Progress::Event(Found::Message(message)) => Progress::Event(Item::Message(message)),
                Progress::Event(Found::Left(fault)) => {
                    self.core.fault_counts.count(&fault);
                    return self.poll();
                }
                Progress::Need(more) => Progress::Need(more),
            },
            Reader::Bare(reader) => reader.poll(&mut self.buffer)?.map(Item::Message),
            Reader::Text(reader) => reader.poll(&mut self.buffer)?.map(Item::Message),
            Reader::Lines(first, lines) => {
                let first = first.take().map(|line| Ok(Progress::Event(line)));
                let line = first.unwrap_or_else(|| lines.poll_request(&mut self.buffer))?;
                line.map(|line| Item::Event(Event::Line(Body::Text(line))))
            }
            Reader::Mjpeg(reader) => reader.poll(&mut self.buffer)?.map(|picture| {
                let Picture { jpeg, envelope } = picture;
                Item::Event(Event::Data(Data { body: Body::File(jpeg), envelope, reply: false }))
            }),
            Reader::Http(request) => match request.take() {
                Some(request) => Progress::Event(Item::Event(Event::Http(request))),
                None => return Ok(None),
            },
            Reader::None => return Ok(None),
        }))
    }

    /// Reads at least one byte, straight to where it stays; false at the end.
    async fn fill(&mut self, more: usize) -> Result<bool, LinkError> {
        let begun = self.buffer.len();
        self.room.hold(begun).map_err(|fault| self.fault(fault))?;
        // A boundary stands behind each picture, before the next one has begun.
        let has_begun = begun > 0 && !matches!(self.reader, Reader::Mjpeg(_))
            || matches!(self.cut_short(), Some(Fault::Truncated(_)));
        self.spare.make_room(&mut self.buffer, more.max(READ_BYTES));
        let read = self.stream.read(&mut self.buffer);
        match progress(has_begun, self.core.network.0.timeouts.progress, read)
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
    /// When the connection fails, or the dialect has no form for the answer.
    pub(super) async fn answer(&mut self, answer: Answer) -> Result<(), LinkError> {
        let owed = std::mem::take(&mut self.owed);
        let ack = self.carrier.filter(|_| owed).map_or(&b""[..], Carrier::ack);
        let (dialect, limits) = (self.core.network.dialect(), &self.core.limits);
        let reply: Bytes = match answer {
            Answer::Bottle(bottle) if self.is_text() => text_line(&bottle),
            Answer::Bottle(bottle) => {
                let bytes = bottle.encode(dialect).map_err(|error| LinkError::Unsendable {
                    carrier: self.carrier.unwrap_or(Carrier::Tcp),
                    reason: error.to_string(),
                })?;
                bytes.into()
            }
            Answer::Object(bytes) if self.is_text() => {
                let bottle = Body::Binary(bytes).bottle(dialect, limits);
                text_line(&bottle.unwrap_or_else(|error| {
                    self.core.fault_counts.count(&Fault::BadPayload(error.to_string()));
                    Bottle::new()
                }))
            }
            Answer::Object(bytes) | Answer::Raw(bytes) => bytes,
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
