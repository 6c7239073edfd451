//! Faults of docs/reliability.md that belong to no other subject: garbage on ports, many that come back at once, a
//! large topic beside a small one, types and clocks that change while a bridge runs.

use std::collections::BTreeSet;
use std::net::{Ipv4Addr, UdpSocket};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use serde_json::Value;
use wrapyfi_e2e::{
    Config, Need, Output, Process, Result, Route, TestEnv, repository, ros1, ros2, run, yarp,
    zeromq,
};

const NEEDS: &[Need] = &[Need::Program, Need::Python];
const TYPE: &str = "std_msgs/msg/String";

/// Numbers that a listener of texts has heard.
fn numbers(output: &Output) -> Vec<u64> {
    let text = |message: &Value| {
        let found = [&message["fields"]["data"], &message["value"]["data"], &message["value"]];
        found.into_iter().find_map(Value::as_str).and_then(|text| text.parse().ok())
    };
    output.objects().filter_map(|message| text(&message)).collect()
}

/// Number of messages that each route of a bridge has received, by its last status.
fn received_by_route(output: &Output) -> Option<Vec<u64>> {
    let last = output.objects().next_back()?;
    let routes = last["routes"].as_array()?;
    routes.iter().map(|route| route["counters"]["received"].as_u64()).collect()
}

/// Waits until a listener has heard `count` numbers more than now, in order and each once.
fn hears_more(listener: &Process, count: usize) -> Result<Vec<u64>> {
    let before = listener.wait_until("what it heard", |output| Some(numbers(output).len()))?;
    let more = listener.wait_until(&format!("{count} numbers more"), |output| {
        let more = numbers(output).split_off(before);
        (more.len() >= count).then_some(more)
    })?;
    ensure!(more.is_sorted_by(|one, next| one < next), "out of order: {more:?}");
    Ok(more)
}

#[test]
fn garbage_on_the_ports_of_dds_stops_nothing() -> Result {
    run("garbage_on_the_ports_of_dds_stops_nothing", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let route = Route::new(&ros2(&from), &zeromq(&to), "Text");
        let mut bridge = env.bridge(&env.embedded().route(route))?;
        let listener = env.wrapyfi(["echo", &zeromq(&to), "--type", "Text", "--json"])?;
        let _publisher = env.dds_publisher(&from, TYPE, "--rate 50 --text {n}")?;
        hears_more(&listener, 10)?;

        let ports = bridge.ports("udp")?;
        ensure!(ports.len() >= 2, "ports of discovery and of data: {ports:?}");
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
        let mut chance = 7_u64;
        let mut byte = || {
            chance = chance.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            chance.to_be_bytes()[0]
        };
        for turn in 0..4000_usize {
            // Nothing, noise, and noise that begins as a message of RTPS does, with submessages of any kind.
            let mut datagram = match turn % 3 {
                0 => Vec::new(),
                1 => b"RTPS".to_vec(),
                _ => {
                    b"RTPS\x02\x03\x01\x10\x01\x10\x00\x01\x00\x00\x00\x01\x00\x00\x00\x01".to_vec()
                }
            };
            datagram.extend((0..turn % 600).map(|_| byte()));
            for port in &ports {
                socket.send_to(&datagram, (Ipv4Addr::LOCALHOST, *port))?;
            }
        }
        hears_more(&listener, 50)?;
        bridge.terminate()?;
        bridge.exits_with(0)
    })
}

