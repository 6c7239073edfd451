//! Names of ROS in the spelling of DDS.
//!
//! ```text
//!   /robot/chatter        ── topic_to_dds ──▶  rt/robot/chatter
//!   std_msgs/msg/String   ── type_to_dds ───▶  std_msgs::msg::dds_::String_
//! ```
//!
//! Topics are valid already when they come here: see [`wrapyfi_node::NodeName`].

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

/// Meaning of a DDS topic in ROS's terms.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum RosName<'a> {
    /// A topic, by its absolute name.
    Topic(&'a str),
    /// The requests of a service, by its absolute name.
    Requests(&'a str),
    /// Replies of a service, by its absolute name.
    Replies(&'a str),
    /// Topic that is not ROS's.
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

/// DDS names of a service's two topics.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ServiceNames {
    /// Topic and type of its requests.
    pub(super) requests: (String, String),
    /// Topic and type of its replies.
    pub(super) replies: (String, String),
}

/// DDS names of a service: `/add` of `example_interfaces/srv/AddTwoInts` is `rq/addRequest` and
/// `rr/addReply` of `example_interfaces::srv::dds_::AddTwoInts_Request_` and `…_Response_`.
///
/// # Errors
/// When the type is not `package/kind/Type`.
pub(super) fn service_to_dds(absolute: &str, ros: &str) -> Result<ServiceNames, TypeNameError> {
    Ok(ServiceNames {
        requests: (format!("rq{absolute}Request"), type_to_dds(&format!("{ros}_Request"))?),
        replies: (format!("rr{absolute}Reply"), type_to_dds(&format!("{ros}_Response"))?),
    })
}

/// The id that `rmw_cyclonedds_cpp` puts into USER_DATA of both endpoints of a client or server:
/// the participant's bytes and a number, in hexadecimal without leading zeros, joined by dots.
pub(super) fn end_id(participant: &[u8; 16], number: u32) -> String {
    let bytes = participant.iter().copied().take(12).chain(number.to_be_bytes());
    let digits: Vec<String> = bytes.map(|byte| format!("{byte:x}")).collect();
    digits.join(".")
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
    fn services_have_two_topics_and_ids() {
        let names = service_to_dds("/a/add", "example_interfaces/srv/AddTwoInts").unwrap();
        let request = "example_interfaces::srv::dds_::AddTwoInts_Request_";
        assert_eq!(names.requests, ("rq/a/addRequest".to_owned(), request.to_owned()));
        let reply = "example_interfaces::srv::dds_::AddTwoInts_Response_";
        assert_eq!(names.replies, ("rr/a/addReply".to_owned(), reply.to_owned()));
        assert!(service_to_dds("/a", "AddTwoInts").is_err());
        let participant =
            [1, 0x10, 0x35, 0xf7, 0x26, 0xad, 0x60, 0xe, 0xac, 0xf5, 0x3c, 0xe6, 0, 0, 1, 0xc1];
        assert_eq!(end_id(&participant, 8), "1.10.35.f7.26.ad.60.e.ac.f5.3c.e6.0.0.0.8");
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
