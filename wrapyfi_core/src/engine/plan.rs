//! Configuration to routes: every name parsed, every conflict found before anything is opened.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use super::config::{Config, Defaults, OverflowConfig, RouteConfig, Spanned};
use super::config_devices::DevicesConfig;
use super::config_error::{ConfigError, Problem, did_you_mean};
use super::config_qos::{QosConfig, QosOverride};
use crate::Limits;
use crate::codec::is_convertible;
use crate::endpoint::{EndpointAddress, Overflow, ParseAddressError, QueueSpec, TopicSpec};
use crate::plugin::{DeviceMaps, Plugins};
use crate::types::{DataType, Encoding, MessageType};

/// A route as it will be run.
#[derive(Debug, Clone, PartialEq)]
pub struct RouteSpec {
    /// Name in tables, logs and errors.
    pub name: String,
    /// Source.
    pub from: EndpointAddress,
    /// Destination.
    pub to: EndpointAddress,
    /// Type of its messages, at the destination and, unless `from_type` says otherwise, at the source.
    pub message_type: MessageType,
    /// Type of the messages at the source.
    pub from_type: MessageType,
    /// Quality of service on middlewares that have one.
    pub qos: QosConfig,
    /// What the start of the program changed of it, at the source.
    pub from_override: QosOverride,
    /// What the start of the program changed of it, at the destination.
    pub to_override: QosOverride,
    /// Queue between source and conversion.
    pub queue: QueueSpec,
    /// Highest rate passed on, in messages per second.
    pub max_rate_hz: Option<f64>,
    /// Channel order of three-channel frames on Wrapyfi's side.
    pub color_order: Encoding,
    /// Bounds on every message.
    pub limits: Limits,
    /// What reads and writes plug-in objects inside native objects.
    pub plugins: Plugins,
}

impl RouteSpec {
    /// A route with default settings.
    #[must_use]
    pub fn new(from: EndpointAddress, to: EndpointAddress, message_type: MessageType) -> Self {
        Self {
            name: format!("{from} -> {to}"),
            from,
            to,
            message_type,
            from_type: message_type,
            qos: QosConfig::default(),
            from_override: QosOverride::default(),
            to_override: QosOverride::default(),
            queue: QueueSpec::default(),
            max_rate_hz: None,
            color_order: Encoding::Bgr8,
            limits: Limits::default(),
            plugins: Plugins::standard(),
        }
    }

    /// What to open at `address`, one of the route's two ends.
    #[must_use]
    pub fn topic_spec(&self, address: &EndpointAddress) -> TopicSpec {
        let at_source = *address == self.from;
        let changed = if at_source { self.from_override } else { self.to_override };
        TopicSpec {
            topic: address.name.clone(),
            message_type: if at_source { self.from_type } else { self.message_type },
            qos: self.qos.qos(),
            match_peers: changed.follows || matches!(self.qos, QosConfig::Match(_)),
            pinned: changed.pinned,
            queue: self.queue,
            color_order: self.color_order,
            limits: self.limits,
            plugins: self.plugins.clone(),
        }
    }
}

impl fmt::Display for RouteSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} -> {}  ", self.from, self.to)?;
        if self.from_type != self.message_type {
            write!(f, "{} as ", self.from_type.ros_type())?;
        }
        write!(f, "{}", self.message_type.ros_type())?;
        write!(f, "  queue {} ", self.queue.depth)?;
        match self.queue.overflow {
            Overflow::DropOldest => write!(f, "drop_oldest")?,
            Overflow::DropNewest => write!(f, "drop_newest")?,
            Overflow::Block(deadline) => write!(f, "block {} ms", deadline.as_millis())?,
        }
        // Fitting is the rule, and not said.
        if let QosConfig::Fixed(qos) = self.qos {
            write!(f, "  qos {qos}")?;
        }
        if let Some(hz) = self.max_rate_hz {
            write!(f, "  at most {hz} Hz")?;
        }
        if let Some(devices) = self.plugins.devices() {
            write!(f, "  devices {devices}")?;
        }
        Ok(())
    }
}

