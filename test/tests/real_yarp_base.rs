//! A mobile base of YARP in ROS 2: its laser, its odometry, its camera with depth, and velocities to it. Each is
//! `yarpdev` with a server of YARP's around one of its fake devices, at our name server.

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Process, Result, Route, TestEnv, asked_until, ros2, run, yarp};

/// Needs of a test that runs this server of YARP around this device.
macro_rules! needs {
    ($wrapper:literal, $device:literal) => {
        &[
            Need::Program,
            Need::Yarp,
            Need::Program,
            Need::YarpDevice("deviceBundler"),
            Need::YarpDevice($wrapper),
            Need::YarpDevice($device),
        ]
    };
}

const SCAN: &str = "sensor_msgs/msg/LaserScan";
const ODOMETRY: &str = "nav_msgs/msg/Odometry";
const TWIST: &str = "geometry_msgs/msg/Twist";
const INFO: &str = "sensor_msgs/msg/CameraInfo";

fn device(env: &TestEnv, wrapper: &str, device: &str, more: &[&str]) -> Result<Process> {
    let bundle = ["--device", "deviceBundler", "--wrapper_device", wrapper];
    let args = [&bundle[..], &["--attached_device", device], more].concat();
    Ok(env.yarp_tool("yarpdev", &args)?.pillar())
}

/// The first message of a port of YARP that `is_wanted`, read as a type. Devices send before they have measured.
fn first(
    env: &TestEnv,
    port: &str,
    kind: &str,
    is_wanted: impl Fn(&Value) -> bool,
) -> Result<Value> {
    let echo = env.wrapyfi(["echo", &yarp(port), "--type", kind, "--json"])?;
    echo.wait_until(&format!("a {kind}"), |output| {
        output.objects().find(|heard| is_wanted(&heard["value"]))
    })
}

fn number(value: &Value, path: &str) -> f64 {
    let found = value.pointer(path).and_then(Value::as_f64);
    found.unwrap_or_else(|| panic!("no number {path} in {value}"))
}

#[test]
fn a_laser_of_yarp_is_a_laser_of_ros() -> Result {
    let needs = needs!("rangefinder2D_nws_yarp", "fakeLaser");
    run("a_laser_of_yarp_is_a_laser_of_ros", needs, |env| {
        let _server = env.yarpserver()?;
        let port = env.topic("laser:o");
        let range = ["--SENSOR::min_angle", "-90", "--SENSOR::max_angle", "90"];
        let rays = ["--SENSOR::resolution", "0.5", "--test", "use_constant"];
        let wall = ["--CONSTANT_MODE::const_distance", "1.25", "--name", &port];
        let args = [range, rays, wall].concat();
        let _laser = device(env, "rangefinder2D_nws_yarp", "fakeLaser", &args)?;
        let heard = first(env, &port, SCAN, |scan| scan["ranges"][0] == 1.25)?;
        let scan = &heard["value"];
        let half = std::f64::consts::FRAC_PI_2;
        let step = 0.5_f64.to_radians();
        for (path, wanted) in [
            ("/angle_min", -half),
            ("/angle_max", half - step),
            ("/angle_increment", step),
            ("/ranges/0", 1.25),
            ("/ranges/359", 1.25),
        ] {
            assert!((number(scan, path) - wanted).abs() < 1e-5, "{path}: {heard}");
        }
        assert_eq!(scan["ranges"].as_array().map(Vec::len), Some(360), "{heard}");
        assert!(number(scan, "/header/stamp/sec") > 1.7e9, "the envelope's time: {heard}");
        Ok(())
    })
}

#[test]
fn an_odometry_of_yarp_is_one_of_ros() -> Result {
    let needs = needs!("odometry2D_nws_yarp", "fakeOdometry2D");
    run("an_odometry_of_yarp_is_one_of_ros", needs, |env| {
        let _server = env.yarpserver()?;
        let base = env.topic("base");
        let _base = device(env, "odometry2D_nws_yarp", "fakeOdometry2D", &["--name", &base])?;
        let heard = first(env, &format!("{base}/odometry:o"), ODOMETRY, Value::is_object)?;
        let odometry = &heard["value"];
        assert_eq!(odometry["header"]["frame_id"], "odom", "{heard}");
        assert_eq!(odometry["child_frame_id"], "base_link", "{heard}");
        // The device moves at random, up to 5 m/s and 5 degrees a second.
        let turn = number(odometry, "/twist/twist/angular/z");
        assert!((0.0..=5_f64.to_radians()).contains(&turn), "{heard}");
        let [z, w] =
            ["z", "w"].map(|part| number(odometry, &format!("/pose/pose/orientation/{part}")));
        assert!((z.hypot(w) - 1.0).abs() < 1e-9, "{heard}");
        assert!(number(odometry, "/header/stamp/sec") > 1.7e9, "{heard}");
        Ok(())
    })
}

