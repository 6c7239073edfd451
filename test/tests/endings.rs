//! Ends of programs: signals at any time, and readers of their output that stand still or went.

use std::fmt::Write as _;
use std::net::TcpListener;

use wrapyfi_e2e::{Need, Process, Result, Route, TestEnv, ros2, run, zeromq};

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
