//! Security of a connection: none, or CURVE.
//!
//! ```text
//!   greeting ─▶ first command ─▶ handshake ─▶ open
//!   outbox: frames ── seal ──▶ bytes          bytes ── open ──▶ frames ── plain ──▶ message
//! ```

use std::sync::Arc;

use super::assembly::Assembly;
use super::curve::{Curve, Grant, OVERHEAD};
use super::heard::End;
use super::message::Content;
use super::zmtp::{self, Breach, Opened, Step};

/// Bytes of memory that a connection with CURVE keeps for its next message.
const KEPT: usize = 64 * 1024;

/// Security of a connection.
pub(super) enum Mechanism {
    Null,
    Curve(Box<Secured>),
}

/// State of a connection with CURVE.
pub(super) struct Secured {
    curve: Curve,
    /// Our first command, where we begin.
    hello: Option<Vec<u8>>,
    /// The message that has begun, of frames that were opened.
    pub(super) plain: Option<Assembly>,
    /// The first message of the outbox, sealed when its turn comes: its number is that of its place.
    sealed: Vec<u8>,
}

impl Mechanism {
    /// CURVE; `hello` is our first command, where we begin, and `plain` takes messages where we are to hear some.
    pub(super) fn curve(curve: Curve, hello: Option<Vec<u8>>, plain: Option<Assembly>) -> Self {
        Self::Curve(Box::new(Secured { curve, hello, plain, sealed: Vec::new() }))
    }

    /// State of a connection with CURVE.
    pub(super) fn secured(&self) -> Option<&Secured> {
        match self {
            Self::Null => None,
            Self::Curve(secured) => Some(secured),
        }
    }

    /// Name in greetings.
    pub(super) fn name(&self) -> &'static str {
        if self.secured().is_some() { zmtp::CURVE } else { zmtp::NULL }
    }

    /// Permissions of the peer's key, where it has some.
    pub(super) fn grant(&self) -> Option<&Arc<Grant>> {
        self.secured()?.curve.grant()
    }

    /// Our greeting, as far as it is said first, and what follows the peer's, whatever that is.
    pub(super) fn greeting(&self) -> (Vec<u8>, Option<Vec<u8>>) {
        let is_server = self.secured().is_some_and(|secured| secured.curve.is_server());
        let mut greeting = zmtp::greeting(self.name(), is_server);
        // libzmq leaves at another mechanism before it tells its own, and nobody would know why.
        let rest = is_server.then(|| greeting.split_off(zmtp::VERSIONED));
        (greeting, rest)
    }

    /// Our first command, where we begin; `kind` is our type of socket.
    pub(super) fn begin(&mut self, kind: &str) -> Option<Vec<u8>> {
        match self {
            Self::Null => Some(zmtp::ready(kind)),
            Self::Curve(secured) => secured.hello.take().map(|hello| zmtp::command(&hello)),
        }
    }

    /// Takes a command of the handshake; `kind` is our type of socket.
    pub(super) fn handshake(&mut self, body: &[u8], kind: &str) -> Result<Step, End> {
        match self {
            Self::Null => match zmtp::short_text(body) {
                Some((b"READY", properties)) => Ok(Step::Open(None, properties.to_vec())),
                _ => Err(Breach.into()),
            },
            Self::Curve(secured) => Ok(secured.curve.handshake(body, &zmtp::properties(kind))?),
        }
    }
}

impl Secured {
    /// Opens a frame in place: its body begins behind [`OVERHEAD`].
    pub(super) fn open(&mut self, frame: &mut [u8]) -> Result<Opened, End> {
        Ok(self.curve.open(frame)?)
    }

    /// Bytes of the first message of the outbox behind the first `written`.
    pub(super) fn seal(&mut self, first: &Content, written: usize) -> std::io::Result<&[u8]> {
        if let Content::Plain { is_command, frames } = first
            && self.sealed.is_empty()
        {
            for (index, frame) in frames.iter().enumerate() {
                let more = index + 1 < frames.len();
                let sealed = self.curve.seal(*is_command, more, frame, &mut self.sealed);
                sealed.map_err(std::io::Error::other)?;
            }
        }
        Ok(self.sealed.get(written..).unwrap_or_default())
    }

    /// Number of bytes of the message that was sealed last.
    pub(super) fn sealed(&self) -> usize {
        self.sealed.len()
    }

    /// Forgets the message that was sealed last, which is written.
    pub(super) fn written(&mut self) {
        self.sealed.clear();
        self.sealed.shrink_to(KEPT);
    }

    /// Assembly for frames with what CURVE adds to them.
    pub(super) fn around(plain: &Assembly) -> Assembly {
        Assembly::new(plain.limit.saturating_add(OVERHEAD))
    }
}
