//! Everything of one middleware in another: topics and services that nobody has written down.

#![allow(clippy::indexing_slicing, reason = "in a test a panic is the right answer")]

use std::time::Instant;

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, PATIENCE, Process, Result, World, ros2, run, until_route};

const ROS1: &[Need] = &[Need::Program, Need::Ros1, Need::Executable("ros1_bridge")];
const ROS1_AND_DDS: &[Need] =
    &[Need::Program, Need::Ros1, Need::Executable("ros1_bridge"), Need::Python];

fn bridge(world: &World, more: &[&str]) -> Result<Process> {
    let args = [&["-p", "status_json:=true"], more].concat();
    world.executable("ros1_bridge", &args)
}

fn is(state: &str) -> impl Fn(Option<&Value>) -> bool {
    move |route| route.is_some_and(|route| route["state"] == state)
}

/// Asks a tool again until it says what it should.
fn tells(world: &World, tool: &str, args: &str, wanted: impl Fn(&str) -> bool) -> Result<String> {
    let deadline = Instant::now() + PATIENCE;
    let mut said = String::new();
    while Instant::now() < deadline {
        let mut process = world.ros_tool(tool, args)?;
        process.exit_code()?;
        said = process.stdout();
        if wanted(&said) {
            return Ok(said);
        }
    }
    anyhow::bail!("{tool} {args} never said what it should, last:\n{said}")
}

/// Looks at ROS 2 until it is as it should be.
fn listed(world: &World, wanted: impl Fn(&[Value]) -> bool) -> Result {
    let deadline = Instant::now() + PATIENCE;
    let mut found = Vec::new();
    while Instant::now() < deadline {
        let mut list = world.wrapyfi(["list", "ros2", "--json", "--wait", "2"])?;
        list.exits_with(0)?;
        found = list.stdout().lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
        if wanted(&found) {
            return Ok(());
        }
    }
    anyhow::bail!("ROS 2 never was as it should be, last: {found:#?}")
}

fn echo(world: &World, endpoint: &str, more: &[&str]) -> Result<Process> {
    let args = ["echo", endpoint, "--json", "--timeout", "100"];
    world.wrapyfi(args.into_iter().chain(more.iter().copied()))
}

/// A type that no package has: it is learned from its publisher.
#[test]
fn a_topic_of_a_type_unknown_here_appears_in_ros_2() -> Result {
    run("a_topic_of_a_type_unknown_here_appears_in_ros_2", ROS1, |world| {
        let _roscore = world.roscore()?;
        let topic = world.topic("pose");
        let full = world.write(
            "Pose.txt",
            "Header header\nstring what\nGrip grip\n\
             ================================================================================\n\
             MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n\
             ================================================================================\n\
             MSG: wrapyfi_demo_msgs/Grip\nfloat64 force\n",
        )?;
        let args = format!(
            "publish --topic {topic} --type wrapyfi_demo_msgs/Pose --definition {}",
            full.display()
        );
        let value =
            r#"{"header": {"frame_id": "hand"}, "what": "cup {n}", "grip": {"force": 0.5}}"#;
        let _peer = world.rospy(&args, Some(value))?;
        let bridge = bridge(world, &[])?;
        listed(world, |found| {
            found.iter().any(|one| {
                one["name"] == topic.as_str()
                    && one["role"] == "publisher"
                    && one["type"] == "wrapyfi_demo_msgs/msg/Pose"
            })
        })
        .map_err(|error| error.context(bridge.tail()))?;
        let folder = world.definitions(&[
            ("wrapyfi_demo_msgs/msg/Pose.msg", "std_msgs/Header header\nstring what\nGrip grip\n"),
            ("wrapyfi_demo_msgs/msg/Grip.msg", "float64 force\n"),
        ])?;
        let more =
            ["--type", "wrapyfi_demo_msgs/msg/Pose", "--definitions", &folder, "--count", "2"];
        let mut echo = echo(world, &ros2(&topic), &more)?;
        let heard = echo.objects(2).map_err(|error| error.context(bridge.tail()))?;
        echo.exits_with(0)?;
        assert_eq!(heard[1]["value"]["grip"], json!({"force": 0.5}), "{heard:?}");
        assert_eq!(heard[0]["value"]["header"]["frame_id"], "hand");
        assert!(heard[0]["value"]["what"].as_str().is_some_and(|what| what.starts_with("cup ")));
        Ok(())
    })
}

