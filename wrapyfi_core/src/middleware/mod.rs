//! The transports. Each module implements [`crate::endpoint::Middleware`]; nothing outside it
//! knows its types beyond its constructor.

pub mod memory;
#[cfg(feature = "ros1")]
pub mod ros1;
#[cfg(feature = "ros2")]
pub mod ros2;
#[cfg(feature = "yarp")]
pub mod yarp;
#[cfg(feature = "zeromq")]
pub mod zeromq;
