//! The guides, run as they are written: their files, their commands, and what they say is printed.
//!
//! Ports, domains and addresses are those of the test, by the variables that the guides name.

use std::path::{Path, PathBuf};

use wrapyfi_e2e::{
    Guide, Line, Need, Process, RealRos2, Result, TestEnv, repository, run, same_but_times,
};

use super::actions::FIBONACCI;

const SCRIPTS: &[Need] = &[Need::Program, Need::Python];
const BUILT: &str = "it builds what this test runs";

/// Runs a line to its end, which must be good.
fn done(env: &TestEnv, line: &Line) -> Result<String> {
    let mut process = env.shell(&line.command)?;
    process.exits_with(0)?;
    Ok(process.stdout())
}

/// Runs a line to its end: it prints what the comment behind it begins with.
fn prints_its_comment(env: &TestEnv, line: &Line) -> Result {
    let printed = done(env, line)?;
    let told = line.comment.split(", of ").next().unwrap_or_default();
    assert!(!told.is_empty() && same_but_times(&printed, told), "{line:?} prints {printed}");
    Ok(())
}

/// Starts a line that goes on, and without which nothing else works.
fn starts(env: &TestEnv, line: &Line) -> Result<Process> {
    Ok(env.shell(&line.command)?.pillar())
}

/// Sets what a line exports for those that follow.
fn export(env: &TestEnv, line: &Line) {
    let words = line.command.split_whitespace().skip(1);
    for (name, value) in words.filter_map(|word| word.split_once('=')) {
        env.set_variable(name, value);
    }
}

/// Waits for a line of output that contains all of `words`.
fn says(process: &Process, words: &[&str]) -> Result {
    process.wait_until(&words.join(", "), |output| {
        let mut lines = output.out.iter().chain(&output.err);
        lines.any(|line| words.iter().all(|word| line.contains(word))).then_some(())
    })
}

/// The camera and the light of the guide for scripts.
fn scripts(env: &TestEnv) -> Result<[Process; 2]> {
    let guide = Guide::read("docs/python-scripts.md")?;
    env.write("camera.py", guide.block("python", "class Camera")?)?;
    env.write("light.py", guide.block("python", "class Light")?)?;
    let [_, camera, _] = guide.lines("--config bridge.yaml")?;
    let [light, ..] = guide.lines::<3>("python light.py")?;
    Ok([starts(env, &camera)?, starts(env, &light)?])
}

#[test]
fn install() -> Result {
    let guide = Guide::read("docs/install.md")?;
    guide.pass_over("make package-deb", BUILT)?;
    guide.pass_over("make package-wheel", BUILT)?;
    guide.pass_over("apt install", "`make test-packages` does it in a system of its own")?;
    guide.pass_over("systemctl", "it is for root, and for all of the machine")?;
    guide.pass_over("cargo install --locked --path", BUILT)?;
    guide.pass_over("--config profile.release", "`make test-publish` installs from the crates")?;
    guide.pass_over("docker", "`make test-packages` does the steps of the image")?;
    guide.is_done()
}

#[test]
fn readme() -> Result {
    run("readme", SCRIPTS, |env| {
        let guide = Guide::read("README.md")?;
        for mark in ["\nmake demo\n", "make build &&", "pip install"] {
            guide.pass_over(mark.trim_start_matches('\n'), BUILT)?;
        }
        guide.pass_over("ROS_MASTER_URI", "`ros1` runs it")?;
        guide.pass_over("yarp:/icub/head/rpc:i", "`yarp` runs it")?;
        guide.pass_over("wrapyfi convert", "`bags_played` runs it")?;
        guide.pass_over("ros2 launch", "`commands_of_ros2` runs it")?;
        env.write("bridge.yaml", guide.block("yaml", "routes:")?)?;
        let [check, bridge, top, why] = guide.lines("wrapyfi check bridge.yaml")?;
        done(env, &check)?;
        let _bridge = starts(env, &bridge)?;
        // There is no terminal here.
        let mut once = env.shell(&format!("{} --once", top.command))?;
        once.exits_with(0)?;
        assert!(
            once.stdout().contains("zeromq:/camera -> ros2:/camera/image_raw"),
            "{}",
            once.stdout()
        );
        let mut missing = env.shell(&why.command)?;
        missing.exits_with(1)?;
        assert!(
            missing.stdout().contains("nobody publishes ros2:/chatter"),
            "{}",
            missing.stdout()
        );
        let [echo, publish, call] = guide.lines("wrapyfi echo zeromq:/camera")?;
        let _scripts = scripts(env)?;
        let echo = env.shell(&echo.command)?;
        echo.wait_until("a picture", |output| {
            output
                .out
                .iter()
                .any(|line| {
                    same_but_times(line, "image 640x480 bgr8 921600 bytes at 1795471266.462655")
                })
                .then_some(())
        })?;
        let object = env.shell("wrapyfi echo zeromq:/object --type NativeObject")?;
        let _publisher = env.shell(&publish.command)?;
        says(&object, &["{\"speed\":[1,2.5]}"])?;
        assert_eq!(done(env, &call)?, "{\"on\":true}");
        guide.is_done()
    })
}

