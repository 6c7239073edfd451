//! Commands from ROS 2 to a robot on YARP while `yarp_bridge` runs as it is: to input ports, and by
//! calls to rpc ports. The robot is ours; `real_yarp.rs` has one of YARP's.

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Output, Process, Result, Route, TestEnv, ros2, run, yarp};

const NEEDS: &[Need] = &[Need::Program];

/// An input port of this name that prints what it is told.
fn input_port(env: &TestEnv, port: &str) -> Result<Process> {
    let (endpoint, own) = (yarp(&env.topic("nobody")), format!("port={port}"));
    let (kind, form) = (["--type", "NativeObject"], ["--option", "bottle=true", "--json"]);
    let own = ["--option", &own];
    env.wrapyfi([&["echo", &endpoint], &kind[..], &own[..], &form[..]].concat())
}

fn publisher(env: &TestEnv, topic: &str, kind: &str, value: &str) -> Result<Process> {
    let endpoint = ros2(topic);
    env.wrapyfi(["pub", &endpoint, "--type", kind, "--value", value, "--rate", "10"])
}

/// Waits for the first message, which must be this.
fn hears(port: &Process, wanted: &Value, bridge: &Process) -> Result {
    let heard = port.objects(1).map_err(|error| error.context(bridge.tail()))?;
    assert_eq!(heard[0]["value"], *wanted, "{heard:?}");
    Ok(())
}

