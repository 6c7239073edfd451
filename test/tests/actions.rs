//! Actions between actionlib of rospy, rclpy of ROS 2 Kilted, and the command line.

use serde_json::{Value, json};
use wrapyfi_e2e::{
    Need, Output, Process, RealRos2, Result, Route, TestEnv, ros1, ros2, route_status, run,
};

const BOTH: &[Need] = &[Need::Program, Need::Ros1, Need::Actionlib, Need::Kilted];
pub(crate) const FIBONACCI: (&str, &str) = (
    "test_msgs/action/Fibonacci.action",
    "int32 order\n---\nint32[] sequence\n---\nint32[] sequence\n",
);

/// ROS 2 Kilted, whose services are Fast DDS's; the bridge speaks both mappings.
pub(crate) fn kilted(env: &TestEnv) -> Result<RealRos2<'_>> {
    env.set_variable("RMW_IMPLEMENTATION", "");
    RealRos2::kilted(env)
}

/// A bridge that offers `there` as `here`.
pub(crate) fn bridge(env: &TestEnv, there: &str, here: &str) -> Result<Process> {
    env.definitions(&[FIBONACCI])?;
    env.bridge(
        &env.embedded().with("definitions", "[interfaces]").route(Route::action(there, here)),
    )
}

/// The end of goal `index`.
pub(crate) fn end(client: &Process, index: u64) -> Result<Value> {
    client.wait_until("the end of the goal", |output| {
        output.events("end").into_iter().find(|end| end["index"] == index)
    })
}

/// Numbers of the goals of the bridge's only route.
pub(crate) fn goals(bridge: &Process, wanted: impl Fn(&Value) -> bool) -> Result<Value> {
    bridge.wait_until("the numbers of the goals", |output| {
        let report = output.objects().rev().find(|it| it["routes"].is_array())?;
        let goals = report["routes"][0]["counters"]["goals"].clone();
        wanted(&goals).then_some(goals)
    })
}

#[test]
fn a_client_of_rclpy_drives_a_server_of_actionlib() -> Result {
    run("a_client_of_rclpy_drives_a_server_of_actionlib", BOTH, |env| {
        let _roscore = env.roscore()?;
        let (ros, action) = (kilted(env)?, env.topic("fib"));
        let bridge = bridge(env, &ros1(&action), &ros2(&action))?;
        let mut server = env.rospy_actions(&format!("serve --action {action}"))?;
        server.event("ready")?;
        let client = ros.rclpy_actions(&format!("send --action {action} --order 6"))?;
        let told = end(&client, 0).map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(
            (&told["state"], &told["sequence"]),
            (&json!("succeeded"), &json!([0, 1, 1, 2, 3, 5, 8, 13]))
        );
        let accepted = client.event("accepted")?;
        assert_eq!(accepted["accepted"], true);
        client.wait_until("all feedback", |output| {
            (output.events("feedback").len() == 6).then_some(())
        })?;

        // A cancel reaches the server, and its answer the client.
        let client =
            ros.rclpy_actions(&format!("send --action {action} --order 4000 --cancel-after 3"))?;
        assert_eq!(end(&client, 0)?["state"], "canceled");
        let canceling = client.event("canceling")?;
        assert_eq!((&canceling["code"], &canceling["goals"]), (&json!(0), &json!(1)));

        // A newer goal preempts the older one, which no client has cancelled.
        let older = ros.rclpy_actions(&format!("send --action {action} --order 4000"))?;
        older.event("feedback")?;
        let newer = ros.rclpy_actions(&format!("send --action {action} --order 3"))?;
        assert_eq!(end(&older, 0)?["state"], "aborted");
        assert_eq!(end(&newer, 0)?["state"], "succeeded");

        // A server that dies ends its goals, and is no longer offered.
        let client = ros.rclpy_actions(&format!("send --action {action} --order 4000"))?;
        client.event("feedback")?;
        server.kill()?;
        assert_eq!(end(&client, 0)?["state"], "aborted");
        let told = goals(&bridge, |goals| goals["aborted"] == 2)?;
        assert_eq!(
            (&told["accepted"], &told["succeeded"], &told["canceled"]),
            (&json!(5), &json!(2), &json!(1))
        );
        let waiting = |output: &Output| {
            let report = output.objects().rev().find(|it| it["routes"].is_array())?;
            (report["routes"][0]["state"] == "waiting").then_some(())
        };
        bridge.wait_until("the route waits", waiting)
    })
}