#[test]
fn python_scripts() -> Result {
    run("python_scripts", SCRIPTS, |env| {
        let guide = Guide::read("docs/python-scripts.md")?;
        env.write("battery.py", guide.block("python", "class Battery")?)?;
        env.write("look.py", guide.block("python", "import wrapyfi_rs")?)?;
        env.write("script.py", "import wrapyfi; print(wrapyfi.__name__)")?;
        env.install_python_package()?;
        let [publish, listen] = guide.lines("python battery.py")?;
        let [battery, listener] = [env.shell(&publish.command)?, env.shell(&listen.command)?];
        says(&listener, &[&listen.comment])?;
        for line in guide.lines::<2>("python -m wrapyfi_rs")? {
            assert_eq!(done(env, &line)?, "wrapyfi_rs");
        }
        let mut look = env.shell("python look.py")?;
        look.exits_with(0)?;
        let said = look.stdout();
        for words in ["{'charge': 0.8}", "publisher /battery", "Vector3(x=0.5, y=0.0, z=0.0)"] {
            assert!(said.contains(words), "{words}: {said}");
        }
        drop((battery, listener));

        env.write("bridge.yaml", guide.block("yaml", "routes:")?)?;
        let [bridge, _, echo] = guide.lines("--config bridge.yaml")?;
        let _bridge = starts(env, &bridge)?;
        let _scripts = scripts(env)?;
        guide.pass_over("class Camera", "`scripts` runs it")?;
        guide.pass_over("class Light", "`scripts` runs it")?;
        let (printed, told) = (done(env, &echo)?, guide.block("text", "image 640x480")?);
        assert!(same_but_times(&printed, &told), "{printed}");

        env.write("chat.py", guide.block("python", "class Chat")?)?;
        let [chat, publish] = guide.lines("python chat.py")?;
        let chat = starts(env, &chat)?;
        let _publisher = env.shell(&publish.command)?;
        says(&chat, &["hello"])?;

        let [_, here, in_ros2] = guide.lines("python light.py")?;
        prints_its_comment(env, &here)?;
        prints_its_comment(env, &in_ros2)?;
        guide.is_done()
    })
}

#[test]
fn python_reference() -> Result {
    run("python_reference", SCRIPTS, |env| {
        let guide = Guide::read("docs/reference/python.md")?;
        env.install_python_package()?;
        for (script, mark) in [("arm.py", "class Arm"), ("robot.py", "class Robot")] {
            env.write(script, guide.block("python", mark)?)?;
        }
        let _arm = env.shell("python arm.py")?;
        let said = "wrapyfi echo ros2:/joint_states --count 1 --json --timeout 100";
        let echo = env.shell(said)?;
        let heard = echo.objects(1)?.remove(0);
        assert_eq!(heard["value"]["position"][0], 0.25, "{heard}");
        let _robot = env.shell("python robot.py")?;
        let call = env.shell("wrapyfi call ros2:/lamp --args '[true]' --json --timeout 100")?;
        let reply = call.objects(1)?.remove(0);
        assert_eq!(reply["value"]["message"], "on", "{reply}");
        guide.is_done()
    })
}

