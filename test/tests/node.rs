//! The node executable as `ros2 run` starts it: ROS arguments decide name, namespace, topics and parameters.

use serde_json::Value;
use wrapyfi_e2e::{Need, Output, Result, Route, TestEnv, ros2, run, texts};

const NEEDS: &[Need] = &[Need::Program, Need::Python];
const NEEDS_ALL: &[Need] = &[Need::Program, Need::Python];

fn node_named(output: &Output, name: &str) -> Option<Value> {
    let samples = output.events("nodes");
    let mut found = samples.iter().rev().flat_map(|s| s["nodes"].as_array().into_iter().flatten());
    found.find(|node| node["name"] == name).cloned()
}

#[test]
fn name_and_namespace_come_from_the_command_line() -> Result {
    run("name_and_namespace_come_from_the_command_line", NEEDS, |env| {
        let graph = env.graph()?;
        let route = Route::new("zeromq:/a", &format!("ros2:{}", env.topic("to")), "Image");
        let mut node = env.node_with(
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
    run("topics_are_remapped", NEEDS, |env| {
        let (from, cam, front) = (env.topic("from"), env.topic("cam"), env.topic("front"));
        let route = Route::new(&format!("zeromq:{from}"), &format!("ros2:{cam}"), "Image");
        let node = env.node_with(vec![route], &["-r", &format!("{cam}:={front}")])?;
        let subscriber = env.dds_subscriber(&front, "sensor_msgs/msg/Image", "--count 2")?;
        let publisher =
            env.wrapyfi_publisher(&from, "--type Image --flavour colour --no-broker")?;
        let heard = subscriber.messages(2).map_err(|e| e.context(node.tail()))?;
        publisher.sent_in_a_row("sha256", &texts(&heard, "sha256"))
    })
}

#[test]
fn relative_topics_are_in_the_nodes_namespace() -> Result {
    run("relative_topics_are_in_the_nodes_namespace", NEEDS, |env| {
        let (from, namespace) = (env.topic("from"), env.topic("lab"));
        let route = Route::new(&format!("zeromq:{from}"), "ros2:cam", "Image");
        let node = env.node_with(vec![route], &["-r", &format!("__ns:={namespace}")])?;
        let subscriber =
            env.dds_subscriber(&format!("{namespace}/cam"), "sensor_msgs/msg/Image", "--count 1")?;
        let publisher =
            env.wrapyfi_publisher(&from, "--type Image --flavour colour --no-broker")?;
        let heard = subscriber.messages(1).map_err(|e| e.context(node.tail()))?;
        publisher.sent_in_a_row("sha256", &texts(&heard, "sha256"))
    })
}

/// The value of the reply to a call of one of the node's own services.
fn asked(env: &TestEnv, service: &str, kind: &str, request: &str) -> Result<Value> {
    let endpoint = format!("ros2:{service}");
    let words = ["call", &endpoint, "--type", kind, "--value", request, "--json"];
    let mut call = env.wrapyfi([&words[..], &["--timeout", "60"]].concat())?;
    call.exits_with(0)?;
    Ok(call.objects(1)?[0]["value"].clone())
}

#[test]
fn parameters_types_and_log_are_on_the_graph() -> Result {
    run("parameters_types_and_log_are_on_the_graph", &[Need::Program], |env| {
        let namespace = env.topic("lab");
        let route = Route::new("zeromq:/a", "ros2:cam", "Image");
        let ns = format!("__ns:={namespace}");
        let mut node = env.node_with(vec![route], &["-r", &ns, "-r", "__node:=eye"])?;
        let own = |service: &str| format!("{namespace}/eye/{service}");
        let request = r#"{"names": ["status_json", "config_file"]}"#;
        let kind = "rcl_interfaces/srv/GetParameters";
        let got = asked(env, &own("get_parameters"), kind, request)
            .map_err(|e| e.context(node.tail()))?;
        assert_eq!(got["values"][0]["bool_value"], false);
        let file = got["values"][1]["string_value"].as_str().unwrap_or_default();
        assert!(file.ends_with("bridge.yaml"), "{got}");

        let request = r#"{"parameters": [{"name": "config_file", "value": {"type": 4}}]}"#;
        let kind = "rcl_interfaces/srv/SetParameters";
        let set = asked(env, &own("set_parameters"), kind, request)?;
        let refused = "Trying to set a read-only parameter: config_file.";
        assert_eq!(set["results"][0]["reason"], refused);

        let hash = "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47";
        let request = format!(r#"{{"type_name": "sensor_msgs/msg/Image", "type_hash": "{hash}"}}"#);
        let kind = "type_description_interfaces/srv/GetTypeDescription";
        let described = asked(env, &own("get_type_description"), kind, &request)?;
        assert_eq!(described["successful"], true, "{described}");

        // Said before the test listened.
        let mut log = env.wrapyfi(["echo", "ros2:/rosout", "--count", "1", "--json"])?;
        log.exits_with(0)?;
        let line = log.objects(1)?[0]["value"].clone();
        let logger = format!("{}.eye", namespace.trim_start_matches('/').replace('/', "."));
        assert!(line["name"].as_str().unwrap_or_default().starts_with(&logger), "{line}");
        assert_eq!(line["level"], 20, "{line}");
        node.terminate()?;
        node.exits_with(0)
    })
}

#[test]
fn only_what_a_node_has_is_among_its_parameters() -> Result {
    run("only_what_a_node_has_is_among_its_parameters", &[Need::Program], |env| {
        let routes = (0..4).map(|n| Route::new("zeromq:/a", &format!("ros2:/cam{n}"), "Image"));
        let depth = "qos_overrides./cam2.publisher.depth:=3";
        let _node = env.node_with(routes.collect(), &["-p", depth])?;
        let kind = "rcl_interfaces/srv/ListParameters";
        let listed = asked(env, "/wrapyfi_bridge/list_parameters", kind, "{}")?;
        let names = listed["result"]["names"].as_array().into_iter().flatten();
        let names: Vec<&str> = names.filter_map(Value::as_str).collect();
        let (of_topics, own): (Vec<&str>, Vec<&str>) =
            names.into_iter().partition(|name| name.starts_with("qos_overrides."));
        let expected = [
            "use_sim_time",
            "start_type_description_service",
            "config_file",
            "seconds",
            "status_json",
            "autostart",
            "page_port",
            "endpoints.zeromq.ip",
            "endpoints.zeromq.pub_port",
            "endpoints.zeromq.sub_port",
        ];
        assert_eq!(own, expected);
        assert_eq!(of_topics.len(), 8, "{of_topics:?}");
        let mut of_topics = of_topics.iter();
        assert!(of_topics.all(|name| name.starts_with("qos_overrides./cam2.publisher.")));
        Ok(())
    })
}

#[test]
fn levels_of_loggers_are_read_and_set() -> Result {
    run("levels_of_loggers_are_read_and_set", NEEDS_ALL, |env| {
        let namespace = env.topic("lab");
        let route = |name: &str, from: &str| {
            Route::new(&format!("zeromq:/{from}"), "ros2:cam", "Image")
                .with("name", name)
                .with("merge", "true")
        };
        let ns = format!("__ns:={namespace}");
        let node = format!("{}.eye", namespace.trim_start_matches('/').replace('/', "."));
        let quiet = format!("{node}.right_eye:=error");
        let eye = env.node_with(
            vec![route("\"left: eye\"", "a"), route("right eye", "b")],
            &["-r", &ns, "-r", "__node:=eye", "--log-level", &quiet],
        )?;
        // Lines about a route are of the route's logger, in a name that tools can write.
        let left = format!("{node}.left_eye");
        eye.wait_until("a line of the first route", |output| {
            output.err.iter().any(|line| line.contains(&format!("[{left}]: "))).then_some(())
        })?;
        let own = |service: &str| format!("{namespace}/eye/{service}");
        let get = "rcl_interfaces/srv/GetLoggerLevels";
        let names = format!(r#"{{"names": ["{node}", "{node}.right_eye", "x"]}}"#);
        let levels = |got: &Value| -> Vec<u64> {
            let levels = got["levels"].as_array().into_iter().flatten();
            levels.filter_map(|one| one["level"].as_u64()).collect()
        };
        let got = asked(env, &own("get_logger_levels"), get, &names)?;
        assert_eq!(levels(&got), [0, 40, 0], "{got}");
        assert!(!eye.stderr().contains(&format!("[{node}.right_eye]: ")), "{}", eye.stderr());
        assert!(!eye.stderr().contains("[DEBUG]"), "{}", eye.stderr());

        let set = "rcl_interfaces/srv/SetLoggerLevels";
        let level = |name: &str, level: u8| format!(r#"{{"name": "{name}", "level": {level}}}"#);
        let right = format!("{node}.right_eye");
        let wanted = [level(&node, 10), level(&right, 20), level(&node, 11)].join(", ");
        let done =
            asked(env, &own("set_logger_levels"), set, &format!(r#"{{"levels": [{wanted}]}}"#))?;
        let done = done["results"].as_array().into_iter().flatten();
        let done: Vec<bool> = done.filter_map(|one| one["successful"].as_bool()).collect();
        assert_eq!(done, [true, true, false]);
        let got = asked(env, &own("get_logger_levels"), get, &names)?;
        assert_eq!(levels(&got), [10, 20, 0], "{got}");
        // The change of a level is a line for debugging; a subscriber that asks for more than is offered
        // at first changes the quality of service of both routes.
        let cam = format!("{namespace}/cam");
        let _late = env.dds_subscriber(&cam, "sensor_msgs/msg/Image", "--transient-local")?;
        for start in ["[DEBUG]", "[INFO]"] {
            eye.wait_until(&format!("a line that begins with {start}"), |output| {
                let logger = if start == "[DEBUG]" { &node } else { &right };
                let words = format!("[{logger}]: ");
                let mut lines = output.err.iter();
                lines.any(|line| line.starts_with(start) && line.contains(&words)).then_some(())
            })?;
        }
        Ok(())
    })
}

#[test]
fn node_executables_know_help_and_config() -> Result {
    run("node_executables_know_help_and_config", NEEDS_ALL, |env| {
        for name in ["bridge", "ros1_bridge", "yarp_bridge", "zeromq_bridge"] {
            let mut help = env.executable(name, &["--", "--help"])?;
            help.exits_with(0)?;
            let said = help.stdout();
            for word in [name, "--config", "--ros-args"] {
                assert!(said.contains(word), "{name} --help does not say {word}:\n{said}");
            }
        }
        let graph = env.graph()?;
        let config = env.embedded().route(Route::new("zeromq:/a", "ros2:cam", "Image"));
        let file = env.write("routes.yaml", config.yaml())?.display().to_string();
        let remaps = ["-r", "__ns:=/lab", "-r", "__node:=eye"];
        let as_node = [&["--config", &file, "--ros-args"][..], &remaps].concat();
        // The same with the command: it is a node and logs as one.
        for (n, mut node) in
            [env.node(&as_node)?, env.wrapyfi([&["bridge"][..], &as_node].concat())?.pillar()]
                .into_iter()
                .enumerate()
        {
            graph.wait_until("node /lab/eye", |output| node_named(output, "/lab/eye"))?;
            node.wait_until("its log", |output| {
                output.err.iter().any(|line| line.contains("[lab.eye]: 1 routes")).then_some(())
            })
            .map_err(|e| e.context(format!("start {n}")))?;
            node.terminate()?;
            node.exits_with(0)?;
        }
        let mut both = env.node([&as_node[..], &["-p", "config_file:=other.yaml"]].concat())?;
        both.exits_with(2)?;
        assert!(both.stderr().contains("--config says"), "{}", both.stderr());
        Ok(())
    })
}

#[test]
fn bad_ros_arguments_are_refused() -> Result {
    run("bad_ros_arguments_are_refused", &[Need::Program], |env| {
        for args in [
            &["--ros-args", "-r", "nonsense"][..],
            &["--ros-args", "-p", "config_file:=no_such_file.yaml"],
        ] {
            let mut node = env.node(args)?;
            let code = node.exit_code()?;
            assert!([1, 2].contains(&code), "exit code {code}\n{}", node.tail());
            let said = node.stderr();
            assert!(said.contains("nonsense") || said.contains("no_such_file.yaml"), "{said}");
            assert!(!said.contains("panicked"), "{said}");
        }
        Ok(())
    })
}

/// CycloneDDS inside the program has no security: a node that has to have it does not run without.
#[test]
fn security_is_refused_or_warned_of_where_there_is_none() -> Result {
    run("security_is_refused_or_warned_of_where_there_is_none", NEEDS, |env| {
        env.set_variable("ROS_SECURITY_ENABLE", "true");
        env.set_variable("WRAPYFI_ROS2_GRAPH", "cyclone");
        let route = || Route::new("zeromq:/a", &format!("ros2:{}", env.topic("to")), "Image");
        let mut open = env.node_with(vec![route()], &[])?;
        open.wait_until("the warning", |output| {
            output
                .err
                .iter()
                .any(|line| line.contains("ROS_SECURITY_ENABLE=true has no effect"))
                .then_some(())
        })?;
        open.terminate()?;
        open.exits_with(0)?;
        env.set_variable("ROS_SECURITY_ENABLE", "false");
        let mut named = env.node_with(vec![route()], &["--enclave", "/lab"])?;
        named.wait_until("the warning", |output| {
            output.err.iter().any(|line| line.contains("/lab has no effect")).then_some(())
        })?;
        named.terminate()?;
        named.exits_with(0)?;
        env.set_variable("ROS_SECURITY_ENABLE", "true");
        env.set_variable("ROS_SECURITY_STRATEGY", "Enforce");
        let mut enforced = env.node_with(vec![route()], &[])?;
        enforced.exits_with(2)?;
        let said = enforced.tail();
        assert!(said.contains("ROS_SECURITY_STRATEGY=Enforce"), "{said}");
        Ok(())
    })
}

/// As any other setting that the program cannot have.
#[test]
fn a_configuration_of_cyclonedds_that_it_refuses_is_bad_usage() -> Result {
    run("a_configuration_of_cyclonedds_that_it_refuses_is_bad_usage", &[Need::Program], |env| {
        env.set_variable("WRAPYFI_ROS2_GRAPH", "cyclone");
        env.set_variable("CYCLONEDDS_URI", "<CycloneDDS><Domain><Nonsense/></Domain></CycloneDDS>");
        let mut echo = env.wrapyfi(["echo", &ros2(&env.topic("x")), "--type", "Text"])?;
        echo.exits_with(2)?;
        assert!(echo.stderr().contains("CYCLONEDDS_URI"), "{}", echo.stderr());
        Ok(())
    })
}
