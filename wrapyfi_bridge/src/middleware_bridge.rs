//! Configurations that are built in: all of one middleware, into ROS 2 and back.
//!
//! ```text
//!   ros2 run wrapyfi_bridge ros1_bridge ─▶ MiddlewareBridge::Ros1.yaml() ─▶ load ─▶ as a file's
//! ```

use std::fmt::Write as _;

use wrapyfi_endpoint::pattern::{NamePattern, bare};
use wrapyfi_node::NodeName;

/// The time of a simulator. Its name is the same for every node, wherever that is.
const CLOCK: &str =
    "  - { from: \"ros:/clock\", to: \"ros2:/clock\", type: rosgraph_msgs/msg/Clock }\n";

/// Executable that bridges all of one middleware.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MiddlewareBridge {
    /// ROS 1: the executable `ros1_bridge`.
    Ros1,
    /// YARP: `yarp_bridge`.
    Yarp,
    /// ZeroMQ: `zeromq_bridge`.
    ZeroMq,
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
    /// Carries `/clock` from ROS 1.
    pub clock: bool,
    /// Carries the joints of all control boards of YARP to `/joint_states`, too.
    pub joint_states: bool,
}

impl MiddlewareBridge {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Ros1, Self::Yarp, Self::ZeroMq];

    /// Executable, name in addresses, and name in words.
    const fn names(self) -> [&'static str; 3] {
        match self {
            Self::Ros1 => ["ros1_bridge", "ros", "ROS 1"],
            Self::Yarp => ["yarp_bridge", "yarp", "YARP"],
            Self::ZeroMq => ["zeromq_bridge", "zeromq", "ZeroMQ"],
        }
    }

    /// Name of the executable, and of its node.
    pub fn node(self) -> &'static str {
        let [node, ..] = self.names();
        node
    }

    /// Sentence about the executable, for its help.
    pub fn about(self) -> String {
        let [.., name] = self.names();
        format!("Bridges all of {name} into ROS 2 and back, as a ROS 2 node.")
    }

    /// Name of the middleware in addresses.
    pub fn middleware(self) -> &'static str {
        let [_, middleware, _] = self.names();
        middleware
    }

    /// The routes, as a configuration has them.
    ///
    /// # Errors
    /// When the prefix cannot begin a name of ROS 2, or an entry of `allow` or `deny` is no pattern.
    pub fn yaml(self, selection: &Selection) -> Result<String, String> {
        let Selection { allow, deny, prefix, has_hidden, service_timeout_ms, clock, joint_states } =
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
        let before = if prefix.is_empty() { String::new() } else { format!("{prefix}/") };
        let into = |from: &str, to: &str| (from.to_owned(), format!("ros2:/{before}{to}"));
        let back = |to: &str| (format!("ros2:/{before}(.*)"), to.to_owned());
        let mut text = "routes:\n".to_owned();
        let mut add =
            |(source, target): (String, String), is_service: bool, comes_back: bool, more: &str| {
                let (from, to) = if is_service { ("service", "as") } else { ("from", "to") };
                // Names on the ROS 2 side have the prefix.
                let before = if comes_back { before.as_str() } else { "" };
                let list = |names: &[String]| {
                    let names = names.iter().map(|name| match before {
                        "" => quoted(name),
                        _ => quoted(&format!("{before}(?:{})", bare(name))),
                    });
                    names.collect::<Vec<_>>().join(", ")
                };
                let (source, target) = (quoted(&source), quoted(&target));
                let _infallible = write!(text, "  - {{ {from}: {source}, {to}: {target}");
                for (key, names) in [("allow", allow), ("deny", deny)] {
                    if !names.is_empty() {
                        let _infallible = write!(text, ", {key}: [{}]", list(names));
                    }
                }
                if *has_hidden {
                    text.push_str(", default_deny: false");
                }
                if let Some(timeout_ms) = service_timeout_ms.filter(|_| is_service) {
                    let _infallible = write!(text, ", timeout_ms: {timeout_ms}");
                }
                let _infallible = writeln!(text, "{more} }}");
            };
        match self {
            Self::Ros1 => {
                for is_service in [false, true] {
                    add(into("ros:/(.*)", "$1"), is_service, false, "");
                    add(back("ros:/$1"), is_service, true, "");
                }
                if *clock {
                    text.push_str(CLOCK);
                }
            }
            Self::Yarp => {
                // A name server does not tell all types.
                const UNKNOWN: &str = ", type_if_unknown: NativeObject";
                // Robots take bottles, functions of Wrapyfi JSON.
                const CALLS: &str = ", options: { bottle: auto }";
                // The time of a simulation is left out elsewhere: on YARP nobody has such a port by accident.
                if !has_hidden {
                    const CLOCK: &str = ", type: rosgraph_msgs/msg/Clock, default_deny: false";
                    add(into("yarp:/(clock)", "$1"), false, false, CLOCK);
                    let (_, to) = into("", "(clock)");
                    add((to, "yarp:/$1".to_owned()), false, true, CLOCK);
                }
                if *joint_states {
                    const JOINTS: &str = ", type: sensor_msgs/msg/JointState, merge: true";
                    add(into("yarp:/(?:.*/)?state:o", "joint_states"), false, false, JOINTS);
                }
                for is_service in [false, true] {
                    let calls = if is_service { CALLS } else { "" };
                    let kind = format!("{UNKNOWN}{calls}");
                    add(into("yarp:/([^:]*)", "$1"), is_service, false, &kind);
                    // Names of ROS have no colon: /head/state:o is /head/state/o there.
                    add(into("yarp:/([^:]*):(.*)", "${1}/$2"), is_service, false, &kind);
                    // An input port whose name is meant is written to: /head/command/i to
                    // /head/command:i.
                    add(back("yarp:/$1"), is_service, true, calls);
                }
            }
            Self::ZeroMq => {
                add(into("zeromq:/(.*)", "$1"), false, false, "");
                add(back("zeromq:/$1"), false, true, "");
            }
        }
        Ok(text)
    }
}

