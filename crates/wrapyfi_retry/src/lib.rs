//! Going on after a failure.
//!
//! * [`backoff`]: waits between tries.
//! * `restart`, with feature `tokio`: tasks that begin again where they panic.

pub mod backoff;
#[cfg(feature = "tokio")]
pub mod restart;

pub use backoff::Backoff;
