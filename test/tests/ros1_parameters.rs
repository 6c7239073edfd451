//! Parameters of ROS 1 as nodes of ROS 2 have theirs: those of dynamic_reconfigure, and those of the parameter server.

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Process, RealRos2, Result, TestEnv, asked_until, ros1, run};

const NEEDS: &[Need] = &[Need::Program, Need::Ros1, Need::Reconfigure];
const ON_KILTED: &[Need] =
    &[Need::Program, Need::Ros1, Need::Reconfigure, Need::Python, Need::Kilted];

/// Answer of a service of the parameters, asked on ROS 1's side.
fn call(env: &TestEnv, node: &str, service: &str, request: &Value) -> Result<Value> {
    let (at, request) = (ros1(&format!("{node}/{service}")), request.to_string());
    let call = ["call", &at, "--json", "--timeout", "100", "--kwargs", &request];
    let mut call = env.wrapyfi(call)?;
    let answer = call.objects(1).map_err(|error| error.context(call.tail()))?.remove(0);
    call.exits_with(0)?;
    Ok(answer["value"].clone())
}

fn names(env: &TestEnv, node: &str) -> Result<Vec<String>> {
    let answer = call(env, node, "list_parameters", &json!({}))?;
    Ok(serde_json::from_value(answer["result"]["names"].clone())?)
}

/// `{"name": …, "value": {"type": …}}` for `ros2 param set`.
fn parameter(name: &str, kind: u8, field: &str, value: &Value) -> Value {
    json!({"name": name, "value": {"type": kind, field: value}})
}

fn set(env: &TestEnv, node: &str, parameters: &[Value]) -> Result<Vec<(bool, String)>> {
    let answer = call(env, node, "set_parameters", &json!({"parameters": parameters}))?;
    let results = answer["results"].as_array().cloned().unwrap_or_default();
    let result = |it: Value| {
        Ok((it["successful"] == true, it["reason"].as_str().unwrap_or_default().to_owned()))
    };
    results.into_iter().map(result).collect()
}

/// Waits until a line of its log has these words.
fn says(process: &Process, words: &str) -> Result {
    process.wait_until(words, |output| {
        output.err.iter().any(|line| line.contains(words)).then_some(())
    })
}

/// Values of a client of dynamic_reconfigure, once they are as wanted.
fn told(client: &Process, what: &str, wanted: impl Fn(&Value) -> bool) -> Result<Value> {
    client.wait_until(what, |output| {
        let last = output.events("config").pop()?["value"].clone();
        wanted(&last).then_some(last)
    })
}

