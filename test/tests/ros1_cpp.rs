//! The `wrapyfi` program with roscpp at the other end: a node in C++ that shares no code with rospy.

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Process, Result, Route, TestEnv, ros1, ros2, run, sha256};

const NEEDS: &[Need] = &[Need::Program, Need::Ros1, Need::Roscpp];
const IMAGE: &str = "sensor_msgs/Image";
const SET: (&str, &str) =
    ("std_srvs/srv/SetBool.srv", "bool data\n---\nbool success\nstring message\n");

fn echo(env: &TestEnv, topic: &str, message_type: &str, count: usize) -> Result<Process> {
    let (endpoint, count) = (ros1(topic), count.to_string());
    let args = ["echo", &endpoint, "--type", message_type, "--count", &count];
    env.wrapyfi(args.into_iter().chain(["--timeout", "100", "--json"]))
}

/// Bytes of the peer's image `index`, as its source makes them.
fn pixels(index: u64, count: u64) -> Vec<u8> {
    let byte = |at: u64| (at * 31 + at / 251 + index) % 256;
    (0..count).filter_map(|at| u8::try_from(byte(at)).ok()).collect()
}

/// A bridge there and one back, through ROS 2: a node does not hear itself.
fn there_and_back(env: &TestEnv, from: &str, to: &str, kind: &str) -> Result<[Process; 2]> {
    let middle = env.topic("middle");
    let there = Route::new(&ros1(from), &ros2(&middle), kind);
    let back = Route::new(&ros2(&middle), &ros1(to), kind);
    Ok([
        env.bridge_named("there.yaml", &env.embedded().route(there))?,
        env.bridge_named("back.yaml", &env.foreign().route(back))?,
    ])
}

#[test]
fn texts_of_roscpp_go_both_ways() -> Result {
    run("texts_of_roscpp_go_both_ways", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let (there, here) = (env.topic("there"), env.topic("here"));
        let _peer = env.roscpp(&format!("publish --topic {there}"), Some("number {n} \u{e4}"))?;
        let mut echo = echo(env, &there, "Text", 5)?;
        let heard = echo.objects(5)?;
        echo.exits_with(0)?;
        let first: Option<u64> = heard[0]["value"]
            .as_str()
            .and_then(|text| text.strip_prefix("number ")?.strip_suffix(" \u{e4}")?.parse().ok());
        for (n, one) in (first.unwrap_or(u64::MAX)..).zip(&heard) {
            assert_eq!(one["value"], json!(format!("number {n} \u{e4}")));
        }

        let ear = env.roscpp(&format!("subscribe --topic {here} --node ear"), None)?;
        let endpoint = ros1(&here);
        let args = ["pub", &endpoint, "--type", "Text", "--value", "\"to C++\""];
        let mut publisher = env.wrapyfi(args.into_iter().chain(["--rate", "20"]))?;
        assert_eq!(ear.messages(2)?[1]["value"], "to C++");
        publisher.terminate()?;
        publisher.exits_with(0)
    })
}

#[test]
fn what_roscpp_latches_and_what_we_latch_is_kept() -> Result {
    run("what_roscpp_latches_and_what_we_latch_is_kept", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let (there, here) = (env.topic("there"), env.topic("here"));
        let talker = env.roscpp(
            &format!("publish --topic {there} --latch --count 3 --rate 1000"),
            Some("kept {n}"),
        )?;
        talker.event("done")?;
        for _ in 0..2 {
            let mut late = echo(env, &there, "Text", 1)?;
            assert_eq!(late.objects(1)?[0]["value"], "kept 2");
            late.exits_with(0)?;
        }

        let endpoint = ros1(&here);
        let args = ["pub", &endpoint, "--type", "Text", "--value", "\"ours\"", "--qos", "latched"];
        let _publisher = env.wrapyfi(args.into_iter().chain(["--rate", "0.01"]))?;
        for node in ["first", "second"] {
            let args = format!("subscribe --topic {here} --count 1 --node {node}");
            let late = env.roscpp(&args, None)?;
            assert_eq!(late.messages(1)?[0]["value"], "ours");
        }
        Ok(())
    })
}

#[test]
fn services_of_roscpp_go_both_ways() -> Result {
    run("services_of_roscpp_go_both_ways", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let folder = env.definitions(&[SET])?;
        let (there, here) = (env.topic("there"), env.topic("here"));
        let server = env.roscpp(&format!("serve --topic {there}"), None)?;
        server.event("ready")?;
        let kind = ["--type", "std_srvs/srv/SetBool", "--definitions", &folder, "--json"];
        for (asked, answer) in [
            ("[true]", json!({"success": true, "message": "so be it"})),
            ("[false]", json!({"success": false, "message": "no"})),
        ] {
            let endpoint = ros1(&there);
            let args = ["call", &endpoint, "--args", asked, "--timeout", "60"];
            let mut call = env.wrapyfi(args.into_iter().chain(kind))?;
            call.exits_with(0)?;
            assert_eq!(call.objects(1)?[0]["value"], answer);
        }

        let endpoint = ros1(&here);
        let value = r#"{"success": true, "message": "done"}"#;
        let args = ["serve", &endpoint, "--value", value];
        let server = env.wrapyfi(args.into_iter().chain(kind))?;
        // A connection for each call, and one for all of them.
        for (node, more) in [("each", ""), ("all", "--persistent")] {
            let args = format!("call --topic {here} --count 5 --node {node} {more}");
            let client = env.roscpp(&args, None)?;
            client.event("done").map_err(|error| error.context(server.tail()))?;
            let replies = client.wait_until("five replies", |output| {
                let found = output.events("reply");
                (found.len() == 5).then_some(found)
            })?;
            for reply in replies {
                assert_eq!(reply["worked"], true, "{reply}");
                assert_eq!((&reply["success"], &reply["message"]), (&json!(true), &json!("done")));
            }
        }
        let asked: Vec<Value> = server.objects(10)?;
        assert_eq!(asked.len(), 10);
        Ok(())
    })
}

