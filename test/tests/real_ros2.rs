//! A real ROS 2 around our programs: its command line tools, nodes of rclpy, launch and bags, under each
//! middleware that is installed.

use serde_json::{Value, json};
use wrapyfi_e2e::{
    Config, Need, Process, RealRos2, Result, Route, TestEnv, repository, ros2, run, sha256, texts,
    zeromq,
};

const NEEDS: &[Need] = &[Need::Program, Need::Python, Need::Ros2];

/// Runs a test under one middleware, with more needs.
fn under(
    test: &str,
    rmw: &'static str,
    needs: &[Need],
    body: impl FnOnce(&TestEnv, &RealRos2<'_>) -> Result,
) -> Result {
    // CycloneDDS inside is not on Zenoh.
    let ours: &[Need] = if rmw == "rmw_zenoh_cpp" { &[Need::Rmw] } else { &[] };
    let needs = [NEEDS, &[Need::Ros2Package(rmw)], ours, needs].concat();
    run(test, &needs, |env| body(env, &RealRos2::new(env, rmw)?))
}

/// The same tests under each middleware, each with what it needs besides.
macro_rules! under_each {
    ([$($rmw:ident),*] $tests:tt) => { $(under_one! { $rmw $tests })* };
}

macro_rules! under_one {
    ($rmw:ident { $($test:ident [$($need:expr),*];)* }) => {
        mod $rmw {
            use super::Need;
            $(
                #[test]
                fn $test() -> super::Result {
                    let rmw = stringify!($rmw);
                    let name = format!("{rmw}_{}", stringify!($test));
                    super::under(&name, rmw, &[$($need),*], super::$test)
                }
            )*
        }
    };
}

under_each! { [rmw_cyclonedds_cpp, rmw_fastrtps_cpp, rmw_zenoh_cpp] {
    the_tools_show_our_node [];
    topic_echo_and_hz_hear_a_script [];
    topic_pub_reaches_a_script [];
    types_of_many_fields_go_through_zeromq_and_back [];
    images_go_through_zeromq_and_back [];
    a_late_latched_subscription_gets_the_last_message [];
    ours_echoes_and_publishes_with_types_of_the_installation [];
    services_of_rclpy_are_called [];
    service_call_asks_ours [];
    parameters_are_listed_got_set_and_dumped [];
    parameters_of_a_node_of_rclpy_are_set_by_ours [];
    launch_starts_the_bridge [Need::Ros2Package("launch_ros")];
    launch_without_arguments_keeps_running [Need::Ros2Package("launch_ros")];
    lifecycle_set_drives_the_bridge [Need::Ros2Package("ros2lifecycle")];
    launch_activates_the_bridge_as_a_lifecycle_node [Need::Ros2Package("launch_ros"), Need::Ros2Package("ros2lifecycle")];
    run_finds_the_nodes [Need::Ros2Package("ros2pkg"), Need::Ros2Package("ros2run")];
    ros2_wrapyfi_is_our_program [];
    doctor_warns_of_what_a_bridge_waits_for [Need::Ros2Package("ros2doctor")];
    a_bag_keeps_what_came_from_a_script [Need::Ros2Package("ros2bag")];
    recordings_go_both_ways [Need::Ros2Package("ros2bag"), Need::Ros2Package("rosbag2_storage_mcap")];
    wrapyfi_on_rclpy_talks_with_ours [Need::WrapyfiOnRos2];
}}

/// Our bridge as a node in this ROS 2, with these routes and the broker of ZeroMQ.
fn bridge(env: &TestEnv, ros: &RealRos2<'_>, routes: Vec<Route>) -> Result<Process> {
    node(env, ros, "wrapyfi_bridge", env.embedded(), routes)
}

/// Our bridge as the node `name`.
fn node(
    env: &TestEnv,
    ros: &RealRos2<'_>,
    name: &str,
    config: Config,
    routes: Vec<Route>,
) -> Result<Process> {
    let config = routes.into_iter().fold(config, Config::route);
    let file = env.write(&format!("{name}.yaml"), config.yaml())?;
    let parameter = format!("config_file:={}", file.display());
    ros.node("bridge", &["-p", &parameter, "-r", &format!("__node:={name}")])
}

/// Two bridges, since none hears itself: one from ROS 2 to ZeroMQ, one back.
fn two_bridges(
    env: &TestEnv,
    ros: &RealRos2<'_>,
    [there, between, back]: [&str; 3],
    kind: &str,
) -> Result<[Process; 2]> {
    let out = Route::new(&ros2(there), &zeromq(between), kind);
    let home = Route::new(&zeromq(between), &ros2(back), kind);
    Ok([
        node(env, ros, "out", env.embedded(), vec![out])?,
        node(env, ros, "home", env.foreign(), vec![home])?,
    ])
}

/// Waits for a line of its output that has all of `words`.
fn prints(process: &Process, words: &[&str]) -> Result<String> {
    process.wait_until(&words.join(", "), |output| {
        let all = |line: &&String| words.iter().all(|word| line.contains(word));
        output.out.iter().chain(&output.err).find(all).cloned()
    })
}

const STRING: &str = "std_msgs/msg/String";

// Tools -----------------------------------------------------------------------------------------

fn the_tools_show_our_node(env: &TestEnv, ros: &RealRos2<'_>) -> Result {
    let (to, from) = (env.topic("to"), env.topic("from"));
    let routes = vec![
        Route::new(&zeromq(&to), &ros2(&to), "Text"),
        Route::new(&ros2(&from), &zeromq(&from), "geometry_msgs/msg/Twist"),
    ];
    let bridge = bridge(env, ros, routes)?;
    let nodes = ros.seen(&["node", "list"], |said| said.contains("bridge"))?;
    let name = nodes.lines().find(|line| line.contains("bridge")).unwrap_or_default().to_owned();
    assert_eq!(nodes.lines().filter(|line| line.contains("bridge")).count(), 1, "{nodes}");
    let info = ros.seen(&["node", "info", &name], |said| {
        said.contains(&format!("{to}: {STRING}"))
            && said.contains(&format!("{from}: geometry_msgs/msg/Twist"))
            && said.contains("get_parameters: rcl_interfaces/srv/GetParameters")
            // What bridges mark belongs to the node as well.
            && said.contains(&format!("{name}/status: wrapyfi_msgs/msg/BridgeStatus"))
            && said.contains("/diagnostics: diagnostic_msgs/msg/DiagnosticArray")
            && said.contains(&format!("{name}/list_routes: wrapyfi_msgs/srv/ListRoutes"))
            && said.contains(&format!("{name}/change_state: lifecycle_msgs/srv/ChangeState"))
    })?;
    assert!(info.contains("/rosout: rcl_interfaces/msg/Log"), "{info}");
    ros.seen(&["topic", "list", "-t"], |said| {
        said.contains(&format!("{to} [{STRING}]"))
            && said.contains(&format!("{from} [geometry_msgs/msg/Twist]"))
    })?;
    let info = ros.seen(&["topic", "info", "-v", &to], |said| {
        said.contains("Publisher count: 1") && said.contains("Topic type hash: RIHS01_")
    })?;
    let wanted = match ros.names_our_endpoints() {
        true => name.trim_start_matches('/'),
        false => "_CREATED_BY_BARE_DDS_APP_",
    };
    assert!(info.contains(wanted), "{wanted} is named: {info}");
    // Zenoh under the tools may write lines of its own before the answer.
    ros.seen(&["topic", "type", &to], |said| said.lines().any(|line| line.trim() == STRING))?;
    drop(bridge);
    ros.seen(&["node", "list"], |said| !said.contains("bridge")).map(drop)
}

fn topic_echo_and_hz_hear_a_script(env: &TestEnv, ros: &RealRos2<'_>) -> Result {
    let topic = env.topic("object");
    let bridge = bridge(env, ros, vec![Route::new(&zeromq(&topic), &ros2(&topic), STRING)])?;
    let publisher = env.wrapyfi_publisher(&topic, "--flavour small --rate 20 --no-broker")?;
    let mut echo = ros.ros2(&["topic", "echo", "--once", &topic, STRING])?;
    echo.exits_with(0).map_err(|error| error.context(bridge.tail()))?;
    publisher.messages(1)?;
    assert!(echo.stdout().starts_with("data: "), "{}", echo.stdout());
    let hz = ros.ros2(&["topic", "hz", &topic])?;
    prints(&hz, &["average rate"]).map(drop)
}

fn topic_pub_reaches_a_script(env: &TestEnv, ros: &RealRos2<'_>) -> Result {
    let topic = env.topic("chatter");
    let _bridge = bridge(env, ros, vec![Route::new(&ros2(&topic), &zeromq(&topic), "Text")])?;
    let listener = env.wrapyfi_listener(&topic, "")?;
    let value = "{data: 'plain text, no JSON'}";
    let _publisher = ros.ros2(&["topic", "pub", "-r", "10", &topic, STRING, value])?;
    let heard = listener.messages(2)?;
    assert_eq!(heard[0]["sha256"], sha256(br#""plain text, no JSON""#), "{}", heard[0]);
    Ok(())
}

// Types -----------------------------------------------------------------------------------------

/// Random messages of rclpy through a script's middleware, and back to rclpy, unchanged.
fn there_and_back(env: &TestEnv, ros: &RealRos2<'_>, kind: &str) -> Result {
    let name = kind.replace('/', "_");
    let [there, between, back] =
        ["there", "between", "back"].map(|place| env.topic(&format!("{name}_{place}")));
    let bridges = two_bridges(env, ros, [&there, &between, &back], kind)?;
    let subscriber =
        ros.rclpy(&format!("subscribe --topic {back} --type {kind} --count 5 --node ear"), None)?;
    subscriber.event("ready")?;
    let publisher =
        ros.rclpy(&format!("publish --topic {there} --type {kind} --node mouth"), None)?;
    let heard = subscriber
        .messages(5)
        .map_err(|error| error.context(format!("{kind}\n{}", bridges[1].tail())))?;
    publisher
        .sent_in_order("sha256", &texts(&heard, "sha256"))
        .map_err(|error| error.context(kind.to_owned()))
}

pub(crate) fn types_of_many_fields_go_through_zeromq_and_back(
    env: &TestEnv,
    ros: &RealRos2<'_>,
) -> Result {
    for kind in [
        "geometry_msgs/msg/TwistWithCovarianceStamped",
        "sensor_msgs/msg/Imu",
        "sensor_msgs/msg/LaserScan",
        "sensor_msgs/msg/JointState",
        "sensor_msgs/msg/PointCloud2",
        "nav_msgs/msg/OccupancyGrid",
        "diagnostic_msgs/msg/DiagnosticArray",
        "rcl_interfaces/msg/ParameterEvent",
    ] {
        there_and_back(env, ros, kind)?;
    }
    Ok(())
}

pub(crate) fn images_go_through_zeromq_and_back(env: &TestEnv, ros: &RealRos2<'_>) -> Result {
    let [there, between, back] = ["there", "between", "back"].map(|place| env.topic(place));
    let bridges = two_bridges(env, ros, [&there, &between, &back], "Image")?;
    let kind = "sensor_msgs/msg/Image";
    let subscriber =
        ros.rclpy(&format!("subscribe --topic {back} --type {kind} --count 2 --node ear"), None)?;
    subscriber.event("ready")?;
    let pixels: Vec<u8> = (0..4 * 3 * 3).map(|n| n * 7).collect();
    let image = json!({
        "header": {"stamp": {"sec": 12, "nanosec": 345_000_000}, "frame_id": "eye"},
        "height": 3, "width": 4, "encoding": "bgr8", "is_bigendian": 0, "step": 12, "data": pixels,
    });
    let publisher = format!("publish --topic {there} --type {kind} --node mouth");
    let _publisher = ros.rclpy(&publisher, Some(&image.to_string()))?;
    let heard = subscriber.messages(2).map_err(|error| error.context(bridges[1].tail()))?;
    for key in ["height", "width", "encoding", "step", "data"] {
        assert_eq!(heard[0]["value"][key], image[key], "{key} of {}", heard[0]);
    }
    assert_eq!(heard[0]["value"]["header"]["stamp"], image["header"]["stamp"]);
    Ok(())
}

fn a_late_latched_subscription_gets_the_last_message(env: &TestEnv, ros: &RealRos2<'_>) -> Result {
    let topic = env.topic("map");
    let endpoint = ros2(&topic);
    let publish = ["pub", &endpoint, "--type", "nav_msgs/msg/OccupancyGrid", "--value"];
    let value = r#"{"info": {"width": 2, "height": 1}, "data": [100, -1]}"#;
    let rest = ["--qos", "latched", "--rate", "0.001"];
    let _publisher = ros.wrapyfi([&publish[..], &[value], &rest].concat())?;
    let mut echo = ros.ros2(&[
        "topic",
        "echo",
        "--once",
        "--qos-durability",
        "transient_local",
        "--qos-reliability",
        "reliable",
        &topic,
        "nav_msgs/msg/OccupancyGrid",
    ])?;
    echo.exits_with(0)?;
    assert!(echo.stdout().contains("- 100") && echo.stdout().contains("- -1"), "{}", echo.stdout());

    let (kind, kept) = ("std_msgs/msg/Header", env.topic("kept"));
    let value = r#"{"frame_id": "kept"}"#;
    let args = format!("publish --topic {kept} --type {kind} --qos latched --count 1");
    let publisher = ros.rclpy(&args, Some(value))?;
    publisher.messages(1)?;
    let endpoint = ros2(&kept);
    let mut echo =
        ros.wrapyfi(["echo", &endpoint, "--count", "1", "--json", "--timeout", "100"])?;
    assert_eq!(echo.objects(1)?[0]["value"]["frame_id"], "kept");
    echo.exits_with(0)
}

/// Types that are not compiled into ours: found in the installation by the ament index.
pub(crate) fn ours_echoes_and_publishes_with_types_of_the_installation(
    env: &TestEnv,
    ros: &RealRos2<'_>,
) -> Result {
    let kind = "trajectory_msgs/msg/JointTrajectory";
    let (there, back) = (env.topic("there"), env.topic("back"));
    let publisher = ros.rclpy(&format!("publish --topic {there} --type {kind}"), None)?;
    let from = ros2(&there);
    let mut echo = ros.wrapyfi(["echo", &from, "--json", "--count", "3", "--timeout", "100"])?;
    let heard = echo.objects(3)?;
    echo.exits_with(0)?;
    let sent = publisher.wait_until("what it sent", |output| {
        let sent = output.events("message");
        let same = |one: &&Value| sent.iter().any(|other| other["value"] == one["value"]);
        heard.iter().all(|one| same(&one)).then_some(sent.len())
    })?;
    assert!(sent >= 3);
    assert_eq!(heard[0]["type"], kind);

    let subscriber =
        ros.rclpy(&format!("subscribe --topic {back} --type {kind} --count 1"), None)?;
    let to = ros2(&back);
    let value = r#"{"joint_names": ["a"], "points": [{"positions": [1.5], "time_from_start": {"sec": 2}}]}"#;
    let mut publish =
        ros.wrapyfi(["pub", &to, "--type", kind, "--value", value, "--count", "1"])?;
    let heard = subscriber.messages(1)?.remove(0);
    publish.exits_with(0)?;
    assert_eq!(heard["value"]["points"][0]["positions"], json!([1.5]), "{heard}");
    assert_eq!(heard["value"]["points"][0]["time_from_start"]["sec"], 2, "{heard}");
    Ok(())
}

// Services and parameters -----------------------------------------------------------------------

pub(crate) fn services_of_rclpy_are_called(env: &TestEnv, ros: &RealRos2<'_>) -> Result {
    let service = env.topic("set");
    let kind = "std_srvs/srv/SetBool";
    let value = r#"{"success": "=request.data", "message": "=str(request.data)"}"#;
    let server = ros.rclpy(&format!("serve --topic {service} --type {kind}"), Some(value))?;
    server.event("ready")?;
    let endpoint = ros2(&service);
    for (given, on) in [
        (["--value", r#"{"data": true}"#], true),
        (["--args", "[false]"], false),
        (["--kwargs", r#"{"data": true}"#], true),
    ] {
        let call = [&["call", &endpoint, "--json", "--timeout", "60"], &given[..]].concat();
        let mut call = ros.wrapyfi(call)?;
        let told = call.objects(1)?.remove(0);
        call.exits_with(0)?;
        let message = if on { "True" } else { "False" };
        assert_eq!(told["value"], json!({"success": on, "message": message}), "{given:?}");
    }
    Ok(())
}

fn service_call_asks_ours(env: &TestEnv, ros: &RealRos2<'_>) -> Result {
    let service = env.topic("light");
    let (endpoint, kind) = (ros2(&service), "std_srvs/srv/SetBool");
    let value = r#"{"success": true, "message": "so be it"}"#;
    let server = ros.wrapyfi(["serve", &endpoint, "--type", kind, "--value", value, "--json"])?;
    ros.seen(&["service", "list", "-t"], |said| said.contains(&format!("{service} [{kind}]")))?;
    let mut call = ros.ros2(&["service", "call", &service, kind, "{data: true}"])?;
    call.exits_with(0)?;
    assert!(call.stdout().contains("message='so be it'"), "{}", call.stdout());
    assert_eq!(server.objects(1)?[0]["value"], json!({"data": true}));

    let client = format!("call --topic {service} --type {kind}");
    let client = ros.rclpy(&client, Some(r#"{"data": false}"#))?;
    assert_eq!(client.event("reply")?["value"]["message"], "so be it");
    Ok(())
}

fn parameters_are_listed_got_set_and_dumped(env: &TestEnv, ros: &RealRos2<'_>) -> Result {
    let topic = env.topic("x");
    let _bridge = bridge(env, ros, vec![Route::new(&zeromq(&topic), &ros2(&topic), "Text")])?;
    let nodes = ros.seen(&["node", "list"], |said| said.contains("bridge"))?;
    let name = nodes.lines().find(|line| line.contains("bridge")).unwrap_or_default().to_owned();
    let list = ros.seen(&["param", "list", &name], |said| said.contains("config_file"))?;
    assert!(list.contains("use_sim_time"), "{list}");
    ros.seen(&["param", "get", &name, "config_file"], |said| said.contains("bridge.yaml"))?;
    ros.seen(&["param", "set", &name, "use_sim_time", "true"], |said| {
        said.contains("Set parameter successful")
    })?;
    ros.seen(&["param", "get", &name, "use_sim_time"], |said| said.contains("True"))?;
    let mut refused = ros.ros2(&[
        "param",
        "set",
        &name,
        "config_file",
        "other.yaml",
        "--no-daemon",
        "--spin-time",
        "2",
    ])?;
    refused.exit_code()?;
    let said = refused.stdout() + &refused.stderr();
    assert!(said.contains("read-only parameter"), "{said}");
    let dump = ros.seen(&["param", "dump", &name], |said| said.contains("ros__parameters"))?;
    assert!(dump.contains("use_sim_time: true"), "{dump}");
    Ok(())
}

pub(crate) fn parameters_of_a_node_of_rclpy_are_set_by_ours(
    _: &TestEnv,
    ros: &RealRos2<'_>,
) -> Result {
    let node = ros.rclpy("params --node camera", Some(r#"{"rate": 30, "name": "left"}"#))?;
    node.event("ready")?;
    let properties = ["ros2:/camera", "--type", "Properties", "--timeout", "60"];
    let mut echo =
        ros.wrapyfi([&["echo"], &properties[..], &["--count", "1", "--json"]].concat())?;
    let told = echo.objects(1)?.remove(0);
    echo.exits_with(0)?;
    assert_eq!(told["value"]["rate"], 30, "{told}");
    let mut set =
        ros.wrapyfi([&["pub"], &properties[..], &["--value", r#"{"rate": 15}"#]].concat())?;
    set.exits_with(0)?;
    let heard = node.event("set")?;
    assert_eq!((&heard["name"], &heard["value"]), (&json!("rate"), &json!(15)));
    let mut echo =
        ros.wrapyfi([&["echo"], &properties[..], &["--count", "1", "--json"]].concat())?;
    assert_eq!(echo.objects(1)?[0]["value"]["rate"], 15);
    echo.exits_with(0)
}

// Starts ----------------------------------------------------------------------------------------

fn launch_starts_the_bridge(env: &TestEnv, ros: &RealRos2<'_>) -> Result {
    let topic = env.topic("x");
    let config = env.embedded().route(Route::new(&zeromq(&topic), &ros2(&topic), "Text"));
    let file = env.write("routes.yaml", config.yaml())?;
    let argument = format!("config_file:={}", file.display());
    for kind in ["py", "xml", "yaml"] {
        let (launch, namespace) =
            (format!("bridge.launch.{kind}"), format!("namespace:=lab_{kind}"));
        let mut launch = ros.ros2(&["launch", "wrapyfi", &launch, &argument, &namespace])?;
        let node = format!("/lab_{kind}/");
        ros.seen(&["node", "list"], |said| said.lines().any(|line| line.starts_with(&node)))
            .map_err(|error| error.context(launch.tail()))?;
        ros.seen(&["topic", "list"], |said| said.contains(&topic))?;
        launch.terminate()?;
        launch.exit_code()?;
        let said = launch.stdout() + &launch.stderr();
        assert!(!said.contains("process has died"), "{said}");
    }
    Ok(())
}

/// The example that comes with it: where no YARP and no ROS 1 is, their routes wait.
fn launch_without_arguments_keeps_running(_: &TestEnv, ros: &RealRos2<'_>) -> Result {
    let launch = ros.ros2(&["launch", "wrapyfi", "bridge.launch.py"])?;
    ros.seen(&["topic", "list"], |said| said.contains("/camera/left"))
        .map_err(|error| error.context(launch.tail()))?;
    let said = launch.stdout() + &launch.stderr();
    assert!(!said.contains("process has died"), "{said}");
    Ok(())
}

/// File of a bridge that others are to configure.
fn managed(env: &TestEnv) -> Result<String> {
    let topic = env.topic("x");
    let config = env.embedded().route(Route::new(&zeromq(&topic), &ros2(&topic), "Text"));
    Ok(env.write("managed.yaml", config.yaml())?.display().to_string())
}

fn lifecycle_set_drives_the_bridge(env: &TestEnv, ros: &RealRos2<'_>) -> Result {
    let parameter = format!("config_file:={}", managed(env)?);
    let arguments = ["-p", &parameter, "-p", "autostart:=false", "-r", "__node:=managed"];
    let bridge = ros.node("bridge", &arguments)?;
    let is = |state: &str| {
        ros.seen(&["lifecycle", "get", "/managed"], |said| said.lines().any(|line| line == state))
            .map_err(|error| error.context(bridge.tail()))
    };
    is("unconfigured [1]")?;
    ros.seen(&["lifecycle", "nodes"], |said| said.contains("/managed"))?;
    ros.seen(&["lifecycle", "list", "-a", "/managed"], |said| {
        said.contains("- transition_error [62]") && said.contains("Goal: errorprocessing")
    })?;
    for (label, state) in [
        ("configure", "inactive [2]"),
        ("activate", "active [3]"),
        ("deactivate", "inactive [2]"),
        ("cleanup", "unconfigured [1]"),
    ] {
        let set = ["lifecycle", "set", "/managed", label];
        ros.seen(&set, |said| said.contains("Transitioning successful"))?;
        is(state)?;
    }
    Ok(())
}

const MANAGED_LAUNCH: &str = r#"
from launch import LaunchDescription
from launch.actions import EmitEvent, RegisterEventHandler
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from lifecycle_msgs.msg import Transition


def generate_launch_description():
    node = LifecycleNode(package="wrapyfi_bridge", executable="bridge", name="managed", namespace="",
                         parameters=[{"config_file": "FILE", "autostart": False}], output="screen")

    def change(transition):
        mine = lambda action: action is node
        return EmitEvent(event=ChangeState(lifecycle_node_matcher=mine, transition_id=transition))

    configured = OnStateTransition(target_lifecycle_node=node, start_state="configuring", goal_state="inactive",
                                   entities=[change(Transition.TRANSITION_ACTIVATE)])
    return LaunchDescription([node, RegisterEventHandler(configured), change(Transition.TRANSITION_CONFIGURE)])
"#;

fn launch_activates_the_bridge_as_a_lifecycle_node(env: &TestEnv, ros: &RealRos2<'_>) -> Result {
    let file = env.write("managed.launch.py", MANAGED_LAUNCH.replace("FILE", &managed(env)?))?;
    let mut launch = ros.ros2(&["launch", &file.display().to_string()])?;
    let get = ["lifecycle", "get", "/managed"];
    ros.seen(&get, |said| said.lines().any(|line| line == "active [3]"))
        .map_err(|error| error.context(launch.tail()))?;
    launch.terminate()?;
    launch.exit_code()?;
    Ok(())
}

fn run_finds_the_nodes(_: &TestEnv, ros: &RealRos2<'_>) -> Result {
    ros.told(&["pkg", "executables", "wrapyfi_bridge"], |said| {
        let programs = ["bridge", "wrapyfi", "ros1_bridge", "yarp_bridge", "zeromq_bridge"];
        let listed = |name: &str| said.lines().any(|line| line == format!("wrapyfi_bridge {name}"));
        programs.into_iter().all(listed)
    })?;
    let mut check = ros.ros2(&["run", "wrapyfi_bridge", "wrapyfi", "--version"])?;
    check.exits_with(0)
}

/// A copy of the package for Python with its registration as `setup.py` writes it, and its folder.
fn registered(env: &TestEnv, ros: &RealRos2<'_>) -> Result<String> {
    let (package, copy) = (repository().join("wrapyfi_py"), env.path("wrapyfi_py"));
    let (package, copy) = (package.display(), copy.display());
    let install = format!("cp -r {package} {copy} && cd {copy} && python3 setup.py -q egg_info");
    ros.shell(&install)?.exits_with(0)?;
    Ok(copy.to_string())
}

/// A route whose master is not there is a warning; one that nobody listens to rests.
fn doctor_warns_of_what_a_bridge_waits_for(env: &TestEnv, ros: &RealRos2<'_>) -> Result {
    let copy = registered(env, ros)?;
    let (scan, text) = (env.topic("scan"), env.topic("text"));
    let away = Route::untyped(&format!("ros:{scan}"), &ros2(&scan));
    let rests = Route::new(&zeromq(&text), &ros2(&text), "Text");
    let _bridge = bridge(env, ros, vec![away, rests])?;
    let doctor = format!(
        "until PYTHONPATH={copy}:$PYTHONPATH ros2 doctor > told 2>&1; grep '{scan}' told; do :; done; cat told"
    );
    let mut doctor = ros.shell(&doctor)?;
    doctor.exits_with(0)?;
    let told = doctor.stdout();
    let line = told.lines().find(|line| line.contains(&scan)).unwrap_or_default();
    assert!(line.contains("waiting for master"), "{told}");
    assert!(!told.contains(&format!("{text}: ")), "{told}");
    Ok(())
}

fn ros2_wrapyfi_is_our_program(env: &TestEnv, ros: &RealRos2<'_>) -> Result {
    let copy = registered(env, ros)?;
    let command = format!("PYTHONPATH={copy}:$PYTHONPATH ros2 wrapyfi");
    let topic = env.topic("named");
    let publish = ["pub", &ros2(&topic), "--type", STRING, "--value", r#"{"data": "x"}"#];
    let _publisher = ros.wrapyfi(publish)?.pillar();
    let mut list = ros.shell(&format!("{command} --log-level warn list ros2 --wait 5"))?;
    list.exits_with(0)?;
    assert!(list.stdout().contains(&topic), "{}", list.stdout());
    ros.shell(&format!("{command} check {copy}/absent.yaml"))?.exits_with(2)
}

// Bags ------------------------------------------------------------------------------------------

fn a_bag_keeps_what_came_from_a_script(env: &TestEnv, ros: &RealRos2<'_>) -> Result {
    let [from, to, back] = ["from", "to", "back"].map(|place| env.topic(place));
    let routes = vec![
        Route::new(&zeromq(&from), &ros2(&to), STRING),
        Route::new(&ros2(&to), &zeromq(&back), STRING),
    ];
    let bag = env.path("bag").display().to_string();
    {
        let _bridge = bridge(env, ros, routes.clone())?;
        let mut record = ros.ros2(&["bag", "record", "-o", &bag, &to])?;
        prints(&record, &["Subscribed to topic", &to])?;
        let publisher = env.wrapyfi_publisher(&from, "--flavour small --rate 20 --no-broker")?;
        publisher.messages(20)?;
        record.terminate()?;
        record.exit_code()?;
    }
    let _bridge = bridge(env, ros, routes)?;
    let listener = env.wrapyfi_listener(&back, "")?;
    let play = ros.ros2(&["bag", "play", "--loop", &bag])?;
    listener.messages(5).map_err(|error| error.context(play.tail())).map(drop)
}

/// `ros2 bag` reads and plays what `wrapyfi record` has written, and `wrapyfi play` what `ros2 bag record` has.
fn recordings_go_both_ways(env: &TestEnv, ros: &RealRos2<'_>) -> Result {
    /// The object of a script, as text.
    const SAID: &str = r#"data: '{"said": 1}'"#;
    let (topic, again) = (env.topic("spoken"), env.topic("again"));
    let [ours, theirs] = ["ours", "theirs"].map(|name| env.path(name).display().to_string());
    let publish = ["pub", &ros2(&topic), "--type", STRING, "--value", r#"{"said": 1}"#];
    let publisher = ros.wrapyfi([&publish[..], &["--rate", "20"]].concat())?;
    let mut record = ros.wrapyfi(["record", &ros2(&topic), "--output", &ours])?;
    prints(&record, &["records", &topic])?;
    let mut their_record = ros.ros2(&["bag", "record", "-s", "mcap", "-o", &theirs, &topic])?;
    prints(&their_record, &["Subscribed to topic", &topic])?;
    // A message that came after both had begun.
    let heard = ["echo", &ros2(&topic), "--type", STRING, "--json"];
    ros.wrapyfi(heard)?.objects(20)?;
    record.interrupt()?;
    record.exits_with(0)?;
    their_record.terminate()?;
    their_record.exit_code()?;
    drop(publisher);
    let mut info = ros.ros2(&["bag", "info", &ours])?;
    info.exits_with(0)?;
    let told = format!("Topic: {topic} | Type: {STRING} | Count: ");
    assert!(info.stdout().contains(&told), "{}", info.stdout());
    let mut theirs_info = ros.ros2(&["bag", "info", &theirs])?;
    theirs_info.exits_with(0)?;
    let distro =
        |info: &str| info.lines().find(|line| line.starts_with("ROS Distro:")).map(str::to_owned);
    let told = distro(&theirs_info.stdout());
    assert!(told.is_some() && distro(&info.stdout()) == told, "{}", info.stdout());

    let play = ros.ros2(&["bag", "play", "--loop", &ours])?;
    let mut echo = ros.ros2(&["topic", "echo", "--once", &topic, STRING])?;
    echo.exits_with(0).map_err(|error| error.context(play.tail()))?;
    assert_eq!(echo.stdout().lines().next(), Some(SAID));
    drop(play);
    let play = ros.wrapyfi(["play", &theirs, "--loop", "--to", &ros2(&again)])?;
    let mut echo = ros.ros2(&["topic", "echo", "--once", &format!("{again}{topic}"), STRING])?;
    echo.exits_with(0).map_err(|error| error.context(play.tail()))?;
    assert_eq!(echo.stdout().lines().next(), Some(SAID));
    Ok(())
}

// Wrapyfi on rclpy ------------------------------------------------------------------------------

/// Python Wrapyfi with `mware="ros2"`, where its interpreter is rclpy's.
fn wrapyfi_on_rclpy_talks_with_ours(_: &TestEnv, ros: &RealRos2<'_>) -> Result {
    let mut script =
        ros.python(&["-u", "-m", "examples.hello_world", "--publish", "--mware", "ros2"])?;
    let endpoint = ros2("/hello/my_message");
    let echo = ros.wrapyfi(["echo", &endpoint, "--type", STRING, "--json", "--timeout", "100"])?;
    for n in 0..50 {
        // Its publisher waits for a subscriber, but does not know whether the first message was heard.
        script.tell(&format!("hello {n}"))?;
    }
    let heard = echo.objects(1).map_err(|error| error.context(script.tail()))?.remove(0);
    let message = heard["value"]["message"].as_str().unwrap_or_default().to_owned();
    assert!(message.starts_with("hello "), "{heard}");

    let listener =
        ros.python(&["-u", "-m", "examples.hello_world", "--listen", "--mware", "ros2"])?;
    drop(script);
    let publish = ["pub", &endpoint, "--type", STRING, "--value", r#"{"message": "from Rust"}"#];
    let _publisher = ros.wrapyfi([&publish[..], &["--rate", "10"]].concat())?;
    prints(&listener, &["Method result:", "'message': 'from Rust'"]).map(drop)
}
