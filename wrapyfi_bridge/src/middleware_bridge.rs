//! Configurations that are built in: all of one middleware, into ROS 2 and back.
//!
//! ```text
//!   ros2 run wrapyfi_bridge ros1_bridge ─▶ MiddlewareBridge::called ─▶ yaml ─▶ load ─▶ as a file's
//! ```

use std::fmt::Write as _;

use wrapyfi_endpoint::driver::{WholeBridge, WholeRoute};
use wrapyfi_endpoint::pattern::{NamePattern, bare};
use wrapyfi_endpoint::{EndpointAddress, Interaction};
use wrapyfi_engine::option_fits;
use wrapyfi_node::NodeName;

use crate::middlewares::{available, whole_bridges};
use crate::node::GRAPH;

/// Executable that bridges all of one middleware.
#[derive(Debug, Clone, Copy)]
pub struct MiddlewareBridge {
    /// Name of the middleware in addresses.
    pub middleware: &'static str,
    whole: WholeBridge,
}

/// Names that are bridged, and settings of their routes.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Selection {
    /// Names that are meant, as regular expressions; all where there are none.
    pub allow: Vec<String>,
    /// Names that are not.
    pub deny: Vec<String>,
    /// Put before names on the ROS 2 side: `/lab`.
    pub prefix: String,
    /// Carries what is hidden, of every node, or of the system, too: `default_deny: false`.
    pub has_hidden: bool,
    /// Time that a call may take, in milliseconds; that of every route where there is none.
    pub service_timeout_ms: Option<u64>,
    /// Options of the routes that may have them, each `NAME=VALUE`.
    pub options: Vec<String>,
    /// Switches of the middleware that are on.
    pub switches: Vec<&'static str>,
}

impl MiddlewareBridge {
    /// The one whose executable has this name.
    pub fn called(executable: &str) -> Option<Self> {
        let mut all = whole_bridges().into_iter();
        let (middleware, whole) = all.find(|(_, whole)| whole.executable == executable)?;
        Some(Self { middleware, whole })
    }

    /// Name of the executable, and of its node.
    pub fn node(self) -> &'static str {
        self.whole.executable
    }

    /// Sentence about the executable, for its help.
    pub fn about(self) -> String {
        format!("Bridges all of {} into ROS 2 and back, as a ROS 2 node.", self.whole.title)
    }

    /// Parameters that are on or off beside those that each such node has, with their descriptions.
    pub fn switches(self) -> &'static [(&'static str, &'static str)] {
        self.whole.switches
    }

    /// The routes, as a configuration has them.
    ///
    /// # Errors
    /// When the prefix cannot begin a name of ROS 2, or an entry of `allow` or `deny` is no pattern.
    pub fn yaml(self, selection: &Selection) -> Result<String, String> {
        let Selection { allow, deny, prefix, has_hidden, service_timeout_ms, options, switches } =
            selection;
        let prefix = prefix.trim_matches('/');
        if !prefix.is_empty() {
            NodeName::check_topic(&format!("/{prefix}"))
                .map_err(|fault| format!("parameter prefix is {prefix:?}: {fault}"))?;
        }
        for (key, names) in [("allow", allow), ("deny", deny)] {
            for name in names {
                NamePattern::new(name)
                    .map_err(|fault| format!("parameter {key}: {name:?} {fault}"))?;
            }
        }
        let routes = (self.whole.routes)(switches, *has_hidden);
        let mut named = Vec::new();
        for option in options {
            let (name, value) = option.split_once('=').ok_or_else(|| {
                format!("parameter options: {option:?} is no setting: write it as introspection=metadata")
            })?;
            if !routes.iter().any(|route| self.takes(route, name)) {
                let executable = self.whole.executable;
                return Err(format!(
                    "parameter options: no route of {executable} has an option {name}; those of a config_file may"
                ));
            }
            // JSON is YAML; anything else is text.
            let is_json = serde_json::from_str::<serde_json::Value>(value).is_ok();
            named.push((name, if is_json { value.to_owned() } else { quoted(value) }));
        }
        let before = if prefix.is_empty() { String::new() } else { format!("{prefix}/") };
        let mut text = "routes:\n".to_owned();
        for route in routes {
            let taken = named.iter().filter(|(name, _)| self.takes(&route, name));
            let taken = taken.map(|(name, value)| format!("{name}: {value}"));
            let taken = taken.collect::<Vec<_>>().join(", ");
            let WholeRoute { interaction, comes_back, there, here, keys, is_fixed } = route;
            let [from, to] = interaction.keys();
            let prefix = if is_fixed { "" } else { before.as_str() };
            let (mut source, mut target) = (there.to_owned(), format!("ros2:/{prefix}{here}"));
            if comes_back {
                std::mem::swap(&mut source, &mut target);
            }
            // Names on the ROS 2 side have the prefix.
            let before = if comes_back { before.as_str() } else { "" };
            let list = |names: &[String]| {
                let names = names.iter().map(|name| match before {
                    "" => quoted(name),
                    _ => quoted(&format!("{before}(?:{})", bare(name))),
                });
                names.collect::<Vec<_>>().join(", ")
            };
            let _infallible =
                write!(text, "  - {{ {from}: {}, {to}: {}", quoted(&source), quoted(&target));
            for (key, names) in [("allow", allow), ("deny", deny)] {
                if !names.is_empty() && !is_fixed {
                    let _infallible = write!(text, ", {key}: [{}]", list(names));
                }
            }
            if *has_hidden && !is_fixed {
                text.push_str(", default_deny: false");
            }
            if let Some(timeout_ms) =
                service_timeout_ms.filter(|_| interaction == Interaction::Service)
            {
                let _infallible = write!(text, ", timeout_ms: {timeout_ms}");
            }
            if !taken.is_empty() {
                let _infallible = write!(text, ", options: {{ {taken} }}");
            }
            let _infallible = writeln!(text, "{keys} }}");
        }
        Ok(text)
    }

    /// True for a route that may have an option.
    fn takes(self, route: &WholeRoute, option: &str) -> bool {
        let end = |middleware: &str| EndpointAddress {
            middleware: middleware.to_owned(),
            ..EndpointAddress::default()
        };
        let [there, here] = [end(self.middleware), end(GRAPH)];
        let ends = if route.comes_back { [&here, &there] } else { [&there, &here] };
        option_fits(option, ends, &available(), route.interaction)
    }
}

