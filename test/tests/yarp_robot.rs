//! `yarp_bridge` by itself: the ports of a robot are in ROS 2, with types that no configuration names.

use serde_json::Value;
use wrapyfi_e2e::{Need, Process, Result, Route, TestEnv, ros2, run, until_route, yarp};

use crate::real_yarp;

const NEEDS: &[Need] = &[Need::Program, Need::Python];
const REAL: &[Need] = &[Need::Program, Need::Python, Need::Yarp];

fn bridge(env: &TestEnv) -> Result<Process> {
    env.executable("yarp_bridge", &["-p", "status_json:=true"])
}

/// Another program's port that sends.
fn port(env: &TestEnv, name: &str, message: &[&str]) -> Result<Process> {
    let endpoint = yarp(name);
    env.wrapyfi([&["pub", &endpoint, "--rate", "20"], message].concat())
}

/// The name that a port has in ROS 2.
fn in_ros(port: &str) -> String {
    port.replace(':', "/")
}

/// Waits until the route of a port has a type, and a reason.
fn until_typed(bridge: &Process, port: &str, kind: &str, reason: &str) -> Result {
    let route = format!("yarp:{port} -> ros2:{}", in_ros(port));
    let is = |route: &Value| {
        let told = route["reason"].as_str().unwrap_or_default();
        route["type"] == kind && told.contains(reason)
    };
    until_route(bridge, &route, |route| route.is_some_and(is))
        .map_err(|error| error.context(format!("{port}, which should be {kind}: {reason}")))
}

/// Four by four pixels of three colours, as numpy writes them.
fn picture(env: &TestEnv) -> Result<String> {
    let mut header = "{'descr': '|u1', 'fortran_order': False, 'shape': (4, 4, 3), }".to_owned();
    while !(header.len() + 11).is_multiple_of(64) {
        header.push(' ');
    }
    header.push('\n');
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend(u16::try_from(header.len())?.to_le_bytes());
    file.extend(header.bytes());
    file.extend(0..48);
    Ok(env.write("picture.npy", file)?.display().to_string())
}

const JOINTS: &str = "sensor_msgs/msg/JointState";

#[test]
fn a_subscription_is_an_input_port_that_gives_way_to_a_port_that_publishes() -> Result {
    run("a_subscription_is_an_input_port", NEEDS, |env| {
        let _names = env.yarpserver()?;
        let (twist, cmd) = ("geometry_msgs/msg/Twist", env.topic("base/cmd"));
        let ear = env.dds_subscriber(&cmd, twist, "--count 1")?;
        let pose = env.topic("head/state/o");
        let eye = env.dds_subscriber(&pose, JOINTS, "--count 1")?;
        let bridge = bridge(env)?;
        until_typed(&bridge, &cmd, twist, "")?;
        // As `yarp connect /joy /base/cmd:i`.
        let connects = format!("out_topic_connect={cmd}:i");
        let fields = r#"{"linear": {"x": 0.25}}"#;
        let said = ["--type", twist, "--value", fields, "--option", &connects];
        let _joy = port(env, &env.topic("joy"), &said)?;
        let heard = ear.messages(1).map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(heard[0]["fields"]["linear"]["x"], 0.25, "{heard:?}");
        // /head/state/o has an input port by now; the robot's /head/state:o becomes that topic.
        until_typed(&bridge, &pose, JOINTS, "")?;
        let joints = r#"{"name": ["a", "b"], "position": [0.5, -1.0]}"#;
        let said = ["--type", JOINTS, "--value", joints];
        let _head = port(env, &env.topic("head/state:o"), &said)?;
        eye.messages(1).map_err(|error| error.context(bridge.tail()))?;
        Ok(())
    })
}

#[test]
fn ports_have_the_types_of_what_they_send() -> Result {
    run("ports_have_the_types_of_what_they_send", NEEDS, |env| {
        let _names = env.yarpserver()?;
        let [head, view, words] = ["head/state:o", "view", "words"].map(|name| env.topic(name));
        let pose = r#"{"name": ["a", "b"], "position": [0.5, -1.0]}"#;
        let _head = port(env, &head, &["--type", JOINTS, "--value", pose])?;
        let file = picture(env)?;
        let _view = port(env, &view, &["--type", "Image", "--file", &file])?;
        let said = ["--type", "NativeObject", "--value", "\"hello icub\""];
        let _words = port(env, &words, &said)?;
        let bridge = bridge(env)?;
        until_typed(&bridge, &head, JOINTS, "a listener on")?;
        until_typed(&bridge, &view, "sensor_msgs/msg/Image", "a listener on")?;
        until_typed(&bridge, &words, "wrapyfi_msgs/msg/NativeObject", "a listener on")?;

        // A subscriber that wants another type gets it where that can be made of it.
        let text = env.dds_subscriber(&words, "std_msgs/msg/String", "--count 1")?;
        let heard = text.messages(1).map_err(|error| error.context(bridge.tail()))?;
        assert!(heard[0].to_string().contains("hello icub"), "{heard:?}");
        // Elsewhere it is named.
        let strange = env.dds_subscriber(&view, "std_msgs/msg/String", "")?;
        let why = "wants std_msgs/msg/String";
        until_typed(&bridge, &view, "sensor_msgs/msg/Image", why)?;
        drop(strange);

        let eye = env.dds_subscriber(&view, "sensor_msgs/msg/Image", "--count 1")?;
        eye.messages(1).map_err(|error| error.context(bridge.tail()))?;
        let ear = env.dds_subscriber(&in_ros(&head), JOINTS, "--count 1")?;
        let heard = ear.messages(1).map_err(|error| error.context(bridge.tail()))?;
        assert!(heard[0].to_string().contains("0.5"), "{heard:?}");
        Ok(())
    })
}

