//! Errors of decoding and encoding, shared by every codec.

/// Error of decoding received bytes.
///
/// `path` is the place of the fault inside the object, for instance `$.frames[3]`; `$` is the
/// whole.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::{DecodeError, Limits, codec, plugin}; }
/// use wrapyfi_core::{DecodeError, Limits};
/// use wrapyfi_core::codec::json;
/// use wrapyfi_core::plugin::Plugins;
/// let error = json::decode(&"[1, 2, maybe]".into(), &Limits::default(), &Plugins::none()).unwrap_err();
/// assert!(matches!(&error, DecodeError::Malformed { format: "JSON", path, .. } if path == "$[2]"), "{error}");
/// let error = DecodeError::too_large(200, 100);
/// assert_eq!(error.to_string(), "message at $ is 200, the limit is 100 (raise max_message_mib)");
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DecodeError {
    /// The bytes do not follow the format.
    #[error("malformed {format} at {path}: {reason}")]
    Malformed {
        /// Format being read: `JSON`, `npy`, `JPEG`, `CDR`, …
        format: &'static str,
        /// Place in the message, from `$`.
        path: String,
        /// Fault, with its numbers.
        reason: String,
    },
    /// A size exceeds its limit; nothing was allocated for it.
    #[error("{what} at {path} is {actual}, the limit is {limit}{}", remedy(.what))]
    TooLarge {
        /// Name of the thing that is too large: `message`, `nesting`, …
        what: &'static str,
        /// Place in the message, from `$`.
        path: String,
        /// Size found.
        actual: u64,
        /// Largest allowed.
        limit: u64,
    },
    /// A valid message, but not of the kind this endpoint carries.
    #[error("expected {expected}, received {actual}")]
    Mismatch {
        /// Kind that the endpoint carries.
        expected: String,
        /// Kind that arrived.
        actual: String,
    },
}

impl DecodeError {
    /// Fault of the whole: the bytes do not follow `format`.
    pub fn malformed(format: &'static str, reason: impl Into<String>) -> Self {
        Self::Malformed { format, path: "$".to_owned(), reason: reason.into() }
    }

    /// Another kind than the one this endpoint carries.
    pub fn mismatch(expected: impl Into<String>, actual: impl Into<String>) -> Self {
        Self::Mismatch { expected: expected.into(), actual: actual.into() }
    }

    /// A message of more bytes than a message may have.
    pub fn too_large(actual: usize, limit: usize) -> Self {
        Self::over("message", "$".to_owned(), actual, limit)
    }

    /// A size over its limit, at a place in the message.
    pub(super) fn over(what: &'static str, path: String, actual: usize, limit: usize) -> Self {
        let (actual, limit) = (actual as u64, limit as u64);
        Self::TooLarge { what, path, actual, limit }
    }

    /// Compares the size of a message with its limit, both in bytes.
    ///
    /// # Errors
    /// When it is over the limit.
    pub fn check_size(actual: usize, limit: usize) -> DecodeResult<()> {
        if actual > limit { Err(Self::too_large(actual, limit)) } else { Ok(()) }
    }

    /// Compares the bytes that a picture needs with the limit of a message.
    #[cfg(any(feature = "jpeg", feature = "pictures"))]
    pub(super) fn check_pixels(
        name: &str,
        width: u32,
        height: u32,
        actual: u64,
        limits: &crate::Limits,
    ) -> DecodeResult<()> {
        let limit = limits.message_bytes as u64;
        if actual <= limit {
            return Ok(());
        }
        let path = format!("{name} of {width}x{height}");
        Err(Self::TooLarge { what: "message", path, actual, limit })
    }
}

