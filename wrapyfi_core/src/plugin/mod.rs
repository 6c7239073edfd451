//! Plug-ins: what the objects behind Wrapyfi's plug-in keys are.
//!
//! ```text
//!   {"__wrapyfi__": [key, part, part, …]}
//!                     │    └────┴─ Body ──▶ Plugin::decode ──▶ Value
//!                     └ Plugins: key ─▶ plug-in               (refused: Tagged, carried intact)
//!
//!   Value ── plugin_key ──▶ Plugin::encode ──▶ [Part, …] ──▶ the same text
//! ```
//!
//! [`Plugins::standard`] has every key of Wrapyfi's own table (`docs/wire/plugins.md`). A crate of
//! the user adds one by implementing [`Plugin`]:
//!
//! ```
//! use wrapyfi_core::plugin::{Body, Context, Part, Plugin, PluginError, Plugins};
//! use wrapyfi_core::types::{ForeignObject, PluginObject, Value};
//! use wrapyfi_core::{Limits, codec::json};
//!
//! #[derive(Debug, Clone, PartialEq)]
//! struct Pose { x: f64, y: f64 }
//! impl PluginObject for Pose {
//!     fn key(&self) -> &str { "Pose2D" }
//! }
//!
//! struct Pose2D;
//! impl Plugin for Pose2D {
//!     fn key(&self) -> &str { "Pose2D" }
//!     fn decode(&self, body: &Body<'_>, _: &Context<'_>) -> Result<Value, PluginError> {
//!         let number = |part| body.value(part)?.as_f64().ok_or_else(|| body.expected(part, "a number"));
//!         Ok(ForeignObject::new(Pose { x: number(0)?, y: number(1)? }).into())
//!     }
//!     fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError> {
//!         let pose = value.as_object::<Pose>().ok_or_else(|| PluginError::not_mine("Pose", value))?;
//!         Ok(vec![Part::Value(pose.x.into()), Part::Value(pose.y.into())])
//!     }
//! }
//!
//! let plugins = Plugins::standard().with(Pose2D);
//! let text = r#"{"__wrapyfi__": ["Pose2D", 1.0, 2.5]}"#;
//! let value = json::decode_with(&text.into(), &Limits::default(), &plugins)?;
//! assert_eq!(value.as_object::<Pose>().unwrap().y, 2.5);
//! assert_eq!(json::encode_with(&value, &plugins)?, text.as_bytes());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod body;
mod devices;
mod error;
mod npy_tensor;
mod pint;
mod set;

pub use body::{Body, Part};
pub use devices::{DeviceError, DeviceMap, DeviceMaps, DeviceOption, Framework};
pub use error::PluginError;
pub use set::Plugins;

pub(crate) use body::Element;

use std::cell::Cell;

use crate::Limits;
use crate::types::Value;

/// Reads and writes the objects of one plug-in key (Wrapyfi's `Plugin` class, FEATURES 8).
///
/// Both directions work on bytes of strangers and values of users: they never panic, allocate
/// nothing in proportion to what was not received, and never run what they read.
pub trait Plugin: Send + Sync {
    /// The key on the wire: in Python, the name of the plug-in's class.
    fn key(&self) -> &str;

    /// What the parts behind the key mean.
    ///
    /// # Errors
    /// When they are malformed or hold what this plug-in does not read. The object then stays a
    /// [`crate::types::Tagged`] that carries the reason and travels on as it came.
    fn decode(&self, body: &Body<'_>, context: &Context<'_>) -> Result<Value, PluginError>;

    /// The parts behind the key, for a value whose [`Value::plugin_key`] is this key.
    ///
    /// # Errors
    /// When Python's side of the plug-in could not read any form of it.
    fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError>;
}

/// What a plug-in may know while it decodes.
#[derive(Debug, Clone, Copy)]
pub struct Context<'a> {
    /// Bounds: nothing a plug-in unpacks may exceed `message_bytes`, nor nest deeper than `depth`.
    pub limits: &'a Limits,
    /// The plug-ins in use, for parts that are native objects themselves.
    pub plugins: &'a Plugins,
    /// Bytes that all objects of the message together may still unpack.
    unpack_left: &'a Cell<usize>,
}

impl<'a> Context<'a> {
    /// The context of a message of which `unpack_left` more bytes may be unpacked.
    pub(crate) fn new(
        limits: &'a Limits,
        plugins: &'a Plugins,
        unpack_left: &'a Cell<usize>,
    ) -> Self {
        Self { limits, plugins, unpack_left }
    }

    /// Books memory for what a part becomes larger than it was sent, before it is allocated: files
    /// inflated, pictures decoded, rows repeated. All objects of a message share one allowance of
    /// `limits.message_bytes`, so that a thousand small bombs cost no more than one.
    ///
    /// # Errors
    /// When the allowance is used up. `what` names the thing.
    pub fn unpack(&self, what: &str, bytes: usize) -> Result<(), PluginError> {
        match self.unpack_left.get().checked_sub(bytes) {
            Some(left) => {
                self.unpack_left.set(left);
                Ok(())
            }
            None => Err(PluginError::TooLarge {
                what: format!("{what}, with what the message unpacked before,"),
                actual: (self.limits.message_bytes - self.unpack_left.get()) as u64 + bytes as u64,
                limit: self.limits.message_bytes as u64,
            }),
        }
    }
}
