//! Whole bridges: the real Wrapyfi on ZeroMQ on one side, independent ROS 2 programs on the other.

use serde_json::Value;
use wrapyfi_e2e::{Need, Result, RosImage, Route, TestEnv, ros2, run, sha256, texts, zeromq};

const NEEDS: &[Need] = &[Need::Program, Need::Python];

/// Fields that a received ROS message must have.
fn assert_fields(message: &Value, expected: &[(&str, Value)]) {
    for (name, value) in expected {
        assert_eq!(&message["fields"][*name], value, "field {name} of {message}");
    }
}

// Wrapyfi -> ROS 2 ------------------------------------------------------------------------------

/// Wrapyfi publishes, the bridge carries, a DDS program on CycloneDDS must find the same bytes.
fn to_ros(
    test: &str,
    peer: &str,
    message_type: &str,
    ros_type: &str,
    key: &str,
    fields: &[(&str, Value)],
) -> Result {
    run(test, NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let bridge = env.bridge(&env.embedded().route(Route::new(
            &zeromq(&from),
            &ros2(&to),
            message_type,
        )))?;
        let subscriber = env.dds_subscriber(&to, ros_type, "--count 3")?;
        let publisher = env.wrapyfi_publisher(&from, &format!("{peer} --no-broker"))?;
        let heard = subscriber.messages(3).map_err(|e| e.context(bridge.tail()))?;
        for message in &heard {
            assert!(message["undecodable"].is_null(), "{message}");
            assert_fields(message, fields);
            if message["fields"]["header"].is_object() {
                assert!(
                    message["stamp"].as_f64().is_some_and(|s| s > 1.7e9),
                    "no time stamp: {message}"
                );
            }
        }
        publisher.sent_in_a_row(key, &texts(&heard, "sha256"))
    })
}

macro_rules! to_ros {
    ($($test:ident: $peer:literal by $message_type:literal as $ros_type:literal, $key:literal, {$($field:ident: $value:expr),*};)*) => {
        $(#[test]
        fn $test() -> Result {
            let fields = [$((stringify!($field), Value::from($value))),*];
            to_ros(stringify!($test), $peer, $message_type, $ros_type, $key, &fields)
        })*
    };
}

to_ros! {
    colour_image_reaches_ros: "--type Image --flavour colour" by "Image" as "sensor_msgs/msg/Image", "sha256",
        {encoding: "bgr8", width: 64, height: 48, step: 192, is_bigendian: 0};
    mono_image_reaches_ros: "--type Image --flavour mono" by "Image" as "sensor_msgs/msg/Image", "sha256",
        {encoding: "mono8", width: 64, height: 48, step: 64};
    float_image_reaches_ros: "--type Image --flavour float" by "Image" as "sensor_msgs/msg/Image", "sha256",
        {encoding: "32FC3", width: 64, height: 48, step: 768};
    mono_float_image_reaches_ros: "--type Image --flavour float_mono" by "Image" as "sensor_msgs/msg/Image", "sha256",
        {encoding: "32FC1", width: 64, height: 48, step: 256};
    jpeg_reaches_ros_untouched: "--type Image --flavour jpg" by "CompressedImage" as "sensor_msgs/msg/CompressedImage", "file_sha256",
        {format: "jpeg"};
    sound_reaches_ros: "--type AudioChunk --flavour stereo" by "AudioChunk" as "wrapyfi_msgs/msg/AudioChunk", "sha256",
        {encoding: "FLOAT32LE", channels: 2, chunk_size: 441, sample_rate: 16000, step: 8};
    sound_reaches_ros_as_upstreams_message: "--type AudioChunk --flavour mono" by "wrapyfi_ros2_interfaces/msg/ROS2AudioMessage"
        as "wrapyfi_ros2_interfaces/msg/ROS2AudioMessage", "sha256",
        {encoding: "S16LE", channels: 1, chunk_size: 441, sample_rate: 16000, step: 4, is_bigendian: 0};
    object_reaches_ros: "--flavour small" by "NativeObject" as "wrapyfi_msgs/msg/NativeObject", "sha256", {};
    object_with_arrays_reaches_ros: "--flavour rich" by "NativeObject" as "wrapyfi_msgs/msg/NativeObject", "sha256", {};
    object_reaches_ros_as_json: "--flavour rich" by "std_msgs/msg/String" as "std_msgs/msg/String", "sha256", {};
}

