//! The middlewares of this crate, as its features bring them: the only list of them.

use std::sync::Arc;

use wrapyfi_endpoint::method::Source;

/// Name of the middleware of values that name none.
pub(super) const DEFAULT: &str = "zeromq";

/// Sources of every middleware that this crate was built with.
pub(super) fn sources() -> Vec<Arc<dyn Source>> {
    vec![
        #[cfg(feature = "zeromq")]
        wrapyfi_zeromq::source(),
        #[cfg(feature = "ros1")]
        wrapyfi_ros1::source(),
        #[cfg(feature = "ros2")]
        wrapyfi_ros2::source(wrapyfi_node::args::RosArgs::default()),
        #[cfg(feature = "yarp")]
        wrapyfi_yarp_endpoint::source(),
    ]
}

/// Names of middlewares that Wrapyfi knows. One that is not built in is absent, and no mistake.
pub(super) const KNOWN: [&str; 7] = ["zeromq", "yarp", "ros", "ros2", "websocket", "zenoh", "mqtt"];

/// Feature of this crate that brings the middleware `name`, where the build lacks it.
pub(super) fn missing_feature(name: &str) -> Option<&'static str> {
    match name {
        "ros" if !cfg!(feature = "ros1") => Some("ros1"),
        "ros2" if !cfg!(feature = "ros2") => Some("ros2"),
        "yarp" if !cfg!(feature = "yarp") => Some("yarp"),
        "zeromq" if !cfg!(feature = "zeromq") => Some("zeromq"),
        _ => None,
    }
}
