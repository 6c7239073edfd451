//! The types of what was captured, and of which topic they are.

use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::{ResolvedType, TypeStore};

use crate::names::{self, RosName};

/// Definitions that this crate does not bring along.
const OTHERS: [(&str, &str); 7] = [
    ("example_interfaces/srv/AddTwoInts", "int64 a\nint64 b\n---\nint64 sum\n"),
    (
        "example_interfaces/action/Fibonacci",
        "int32 order\n---\nint32[] sequence\n---\nint32[] sequence\n",
    ),
    ("std_msgs/msg/Empty", ""),
    ("std_msgs/msg/Float64", "float64 data\n"),
    ("std_msgs/msg/MultiArrayDimension", "string label\nuint32 size\nuint32 stride\n"),
    ("std_msgs/msg/MultiArrayLayout", "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n"),
    ("std_msgs/msg/UInt8MultiArray", "std_msgs/MultiArrayLayout layout\nuint8[] data\n"),
];

/// Topics and what they carry: a type, and which part of it where it is an interface of several.
const TOPICS: [(&str, &str, &str); 7] = [
    ("/chatter", "std_msgs/msg/String", ""),
    ("/latched", "std_msgs/msg/String", ""),
    ("/parameter_events", "rcl_interfaces/msg/ParameterEvent", ""),
    ("/rosout", "rcl_interfaces/msg/Log", ""),
    ("/add_two_ints/_service_event", "example_interfaces/srv/AddTwoInts", "_Event"),
    ("/fibonacci/_action/feedback", "example_interfaces/action/Fibonacci", "_FeedbackMessage"),
    ("/fibonacci/_action/status", "action_msgs/msg/GoalStatusArray", ""),
];

/// Services in the same way; `_Request` and `_Response` follow.
const SERVICES: [(&str, &str, &str); 13] = [
    ("/add_two_ints", "example_interfaces/srv/AddTwoInts", ""),
    ("/nothing", "std_srvs/srv/Empty", ""),
    ("/set_bool", "std_srvs/srv/SetBool", ""),
    ("/params/describe_parameters", "rcl_interfaces/srv/DescribeParameters", ""),
    ("/params/get_parameters", "rcl_interfaces/srv/GetParameters", ""),
    ("/params/get_parameter_types", "rcl_interfaces/srv/GetParameterTypes", ""),
    ("/params/list_parameters", "rcl_interfaces/srv/ListParameters", ""),
    ("/params/set_parameters", "rcl_interfaces/srv/SetParameters", ""),
    ("/params/set_parameters_atomically", "rcl_interfaces/srv/SetParametersAtomically", ""),
    ("/talker/get_type_description", "type_description_interfaces/srv/GetTypeDescription", ""),
    ("/fibonacci/_action/send_goal", "example_interfaces/action/Fibonacci", "_SendGoal"),
    ("/fibonacci/_action/get_result", "example_interfaces/action/Fibonacci", "_GetResult"),
    ("/fibonacci/_action/cancel_goal", "action_msgs/srv/CancelGoal", ""),
];

/// Every type that is looked up.
pub(super) struct Definitions(TypeStore);

impl Definitions {
    pub(super) fn new() -> Self {
        let mut store = TypeStore::generated();
        for (name, text) in OTHERS {
            let name = TypeName::parse(Dialect::Ros2, name).unwrap();
            store.add_definition(&name, text).unwrap();
        }
        Self(store)
    }

    /// Type of the messages on a DDS topic.
    pub(super) fn on(&mut self, dds_topic: &str) -> Option<ResolvedType> {
        let find = |table: &[(&str, &'static str, &'static str)], name: &str| {
            table.iter().find(|(known, ..)| *known == name).map(|&(_, base, part)| (base, part))
        };
        let (base, part) = match names::from_dds(dds_topic) {
            RosName::Topic(topic) => {
                let (base, part) = find(&TOPICS, topic)?;
                (base, part.to_owned())
            }
            RosName::Requests(service) => {
                let (base, part) = find(&SERVICES, service)?;
                (base, format!("{part}_Request"))
            }
            RosName::Replies(service) => {
                let (base, part) = find(&SERVICES, service)?;
                (base, format!("{part}_Response"))
            }
            RosName::Dds("ros_discovery_info") => {
                ("rmw_dds_common/msg/ParticipantEntitiesInfo", String::new())
            }
            RosName::Dds(_) => return None,
        };
        Some(self.part(base, &part))
    }

    /// A message by its name on DDS, for instance `std_srvs::srv::dds_::SetBool_Request_`.
    pub(super) fn named(&mut self, dds_type: &str) -> ResolvedType {
        let name = names::type_from_dds(dds_type).unwrap();
        for part in ["_Request", "_Response"] {
            if let Some(base) = name.strip_suffix(part) {
                return self.part(base, part);
            }
        }
        self.part(&name, "")
    }

    pub(super) fn part(&mut self, base: &str, part: &str) -> ResolvedType {
        let resolved = self.0.resolve_name(base).unwrap();
        if part.is_empty() {
            return resolved;
        }
        resolved.part(part).unwrap_or_else(|| panic!("{base} has no {part}"))
    }
}
