//! Actions of ROS 1 through a bridge, with clients and servers of actionlib in Python and C++ at both ends, unmodified.
//!
//! ```text
//!   SimpleActionClient ─▶ /here   wrapyfi bridge   /there ─▶ SimpleActionServer
//! ```
//!
//! The bridge has no definition of `actionlib/Test`: it learns it from what the server shows, and where that is in C++
//! from what its clients show, too.

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Process, Result, Route, TestEnv, ros1, ros2, run, until_route};

const NEEDS: &[Need] = &[Need::Program, Need::Ros1, Need::Actionlib];

/// A bridge that offers the action `there` as `here`; ready when it does.
fn bridge(env: &TestEnv, options: &str) -> Result<Process> {
    let route = Route::action(&ros1(&env.topic("there")), &ros1(&env.topic("here")));
    let route = if options.is_empty() { route } else { route.with("options", options) };
    env.bridge(&env.embedded().route(route))
}

fn server(env: &TestEnv, role: &str) -> Result<Process> {
    let server = env.actionlib(&format!("{role} --topic {} --node server", env.topic("there")))?;
    server.event("ready")?;
    Ok(server)
}

fn client(env: &TestEnv, args: &str) -> Result<Process> {
    env.actionlib(&format!("ask --topic {} --node client {args}", env.topic("here")))
}

fn ended(client: &Process, count: usize) -> Result<Vec<Value>> {
    client.wait_until("the goals end", |output| {
        let ended = output.events("ended");
        (ended.len() >= count).then_some(ended)
    })
}

fn feedback(client: &Process) -> Result<Vec<Value>> {
    let values = |one: &Value| one["value"].clone();
    client.wait_until("its feedback", |output| {
        Some(output.events("feedback").iter().map(values).collect())
    })
}

#[test]
fn a_goal_of_actionlib_crosses_with_feedback_and_result() -> Result {
    run("a_goal_of_actionlib_crosses_with_feedback_and_result", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let server = server(env, "serve")?;
        let _bridge = bridge(env, "")?;
        let client = client(env, "--goal 5 --goals 2")?;
        client.event("server")?;
        for end in ended(&client, 2)? {
            assert_eq!(end["state"], "SUCCEEDED", "{end}");
            assert_eq!((&end["text"], &end["result"]), (&json!("counted"), &json!(5)));
        }
        assert_eq!(feedback(&client)?, [1, 2, 3, 4, 5, 1, 2, 3, 4, 5]);
        drop(server);
        Ok(())
    })
}

#[test]
fn a_cancel_is_handled_while_the_goal_runs() -> Result {
    run("a_cancel_is_handled_while_the_goal_runs", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let server = server(env, "serve")?;
        let _bridge = bridge(env, "")?;
        let client = client(env, "--goal 100000 --cancel 3")?;
        let end = ended(&client, 1)?.remove(0);
        assert_eq!((&end["state"], &end["text"]), (&json!("PREEMPTED"), &json!("given up")));
        server.event("preempted")?;
        Ok(())
    })
}

#[test]
fn a_goal_that_its_server_aborts_or_rejects_ends_with_its_words() -> Result {
    run("a_goal_that_its_server_aborts_or_rejects_ends_with_its_words", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let mut real = server(env, "serve")?;
        let _bridge = bridge(env, "")?;
        let aborted = client(env, "--goal -1")?;
        let end = ended(&aborted, 1)?.remove(0);
        assert_eq!((&end["state"], &end["text"]), (&json!("ABORTED"), &json!("below zero")));
        assert_eq!(end["result"], -1);
        drop(aborted);
        real.kill()?;
        let _real = server(env, "reject")?;
        let rejected = client(env, "--goal 1")?;
        let end = ended(&rejected, 1)?.remove(0);
        assert_eq!((&end["state"], &end["text"]), (&json!("ABORTED"), &json!("no map")));
        Ok(())
    })
}

/// Its clients wait for a server again, until there is one.
#[test]
fn a_server_that_is_killed_aborts_its_goals_and_may_come_back() -> Result {
    run("a_server_that_is_killed_aborts_its_goals_and_may_come_back", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let mut real = server(env, "serve")?;
        let bridge = bridge(env, "")?;
        let asking = client(env, "--goal 100000")?;
        asking.event("feedback")?;
        real.kill()?;
        let end = ended(&asking, 1)?.remove(0);
        assert_eq!(end["state"], "ABORTED");
        assert_eq!(end["text"], "the server /server has gone");
        drop(asking);
        let mut real = server(env, "serve")?;
        let asking = client(env, "--goal 2")?;
        assert_eq!(ended(&asking, 1)?[0]["state"], "SUCCEEDED");
        drop((asking, bridge));
        // The master keeps the names of nodes that were killed.
        real.kill()?;
        let mut why = env.wrapyfi(["why", &ros1(&env.topic("there")), "--json"])?;
        why.exits_with(1)?;
        let found = why.objects(1)?.remove(0);
        assert_eq!(found["cause"], "peer_unreachable", "{found}");
        assert!(found["what"].as_str().is_some_and(|what| what.contains("/server")), "{found}");
        Ok(())
    })
}

