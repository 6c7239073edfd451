//! Topics of ROS 2 whose quality of service is a convention, whichever endpoint comes first.
//!
//! | topic | type | into ROS 2 | from ROS 2 |
//! | --- | --- | --- | --- |
//! | `/rosout` | `rcl_interfaces/msg/Log` | reliable, transient local, last 1000, 10 s | follows, last 1000 |
//! | `/clock` | `rosgraph_msgs/msg/Clock` | follows, best effort by itself, last 1 | follows, last 1 |
//!
//! They hold where the route itself sets none.

use std::time::Duration;

use wrapyfi_endpoint::{
    Durability, EndpointAddress, History, Qos, QueueSpec, Reliability, TopicSpec,
};

/// Number of lines that a node keeps for later readers, and that wait in a route.
const LINES: u32 = 1000;
/// Age at which a line is no longer delivered to later readers.
const LIFESPAN: Duration = Duration::from_secs(10);

/// Gives the `spec` of the endpoint at `address` the quality of service that is usual there.
pub(super) fn apply(spec: &mut TopicSpec, address: &EndpointAddress, at_source: bool) {
    let is_ros_2 = address.middleware == "ros2";
    match (address.name.trim_start_matches('/'), spec.message_type.ros_type()) {
        ("rosout", "rcl_interfaces/msg/Log") => {
            let history = History::KeepLast(LINES);
            if is_ros_2 && !at_source && spec.match_peers {
                spec.match_peers = false;
                spec.qos = Qos {
                    reliability: Reliability::Reliable,
                    durability: Durability::TransientLocal,
                    lifespan: Some(LIFESPAN),
                    ..spec.qos
                };
            }
            if is_ros_2 {
                spec.qos.history = history;
            }
            // Programs log many lines at once when they start.
            if spec.queue == QueueSpec::default() {
                spec.queue.depth = usize::try_from(LINES).unwrap_or(spec.queue.depth);
            }
        }
        ("clock", "rosgraph_msgs/msg/Clock") if is_ros_2 => {
            spec.qos.reliability = Reliability::BestEffort;
            spec.qos.history = History::KeepLast(1);
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{QosConfig, Route};
    use wrapyfi_data::types::{MessageType, RosType};
    use wrapyfi_endpoint::QosPreset;
    use wrapyfi_interfaces::store::TypeStore;

    fn route(from: &str, to: &str, message_type: &str) -> Route {
        let resolved = TypeStore::generated().resolve_name(message_type).unwrap();
        let message_type = MessageType::Ros(RosType::new(&resolved).unwrap());
        Route::topic(from.parse().unwrap(), to.parse().unwrap(), message_type)
    }

    const LOG: &str = "rcl_interfaces/msg/Log";

    #[test]
    fn the_log_goes_into_ros_2_as_nodes_publish_it() {
        let spec = route("ros:/rosout", "ros2:/rosout", LOG);
        let (from, to) = (spec.topic_spec(&spec.from), spec.topic_spec(&spec.to));
        assert_eq!((to.match_peers, to.qos.durability), (false, Durability::TransientLocal));
        assert_eq!((to.qos.history, to.qos.lifespan), (History::KeepLast(1000), Some(LIFESPAN)));
        assert_eq!((from.match_peers, from.queue.depth), (true, 1000));
        let back = route("ros2:/rosout", "ros:/rosout", LOG);
        let from = back.topic_spec(&back.from);
        assert_eq!((from.match_peers, from.qos.history), (true, History::KeepLast(1000)));
    }

    #[test]
    fn what_the_route_says_holds() {
        let mut spec = route("ros:/rosout", "ros2:/rosout", LOG);
        spec.policy.qos = QosConfig::Fixed(QosPreset::SensorData.into());
        assert_eq!(spec.topic_spec(&spec.to).qos, QosPreset::SensorData.into());
        let other = route("ros:/rosout", "ros2:/rosout", "std_msgs/msg/String");
        assert_eq!(other.topic_spec(&other.to).qos, Qos::default());
    }

    #[test]
    fn a_clock_is_best_effort_and_no_older_than_the_last() {
        let spec = route("ros:/clock", "ros2:/clock", "rosgraph_msgs/msg/Clock");
        let to = spec.topic_spec(&spec.to);
        assert_eq!((to.match_peers, to.qos.reliability), (true, Reliability::BestEffort));
        assert_eq!(to.qos.history, History::KeepLast(1));
    }
}
