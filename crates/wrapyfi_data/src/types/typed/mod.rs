//! Rust types as native objects and back, through serde.
//!
//! ```text
//!   T: Serialize ──▶ to_value ──▶ Value ──▶ from_value ──▶ T: DeserializeOwned
//!
//!   struct, map      dict           tuple, tuple struct   tuple
//!   Vec, slice, set  list           unit variant          its name
//!   Option           None or value  other variants        {name: content}
//!   Tensor, Value, DateTime, …      themselves, arrays shared and not copied
//! ```
//!
//! Reading is as generous as Python is: a list or a tuple for either, an array for nested vectors,
//! NumPy's 0-d arrays for numbers, keys such as `"1"` for numbers, because JSON has no others.

mod de;
mod de_access;
mod error;
mod exact;
mod foreign;
mod ser;
mod ser_compound;

use serde::Serialize;
use serde::de::DeserializeOwned;

pub use error::TypedError;
#[cfg(feature = "ndarray")]
pub use foreign::as_tensor;
pub use ser::MAX_DEPTH;

use super::Value;

/// A Rust value as a native object.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use serde::{Deserialize, Serialize};
/// use wrapyfi_core::types::{Tensor, Value, from_value, to_value};
///
/// #[derive(Debug, PartialEq, Serialize, Deserialize)]
/// struct Detection {
///     label: String,
///     corners: (i32, i32, i32, i32),
///     embedding: Tensor,
/// }
///
/// let seen = Detection {
///     label: "cup".into(),
///     corners: (10, 20, 30, 40),
///     embedding: Tensor::from_elements(&[3], vec![0.1_f32, 0.2, 0.7])?,
/// };
/// let value = to_value(&seen)?;
/// assert!(matches!(value.get("corners"), Some(Value::Tuple(_))));
/// assert!(value.get("embedding").unwrap().as_tensor().is_some());
/// assert_eq!(from_value::<Detection>(value)?, seen);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// When `T`'s own `Serialize` fails, or it nests deeper than [`MAX_DEPTH`].
pub fn to_value<T: Serialize + ?Sized>(value: &T) -> Result<Value, TypedError> {
    value.serialize(ser::ToValue { depth: 0 })
}

/// A native object as a Rust value.
///
/// # Errors
/// When `value` is not what `T` asks for; the message says where.
pub fn from_value<T: DeserializeOwned>(value: Value) -> Result<T, TypedError> {
    T::deserialize(de::FromValue { value, key: false })
}

#[cfg(test)]
mod tests;
