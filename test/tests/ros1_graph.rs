//! Clock, log and parameters of nodes of ROS 1 and ROS 2 across routes; against rosmaster, rospy,
//! CycloneDDS and a node with parameters of another make.

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Output, Process, Result, Route, ros1, ros2, run};

const NEEDS: &[Need] = &[Need::Program, Need::Ros1, Need::Python];
const CLOCK: &str = "rosgraph_msgs/msg/Clock";
const LOG: &str = "rcl_interfaces/msg/Log";

/// Waits until the ROS 2 graph has an endpoint on a topic.
fn endpoint(graph: &Process, role: &str, topic: &str) -> Result<Value> {
    let topic = format!("rt{topic}");
    graph.wait_until(&format!("a {role} of {topic}"), |output| {
        let mut all = output.events("endpoint").into_iter();
        all.find(|e| e["topic"] == *topic && e["role"] == role)
    })
}

#[test]
fn a_clock_goes_both_ways() -> Result {
    run("a_clock_goes_both_ways", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let back = env.topic("clock");
        let graph = env.graph()?;
        let config = env
            .embedded()
            .route(Route::new("ros:/clock", "ros2:/clock", CLOCK))
            .route(Route::new(&ros2(&back), &ros1(&back), CLOCK));
        let bridge = env.bridge(&config)?;
        assert_eq!(endpoint(&graph, "writer", "/clock")?["reliable"], false);
        let hears = env.dds_subscriber("/clock", CLOCK, "--best-effort --depth 1")?;
        let value = r#"{"clock": {"secs": 1700000000, "nsecs": {n}}}"#;
        let _clock = env.rospy("publish --topic /clock --type rosgraph_msgs/Clock", Some(value))?;
        let heard = hears.messages(2).map_err(|e| e.context(bridge.tail()))?;
        assert_eq!(heard[1]["fields"]["clock"]["sec"], 1_700_000_000);
        let nanoseconds =
            |at: usize| heard[at]["fields"]["clock"]["nanosec"].as_u64().unwrap_or_default();
        assert!(nanoseconds(1) > nanoseconds(0), "{heard:?}");

        let args = format!("subscribe --topic {back} --type rosgraph_msgs/Clock --node ear");
        let ear = env.rospy(&args, None)?;
        let fields = r#"{"clock":{"sec":7,"nanosec":8}}"#;
        let _clock = env.dds_publisher(&back, CLOCK, &format!("--fields {fields}"))?;
        let heard = ear.messages(1).map_err(|e| e.context(bridge.tail()))?;
        assert_eq!(heard[0]["value"], json!({"clock": {"secs": 7, "nsecs": 8}}));
        Ok(())
    })
}

/// The texts of a log that a peer heard, with the names that they came under.
fn lines(output: &Output) -> Vec<(String, String)> {
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let line = |event: Value| {
        let fields = if event["fields"].is_null() { &event["value"] } else { &event["fields"] };
        (text(&fields["name"]), text(&fields["msg"]))
    };
    output.events("message").into_iter().map(line).collect()
}

#[test]
fn logs_go_both_ways_at_once_without_an_echo() -> Result {
    run("logs_go_both_ways_at_once_without_an_echo", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let config = env
            .embedded()
            .route(Route::new("ros:/rosout", "ros2:/rosout", LOG))
            .route(Route::new("ros2:/rosout", "ros:/rosout", LOG));
        let graph = env.graph()?;
        let bridge = env.bridge(&config)?;
        endpoint(&graph, "reader", "/rosout")?;
        let there = env.dds_subscriber("/rosout", LOG, "--transient-local --depth 1000")?;
        there.event("matched")?;
        let args = "subscribe --topic /rosout --type rosgraph_msgs/Log --node ear";
        let here = env.rospy(args, None)?;
        here.event("matched")?;
        let heard = |who: &Process, name: &str, text: &str| {
            who.wait_until(&format!("{text:?} of {name}"), |output| {
                lines(output).contains(&(name.to_owned(), text.to_owned())).then_some(())
            })
            .map_err(|e| e.context(bridge.tail()))
        };
        let logs = |number: u32| -> Result<[Process; 2]> {
            let text = format!("from 1, {number}");
            let rospy = env.rospy(&format!("log --node one_{number}"), Some(&text))?;
            heard(&there, &format!("/one_{number}"), &text)?;
            let fields = json!({
                "stamp": {"sec": 5, "nanosec": 6}, "level": 40, "name": format!("two_{number}"),
                "msg": format!("from_2,{number}"), "file": "f.py", "function": "main", "line": 7
            });
            let args = format!("--transient-local --count 1 --fields {fields}");
            let node = env.dds_publisher("/rosout", LOG, &args)?;
            heard(&here, &format!("two_{number}"), &format!("from_2,{number}"))?;
            Ok([rospy, node])
        };
        let _first = logs(1)?;
        let _second = logs(2)?;
        let line = here.wait_until("the line", |output| {
            output.events("message").into_iter().find(|e| e["value"]["name"] == "two_1")
        })?;
        let got = &line["value"];
        assert_eq!(
            (&got["level"], &got["line"], &got["file"]),
            (&json!(8), &json!(7), &json!("f.py"))
        );
        assert_eq!(got["header"]["stamp"], json!({"secs": 5, "nsecs": 6}));
        let line = there.wait_until("the line", |output| {
            output.events("message").into_iter().find(|e| e["fields"]["name"] == "/one_1")
        })?;
        assert_eq!(line["fields"]["level"], 30, "{line}");
        for who in [&there, &here] {
            for number in [1, 2] {
                heard(who, &format!("/one_{number}"), &format!("from 1, {number}"))?;
                heard(who, &format!("two_{number}"), &format!("from_2,{number}"))?;
            }
        }
        // Each once, after two rounds; and nothing of the bridge's own in ROS 1.
        for who in [&there, &here] {
            let all = who.wait_until("all lines", |output| Some(lines(output)))?;
            for text in ["from 1, 1", "from 1, 2", "from_2,1", "from_2,2"] {
                let times = all.iter().filter(|(_, one)| one == text).count();
                assert_eq!(times, 1, "{text}: {all:?}");
            }
        }
        let all = here.wait_until("all lines", |output| Some(lines(output)))?;
        assert!(all.iter().all(|(name, _)| !name.contains("wrapyfi")), "{all:?}");
        Ok(())
    })
}

