//! Wrapyfi's data: values, tensors, images and sound, and the bytes as which they travel. The crate
//! has no sockets, clocks or threads.
//!
//! ```text
//!   bytes ──▶ codec ──▶ types ──▶ codec ──▶ bytes
//!               │
//!            plugin    the trait of what stands behind Wrapyfi's plug-in keys
//!
//!   imports: returned ─▶ codec ─▶ plugin ─▶ types
//! ```
//!
//! * [`types`]: the data model.
//! * [`codec`]: Wrapyfi's JSON, `.npy`, JPEG, CDR of the ROS messages.
//! * [`plugin`]: the trait of plug-ins, by which codecs know them; those of pandas, torch, Pillow, … are in `wrapyfi_plugins`.
//! * [`returned`]: types that a registered method may return.
//!
//! A program names these through `wrapyfi_core`, which exports them under the same names.
//!
//! ```
//! # mod wrapyfi_core { pub use wrapyfi_data::{Limits, codec, plugin, types}; }
//! use wrapyfi_core::Limits;
//! use wrapyfi_core::codec::json;
//! use wrapyfi_core::plugin::Plugins;
//! use wrapyfi_core::types::Value;
//!
//! let text = br#"["a", true]"#.as_slice().into();
//! let value = json::decode(&text, &Limits::default(), &Plugins::none())?;
//! assert_eq!(value, Value::List(vec![Value::Str("a".into()), Value::Bool(true)]));
//! # Ok::<(), wrapyfi_data::codec::DecodeError>(())
//! ```

mod base64;
pub mod codec;
mod json_text;
mod limits;
pub mod plugin;
pub mod returned;
pub mod types;

pub use codec::{DecodeError, DecodeResult, EncodeError, EncodeResult};
pub use limits::Limits;
pub use wrapyfi_interfaces::did_you_mean;