/// Text as YAML has it between double quotes, which JSON has as well.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

#[cfg(test)]
mod tests {
    use wrapyfi_engine::Route;

    use super::*;
    use crate::middlewares::{Loaded, load_text};

    fn bridge(executable: &str) -> MiddlewareBridge {
        MiddlewareBridge::called(executable).unwrap()
    }

    fn targets(bridge: MiddlewareBridge, selection: &Selection, name: &str) -> Vec<String> {
        let yaml = bridge.yaml(selection).unwrap();
        let Loaded { plan, .. } = load_text(&yaml, bridge.node()).unwrap();
        let all = plan.routes.iter().filter_map(|pattern| pattern.target(name));
        all.map(|to| to.to_string()).collect()
    }

    #[test]
    fn every_built_in_configuration_is_one() {
        let all = Selection::default();
        let ros1 = targets(bridge("ros1_bridge"), &all, "/chatter");
        assert_eq!(ros1, ["ros2:/chatter", "ros:/chatter"].repeat(3), "topic, service, action");
        let yarp = targets(bridge("yarp_bridge"), &all, "/icub/head/state:o");
        assert_eq!(yarp.first().map(String::as_str), Some("ros2:/icub/head/state/o"));
        for (name, wanted) in [
            ("/skin/0/out", "ros2:/skin/_0/out"),
            ("/x/1:o", "ros2:/x/_1/o"),
            ("/my-module/out", "ros2:/my_module/out"),
            ("/rs.d435/info", "ros2:/rs_d435/info"),
        ] {
            let made = targets(bridge("yarp_bridge"), &all, name);
            assert_eq!(made.first().map(String::as_str), Some(wanted));
        }
        let first = targets(bridge("ros1_bridge"), &all, "/robot-1/1st");
        assert_eq!(first.first().map(String::as_str), Some("ros2:/robot_1/_1st"));
        assert_eq!(targets(bridge("zeromq_bridge"), &all, "/x"), ["ros2:/x", "zeromq:/x"]);
        assert!(targets(bridge("ros1_bridge"), &all, "/a/_hidden").is_empty());
    }

