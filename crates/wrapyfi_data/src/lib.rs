//! Wrapyfi's data: values, tensors, images and sound, and the bytes as which they travel. The crate
//! has no sockets, clocks or threads.
//!
//! ```text
//!   bytes ──▶ codec ──▶ types ──▶ codec ──▶ bytes
//!               │
//!            plugin    what stands behind Wrapyfi's plug-in keys
//!
//!   imports: plugin, returned ─▶ codec ─▶ plugin_api ─▶ types
//! ```
//!
//! * [`types`]: the data model.
//! * [`codec`]: Wrapyfi's JSON, `.npy`, JPEG, pickles, CDR of the ROS messages.
//! * [`plugin`]: pandas, torch, Pillow, … and objects of your own.
//! * [`returned`]: types that a registered method may return.
//!
//! A program names these through `wrapyfi_core`, which exports them under the same names.
//!
//! ```
//! # mod wrapyfi_core { pub use wrapyfi_data::{Limits, codec, types}; }
//! use wrapyfi_core::Limits;
//! use wrapyfi_core::codec::json;
//! use wrapyfi_core::types::Value;
//!
//! let text = br#"["a", true]"#.as_slice().into();
//! let value = json::decode(&text, &Limits::default())?;
//! assert_eq!(value, Value::List(vec![Value::Str("a".into()), Value::Bool(true)]));
//! # Ok::<(), wrapyfi_data::codec::DecodeError>(())
//! ```

mod base64;
pub mod codec;
mod json_text;
mod limits;
pub mod plugin;
mod plugin_api;
pub mod returned;
pub mod types;

pub use codec::{DecodeError, DecodeResult, EncodeError, EncodeResult};
pub use limits::Limits;
pub use wrapyfi_interfaces::did_you_mean;
