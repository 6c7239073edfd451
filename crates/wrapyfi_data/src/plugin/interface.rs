//! A plug-in, and what it is given to decode an object.

use std::cell::Cell;

use super::{Body, Part, PluginError, Plugins};
use crate::Limits;
use crate::types::Value;

/// The reader and writer of one plug-in key's objects (Wrapyfi's `Plugin` class).
///
/// Both directions work on bytes of strangers and values of users: they never panic, allocate only
/// in proportion to received bytes, and never run an object that they read.
///
/// [`Plugins::with`] adds it.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::{plugin, types}; }
/// use wrapyfi_core::plugin::{Body, Part, Plugin, PluginError, Unpacking};
/// use wrapyfi_core::types::Value;
///
/// /// Text that travels as a file: `{"__wrapyfi__": ["Note", "aGk="]}`.
/// struct Note;
/// impl Plugin for Note {
///     fn key(&self) -> &str { "Note" }
///     fn decode(&self, body: &Body<'_>, _: &Unpacking<'_>) -> Result<Value, PluginError> {
///         let text = String::from_utf8(body.base64(0)?.to_vec());
///         text.map(Value::from).map_err(|error| PluginError::malformed(0, error.to_string()))
///     }
///     fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError> {
///         let text = value.as_str().ok_or_else(|| PluginError::not_mine("note", value))?;
///         Ok(vec![Part::base64(text.to_owned())])
///     }
/// }
///
/// assert_eq!(Note.encode(&"hi".into())?, [Part::base64("hi")]);
/// assert!(Note.encode(&5.into()).is_err());
/// # Ok::<(), PluginError>(())
/// ```
pub trait Plugin: Send + Sync {
    /// Key on the wire: in Python, the name of the plug-in's class.
    fn key(&self) -> &str;

    /// Decodes the parts behind the key.
    ///
    /// # Errors
    /// When they are malformed, or hold things that this plug-in does not read. The object then
    /// stays a [`crate::types::Tagged`] that carries the reason and travels on as it came.
    fn decode(&self, body: &Body<'_>, context: &Unpacking<'_>) -> Result<Value, PluginError>;

    /// Encodes a value whose [`Value::plugin_key`] is this key into the parts behind the key.
    ///
    /// # Errors
    /// When Python's side of the plug-in could not read any form of it.
    fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError>;
}

/// Limits and plug-ins for a plug-in that decodes.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::{Limits, plugin}; }
/// use std::cell::Cell;
/// use wrapyfi_core::Limits;
/// use wrapyfi_core::plugin::{Plugins, Unpacking};
/// let (limits, plugins, unpacked) = (Limits::default(), Plugins::none(), Cell::new(0));
/// let context = Unpacking::new(&limits, &plugins, &unpacked);
/// // A small file that claims to hold 40 MiB, twice in one message of at most 64 MiB.
/// assert!(context.unpack("pixels", 40 << 20).is_ok());
/// assert_eq!(context.left().message_bytes, 24 << 20);
/// assert!(context.unpack("pixels", 40 << 20).is_err());
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Unpacking<'a> {
    /// Limits: an unpacked object may not exceed `message_bytes`, nor nest deeper than `depth`.
    pub limits: &'a Limits,
    /// Plug-ins in use, for parts that are native objects themselves.
    pub plugins: &'a Plugins,
    /// Number of bytes that the objects of the message have been unpacked to so far.
    unpacked: &'a Cell<u64>,
}

impl<'a> Unpacking<'a> {
    /// The context of all objects of one message. `unpacked` begins at 0.
    pub fn new(limits: &'a Limits, plugins: &'a Plugins, unpacked: &'a Cell<u64>) -> Self {
        Self { limits, plugins, unpacked }
    }

    /// Counts `bytes` that are about to be allocated for compressed or only claimed data. All
    /// objects of a message together may take `message_bytes` in this way: otherwise a small
    /// message of many small files could fill the memory.
    ///
    /// # Errors
    /// When the limit is exceeded; `what` names the data. The bytes are not counted then.
    pub fn unpack(&self, what: impl Into<String>, bytes: u64) -> Result<(), PluginError> {
        let actual = self.unpacked.get().saturating_add(bytes);
        let limit = self.limits.message_bytes as u64;
        if actual > limit {
            return Err(PluginError::TooLarge { what: what.into(), actual, limit });
        }
        self.unpacked.set(actual);
        Ok(())
    }

    /// Limits for the next object that is unpacked: the part that the objects of the message have
    /// left.
    pub fn left(&self) -> Limits {
        let unpacked = usize::try_from(self.unpacked.get()).unwrap_or(usize::MAX);
        let message_bytes = self.limits.message_bytes.saturating_sub(unpacked);
        Limits { message_bytes, ..*self.limits }
    }

    /// Limits for JSON inside a part of `length` bytes: room for as many values as Python's `json`
    /// can write into it, at three bytes each.
    pub fn limits_within(&self, length: usize) -> Limits {
        let message_bytes = length.saturating_mul(3).min(self.limits.message_bytes);
        Limits { message_bytes, ..*self.limits }
    }
}
