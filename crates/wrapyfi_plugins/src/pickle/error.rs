//! Errors of reading and understanding pickles.

/// Error of reading a pickle. Every variant names the place: a byte of the pickle, as
/// `pickletools.dis` counts them, or the path of an object inside it.
///
/// ```
/// use wrapyfi_data::Limits;
/// use wrapyfi_plugins::pickle::{self, Allowed, PickleError};
/// // Pickle of an object whose __reduce__ returns (os.system, ("id",))
/// let data = b"cos\nsystem\n(Vid\ntR.".to_vec().into();
/// let error = pickle::read(&data, &[], &Allowed::NUMPY, &Limits::default()).unwrap_err();
/// assert!(matches!(&error, PickleError::Refused { global, .. } if global == "os.system"));
/// assert!(error.to_string().contains("os.system, which is not on the list"));
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PickleError {
    /// A function or class that is not on the list: nothing was imported, nothing was called.
    #[error("the pickle names {global}, which is not on the list of data constructors (byte {at})")]
    Refused {
        /// `module.name` as the pickle has it, shortened where it is long.
        global: String,
        /// Byte of the opcode.
        at: usize,
    },
    /// An instruction that could do more than build data, or none of Python's.
    #[error("{opcode} at byte {at}: {reason}")]
    Opcode {
        /// Name of the opcode in Python's `pickletools`, or its code.
        opcode: String,
        /// Byte of the opcode.
        at: usize,
        /// Reason that the opcode is refused.
        reason: String,
    },
    /// The pickle ends early, or claims a length that is not there.
    #[error("the pickle ends early: {what} at byte {at} needs {needed} bytes, {left} are left")]
    Truncated {
        /// Name of the part being read.
        what: &'static str,
        /// Byte where it begins.
        at: usize,
        /// Bytes it claims.
        needed: u64,
        /// Bytes that are there.
        left: usize,
    },
    /// A size exceeds its limit; nothing was allocated for it.
    #[error("{what} at byte {at} is {actual}, the limit is {limit}{}", remedy(.what))]
    TooLarge {
        /// Name of the thing that is too large: `memory of the pickle`, `memo index`, …
        what: &'static str,
        /// Byte of the opcode.
        at: usize,
        /// Size found.
        actual: u64,
        /// Largest allowed.
        limit: u64,
    },
    /// A buffer that should travel beside the pickle is missing.
    #[error("the pickle uses out-of-band buffer number {wanted}, {count} came with it (byte {at})")]
    Buffer {
        /// Number of the buffer that the pickle uses.
        wanted: usize,
        /// Number of buffers that came.
        count: usize,
        /// Byte of the opcode.
        at: usize,
    },
    /// The object is not what its place asks for.
    #[error("{path} should be {expected}, it is {actual} (byte {at})")]
    Unexpected {
        /// Place in the object: `$._mgr.args[0]`.
        path: String,
        /// Kind of object that belongs there.
        expected: String,
        /// Kind of object that is there.
        actual: String,
        /// Byte of the opcode that made it.
        at: usize,
    },
    /// The object is of the right kind, but its parts make no value.
    #[error("the {what} at {path} cannot be read: {reason} (byte {at})")]
    Invalid {
        /// Kind of value that the object should be.
        what: &'static str,
        /// Place in the object.
        path: String,
        /// Fault, with its numbers.
        reason: String,
        /// Byte of the opcode that made it.
        at: usize,
    },
}

fn remedy(what: &str) -> &'static str {
    match what {
        "pickle with its buffers" | "memory of the pickle" | "memory of the object" => {
            " (raise max_message_mib)"
        }
        _ => "",
    }
}

impl PickleError {
    /// Error for a size over its limit, found by the opcode at the byte `at`.
    pub(crate) fn too_large(what: &'static str, at: usize, actual: usize, limit: usize) -> Self {
        Self::TooLarge { what, at, actual: actual as u64, limit: limit as u64 }
    }
}