/// Text as YAML has it between double quotes, which JSON has as well.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

#[cfg(test)]
mod tests {
    use wrapyfi_engine::{Kind, Route};

    use super::*;
    use crate::middlewares::{Loaded, load_text};

    fn targets(bridge: MiddlewareBridge, selection: &Selection, name: &str) -> Vec<String> {
        let yaml = bridge.yaml(selection).unwrap();
        let Loaded { plan, .. } = load_text(&yaml, bridge.node()).unwrap();
        let all = plan.routes.iter().filter_map(|pattern| pattern.target(name));
        all.map(|to| to.to_string()).collect()
    }

    #[test]
    fn every_built_in_configuration_is_one() {
        let all = Selection::default();
        let ros1 = targets(MiddlewareBridge::Ros1, &all, "/chatter");
        assert_eq!(ros1, ["ros2:/chatter", "ros:/chatter", "ros2:/chatter", "ros:/chatter"]);
        let yarp = targets(MiddlewareBridge::Yarp, &all, "/icub/head/state:o");
        assert_eq!(yarp.first().map(String::as_str), Some("ros2:/icub/head/state/o"));
        for (name, wanted) in [
            ("/skin/0/out", "ros2:/skin/_0/out"),
            ("/x/1:o", "ros2:/x/_1/o"),
            ("/my-module/out", "ros2:/my_module/out"),
            ("/rs.d435/info", "ros2:/rs_d435/info"),
        ] {
            let made = targets(MiddlewareBridge::Yarp, &all, name);
            assert_eq!(made.first().map(String::as_str), Some(wanted));
        }
        let first = targets(MiddlewareBridge::Ros1, &all, "/robot-1/1st");
        assert_eq!(first.first().map(String::as_str), Some("ros2:/robot_1/_1st"));
        assert_eq!(targets(MiddlewareBridge::ZeroMq, &all, "/x"), ["ros2:/x", "zeromq:/x"]);
        assert!(targets(MiddlewareBridge::Ros1, &all, "/a/_hidden").is_empty());
    }

    #[test]
    fn clock_time_out_and_what_is_denied_are_as_wished() {
        let wished = Selection {
            has_hidden: true,
            service_timeout_ms: Some(1234),
            clock: true,
            ..Selection::default()
        };
        let yaml = MiddlewareBridge::Ros1.yaml(&wished).unwrap();
        let Loaded { plan, .. } = load_text(&yaml, "test").unwrap();
        let clock = plan.routes.iter().find(|route| route.is_whole()).unwrap();
        assert_eq!(clock.types().to.ros_type(), "rosgraph_msgs/msg/Clock");
        assert_eq!(targets(MiddlewareBridge::Ros1, &wished, "/a/_hidden").len(), 4);
        let services = plan.routes.iter().filter(|route| matches!(route.kind, Kind::Service(_)));
        let timeout = |route: &Route| route.policy.timeout.as_millis();
        assert_eq!(services.map(timeout).collect::<Vec<_>>(), [1234, 1234]);
        assert!(!MiddlewareBridge::Ros1.yaml(&Selection::default()).unwrap().contains("clock"));
    }

    #[test]
    fn yarp_carries_the_network_clock_and_all_joints_to_one_topic_where_that_is_wished() {
        let first = |selection: &Selection, name: &str, count: usize| {
            let all = targets(MiddlewareBridge::Yarp, selection, name);
            all.into_iter().take(count).collect::<Vec<_>>()
        };
        let all = Selection::default();
        assert_eq!(first(&all, "/clock", 2), ["ros2:/clock", "yarp:/clock"]);
        let prefixed = Selection { prefix: "sim".into(), ..Selection::default() };
        assert_eq!(first(&prefixed, "/clock", 1), ["ros2:/sim/clock"]);
        assert_eq!(first(&prefixed, "/sim/clock", 1), ["yarp:/clock"]);
        let denied = Selection { deny: vec!["clock".into()], ..Selection::default() };
        assert!(targets(MiddlewareBridge::Yarp, &denied, "/clock").is_empty());
        let wished = Selection { joint_states: true, ..Selection::default() };
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
            targets(MiddlewareBridge::ZeroMq, &selection, "/cam/left"),
            ["ros2:/lab/cam/left"]
        );
        assert_eq!(
            targets(MiddlewareBridge::ZeroMq, &selection, "/lab/cam/left"),
            ["zeromq:/cam/left"]
        );
        assert!(targets(MiddlewareBridge::ZeroMq, &selection, "/other").is_empty());
        let wrong = Selection { prefix: "a b".into(), ..Selection::default() };
        assert!(MiddlewareBridge::Ros1.yaml(&wrong).unwrap_err().contains("parameter prefix"));
        let wrong = Selection { deny: vec!["*".into()], ..Selection::default() };
        let told = MiddlewareBridge::Ros1.yaml(&wrong).unwrap_err();
        assert!(told.starts_with("parameter deny: \"*\"") && told.lines().count() == 1, "{told}");
    }
}
