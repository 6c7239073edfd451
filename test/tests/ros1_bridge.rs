//! All of ROS 1 in ROS 2, when nodes are killed, the master is restarted, or folders hold old definitions;
//! against Debian's rosmaster, rospy and tools.

use std::time::Instant;

use serde_json::{Value, json};
use wrapyfi_e2e::{
    Books, Need, Output, Process, Result, Route, TIMEOUT, TestEnv, ros1, ros2, run, until_route,
};

const NEEDS: &[Need] = &[Need::Program, Need::Ros1];
const WITH_DDS: &[Need] = &[Need::Program, Need::Ros1, Need::Python];
const NODE: &str = "/ros1_bridge";

fn bridge(env: &TestEnv, more: &[&str]) -> Result<Process> {
    env.executable("ros1_bridge", &[&["-p", "status_json:=true"], more].concat())
}

fn echo(env: &TestEnv, endpoint: &str, more: &[&str]) -> Result<Process> {
    let args = ["echo", endpoint, "--json", "--timeout", "100"];
    env.wrapyfi(args.into_iter().chain(more.iter().copied()))
}

fn waits_for_a_listener(route: Option<&Value>) -> bool {
    route.is_some_and(|route| route["cause"] == "nobody_listens")
}

/// Waits until the master's books are as they should be.
fn books(env: &TestEnv, what: &str, wanted: impl Fn(&Books) -> bool) -> Result<Books> {
    let deadline = Instant::now() + TIMEOUT;
    loop {
        match env.ros_books() {
            Ok(books) if wanted(&books) => return Ok(books),
            books if Instant::now() >= deadline => {
                anyhow::bail!("the master never had {what}, last: {books:?}")
            }
            _ => std::thread::sleep(std::time::Duration::from_millis(20)),
        }
    }
}

fn has(owners: &[(String, Vec<String>)], name: &str, node: &str) -> bool {
    owners.iter().any(|(one, nodes)| one == name && nodes.iter().any(|it| it == node))
}

fn log(bridge: &Process) -> String {
    bridge.stderr() + &bridge.stdout()
}

/// A folder of its own with one definition.
fn folder_with(env: &TestEnv, folder: &str, file: &str, text: &str) -> Result<String> {
    let path = env.path(folder).join(file);
    path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
    std::fs::write(path, text)?;
    Ok(env.path(folder).display().to_string())
}

/// The text of a definition with all inside, as a publisher shows it.
fn shown(env: &TestEnv, file: &str, text: &str) -> Result<String> {
    let line = "=".repeat(80);
    let header = "uint32 seq\ntime stamp\nstring frame_id\n";
    let text = format!("{text}{line}\nMSG: std_msgs/Header\n{header}");
    Ok(env.write(file, text)?.display().to_string())
}