const CPP: &[Need] = &[Need::Program, Need::Ros1, Need::Actionlib, Need::ActionlibCpp];

/// The definition of goals is nowhere but with a client: a server in C++ does not show it.
#[test]
fn a_client_and_a_server_in_cpp_reach_each_other() -> Result {
    run("a_client_and_a_server_in_cpp_reach_each_other", CPP, |env| {
        let _roscore = env.roscore()?;
        let server =
            env.actionlib_cpp(&format!("serve --topic {} --node server", env.topic("there")))?;
        server.event("ready")?;
        let _direct = env.actionlib_cpp(&format!("ask --topic {} --goal 0", env.topic("there")))?;
        let _bridge = bridge(env, "")?;
        let here = env.topic("here");
        let counting = env.actionlib_cpp(&format!("ask --topic {here} --node first --goal 5"))?;
        let end = ended(&counting, 1)?.remove(0);
        assert_eq!((&end["state"], &end["text"]), (&json!("SUCCEEDED"), &json!("counted")));
        assert_eq!(end["result"], 5);
        assert_eq!(feedback(&counting)?, [1, 2, 3, 4, 5]);
        let args = format!("ask --topic {here} --node second --goal 100000 --cancel 3");
        let given_up = env.actionlib_cpp(&args)?;
        let end = ended(&given_up, 1)?.remove(0);
        assert_eq!((&end["state"], &end["text"]), (&json!("PREEMPTED"), &json!("given up")));
        let aborted = env.actionlib_cpp(&format!("ask --topic {here} --node third --goal -1"))?;
        assert_eq!(ended(&aborted, 1)?[0]["state"], "ABORTED");
        Ok(())
    })
}

/// A server that ignores cancellation has refused it, and a newer goal aborts the one before, unless the route says that
/// it counts as cancelled.
#[test]
fn a_newer_goal_of_another_client_ends_the_one_before() -> Result {
    run("a_newer_goal_of_another_client_ends_the_one_before", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let _server = server(env, "serve")?;
        for (options, state) in [("", "ABORTED"), ("{ preempted: canceled }", "PREEMPTED")] {
            let mut bridge = bridge(env, options)?;
            let first = client(env, "--goal 100000")?;
            first.event("feedback")?;
            let there = env.topic("there");
            let newer = env.actionlib(&format!("ask --topic {there} --node newer --goal 1"))?;
            assert_eq!(ended(&first, 1)?[0]["state"], state);
            assert_eq!(ended(&newer, 1)?[0]["state"], "SUCCEEDED");
            bridge.terminate()?;
            bridge.exits_with(0)?;
        }
        Ok(())
    })
}

/// Patterns of topics leave the five topics of an action to the pattern of actions.
#[test]
fn a_pattern_carries_actions_and_another_one_the_other_topics() -> Result {
    run("a_pattern_carries_actions_and_another_one_the_other_topics", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let server = env.actionlib("serve --topic /robot/count --node server")?;
        server.event("ready")?;
        let _talker =
            env.rospy("publish --topic /robot/said --node talker", Some("{\"data\": \"x\"}"))?;
        let actions = Route::action("ros:/robot/(.*)", "ros:/shown/$1");
        let topics = Route::untyped("ros:/robot/(.*)", "zeromq:/$1");
        let bridge = env.bridge(&env.embedded().route(topics).route(actions))?;
        until_route(&bridge, "ros:/robot/said -> zeromq:/said", |route| route.is_some())?;
        let client = env.actionlib("ask --topic /shown/count --node client --goal 2")?;
        assert_eq!(ended(&client, 1)?[0]["state"], "SUCCEEDED");
        for part in ["goal", "cancel", "status", "feedback", "result"] {
            let route = format!("ros:/robot/count/{part} -> zeromq:/count/{part}");
            until_route(&bridge, &route, |route| route.is_none())?;
        }
        Ok(())
    })
}

const TEST: (&str, &str) =
    ("actionlib/action/Test.action", "int32 goal\n---\nint32 result\n---\nint32 feedback\n");

