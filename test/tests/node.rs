//! The node executable as `ros2 run` starts it: ROS arguments decide name, namespace, topics and parameters.

#![allow(clippy::indexing_slicing, reason = "in a test a panic is the right answer")]

use serde_json::Value;
use wrapyfi_e2e::{Need, Output, Process, Result, Route, World, run, texts};

const NEEDS: &[Need] = &[Need::Node, Need::Python];

/// Starts the node with a configuration as parameter and more ROS arguments.
fn start(world: &World, routes: Vec<Route>, ros_args: &[&str]) -> Result<Process> {
    let config = routes.into_iter().fold(world.embedded(), wrapyfi_e2e::Config::route);
    let file = world.write("bridge.yaml", config.yaml())?;
    let parameter = format!("config_file:={}", file.display());
    let mut args = vec!["--ros-args", "-p", &parameter];
    args.extend(ros_args);
    world.node(args)
}

fn node_named(output: &Output, name: &str) -> Option<Value> {
    let samples = output.events("nodes");
    let mut found = samples.iter().rev().flat_map(|s| s["nodes"].as_array().into_iter().flatten());
    found.find(|node| node["name"] == name).cloned()
}

#[test]
fn name_and_namespace_come_from_the_command_line() -> Result {
    run("name_and_namespace_come_from_the_command_line", NEEDS, |world| {
        let graph = world.graph()?;
        let route = Route::new("zeromq:/a", &format!("ros2:{}", world.topic("to")), "Image");
        let mut node = start(
            world,
            vec![route],
            &["-r", "__node:=other", "-r", "__ns:=/lab", "--log-level", "debug"],
        )?;
        graph
            .wait_until("node /lab/other", |output| node_named(output, "/lab/other"))
            .map_err(|e| e.context(node.tail()))?;
        node.wait_until("a line at level debug", |output| {
            output.err.iter().chain(&output.out).any(|l| l.contains("DEBUG")).then_some(())
        })?;
        node.terminate()?;
        node.exits_with(0)
    })
}

#[test]
fn topics_are_remapped() -> Result {
    run("topics_are_remapped", NEEDS, |world| {
        let (from, cam, front) = (world.topic("from"), world.topic("cam"), world.topic("front"));
        let route = Route::new(&format!("zeromq:{from}"), &format!("ros2:{cam}"), "Image");
        let node = start(world, vec![route], &["-r", &format!("{cam}:={front}")])?;
        let subscriber = world.dds_subscriber(&front, "sensor_msgs/msg/Image", "--count 2")?;
        let publisher =
            world.wrapyfi_publisher(&from, "--type Image --flavour colour --no-broker")?;
        let heard = subscriber.messages(2).map_err(|e| e.context(node.tail()))?;
        publisher.sent_in_a_row("sha256", &texts(&heard, "sha256"))
    })
}

#[test]
fn relative_topics_are_in_the_nodes_namespace() -> Result {
    run("relative_topics_are_in_the_nodes_namespace", NEEDS, |world| {
        let (from, namespace) = (world.topic("from"), world.topic("lab"));
        let route = Route::new(&format!("zeromq:{from}"), "ros2:cam", "Image");
        let node = start(world, vec![route], &["-r", &format!("__ns:={namespace}")])?;
        let subscriber = world.dds_subscriber(
            &format!("{namespace}/cam"),
            "sensor_msgs/msg/Image",
            "--count 1",
        )?;
        let publisher =
            world.wrapyfi_publisher(&from, "--type Image --flavour colour --no-broker")?;
        let heard = subscriber.messages(1).map_err(|e| e.context(node.tail()))?;
        publisher.sent_in_a_row("sha256", &texts(&heard, "sha256"))
    })
}

#[test]
fn bad_ros_arguments_are_refused() -> Result {
    run("bad_ros_arguments_are_refused", &[Need::Node], |world| {
        for args in [
            &["--ros-args", "-r", "nonsense"][..],
            &["--ros-args", "-p", "config_file:=no_such_file.yaml"],
        ] {
            let mut node = world.node(args)?;
            let code = node.exit_code()?;
            assert!([1, 2].contains(&code), "exit code {code}\n{}", node.tail());
            let said = node.stderr();
            assert!(said.contains("nonsense") || said.contains("no_such_file.yaml"), "{said}");
            assert!(!said.contains("panicked"), "{said}");
        }
        Ok(())
    })
}
