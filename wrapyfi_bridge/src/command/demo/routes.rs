//! Routes of the demo.

use wrapyfi_data::types::{MessageType, RosService, ServiceKind};
use wrapyfi_endpoint::EndpointAddress;
use wrapyfi_engine::{Plan, Route};
use wrapyfi_interfaces::std_srvs::srv::SetBool;

/// A topic of the demo.
pub(super) struct Topic {
    /// Name of its route.
    pub(super) name: &'static str,
    /// Endpoint that a source publishes on.
    pub(super) from: &'static str,
    /// Topic of ROS 2 that the viewer looks at.
    pub(super) to: &'static str,
    pub(super) message_type: MessageType,
}

const fn topic(
    name: &'static str,
    from: &'static str,
    to: &'static str,
    message_type: MessageType,
) -> Topic {
    Topic { name, from, to, message_type }
}

/// The topics, scripts' first, then a robot's.
pub(super) static TOPICS: [Topic; 7] = [
    topic("camera", "zeromq:/demo/camera", "/camera/image_raw", MessageType::Image),
    topic(
        "camera jpeg",
        "zeromq:/demo/jpeg",
        "/camera/image_raw/compressed",
        MessageType::CompressedImage,
    ),
    topic("microphone", "zeromq:/demo/microphone", "/microphone", MessageType::AudioChunk),
    topic("object", "zeromq:/demo/object", "/object", MessageType::NativeObject),
    topic("object as text", "zeromq:/demo/text", "/object/json", MessageType::StringJson),
    topic("robot camera", "yarp:/robot/cam/left", "/robot/cam/left/image_raw", MessageType::Image),
    topic("robot ears", "yarp:/robot/ears", "/robot/ears", MessageType::AudioChunk),
];

/// Name of the route of the robot's service.
pub(super) const LIGHT: &str = "robot light";
/// The robot's rpc port.
pub(super) const LIGHT_PORT: &str = "yarp:/robot/light/rpc";
/// Name of that port's service on ROS 2.
pub(super) const LIGHT_SERVICE: &str = "/robot/light";
/// The robot's service: which of the common ones it is.
pub(super) fn light() -> anyhow::Result<ServiceKind> {
    Ok(ServiceKind::Ros(RosService::of::<SetBool>()?))
}

/// The routes that the bridge runs.
pub(super) fn plan() -> anyhow::Result<Plan> {
    let ros2 = |name: &str| format!("ros2:{name}").parse::<EndpointAddress>();
    let route = |topic: &Topic| {
        let route = Route::topic(topic.from.parse()?, ros2(topic.to)?, topic.message_type);
        anyhow::Ok(Route { name: topic.name.to_owned(), ..route })
    };
    let mut routes = TOPICS.iter().map(route).collect::<anyhow::Result<Vec<_>>>()?;
    let light = Route::service(LIGHT_PORT.parse()?, ros2(LIGHT_SERVICE)?, light()?);
    routes.push(Route { name: LIGHT.to_owned(), ..light });
    Ok(Plan { routes })
}

#[cfg(test)]
mod tests {
    use wrapyfi_engine::RouteTypes;

    use super::*;
    use crate::middlewares;

    #[test]
    fn the_routes_are_valid_and_each_goes_to_a_topic_of_its_own() {
        let plan = plan().unwrap();
        assert_eq!(plan.routes.len(), TOPICS.len() + 1);
        let mut to: Vec<_> = plan.routes.iter().map(|route| &route.to).collect();
        to.sort();
        to.dedup();
        assert_eq!(to.len(), TOPICS.len() + 1);
        let known = middlewares::names();
        let ends = plan.routes.iter().flat_map(|route| [&route.from, &route.to]);
        assert!(ends.into_iter().all(|end| known.contains(&end.middleware.as_str())));
        let light = plan.routes.last().unwrap();
        assert!(
            matches!(light.types, RouteTypes::Service(kind) if kind.ros_type() == "std_srvs/srv/SetBool")
        );
    }
}
