//! Limits on sizes, which are checked before memory is allocated.

use std::time::Duration;

/// Limits on the memory that one message may take. The error of a check names its limit.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::Limits; }
/// use wrapyfi_core::Limits;
/// let limits = Limits { message_bytes: 256 * Limits::MIB, ..Limits::default() };
/// assert_eq!(limits.depth, 64);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Largest message in bytes, in any encoding (`max_message_mib`; default 64 MiB).
    pub message_bytes: usize,
    /// Deepest nesting of a value (default 64).
    pub depth: usize,
}

impl Limits {
    /// One mebibyte.
    pub const MIB: usize = 1 << 20;
    /// Number of bytes that may wait in one process, unless `limits: { waiting_mib }` says
    /// otherwise.
    pub const WAITING_BYTES: usize = 1024 * Self::MIB;
    /// Time in which a process ends after SIGINT or SIGTERM.
    pub const SHUTDOWN: Duration = Duration::from_secs(2);
}

impl Default for Limits {
    fn default() -> Self {
        Self { message_bytes: 64 * Self::MIB, depth: 64 }
    }
}