/// Result of decoding.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use wrapyfi_data::{Limits, plugin, types};
/// #     pub mod codec { pub use wrapyfi_data::{DecodeResult, codec::json}; }
/// # }
/// use wrapyfi_core::Limits;
/// use wrapyfi_core::codec::{DecodeResult, json};
/// use wrapyfi_core::plugin::Plugins;
/// use wrapyfi_core::types::Value;
/// fn speed(text: &str) -> DecodeResult<Option<f64>> {
///     let value = json::decode(&text.to_owned().into(), &Limits::default(), &Plugins::none())?;
///     Ok(value.get("speed").and_then(Value::as_f64))
/// }
/// assert_eq!(speed(r#"{"speed": 1.5}"#), Ok(Some(1.5)));
/// ```
pub type DecodeResult<T> = Result<T, DecodeError>;

fn remedy(what: &str) -> &'static str {
    if matches!(what, "message" | "memory of the values") { " (raise max_message_mib)" } else { "" }
}

/// Error of encoding a payload.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::{EncodeError, codec, plugin, types}; }
/// use wrapyfi_core::EncodeError;
/// use wrapyfi_core::codec::json;
/// use wrapyfi_core::plugin::Plugins;
/// use wrapyfi_core::types::Value;
/// let error = json::encode(&vec![Value::Bytes("raw".into())].into(), &Plugins::none()).unwrap_err();
/// assert!(matches!(&error, EncodeError::Unrepresentable { path, .. } if path == "$[0]"));
/// assert!(error.to_string().starts_with("JSON cannot hold 3 raw bytes at $[0]; "));
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// The format has no way to write this.
    #[error("{format} cannot hold {what} at {path}; {remedy}")]
    Unrepresentable {
        /// Format being written.
        format: &'static str,
        /// Thing that cannot be written.
        what: String,
        /// Place in the value, from `$`.
        path: String,
        /// Remedy.
        remedy: String,
    },
    /// The payload is not of the kind this endpoint carries.
    #[error("expected {expected}, was given {actual}")]
    Mismatch {
        /// Kind that the endpoint carries.
        expected: String,
        /// Kind that was given.
        actual: String,
    },
    /// The encoded message would exceed its limit.
    #[error("message would be {actual} bytes, the limit is {limit} (raise max_message_mib)")]
    TooLarge {
        /// Encoded size in bytes.
        actual: u64,
        /// Largest allowed.
        limit: u64,
    },
}

impl EncodeError {
    /// A whole that `format` has no way to write.
    pub fn unrepresentable(
        format: &'static str,
        what: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        let (what, remedy) = (what.into(), remedy.into());
        Self::Unrepresentable { format, what, path: "$".to_owned(), remedy }
    }

    /// Another kind than the one this endpoint carries.
    pub fn mismatch(expected: impl Into<String>, actual: impl Into<String>) -> Self {
        Self::Mismatch { expected: expected.into(), actual: actual.into() }
    }

    /// A message of more bytes than a message may have.
    pub fn too_large(actual: usize, limit: usize) -> Self {
        Self::TooLarge { actual: actual as u64, limit: limit as u64 }
    }

    /// Compares the size of a message with its limit, both in bytes.
    ///
    /// # Errors
    /// When it is over the limit.
    pub fn check_size(actual: usize, limit: usize) -> EncodeResult<()> {
        if actual > limit { Err(Self::too_large(actual, limit)) } else { Ok(()) }
    }
}

/// Result of encoding.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use wrapyfi_data::{EncodeError, plugin, types};
/// #     pub mod codec { pub use wrapyfi_data::{EncodeResult, codec::json}; }
/// # }
/// use wrapyfi_core::EncodeError;
/// use wrapyfi_core::codec::{EncodeResult, json};
/// use wrapyfi_core::plugin::Plugins;
/// use wrapyfi_core::types::Value;
/// fn small(value: &Value) -> EncodeResult<Vec<u8>> {
///     let text = json::encode(value, &Plugins::none())?;
///     EncodeError::check_size(text.len(), 8)?;
///     Ok(text)
/// }
/// assert_eq!(small(&Value::from(1.5)), Ok(b"1.5".to_vec()));
/// assert!(small(&Value::from("a long text")).is_err());
/// ```
pub type EncodeResult<T> = Result<T, EncodeError>;
