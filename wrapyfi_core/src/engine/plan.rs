//! Configuration to routes: every name parsed, every conflict found before anything is opened.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use super::config::{Config, Defaults, OverflowConfig, RouteConfig, Spanned};
use super::config_devices::DevicesConfig;
use super::config_error::{ConfigError, Problem};
use super::config_qos::{QosConfig, QosOverride};
use super::conventions;
use super::plan_address::address;
use super::plan_options;
use super::plan_pattern::{self, PatternSpec};
use super::plan_service::{self, ServiceRouteSpec};
use super::stamping::StampSource;
use crate::Limits;
use crate::codec::is_convertible;
use crate::endpoint::{BridgeMark, EndpointAddress, Overflow, QueueSpec, TopicSpec};
use crate::plugin::{DeviceMaps, Plugins};
use crate::types::{DataType, Encoding, Map, MessageType};
use wrapyfi_interfaces::store::TypeStore;

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
    /// Coordinate frame that its messages get; the source's where there is none.
    pub frame_id: Option<String>,
    /// Time that its messages get.
    pub stamp: Option<StampSource>,
    /// Bounds on every message.
    pub limits: Limits,
    /// What reads and writes plug-in objects inside native objects.
    pub plugins: Plugins,
    /// Settings that only some middlewares have, by name.
    pub options: Map,
    /// Opens its source only while somebody wants what it carries.
    pub lazy: bool,
    /// Of a route that a pattern made: what its destination announces. Its source then passes over
    /// what came through the destination's middleware before.
    pub mark: Option<BridgeMark>,
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
            frame_id: None,
            stamp: None,
            limits: Limits::default(),
            plugins: Plugins::standard(),
            options: Map::default(),
            lazy: false,
            mark: None,
        }
    }

    /// What to open at `address`, one of the route's two ends.
    #[must_use]
    pub fn topic_spec(&self, address: &EndpointAddress) -> TopicSpec {
        let at_source = *address == self.from;
        let changed = if at_source { self.from_override } else { self.to_override };
        let mut spec = TopicSpec {
            topic: address.name.clone(),
            message_type: if at_source { self.from_type } else { self.message_type },
            qos: self.qos.qos(),
            match_peers: changed.follows || matches!(self.qos, QosConfig::Match(_)),
            pinned: changed.pinned,
            queue: self.queue,
            color_order: self.color_order,
            limits: self.limits,
            plugins: self.plugins.clone(),
            options: self.options.clone(),
            mark: self.mark.clone().filter(|_| !at_source),
            shun: self.mark.as_ref().filter(|_| at_source).map(|_| self.to.middleware.clone()),
        };
        if self.qos == QosConfig::default() {
            conventions::apply(&mut spec, address, at_source);
        }
        spec
    }
}

impl RouteSpec {
    /// What the route says of headers.
    pub(super) fn show_header(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(frame_id) = &self.frame_id {
            write!(f, "  frame_id {frame_id}")?;
        }
        self.stamp.map_or(Ok(()), |stamp| write!(f, "  stamp {stamp}"))
    }
}

impl fmt::Display for RouteSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} -> {}  ", self.from, self.to)?;
        if self.from_type != self.message_type {
            write!(f, "{} as ", self.from_type.label())?;
        }
        write!(f, "{}", self.message_type.label())?;
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
        if self.color_order != Encoding::Bgr8 {
            write!(f, "  encoding {}", self.color_order)?;
        }
        self.show_header(f)?;
        if let Some(devices) = self.plugins.devices() {
            write!(f, "  devices {devices}")?;
        }
        if self.lazy {
            f.write_str("  lazy")?;
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
    /// Settings that only it and few others have, as `options` of a route names them.
    pub options: &'a [&'a str],
}

/// The routes of a configuration, checked.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plan {
    /// Routes of topics, in the order of the file.
    pub routes: Vec<RouteSpec>,
    /// Routes of services, in the order of the file.
    pub services: Vec<ServiceRouteSpec>,
    /// Routes that are made while running, in the order of the file.
    pub patterns: Vec<PatternSpec>,
}

