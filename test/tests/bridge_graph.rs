//! Appearance of a bridge on the ROS 2 graph: its node, its types, its CDR.

use serde_json::Value;
use wrapyfi_e2e::{Need, Process, Result, Route, ros2, run, texts, zeromq};

const NEEDS: &[Need] = &[Need::Program, Need::Python];

/// Hashes of standard interfaces, as real ROS 2 Jazzy nodes announce them.
const GOLDEN_HASHES: &[(&str, &str)] = &[
    (
        "sensor_msgs/msg/Image",
        "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
    ),
    (
        "sensor_msgs/msg/CompressedImage",
        "RIHS01_15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a",
    ),
    (
        "std_msgs/msg/String",
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    ),
];

/// The endpoint of the bridge on a topic, and the node that lists it.
fn endpoint_and_node(graph: &Process, role: &str, topic: &str) -> Result<(Value, Value)> {
    let (dds_topic, list) = (format!("rt{topic}"), format!("{role}s"));
    graph.wait_until(&format!("a node with a {role} on {dds_topic}"), |output| {
        let endpoint = output
            .events("endpoint")
            .into_iter()
            .find(|e| e["topic"] == *dds_topic && e["role"] == role)?;
        let samples = output.events("nodes");
        let node = samples.iter().flat_map(|s| s["nodes"].as_array().into_iter().flatten()).find(
            |node| {
                node[list.as_str()]
                    .as_array()
                    .is_some_and(|guids| guids.contains(&endpoint["guid"]))
            },
        )?;
        Some((endpoint, node.clone()))
    })
}

#[test]
fn the_graph_shows_the_node_and_the_types() -> Result {
    run("the_graph_shows_the_node_and_the_types", NEEDS, |env| {
        let mut config = env.embedded();
        for (index, (ros_type, _)) in GOLDEN_HASHES.iter().enumerate() {
            let (from, to) = (env.topic(&format!("from{index}")), env.topic(&format!("to{index}")));
            config = config.route(Route::new(&zeromq(&from), &ros2(&to), ros_type));
        }
        let back = env.topic("back");
        config = config.route(Route::new(
            &ros2(&back),
            &zeromq(&env.topic("object")),
            "std_msgs/msg/String",
        ));
        let graph = env.graph()?;
        let bridge = env.bridge(&config)?;
        let mut names = Vec::new();
        for (index, (ros_type, hash)) in GOLDEN_HASHES.iter().enumerate() {
            let (endpoint, node) =
                endpoint_and_node(&graph, "writer", &env.topic(&format!("to{index}")))
                    .map_err(|e| e.context(bridge.tail()))?;
            assert_eq!(endpoint["type"], ros_type.replace("/msg/", "::msg::dds_::") + "_");
            assert_eq!(endpoint["hash"], *hash, "{endpoint}");
            names.push(node["name"].as_str().unwrap_or_default().to_owned());
        }
        let (endpoint, node) = endpoint_and_node(&graph, "reader", &back)?;
        assert_eq!(endpoint["hash"], GOLDEN_HASHES[2].1, "{endpoint}");
        names.push(node["name"].as_str().unwrap_or_default().to_owned());
        names.dedup();
        assert_eq!(names.len(), 1, "one node for all routes: {names:?}");
        assert!(names[0].starts_with('/') && names[0].len() > 1, "{names:?}");
        Ok(())
    })
}

