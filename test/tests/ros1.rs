//! The `wrapyfi` program as a node of ROS 1, against Debian's rosmaster, rospy and tools: nothing of
//! ROS 1 is in it.

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Process, Result, Route, TestEnv, ros1, ros2, run, texts, zeromq};

pub(super) const NEEDS: &[Need] = &[Need::Program, Need::Ros1];
pub(super) const WITH_WRAPYFI: &[Need] = &[Need::Program, Need::Ros1, Need::Python];

fn echo(env: &TestEnv, endpoint: &str, message_type: &str, count: usize) -> Result<Process> {
    let count = count.to_string();
    let args = ["echo", endpoint, "--type", message_type, "--count", &count];
    env.wrapyfi(args.into_iter().chain(["--timeout", "100", "--json"]))
}

fn publish(env: &TestEnv, endpoint: &str, value: &str, more: &[&str]) -> Result<Process> {
    let args = ["pub", endpoint, "--value", value].into_iter();
    env.wrapyfi(args.chain(more.iter().copied()))
}

/// Output of a tool that has ended well.
pub(super) fn told(env: &TestEnv, tool: &str, args: &str) -> Result<String> {
    let mut process = env.ros_tool(tool, args)?;
    process.exits_with(0)?;
    Ok(process.stdout())
}

/// Asks a tool again until it says what it should.
pub(super) fn tells(
    env: &TestEnv,
    tool: &str,
    args: &str,
    wanted: impl Fn(&str) -> bool,
) -> Result<String> {
    let mut said = String::new();
    for _ in 0..60 {
        let mut process = env.ros_tool(tool, args)?;
        process.exit_code()?;
        said = process.stdout();
        if wanted(&said) {
            return Ok(said);
        }
    }
    anyhow::bail!("{tool} {args} never said what it should, last:\n{said}")
}

