//! The one place where middlewares are made from their settings, whoever gives these.
//!
//! ```text
//!   a program: zeromq() ros1(node) ros2(node) yarp(), changed by with(|settings| …)  ─┐
//!   options of a method: communicator                                                 ├─▶ MiddlewareSettings::start ─▶ Middleware
//!   a configuration: wrapyfi_bridge                                                  ─┘
//!     └── each begins with the environment: WRAPYFI_ZEROMQ_*, ROS_MASTER_URI, ROS_DOMAIN_ID, yarp.conf
//! ```

use crate::communicator::OptionError;
use wrapyfi_endpoint::Middleware;
#[cfg(feature = "ros1")]
use wrapyfi_ros1::{Ros1, Ros1Config, Ros1Error};
#[cfg(feature = "yarp")]
use wrapyfi_yarp_endpoint::{Yarp, YarpConfig, YarpError};
#[cfg(feature = "zeromq")]
use wrapyfi_zeromq::{ZeroMq, ZeroMqConfig};

/// Settings of a middleware that is not started yet.
///
/// ```
/// use wrapyfi_core::endpoint::Middleware;
/// use wrapyfi_core::middleware::memory::Memory;
/// use wrapyfi_core::start::{MiddlewareSettings, StartError};
///
/// struct BusSettings { name: String }
/// impl MiddlewareSettings for BusSettings {
///     type Middleware = Memory;
///     fn start(&self) -> Result<Memory, StartError> {
///         match self.name.as_str() {
///             "" => Err(StartError::refused("the bus needs a name")),
///             name => Ok(Memory::new(name)),
///         }
///     }
/// }
///
/// assert_eq!(BusSettings { name: "bus".into() }.start()?.name(), "bus");
/// # Ok::<(), StartError>(())
/// ```
pub trait MiddlewareSettings {
    /// The middleware that they are for.
    type Middleware: Middleware + 'static;

    /// Starts the middleware. A broker, master or name server elsewhere that is not there yet is no error: it is
    /// waited for.
    ///
    /// # Errors
    /// When the middleware refuses.
    fn start(&self) -> Result<Self::Middleware, StartError>;
}

/// Error of starting a middleware.
///
/// ```
/// use wrapyfi_core::middleware::zeromq::BrokerMode;
/// use wrapyfi_core::start::StartError;
/// let zeromq = wrapyfi_core::zeromq().with(|settings| {
///     settings.broker = BrokerMode::Foreign;
///     settings.pub_port = 0;
/// });
/// let error = zeromq.start().err().unwrap();
/// assert!(matches!(error, StartError::Refused(_)));
/// assert_eq!(error.to_string(), "with a foreign broker pub_port must be its port, not 0");
/// ```
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StartError {
    /// An option has a value that it cannot have.
    #[error("{0}")]
    Option(String),
    /// The settings can never work, in the words of the middleware.
    #[error("{0}")]
    Refused(String),
    /// A machine or server that the settings name is not there.
    #[error("{0}")]
    Absent(String),
    /// The system or a library refuses; a later try may succeed.
    #[error("{0}")]
    Failed(String),
}

impl From<OptionError> for StartError {
    fn from(error: OptionError) -> Self {
        Self::Option(error.to_string())
    }
}

impl StartError {
    /// Makes [`StartError::Refused`] of the middleware's own error.
    pub fn refused(reason: impl std::fmt::Display) -> Self {
        Self::Refused(reason.to_string())
    }
}

/// Settings as the environment has them, changed where a program says otherwise.
///
/// ```no_run
/// use wrapyfi_core::middleware::zeromq::BrokerMode;
///
/// let zeromq = wrapyfi_core::zeromq()
///     .with(|settings| {
///         settings.broker = BrokerMode::Foreign;
///         settings.pub_port = 5560;
///     })
///     .start()?;
/// # Ok::<(), wrapyfi_core::start::StartError>(())
/// ```
#[derive(Debug)]
#[must_use = "nothing runs until it is started"]
pub struct Builder<S>(Result<S, StartError>);

