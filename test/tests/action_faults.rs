//! Faults that other bridges of actions had, on real peers.
//!
//! | fault | tests: here, else by module |
//! | --- | --- |
//! | (a) a rejected goal ends the bridge | `actions::goals_that_actionlib_rejects_or_aborts_end_aborted`, `client_goals::a_rejected_goal_is_aborted_and_says_why` |
//! | (b) a cancel before ACTIVE is forgotten | `a_goal_that_its_server_has_not_taken_is_accepted_and_can_be_cancelled`, `client_goals::a_cancel_before_active_is_not_forgotten`, `action_tests::a_wish_to_cancel_before_the_goal_is_accepted_is_not_forgotten` |
//! | (c) every end without success is an abort | `actions::a_client_of_rclpy_drives_a_server_of_actionlib`, `client_goals::preempted_after_a_cancel_is_canceled_and_without_one_aborted`, `client_goals::recalled_with_no_cancel_asked_is_aborted` |
//! | (d) RECALLING is an end, then nothing | `a_goal_that_its_server_has_not_taken_is_accepted_and_can_be_cancelled`, `client_goals::a_goal_that_is_recalled_ends_with_its_result` |
//! | (e) LOST has a null result | `actions::a_client_of_rclpy_drives_a_server_of_actionlib`, `client_goals::a_goal_that_is_missing_from_a_status_array_is_lost` |
//! | (f) the goal blocks a callback for a second; `send_goal` is answered on ACTIVE | `a_goal_that_its_server_has_not_taken_is_accepted_and_can_be_cancelled`, `ros1: actions::a_goal_its_feedback_and_its_result_cross` |
//! | (g) a cancel is always accepted | `actions::goals_that_rclpy_rejects_aborts_or_goes_on_with_end_so`, `client_goals::a_server_that_goes_on_has_refused_to_cancel`, `action_tests::a_server_may_go_on_with_a_goal_that_was_to_be_cancelled` |
//! | (h) a thread for each goal | `goals_under_way_have_no_threads_of_their_own` |
//! | (i) fields named goal, result or feedback | `ros1_actions::ros1_bridge_carries_actions`, `action_hostile_tests::fields_may_be_called_as_the_parts_that_carry_them` |
//! | a second publisher of status arrays | `an_action_of_ros1_is_offered_beside_no_other`, `two_bridges_with_one_pattern_give_a_goal_to_its_server_once`, `ros1: actions::nothing_is_offered_where_another_node_publishes_the_status`, `ros1: actions::an_action_gives_way_to_a_node_that_publishes_the_status_later` |
//! | stamps that do not rise, in simulated time | `stamps_rise_while_the_clock_stands_still`, `action_messages::stamps_rise_strictly_in_simulated_time_too` |
//! | results are waited for on the loop that drives others | `goals_under_way_have_no_threads_of_their_own`, `action_tests::several_goals_end_each_for_itself` |
//! | ended goals are kept | `server_goals::the_limit_is_of_goals_under_way`, `action_tests::a_result_is_kept_for_ten_seconds_and_freed_though_nobody_fetches_it` |
//! | late joiners miss the status | `who_comes_late_gets_the_status` |
//! | `wait_for_server` lies | `a_client_waits_for_the_real_server`, `action_relay::a_server_that_goes_ends_its_goals_and_is_no_longer_offered` |
//! | a limit of seconds on results | `action_tests::a_goal_goes_there_and_its_feedback_and_result_come_back` waits for an hour |
//! | a cancel waits for the goal | `ros1_actions::a_cancel_is_handled_while_the_goal_runs`, `ros1: actions::a_cancel_reaches_the_goal_while_it_runs` |
//! | bags repeat ids | `goals_that_are_played_again_are_no_new_goals`, `server_goals::an_id_that_repeats_is_no_new_goal`, `action_tests::an_id_that_repeats_is_rejected_and_counted` |

use serde_json::{Value, json};
use wrapyfi_e2e::{
    Need, Output, Process, Result, Route, ros1, ros2, route_status, run, until_route,
};

use super::actions::{FIBONACCI, bridge, end, goals, kilted};

const BOTH: &[Need] = &[Need::Program, Need::Ros1, Need::Actionlib, Need::Kilted];

fn is_active(route: Option<&Value>) -> bool {
    route.is_some_and(|route| route["state"] == "active")
}

