//! Broken set-ups with real peers: `wrapyfi why` alone names the cause and what mends it.

use serde_json::Value;
use wrapyfi_e2e::{
    Need, Process, Result, Route, TIMEOUT, TestEnv, ros1, ros2, run, until_route, yarp, zeromq,
};

/// Longest time that an answer may take on a machine with much else to do. The two seconds that are promised are those for
/// which it looks, with some to spare: `look.rs` adds them up.
const MOST_MS: u64 = 10_000;

const NEEDS: &[Need] = &[Need::Program, Need::Python, Need::Hosts];
const WITH_ROS: &[Need] = &[Need::Program, Need::Python, Need::Hosts, Need::Ros1];
const WITH_FAST: &[Need] = &[Need::Program, Need::Python, Need::Hosts, Need::FastDds];

/// Makes the situation of a folder of `test/broken`, and compares the answer.
fn is_named(folder: &str, needs: &[Need], cause: &str, what: &[&str], remedy: &str) -> Result {
    run(folder, needs, |env| {
        let mut script = env.broken(folder)?;
        script.exits_with(1)?;
        let said = script.stdout();
        let answer: Value = serde_json::from_str(said.trim())?;
        let text = |key: &str| answer[key].as_str().unwrap_or_default().to_owned();
        assert_eq!(text("cause"), cause, "{said}");
        for words in what {
            assert!(text("what").contains(words), "{words:?} is not in {said}");
        }
        assert!(text("remedy").contains(remedy), "{remedy:?} is not in {said}");
        assert!(!text("who").is_empty(), "{said}");
        assert!(answer["took_ms"].as_u64().is_some_and(|ms| ms <= MOST_MS), "{said}");
        Ok(())
    })
}

#[test]
fn wrong_topic() -> Result {
    let what = ["nobody publishes ros2:/chatter", "ros2:/Chatter", "capital letters"];
    is_named("wrong_topic", NEEDS, "other_name", &what, "write ros2:/Chatter")
}

#[test]
fn wrong_type() -> Result {
    let what = ["has type std_msgs/msg/String", "the route has std_msgs/msg/Int32"];
    is_named("wrong_type", NEEDS, "type", &what, "`type: std_msgs/msg/String`")
}

#[test]
fn wrong_qos() -> Result {
    let what = ["offers best effort", "asks for reliable"];
    is_named("wrong_qos", NEEDS, "qos", &what, "leave out `qos` on the route")
}

#[test]
fn other_domain() -> Result {
    let what = ["here (domain 10)", "in domain 12 there is 1 publisher"];
    is_named("other_domain", NEEDS, "other_domain", &what, "ROS_DOMAIN_ID=12")
}

#[test]
fn loopback_broker() -> Result {
    let what = ["10.77.0.2:5555 does not answer", "listens on 127.0.0.1 of that machine alone"];
    let remedy = "wrapyfi broker --ip 10.77.0.2 --insecure";
    is_named("loopback_broker", NEEDS, "loopback_elsewhere", &what, remedy)
}

#[test]
fn loopback_port() -> Result {
    let what = ["yarp:/cam at 127.0.0.1:", "an address of its own machine alone"];
    is_named("loopback_port", NEEDS, "loopback_address", &what, "export YARP_IP=ADDRESS")
}

#[test]
fn service_mapping() -> Result {
    let what = ["speaks rmw_fastrtps_cpp", "rmw_cyclonedds_cpp here"];
    let remedy = "RMW_IMPLEMENTATION=rmw_fastrtps_cpp";
    is_named("service_mapping", WITH_FAST, "service_mapping", &what, remedy)
}

#[test]
fn unresolved_host() -> Result {
    let what = ["robot-base", "does not resolve"];
    is_named("unresolved_host", NEEDS, "unresolved_host", &what, "hosts: { robot-base: ADDRESS }")
}

#[test]
fn missing_definition() -> Result {
    let what = ["nobody here has a definition of geometry_msgs/msg/PolygonInstance"];
    is_named("missing_definition", NEEDS, "definition", &what, "definitions: [DIR]")
}

#[test]
fn dead_master() -> Result {
    let what = ["ROS 1 master 127.0.0.1:11311 does not answer", "nothing listens on port 11311"];
    is_named("dead_master", WITH_ROS, "server_away", &what, "roscore")
}

