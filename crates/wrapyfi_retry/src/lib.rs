//! Going on after a failure.
//!
//! * [`backoff`]: waits between tries.
//! * [`thread`]: threads that begin again where they panic.
//! * `restart`, with feature `tokio`: tasks that do.

pub mod backoff;
#[cfg(feature = "tokio")]
pub mod restart;
pub mod thread;

pub use backoff::Backoff;
pub use thread::contained;