#[test]
fn red_from_opencv_is_red_in_ros() -> Result {
    run("red_from_opencv_is_red_in_ros", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let _bridge =
            env.bridge(&env.embedded().route(Route::new(&zeromq(&from), &ros2(&to), "Image")))?;
        let subscriber = env.dds_subscriber(&to, "sensor_msgs/msg/Image", "--count 1")?;
        let _publisher = env.wrapyfi_publisher(&from, "--type Image --flavour red --no-broker")?;
        let heard = subscriber.messages(1)?;
        assert_fields(&heard[0], &[("encoding", "bgr8".into())]);
        assert_eq!(
            heard[0]["channel_means"],
            serde_json::json!([0.0, 0.0, 255.0]),
            "blue, green, red"
        );
        Ok(())
    })
}

#[test]
fn a_route_may_say_that_wrapyfi_sends_rgb() -> Result {
    run("a_route_may_say_that_wrapyfi_sends_rgb", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let route = Route::new(&zeromq(&from), &ros2(&to), "Image").with("encoding", "rgb8");
        let _bridge = env.bridge(&env.embedded().route(route))?;
        let subscriber = env.dds_subscriber(&to, "sensor_msgs/msg/Image", "--count 1")?;
        let publisher =
            env.wrapyfi_publisher(&from, "--type Image --flavour colour --no-broker")?;
        let heard = subscriber.messages(1)?;
        assert_fields(&heard[0], &[("encoding", "rgb8".into())]);
        publisher.sent_in_a_row("sha256", &texts(&heard, "sha256"))
    })
}

#[test]
fn a_bridge_uses_wrapyfis_own_broker() -> Result {
    run("a_bridge_uses_wrapyfis_own_broker", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let _bridge =
            env.bridge(&env.foreign().route(Route::new(&zeromq(&from), &ros2(&to), "Image")))?;
        let subscriber = env.dds_subscriber(&to, "sensor_msgs/msg/Image", "--count 3")?;
        let publisher = env.wrapyfi_publisher(&from, "--type Image --flavour colour")?;
        publisher.sent_in_a_row("sha256", &texts(&subscriber.messages(3)?, "sha256"))
    })
}

#[test]
fn a_bridge_may_be_the_last_to_start() -> Result {
    run("a_bridge_may_be_the_last_to_start", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let publisher = env.wrapyfi_publisher(&from, "--no-broker")?;
        let subscriber = env.dds_subscriber(&to, "std_msgs/msg/String", "--count 3")?;
        publisher.event("ready")?;
        subscriber.event("ready")?;
        let _bridge = env.bridge(&env.embedded().route(Route::new(
            &zeromq(&from),
            &ros2(&to),
            "std_msgs/msg/String",
        )))?;
        publisher.sent_in_a_row("sha256", &texts(&subscriber.messages(3)?, "sha256"))
    })
}

#[test]
fn a_bridge_goes_on_when_wrapyfi_starts_again() -> Result {
    run("a_bridge_goes_on_when_wrapyfi_starts_again", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let _bridge = env.bridge(&env.foreign().route(Route::new(
            &zeromq(&from),
            &ros2(&to),
            "std_msgs/msg/String",
        )))?;
        let first = env.dds_subscriber(&to, "std_msgs/msg/String", "--count 1")?;
        let publisher = env.wrapyfi_publisher(&from, "")?;
        first.messages(1)?;
        drop(publisher); // and with it the broker
        let publisher = env.wrapyfi_publisher(&from, "--flavour array")?;
        let second = env.dds_subscriber(&to, "std_msgs/msg/String", "")?;
        let heard = second.wait_until("a message of the second publisher", |output| {
            output.events("message").into_iter().find(|m| m["value"]["ramp"].is_object())
        })?;
        publisher.sent_in_a_row("sha256", &texts(&[heard], "sha256"))
    })
}

#[test]
fn a_ros_node_of_another_make_reads_json() -> Result {
    run("a_ros_node_of_another_make_reads_json", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let _bridge = env.bridge(&env.embedded().route(Route::new(
            &zeromq(&from),
            &ros2(&to),
            "std_msgs/msg/String",
        )))?;
        let mut node = env.ros_node("reader")?;
        let heard = node.subscribe::<String>(&to, "std_msgs/msg/String")?;
        let _publisher = env.wrapyfi_publisher(&from, "--flavour small --no-broker")?;
        let object: Value = serde_json::from_str(&heard.next()?)?;
        assert_eq!(object["greeting"], "hello");
        assert_eq!(object["list"], serde_json::json!([1, -2, 3.5, "four"]));
        Ok(())
    })
}

