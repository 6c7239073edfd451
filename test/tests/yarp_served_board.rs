//! A robot of ROS 2 as a control board of YARP: key `board`.

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Process, Result, Route, TIMEOUT, TestEnv, ros2, run, yarp};

const NEEDS: &[Need] = &[Need::Program];
const REAL: &[Need] = &[
    Need::Program,
    Need::Yarp,
    Need::YarpDevice("deviceBundler"),
    Need::YarpDevice("controlBoard_nws_yarp"),
    Need::YarpDevice("remote_controlboard"),
];

const JOINTS: &str = "sensor_msgs/msg/JointState";
const TRAJECTORY: &str = "trajectory_msgs/msg/JointTrajectory";

/// A robot that says where its joints are, the bridge that makes it a board, and what reaches the robot.
struct Robot {
    _states: Process,
    bridge: Process,
    commands: Process,
}

impl Robot {
    fn new(env: &TestEnv, board: &str) -> Result<Self> {
        let [states, commands] = ["states", "commands"].map(|name| ros2(&env.topic(name)));
        let options = "{ joints: [pan, lift], prismatic: [lift], limits: { pan: [-90, 90] } }";
        let route = Route::new(&states, &commands, TRAJECTORY)
            .with("board", &format!("\"{}\"", yarp(board)))
            .with("options", options);
        let bridge = env.bridge(&env.embedded().route(route))?;
        let commands = env.wrapyfi(["echo", &commands, "--type", TRAJECTORY, "--json"])?;
        // Other joints of the same robot are passed over.
        let state = json!({
            "name": ["lift", "pan", "wheel"], "position": [0.25, std::f64::consts::FRAC_PI_4, 3.0],
        });
        let publish = ["pub", &states, "--type", JOINTS, "--value", &state.to_string()];
        let states = env.wrapyfi([&publish[..], &["--rate", "20"]].concat())?;
        Ok(Self { _states: states, bridge, commands })
    }

    /// Waits until the robot is told to have `pan` at this place, in radians.
    fn is_sent(&self, pan: f64) -> Result<Value> {
        let sent = |echoed: &Value| {
            let point = echoed["value"]["points"].as_array()?.last()?;
            let place = point["positions"][0].as_f64()?;
            ((place - pan).abs() < 1e-6).then(|| echoed["value"].clone())
        };
        self.commands
            .wait_until(&format!("a movement to {pan}"), |output| {
                output.objects().find_map(|it| sent(&it))
            })
            .map_err(|error| error.context(self.bridge.tail()))
    }
}

#[test]
fn a_robot_of_ros_2_is_read_and_moved_as_a_board() -> Result {
    run("a_robot_of_ros_2_is_read_and_moved_as_a_board", NEEDS, |env| {
        let _names = env.yarpserver()?;
        let board = env.topic("arm");
        let robot = Robot::new(env, &board)?;
        let state = yarp(&format!("{board}/stateExt:o"));
        // Our own program asks the board for names and kinds of its joints, as of any other.
        let echo = env.wrapyfi(["echo", &state, "--type", JOINTS, "--json"])?;
        let heard = echo.wait_until("the joints by name", |output| {
            output.objects().find(|it| it["value"]["name"] == json!(["pan", "lift"]))
        })?;
        let pan = heard["value"]["position"][0].as_f64().unwrap_or_default();
        assert!((pan - std::f64::consts::FRAC_PI_4).abs() < 1e-6, "{heard}");
        assert_eq!(heard["value"]["position"][1], json!(0.25), "{heard}");
        let rpc = yarp(&format!("{board}/rpc:i"));
        let call = |words: Value| -> Result<String> {
            let words = words.to_string();
            let mut call =
                env.wrapyfi(["call", &rpc, "--option", "bottle=true", "--args", &words])?;
            call.exits_with(0)?;
            Ok(call.stdout())
        };
        let told = call(json!(["get", "encs"]))?;
        assert!(told.contains("45.0 0.25"), "{told}");
        assert!(call(json!(["set", "vel", 0, 30.0]))?.contains("ok"));
        assert!(call(json!(["set", "pos", 0, -180.0]))?.contains("ok"));
        let sent = robot.is_sent(-std::f64::consts::FRAC_PI_2)?;
        assert_eq!(sent["joint_names"], json!(["pan", "lift"]));
        assert_eq!(
            sent["points"][1]["positions"][1],
            json!(0.25),
            "what does not move stays: {sent}"
        );
        let time = &sent["points"][1]["time_from_start"];
        assert_eq!((&time["sec"], &time["nanosec"]), (&json!(4), &json!(500_000_000)), "{sent}");
        let words = json!(["set", "icmd", "cmod", 0, "vel"]).to_string();
        let mut refused =
            env.wrapyfi(["call", &rpc, "--option", "bottle=true", "--args", &words])?;
        refused.exits_with(1)?;
        assert!(refused.stderr().contains("[fail]"), "no trajectory has velocities alone");
        Ok(())
    })
}