impl Plan {
    /// Names of the middlewares on which its routes have ends, each as often as it is named.
    pub fn middlewares(&self) -> impl Iterator<Item = &str> {
        let topics = self.routes.iter().flat_map(|route| [&route.from, &route.to]);
        let services = self.services.iter().flat_map(|route| [&route.offered, &route.service]);
        let patterns = self.patterns.iter();
        let patterns = patterns.flat_map(|it| [it.source_middleware(), it.to.middleware.as_str()]);
        topics.chain(services).map(|end| end.middleware.as_str()).chain(patterns)
    }

    /// True where an end of a route is on this middleware.
    #[must_use]
    pub fn uses(&self, middleware: &str) -> bool {
        self.middlewares().any(|name| name == middleware)
    }

    /// True where others connect to an end of a route on this middleware: at all but services that are only
    /// called there.
    #[must_use]
    pub fn is_reached_on(&self, middleware: &str) -> bool {
        let topics = self.routes.iter().flat_map(|route| [&route.from, &route.to]);
        let offered = self.services.iter().map(|route| &route.offered);
        topics.chain(offered).any(|end| end.middleware == middleware)
            || (!self.patterns.is_empty() && self.uses(middleware))
    }

    /// The largest message that a route takes, in bytes.
    #[must_use]
    pub fn largest_message(&self) -> usize {
        let topics = self.routes.iter().map(|route| route.limits.message_bytes);
        let services = self.services.iter().map(|route| route.limits.message_bytes);
        let patterns = self.patterns.iter().map(PatternSpec::largest_message);
        topics.chain(services).chain(patterns).max().unwrap_or(0)
    }