#[test]
fn topics_named_like_an_input_port_are_written_to_it() -> Result {
    run("topics_named_like_an_input_port_are_written_to_it", NEEDS, |env| {
        let _names = env.yarpserver()?;
        let head = env.topic("head");
        let (command, emotion) = (format!("{head}/command:i"), format!("{head}/emotion/in"));
        let robot = [input_port(env, &command)?, input_port(env, &emotion)?];
        let bridge = env.executable("yarp_bridge", &[])?;
        let (angles, words) = (json!([1.0, 2.5]), json!(["set", "mou", "sur"]));
        let topic = format!("{head}/command/i");
        let (array, data) = ("std_msgs/msg/Float64MultiArray", r#"{"data": [1.0, 2.5]}"#);
        let _angles = publisher(env, &topic, array, data)?;
        let _words = publisher(env, &emotion, "NativeObject", &words.to_string())?;
        hears(&robot[0], &angles, &bridge)?;
        hears(&robot[1], &words, &bridge)?;
        // No port has the topic's name.
        let mut list = env.wrapyfi(["list", "yarp", "--json"])?;
        list.exits_with(0)?;
        let names: Vec<Value> = list.objects(2)?.iter().map(|one| one["name"].clone()).collect();
        assert!(names.contains(&json!(command)) && !names.contains(&json!(topic)), "{names:?}");
        // The robot is started again, and is commanded again.
        let [mut first, second] = robot;
        first.kill()?;
        drop(first);
        let again = input_port(env, &command)?;
        hears(&again, &angles, &bridge)?;
        drop(second);
        Ok(())
    })
}

/// Also where the topic was there first and no port of the robot: the name is left to the robot.
#[test]
fn a_robot_that_comes_later_is_commanded() -> Result {
    run("a_robot_that_comes_later_is_commanded", NEEDS, |env| {
        let _names = env.yarpserver()?;
        let head = env.topic("head");
        let (topic, port) = (format!("{head}/command/i"), format!("{head}/command:i"));
        let bridge = env.executable("yarp_bridge", &["-p", "status_json:=true"])?;
        let _words = publisher(env, &topic, "NativeObject", r#"["go", 1]"#)?;
        // Until then its port has a name that no program has to know.
        let name = format!("ros2:{topic} -> yarp:{topic}");
        bridge.wait_until("the route to wait for a reader", |output| {
            let status = output.objects().last()?;
            let mut routes = status["routes"].as_array()?.iter();
            let route = routes.find(|route| route["name"] == *name)?;
            assert_eq!(route["counters"]["sent"], 0, "{route}");
            assert_ne!(route["state"], "active", "{route}");
            let reason = route["reason"].as_str()?;
            reason.starts_with("a listener on").then_some(())
        })?;
        let robot = input_port(env, &port)?;
        hears(&robot, &json!(["go", 1]), &bridge)
    })
}

/// Connections need no name server, and one after another brings nothing new to those that are there.
#[test]
fn a_robot_is_commanded_while_the_name_server_is_away_and_after() -> Result {
    run("a_robot_is_commanded_while_the_name_server_is_away_and_after", NEEDS, |env| {
        let mut names = env.yarpserver()?;
        let (port, nobody) = (format!("{}/in", env.topic("head")), env.topic("nobody"));
        let robot = input_port(env, &port)?;
        let commands = Route::new(&ros2(&port), &yarp(&port), "NativeObject");
        let witness = Route::new(&yarp(&nobody), &ros2(&nobody), "NativeObject");
        let bridge = env.bridge(&env.embedded().route(commands).route(witness))?;
        let _words = publisher(env, &port, "NativeObject", r#"["go", 1]"#)?;
        hears(&robot, &json!(["go", 1]), &bridge)?;
        for _ in 0..2 {
            names.kill()?;
            last_told(&bridge, "waiting for name server")?;
            more(&robot, 10).map_err(|error| error.context(bridge.tail()))?;
            names = env.yarpserver_there()?;
            last_told(&bridge, &format!("waiting for port {nobody}"))?;
            more(&robot, 10).map_err(|error| error.context(bridge.tail()))?;
        }
        Ok(())
    })
}

/// Waits until the last line that says what a route waits for says this.
fn last_told(bridge: &Process, what: &str) -> Result {
    bridge.wait_until(what, |output| {
        let waiting = output.err.iter().rfind(|line| line.contains("waiting for"))?;
        waiting.contains(what).then_some(())
    })
}

/// Waits for so many more messages.
fn more(port: &Process, count: usize) -> Result {
    let heard = |output: &Output| output.objects().count();
    let before = port.wait_until("what was heard", |output| Some(heard(output)))?;
    port.wait_until("more messages", |output| (heard(output) >= before + count).then_some(()))
}

#[test]
fn rpc_ports_of_robots_take_bottles_and_functions_of_wrapyfi_json() -> Result {
    let test = "rpc_ports_of_robots_take_bottles_and_functions_of_wrapyfi_json";
    run(test, NEEDS, |env| {
        let _names = env.yarpserver()?;
        let (robot, function) = (env.topic("head") + "/rpc", env.topic("lab") + "/rpc");
        let serve = |name: &str, more: &[&str]| {
            let endpoint = yarp(name);
            let said = ["serve", &endpoint, "--type", "NativeObject", "--echo", "--json"];
            env.wrapyfi([&said[..], more].concat())
        };
        let robot_port = serve(&robot, &["--option", "bottle=true"])?;
        let function_port = serve(&function, &[])?;
        let bridge = env.executable("yarp_bridge", &[])?;
        let ends = |name: &str| [ros2(name), yarp(name)];
        for endpoint in ends(&robot).into_iter().chain(ends(&function)) {
            let (endpoint, args) = (endpoint.as_str(), r#"["get", "enc", 0]"#);
            let kind = ["--type", "NativeObject", "--json", "--timeout", "40"];
            let call = [&["call", endpoint, "--args", args], &kind[..]].concat();
            let mut call = env.wrapyfi(call)?;
            call.exits_with(0).map_err(|error| error.context(bridge.tail()))?;
        }
        // A robot that got JSON would have one argument: its text.
        for port in [robot_port, function_port] {
            for asked in port.objects(2)? {
                assert_eq!(asked["args"], json!(["get", "enc", 0]), "{asked}");
            }
        }
        Ok(())
    })
}

#[test]
fn pub_goes_on_while_a_reader_stands_still() -> Result {
    run("pub_goes_on_while_a_reader_stands_still", &[Need::Program], |env| {
        let _names = env.yarpserver()?;
        let endpoint = yarp(&env.topic("cam"));
        let kind = ["--type", "NativeObject"];
        let reader = env.wrapyfi([&["echo", &endpoint, "--json"], &kind[..]].concat())?;
        let value = ["--value", "[1, 2]", "--rate", "100"];
        let publisher = env.wrapyfi([&["pub", &endpoint], &kind[..], &value[..]].concat())?;
        reader.objects(3)?;
        reader.pause()?;
        let full = "is full";
        publisher.wait_until("it to say that nothing is taken", |output| {
            output.err.iter().any(|line| line.contains(full)).then_some(())
        })?;
        reader.resume()?;
        // More than were queued.
        reader.objects(200).map_err(|error| error.context(publisher.tail())).map(drop)
    })
}
