//! A control board of YARP, moved from ROS 2: `yarpdev` with `controlBoard_nws_yarp` around
//! `fakeMotionControl`, at our name server.

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Process, Result, Route, TestEnv, ros2, run, yarp};

const NEEDS: &[Need] = &[
    Need::Program,
    Need::Yarp,
    Need::YarpDevice("deviceBundler"),
    Need::YarpDevice("controlBoard_nws_yarp"),
    Need::YarpDevice("fakeMotionControl"),
];

const JOINTS: &str = "sensor_msgs/msg/JointState";
const TRAJECTORY: &str = "trajectory_msgs/msg/JointTrajectory";
const NAMES: [&str; 3] = ["neck_pitch", "neck_roll", "torso_heave"];

/// A board with two joints that turn and one that slides.
fn board(env: &TestEnv, name: &str) -> Result<Process> {
    let names = format!("({})", NAMES.join(" "));
    let args = [
        ("--device", "deviceBundler"),
        ("--wrapper_device", "controlBoard_nws_yarp"),
        ("--attached_device", "fakeMotionControl"),
        ("--name", name),
        ("--period", "0.05"),
        ("--GENERAL::Joints", "3"),
        ("--GENERAL::AxisName", &names),
        ("--GENERAL::AxisType", "(revolute revolute prismatic)"),
    ];
    let args: Vec<&str> = args.into_iter().flat_map(|(name, value)| [name, value]).collect();
    Ok(env.yarp_tool("yarpdev", &args)?.pillar())
}

/// The first state whose positions are these.
fn moved(echo: &Process, positions: [f64; 3]) -> Result<Value> {
    echo.wait_until(&format!("the joints at {positions:?}"), |output| {
        output.objects().find(|state| {
            let found = state["value"]["position"].as_array().cloned().unwrap_or_default();
            let found = found.iter().filter_map(Value::as_f64);
            found.clone().count() == 3
                && found.zip(positions).all(|(found, wanted)| (found - wanted).abs() < 1e-6)
        })
    })
}

#[test]
fn a_board_is_moved_by_ros_and_shows_it() -> Result {
    run("a_board_is_moved_by_ros_and_shows_it", NEEDS, |env| {
        let _server = env.yarpserver()?;
        let part = env.topic("head");
        let _board = board(env, &part)?;
        let [states, command, path] =
            ["joint_states", "command", "trajectory"].map(|name| ros2(&format!("{part}/{name}")));
        let to_board = format!("{{ out_topic_connect: \"{part}/command:i\" }}");
        let routes = [
            Route::new(&yarp(&format!("{part}/state:o")), &states, JOINTS),
            Route::new(&command, &yarp(&format!("/bridge{part}/state")), JOINTS)
                .with("options", &to_board),
            Route::new(&path, &yarp(&format!("/bridge{part}/path")), TRAJECTORY)
                .with("options", &to_board),
        ];
        let config = routes.into_iter().fold(env.embedded(), wrapyfi_e2e::Config::route);
        let bridge = env.bridge(&config)?;
        let echo = env.wrapyfi(["echo", &states, "--type", JOINTS, "--json"])?;
        let at_rest = moved(&echo, [0.0; 3]).map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(at_rest["value"]["name"], json!(NAMES), "told by the board: {at_rest}");
        let stamp = &at_rest["value"]["header"]["stamp"];
        assert!(stamp["sec"].as_i64() > Some(1_700_000_000), "the envelope's time: {at_rest}");

        // In another order than the board's; what slides is metres on both sides.
        let names = [NAMES[2], NAMES[0], NAMES[1]];
        let wanted = json!({ "name": names, "position": [0.05, 0.5, -0.25] }).to_string();
        let publish = ["pub", &command, "--type", JOINTS, "--value", &wanted, "--rate", "20"];
        let publisher = env.wrapyfi(publish)?;
        moved(&echo, [0.5, -0.25, 0.05]).map_err(|error| error.context(bridge.tail()))?;
        drop(publisher);

        let point = |place: f64, nanosec: u32| {
            let time = json!({ "sec": 0, "nanosec": nanosec });
            json!({ "positions": [0.1, place, -place], "time_from_start": time })
        };
        let points = [point(0.75, 0), point(1.0, 100_000_000)];
        let wanted = json!({ "joint_names": names, "points": points }).to_string();
        // Slower than it is played.
        let publish = ["pub", &path, "--type", TRAJECTORY, "--value", &wanted, "--rate", "1"];
        let _publisher = env.wrapyfi(publish)?;
        for place in [0.75, 1.0] {
            moved(&echo, [place, -place, 0.1]).map_err(|error| error.context(bridge.tail()))?;
        }
        Ok(())
    })
}