/// A small topic of 50 messages a second beside one of 2 MB messages, both from the middleware of `end`.
fn beside_a_large_topic(
    test: &str,
    needs: &[Need],
    end: impl Fn(&str) -> String,
    prepare: impl FnOnce(&TestEnv) -> Result<Option<Process>>,
) -> Result {
    run(test, needs, |env| {
        let _server = prepare(env)?;
        let _broker = env.broker()?;
        let [start, small, large, heard] =
            ["start", "small", "large", "heard"].map(|name| env.topic(name));
        // A bridge of its own numbers messages on every middleware.
        let route = Route::new(&ros2(&start), &end(&small), "Text");
        let _talker = env.bridge_named("talker.yaml", &env.foreign().route(route))?;
        let _numbers = env.dds_publisher(&start, TYPE, "--rate 50 --text {n}")?;
        let large_to = ros2(&large);
        let config: Config = env
            .foreign()
            .route(Route::new(&end(&small), &ros2(&heard), "Text"))
            .route(Route::new(&end(&large), &large_to, "NativeObject").with("lazy", "false"));
        let bridge = env.bridge(&config)?;
        let listener = env.dds_subscriber(&heard, TYPE, "--plain")?;
        hears_more(&listener, 10)?;

        let text = serde_json::to_string(&"x".repeat(2_000_000))?;
        let file = env.write("large.json", text)?.display().to_string();
        let publish = ["pub", &end(&large), "--type", "NativeObject", "--file", &file];
        let _publisher = env.wrapyfi(publish.into_iter().chain(["--rate", "20"]))?;
        let received = |output: &Output| {
            let last = output.objects().next_back()?;
            let routes = last["routes"].as_array()?;
            let route = routes.iter().find(|route| route["to"] == large_to.as_str())?;
            route["counters"]["received"].as_u64()
        };
        bridge.wait_until("large messages", |output| received(output).filter(|it| *it > 0))?;
        let more = hears_more(&listener, 200)?;
        let large = bridge.wait_until("its status", received)?;
        ensure!(large >= 2, "{large} large messages beside 200 small ones");
        let span = more[more.len() - 1] - more[0] + 1;
        // A busy machine may be late; a route that waits for the large messages would lose most.
        ensure!(span * 9 <= more.len() as u64 * 10, "{} of {span} small messages", more.len());
        Ok(())
    })
}

#[test]
fn a_large_topic_on_ros_1_stops_no_small_one() -> Result {
    let needs = &[Need::Program, Need::Python, Need::Ros1];
    let master = |env: &TestEnv| env.roscore().map(Some);
    beside_a_large_topic("a_large_topic_on_ros_1_stops_no_small_one", needs, ros1, master)
}

#[test]
fn a_large_topic_on_yarp_stops_no_small_one() -> Result {
    let server = |env: &TestEnv| env.yarpserver().map(Some);
    beside_a_large_topic("a_large_topic_on_yarp_stops_no_small_one", NEEDS, yarp, server)
}

#[test]
fn a_large_topic_on_zeromq_stops_no_small_one() -> Result {
    beside_a_large_topic("a_large_topic_on_zeromq_stops_no_small_one", NEEDS, zeromq, |_| Ok(None))
}

#[test]
fn a_hundred_routes_and_a_hundred_sockets_come_back_to_a_broker_at_once() -> Result {
    run("a_hundred_routes_and_a_hundred_sockets_come_back_to_a_broker_at_once", NEEDS, |env| {
        const COUNT: usize = 100;
        let topic = env.topic("x");
        let name = |number: usize| format!("{topic}_{number}");
        let routes = (0..COUNT).map(|number| {
            let name = name(number);
            Route::new(&zeromq(&name), &ros2(&name), "Text").with("lazy", "false")
        });
        let config = routes.fold(env.foreign(), Config::route);
        let mut broker = env.broker()?;
        let bridge = env.bridge(&config)?;
        let crowd =
            env.peer("zmq_numbers.py", &format!("crowd --topic {topic} --count {COUNT}"))?;
        crowd.event("ready")?;
        let args = format!("round --topic {topic} --count {COUNT} --rate 5");
        let talker = env.peer("zmq_numbers.py", &args)?;
        talker.event("ready")?;
        for _life in 0..3 {
            // Number of messages of the socket that has heard the fewest.
            let least = |output: &Output| output.objects().next_back()?["least"].as_u64();
            let before = bridge.wait_until("its status", received_by_route)?;
            let heard = crowd.wait_until("what it heard", least)?;
            crowd.wait_until("news on every socket", |output| {
                least(output).filter(|least| *least > heard)
            })?;
            bridge.wait_until("news on every route", |output| {
                let now = received_by_route(output)?;
                now.iter().zip(&before).all(|(now, before)| now > before).then_some(())
            })?;
            broker.kill()?;
            drop(broker);
            broker = env.broker()?;
        }
        Ok(())
    })
}

