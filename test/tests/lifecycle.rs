//! A bridge as a managed node: the states that others ask for, what they mean for its routes, and what it tells of them.

use std::net::TcpStream;

use serde_json::{Value, json};
use wrapyfi_e2e::{
    Config, Need, Process, Result, Route, TestEnv, ros2, run, until_route, yarp, zeromq,
};

const NEEDS: &[Need] = &[Need::Program, Need::Python];
const NODE: &str = "/wrapyfi_bridge";
const FILE: &str = "lifecycle.yaml";

fn config(env: &TestEnv) -> Config {
    let topic = env.topic("talk");
    let route = Route::new(&ros2(&topic), &zeromq(&topic), "Text").with("name", "talk");
    env.embedded().route(route)
}

/// A bridge that waits for others.
fn waiting_bridge(env: &TestEnv, config: &Config) -> Result<Process> {
    let file = env.write(FILE, config.yaml())?;
    let file = file.display().to_string();
    env.wrapyfi(["bridge", "--config", &file, "--json", "--no-autostart"])
}

/// Reply of a service of the node.
fn ask(env: &TestEnv, bridge: &Process, service: &str, request: &Value) -> Result<Value> {
    let (service, request) = (format!("ros2:{NODE}/{service}"), request.to_string());
    let mut asked = env.wrapyfi(["call", &service, "--value", &request, "--json"])?;
    asked.exits_with(0).map_err(|error| error.context(bridge.tail()))?;
    let told: Value = serde_json::from_str(asked.stdout().trim())?;
    Ok(told["value"].clone())
}

fn state(env: &TestEnv, bridge: &Process) -> Result<String> {
    let told = ask(env, bridge, "get_state", &json!({}))?;
    let current = &told["current_state"];
    Ok(format!("{} {}", current["id"], current["label"].as_str().unwrap_or_default()))
}

/// Asks for a transition by its name; true where the node has made it.
fn change(env: &TestEnv, bridge: &Process, label: &str) -> Result<bool> {
    let request = json!({"transition": {"label": label}});
    Ok(ask(env, bridge, "change_state", &request)?["success"] == true)
}

/// True where the bridge listens to the topic of its route on ROS 2.
fn has_listener(env: &TestEnv) -> Result<bool> {
    let mut listed = env.wrapyfi(["list", "ros2", "--json"])?;
    listed.exits_with(0)?;
    let topic = env.topic("talk");
    let is_ours = |line: &str| line.contains(&topic) && line.contains(NODE);
    Ok(listed.stdout().lines().any(is_ours))
}

fn found(process: &Process, what: &str, wanted: impl Fn(&Value) -> bool) -> Result<Value> {
    process.wait_until(what, |output| {
        output.events("message").into_iter().rev().find(|one| wanted(&one["fields"]))
    })
}

#[test]
fn a_managed_bridge_has_routes_while_it_is_active_and_ends_once_it_is_finalized() -> Result {
    run("lifecycle_managed", NEEDS, |env| {
        let topic = env.topic("talk");
        let mut bridge = waiting_bridge(env, &config(env))?;
        let kind = "lifecycle_msgs/msg/TransitionEvent";
        let events = env.dds_subscriber(&format!("{NODE}/transition_event"), kind, "--plain")?;
        events.event("matched")?;
        let kind = "wrapyfi_msgs/msg/BridgeStatus";
        let status = env.dds_subscriber(&format!("{NODE}/status"), kind, "--plain")?;
        let is_broker_there = || TcpStream::connect(("127.0.0.1", env.pub_port())).is_ok();

        assert_eq!(state(env, &bridge)?, "1 unconfigured");
        found(&status, "no route", |it| {
            it["state"] == "unconfigured" && it["routes"] == json!([])
        })?;
        assert!(!is_broker_there(), "nothing but ROS 2 has started");
        assert!(!change(env, &bridge, "activate")?, "it is not configured");
        assert!(!change(env, &bridge, "nonsense")?);
        let added = ask(env, &bridge, "add_route", &json!({"route": "x"}))?;
        assert!(added["message"].to_string().contains("is unconfigured"), "{added}");

        assert!(change(env, &bridge, "configure")?);
        assert_eq!(state(env, &bridge)?, "2 inactive");
        found(&status, "a route that waits", |it| {
            it["state"] == "inactive"
                && it["routes"][0]["key"] == "talk"
                && it["routes"][0]["kind"] == "topic"
                && it["routes"][0]["reason"] == "the bridge to be activated"
        })?;
        assert!(is_broker_there(), "the middlewares are there");
        assert!(!has_listener(env)?, "the route is closed");
        let mut why = env.wrapyfi(["why", "talk", "--node", NODE, "--json"])?;
        why.exits_with(1)?;
        assert!(why.stdout().contains("ros2 lifecycle set /wrapyfi_bridge activate"));

        // By its number, as launch asks.
        let activated = json!({"transition": {"id": 3}});
        assert_eq!(ask(env, &bridge, "change_state", &activated)?, json!({"success": true}));
        let _talker = env.dds_publisher(&topic, "std_msgs/msg/String", "--text hello --rate 20")?;
        // The program that listens stays: without a listener the route waits.
        let carries = || -> Result<Process> {
            let listener = env.wrapyfi(["echo", &zeromq(&topic), "--type", "NativeObject"])?;
            listener
                .wait_until("hello", |output| {
                    output.out.iter().any(|line| line.contains("hello")).then_some(())
                })
                .map_err(|error| error.context(bridge.tail()))?;
            Ok(listener)
        };
        let listener = carries()?;
        found(&status, "messages", |it| {
            it["state"] == "active"
                && it["routes"][0]["state"] == "active"
                && it["routes"][0]["sent"].as_u64() > Some(5)
        })?;

        drop(listener);
        assert!(change(env, &bridge, "deactivate")?);
        assert_eq!(state(env, &bridge)?, "2 inactive");
        bridge.wait_until("the reason for the end of the route", |output| {
            let is_told = |line: &String| line.contains("the node was deactivated");
            output.err.iter().any(is_told).then_some(())
        })?;
        assert!(!has_listener(env)? && is_broker_there());
        assert!(change(env, &bridge, "activate")?);
        drop(carries()?);
        assert!(change(env, &bridge, "deactivate")?);
        assert!(change(env, &bridge, "cleanup")?);
        assert_eq!(state(env, &bridge)?, "1 unconfigured");

        // What is wrong with the file is a failure, and can be mended.
        env.write(FILE, "routes: [")?;
        assert!(!change(env, &bridge, "configure")?);
        assert_eq!(state(env, &bridge)?, "1 unconfigured");
        env.write(FILE, config(env).yaml())?;
        assert!(change(env, &bridge, "configure")?);
        assert!(change(env, &bridge, "shutdown")?, "it answers before it ends");
        bridge.exits_with(0)?;

        let expected = [
            ("unconfigured", "configuring", "inactive"),
            ("inactive", "activating", "active"),
            ("active", "deactivating", "inactive"),
            ("inactive", "activating", "active"),
            ("active", "deactivating", "inactive"),
            ("inactive", "cleaningup", "unconfigured"),
            ("unconfigured", "configuring", "unconfigured"),
            ("unconfigured", "configuring", "inactive"),
            ("inactive", "shuttingdown", "finalized"),
        ];
        let expected: Vec<_> =
            expected.into_iter().flat_map(|(from, at, to)| [(from, at), (at, to)]).collect();
        let told = events.messages(expected.len())?;
        let label = |event: &Value, key: &str| event["fields"][key]["label"].clone();
        let told: Vec<_> =
            told.iter().map(|it| (label(it, "start_state"), label(it, "goal_state"))).collect();
        let expected: Vec<_> =
            expected.into_iter().map(|(from, to)| (json!(from), json!(to))).collect();
        assert_eq!(told, expected);
        Ok(())
    })
}