#[test]
fn commands_send_serve_and_cancel_goals_of_actionlib() -> Result {
    run("commands_send_serve_and_cancel_goals_of_actionlib", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let (there, here) = (ros1(&env.topic("there")), ros1(&env.topic("here")));
        let _server = server(env, "serve")?;
        let send = |goal: &str| {
            let value = format!("{{\"goal\": {goal}}}");
            env.wrapyfi(["action", "send", &there, "--value", &value, "--timeout", "100", "--json"])
        };
        let mut sent = send("2")?;
        let lines = sent.objects(5)?;
        let words: Vec<_> = lines.iter().map(|line| line["goal"].clone()).collect();
        assert_eq!(words, ["accepted", "executing", "feedback", "feedback", "succeeded"]);
        assert_eq!(lines[4]["value"], json!({ "result": 2 }));
        sent.exits_with(0)?;
        // Ctrl-C cancels the goal.
        let interrupted = send("100000")?;
        interrupted.objects(3)?;
        interrupted.interrupt()?;
        interrupted.wait_until("it is cancelled", |output| {
            output.objects().find(|line| line["goal"] == "canceled")
        })?;
        // So does another command those of all clients.
        let asking = env.actionlib(&format!("ask --topic {} --goal 100000", env.topic("there")))?;
        asking.event("feedback")?;
        env.wrapyfi(["action", "cancel", &there, "--timeout", "100"])?.exits_with(0)?;
        assert_eq!(ended(&asking, 1)?[0]["state"], "PREEMPTED");

        let folder = env.definitions(&[TEST])?;
        let kind = ["--type", "actionlib/action/Test", "--definitions", &folder];
        let result = ["--value", "{\"result\": 7}", "--seconds", "0.2", "--count", "1"];
        let mut serving =
            env.wrapyfi(["action", "serve", &here].into_iter().chain(kind).chain(result))?;
        let asking = client(env, "--goal 1")?;
        let end = ended(&asking, 1)?.remove(0);
        assert_eq!((&end["state"], &end["result"]), (&json!("SUCCEEDED"), &json!(7)));
        serving.exits_with(0)
    })
}

/// The whole bridge carries actions by itself, and leaves their five topics alone.
#[test]
fn ros1_bridge_carries_actions() -> Result {
    run("ros1_bridge_carries_actions", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let _server = server(env, "serve")?;
        let bridge = env.executable("ros1_bridge", &["-p", "status_json:=true"])?;
        let (folder, there) = (env.definitions(&[TEST])?, env.topic("there"));
        let kind = ["--type", "actionlib/action/Test", "--definitions", &folder];
        let goal = ["action", "send", &ros2(&there), "--value", "{\"goal\": 2}", "--json"];
        let mut sent = env.wrapyfi(goal.into_iter().chain(["--timeout", "100"]).chain(kind))?;
        let end = sent.objects(5)?.remove(4);
        assert_eq!((&end["goal"], &end["value"]), (&json!("succeeded"), &json!({ "result": 2 })));
        sent.exits_with(0)?;
        for part in ["goal", "cancel", "status", "feedback", "result"] {
            let route = format!("ros:{there}/{part} -> ros2:{there}/{part}");
            until_route(&bridge, &route, |route| route.is_none())?;
        }
        Ok(())
    })
}

/// Results of both had the part that was shown last, so that the clients of one found no server.
#[test]
fn actions_of_two_versions_of_a_type_are_carried_side_by_side() -> Result {
    run("actions_of_two_versions_of_a_type_are_carried_side_by_side", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let versions = [("Count", "int32-x"), ("Row", "int32-x,int32-y"), ("Count", "string-text")];
        let versions = versions.iter().enumerate().map(|(number, (kind, part))| {
            let of = |end: &str| env.topic(&format!("{end}{number}"));
            let kind = format!("--type acme_msgs/{kind} --part {part}");
            (of("there"), of("here"), kind)
        });
        let versions: Vec<_> = versions.collect();
        let mut config = env.embedded();
        let mut servers = Vec::new();
        for (there, here, kind) in &versions {
            let server =
                env.rospy_actions(&format!("serve --action {there} --step 0.01 {kind}"))?;
            server.event("ready")?;
            servers.push(server);
            config = config.route(Route::action(&ros1(there), &ros1(here)));
        }
        let bridge = env.bridge(&config)?;
        for (_, here, kind) in &versions {
            let client = env.rospy_actions(&format!("send --action {here} --order 3 {kind}"))?;
            client.event("done").map_err(|error| error.context(bridge.tail()))?;
            let ends = client.wait_until("the end", |output| Some(output.events("end")))?;
            assert_eq!(ends[0]["sequence"], json!([0, 1, 1, 2, 3]), "{here} {kind}: {ends:?}");
        }
        Ok(())
    })
}