#[test]
fn a_hundred_topics_of_ros_2_come_back_at_once() -> Result {
    run("a_hundred_topics_of_ros_2_come_back_at_once", NEEDS, |env| {
        const COUNT: usize = 100;
        let topic = env.topic("x");
        let routes = (0..COUNT).map(|number| {
            let name = format!("{topic}_{number}");
            Route::new(&ros2(&name), &zeromq(&name), "Text").with("lazy", "false")
        });
        let bridge = env.bridge(&routes.fold(env.embedded(), Config::route))?;
        let args = format!("crowd --topic {topic} --type {TYPE} --count {COUNT} --rate 5");
        let mut files = Vec::new();
        for _life in 0..3 {
            let before = bridge.wait_until("its status", received_by_route)?;
            let mut crowd = env.peer("cyclone_peer.py", &args)?;
            bridge.wait_until("news on every route", |output| {
                let now = received_by_route(output)?;
                now.iter().zip(&before).all(|(now, before)| now > before).then_some(())
            })?;
            files.push(std::fs::read_dir(format!("/proc/{}/fd", bridge.id()))?.count());
            crowd.kill()?;
        }
        // Peers of DDS share the sockets of a process: none of them takes a file.
        ensure!(files.iter().max() == files.iter().min(), "open files in each life: {files:?}");
        Ok(())
    })
}

#[test]
fn a_topic_of_ros_2_that_comes_back_with_another_type_is_carried() -> Result {
    run("a_topic_of_ros_2_that_comes_back_with_another_type_is_carried", NEEDS, |env| {
        let topic = env.topic("x");
        let route = Route::untyped(&ros2(&topic), &zeromq(&topic));
        let _bridge = env.bridge(&env.embedded().route(route))?;
        let listener =
            env.wrapyfi(["echo", &zeromq(&topic), "--type", "NativeObject", "--json"])?;
        for (number, message_type) in ["NativeObject", "Text", "NativeObject"].iter().enumerate() {
            let value = format!("\"{number}\"");
            let publish = ["pub", &ros2(&topic), "--type", message_type, "--value", &value];
            let mut publisher = env.wrapyfi(publish.into_iter().chain(["--rate", "20"]))?;
            let heard = |output: &Output| numbers(output).contains(&(number as u64)).then_some(());
            listener.wait_until(message_type, heard).with_context(|| publisher.tail())?;
            publisher.terminate()?;
            publisher.exits_with(0)?;
        }
        Ok(())
    })
}

#[test]
fn a_topic_of_ros_1_that_comes_back_with_another_type_is_carried() -> Result {
    let test = "a_topic_of_ros_1_that_comes_back_with_another_type_is_carried";
    run(test, &[Need::Program, Need::Python, Need::Ros1], |env| {
        let _master = env.roscore()?;
        let topic = env.topic("x");
        let route = Route::untyped(&ros1(&topic), &zeromq(&topic));
        let _bridge = env.bridge(&env.embedded().route(route))?;
        let listener =
            env.wrapyfi(["echo", &zeromq(&topic), "--type", "NativeObject", "--json"])?;
        let text = ("std_msgs/String", "\"one\"", "\"value\":\"one\"");
        for (message_type, value, said) in [text, ("std_msgs/Int32", "2", "\"data\":2")] {
            let args = format!("publish --topic {topic} --type {message_type} --rate 20");
            let fields = format!("{{\"data\": {value}}}");
            let mut publisher = env.rospy(&args, Some(&fields))?;
            let heard =
                |output: &Output| output.out.iter().any(|line| line.contains(said)).then_some(());
            listener.wait_until(message_type, heard).with_context(|| publisher.tail())?;
            publisher.terminate()?;
            publisher.exits_with(0)?;
        }
        Ok(())
    })
}

