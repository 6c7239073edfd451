//! Bytes to values and back: no sockets, no clocks, no threads.
//!
//! ```text
//!   ZeroMQ frames ─▶ frames ─▶ Payload ─▶ ros ─▶ CDR
//!                      │          ▲
//!        json, npy, jpeg ────────┘          every arrow also runs the other way
//! ```
//!
//! | module | reads and writes | specified in |
//! | --- | --- | --- |
//! | [`json`] | Wrapyfi's native objects | docs/wire/native-object.md |
//! | [`npy`] | NumPy's array file | docs/wire/native-object.md |
//! | [`frames`] | Wrapyfi's ZeroMQ messages | docs/wire/zeromq.md |
//! | [`requests`] | requests and replies on ZeroMQ | docs/wire/zeromq-requests.md |
//! | [`ros`] | the ROS messages of the data model | docs/wire/ros2.md |
//! | [`ros1`] | the ROS 1 messages of the data model | docs/ros1.md |
//! | [`jpeg`] | JPEG files | |
//! | [`image_file`] | image files of other formats | |
//! | [`pickle`] | pickles of plug-in objects, as data | docs/wire/pickle.md |

pub(crate) mod archive;
mod convert;
mod error;
pub mod frames;
pub mod image_file;
pub mod jpeg;
mod jpeg_header;
pub mod json;
pub mod npy;
mod path;
pub mod pickle;
mod picture;
pub mod requests;
pub mod ros;
pub mod ros1;
mod sound;

pub use convert::{ConvertError, convert_payload, is_convertible};
pub use error::{DecodeError, EncodeError};
pub use jpeg::convert;

pub(crate) use path::Path;
