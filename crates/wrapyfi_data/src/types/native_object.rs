//! A Python object with the header of its message.

use std::ops::{Deref, DerefMut};

use super::{Stamp, Value};

/// A Python object with the time and the coordinate frame of its message. It can be read as its
/// [`Value`].
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{Map, NativeObject, Stamp, Value};
/// let value = Map::from([("speed", 1.5)]).into();
/// let object = NativeObject { stamp: Stamp::now(), frame_id: "base_link".into(), value };
/// assert_eq!(object.get("speed").and_then(Value::as_f64), Some(1.5));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct NativeObject {
    /// Time at which the object was made; zero where the sender does not say.
    pub stamp: Stamp,
    /// Coordinate frame; empty where the sender names none.
    pub frame_id: String,
    /// The object.
    pub value: Value,
}

impl From<Value> for NativeObject {
    fn from(value: Value) -> Self {
        Self { stamp: Stamp::default(), frame_id: String::new(), value }
    }
}

impl Deref for NativeObject {
    type Target = Value;

    fn deref(&self) -> &Value {
        &self.value
    }
}

impl DerefMut for NativeObject {
    fn deref_mut(&mut self) -> &mut Value {
        &mut self.value
    }
}
