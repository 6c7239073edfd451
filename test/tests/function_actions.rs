//! Functions of Wrapyfi scripts and rpc ports of YARP as actions: driven by the command line, by rclpy and by rospy.

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Process, Result, Route, TestEnv, ros1, ros2, run, yarp};

use super::actions::{FIBONACCI, end, goals, kilted};

const PYTHON: &[Need] = &[Need::Program, Need::Python];

/// Route from the function of `fibonacci.py`.
fn of_script(offered: &str) -> Route {
    Route::action("zeromq:/fibonacci", offered)
        .with("type", "test_msgs/action/Fibonacci")
        .with("options", "{ feedback: /fibonacci/progress }")
}

/// Starts the script on this test's ports.
fn script(env: &TestEnv, args: &str) -> Result<Process> {
    let script = env.peer("fibonacci.py", args)?;
    script.event("ready")?;
    Ok(script)
}

/// Sends a goal from the command line.
fn send(env: &TestEnv, action: &str, kind: &str, goal: &str) -> Result<Process> {
    let folder = env.path("interfaces").display().to_string();
    let kind = ["--type", kind, "--definitions", &folder, "--json", "--timeout", "100"];
    env.wrapyfi([&["action", "send", &ros2(action), "--value", goal], &kind[..]].concat())
}

/// The words of the goal's updates, and the last update.
fn updates(sent: &mut Process, code: i32) -> Result<(Vec<String>, Value)> {
    sent.exits_with(code)?;
    let lines =
        sent.wait_until("its lines", |output| Some(output.objects().collect::<Vec<_>>()))?;
    let word = |line: &Value| line["goal"].as_str().unwrap_or_default().to_owned();
    let mut words: Vec<_> = lines.iter().map(word).collect();
    words.dedup();
    Ok((words, lines.last().cloned().unwrap_or_default()))
}

/// The bridge's broker has the script's requests, or the script starts first and brings its own, as Wrapyfi does by itself.
fn a_script(test: &str, own_broker: bool) -> Result {
    run(test, PYTHON, |env| {
        env.definitions(&[FIBONACCI])?;
        let action = env.topic("fib");
        let config = env.embedded().requests(env).with("definitions", "[interfaces]");
        let config = config.route(of_script(&ros2(&action)));
        let (bridge, mut server) = match own_broker {
            false => (env.bridge(&config)?, script(env, "")?),
            true => {
                let server = script(env, "--own-broker")?;
                (env.bridge(&config)?, server)
            }
        };
        let send = |order: i32| {
            let goal = json!({ "order": order }).to_string();
            send(env, &action, "test_msgs/action/Fibonacci", &goal)
        };
        let (words, last) = updates(&mut send(12)?, 0)
            .map_err(|error| error.context(bridge.tail()).context(server.tail()))?;
        assert_eq!(words, ["accepted", "executing", "feedback", "succeeded"]);
        let sequence = [0, 1, 1, 2, 3, 5, 8, 13, 21, 34, 55, 89, 144, 233];
        assert_eq!(last["value"]["sequence"], json!(sequence));

        // It cannot be taken back: the function goes on.
        let long = send(1000)?;
        long.wait_until("its feedback", |output| {
            output.objects().find(|line| line["goal"] == "feedback").map(drop)
        })?;
        long.interrupt()?;
        let refused = long.wait_until("the cancel is refused", |output| {
            output.objects().find(|line| line["goal"] == "cancel_refused")
        })?;
        drop((long, refused));

        // An exception ends the script, and no reply tells of it.
        server.kill()?;
        goals(&bridge, |goals| goals["aborted"] == 1)?;
        let mut server = script(env, "")?;
        let (words, last) =
            updates(&mut send(-1)?, 1).map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(words.last().map(String::as_str), Some("aborted"), "{last}");
        server.exits_with(1)?;
        let said = "goal aborted: the server has gone";
        bridge.wait_until(said, |output| {
            output.err.iter().any(|line| line.contains(said)).then_some(())
        })?;

        let _server = script(env, "")?;
        let (_, last) = updates(&mut send(1)?, 0)?;
        assert_eq!(last["value"]["sequence"], json!([0, 1, 1]));
        Ok(())
    })
}

#[test]
fn a_function_of_a_script_is_an_action() -> Result {
    a_script("a_function_of_a_script_is_an_action", false)
}

#[test]
fn a_function_of_a_script_with_its_own_broker_is_an_action() -> Result {
    a_script("a_function_of_a_script_with_its_own_broker_is_an_action", true)
}

