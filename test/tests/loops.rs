//! Messages that would go round for ever between bridges whose written routes lead back.

use std::time::{Duration, Instant};

use anyhow::ensure;
use serde_json::Value;
use wrapyfi_e2e::{
    Config, Need, Output, Process, Result, Route, TIMEOUT, TestEnv, ros2, route_status, run, yarp,
    zeromq,
};

use super::real_yarp::yarps_server;

const NEEDS: &[Need] = &[Need::Program];

fn text(from: &str, to: &str) -> Route {
    Route::new(from, to, "Text").with("queue_depth", "1000")
}

/// Publishes a text once.
fn say(env: &TestEnv, endpoint: &str, what: &str, count: u64) -> Result {
    let value = format!("{{\"data\": \"{what}\"}}");
    let args = ["pub", endpoint, "--type", "std_msgs/msg/String", "--value", &value];
    env.wrapyfi([&args[..], &["--count", &count.to_string()]].concat())?.exits_with(0)
}

fn routes(status: &Value) -> impl Iterator<Item = &Value> {
    status["routes"].as_array().into_iter().flatten()
}

/// Number of messages that the routes of a status have sent.
fn sent(status: &Value) -> u64 {
    routes(status).filter_map(|route| route["counters"]["sent"].as_u64()).sum()
}

/// The next two lines of a bridge's status, the later one first.
fn two_more(bridge: &Process) -> Result<(Value, Value)> {
    let seen = bridge.stdout().lines().filter(|line| line.starts_with('{')).count();
    bridge.wait_until("two more lines of the status", |output| {
        let mut lines: Vec<Value> = output.objects().collect();
        let told = lines.len() >= seen + 2;
        let last = lines.pop().zip(lines.pop());
        told.then_some(last).flatten()
    })
}

/// Waits until the bridge that began last says that its only route would close a circle; the reason.
fn until_closed(last: &Process) -> Result<String> {
    last.wait_until("the circle", |output| {
        let status = output.objects().next_back()?;
        let mut reasons = routes(&status).filter_map(|route| route["reason"].as_str());
        reasons.find(|it| it.starts_with("loop: ")).map(str::to_owned)
    })
}

/// Has the bridges carry one message, and waits until each of those that carry it has sent it once and no more.
fn goes_round_never(env: &TestEnv, from: &str, carrying: &[&Process], closed: &Process) -> Result {
    // The first message goes out as soon as one of them hears.
    const SAID: u64 = 3;
    say(env, from, "round", SAID)?;
    for bridge in carrying {
        bridge.wait_until("the message", |output| {
            (sent(&output.objects().next_back()?) > 0).then_some(())
        })?;
    }
    for bridge in carrying {
        let (last, before) = two_more(bridge)?;
        assert!(sent(&last) == sent(&before) && sent(&last) <= SAID, "{last}");
    }
    assert_eq!(sent(&two_more(closed)?.0), 0);
    Ok(())
}

/// Waits until every route of a bridge is open at its destination and has nothing to carry yet.
fn until_open(bridge: &Process) -> Result {
    bridge.wait_until("every route to be open", |output| {
        let last = output.objects().next_back()?;
        let waits =
            |route: &Value| route["reason"].as_str().is_some_and(|it| it.contains("a publisher"));
        routes(&last).all(waits).then_some(())
    })
}

/// Two bridges, one route each, there and back: that of the bridge that began last stays closed until the other bridge
/// has ended.
#[test]
fn of_two_bridges_with_opposite_routes_the_second_closes_its_own() -> Result {
    run("of_two_bridges_with_opposite_routes_the_second_closes_its_own", NEEDS, |env| {
        let (near, far) = (ros2(&env.topic("x")), zeromq(&env.topic("x")));
        let echo = ["echo", &far, "--type", "Text", "--json", "--timeout", "100"];
        let one = env.bridge_named("one.yaml", &env.embedded().route(text(&near, &far)))?;
        let echo = env.wrapyfi(echo)?;
        until_open(&one)?;
        let other = env.bridge_named("other.yaml", &env.foreign().route(text(&far, &near)))?;
        let reason = until_closed(&other)?;
        let way = format!("comes back to {far} through bridge /wrapyfi_bridge ({near} -> {far})");
        for words in [&way, "leave one of the routes out", "loop_guard: false"] {
            assert!(reason.contains(words), "{words} is not in {reason}");
        }
        goes_round_never(env, &near, &[&one], &other)?;
        echo.objects(1)?;
        one.terminate()?;
        other.wait_until("the route to be open", |output| {
            let route = route_status(output, &format!("{far} -> {near}"))?;
            (route["state"] != "error").then_some(())
        })
    })
}

