//! Messages of ports: payloads, with envelope and origin.

use std::sync::Arc;

use bytes::Bytes;

use crate::bottle::{BottleError, EncodeError};
use crate::sig::Stamp;
use crate::wire::{Body, Fault};
use crate::{Bottle, Dialect, WireLimits};

/// Format of the bytes of a [`PortPayload`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PayloadKind {
    /// A serialised object as binary carriers bring it: a bottle, or an image, a sound, a vector,
    /// whose bytes read as a bottle, too.
    #[default]
    Bottle,
    /// Anything else: a JPEG file on mjpeg.
    Raw,
}

/// Bytes of a message: shared, never copied on their way through a port.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct PortPayload {
    /// The bytes.
    pub bytes: Bytes,
    /// Format of the bytes.
    pub kind: PayloadKind,
}

impl PortPayload {
    /// A serialised object.
    pub fn object(bytes: impl Into<Bytes>) -> Self {
        Self { bytes: bytes.into(), kind: PayloadKind::Bottle }
    }

    /// Bytes that are no bottle.
    pub fn raw(bytes: impl Into<Bytes>) -> Self {
        Self { bytes: bytes.into(), kind: PayloadKind::Raw }
    }

    /// A bottle in the encoding of `dialect`.
    ///
    /// # Errors
    /// When that dialect lacks a type in it.
    pub fn bottle(bottle: &Bottle, dialect: Dialect) -> Result<Self, EncodeError> {
        Ok(Self::object(bottle.encode(dialect)?))
    }

    /// Reads the bytes as a bottle.
    ///
    /// # Errors
    /// When they are none, or exceed a limit.
    pub fn to_bottle(&self, dialect: Dialect, limits: &WireLimits) -> Result<Bottle, BottleError> {
        Bottle::decode(&self.bytes, dialect, limits).map(|(bottle, _)| bottle)
    }

    /// The payload that came as `body`: text becomes the bytes of the bottle that it is.
    pub(super) fn received(
        body: Body,
        dialect: Dialect,
        limits: &WireLimits,
    ) -> Result<Self, Fault> {
        let bad = |error: BottleError| Fault::BadPayload(error.to_string());
        match body {
            Body::Binary(bytes) => Ok(Self::object(bytes)),
            Body::File(bytes) => Ok(Self::raw(bytes)),
            text @ Body::Text(_) => {
                let bottle = text.bottle(dialect, limits).map_err(bad)?;
                let bytes = bottle.encode(dialect);
                Ok(Self::object(bytes.map_err(|error| Fault::BadPayload(error.to_string()))?))
            }
        }
    }
}

/// Reason why a target does not get a message that was meant for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Loss {
    /// The message gave way to a newer one.
    Full,
    /// The connection ended first.
    Connection,
    /// The output or its port was closed first.
    Closed,
    /// The message has no form on the target's carrier.
    Unsendable,
}

/// Receiver of the losses of messages that were meant for a target.
pub trait Fate: std::fmt::Debug + Send + Sync {
    /// A target does not get it.
    fn lost(&self, how: Loss);
}

/// A message to write.
#[derive(Debug, Clone, Default)]
pub struct Message {
    /// PortPayload to send.
    pub payload: PortPayload,
    /// The text that goes with it: a [`Stamp`] usually. Cut at the first byte below 32 by readers.
    pub envelope: Option<Bytes>,
    /// Receiver of the losses: it is told of targets that do not get the message.
    pub fate: Option<Arc<dyn Fate>>,
}

impl Message {
    /// A message without envelope.
    pub fn new(payload: PortPayload) -> Self {
        Self { payload, ..Self::default() }
    }

    pub(super) fn lost(&self, how: Loss) {
        self.fate.iter().for_each(|fate| fate.lost(how));
    }

    /// The message with a time stamp.
    #[must_use]
    pub fn stamped(mut self, stamp: Stamp) -> Self {
        self.envelope = Some(stamp.to_envelope().into());
        self
    }
}

/// A message that came.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Received {
    /// PortPayload that was sent.
    pub payload: PortPayload,
    /// The last envelope of its connection.
    pub envelope: Option<Bytes>,
    /// The name of the sender, as it said.
    pub from: Arc<str>,
    /// Number of its connection among those of this port: several senders may have one name, unless that
    /// begins with a slash.
    pub connection: u64,
    /// True when the message came as text: its bytes are of the network's dialect, whatever the
    /// sender speaks.
    pub is_text: bool,
    /// Encoding of bottles.
    pub(super) dialect: Dialect,
    pub(super) limits: Arc<WireLimits>,
}

impl Received {
    /// The bottle that was sent.
    ///
    /// # Errors
    /// When it is none in the dialect of the network, or exceeds a limit.
    pub fn bottle(&self) -> Result<Bottle, BottleError> {
        self.payload.to_bottle(self.dialect, &self.limits)
    }

    /// The time stamp, where the envelope is one.
    pub fn stamp(&self) -> Option<Stamp> {
        self.envelope.as_deref().and_then(Stamp::from_envelope)
    }
}