/// A written route, and the route of a pattern. The first message of a port shows its type.
#[test]
fn a_port_of_yarp_that_comes_back_with_another_type_is_carried() -> Result {
    run("a_port_of_yarp_that_comes_back_with_another_type_is_carried", NEEDS, |env| {
        let _server = env.yarpserver()?;
        let (one, all) = (env.topic("one"), env.topic("all/"));
        let config = env
            .embedded()
            .route(Route::untyped(&yarp(&one), &zeromq(&one)))
            .route(Route::untyped(&yarp(&format!("{all}(.*)")), &zeromq(&format!("{all}$1"))));
        let _bridge = env.bridge(&config)?;
        for topic in [one, format!("{all}x")] {
            let listener =
                env.wrapyfi(["echo", &zeromq(&topic), "--type", "NativeObject", "--json"])?;
            let numbers = ("std_msgs/msg/Float64MultiArray", "{\"data\": [1.5]}", "<f8");
            for (message_type, value, said) in [numbers, ("NativeObject", "\"word\"", "\"word\"")] {
                let publish = ["pub", &yarp(&topic), "--type", message_type, "--value", value];
                let mut publisher = env.wrapyfi(publish.into_iter().chain(["--rate", "20"]))?;
                // For two seconds: a bridge looks twice a second at what there is.
                let heard = |output: &Output| {
                    let told = output.out.iter().filter(|line| line.contains(said)).count();
                    (told >= 40).then_some(())
                };
                listener.wait_until(message_type, heard).with_context(|| publisher.tail())?;
                publisher.terminate()?;
                publisher.exits_with(0)?;
            }
        }
        Ok(())
    })
}

/// Fifty programs listen to either end of a route and go, every third one killed: who stays misses nothing.
fn guests_come_and_go(
    test: &str,
    needs: &[Need],
    (end, kind): (impl Fn(&str) -> String, &str),
    prepare: impl FnOnce(&TestEnv) -> Result<Option<Process>>,
    talk: impl FnOnce(&TestEnv, &str) -> Result<Process>,
) -> Result {
    run(test, needs, |env| {
        let _server = prepare(env)?;
        let (from, to) = (env.topic("from"), env.topic("to"));
        let (source, destination) = (end(&from), end(&to));
        let bridge = env.bridge(&env.embedded().route(Route::new(&source, &destination, kind)))?;
        let echo = |end: &str, more: &[&str]| {
            env.wrapyfi([&["echo", end, "--type", kind, "--json"], more].concat())
        };
        let listener = echo(&destination, &[])?;
        let _talker = talk(env, &from)?;
        hears_more(&listener, 10).with_context(|| bridge.tail())?;
        for number in 0..50 {
            let side = if number % 2 == 0 { &source } else { &destination };
            if number % 3 == 0 {
                let mut guest = echo(side, &[])?;
                guest.objects(1)?;
                guest.kill()?;
            } else {
                echo(side, &["--count", "1"])?.exits_with(0)?;
            }
        }
        let heard = listener.wait_until("what it heard", |output| Some(numbers(output)))?;
        let whole: Vec<u64> = (heard[0]..).take(heard.len()).collect();
        ensure!(heard == whole, "some of {} are missing: {heard:?}", whole.len());
        Ok(())
    })
}

