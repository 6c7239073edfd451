//! Bytes to values and back: no sockets, no clocks, no threads.
//!
//! | module | reads and writes | specified in |
//! | --- | --- | --- |
//! | `json` | Wrapyfi's native objects | docs/wire/native-object.md |
//! | `npy` | NumPy's array file | docs/wire/native-object.md |
//! | `frames` | Wrapyfi's ZeroMQ messages | docs/wire/zeromq.md |
//! | `ros` | the ROS messages of the data model | docs/wire/ros2.md |
//! | `jpeg` | JPEG files | |

mod error;

pub use error::{DecodeError, EncodeError};
