//! The peers among themselves: a failure here is the harness's or the machine's, not the product's.

use wrapyfi_e2e::{Need, Result, RosImage, run, sha256, texts};

#[test]
fn wrapyfi_hears_wrapyfi() -> Result {
    run("wrapyfi_hears_wrapyfi", &[Need::Python], |env| {
        let topic = env.topic("x");
        let listener = env.wrapyfi_listener(&topic, "--flavour rich --count 3")?;
        let publisher = env.wrapyfi_publisher(&topic, "--flavour rich")?;
        publisher.sent_in_a_row("sha256", &texts(&listener.messages(3)?, "sha256"))
    })
}

#[test]
fn wrapyfi_serves_others_with_its_broker() -> Result {
    run("wrapyfi_serves_others_with_its_broker", &[Need::Python], |env| {
        let holder = env.wrapyfi_publisher(&env.topic("holder"), "--no-wait --count 1")?;
        holder.event("done")?;
        let topic = env.topic("x");
        let publisher = env.wrapyfi_publisher(&topic, "--no-broker")?;
        let listener = env.wrapyfi_listener(&topic, "--count 1")?;
        publisher.sent_in_a_row("sha256", &texts(&listener.messages(1)?, "sha256"))
    })
}

#[test]
fn the_raw_publisher_reaches_wrapyfis_broker() -> Result {
    run("the_raw_publisher_reaches_wrapyfis_broker", &[Need::Python], |env| {
        let topic = env.topic("x");
        let _publisher = env.wrapyfi_publisher(&topic, "")?;
        let listener = env.wrapyfi_listener(&topic, "")?;
        listener.messages(1)?;
        let port = env.sub_port();
        let raw = env.peer(
            "zmq_peer.py",
            &format!("--topic {topic} --sub-port {port} --cases native_truncated"),
        )?;
        raw.event("done")?;
        // The real Wrapyfi dies of it: the bad message did arrive.
        listener.wait_until("Wrapyfi's end", |o| {
            o.err.iter().any(|l| l.contains("JSONDecodeError")).then_some(())
        })
    })
}

#[test]
fn sample_files_are_made() -> Result {
    run("sample_files_are_made", &[Need::Python], |env| {
        let mut maker = env.peer("make_files.py", &env.path("").display().to_string())?;
        maker.exits_with(0)?;
        assert!(env.path("colour.png").is_file());
        Ok(())
    })
}

#[test]
fn dds_peer_hears_dds_peer() -> Result {
    run("dds_peer_hears_dds_peer", &[Need::Python], |env| {
        let topic = env.topic("x");
        let publisher = env.dds_publisher(&topic, "sensor_msgs/msg/Image", "--flavour colour")?;
        let subscriber = env.dds_subscriber(&topic, "sensor_msgs/msg/Image", "--count 3")?;
        publisher.sent_in_a_row("sha256", &texts(&subscriber.messages(3)?, "sha256"))
    })
}

#[test]
fn dds_peer_and_ros_node_hear_each_other() -> Result {
    run("dds_peer_and_ros_node_hear_each_other", &[Need::Python], |env| {
        let (there, back) = (env.topic("there"), env.topic("back"));
        let mut node = env.ros_node("independent")?;
        let heard = node.subscribe::<String>(&there, "std_msgs/msg/String")?;
        let _publisher = env.dds_publisher(&there, "std_msgs/msg/String", "")?;
        assert!(heard.next()?.contains("greeting"));

        let frame = RosImage::plain(64, 48, "rgb8", [255, 0, 0]);
        let expected = sha256(&frame.data);
        let _spoken = node.publish(&back, "sensor_msgs/msg/Image", move |_| frame.clone())?;
        let subscriber = env.dds_subscriber(&back, "sensor_msgs/msg/Image", "--count 1")?;
        assert_eq!(texts(&subscriber.messages(1)?, "sha256"), [expected]);
        Ok(())
    })
}

#[test]
fn graph_observer_sees_a_ros_node() -> Result {
    run("graph_observer_sees_a_ros_node", &[Need::Python], |env| {
        let graph = env.graph()?;
        let mut node = env.ros_node("independent")?;
        let _heard = node.subscribe::<String>(&env.topic("x"), "std_msgs/msg/String")?;
        let dds_topic = format!("rt{}", env.topic("x"));
        graph.wait_until("the node with its subscription", |output| {
            let endpoint =
                output.events("endpoint").into_iter().find(|e| e["topic"] == *dds_topic)?;
            let nodes = output.events("nodes");
            let node = nodes
                .iter()
                .flat_map(|e| e["nodes"].as_array().into_iter().flatten())
                .find(|node| {
                    node["name"] == "/independent"
                        && node["readers"].as_array().is_some_and(|r| r.contains(&endpoint["guid"]))
                })?;
            Some(node.clone())
        })?;
        Ok(())
    })
}

#[test]
fn a_ros_node_reads_an_image_of_the_dds_peer() -> Result {
    run("a_ros_node_reads_an_image_of_the_dds_peer", &[Need::Python], |env| {
        let topic = env.topic("x");
        let mut node = env.ros_node("reader")?;
        let heard = node.subscribe::<RosImage>(&topic, "sensor_msgs/msg/Image")?;
        let publisher = env.dds_publisher(&topic, "sensor_msgs/msg/Image", "--flavour colour")?;
        publisher.sent_in_a_row("sha256", &[sha256(&heard.next()?.data)])
    })
}