#[test]
fn a_bridge_starts_active_by_itself_and_tells_what_can_be_asked_of_it() -> Result {
    run("lifecycle_autostart", NEEDS, |env| {
        let bridge = env.bridge_named(FILE, &config(env))?;
        until_route(&bridge, "talk", |route| route.is_some())?;
        assert_eq!(state(env, &bridge)?, "3 active");
        let states = ask(env, &bridge, "get_available_states", &json!({}))?;
        assert_eq!(states["available_states"].as_array().map(Vec::len), Some(11), "{states}");
        let listed = |service: &str| -> Result<Vec<String>> {
            let told = ask(env, &bridge, service, &json!({}))?;
            let all = told["available_transitions"].as_array().cloned().unwrap_or_default();
            let line = |one: &Value| {
                format!(
                    "{} {} -> {}",
                    one["transition"]["id"],
                    one["start_state"]["label"].as_str().unwrap_or_default(),
                    one["goal_state"]["label"].as_str().unwrap_or_default(),
                )
            };
            Ok(all.iter().map(line).collect())
        };
        let available = listed("get_available_transitions")?;
        assert_eq!(available, ["4 active -> deactivating", "7 active -> shuttingdown"]);
        let all = listed("get_transition_graph")?;
        assert_eq!((all.len(), all[0].as_str()), (25, "1 unconfigured -> configuring"));
        // Who comes late has the last status at once.
        let kind = "wrapyfi_msgs/msg/BridgeStatus";
        let args = "--plain --transient-local --count 1";
        let status = env.dds_subscriber(&format!("{NODE}/status"), kind, args)?;
        found(&status, "the status", |it| {
            it["state"] == "active" && it["routes"][0]["source"] == ros2(&env.topic("talk"))
        })?;
        // A route that is added and a file that changes wait for the state.
        assert!(change(env, &bridge, "deactivate")?);
        let other = env.topic("other");
        let route = Route::new(&ros2(&other), &zeromq(&other), "Text").with("name", "other");
        env.write(FILE, config(env).route(route).yaml())?;
        until_route(&bridge, "other", |route| {
            route.is_some_and(|route| route["reason"] == "the bridge to be activated")
        })?;
        assert!(change(env, &bridge, "activate")?);
        until_route(&bridge, "other", |route| {
            route.is_some_and(|route| route["reason"] != "the bridge to be activated")
        })
    })
}

#[test]
fn a_bridge_that_nobody_could_activate_is_refused() -> Result {
    run("lifecycle_no_ros2", &[Need::Program], |env| {
        let topic = env.topic("x");
        let route = Route::new(&zeromq(&topic), &yarp(&topic), "NativeObject");
        let mut bridge = waiting_bridge(env, &env.embedded().yarp(env).route(route))?;
        bridge.exits_with(2)?;
        assert!(bridge.stderr().contains("no route is on ros2"), "{}", bridge.stderr());
        Ok(())
    })
}