#[test]
fn a_folder_of_packages_breaks_nothing() -> Result {
    run("a_folder_of_packages_breaks_nothing", NEEDS, |env| {
        let _roscore = env.roscore()?;
        // The folder has no package but its own, and an older Sample than is published.
        let folder = env.definitions(&[
            ("wrapyfi_lab/msg/Report.msg", "Header header\nstring what\n"),
            ("wrapyfi_lab/msg/Sample.msg", "Header header\nint32 value\n"),
        ])?;
        let (report, sample) = (env.topic("report"), env.topic("sample"));
        let talk = |topic: &str, name: &str, text: &str, value: &str| {
            let file = shown(env, &format!("{name}.txt"), text)?;
            let args = format!(
                "publish --topic {topic} --type wrapyfi_lab/{name} --definition {file} --node {name}"
            );
            env.rospy(&args, Some(value))
        };
        let _reports =
            talk(&report, "Report", "Header header\nstring what\n", r#"{"what": "all well"}"#)?;
        let _samples =
            talk(&sample, "Sample", "Header header\nfloat64 value\n", r#"{"value": 0.5}"#)?;
        env.set_variable("ROS_PACKAGE_PATH", &folder);
        let bridge = bridge(env, &[])?;
        for (topic, name) in [(&report, "Report"), (&sample, "Sample")] {
            until_route(&bridge, &format!("ros:{topic} -> ros2:{topic}"), |route| {
                waits_for_a_listener(route)
                    && route.is_some_and(|it| it["type"] == format!("wrapyfi_lab/msg/{name}"))
            })?;
        }
        env.set_variable("ROS_PACKAGE_PATH", "");
        std::fs::create_dir_all(env.path("newer/wrapyfi_lab/msg"))?;
        env.write("newer/wrapyfi_lab/msg/Sample.msg", "std_msgs/Header header\nfloat64 value\n")?;
        let newer = env.path("newer").display().to_string();
        let more = ["--type", "wrapyfi_lab/msg/Sample", "--definitions", &newer, "--count", "1"];
        let mut echo = echo(env, &ros2(&sample), &more)?;
        let heard = echo.objects(1).map_err(|error| error.context(bridge.tail()))?;
        echo.exits_with(0)?;
        assert_eq!(heard[0]["value"]["value"], 0.5, "{heard:?}");
        Ok(())
    })
}

#[test]
fn echo_is_told_the_type_by_the_publisher() -> Result {
    run("echo_is_told_the_type_by_the_publisher", &[Need::Program, Need::Ros1], |env| {
        let _roscore = env.roscore()?;
        let (odd, text, later) = (env.topic("odd"), env.topic("text"), env.topic("later"));
        let file = shown(env, "Odd.txt", "Header header\nfloat64[] values\n")?;
        let args =
            format!("publish --topic {odd} --type nobody_has/Odd --definition {file} --node odd");
        let _odd = env.rospy(&args, Some(r#"{"values": [0.5, 2.5]}"#))?;
        let _text = env
            .rospy(&format!("publish --topic {text} --node text"), Some(r#"{"data": "hello"}"#))?;
        let mut early = echo(env, &ros1(&later), &["--count", "1"])?;
        let mut of_odd = echo(env, &ros1(&odd), &["--count", "1"])?;
        assert_eq!(of_odd.objects(1)?[0]["value"]["values"], json!([0.5, 2.5]));
        of_odd.exits_with(0)?;
        let mut of_text = echo(env, &ros1(&text), &["--count", "1"])?;
        assert_eq!(of_text.objects(1)?[0]["value"], "hello");
        of_text.exits_with(0)?;
        // It waits for a program that tells the type.
        let args = format!("publish --topic {later} --type sensor_msgs/JointState --node later");
        let _later = env.rospy(&args, Some(r#"{"name": ["elbow"]}"#))?;
        assert_eq!(early.objects(1)?[0]["value"]["name"], json!(["elbow"]));
        early.exits_with(0)?;
        Ok(())
    })
}

/// No node of rospy registers again with a master that was restarted.
#[test]
fn a_restarted_master_ends_no_route_whose_publisher_lives() -> Result {
    run("a_restarted_master_ends_no_route_whose_publisher_lives", NEEDS, |env| {
        let mut roscore = env.roscore()?;
        let topic = env.topic("text");
        let _talker = env
            .rospy(&format!("publish --topic {topic} --node talker"), Some(r#"{"data": "{n}"}"#))?;
        let bridge = bridge(env, &[])?;
        let forever = ["--type", "Text", "--count", "100000"];
        let first = echo(env, &ros2(&topic), &forever)?;
        first.objects(20).map_err(|error| error.context(bridge.tail()))?;
        roscore.kill()?;
        roscore = env.roscore()?;
        let known = |books: &Books| has(&books.subscribers, &topic, NODE);
        let now = books(env, "the bridge as a subscriber", known)?;
        assert!(!has(&now.publishers, &topic, "/talker"), "rospy registered again: {now:?}");
        // 20 a second: longer than a route lives without its source.
        let before = first.objects(1)?.len();
        first.objects(before + 240).map_err(|error| error.context(bridge.tail()))?;
        assert!(!log(&bridge).contains("route ended"), "{}", bridge.tail());
        // Nor is the publisher forgotten while no program listens.
        drop(first);
        let route = format!("ros:{topic} -> ros2:{topic}");
        until_route(&bridge, &route, waits_for_a_listener)?;
        let second = echo(env, &ros2(&topic), &forever)?;
        second.objects(20).map_err(|error| error.context(bridge.tail()))?;
        assert!(!log(&bridge).contains("route ended"), "{}", bridge.tail());
        drop(roscore);
        Ok(())
    })
}

#[test]
fn a_killed_node_is_gone_though_the_master_keeps_it() -> Result {
    run("a_killed_node_is_gone_though_the_master_keeps_it", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let (topic, service) = (env.topic("text"), env.topic("light"));
        let mut talker = env
            .rospy(&format!("publish --topic {topic} --node talker"), Some(r#"{"data": "{n}"}"#))?;
        let mut server = env.rospy(&format!("serve --topic {service} --node server"), None)?;
        let bridge = bridge(env, &[])?;
        let (route, offered) =
            (format!("ros:{topic} -> ros2:{topic}"), format!("ros2:{service} -> ros:{service}"));
        until_route(&bridge, &route, waits_for_a_listener)?;
        until_route(&bridge, &offered, |route| route.is_some())?;
        talker.kill()?;
        server.kill()?;
        until_route(&bridge, &route, |route| route.is_none())?;
        until_route(&bridge, &offered, |route| route.is_none())?;
        let kept = env.ros_books()?;
        assert!(has(&kept.publishers, &topic, "/talker"), "{kept:?}");
        assert!(has(&kept.services, &service, "/server"), "{kept:?}");
        Ok(())
    })
}

#[test]
fn where_somebody_listens_the_subscription_is_there_before_a_publisher() -> Result {
    let test = "where_somebody_listens_the_subscription_is_there_before_a_publisher";
    run(test, NEEDS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("text");
        let bridge = bridge(env, &[])?;
        let forever = ["--type", "Text", "--count", "100000"];
        // What the bridge tells about itself is no topic of ROS 1, whichever program listens.
        let status = format!("{NODE}/status");
        let own = ["--type", "wrapyfi_msgs/msg/BridgeStatus", "--count", "100000"];
        let looks = echo(env, &ros2(&status), &own)?;
        looks.objects(1).map_err(|error| error.context(bridge.tail()))?;
        let listener = echo(env, &ros2(&topic), &forever)?;
        let stands = |books: &Books| has(&books.subscribers, &topic, NODE);
        books(env, "the bridge as a subscriber", stands)
            .map_err(|error| error.context(bridge.tail()))?;
        // The bridge's end on ROS 2 has met the listener.
        until_route(&bridge, &format!("ros:{topic} -> ros2:{topic}"), |route| {
            route.is_some() && !waits_for_a_listener(route)
        })?;
        let talker = env
            .rospy(&format!("publish --topic {topic} --node talker"), Some(r#"{"data": "{n}"}"#))?;
        let heard = listener.objects(3).map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(heard[0]["value"], "0", "the first message: {heard:?}");
        // The listener to the status came before.
        until_route(&bridge, &format!("ros:{status} -> ros2:{status}"), |route| route.is_none())?;
        books(env, "nothing of the status", |books| !has(&books.subscribers, &status, NODE))?;
        // With the listener and the publisher the route goes.
        drop((listener, talker));
        until_route(&bridge, &format!("ros:{topic} -> ros2:{topic}"), |route| route.is_none())?;
        books(env, "nothing of the topic", |books| !has(&books.subscribers, &topic, NODE))?;

        // A listener that errs does not spoil it for others.
        let other = env.topic("joints");
        let wrong = echo(env, &ros2(&other), &forever)?;
        books(env, "the bridge", |books| has(&books.subscribers, &other, NODE))?;
        let args = format!("publish --topic {other} --type sensor_msgs/JointState --node joints");
        let _joints = env.rospy(&args, Some(r#"{"name": ["elbow"]}"#))?;
        let more = ["--type", "sensor_msgs/msg/JointState", "--count", "1"];
        let mut right = echo(env, &ros2(&other), &more)?;
        let heard = right.objects(1).map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(heard[0]["value"]["name"], json!(["elbow"]));
        right.exits_with(0)?;
        drop(wrong);
        Ok(())
    })
}

#[test]
fn a_bag_is_heard_from_its_first_message() -> Result {
    run("a_bag_is_heard_from_its_first_message", WITH_DDS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("text");
        let words = format!("bag --topic {topic} --bag talk.bag --count 30 --rate 50");
        env.rospy(&words, Some(r#"{"data": "{n}"}"#))?.event("done")?;
        let bridge = bridge(env, &[])?;
        let listener = env.dds_subscriber(&topic, "std_msgs/msg/String", "--plain")?;
        let stands = |books: &Books| has(&books.subscribers, &topic, NODE);
        books(env, "the bridge as a subscriber", stands)
            .map_err(|error| error.context(bridge.tail()))?;
        listener.event("matched")?;
        // It waits for subscribers, and there is none but the one that stands.
        let mut player = env.ros_tool("rosbag", "play --wait-for-subscribers talk.bag")?;
        let heard = listener.messages(30).map_err(|error| error.context(player.tail()))?;
        let heard: Vec<Value> = heard.iter().map(|one| one["fields"]["data"].clone()).collect();
        assert_eq!(heard, (0..30).map(|number| json!(number.to_string())).collect::<Vec<_>>());
        player.exits_with(0)
    })
}

#[test]
fn the_bridge_has_its_name_at_the_master_and_ends_when_it_is_killed_there() -> Result {
    let test = "the_bridge_has_its_name_at_the_master_and_ends_when_it_is_killed_there";
    run(test, NEEDS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("text");
        let _talker = env
            .rospy(&format!("publish --topic {topic} --node talker"), Some(r#"{"data": "{n}"}"#))?;
        for (name, more) in
            [(NODE, vec![]), ("/lab/other", vec!["-r", "__node:=other", "-r", "__ns:=/lab"])]
        {
            let mut bridge = bridge(env, &more)?;
            let _listener = echo(env, &ros2(&topic), &["--type", "Text", "--count", "100000"])?;
            let subscribed = |books: &Books| has(&books.subscribers, &topic, name);
            books(env, name, subscribed).map_err(|error| error.context(bridge.tail()))?;
            let mut kill = env.ros_tool("rosnode", &format!("kill {name}"))?;
            bridge.exits_with(1)?;
            kill.exits_with(0)?;
            let said = log(&bridge);
            assert!(said.contains("told this node to shut down"), "{said}");
        }
        Ok(())
    })
}

/// No program listens, and the route is there before what is kept is published.
#[test]
fn a_latching_publisher_that_comes_late_is_not_missed() -> Result {
    run("a_latching_publisher_that_comes_late_is_not_missed", WITH_DDS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("map_name");
        let _other = env.rospy(
            &format!("publish --topic {topic} --node other"),
            Some(r#"{"data": "not kept"}"#),
        )?;
        let bridge = bridge(env, &[])?;
        let route = format!("ros:{topic} -> ros2:{topic}");
        until_route(&bridge, &route, waits_for_a_listener)?;
        let words = format!("publish --topic {topic} --node late --latch --count 1");
        let _late = env.rospy(&words, Some(r#"{"data": "kitchen"}"#))?;
        until_route(&bridge, &route, |route| {
            route.is_some_and(|it| it["counters"]["received"].as_u64().is_some_and(|n| n > 0))
        })?;
        let listener =
            env.dds_subscriber(&topic, "std_msgs/msg/String", "--plain --transient-local")?;
        listener
            .wait_until("what is kept", |output: &Output| {
                let mut heard = output.events("message").into_iter();
                heard.any(|one| one["fields"]["data"] == "kitchen").then_some(())
            })
            .map_err(|error| error.context(bridge.tail()))?;
        Ok(())
    })
}

#[test]
fn a_topic_is_worth_one_line() -> Result {
    run("a_topic_is_worth_one_line", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("text");
        let _talker = env
            .rospy(&format!("publish --topic {topic} --node talker"), Some(r#"{"data": "{n}"}"#))?;
        let bridge = bridge(env, &[])?;
        until_route(&bridge, &format!("ros:{topic} -> ros2:{topic}"), waits_for_a_listener)?;
        let mut listener = echo(env, &ros2(&topic), &["--type", "Text", "--count", "3"])?;
        listener.exits_with(0)?;
        until_route(&bridge, &format!("ros:{topic} -> ros2:{topic}"), waits_for_a_listener)?;
        // It is told a second later: those that are many get one line.
        let lines = |output: &Output| -> Vec<String> {
            let all = output.out.iter().chain(&output.err);
            let told = all.filter(|it| it.contains(&topic) && !it.trim_start().starts_with('{'));
            told.cloned().collect()
        };
        let lines = bridge.wait_until("the line", |output| {
            let lines = lines(output);
            (!lines.is_empty()).then_some(lines)
        })?;
        assert_eq!(lines.len(), 1, "{lines:#?}");
        assert!(lines[0].contains("route made for"), "{lines:#?}");
        Ok(())
    })
}

#[test]
fn time_is_carried_where_it_is_wished() -> Result {
    run("time_is_carried_where_it_is_wished", WITH_DDS, |env| {
        let _roscore = env.roscore()?;
        let bridge = bridge(env, &["-p", "clock:=true", "-p", "service_timeout_ms:=60000"])?;
        let kind = "rosgraph_msgs/msg/Clock";
        let hears = env.dds_subscriber("/clock", kind, "--best-effort --depth 1")?;
        let value = r#"{"clock": {"secs": 1700000000, "nsecs": {n}}}"#;
        let _clock = env.rospy("publish --topic /clock --type rosgraph_msgs/Clock", Some(value))?;
        let heard = hears.messages(1).map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(heard[0]["fields"]["clock"]["sec"], 1_700_000_000);
        Ok(())
    })
}

fn call(env: &TestEnv, service: &str, kind: &str, value: &str) -> Result<Process> {
    let endpoint = ros2(service);
    let args = ["call", &endpoint, "--type", kind, "--value", value];
    env.wrapyfi(args.into_iter().chain(["--timeout", "100", "--json"]))
}

/// Its routes are its own, and have the options that a parameter gives them.
#[test]
fn services_that_it_finds_have_events_where_they_are_wished() -> Result {
    const NEEDS: &[Need] = &[Need::Program, Need::Ros1, Need::Kilted];
    run("services_that_it_finds_have_events_where_they_are_wished", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let (ros, set) = (super::actions::kilted(env)?, env.topic("set"));
        let _setter = env.rospy(&format!("serve --topic {set} --node setter"), None)?;
        let bridge = bridge(env, &["-p", "options:=[introspection=contents]"])?;
        let events = format!("--topic {set}/_service_event --type std_srvs/srv/SetBool_Event");
        let ear = ros.rclpy(&format!("subscribe {events} --node ear"), None)?;
        ear.event("ready")?;
        // Events are not kept: those before the ear has found the bridge are lost.
        loop {
            let asked = call(env, &set, "std_srvs/srv/SetBool", r#"{"data": true}"#)?;
            asked.objects(1).map_err(|error| error.context(bridge.tail()))?;
            let heard = ear.wait_until("events", |output| Some(output.events("message")))?;
            let answer = |event: &Value| event["value"]["response"][0]["message"] == "so be it";
            if heard.iter().any(answer) {
                return Ok(());
            }
        }
    })
}

#[test]
fn services_that_fail_or_are_named_as_those_of_nodes_are_carried() -> Result {
    run("services_that_fail_or_are_named_as_those_of_nodes_are_carried", NEEDS, |env| {
        let _roscore = env.roscore()?;
        // As dynamic_reconfigure calls it.
        let (set, clear) = (env.topic("camera/set_parameters"), env.topic("clear"));
        let _setter = env.rospy(&format!("serve --topic {set} --node setter"), None)?;
        let args = format!("serve --topic {clear} --type std_srvs/Empty --node cleaner");
        let _cleaner = env.rospy(&args, Some(r#"{"never": "=1/0"}"#))?;
        let bridge = bridge(env, &[])?;
        let asked = call(env, &set, "std_srvs/srv/SetBool", r#"{"data": true}"#)?;
        let got = asked.objects(1).map_err(|error| error.context(bridge.tail()))?.remove(0);
        assert_eq!(got["value"]["message"], "so be it");
        let mut asked = call(env, &clear, "std_srvs/srv/Empty", "{}")?;
        asked.objects(1).map_err(|error| error.context(bridge.tail()))?;
        asked.exits_with(0)?;
        bridge.wait_until("the reason", |output| {
            let mut lines = output.err.iter();
            lines.any(|line| line.contains("division by zero")).then_some(())
        })?;
        Ok(())
    })
}

/// Names that ROS 2 lacks are as they are on the side of ROS 1, and replaced by patterns.
#[test]
fn names_that_ros_2_lacks_are_carried() -> Result {
    run("names_that_ros_2_lacks_are_carried", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let base = env.topic("names");
        let [topic, service] = ["robot-1/1st", "2nd-lamp"].map(|name| format!("{base}/{name}"));
        let by_pattern = [format!("{base}/robot_1/_1st"), format!("{base}/_2nd_lamp")];
        let _talker = env
            .rospy(&format!("publish --topic {topic} --node talker"), Some(r#"{"data": "hi"}"#))?;
        let _lamp = env.rospy(&format!("serve --topic {service} --node lamp"), None)?;
        let heard = |endpoint: &str| -> Result {
            let mut echo = echo(env, endpoint, &["--type", "Text", "--count", "1"])?;
            assert_eq!(echo.objects(1)?[0]["value"], "hi");
            echo.exits_with(0)
        };
        let called = |endpoint: &str| -> Result {
            let args = ["call", endpoint, "--args", "[true]", "--json", "--timeout", "100"];
            let mut call = env.wrapyfi(args)?;
            assert_eq!(call.objects(1)?[0]["value"]["message"], "so be it", "{}", call.tail());
            call.exits_with(0)
        };
        heard(&ros1(&topic))?;
        called(&ros1(&service))?;
        let bridge = bridge(env, &[])?;
        let context = |error: anyhow::Error| error.context(bridge.tail());
        heard(&ros2(&by_pattern[0])).map_err(context)?;
        called(&ros2(&by_pattern[1])).map_err(context)?;
        // A bridge tells of its routes once a second.
        let names_it = || -> Result<bool> {
            let mut why = env.wrapyfi(["why", &ros1(&topic)])?;
            why.exit_code()?;
            Ok(why.stdout().contains(&ros2(&by_pattern[0])))
        };
        assert!(names_it()? || names_it()? || names_it()?, "{}", bridge.tail());
        drop(bridge);
        let by_hand = env.topic("by_hand");
        let route = Route::new(&ros1(&topic), &ros2(&by_hand), "Text");
        let bridge = env.bridge(&env.foreign().route(route))?;
        heard(&ros2(&by_hand)).map_err(|error| error.context(bridge.tail()))
    })
}

/// A name of ROS 2 means the one that a subscriber on ROS 1 has; of two that become one both are told.
#[test]
fn names_that_ros_2_lacks_are_meant_and_told() -> Result {
    run("names_that_ros_2_lacks_are_meant_and_told", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let base = env.topic("meant");
        let name = |end: &str| format!("{base}/{end}");
        let ear = env.rospy(&format!("subscribe --topic {} --node ear", name("rs-1/2nd")), None)?;
        let talker = |topic: &str, node: &str| {
            let args = format!("publish --topic {} --node {node}", name(topic));
            env.rospy(&args, Some(r#"{"data": "hi"}"#))
        };
        let _both = [talker("arm-1/1st", "first")?, talker("arm_1/_1st", "second")?];
        let bridge = bridge(env, &[])?;
        let to = ros2(&name("rs_1/_2nd"));
        let publish = ["pub", &to, "--type", "Text", "--value", "\"go\"", "--rate", "20"];
        let _publisher = env.wrapyfi(publish)?;
        let heard = ear.messages(1).map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(heard[0]["value"]["data"], "go", "{}", heard[0]);
        assert!(env.ros_books()?.publishers.iter().all(|(one, _)| *one != name("rs_1/_2nd")));

        let [first, second] = ["arm-1/1st", "arm_1/_1st"].map(|end| ros1(&name(end)));
        let is_both = |line: &String| line.contains(&first) && line.contains(&second);
        let line = bridge.wait_until("both names in the log", |output| {
            output
                .err
                .iter()
                .find(|line| line.contains("WARN") && line.contains(" goes; write"))
                .cloned()
        })?;
        let shared = ros2(&name("arm_1/_1st"));
        assert!(line.contains(&shared) && is_both(&line), "{line}");
        let node = ["--node", NODE];
        let why = |name: &str| -> Result<String> {
            let mut why = env.wrapyfi(["why", name].into_iter().chain(node))?;
            why.exit_code()?;
            Ok(why.stdout())
        };
        let told = why(&shared)?;
        assert!(is_both(&told), "{told}");
        let [one, other] = [why(&first)?, why(&second)?];
        let left = if one.contains(" goes; write") { one } else { other };
        assert!(is_both(&left) && left.contains("give it a route with another name"), "{left}");
        // No program has the name on either side: what would lead to it is meant.
        let told = why(&ros2(&name("none")))?;
        let way = format!("{} -> {}", ros1(&name("none")), ros2(&name("none")));
        assert!(told.contains(&way), "{told}");
        Ok(())
    })
}

/// A publisher that is started again with another definition of its type: the new field was dropped.
#[test]
fn the_learned_type_follows_its_publisher() -> Result {
    run("the_learned_type_follows_its_publisher", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("grown");
        let talk = |file: &str, text: &str, value: &str| {
            let file = env.write(file, text)?.display().to_string();
            let args = format!(
                "publish --topic {topic} --type wrapyfi_lab/Grown --definition {file} --node grown"
            );
            env.rospy(&args, Some(value))
        };
        let mut before = talk("before.txt", "int32 a\n", r#"{"a": 1}"#)?;
        let _bridge = bridge(env, &[])?;
        let types =
            |folder: &str, text: &str| folder_with(env, folder, "wrapyfi_lab/msg/Grown.msg", text);
        let old = types("old", "int32 a\n")?;
        let new = types("new", "int64 a\nstring b\n")?;
        let hears = |folder: &str, wanted: Value| -> Result {
            let more = ["--type", "wrapyfi_lab/msg/Grown", "--definitions", folder, "--count", "1"];
            let mut echo = echo(env, &ros2(&topic), &more)?;
            assert_eq!(echo.objects(1)?[0]["value"], wanted);
            echo.exits_with(0)
        };
        hears(&old, json!({"a": 1}))?;
        before.terminate()?;
        before.exit_code()?;
        let _after = talk("after.txt", "int64 a\nstring b\n", r#"{"a": 5000000000, "b": "x"}"#)?;
        hears(&new, json!({"a": 5_000_000_000_i64, "b": "x"}))
    })
}

/// A service of a package whose messages only a publisher shows appears, and is called by the type that the bridge has
/// learned.
#[test]
fn a_learned_service_is_called_by_the_type_that_the_bridge_knows() -> Result {
    run("a_learned_service_is_called_by_the_type_that_the_bridge_knows", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let (topic, service) = (env.topic("part"), env.topic("s2"));
        let folder = env.definitions(&[
            ("wrapyfi_n/srv/S2.srv", "wrapyfi_m/Bb b\n---\nwrapyfi_m/Bb b\n"),
            ("wrapyfi_m/msg/Bb.msg", "A a\nint32 n\n"),
            ("wrapyfi_m/msg/A.msg", "string text\n"),
        ])?;
        let text = "wrapyfi_m/Bb b\n---\nwrapyfi_m/Bb b\n";
        let own = folder_with(env, "own", "wrapyfi_n/srv/S2.srv", text)?;
        let args =
            format!("serve --topic {service} --type wrapyfi_n/S2 --node s2 --definitions {folder}");
        let _server = env.rospy(&args, Some(r#"{"b": "=request.b"}"#))?;
        let args =
            format!("publish --topic {topic} --type wrapyfi_m/Bb --node bb --definitions {folder}");
        let _talker = env.rospy(&args, Some(r#"{"n": 3}"#))?;
        env.set_variable("ROS_PACKAGE_PATH", own);
        let bridge = bridge(env, &[])?;
        let route = format!("ros2:{service} -> ros:{service}");
        until_route(&bridge, &route, |route| {
            route.is_some_and(|route| route["type"] == "wrapyfi_n/srv/S2")
        })?;
        env.set_variable("ROS_PACKAGE_PATH", "");
        let kwargs = r#"{"b": {"a": {"text": "hi"}, "n": 7}}"#;
        let args = ["call", &ros2(&service), "--kwargs", kwargs, "--json", "--timeout", "100"];
        let mut call = env.wrapyfi(args)?;
        call.exits_with(0).map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(call.objects(1)?[0]["value"]["b"], json!({"a": {"text": "hi"}, "n": 7}));
        drop(bridge);
        // The same where `definitions` has the service, and only the publisher the messages inside.
        let text = format!(
            "definitions: [own]\nroutes:\n  - {{ name: s2, service: '{}', as: '{}' }}\n  - {{ from: '{}', to: '{}' }}\n",
            ros1(&service),
            ros2(&service),
            ros1(&topic),
            ros2(&topic),
        );
        let file = env.write("folder.yaml", text)?.display().to_string();
        let bridge = env.wrapyfi(["bridge", "--config", &file, "--json"])?.pillar();
        until_route(&bridge, "s2", |route| {
            route.is_some_and(|it| it["type"] == "wrapyfi_n/srv/S2" && it["state"] == "active")
        })
        .map_err(|error| error.context(bridge.tail()))
    })
}

/// A type without fields, whose text is empty, is one that its publisher shows.
#[test]
fn a_type_without_fields_is_learned() -> Result {
    run("a_type_without_fields_is_learned", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("nothing");
        let file = env.write("nothing.txt", "")?.display().to_string();
        let args = format!(
            "publish --topic {topic} --type wrapyfi_lab/Nothing --definition {file} --node nothing"
        );
        let _talker = env.rospy(&args, Some("{}"))?;
        let bridge = bridge(env, &[])?;
        let mut echo = echo(env, &ros2(&topic), &["--count", "1"])?;
        let heard = echo.objects(1).map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(
            (&heard[0]["type"], &heard[0]["value"]),
            (&json!("wrapyfi_lab/msg/Nothing"), &json!({}))
        );
        echo.exits_with(0)
    })
}

/// Fields that one of the two definitions lacks are named: in the log once, by `why` and `check` always.
#[test]
fn fields_that_are_lost_are_named() -> Result {
    run("fields_that_are_lost_are_named", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("differs");
        let folder =
            env.definitions(&[("wrapyfi_lab/msg/Differs.msg", "int32 a\nint32 only2\n")])?;
        let file = env.write("differs.txt", "int32 a\nint32 only1\n")?.display().to_string();
        let args = format!(
            "publish --topic {topic} --type wrapyfi_lab/Differs --definition {file} --node d"
        );
        let _talker = env.rospy(&args, Some(r#"{"a": 1, "only1": 2}"#))?;
        let kind = "wrapyfi_lab/msg/Differs";
        let route = Route::new(&ros1(&topic), &ros2(&topic), kind);
        let config = env.foreign().with("definitions", "[interfaces]").route(route);
        let file = env.write("differs.yaml", config.yaml())?.display().to_string();
        let bridge = env.bridge_named("differs.yaml", &config)?;
        let more = ["--type", kind, "--definitions", &folder, "--count", "3"];
        let mut echo = echo(env, &ros2(&topic), &more)?;
        let heard = echo.objects(3).map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(heard[0]["value"], json!({"a": 1, "only2": 0}));
        echo.exits_with(0)?;
        for lost in ["only1 is in ROS 1 only", "only2 is in ROS 2 only"] {
            assert_eq!(log(&bridge).matches(lost).count(), 1, "{}", bridge.tail());
            let mut why = env.wrapyfi(["why", &ros1(&topic), "--config", &file])?;
            why.exit_code()?;
            assert!(why.stdout().contains(lost), "{}", why.tail());
        }
        let text = "int32 a\nint32 only1\n";
        let own = folder_with(env, "own", "wrapyfi_lab/msg/Differs.msg", text)?;
        env.set_variable("ROS_PACKAGE_PATH", own);
        let mut check = env.wrapyfi(["check", &file])?;
        check.exits_with(0)?;
        assert!(check.stderr().contains("only1 is in ROS 1 only"), "{}", check.tail());
        Ok(())
    })
}
