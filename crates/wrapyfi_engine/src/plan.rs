//! Configuration to routes: every name parsed, every conflict found before anything is opened.

use std::borrow::Cow;
use std::collections::BTreeMap;

use super::config::{Config, RouteConfig};
use super::plan_entry::Reader;
use super::route::{BOARD_OPTION, Route, RouteKey};
use wrapyfi_endpoint::config::{ConfigError, Problem, Spanned};
use wrapyfi_endpoint::driver::Available;
use wrapyfi_endpoint::{EndpointAddress, Interaction};
use wrapyfi_interfaces::store::TypeStore;

/// Type of the states of a control board.
const BOARD_STATES: &str = "sensor_msgs/msg/JointState";
/// Type of the movements of a control board, where the entry has none.
const BOARD_MOVEMENTS: &str = "trajectory_msgs/msg/JointTrajectory";

/// The routes of a configuration, checked.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_engine as engine; }
/// use std::collections::BTreeMap;
/// use wrapyfi_core::engine::{Available, Config, Plan};
/// use wrapyfi_interfaces::store::TypeStore;
/// let text = "routes:\n  - from: zeromq:/camera\n    to: ros2:/camera\n    type: Image\n";
/// let config: Config<BTreeMap<String, String>> = Config::from_yaml(text, "bridge.yaml")?;
/// let middlewares = ["zeromq", "ros2"].map(|name| Available { name, ..Available::default() });
/// let plan = Plan::new(&config, &middlewares, &mut TypeStore::generated(), "bridge.yaml")?;
/// assert_eq!(plan.routes[0].to.to_string(), "ros2:/camera");
/// assert!(plan.uses("zeromq") && !plan.uses("yarp"));
/// # Ok::<(), wrapyfi_engine::ConfigError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plan {
    /// Routes and patterns, in the order of the file.
    pub routes: Vec<Route>,
}

impl Plan {
    /// Names of the middlewares on which routes have ends, each as often as it is named.
    pub fn middlewares(&self) -> impl Iterator<Item = &str> {
        let ends = self.routes.iter().flat_map(|route| [&route.from, &route.to]);
        ends.map(|end| end.middleware.as_str())
    }

    /// True where an end of a route is on this middleware.
    pub fn uses(&self, middleware: &str) -> bool {
        self.middlewares().any(|name| name == middleware)
    }

    /// True where other programs connect to an end of a route on this middleware, as they do unless
    /// it only calls services.
    pub fn is_reached_on(&self, middleware: &str) -> bool {
        self.routes.iter().any(|route| {
            let is_called = route.interaction() != Interaction::Topic && route.is_whole();
            route.to.middleware == middleware || (route.from.middleware == middleware && !is_called)
        })
    }

    /// True where a service has an end on this middleware, or an action, which is a function where there are none.
    pub fn has_services_on(&self, middleware: &str) -> bool {
        let called = self.routes.iter().filter(|it| it.interaction() != Interaction::Topic);
        called.flat_map(|it| [&it.from, &it.to]).any(|end| end.middleware == middleware)
    }

    /// Size of the largest message of a route with an end on this middleware, in bytes.
    pub fn largest_message_on(&self, middleware: &str) -> usize {
        let on =
            |route: &&Route| [&route.from, &route.to].iter().any(|it| it.middleware == middleware);
        let bytes = self.routes.iter().filter(on).map(|route| route.policy.limits.message_bytes);
        bytes.max().unwrap_or(0)
    }

