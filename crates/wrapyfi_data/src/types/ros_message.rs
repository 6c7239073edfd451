//! A ROS message of any type, as bytes.
//!
//! ```text
//!   CDR of one middleware ──▶ RosMessage ──▶ CDR of another     nothing is looked into
//!              struct ── of ──▶│      ▲ │─── read ──▶ struct    large `uint8[]` fields are shared
//!                       fields ▼      │ from_fields
//!                         DynamicMessage  ◀──▶  Value (dict)    where a native object is wanted
//! ```

use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::cdr::{CdrError, CdrParts, CdrReader};
use wrapyfi_interfaces::dynamic::{DynamicMessage, ValueError};

use super::ros_type::{RosType, RosTypeError};

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
    /// Encapsulation header (4 bytes) and body; in pieces where the message was made of fields.
    pub cdr: CdrParts,
}

/// Error of reading a message as a generated type.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The message is of another type, or of another definition of it.
    #[error("a message of {actual} where one of {expected} should be")]
    Type {
        /// Name and hash of the type that was asked for.
        expected: String,
        /// Name and hash of the type of the message.
        actual: String,
    },
    /// The bytes are no message of the type.
    #[error(transparent)]
    Cdr(#[from] CdrError),
}

impl RosMessage {
    /// Makes a message of a struct that was generated from its definition. Large `uint8[]` fields are shared with it.
    ///
    /// ```
    /// # mod wrapyfi_core { pub use wrapyfi_data::types; }
    /// use wrapyfi_core::types::RosMessage;
    /// use wrapyfi_interfaces::geometry_msgs::msg::Vector3;
    /// let up = Vector3 { z: 1.0, ..Vector3::default() };
    /// let message = RosMessage::of(&up)?;
    /// assert_eq!(message.read::<Vector3>()?, up);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// As [`RosType::of`].
    pub fn of<M: Message>(message: &M) -> Result<Self, RosTypeError> {
        Ok(Self::new(RosType::of::<M>()?, message.encode()))
    }

    /// The message as a struct that was generated from its definition. Middlewares have checked its size.
    ///
    /// # Errors
    /// When it is of another type, or no message of it.
    pub fn read<M: Message>(&self) -> Result<M, ReadError> {
        let (name, hash) = (self.ros_type.name(), self.ros_type.type_hash());
        if hash != M::TYPE_HASH {
            return Err(ReadError::Type {
                expected: format!("{} ({})", M::ROS_TYPE, M::TYPE_HASH),
                actual: format!("{name} ({hash})"),
            });
        }
        Ok(M::decode(&self.cdr, self.cdr.len())?)
    }

    /// Makes a message of its bytes, which are not checked until [`RosMessage::fields`].
    pub fn new(ros_type: RosType, cdr: impl Into<CdrParts>) -> Self {
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
        Ok(Self { ros_type, cdr: ros_type.plan().encode(fields)? })
    }
}
