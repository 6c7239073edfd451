//! Security of a connection: none, or CURVE.
//!
//! ```text
//!   greeting ─▶ first command ─▶ handshake ─▶ open
//!   frames ── seal ──▶ bytes: outbox          bytes ── open ──▶ frames ── plain ──▶ message
//! ```

use std::sync::Arc;

use bytes::Bytes;

use super::assembly::Assembly;
use super::curve::{self, Curve, Grant, OVERHEAD};
use super::heard::ConnectionEnd;
use super::zmtp::{self, Breach, HandshakeStep, Opened};

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
}

impl Mechanism {
    /// CURVE; `hello` is our first command, where we begin, and `plain` takes messages where we are to hear some.
    pub(super) fn curve(curve: Curve, hello: Option<Vec<u8>>, plain: Option<Assembly>) -> Self {
        Self::Curve(Box::new(Secured { curve, hello, plain }))
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
        // libzmq leaves at another mechanism before it tells its own, and no user would know why.
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

    /// A command on the connection that is open.
    pub(super) fn command(&mut self, body: &[u8]) -> Option<Vec<u8>> {
        let Self::Curve(secured) = self else { return Some(zmtp::command(body)) };
        let mut sealed = Vec::new();
        secured.curve.seal(true, false, body, &mut sealed).ok()?;
        Some(sealed)
    }

    /// A message that goes next, sealed where the connection has CURVE.
    ///
    /// # Errors
    /// When it cannot be sealed.
    pub(super) fn sealed(&mut self, frames: &[Bytes]) -> Result<Option<Bytes>, curve::Breach> {
        if matches!(self, Self::Null) {
            return Ok(None);
        }
        let mut sealed = Vec::new();
        self.append(frames, &mut sealed)?;
        Ok(Some(sealed.into()))
    }

    /// Appends a message that goes next as its bytes go on the wire.
    ///
    /// # Errors
    /// When it cannot be sealed.
    pub(super) fn append(
        &mut self,
        frames: &[impl AsRef<[u8]>],
        out: &mut Vec<u8>,
    ) -> Result<(), curve::Breach> {
        let Self::Curve(secured) = self else {
            zmtp::append(frames, out);
            return Ok(());
        };
        for (index, frame) in frames.iter().map(AsRef::as_ref).enumerate() {
            secured.curve.seal(false, index + 1 < frames.len(), frame, out)?;
        }
        Ok(())
    }

    /// Takes a command of the handshake; `kind` is our type of socket.
    pub(super) fn handshake(
        &mut self,
        body: &[u8],
        kind: &str,
    ) -> Result<HandshakeStep, ConnectionEnd> {
        match self {
            Self::Null => match zmtp::short_text(body) {
                Some((b"READY", properties)) => Ok(HandshakeStep::Open(None, properties.to_vec())),
                _ => Err(Breach.into()),
            },
            Self::Curve(secured) => Ok(secured.curve.handshake(body, &zmtp::properties(kind))?),
        }
    }
}

impl Secured {
    /// Opens a frame in place: its body begins behind [`OVERHEAD`].
    pub(super) fn open(&mut self, frame: &mut [u8]) -> Result<Opened, ConnectionEnd> {
        Ok(self.curve.open(frame)?)
    }

    /// Assembly for frames with what CURVE adds to them.
    pub(super) fn around(plain: &Assembly) -> Assembly {
        Assembly::new(plain.limit.saturating_add(OVERHEAD))
    }
}
