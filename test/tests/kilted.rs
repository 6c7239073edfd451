//! ROS 2 Kilted around our programs: nodes of rclpy on Fast DDS 3, which tell each other their types by XTypes.

use wrapyfi_e2e::{Need, RealRos2, Result, TestEnv, ros2, run};

use crate::real_ros2;

const NEEDS: &[Need] = &[Need::Program, Need::Python, Need::Kilted];

fn on_kilted(test: &str, body: impl FnOnce(&TestEnv, &RealRos2<'_>) -> Result) -> Result {
    run(test, NEEDS, |env| body(env, &RealRos2::kilted(env)?))
}

/// Tests that an installed ROS 2 runs as well, of those that need no `ros2`.
macro_rules! as_on_ros2 {
    ($($test:ident),*) => { $(
        #[test]
        fn $test() -> Result {
            on_kilted(&format!("kilted_{}", stringify!($test)), real_ros2::$test)
        }
    )* };
}

as_on_ros2!(
    types_of_many_fields_go_through_zeromq_and_back,
    images_go_through_zeromq_and_back,
    ours_echoes_and_publishes_with_types_of_the_installation,
    services_of_rclpy_are_called,
    parameters_of_a_node_of_rclpy_are_set_by_ours
);

#[test]
fn services_need_no_choice() -> Result {
    on_kilted("services_need_no_choice", |env, ros| {
        env.set_variable("RMW_IMPLEMENTATION", "");
        let service = env.topic("light");
        let serve = ["serve", &ros2(&service), "--type", "std_srvs/srv/SetBool", "--value"];
        let server = env.wrapyfi([&serve[..], &[r#"{"message": "so be it"}"#]].concat())?;
        for rmw in ["rmw_cyclonedds_cpp", "rmw_fastrtps_cpp"] {
            let call = ["call", &ros2(&service), "--timeout", "60", "--value", r#"{"data": true}"#];
            env.wrapyfi_as(rmw, call)?.exits_with(0)?;
        }
        let client = format!("call --topic {service} --type std_srvs/srv/SetBool");
        let client = ros.rclpy(&client, Some(r#"{"data": true}"#))?;
        let reply = client.event("reply").map_err(|error| error.context(server.tail()))?;
        assert_eq!(reply["value"]["message"], "so be it");
        real_ros2::services_of_rclpy_are_called(env, ros)
    })
}

/// The client asks as soon as one of the stacks that the server is on has matched.
#[test]
fn a_client_that_waits_for_a_service_is_answered() -> Result {
    on_kilted("a_client_that_waits_for_a_service_is_answered", |env, ros| {
        env.set_variable("RMW_IMPLEMENTATION", "");
        for round in 0..4 {
            let service = env.topic(&format!("light{round}"));
            let client = format!("call --topic {service} --type std_srvs/srv/SetBool");
            let client = ros.rclpy(&client, Some(r#"{"data": true}"#))?;
            client.event("ready")?;
            let serve = ["serve", &ros2(&service), "--type", "std_srvs/srv/SetBool", "--value"];
            let server = env.wrapyfi([&serve[..], &[r#"{"message": "so be it"}"#]].concat())?;
            client.event("reply").map_err(|error| error.context(server.tail()))?;
        }
        Ok(())
    })
}

/// A type with a sequence of strings: from what the nodes told each other about it, CycloneDDS took it for invalid.
const KIND: &str = "sensor_msgs/msg/JointState";

#[test]
fn every_late_node_is_heard_and_hears() -> Result {
    on_kilted("every_late_node_is_heard_and_hears", |env, ros| {
        let (to, from) = (env.topic("to"), env.topic("from"));
        let (to_ours, from_ours) = (ros2(&from), ros2(&to));
        let value = r#"{"name": ["elbow"]}"#;
        let publish = ["pub", &from_ours, "--type", KIND, "--value", value];
        let _publisher =
            ros.wrapyfi([&publish[..], &["--qos", "latched", "--rate", "0.001"]].concat())?;
        let echo = ros.wrapyfi(["echo", &to_ours, "--type", KIND, "--json"])?;
        // Each with all those before it, which have told each other their types.
        let mut nodes = Vec::new();
        for number in 0..6 {
            let ear =
                format!("subscribe --topic {to} --type {KIND} --qos latched --node ear{number}");
            let ear = ros.rclpy(&ear, None)?;
            let mouth = format!("publish --topic {from} --type {KIND} --node mouth{number}");
            let value = format!(r#"{{"name": ["mouth{number}"]}}"#);
            let mouth = ros.rclpy(&mouth, Some(&value))?;
            assert_eq!(ear.messages(1)?[0]["value"]["name"][0], "elbow", "{number}");
            nodes.extend([ear, mouth]);
        }
        echo.wait_until("messages of all six", |output| {
            let heard = |name: String| {
                output.objects().any(|object| object["value"]["name"][0] == name.as_str())
            };
            (0..6).all(|number| heard(format!("mouth{number}"))).then_some(())
        })
    })
}
