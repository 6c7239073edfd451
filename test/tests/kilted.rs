//! ROS 2 Kilted around our programs: nodes of rclpy on Fast DDS 3, which tell each other their types by XTypes.

use anyhow::Context as _;
use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Output, Process, RealRos2, Result, Route, TestEnv, ros2, run};

use crate::real_ros2;

const NEEDS: &[Need] = &[Need::Program, Need::Python, Need::Kilted];

fn on_kilted(test: &str, body: impl FnOnce(&TestEnv, &RealRos2<'_>) -> Result) -> Result {
    run(test, NEEDS, |env| body(env, &RealRos2::kilted(env)?))
}

/// Tests that an installed ROS 2 runs as well, of those that need no `ros2`.
macro_rules! as_on_ros2 {
    ($($test:ident),*) => { $(
        #[test]
        fn $test() -> Result {
            on_kilted(&format!("kilted_{}", stringify!($test)), real_ros2::$test)
        }
    )* };
}

as_on_ros2!(
    types_of_many_fields_go_through_zeromq_and_back,
    images_go_through_zeromq_and_back,
    ours_echoes_and_publishes_with_types_of_the_installation,
    services_of_rclpy_are_called,
    parameters_of_a_node_of_rclpy_are_set_by_ours
);

#[test]
fn services_need_no_choice() -> Result {
    on_kilted("services_need_no_choice", |env, ros| {
        env.set_variable("RMW_IMPLEMENTATION", "");
        let service = env.topic("light");
        let serve = ["serve", &ros2(&service), "--type", "std_srvs/srv/SetBool", "--value"];
        let server = env.wrapyfi([&serve[..], &[r#"{"message": "so be it"}"#]].concat())?;
        // Before a client of CycloneDDS's mapping: after it the first request of one on Fast DDS may be lost.
        let client = format!("call --topic {service} --type std_srvs/srv/SetBool");
        let client = ros.rclpy(&client, Some(r#"{"data": true}"#))?;
        let reply = client.event("reply").map_err(|error| error.context(server.tail()))?;
        assert_eq!(reply["value"]["message"], "so be it");
        for rmw in ["rmw_cyclonedds_cpp", "rmw_fastrtps_cpp"] {
            let call = ["call", &ros2(&service), "--timeout", "60", "--value", r#"{"data": true}"#];
            env.wrapyfi_as(rmw, call)?.exits_with(0)?;
        }
        real_ros2::services_of_rclpy_are_called(env, ros)
    })
}

/// The client asks as soon as one of the stacks that the server is on has matched.
#[test]
fn a_client_that_waits_for_a_service_is_answered() -> Result {
    on_kilted("a_client_that_waits_for_a_service_is_answered", |env, ros| {
        env.set_variable("RMW_IMPLEMENTATION", "");
        for round in 0..4 {
            let service = env.topic(&format!("light{round}"));
            let client = format!("call --topic {service} --type std_srvs/srv/SetBool");
            let client = ros.rclpy(&client, Some(r#"{"data": true}"#))?;
            client.event("ready")?;
            let serve = ["serve", &ros2(&service), "--type", "std_srvs/srv/SetBool", "--value"];
            let server = env.wrapyfi([&serve[..], &[r#"{"message": "so be it"}"#]].concat())?;
            client.event("reply").map_err(|error| error.context(server.tail()))?;
        }
        Ok(())
    })
}

/// A type with a sequence of strings: from what the nodes told each other about it, CycloneDDS took it for invalid.
const KIND: &str = "sensor_msgs/msg/JointState";

#[test]
fn every_late_node_is_heard_and_hears() -> Result {
    on_kilted("every_late_node_is_heard_and_hears", |env, ros| {
        let (to, from) = (env.topic("to"), env.topic("from"));
        let (to_ours, from_ours) = (ros2(&from), ros2(&to));
        let value = r#"{"name": ["elbow"]}"#;
        let publish = ["pub", &from_ours, "--type", KIND, "--value", value];
        let _publisher =
            ros.wrapyfi([&publish[..], &["--qos", "latched", "--rate", "0.001"]].concat())?;
        let echo = ros.wrapyfi(["echo", &to_ours, "--type", KIND, "--json"])?;
        // Each with all those before it, which have told each other their types.
        let mut nodes = Vec::new();
        for number in 0..6 {
            let ear =
                format!("subscribe --topic {to} --type {KIND} --qos latched --node ear{number}");
            let heard = |ear: &Process| Ok(ear.messages(1)?[0]["value"]["name"][0].clone());
            let (ear, heard) = unless_it_crashes(|| ros.rclpy(&ear, None), heard)?;
            assert_eq!(heard, "elbow", "{number}");
            let mouth = format!("publish --topic {from} --type {KIND} --node mouth{number}");
            let name = format!("mouth{number}");
            let value = format!(r#"{{"name": ["{name}"]}}"#);
            let is_heard = |mouth: &Process| {
                let heard = |output: &Output| {
                    output.objects().any(|object| object["value"]["name"][0] == name.as_str())
                };
                echo.wait_until(&name, |output| {
                    (heard(output) || mouth.has_crashed()).then(|| heard(output))
                })?
                .then_some(())
                .with_context(|| format!("{name} has crashed"))
            };
            let (mouth, ()) = unless_it_crashes(|| ros.rclpy(&mouth, Some(&value)), is_heard)?;
            nodes.extend([ear, mouth]);
        }
        Ok(())
    })
}

/// Starts a node until `done` has what it looks for, again where the node crashes: Fast DDS 3.2.2 goes through what
/// waits for a type without the lock (`TypeLookupManager::notify_callbacks`), while other nodes of that type come.
fn unless_it_crashes<T>(
    start: impl Fn() -> Result<Process>,
    done: impl Fn(&Process) -> Result<T>,
) -> Result<(Process, T)> {
    const MOST: usize = 5;
    let mut crashes = 0;
    loop {
        let node = start()?;
        match done(&node) {
            Ok(found) => return Ok((node, found)),
            Err(_) if node.has_crashed() && crashes < MOST => crashes += 1,
            Err(error) => return Err(error.context(format!("after {crashes} crashes"))),
        }
    }
}

const FIBONACCI: &str = "test_msgs/action/Fibonacci";

/// Words under which `wrapyfi action send --json` tells of a goal until it says `last`, each once where it comes several
/// times in a row.
fn told(process: &Process, last: &str) -> Result<Vec<String>> {
    process.wait_until(last, |output| {
        let words = output.objects().filter_map(|it| it["goal"].as_str().map(str::to_owned));
        let mut words: Vec<_> = words.collect();
        words.dedup();
        words.iter().any(|word| word == last).then_some(words)
    })
}

#[test]
fn actions_of_rclpy_are_driven() -> Result {
    on_kilted("actions_of_rclpy_are_driven", |env, ros| {
        let action = env.topic("fibonacci");
        let at = ros2(&action);
        let server = format!("achieve --topic {action} --type {FIBONACCI} --rate 10");
        let server = ros.rclpy(&server, None)?;
        server.event("ready")?;
        let send = |order: i64| {
            let goal = format!("{{\"order\": {order}}}");
            let send = ["action", "send", &at, "--json", "--timeout", "60", "--value", &goal];
            ros.wrapyfi(send)
        };
        let reached = ["accepted", "executing", "feedback"];
        for (order, code, end) in [(5, 0, "succeeded"), (0, 1, "aborted"), (-1, 1, "rejected")] {
            let mut goal = send(order)?;
            goal.exits_with(code)?;
            let wanted = match order {
                5 => [&reached[..], &[end]].concat(),
                0 => vec![reached[0], reached[1], end],
                _ => vec![end],
            };
            assert_eq!(told(&goal, end)?, wanted, "{order}");
            if order == 5 {
                let all = goal.objects(8)?;
                assert_eq!(all[6]["value"]["sequence"], json!([0, 1, 1, 2, 3, 5, 8]));
                assert_eq!(all[7]["value"]["sequence"], all[6]["value"]["sequence"]);
            }
        }
        // Several goals, of which one is cancelled, and one cannot be. Both outlast any wait for what comes before.
        let (mut one, refused) = (send(10_000)?, send(10_013)?);
        told(&one, "feedback")?;
        told(&refused, "feedback")?;
        one.interrupt()?;
        refused.interrupt()?;
        one.exits_with(1)?;
        assert_eq!(told(&one, "canceled")?, [&reached[..], &["canceling", "canceled"]].concat());
        told(&refused, "cancel_refused").map(drop)
    })
}

#[test]
fn actions_of_ours_are_driven_by_rclpy() -> Result {
    on_kilted("actions_of_ours_are_driven_by_rclpy", |env, ros| {
        let (reached, cancelled) = (env.topic("reached"), env.topic("cancelled"));
        let more = ["--value", r#"{"sequence": [1, 2]}"#, "--feedback", r#"{"sequence": [7]}"#];
        let serve = |action: &str, seconds: &str| {
            let at = ros2(action);
            let serve = ["action", "serve", &at, "--type", FIBONACCI, "--json"];
            ros.wrapyfi([&serve[..], &more, &["--every", "0.05", "--seconds", seconds]].concat())
        };
        let send = |action: &str, more: &str| {
            let send = format!("send --topic {action} --type {FIBONACCI} {more}");
            ros.rclpy(&send, Some(r#"{"order": 3}"#))
        };
        let _servers = (serve(&reached, "3")?, serve(&cancelled, "100")?);
        let client = send(&reached, "--count 8")?;
        let (ends, feedback) = client.wait_until("the ends of all", |output| {
            let ends = output.events("ended");
            (ends.len() == 8).then(|| (ends, output.events("feedback").len()))
        })?;
        for end in ends {
            assert_eq!((&end["status"], &end["value"]["sequence"]), (&json!(4), &json!([1, 2])));
        }
        assert!(feedback > 20, "{feedback}");
        let client = send(&cancelled, "--cancel")?;
        let end = client.event("ended")?;
        assert_eq!((&end["status"], &end["value"]["sequence"]), (&json!(5), &json!([1, 2])));
        assert_eq!(client.event("cancel")?["code"], 0);
        Ok(())
    })
}

/// As `ros2 action echo` reads them, which the wheels do not have: of the bridge as a client, and as a server.
#[test]
fn events_of_an_action_are_heard_by_rclpy() -> Result {
    on_kilted("events_of_an_action_are_heard_by_rclpy", |env, ros| {
        env.set_variable("RMW_IMPLEMENTATION", "");
        let (real, shown) = (env.topic("real"), env.topic("shown"));
        let route = Route::action(&ros2(&real), &ros2(&shown));
        let route = route.with("options", "{ introspection: contents }");
        env.definitions(&[crate::actions::FIBONACCI])?;
        let bridge = env.embedded().with("definitions", "[interfaces]").route(route);
        let bridge = env.bridge(&bridge)?;
        let kind = format!("--type {FIBONACCI}");
        let _server = ros.rclpy(&format!("achieve --topic {real} {kind}"), None)?;
        let ears = [(&real, "ear_of_real", [0, 3]), (&shown, "ear_of_shown", [1, 2])];
        for (action, node, kinds) in ears {
            let topic = format!("{action}/_action/send_goal/_service_event");
            let ear = format!("subscribe --topic {topic} {kind}_SendGoal_Event --node {node}");
            let ear = ros.rclpy(&ear, None)?;
            ear.event("ready")?;
            // Events are not kept: those before the ear has found the bridge are lost.
            let [asked, answered] = loop {
                let goal = format!("send --topic {shown} {kind}");
                let client = ros.rclpy(&goal, Some(r#"{"order": 3}"#))?;
                client.event("ended").map_err(|error| error.context(bridge.tail()))?;
                let heard = ear.wait_until("events", |output| Some(output.events("message")))?;
                if let Some(pair) = pair(&heard, kinds) {
                    break pair;
                }
            };
            assert_eq!(asked["request"][0]["goal"]["order"], 3);
            assert_eq!(asked["response"], json!([]));
            assert_eq!(answered["request"], json!([]));
            assert_eq!(answered["response"][0]["accepted"], true);
            assert_eq!(asked["info"]["client_gid"], answered["info"]["client_gid"]);
        }
        Ok(())
    })
}

/// Zenoh and newer middlewares of ROS 2 connect nothing whose hash is another one.
#[test]
fn events_have_the_hashes_of_ros_2() -> Result {
    on_kilted("events_have_the_hashes_of_ros_2", |env, ros| {
        env.set_variable("RMW_IMPLEMENTATION", "");
        let (real, shown, light) = (env.topic("real"), env.topic("shown"), env.topic("light"));
        let lit = env.topic("lit");
        let events = |route: Route| route.with("options", "{ introspection: metadata }");
        let action = Route::action(&ros2(&real), &ros2(&shown)).with("type", FIBONACCI);
        let service = Route::service(&ros2(&light), &ros2(&lit), "std_srvs/srv/SetBool");
        env.definitions(&[crate::actions::FIBONACCI])?;
        let config = env.embedded().with("definitions", "[interfaces]");
        let bridge = env.bridge(&config.route(events(action)).route(events(service)))?;
        let parts = [
            ("send_goal", format!("{FIBONACCI}_SendGoal_Event")),
            ("get_result", format!("{FIBONACCI}_GetResult_Event")),
            ("cancel_goal", "action_msgs/srv/CancelGoal_Event".to_owned()),
        ];
        let _server = ros.rclpy(&format!("achieve --topic {real} --type {FIBONACCI}"), None)?;
        let of_action = [&real, &shown].into_iter().flat_map(|action| {
            parts.each_ref().map(|(part, kind)| (format!("{action}/_action/{part}"), kind.clone()))
        });
        let of_service = [light, lit].map(|name| (name, "std_srvs/srv/SetBool_Event".to_owned()));
        for (service, kind) in of_action.chain(of_service) {
            let asks = format!("hash --topic {service}/_service_event --type {kind}");
            let told = ros.rclpy(&asks, None)?.event("hash");
            let told = told.map_err(|error| error.context(bridge.tail()))?;
            assert_eq!(told["announced"], json!([told["known"]]), "{kind} of {service}");
        }
        Ok(())
    })
}

/// The first event of one kind, and that of the other kind for the same request.
fn pair(heard: &[Value], kinds: [u64; 2]) -> Option<[Value; 2]> {
    let values = || heard.iter().map(|message| &message["value"]);
    let asked = values().find(|event| event["info"]["event_type"] == kinds[0])?;
    let is_answer = |event: &&Value| {
        let (one, other) = (&event["info"], &asked["info"]);
        one["event_type"] == kinds[1] && one["sequence_number"] == other["sequence_number"]
    };
    Some([asked.clone(), values().find(is_answer)?.clone()])
}
