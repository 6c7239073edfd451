//! Messages that wait for peers.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use bytes::Bytes;
use smallvec::SmallVec;

use super::own_messages::Fingerprint;
use super::zmtp;
use wrapyfi_endpoint::{DropReason, Pieces, Waits};

/// Messages of a batch at most.
const BATCH_MESSAGES: usize = 64;
/// Bytes of memory that are kept for the next batch.
const SPARE_BYTES: usize = 16 * 1024;

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
#[derive(Debug)]
pub(super) enum Outgoing {
    /// Bytes of the handshake or a command, which are few and do not count as waiting.
    Word(Bytes),
    /// A message, and its bytes for this peer alone where they are sealed.
    Message(Arc<Message>, Option<Bytes>),
    /// Small messages of a publisher of ours.
    Batch(Box<Batch>),
}

impl Outgoing {
    pub(super) fn message(&self) -> Option<&Arc<Message>> {
        match self {
            Self::Word(_) | Self::Batch(_) => None,
            Self::Message(message, _) => Some(message),
        }
    }

    /// Messages of a publisher, which count against the high-water mark, without those that are in the first `written` bytes as a whole: the
    /// size of each as its publisher counts it, and its fingerprint.
    pub(super) fn published(
        &self,
        written: usize,
    ) -> impl Iterator<Item = (usize, Option<Fingerprint>)> {
        let batch = if let Self::Batch(batch) = self { Some(batch) } else { None };
        let batch = batch.and_then(|batch| batch.messages.get(batch.written(written)..));
        let batch = batch.unwrap_or_default().iter().map(|one| (one.bytes, one.print));
        let one = self.message().and_then(|one| Some((one.of.as_ref()?.1, one.print)));
        batch.chain(one)
    }

    /// Number of messages of a batch that are in its first `written` bytes as a whole.
    pub(super) fn written(&self, written: usize) -> usize {
        match self {
            Self::Batch(batch) if written > 0 => batch.written(written),
            _ => 0,
        }
    }
}

impl Waits for Outgoing {
    fn bytes(&self) -> usize {
        match self {
            Self::Word(_) => 0,
            Self::Message(message, _) => message.bytes,
            Self::Batch(batch) => batch.messages.iter().map(|message| message.bytes).sum(),
        }
    }
}

impl Pieces for Outgoing {
    fn pieces(&self) -> impl Iterator<Item = &[u8]> {
        let pieces = match self {
            Self::Word(bytes) | Self::Message(_, Some(bytes)) => std::slice::from_ref(bytes),
            Self::Message(message, None) => &message.parts,
            Self::Batch(_) => &[],
        };
        let batch = if let Self::Batch(batch) = self { Some(&batch.bytes[..]) } else { None };
        pieces.iter().map(|piece| &piece[..]).chain(batch)
    }
}

/// Small messages for one peer, which lie one behind the other: their memory is used again, and two threads share as little of it as can be.
#[derive(Debug, Default)]
pub(super) struct Batch {
    /// Their bytes as they go on the wire. They grow until the I/O thread has them, which then writes them without a lock.
    bytes: Arc<Vec<u8>>,
    messages: Vec<InBatch>,
}

/// A message of a batch.
#[derive(Debug)]
struct InBatch {
    /// Size as its publisher counts it.
    bytes: usize,
    print: Option<Fingerprint>,
    /// Number of bytes of the batch up to its end.
    end: usize,
}

impl Batch {
    /// Takes another message, whose bytes `put` appends; `None` where the I/O thread has the batch, or it is full.
    pub(super) fn take<T>(
        &mut self,
        size: usize,
        print: Option<Fingerprint>,
        put: impl FnOnce(&mut Vec<u8>) -> T,
    ) -> Option<T> {
        let bytes =
            Arc::get_mut(&mut self.bytes).filter(|_| self.messages.len() < BATCH_MESSAGES)?;
        let put = put(bytes);
        self.messages.push(InBatch { bytes: size, print, end: bytes.len() });
        Some(put)
    }

    /// Its bytes, for the I/O thread.
    pub(super) fn bytes(&self) -> Arc<Vec<u8>> {
        Arc::clone(&self.bytes)
    }

    /// Number of messages of which the first `written` bytes of the batch hold all.
    fn written(&self, written: usize) -> usize {
        self.messages.partition_point(|message| message.end <= written)
    }

    /// The same, empty, for other messages; `None` where its memory is much, or in use.
    pub(super) fn emptied(mut self: Box<Self>) -> Option<Box<Self>> {
        self.messages.clear();
        let bytes =
            Arc::get_mut(&mut self.bytes).filter(|bytes| bytes.capacity() <= SPARE_BYTES)?;
        bytes.clear();
        Some(self)
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

    #[test]
    fn a_batch_takes_messages_until_another_has_it_or_it_is_full() {
        let mut batch = Box::<Batch>::default();
        let put = |batch: &mut Batch, byte: u8| batch.take(3, None, |out| out.push(byte)).is_some();
        assert!(put(&mut batch, 1) && put(&mut batch, 2));
        let writes = batch.bytes();
        assert!(!put(&mut batch, 3), "it is being written");
        assert_eq!(*writes, [1, 2]);
        drop(writes);
        assert_eq!((4..=255).filter(|byte| put(&mut batch, *byte)).count(), BATCH_MESSAGES - 2);
        let outgoing = Outgoing::Batch(batch);
        assert_eq!(outgoing.bytes(), 3 * BATCH_MESSAGES);
        let left = |written| outgoing.published(written).count();
        assert_eq!([0, 1, 3, 999].map(left), [BATCH_MESSAGES, 63, 61, 0]);
        assert_eq!(outgoing.written(3), 3);
        let pieces: Vec<u8> = outgoing.pieces().flatten().copied().collect();
        assert_eq!((pieces.len(), &pieces[..3]), (BATCH_MESSAGES, &[1, 2, 4][..]));
        let Outgoing::Batch(batch) = outgoing else { unreachable!() };
        let mut batch = batch.emptied().unwrap();
        assert!(batch.bytes().is_empty() && put(&mut batch, 9));
        let writes = batch.bytes();
        assert!(batch.emptied().is_none(), "memory that is still in use is not used again");
        assert_eq!(*writes, [9]);
        let mut large = Box::<Batch>::default();
        assert!(large.take(1, None, |out| out.resize(SPARE_BYTES + 1, 0)).is_some());
        assert!(large.emptied().is_none(), "much memory is not kept");
    }
}
