//! Actions that do not work with real peers: `wrapyfi why` names the cause and what mends it.

use serde_json::Value;
use wrapyfi_e2e::{Need, Result, Route, TestEnv, ros1, ros2, run, until_route};

use super::actions::{FIBONACCI, kilted};
use super::why::asked_until;

const OF_ROS1: &[Need] = &[Need::Program, Need::Ros1, Need::Actionlib];
const BOTH: &[Need] = &[Need::Program, Need::Ros1, Need::Actionlib, Need::Kilted];
const ON_ROS2: &[Need] = &[Need::Program, Need::Kilted];
const STATUS: &str = "actionlib_msgs/GoalStatusArray";

/// The answer about a name once it has this cause, whose words and remedy hold others.
fn told(env: &TestEnv, name: &str, [cause, what, remedy]: [&str; 3]) -> Result<Value> {
    asked_until(env, [name], |answer| {
        let has = |key: &str, words: &str| answer[key].to_string().contains(words);
        answer["cause"] == cause && has("what", what) && has("remedy", remedy)
    })
}

#[test]
fn no_server_or_one_with_some_parts_is_told_without_a_bridge() -> Result {
    run("no_server_or_one_with_some_parts_is_told_without_a_bridge", OF_ROS1, |env| {
        let _roscore = env.roscore()?;
        let (near, far) = (env.topic("near"), env.topic("far"));
        env.definitions(&[FIBONACCI])?;
        let config = env.embedded().with("definitions", "[interfaces]");
        let config = config.route(Route::action(&ros1(&near), &ros2(&near)).with("name", "near"));
        let config = config.route(Route::action(&ros2(&far), &ros1(&far)).with("name", "far"));
        let file = env.write("bridge.yaml", config.yaml())?.display().to_string();
        for (name, address) in [("near", ros1(&near)), ("far", ros2(&far))] {
            asked_until(env, [name, "--config", &file], |answer| {
                let serve = format!("wrapyfi action serve {address}");
                let is_there = |key: &str, words: &str| answer[key].to_string().contains(words);
                answer["cause"] == "nobody_offers"
                    && is_there("what", &format!("nobody offers {address}"))
                    && is_there("remedy", &serve)
            })?;
        }
        let publish = format!("publish --type {STATUS} --topic {near}/status --node half --latch");
        let _half = env.rospy(&publish, Some("{}"))?;
        let part = ros2(&format!("{far}/_action/status"));
        let publish = ["pub", &part, "--type", "action_msgs/msg/GoalStatusArray", "--value", "{}"];
        let _half_of_ros2 = env.wrapyfi(publish.into_iter().chain(["--rate", "10"]))?;
        let lacks = "goal, cancel, feedback, result are not found";
        told(env, &ros1(&near), ["not_ready", lacks, "wrapyfi list ros"])?;
        let lacks = "send_goal, cancel_goal, get_result, feedback are not found";
        told(env, &ros2(&far), ["not_ready", lacks, "wrapyfi list ros2"])?;
        Ok(())
    })
}

#[test]
fn a_second_publisher_of_the_status_is_told() -> Result {
    run("a_second_publisher_of_the_status_is_told", OF_ROS1, |env| {
        let _roscore = env.roscore()?;
        let action = env.topic("fib");
        let server = env.rospy_actions(&format!("serve --action {action}"))?;
        server.event("ready")?;
        let publish = format!("publish --type {STATUS} --topic {action}/status --node bag --latch");
        let _bag = env.rospy(&publish, Some("{}"))?;
        let what = format!("publish the status of the action {}", ros1(&action));
        let answer = told(env, &ros1(&action), ["name_taken", &what, "end all servers"])?;
        assert!(answer["what"].to_string().contains("/bag and /rospy_actions"), "{answer}");
        Ok(())
    })
}

#[test]
fn a_server_and_a_client_of_another_type_are_told() -> Result {
    run("a_server_and_a_client_of_another_type_are_told", BOTH, |env| {
        let (ros, action, other) = (kilted(env)?, env.topic("fib"), "test_msgs/action/Other");
        let folder =
            env.definitions(&[FIBONACCI, ("test_msgs/action/Other.action", "---\n---\n")])?;
        let server = ros.rclpy_actions(&format!("serve --action {action}"))?;
        server.event("ready")?;
        let shown = env.topic("shown");
        let config = |name: &str, kind: &str| {
            let route = Route::action(&ros2(&action), &ros2(&shown)).with("name", name);
            let route = if kind.is_empty() { route } else { route.with("type", kind) };
            let config = env.embedded().with("definitions", "[interfaces]").route(route);
            Ok::<_, anyhow::Error>((env.write(&format!("{name}.yaml"), config.yaml())?, config))
        };
        let (file, _) = config("typed", other)?;
        let file = file.display().to_string();
        asked_until(env, ["typed", "--config", &file], |answer| {
            let what = answer["what"].to_string();
            let words = format!("has type test_msgs/action/Fibonacci, the route has {other}");
            answer["cause"] == "type" && what.contains(&words)
        })?;
        let (file, config) = config("learned", "")?;
        let bridge = env.bridge(&config)?;
        until_route(&bridge, "learned", |route| route.is_some_and(|it| it["state"] == "active"))?;
        let send = ["action", "send", &ros2(&shown), "--type", other, "--definitions", &folder];
        let _client = env.wrapyfi(send.into_iter().chain(["--timeout", "200"]))?;
        let file = file.display().to_string();
        asked_until(env, ["learned", "--config", &file], |answer| {
            let what = answer["what"].to_string();
            let words = format!("wants type {other}, the route has test_msgs/action/Fibonacci");
            answer["cause"] == "type" && what.contains(&words)
        })?;
        Ok(())
    })
}

