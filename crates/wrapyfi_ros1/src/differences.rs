//! Fields that only one of two definitions has: what a route between them loses, in words.
//!
//! ```text
//!   ROS 1  a, only1 ┐            only1 is in ROS 1 only: dropped towards ROS 2, empty towards ROS 1
//!   ROS 2  a, only2 ┴─▶ notes ─▶ only2 is in ROS 2 only: default value towards ROS 2, dropped towards ROS 1
//! ```

use wrapyfi_data::types::{MessageType, RosType, ServiceKind};
use wrapyfi_interfaces::ros1::{PairPlan, Types};

/// Differences of the definitions that a topic of this type has in ROS 1 and in ROS 2, a sentence each. None where no
/// definition of ROS 1 is known: then one is made that has the same fields.
pub fn of_topic(types: &mut Types, message_type: MessageType) -> Vec<String> {
    let MessageType::Ros(ros_type) = message_type else { return Vec::new() };
    types.add_ros2(ros_type.resolved());
    let Ok((definition, _)) = types.towards_ros1(ros_type.resolved().name(), None) else {
        return Vec::new();
    };
    let plan = PairPlan::compile(&definition.resolved, ros_type.resolved(), types.rules());
    plan.map_or_else(|_unlike| Vec::new(), |plan| of_plan(&plan, ros_type))
}

/// As [`of_topic`], for requests and responses of a service.
pub fn of_service(types: &mut Types, kind: ServiceKind) -> Vec<String> {
    let ServiceKind::Ros(service) = kind else { return Vec::new() };
    types.add_ros2(service.resolved());
    let Ok(found) = types.service_towards_ros1(service.resolved().name()) else {
        return Vec::new();
    };
    let definition = found.definition;
    let parts =
        [(definition.request, service.request()), (definition.response, service.response())];
    let plans = parts.into_iter().filter_map(|(ros1, part)| {
        Some((PairPlan::compile(&ros1, part.resolved(), types.rules()).ok()?, part))
    });
    plans.flat_map(|(plan, part)| of_plan(&plan, part)).collect()
}

/// Fields that a plan carries one way only or not at all.
pub(super) fn of_plan(plan: &PairPlan, ros_type: RosType) -> Vec<String> {
    let lost = plan.notes().iter().filter(|note| note.is_loss());
    lost.map(|note| format!("{ros_type}: {note}")).collect()
}
