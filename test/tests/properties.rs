//! The parameters of nodes as properties: `wrapyfi echo`, `wrapyfi pub` and routes, with a node that
//! shares no code with ours, with the real Wrapyfi, and between our own nodes.

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Output, Process, Result, Route, TestEnv, rmw, run};

const NEEDS: &[Need] = &[Need::Program, Need::Python];
const AS: [&str; 2] = ["--type", "Properties"];

/// A node of another make. Written without blanks, since the arguments are split at them.
fn camera(env: &TestEnv, node: &str, parameters: &Value) -> Result<Process> {
    let peer = env.peer("param_node.py", &format!("--node {node} {parameters}"))?;
    peer.event("ready")?;
    Ok(peer)
}

fn parameters() -> Value {
    json!({"rate": 10, "gain": 1.5, "serial": "A1", "lens.label": "left", "ids": [1, 2]})
}

/// Waits until as many listen to the events of the node: the topic keeps nothing for later ones.
fn heard_by(camera: &Process, readers: u64) -> Result {
    camera.wait_until("readers of the events", |output| {
        let last = output.events("heard").pop()?;
        (last["readers"] == readers).then_some(())
    })
}

fn echo(env: &TestEnv, rmw: &str, node: &str, more: &[&str]) -> Result<Process> {
    let endpoint = format!("ros2:{node}");
    env.wrapyfi_as(rmw, [&["echo", &endpoint, "--json"], &AS[..], more].concat())
}

fn set(env: &TestEnv, rmw: &str, node: &str, value: &Value, more: &[&str]) -> Result<Process> {
    let (endpoint, value) = (format!("ros2:{node}"), value.to_string());
    let words = ["pub", &endpoint, "--value", &value];
    env.wrapyfi_as(rmw, [&words[..], &AS[..], more].concat())
}

/// Sets, and asserts how that ends.
fn sets(env: &TestEnv, node: &str, value: &Value, code: i32) -> Result<Process> {
    let mut process = set(env, &rmw(), node, value, &["--timeout", "60"])?;
    process.exits_with(code)?;
    Ok(process)
}

const FAST: &str = "rmw_fastrtps_cpp";

/// All changes so far, one upon the other.
fn told(output: &Output) -> Value {
    let mut all = serde_json::Map::new();
    for object in output.objects() {
        if let Some(changes) = object["value"].as_object() {
            all.extend(changes.clone());
        }
    }
    Value::Object(all)
}

#[test]
fn a_node_of_another_make_is_read_set_and_watched() -> Result {
    run("a_node_of_another_make_is_read_set_and_watched", NEEDS, |env| {
        let node = env.topic("camera");
        let watcher = echo(env, &rmw(), &node, &[])?;
        let mut peer = camera(env, &node, &parameters())?;
        let first = watcher.objects(1)?.remove(0);
        assert_eq!((&first["type"], &first["value"]), (&json!("Properties"), &parameters()));
        heard_by(&peer, 1)?;
        sets(env, &node, &json!({"gain": 2.5, "lens": {"label": "right"}, "ids": []}), 0)?;
        let now = watcher.wait_until("what was set", |output| {
            let now = told(output);
            (now["lens.label"] == "right" && now["ids"] == json!([])).then_some(now)
        })?;
        assert_eq!(now["gain"], 2.5, "{now}");
        let own = r#"{"gain": null, "new": true}"#;
        peer.tell(own).map_err(|e| e.context(peer.tail()))?;
        watcher.wait_until("what the node did", |output| {
            let now = told(output);
            (now["gain"].is_null() && now["new"] == true).then_some(())
        })?;
        // A parameter that the node refuses is reported in the node's words, and the rest is set.
        let refused = sets(env, &node, &json!({"rate": 61, "serial": "B2", "new": false}), 1)?;
        let said = refused.stderr();
        for words in [
            "refused 2 of 3 parameters",
            "rate: Parameter rate out of range. Min: 1, Max: 60, value: 61",
            "serial: Trying to set a read-only parameter: serial.",
        ] {
            assert!(said.contains(words), "{said}");
        }
        watcher.wait_until("what was set beside it", |output| {
            (told(output)["new"] == false).then_some(())
        })?;
        let wrong = sets(env, &node, &json!({"rate": 2.5}), 1)?.stderr();
        assert!(wrong.contains("expected 'Type.INTEGER' got 'Type.DOUBLE'"), "{wrong}");
        // After a restart what vanished is told too.
        drop(peer);
        let _again = camera(env, &node, &json!({"rate": 20, "serial": "A1"}))?;
        watcher.wait_until("the parameters after the restart", |output| {
            let now = told(output);
            let gone = ["lens.label", "ids", "new"].iter().all(|name| now[name].is_null());
            (gone && now["rate"] == 20 && now["serial"] == "A1").then_some(())
        })?;
        Ok(())
    })
}

#[test]
fn a_node_that_is_not_there_is_named() -> Result {
    run("a_node_that_is_not_there_is_named", &[Need::Program], |env| {
        let node = env.topic("nobody");
        let mut process = set(env, &rmw(), &node, &json!({"a": 1}), &["--timeout", "0.2"])?;
        process.exits_with(3)?;
        let said = process.stderr();
        assert!(said.contains(&format!("time-out while waiting for node {node}")), "{said}");
        let mut process = echo(env, &rmw(), &node, &["--timeout", "0.2"])?;
        process.exits_with(3)?;
        let said = process.stderr();
        assert!(said.contains(&format!("still waiting for node {node}")), "{said}");
        let mut process = set(env, &rmw(), &node, &json!({"a": [1, "x"]}), &[])?;
        process.exits_with(2)?;
        let said = process.stderr();
        assert!(said.contains("parameter \"a\": a list holds values of one type"), "{said}");
        Ok(())
    })
}

