//! The transports. Each module implements [`crate::endpoint::Middleware`]; nothing outside it
//! knows its types beyond its constructor.

/// The middleware inside one process, for tests and for programs that talk to themselves.
pub mod memory {
    #[doc(inline)]
    pub use wrapyfi_endpoint::memory::Memory;
}

/// ROS 1: topics, services and parameters of nodes that a `roscore` knows.
#[cfg(feature = "ros1")]
pub mod ros1 {
    #[doc(inline)]
    pub use wrapyfi_ros1::{Ros1, Ros1Config};
}

/// ROS 2: topics, services and parameters on CycloneDDS, or on the middleware of the ROS 2 that is sourced.
#[cfg(feature = "ros2")]
pub mod ros2 {
    #[doc(inline)]
    pub use wrapyfi_ros2::{
        Adapter, CycloneConfig, ParameterClient, ParameterClientError, ParameterResult, Ros2,
        ServiceOptions, environment::DiscoveryRange, graph::ServiceMapping,
    };
}

/// YARP: ports of robots, and the name server that knows them.
#[cfg(feature = "yarp")]
pub mod yarp {
    #[doc(inline)]
    pub use wrapyfi_yarp_endpoint::{Dialect, Yarp, YarpConfig};
}

/// ZeroMQ: Wrapyfi's publishers and listeners, clients and servers, and the broker between them.
#[cfg(feature = "zeromq")]
pub mod zeromq {
    #[doc(inline)]
    pub use wrapyfi_zeromq::{BrokerMode, CurveClient, CurveConfig, ZeroMq, ZeroMqConfig};
}