#[test]
fn ros2() -> Result {
    run("ros2", &[Need::Program], |env| {
        let guide = Guide::read("docs/ros2.md")?;
        guide.pass_over("colcon build", BUILT)?;
        guide.pass_over("sysctl", "it is for root, and for all of the machine")?;
        guide.pass_over("create_subscription", "it is a part of a node on rclpy")?;
        guide.pass_over("ros2 run wrapyfi_bridge ros1_bridge", "`commands_of_ros2` runs it")?;
        env.write("bridge.yaml", guide.block("yaml", "routes:")?)?;
        let [check, ..] = guide.lines::<3>("wrapyfi check bridge.yaml")?;
        done(env, &check)?;
        let [list, echo, call, parameters] = guide.lines("wrapyfi list ros2")?;
        let twist = r#"{"linear": {"x": 0.5}}"#;
        let _publisher = env
            .wrapyfi([
                "pub",
                "ros2:/cmd_vel",
                "--type",
                "geometry_msgs/msg/Twist",
                "--value",
                twist,
                "--rate",
                "10",
            ])?
            .pillar();
        let _lamp = env.shell("wrapyfi serve ros2:/lamp --type std_srvs/srv/SetBool --value '{\"success\": true, \"message\": \"on\"}'")?.pillar();
        let _camera =
            env.node(["--ros-args", "-p", "config_file:=bridge.yaml", "-r", "__node:=camera"])?;
        let heard = env.shell(&echo.command)?;
        says(&heard, &["0.5"])?;
        assert!(done(env, &call)?.contains("on"), "{call:?}");
        let told = done(env, &list)?;
        for shown in ["/cmd_vel", "geometry_msgs/msg/Twist", "/lamp"] {
            assert!(told.contains(shown), "{shown}: {told}");
        }
        let parameters = env.shell(&parameters.command)?;
        says(&parameters, &["use_sim_time"])?;
        example_interfaces(env)?;
        let [list, send, serve] = guide.lines("wrapyfi action list")?;
        let _server = starts(env, &serve)?;
        until(env, &list, &["/fibonacci", "action server", "example_interfaces/action/Fibonacci"])?;
        assert!(done(env, &send)?.ends_with("succeeded:\n  sequence:\n  - 0\n  - 1\n  - 1"));
        guide.is_done()
    })
}

/// Installs the package that has the action of the guides.
fn example_interfaces(env: &TestEnv) -> Result {
    let index = "share/ament_index/resource_index/rosidl_interfaces/example_interfaces";
    let prefix = env.definitions(&[
        ("share/example_interfaces/action/Fibonacci.action", FIBONACCI.1),
        (index, "action/Fibonacci.action\n"),
    ])?;
    env.set_variable("AMENT_PREFIX_PATH", prefix);
    Ok(())
}

#[test]
fn actions() -> Result {
    run("actions", &[Need::Program], |env| {
        let guide = Guide::read("docs/reference/actions.md")?;
        example_interfaces(env)?;
        let [serve, list, info, send, cancel] = guide.lines("wrapyfi action serve")?;
        let _server = starts(env, &serve)?;
        for line in [list, info] {
            let told = guide.block("text", "action server")?;
            let shown =
                told.lines().nth(1).and_then(|line| line.rsplit_once(' ')).unwrap_or_default();
            until(env, &line, &[shown.0.trim()])?;
        }
        assert_eq!(done(env, &send)?, guide.block("text", "succeeded:")?.trim_end());
        assert_eq!(done(env, &cancel)?, "asked for the end of all goals");

        let check = |name: &str, yaml: String| -> Result {
            env.write(name, yaml)?;
            env.shell(&format!("wrapyfi check {name}"))?.exits_with(0)
        };
        check("routes.yaml", guide.block("yaml", "routes:")?)?;
        env.definitions(&[
            ("my_robot/action/Plan.action", FIBONACCI.1),
            ("my_robot/action/Go.action", "float64 to\n---\n---\nfloat64 at\nbool done\n"),
        ])?;
        let routes = guide.block("text", "{ action: \"zeromq:/plan\"")?;
        let routes: String = routes.lines().map(|route| format!("  - {route}\n")).collect();
        check("functions.yaml", format!("definitions: [interfaces]\nroutes:\n{routes}"))?;
        guide.is_done()
    })
}

