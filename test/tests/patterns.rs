//! Everything of one middleware in another: topics and services that no configuration names.

use std::time::Instant;

use serde_json::{Value, json};
use wrapyfi_e2e::{
    Need, Output, Process, Result, Route, TIMEOUT, TestEnv, ros2, run, until_route, zeromq,
};

const ROS1: &[Need] = &[Need::Program, Need::Ros1];
const ROS1_AND_DDS: &[Need] = &[Need::Program, Need::Ros1, Need::Python];

fn bridge(env: &TestEnv, more: &[&str]) -> Result<Process> {
    let args = [&["-p", "status_json:=true"], more].concat();
    env.executable("ros1_bridge", &args)
}

fn is(state: &str) -> impl Fn(Option<&Value>) -> bool {
    move |route| route.is_some_and(|route| route["state"] == state)
}

/// Asks a tool again until it says what it should.
fn tells(env: &TestEnv, tool: &str, args: &str, wanted: impl Fn(&str) -> bool) -> Result<String> {
    let deadline = Instant::now() + TIMEOUT;
    let mut said = String::new();
    while Instant::now() < deadline {
        let mut process = env.ros_tool(tool, args)?;
        process.exit_code()?;
        said = process.stdout();
        if wanted(&said) {
            return Ok(said);
        }
    }
    anyhow::bail!("{tool} {args} never said what it should, last:\n{said}")
}

/// Looks at ROS 2 until it is as it should be.
fn listed(env: &TestEnv, wanted: impl Fn(&[Value]) -> bool) -> Result {
    let deadline = Instant::now() + TIMEOUT;
    let mut found = Vec::new();
    while Instant::now() < deadline {
        let mut list = env.wrapyfi(["list", "ros2", "--json", "--wait", "2"])?;
        list.exits_with(0)?;
        found = list.stdout().lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
        if wanted(&found) {
            return Ok(());
        }
    }
    anyhow::bail!("ROS 2 never was as it should be, last: {found:#?}")
}

fn echo(env: &TestEnv, endpoint: &str, more: &[&str]) -> Result<Process> {
    let args = ["echo", endpoint, "--json", "--timeout", "100"];
    env.wrapyfi(args.into_iter().chain(more.iter().copied()))
}