/// Waits until the namespace in ROS 1 is so.
fn master_has(params: &Process, bridge: &Process, wanted: &Value) -> Result {
    params
        .wait_until(&format!("{wanted}"), |output| {
            (output.events("message").pop()?["value"] == *wanted).then_some(())
        })
        .map_err(|e| e.context(bridge.tail()))
}

#[test]
fn parameters_of_both_sides_follow_each_other() -> Result {
    run("parameters_of_both_sides_follow_each_other", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let (node, space) = (env.topic("node"), env.topic("space"));
        let (there, here) = (format!("ros2:{node}"), ros1(&space));
        let first =
            json!({"rate": 10, "gain": 1.5, "lens.label": "left", "ids": [1, 2], "serial": "A1"});
        let mut peer = env.peer("param_node.py", &format!("--node {node} {first}"))?;
        peer.event("ready")?;
        let mut params = env.rospy(&format!("params --topic {space}"), None)?;
        let config = env
            .embedded()
            .route(Route::new(&here, &there, "Properties"))
            .route(Route::new(&there, &here, "Properties"));
        let bridge = env.bridge(&config)?;
        let mut now = json!(
            {"rate": 10, "gain": 1.5, "lens": {"label": "left"}, "ids": [1, 2], "serial": "A1"});
        master_has(&params, &bridge, &now)?;
        // The topic of events keeps nothing for later ones.
        peer.wait_until("the reader of its events", |output| {
            (output.events("heard").pop()?["readers"] == 1).then_some(())
        })?;
        let set = |peer: &Process, name: &str, times: usize| {
            peer.wait_until(&format!("{name} to be set {times} times"), |output| {
                let all = output.events("set").into_iter();
                let values: Vec<Value> =
                    all.filter(|e| e["name"] == name).map(|e| e["value"].clone()).collect();
                (values.len() >= times).then_some(values)
            })
            .map_err(|e| e.context(bridge.tail()))
        };
        // ROS 1 changes: nested, an array, one value forth and back.
        params.tell(r#"{"gain": 2.5, "lens/label": "right", "ids": [3]}"#)?;
        assert_eq!(set(&peer, "gain", 1)?, [json!(2.5)]);
        assert_eq!(set(&peer, "lens.label", 1)?, [json!("right")]);
        assert_eq!(set(&peer, "ids", 1)?, [json!([3])]);
        // ROS 2 changes.
        peer.tell(r#"{"gain": 3.5, "rate": 20}"#)?;
        now["gain"] = json!(3.5);
        now["rate"] = json!(20);
        now["lens"]["label"] = json!("right");
        now["ids"] = json!([3]);
        master_has(&params, &bridge, &now)?;
        params.tell(r#"{"gain": 2.5}"#)?;
        assert_eq!(set(&peer, "gain", 2)?, [json!(2.5), json!(2.5)]);
        // A parameter that ROS 2 has no type for is reported, one that the node refuses too, and
        // the rest goes on.
        params.tell(r#"{"rows": [[1], [2]], "rate": 61}"#)?;
        bridge.wait_until("what is wrong with the two", |output| {
            let says = |words: &str| output.err.iter().any(|line| line.contains(words));
            (says("\"rows\"") && says("Parameter rate out of range")).then_some(())
        })?;
        bridge.wait_until("both to be counted", |output| {
            let report = output.objects().rev().find(|object| object["routes"].is_array())?;
            let drops = report["routes"][0]["counters"]["drops"].clone();
            (drops["mismatch"] == 1 && drops["refused"] == 1).then_some(())
        })?;
        params.tell(r#"{"rate": 30, "gain": 4.5}"#)?;
        assert_eq!(set(&peer, "rate", 1)?, [json!(30)]);
        assert_eq!(set(&peer, "gain", 3)?[2], 4.5);
        // No echo: each change was set once, and what began in ROS 2 never.
        let all = peer.wait_until("all that was set", |output| Some(output.events("set")))?;
        assert_eq!(all.len(), 6, "{all:?}");
        Ok(())
    })
}