#[test]
fn actions_of_ros1() -> Result {
    let needs = [Need::Program, Need::Ros1, Need::Actionlib];
    run("actions_of_ros1", &needs, |env| {
        let _roscore = env.roscore()?;
        example_interfaces(env)?;
        let guide = Guide::read("docs/ros1.md")?;
        let server = "serve --action /fibonacci --type example_interfaces/Fibonacci";
        let _server = env.rospy_actions(server)?;
        let _bridge = env.executable("ros1_bridge", &[])?;
        let [list, direct, bridged] = guide.lines("wrapyfi action list ros")?;
        until(env, &list, &["/fibonacci", "action server", "example_interfaces/Fibonacci"])?;
        // The command waits for 5 s, in which a busy machine may not have bridged the action.
        let command = list.command.replace("list ros", "list ros2");
        until(env, &Line { command, ..list }, &["/fibonacci", "action server"])?;
        for send in [direct, bridged] {
            let told = done(env, &send)?;
            assert!(told.contains("feedback:") && told.ends_with("  - 5\n  - 8"), "{told}");
        }
        Ok(())
    })
}

#[test]
fn commands_of_ros2() -> Result {
    let needs = [Need::Program, Need::Ros2];
    run("commands_of_ros2", &[&needs[..], &[Need::Ros2Package("launch_ros")]].concat(), |env| {
        let guide = Guide::read("docs/ros2.md")?;
        env.write("bridge.yaml", guide.block("yaml", "routes:")?)?;
        let ros = RealRos2::new(env, "rmw_cyclonedds_cpp")?;
        let [_, run, launch] = guide.lines("wrapyfi check bridge.yaml")?;
        let [run_all, launch_all] = guide.lines("ros2 run wrapyfi_bridge ros1_bridge")?;
        let [of_readme, ..] = Guide::read("README.md")?.lines::<3>("ros2 launch")?;
        for line in [run, launch, of_readme] {
            says(&ros.shell(&line.command)?, &["routes", "from"])?;
        }
        for line in [run_all, launch_all] {
            says(&ros.shell(&line.command)?, &["ROS 1: node started"])?;
        }
        Ok(())
    })
}

#[test]
fn ros1() -> Result {
    let needs = [Need::Program, Need::Ros1];
    run("ros1", &needs, |env| {
        let _roscore = env.roscore()?;
        let scan = r#"{"ranges": [0.5, 2.5]}"#;
        let _scan = env.rospy(
            "publish --topic /scan --type sensor_msgs/LaserScan --node scanner",
            Some(scan),
        )?;
        let mut guide = Guide::read("docs/ros1.md")?;
        let port = env.ros_port().to_string();
        guide.replace("11311", &port)?;
        let [master, list, echo, bridge, echo_in_ros2] = guide.lines("wrapyfi echo ros:/scan")?;
        export(env, &master);
        until(env, &list, &["/scan", "sensor_msgs/LaserScan"])?;
        assert!(done(env, &echo)?.contains("2.5"), "{echo:?}");
        let mut readme = Guide::read("README.md")?;
        readme.replace("11311", &port)?;
        let [same_bridge] = readme.lines("ROS_MASTER_URI")?;
        for bridge in [bridge, same_bridge] {
            let _bridge = starts(env, &bridge)?;
            assert!(done(env, &echo_in_ros2)?.contains("2.5"), "{echo_in_ros2:?}");
        }
        env.write("bridge.yaml", guide.block("yaml", "ros:/arm/(.*)")?)?;
        let [check, bridge] = guide.lines("wrapyfi check bridge.yaml")?;
        done(env, &check)?;
        says(&starts(env, &bridge)?, &["a ROS 1 node that publishes /camera/image_raw"])?;
        guide.pass_over("ros2 launch", "`commands_of_ros2` starts this launch file")?;
        guide.pass_over("wrapyfi action list ros", "`actions_of_ros1` runs these commands")?;
        guide.pass_over("ROS_DOMAIN_ID", "`ros1_base_and_ros2_navigation` runs it")?;
        guide.is_done()
    })
}