/// A client of rclpy is told at once, long before the server has taken the goal up.
#[test]
fn a_goal_that_its_server_has_not_taken_is_accepted_and_can_be_cancelled() -> Result {
    let test = "a_goal_that_its_server_has_not_taken_is_accepted_and_can_be_cancelled";
    run(test, BOTH, |env| {
        let _roscore = env.roscore()?;
        let (ros, action) = (kilted(env)?, env.topic("fib"));
        let bridge = bridge(env, &ros1(&action), &ros2(&action))?;
        let server = env.rospy_actions(&format!("serve --action {action} --behave pend"))?;
        server.event("ready")?;
        let client =
            ros.rclpy_actions(&format!("send --action {action} --order 3 --cancel-accepted"))?;
        let told = end(&client, 0).map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(client.event("accepted")?["accepted"], true);
        assert_eq!(told["state"], "canceled");
        server.event("cancel")?;
        Ok(())
    })
}

/// Threads of a process.
fn threads(process: &Process) -> Result<usize> {
    Ok(std::fs::read_dir(format!("/proc/{}/task", process.id()))?.count())
}

/// A client of rclpy keeps ten replies of a service, those to other clients among them: so one begins after
/// the other.
#[test]
fn goals_under_way_have_no_threads_of_their_own() -> Result {
    const CLIENTS: usize = 3;
    const GOALS: usize = 8;
    run("goals_under_way_have_no_threads_of_their_own", BOTH, |env| {
        let _roscore = env.roscore()?;
        let (ros, action) = (kilted(env)?, env.topic("fib"));
        let bridge = bridge(env, &ros1(&action), &ros2(&action))?;
        let serve = format!("serve --action {action} --goals {GOALS} --step 1");
        let server = env.rospy_actions(&serve)?;
        server.event("ready")?;
        let one = ros.rclpy_actions(&format!("send --action {action} --order 1"))?;
        assert_eq!(end(&one, 0)?["state"], "succeeded");
        let before = threads(&bridge)?;
        let send = format!("send --action {action} --order 20 --goals {GOALS}");
        let mut clients = Vec::new();
        for client in 1..=CLIENTS {
            let asks = ros.rclpy_actions(&send)?;
            let under_way = server.wait_until("its goals are under way", |output| {
                (output.events("goal").len() > client * GOALS).then_some(())
            });
            under_way.map_err(|error| error.context(asks.tail()))?;
            clients.push(asks);
        }
        let under_way = threads(&bridge)?;
        let most = before + CLIENTS * GOALS / 2;
        assert!(under_way < most, "{before} threads, {under_way} with the goals");
        for client in &clients {
            for index in 0..GOALS as u64 {
                assert_eq!(end(client, index)?["state"], "succeeded", "{index}");
            }
        }
        Ok(())
    })
}

/// Every client of the other server would take its goals as lost.
#[test]
fn an_action_of_ros1_is_offered_beside_no_other() -> Result {
    run("an_action_of_ros1_is_offered_beside_no_other", BOTH, |env| {
        let _roscore = env.roscore()?;
        let (ros, action) = (kilted(env)?, env.topic("fib"));
        let bridge = bridge(env, &ros2(&action), &ros1(&action))?;
        let far = ros.rclpy_actions(&format!("serve --action {action}"))?;
        far.event("ready")?;
        let client = env.rospy_actions(&format!("send --action {action} --order 4000"))?;
        client.event("feedback").map_err(|error| error.context(bridge.tail()))?;

        let mut near = env.rospy_actions(&format!("serve --action {action}"))?;
        let told = end(&client, 0)?;
        let is_over = ["aborted", "lost"].contains(&told["state"].as_str().unwrap_or_default());
        assert!(is_over, "{told}");
        far.event("cancel")?;
        let name = format!("{} -> {}", ros1(&action), ros2(&action));
        until_route(&bridge, &name, |route| {
            let reason = route.and_then(|route| route["reason"].as_str()).unwrap_or_default();
            reason.contains("rospy_actions") && reason.contains("offers an action")
        })?;
        let client = env.rospy_actions(&format!("send --action {action} --order 3"))?;
        assert_eq!(end(&client, 0)?["state"], "succeeded");
        assert_eq!(near.event("goal")?["order"], 3);

        near.kill()?;
        until_route(&bridge, &name, is_active)?;
        let client = env.rospy_actions(&format!("send --action {action} --order 2"))?;
        assert_eq!(end(&client, 0)?["state"], "succeeded");
        far.wait_until("the goal is its", |output| {
            output.events("goal").into_iter().find(|goal| goal["order"] == 2)
        })?;
        Ok(())
    })
}

