//! Example configurations of robots: each is a plan, and each of its options is one of YARP.

use std::collections::BTreeMap;

use wrapyfi_endpoint::EndpointAddress;
use wrapyfi_engine::{Available, Config, Plan};
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_yarp_endpoint::OPTIONS;
use wrapyfi_yarp_endpoint::options::YarpOptions;

#[test]
fn the_examples_for_robots_are_plans() {
    let plan = |text: &str| {
        let config: Config<BTreeMap<String, serde_json::Value>> =
            Config::from_yaml(text, "robot.yaml").unwrap();
        let known = |name, options| Available { name, options, ..Available::default() };
        let ends = [known("yarp", OPTIONS), known("ros2", &[])];
        Plan::new(&config, &ends, &mut TypeStore::generated(), "robot.yaml").unwrap()
    };
    let options = |plan: &Plan| -> Vec<YarpOptions> {
        let at_yarp = |ends: [&EndpointAddress; 2]| {
            ends.into_iter().find(|end| end.middleware == "yarp").unwrap().clone()
        };
        let specs = plan.routes.iter().map(|it| it.topic_spec(&at_yarp([&it.from, &it.to])));
        specs.map(|spec| YarpOptions::of_topic(&spec).unwrap()).collect()
    };
    let icub = plan(include_str!("../../../config/icub.yaml"));
    assert!(options(&icub).len() > 10, "{icub:?}");
    // A board is a route in each direction.
    let arm = plan(include_str!("../../../config/arm_for_yarp.yaml"));
    let ends: Vec<String> = arm.routes.iter().map(|route| route.ends().to_string()).collect();
    let command = "ros2:/joint_trajectory_controller/joint_trajectory";
    assert_eq!(ends, ["ros2:/joint_states -> yarp:/arm", &format!("yarp:/arm -> {command}")]);
    assert!(options(&arm).iter().all(|it| it.board && it.ranges.len() == 4), "{arm:?}");
}