#[test]
fn killed_node() -> Result {
    let what = ["has registered ros:/chatter at 127.0.0.1:", "it was killed"];
    is_named("killed_node", WITH_ROS, "peer_unreachable", &what, "rosnode cleanup")
}

#[test]
fn cycle() -> Result {
    let what = ["zeromq:/state -> yarp:/state -> ros2:/state -> zeromq:/state"];
    is_named("cycle", NEEDS, "cycle", &what, "write a route from ros2:/state to yarp:/state")
}

#[test]
fn denied() -> Result {
    let what = ["ros2:/camera/raw is left out by deny"];
    is_named("denied", NEEDS, "left_out", &what, "take \".*/raw\" out of `deny`")
}

#[test]
fn no_bridge() -> Result {
    let what = ["no bridge runs the route"];
    is_named("no_bridge", NEEDS, "no_bridge", &what, "wrapyfi bridge --config")
}

#[test]
fn bridge_elsewhere() -> Result {
    let what = ["no bridge runs the route here (domain 10): /wrapyfi_bridge does in domain 12"];
    is_named("bridge_elsewhere", NEEDS, "other_domain", &what, "export ROS_DOMAIN_ID=12")
}

#[test]
fn silent_publisher() -> Result {
    let what = ["no message came on ros2:/chatter", "open and idle"];
    is_named("silent_publisher", NEEDS, "idle", &what, "wrapyfi echo ros2:/chatter")
}

/// Answer about a route of the test's `bridge.yaml`, which a bridge runs, once it has `cause`; none where that is empty.
fn of_running(env: &TestEnv, name: &str, cause: &str) -> Result<Value> {
    let file = env.path("bridge.yaml").display().to_string();
    let is_it = |answer: &Value| answer["cause"].as_str().unwrap_or_default() == cause;
    asked_until(env, [name, "--config", &file], is_it)
}

/// Answer to a question once it is the one that `is_it`.
pub(crate) fn asked_until<const N: usize>(
    env: &TestEnv,
    args: [&str; N],
    is_it: impl Fn(&Value) -> bool,
) -> Result<Value> {
    let deadline = std::time::Instant::now() + TIMEOUT;
    loop {
        let answer = answered(env, args)?;
        if is_it(&answer) {
            return Ok(answer);
        }
        let is_late = std::time::Instant::now() >= deadline;
        anyhow::ensure!(!is_late, "the last answer: {answer}");
    }
}

/// Answer to a question of a shell that maps services as CycloneDDS does.
fn answered<const N: usize>(env: &TestEnv, args: [&str; N]) -> Result<Value> {
    let mut why = env.wrapyfi(["why", "--json"].into_iter().chain(args))?;
    why.exit_code()?;
    Ok(serde_json::from_str(why.stdout().trim())?)
}

/// Bridges are heard on a topic: services have another mapping there, and any other program that listens is none.
#[test]
fn a_bridge_is_heard_whatever_its_services_are_mapped_to() -> Result {
    run("a_bridge_is_heard_whatever_its_services_are_mapped_to", &[Need::Program], |env| {
        const FAST: &str = "rmw_fastrtps_cpp";
        let (words, light) = (env.topic("words"), env.topic("light"));
        let _broker = env.broker()?;
        let _talker = env.wrapyfi([
            "pub",
            &ros2(&words),
            "--type",
            "Text",
            "--value",
            "\"x\"",
            "--rate",
            "10",
        ])?;
        let _ear = env.wrapyfi(["echo", &ros2(&words), "--type", "Text"])?;
        let _wanted = env.wrapyfi(["echo", &zeromq(&words), "--type", "Text"])?;
        let config = env
            .foreign()
            .requests(env)
            .route(Route::new(&ros2(&words), &zeromq(&words), "Text").with("name", "words"))
            .route(Route::service(&zeromq("/light"), &ros2(&light), "std_srvs/srv/SetBool"));
        let file = env.write("bridge.yaml", config.yaml())?.display().to_string();
        let told = answered(env, ["words", "--config", &file])?;
        assert_eq!(told["cause"], "no_bridge", "{told}");
        assert!(told["what"].to_string().contains("none is on the graph of ROS 2"), "{told}");

        let bridge = env.wrapyfi_as(FAST, ["bridge", "--config", &file, "--json"])?;
        until_route(&bridge, "words", |route| route.is_some_and(|it| it["state"] == "active"))?;
        let told = answered(env, ["words", "--config", &file])?;
        let passed = told["passed"].to_string();
        assert!(passed.contains("a bridge runs the route: ") && told["cause"].is_null(), "{told}");

        let change = ["call", "ros2:/wrapyfi_bridge/change_state", "--value"];
        let value = r#"{"transition": {"id": 4}}"#;
        let mut call = env.wrapyfi_as(FAST, change.into_iter().chain([value]))?;
        call.exits_with(0).map_err(|e| e.context(bridge.tail()))?;
        let bare = ros2(&light);
        let remedy =
            format!("RMW_IMPLEMENTATION={FAST} ros2 lifecycle set /wrapyfi_bridge activate");
        for told in [answered(env, ["words", "--config", &file])?, answered(env, [&bare])?] {
            assert_eq!(told["remedy"], remedy, "{told}");
            assert!(told["what"].to_string().contains("/wrapyfi_bridge is inactive"), "{told}");
        }
        let mut call = env.wrapyfi(["call", &bare, "--timeout", "1", "--args", "[true]"])?;
        call.exits_with(3)?;
        let said = call.stderr();
        assert!(said.contains("the bridge /wrapyfi_bridge is inactive"), "{said}");
        assert!(said.contains(&remedy), "{said}");
        Ok(())
    })
}