/// A loop that is meant is not reported.
#[test]
fn a_route_whose_guard_is_off_stays_open() -> Result {
    run("a_route_whose_guard_is_off_stays_open", NEEDS, |env| {
        let (near, far) = (ros2(&env.topic("x")), zeromq(&env.topic("x")));
        let (y_near, y_far) = (ros2(&env.topic("y")), zeromq(&env.topic("y")));
        let there = env.embedded().route(text(&near, &far)).route(text(&y_near, &y_far));
        let one = env.bridge_named("one.yaml", &there)?;
        until_open(&one)?;
        let back = text(&far, &near).with("loop_guard", "false");
        // This one stays closed: by then the circle of the first has been found as well.
        let config = env.foreign().route(back).route(text(&y_far, &y_near));
        let other = env.bridge_named("other.yaml", &config)?;
        until_closed(&other)?;
        let status = two_more(&other)?.0;
        let name = format!("{far} -> {near}");
        let route = routes(&status).find(|route| route["name"] == name.as_str());
        assert!(route.is_some_and(|route| route["state"] != "error"), "{status}");
        Ok(())
    })
}

#[test]
fn two_bridges_beside_each_other_and_one_back_are_a_circle() -> Result {
    run("two_bridges_beside_each_other_and_one_back_are_a_circle", NEEDS, |env| {
        let (near, far) = (ros2(&env.topic("x")), zeromq(&env.topic("x")));
        let there = || text(&near, &far);
        let one = env.bridge_named("one.yaml", &env.embedded().route(there()))?;
        let two = env.bridge_named("two.yaml", &env.foreign().route(there()))?;
        let echo = ["echo", &far, "--type", "Text", "--json", "--timeout", "100"];
        let _echo = env.wrapyfi(echo)?;
        until_open(&one)?;
        until_open(&two)?;
        let back = env.bridge_named("back.yaml", &env.foreign().route(text(&far, &near)))?;
        until_closed(&back)?;
        goes_round_never(env, &near, &[&one, &two], &back)
    })
}

/// Bridges that have a route on ROS 2 hear of each other, also of routes that do not touch it.
#[test]
fn a_ring_of_three_bridges_is_a_circle() -> Result {
    run("a_ring_of_three_bridges_is_a_circle", NEEDS, |env| {
        env.yarp_conf()?;
        let topic = env.topic("x");
        let with_yarp = |config: Config| {
            let address = format!("127.0.0.1:{}", env.yarp_port());
            config.endpoint(&format!("  yarp: {{ name_server: \"{address}\" }}\n"))
        };
        let other = env.topic("y");
        let over = env.embedded().yarp(env).route(text(&zeromq(&topic), &yarp(&topic)));
        let over = over.route(text(&ros2(&other), &zeromq(&other)));
        let over = env.bridge_named("over.yaml", &over)?;
        let out = env.foreign().route(text(&ros2(&topic), &zeromq(&topic)));
        let out = env.bridge_named("out.yaml", &out)?;
        let echo = ["echo", &yarp(&topic), "--type", "Text", "--json", "--timeout", "100"];
        let _echo = env.wrapyfi(echo)?;
        until_open(&out)?;
        let back = with_yarp(env.foreign()).route(text(&yarp(&topic), &ros2(&topic)));
        let back = env.bridge_named("back.yaml", &back)?;
        let reason = until_closed(&back)?;
        assert_eq!(reason.matches("bridge /wrapyfi_bridge").count(), 3, "{reason}");
        goes_round_never(env, &ros2(&topic), &[&out, &over], &back)
    })
}

