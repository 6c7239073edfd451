//! Going on after a failure.
//!
//! * [`backoff`]: waits between tries.
//! * [`thread`]: threads that begin again where they panic.
//! * [`Mutex`]: a lock that outlives a panic.
//! * `restart`, with feature `tokio`: tasks that do.

pub mod backoff;
mod lock;
#[cfg(feature = "tokio")]
pub mod restart;
pub mod thread;

pub use backoff::Backoff;
pub use lock::Mutex;
pub use thread::contained;