/// A broker tells its clients nothing of servers; that of the bridge itself is known to have none.
#[test]
fn a_service_of_zeromq_that_nobody_offers_is_told() -> Result {
    run("a_service_of_zeromq_that_nobody_offers_is_told", &[Need::Program], |env| {
        let light = env.topic("light");
        let route = Route::service(&zeromq("/light"), &ros2(&light), "std_srvs/srv/Trigger");
        let bridge =
            env.bridge(&env.embedded().requests(env).route(route.with("name", "light")))?;
        let told = of_running(env, "light", "nobody_offers")?;
        let what = told["what"].to_string();
        assert!(what.contains("waits for a server of zeromq:/light"), "{told}");
        let remedy = told["remedy"].as_str().unwrap_or_default();
        let (_, command) = remedy.split_once("wrapyfi ").ok_or(anyhow::anyhow!("{told}"))?;
        let _server = env.wrapyfi(command.split(' '))?;
        until_route(&bridge, "light", |route| route.is_some_and(|it| it["state"] == "active"))?;
        Ok(())
    })
}

/// A master that was restarted knows no node, while the connections that there were go on.
#[test]
fn a_master_that_was_restarted_is_not_believed_before_the_bridge() -> Result {
    run("a_master_that_was_restarted_is_not_believed_before_the_bridge", WITH_ROS, |env| {
        let mut roscore = env.roscore()?;
        let topic = env.topic("chat");
        let route = Route::new(&ros1(&topic), &ros2(&topic), "std_msgs/msg/String");
        let bridge = env.bridge(&env.embedded().route(route.with("name", "chat")))?;
        let talk = format!("publish --topic {topic} --node talker --rate 10");
        let _talker = env.rospy(&talk, Some("{\"data\": \"hello\"}"))?;
        let _listener = env.wrapyfi(["echo", &ros2(&topic), "--type", "Text"])?;
        until_route(&bridge, "chat", |route| {
            route.is_some_and(|it| it["counters"]["sent"].as_u64() > Some(20))
        })?;
        roscore.kill()?;
        let file = env.path("bridge.yaml").display().to_string();
        let told = answered(env, ["chat", "--config", &file])?;
        let passed = told["passed"].to_string();
        assert!(told["cause"].is_null(), "{told}");
        assert!(passed.contains("messages pass, but ROS 1 master"), "{told}");
        let _again = env.roscore()?;
        let told = answered(env, ["chat", "--config", &file])?;
        let passed = told["passed"].to_string();
        assert!(told["cause"].is_null(), "{told}");
        assert!(passed.contains("messages pass, but nobody publishes"), "{told}");
        assert!(passed.contains("that the ROS 1 master knows: where it was restarted"), "{told}");
        Ok(())
    })
}

