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
//! | [`json`] | Wrapyfi's native objects | docs/reference/wire/native-object.md |
//! | [`npy`] | NumPy's array file | docs/reference/wire/native-object.md |
//! | [`ros`] | the ROS messages of the data model | docs/reference/wire/ros2.md |
//! | [`ros1`] | the ROS 1 messages of the data model | docs/reference/ros1.md |
//! | [`jpeg`] | JPEG files, with feature `jpeg` | |
//! | `image_file` | with feature `pictures`, image files of other formats | |

pub mod convert;
mod error;
mod fields;
#[cfg(feature = "pictures")]
pub mod image_file;
pub mod jpeg;
#[cfg(not(feature = "jpeg"))]
mod jpeg_absent;
#[cfg(feature = "jpeg")]
mod jpeg_file;
#[cfg(feature = "jpeg")]
mod jpeg_header;
pub mod json;
pub mod npy;
mod path;
pub mod picture;
pub mod ros;
pub mod ros1;
pub mod sound;

pub use convert::{Conversion, ConvertError, is_convertible, message_of, properties_to_set};
pub use error::{DecodeError, DecodeResult, EncodeError, EncodeResult};
pub use fields::Fields;
pub use jpeg::{check_form, convert};
pub use path::{SHOWN, quote};

pub(crate) use path::Path;
