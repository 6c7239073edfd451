//! Ends of programs: signals at any time, and readers of their output that stand still or went.

use std::fmt::Write as _;
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

use wrapyfi_e2e::{Need, Process, Result, Route, TIMEOUT, TestEnv, ros1, ros2, run, yarp, zeromq};

const NEEDS: &[Need] = &[Need::Program];

/// Carries messages through a bridge for longer than it takes to print its first status, and ends it.
fn carries(test: &str, bridge: impl FnOnce(&TestEnv, &[&str]) -> Result<Process>) -> Result {
    run(test, NEEDS, |env| {
        let (from, to) = (zeromq(&env.topic("from")), ros2(&env.topic("to")));
        let config = env.embedded().route(Route::new(&from, &to, "NativeObject"));
        let file = env.write("bridge.yaml", config.yaml())?;
        let file = file.to_string_lossy();
        let mut bridge = bridge(env, &["bridge", "--config", &file, "--json"])?;
        let mut echo = env.wrapyfi(["echo", &to, "--type", "NativeObject", "--count", "60"])?;
        let publish = ["pub", &from, "--type", "NativeObject", "--value", "1", "--rate", "20"];
        let publisher = env.wrapyfi(publish)?;
        echo.exits_with(0).map_err(|error| error.context(publisher.tail()))?;
        bridge.terminate()?;
        bridge.exits_with(0)
    })
}

#[test]
fn a_reader_of_the_log_that_stands_still_stops_nothing() -> Result {
    let test = "a_reader_of_the_log_that_stands_still_stops_nothing";
    carries(test, |env, args| env.wrapyfi_stalled(2, args))
}

#[test]
fn a_reader_of_the_status_that_stands_still_stops_nothing() -> Result {
    let test = "a_reader_of_the_status_that_stands_still_stops_nothing";
    carries(test, |env, args| env.wrapyfi_stalled(1, args))
}

#[test]
fn a_reader_of_the_status_that_went_ends_nothing() -> Result {
    let test = "a_reader_of_the_status_that_went_ends_nothing";
    carries(test, TestEnv::wrapyfi_unread)
}

#[test]
fn a_full_disk_under_log_and_status_stops_nothing() -> Result {
    carries("a_full_disk_under_log_and_status_stops_nothing", |env, args| {
        // Whatever is written there fails for want of space.
        env.wrapyfi_by("exec \"$@\" >/dev/full 2>&1", args)
    })
}

/// Asks a bridge to end while it waits for the answer of something that takes connections and says nothing.
fn ends_while_it_starts(test: &str, endpoints: impl Fn(u16) -> String, from: &str) -> Result {
    run(test, NEEDS, |env| {
        let silent = TcpListener::bind("127.0.0.1:0")?;
        let endpoints = endpoints(silent.local_addr()?.port());
        let to = ros2(&env.topic("to"));
        let config = format!(
            "endpoints: {{ {endpoints} }}\nroutes:\n  - {{ from: \"{from}\", to: \"{to}\", type: NativeObject }}\n"
        );
        let file = env.write("bridge.yaml", config)?;
        let file = file.to_string_lossy();
        let mut bridge = env.wrapyfi(["bridge", "--config", &file])?;
        let connection = silent.accept()?;
        bridge.terminate()?;
        bridge.exits_with(0)?;
        drop(connection);
        Ok(())
    })
}

#[test]
fn a_name_server_that_does_not_answer_delays_no_end() -> Result {
    let test = "a_name_server_that_does_not_answer_delays_no_end";
    ends_while_it_starts(
        test,
        |port| format!("yarp: {{ name_server: 127.0.0.1:{port} }}"),
        "yarp:/from",
    )
}

#[test]
fn a_master_that_does_not_answer_delays_no_end() -> Result {
    let test = "a_master_that_does_not_answer_delays_no_end";
    let section = |port| format!("ros: {{ master_uri: \"http://127.0.0.1:{port}\" }}");
    ends_while_it_starts(test, section, "ros:/from")
}