#[test]
fn a_ros_node_of_another_make_reads_an_image() -> Result {
    run("a_ros_node_of_another_make_reads_an_image", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let _bridge =
            env.bridge(&env.embedded().route(Route::new(&zeromq(&from), &ros2(&to), "Image")))?;
        let mut node = env.ros_node("reader")?;
        let heard = node.subscribe::<RosImage>(&to, "sensor_msgs/msg/Image")?;
        let publisher =
            env.wrapyfi_publisher(&from, "--type Image --flavour colour --no-broker")?;
        let frame = heard.next()?;
        assert_eq!(
            (frame.width, frame.height, frame.step, frame.encoding.as_str()),
            (64, 48, 192, "bgr8")
        );
        publisher.sent_in_a_row("sha256", &[sha256(&frame.data)])
    })
}

// ROS 2 -> Wrapyfi ------------------------------------------------------------------------------

/// A DDS program publishes, the bridge carries, a Wrapyfi listener that waits for a connection must
/// find the same content.
fn from_ros(
    test: &str,
    ros_type: &str,
    sender: &str,
    message_type: &str,
    peer: &str,
    key: &str,
) -> Result {
    run(test, NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let bridge = env.bridge(&env.embedded().route(Route::new(
            &ros2(&from),
            &zeromq(&to),
            message_type,
        )))?;
        let listener = env.wrapyfi_listener(&to, &format!("{peer} --count 3"))?;
        let publisher = env.dds_publisher(&from, ros_type, sender)?;
        let heard = listener.messages(3).map_err(|e| e.context(bridge.tail()))?;
        publisher.sent_in_a_row(key, &texts(&heard, "sha256"))
    })
}

macro_rules! from_ros {
    ($($test:ident: $ros_type:literal $sender:literal by $message_type:literal to $peer:literal, $key:literal;)*) => {
        $(#[test]
        fn $test() -> Result {
            from_ros(stringify!($test), $ros_type, $sender, $message_type, $peer, $key)
        })*
    };
}

from_ros! {
    bgr_image_reaches_wrapyfi: "sensor_msgs/msg/Image" "--flavour colour --encoding bgr8" by "Image"
        to "--type Image --flavour colour", "sha256";
    // The hash is that of the picture in blue-green-red: the bridge must have swapped the channels.
    rgb_image_reaches_wrapyfi_as_bgr: "sensor_msgs/msg/Image" "--flavour colour --encoding rgb8" by "Image"
        to "--type Image --flavour colour", "sha256";
    mono_image_reaches_wrapyfi: "sensor_msgs/msg/Image" "--flavour mono" by "Image"
        to "--type Image --flavour mono", "sha256";
    float_image_reaches_wrapyfi: "sensor_msgs/msg/Image" "--flavour float" by "Image"
        to "--type Image --flavour float", "sha256";
    jpeg_reaches_wrapyfi: "sensor_msgs/msg/CompressedImage" "--flavour jpg" by "CompressedImage"
        to "--type Image --flavour jpg", "decoded_sha256";
    sound_reaches_wrapyfi: "wrapyfi_msgs/msg/AudioChunk" "--flavour stereo" by "AudioChunk"
        to "--type AudioChunk --flavour stereo", "sha256";
    upstreams_sound_reaches_wrapyfi: "wrapyfi_ros2_interfaces/msg/ROS2AudioMessage" "--flavour mono"
        by "wrapyfi_ros2_interfaces/msg/ROS2AudioMessage" to "--type AudioChunk --flavour mono", "sha256";
    json_reaches_wrapyfi: "std_msgs/msg/String" "--flavour rich" by "std_msgs/msg/String"
        to "--flavour rich", "sha256";
    object_reaches_wrapyfi: "wrapyfi_msgs/msg/NativeObject" "--flavour rich" by "NativeObject"
        to "--flavour rich", "sha256";
}

#[test]
fn json_of_a_ros_node_of_another_make_reaches_wrapyfi() -> Result {
    run("json_of_a_ros_node_of_another_make_reaches_wrapyfi", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let _bridge = env.bridge(&env.embedded().route(Route::new(
            &ros2(&from),
            &zeromq(&to),
            "std_msgs/msg/String",
        )))?;
        let listener = env.wrapyfi_listener(&to, "--count 2")?;
        let mut node = env.ros_node("writer")?;
        let _spoken = node.publish(&from, "std_msgs/msg/String", |seq| {
            format!("{{\"seq\": {seq}, \"from\": \"ros\"}}")
        })?;
        let heard = listener.messages(2)?;
        let first = heard[0]["seq"].as_u64().unwrap_or(u64::MAX);
        assert_eq!(heard[1]["seq"], first + 1, "none is lost in between");
        assert_eq!(heard[0]["value"], serde_json::json!({"seq": first, "from": "ros"}));
        Ok(())
    })
}