#[test]
fn our_own_types_have_the_hash_that_others_compute() -> Result {
    run("our_own_types_have_the_hash_that_others_compute", NEEDS, |env| {
        let types = ["wrapyfi_msgs/msg/NativeObject", "wrapyfi_msgs/msg/AudioChunk"];
        let hashes = env.peer("rosbags_decode.py", &format!("hash {}", types.join(" ")))?;
        let hashes = texts(&hashes.objects(types.len())?, "hash");
        let mut config = env.embedded();
        for (index, ros_type) in types.iter().enumerate() {
            let (from, to) = (env.topic(&format!("from{index}")), env.topic(&format!("to{index}")));
            config = config.route(Route::new(&zeromq(&from), &ros2(&to), ros_type));
        }
        let graph = env.graph()?;
        let _bridge = env.bridge(&config)?;
        for (index, hash) in hashes.iter().enumerate() {
            let (endpoint, _) =
                endpoint_and_node(&graph, "writer", &env.topic(&format!("to{index}")))?;
            assert_eq!(endpoint["hash"], **hash, "{endpoint}");
        }
        Ok(())
    })
}

#[test]
fn a_bridge_that_ends_leaves_the_graph() -> Result {
    run("a_bridge_that_ends_leaves_the_graph", NEEDS, |env| {
        let to = env.topic("to");
        let graph = env.graph()?;
        let mut bridge =
            env.bridge(&env.embedded().route(Route::new("zeromq:/from", &ros2(&to), "Image")))?;
        let (endpoint, _) = endpoint_and_node(&graph, "writer", &to)?;
        bridge.terminate()?;
        bridge.exits_with(0)?;
        graph.wait_until("the end of the bridge's writer", |output| {
            output.events("gone").into_iter().find(|gone| gone["guid"] == endpoint["guid"])
        })?;
        Ok(())
    })
}

// CDR -------------------------------------------------------------------------------------------

/// rosbags decodes what is on the wire, finds the right fields, and would have written the same bytes.
fn rosbags_reads(test: &str, peer: &str, message_type: &str, ros_type: &str) -> Result {
    run(test, NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let _bridge = env.bridge(&env.embedded().route(Route::new(
            &zeromq(&from),
            &ros2(&to),
            message_type,
        )))?;
        let subscriber = env.dds_subscriber(&to, ros_type, "--count 2 --cdr")?;
        let _publisher = env.wrapyfi_publisher(&from, &format!("{peer} --no-broker"))?;
        let heard = subscriber.messages(2)?;
        let mut decoder = env.peer("rosbags_decode.py", "")?;
        for message in &heard {
            assert!(
                message["cdr"].as_str().is_some_and(|cdr| cdr.starts_with("00010000")),
                "little-endian CDR"
            );
            decoder
                .tell(&serde_json::json!({"type": ros_type, "cdr": message["cdr"]}).to_string())?;
        }
        decoder.close_stdin();
        for decoded in decoder.objects(2)? {
            assert_eq!(decoded["event"], "decoded", "{decoded}");
            assert_eq!(decoded["same_bytes"], true, "rosbags writes the same bytes: {decoded}");
            if ros_type == "sensor_msgs/msg/Image" {
                assert_eq!(decoded["fields"]["encoding"], "bgr8");
                assert_eq!(decoded["fields"]["data"]["bytes"], 64 * 48 * 3);
            }
        }
        Ok(())
    })
}

macro_rules! rosbags_reads {
    ($($test:ident: $peer:literal by $message_type:literal as $ros_type:literal;)*) => {
        $(#[test]
        fn $test() -> Result {
            rosbags_reads(stringify!($test), $peer, $message_type, $ros_type)
        })*
    };
}

rosbags_reads! {
    rosbags_reads_our_image: "--type Image --flavour colour" by "Image" as "sensor_msgs/msg/Image";
    rosbags_reads_our_compressed_image: "--type Image --flavour jpg" by "CompressedImage" as "sensor_msgs/msg/CompressedImage";
    rosbags_reads_our_sound: "--type AudioChunk --flavour stereo" by "AudioChunk" as "wrapyfi_msgs/msg/AudioChunk";
    rosbags_reads_our_object: "--flavour rich" by "NativeObject" as "wrapyfi_msgs/msg/NativeObject";
    rosbags_reads_our_string: "--flavour rich" by "std_msgs/msg/String" as "std_msgs/msg/String";
}
