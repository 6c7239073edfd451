//! YARP in Rust: the wire protocol of YARP 3 and 4, without YARP's C++ libraries.
//!
//! ```text
//!   bytes on a connection ──wire──▶ messages ──▶ payload ──bottle──▶ Bottle: numbers, words, lists
//!                                                   └─────sig─────▶ Image, Sound, Vector, Matrix
//! ```
//!
//! * [`bottle`]: YARP's self-describing lists, as bytes and as text.
//! * [`sig`]: images, sounds, vectors and time stamps; the same bytes read as a bottle, too.
//! * [`dialect`]: YARP 4 moved the codes of floats; nothing on the wire says which one is spoken.
//! * [`port`] and [`wire`]: ports of every carrier over tokio, and their bytes without sockets.
//! * [`name`] and [`server`]: name servers, seen from those who ask them, and one to embed.
//! * [`limits`]: what is refused, so that no peer can make this process run out of memory.
//!
//! Codecs and [`wire`] take bytes and give values: no sockets, no threads, no clock.
//!
//! ```
//! use bytes::Bytes;
//! use wrapyfi_yarp::{Bottle, Dialect, WireLimits};
//!
//! let bottle = Bottle::from_text(b"[set] pos 2 (fast true)", &WireLimits::default())?;
//! let bytes = Bytes::from(bottle.encode(Dialect::V3)?);
//! let (again, _) = Bottle::decode(&bytes, Dialect::V3, &WireLimits::default())?;
//! assert_eq!(again.find("pos").and_then(|value| value.as_i64()), Some(2));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod bottle;
pub mod dialect;
pub mod limits;
pub mod name;
pub mod port;
pub mod server;
pub mod sig;
pub mod task;
pub mod wire;

pub use bottle::{Bottle, Value};
pub use dialect::Dialect;
pub use limits::WireLimits;