#[test]
fn plain_text_of_a_ros_node_reaches_wrapyfi_and_comes_back() -> Result {
    run("plain_text_of_a_ros_node_reaches_wrapyfi_and_comes_back", NEEDS, |env| {
        let (from, there) = (env.topic("from"), env.topic("there"));
        let (back, plain, json) = (env.topic("back"), env.topic("plain"), env.topic("json"));
        let config = env
            .embedded()
            .route(Route::new(&ros2(&from), &zeromq(&there), "std_msgs/msg/String"))
            .route(Route::new(&zeromq(&back), &ros2(&plain), "Text"))
            .route(Route::new(&zeromq(&back), &ros2(&json), "std_msgs/msg/String"));
        let _bridge = env.bridge(&config)?;
        let listener = env.wrapyfi_listener(&there, "--count 2")?;
        let mut node = env.ros_node("talker")?;
        let as_text = node.subscribe::<String>(&plain, "std_msgs/msg/String")?;
        let as_json = node.subscribe::<String>(&json, "std_msgs/msg/String")?;
        let _spoken =
            node.publish(&from, "std_msgs/msg/String", |seq| format!("Hello World: {seq}"))?;
        for message in listener.messages(2)? {
            let text = message["value"].as_str().unwrap_or_default();
            assert!(text.starts_with("Hello World: "), "{message}");
        }
        let endpoint = zeromq(&back);
        let text = ["--type", "NativeObject", "--value", r#""Hello World""#, "--rate", "20"];
        let _publisher = env.wrapyfi([&["pub", &endpoint][..], &text].concat())?;
        assert_eq!(as_text.next()?, "Hello World");
        assert_eq!(as_json.next()?, "\"Hello World\"", "as Python Wrapyfi reads it");
        Ok(())
    })
}

#[test]
fn red_of_a_ros_node_of_another_make_is_red_in_opencv() -> Result {
    run("red_of_a_ros_node_of_another_make_is_red_in_opencv", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let _bridge =
            env.bridge(&env.embedded().route(Route::new(&ros2(&from), &zeromq(&to), "Image")))?;
        let listener = env.wrapyfi_listener(&to, "--type Image --flavour colour --count 1")?;
        let frame = RosImage::plain(64, 48, "rgb8", [255, 0, 0]);
        let mut node = env.ros_node("writer")?;
        let _spoken = node.publish(&from, "sensor_msgs/msg/Image", move |_| frame.clone())?;
        let heard = listener.messages(1)?;
        assert_eq!(
            heard[0]["channel_means"],
            serde_json::json!([0.0, 0.0, 255.0]),
            "blue, green, red"
        );
        Ok(())
    })
}

// Loops -----------------------------------------------------------------------------------------

#[test]
fn routes_in_both_directions_do_not_loop() -> Result {
    run("routes_in_both_directions_do_not_loop", NEEDS, |env: &TestEnv| {
        let (left, right) = (env.topic("left"), env.topic("right"));
        let config = env
            .embedded()
            .route(Route::new(&zeromq(&left), &ros2(&right), "std_msgs/msg/String"))
            .route(Route::new(&ros2(&right), &zeromq(&left), "std_msgs/msg/String"));
        let bridge = env.bridge(&config)?;
        let subscriber = env.dds_subscriber(&right, "std_msgs/msg/String", "")?;
        let publisher = env.wrapyfi_publisher(&left, "--no-broker")?;
        subscriber.messages(5)?;
        // Three more status reports are time enough for an echo; none may be counted as carried.
        let reports = |output: &wrapyfi_e2e::Output| {
            output.objects().filter(|o| o["routes"].is_array()).count()
        };
        let seen = bridge
            .wait_until("a status report", |output| Some(reports(output)).filter(|&n| n > 0))?;
        let last = bridge.wait_until("three more status reports", |output| {
            (reports(output) >= seen + 3)
                .then(|| output.objects().rev().find(|o| o["routes"].is_array()))?
        })?;
        assert_eq!(last["routes"][1]["counters"]["sent"], 0, "{last}");
        let heard = subscriber.wait_until("messages", |output| Some(output.events("message")))?;
        publisher
            .sent_in_a_row("sha256", &texts(&heard, "sha256"))
            .map_err(|e| e.context("each message arrives once"))
    })
}