#[test]
fn a_server_of_dynamic_reconfigure_is_described_and_set() -> Result {
    run("a_server_of_dynamic_reconfigure_is_described_and_set", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let server = env.topic("tool/settings");
        let peer = env.reconfigure(&format!("serve --server {server}"))?;
        peer.event("ready")?;
        let all = names(env, &server)?;
        for name in ["int_", "double_", "str_", "bool_", "int_enum_", "group2_double"] {
            assert!(all.iter().any(|it| it == name), "{all:?}");
        }
        let asked =
            json!({"names": ["int_", "double_", "int_enum_", "group2_double", "double_no_minmax"]});
        let said = call(env, &server, "describe_parameters", &asked)?;
        let [int, double, choice, grouped, free] =
            [0, 1, 2, 3, 4].map(|at| &said["descriptors"][at]);
        assert_eq!(
            (&int["type"], &int["integer_range"][0]["from_value"]),
            (&json!(2), &json!(-10))
        );
        assert_eq!(int["integer_range"][0]["to_value"], 10);
        assert!(int["description"].as_str().is_some_and(|it| it.contains("level 1")), "{int}");
        assert_eq!(double["floating_point_range"][0]["to_value"], 10.0);
        let constraints = choice["additional_constraints"].as_str().unwrap_or_default();
        assert!(
            constraints.starts_with("one of 0 (Small: A small constant), 1 (Medium"),
            "{choice}"
        );
        assert!(
            grouped["description"].as_str().is_some_and(|it| it.contains("group Group_One/GROUP2")),
            "{grouped}"
        );
        assert_eq!(free["floating_point_range"], json!([]), "{free}");
        // The server makes it odd, and each of the others is set beside those that are refused.
        let results = set(
            env,
            &server,
            &[
                parameter("int_", 2, "integer_value", &json!(4)),
                parameter("double_", 3, "double_value", &json!(99.0)),
                parameter("int_enum_", 2, "integer_value", &json!(2)),
                parameter("nothing", 2, "integer_value", &json!(2)),
                parameter("bool_", 4, "string_value", &json!("yes")),
            ],
        )?;
        let successful: Vec<bool> = results.iter().map(|(it, _)| *it).collect();
        assert_eq!(successful, [true, false, true, false, false], "{results:?}");
        for (at, words) in [
            (0, "made 5 of 4"),
            (1, "out of range Min: -2.0, Max: 10.0"),
            (4, "expected 'Type.BOOL'"),
        ] {
            assert!(results[at].1.contains(words), "{results:?}");
        }
        told(&peer, "what was set", |now| now["int_"] == 5 && now["int_enum_"] == 2)?;
        let got = call(env, &server, "get_parameters", &json!({"names": ["int_"]}))?;
        assert_eq!(got["values"][0]["integer_value"], 5);
        // Its own refusal, and an enum.
        let refused = set(env, &server, &[parameter("str_", 4, "string_value", &json!("no"))])?;
        assert!(!refused[0].0 && refused[0].1.contains("str_ is never no"), "{refused:?}");
        let small = [
            parameter("int_enum_", 2, "integer_value", &json!(3)),
            parameter("bool_", 1, "bool_value", &json!(true)),
        ];
        let answer =
            call(env, &server, "set_parameters_atomically", &json!({"parameters": small}))?;
        assert_eq!(answer["result"]["successful"], true, "{answer}");
        told(&peer, "what was set at once", |now| now["bool_"] == true && now["int_enum_"] == 3)?;
        Ok(())
    })
}

#[test]
fn what_a_server_lies_about_is_said_and_the_rest_is_there() -> Result {
    run("what_a_server_lies_about_is_said_and_the_rest_is_there", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let server = env.topic("liar");
        let peer = env.reconfigure(&format!("lie --server {server} --count 10000"))?;
        peer.event("ready")?;
        let listen = ros1(&format!("{server}/parameter_events"));
        let echo = env.wrapyfi([
            "echo",
            &listen,
            "--json",
            "--type",
            "rcl_interfaces/msg/ParameterEvent",
        ])?;
        let first = echo.objects(1)?.remove(0);
        let count = first["value"]["new_parameters"].as_array().map(Vec::len);
        assert_eq!(count, Some(4096), "{}", echo.tail());
        for words in [
            "\"turned\" has no range: its minimum is 9, its maximum 5",
            "the enum of parameter \"unreadable\" is not readable",
            "\"odd\" has type \"complex\"",
            "a node has at most 4096",
            "more faults",
        ] {
            says(&echo, words)?;
        }
        let lines = echo.stderr().lines().count();
        assert!(lines < 200, "{lines} lines: one for each fault, then their number");
        Ok(())
    })
}