#[test]
fn two_bridges_with_one_pattern_give_a_goal_to_its_server_once() -> Result {
    run("two_bridges_with_one_pattern_give_a_goal_to_its_server_once", BOTH, |env| {
        let _roscore = env.roscore()?;
        let (ros, robot) = (kilted(env)?, env.topic("robot"));
        let (near_name, far_name) = (format!("{robot}/near"), format!("{robot}/far"));
        let prefix = env.definitions(&[FIBONACCI])?;
        let to_ros2 = Route::action(&ros1(&format!("{robot}/(.*)")), "ros2:/shown/$1");
        let to_ros1 = Route::action(&ros2(&format!("{robot}/(.*)")), "ros:/shown/$1");
        let config = env.embedded().with("definitions", &format!("[{prefix:?}]"));
        let config = config.route(to_ros2).route(to_ros1);
        let first = env.bridge_named("first.yaml", &config)?;
        let near = env.rospy_actions(&format!("serve --action {robot}/near"))?;
        let far = ros.rclpy_actions(&format!("serve --action {robot}/far"))?;
        for (here, there) in
            [("ros2:/shown/near", ros1(&near_name)), ("ros:/shown/far", ros2(&far_name))]
        {
            until_route(&first, &format!("{here} -> {there}"), is_active)?;
        }
        // What a client sends while two bridges that began together give way to each other is lost.
        let second = env.bridge_named("second.yaml", &config)?;
        second.wait_until("it has looked around", |output| {
            let report = output.objects().rfind(|it| it["routes"].is_array())?;
            (report["routes"].as_array()?.len() > 2).then_some(())
        })?;
        let to_near = ros.rclpy_actions("send --action /shown/near --order 40")?;
        let to_far = env.rospy_actions("send --action /shown/far --order 40")?;
        for (client, server) in [(&to_near, &near), (&to_far, &far)] {
            let told = end(client, 0)
                .map_err(|error| error.context(first.tail()).context(second.tail()))?;
            assert_eq!(told["state"], "succeeded");
            let taken = server.wait_until("its goals", |output| Some(output.events("goal")))?;
            assert_eq!(taken.len(), 1, "{taken:?}");
        }
        Ok(())
    })
}

/// A SimpleActionServer gives a goal up whose stamp is before that of another one.
#[test]
fn stamps_rise_while_the_clock_stands_still() -> Result {
    run("stamps_rise_while_the_clock_stands_still", BOTH, |env| {
        let _roscore = env.roscore()?;
        let (ros, action) = (kilted(env)?, env.topic("fib"));
        let _simulated = env.rospy("param --topic /use_sim_time --node says", Some("true"))?;
        let at = "{\"clock\": {\"secs\": 5, \"nsecs\": 999999999}}";
        let clock = "publish --topic /clock --type rosgraph_msgs/Clock --node time --rate 20";
        let _clock = env.rospy(clock, Some(at))?;
        let at = "{\"clock\": {\"sec\": 5, \"nanosec\": 999999999}}";
        let clock = ["pub", "ros2:/clock", "--type", "rosgraph_msgs/msg/Clock", "--value", at];
        let _clock_of_ros2 = env.wrapyfi(clock.into_iter().chain(["--rate", "20"]))?;
        env.definitions(&[FIBONACCI])?;
        let config = env.embedded().with("definitions", "[interfaces]");
        let config = config.route(Route::action(&ros1(&action), &ros2(&action)));
        let file = env.write("bridge.yaml", config.yaml())?.display().to_string();
        let simulated = ["--ros-args", "-p", "use_sim_time:=true"];
        let bridge =
            env.wrapyfi(["bridge", "--config", &file, "--json"].into_iter().chain(simulated))?;
        let server = env.rospy_actions(&format!("serve --action {action} --goals 8"))?;
        let client = ros.rclpy_actions(&format!("send --action {action} --order 2 --goals 8"))?;
        for index in 0..8 {
            let told = end(&client, index).map_err(|error| error.context(bridge.tail()))?;
            assert_eq!(told["state"], "succeeded", "{index}");
        }
        let goals = server.wait_until("its goals", |output| Some(output.events("goal")))?;
        let stamps: Vec<u64> = goals.iter().filter_map(|goal| goal["stamp"].as_u64()).collect();
        assert!(stamps.is_sorted_by(|one, next| one < next), "{stamps:?}");
        assert!(stamps.len() == 8 && stamps[0] >= 5_999_999_999 && stamps[7] < 7_000_000_000);
        Ok(())
    })
}

