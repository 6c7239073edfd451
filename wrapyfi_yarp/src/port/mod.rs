//! Ports over tokio.

mod counters;
mod io;
pub mod names;
pub mod session;

pub use counters::Counters;
