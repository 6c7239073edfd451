//! Sizes that are checked before anything is allocated.

use std::time::Duration;

/// Bounds on what one message may cost. Every check names the limit it applied.
///
/// ```
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
    /// Bytes that may wait in one process, unless it is told otherwise (`limits: { waiting_mib }`).
    pub const WAITING_BYTES: usize = 1024 * Self::MIB;
    /// First wait before a lost peer or a failed opening is tried again.
    pub const RECONNECT_MIN: Duration = Duration::from_millis(100);
    /// Longest wait between two tries.
    pub const RECONNECT_MAX: Duration = Duration::from_secs(5);
    /// Time in which a process ends after SIGINT or SIGTERM.
    pub const SHUTDOWN: Duration = Duration::from_secs(2);
}

impl Default for Limits {
    fn default() -> Self {
        Self { message_bytes: 64 * Self::MIB, depth: 64 }
    }
}
