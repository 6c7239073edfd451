//! Coordinate frames and times on their way: with ROS 2 nodes, the real Wrapyfi, and simulated time.

use serde_json::json;
use wrapyfi_e2e::{Need, Result, RosImage, Route, TestEnv, ros2, run, zeromq};

const NEEDS: &[Need] = &[Need::Program, Need::Python];

/// First message on a topic of ZeroMQ, as `wrapyfi echo` shows it.
fn first(env: &TestEnv, topic: &str, message_type: &str) -> Result<serde_json::Value> {
    let endpoint = zeromq(topic);
    let args = ["echo", &endpoint, "--type", message_type, "--json", "--count", "1"];
    Ok(env.wrapyfi(args)?.objects(1)?.remove(0))
}

#[test]
fn frames_reach_zeromq_beside_what_wrapyfi_reads() -> Result {
    run("frames_reach_zeromq_beside_what_wrapyfi_reads", NEEDS, |env| {
        let (from, there, kept) = (env.topic("from"), env.topic("there"), env.topic("kept"));
        let image = |to: &str| Route::new(&ros2(&from), &zeromq(to), "Image");
        let config = env
            .embedded()
            .route(image(&there))
            .route(image(&kept).with("encoding", "rgb8").with("frame_id", "left_eye"));
        let _bridge = env.bridge(&config)?;
        let listener = env.wrapyfi_listener(&there, "--type Image --flavour colour --count 1")?;
        let mut node = env.ros_node("camera")?;
        let frame = RosImage::plain(64, 48, "rgb8", [255, 0, 0]);
        let _spoken = node.publish(&from, "sensor_msgs/msg/Image", move |_| frame.clone())?;
        // Blue, green, red, as OpenCV has it.
        let heard = listener.messages(1)?;
        assert_eq!(heard[0]["channel_means"], json!([0.0, 0.0, 255.0]), "{heard:?}");
        let seen = first(env, &there, "Image")?;
        assert_eq!((&seen["frame_id"], &seen["encoding"]), (&json!("camera"), &json!("bgr8")));
        let seen = first(env, &kept, "Image")?;
        assert_eq!((&seen["frame_id"], &seen["encoding"]), (&json!("left_eye"), &json!("rgb8")));
        Ok(())
    })
}

#[test]
fn objects_with_a_header_are_read_by_wrapyfi() -> Result {
    run("objects_with_a_header_are_read_by_wrapyfi", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let route = Route::new(&ros2(&from), &zeromq(&to), "NativeObject");
        let config = env.embedded().route(route.with("frame_id", "map").with("stamp", "arrival"));
        let _bridge = env.bridge(&config)?;
        let listener = env.wrapyfi_listener(&to, "--flavour rich --count 2")?;
        let sender = "--flavour rich --frame-id odom";
        let _publisher = env.dds_publisher(&from, "wrapyfi_msgs/msg/NativeObject", sender)?;
        for message in listener.messages(2)? {
            assert!(message["sha256"].is_string() && message["seq"].is_u64(), "{message}");
        }
        Ok(())
    })
}

/// No other program publishes or hears the clock.
#[test]
fn simulated_time_that_a_bridge_brings_itself_is_its_own() -> Result {
    run("simulated_time_that_a_bridge_brings_itself_is_its_own", NEEDS, |env| {
        let (from, to, clock) = (env.topic("from"), env.topic("to"), env.topic("clock"));
        let routes = vec![
            Route::new(&zeromq(&from), &ros2(&to), "Image"),
            Route::new(&zeromq(&clock), &ros2("/clock"), "rosgraph_msgs/msg/Clock"),
        ];
        let _bridge = env.node_with(routes, &["-p", "use_sim_time:=true"])?;
        let time = r#"{"clock": {"sec": 77, "nanosec": 500000000}}"#;
        let publish = ["--type", "NativeObject", "--value", time, "--rate", "10"];
        let _clock = env.wrapyfi([&["pub", &zeromq(&clock)], &publish[..]].concat())?;
        let simulated = env.dds_subscriber(&to, "sensor_msgs/msg/Image", "")?;
        let args = "--type Image --flavour colour --no-broker";
        let _publisher = env.wrapyfi_publisher(&from, args)?;
        simulated.wait_until("an image in simulated time", |output| {
            let mut messages = output.events("message").into_iter();
            messages.find(|message| message["stamp"].as_f64() == Some(77.5))
        })?;
        Ok(())
    })
}

#[test]
fn simulated_time_is_that_of_images_from_outside() -> Result {
    run("simulated_time_is_that_of_images_from_outside", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let wall = env.topic("wall");
        let image = |to: &str| Route::new(&zeromq(&from), &ros2(to), "Image");
        let routes =
            vec![image(&to).with("frame_id", "left"), image(&wall).with("stamp", "source")];
        let _bridge = env.node_with(routes, &["-p", "use_sim_time:=true"])?;
        let clock = r#"--fields {"clock":{"sec":77,"nanosec":500000000}}"#;
        let _clock = env.dds_publisher("/clock", "rosgraph_msgs/msg/Clock", clock)?;
        let simulated = env.dds_subscriber(&to, "sensor_msgs/msg/Image", "")?;
        let as_sent = env.dds_subscriber(&wall, "sensor_msgs/msg/Image", "--count 1")?;
        let args = "--type Image --flavour colour --no-broker";
        let _publisher = env.wrapyfi_publisher(&from, args)?;
        let seen = simulated.wait_until("an image in simulated time", |output| {
            let mut messages = output.events("message").into_iter();
            messages.find(|message| message["stamp"].as_f64() == Some(77.5))
        })?;
        assert_eq!(seen["fields"]["header"]["frame_id"], "left", "{seen}");
        let seen = as_sent.messages(1)?.remove(0);
        assert!(seen["stamp"].as_f64() > Some(1.7e9), "{seen}");
        Ok(())
    })
}