/// Nothing has passed on them: the server that the bridge has, and the publisher that no program listens to.
#[test]
fn what_a_bridge_has_outlives_the_list_of_a_master() -> Result {
    run("what_a_bridge_has_outlives_the_list_of_a_master", WITH_ROS, |env| {
        let mut roscore = env.roscore()?;
        let (topic, lamp) = (env.topic("chat"), env.topic("lamp"));
        let chat = Route::new(&ros1(&topic), &ros2(&topic), "std_msgs/msg/String");
        let serves = Route::service(&ros1(&lamp), &ros2(&lamp), "std_srvs/srv/SetBool");
        let routes = env.embedded().route(chat.with("name", "chat"));
        let bridge = env.bridge(&routes.route(serves.with("name", "lamp")))?;
        let talk = format!("publish --topic {topic} --node talker --rate 10");
        let _talker = env.rospy(&talk, Some("{\"data\": \"hello\"}"))?;
        let _server = env.rospy(&format!("serve --topic {lamp} --node server"), None)?;
        for name in ["chat", "lamp"] {
            until_route(&bridge, name, |route| route.is_some_and(|it| it["has_source"] == true))?;
        }
        roscore.kill()?;
        let _again = env.roscore()?;
        let file = env.path("bridge.yaml").display().to_string();
        let said = "the bridge /wrapyfi_bridge has it, but nobody";
        let asked = [answered(env, ["lamp", "--config", &file])?, answered(env, [&ros1(&lamp)])?];
        for told in asked {
            assert!(told["cause"].is_null(), "{told}");
            assert!(told["passed"].to_string().contains(&format!("{said} offers")), "{told}");
        }
        let told = answered(env, ["chat", "--config", &file])?;
        assert_eq!(told["cause"], "nobody_listens", "{told}");
        assert!(told["passed"].to_string().contains(&format!("{said} publishes")), "{told}");
        Ok(())
    })
}

/// A bridge has names of its own for the ends of its routes, where it is started with remap rules or in a namespace.
#[test]
fn a_bridge_that_has_other_names_is_found_by_all_of_them() -> Result {
    run("a_bridge_that_has_other_names_is_found_by_all_of_them", &[Need::Program], |env| {
        let (words, lab) = (env.topic("words"), env.topic("lab"));
        let route = |from: &str, name: &str| {
            Route::new(&ros2(from), &zeromq(&words), "Text").with("name", name)
        };
        let config = env.embedded().route(route("/chatter", "chat"));
        let file = env.write("bridge.yaml", config.yaml())?.display().to_string();
        let (rule, space) = (format!("/chatter:={lab}/news"), format!("__ns:={lab}"));
        let started =
            ["bridge", "--config", &file, "--json", "--ros-args", "-r", &rule, "-r", &space];
        let bridge = env.wrapyfi(started)?;
        let news = format!("{lab}/news");
        let talk = ["pub", &ros2(&news), "--type", "Text", "--value", "\"x\"", "--rate", "20"];
        let _talker = env.wrapyfi(talk)?;
        let _ear = env.wrapyfi(["echo", &zeromq(&words), "--type", "Text"])?;
        until_route(&bridge, "chat", |route| {
            route.is_some_and(|it| it["counters"]["sent"].as_u64() > Some(10))
        })?;
        for name in ["chat", "ros2:/chatter", &ros2(&news), &zeromq(&words)] {
            let told = answered(env, [name, "--config", &file])?;
            let passed = told["passed"].to_string();
            assert!(told["cause"].is_null(), "{name}: {told}");
            assert!(passed.contains(&format!("{} has 1 publisher", ros2(&news))), "{name}: {told}");
        }
        Ok(())
    })
}