impl<S: MiddlewareSettings> Builder<S> {
    /// Changes settings.
    pub fn with(mut self, change: impl FnOnce(&mut S)) -> Self {
        if let Ok(settings) = &mut self.0 {
            change(settings);
        }
        self
    }

    /// Starts the middleware.
    ///
    /// # Errors
    /// When a variable of the environment has a value that it cannot have, or the middleware refuses.
    pub fn start(self) -> Result<S::Middleware, StartError> {
        self.0?.start()
    }
}

/// Error of a middleware as one of three kinds.
#[cfg(any(feature = "zeromq", feature = "ros1", feature = "ros2", feature = "yarp"))]
fn failed(error: &dyn std::fmt::Display, is_hopeless: bool, is_absent: bool) -> StartError {
    match (is_hopeless, is_absent) {
        (true, _) => StartError::refused(error),
        (false, true) => StartError::Absent(error.to_string()),
        (false, false) => StartError::Failed(error.to_string()),
    }
}

/// ZeroMQ, as the variables `WRAPYFI_ZEROMQ_*` say; it runs the broker where there is none.
#[cfg(feature = "zeromq")]
pub fn zeromq() -> Builder<ZeroMqConfig> {
    Builder(ZeroMqConfig::from_env().map_err(StartError::refused))
}

#[cfg(feature = "zeromq")]
impl MiddlewareSettings for ZeroMqConfig {
    type Middleware = ZeroMq;

    fn start(&self) -> Result<ZeroMq, StartError> {
        ZeroMq::start(self).map_err(|error| failed(&error, error.is_hopeless(), false))
    }
}

/// ROS 1 as the node `node`, at the master that `ROS_MASTER_URI` names.
#[cfg(feature = "ros1")]
pub fn ros1(node: &str) -> Builder<Ros1Config> {
    let settings = Ros1Config::from_env().map_err(StartError::refused);
    Builder(settings).with(|settings| settings.node = Some(node.to_owned()))
}

#[cfg(feature = "ros1")]
impl MiddlewareSettings for Ros1Config {
    type Middleware = Ros1;

    fn start(&self) -> Result<Ros1, StartError> {
        let is_absent = |error: &Ros1Error| matches!(error, Ros1Error::Config(_));
        Ros1::start(self).map_err(|error| failed(&error, error.is_hopeless(), is_absent(&error)))
    }
}

/// YARP, at the name server that `yarp.conf` names.
#[cfg(feature = "yarp")]
pub fn yarp() -> Builder<YarpConfig> {
    Builder(YarpConfig::from_env().map_err(StartError::refused))
}

#[cfg(feature = "yarp")]
impl MiddlewareSettings for YarpConfig {
    type Middleware = Yarp;

    fn start(&self) -> Result<Yarp, StartError> {
        let is_absent =
            |error: &YarpError| matches!(error, YarpError::NameServer(_) | YarpError::Host(_));
        Yarp::start(self).map_err(|error| failed(&error, error.is_hopeless(), is_absent(&error)))
    }
}

#[cfg(feature = "ros2")]
pub use ros2::{Ros2Settings, ros2};
#[cfg(feature = "ros2")]
mod ros2 {
    use std::sync::Arc;

    use super::{Builder, MiddlewareSettings, StartError, failed};
    use wrapyfi_node::NodeName;
    use wrapyfi_ros2::environment::{self, Environment};
    use wrapyfi_ros2::{Adapter, CycloneConfig, CycloneError, DomainError, JoinError, Ros2, join};

    /// Rule that gives a topic the name that it has for the node, or says what is wrong with it.
    type Remap = dyn Fn(&str) -> Result<String, String> + Send + Sync;

