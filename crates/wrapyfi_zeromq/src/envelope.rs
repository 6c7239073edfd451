//! A request or a reply on its way: ZeroMQ's envelope, and one frame.
//!
//! ```text
//!   │ routing id │ … │ mark │ "" │ body │
//!     by a ROUTER      ours       the only frame behind the empty one
//! ```
//!
//! Frames are read one by one, and what exceeds a bound is not kept.

use bytes::Bytes;

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
    let (mut envelope, mut body) = (Vec::new(), None);
    let (mut size, mut outside, mut behind, mut closed, mut fits) = (0, 0, 0, false, true);
    let mut body_bytes = 0;
    loop {
        let more = frame.get_more();
        size += frame.len();
        if closed {
            behind += 1;
            body_bytes += frame.len();
            if behind == 1 && body_bytes <= limit {
                body = Some(Bytes::from_owner(Owned(frame)));
            }
        } else if frame.is_empty() {
            closed = true;
        } else {
            outside += frame.len();
            fits &= envelope.len() < MAX_ENVELOPE && outside <= MAX_ENVELOPE_BYTES;
            if fits {
                envelope.push(Bytes::copy_from_slice(&frame));
            }
        }
        if !more {
            break;
        }
        // Frames of one message arrive together: this does not wait.
        frame = socket.recv_msg(0)?;
    }
    let message = match (closed && fits, behind, body) {
        (false, ..) => Err(Misfit::NoEnvelope),
        (true, 1, Some(body)) => Ok(ServiceMessage { envelope, body }),
        (true, 1, None) => Err(Misfit::TooLarge(envelope, body_bytes)),
        (true, frames, _) => Err(Misfit::Frames(envelope, frames)),
    };
    Ok(Some((message, size)))
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