    /// Checks `config` against the middlewares that exist, and looks its types up in `types`; `file`
    /// is its name in errors.
    ///
    /// # Errors
    /// Every fault at once: unknown middlewares and types, bad names and numbers, routes that are
    /// given twice, destinations with two routes that do not say `merge: true`.
    pub fn new<E>(
        config: &Config<E>,
        middlewares: &[Available<'_>],
        types: &mut TypeStore,
        file: &str,
    ) -> Result<Self, ConfigError> {
        let mut problems = Vec::new();
        let mut routes: Vec<RouteSpec> = Vec::with_capacity(config.routes.len());
        let mut services: Vec<ServiceRouteSpec> = Vec::new();
        let mut offered: BTreeMap<EndpointAddress, u64> = BTreeMap::new();
        let (mut patterns, mut found_later) = (Vec::new(), BTreeMap::new());
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
            problems.extend(plan_pattern::misplaced(&entry.value));
            if plan_pattern::is_found_later(&entry.value) {
                let read = plan_pattern::read(
                    entry,
                    &config.defaults,
                    &default_devices,
                    middlewares,
                    types,
                );
                match read {
                    Ok(pattern) => {
                        if let Some(first) = found_later.insert(pattern.ends(), line) {
                            let text = format!("{} stands already in line {first}", pattern.ends());
                            problems.push(Problem::at(entry.referenced, text));
                        }
                        patterns.push(pattern);
                    }
                    Err(found) => problems.extend(found),
                }
                continue;
            }
            if plan_service::is_service(&entry.value) {
                match plan_service::read(entry, &config.defaults, middlewares, types) {
                    Ok(service) => {
                        let first = offered.insert(service.offered.clone(), line);
                        if let Some(first) = first {
                            let at = &service.offered;
                            let text = format!("line {first} already offers a service as {at}");
                            problems.push(Problem::at(entry.referenced, text));
                        }
                        services.push(service);
                    }
                    Err(found) => problems.extend(found),
                }
                continue;
            }
            let route =
                match route_spec(entry, &config.defaults, &default_devices, middlewares, types) {
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
            Ok(Self { routes, services, patterns })
        } else {
            Err(ConfigError { file: file.to_owned(), problems })
        }
    }
}

pub(super) fn route_spec(
    entry: &Spanned<RouteConfig>,
    defaults: &Defaults,
    default_devices: &DeviceMaps,
    middlewares: &[Available<'_>],
    types: &mut TypeStore,
) -> Result<RouteSpec, Vec<Problem>> {
    let config = &entry.value;
    let mut problems = Vec::new();
    let mut end = |key: &str, written: &Option<Spanned<String>>| match written {
        Some(text) => address(text, middlewares).map_err(|problem| problems.push(problem)).ok(),
        None => {
            let text =
                format!("key `{key}` is missing: a route has from and to, or service and as");
            problems.push(Problem::at(entry.referenced, text));
            None
        }
    };
    let (from, to) = (end("from", &config.from), end("to", &config.to));
    if let Some(timeout) = &config.timeout_ms {
        let text = "timeout_ms has no effect on topics: only services are answered".to_owned();
        problems.push(Problem::at(timeout.referenced, text));
    }
    let mut parse_type = |text: &Spanned<String>| {
        let parsed = MessageType::resolve(&text.value, types);
        parsed.map_err(|error| problems.push(Problem::at(text.referenced, error.to_string()))).ok()
    };
    // Without a type the entry is read elsewhere.
    let message_type = config.message_type.as_ref().and_then(&mut parse_type);
    let from_type = config.from_type.as_ref().map_or(message_type, parse_type);
    let type_text = config.message_type.as_ref().map_or("", |text| text.value.as_str());
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
    for (key, place) in [
        ("frame_id", config.frame_id.as_ref().map(|it| it.referenced)),
        ("stamp", config.stamp.as_ref().map(|it| it.referenced)),
    ] {
        if let (Some(place), Some(to)) = (place, message_type)
            && !to.has_header()
        {
            let text = format!("{key} has no effect: {} has no header", to.label());
            problems.push(Problem::at(place, text));
        }
    }
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
            "devices has no effect on {type_text}: only native objects hold tensors with a device"
        );
        problems.push(Problem::at(own.referenced, text));
    }
    let options = match (&from, &to) {
        (Some(from), Some(to)) => plan_options::read(&config.options, [from, to], middlewares)
            .map_err(|found| problems.extend(found))
            .unwrap_or_default(),
        _ => Map::default(),
    };
    match (from, to, message_type.zip(from_type)) {
        (Some(from), Some(to), Some((message_type, from_type))) if problems.is_empty() => {
            if from == to {
                let text = format!("route from {from} to itself: it would loop");
                return Err(vec![Problem::at(entry.referenced, text)]);
            }
            // Between two ROS a String stays what it is; written as JSON, a plain text would get quotes.
            let is_ros = |end: &EndpointAddress| matches!(end.middleware.as_str(), "ros" | "ros2");
            let (message_type, from_type) = match (message_type, from_type) {
                (MessageType::StringJson, MessageType::StringJson)
                    if is_ros(&from) && is_ros(&to) =>
                {
                    (MessageType::Text, MessageType::Text)
                }
                types => types,
            };
            let mut route = RouteSpec::new(from, to, message_type);
            route.from_type = from_type;
            if let Some(name) = &config.name {
                route.name.clone_from(name);
            }
            route.qos = config.qos.unwrap_or_default();
            route.queue = QueueSpec { depth, overflow };
            route.lazy = config.lazy.as_ref().is_some_and(|lazy| lazy.value);
            route.max_rate_hz = config.max_rate_hz.as_ref().map(|rate| rate.value);
            route.color_order = color_order;
            route.frame_id = config.frame_id.as_ref().map(|frame_id| frame_id.value.clone());
            route.stamp = config.stamp.as_ref().map(|stamp| stamp.value);
            route.limits.message_bytes = mib.saturating_mul(Limits::MIB);
            let maps = own_devices.unwrap_or_default().or_from(default_devices);
            route.plugins = route.plugins.with_devices(maps);
            route.options = options;
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

#[cfg(test)]
#[path = "plan_tests.rs"]
mod tests;
