//! Messages that wait for peers.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use bytes::Bytes;

use super::own_messages::Fingerprint;
use super::zmtp;
use wrapyfi_endpoint::{DropReason, Pieces, Waits};

/// A message, which exists once however many peers it waits for.
#[derive(Debug)]
pub(super) struct Message {
    /// Its bytes as they go on the wire; its frames where each connection seals them for itself, with CURVE.
    pub(super) parts: Vec<Bytes>,
    /// Size of the parts.
    bytes: usize,
    /// Topic and size as its publisher counts it; none for what the broker says itself.
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
    pub(super) fn new(
        frames: Vec<Bytes>,
        is_sealed: bool,
        of: Option<(Bytes, usize)>,
        print: Option<Fingerprint>,
    ) -> Arc<Self> {
        let parts = if is_sealed { frames } else { zmtp::encode(frames) };
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
