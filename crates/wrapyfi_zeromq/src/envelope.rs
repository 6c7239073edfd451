//! A request or a reply on its way: ZeroMQ's envelope, and one frame.
//!
//! ```text
//!   │ routing id │ … │ mark │ "" │ body │
//!     by a ROUTER      ours       the only frame behind the empty one
//! ```
//!
//! Frames are read one by one, and what exceeds a bound is not kept.

use std::sync::Arc;

use bytes::Bytes;

use super::peer::Message;
use super::zmtp::Owned;
use mark::{Kind, Mark};
use wrapyfi_endpoint::codec::requests::{self, mark};

/// Frames in front of the empty one: a routing id for each broker on the way, and the mark.
const MAX_ENVELOPE: usize = 8;
/// Bytes of all those together; a routing id has at most 255.
const MAX_ENVELOPE_BYTES: usize = 1024;
/// Longest text of an error, in bytes.
const MAX_ERROR_BYTES: usize = 16 * 1024;

/// A message in its envelope.
#[derive(Debug)]
pub(super) struct ServiceMessage {
    /// Frames in front of the empty one.
    pub(super) envelope: Vec<Bytes>,
    pub(super) body: Bytes,
}

/// Fault of frames that are no [`ServiceMessage`].
#[derive(Debug)]
pub(super) enum Misfit {
    /// Frames without an envelope: nobody can be answered.
    NoEnvelope,
    /// The body is larger than allowed, in so many bytes.
    TooLarge(Vec<Bytes>, usize),
    /// Number of frames behind the empty one, which must be one.
    Frames(Vec<Bytes>, usize),
}

/// The next message, if one waits, and its size; bodies over `limit` bytes are not kept.
pub(super) fn receive(
    socket: &zmq::Socket,
    limit: usize,
) -> zmq::Result<Option<(Result<ServiceMessage, Misfit>, usize)>> {
    let mut frame = match socket.recv_msg(zmq::DONTWAIT) {
        Ok(frame) => frame,
        Err(zmq::Error::EAGAIN) => return Ok(None),
        Err(error) => return Err(error),
    };
    let mut reading = Reading::new(limit);
    loop {
        let more = frame.get_more();
        reading.add(Bytes::from_owner(Owned(frame)));
        if !more {
            let size = reading.size;
            return Ok(Some((reading.end(), size)));
        }
        // Frames of one message arrive together: this does not wait.
        frame = socket.recv_msg(0)?;
    }
}

/// The message of these frames.
pub(super) fn of_frames(frames: impl IntoIterator<Item = Bytes>) -> Result<ServiceMessage, Misfit> {
    let mut reading = Reading::new(usize::MAX);
    frames.into_iter().for_each(|frame| reading.add(frame));
    reading.end()
}

/// A message of which not all frames were seen.
struct Reading {
    limit: usize,
    envelope: Vec<Bytes>,
    body: Option<Bytes>,
    /// Bytes of all frames, of those in front of the empty one, and of those behind it.
    size: usize,
    outside: usize,
    body_bytes: usize,
    /// Number of frames behind the empty one.
    behind: usize,
    closed: bool,
    fits: bool,
}

impl Reading {
    fn new(limit: usize) -> Self {
        Self {
            limit,
            envelope: Vec::new(),
            body: None,
            size: 0,
            outside: 0,
            body_bytes: 0,
            behind: 0,
            closed: false,
            fits: true,
        }
    }

    fn add(&mut self, frame: Bytes) {
        self.size += frame.len();
        if self.closed {
            self.behind += 1;
            self.body_bytes += frame.len();
            if self.behind == 1 && self.body_bytes <= self.limit {
                self.body = Some(frame);
            }
        } else if frame.is_empty() {
            self.closed = true;
        } else {
            self.outside += frame.len();
            self.fits &= self.envelope.len() < MAX_ENVELOPE && self.outside <= MAX_ENVELOPE_BYTES;
            if self.fits {
                self.envelope.push(frame);
            }
        }
    }

    fn end(self) -> Result<ServiceMessage, Misfit> {
        let Self { envelope, body, .. } = self;
        match (self.closed && self.fits, self.behind, body) {
            (false, ..) => Err(Misfit::NoEnvelope),
            (true, 1, Some(body)) => Ok(ServiceMessage { envelope, body }),
            (true, 1, None) => Err(Misfit::TooLarge(envelope, self.body_bytes)),
            (true, frames, _) => Err(Misfit::Frames(envelope, frames)),
        }
    }
}

impl ServiceMessage {
    /// The mark of the caller, where it is ours.
    pub(super) fn mark(&self) -> Option<Mark> {
        self::mark(&self.envelope)
    }

    /// Size in bytes, all frames.
    pub(super) fn size(&self) -> usize {
        self.envelope.iter().map(Bytes::len).sum::<usize>() + self.body.len()
    }

    /// The reply to a request with this envelope that says why there is none.
    pub(super) fn error(mut envelope: Vec<Bytes>, text: &str) -> Self {
        let text = shortened(text);
        match self::mark(&envelope) {
            Some(mark) => {
                stamp(&mut envelope, Mark { kind: Kind::Error, ..mark });
                Self { envelope, body: Bytes::copy_from_slice(text.as_bytes()) }
            }
            None => Self { envelope, body: requests::encode_error(text).into() },
        }
    }

    /// The message as it goes to a peer, behind the first `without` frames of its envelope.
    pub(super) fn on_wire(&self, without: usize) -> Arc<Message> {
        let outside = self.envelope.iter().skip(without).cloned();
        let frames = outside.chain([Bytes::new(), self.body.clone()]).collect();
        // It counts where it waits.
        Message::new(frames, Some((Bytes::new(), self.size())), None)
    }

    /// Sends without waiting; false when there is no room for it, or nobody to take it.
    pub(super) fn send(&self, socket: &zmq::Socket) -> zmq::Result<bool> {
        let empty = Bytes::new();
        let frames = self.envelope.iter().chain([&empty]);
        // Only the first frame can find no room: there is room for whole messages or none.
        for frame in frames {
            match socket.send(&frame[..], zmq::SNDMORE | zmq::DONTWAIT) {
                Err(zmq::Error::EAGAIN) => return Ok(false),
                other => other?,
            }
        }
        socket.send(&self.body[..], zmq::DONTWAIT)?;
        Ok(true)
    }
}

/// Beginning of `text`, as long as an error may have it.
fn shortened(text: &str) -> &str {
    let ends = (0..=MAX_ERROR_BYTES.min(text.len())).rev();
    ends.take(4).find_map(|end| text.get(..end)).unwrap_or_default()
}

/// The mark in an envelope: its last frame.
pub(super) fn mark(envelope: &[Bytes]) -> Option<Mark> {
    envelope.last().and_then(|frame| Mark::decode(frame))
}

/// Puts `mark` in place of the one that an envelope has.
pub(super) fn stamp(envelope: &mut [Bytes], mark: Mark) {
    if let Some(last) = envelope.last_mut() {
        *last = mark.encode().into();
    }
}
