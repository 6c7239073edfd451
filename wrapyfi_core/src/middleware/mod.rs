//! The transports. Each module implements [`crate::endpoint::Middleware`]; nothing outside it
//! knows its types beyond its constructor.

pub use wrapyfi_endpoint::memory;
#[cfg(feature = "ros1")]
pub use wrapyfi_ros1 as ros1;
#[cfg(feature = "ros2")]
pub use wrapyfi_ros2 as ros2;
#[cfg(feature = "yarp")]
pub use wrapyfi_yarp_endpoint as yarp;
#[cfg(feature = "zeromq")]
pub use wrapyfi_zeromq as zeromq;