#[test]
fn a_publisher_that_is_killed_is_one_line_of_the_log() -> Result {
    run("a_publisher_that_is_killed_is_one_line_of_the_log", NEEDS, |env| {
        let topic = env.topic("x");
        let listener = env.wrapyfi(["echo", &ros1(&topic), "--type", "Text", "--json"])?;
        let away = format!("waiting for master {}/ (it does not answer: ", env.ros_master_uri());
        listener.wait_until("its complaint", |output| {
            output.err.iter().any(|line| line.contains(&away)).then_some(())
        })?;
        let _roscore = env.roscore()?;
        let mut publisher =
            env.rospy(&format!("publish --topic {topic}"), Some(r#"{"data": "x"}"#))?;
        listener.objects(1)?;
        publisher.kill()?;
        let is_told = |line: &&String| line.contains("ROS 1: publisher");
        listener.wait_until("what came of it", |output| {
            let mut told = output.err.iter().filter(is_told);
            told.any(|line| line.contains("it does not answer")).then_some(())
        })?;
        let said = listener.stderr();
        assert_eq!(said.matches("ROS 1: publisher").count(), 1, "{said}");
        Ok(())
    })
}

#[test]
fn the_tools_of_ros_1_show_our_node() -> Result {
    run("the_tools_of_ros_1_show_our_node", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("x");
        let listener = env.rospy(&format!("subscribe --topic {topic}"), None)?;
        let mut publisher = publish(
            env,
            &ros1(&topic),
            r#"{"n": 1}"#,
            &["--type", "NativeObject", "--rate", "20"],
        )?;
        assert_eq!(listener.messages(1)?[0]["value"], json!({"data": "{\"n\": 1}"}));

        let info = told(env, "rostopic", &format!("info {topic}"))?;
        assert!(info.contains("Type: std_msgs/String"), "{info}");
        let publishers = info.split("Subscribers").next().unwrap_or_default();
        let node = publishers.lines().find_map(|line| line.trim().strip_prefix("* /wrapyfi_"));
        let Some(node) = node else { panic!("no node of ours: {info}") };
        let node = format!("/wrapyfi_{}", node.split_whitespace().next().unwrap_or_default());

        let ping = told(env, "rosnode", &format!("ping -c 1 {node}"))?;
        assert!(ping.contains("xmlrpc reply from http://127.0.0.1:"), "{ping}");
        let info = told(env, "rosnode", &format!("info {node}"))?;
        assert!(info.contains(&format!("* {topic} [std_msgs/String]")), "{info}");
        assert!(info.contains("* to: /rospy_peer") && info.contains("outbound"), "{info}");
        assert!(info.contains("transport: TCPROS"), "{info}");
        let echo = told(env, "rostopic", &format!("echo -n 1 {topic}"))?;
        assert!(echo.contains(r#"{\"n\": 1}"#), "{echo}");

        publisher.terminate()?;
        publisher.exits_with(0)?;
        // Nothing of us is left at the master: no grace, no cleanup.
        let nodes = told(env, "rosnode", "list")?;
        assert!(!nodes.contains("/wrapyfi_"), "{nodes}");
        Ok(())
    })
}

#[test]
fn echo_hears_rospy_and_names_itself_to_it() -> Result {
    run("echo_hears_rospy_and_names_itself_to_it", NEEDS, |env| {
        let topic = env.topic("x");
        // Before there is a master.
        let mut echo = echo(env, &ros1(&topic), "NativeObject", 3)?;
        let _roscore = env.roscore()?;
        let peer =
            env.rospy(&format!("publish --topic {topic}"), Some(r#"{"data": "[{n}, 2]"}"#))?;
        let heard = echo.objects(3)?;
        echo.exits_with(0)?;
        let first = heard[0]["value"][0].as_u64().unwrap_or_default();
        for (n, one) in (first..).zip(&heard) {
            assert_eq!(one["value"], json!([n, 2]));
        }
        assert_eq!(peer.messages(1)?[0]["index"], 0);
        Ok(())
    })
}

#[test]
fn latched_messages_go_both_ways_once() -> Result {
    run("latched_messages_go_both_ways_once", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let (there, here) = (env.topic("there"), env.topic("here"));
        // Two latched publishers of one topic: each message once.
        let latch = |node: &str, value: &str| {
            let args = format!("publish --topic {there} --latch --count 1 --node {node}");
            let peer = env.rospy(&args, Some(value))?;
            peer.event("done")?;
            Ok::<_, anyhow::Error>(peer)
        };
        let _first = latch("first", r#"{"data": "1"}"#)?;
        let _second = latch("second", r#"{"data": "2"}"#)?;
        let mut echo = echo(env, &ros1(&there), "NativeObject", 2)?;
        let mut heard: Vec<_> = echo.objects(2)?.iter().map(|one| one["value"].clone()).collect();
        echo.exits_with(0)?;
        heard.sort_by_key(Value::as_u64);
        assert_eq!(heard, [json!(1), json!(2)]);

        let publisher = publish(
            env,
            &ros1(&here),
            r#""kept""#,
            &["--type", "Text", "--qos", "latched", "--rate", "0.01"],
        )?;
        tells(env, "rostopic", &format!("info {here}"), |said| said.contains("* /wrapyfi_"))?;
        for _ in 0..2 {
            let late = env.rospy(&format!("subscribe --topic {here} --count 1"), None)?;
            assert_eq!(late.messages(1)?[0]["value"], json!({"data": "kept"}));
        }
        drop(publisher);
        Ok(())
    })
}

#[test]
fn a_type_of_any_package_is_received_and_sent() -> Result {
    run("a_type_of_any_package_is_received_and_sent", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("joints");
        let value =
            r#"{"header": {"frame_id": "arm"}, "name": ["a", "b"], "position": [0.5, {n}]}"#;
        let kind = "sensor_msgs/JointState";
        let peer = env.rospy(&format!("publish --topic {topic} --type {kind}"), Some(value))?;
        let mut echo = echo(env, &ros1(&topic), "sensor_msgs/msg/JointState", 2)?;
        let heard = echo.objects(2)?;
        echo.exits_with(0)?;
        drop(peer);
        assert_eq!(heard[0]["value"]["name"], json!(["a", "b"]));
        assert_eq!(heard[0]["value"]["header"]["frame_id"], "arm");

        let back = env.topic("back");
        let listener = env.rospy(&format!("subscribe --topic {back} --type {kind}"), None)?;
        let mut publisher = publish(
            env,
            &ros1(&back),
            r#"{"header": {"stamp": {"sec": 5}, "frame_id": "leg"}, "name": ["c"], "effort": [1.5]}"#,
            &["--type", "sensor_msgs/msg/JointState", "--count", "2", "--rate", "20"],
        )?;
        let got = &listener.messages(2)?[1]["value"];
        publisher.exits_with(0)?;
        assert_eq!((&got["name"], &got["effort"]), (&json!(["c"]), &json!([1.5])));
        let header = json!({"seq": 1, "stamp": {"secs": 5, "nsecs": 0}, "frame_id": "leg"});
        assert_eq!(got["header"], header);
        Ok(())
    })
}

#[test]
fn a_mismatch_is_told_on_both_sides() -> Result {
    run("a_mismatch_is_told_on_both_sides", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("x");
        let peer =
            env.rospy(&format!("publish --topic {topic} --latch"), Some(r#"{"data": "1"}"#))?;
        peer.messages(1)?;
        let echo = echo(env, &ros1(&topic), "Image", 1)?;
        echo.wait_until("the reason", |output| {
            let tells = |line: &String| {
                line.contains("it refuses: topic types do not match")
                    && line
                        .contains("wanted is sensor_msgs/Image [060021388200f6f0f447d0fcd9c64743]")
            };
            output.err.iter().any(tells).then_some(())
        })?;
        Ok(())
    })
}

/// The master ends and comes back, a peer is killed and comes back under its name.
#[test]
fn what_is_lost_is_found_again() -> Result {
    run("what_is_lost_is_found_again", NEEDS, |env| {
        let mut roscore = env.roscore()?;
        let topic = env.topic("x");
        let value = Some(r#"{"data": "\"{n}\""}"#);
        let echo = echo(env, &ros1(&topic), "NativeObject", 100_000)?;
        let talker = || env.rospy(&format!("publish --topic {topic} --node talker"), value);
        let first = talker()?;
        let mut heard = echo.objects(3)?.len();
        // The connection outlives the master.
        roscore.terminate()?;
        roscore.exit_code()?;
        heard = echo.objects(heard + 20)?.len();
        drop(roscore);
        let _roscore = env.roscore()?;
        tells(env, "rostopic", &format!("info {topic}"), |said| said.contains("* /wrapyfi_"))?;
        heard = echo.objects(heard + 5)?.len();
        drop(first); // killed, still in nobody's books: rospy does not register again
        let _second = talker()?;
        echo.objects(heard + 5)?;
        Ok(())
    })
}

#[test]
fn properties_are_parameters_of_the_master() -> Result {
    run("properties_are_parameters_of_the_master", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let (there, here) = (env.topic("there"), env.topic("here"));
        let peer = env.rospy(
            &format!("param --topic {there}"),
            Some(r#"{"gain": 2.5, "camera": {"rate": 30}, "names": ["a", "b"]}"#),
        )?;
        peer.event("ready")?;
        let mut echo = echo(env, &ros1(&there), "Properties", 1)?;
        let got = echo.objects(1)?.remove(0);
        echo.exits_with(0)?;
        let expected = json!({"gain": 2.5, "camera.rate": 30, "names": ["a", "b"]});
        assert_eq!(got["value"], expected, "{got}");

        let mut set = publish(
            env,
            &ros1(&here),
            r#"{"gain": 1.5, "camera": {"rate": 10}}"#,
            &["--type", "Properties", "--count", "1"],
        )?;
        set.exits_with(0)?;
        let peer = env.rospy(&format!("param --topic {here}/camera/rate"), None)?;
        assert_eq!(peer.messages(1)?[0]["value"], 10);
        Ok(())
    })
}

#[test]
fn list_shows_what_the_master_knows() -> Result {
    run("list_shows_what_the_master_knows", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("x");
        let peer =
            env.rospy(&format!("publish --topic {topic} --latch"), Some(r#"{"data": "1"}"#))?;
        peer.messages(1)?;
        let mut list = env.wrapyfi(["list", "ros", "--json", "--wait", "3"])?;
        list.exits_with(0)?;
        let found = list.objects(1)?;
        let one = found.iter().find(|one| one["name"] == topic.as_str());
        let Some(one) = one else { panic!("{found:?}") };
        assert_eq!(
            (&one["role"], &one["type"], &one["node"]),
            (&json!("publisher"), &json!("std_msgs/String"), &json!("/rospy_peer"))
        );
        Ok(())
    })
}

/// Into ROS 2 and back: two bridges, so that nothing is decoded in between but by them.
#[test]
fn routes_join_ros_1_and_ros_2() -> Result {
    run("routes_join_ros_1_and_ros_2", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let [from, middle, back] = ["from", "middle", "back"].map(|name| env.topic(name));
        let kind = "sensor_msgs/msg/JointState";
        // One node does not hear itself: two do.
        let there = env.embedded().route(Route::new(&ros1(&from), &ros2(&middle), kind));
        let again = env.foreign().route(Route::new(&ros2(&middle), &ros1(&back), kind));
        let _there = env.bridge_named("there.yaml", &there)?;
        let _again = env.bridge_named("again.yaml", &again)?;
        let ros = "sensor_msgs/JointState";
        let listener =
            env.rospy(&format!("subscribe --topic {back} --type {ros} --node ear"), None)?;
        let value = r#"{"header": {"frame_id": "arm"}, "name": ["a"], "velocity": [{n}]}"#;
        let _talker = env.rospy(&format!("publish --topic {from} --type {ros}"), Some(value))?;
        let got = listener.messages(2)?;
        assert_eq!(got[1]["value"]["name"], json!(["a"]));
        let velocity = |at: usize| got[at]["value"]["velocity"][0].as_f64().unwrap_or(-1.0);
        assert!((velocity(1) - velocity(0) - 1.0).abs() < 1e-9, "{got:?}");
        Ok(())
    })
}

/// A publisher of rospy ends an older connection of the same name: each route has a name of its own.
#[test]
fn two_routes_from_one_topic_of_rospy_lose_nothing() -> Result {
    run("two_routes_from_one_topic_of_rospy_lose_nothing", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("numbers");
        let ends = [zeromq(&topic), ros2(&topic)];
        let routes = ends.iter().map(|to| Route::new(&ros1(&topic), to, "Text"));
        let bridge = env.bridge(&routes.fold(env.embedded(), wrapyfi_e2e::Config::route))?;
        let echoes = ends.iter().map(|end| echo(env, end, "Text", 50));
        let echoes = echoes.collect::<Result<Vec<Process>>>()?;
        let talker = env.rospy(&format!("publish --topic {topic}"), Some(r#"{"data": "{n}"}"#))?;
        for echo in &echoes {
            let heard = echo.objects(50).map_err(|error| error.context(bridge.tail()))?;
            let heard: Vec<u64> = heard
                .iter()
                .filter_map(|one| one["value"].as_str().and_then(|text| text.parse().ok()))
                .collect();
            let first = heard.first().copied().unwrap_or_default();
            assert_eq!(heard, (first..first + 50).collect::<Vec<_>>(), "{}", bridge.tail());
        }
        // The tools of ROS 1 show each by its name.
        let known = told(env, "rosnode", "info /rospy_peer")?;
        let node = known.lines().find_map(|line| line.trim().strip_suffix("/listener_2"));
        let node = node.map(|line| line.trim_start_matches("* to:").trim().to_owned());
        assert!(node.is_some_and(|node| known.contains(&format!("{node}\n"))), "{known}");
        drop(talker);
        Ok(())
    })
}

/// The real Wrapyfi on rospy publishes; `wrapyfi echo` must find the same hashes.
fn echo_hears(test: &str, peer: &str, message_type: &str, key: &str) -> Result {
    run(test, WITH_WRAPYFI, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("x");
        let mut echo = echo(env, &ros1(&topic), message_type, 3)?;
        let publisher =
            env.peer("wrapyfi_peer.py", &format!("publish --mware ros --topic {topic} {peer}"))?;
        let heard = echo.objects(3)?;
        publisher.sent_in_a_row(key, &texts(&heard, "sha256"))?;
        echo.exits_with(0)
    })
}

/// The other way: what one Wrapyfi sends must be what another receives through our node.
fn wrapyfi_hears(test: &str, peer: &str, message_type: &str) -> Result {
    run(test, WITH_WRAPYFI, |env| {
        let _roscore = env.roscore()?;
        let [from, middle, to] = ["from", "middle", "to"].map(|name| env.topic(name));
        let there = Route::new(&ros1(&from), &ros2(&middle), message_type);
        let again = Route::new(&ros2(&middle), &ros1(&to), message_type);
        let _there = env.bridge_named("there.yaml", &env.embedded().route(there))?;
        let _again = env.bridge_named("again.yaml", &env.foreign().route(again))?;
        let listener = env.peer(
            "wrapyfi_peer.py",
            &format!("listen --mware ros --topic {to} --count 3 {peer}"),
        )?;
        let publisher =
            env.peer("wrapyfi_peer.py", &format!("publish --mware ros --topic {from} {peer}"))?;
        publisher.sent_in_a_row("sha256", &texts(&listener.messages(3)?, "sha256"))
    })
}

macro_rules! pairs {
    ($function:ident: $($test:ident($($arg:literal),*);)*) => {
        $(#[test]
        fn $test() -> Result {
            $function(stringify!($test), $($arg),*)
        })*
    };
}

pairs! { echo_hears:
    echo_hears_objects_of_wrapyfi("--flavour rich", "NativeObject", "sha256");
    echo_hears_colour_images_of_wrapyfi("--type Image --flavour colour", "Image", "sha256");
    echo_hears_mono_images_of_wrapyfi("--type Image --flavour mono", "Image", "sha256");
    echo_hears_float_images_of_wrapyfi("--type Image --flavour float", "Image", "sha256");
    echo_hears_jpegs_of_wrapyfi("--type Image --flavour jpg", "CompressedImage", "file_sha256");
    echo_hears_sound_of_wrapyfi("--type AudioChunk --flavour stereo", "AudioChunk", "sha256");
}

pairs! { wrapyfi_hears:
    wrapyfi_hears_objects_through_us("--flavour rich", "NativeObject");
    wrapyfi_hears_images_through_us("--type Image --flavour colour", "Image");
    wrapyfi_hears_sound_through_us("--type AudioChunk --flavour stereo", "AudioChunk");
}

/// Wrapyfi's listeners take `bgr8` only; the nodes of a robot have whatever they have.
#[test]
fn wrapyfi_hears_images_of_ros_2_whose_red_comes_first() -> Result {
    run("wrapyfi_hears_images_of_ros_2_whose_red_comes_first", WITH_WRAPYFI, |env| {
        let _roscore = env.roscore()?;
        let (from, to) = (env.topic("from"), env.topic("to"));
        let route = Route::new(&ros2(&from), &ros1(&to), "Image");
        let bridge = env.bridge(&env.embedded().route(route))?;
        let listener = env.peer(
            "wrapyfi_peer.py",
            &format!("listen --mware ros --topic {to} --count 3 --type Image --flavour colour"),
        )?;
        let image = "sensor_msgs/msg/Image";
        let publisher = env.dds_publisher(&from, image, "--flavour colour --encoding rgb8")?;
        let heard = listener.messages(3).map_err(|e| e.context(bridge.tail()))?;
        publisher.sent_in_a_row("sha256", &texts(&heard, "sha256"))
    })
}

/// The real Wrapyfi serves on rospy; `wrapyfi call` must find the same hashes.
fn call_hears(test: &str, peer: &str, service_type: &str) -> Result {
    run(test, WITH_WRAPYFI, |env| {
        let _roscore = env.roscore()?;
        let service = env.topic("x");
        let server =
            env.peer("wrapyfi_peer.py", &format!("reply --mware ros --topic {service} {peer}"))?;
        let endpoint = ros1(&service);
        for number in 0..2_usize {
            let asked = format!("[{number}]");
            let args = ["call", &endpoint, "--type", service_type, "--args", &asked];
            let mut call = env.wrapyfi(args.into_iter().chain(["--timeout", "100", "--json"]))?;
            let got = call.objects(1)?.remove(0);
            call.exits_with(0)?;
            let sent = server.messages(number + 1)?.remove(number);
            assert_eq!(got["sha256"], sent["sha256"], "{got} of {sent}");
        }
        Ok(())
    })
}

pairs! { call_hears:
    call_hears_objects_of_wrapyfi("--flavour rich", "NativeObject");
    call_hears_images_of_wrapyfi("--type Image --flavour colour", "Image");
    call_hears_sound_of_wrapyfi("--type AudioChunk --flavour stereo", "AudioChunk");
}

#[test]
fn a_bridge_whose_node_is_killed_comes_back() -> Result {
    run("a_bridge_whose_node_is_killed_comes_back", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("x");
        let listener = env.rospy(&format!("subscribe --topic {topic}"), None)?;
        let config = env.embedded().endpoint("  ros: { node: killed }\n");
        let bridge =
            env.bridge(&config.route(Route::new(&zeromq(&topic), &ros1(&topic), "Text")))?;
        let _publisher =
            publish(env, &zeromq(&topic), "\"hello\"", &["--type", "Text", "--rate", "20"])?;
        listener.messages(1)?;
        for _ in 0..2 {
            let mut kill = env.ros_tool("rosnode", "kill /killed")?;
            kill.exits_with(0)?;
            let known = listener.stdout().lines().count();
            listener.wait_until("messages of the new node", |output| {
                (output.out.len() >= known + 40).then_some(())
            })?;
        }
        let said = bridge.stderr();
        let told = said.lines().filter(|line| line.contains("/rosnode at 127.0.0.1:"));
        assert!(
            told.filter(|line| line.contains("told this node to shut down")).count() >= 2,
            "{said}"
        );
        Ok(())
    })
}

/// A route's lists name nodes: others are refused, named in the log, and counted.
#[test]
fn nodes_of_a_list_are_heard_and_reached_and_no_others() -> Result {
    run("nodes_of_a_list_are_heard_and_reached_and_no_others", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let (near, far) = (env.topic("near"), env.topic("far"));
        let heard = Route::new(&ros1(&near), &zeromq(&near), "Text")
            .with("options", "{ from_peers: [/friend] }");
        let sent = Route::new(&zeromq(&far), &ros1(&far), "Text")
            .with("options", "{ to_peers: [/ear@127.0.0.1] }");
        let bridge = env.bridge(&env.embedded().route(heard).route(sent))?;
        let logs = |what: &'static str| {
            bridge.wait_until(what, move |output| {
                output.err.iter().any(|line| line.contains(what)).then_some(())
            })
        };
        let echo = echo(env, &zeromq(&near), "Text", 100_000)?;
        let talk = |node: &str| {
            let args = format!("publish --topic {near} --node {node} --rate 20");
            env.rospy(&args, Some(&json!({ "data": node }).to_string()))
        };
        let _stranger = talk("stranger")?;
        logs("/stranger at 127.0.0.1 is not among from_peers")?;
        let _friend = talk("friend")?;
        let texts = echo.objects(10).map_err(|error| error.context(bridge.tail()))?;
        assert!(texts.iter().all(|one| one["value"] == "friend"), "{texts:?}");

        let _talker = publish(env, &zeromq(&far), "\"x\"", &["--type", "Text", "--rate", "20"])?;
        let _spy = env.rospy(&format!("subscribe --topic {far} --node spy"), None)?;
        logs("/spy at 127.0.0.1 is not among to_peers")?;
        let ear = env.rospy(&format!("subscribe --topic {far} --node ear"), None)?;
        ear.messages(3).map_err(|error| error.context(bridge.tail()))?;
        bridge.wait_until("the refusals to be counted", |output| {
            let last = output.objects().next_back()?;
            let mut routes = last["routes"].as_array()?.iter();
            let counts = |it: &Value| it["counters"]["drops"]["refused_peer"].as_u64() >= Some(1);
            routes.all(counts).then_some(())
        })
    })
}

/// A list that is shortened while the bridge runs leaves no program connected that is not in it any more.
#[test]
fn a_subscriber_that_a_changed_list_leaves_out_is_cut_off() -> Result {
    run("a_subscriber_that_a_changed_list_leaves_out_is_cut_off", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("x");
        let config = |peers: &str| {
            let route = Route::new(&zeromq(&topic), &ros1(&topic), "Text")
                .with("options", &format!("{{ to_peers: [{peers}] }}"));
            env.embedded().route(route)
        };
        let bridge = env.bridge_named("peers.yaml", &config("/ear, /spy"))?;
        let _talker = publish(env, &zeromq(&topic), "\"x\"", &["--type", "Text", "--rate", "20"])?;
        let listen =
            |node: &str| env.rospy(&format!("subscribe --topic {topic} --node {node}"), None);
        let (spy, ear) = (listen("spy")?, listen("ear")?);
        let heard = |node: &Process| {
            node.wait_until("what it heard", |output| Some(output.events("message").len()))
        };
        spy.messages(3)?;
        ear.messages(3)?;
        env.write("peers.yaml", config("/ear").yaml())?;
        bridge.hang_up()?;
        bridge.wait_until("the refusal", |output| {
            let what = "/spy at 127.0.0.1 is not among to_peers";
            output.err.iter().any(|line| line.contains(what)).then_some(())
        })?;
        let before = heard(&spy)?;
        ear.messages(heard(&ear)? + 20).map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(heard(&spy)?, before, "{}", bridge.tail());
        Ok(())
    })
}