/// From a `roscore` with a package of its own to the bridge's end.
#[test]
fn from_ros1() -> Result {
    run("from_ros1", &[Need::Program, Need::Ros1], |env| {
        let roscore = env.roscore()?;
        let mut guide = Guide::read("docs/from-ros1.md")?;
        guide.replace("11311", &env.ros_port().to_string())?;
        let folder =
            env.definitions(&[("my_robot_msgs/msg/Joint.msg", "float64 angle # in radians\n")])?;
        let node = |topic: &str, kind: &str, value: &str| {
            let args = format!(
                "publish --topic {topic} --type {kind} --node {} --definitions {folder}",
                topic.trim_start_matches('/')
            );
            let node = env.rospy(&args, Some(value))?;
            node.event("ready")?;
            Ok::<_, anyhow::Error>(node)
        };
        let joint = node("/joint", "my_robot_msgs/Joint", r#"{"angle": 0.5}"#)?;
        let args = format!(
            "subscribe --topic /joint --type my_robot_msgs/Joint --node ear --definitions {folder}"
        );
        let ear = env.rospy(&args, None)?;
        ear.messages(1)?;

        let [master, list, survey] = guide.lines("wrapyfi survey ros:")?;
        export(env, &master);
        until(env, &list, &["/joint", "my_robot_msgs/Joint"])?;
        done(env, &survey)?;
        let [check, bridge, in_ros2] = guide.lines("wrapyfi bridge --config survey.yaml")?;
        done(env, &check)?;
        let bridge = starts(env, &bridge)?;
        until(env, &in_ros2, &["/joint", "my_robot_msgs/msg/Joint"])?;
        let [types] = guide.lines("wrapyfi export ros:")?;
        done(env, &types)?;
        let text = std::fs::read_to_string(env.path("src/my_robot_msgs/msg/Joint.msg"))?;
        assert_eq!(text, "\n# in radians\nfloat64 angle\n");
        guide.pass_over(
            "colcon build",
            "`types_of_rospy_nodes_become_a_package_that_colcon_builds` does it",
        )?;

        drop(joint);
        let routes = std::fs::read_to_string(env.path("survey.yaml"))?;
        let back = "  # - { from: \"ros2:/joint\"";
        assert!(routes.contains(back), "{routes}");
        env.write("new.yaml", routes.replace(back, "  - { from: \"ros2:/joint\""))?;
        let [against] = guide.lines("--against survey.yaml")?;
        assert!(done(env, &against)?.contains("ros2:/joint"), "{against:?}");
        std::fs::rename(env.path("new.yaml"), env.path("survey.yaml"))?;
        let moved = "wrapyfi pub ros2:/joint --type my_robot_msgs/msg/Joint --definitions src --value '{\"angle\": 1.5}' --rate 20";
        let _moved = env.shell(moved)?;
        ear.wait_until("the node that has moved", |output| {
            let mut all = output.events("message").into_iter();
            all.find(|one| one["value"]["angle"] == 1.5).map(drop)
        })
        .map_err(|error| error.context(bridge.tail()))?;
        let [top, why] = guide.lines("wrapyfi top --once")?;
        assert!(done(env, &top)?.contains("ros2:/joint"));
        let mut why = env.shell(&why.command)?;
        why.exits_with(1)?;
        assert!(why.stdout().contains("nobody publishes ros2:/scan"), "{}", why.tail());

        drop(ear);
        let [left] = guide.lines("no endpoint of another node")?;
        let told = done(env, &left)?;
        assert!(!told.contains("/ear"), "{told}");
        drop((bridge, roscore));
        guide.is_done()
    })
}

#[test]
fn ros1_base_and_ros2_navigation() -> Result {
    run("ros1_base_and_ros2_navigation", &[Need::Program, Need::Ros1], |env| {
        let _roscore = env.roscore()?;
        let mut guide = Guide::read("docs/ros1.md")?;
        guide.replace("http://base:11311", &env.ros_master_uri())?;
        guide.replace("192.168.1.20", "127.0.0.1")?;
        guide.replace("ROS_DOMAIN_ID=7", "")?;
        let [variables, list, check, bridge] = guide.lines("ROS_DOMAIN_ID")?;
        export(env, &variables);
        std::os::unix::fs::symlink(wrapyfi_e2e::repository().join("config"), env.path("config"))?;
        done(env, &list)?;
        done(env, &check)?;
        let _bridge = starts(env, &bridge)?;
        let scan = r#"{"ranges": [0.5, 2.5]}"#;
        let _scan = env.rospy(
            "publish --topic /scan --type sensor_msgs/LaserScan --node scanner",
            Some(scan),
        )?;
        let mut echo = env.shell("wrapyfi echo ros2:/scan --count 1")?;
        echo.exits_with(0)?;
        assert!(echo.stdout().contains("2.5"), "{}", echo.tail());
        Ok(())
    })
}

/// Runs a line again until it prints a line with all of `words`.
fn until(env: &TestEnv, line: &Line, words: &[&str]) -> Result {
    let mut printed = String::new();
    for _ in 0..60 {
        printed = done(env, line)?;
        if printed.lines().any(|line| words.iter().all(|word| line.contains(word))) {
            return Ok(());
        }
    }
    anyhow::bail!("{line:?} never printed {words:?}, last:\n{printed}")
}

#[test]
fn yarp() -> Result {
    let needs = [Need::Program, Need::Python];
    run("yarp", &needs, |env| {
        let guide = Guide::read("docs/yarp.md")?;
        for mark in ["robot$", "laptop$  mkdir", "laptop$  export", "laptop$  ros2 topic hz"] {
            guide.pass_over(mark, "it takes YARP and two machines: `real_yarp` has them")?;
        }
        guide.pass_over(
            "ros2 service call",
            "it takes ROS 2 with wrapyfi_msgs: `real_ros2` has it",
        )?;
        guide.pass_over("yarp rpc /arm/rpc:i", "it takes YARP: `yarp_served_board` has it")?;
        env.peer("make_files.py", &env.path("").display().to_string())?.exits_with(0)?;
        std::fs::rename(env.path("colour.png"), env.path("frame.png"))?;
        let [server, camera, head, list, bridge, echo, call] = guide.lines("wrapyfi yarpserver")?;
        let server = starts(env, &server)?;
        says(&server, &["name server /root on"])?;
        let _camera = starts(env, &camera)?;
        let _head = starts(env, &head)?;
        until(env, &list, &["/icub/cam/left", "publisher", "Image"])?;
        let readme = Guide::read("README.md")?;
        let [same_bridge, same_call] = readme.lines("yarp:/icub/head/rpc:i")?;
        for (bridge, call) in [(bridge, call), (same_bridge, same_call)] {
            let _bridge = starts(env, &bridge)?;
            let printed = done(env, &echo)?;
            assert_eq!(
                printed.lines().filter(|line| line.starts_with("image ")).count(),
                2,
                "{printed}"
            );
            assert_eq!(done(env, &call)?, "[ok]");
        }
        env.write("some.yaml", guide.block("yaml", "carrier: fast_tcp")?)?;
        env.shell("wrapyfi check some.yaml")?.exits_with(0)?;
        env.write("board.yaml", guide.block("yaml", "board: yarp:/arm")?)?;
        env.shell("wrapyfi check board.yaml")?.exits_with(0)?;
        guide.is_done()
    })
}

#[test]
fn rust() -> Result {
    run("rust", &[Need::Program, Need::Example("mirror")], |env| {
        let guide = Guide::read("docs/rust.md")?;
        guide.pass_over("[dependencies]", BUILT)?;
        guide.pass_over(
            "impl Mirror",
            "the test of `examples/communicator` compares it with the program `mirror`",
        )?;
        guide.pass_over("open_listener", "it is a part of an example in wrapyfi_core")?;
        guide.pass_over("impl Base", "`examples/guides` compiles it")?;
        guide.pass_over("build::generate", "the build script of `examples/typed` does the same")?;
        guide.pass_over("RosService::of", "`examples/guides` runs it")?;
        let [publish, listen] = guide.lines("cargo run -- publish")?;
        let started = |line: &Line| {
            let (_, args) = line.command.split_once("cargo run -- ")?;
            Some(env.example("mirror", args))
        };
        let (Some(publish), Some(listen)) = (started(&publish), started(&listen)) else {
            anyhow::bail!("{publish:?}, {listen:?}")
        };
        let (mut publish, mut listen) = (publish?, listen?);
        publish.tell("hello")?;
        publish.tell("exit")?;
        says(&listen, &["hello"])?;
        listen.exits_with(0)?;
        guide.is_done()
    })
}

/// Files of Rust below a folder.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) -> Result {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            sources(&path, found)?;
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
    Ok(())
}