#[test]
fn scripts_of_wrapyfi_hear_and_set_parameters() -> Result {
    run("scripts_of_wrapyfi_hear_and_set_parameters", NEEDS, |env| {
        let (node, params, wish) = (env.topic("camera"), env.topic("p"), env.topic("w"));
        let (endpoint, out) = (format!("ros2:{node}"), format!("zeromq:{params}"));
        let bridge = env.bridge(
            &env.embedded().route(Route::new(&endpoint, &out, "Properties")).route(Route::new(
                &format!("zeromq:{wish}"),
                &endpoint,
                "Properties",
            )),
        )?;
        let peer = camera(env, &node, &parameters())?;
        // However late the script comes, it begins with all of them.
        heard_by(&peer, 1)?;
        let script = env.wrapyfi_listener(&params, "")?;
        let first = script.messages(1).map_err(|e| e.context(bridge.tail()))?.remove(0);
        assert_eq!(first["value"], parameters());
        let wishes = env.wrapyfi_publisher(&wish, "--flavour settings --no-broker")?;
        let label = |value: &Value| value.as_str().is_some_and(|text| text.starts_with("take "));
        peer.wait_until("what the script sets", |output| {
            output.events("set").into_iter().find(|set| label(&set["value"]))
        })
        .map_err(|e| e.context(format!("{}\n{}", bridge.tail(), wishes.tail())))?;
        script.wait_until("what the node made of it", |output| {
            output.events("message").into_iter().find(|m| label(&m["value"]["lens.label"]))
        })?;
        Ok(())
    })
}

#[test]
fn refusals_of_a_route_are_counted_with_the_reason() -> Result {
    run("refusals_of_a_route_are_counted_with_the_reason", NEEDS, |env| {
        let (node, wish) = (env.topic("camera"), env.topic("w"));
        let bridge = env.bridge(&env.embedded().route(Route::new(
            &format!("zeromq:{wish}"),
            &format!("ros2:{node}"),
            "Properties",
        )))?;
        let _peer = camera(env, &node, &json!({"gain": "text"}))?;
        let _wishes = env.wrapyfi_publisher(&wish, "--flavour settings --no-broker")?;
        bridge.wait_until("the count", |output| {
            let status = output.objects().next_back()?;
            status["routes"][0]["counters"]["drops"]["refused"].as_u64()
        })?;
        bridge.wait_until("the reason", |output| {
            let words = "gain: Wrong parameter type, expected 'Type.STRING' got 'Type.DOUBLE'";
            output.err.iter().any(|line| line.contains(words)).then_some(())
        })?;
        Ok(())
    })
}

/// The bridge's own parameters, by programs that speak as `rmw` does.
fn between_own_nodes(env: &TestEnv, rmw: &str) -> Result {
    let config = env.embedded().route(Route::new("zeromq:/a", "ros2:/b", "Image"));
    let file = env.write("bridge.yaml", config.yaml())?.display().to_string();
    let _bridge = env.wrapyfi_as(rmw, ["bridge", "--config", &file])?;
    let watcher = echo(env, rmw, "/wrapyfi_bridge", &["--timeout", "100"])?;
    let first = watcher.objects(1)?.remove(0);
    assert_eq!(first["value"]["use_sim_time"], false, "{first}");
    let mut process =
        set(env, rmw, "/wrapyfi_bridge", &json!({"use_sim_time": true}), &["--timeout", "60"])?;
    process.exits_with(0)?;
    let mut process = echo(env, rmw, "/wrapyfi_bridge", &["--timeout", "100", "--count", "1"])?;
    process.exits_with(0)?;
    assert_eq!(process.objects(1)?[0]["value"]["use_sim_time"], true);
    let name = "start_type_description_service";
    let mut process =
        set(env, rmw, "/wrapyfi_bridge", &json!({name: false}), &["--timeout", "60"])?;
    process.exits_with(1)?;
    let said = process.stderr();
    let words = format!("{name}: Trying to set a read-only parameter: {name}.");
    assert!(said.contains(&words), "{said}");
    Ok(())
}

#[test]
fn our_own_nodes() -> Result {
    run("our_own_nodes", &[Need::Program], |env| between_own_nodes(env, &rmw()))
}

#[test]
fn our_own_nodes_as_of_fast_dds() -> Result {
    run("our_own_nodes_as_of_fast_dds", &[Need::Program], |env| between_own_nodes(env, FAST))
}

/// A method registered under `Properties`, in two programs: one is told, one sets.
#[test]
fn registered_methods_read_and_set_a_node() -> Result {
    const NEEDS: &[Need] = &[Need::Program, Need::Python, Need::Example("exchange")];
    run("registered_methods_read_and_set_a_node", NEEDS, |env| {
        let node = env.topic("camera");
        let start = |mode: &str| {
            let args = format!("--type Properties --mode {mode} --mware ros2 --topic {node}");
            env.example("exchange", &args)
        };
        let listener = start("listen")?;
        let peer = camera(env, &node, &json!({"gain": 0.25, "serial": "A1"}))?;
        let first = listener.messages(1)?.remove(0);
        assert_eq!(first["value"], json!({"gain": 0.25, "serial": "A1"}));
        heard_by(&peer, 1)?;
        let _setter = start("publish")?;
        listener.wait_until("what the other method set", |output| {
            let gains = output.events("message").into_iter();
            gains.map(|told| told["value"]["gain"].clone()).find(|gain| *gain == 3.5).map(drop)
        })
    })
}