#[test]
fn nodes_of_ros_1_come_and_go_under_traffic() -> Result {
    let needs = &[Need::Program, Need::Python, Need::Ros1];
    let talk = |env: &TestEnv, topic: &str| {
        let args = format!("publish --topic {topic} --rate 50");
        env.rospy(&args, Some(r#"{"data": "{n}"}"#))
    };
    let master = |env: &TestEnv| env.roscore().map(Some);
    guests_come_and_go(
        "nodes_of_ros_1_come_and_go_under_traffic",
        needs,
        (ros1, "Text"),
        master,
        talk,
    )
}

#[test]
fn sockets_of_zeromq_come_and_go_under_traffic() -> Result {
    let talk = |env: &TestEnv, topic: &str| {
        env.peer("zmq_numbers.py", &format!("publish --topic {topic} --rate 50"))
    };
    let test = "sockets_of_zeromq_come_and_go_under_traffic";
    guests_come_and_go(test, NEEDS, (zeromq, "NativeObject"), |_| Ok(None), talk)
}

#[test]
fn a_clock_that_stops_stops_no_route() -> Result {
    run("a_clock_that_stops_stops_no_route", &[Need::Program, Need::Python], |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let route = Route::new(&ros2(&from), &zeromq(&to), "Text");
        let _bridge = env.node_with(vec![route], &["-p", "use_sim_time:=true"])?;
        let listener = env.wrapyfi(["echo", &zeromq(&to), "--type", "Text", "--json"])?;
        let _publisher = env.dds_publisher(&from, TYPE, "--rate 50 --text {n}")?;
        let fields = r#"--rate 50 --fields {"clock":{"sec":77}}"#;
        let mut clock = env.dds_publisher("/clock", "rosgraph_msgs/msg/Clock", fields)?;
        hears_more(&listener, 20)?;
        clock.kill()?;
        hears_more(&listener, 100).map(drop)
    })
}

/// Files that read the system's clock. None of them decides when a route, a wait or a rate goes on: those take
/// `Instant`, which no jump of that clock moves.
const CLOCK_READERS: [(&str, &str); 8] = [
    ("crates/wrapyfi_data/src/types/stamp.rs", "time in a message"),
    ("crates/wrapyfi_endpoint/src/mark.rs", "number of a bridge, taken once"),
    ("crates/wrapyfi_engine/src/stamping.rs", "time in a message"),
    ("crates/wrapyfi_ros1/src/config.rs", "name of a node, taken once"),
    ("crates/wrapyfi_yarp_endpoint/src/log_port.rs", "time of a line of the log"),
    ("wrapyfi_bridge/src/command/bag/record.rs", "time in a recording"),
    ("wrapyfi_bridge/src/logging.rs", "time of a line of the log"),
    ("wrapyfi_bridge/src/why/actions.rs", "compared with stamps of other computers"),
];
/// The deadline of a request for a broker of this machine, at most its timeout.
const DEADLINE: &str = "crates/wrapyfi_zeromq/src/deadline.rs";

fn sources(folder: &Path, found: &mut Vec<PathBuf>) -> Result {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        if path.is_dir() {
            if !["tests", "target", "conformance"].contains(&name) {
                sources(&path, found)?;
            }
        } else if name.ends_with(".rs") && !name.ends_with("tests.rs") {
            found.push(path);
        }
    }
    Ok(())
}

#[test]
fn the_systems_clock_is_read_in_named_places_alone() -> Result {
    let root = repository();
    let crates =
        std::fs::read_dir(root.join("crates"))?.filter_map(|entry| Some(entry.ok()?.path()));
    let all = crates.chain(["wrapyfi_core", "wrapyfi_bridge"].map(|name| root.join(name)));
    let mut files = Vec::new();
    for folder in all.map(|of| of.join("src")).filter(|folder| folder.is_dir()) {
        sources(&folder, &mut files)?;
    }
    let mut readers = BTreeSet::new();
    for file in files {
        let text = std::fs::read_to_string(&file)?;
        let code = text.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
        let reads = ["SystemTime::now", "Utc::now", "Local::now", "CLOCK_REALTIME"];
        if reads.iter().any(|read| code.contains(read)) {
            readers.insert(file.strip_prefix(&root)?.display().to_string());
        }
    }
    let named: BTreeSet<String> =
        CLOCK_READERS.iter().map(|(file, _)| *file).chain([DEADLINE]).map(str::to_owned).collect();
    assert_eq!(readers, named, "another file reads the clock, or one no more: say what for");
    Ok(())
}