    #[test]
    fn clock_time_out_and_what_is_denied_are_as_wished() {
        let wished = Selection {
            has_hidden: true,
            service_timeout_ms: Some(1234),
            switches: vec!["clock"],
            ..Selection::default()
        };
        let yaml = bridge("ros1_bridge").yaml(&wished).unwrap();
        let Loaded { plan, .. } = load_text(&yaml, "test").unwrap();
        let clock = plan.routes.iter().find(|route| route.is_whole()).unwrap();
        assert_eq!(clock.message_types().to.ros_type(), "rosgraph_msgs/msg/Clock");
        assert_eq!(targets(bridge("ros1_bridge"), &wished, "/a/_hidden").len(), 6);
        let services =
            plan.routes.iter().filter(|route| route.interaction() == Interaction::Service);
        let timeout = |route: &Route| route.policy.answer_within().as_millis();
        assert_eq!(services.map(timeout).collect::<Vec<_>>(), [1234, 1234]);
        assert!(!bridge("ros1_bridge").yaml(&Selection::default()).unwrap().contains("clock"));
    }

    /// Each stands where it has an effect, and nowhere else.
    #[test]
    fn options_are_those_of_the_routes_that_have_them() {
        let read = |options: &[&str]| Selection {
            options: options.iter().map(|option| (*option).to_owned()).collect(),
            ..Selection::default()
        };
        let wished = read(&["introspection=metadata", "from_peers=[\"/robot/*\"]"]);
        let yaml = bridge("ros1_bridge").yaml(&wished).unwrap();
        let Loaded { plan, .. } = load_text(&yaml, "test").unwrap();
        let has = |route: &Route, option| route.policy.options.get(option).is_some();
        for route in &plan.routes {
            let is_topic = route.interaction() == Interaction::Topic;
            assert_eq!(has(route, "introspection"), !is_topic, "{route}");
            let is_from_ros1 = route.from.middleware == "ros";
            assert_eq!(has(route, "from_peers"), is_topic && is_from_ros1, "{route}");
        }
        let refused = |options: &[&str]| bridge("ros1_bridge").yaml(&read(options)).unwrap_err();
        assert!(
            refused(&["carrier=udp"]).contains("no route of ros1_bridge has an option carrier")
        );
        assert!(refused(&["introspection"]).contains("write it as introspection=metadata"));
        let wrong = bridge("ros1_bridge").yaml(&read(&["introspection=all"])).unwrap();
        let wrong = load_text(&wrong, "test").unwrap_err().to_string();
        assert!(wrong.contains("option introspection must be metadata or contents"), "{wrong}");
    }

    #[test]
    fn yarp_carries_the_network_clock_and_all_joints_to_one_topic_where_that_is_wished() {
        let first = |selection: &Selection, name: &str, count: usize| {
            let all = targets(bridge("yarp_bridge"), selection, name);
            all.into_iter().take(count).collect::<Vec<_>>()
        };
        let all = Selection::default();
        assert_eq!(first(&all, "/clock", 2), ["ros2:/clock", "yarp:/clock"]);
        let prefixed = Selection { prefix: "sim".into(), ..Selection::default() };
        assert_eq!(first(&prefixed, "/clock", 1), ["ros2:/sim/clock"]);
        assert_eq!(first(&prefixed, "/sim/clock", 1), ["yarp:/clock"]);
        let denied = Selection { deny: vec!["clock".into()], ..Selection::default() };
        assert!(targets(bridge("yarp_bridge"), &denied, "/clock").is_empty());
        let wished = Selection { switches: vec!["joint_states"], ..Selection::default() };
        for port in ["/icub/head/state:o", "/state:o"] {
            assert!(first(&wished, port, 2).contains(&"ros2:/joint_states".to_owned()), "{port}");
        }
    }

    #[test]
    fn a_prefix_is_on_the_ros_2_side_only() {
        let selection = Selection {
            allow: vec!["/cam/.*".into()],
            deny: vec![".*raw\"".into()],
            prefix: "/lab/".into(),
            ..Selection::default()
        };
        assert_eq!(
            targets(bridge("zeromq_bridge"), &selection, "/cam/left"),
            ["ros2:/lab/cam/left"]
        );
        assert_eq!(
            targets(bridge("zeromq_bridge"), &selection, "/lab/cam/left"),
            ["zeromq:/cam/left"]
        );
        assert!(targets(bridge("zeromq_bridge"), &selection, "/other").is_empty());
        let wrong = Selection { prefix: "a b".into(), ..Selection::default() };
        assert!(bridge("ros1_bridge").yaml(&wrong).unwrap_err().contains("parameter prefix"));
        let wrong = Selection { deny: vec!["*".into()], ..Selection::default() };
        let told = bridge("ros1_bridge").yaml(&wrong).unwrap_err();
        assert!(told.starts_with("parameter deny: \"*\"") && told.lines().count() == 1, "{told}");
    }
}
