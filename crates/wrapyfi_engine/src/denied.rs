//! Topics and services that patterns leave out unless `default_deny: false` says otherwise.

use wrapyfi_endpoint::pattern::bare;

/// Topics that every node has, and those that two programs would feed each other for ever.
const NOT_TOPICS: [&str; 4] = ["rosout", "rosout_agg", "clock", "parameter_events"];
/// Services that every node of ROS 1 offers about itself.
const NOT_SERVICES_OF_ROS1: [&str; 2] = ["get_loggers", "set_logger_level"];
/// Services that every other node offers about itself.
const NOT_SERVICES: [&str; 11] = [
    "get_parameters",
    "get_parameter_types",
    "set_parameters",
    "set_parameters_atomically",
    "list_parameters",
    "describe_parameters",
    "get_type_description",
    "get_loggers",
    "get_logger_levels",
    "set_logger_level",
    "set_logger_levels",
];

/// Prefix of YARP's log ports; a number follows, with which no name of ROS may begin.
const LOGS_OF_YARP: &str = "log/";

/// True for topics that are left out unless `default_deny: false` says otherwise: hidden ones,
/// whose names have a part that begins with `_`, those of the logs, of time, and of parameters.
pub(super) fn is_denied_topic(middleware: &str, name: &str) -> bool {
    let bare = bare(name);
    let is_log = middleware == "yarp" && bare.starts_with(LOGS_OF_YARP);
    is_hidden(bare) || is_log || NOT_TOPICS.contains(&bare)
}

/// As [`is_denied_topic`], for services of a middleware: hidden ones, and those that every node
/// there offers about itself.
pub(super) fn is_denied_service(middleware: &str, name: &str) -> bool {
    let bare = bare(name);
    let last = bare.rsplit('/').next().unwrap_or(bare);
    let of_every_node: &[&str] =
        if middleware == "ros" { &NOT_SERVICES_OF_ROS1 } else { &NOT_SERVICES };
    is_hidden(bare) || of_every_node.contains(&last)
}

fn is_hidden(bare: &str) -> bool {
    bare.split('/').any(|part| part.starts_with('_'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn some_are_left_out_by_default() {
        for name in ["/rosout", "/rosout_agg", "/clock", "/parameter_events", "/_x", "/a/_action/b"]
        {
            assert!(is_denied_topic("ros", name), "{name}");
        }
        for name in ["/tf", "/tf2", "/robot/clock", "/a_b", "/rosout2"] {
            assert!(!is_denied_topic("ros", name), "{name}");
        }
        let log = "/log/robot/yarpdev/4711";
        assert!(is_denied_topic("yarp", log) && !is_denied_topic("ros2", log));
        for name in ["/talker/get_parameters", "/rosout/set_logger_level", "/x/_action/send_goal"] {
            assert!(is_denied_service("ros2", name), "{name}");
        }
        for name in ["/add", "/get_parameters/of"] {
            assert!(!is_denied_service("ros2", name), "{name}");
        }
        assert!(is_denied_service("ros", "/talker/set_logger_level"));
        // dynamic_reconfigure's.
        assert!(!is_denied_service("ros", "/camera/set_parameters"));
    }
}