/// A program that is stopped keeps its connections: the program that asks it learns that it does not answer.
#[test]
fn a_publisher_that_hangs_is_named() -> Result {
    run("a_publisher_that_hangs_is_named", WITH_ROS, |env| {
        let (_roscore, _names) = (env.roscore()?, env.yarpserver()?);
        let [chat, cam] = ["chat", "cam"].map(|name| env.topic(name));
        let chats = Route::new(&ros1(&chat), &ros2(&chat), "std_msgs/msg/String");
        let cams = Route::new(&yarp(&cam), &ros2(&cam), "NativeObject");
        let config =
            env.embedded().route(chats.with("name", "chat")).route(cams.with("name", "cam"));
        let bridge = env.bridge(&config)?;
        let talk = format!("publish --topic {chat} --node talker --rate 20");
        let of_ros = env.rospy(&talk, Some("{\"data\": \"hello\"}"))?;
        let shown = ["pub", &yarp(&cam), "--type", "NativeObject", "--value", "1", "--rate", "20"];
        let of_yarp = env.wrapyfi(shown)?;
        let _text = env.wrapyfi(["echo", &ros2(&chat), "--type", "Text", "--timeout", "200"])?;
        let _object =
            env.wrapyfi(["echo", &ros2(&cam), "--type", "NativeObject", "--timeout", "200"])?;
        for (name, publisher) in [("chat", &of_ros), ("cam", &of_yarp)] {
            until_route(&bridge, name, |route| {
                route.is_some_and(|it| it["counters"]["sent"].as_u64() > Some(10))
            })?;
            publisher.pause()?;
            let told = of_running(env, name, "peer_unreachable");
            publisher.resume()?;
            let what = told?["what"].to_string();
            assert!(what.contains("connections are accepted and nobody answers"), "{what}");
            assert_eq!(of_running(env, name, "")?["cause"], Value::Null);
        }
        Ok(())
    })
}

/// A bridge that was told to leave a route out, one that is stopped, and a second one.
#[test]
fn a_second_bridge_is_not_what_mends_a_route() -> Result {
    run("a_second_bridge_is_not_what_mends_a_route", &[Need::Program], |env| {
        let words = env.topic("words");
        let route = Route::new(&ros2(&words), &zeromq(&words), "Text").with("name", "words");
        let bridge = env.bridge(&env.embedded().route(route))?;
        let talk = ["pub", &ros2(&words), "--type", "Text", "--value", "\"x\"", "--rate", "10"];
        let mut talker = env.wrapyfi(talk)?;
        let _ear = env.wrapyfi(["echo", &zeromq(&words), "--type", "Text"])?;
        let file = env.path("bridge.yaml").display().to_string();
        let is_well = |route: Option<&Value>| route.is_some_and(|it| it["state"] == "active");
        until_route(&bridge, "words", is_well)?;

        let remove = ["call", "ros2:/wrapyfi_bridge/remove_route", "--value"];
        let name = r#"{"name": "words"}"#;
        env.wrapyfi(remove.into_iter().chain([name]))?.exits_with(0)?;
        let told = of_running(env, "words", "no_bridge")?;
        for name in ["words", &ros2(&words), &zeromq(&words)] {
            let of_bridge = answered(env, [name, "--node", "/wrapyfi_bridge"])?;
            assert_eq!(of_bridge["remedy"], told["remedy"], "{name}: {of_bridge}");
        }
        let remedy = told["remedy"].as_str().unwrap_or_default();
        let (call, value) = remedy.split_once(" --value ").unwrap_or_default();
        let call = call.split(' ').skip(1).chain(["--value", value.trim_matches('\'')]);
        env.wrapyfi(call)?.exits_with(0).map_err(|error| error.context(told.to_string()))?;
        until_route(&bridge, "words", is_well)?;

        bridge.pause()?;
        let told = of_running(env, "words", "no_bridge");
        // Its broker is silent with it.
        let of_broker = answered(env, [&zeromq(&words)]);
        let mut top = env.wrapyfi(["top", "--once"])?;
        let of_top = top.exits_with(3).map(|_| top.stderr());
        bridge.resume()?;
        let remedy = format!("kill -CONT {}, or `fg` in its shell", bridge.id());
        for told in [told?, of_broker?] {
            assert_eq!(told["remedy"], remedy, "{told}");
        }
        let of_top = of_top?;
        assert!(of_top.contains(&remedy), "{of_top}");

        let second = env.wrapyfi(["bridge", "--config", &file, "--json"])?;
        until_route(&second, "words", is_well)?;
        let told = of_running(env, "words", "several_bridges")?;
        let what = told["what"].to_string();
        assert!(
            what.contains("2 bridges run the route, /wrapyfi_bridge, /wrapyfi_bridge"),
            "{told}"
        );

        talker.kill()?;
        let is_waiting = |route: Option<&Value>| route.is_some_and(|it| it["state"] == "waiting");
        for bridge in [&bridge, &second] {
            until_route(bridge, "words", is_waiting)?;
        }
        let told = of_running(env, "words", "nobody_publishes")?;
        assert!(told["passed"].to_string().contains("2 bridges run the route"), "{told}");
        Ok(())
    })
}

