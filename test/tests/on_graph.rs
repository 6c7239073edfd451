//! Topics and services by which a running bridge tells of itself on the graph: `/diagnostics`, `~/list_routes` and `~/explain`.

use serde_json::Value;
use wrapyfi_e2e::{Need, Process, Result, Route, TestEnv, ros2, run, until_route, zeromq};

const NEEDS: &[Need] = &[Need::Program, Need::Python];
const NODE: &str = "/wrapyfi_bridge";
const FILE: &str = "on_graph.yaml";

/// A bridge with a route that carries, one that waits for a publisher, and a topic with a publisher.
fn bridge(env: &TestEnv) -> Result<Process> {
    let route = |name: &str| {
        let topic = env.topic(name);
        Route::new(&ros2(&topic), &zeromq(&topic), "Text").with("name", name)
    };
    let config = env.embedded().route(route("talk")).route(route("waits"));
    let bridge = env.bridge_named(FILE, &config)?;
    until_route(&bridge, "talk", |route| route.is_some())?;
    Ok(bridge)
}

fn status(message: &Value, name: &str) -> Option<Value> {
    let all = message["fields"]["status"].as_array()?;
    all.iter().find(|one| one["name"] == format!("wrapyfi_bridge: {name}")).cloned()
}

fn value(status: &Value, key: &str) -> Option<u64> {
    let pairs = status["values"].as_array()?;
    pairs.iter().find(|pair| pair["key"] == key)?["value"].as_str()?.parse().ok()
}

fn is_level(status: &Value, level: u64) -> bool {
    // A byte: a number, or its own text in Python.
    status["level"].as_u64() == Some(level)
        || status["level"]["bytes"].as_u64() == Some(1)
        || status["level"].as_str().is_some_and(|text| text.bytes().map(u64::from).eq([level]))
}

/// Runs `wrapyfi` and reads the JSON object that it prints.
fn answer(env: &TestEnv, args: &[&str], code: i32) -> Result<Value> {
    let mut asked = env.wrapyfi(args)?;
    asked.exits_with(code)?;
    Ok(serde_json::from_str(asked.stdout().trim())?)
}

#[test]
fn diagnostics_come_once_a_second_with_a_level_for_each_route() -> Result {
    run("diagnostics", NEEDS, |env| {
        let bridge = bridge(env)?;
        let talker =
            env.dds_publisher(&env.topic("talk"), "std_msgs/msg/String", "--text hello --rate 20")?;
        let listener =
            env.wrapyfi(["echo", &zeromq(&env.topic("talk")), "--type", "NativeObject"])?;
        let kind = "diagnostic_msgs/msg/DiagnosticArray";
        let diagnostics = env.dds_subscriber("/diagnostics", kind, "--plain")?;
        let found = |what: &str, wanted: &dyn Fn(&Value) -> bool| {
            diagnostics
                .wait_until(what, |output| {
                    output.events("message").into_iter().rev().find(|one| wanted(one))
                })
                .map_err(|error| error.context(bridge.tail()))
        };
        found("messages of the route", &|message| {
            status(message, "talk").is_some_and(|talk| {
                is_level(&talk, 0)
                    && talk["message"] == "active"
                    && value(&talk, "sent").is_some_and(|sent| sent > 20)
            })
        })?;
        found("a route that waits", &|message| {
            status(message, "waits").is_some_and(|waits| {
                is_level(&waits, 1)
                    && waits["message"]
                        .as_str()
                        .is_some_and(|text| text.starts_with("waiting for "))
            })
        })?;
        found("the middlewares", &|message| {
            ["zeromq", "ros2"]
                .iter()
                .all(|name| status(message, name).is_some_and(|one| one["message"] == "works"))
        })?;
        drop(talker);
        found("a route that is stale", &|message| {
            status(message, "talk").is_some_and(|talk| !is_active(&talk))
        })?;
        drop(listener);
        Ok(())
    })
}

fn is_active(status: &Value) -> bool {
    status["message"] == "active"
}

#[test]
fn a_bridge_lists_its_routes_with_their_counters() -> Result {
    run("list_routes", NEEDS, |env| {
        let bridge = bridge(env)?;
        let topic = env.topic("talk");
        let _listener = env.wrapyfi(["echo", &zeromq(&topic), "--type", "NativeObject"])?;
        let _talker = env.dds_publisher(&topic, "std_msgs/msg/String", "--text hello --rate 20")?;
        until_route(&bridge, "talk", |route| {
            route.is_some_and(|route| route["counters"]["sent"].as_u64() > Some(10))
        })?;
        let service = format!("ros2:{NODE}/list_routes");
        let told = answer(env, &["call", &service, "--json"], 0)?;
        let routes = told["value"]["routes"].as_array().cloned().unwrap_or_default();
        let talk = routes.iter().find(|route| route["key"] == "talk");
        let talk = talk.unwrap_or_else(|| panic!("{told}"));
        assert_eq!(talk["source"], ros2(&topic), "{told}");
        assert_eq!(talk["destination"], zeromq(&topic), "{told}");
        assert_eq!(talk["type_name"], "std_msgs/msg/String", "{told}");
        assert!(
            talk["sent"].as_u64() > Some(10) && talk["sent_bytes"].as_u64() > Some(0),
            "{told}"
        );
        let waits = routes.iter().find(|route| route["key"] == "waits");
        assert_eq!(waits.map(|route| route["state"].clone()), Some("waiting".into()), "{told}");
        Ok(())
    })
}

#[test]
fn a_bridge_elsewhere_says_why_nothing_flows() -> Result {
    run("explain", NEEDS, |env| {
        let bridge = bridge(env)?;
        let ask = |name: &str, code| {
            answer(env, &["why", name, "--node", NODE, "--json"], code)
                .map_err(|error| error.context(bridge.tail()))
        };
        let waits = ask("waits", 1)?;
        assert_eq!(waits["cause"], "nobody_publishes", "{waits}");
        let topic = env.topic("waits");
        assert!(waits["what"].as_str().is_some_and(|what| what.contains(&topic)), "{waits}");
        let topic = env.topic("talk");
        let _listener = env.wrapyfi(["echo", &zeromq(&topic), "--type", "NativeObject"])?;
        let _talker = env.dds_publisher(&topic, "std_msgs/msg/String", "--text hello --rate 20")?;
        until_route(&bridge, "talk", |route| {
            route.is_some_and(|route| route["counters"]["sent"].as_u64() > Some(10))
        })?;
        // By its name, and by either end.
        for name in ["talk", &ros2(&topic), &zeromq(&topic)] {
            let talk = ask(name, 0)?;
            let passed = talk["passed"].as_array().cloned().unwrap_or_default();
            let says = |words: &str| {
                passed.iter().any(|step| step.as_str().is_some_and(|step| step.contains(words)))
            };
            assert!(says("a bridge runs the route") && says("has 1 publisher"), "{talk}");
        }
        // It explains what runs, whatever the file has become.
        env.write(FILE, "routes: [")?;
        ask("talk", 0)?;
        let mut unknown = env.wrapyfi(["why", "nonsense", "--node", NODE])?;
        unknown.exits_with(2)?;
        assert!(unknown.stderr().contains("has no route \"nonsense\""), "{}", unknown.stderr());
        let mut nobody = env.wrapyfi(["why", "talk", "--node", "/nobody"])?;
        nobody.exits_with(3)
    })
}