#[test]
fn who_comes_late_gets_the_status() -> Result {
    run("who_comes_late_gets_the_status", BOTH, |env| {
        let _roscore = env.roscore()?;
        let (ros, near, far) = (kilted(env)?, env.topic("near"), env.topic("far"));
        env.definitions(&[FIBONACCI])?;
        let config = env.embedded().with("definitions", "[interfaces]");
        let config = config.route(Route::action(&ros1(&near), &ros2(&near)));
        let bridge = env.bridge(&config.route(Route::action(&ros2(&far), &ros1(&far))))?;
        let _near = env.rospy_actions(&format!("serve --action {near} --behave pend"))?;
        let _far = ros.rclpy_actions(&format!("serve --action {far}"))?;
        let client = ros.rclpy_actions(&format!("send --action {near} --order 1"))?;
        client.event("accepted").map_err(|error| error.context(bridge.tail()))?;
        // Nothing changes any more: what comes was kept.
        let late = ros.rclpy_actions(&format!("watch --action {near}"))?;
        assert_eq!(late.event("status")?["states"], json!([1]));

        let client = env.rospy_actions(&format!("send --action {far} --order 4000"))?;
        client.event("feedback").map_err(|error| error.context(bridge.tail()))?;
        let subscribe = "subscribe --type actionlib_msgs/GoalStatusArray --node late --count 1";
        let late = env.rospy(&format!("{subscribe} --topic {far}/status"), None)?;
        let states = late.messages(1)?[0]["value"]["status_list"].clone();
        assert_eq!((&states[0]["status"], &states[1]), (&json!(1), &Value::Null));
        Ok(())
    })
}

/// A bridge that is there is no server.
#[test]
fn a_client_waits_for_the_real_server() -> Result {
    run("a_client_waits_for_the_real_server", BOTH, |env| {
        let _roscore = env.roscore()?;
        let (ros, near, far) = (kilted(env)?, env.topic("near"), env.topic("far"));
        env.definitions(&[FIBONACCI])?;
        let config = env.embedded().with("definitions", "[interfaces]");
        let config = config.route(Route::action(&ros1(&near), &ros2(&near)));
        let bridge = env.bridge(&config.route(Route::action(&ros2(&far), &ros1(&far))))?;
        let names = [(&near, "ros2", "ros"), (&far, "ros", "ros2")]
            .map(|(name, here, there)| format!("{here}:{name} -> {there}:{name}"));
        let is_waiting = |route: Option<&Value>| route.is_some_and(|it| it["state"] == "waiting");
        let clients = || {
            let of_rclpy = ros.rclpy_actions(&format!("send --action {near} --order 1"))?;
            let of_rospy = env.rospy_actions(&format!("send --action {far} --order 1"))?;
            Ok::<_, anyhow::Error>([of_rclpy, of_rospy])
        };
        let early = clients()?;
        let servers = || {
            let of_rospy = env.rospy_actions(&format!("serve --action {near}"))?;
            let of_rclpy = ros.rclpy_actions(&format!("serve --action {far}"))?;
            Ok::<_, anyhow::Error>([of_rospy, of_rclpy])
        };
        let nobody_is_told = |clients: &[Process]| {
            for name in &names {
                until_route(&bridge, name, is_waiting)?;
            }
            for client in clients {
                let ready = client.wait_until("its word", |out| Some(out.events("ready")))?;
                assert!(ready.is_empty(), "it found a server");
            }
            // What the graph shows is what a client waits for.
            let at = ["action", "send", &ros2(&near), "--timeout", "1"].map(str::to_owned);
            let kind = ["--type", "test_msgs/action/Fibonacci", "--definitions"];
            let folder = env.path("interfaces").display().to_string();
            let kind = kind.into_iter().chain([folder.as_str()]).map(str::to_owned);
            env.wrapyfi(at.into_iter().chain(kind).collect::<Vec<_>>())?.exits_with(3)?;
            Ok::<_, anyhow::Error>(())
        };
        nobody_is_told(&early)?;
        let mut there = servers()?;
        for client in &early {
            let told = end(client, 0).map_err(|error| error.context(bridge.tail()))?;
            assert_eq!(told["state"], "succeeded");
        }
        drop(early);
        // Else the report from before they came would be taken for the one after they have gone.
        for name in &names {
            until_route(&bridge, name, is_active)?;
        }
        for server in &mut there {
            server.kill()?;
        }
        for name in &names {
            until_route(&bridge, name, is_waiting)?;
        }
        let late = clients()?;
        nobody_is_told(&late)?;
        let _again = servers()?;
        for client in &late {
            let told = end(client, 0).map_err(|error| error.context(bridge.tail()))?;
            assert_eq!(told["state"], "succeeded", "{told}");
        }
        Ok(())
    })
}