#[test]
fn goals_that_actionlib_rejects_or_aborts_end_aborted() -> Result {
    run("goals_that_actionlib_rejects_or_aborts_end_aborted", BOTH, |env| {
        let _roscore = env.roscore()?;
        let (ros, action) = (kilted(env)?, env.topic("fib"));
        let bridge = bridge(env, &ros1(&action), &ros2(&action))?;
        for behave in ["reject", "abort"] {
            let server =
                env.rospy_actions(&format!("serve --action {action} --behave {behave}"))?;
            server.event("ready")?;
            let client = ros.rclpy_actions(&format!("send --action {action} --order 3"))?;
            let told = end(&client, 0).map_err(|error| error.context(bridge.tail()))?;
            assert_eq!(told["state"], "aborted", "{behave}");
        }
        Ok(())
    })
}

#[test]
fn a_client_of_actionlib_drives_a_server_of_rclpy() -> Result {
    run("a_client_of_actionlib_drives_a_server_of_rclpy", BOTH, |env| {
        let _roscore = env.roscore()?;
        let (ros, action) = (kilted(env)?, env.topic("fib"));
        let bridge = bridge(env, &ros2(&action), &ros1(&action))?;
        let mut server = ros.rclpy_actions(&format!("serve --action {action}"))?;
        server.event("ready")?;
        let client = env.rospy_actions(&format!("send --action {action} --order 6"))?;
        let told = end(&client, 0).map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(
            (&told["state"], &told["sequence"]),
            (&json!("succeeded"), &json!([0, 1, 1, 2, 3, 5, 8, 13]))
        );
        client.wait_until("all feedback", |output| {
            (output.events("feedback").len() == 6).then_some(())
        })?;
        let client =
            env.rospy_actions(&format!("send --action {action} --order 4000 --cancel-after 3"))?;
        assert_eq!(end(&client, 0)?["state"], "preempted");
        let client = env.rospy_actions(&format!("send --action {action} --order 4 --goals 8"))?;
        for index in 0..8 {
            assert_eq!(end(&client, index)?["state"], "succeeded");
        }
        let client = env.rospy_actions(&format!("send --action {action} --order 4000"))?;
        client.event("feedback")?;
        server.kill()?;
        let told = end(&client, 0)?;
        assert!(
            ["aborted", "lost"].contains(&told["state"].as_str().unwrap_or_default()),
            "{told}"
        );
        Ok(())
    })
}

#[test]
fn goals_that_rclpy_rejects_aborts_or_goes_on_with_end_so() -> Result {
    run("goals_that_rclpy_rejects_aborts_or_goes_on_with_end_so", BOTH, |env| {
        let _roscore = env.roscore()?;
        let ros = kilted(env)?;
        for (behave, state) in
            [("reject", "rejected"), ("abort", "aborted"), ("refuse_cancel", "succeeded")]
        {
            let action = env.topic(behave);
            let bridge = bridge(env, &ros2(&action), &ros1(&action))?;
            let server =
                ros.rclpy_actions(&format!("serve --action {action} --behave {behave}"))?;
            server.event("ready")?;
            let cancel = if behave == "refuse_cancel" { " --cancel-after 2" } else { "" };
            let client =
                env.rospy_actions(&format!("send --action {action} --order 12{cancel}"))?;
            let told = end(&client, 0).map_err(|error| error.context(bridge.tail()))?;
            assert_eq!(told["state"], state, "{behave}");
        }
        Ok(())
    })
}

/// `ros1_bridge` has the actions of both sides, and not their topics and services.
#[test]
fn ros1_bridge_has_actions_in_place_of_their_parts() -> Result {
    run("ros1_bridge_has_actions_in_place_of_their_parts", BOTH, |env| {
        let _roscore = env.roscore()?;
        let ros = kilted(env)?;
        let (there, here) = (env.topic("there"), env.topic("here"));
        let (file, text) = FIBONACCI;
        let index = "share/ament_index/resource_index/rosidl_interfaces/test_msgs";
        let files = [(&*format!("share/{file}"), text), (index, "action/Fibonacci.action\n")];
        let prefix = env.definitions(&files)?;
        env.set_variable("AMENT_PREFIX_PATH", &prefix);
        let bridge = env.executable("ros1_bridge", &["-p", "status_json:=true"])?;
        let _server = env.rospy_actions(&format!("serve --action {there}"))?;
        let _other = ros.rclpy_actions(&format!("serve --action {here}"))?;
        let to_ros1 = ros.rclpy_actions(&format!("send --action {there} --order 3"))?;
        let to_ros2 = env.rospy_actions(&format!("send --action {here} --order 3"))?;
        for client in [&to_ros1, &to_ros2] {
            let told = end(client, 0).map_err(|error| error.context(bridge.tail()))?;
            assert_eq!(told["state"], "succeeded");
        }
        // A topic of a client that has not registered all five yet is one like others, until it has.
        bridge.wait_until("both routes, and none of a part", |output| {
            let report = output.objects().rev().find(|it| it["routes"].is_array())?;
            let routes = report["routes"].as_array()?;
            let is_named =
                |one: &Value, text: &str| one["name"].as_str().is_some_and(|it| it.contains(text));
            let has = |name: &str| {
                routes.iter().any(|one| one["kind"] == "action" && is_named(one, name))
            };
            let is_part = |one: &Value| {
                let parts = ["/feedback", "/status", "/cancel", "/result", "_action"];
                let names = [&there, &here].into_iter();
                names
                    .flat_map(|name| parts.map(|part| format!("{name}{part}")))
                    .any(|part| is_named(one, &part))
            };
            (has(&there) && has(&here) && !routes.iter().any(is_part)).then_some(())
        })?;
        Ok(())
    })
}