/// YARP's own client, behind YARP's own server: what goes through both is what a module of a humanoid asks for.
#[test]
fn remote_controlboard_reads_and_moves_a_robot_of_ros_2() -> Result {
    run("remote_controlboard_reads_and_moves_a_robot_of_ros_2", REAL, |env| {
        let _names = env.yarpserver()?;
        let [board, mirror] = ["arm", "mirror"].map(|name| env.topic(name));
        let robot = Robot::new(env, &board)?;
        let state = yarp(&format!("{board}/stateExt:o"));
        let echo = env.wrapyfi(["echo", &state, "--type", JOINTS, "--json"])?;
        echo.objects(1)?;
        let local = env.topic("client");
        let client = [
            ("--device", "deviceBundler"),
            ("--wrapper_device", "controlBoard_nws_yarp"),
            ("--attached_device", "remote_controlboard"),
            ("--remote", &board),
            ("--local", &local),
            ("--name", &mirror),
            ("--period", "0.05"),
        ];
        let client: Vec<&str> = client.into_iter().flat_map(|(key, value)| [key, value]).collect();
        let _client = env.yarp_tool("yarpdev", &client)?.pillar();
        let state = yarp(&format!("{mirror}/stateExt:o"));
        let echo = env.wrapyfi(["echo", &state, "--type", JOINTS, "--json"])?;
        let heard = echo.wait_until("the robot behind both", |output| {
            output.objects().find(|it| {
                let pan = it["value"]["position"][0].as_f64();
                pan.is_some_and(|pan| (pan - std::f64::consts::FRAC_PI_4).abs() < 1e-6)
            })
        })?;
        assert_eq!(heard["value"]["name"], json!(["pan", "lift"]), "names and kinds: {heard}");
        let rpc = yarp(&format!("{mirror}/rpc:i"));
        for (words, wanted) in [
            (json!(["get", "llim", 0]), "-90.0 90.0"),
            (json!(["get", "icmd", "cmds"]), "pos"),
            (json!(["set", "icmd", "cmod", 0, "posd"]), "ok"),
            (json!(["set", "pos", 0, 30.0]), "ok"),
        ] {
            let words = words.to_string();
            let mut call =
                env.wrapyfi(["call", &rpc, "--option", "bottle=true", "--args", &words])?;
            call.exits_with(0)?;
            assert!(call.stdout().contains(wanted), "{words}: {}", call.stdout());
        }
        robot.is_sent(30_f64.to_radians())?;
        Ok(())
    })
}

/// Answers of `wrapyfi why` about a board, without a program that says where the joints are to a client that is
/// connected.
#[test]
fn what_a_board_lacks_is_told() -> Result {
    run("what_a_board_lacks_is_told", NEEDS, |env| {
        let _names = env.yarpserver()?;
        let board = env.topic("arm");
        let [states, commands] = ["states", "commands"].map(|name| ros2(&env.topic(name)));
        let route = Route::new(&states, &commands, TRAJECTORY)
            .with("board", &format!("\"{}\"", yarp(&board)))
            .with("options", "{ joints: [pan, lift] }");
        let _bridge = env.bridge(&env.embedded().route(route))?;
        let file = env.path("bridge.yaml").display().to_string();
        let ask = |name: &str, end: &str, from: [&str; 2]| -> Result<Value> {
            let name = yarp(&format!("{name}{end}"));
            let mut why = env.wrapyfi(["why", "--json", &name].into_iter().chain(from))?;
            why.exit_code()?;
            Ok(serde_json::from_str(why.stdout().trim())?)
        };
        let of_file = ["--config", &file];
        let until = |end: &str, words: &str| -> Result<Value> {
            let deadline = std::time::Instant::now() + TIMEOUT;
            loop {
                let told = ask(&board, end, of_file)?;
                if told.to_string().contains(words) {
                    return Ok(told);
                }
                anyhow::ensure!(std::time::Instant::now() < deadline, "no {words:?}: {told}");
            }
        };
        let says = |names: Value| {
            let places: Vec<f64> = names.as_array().into_iter().flatten().map(|_| 0.5).collect();
            let state = json!({ "name": names, "position": places }).to_string();
            env.wrapyfi(["pub", &states, "--type", JOINTS, "--value", &state, "--rate", "20"])
        };
        let told = until("", "nobody publishes")?;
        assert!(told["what"].to_string().contains(&states), "{told}");
        let some = says(json!(["lift"]))?;
        for end in ["", "/rpc:i", "/command:i", "/state:o", "/stateExt:o"] {
            until(end, r#"no joint \"pan\", which option joints names; those that move are lift"#)?;
        }
        drop(some);
        let _all = says(json!(["pan", "lift"]))?;
        let told = until("/rpc:i", &format!("nobody listens to {commands}"))?;
        assert!(told["passed"].to_string().contains("/stateExt:o at 127.0.0.1:"), "{told}");
        let _robot = env.wrapyfi(["echo", &commands, "--type", TRAJECTORY, "--json"])?;
        until("", "the board is open, and no client is connected")?;
        let state = yarp(&format!("{board}/state:o"));
        let _reader = env.wrapyfi(["echo", &state, "--type", "NativeObject", "--json"])?;
        let told = until("/state:o", "state:o at 127.0.0.1:")?;
        let connected = || -> Result<Value> { until("/state:o", "answers; connected: /") };
        assert!(connected()?["cause"].is_null(), "{told}");
        let by_node = ask(&board, "/state:o", ["--node", "/wrapyfi_bridge"])?;
        assert!(by_node["passed"].to_string().contains("answers; connected: /"), "{by_node}");
        assert!(by_node["cause"].is_null(), "{by_node}");
        Ok(())
    })
}
