//! One builder for each middleware: the settings of the environment, changed where a program says otherwise.
//!
//! ```text
//!   zeromq()  ros1(node)  ros2(node)  yarp()  ─ with(|settings| …) ─▶ start() ─▶ Middleware
//!        └── WRAPYFI_ZEROMQ_*, ROS_MASTER_URI, ROS_DOMAIN_ID, yarp.conf
//! ```

use crate::communicator::StartError;

/// A middleware of type `M` that is not started yet, with its settings `S`.
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
/// # Ok::<(), wrapyfi_core::communicator::StartError>(())
/// ```
#[derive(Debug)]
#[must_use = "nothing runs until it is started"]
pub struct Builder<S, M> {
    settings: Result<S, StartError>,
    start: fn(S) -> Result<M, StartError>,
}

impl<S, M> Builder<S, M> {
    /// Changes settings.
    pub fn with(mut self, change: impl FnOnce(&mut S)) -> Self {
        if let Ok(settings) = &mut self.settings {
            change(settings);
        }
        self
    }

    /// Starts the middleware.
    ///
    /// # Errors
    /// When a variable of the environment has a value that it cannot have, or the middleware refuses. A broker, master
    /// or name server elsewhere that is not there yet is no error: it is waited for.
    pub fn start(self) -> Result<M, StartError> {
        (self.start)(self.settings?)
    }
}

/// ZeroMQ, as the variables `WRAPYFI_ZEROMQ_*` say; it runs the broker where there is none.
#[cfg(feature = "zeromq")]
pub fn zeromq()
-> Builder<crate::middleware::zeromq::ZeroMqConfig, crate::middleware::zeromq::ZeroMq> {
    use crate::middleware::zeromq::{ZeroMq, ZeroMqConfig};
    Builder {
        settings: ZeroMqConfig::from_env().map_err(StartError::refused),
        start: |settings| ZeroMq::start(&settings).map_err(StartError::refused),
    }
}

/// ROS 1 as the node `node`, at the master that `ROS_MASTER_URI` names.
#[cfg(feature = "ros1")]
pub fn ros1(
    node: &str,
) -> Builder<crate::middleware::ros1::Ros1Config, crate::middleware::ros1::Ros1> {
    use crate::middleware::ros1::{Ros1, Ros1Config};
    let settings = Ros1Config::from_env().map_err(StartError::refused);
    let start = |settings| Ros1::start(&settings).map_err(StartError::refused);
    Builder { settings, start }.with(|settings| settings.node = Some(node.to_owned()))
}

/// Settings of a node on ROS 2.
#[cfg(feature = "ros2")]
#[derive(Debug)]
#[non_exhaustive]
pub struct Ros2Settings {
    /// Name of the node, its domain, and what CycloneDDS needs beside them.
    pub cyclone: crate::middleware::ros2::CycloneConfig,
    /// What carries the graph; `None`: as the environment says.
    pub adapter: Option<crate::middleware::ros2::Adapter>,
    /// Variables of ROS 2 as they were read.
    environment: crate::middleware::ros2::environment::Environment,
}

/// ROS 2 as the node `node`, such as `camera` or `/lab/camera`, in the domain and on the middleware that the variables
/// of ROS 2 name. Topics are not remapped.
#[cfg(feature = "ros2")]
pub fn ros2(node: &str) -> Builder<Ros2Settings, crate::middleware::ros2::Ros2> {
    use crate::middleware::ros2::{CycloneConfig, Ros2, environment, join};
    use crate::node::NodeName;
    let settings = || {
        let (namespace, name) = node.rsplit_once('/').unwrap_or(("/", node));
        let name = NodeName::new(name, namespace)
            .map_err(|error| StartError::refused(format_args!("node {node:?}: {error}")))?;
        let environment =
            environment::read(|name| std::env::var(name).ok()).map_err(StartError::refused)?;
        let cyclone = CycloneConfig::from_environment(name, &environment);
        Ok(Ros2Settings { cyclone, adapter: None, environment })
    };
    let start = |settings: Ros2Settings| {
        let Ros2Settings { cyclone, adapter, environment } = settings;
        environment.log();
        let own = cyclone.node.clone();
        let joined = join(&cyclone, &environment, adapter, "/").map_err(StartError::refused)?;
        Ok(Ros2::joined(joined, move |topic| own.expand(topic).map_err(|error| error.to_string())))
    };
    Builder { settings: settings(), start }
}

/// YARP, at the name server that `yarp.conf` names.
#[cfg(feature = "yarp")]
pub fn yarp() -> Builder<crate::middleware::yarp::YarpConfig, crate::middleware::yarp::Yarp> {
    use crate::middleware::yarp::{Yarp, YarpConfig};
    Builder {
        settings: YarpConfig::from_env().map_err(StartError::refused),
        start: |settings| Yarp::start(&settings).map_err(StartError::refused),
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
            settings.broker = crate::middleware::zeromq::BrokerMode::Embedded;
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
