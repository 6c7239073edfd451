//! Fields that only one of two definitions has: what a route between them loses, in words.
//!
//! ```text
//!   ROS 1  a, only1 ┐            only1 is in ROS 1 only: dropped towards ROS 2, empty towards ROS 1
//!   ROS 2  a, only2 ┴─▶ notes ─▶ only2 is in ROS 2 only: default value towards ROS 2, dropped towards ROS 1
//! ```

use wrapyfi_data::types::{MessageType, RosAction, RosService, RosType, ServiceKind};
use wrapyfi_interfaces::ros1::{Definition, PairError, PairPlan, ServiceDefinition, Types};

/// Differences of the definitions that a topic of this type has in ROS 1 and in ROS 2, a sentence each. None where no
/// definition of ROS 1 is known: then one is made that has the same fields.
pub fn of_topic(types: &mut Types, message_type: MessageType) -> Vec<String> {
    let MessageType::Ros(ros_type) = message_type else { return Vec::new() };
    let pair = towards(types, ros_type);
    pair.map_or_else(|_unlike| Vec::new(), |(_, plan)| of_plan(&plan, ros_type))
}

/// As [`of_topic`], for requests and responses of a service.
pub fn of_service(types: &mut Types, kind: ServiceKind) -> Vec<String> {
    let ServiceKind::Ros(service) = kind else { return Vec::new() };
    let Ok((_, plans)) = service_towards(types, service, None) else { return Vec::new() };
    let parts = [service.request(), service.response()];
    plans.iter().zip(parts).flat_map(|(plan, part)| of_plan(plan, part)).collect()
}

/// As [`of_topic`], for goals, results and feedback of an action.
pub fn of_action(types: &mut Types, kind: RosAction) -> Vec<String> {
    types.add_ros2(kind.resolved());
    let parts = [kind.goal(), kind.result(), kind.feedback()];
    parts.into_iter().flat_map(|part| of_topic(types, MessageType::Ros(part))).collect()
}

/// Definition that a type of ROS 2 most likely has in ROS 1, and the plan between the two. That of a part of an action
/// is the message around it, and the plan that of the part.
pub(super) fn towards(
    types: &mut Types,
    ros_type: RosType,
) -> Result<(Definition, PairPlan), PairError> {
    let resolved = ros_type.resolved();
    // The caller that resolved it may have looked where this node does not.
    types.add_ros2(resolved);
    types.counterpart(resolved)
}

/// As [`towards`], with the plans of requests and responses of a service, whose server tells `md5sum` where it is one of
/// ROS 1.
pub(super) fn service_towards(
    types: &mut Types,
    service: RosService,
    md5sum: Option<&str>,
) -> Result<(ServiceDefinition, [PairPlan; 2]), PairError> {
    types.add_ros2(service.resolved());
    types.service_counterpart(service.resolved(), md5sum)
}

/// Fields that a plan carries one way only or not at all.
pub(super) fn of_plan(plan: &PairPlan, ros_type: RosType) -> Vec<String> {
    let lost = plan.notes().iter().filter(|note| note.is_loss());
    lost.map(|note| format!("{ros_type}: {note}")).collect()
}