/// `wrapyfi action` on both ROS, without a bridge.
#[test]
fn the_command_line_lists_sends_serves_and_cancels() -> Result {
    const NEEDS: &[Need] = &[Need::Program, Need::Ros1];
    run("the_command_line_lists_sends_serves_and_cancels", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let folder = env.definitions(&[FIBONACCI])?;
        let action = env.topic("fib");
        let kind = ["--type", "test_msgs/action/Fibonacci", "--definitions", &folder];
        for at in [ros1(&action), ros2(&action)] {
            let serve = ["action", "serve", &at, "--seconds", "1", "--every", "0.2", "--json"];
            let values =
                ["--value", r#"{"sequence": [1, 2]}"#, "--feedback", r#"{"sequence": [1]}"#];
            let server = env.wrapyfi([&serve[..], &kind, &values].concat())?;
            let mut send = env.wrapyfi(
                [
                    &["action", "send", &at, "--value", r#"{"order": 5}"#, "--timeout", "60"],
                    &kind[..],
                ]
                .concat(),
            )?;
            send.exits_with(0).map_err(|error| error.context(server.tail()))?;
            let said = send.stdout();
            for part in
                ["accepted", "executing", "feedback:\n  sequence:", "succeeded:\n  sequence:"]
            {
                assert!(said.contains(part), "{part} is not in {said}");
            }
            assert_eq!(server.objects(1)?[0]["value"]["order"], 5);
            let side = if at.starts_with("ros2") { "ros2" } else { "ros" };
            let mut list = env.wrapyfi(["action", "list", side, "--json", "--wait", "3"])?;
            list.exits_with(0)?;
            let listed = list.objects(1)?;
            let is_it = |one: &Value| {
                one["name"] == action.as_str()
                    && one["role"] == "action_server"
                    && one["type"].as_str().is_some_and(|kind| kind.ends_with("Fibonacci"))
            };
            assert!(listed.iter().any(is_it), "{listed:?}");
            drop(server);

            let serve = ["action", "serve", &at, "--seconds", "60", "--json"];
            let server = env.wrapyfi([&serve[..], &kind].concat())?;
            let send = ["action", "send", &at, "--timeout", "60"];
            let mut sent = env.wrapyfi([&send[..], &kind].concat())?;
            sent.wait_until("the goal is under way", |output| {
                output.out.iter().any(|line| line.contains("executing")).then_some(())
            })?;
            let mut cancel = env.wrapyfi([&["action", "cancel", &at], &kind[..]].concat())?;
            cancel.exits_with(0)?;
            sent.exits_with(1).map_err(|error| error.context(server.tail()))?;
            assert!(sent.stdout().contains("canceled"), "{}", sent.tail());
            let interrupted = env.wrapyfi([&send[..], &kind].concat())?;
            interrupted.wait_until("the goal is under way", |output| {
                output.out.iter().any(|line| line.contains("executing")).then_some(())
            })?;
            interrupted.interrupt()?;
            interrupted.wait_until("the goal is canceled", |output| {
                output.out.iter().any(|line| line.contains("canceled")).then_some(())
            })?;
        }
        let mut nobody = env.wrapyfi(
            [&["action", "send", &ros2("/nobody"), "--timeout", "1"], &kind[..]].concat(),
        )?;
        nobody.exits_with(3)?;
        for args in [&["list", "zeromq"][..], &["info", "zeromq:/say"]] {
            let mut list = env.wrapyfi([&["action"], args].concat())?;
            list.exits_with(2)?;
            let said = list.stderr();
            assert!(said.contains("zeromq has no actions"), "{said}");
        }
        let mut untyped = env.wrapyfi(["action", "send", "zeromq:/say", "--value", "{}"])?;
        untyped.exits_with(2)?;
        assert!(untyped.stderr().contains("--type is needed"), "{}", untyped.stderr());
        Ok(())
    })
}

/// A route tells its type once it is learned.
#[test]
fn an_action_waits_for_its_server_and_names_it() -> Result {
    const NEEDS: &[Need] = &[Need::Program, Need::Ros1, Need::Actionlib];
    run("an_action_waits_for_its_server_and_names_it", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let action = env.topic("fib");
        let bridge = bridge(env, &ros1(&action), &ros2(&action))?;
        bridge.wait_until("the route waits", |output| {
            let report = output.objects().rev().find(|it| it["routes"].is_array())?;
            let route = &report["routes"][0];
            let said = route["reason"].as_str()?;
            (route["state"] == "waiting" && said.contains("a server of")).then_some(())
        })?;
        let name = format!("{} -> {}", ros2(&action), ros1(&action));
        let _server = env.rospy_actions(&format!("serve --action {action}"))?;
        let status = bridge.wait_until("the route is active", |output| {
            route_status(output, &name).filter(|route| route["state"] == "active")
        })?;
        assert_eq!(status["kind"], "action");
        assert_eq!(status["type"], "test_msgs/action/Fibonacci");
        Ok(())
    })
}

