//! Bad input while a bridge runs: what is malformed is dropped and counted, everything else goes on.

use serde_json::Value;
use wrapyfi_e2e::{Need, Process, Result, Route, TestEnv, run, texts};

const NEEDS: &[Need] = &[Need::Program, Need::Python];

/// Cases that no reader may take for a message: each must be counted as dropped.
const OBJECTS: &[&str] = &[
    "native_truncated",
    "native_empty",
    "native_not_utf8",
    "native_trailing",
    "native_deep",
    "native_deep_tags",
    "native_huge_exponent",
    "native_lying_npy",
    "native_overflow_npy",
    "native_negative_npy",
    "native_npy_no_newline",
    "native_bad_base64",
    "native_no_body",
    "native_three_frames",
    "other_topic_by_prefix",
];
const IMAGES: &[&str] = &[
    "image_short",
    "image_one_dimension",
    "image_four_dimensions",
    "image_seven_channels",
    "image_text_array",
    "image_not_json",
    "image_empty_body",
    "image_header_only",
    "image_truncated",
    "image_three_garbage",
    "image_pickle",
    "native_lying_npy",
    "other_topic_by_prefix",
];
const SOUNDS: &[&str] = &[
    "audio_lying_size",
    "audio_negative",
    "audio_not_a_tuple",
    "audio_huge_rate",
    "native_truncated",
    "native_no_body",
    "other_topic_by_prefix",
];
const JPEGS: &[&str] = &["jpeg_empty", "image_header_only", "other_topic_by_prefix"];

/// Cases that a lenient reader may let pass: only survival is asked for.
const DOUBTFUL: &str = "image_body_only,jpeg_garbage,image_three_garbage,native_three_frames";

/// The newest status report that satisfies `enough`.
fn status(bridge: &Process, what: &str, enough: impl Fn(&Value) -> bool) -> Result<Value> {
    bridge.wait_until(what, |output| {
        output.objects().rev().find(|o| o["routes"].is_array()).filter(&enough)
    })
}

fn dropped(report: &Value, route: usize) -> u64 {
    let drops = report["routes"][route]["counters"]["drops"].as_object();
    drops.into_iter().flat_map(|d| d.values()).filter_map(Value::as_u64).sum()
}

/// Sends cases on a topic and waits until they are out.
fn send(env: &TestEnv, topic: &str, cases: &str) -> Result<Process> {
    let port = env.sub_port();
    let peer =
        env.peer("zmq_peer.py", &format!("--topic {topic} --sub-port {port} --cases {cases}"))?;
    peer.event("done")?;
    Ok(peer)
}

/// One route gets every bad message of its type; a second route carries good ones all the time.
fn survives(test: &str, message_type: &str, ros_type: &str, cases: &[&str], good: &str) -> Result {
    run(test, NEEDS, |env| {
        let (bad_from, bad_to) = (env.topic("bad"), env.topic("bad_out"));
        let (good_from, good_to) = (env.topic("good"), env.topic("good_out"));
        let config = env
            .embedded()
            .route(Route::new(
                &format!("zeromq:{bad_from}"),
                &format!("ros2:{bad_to}"),
                message_type,
            ))
            .route(Route::new(
                &format!("zeromq:{good_from}"),
                &format!("ros2:{good_to}"),
                "std_msgs/msg/String",
            ));
        let mut bridge = env.bridge(&config)?;
        let hit = env.dds_subscriber(&bad_to, ros_type, "")?;
        let mut node = env.ros_node("reader")?;
        let heard = node.subscribe::<String>(&good_to, "std_msgs/msg/String")?;
        let _good_publisher = env.wrapyfi_publisher(&good_from, "--no-broker")?;
        heard.next()?;

        let _bad_publisher = send(env, &bad_from, &cases.join(","))?;
        let expected = cases.len() as u64;
        let report = status(&bridge, &format!("{expected} drops on the first route"), |r| {
            dropped(r, 0) >= expected
        })?;
        assert_eq!(dropped(&report, 0), expected, "{report}");
        assert_eq!(report["routes"][0]["counters"]["sent"], 0, "{report}");
        assert_eq!(dropped(&report, 1), 0, "the good route lost nothing: {report}");

        // Both routes still work: the one that was hit, too.
        for _ in 0..3 {
            heard.next()?;
        }
        let publisher = env.wrapyfi_publisher(&bad_from, &format!("{good} --no-broker"))?;
        let key = if good.contains("jpg") { "file_sha256" } else { "sha256" };
        publisher.sent_in_a_row(key, &texts(&hit.messages(2)?, "sha256"))?;

        let _doubtful = send(env, &bad_from, DOUBTFUL)?;
        for _ in 0..3 {
            heard.next()?;
        }
        bridge.terminate()?;
        bridge.exits_with(0)?;
        let last = status(&bridge, "the last report", |_| true)?;
        assert!(dropped(&last, 0) >= expected, "the last report has the totals: {last}");
        assert!(!bridge.stderr().contains("panicked"), "{}", bridge.stderr());
        Ok(())
    })
}