    /// Settings of a node on ROS 2.
    ///
    /// ```
    /// use wrapyfi_core::node::NodeName;
    /// use wrapyfi_core::start::Ros2Settings;
    /// let domain = |name: &str| (name == "ROS_DOMAIN_ID").then(|| "7".to_owned());
    /// let settings = Ros2Settings::of_node(NodeName::new("camera", "/lab")?, domain)?;
    /// assert_eq!(settings.cyclone.domain_id, 7);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[derive(Clone)]
    #[non_exhaustive]
    pub struct Ros2Settings {
        /// Name of the node, its domain, and what CycloneDDS needs beside them.
        pub cyclone: CycloneConfig,
        /// Carrier of the graph; `None`: as the environment says.
        pub adapter: Option<Adapter>,
        /// Name of the node for security, `/` where it has none.
        pub enclave: String,
        /// Variables of ROS 2 as they were read.
        environment: Environment,
        remap: Arc<Remap>,
    }

    impl Ros2Settings {
        /// Settings of a node, as the variables of ROS 2 say that `lookup` gives. Topics are expanded in the node's
        /// namespace, and not remapped.
        ///
        /// # Errors
        /// When a variable has a value that it cannot have.
        pub fn of_node(
            node: NodeName,
            lookup: impl Fn(&str) -> Option<String>,
        ) -> Result<Self, StartError> {
            let environment = environment::read(lookup).map_err(StartError::refused)?;
            let cyclone = CycloneConfig::from_environment(node.clone(), &environment);
            let expand = move |topic: &str| node.expand(topic).map_err(|error| error.to_string());
            let (adapter, enclave) = (None, "/".to_owned());
            Ok(Self { cyclone, adapter, enclave, environment, remap: Arc::new(expand) })
        }

        /// Sets the rule that gives topics their names.
        #[must_use]
        pub fn remapped(
            self,
            remap: impl Fn(&str) -> Result<String, String> + Send + Sync + 'static,
        ) -> Self {
            Self { remap: Arc::new(remap), ..self }
        }
    }

    impl std::fmt::Debug for Ros2Settings {
        fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            f.debug_tuple("Ros2Settings").field(&self.cyclone).finish_non_exhaustive()
        }
    }

    /// ROS 2 as the node `node`, such as `camera` or `/lab/camera`, in the domain and on the middleware that the
    /// variables of ROS 2 name.
    pub fn ros2(node: &str) -> Builder<Ros2Settings> {
        let (namespace, name) = node.rsplit_once('/').unwrap_or(("/", node));
        let name = NodeName::new(name, namespace)
            .map_err(|error| StartError::refused(format_args!("node {node:?}: {error}")));
        Builder(name.and_then(|name| Ros2Settings::of_node(name, |name| std::env::var(name).ok())))
    }

    impl MiddlewareSettings for Ros2Settings {
        type Middleware = Ros2;

        fn start(&self) -> Result<Ros2, StartError> {
            let Self { cyclone, adapter, enclave, environment, remap } = self.clone();
            environment.log();
            let joined = join(&cyclone, &environment, adapter, &enclave);
            let is_refused = |error: &JoinError| match error {
                // With the user's own configuration, which nothing changes but the user.
                JoinError::Cyclone(CycloneError::Domain(DomainError::Refused { .. })) => {
                    cyclone.extra_uri.is_some()
                }
                JoinError::Cyclone(CycloneError::Domain(DomainError::Peer(peer))) => {
                    peer.is_of_settings()
                }
                JoinError::Cyclone(_) => false,
                _ => true,
            };
            let joined = joined.map_err(|error| failed(&error, is_refused(&error), false))?;
            Ok(Ros2::joined(joined, move |topic| remap(topic)))
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "in a test a panic is the right answer")]
mod tests {
    #[test]
    #[cfg(feature = "zeromq")]
    fn settings_are_changed_before_the_start() {
        let started = super::zeromq().with(|settings| {
            settings.ip = "127.0.0.1".to_owned();
            (settings.pub_port, settings.sub_port) = (0, 0);
            settings.broker = wrapyfi_zeromq::BrokerMode::Embedded;
        });
        assert_ne!(started.start().unwrap().pub_port(), 0);
    }

    #[test]
    #[cfg(feature = "ros2")]
    fn a_name_that_no_node_can_have_is_refused_at_the_start() {
        let refused =
            super::ros2("1camera").with(|settings| settings.cyclone.domain_id = 7).start();
        assert!(refused.is_err_and(|error| error.to_string().contains("1camera")));
    }
}
