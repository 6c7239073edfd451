//! Topics of ROS 2 whose quality of service is a convention, whichever endpoint comes first.
//!
//! | topic | type | into ROS 2 | from ROS 2 |
//! | --- | --- | --- | --- |
//! | `/rosout` | `rcl_interfaces/msg/Log` | reliable, transient local, last 1000, 10 s | follows, last 1000 |
//! | `/clock` | `rosgraph_msgs/msg/Clock` | follows, best effort by itself, last 1 | follows, last 1 |

use std::time::Duration;

use wrapyfi_endpoint::{Durability, History, Qos, Reliability, TopicSpec};

/// Number of lines that a node keeps for later readers.
const LINES: u32 = 1000;
/// Age at which a line is no longer delivered to later readers.
const LIFESPAN: Duration = Duration::from_secs(10);

/// Gives an endpoint, a listener where it is `at_source`, the quality of service that is usual for its topic.
pub fn follow_conventions(spec: &mut TopicSpec, at_source: bool) {
    match (spec.topic.trim_start_matches('/'), spec.message_type.ros_type()) {
        ("rosout", "rcl_interfaces/msg/Log") => {
            if !at_source && spec.match_peers {
                spec.match_peers = false;
                spec.qos = Qos {
                    reliability: Reliability::Reliable,
                    durability: Durability::TransientLocal,
                    lifespan: Some(LIFESPAN),
                    ..spec.qos
                };
            }
            spec.qos.history = History::KeepLast(LINES);
        }
        ("clock", "rosgraph_msgs/msg/Clock") => {
            spec.qos.reliability = Reliability::BestEffort;
            spec.qos.history = History::KeepLast(1);
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_data::types::{MessageType, RosType};
    use wrapyfi_interfaces::store::TypeStore;

    fn followed(topic: &str, type_name: &str, at_source: bool) -> TopicSpec {
        let resolved = TypeStore::generated().resolve_name(type_name).unwrap();
        let message_type = MessageType::Ros(RosType::new(&resolved).unwrap());
        let mut spec = TopicSpec { match_peers: true, ..TopicSpec::new(topic, message_type) };
        follow_conventions(&mut spec, at_source);
        spec
    }

    #[test]
    fn the_log_goes_into_ros_2_as_nodes_publish_it() {
        let to = followed("/rosout", "rcl_interfaces/msg/Log", false);
        assert_eq!((to.match_peers, to.qos.durability), (false, Durability::TransientLocal));
        assert_eq!((to.qos.history, to.qos.lifespan), (History::KeepLast(1000), Some(LIFESPAN)));
        let from = followed("rosout", "rcl_interfaces/msg/Log", true);
        assert_eq!((from.match_peers, from.qos.history), (true, History::KeepLast(1000)));
        let other = followed("/rosout", "std_msgs/msg/String", false);
        assert_eq!((other.match_peers, other.qos), (true, Qos::default()));
    }

    #[test]
    fn a_clock_is_best_effort_and_no_older_than_the_last() {
        let to = followed("/clock", "rosgraph_msgs/msg/Clock", false);
        assert_eq!((to.match_peers, to.qos.reliability), (true, Reliability::BestEffort));
        assert_eq!(to.qos.history, History::KeepLast(1));
    }
}