/// A type that no package has: it is learned from its publisher.
#[test]
fn a_topic_of_a_type_unknown_here_appears_in_ros_2() -> Result {
    run("a_topic_of_a_type_unknown_here_appears_in_ros_2", ROS1, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("pose");
        let full = env.write(
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
        let _peer = env.rospy(&args, Some(value))?;
        let bridge = bridge(env, &[])?;
        listed(env, |found| {
            found.iter().any(|one| {
                one["name"] == topic.as_str()
                    && one["role"] == "publisher"
                    && one["type"] == "wrapyfi_demo_msgs/msg/Pose"
            })
        })
        .map_err(|error| error.context(bridge.tail()))?;
        let folder = env.definitions(&[
            ("wrapyfi_demo_msgs/msg/Pose.msg", "std_msgs/Header header\nstring what\nGrip grip\n"),
            ("wrapyfi_demo_msgs/msg/Grip.msg", "float64 force\n"),
        ])?;
        let more =
            ["--type", "wrapyfi_demo_msgs/msg/Pose", "--definitions", &folder, "--count", "2"];
        let mut echo = echo(env, &ros2(&topic), &more)?;
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
    run("a_topic_is_there_before_and_carried_only_while_somebody_listens", ROS1, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("text");
        let peer = env.rospy(&format!("publish --topic {topic}"), Some(r#"{"data": "{n}"}"#))?;
        peer.event("ready")?;
        let bridge = bridge(env, &[])?;
        let route = format!("ros:{topic} -> ros2:{topic}");
        until_route(&bridge, &route, |route| {
            route.is_some_and(|it| it["reason"] == format!("a listener on ros2:{topic}"))
        })?;
        listed(env, |found| found.iter().any(|one| one["name"] == topic.as_str()))?;
        let nobody = |said: &str| said.contains("Subscribers: None");
        tells(env, "rostopic", &format!("info {topic}"), nobody)?;
        let mut echo = echo(env, &ros2(&topic), &["--type", "Text", "--count", "3"])?;
        echo.objects(3).map_err(|error| error.context(bridge.tail()))?;
        echo.exits_with(0)?;
        // The peer's messages were heard: it sends nothing that no program subscribes to.
        assert!(!peer.messages(3)?.is_empty());
        tells(env, "rostopic", &format!("info {topic}"), nobody)?;

        // A peer that goes is gone, on the other side too.
        drop(peer);
        until_route(&bridge, &route, |route| route.is_none())?;
        listed(env, |found| !found.iter().any(|one| one["name"] == topic.as_str()))?;
        let log = bridge.stderr() + &bridge.stdout();
        assert!(log.contains("route made for") && log.contains("its source is gone"), "{log}");
        Ok(())
    })
}

/// A latched message waits for later listeners, though no program listened when its route was made.
#[test]
fn what_latches_is_kept_for_who_comes_later() -> Result {
    run("what_latches_is_kept_for_who_comes_later", ROS1_AND_DDS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("tf_static");
        let mut talkers = Vec::new();
        for node in ["left", "right"] {
            let words = format!("publish --topic {topic} --node {node} --latch --count 1");
            let talker = env.rospy(&words, Some(&format!(r#"{{"data": "{node}"}}"#)))?;
            talker.event("done")?;
            talkers.push(talker);
        }
        let bridge = bridge(env, &[])?;
        until_route(&bridge, &format!("ros:{topic} -> ros2:{topic}"), |route| {
            route.is_some_and(|it| it["counters"]["received"] == 2)
        })?;
        let late =
            env.dds_subscriber(&topic, "std_msgs/msg/String", "--plain --transient-local")?;
        let heard = late.messages(2).map_err(|error| error.context(bridge.tail()))?;
        let mut texts: Vec<&Value> = heard.iter().map(|one| &one["fields"]["data"]).collect();
        texts.sort_by_key(ToString::to_string);
        assert_eq!(texts, [&json!("left"), &json!("right")]);
        Ok(())
    })
}

#[test]
fn topics_of_ros_2_are_heard_in_ros_1() -> Result {
    run("topics_of_ros_2_are_heard_in_ros_1", ROS1_AND_DDS, |env| {
        let _roscore = env.roscore()?;
        let (topic, denied) = (env.topic("image"), env.topic("denied"));
        let kind = "sensor_msgs/msg/Image";
        let _publisher = env.dds_publisher(&topic, kind, "--flavour colour")?;
        let _other = env.dds_publisher(&denied, kind, "--flavour colour")?;
        let bridge = bridge(env, &["-p", "deny:=[\".*/denied\"]"])?;
        let ear =
            env.rospy(&format!("subscribe --topic {topic} --type sensor_msgs/Image"), None)?;
        let heard = ear.messages(2).map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(heard[0]["value"]["width"], 64, "{}", heard[0]);
        let said = tells(env, "rostopic", "list", |said| said.contains(&topic))?;
        assert!(!said.contains(&denied) && !said.contains("parameter_events"), "{said}");
        Ok(())
    })
}

#[test]
fn services_go_both_ways() -> Result {
    run("services_go_both_ways", ROS1, |env| {
        let _roscore = env.roscore()?;
        let (there, here) = (env.topic("there"), env.topic("here"));
        let peer = env.rospy(&format!("serve --topic {there}"), None)?;
        peer.event("ready")?;
        let carried = env.topic("carried");
        let route = Route::new(&zeromq(&carried), &ros2(&carried), "NativeObject");
        let _with_a_file = env.bridge_named("with_a_file.yaml", &env.embedded().route(route))?;
        let reload = "/wrapyfi_bridge/reload";
        listed(env, |all| all.iter().any(|one| one["name"] == reload))?;
        let set = "std_srvs/srv/SetBool";
        let value = r#"{"success": true, "message": "done"}"#;
        let endpoint = ros2(&here);
        let _server = env.wrapyfi(["serve", &endpoint, "--type", set, "--value", value])?;
        let bridge = bridge(env, &[])?;
        let endpoint = ros2(&there);
        let mut call = env.wrapyfi([
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

        tells(env, "rosservice", "list", |said| said.contains(&here))?;
        let said = tells(env, "rosservice", &format!("call {here} true"), |said| {
            said.contains("success: True")
        })?;
        assert!(said.contains("done"), "{said}");
        let all = tells(env, "rosservice", "list", |_| true)?;
        assert!(!all.contains("get_parameters"), "{all}");
        assert!(!all.contains(reload), "its mark says that no bridge carries it: {all}");
        Ok(())
    })
}

/// Two of the same: each message comes once, and the second goes on where the first ends.
#[test]
fn two_bridges_side_by_side_neither_loop_nor_double() -> Result {
    run("two_bridges_side_by_side_neither_loop_nor_double", ROS1_AND_DDS, |env| {
        let _roscore = env.roscore()?;
        let (one, two) = (env.topic("one"), env.topic("two"));
        let _talker =
            env.rospy(&format!("publish --topic {one} --node talker"), Some(r#"{"data": "{n}"}"#))?;
        let endpoint = ros2(&two);
        let _speaker =
            env.wrapyfi(["pub", &endpoint, "--type", "Text", "--value", "\"x\"", "--rate", "20"])?;
        let first = bridge(env, &[])?;
        let there = format!("ros:{one} -> ros2:{one}");
        let back = format!("ros2:{two} -> ros:{two}");
        until_route(&first, &there, is("waiting"))?;
        until_route(&first, &back, is("waiting"))?;
        let second = bridge(env, &["-r", "__node:=second_bridge"])?;
        let yields = |route: Option<&Value>| {
            let reason = route.and_then(|route| route["reason"].as_str());
            reason.is_some_and(|reason| reason.contains("which carries it to"))
        };
        until_route(&second, &there, yields)?;
        until_route(&second, &back, yields)?;

        // A topic that both find at the same moment.
        let new = env.topic("new");
        let hears = env.rospy(&format!("subscribe --topic {new} --node hears"), None)?;
        let _speaker = env.dds_publisher(&new, "std_msgs/msg/String", "--rate 50 --text {n}")?;
        let heard = hears.messages(100).map_err(|error| error.context(second.tail()))?;
        let values: Vec<String> = heard.iter().map(|one| one["value"].to_string()).collect();
        let distinct: std::collections::BTreeSet<&String> = values.iter().collect();
        assert_eq!(distinct.len(), values.len(), "{values:?}");

        let ear = env.rospy(&format!("subscribe --topic {two} --node ear"), None)?;
        let echo = echo(env, &ros2(&one), &["--type", "Text", "--count", "100000"])?;
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
    run("a_topic_of_both_sides_goes_both_ways", ROS1, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("tf");
        let _talker = env.rospy(
            &format!("publish --topic {topic} --node talker --latch --rate 10"),
            Some(r#"{"data": "from 1"}"#),
        )?;
        let endpoint = ros2(&topic);
        let _speaker = env.wrapyfi([
            "pub",
            &endpoint,
            "--type",
            "Text",
            "--value",
            "\"from 2\"",
            "--rate",
            "10",
        ])?;
        let bridge = bridge(env, &[])?;
        let ear = env.rospy(&format!("subscribe --topic {topic} --node ear"), None)?;
        let hears = |text: &str| {
            let text = text.to_owned();
            move |output: &wrapyfi_e2e::Output| {
                let mut heard = output.events("message").into_iter();
                heard.any(|one| one["value"]["data"] == text.as_str()).then_some(())
            }
        };
        ear.wait_until("ROS 2's", hears("from 2")).map_err(|e| e.context(bridge.tail()))?;
        ear.wait_until("ROS 1's own", hears("from 1"))?;
        let echo = echo(env, &endpoint, &["--type", "Text", "--count", "100000"])?;
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
    let needs = &[Need::Program];
    run("ports_of_yarp_are_topics_of_ros_2", needs, |env| {
        env.yarp_conf()?;
        let port = env.yarp_port().to_string();
        let _names =
            env.wrapyfi(["yarpserver", "--port", &port, "--no-discovery", "--silent"])?.pillar();
        let (there, here) = (env.topic("state"), env.topic("chatter"));
        let (out, endpoint) = (format!("yarp:{there}:o"), ros2(&here));
        let value = r#"{"joints": [1, 2.5]}"#;
        let _port =
            env.wrapyfi(["pub", &out, "--type", "NativeObject", "--value", value, "--rate", "20"])?;
        let _speaker = env.wrapyfi([
            "pub",
            &endpoint,
            "--type",
            "Text",
            "--value",
            "\"hello\"",
            "--rate",
            "20",
        ])?;
        let bridge = env.executable("yarp_bridge", &[])?;
        let more = ["--type", "NativeObject", "--count", "1"];
        let mut echo_there = echo(env, &ros2(&format!("{there}/o")), &more)?;
        let heard = echo_there.objects(1).map_err(|error| error.context(bridge.tail()))?;
        echo_there.exits_with(0)?;
        assert_eq!(heard[0]["value"], json!({"joints": [1, 2.5]}), "{heard:?}");
        let mut echo_here =
            echo(env, &format!("yarp:{here}"), &["--type", "Text", "--count", "1"])?;
        let heard = echo_here.objects(1).map_err(|error| error.context(bridge.tail()))?;
        echo_here.exits_with(0)?;
        assert_eq!(heard[0]["value"], "hello", "{heard:?}");
        Ok(())
    })
}

#[test]
fn topics_of_zeromq_are_topics_of_ros_2() -> Result {
    let needs = &[Need::Program];
    run("topics_of_zeromq_are_topics_of_ros_2", needs, |env| {
        let _broker = env.broker()?;
        let (there, here) = (env.topic("object"), env.topic("chatter"));
        let (from, endpoint) = (format!("zeromq:{there}"), ros2(&here));
        let value = r#"{"joints": [1, 2.5]}"#;
        let bridge = env.executable("zeromq_bridge", &["-p", "status_json:=true"])?;
        let _publisher = env.wrapyfi([
            "pub",
            &from,
            "--type",
            "NativeObject",
            "--value",
            value,
            "--rate",
            "20",
        ])?;
        let _speaker = env.wrapyfi([
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
        let mut echo_there = echo(env, &ros2(&there), &more)?;
        let heard = echo_there.objects(1).map_err(|error| error.context(bridge.tail()))?;
        echo_there.exits_with(0)?;
        assert_eq!(heard[0]["value"], json!({"joints": [1, 2.5]}), "{heard:?}");
        // The bridge looks at all topics of ZeroMQ, and is no listener that anything is brought for.
        until_route(&bridge, &format!("{endpoint} -> zeromq:{here}"), |route| {
            is("waiting")(route)
                && route.is_some_and(|route| route["counters"]["received"] == json!(0))
        })?;
        let more = ["--type", "Text", "--count", "1"];
        let mut echo_here = echo(env, &format!("zeromq:{here}"), &more)?;
        let heard = echo_here.objects(1).map_err(|error| error.context(bridge.tail()))?;
        echo_here.exits_with(0)?;
        assert_eq!(heard[0]["value"], "hello", "{heard:?}");
        Ok(())
    })
}

/// One topic whose type no configuration names, and the status of what waits.
#[test]
fn a_route_without_a_type_learns_it() -> Result {
    run("a_route_without_a_type_learns_it", &[Need::Program, Need::Ros1], |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("joints");
        let text = format!("routes:\n  - {{ from: \"ros:{topic}\", to: \"ros2:/copy{topic}\" }}\n");
        let file = env.write("bridge.yaml", text)?;
        let file = file.display().to_string();
        let bridge = env.wrapyfi(["bridge", "--config", &file, "--json"])?.pillar();
        let route = format!("ros:{topic} -> ros2:/copy{topic}");
        until_route(&bridge, &route, |route| {
            route.is_some_and(|it| {
                it["reason"].as_str().is_some_and(|why| why.contains("which tells the type"))
            })
        })?;
        let value = r#"{"name": ["a"], "position": [{n}]}"#;
        let kind = "sensor_msgs/JointState";
        let _peer = env.rospy(&format!("publish --topic {topic} --type {kind}"), Some(value))?;
        let endpoint = ros2(&format!("/copy{topic}"));
        let mut echo =
            echo(env, &endpoint, &["--type", "sensor_msgs/msg/JointState", "--count", "1"])?;
        let heard = echo.objects(1).map_err(|error| error.context(bridge.tail()))?;
        echo.exits_with(0)?;
        assert_eq!(heard[0]["value"]["name"], json!(["a"]));
        let mut check = env.wrapyfi(["check", &file])?;
        check.exits_with(0)?;
        assert!(check.stdout().contains("type learned"), "{}", check.stdout());
        Ok(())
    })
}

/// The marks that a bridge gives its publishers are a parameter, which another program may have deleted.
#[test]
fn marks_that_are_gone_are_no_fault_at_the_end() -> Result {
    run("marks_that_are_gone_are_no_fault_at_the_end", ROS1_AND_DDS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("words");
        let mut bridge = bridge(env, &[])?;
        let _talker = env.dds_publisher(&topic, "std_msgs/msg/String", "--text hello --rate 5")?;
        let _ear = env.rospy(&format!("subscribe --topic {topic}"), None)?;
        let mut marks = env.rospy("params --topic /wrapyfi_bridges --node marks", None)?;
        let last = |output: &Output| {
            let told = output.events("message").pop()?;
            told["value"].as_object().map(|all| all.keys().cloned().collect::<Vec<_>>())
        };
        let names =
            marks.wait_until("a mark", |output| last(output).filter(|it| !it.is_empty()))?;
        for name in names {
            marks.tell(&json!({ name: null }).to_string())?;
        }
        marks.wait_until("none", |output| last(output).filter(Vec::is_empty))?;
        bridge.terminate()?;
        bridge.exits_with(0)?;
        let log = bridge.stderr() + &bridge.stdout();
        assert!(!log.contains("deleteParam"), "{log}");
        Ok(())
    })
}