/// A bridge does not hear itself: there and back in one file is quiet.
#[test]
fn there_and_back_in_one_file_is_quiet() -> Result {
    run("there_and_back_in_one_file_is_quiet", NEEDS, |env| {
        let (near, far) = (ros2(&env.topic("x")), zeromq(&env.topic("x")));
        let config = env.embedded().route(text(&near, &far)).route(text(&far, &near));
        let bridge = env.bridge(&config)?;
        let echo = ["echo", &far, "--type", "Text", "--json", "--count", "20", "--timeout", "100"];
        let mut echo = env.wrapyfi(echo)?;
        let args = ["pub", &near, "--type", "std_msgs/msg/String", "--rate", "20"];
        let value = ["--value", "{\"data\": \"once\"}"];
        let _talker = env.wrapyfi([&args[..], &value].concat())?;
        echo.objects(20).map_err(|error| error.context(bridge.tail()))?;
        echo.exits_with(0)?;
        bridge.wait_until("20 messages, none of which came back", |output| {
            let there = route_status(output, &format!("{near} -> {far}"))?;
            let back = route_status(output, &format!("{far} -> {near}"))?;
            let flows = there["counters"]["sent"].as_u64()? >= 20;
            flows.then(|| assert_eq!(back["counters"]["sent"], 0, "{back}"))
        })
    })
}

/// Messages that two bridges double, and a publisher that says one thing quickly, are no loop.
#[test]
fn a_quick_publisher_and_two_bridges_beside_each_other_are_no_loop() -> Result {
    run("a_quick_publisher_and_two_bridges_beside_each_other_are_no_loop", NEEDS, |env| {
        let (near, far) = (ros2(&env.topic("x")), zeromq(&env.topic("x")));
        let there = || text(&near, &far);
        let one = env.bridge_named("one.yaml", &env.embedded().route(there()))?;
        let two = env.bridge_named("two.yaml", &env.foreign().route(there()))?;
        let echo = ["echo", &far, "--type", "Text", "--json", "--timeout", "100"];
        let _echo = env.wrapyfi(echo)?;
        let args = ["pub", &near, "--type", "std_msgs/msg/String", "--rate", "500"];
        let value = ["--value", "{\"data\": \"the same\"}"];
        let _talker = env.wrapyfi([&args[..], &value].concat())?;
        let name = format!("{near} -> {far}");
        for bridge in [&one, &two] {
            bridge.wait_until("4000 messages without a loop", |output| {
                let route = route_status(output, &name)?;
                assert_ne!(route["state"], "error", "{route}");
                (route["counters"]["sent"].as_u64()? >= 4000).then_some(())
            })?;
        }
        Ok(())
    })
}

/// Number of messages that a talker on ROS 2 publishes beside two bridges.
const PUBLISHED: u64 = 200;

/// Two bridges with the same patterns, each both ways between ROS 2 and the far side. The numbers of messages that each
/// has sent, once the talker has ended and nothing flows any more.
fn side_by_side(env: &TestEnv, far: fn(&str) -> String, configs: [Config; 2]) -> Result<[u64; 2]> {
    let topic = env.topic("x");
    let (pattern, target) = (format!("{topic}(.*)"), format!("{topic}$1"));
    let [one, two] = configs.map(|config| {
        let there = text(&ros2(&pattern), &far(&target));
        config.route(there).route(text(&far(&pattern), &ros2(&target)))
    });
    let one = env.bridge_named("one.yaml", &one)?;
    let two = env.bridge_named("two.yaml", &two)?;
    let echo = ["echo", &far(&topic), "--type", "Text", "--json", "--timeout", "100"];
    let echo = env.wrapyfi(echo)?;
    let count = PUBLISHED.to_string();
    let value = ["--value", "{\"data\": \"once\"}", "--rate", "50", "--count", &count];
    let endpoint = ros2(&topic);
    let args = ["pub", &endpoint, "--type", "std_msgs/msg/String"];
    env.wrapyfi([&args[..], &value].concat())?.exits_with(0)?;
    echo.objects(1).map_err(|error| error.context(one.tail()))?;
    let deadline = Instant::now() + TIMEOUT;
    while Instant::now() < deadline {
        let [(now, before), (other_now, other_before)] = [two_more(&one)?, two_more(&two)?];
        let sums = [sent(&now), sent(&other_now)];
        if sums == [sent(&before), sent(&other_before)] && sums != [0, 0] {
            return Ok(sums);
        }
        assert!(sums.iter().sum::<u64>() <= 10 * PUBLISHED, "a storm: {now} {other_now}");
    }
    anyhow::bail!("messages go on: {} {}", one.tail(), two.tail())
}