/// A bridge with the route `name`, who listens behind it, and who publishes an object before it.
fn an_object_to_ros2(env: &TestEnv, name: &str, message_type: &str) -> Result<[Process; 3]> {
    let topic = env.topic(name);
    let route = Route::new(&zeromq(&topic), &ros2(&topic), message_type).with("name", name);
    let bridge = env.bridge(&env.embedded().route(route))?;
    let listener =
        env.wrapyfi(["echo", &ros2(&topic), "--type", message_type, "--timeout", "200"])?;
    let talk = ["pub", &zeromq(&topic), "--type", "NativeObject", "--value", "{\"a\": 1}"];
    let talker = env.wrapyfi(talk.into_iter().chain(["--rate", "20"]))?;
    Ok([bridge, listener, talker])
}

/// The bridge's own endpoints, which are on the graph as well, are no other program's.
#[test]
fn a_running_route_that_is_well_lacks_nothing() -> Result {
    run("a_running_route_that_is_well_lacks_nothing", &[Need::Program], |env| {
        let _programs = an_object_to_ros2(env, "talk", "NativeObject")?;
        let deadline = std::time::Instant::now() + TIMEOUT;
        loop {
            let file = env.path("bridge.yaml").display().to_string();
            let mut why = env.wrapyfi(["why", "talk", "--config", &file])?;
            let (code, said) = (why.exit_code()?, why.stdout());
            if code == 0 && said.contains("a bridge runs the route") {
                assert!(said.contains("nothing is missing"), "{said}");
                return Ok(());
            }
            let is_late = std::time::Instant::now() >= deadline;
            anyhow::ensure!(!is_late, "the last answer: {said}");
        }
    })
}

/// The file alone is given: the state is that of the bridge on the graph.
#[test]
fn a_running_route_that_drops_every_message_is_named() -> Result {
    run("a_running_route_that_drops_every_message_is_named", &[Need::Program], |env| {
        let _programs = an_object_to_ros2(env, "cam", "std_msgs/msg/Int32")?;
        let answer = of_running(env, "cam", "drops")?;
        let what = answer["what"].as_str().unwrap_or_default();
        assert!(what.contains("messages of the route are dropped"), "{answer}");
        assert!(answer["remedy"].as_str().is_some_and(|it| it.contains("type")), "{answer}");
        let passed = answer["passed"].to_string();
        assert!(passed.contains("a bridge runs the route: "), "{answer}");
        Ok(())
    })
}

/// Nothing gives a type: the one that is learned is compared with what the listener wants.
#[test]
fn a_subscriber_of_another_type_at_the_destination_is_named() -> Result {
    run("a_subscriber_of_another_type_at_the_destination_is_named", WITH_ROS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("talk");
        let route = Route::untyped(&ros1(&topic), &ros2(&topic)).with("name", "talk");
        let bridge = env.bridge(&env.embedded().route(route))?;
        let talk = format!("publish --topic {topic} --node talker");
        let _talker = env.rospy(&talk, Some("{\"data\": \"hello\"}"))?;
        until_route(&bridge, "talk", |route| {
            route.is_some_and(|route| route["type"] == "std_msgs/msg/String")
        })?;
        let _listener = env.dds_subscriber(&topic, "geometry_msgs/msg/Point", "")?;
        let answer = of_running(env, "talk", "type")?;
        let what = answer["what"].as_str().unwrap_or_default();
        let words = "wants type geometry_msgs/msg/Point, the route has std_msgs/msg/String";
        assert!(what.contains(words), "{answer}");
        Ok(())
    })
}

