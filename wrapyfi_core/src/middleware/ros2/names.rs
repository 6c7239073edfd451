//! How DDS spells what ROS names.
//!
//! ```text
//!   /robot/chatter        ── topic_to_dds ──▶  rt/robot/chatter
//!   std_msgs/msg/String   ── type_to_dds ───▶  std_msgs::msg::dds_::String_
//! ```
//!
//! Topics are valid already when they come here: see [`crate::node::NodeName`].

/// A text that is no ROS type.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no type name: write it as package/msg/Type")]
pub(super) struct TypeNameError(String);

/// DDS topic of an absolute ROS topic: `/chatter` is `rt/chatter`.
pub(super) fn topic_to_dds(absolute: &str) -> String {
    format!("rt{absolute}")
}

/// ROS topic of a DDS topic, where it is one: `rt/chatter` is `/chatter`, anything else is none.
pub(super) fn topic_from_dds(dds: &str) -> Option<&str> {
    dds.strip_prefix("rt").filter(|name| name.starts_with('/'))
}

/// What a DDS topic is in ROS's terms.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum RosName<'a> {
    /// A topic, by its absolute name.
    Topic(&'a str),
    /// The requests of a service, by its absolute name.
    Requests(&'a str),
    /// Its replies.
    Replies(&'a str),
    /// Not ROS's.
    Dds(&'a str),
}

/// Reads the name of a DDS topic.
pub(super) fn from_dds(dds: &str) -> RosName<'_> {
    let service = |prefix: &str, suffix: &str| {
        dds.strip_prefix(prefix)?.strip_suffix(suffix).filter(|name| name.starts_with('/'))
    };
    if let Some(topic) = topic_from_dds(dds) {
        RosName::Topic(topic)
    } else if let Some(name) = service("rq", "Request") {
        RosName::Requests(name)
    } else if let Some(name) = service("rr", "Reply") {
        RosName::Replies(name)
    } else {
        RosName::Dds(dds)
    }
}

/// Type of a service, from the DDS type of its requests or replies.
pub(super) fn service_type_from_dds(dds: &str) -> Option<String> {
    let half = type_from_dds(dds)?;
    half.strip_suffix("_Request").or_else(|| half.strip_suffix("_Response")).map(str::to_owned)
}

/// DDS type of a ROS type: `std_msgs/msg/String` is `std_msgs::msg::dds_::String_`.
///
/// # Errors
/// When it is not `package/kind/Type`.
pub(super) fn type_to_dds(ros: &str) -> Result<String, TypeNameError> {
    let mut parts = ros.split('/');
    match (parts.next(), parts.next(), parts.next(), parts.next()) {
        (Some(package), Some(kind), Some(name), None)
            if [package, kind, name].into_iter().all(is_identifier) =>
        {
            Ok(format!("{package}::{kind}::dds_::{name}_"))
        }
        _ => Err(TypeNameError(ros.to_owned())),
    }
}

/// ROS type of a DDS type, where it is one.
pub(super) fn type_from_dds(dds: &str) -> Option<String> {
    let (before, name) = dds.split_once("::dds_::")?;
    let name = name.strip_suffix('_')?;
    let (package, kind) = before.split_once("::")?;
    [package, kind, name].into_iter().all(is_identifier).then(|| format!("{package}/{kind}/{name}"))
}

fn is_identifier(part: &str) -> bool {
    part.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && part.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_go_both_ways() {
        assert_eq!(topic_to_dds("/a/b"), "rt/a/b");
        assert_eq!(topic_from_dds("rt/a/b"), Some("/a/b"));
        for foreign in ["ros_discovery_info", "rtx", "rq/a", ""] {
            assert_eq!(topic_from_dds(foreign), None, "{foreign:?}");
        }
    }

    #[test]
    fn services_are_told_from_topics() {
        assert_eq!(from_dds("rt/a"), RosName::Topic("/a"));
        assert_eq!(from_dds("rq/a/getRequest"), RosName::Requests("/a/get"));
        assert_eq!(from_dds("rr/a/getReply"), RosName::Replies("/a/get"));
        assert_eq!(from_dds("rq/a"), RosName::Dds("rq/a"));
        let dds = "example_interfaces::srv::dds_::AddTwoInts_Request_";
        let ros = "example_interfaces/srv/AddTwoInts";
        assert_eq!(service_type_from_dds(dds).as_deref(), Some(ros));
    }

    #[test]
    fn types_go_both_ways() {
        let dds = type_to_dds("std_msgs/msg/String").unwrap();
        assert_eq!(dds, "std_msgs::msg::dds_::String_");
        assert_eq!(type_from_dds(&dds).as_deref(), Some("std_msgs/msg/String"));
        for wrong in ["", "String", "std_msgs/String", "a/b/c/d", "a/msg/", "a/msg/B-C", "a/msg/1"]
        {
            assert_eq!(type_to_dds(wrong), Err(TypeNameError(wrong.into())));
        }
        for foreign in
            ["Plain", "a::dds_::B_", "a::msg::dds_::B", "a::msg::dds_::_", "::::dds_::B_"]
        {
            assert_eq!(type_from_dds(foreign), None, "{foreign:?}");
        }
    }
}