/// Waits until a program catches SIGINT and SIGTERM: the system ends it before.
fn catches(program: &Process) -> Result {
    let file = format!("/proc/{}/status", program.id());
    let deadline = Instant::now() + TIMEOUT;
    while Instant::now() < deadline {
        let status = std::fs::read_to_string(&file)?;
        let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:"));
        let caught = u64::from_str_radix(caught.unwrap_or_default().trim(), 16)?;
        // Signal 1 is the lowest bit.
        if caught & (1 << 1) != 0 && caught & (1 << 14) != 0 {
            return Ok(());
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    anyhow::bail!("{file}: SIGINT and SIGTERM are not caught")
}

#[test]
fn either_signal_ends_a_bridge_of_all_sides_at_any_moment() -> Result {
    run("either_signal_ends_a_bridge_of_all_sides_at_any_moment", NEEDS, |env| {
        // There is no master and no name server.
        env.yarp_conf()?;
        let topic = env.topic("x");
        let config = ["ros:", "yarp:", "zeromq:"].iter().fold(env.embedded(), |config, side| {
            config.route(Route::new(&ros2(&topic), &format!("{side}{topic}"), "Text"))
        });
        let file = env.write("bridge.yaml", config.yaml())?;
        let file = file.to_string_lossy();
        for after_ms in [0, 5, 10, 20, 40, 80, 150, 300, 600] {
            for ends in [Process::terminate, Process::interrupt] {
                let mut bridge = env.wrapyfi(["bridge", "--config", &file, "--json"])?;
                catches(&bridge)?;
                // No condition to wait for: any moment is meant.
                std::thread::sleep(Duration::from_millis(after_ms));
                ends(&bridge)?;
                let ended = bridge.exits_with(0);
                ended.map_err(|error| error.context(format!("after {after_ms} ms")))?;
            }
        }
        Ok(())
    })
}

#[test]
fn four_hundred_routes_open_though_a_process_starts_with_a_thousand_files() -> Result {
    run("four_hundred_routes_open_though_a_process_starts_with_a_thousand_files", NEEDS, |env| {
        let mut config = env.embedded();
        for number in 0..400 {
            let mut name = env.topic("many");
            write!(name, "_{number}")?;
            config = config.route(Route::new(&ros2(&name), &zeromq(&name), "NativeObject"));
        }
        let file = env.write("bridge.yaml", config.yaml())?;
        let file = file.to_string_lossy();
        let args = ["bridge", "--config", &file, "--json"];
        let mut bridge = env.wrapyfi_by("ulimit -S -n 1024; exec \"$@\"", &args)?;
        // A route opens its destination first: each of them has, and asks ROS 2.
        bridge.wait_until("400 routes that are open", |output| {
            let last = output.objects().next_back()?;
            let routes = last["routes"].as_array()?;
            let open = routes.iter().filter(|route| {
                route["reason"].as_str().is_some_and(|reason| reason.contains("a publisher of "))
            });
            (open.count() == 400).then_some(())
        })?;
        bridge.terminate()?;
        bridge.exits_with(0)
    })
}

/// Files that a program may open.
const FILES: usize = 80;

/// CycloneDDS ends its process in each of these cases.
#[test]
fn what_cyclonedds_cannot_start_with_ends_with_one_line() -> Result {
    run("what_cyclonedds_cannot_start_with_ends_with_one_line", &[Need::Program], |env| {
        let echo = ["echo", "ros2:/x", "--type", "std_msgs/msg/String", "--timeout", "1"];
        for limit in ["-n 8", "-n 12", "-v 100000"] {
            let mut one = env.wrapyfi_by(&format!("ulimit {limit}; exec \"$@\""), &echo)?;
            one.exits_with(1).map_err(|error| error.context(limit))?;
            let said = one.stderr();
            assert!(said.contains("no room for CycloneDDS"), "{limit}: {said}");
            assert_eq!(said.lines().count(), 1, "{limit}: {said}");
        }
        for peer in ["999.1.1.1", "::1"] {
            let script = format!("ROS_STATIC_PEERS={peer} exec \"$@\"");
            let mut one = env.wrapyfi_by(&script, &echo)?;
            one.exits_with(2).map_err(|error| error.context(peer))?;
            let said = one.stderr();
            assert!(said.contains("ROS_STATIC_PEERS has") && said.contains(peer), "{said}");
        }
        Ok(())
    })
}

/// A name among the peers that does not resolve keeps no program from the others, and no command from its end.
#[test]
fn a_peer_that_does_not_resolve_holds_nothing_up() -> Result {
    run("a_peer_that_does_not_resolve_holds_nothing_up", &[Need::Program], |env| {
        let xml = "<CycloneDDS><Domain><Discovery><Peers><Peer address=\"robot.invalid\"/></Peers>\
                   </Discovery></Domain></CycloneDDS>";
        for variable in
            ["ROS_STATIC_PEERS='robot.invalid;127.0.0.1'", &format!("CYCLONEDDS_URI='{xml}'")]
        {
            let script = format!("export {variable}; exec \"$@\"");
            let topic = ["ros2:/x", "--type", "std_msgs/msg/String"];
            let publish = ["--value", "{\"data\": \"hello\"}", "--rate", "10"];
            let _publisher =
                env.wrapyfi_by(&script, &[&["pub"][..], &topic[..], &publish[..]].concat())?;
            let args = [&["echo"][..], &topic[..], &["--count", "1"][..]].concat();
            let mut echo = env.wrapyfi_by(&script, &args)?;
            echo.exits_with(0)?;
            let said = echo.stderr();
            assert!(said.contains("\"robot.invalid\" of") && said.contains("resolve"), "{said}");
            let mut silent = env.wrapyfi_by(
                &script,
                &["echo", "ros2:/nobody", "--type", "std_msgs/msg/String", "--timeout", "1"],
            )?;
            silent.exits_with(3)?;
            let said = silent.stderr();
            assert!(said.contains("a publisher of /nobody (the host \"robot.invalid\""), "{said}");
            let mut why = env.wrapyfi_by(&script, &["why", "ros2:/nobody"])?;
            why.exits_with(1)?;
            let said = why.tail();
            assert!(said.contains("\"robot.invalid\"") && said.contains("/etc/hosts"), "{said}");
        }
        Ok(())
    })
}

/// Starts a server that may open few files, and waits until its log has `words`.
fn with_few_files(env: &TestEnv, args: &[&str], words: &str) -> Result<Process> {
    let script = format!("ulimit -n {FILES}; exec \"$@\"");
    let server = env.wrapyfi_by(&script, args)?.pillar();
    server.wait_until(words, |output| {
        output.err.iter().any(|line| line.contains(words)).then_some(())
    })?;
    Ok(server)
}

/// More connections to a port than its program may have files.
fn crowd(port: u16) -> Result<Vec<TcpStream>> {
    let (address, limit) = ((Ipv4Addr::LOCALHOST, port).into(), Duration::from_millis(100));
    let mut held = Vec::new();
    // The system takes those that the program cannot, until its queue is full.
    while held.len() < 2 * FILES
        && let Ok(stream) = TcpStream::connect_timeout(&address, limit)
    {
        held.push(stream);
    }
    anyhow::ensure!(held.len() > FILES, "{} connections", held.len());
    Ok(held)
}

/// Carries three messages.
fn flows(env: &TestEnv, endpoint: &str) -> Result {
    let kind = ["--type", "NativeObject"];
    let mut echo = env.wrapyfi([&["echo", endpoint, "--count", "3"], &kind[..]].concat())?;
    let publish = [&["pub", endpoint, "--value", "1", "--rate", "20"], &kind[..]].concat();
    let publisher = env.wrapyfi(publish)?;
    echo.exits_with(0).map_err(|error| error.context(publisher.tail()))
}

#[test]
fn a_broker_that_had_no_files_left_serves_again() -> Result {
    run("a_broker_that_had_no_files_left_serves_again", NEEDS, |env| {
        let (pub_port, sub_port) = (env.pub_port().to_string(), env.sub_port().to_string());
        let args = ["broker", "--pub-port", &pub_port, "--sub-port", &sub_port];
        let _broker = with_few_files(env, &args, "listeners connect to port")?;
        for port in [env.pub_port(), env.sub_port()] {
            drop(crowd(port)?);
        }
        flows(env, &zeromq(&env.topic("x")))
    })
}

#[test]
fn a_ros_1_node_that_had_no_files_left_serves_again() -> Result {
    let needs = &[Need::Program, Need::Python, Need::Ros1];
    run("a_ros_1_node_that_had_no_files_left_serves_again", needs, |env| {
        let (_roscore, _broker) = (env.roscore()?, env.broker()?);
        let topic = env.topic("x");
        let route = Route::new(&zeromq(&topic), &ros1(&topic), "Text");
        let file = env.write("bridge.yaml", env.foreign().route(route).yaml())?;
        let file = file.display().to_string();
        let args = ["bridge", "--config", &file, "--json"];
        let bridge = with_few_files(env, &args, "ROS 1: node started")?;
        let ports = bridge.ports("tcp")?;
        anyhow::ensure!(ports.len() == 2, "XML-RPC and TCPROS: {ports:?}");
        for port in ports {
            drop(crowd(port)?);
        }
        let publish =
            ["pub", &zeromq(&topic), "--type", "Text", "--value", "\"x\"", "--rate", "20"];
        let _publisher = env.wrapyfi(publish)?;
        let ear = env.rospy(&format!("subscribe --topic {topic}"), None)?;
        ear.messages(3).map(drop).map_err(|error| error.context(bridge.tail()))
    })
}

#[test]
fn a_name_server_that_had_no_files_left_serves_again() -> Result {
    run("a_name_server_that_had_no_files_left_serves_again", NEEDS, |env| {
        env.yarp_conf()?;
        let args = ["yarpserver", "--read", "--no-discovery"];
        let server = with_few_files(env, &args, "name server /root on")?;
        let held = crowd(env.yarp_port())?;
        server.wait_until("the fault", |output| {
            output.err.iter().any(|line| line.contains("Too many open files")).then_some(())
        })?;
        drop(held);
        flows(env, &yarp(&env.topic("x")))
    })
}