    /// As [`Plan::read`]; `file` is the name of the configuration in errors.
    ///
    /// # Errors
    /// When there are faults, all of them.
    pub fn new<E>(
        config: &Config<E>,
        middlewares: &[Available<'_>],
        types: &mut TypeStore,
        file: &str,
    ) -> Result<Self, ConfigError> {
        let (plan, problems) = Self::read(config, middlewares, types);
        match problems.is_empty() {
            true => Ok(plan),
            false => Err(ConfigError { file: file.to_owned(), problems }),
        }
    }

    /// Checks `config` against the middlewares that exist, and looks its types up in `types`. Beside the routes whose
    /// ends can be read are the faults, all of them: unknown middlewares and types, bad names and numbers, routes that
    /// are given twice, destinations with two routes without `merge: true`.
    #[doc(hidden)]
    pub fn read<E>(
        config: &Config<E>,
        middlewares: &[Available<'_>],
        types: &mut TypeStore,
    ) -> (Self, Vec<Problem>) {
        let mut reader = Reader::new(config, middlewares, types);
        let mut routes: Vec<Route> = Vec::with_capacity(config.routes.len());
        let mut seen: BTreeMap<RouteKey, u64> = BTreeMap::new();
        let mut into: BTreeMap<(Interaction, EndpointAddress), (u64, bool)> = BTreeMap::new();
        let mut names = BTreeMap::new();
        if config.routes.is_empty() {
            let message = "no routes: nothing to do".to_owned();
            reader.problems.push(Problem { position: None, message });
        }
        let entries = config.routes.iter().flat_map(board_routes);
        for entry in entries {
            let entry = &*entry;
            let Some(route) = reader.read(entry) else { continue };
            let (line, key) = (entry.referenced.line(), route.key());
            let place = (key.interaction, key.to.clone());
            let merges = entry.value.merge;
            let taken = into.get(&place).filter(|(_, others)| !(*others && merges));
            let fault = match (seen.insert(key, line), taken) {
                (Some(first), _) => {
                    Some(format!("route {} stands already in {}", route.ends(), at(first)))
                }
                (None, Some((first, _))) if !route.is_many() => Some(match route.interaction() {
                    Interaction::Topic => format!(
                        "{} already routes to {}; write merge: true on both to mix them",
                        at(*first),
                        route.to
                    ),
                    called => format!("{} already offers a {called} as {}", at(*first), route.to),
                }),
                _ => None,
            };
            let named = entry.value.name.clone().and_then(|name| names.insert(name, line));
            let named = named.map(|first| {
                format!("{} already has the name {}; give each its own", at(first), route.name)
            });
            let faults = fault.into_iter().chain(named);
            reader.problems.extend(faults.map(|text| Problem::at(entry.referenced, text)));
            if !route.is_many() {
                into.entry(place).or_insert((line, merges));
            }
            routes.push(route);
        }
        (Self { routes }, reader.problems)
    }
}

/// The routes that an entry stands for: itself, or the two of a control board.
fn board_routes(entry: &Spanned<RouteConfig>) -> Vec<Cow<'_, Spanned<RouteConfig>>> {
    let Some(board) = &entry.value.board else { return vec![Cow::Borrowed(entry)] };
    let at_board = |value: &str| Spanned::new(value.to_owned(), board.referenced, board.defined);
    let mut options = entry.value.options.clone();
    options.insert(BOARD_OPTION.into(), Spanned::new(true.into(), board.referenced, board.defined));
    let named = |what: &str| entry.value.name.as_ref().map(|name| format!("{name} {what}"));
    let states = RouteConfig {
        to: Some(board.clone()),
        message_type: Some(at_board(BOARD_STATES)),
        name: named("states"),
        options: options.clone(),
        ..entry.value.clone()
    };
    let movements = RouteConfig {
        from: Some(board.clone()),
        message_type: entry.value.message_type.clone().or_else(|| Some(at_board(BOARD_MOVEMENTS))),
        name: named("movements"),
        options,
        ..entry.value.clone()
    };
    let spanned = |route| Cow::Owned(Spanned::new(route, entry.referenced, entry.defined));
    [states, movements].map(spanned).into()
}

/// Place of an entry in words, by its line; one that a running bridge was told to add has none.
fn at(line: u64) -> String {
    if line == 0 { "an entry that was added".to_owned() } else { format!("line {line}") }
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::super::config_qos::QosConfig;
    use super::super::route::Types;
    use super::*;
    use wrapyfi_data::Limits;
    use wrapyfi_data::types::{Encoding, MessageType};
    use wrapyfi_endpoint::{Conventions, QosPreset, TopicSpec};

    #[derive(Debug, Default, Deserialize)]
    struct NoEndpoints {}

    fn plan(text: &str) -> Result<Plan, ConfigError> {
        let config: Config<NoEndpoints> = Config::from_yaml(text, "bridge.yaml")?;
        let no_blanks = |topic: &str| match topic.find(' ') {
            Some(at) => Err(format!("blank at {at}")),
            None => Ok(()),
        };
        let known = |name| Available {
            name,
            check_topic: &no_blanks,
            options: &["carrier"],
            check_option: &|_, _| Ok(()),
            conventions: Conventions { has_text_type: name == "ros2", ..Conventions::NONE },
            ..Available::default()
        };
        let mut types = TypeStore::generated();
        Plan::new(&config, &[known("zeromq"), known("ros2")], &mut types, "bridge.yaml")
    }

    #[test]
    fn a_plan_prints_what_will_run() {
        let plan = plan(
        "defaults: { queue_depth: 3, max_message_mib: 8 }\nroutes:\n  - { from: 'zeromq:/a', to: 'ros2:/b', type: Image, encoding: rgb8, max_rate_hz: 15 }\n",
    )
    .unwrap();
        let route = &plan.routes[0];
        assert_eq!(route.policy.limits.message_bytes, 8 * Limits::MIB);
        assert_eq!(route.topic_spec(&route.from).color_order, Encoding::Rgb8);
        assert_eq!(
            route.to_string(),
            "zeromq:/a -> ros2:/b  topic  sensor_msgs/msg/Image  queue 3 drop_oldest  at most 15 Hz  \
         encoding rgb8"
        );
        assert!(route.topic_spec(&route.to).match_peers);
    }

    #[test]
    fn a_board_is_a_route_in_each_direction() {
        let board = "board: 'zeromq:/arm', name: arm, options: { carrier: tcp }";
        let read =
            plan(&format!("routes:\n  - {{ {board}, from: 'ros2:/states', to: 'ros2:/go' }}\n"));
        let fault = read.unwrap_err().to_string();
        assert!(fault.contains("bridge.yaml:2:") && fault.contains("board"), "{fault}");
        let fault = plan(&format!("routes:\n  - {{ {board}, from: 'ros2:/states' }}\n"));
        assert!(fault.unwrap_err().to_string().contains("`to` is missing"));
    }

    #[test]
    fn what_headers_get_is_shown_and_only_where_there_are_headers() {
        let route = |rest: &str| {
            plan(&format!("routes:\n  - {{ from: 'zeromq:/a', to: 'ros2:/b', {rest} }}\n"))
        };
        let shown = |rest: &str| route(rest).unwrap().routes[0].to_string();
        let image = shown("type: Image, frame_id: left_eye, stamp: ros_time");
        assert!(image.ends_with("  frame_id left_eye  stamp ros_time"), "{image}");
        let joints = shown("type: sensor_msgs/msg/JointState, stamp: arrival");
        assert!(joints.ends_with("  stamp arrival"), "{joints}");
        let many = plan("routes:\n  - { from: 'zeromq:/(.*)', to: 'ros2:/$1', stamp: ros_time }\n")
            .unwrap();
        let shown = many.routes[0].to_string();
        assert!(shown.contains("type learned  stamp ros_time"), "{shown}");
        for (rest, wanted) in [
            ("type: Text, frame_id: x", "frame_id has no effect on Text: it has no header"),
            (
                "type: geometry_msgs/msg/Twist, stamp: source",
                "stamp has no effect on geometry_msgs",
            ),
            ("type: Image, stamp: now", "source, ros_time, arrival"),
        ] {
            let error = route(rest).unwrap_err().to_string();
            assert!(error.contains(wanted) || error.contains("`ros_time`"), "{error}");
        }
        let service =
            "routes:\n  - { service: 'zeromq:/a', as: 'ros2:/b', type: Image, stamp: source }\n";
        let error = plan(service).unwrap_err().to_string();
        assert!(error.contains("stamp has no effect on a service"), "{error}");
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
            plan.routes[route]
                .policy
                .plugins
                .devices()
                .unwrap()
                .target(key, device)
                .map(str::to_owned)
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
        assert!(text.contains("devices has no effect on sensor_msgs/msg/Image"), "{text}");
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
        "routes:\n  - { from: 'zermoq:/a', to: 'ros2:/b', type: Imge }\n  - { from: '/a', to: 'ros2:/c', type: Image, queue_depth: 0 }\n  - { from: 'ros2:/x', to: 'zeromq:/(.*)', type: Image }\n  - { from: 'ros2:/a b', to: 'zeromq:/x', type: Image }\n",
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
        let named = "routes:\n  - { name: left, from: 'zeromq:/a', to: 'ros2:/b', type: Image }\n  - { name: left, from: 'zeromq:/c', to: 'ros2:/d', type: Image }\n";
        let text = plan(named).unwrap_err().to_string();
        assert!(text.contains(":3:5: line 2 already has the name left"), "{text}");
        let to_itself = "routes:\n  - { from: 'ros2:/a', to: 'ros2:/a', type: Image }\n";
        assert!(plan(to_itself).unwrap_err().to_string().contains("loop"));
        assert!(plan("routes: []\n").unwrap_err().to_string().contains("no routes"));
    }

    #[test]
    fn text_between_two_ros_stays_as_it_is() {
        let types = |route: &str| {
            let plan = plan(&format!("routes:\n  - {{ {route} }}\n")).unwrap();
            plan.routes[0].message_types()
        };
        let string = "type: std_msgs/msg/String";
        let text = MessageType::Text.into();
        assert_eq!(types(&format!("from: 'ros2:/a', to: 'ros2:/b', {string}")), text);
        let json = MessageType::StringJson.into();
        assert_eq!(types(&format!("from: 'ros2:/a', to: 'zeromq:/b', {string}")), json);
        // Route an object of on the way.
        let read = types(
            "from: 'ros2:/a', to: 'ros2:/b', from_type: std_msgs/msg/String, type: NativeObject",
        );
        assert_eq!(read, Types { from: MessageType::StringJson, to: MessageType::NativeObject });
    }

    #[test]
    fn many_lines_of_a_log_wait_and_what_is_written_goes_before_conventions() {
        let log = "rcl_interfaces/msg/Log";
        let resolved = TypeStore::generated().resolve_name(log).unwrap();
        let message_type = MessageType::Ros(wrapyfi_data::types::RosType::new(&resolved).unwrap());
        let mut route =
            Route::topic("a:/x".parse().unwrap(), "b:/x".parse().unwrap(), message_type);
        assert_eq!(route.topic_spec(&route.from).queue.depth, 1000);
        let depth = |spec: &mut TopicSpec, _| spec.queue.depth = 7;
        assert_eq!(route.topic_spec_by(&route.to, depth).queue.depth, 7);
        route.policy.qos = QosConfig::Fixed(QosPreset::SensorData.into());
        assert_eq!(route.topic_spec_by(&route.to, depth).queue.depth, 1000);
    }

    #[test]
    fn a_wrong_default_is_told_once_whatever_the_number_of_routes() {
        let routes: String = (0..5)
            .map(|n| format!("  - {{ from: 'zeromq:/{n}', to: 'ros2:/{n}', type: Image }}\n"))
            .collect();
        let text = format!("defaults: {{ queue_depth: 0 }}\nroutes:\n{routes}");
        let text = plan(&text).unwrap_err().to_string();
        assert_eq!(text.matches("queue_depth is 0").count(), 1, "{text}");
        assert!(text.contains("bridge.yaml:1:"), "{text}");
    }
}
