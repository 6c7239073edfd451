//! Going on after a failure.
//!
//! * [`backoff`]: waits between tries.
//! * [`thread`]: threads that begin again where they panic.
//! * [`Mutex`]: a lock that outlives a panic.
//! * `restart`, with feature `tokio`: tasks that do.
//! * `liveness`, with feature `liveness`: peers of TCP connections that are gone without a word.

pub mod backoff;
#[cfg(feature = "liveness")]
pub mod liveness;
mod lock;
#[cfg(feature = "tokio")]
mod newest;
#[cfg(feature = "tokio")]
pub mod restart;
pub mod thread;

pub use backoff::Backoff;
pub use lock::Mutex;
#[cfg(feature = "tokio")]
pub use newest::NewestTasks;
pub use thread::contained;