/// Nobody has the package: the bridge describes what it has learned of ROS 1.
#[test]
fn an_action_that_is_installed_nowhere_is_described_by_the_bridge() -> Result {
    const NEEDS: &[Need] = &[Need::Program, Need::Ros1, Need::Actionlib];
    run("an_action_that_is_installed_nowhere_is_described_by_the_bridge", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let action = env.topic("fib");
        let route = Route::action(&ros1(&action), &ros2(&action));
        let bridge = env.bridge(&env.embedded().route(route))?;
        let server = env.rospy_actions(&format!("serve --action {action}"))?;
        server.event("ready")?;
        let at = ros2(&action);
        let send = ["action", "send", &at, "--value", r#"{"order": 2}"#, "--timeout", "60"];
        let mut sent = env.wrapyfi(send.into_iter().chain(["--json"]))?;
        sent.exits_with(0).map_err(|error| error.context(bridge.tail()))?;
        let end = sent.wait_until("the end", |output| output.objects().next_back())?;
        assert_eq!(end["value"]["sequence"], json!([0, 1, 1, 2]));
        let why = env.wrapyfi(["why", &at, "--json"])?.objects(1)?;
        assert_ne!(why[0]["cause"], "definition", "{why:?}");
        Ok(())
    })
}

/// The goal of a client whose bridge was killed goes on, and the next bridge has nobody's wish to end it but one for all.
#[test]
fn a_goal_that_a_killed_bridge_has_sent_can_be_cancelled() -> Result {
    run("a_goal_that_a_killed_bridge_has_sent_can_be_cancelled", BOTH, |env| {
        let _roscore = env.roscore()?;
        let ros = kilted(env)?;
        let folder = env.definitions(&[FIBONACCI])?;
        for is_server_on_ros1 in [true, false] {
            let action = env.topic(if is_server_on_ros1 { "one" } else { "two" });
            let (there, here) = match is_server_on_ros1 {
                true => (ros1(&action), ros2(&action)),
                false => (ros2(&action), ros1(&action)),
            };
            let (serve, send) = (
                format!("serve --action {action}"),
                format!("send --action {action} --order 4000"),
            );
            let mut killed = bridge(env, &there, &here)?;
            let (server, client) = match is_server_on_ros1 {
                true => (env.rospy_actions(&serve)?, ros.rclpy_actions(&send)?),
                false => (ros.rclpy_actions(&serve)?, env.rospy_actions(&send)?),
            };
            client.event("feedback").map_err(|error| error.context(killed.tail()))?;
            killed.kill()?;
            let next = bridge(env, &there, &here)?;
            let route = format!("{here} -> {there}");
            next.wait_until("the route is active", |output| {
                route_status(output, &route).filter(|route| route["state"] == "active")
            })?;
            let kind = ["--type", "test_msgs/action/Fibonacci", "--definitions", &folder];
            let cancel = [&["action", "cancel", &here, "--timeout", "30"], &kind[..]].concat();
            env.wrapyfi(cancel)?.exits_with(0)?;
            let told = server.event("end").map_err(|error| error.context(next.tail()))?;
            let wanted = if is_server_on_ros1 { "preempted" } else { "canceled" };
            assert_eq!(told["state"], wanted);
        }
        Ok(())
    })
}