/// The master knows one type of a topic: what its subscriber wants shows where it connects.
#[test]
fn a_subscriber_of_another_type_on_ros_1_is_named() -> Result {
    run("a_subscriber_of_another_type_on_ros_1_is_named", WITH_ROS, |env| {
        let _roscore = env.roscore()?;
        let topic = env.topic("talk");
        let route = Route::new(&ros2(&topic), &ros1(&topic), "std_msgs/msg/String");
        let bridge = env.bridge(&env.embedded().route(route.with("name", "talk")))?;
        let _talker = env.dds_publisher(&topic, "std_msgs/msg/String", "--text hello --rate 5")?;
        let _listener = env.rospy(
            &format!("subscribe --topic {topic} --type geometry_msgs/Point --node ear"),
            None,
        )?;
        until_route(&bridge, "talk", |route| {
            let reason = route.and_then(|it| it["reason"].as_str());
            reason
                .is_some_and(|it| it.contains("of std_msgs/String: /ear wants geometry_msgs/Point"))
        })?;
        let answer = of_running(env, "talk", "state")?;
        let what = answer["what"].as_str().unwrap_or_default();
        assert!(what.contains("/ear wants geometry_msgs/Point"), "{answer}");
        // Who only looks whether a program is there is no refused subscriber, nor one who is waited for.
        answered(env, [&ros1(&topic)])?;
        let answer = of_running(env, "talk", "state")?;
        assert!(answer["remedy"].to_string().contains("`type: geometry_msgs/Point`"), "{answer}");
        let log = bridge.stderr();
        assert!(!log.contains("refused a connection"), "{log}");
        Ok(())
    })
}

/// A mere name, whose bridge tells what keeps a route from it.
#[test]
fn a_name_from_which_a_route_takes_nothing_is_told_with_the_cause() -> Result {
    run("a_name_from_which_a_route_takes_nothing_is_told_with_the_cause", WITH_ROS, |env| {
        let _roscore = env.roscore()?;
        let [typed, limited, denied] = ["typed", "limited", "denied"].map(|it| env.topic(it));
        let of_type = Route::new(&ros1(&typed), &ros2(&typed), "std_msgs/msg/Int32");
        let of_peers = Route::new(&ros1(&limited), &ros2(&limited), "std_msgs/msg/String");
        let of_peers = of_peers.with("options", "{ from_peers: [/friend] }");
        let pattern = Route::untyped("ros:/(.*denied.*)", "ros2:/$1");
        let pattern = pattern
            .with("name", "all")
            .with("deny", &format!("[{}]", denied.trim_start_matches('/')));
        let config = env.embedded().route(of_type).route(of_peers).route(pattern);
        let _bridge = env.bridge(&config)?;
        let mut talkers = Vec::new();
        for (topic, node) in [(&typed, "odd"), (&limited, "stranger"), (&denied, "other")] {
            let talk = format!("publish --topic {topic} --node {node} --rate 20");
            talkers.push(env.rospy(&talk, Some("{\"data\": \"hello\"}"))?);
        }
        let _int = env.dds_subscriber(&typed, "std_msgs/msg/Int32", "")?;
        let _text = env.dds_subscriber(&limited, "std_msgs/msg/String", "")?;
        let told = |topic: &str, cause: &str, what: &str, remedy: &str| {
            asked_until(env, [&ros1(topic)], |answer| {
                let has = |key: &str, words: &str| answer[key].to_string().contains(words);
                answer["cause"] == cause && has("what", what) && has("remedy", remedy)
            })
        };
        told(&typed, "state", "std_msgs/String", "`type: std_msgs/String`")?;
        told(&limited, "refused", "/stranger", "from_peers")?;
        told(&denied, "left_out", "the pattern all of", "--node /wrapyfi_bridge")?;
        let by_node = answered(env, [&ros1(&denied), "--node", "/wrapyfi_bridge"])?;
        assert!(by_node["what"].to_string().contains("left out by deny"), "{by_node}");
        let mut none = env.wrapyfi(["why", "x", "--node", "/none"])?;
        assert_eq!(none.exit_code()?, 3);
        assert!(none.stderr().contains("there: /wrapyfi_bridge"), "{}", none.stderr());
        Ok(())
    })
}

/// A program that was stopped by Ctrl-Z sends nothing, and DDS forgets it.
#[test]
fn a_stopped_program_is_told_where_nobody_has_the_name() -> Result {
    run("a_stopped_program_is_told_where_nobody_has_the_name", NEEDS, |env| {
        let name = ros2(&env.topic("rests"));
        let talker =
            env.wrapyfi(["pub", &name, "--type", "Text", "--value", "\"x\"", "--rate", "20"])?;
        asked_until(env, [&name], |answer| answer["cause"] != "nobody_publishes")?;
        talker.pause()?;
        let told = asked_until(env, [&name], |answer| answer["cause"] == "nobody_publishes");
        talker.resume()?;
        let who = told?["who"].to_string();
        assert!(who.contains("kill -CONT") && who.contains(&name), "{who}");
        Ok(())
    })
}
