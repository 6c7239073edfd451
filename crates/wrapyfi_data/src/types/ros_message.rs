//! A ROS message of any type, as bytes.
//!
//! ```text
//!   CDR of one middleware ──▶ RosMessage ──▶ CDR of another     nothing is looked into
//!                              │      ▲
//!                       fields ▼      │ from_fields
//!                         DynamicMessage  ◀──▶  Value (dict)    where a native object is wanted
//! ```

use bytes::Bytes;
use wrapyfi_interfaces::cdr::{CdrError, CdrParts, CdrReader};
use wrapyfi_interfaces::dynamic::{DynamicMessage, ValueError};

use super::ros_type::RosType;

/// A message of a type known while running: encapsulation header and CDR body, as DDS carries them.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{RosMessage, RosType, Value};
/// use wrapyfi_interfaces::store::TypeStore;
///
/// let header = RosType::new(&TypeStore::generated().resolve_name("std_msgs/msg/Header")?)?;
/// let mut fields = header.plan().default_message();
/// fields.set("frame_id", "map")?;
/// let message = RosMessage::from_fields(header, &fields)?;
///
/// let value = message.to_value(1 << 20)?;
/// assert_eq!(value.get("frame_id"), Some(&Value::from("map")));
/// assert_eq!(RosMessage::from_value(header, &value, 1 << 20)?, message);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct RosMessage {
    /// Type of the message.
    pub ros_type: RosType,
    /// Encapsulation header (4 bytes) and body.
    pub cdr: Bytes,
}

impl RosMessage {
    /// Makes a message of its bytes, which are not checked until [`RosMessage::fields`].
    pub fn new(ros_type: RosType, cdr: impl Into<Bytes>) -> Self {
        Self { ros_type, cdr: cdr.into() }
    }

    /// Checks the size, the encapsulation, and that the smallest message of the type would fit,
    /// which costs nothing. The fields are checked when they are read.
    ///
    /// # Errors
    /// When the bytes cannot be a message of the type, or are more than `max_bytes`.
    pub fn check(&self, max_bytes: usize) -> Result<(), CdrError> {
        let available = CdrReader::within(&self.cdr, max_bytes)?.remaining();
        let needed = self.ros_type.plan().min_size();
        if available < needed {
            let path = self.ros_type.name().to_owned();
            return Err(CdrError::Truncated { path, needed, available });
        }
        Ok(())
    }

    /// Fields of the message by name.
    ///
    /// # Errors
    /// When the bytes are no message of the type, or more than `max_bytes`.
    pub fn fields(&self, max_bytes: usize) -> Result<DynamicMessage, CdrError> {
        self.ros_type.plan().decode(&self.cdr, max_bytes)
    }

    /// Makes a message of its fields.
    ///
    /// # Errors
    /// When the fields are those of another type.
    pub fn from_fields(ros_type: RosType, fields: &DynamicMessage) -> Result<Self, ValueError> {
        let cdr: CdrParts = ros_type.plan().encode(fields)?;
        Ok(Self { ros_type, cdr: cdr.to_bytes() })
    }
}
