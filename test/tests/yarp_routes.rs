//! Bridges between YARP and ROS 2: the name server runs in the bridge, ports are ours, and on the ROS 2
//! side are independent programs.

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Process, Result, Route, TestEnv, asked_until, ros2, run, zeromq};

const NEEDS: &[Need] = &[Need::Program, Need::Python];

fn bridge(env: &TestEnv, route: Route) -> Result<Process> {
    env.yarp_conf()?;
    env.bridge(&env.embedded().yarp(env).route(route))
}

fn yarp(name: &str) -> String {
    format!("yarp:{name}")
}

/// Message that a subscriber on ROS 2 hears of `value`, published to YARP.
fn heard(env: &TestEnv, route: Route, ros_type: &str, publish: &[&str]) -> Result<Value> {
    let (from, to) = (env.topic("from"), env.topic("to"));
    let bridge = bridge(env, route)?;
    let subscriber = env.dds_subscriber(&to, ros_type, "--count 1")?;
    let endpoint = yarp(&from);
    let _publisher = env.wrapyfi([&["pub", &endpoint, "--rate", "20"], publish].concat())?;
    let mut heard = subscriber.messages(1).map_err(|error| error.context(bridge.tail()))?;
    Ok(heard.remove(0))
}

fn route(env: &TestEnv, message_type: &str) -> Route {
    Route::new(&yarp(&env.topic("from")), &ros2(&env.topic("to")), message_type)
}

#[test]
fn text_of_a_port_is_a_string() -> Result {
    run("text_of_a_port_is_a_string", NEEDS, |env| {
        let route = route(env, "Text");
        let publish = ["--type", "Text", "--value", r#""hello icub""#];
        let heard = heard(env, route, "std_msgs/msg/String", &publish)?;
        assert!(heard.to_string().contains("hello icub"), "{heard}");
        Ok(())
    })
}

#[test]
fn an_object_reaches_ros() -> Result {
    run("an_object_reaches_ros", NEEDS, |env| {
        let route = route(env, "std_msgs/msg/String");
        let publish = ["--type", "NativeObject", "--value", r#"{"speed": [1, 2.5]}"#];
        let heard = heard(env, route, "std_msgs/msg/String", &publish)?;
        assert_eq!(heard["value"], json!({"speed": [1, 2.5]}), "{heard}");
        Ok(())
    })
}

#[test]
fn encoders_in_degrees_are_joint_states_in_radians() -> Result {
    run("encoders_in_degrees_are_joint_states_in_radians", NEEDS, |env| {
        let joints = "sensor_msgs/msg/JointState";
        let options = r#"{ joints: ["neck_pitch", "neck_roll"] }"#;
        let route = route(env, joints).with("options", options);
        let publish = [
            "--type",
            joints,
            "--option",
            r#"joints=["neck_pitch", "neck_roll"]"#,
            "--value",
            r#"{"name": ["neck_pitch", "neck_roll"], "position": [0.5, -1.0]}"#,
        ];
        let heard = heard(env, route, joints, &publish)?;
        assert_eq!(heard["fields"]["name"], json!(["neck_pitch", "neck_roll"]), "{heard}");
        let position = heard["fields"]["position"].to_string();
        assert!(position.contains("0.5") && position.contains("-1"), "{heard}");
        Ok(())
    })
}

#[test]
fn a_ros_image_is_a_port_that_may_be_read() -> Result {
    run("a_ros_image_is_a_port_that_may_be_read", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let bridge = bridge(env, Route::new(&ros2(&from), &yarp(&to), "Image"))?;
        let endpoint = yarp(&to);
        let listener =
            env.wrapyfi(["echo", &endpoint, "--type", "Image", "--count", "2", "--json"])?;
        let publisher = env.dds_publisher(&from, "sensor_msgs/msg/Image", "--flavour colour")?;
        let heard = listener.objects(2).map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(heard[0]["shape"], json!([48, 64, 3]), "{}", heard[0]);
        let sums: Vec<String> =
            heard.iter().filter_map(|h| h["sha256"].as_str().map(str::to_owned)).collect();
        publisher.sent_in_a_row("sha256", &sums)
    })
}

#[test]
fn two_routes_merge_into_one_port() -> Result {
    run("two_routes_merge_into_one_port", NEEDS, |env| {
        env.yarp_conf()?;
        let (a, b, to) = (env.topic("a"), env.topic("b"), yarp(&env.topic("to")));
        let sources = [ros2(&a), zeromq(&b)];
        let mut config = env.embedded().yarp(env);
        for from in &sources {
            config = config.route(Route::new(from, &to, "Text").with("merge", "true"));
        }
        let bridge = env.bridge(&config)?;
        let listener = env.wrapyfi(["echo", &to, "--type", "Text", "--json"])?;
        let mut publishers = Vec::new();
        for from in &sources {
            let value = format!("\"of {from}\"");
            let publish = ["pub", from, "--type", "Text", "--value", &value, "--rate", "20"];
            publishers.push(env.wrapyfi(publish)?);
        }
        for from in &sources {
            let what = format!("of {from}");
            listener
                .wait_until(&what, |output| {
                    output.out.iter().any(|line| line.contains(&what)).then_some(())
                })
                .map_err(|error| error.context(bridge.tail()))?;
        }
        Ok(())
    })
}

#[test]
fn a_port_that_answers_is_a_ros_service() -> Result {
    run("a_port_that_answers_is_a_ros_service", NEEDS, |env| {
        let (rpc, name) = (env.topic("rpc"), env.topic("ask"));
        let route = Route::service(&yarp(&rpc), &ros2(&name), "NativeObject");
        let bridge = bridge(env, route)?;
        let (server, client) = (yarp(&rpc), ros2(&name));
        let _server = env.wrapyfi(["serve", &server, "--type", "NativeObject", "--echo"])?;
        let mut call = env.wrapyfi([
            "call",
            &client,
            "--type",
            "NativeObject",
            "--args",
            r#"["hello"]"#,
            "--json",
            "--timeout",
            "30",
        ])?;
        call.exits_with(0).map_err(|error| error.context(bridge.tail()))?;
        assert!(call.stdout().contains("hello"), "{}", call.tail());
        Ok(())
    })
}

#[test]
fn ports_are_listed() -> Result {
    run("ports_are_listed", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let _bridge = bridge(env, Route::new(&ros2(&from), &yarp(&to), "Image"))?;
        asked_until("the port in the list", || {
            let mut list = env.wrapyfi(["list", "yarp", "--json", "--wait", "2"])?;
            // The name server may not run yet.
            Ok((list.exit_code()? == 0 && list.stdout().contains(&to)).then_some(()))
        })
    })
}
