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
    /// Middleware `ros`, which [`crate::ros1`] starts:
    ///
    /// ```
    /// use wrapyfi_core::endpoint::{Context, Middleware, TopicSpec};
    /// use wrapyfi_core::types::MessageType;
    /// // A master that is not there yet is waited for.
    /// let ros1 = wrapyfi_core::ros1("camera")
    ///     .with(|settings| settings.master_uri = "http://127.0.0.1:11399".to_owned())
    ///     .start()?;
    /// let spec = TopicSpec::new("/camera/image_raw", MessageType::Image);
    /// let mut listener = ros1.open_listener(&spec, &Context::default())?;
    /// assert_eq!((ros1.name(), listener.take()?), ("ros", None));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[doc(inline)]
    pub use wrapyfi_ros1::Ros1;
    #[doc(inline)]
    pub use wrapyfi_ros1::Ros1Config;
}

/// ROS 2: topics, services and parameters on CycloneDDS, or on the middleware of the ROS 2 that is sourced.
#[cfg(feature = "ros2")]
pub mod ros2 {
    /// Middleware `ros2`, which [`crate::ros2`] starts:
    ///
    /// ```no_run
    /// use wrapyfi_core::endpoint::{Context, Middleware, TopicSpec};
    /// use wrapyfi_core::types::MessageType;
    /// let ros2 = wrapyfi_core::ros2("camera").start()?;
    /// let spec = TopicSpec::new("/camera/image_raw", MessageType::Image);
    /// let mut listener = ros2.open_listener(&spec, &Context::default())?;
    /// assert_eq!(listener.take()?, None);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[doc(inline)]
    pub use wrapyfi_ros2::Ros2;
    #[doc(inline)]
    pub use wrapyfi_ros2::{
        Adapter, CycloneConfig, ParameterClient, ParameterClientError, ParameterResult,
        ServiceOptions, environment::DiscoveryRange, graph::ServiceMapping,
    };
}

/// YARP: ports of robots, and the name server that knows them.
#[cfg(feature = "yarp")]
pub mod yarp {
    /// Middleware `yarp`, which [`crate::yarp`] starts:
    ///
    /// ```
    /// use wrapyfi_core::endpoint::{Context, Middleware, TopicSpec};
    /// use wrapyfi_core::types::MessageType;
    /// // A name server of its own, on any free port.
    /// let yarp = wrapyfi_core::yarp().with(|settings| {
    ///     settings.name_server = Some(std::net::SocketAddr::from(([127, 0, 0, 1], 0)).into());
    ///     settings.embedded = true;
    /// });
    /// let yarp = yarp.start()?;
    /// let spec = TopicSpec::new("/head/camera:o", MessageType::Image);
    /// let mut listener = yarp.open_listener(&spec, &Context::default())?;
    /// assert_eq!((yarp.name(), listener.take()?), ("yarp", None));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[doc(inline)]
    pub use wrapyfi_yarp_endpoint::Yarp;
    #[doc(inline)]
    pub use wrapyfi_yarp_endpoint::{Dialect, YarpConfig};
}

/// ZeroMQ: Wrapyfi's publishers and listeners, clients and servers, and the broker between them.
#[cfg(feature = "zeromq")]
pub mod zeromq {
    /// Middleware `zeromq`, which [`crate::zeromq`] starts:
    ///
    /// ```
    /// use wrapyfi_core::endpoint::{Context, Middleware, TopicSpec};
    /// use wrapyfi_core::types::MessageType;
    /// // A broker of its own, on any free ports.
    /// let zeromq = wrapyfi_core::zeromq().with(|settings| (settings.pub_port, settings.sub_port) = (0, 0));
    /// let zeromq = zeromq.start()?;
    /// let spec = TopicSpec::new("/camera", MessageType::Image);
    /// let mut listener = zeromq.open_listener(&spec, &Context::default())?;
    /// assert_eq!(listener.take()?, None); // no publisher yet
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[doc(inline)]
    pub use wrapyfi_zeromq::ZeroMq;
    #[doc(inline)]
    pub use wrapyfi_zeromq::{BrokerMode, CurveClient, CurveConfig, ZeroMqConfig};
}
