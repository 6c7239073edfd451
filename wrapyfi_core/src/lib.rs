//! Wrapyfi in Rust: native objects, arrays, images and sound between ZeroMQ and ROS 2.
//!
//! # Layout
//!
//! ```text
//!   engine        routes: discover -> reconcile -> propagate, counters, reasons
//!     │
//!   endpoint      Publisher, Listener, Middleware, Registry: the seam
//!     │
//!   middleware    zeromq, ros2, memory: one module each, the rest never names one
//!     │
//!   codec         bytes <-> values, no sockets, no clocks
//!     │
//!   types         Value, Tensor, Image, AudioChunk
//! ```
//!
//! * [`types`]: the data model.
//! * [`codec`]: Wrapyfi's JSON and frames, `.npy`, JPEG, CDR of the ROS messages.
//! * [`endpoint`]: the traits every middleware implements, bounded queues, counters.
//! * [`middleware`]: the transports.
//! * [`engine`]: configuration, routes and the loop that moves messages.
//! * [`node`]: what makes a process a ROS 2 node: names, `--ros-args`.

pub mod codec;
pub mod endpoint;
pub mod engine;
mod limits;
pub mod middleware;
pub mod node;
pub mod types;

pub use codec::{DecodeError, EncodeError};
pub use limits::Limits;