#[test]
fn the_extended_state_has_velocities_and_torques() -> Result {
    run("the_extended_state_has_velocities_and_torques", NEEDS, |env| {
        let _server = env.yarpserver()?;
        let part = env.topic("arm");
        let _board = board(env, &part)?;
        let endpoint = yarp(&format!("{part}/stateExt:o"));
        let echo = env.wrapyfi(["echo", &endpoint, "--type", JOINTS, "--json"])?;
        let heard = echo.objects(1)?.remove(0);
        let state = &heard["value"];
        assert_eq!(state["name"], json!(NAMES), "{heard}");
        for field in ["position", "velocity", "effort"] {
            assert_eq!(state[field].as_array().map(Vec::len), Some(3), "{field}: {heard}");
        }
        // As a plain bottle it has the time of its envelope, too.
        let echo = env.wrapyfi(["echo", &endpoint, "--type", "NativeObject", "--json"])?;
        let heard = echo.objects(1)?.remove(0);
        assert!(heard["stamp"].as_f64() > Some(1.7e9), "{heard}");
        assert_eq!(heard["value"][1], json!("[ok]"), "{heard}");
        Ok(())
    })
}

/// The board of the test lets its joints go from 0 to 100 degrees, or metres.
#[test]
fn a_joint_beyond_its_limits_is_named_once_and_the_board_decides() -> Result {
    run("a_joint_beyond_its_limits_is_named_once_and_the_board_decides", NEEDS, |env| {
        let _server = env.yarpserver()?;
        let part = env.topic("limited");
        let _board = board(env, &part)?;
        let state = yarp(&format!("{part}/state:o"));
        let echo = env.wrapyfi(["echo", &state, "--type", JOINTS, "--json"])?;
        moved(&echo, [0.0; 3])?;
        let command = format!("{part}/command/i");
        let route = Route::new(&ros2(&command), &yarp(&command), JOINTS);
        let bridge = env.bridge(&env.embedded().route(route))?;
        let wanted = json!({ "name": NAMES, "position": [2.0, 0.25, 0.05] }).to_string();
        let (topic, rate) = (ros2(&command), ["--rate", "20"]);
        let publish = ["pub", &topic, "--type", JOINTS, "--value", &wanted];
        let _publisher = env.wrapyfi([&publish[..], &rate].concat())?;
        let said = "neck_pitch is to go to 2.000 rad (114.6°), beyond its limits, 0.000 rad (0.0°) and \
                    1.745 rad (100.0°)";
        bridge.wait_until("the joint to be named", |output| {
            output.err.iter().any(|line| line.contains(said)).then_some(())
        })?;
        // It is told to the board all the same.
        moved(&echo, [2.0, 0.25, 0.05]).map_err(|error| error.context(bridge.tail()))?;
        bridge.wait_until("one line", |output| {
            let lines = output.err.iter().filter(|line| line.contains("beyond its limits"));
            (lines.count() == 1).then_some(())
        })
    })
}

/// Route that `yarp_bridge` makes of a topic of ROS: to the port that its name means.
#[test]
fn a_topic_that_means_the_command_port_moves_the_board() -> Result {
    run("a_topic_that_means_the_command_port_moves_the_board", NEEDS, |env| {
        let _server = env.yarpserver()?;
        let part = env.topic("leg");
        let _board = board(env, &part)?;
        let endpoint = yarp(&format!("{part}/state:o"));
        let echo = env.wrapyfi(["echo", &endpoint, "--type", JOINTS, "--json"])?;
        moved(&echo, [0.0; 3])?;
        let command = format!("{part}/command/i");
        let route = Route::new(&ros2(&command), &yarp(&command), JOINTS);
        let bridge = env.bridge(&env.embedded().route(route))?;
        let wanted = json!({ "name": NAMES, "position": [0.5, -0.25, 0.05] }).to_string();
        let (topic, rate) = (ros2(&command), ["--rate", "20"]);
        let publish = ["pub", &topic, "--type", JOINTS, "--value", &wanted];
        let _publisher = env.wrapyfi([&publish[..], &rate].concat())?;
        moved(&echo, [0.5, -0.25, 0.05]).map_err(|error| error.context(bridge.tail()))?;
        Ok(())
    })
}