/// A middleware that routes may name.
#[derive(Clone, Copy)]
pub struct Available<'a> {
    /// Name in addresses.
    pub name: &'a str,
    /// Its rule for topic names; the error says what is wrong with one.
    pub check_topic: &'a dyn Fn(&str) -> Result<(), String>,
}

/// The routes of a configuration, checked.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plan {
    /// In the order of the file.
    pub routes: Vec<RouteSpec>,
}

impl Plan {
    /// Checks `config` against the middlewares that exist; `file` is its name in errors.
    ///
    /// # Errors
    /// Every fault at once: unknown middlewares and types, bad names and numbers, routes that are
    /// given twice, destinations with two routes that do not say `merge: true`.
    pub fn new<E>(
        config: &Config<E>,
        middlewares: &[Available<'_>],
        file: &str,
    ) -> Result<Self, ConfigError> {
        let mut problems = Vec::new();
        let mut routes: Vec<RouteSpec> = Vec::with_capacity(config.routes.len());
        let mut seen: BTreeMap<(EndpointAddress, EndpointAddress), u64> = BTreeMap::new();
        let mut into: BTreeMap<EndpointAddress, (u64, bool)> = BTreeMap::new();
        if config.routes.is_empty() {
            problems
                .push(Problem { position: None, message: "no routes: nothing to do".to_owned() });
        }
        let default_devices = device_maps(config.defaults.devices.as_ref())
            .map_err(|problem| problems.push(problem))
            .unwrap_or_default();
        for entry in &config.routes {
            let line = entry.referenced.line();
            let route = match route_spec(entry, &config.defaults, &default_devices, middlewares) {
                Ok(route) => route,
                Err(found) => {
                    problems.extend(found);
                    continue;
                }
            };
            let mut complain = |message| problems.push(Problem::at(entry.referenced, message));
            let ends = (route.from.clone(), route.to.clone());
            if let Some(first) = seen.insert(ends, line) {
                complain(format!(
                    "route {} -> {} stands already in line {first}",
                    route.from, route.to
                ));
            } else if let Some(&(first, merges)) = into.get(&route.to)
                && !(merges && entry.value.merge)
            {
                complain(format!(
                    "line {first} already routes to {}; write merge: true on both to mix them",
                    route.to
                ));
            }
            into.entry(route.to.clone()).or_insert((line, entry.value.merge));
            routes.push(route);
        }
        if problems.is_empty() {
            Ok(Self { routes })
        } else {
            Err(ConfigError { file: file.to_owned(), problems })
        }
    }
}

fn route_spec(
    entry: &Spanned<RouteConfig>,
    defaults: &Defaults,
    default_devices: &DeviceMaps,
    middlewares: &[Available<'_>],
) -> Result<RouteSpec, Vec<Problem>> {
    let config = &entry.value;
    let mut problems = Vec::new();
    let from = address(&config.from, middlewares).map_err(|problem| problems.push(problem)).ok();
    let to = address(&config.to, middlewares).map_err(|problem| problems.push(problem)).ok();
    let mut parse_type = |text: &Spanned<String>| {
        let parsed = text.value.parse::<MessageType>();
        parsed.map_err(|error| problems.push(Problem::at(text.referenced, error.to_string()))).ok()
    };
    let message_type = parse_type(&config.message_type);
    let from_type = config.from_type.as_ref().map_or(message_type, parse_type);
    if let (Some(written), Some(from), Some(to)) = (&config.from_type, from_type, message_type)
        && !is_convertible(from.data_type(), to.data_type())
    {
        let text = format!(
            "from_type {from} does not become type {to}: {} and {} only become each other through \
             NativeObject",
            from.data_type(),
            to.data_type()
        );
        problems.push(Problem::at(written.referenced, text));
    }
    let color_order = match &config.encoding {
        None => Encoding::Bgr8,
        Some(encoding) => match encoding.value.as_str() {
            "bgr8" => Encoding::Bgr8,
            "rgb8" => Encoding::Rgb8,
            other => {
                let text = format!("encoding {other:?} is not a channel order: write bgr8 or rgb8");
                problems.push(Problem::at(encoding.referenced, text));
                Encoding::Bgr8
            }
        },
    };
    let mut within = |key: &str, own: &Option<Spanned<usize>>, default: usize, most: usize| {
        let value = own.as_ref().map_or(default, |own| own.value);
        if !(1..=most).contains(&value) {
            let at = own.as_ref().map_or(entry.referenced, |own| own.referenced);
            let text = format!("{key} is {value}, it must lie between 1 and {most}");
            problems.push(Problem::at(at, text));
        }
        value
    };
    let depth = within("queue_depth", &config.queue_depth, defaults.queue_depth, 100_000);
    let mib = within("max_message_mib", &config.max_message_mib, defaults.max_message_mib, 2047);
    if let Some(rate) = &config.max_rate_hz
        && !(rate.value.is_finite() && rate.value > 0.0)
    {
        let text = format!("max_rate_hz is {}, it must be above 0", rate.value);
        problems.push(Problem::at(rate.referenced, text));
    }
    let overflow = match config.overflow.unwrap_or(defaults.overflow) {
        OverflowConfig::DropOldest => Overflow::DropOldest,
        OverflowConfig::DropNewest => Overflow::DropNewest,
        OverflowConfig::Block { block_ms } => Overflow::Block(Duration::from_millis(block_ms)),
    };
    let own_devices =
        device_maps(config.devices.as_ref()).map_err(|problem| problems.push(problem));
    if let (Some(own), Some(message_type), Some(from_type)) =
        (&config.devices, message_type, from_type)
        && [message_type, from_type].iter().all(|it| it.data_type() != DataType::NativeObject)
    {
        let text = format!(
            "devices has no effect on {}: only native objects hold tensors with a device",
            config.message_type.value
        );
        problems.push(Problem::at(own.referenced, text));
    }
    match (from, to, message_type.zip(from_type)) {
        (Some(from), Some(to), Some((message_type, from_type))) if problems.is_empty() => {
            if from == to {
                let text = format!("route from {from} to itself: it would loop");
                return Err(vec![Problem::at(entry.referenced, text)]);
            }
            let mut route = RouteSpec::new(from, to, message_type);
            route.from_type = from_type;
            if let Some(name) = &config.name {
                route.name.clone_from(name);
            }
            route.qos = config.qos.unwrap_or_default();
            route.queue = QueueSpec { depth, overflow };
            route.max_rate_hz = config.max_rate_hz.as_ref().map(|rate| rate.value);
            route.color_order = color_order;
            route.limits.message_bytes = mib.saturating_mul(Limits::MIB);
            let maps = own_devices.unwrap_or_default().or_from(default_devices);
            route.plugins = route.plugins.with_devices(maps);
            Ok(route)
        }
        _ => Err(problems),
    }
}

/// The device maps that a section `devices` makes.
fn device_maps(devices: Option<&Spanned<DevicesConfig>>) -> Result<DeviceMaps, Problem> {
    devices
        .map_or_else(|| Ok(DeviceMaps::default()), |devices| devices.value.maps(devices.referenced))
}

fn address(
    text: &Spanned<String>,
    middlewares: &[Available<'_>],
) -> Result<EndpointAddress, Problem> {
    let problem = |message| Problem::at(text.referenced, message);
    let address: EndpointAddress =
        text.value.parse().map_err(|error: ParseAddressError| problem(error.to_string()))?;
    let Some(middleware) = middlewares.iter().find(|known| known.name == address.middleware) else {
        let names: Vec<&str> = middlewares.iter().map(|known| known.name).collect();
        let hint = did_you_mean(&address.middleware, &names);
        return Err(problem(format!(
            "{:?}: middleware {:?} is not available; {hint}available: {}",
            text.value,
            address.middleware,
            names.join(", ")
        )));
    };
    if address.name.contains(['*', '(', '[', '$']) {
        let what =
            format!("{:?} is a pattern; this version routes one topic per entry", text.value);
        return Err(problem(what));
    }
    (middleware.check_topic)(&address.name)
        .map_err(|fault| problem(format!("{:?} is no topic name: {fault}", text.value)))?;
    Ok(address)
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Debug, Default, Deserialize)]
    struct NoEndpoints {}

    fn plan(text: &str) -> Result<Plan, ConfigError> {
        let config: Config<NoEndpoints> = Config::from_yaml(text, "bridge.yaml")?;
        let no_blanks = |topic: &str| match topic.find(' ') {
            Some(at) => Err(format!("blank at {at}")),
            None => Ok(()),
        };
        let known = |name| Available { name, check_topic: &no_blanks };
        Plan::new(&config, &[known("zeromq"), known("ros2")], "bridge.yaml")
    }

    #[test]
    fn a_plan_prints_what_will_run() {
        let plan = plan(
            "defaults: { queue_depth: 3, max_message_mib: 8 }\nroutes:\n  - { from: 'zeromq:/a', to: 'ros2:/b', type: Image, encoding: rgb8, max_rate_hz: 15 }\n",
        )
        .unwrap();
        let route = &plan.routes[0];
        assert_eq!(route.limits.message_bytes, 8 * Limits::MIB);
        assert_eq!(route.topic_spec(&route.from).color_order, Encoding::Rgb8);
        assert_eq!(
            route.to_string(),
            "zeromq:/a -> ros2:/b  sensor_msgs/msg/Image  queue 3 drop_oldest  at most 15 Hz"
        );
        assert!(route.topic_spec(&route.to).match_peers);
    }

    #[test]
    fn a_fixed_quality_of_service_is_said_and_follows_nobody() {
        let plan = plan(
            "routes:\n  - { from: 'zeromq:/a', to: 'ros2:/b', type: Image, qos: { depth: 3, deadline_ms: 40 } }\n",
        )
        .unwrap();
        let route = &plan.routes[0];
        assert!(!route.topic_spec(&route.to).match_peers);
        let shown = route.to_string();
        assert!(shown.ends_with("  qos reliable volatile keep_last(3) deadline 40ms"), "{shown}");
    }

    #[test]
    fn a_route_may_carry_another_type_at_its_source() {
        let plan = plan(
            "routes:\n  - { from: 'zeromq:/a', to: 'ros2:/b', type: Image, from_type: NativeObject }\n",
        )
        .unwrap();
        let route = &plan.routes[0];
        assert_eq!(route.topic_spec(&route.from).message_type, MessageType::NativeObject);
        assert_eq!(route.topic_spec(&route.to).message_type, MessageType::Image);
        let shown = route.to_string();
        assert!(
            shown.contains("  wrapyfi_msgs/msg/NativeObject as sensor_msgs/msg/Image  "),
            "{shown}"
        );
    }

    #[test]
    fn a_source_type_that_cannot_become_the_other_is_refused() {
        let route = |from_type: &str| {
            format!(
                "routes:\n  - {{ from: 'zeromq:/a', to: 'ros2:/b', type: Image, from_type: {from_type} }}\n"
            )
        };
        let text = plan(&route("AudioChunk")).unwrap_err().to_string();
        assert!(text.contains("bridge.yaml:2:"), "{text}");
        assert!(text.contains("from_type AudioChunk does not become type Image"), "{text}");
        let text = plan(&route("Imge")).unwrap_err().to_string();
        assert!(text.contains("\"Imge\" is no message type"), "{text}");
    }

    #[test]
    fn devices_of_a_route_go_before_the_defaults() {
        let plan = plan(
            "defaults: { devices: { load_torch_device: cpu, load_cupy_device: 1 } }\nroutes:\n  - { from: 'zeromq:/a', to: 'ros2:/b', type: NativeObject, devices: { map_torch_devices: { cpu: 'cuda:0' } } }\n  - { from: 'zeromq:/c', to: 'ros2:/d', type: NativeObject }\n",
        )
        .unwrap();
        let target = |route: usize, key, device| {
            plan.routes[route].plugins.devices().unwrap().target(key, device).map(str::to_owned)
        };
        assert_eq!(target(0, "PytorchTensor", "cpu").as_deref(), Some("cuda:0"));
        assert_eq!(target(0, "PytorchTensor", "cuda:0"), None);
        assert_eq!(target(0, "CuPyArray", "cuda:0").as_deref(), Some("cuda:1"));
        assert_eq!(target(1, "PytorchTensor", "cuda:0").as_deref(), Some("cpu"));
        let shown = plan.routes[0].to_string();
        assert!(shown.ends_with("devices torch cpu->cuda:0, cupy *->cuda:1"), "{shown}");
    }

    #[test]
    fn wrong_devices_are_refused_with_their_line() {
        let route = |devices: &str, message_type: &str| {
            plan(&format!(
                "routes:\n  - from: 'zeromq:/a'\n    to: 'ros2:/b'\n    type: {message_type}\n    devices:\n      {devices}\n"
            ))
            .unwrap_err()
            .to_string()
        };
        let text = route("load_toch_device: cpu", "NativeObject");
        assert!(text.starts_with("bridge.yaml:6:"), "{text}");
        assert!(text.contains("did you mean `load_torch_device`?"), "{text}");
        let text = route("load_torch_device: cdua:0", "NativeObject");
        assert!(text.starts_with("bridge.yaml:6:") && text.contains("no device"), "{text}");
        let text = route(
            "{ load_torch_device: 'cuda:0', map_torch_devices: { default: cpu } }",
            "NativeObject",
        );
        assert!(text.contains("default goes to cuda:0 and to cpu"), "{text}");
        let text = route("load_torch_device: cpu", "Image");
        assert!(text.contains("devices has no effect on Image"), "{text}");
        let text = plan("defaults:\n  devices: { load_cupy_device: cpu }\nroutes:\n  - { from: 'zeromq:/a', to: 'ros2:/b', type: Image }\n  - { from: 'zeromq:/c', to: 'ros2:/d', type: Image }\n")
            .unwrap_err()
            .to_string();
        assert!(text.starts_with("bridge.yaml:2:") && text.lines().count() == 1, "{text}");
        let text = route("load_torch_device: [cpu]", "NativeObject");
        assert!(text.contains("a device, for instance cuda:0"), "{text}");
    }

    #[test]
    fn every_fault_is_reported_at_once_with_its_line() {
        let error = plan(
            "routes:\n  - { from: 'zermoq:/a', to: 'ros2:/b', type: Imge }\n  - { from: '/a', to: 'ros2:/c', type: Image, queue_depth: 0 }\n  - { from: 'ros2:/(.*)', to: 'zeromq:/x', type: Image }\n  - { from: 'ros2:/a b', to: 'zeromq:/x', type: Image }\n",
        )
        .unwrap_err();
        let text = error.to_string();
        assert!(
            text.contains("bridge.yaml:2:") && text.contains("did you mean `zeromq`?"),
            "{text}"
        );
        assert!(text.contains("Imge"), "{text}");
        assert!(text.contains("bridge.yaml:3:") && text.contains("names no middleware"), "{text}");
        assert!(text.contains("queue_depth is 0"), "{text}");
        assert!(text.contains("pattern"), "{text}");
        assert!(text.contains(r#""ros2:/a b" is no topic name: blank at 2"#), "{text}");
    }

    #[test]
    fn duplicates_and_shared_destinations_are_refused() {
        let twice = "  - { from: 'zeromq:/a', to: 'ros2:/b', type: Image }\n";
        let text = plan(&format!("routes:\n{twice}{twice}")).unwrap_err().to_string();
        assert!(text.contains("stands already in line 2"), "{text}");
        let other = "  - { from: 'zeromq:/c', to: 'ros2:/b', type: Image }\n";
        let text = plan(&format!("routes:\n{twice}{other}")).unwrap_err().to_string();
        assert!(text.contains("merge: true"), "{text}");
        let merged = "routes:\n  - { from: 'zeromq:/a', to: 'ros2:/b', type: Image, merge: true }\n  - { from: 'zeromq:/c', to: 'ros2:/b', type: Image, merge: true }\n";
        assert_eq!(plan(merged).unwrap().routes.len(), 2);
        let to_itself = "routes:\n  - { from: 'ros2:/a', to: 'ros2:/a', type: Image }\n";
        assert!(plan(to_itself).unwrap_err().to_string().contains("loop"));
        assert!(plan("routes: []\n").unwrap_err().to_string().contains("no routes"));
    }
}