/// A port that sent bottles comes back with pictures, while the program that wants its bottles is still there: the
/// route has the pictures' type, and names the listener.
#[test]
fn an_old_listener_does_not_make_the_type_of_a_port() -> Result {
    run("an_old_listener_does_not_make_the_type_of_a_port", NEEDS, |env| {
        const OBJECT: &str = "wrapyfi_msgs/msg/NativeObject";
        let _names = env.yarpserver()?;
        let (one, all) = (env.topic("one"), env.topic("all/x"));
        let file = picture(env)?;
        let config = env
            .foreign()
            .endpoint(&format!("  yarp: {{ name_server: \"127.0.0.1:{}\" }}\n", env.yarp_port()))
            .route(Route::untyped(&yarp(&one), &ros2(&one)))
            .route(Route::untyped(&yarp(&env.topic("all/(.*)")), &ros2(&env.topic("all/$1"))));
        let bridge = env.bridge(&config)?;
        let mut old = Vec::new();
        for name in [&one, &all] {
            let said = ["--type", "NativeObject", "--value", "\"hello icub\""];
            let mut bottles = port(env, name, &said)?;
            let listener = env.dds_subscriber(name, OBJECT, "")?;
            listener.messages(1).map_err(|error| error.context(bridge.tail()))?;
            old.push(listener);
            bottles.terminate()?;
            bottles.exits_with(0)?;
        }
        // The route of the pattern ends with its port.
        until_route(&bridge, &format!("{} -> {}", yarp(&all), ros2(&all)), |it| it.is_none())?;
        for name in [&one, &all] {
            let _pictures = port(env, name, &["--type", "Image", "--file", &file])?;
            until_typed(&bridge, name, "sensor_msgs/msg/Image", &format!("wants {OBJECT}"))?;
            let file = env.path("bridge.yaml").display().to_string();
            for way in [["--config", &file], ["--node", "/wrapyfi_bridge"]] {
                let mut why = env.wrapyfi([&["why", &ros2(name)], &way[..]].concat())?;
                why.exit_code()?;
                // Of a pattern it tells of the names that match.
                let is_told = why.stdout().contains(OBJECT) || *name == all;
                anyhow::ensure!(is_told, "{way:?} {}", why.tail());
            }
            let eye = env.dds_subscriber(name, "sensor_msgs/msg/Image", "--count 1")?;
            eye.messages(1).map_err(|error| error.context(bridge.tail()))?;
        }
        Ok(())
    })
}

/// YARP's own camera and control board, at YARP's name server.
#[test]
fn a_real_camera_and_real_encoders_are_in_ros_2() -> Result {
    run("a_real_camera_and_real_encoders_are_in_ros_2", REAL, |env| {
        let number = env.yarp_port().to_string();
        let args = ["--write", "--ip", "127.0.0.1", "--socket", &number];
        let _names = env.yarp_tool("yarpserver", &args)?.pillar();
        let until = |port: &str| real_yarp::exists(env, port);
        until("/root")?;
        let [cam, head] = ["grabber", "head"].map(|name| env.topic(name));
        let bundle = |wrapper, device, name| {
            let args = ["--device", "deviceBundler", "--wrapper_device", wrapper];
            let more = ["--attached_device", device, "--name", name];
            env.yarp_tool("yarpdev", &[args, more].concat())
        };
        let _cam = bundle("frameGrabber_nws_yarp", "fakeFrameGrabber", cam.as_str())?;
        let _head = bundle("controlBoard_nws_yarp", "fakeMotionControl", head.as_str())?;
        let state = format!("{head}/state:o");
        until(&cam)?;
        until(&state)?;
        let bridge = bridge(env)?;
        until_typed(&bridge, &cam, "sensor_msgs/msg/Image", "a listener on")?;
        until_typed(&bridge, &state, JOINTS, "a listener on")?;
        until_typed(&bridge, &format!("{head}/stateExt:o"), JOINTS, "a listener on")?;
        // No program listens, so nothing is sent.
        let mut ping = env.yarp_tool("yarp", &["ping", &cam])?;
        ping.exit_code()?;
        let told = ping.stdout() + &ping.stderr();
        assert!(told.contains("no outgoing connections"), "{told}");
        let eye = env.dds_subscriber(&cam, "sensor_msgs/msg/Image", "--count 1")?;
        eye.messages(1).map_err(|error| error.context(bridge.tail()))?;
        let ear = env.dds_subscriber(&in_ros(&state), JOINTS, "--count 1")?;
        ear.messages(1).map_err(|error| error.context(bridge.tail()))?;
        // Over mjpeg the same camera has files, which are passed on as they are.
        let shown = env.topic("files");
        let route = Route::untyped(&yarp(&cam), &ros2(&shown));
        let config = env.embedded().route(route.with("options", "{ carrier: mjpeg }"));
        let files = env.bridge(&config)?;
        let kind = "sensor_msgs/msg/CompressedImage";
        let eye = env.dds_subscriber(&shown, kind, "--count 1")?;
        let heard = eye.messages(1).map_err(|error| error.context(files.tail()))?;
        assert!(heard[0].to_string().contains("jpeg"), "{heard:?}");
        Ok(())
    })
}