#[test]
fn hostile_objects_are_dropped_and_counted() -> Result {
    let test = "hostile_objects_are_dropped_and_counted";
    survives(test, "std_msgs/msg/String", "std_msgs/msg/String", OBJECTS, "--flavour rich")
}

#[test]
fn hostile_objects_for_our_own_type_are_dropped_and_counted() -> Result {
    let test = "hostile_objects_for_our_own_type_are_dropped_and_counted";
    survives(test, "NativeObject", "wrapyfi_msgs/msg/NativeObject", OBJECTS, "--flavour rich")
}

#[test]
fn hostile_images_are_dropped_and_counted() -> Result {
    let test = "hostile_images_are_dropped_and_counted";
    survives(test, "Image", "sensor_msgs/msg/Image", IMAGES, "--type Image --flavour colour")
}

#[test]
fn hostile_jpegs_are_dropped_and_counted() -> Result {
    let test = "hostile_jpegs_are_dropped_and_counted";
    survives(
        test,
        "CompressedImage",
        "sensor_msgs/msg/CompressedImage",
        JPEGS,
        "--type Image --flavour jpg",
    )
}

#[test]
fn hostile_sounds_are_dropped_and_counted() -> Result {
    let test = "hostile_sounds_are_dropped_and_counted";
    survives(
        test,
        "AudioChunk",
        "wrapyfi_msgs/msg/AudioChunk",
        SOUNDS,
        "--type AudioChunk --flavour mono",
    )
}

#[test]
fn malformed_and_foreign_topics_are_told_apart() -> Result {
    run("malformed_and_foreign_topics_are_told_apart", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let route =
            Route::new(&format!("zeromq:{from}"), &format!("ros2:{to}"), "std_msgs/msg/String");
        let bridge = env.bridge(&env.embedded().route(route))?;
        let _subscriber = env.dds_subscriber(&to, "std_msgs/msg/String", "")?;
        // Without a consumer nothing would be decoded, and so nothing found malformed.
        status(&bridge, "an active route", |r| r["routes"][0]["state"] == "active")?;
        let _sender = send(env, &from, "native_truncated,native_empty,other_topic_by_prefix")?;
        let report = status(&bridge, "three drops", |r| dropped(r, 0) >= 3)?;
        assert_eq!(
            report["routes"][0]["counters"]["drops"],
            serde_json::json!({"malformed": 2, "wrong_topic": 1}),
            "{report}"
        );
        Ok(())
    })
}

#[test]
fn nesting_beyond_the_limit_has_a_count_of_its_own() -> Result {
    run("nesting_beyond_the_limit_has_a_count_of_its_own", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let route = Route::new(&format!("zeromq:{from}"), &format!("ros2:{to}"), "NativeObject");
        let bridge = env.bridge(&env.embedded().route(route))?;
        let _subscriber = env.dds_subscriber(&to, "wrapyfi_msgs/msg/NativeObject", "")?;
        status(&bridge, "an active route", |r| r["routes"][0]["state"] == "active")?;
        let _sender = send(env, &from, "native_deep,native_truncated,native_deep_tags")?;
        let report = status(&bridge, "three drops", |r| dropped(r, 0) >= 3)?;
        let counted = serde_json::json!({"malformed": 1, "nesting": 2});
        assert_eq!(report["routes"][0]["counters"]["drops"], counted, "{report}");
        Ok(())
    })
}

#[test]
fn objects_from_ros_that_are_none_are_dropped() -> Result {
    run("objects_from_ros_that_are_none_are_dropped", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let route =
            Route::new(&format!("ros2:{from}"), &format!("zeromq:{to}"), "std_msgs/msg/String");
        let bridge = env.bridge(&env.embedded().route(route))?;
        let listener = env.wrapyfi_listener(&to, "--count 2")?;
        let mut node = env.ros_node("writer")?;
        let _spoken = node.publish(&from, "std_msgs/msg/String", |seq| {
            if seq % 2 == 0 {
                format!("{{\"seq\": {seq}}}")
            } else {
                format!("{{\"seq\": {seq}, \"__wrapyfi__\": [")
            }
        })?;
        for message in listener.messages(2)? {
            assert_eq!(message["seq"].as_u64().map(|s| s % 2), Some(0), "{message}");
        }
        status(&bridge, "a malformed message", |r| {
            r["routes"][0]["counters"]["drops"]["malformed"].as_u64() >= Some(1)
        })?;
        Ok(())
    })
}