/// Every test that the table of faults names is in a file of the module's name.
#[test]
fn reliability() -> Result {
    let root = repository();
    let mut files = Vec::new();
    for folder in ["crates", "test/tests", "wrapyfi_bridge/src"] {
        sources(&root.join(folder), &mut files)?;
    }
    let page = std::fs::read_to_string(root.join("docs/reliability.md"))?;
    let quoted = page.split('`').skip(1).step_by(2);
    let tests: Vec<_> = quoted.filter_map(|words| words.split_once("::")).collect();
    assert!(tests.len() > 80, "{} tests", tests.len());
    for (module, test) in tests {
        // Cases of the suite for middlewares are generic.
        let begins = [format!("fn {test}("), format!("fn {test}<")];
        let of_module = |file: &&PathBuf| file.file_stem().is_some_and(|stem| stem == module);
        let mut texts = files.iter().filter(of_module).map(std::fs::read_to_string);
        let has = |text: String| begins.iter().any(|begin| text.contains(begin));
        let is_there = texts.any(|text| text.is_ok_and(has));
        assert!(is_there, "docs/reliability.md names {module}::{test}, which is nowhere");
    }
    Ok(())
}

/// Sources of the product in a folder, without tests and the demo: path from the root, and text before its unit tests.
fn product(folder: &str) -> Result<Vec<(String, String)>> {
    let root = repository();
    let mut files = Vec::new();
    sources(&root.join(folder), &mut files)?;
    let mut found = Vec::new();
    for file in files {
        let path = file.strip_prefix(&root)?.display().to_string();
        let is_test = path.ends_with("tests.rs") || path.contains("/tests/");
        if path.contains("/src/") && !is_test && !path.contains("/demo/") {
            let text = std::fs::read_to_string(&file)?;
            let code = text.split("#[cfg(test)]").next().unwrap_or_default().to_owned();
            found.push((path, code));
        }
    }
    Ok(found)
}