#[test]
fn roscpp_is_told_of_a_mismatch_and_others_are_served() -> Result {
    run("roscpp_is_told_of_a_mismatch_and_others_are_served", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let (there, here) = (env.topic("there"), env.topic("here"));
        // It publishes another type: its refusal is the reason that we show.
        let talker = env.roscpp(&format!("publish --topic {there} --node talker"), None)?;
        let wrong = echo(env, &there, "Image", 1)?;
        let mut right = echo(env, &there, "Text", 2)?;
        wrong.wait_until("the reason", |output| {
            let tells = |line: &String| {
                line.contains("it refuses:")
                    && line
                        .contains("wanted is sensor_msgs/Image [060021388200f6f0f447d0fcd9c64743]")
            };
            output.err.iter().any(tells).then_some(())
        })?;
        right.exits_with(0)?;
        drop(talker);

        // It subscribes to another type: it is refused by name, which roscpp logs nowhere, and the next
        // one is served.
        let endpoint = ros1(&here);
        let args = ["pub", &endpoint, "--type", "Text", "--value", "\"still\"", "--rate", "50"];
        let publisher = env.wrapyfi(args)?;
        let args = format!("subscribe --topic {here} --type {IMAGE} --node stranger");
        let stranger = env.roscpp(&args, None)?;
        let told = |line: &String| {
            line.contains("/stranger wants topic")
                && line.contains("sensor_msgs/Image [060021388200f6f0f447d0fcd9c64743]")
                && line.contains("std_msgs/String [992ce8a1687cec8c8bd883ec73ca41d1]")
        };
        publisher.wait_until("the warning", |output| output.err.iter().any(told).then_some(()))?;
        let friend = env.roscpp(&format!("subscribe --topic {here} --node friend"), None)?;
        assert_eq!(friend.messages(3)?[2]["value"], "still");
        assert!(stranger.wait_until("no message", |o| Some(o.events("message")))?.is_empty());
        Ok(())
    })
}

#[test]
fn images_of_roscpp_keep_every_byte() -> Result {
    run("images_of_roscpp_keep_every_byte", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("x");
        let args = format!("publish --topic {topic} --type {IMAGE} --width 64 --height 48");
        let _peer = env.roscpp(&args, None)?;
        let mut echo = echo(env, &topic, "Image", 2)?;
        let heard = echo.objects(2)?;
        echo.exits_with(0)?;
        let prints: Vec<String> =
            (0..256).map(|index| sha256(&pixels(index, 64 * 48 * 3))).collect();
        let number = |one: &Value| prints.iter().position(|print| one["sha256"] == print.as_str());
        let first = number(&heard[0]);
        assert!(first.is_some(), "{heard:?}");
        assert_eq!(number(&heard[1]), first.map(|first| (first + 1) % 256));
        Ok(())
    })
}

/// 6 MB, more than a socket's buffer: into ROS 2 and back.
#[test]
fn large_images_of_roscpp_cross_ros_2_and_come_back() -> Result {
    run("large_images_of_roscpp_cross_ros_2_and_come_back", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let (from, to) = (env.topic("from"), env.topic("to"));
        let _bridges = there_and_back(env, &from, &to, "sensor_msgs/msg/Image")?;
        let ear = env
            .roscpp(&format!("subscribe --topic {to} --type {IMAGE} --node ear --count 3"), None)?;
        let size = "--width 1920 --height 1080 --rate 5";
        let talker = env.roscpp(&format!("publish --topic {from} --type {IMAGE} {size}"), None)?;
        let heard = ear.messages(3)?;
        for one in &heard {
            assert_eq!(one["size"], 1920 * 1080 * 3);
            let sent = talker.wait_until("what was sent", |output| {
                output.events("message").into_iter().find(|sent| sent["nsec"] == one["nsec"])
            })?;
            for key in ["fnv", "width", "height", "encoding", "frame_id"] {
                assert_eq!(one[key], sent[key], "{key}");
            }
        }
        let numbers: Vec<_> = heard.iter().filter_map(|one| one["nsec"].as_u64()).collect();
        assert!(numbers.is_sorted() && numbers[0] < numbers[2], "{numbers:?}");
        Ok(())
    })
}