#[test]
fn a_namespace_of_the_parameter_server_is_followed() -> Result {
    run("a_namespace_of_the_parameter_server_is_followed", NEEDS, |env| {
        let _roscore = env.roscore()?;
        // rospy has no namespaces in the names of nodes.
        let name = env.topic("camera").trim_start_matches('/').replace('/', "_");
        let node = format!("/{name}");
        let put = |key: &str, value: &str| -> Result {
            let key = format!("{node}/{key}");
            let setter = env.rospy(&format!("param --topic {key} --node setter"), Some(value))?;
            setter.event("ready").map(drop)
        };
        put("rate", "30")?;
        put("lens/label", "\"left\"")?;
        put("mixed", "[1, \"a\"]")?;
        let _camera = env
            .rospy(&format!("publish --topic {node}_x --node {name}"), Some(r#"{"data": "x"}"#))?;
        let listen = ros1(&format!("{node}/parameter_events"));
        let echo = env.wrapyfi([
            "echo",
            &listen,
            "--json",
            "--type",
            "rcl_interfaces/msg/ParameterEvent",
        ])?;
        let first = echo.objects(1)?.remove(0);
        let new = first["value"]["new_parameters"].as_array().cloned().unwrap_or_default();
        let mut names: Vec<&str> = new.iter().filter_map(|it| it["name"].as_str()).collect();
        names.sort_unstable();
        assert_eq!(names, ["lens.label", "rate"]);
        says(&echo, "\"mixed\"")?;
        // A key that comes, one that changes, and one that goes.
        put("gain", "2.5")?;
        put("rate", "15")?;
        echo.wait_until("both changes", |output| {
            let told = |list: &str, name: &str| {
                output.objects().any(|it| it["value"][list][0]["name"] == name)
            };
            (told("new_parameters", "gain") && told("changed_parameters", "rate")).then_some(())
        })?;
        let results = set(
            env,
            &node,
            &[
                parameter("rate", 2, "integer_value", &json!(20)),
                parameter("lens.label", 0, "string_value", &json!("")),
                parameter("typo", 2, "integer_value", &json!(20)),
            ],
        )?;
        let successful: Vec<bool> = results.iter().map(|(it, _)| *it).collect();
        assert_eq!(successful, [true, true, false], "{results:?}");
        echo.wait_until("what was set from ROS 2", |output| {
            let rate = output.objects().any(|it| {
                let changed = &it["value"]["changed_parameters"][0];
                changed["name"] == "rate" && changed["value"]["integer_value"] == 20
            });
            let gone = output
                .objects()
                .any(|it| it["value"]["deleted_parameters"][0]["name"] == "lens.label");
            (rate && gone).then_some(())
        })?;
        // What a server of dynamic_reconfigure has left there is set at the server alone.
        let server = env.reconfigure(&format!("serve --server {node}/planner"))?;
        server.event("ready")?;
        echo.wait_until("its values", |output| {
            let new = |it: &Value| it["value"]["new_parameters"].as_array().cloned();
            let mut all = output.objects().filter_map(|it| new(&it)).flatten();
            all.any(|it| it["name"] == "planner.int_").then_some(())
        })?;
        let limit = [parameter("planner.int_", 2, "integer_value", &json!(4000))];
        let refused = set(env, &node, &limit)?;
        let words = format!("the dynamic_reconfigure server {node}/planner ");
        assert!(!refused[0].0 && refused[0].1.contains(&words), "{refused:?}");
        Ok(())
    })
}

/// A node of rclpy, which asks for a node before it asks for its services.
#[test]
fn a_server_of_dynamic_reconfigure_is_a_node_of_ros_2() -> Result {
    run("a_server_of_dynamic_reconfigure_is_a_node_of_ros_2", ON_KILTED, |env| {
        let ros = RealRos2::kilted(env)?;
        let _roscore = env.roscore()?;
        env.set_variable("RMW_IMPLEMENTATION", "");
        let server = env.topic("tool/settings");
        let serve = format!("serve --server {server}");
        let peer = env.reconfigure(&serve)?;
        peer.event("ready")?;
        let bridge = env.executable("ros1_bridge", &["-p", "status_json:=true"])?;
        let steps = json!([
            ["list"],
            ["describe", "int_", "int_enum_"],
            ["set", {"int_": 4}],
            ["get", "int_", "double_no_minmax"],
            ["set", {"int_enum_": 9}],
            ["load", {"bool_": true, "double_": 2.5}],
        ]);
        let client = ros.rclpy_parameters(&format!("--node {server}"), Some(&steps.to_string()))?;
        let loaded = client.event("load").map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(loaded["value"], json!([[true, ""]]));
        let value = |event: &str| client.event(event).map(|it| it["value"].clone());
        let list = value("list")?;
        assert!(list.as_array().is_some_and(|all| all.contains(&json!("deep_var_int"))), "{list}");
        let described = value("describe")?;
        assert_eq!(described["int_"]["range"], json!([[-10, 10]]));
        assert!(
            described["int_enum_"]["constraints"]
                .as_str()
                .is_some_and(|it| it.contains("ExtraLarge")),
            "{described}"
        );
        let said = client.wait_until("both answers", |output| {
            let all = output.events("set");
            (all.len() == 2).then_some(all)
        })?;
        assert_eq!(said[0]["value"][0][0], true, "{said:?}");
        assert_eq!(said[1]["value"][0][0], false, "{said:?}");
        assert_eq!(value("get")?, json!([5, 1.0]));
        // Its events, of what was set here and of what is on ROS 1's side.
        let changed = |what: &str, name: &str, wanted: Value| {
            client.wait_until(what, |output| {
                let all = output.events("changed");
                all.iter().any(|it| it["value"][name] == wanted).then_some(())
            })
        };
        changed("what it was made", "int_", json!(5))?;
        let mut rqt =
            env.reconfigure(&format!(r#"set --server {server} --value {{"double_":-1.5}}"#))?;
        rqt.exits_with(0)?;
        changed("what rqt has set", "double_", json!(-1.5))?;
        // It goes, and comes back.
        let gone = ros.rclpy_parameters(&format!("--node {server} --gone"), None)?;
        gone.event("ready")?;
        drop(peer);
        gone.event("gone").map_err(|error| error.context(bridge.tail()))?;
        let again = env.reconfigure(&serve)?;
        again.event("ready")?;
        let steps = r#"[["get", "int_"]]"#;
        let client = ros.rclpy_parameters(&format!("--node {server}"), Some(steps))?;
        let got = client.event("get").map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(got["value"], json!([5]), "kept on the parameter server");
        Ok(())
    })
}

/// The same node for the commands of this package.
#[test]
fn properties_of_a_server_are_echoed_and_set_on_ros_2() -> Result {
    let needs = [NEEDS, &[Need::Python]].concat();
    run("properties_of_a_server_are_echoed_and_set_on_ros_2", &needs, |env| {
        let _roscore = env.roscore()?;
        let server = env.topic("base/planner");
        let peer = env.reconfigure(&format!("serve --server {server}"))?;
        peer.event("ready")?;
        let bridge = env.executable("ros1_bridge", &["-p", "prefix:=/lab"])?;
        let at = format!("ros2:/lab{server}");
        let properties = ["--type", "Properties", "--timeout", "100"];
        let echo = env.wrapyfi([&["echo", &at, "--json"], &properties[..]].concat())?;
        let first = echo.objects(1).map_err(|error| error.context(bridge.tail()))?.remove(0);
        assert_eq!(first["value"]["double_no_max"], 2.0, "{first}");
        let mut set =
            env.wrapyfi([&["pub", &at, "--value", r#"{"int_": 6}"#], &properties[..]].concat())?;
        set.exits_with(0)?;
        echo.wait_until("the change, by the name of the node on ROS 2", |output| {
            output.objects().any(|it| it["value"]["int_"] == 7).then_some(())
        })?;
        let wrong = [&["pub", &at, "--value", r#"{"int_": 60}"#], &properties[..]].concat();
        let mut wrong = env.wrapyfi(wrong)?;
        wrong.exits_with(1)?;
        let said = wrong.stderr();
        assert!(
            said.contains("Parameter int_ out of range. Min: -10, Max: 10, value: 60"),
            "{said}"
        );
        asked_until("the node in the list", || {
            let mut list = env.wrapyfi(["list", "ros2", "--json"])?;
            list.exit_code()?;
            Ok(list.stdout().contains(&format!("\"/lab{server}\"")).then_some(()))
        })
    })
}
