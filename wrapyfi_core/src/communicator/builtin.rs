//! The middlewares of this crate as sources, configured as Wrapyfi's are: by options, then by the
//! environment, then by default.

use std::sync::Arc;

use super::source::Source;

/// Sources of every middleware that this crate was built with.
pub(super) fn sources() -> Vec<Arc<dyn Source>> {
    vec![
        #[cfg(feature = "zeromq")]
        Arc::new(zeromq::ZeroMqSource),
        #[cfg(feature = "ros1")]
        Arc::new(ros1::Ros1Source::default()),
        #[cfg(feature = "ros2")]
        ros2_with(wrapyfi_node::args::RosArgs::default()),
        #[cfg(feature = "yarp")]
        Arc::new(yarp::YarpSource),
    ]
}

/// Source of ROS 2 with the remap rules and names of a command line.
#[cfg(feature = "ros2")]
pub(super) fn ros2_with(args: wrapyfi_node::args::RosArgs) -> Arc<dyn Source> {
    Arc::new(ros2::Ros2Source::new(args))
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

#[cfg(feature = "zeromq")]
mod zeromq {
    //! ZeroMQ: publishers run the broker where there is none, listeners never do.

    use crate::communicator::resolve::Side;
    use crate::communicator::source::{EndpointNeeds, Planned, Source, StartError};
    use wrapyfi_endpoint::network::Place;
    use wrapyfi_zeromq::{BrokerMode, NAME, ZeroMqConfig};

    pub(super) struct ZeroMqSource;

    impl Source for ZeroMqSource {
        fn name(&self) -> &str {
            NAME
        }

        fn plan(&self, wanted: &EndpointNeeds<'_>) -> Result<Planned, StartError> {
            let options = wanted.options;
            // Wrapyfi's clients and servers read the names of the two ports crosswise.
            let read = match (wanted.is_service, wanted.side) {
                (true, Side::Listener) => ZeroMqConfig::from_env_of_client(),
                _ => ZeroMqConfig::from_env(),
            };
            let mut config = read.map_err(StartError::refused)?;
            let ip = options.text("socket_ip")?;
            if let Some(ip) = ip {
                ip.clone_into(&mut config.ip);
            }
            let is_insecure = options.switch("insecure")?.unwrap_or(false);
            config.insecure.said(Place::Keyword, ip.is_some(), is_insecure);
            if let Some(topic) = options.text("pubsub_monitor_topic")? {
                topic.clone_into(&mut config.monitor_topic);
            }
            config.pub_port = options.number("socket_pub_port")?.unwrap_or(config.pub_port);
            config.sub_port = options.number("socket_sub_port")?.unwrap_or(config.sub_port);
            config.rep_port = options.number("socket_rep_port")?.unwrap_or(config.rep_port);
            config.req_port = options.number("socket_req_port")?.unwrap_or(config.req_port);
            config.monitor =
                options.switch("start_pubsub_monitor_broker")?.unwrap_or(config.monitor);
            config.max_frame_bytes = config.max_frame_bytes.max(wanted.max_message_bytes);
            let may_start = match options.switch("start_proxy_broker")? {
                Some(may_start) => may_start,
                None => config.broker == BrokerMode::Embedded,
            };
            let brings_broker = may_start && wanted.side == Side::Publisher;
            let mode = |brings| if brings { BrokerMode::Embedded } else { BrokerMode::Foreign };
            config.broker = mode(brings_broker && !wanted.is_service);
            config.service_broker = mode(brings_broker && wanted.is_service);
            // Two sides, two instances: one instance does not hear itself.
            Ok(Planned::new(format!("{:?} {config:?}", wanted.side), config))
        }
    }
}

#[cfg(feature = "ros1")]
mod ros1 {
    //! ROS 1: one node for all publishers and servers of a context, one for its listeners and
    //! clients.

    use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

    use crate::communicator::resolve::Side;
    use crate::communicator::source::{EndpointNeeds, Planned, Source, StartError, queue_size};
    use wrapyfi_endpoint::network::Place;
    use wrapyfi_ros1::{NAME, Ros1Config};

    /// Name of a node without one, as in Wrapyfi.
    const NODE: &str = "wrapyfi";

    /// Number of contexts made in the process.
    static CONTEXTS: AtomicU32 = AtomicU32::new(0);

    pub(super) struct Ros1Source {
        /// Number of this context.
        number: u32,
    }

    impl Default for Ros1Source {
        fn default() -> Self {
            Self { number: CONTEXTS.fetch_add(1, Relaxed) }
        }
    }

    impl Source for Ros1Source {
        fn name(&self) -> &str {
            NAME
        }

        fn plan(&self, wanted: &EndpointNeeds<'_>) -> Result<Planned, StartError> {
            let kwargs = wanted.options.part("ros_kwargs")?;
            let named = kwargs.text("node_name")?.unwrap_or(NODE);
            let anonymous = kwargs.switch("anonymous")?.unwrap_or(true);
            // Two sides, two nodes: a node does not hear itself.
            let side = if wanted.side == Side::Publisher { "" } else { "_in" };
            let node = if anonymous {
                format!("{named}_{:x}_{}{side}", std::process::id(), self.number)
            } else {
                format!("{named}{side}")
            };
            let mut config = Ros1Config::from_env().map_err(StartError::refused)?;
            config.node = Some(node.clone());
            let is_insecure = kwargs.switch("insecure")?.unwrap_or(false);
            config.insecure.said(Place::Keyword, false, is_insecure);
            Ok(Planned::new(node, config))
        }

        fn queue_depth(&self) -> Option<usize> {
            Some(queue_size("WRAPYFI_ROS_QUEUE_SIZE"))
        }
    }
}

#[cfg(feature = "ros2")]
mod ros2 {
    //! ROS 2: one node for all publishers and servers of a context, one for its listeners and
    //! clients.

    use std::sync::Arc;
    use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

    use crate::communicator::resolve::Side;
    use crate::communicator::source::{EndpointNeeds, Planned, Source, StartError, queue_size};
    use crate::start::Ros2Settings;
    use wrapyfi_node::args::RosArgs;
    use wrapyfi_node::{NodeName, NodeOptions};

    /// Number of nodes without a name made in the process.
    static NAMELESS: AtomicU32 = AtomicU32::new(0);

    pub(super) struct Ros2Source {
        /// Number in the names of this context's nameless nodes.
        number: u32,
        args: Arc<RosArgs>,
    }

    impl Ros2Source {
        pub(super) fn new(args: RosArgs) -> Self {
            Self { number: NAMELESS.fetch_add(1, Relaxed), args: Arc::new(args) }
        }
    }

    impl Source for Ros2Source {
        fn name(&self) -> &str {
            "ros2"
        }

        fn plan(&self, wanted: &EndpointNeeds<'_>) -> Result<Planned, StartError> {
            let kwargs = wanted.options.part("ros2_kwargs")?;
            let base = match kwargs.text("node_name")? {
                Some(name) => name.to_owned(),
                None => format!("wrapyfi_{:x}_{}", std::process::id(), self.number),
            };
            let options =
                NodeOptions::resolve(&base, "/", &self.args).map_err(StartError::refused)?;
            let own = options.name;
            // Two sides, two nodes: a node does not hear itself.
            let node = match wanted.side {
                Side::Publisher => own.clone(),
                Side::Listener => NodeName::new(&format!("{}_in", own.name()), own.namespace())
                    .map_err(StartError::refused)?,
            };
            let (name, args) = (node.fqn(), Arc::clone(&self.args));
            let mut settings = Ros2Settings::of_node(node, |name| std::env::var(name).ok())?;
            let most = &mut settings.cyclone.max_message_bytes;
            *most = wanted.max_message_bytes.max(*most);
            settings.enclave.clone_from(&args.enclave);
            // Both sides use the rules for the node's own name.
            let remap = move |topic: &str| {
                args.resolve_topic(&own, topic).map_err(|error| error.to_string())
            };
            Ok(Planned::new(name, settings.remapped(remap)))
        }

        fn queue_depth(&self) -> Option<usize> {
            Some(queue_size("WRAPYFI_ROS2_QUEUE_SIZE"))
        }
    }

    #[cfg(test)]
    mod tests {
        use super::*;
        use crate::communicator::option::{OptionValue, Options};

        fn key(argv: &[&str], side: Side, options: &Options) -> Result<String, StartError> {
            let argv = argv.iter().map(|word| (*word).to_owned());
            let none = |_: &str| Err(std::io::Error::other("no files here"));
            let source = Ros2Source::new(RosArgs::parse(argv, none).unwrap());
            let wanted = EndpointNeeds { side, is_service: false, options, max_message_bytes: 1 };
            source.plan(&wanted).map(|planned| planned.key)
        }

        #[test]
        fn the_command_line_names_both_nodes() {
            let named = Options::default().with(
                "ros2_kwargs",
                OptionValue::Map(
                    Options::default().with("node_name", OptionValue::Text("eye".into())),
                ),
            );
            let lab = ["--ros-args", "-r", "__ns:=/lab"];
            assert_eq!(key(&[], Side::Publisher, &named).unwrap(), "/eye");
            assert_eq!(key(&lab, Side::Publisher, &named).unwrap(), "/lab/eye");
            assert_eq!(key(&lab, Side::Listener, &named).unwrap(), "/lab/eye_in");
            let other = ["--ros-args", "-r", "__node:=driver"];
            assert_eq!(key(&other, Side::Listener, &named).unwrap(), "/driver_in");
            let wrong = ["--ros-args", "-p", "use_sim_time:=5"];
            let error = key(&wrong, Side::Publisher, &named).unwrap_err().to_string();
            assert!(error.contains("'use_sim_time'"), "{error}");
        }
    }
}

#[cfg(feature = "yarp")]
mod yarp {
    //! YARP: the name server that YARP's own configuration names, as Wrapyfi's programs find it.

    use crate::communicator::option::Options;
    use crate::communicator::source::{EndpointNeeds, Planned, Source, StartError};
    use wrapyfi_endpoint::network::Place;
    use wrapyfi_yarp_endpoint::{NAME, YarpConfig};

    pub(super) struct YarpSource;

    impl Source for YarpSource {
        fn name(&self) -> &str {
            NAME
        }

        fn absent(&self, options: &Options) -> Option<String> {
            // `plan` reports an option that cannot be read.
            let kwargs = options.map("yarp_kwargs").ok().flatten();
            if kwargs
                .is_some_and(|kwargs| matches!(kwargs.text("name_server"), Ok(Some(_)) | Err(_)))
            {
                return None;
            }
            match YarpConfig::default().check_name_server() {
                Err(error) if error.is_missing() => Some(error.to_string()),
                _ => None,
            }
        }

        fn plan(&self, wanted: &EndpointNeeds<'_>) -> Result<Planned, StartError> {
            let kwargs = wanted.options.part("yarp_kwargs")?;
            let mut config = YarpConfig::from_env().map_err(StartError::refused)?;
            config.name_server = kwargs.word("name_server")?.or(config.name_server);
            let ip = kwargs.word("ip")?;
            let is_insecure = kwargs.switch("insecure")?.unwrap_or(false);
            config.insecure.said(Place::Keyword, ip.is_some(), is_insecure);
            config.ip = ip.or(config.ip);
            config.is_wrapyfi = true;
            config.dialect = kwargs.word("dialect")?.unwrap_or(config.dialect);
            config.max_message_bytes = config.max_message_bytes.max(wanted.max_message_bytes);
            // Two sides, two instances: one instance does not hear itself.
            Ok(Planned::new(format!("{:?} {config:?}", wanted.side), config))
        }
    }
}