/// The server began when its machine had another time.
#[test]
fn stamps_in_the_past_are_told() -> Result {
    run("stamps_in_the_past_are_told", OF_ROS1, |env| {
        let _roscore = env.roscore()?;
        let action = env.topic("fib");
        let simulated = env.rospy("param --topic /use_sim_time --node says", Some("true"))?;
        simulated.event("ready")?;
        let clock = "publish --topic /clock --type rosgraph_msgs/Clock --node time --rate 20";
        let _clock = env.rospy(clock, Some("{\"clock\": {\"secs\": 100{n}, \"nsecs\": 0}}"))?;
        let server = env.rospy_actions(&format!("serve --action {action}"))?;
        server.event("ready")?;
        let real = env.rospy("param --topic /use_sim_time --node unsays", Some("false"))?;
        real.event("ready")?;
        told(env, &ros1(&action), ["setting", "stamps in the past", "one clock"])?;
        Ok(())
    })
}

/// A name that patterns of topics, of services and of actions have is that of the one that is there.
#[test]
fn a_name_of_three_patterns_is_that_of_the_action() -> Result {
    run("a_name_of_three_patterns_is_that_of_the_action", OF_ROS1, |env| {
        let _roscore = env.roscore()?;
        let robot = env.topic("robot");
        let [from, to] = ["ros:", "ros2:"].map(|side| format!("{side}{robot}/"));
        let [all, shown] = [format!("{from}(.*)"), format!("{to}$1")];
        env.definitions(&[FIBONACCI])?;
        let config = env.embedded().with("definitions", "[interfaces]");
        let config = config.route(Route::untyped(&all, &shown));
        let config = config.route(Route::service(&all, &shown, "std_srvs/srv/Trigger"));
        let config = config.route(Route::action(&all, &shown));
        let _bridge = env.bridge(&config)?;
        let server = env.rospy_actions(&format!("serve --action {robot}/fib"))?;
        server.event("ready")?;
        let file = env.path("bridge.yaml").display().to_string();
        for name in [format!("{from}fib"), format!("{to}fib")] {
            for (option, value) in [("--config", file.as_str()), ("--node", "/wrapyfi_bridge")] {
                asked_until(env, [&name, option, value], |answer| {
                    let is_it = answer["passed"].to_string().contains("1 action server");
                    is_it && answer["cause"].is_null()
                })?;
            }
        }
        Ok(())
    })
}

/// ROS 2 sends a request to all who offer its name.
#[test]
fn two_nodes_that_offer_one_service_or_action_on_ros_2_are_told() -> Result {
    run("two_nodes_that_offer_one_service_or_action_on_ros_2_are_told", ON_ROS2, |env| {
        let (ros, light, fib) = (kilted(env)?, env.topic("light"), env.topic("fib"));
        let light_type = "std_srvs/srv/SetBool";
        let serve = format!("serve --topic {light} --type {light_type}");
        let achieve = format!("achieve --topic {fib} --type test_msgs/action/Fibonacci");
        let start = |node: &str| {
            let made = [&serve, &achieve]
                .map(|role| ros.rclpy(&format!("{role} --node {node}{}", role.len()), None));
            made.into_iter().collect::<Result<Vec<_>>>()
        };
        let _left = start("left")?;
        for name in [&light, &fib] {
            let answer = asked_until(env, [&*ros2(name)], |answer| {
                answer["passed"].to_string().contains("/left")
            })?;
            assert_ne!(answer["cause"], "name_taken", "{answer}");
        }
        let _right = start("right")?;
        for (name, kind) in [(&light, "service"), (&fib, "action")] {
            let what = format!("offer the {kind} {}", ros2(name));
            let remedy = format!("-r {name}:=/other{name}");
            let answer = told(env, &ros2(name), ["name_taken", &what, &remedy])?;
            let what = answer["what"].to_string();
            assert!(what.contains("/left") && what.contains(" and /right"), "{answer}");
        }
        Ok(())
    })
}
