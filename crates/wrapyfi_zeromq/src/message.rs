//! Messages that wait for peers.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use bytes::Bytes;
use smallvec::SmallVec;

use super::own_messages::Fingerprint;
use super::zmtp;
use wrapyfi_endpoint::{DropReason, Outbox, Pieces, Waits};

/// Messages that are written with one call at most.
const BATCH_MESSAGES: usize = 64;
/// Bytes that are written with one call at most.
const BATCH_BYTES: usize = 64 * 1024;

/// Bytes of a message in pieces, of which a small message has one.
pub(super) type Parts = SmallVec<[Bytes; 1]>;

/// A message, which exists once however many peers it waits for.
#[derive(Debug)]
pub(super) struct Message {
    /// Its bytes as they go on the wire; its frames where each connection seals them for itself, with CURVE.
    pub(super) parts: Parts,
    /// Size of the parts.
    bytes: usize,
    /// Topic, empty where the connection is for one topic, and size as its publisher counts it; none for what the broker
    /// says itself.
    pub(super) of: Option<(Bytes, usize)>,
    /// Fingerprint by which it is known again when it comes back, where a program here listens.
    pub(super) print: Option<Fingerprint>,
    /// A listener missed it already: it is counted once.
    missed: AtomicBool,
}

/// A message, or bytes of a handshake, that waits for one peer.
#[derive(Debug, Clone)]
pub(super) enum Outgoing {
    /// Bytes of the handshake or a command, which are few and do not count as waiting.
    Word(Bytes),
    /// A message, and its bytes for this peer alone where they are sealed.
    Message(Arc<Message>, Option<Bytes>),
}

impl Outgoing {
    pub(super) fn message(&self) -> Option<&Arc<Message>> {
        match self {
            Self::Word(_) => None,
            Self::Message(message, _) => Some(message),
        }
    }

    /// True for a message of a publisher, which counts against the high-water mark.
    pub(super) fn is_of_publisher(&self) -> bool {
        self.message().is_some_and(|message| message.of.is_some())
    }
}

impl Waits for Outgoing {
    fn bytes(&self) -> usize {
        self.message().map_or(0, |message| message.bytes)
    }
}

impl Pieces for Outgoing {
    fn pieces(&self) -> impl Iterator<Item = &[u8]> {
        let pieces = match self {
            Self::Word(bytes) | Self::Message(_, Some(bytes)) => std::slice::from_ref(bytes),
            Self::Message(message, None) => &message.parts,
        };
        pieces.iter().map(|piece| &piece[..])
    }
}

/// Messages of a burst that are written with one call.
#[derive(Default)]
pub(super) struct Batch {
    messages: Vec<Outgoing>,
    bytes: Vec<u8>,
}

impl Batch {
    /// Takes the first messages that wait in place of those before; they stay in the queue until they are written.
    pub(super) fn take(&mut self, outbox: &Outbox<Outgoing>) {
        self.messages.clear();
        self.messages.extend(outbox.iter().take(BATCH_MESSAGES).cloned());
    }

    /// Bytes to write, behind the first `written`; what is too much for one call stays for the next.
    pub(super) fn bytes(&mut self, written: usize) -> &[u8] {
        self.bytes.clear();
        let mut skip = written;
        for piece in self.messages.iter().flat_map(Outgoing::pieces) {
            let rest = piece.get(skip..).unwrap_or_default();
            skip = skip.saturating_sub(piece.len());
            let room = BATCH_BYTES.saturating_sub(self.bytes.len());
            self.bytes.extend_from_slice(rest.get(..room).unwrap_or(rest));
        }
        &self.bytes
    }

    /// Lets go of the messages, into `spent` where that has room.
    pub(super) fn leave(&mut self, spent: &mut Vec<Outgoing>) {
        let room = (2 * BATCH_MESSAGES).saturating_sub(spent.len());
        spent.extend(self.messages.drain(..).take(room));
    }
}

/// A message that a listener did not get.
#[derive(Debug, Clone)]
pub(super) struct Loss {
    pub(super) reason: DropReason,
    pub(super) listener: SocketAddr,
    /// Topic and size, where no other listener missed it before.
    pub(super) first: Option<(Bytes, usize)>,
}

impl Message {
    /// A message of a publisher, with its topic and size, for connections that all have CURVE or none.
    pub(super) fn new<F: AsRef<[u8]> + Into<Bytes>>(
        frames: Vec<F>,
        is_sealed: bool,
        of: Option<(Bytes, usize)>,
        print: Option<Fingerprint>,
    ) -> Arc<Self> {
        let parts = match is_sealed {
            true => frames.into_iter().map(F::into).collect(),
            false => zmtp::encode(frames),
        };
        let bytes = parts.iter().map(Bytes::len).sum();
        Arc::new(Self { parts, bytes, of, print, missed: AtomicBool::new(false) })
    }

    /// A subscription to what begins with `topic`, or its end. It has a size, so that it counts where it waits.
    pub(super) fn subscription(is_on: bool, topic: &[u8], is_sealed: bool) -> Arc<Self> {
        let frame = zmtp::subscription(is_on, topic);
        let of = Some((Bytes::new(), frame.len()));
        Self::new(vec![frame], is_sealed, of, None)
    }

    /// The loss of this message at one listener.
    pub(super) fn loss(&self, reason: DropReason, listener: SocketAddr) -> Loss {
        let first = if self.missed.swap(true, Relaxed) { None } else { self.of.clone() };
        Loss { reason, listener, first }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_endpoint::Overflow;

    #[test]
    fn a_batch_goes_on_where_the_one_before_ended() {
        let (mut outbox, mut batch) = (Outbox::default(), Batch::default());
        let small = (0..200_usize).map(|n| vec![vec![n as u8; n % 9], vec![7; n % 5]]);
        let large = vec![vec![1; 3], vec![2; 5000], vec![3; BATCH_BYTES + 1000]];
        for frames in small.chain([large, vec![vec![4; 10]]]) {
            let message = Message::new(frames, false, Some((Bytes::new(), 1)), None);
            let message = Outgoing::Message(message, None);
            outbox.push(message, 999, Overflow::DropNewest, drop).unwrap();
        }
        let whole: Vec<u8> = outbox.iter().flat_map(Outgoing::pieces).flatten().copied().collect();
        let (mut written, mut sent) = (Vec::new(), 0);
        for count in [1, 2, 4, 3, 700, 11, 65_536, 5000].into_iter().cycle() {
            batch.take(&outbox);
            let bytes = batch.bytes(outbox.written());
            assert!(bytes.len() <= BATCH_BYTES);
            let bytes = &bytes[..count.min(bytes.len())];
            written.extend_from_slice(bytes);
            outbox.note_written(bytes.len(), |_| sent += 1);
            if outbox.is_empty() {
                break;
            }
        }
        assert!(written == whole, "{} of {} bytes", written.len(), whole.len());
        assert_eq!((sent, outbox.sent().1), (202, whole.len() as u64));
    }
}
