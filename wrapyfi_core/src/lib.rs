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
//!   codec         bytes <-> values, no sockets, no clocks
//!     │
//!   plugin        what stands behind Wrapyfi's plug-in keys
//!     │
//!   types         Value, Tensor, Image, AudioChunk
//! ```
//!
//! * [`types`]: the data model.
//! * [`codec`]: Wrapyfi's JSON and frames, `.npy`, JPEG, CDR of the ROS messages.
//! * [`plugin`]: pandas, torch, Pillow, … and objects of your own.
//! * [`endpoint`]: the traits every middleware implements, bounded queues, counters.
//! * [`middleware`]: the transports.
//! * [`network`]: names of machines, and who may reach our sockets.
//! * [`engine`]: configuration, routes and the loop that moves messages.
//! * [`communicator`]: registered methods, Wrapyfi's programming model.
//! * [`node`]: what makes a process a ROS 2 node: names, `--ros-args`.
//!
//! # The way of one image, from Wrapyfi's socket to DDS
//!
//! ```text
//!   middleware::zeromq   I/O thread   SUB socket -> frames, shared as Bytes; topic and size checked
//!   endpoint::inbox                   bounded queue; full: drop oldest, drop newest or block
//!   engine::Relay        a worker     take(): rate limit; nobody listens: not even decoded
//!   codec::frames, json, npy          base64 decoded once, straight into the pixels   (copy 1)
//!   types::Image                      stamp, encoding, Bytes
//!   codec::ros                        CDR in two pieces: fields, and the pixels as they are
//!   middleware::ros2     a worker     pieces -> serdata -> DDS writer                  (copy 2)
//! ```
//!
//! The way back is the same upside down: the DDS buffer is lent, not copied, until base64 writes the
//! pixels into the ZeroMQ frame.
//!
//! # Example
//!
//! A listener of a Wrapyfi script, on the broker that `wrapyfi broker` or the script runs:
//!
//! ```no_run
//! use std::time::Duration;
//! use wrapyfi_core::endpoint::{Context, Middleware, TopicSpec};
//! use wrapyfi_core::middleware::zeromq::{BrokerMode, ZeroMq, ZeroMqConfig};
//! use wrapyfi_core::types::{MessageType, Payload};
//!
//! let config = ZeroMqConfig { broker: BrokerMode::Foreign, ..ZeroMqConfig::from_env()? };
//! let zeromq = ZeroMq::start(&config)?;
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

mod backoff;
pub mod codec;
pub mod communicator;
pub mod endpoint;
pub mod engine;
mod limits;
pub mod middleware;
pub mod network;
pub mod node;
pub mod plugin;
mod throttle;
pub mod types;

pub use codec::{DecodeError, EncodeError};
pub use limits::Limits;
pub use throttle::Throttle;