#[test]
fn a_topic_is_there_before_and_carried_only_while_somebody_listens() -> Result {
    run("a_topic_is_there_before_and_carried_only_while_somebody_listens", ROS1, |world| {
        let _roscore = world.roscore()?;
        let topic = world.topic("text");
        let peer = world.rospy(&format!("publish --topic {topic}"), Some(r#"{"data": "{n}"}"#))?;
        peer.event("ready")?;
        let bridge = bridge(world, &[])?;
        let route = format!("ros:{topic} -> ros2:{topic}");
        until_route(&bridge, &route, |route| {
            route.is_some_and(|it| it["reason"] == format!("a listener on ros2:{topic}"))
        })?;
        listed(world, |found| found.iter().any(|one| one["name"] == topic.as_str()))?;
        let nobody = |said: &str| said.contains("Subscribers: None");
        tells(world, "rostopic", &format!("info {topic}"), nobody)?;
        let mut echo = echo(world, &ros2(&topic), &["--type", "Text", "--count", "3"])?;
        echo.objects(3).map_err(|error| error.context(bridge.tail()))?;
        echo.exits_with(0)?;
        // What it sent was heard: it sends nothing that nobody subscribes to.
        assert!(!peer.messages(3)?.is_empty());
        tells(world, "rostopic", &format!("info {topic}"), nobody)?;

        // Who goes is gone, on the other side too.
        drop(peer);
        until_route(&bridge, &route, |route| route.is_none())?;
        listed(world, |found| !found.iter().any(|one| one["name"] == topic.as_str()))?;
        let log = bridge.stderr() + &bridge.stdout();
        assert!(log.contains("route made for") && log.contains("its source is gone"), "{log}");
        Ok(())
    })
}

/// What latches waits for who comes later, though nobody listened when its route was made.
#[test]
fn what_latches_is_kept_for_who_comes_later() -> Result {
    run("what_latches_is_kept_for_who_comes_later", ROS1_AND_DDS, |world| {
        let _roscore = world.roscore()?;
        let topic = world.topic("tf_static");
        let mut talkers = Vec::new();
        for node in ["left", "right"] {
            let words = format!("publish --topic {topic} --node {node} --latch --count 1");
            let talker = world.rospy(&words, Some(&format!(r#"{{"data": "{node}"}}"#)))?;
            talker.event("done")?;
            talkers.push(talker);
        }
        let bridge = bridge(world, &[])?;
        until_route(&bridge, &format!("ros:{topic} -> ros2:{topic}"), |route| {
            route.is_some_and(|it| it["counters"]["received"] == 2)
        })?;
        let late =
            world.dds_subscriber(&topic, "std_msgs/msg/String", "--plain --transient-local")?;
        let heard = late.messages(2).map_err(|error| error.context(bridge.tail()))?;
        let mut texts: Vec<&Value> = heard.iter().map(|one| &one["fields"]["data"]).collect();
        texts.sort_by_key(ToString::to_string);
        assert_eq!(texts, [&json!("left"), &json!("right")]);
        Ok(())
    })
}

#[test]
fn topics_of_ros_2_are_heard_in_ros_1() -> Result {
    run("topics_of_ros_2_are_heard_in_ros_1", ROS1_AND_DDS, |world| {
        let _roscore = world.roscore()?;
        let (topic, denied) = (world.topic("image"), world.topic("denied"));
        let kind = "sensor_msgs/msg/Image";
        let _publisher = world.dds_publisher(&topic, kind, "--flavour colour")?;
        let _other = world.dds_publisher(&denied, kind, "--flavour colour")?;
        let bridge = bridge(world, &["-p", "deny:=[\".*/denied\"]"])?;
        let ear =
            world.rospy(&format!("subscribe --topic {topic} --type sensor_msgs/Image"), None)?;
        let heard = ear.messages(2).map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(heard[0]["value"]["width"], 64, "{}", heard[0]);
        let said = tells(world, "rostopic", "list", |said| said.contains(&topic))?;
        assert!(!said.contains(&denied) && !said.contains("parameter_events"), "{said}");
        Ok(())
    })
}

#[test]
fn services_go_both_ways() -> Result {
    run("services_go_both_ways", ROS1, |world| {
        let _roscore = world.roscore()?;
        let (there, here) = (world.topic("there"), world.topic("here"));
        let peer = world.rospy(&format!("serve --topic {there}"), None)?;
        peer.event("ready")?;
        let set = "std_srvs/srv/SetBool";
        let value = r#"{"success": true, "message": "done"}"#;
        let endpoint = ros2(&here);
        let _server = world.wrapyfi(["serve", &endpoint, "--type", set, "--value", value])?;
        let bridge = bridge(world, &[])?;
        let endpoint = ros2(&there);
        let mut call = world.wrapyfi([
            "call",
            &endpoint,
            "--type",
            set,
            "--value",
            r#"{"data": true}"#,
            "--timeout",
            "100",
            "--json",
        ])?;
        let got = call.objects(1).map_err(|error| error.context(bridge.tail()))?.remove(0);
        call.exits_with(0)?;
        assert_eq!(got["value"], json!({"success": true, "message": "so be it"}));

        tells(world, "rosservice", "list", |said| said.contains(&here))?;
        let said = tells(world, "rosservice", &format!("call {here} true"), |said| {
            said.contains("success: True")
        })?;
        assert!(said.contains("done"), "{said}");
        let all = tells(world, "rosservice", "list", |_| true)?;
        assert!(!all.contains("get_parameters"), "{all}");
        Ok(())
    })
}

/// Two of the same: each message comes once, and the second goes on where the first ends.
#[test]
fn two_bridges_side_by_side_neither_loop_nor_double() -> Result {
    run("two_bridges_side_by_side_neither_loop_nor_double", ROS1, |world| {
        let _roscore = world.roscore()?;
        let (one, two) = (world.topic("one"), world.topic("two"));
        let _talker = world
            .rospy(&format!("publish --topic {one} --node talker"), Some(r#"{"data": "{n}"}"#))?;
        let endpoint = ros2(&two);
        let _speaker = world
            .wrapyfi(["pub", &endpoint, "--type", "Text", "--value", "\"x\"", "--rate", "20"])?;
        let first = bridge(world, &[])?;
        let there = format!("ros:{one} -> ros2:{one}");
        let back = format!("ros2:{two} -> ros:{two}");
        until_route(&first, &there, is("waiting"))?;
        until_route(&first, &back, is("waiting"))?;
        let second = bridge(world, &["-r", "__node:=second_bridge"])?;
        let yields = |route: Option<&Value>| {
            let reason = route.and_then(|route| route["reason"].as_str());
            reason.is_some_and(|reason| reason.contains("which carries it to"))
        };
        until_route(&second, &there, yields)?;
        until_route(&second, &back, yields)?;

        let ear = world.rospy(&format!("subscribe --topic {two} --node ear"), None)?;
        let echo = echo(world, &ros2(&one), &["--type", "Text", "--count", "100000"])?;
        let heard = echo.objects(60).map_err(|error| error.context(first.tail()))?;
        ear.messages(20)?;
        let numbers: Vec<u64> =
            heard.iter().filter_map(|one| one["value"].as_str()?.parse().ok()).collect();
        assert_eq!(numbers.len(), 60);
        assert!(numbers.windows(2).all(|two| two[0] < two[1]), "{numbers:?}");
        // Neither has made the way back of what the other brings.
        for bridge in [&first, &second] {
            let made = bridge.stderr() + &bridge.stdout();
            for wrong in [format!("ros2:{one} -> ros:{one}"), format!("ros:{two} -> ros2:{two}")] {
                assert!(!made.contains(&wrong), "{wrong}: {made}");
            }
        }
        drop(first);
        let before = echo.objects(60)?.len();
        until_route(&second, &there, is("active"))?;
        echo.objects(before + 60).map_err(|error| error.context(second.tail()))?;
        Ok(())
    })
}

/// A topic that has publishers on both sides goes both ways, once.
#[test]
fn a_topic_of_both_sides_goes_both_ways() -> Result {
    run("a_topic_of_both_sides_goes_both_ways", ROS1, |world| {
        let _roscore = world.roscore()?;
        let topic = world.topic("tf");
        let _talker = world.rospy(
            &format!("publish --topic {topic} --node talker --latch --rate 10"),
            Some(r#"{"data": "from 1"}"#),
        )?;
        let endpoint = ros2(&topic);
        let _speaker = world.wrapyfi([
            "pub",
            &endpoint,
            "--type",
            "Text",
            "--value",
            "\"from 2\"",
            "--rate",
            "10",
        ])?;
        let bridge = bridge(world, &[])?;
        let ear = world.rospy(&format!("subscribe --topic {topic} --node ear"), None)?;
        let hears = |text: &str| {
            let text = text.to_owned();
            move |output: &wrapyfi_e2e::Output| {
                let mut heard = output.events("message").into_iter();
                heard.any(|one| one["value"]["data"] == text.as_str()).then_some(())
            }
        };
        ear.wait_until("ROS 2's", hears("from 2")).map_err(|e| e.context(bridge.tail()))?;
        ear.wait_until("ROS 1's own", hears("from 1"))?;
        let echo = echo(world, &endpoint, &["--type", "Text", "--count", "100000"])?;
        let both = |output: &wrapyfi_e2e::Output| {
            let all: Vec<Value> = output.objects().map(|one| one["value"].clone()).collect();
            (all.contains(&json!("from 1")) && all.contains(&json!("from 2"))).then_some(())
        };
        echo.wait_until("both", both).map_err(|error| error.context(bridge.tail()))?;
        Ok(())
    })
}

#[test]
fn ports_of_yarp_are_topics_of_ros_2() -> Result {
    let needs = &[Need::Program, Need::Executable("yarp_bridge")];
    run("ports_of_yarp_are_topics_of_ros_2", needs, |world| {
        world.yarp_conf()?;
        let port = world.yarp_port().to_string();
        let _names =
            world.wrapyfi(["yarpserver", "--port", &port, "--no-discovery", "--silent"])?.pillar();
        let (there, here) = (world.topic("state"), world.topic("chatter"));
        let (out, endpoint) = (format!("yarp:{there}:o"), ros2(&here));
        let value = r#"{"joints": [1, 2.5]}"#;
        let _port = world.wrapyfi([
            "pub",
            &out,
            "--type",
            "NativeObject",
            "--value",
            value,
            "--rate",
            "20",
        ])?;
        let _speaker = world.wrapyfi([
            "pub",
            &endpoint,
            "--type",
            "Text",
            "--value",
            "\"hello\"",
            "--rate",
            "20",
        ])?;
        let bridge = world.executable("yarp_bridge", &[])?;
        let more = ["--type", "NativeObject", "--count", "1"];
        let mut echo_there = echo(world, &ros2(&format!("{there}/o")), &more)?;
        let heard = echo_there.objects(1).map_err(|error| error.context(bridge.tail()))?;
        echo_there.exits_with(0)?;
        assert_eq!(heard[0]["value"], json!({"joints": [1, 2.5]}), "{heard:?}");
        let mut echo_here =
            echo(world, &format!("yarp:{here}"), &["--type", "Text", "--count", "1"])?;
        let heard = echo_here.objects(1).map_err(|error| error.context(bridge.tail()))?;
        echo_here.exits_with(0)?;
        assert_eq!(heard[0]["value"], "hello", "{heard:?}");
        Ok(())
    })
}

#[test]
fn topics_of_zeromq_are_topics_of_ros_2() -> Result {
    let needs = &[Need::Program, Need::Executable("zeromq_bridge")];
    run("topics_of_zeromq_are_topics_of_ros_2", needs, |world| {
        let _broker = world.broker()?;
        let (there, here) = (world.topic("object"), world.topic("chatter"));
        let (from, endpoint) = (format!("zeromq:{there}"), ros2(&here));
        let value = r#"{"joints": [1, 2.5]}"#;
        let bridge = world.executable("zeromq_bridge", &[])?;
        let _publisher = world.wrapyfi([
            "pub",
            &from,
            "--type",
            "NativeObject",
            "--value",
            value,
            "--rate",
            "20",
        ])?;
        let _speaker = world.wrapyfi([
            "pub",
            &endpoint,
            "--type",
            "Text",
            "--value",
            "\"hello\"",
            "--rate",
            "20",
        ])?;
        let more = ["--type", "NativeObject", "--count", "1"];
        let mut echo_there = echo(world, &ros2(&there), &more)?;
        let heard = echo_there.objects(1).map_err(|error| error.context(bridge.tail()))?;
        echo_there.exits_with(0)?;
        assert_eq!(heard[0]["value"], json!({"joints": [1, 2.5]}), "{heard:?}");
        let more = ["--type", "Text", "--count", "1"];
        let mut echo_here = echo(world, &format!("zeromq:{here}"), &more)?;
        let heard = echo_here.objects(1).map_err(|error| error.context(bridge.tail()))?;
        echo_here.exits_with(0)?;
        assert_eq!(heard[0]["value"], "hello", "{heard:?}");
        Ok(())
    })
}

/// One topic whose type nobody has written down, and the status of what waits.
#[test]
fn a_route_without_a_type_learns_it() -> Result {
    run("a_route_without_a_type_learns_it", &[Need::Program, Need::Ros1], |world| {
        let _roscore = world.roscore()?;
        let topic = world.topic("joints");
        let text = format!("routes:\n  - {{ from: \"ros:{topic}\", to: \"ros2:/copy{topic}\" }}\n");
        let file = world.write("bridge.yaml", text)?;
        let file = file.display().to_string();
        let bridge = world.wrapyfi(["bridge", "--config", &file, "--json"])?.pillar();
        let route = format!("ros:{topic} -> ros2:/copy{topic}");
        until_route(&bridge, &route, |route| {
            route.is_some_and(|it| {
                it["reason"].as_str().is_some_and(|why| why.contains("which tells the type"))
            })
        })?;
        let value = r#"{"name": ["a"], "position": [{n}]}"#;
        let kind = "sensor_msgs/JointState";
        let _peer = world.rospy(&format!("publish --topic {topic} --type {kind}"), Some(value))?;
        let endpoint = ros2(&format!("/copy{topic}"));
        let mut echo =
            echo(world, &endpoint, &["--type", "sensor_msgs/msg/JointState", "--count", "1"])?;
        let heard = echo.objects(1).map_err(|error| error.context(bridge.tail()))?;
        echo.exits_with(0)?;
        assert_eq!(heard[0]["value"]["name"], json!(["a"]));
        let mut check = world.wrapyfi(["check", &file])?;
        check.exits_with(0)?;
        assert!(check.stdout().contains("type learned"), "{}", check.stdout());
        Ok(())
    })
}