/// One function, offered to both ROS.
#[test]
fn clients_of_both_ros_drive_a_function_of_a_script() -> Result {
    const ALL: &[Need] = &[Need::Program, Need::Python, Need::Ros1, Need::Actionlib, Need::Kilted];
    run("clients_of_both_ros_drive_a_function_of_a_script", ALL, |env| {
        let _roscore = env.roscore()?;
        let ros = kilted(env)?;
        env.definitions(&[FIBONACCI])?;
        let action = env.topic("fib");
        let config = env.embedded().requests(env).with("definitions", "[interfaces]");
        let routes = [ros1(&action), ros2(&action)].map(|offered| of_script(&offered));
        let config = routes.into_iter().fold(config, wrapyfi_e2e::Config::route);
        let bridge = env.bridge(&config)?;
        let order =
            |order: i32, more: &str| format!("send --action {action} --order {order} {more}");
        let clients = |order: &str| {
            Ok::<_, anyhow::Error>([ros.rclpy_actions(order)?, env.rospy_actions(order)?])
        };
        let mut server = script(env, "")?;
        for client in clients(&order(12, "--cancel-after 2"))? {
            let told = end(&client, 0)
                .map_err(|error| error.context(bridge.tail()).context(server.tail()))?;
            // A cancel is refused.
            assert_eq!(told["state"], "succeeded", "{told}");
            assert_eq!(told["sequence"].as_array().map(Vec::len), Some(14), "{told}");
            let heard = client.event("feedback")?;
            assert_eq!(heard["sequence"][2], 1, "{heard}");
        }
        let refused = |index: usize| {
            bridge.wait_until("a cancel is refused", |output| {
                let report = output.objects().rev().find(|it| it["routes"].is_array())?;
                let goals = &report["routes"][index]["counters"]["goals"];
                (goals["cancel_refused"] == 1).then_some(())
            })
        };
        refused(0)?;
        refused(1)?;
        // The exception of one goal ends the script, and so the goal of the other client, which waits for it.
        let [one, other] = clients(&order(1000, ""))?;
        for client in [&one, &other] {
            client.event("feedback")?;
        }
        server.kill()?;
        for client in [&one, &other] {
            assert_eq!(end(client, 0)?["state"], "aborted");
        }
        Ok(())
    })
}

const MOVE: (&str, &str) =
    ("demo/action/Move.action", "float64 to\n---\nfloat64 reached\n---\nfloat64 at\nbool done\n");

/// A robot that answers `walk` when it has arrived, `go` at once and `checkMotionDone` at any time.
#[test]
fn an_rpc_port_of_yarp_is_an_action() -> Result {
    run("an_rpc_port_of_yarp_is_an_action", &[Need::Program, Need::Yarp, Need::YarpCpp], |env| {
        let _names = env.yarpserver()?;
        env.definitions(&[MOVE])?;
        let rpc = env.topic("base/rpc:i");
        let mut robot = env.yarp_robot(&rpc)?;
        robot.event("ready")?;
        let [walk, go] = ["walk", "go"].map(|name| env.topic(name));
        let route = |offered: &str, options: &str| {
            Route::action(&yarp(&rpc), &ros2(offered))
                .with("type", "demo/action/Move")
                .with("options", options)
        };
        let config = env
            .embedded()
            .with("definitions", "[interfaces]")
            .route(route(&walk, "{ command: walk, poll: checkMotionDone, poll_ms: 50 }"))
            .route(route(&go, "{ command: go, poll: checkMotionDone, poll_ms: 50, until: done }"));
        let bridge = env.bridge(&config)?;
        let send = |action: &str, to: f64| {
            send(env, action, "demo/action/Move", &json!({ "to": to }).to_string())
        };
        for action in [&walk, &go] {
            let mut sent = send(action, 0.5)?;
            let (words, last) = updates(&mut sent, 0)
                .map_err(|error| error.context(bridge.tail()).context(robot.tail()))?;
            assert_eq!(words, ["accepted", "executing", "feedback", "succeeded"], "{action}");
            assert_eq!(last["value"]["reached"], 0.5, "{action}");
            let feedback = sent.wait_until("its feedback", |output| {
                let feedback = output.objects().filter(|line| line["goal"] == "feedback");
                Some(feedback.map(|line| line["value"].clone()).collect::<Vec<_>>())
            })?;
            assert!(feedback.iter().any(|one| one["done"] == false), "{action}: {feedback:?}");
            robot.tell("home")?;
            robot.wait_until("it is home", |output| {
                output.events("home").len().checked_sub(1).map(drop)
            })?;
        }
        // A word that the robot gives.
        let (words, _) = updates(&mut send(&go, 1000.0)?, 1)?;
        assert_eq!(words.last().map(String::as_str), Some("aborted"));
        let said = "goal aborted: ";
        bridge.wait_until(said, |output| {
            let is = |line: &&String| line.contains(said) && line.contains("too far");
            output.err.iter().find(is).map(drop)
        })?;
        // A robot that is switched off.
        for action in [&walk, &go] {
            let mut sent = send(action, 100.0)?;
            sent.wait_until("it moves", |output| {
                output.objects().find(|line| line["goal"] == "feedback").map(drop)
            })?;
            robot.kill()?;
            let (words, _) = updates(&mut sent, 1).map_err(|error| error.context(bridge.tail()))?;
            assert_eq!(words.last().map(String::as_str), Some("aborted"), "{action}");
            robot = env.yarp_robot(&rpc)?;
            robot.event("ready")?;
        }
        Ok(())
    })
}
