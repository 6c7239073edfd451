//! Messages that wait for peers.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use bytes::Bytes;

use super::own_messages::Fingerprint;
use super::zmtp;
use wrapyfi_endpoint::DropReason;

/// Form in which a message waits.
#[derive(Debug)]
pub(super) enum Content {
    /// Bytes as they go on the wire.
    Encoded(Vec<Bytes>),
    /// A command, or frames of a message, which each connection with CURVE seals for itself.
    Plain { is_command: bool, frames: Vec<Bytes> },
}

/// A message, which exists once however many peers it waits for.
#[derive(Debug)]
pub(super) struct Message {
    pub(super) content: Content,
    /// Size on the wire, or of the frames that are still to be sealed.
    pub(super) bytes: usize,
    /// Topic and size as its publisher counts it; none for what the broker says itself.
    pub(super) of: Option<(Bytes, usize)>,
    /// Fingerprint by which it is known again when it comes back, where somebody here listens.
    pub(super) print: Option<Fingerprint>,
    /// True where its bytes count as waiting: all but commands, which are few and short.
    pub(super) is_counted: bool,
    /// A listener missed it already: it is counted once.
    missed: AtomicBool,
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
        let content = match is_sealed {
            true => Content::Plain { is_command: false, frames },
            false => Content::Encoded(zmtp::encode(frames)),
        };
        Self::of_content(content, of, print, true)
    }

    /// Bytes of the handshake, which go as they are.
    pub(super) fn clear(bytes: Vec<u8>) -> Arc<Self> {
        Self::of_content(Content::Encoded(vec![bytes.into()]), None, None, false)
    }

    /// A command on a connection that is open.
    pub(super) fn command(body: Vec<u8>, is_sealed: bool) -> Arc<Self> {
        match is_sealed {
            true => {
                let content = Content::Plain { is_command: true, frames: vec![body.into()] };
                Self::of_content(content, None, None, false)
            }
            false => Self::clear(zmtp::command(&body)),
        }
    }

    fn of_content(
        content: Content,
        of: Option<(Bytes, usize)>,
        print: Option<Fingerprint>,
        is_counted: bool,
    ) -> Arc<Self> {
        let (Content::Encoded(parts) | Content::Plain { frames: parts, .. }) = &content;
        let bytes = parts.iter().map(Bytes::len).sum();
        Arc::new(Self { content, bytes, of, print, is_counted, missed: AtomicBool::new(false) })
    }

    /// The loss of this message at one listener.
    pub(super) fn loss(&self, reason: DropReason, listener: SocketAddr) -> Loss {
        let first = if self.missed.swap(true, Relaxed) { None } else { self.of.clone() };
        Loss { reason, listener, first }
    }
}