#[test]
fn a_twist_of_ros_moves_a_base_of_yarp() -> Result {
    let needs = needs!("mobileBaseVelocityControl_nws_yarp", "fakeNavigation");
    run("a_twist_of_ros_moves_a_base_of_yarp", needs, |env| {
        let _server = env.yarpserver()?;
        let base = env.topic("base");
        let args = ["--local", &base];
        let wrapper = "mobileBaseVelocityControl_nws_yarp";
        let _base = device(env, wrapper, "fakeNavigation", &args)?;
        let velocity = ros2(&env.topic("cmd_vel"));
        let to_base = format!("{{ base: velocity, out_topic_connect: \"{base}/data:i\" }}");
        let ours = yarp(&env.topic("bridge/velocity:o"));
        let route = Route::new(&velocity, &ours, TWIST).with("options", &to_base);
        let bridge = env.bridge(&env.embedded().route(route))?;
        let wanted = json!({ "linear": { "x": 0.5, "y": -0.25 }, "angular": { "z": 0.125 } });
        let wanted = wanted.to_string();
        let publish = ["pub", &velocity, "--type", TWIST, "--value", &wanted, "--rate", "20"];
        let _publisher = env.wrapyfi(publish)?;
        let rpc = yarp(&format!("{base}/rpc:i"));
        let ask =
            ["call", &rpc, "--option", "bottle=true", "--args", "[\"getLastVelocityCommandRPC\"]"];
        let told = asked_until("the velocity that the base was told", || {
            let mut call = env.wrapyfi(ask)?;
            // The port answers once the device is attached to it.
            call.exit_code()?;
            let told: Value = serde_json::from_str(call.stdout().trim()).unwrap_or_default();
            let told: Vec<f64> =
                told.as_array().into_iter().flatten().filter_map(Value::as_f64).collect();
            Ok(told.ends_with(&[0.5, -0.25, 0.125_f64.to_degrees()]).then_some(()))
        });
        told.map_err(|error| error.context(bridge.tail()))
    })
}

/// The stamps of the pictures that an echo has shown, in seconds.
fn stamps(echo: &Process) -> Result<Vec<f64>> {
    let stamp = |picture: Value| picture["stamp"].as_f64();
    echo.wait_until("its pictures", |output| Some(output.objects().filter_map(stamp).collect()))
}

#[test]
fn a_camera_with_depth_has_its_calibration_beside_each_picture() -> Result {
    let needs = needs!("rgbdSensor_nws_yarp", "fakeDepthCamera");
    run("a_camera_with_depth_has_its_calibration_beside_each_picture", needs, |env| {
        let _server = env.yarpserver()?;
        let camera = env.topic("depthCamera");
        let args = ["--name", &camera, "--period", "0.05"];
        let _camera = device(env, "rgbdSensor_nws_yarp", "fakeDepthCamera", &args)?;
        let bridge = env.executable("yarp_bridge", &[])?;
        let echo = |topic: &str, kind: &str| {
            let topic = ros2(&format!("{camera}/{topic}"));
            env.wrapyfi(["echo", &topic, "--type", kind, "--json"])
        };
        let size = [json!(240), json!(320)];
        for (eye, encoding) in [("rgbImage", "rgb8"), ("depthImage", "32FC1")] {
            let infos = echo(&format!("{eye}/camera_info"), INFO)?;
            // The first ones may come before the camera has told.
            let told = |info: &Value| info["value"]["distortion_model"] == "plumb_bob";
            let heard = infos
                .wait_until("a calibration", |output| output.objects().find(told))
                .map_err(|error| error.context(bridge.tail()))?;
            let info = &heard["value"];
            assert_eq!((info["width"].as_i64(), info["height"].as_i64()), (Some(320), Some(240)));
            let k = [512.0, 0.0, 235.0, 0.0, 512.0, 231.0, 0.0, 0.0, 1.0];
            assert_eq!(info["k"], json!(k), "{heard}");
            assert_eq!(info["p"][2], json!(235.0), "{heard}");
            // They come on two connections: one picture whose calibration came is enough.
            let pictures = echo(&format!("{eye}/o"), "sensor_msgs/msg/Image")?;
            let seen = pictures.objects(1).map_err(|error| error.context(bridge.tail()))?.remove(0);
            assert_eq!(seen["encoding"], encoding, "{seen}");
            assert_eq!(
                seen["shape"].as_array().map(|shape| &shape[..2]),
                Some(&size[..]),
                "{seen}"
            );
            infos.wait_until("a calibration with the stamp of a picture", |output| {
                let shown = |info: &Value| {
                    let stamp = info.pointer("/value/header/stamp")?;
                    Some(stamp["sec"].as_f64()? + stamp["nanosec"].as_f64()? * 1e-9)
                };
                let pictures = stamps(&pictures).ok()?;
                let same = |stamp: f64| pictures.iter().any(|one| (one - stamp).abs() < 1e-5);
                output.objects().filter_map(|info| shown(&info)).any(same).then_some(())
            })?;
        }
        Ok(())
    })
}