/// Every file that has the example of a section is in the section's list, and the list has no others.
#[test]
fn extending() -> Result {
    let root = repository();
    let page = std::fs::read_to_string(root.join("docs/extending.md"))?;
    let variants = ["Payload", "DataType", "MessageType", "ServiceKind", "Self"];
    let variants = variants.map(|kind| format!("{kind}::AudioChunk"));
    let [rate, detect, module] = ["max_rate_hz", "Detect(", "mod detect"].map(str::to_owned);
    let (keys, commands) = ([rate], [detect, module]);
    let everywhere = ["crates", "wrapyfi_core/src", "wrapyfi_bridge/src"];
    for (title, example, marks, folders) in [
        ("A payload type", "AudioChunk", &variants[..], &everywhere[..]),
        (
            "A key of the configuration",
            "max_rate_hz",
            &keys[..],
            &["crates/wrapyfi_engine/src"][..],
        ),
        ("A command", "etect", &commands[..], &everywhere[2..]),
    ] {
        let section = page.split("\n## ").find_map(|section| section.strip_prefix(title));
        let section = section.unwrap_or_default();
        let rows = section.lines().filter_map(|line| line.strip_prefix("| `"));
        let files = rows.filter_map(|row| row.split(" | ").next()).flat_map(|cell| cell.split('`'));
        let listed: Vec<_> = files.filter(|file| root.join(file).is_file()).collect();
        assert!(listed.len() > 3, "{title}: {listed:?}");
        for file in &listed {
            let text = std::fs::read_to_string(root.join(file))?;
            assert!(text.contains(example), "{title}: {file} has no {example}");
        }
        for folder in folders {
            for (path, code) in product(folder)? {
                let is_meant = marks.iter().any(|mark| code.contains(mark.as_str()));
                let is_listed = listed.contains(&path.as_str());
                assert!(!is_meant || is_listed, "{title}: the list lacks {path}");
            }
        }
    }
    Ok(())
}
