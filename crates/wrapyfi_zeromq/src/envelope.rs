//! A request or a reply on its way: ZeroMQ's envelope, and one frame.
//!
//! ```text
//!   │ routing id │ … │ mark │ "" │ body │
//!     by a ROUTER      ours       the only frame behind the empty one
//! ```

use bytes::Bytes;

use crate::codec::mark::{Kind, Mark};
use wrapyfi_endpoint::codec::requests;

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

/// Envelope of a message of these frames, and its body, or the number of frames that stand in place of one; nothing
/// where there is no envelope, so that no program can be answered.
pub(super) fn split(mut frames: Vec<Bytes>) -> Option<(Vec<Bytes>, Result<Bytes, usize>)> {
    let count = frames.len();
    let end = frames.iter().take(MAX_ENVELOPE + 1).position(Bytes::is_empty)?;
    let body = frames.split_off(end).pop();
    let behind = count.saturating_sub(end + 1);
    let fits = frames.iter().map(Bytes::len).sum::<usize>() <= MAX_ENVELOPE_BYTES;
    fits.then(|| (frames, body.filter(|_| behind == 1).ok_or(behind)))
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
        let text = requests::beginning(text, MAX_ERROR_BYTES);
        match self::mark(&envelope) {
            Some(mark) => {
                stamp(&mut envelope, Mark { kind: Kind::Error, ..mark });
                Self { envelope, body: Bytes::copy_from_slice(text.as_bytes()) }
            }
            None => Self { envelope, body: requests::encode_error(text).into() },
        }
    }

    /// Frames as they go to a peer, behind the first `without` of the envelope.
    pub(super) fn frames(&self, without: usize) -> Vec<Bytes> {
        let outside = self.envelope.iter().skip(without).cloned();
        outside.chain([Bytes::new(), self.body.clone()]).collect()
    }
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