/// No mark crosses ZeroMQ: both bridges carry each message, once.
#[test]
fn two_bridges_side_by_side_on_zeromq_double_and_make_no_storm() -> Result {
    run("two_bridges_side_by_side_on_zeromq_double_and_make_no_storm", NEEDS, |env| {
        let sums = side_by_side(env, zeromq, [env.embedded(), env.foreign()])?;
        assert!(sums.iter().all(|sum| *sum <= PUBLISHED), "{sums:?} of {PUBLISHED} messages");
        Ok(())
    })
}

/// A port of YARP has one owner.
#[test]
fn two_bridges_side_by_side_on_yarp_make_no_storm() -> Result {
    run("two_bridges_side_by_side_on_yarp_make_no_storm", NEEDS, |env| {
        env.yarp_conf()?;
        let address = format!("127.0.0.1:{}", env.yarp_port());
        let two = env.foreign().endpoint(&format!("  yarp: {{ name_server: \"{address}\" }}\n"));
        let sums = side_by_side(env, yarp, [env.embedded().yarp(env), two])?;
        assert!(sums.iter().sum::<u64>() <= PUBLISHED, "{sums:?} of {PUBLISHED} messages");
        Ok(())
    })
}

#[test]
fn a_second_bridge_on_yarp_takes_over() -> Result {
    second_bridge(
        "a_second_bridge_on_yarp_takes_over",
        Need::Program,
        TestEnv::yarpserver,
        |owner| {
            owner.terminate()?;
            owner.exits_with(0)
        },
    )
}

/// The name server keeps the port of who was killed.
#[test]
fn a_second_bridge_on_yarp_takes_over_from_one_that_was_killed() -> Result {
    let test = "a_second_bridge_on_yarp_takes_over_from_one_that_was_killed";
    second_bridge(test, Need::Program, TestEnv::yarpserver, Process::kill)
}

#[test]
fn a_second_bridge_takes_over_from_one_that_was_killed_at_yarps_name_server() -> Result {
    let test = "a_second_bridge_takes_over_from_one_that_was_killed_at_yarps_name_server";
    second_bridge(test, Need::Yarp, yarps_server, Process::kill)
}

/// Three bridges, each of which takes over a topic when the one before it has come to its `end`.
fn second_bridge(
    test: &str,
    need: Need,
    server: impl FnOnce(&TestEnv) -> Result<Process>,
    end: impl Fn(&mut Process) -> Result,
) -> Result {
    run(test, &[Need::Program, Need::Python, need], |env| {
        let _server = server(env)?;
        let topic = env.topic("x");
        let (pattern, target) = (format!("{topic}(.*)"), format!("{topic}$1"));
        let address = format!("  yarp: {{ name_server: \"127.0.0.1:{}\" }}\n", env.yarp_port());
        let config = env
            .foreign()
            .endpoint(&address)
            .route(text(&ros2(&pattern), &yarp(&target)))
            .route(text(&yarp(&pattern), &ros2(&target)));
        let _talker = env.dds_publisher(&topic, "std_msgs/msg/String", "--rate 20 --text here")?;
        let name = format!("{} -> {}", ros2(&topic), yarp(&topic));
        let sends = |bridge: &Process| {
            bridge.wait_until("messages", |output| {
                let route = route_status(output, &name)?;
                (route["counters"]["sent"].as_u64()? > 0).then_some(())
            })
        };
        let mut owner = env.bridge_named("bridge0.yaml", &config)?;
        let args = ["echo", &yarp(&topic), "--type", "Text", "--json"];
        let echo = env.wrapyfi(args)?;
        sends(&owner)?;
        for number in 1..=2 {
            let second = env.bridge_named(&format!("bridge{number}.yaml"), &config)?;
            second.wait_until("to leave the topic alone", |output| {
                route_status(output, &name).filter(|route| route["state"] != "active")
            })?;
            end(&mut owner)?;
            let (ended, before) = (Instant::now(), echo.wait_until("what it heard", heard)?);
            echo.objects(before + 1).map_err(|error| error.context(second.tail()))?;
            let time = ended.elapsed();
            // Two seconds, and what a busy machine takes.
            ensure!(time < Duration::from_secs(6), "the next message came after {time:?}");
            sends(&second).map_err(|error| error.context(second.tail()))?;
            owner = second;
        }
        Ok(())
    })
}

fn heard(output: &Output) -> Option<usize> {
    Some(output.objects().count())
}
