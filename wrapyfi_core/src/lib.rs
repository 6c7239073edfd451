//! Wrapyfi in Rust: native objects, arrays, images and sound between ZeroMQ, YARP, ROS 1 and ROS 2.
//!
//! # Layout
//!
//! ```text
//!   engine        routes: discover -> reconcile -> propagate, counters, reasons
//!   communicator  methods that publish, listen, request or reply, by their mode
//!     │
//!   endpoint      Publisher, Listener, Middleware, Registry: the seam
//!     │
//!   middleware    zeromq, yarp, ros1, ros2, memory: one module each, the rest never names one
//!     │
//!   wrapyfi_data  codec: bytes <-> values; plugin: what stands behind Wrapyfi's plug-in keys;
//!                 types: Value, Tensor, Image, AudioChunk. No sockets, no clocks
//! ```
//!
//! * [`types`]: the data model.
//! * [`codec`]: Wrapyfi's JSON and frames, `.npy`, JPEG, CDR of the ROS messages.
//! * [`plugin`]: pandas, torch, Pillow, … and objects of your own.
//! * [`endpoint`]: the traits every middleware implements, bounded queues, counters.
//! * [`middleware`]: the transports.
//! * [`network`]: names of machines, and who may reach our sockets.
//! * `engine`, with the feature of that name: configuration, routes and the loop that moves messages.
//! * [`communicator`]: registered methods, Wrapyfi's programming model.
//! * [`start`]: one builder for each middleware. `stream`, with the feature of that name: listeners as streams.
//! * [`node`]: what makes a process a ROS 2 node: names, `--ros-args`.
//!
//! The way of one image through these modules, and the threads: ARCHITECTURE.md in the repository.
//!
//! # Example
//!
//! A listener of a Wrapyfi script, on the broker that `wrapyfi broker` or the script runs:
//!
//! ```no_run
//! use std::time::Duration;
//! use wrapyfi_core::endpoint::{Context, Middleware, TopicSpec};
//! use wrapyfi_core::middleware::zeromq::BrokerMode;
//! use wrapyfi_core::types::{MessageType, Payload};
//!
//! let zeromq =
//!     wrapyfi_core::zeromq().with(|settings| settings.broker = BrokerMode::Foreign).start()?;
//! let context = Context::default();
//! let mut listener =
//!     zeromq.open_listener(&TopicSpec::new("/camera", MessageType::Image), &context)?;
//! loop {
//!     match listener.take()? {
//!         Some(sample) => {
//!             if let Payload::Image(image) = sample.payload {
//!                 println!("{:?} at {:?}", image.pixels, image.stamp);
//!             }
//!         }
//!         None => _ = context.wake.wait(Duration::from_secs(1)),
//!     }
//! }
//! # #[allow(unreachable_code)]
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#[allow(unused_extern_crates, reason = "the macros name the crate as seen from outside")]
extern crate self as wrapyfi_core;

pub mod communicator;
pub mod middleware;
pub mod start;
#[cfg(feature = "stream")]
pub mod stream;

#[cfg(feature = "ros1")]
pub use start::ros1;
#[cfg(feature = "ros2")]
pub use start::ros2;
#[cfg(feature = "yarp")]
pub use start::yarp;
#[cfg(feature = "zeromq")]
pub use start::zeromq;

pub use codec::{DecodeError, EncodeError};
pub use wrapyfi_data::{Limits, plugin, types};
pub use wrapyfi_endpoint::{self as endpoint, Throttle, codec, network};
#[cfg(feature = "engine")]
pub use wrapyfi_engine as engine;
#[cfg(any(feature = "ros1", feature = "ros2"))]
pub use wrapyfi_node as node;