/// `rosbag play` sends the goals of the record with their ids, again and again.
#[test]
fn goals_that_are_played_again_are_no_new_goals() -> Result {
    const NEEDS: &[Need] = &[Need::Program, Need::Ros1, Need::Actionlib];
    run("goals_that_are_played_again_are_no_new_goals", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let (there, here) = (env.topic("there"), env.topic("here"));
        let config = env.embedded().route(Route::action(&ros1(&there), &ros1(&here)));
        let bridge = env.bridge(&config)?;
        let server = env.actionlib(&format!("serve --topic {there} --node server"))?;
        server.event("ready")?;
        let goal = r#"{"goal_id": {"stamp": {"secs": 7, "nsecs": 0}, "id": "/client-1-7.0"}, "goal": {"goal": 100000}}"#;
        let play = format!("publish --topic {here}/goal --type actionlib/TestActionGoal");
        let _bag = env.rospy(&format!("{play} --node bag --rate 50"), Some(goal))?;
        let name = format!("{} -> {}", ros1(&here), ros1(&there));
        let again = |output: &Output| {
            let route = route_status(output, &name)?;
            (route["counters"]["drops"]["duplicate"].as_u64() >= Some(20)).then_some(())
        };
        bridge.wait_until("the goal is played again", again)?;
        let taken = server.wait_until("its goals", |output| Some(output.events("goal")))?;
        assert_eq!(taken.len(), 1, "{taken:?}");
        goals(&bridge, |goals| goals["accepted"] == 1).map(drop)
    })
}

/// The folder is there, and the package in it; the action is not.
#[test]
fn a_folder_of_definitions_without_the_action_is_told() -> Result {
    const NEEDS: &[Need] = &[Need::Program, Need::Kilted];
    run("a_folder_of_definitions_without_the_action_is_told", NEEDS, |env| {
        let (ros, action) = (kilted(env)?, env.topic("fib"));
        let folder = env.definitions(&[("test_msgs/action/Other.action", "---\n---\n")])?;
        let kind = ["--type", "test_msgs/action/Fibonacci", "--definitions", &folder];
        let mut serve = env.wrapyfi(["action", "serve", &ros2(&action)].into_iter().chain(kind))?;
        serve.exits_with(2)?;
        assert!(serve.stderr().contains("test_msgs/action/Fibonacci"), "{}", serve.stderr());
        let route = Route::action(&ros2(&action), "ros2:/shown");
        let route = route.with("type", "test_msgs/action/Fibonacci");
        let typed = env.embedded().with("definitions", "[interfaces]").route(route);
        let file = env.write("typed.yaml", typed.yaml())?.display().to_string();
        let mut check = env.wrapyfi(["check", &file])?;
        check.exits_with(2)?;
        assert!(check.stderr().contains("test_msgs/action/Fibonacci"), "{}", check.stderr());

        // One that is to be learned waits, and says for what.
        let bridge = {
            let route = Route::action(&ros2(&action), "ros2:/shown");
            env.bridge(&env.embedded().with("definitions", "[interfaces]").route(route))?
        };
        let _server = ros.rclpy_actions(&format!("serve --action {action}"))?;
        until_route(&bridge, &format!("ros2:/shown -> {}", ros2(&action)), |route| {
            let of = |key: &str| route.and_then(|it| it[key].as_str()).unwrap_or_default();
            of("cause") == "definition" && of("reason").contains("test_msgs/action/Fibonacci")
        })
    })
}
