//! The command line: exit codes, one clear line for each failure, and ends in good order.

use std::net::TcpListener;

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Output, Process, Result, Route, TestEnv, run, zeromq};

pub(super) const PROGRAM: &[Need] = &[Need::Program];

/// Waits for its end; the complaint must be short, name each of `words`, and be no panic.
pub(super) fn complains(process: &mut Process, codes: &[i32], words: &[&str]) -> Result {
    let code = process.exit_code()?;
    let said = process.stderr();
    assert!(
        codes.contains(&code),
        "exit code {code}, expected one of {codes:?}\n{}",
        process.tail()
    );
    assert!(!said.contains("panicked"), "{said}");
    assert!(!said.trim().is_empty(), "no word on stderr");
    for word in words {
        assert!(said.contains(word), "stderr does not say {word:?}:\n{said}");
    }
    Ok(())
}

fn report(output: &Output) -> Option<Value> {
    output.objects().rev().find(|object| object["routes"].is_array())
}

/// Holds a port as a program that is no broker.
pub(super) fn hold(port: u16) -> Result<TcpListener> {
    Ok(TcpListener::bind(("127.0.0.1", port))?)
}

// Ports -----------------------------------------------------------------------------------------

#[test]
fn a_broker_names_the_port_that_is_taken() -> Result {
    run("a_broker_names_the_port_that_is_taken", PROGRAM, |env| {
        for port in [env.pub_port(), env.sub_port()] {
            let _held = hold(port)?;
            let mut broker = env.broker_that_may_fail()?;
            complains(&mut broker, &[1, 2], &[&port.to_string()])?;
            let lines = broker.stderr().lines().filter(|l| l.contains(&port.to_string())).count();
            assert_eq!(lines, 1, "one line names the port:\n{}", broker.stderr());
        }
        Ok(())
    })
}

#[test]
fn a_broker_beside_a_bridge_waits_for_its_end() -> Result {
    run("a_broker_beside_a_bridge_waits_for_its_end", PROGRAM, |env| {
        let bridge =
            env.bridge(&env.embedded().route(Route::new("zeromq:/a", "ros2:/a", "Image")))?;
        bridge.wait_until("its broker", |output| {
            output.err.iter().any(|line| line.contains("broker runs: pub_port")).then_some(())
        })?;
        let broker = env.broker_that_may_fail()?;
        let says = |words: String| {
            broker.wait_until(&words, |output| {
                output.err.iter().any(|line| line.contains(&words)).then_some(())
            })
        };
        says(format!("the ZeroMQ broker that runs already (process {}, ", bridge.id()))?;
        drop(bridge);
        says("listeners connect to port".to_owned())
    })
}

#[test]
fn a_bridge_names_the_port_that_is_taken() -> Result {
    run("a_bridge_names_the_port_that_is_taken", PROGRAM, |env| {
        let _held = hold(env.pub_port())?;
        let config = env.embedded().route(Route::new("zeromq:/a", "ros2:/a", "Image"));
        let bridge = env.bridge(&config)?;
        // Its routes on the other middlewares run meanwhile.
        let words = format!("port {} on 127.0.0.1 is taken", env.pub_port());
        bridge.wait_until("the port that is taken", |output| {
            let waits = |line: &String| line.contains("routes wait") && line.contains(&words);
            output.err.iter().any(waits).then_some(())
        })
    })
}

// Completions -----------------------------------------------------------------------------------

#[test]
fn bash_completes_commands_and_options() -> Result {
    run("bash_completes_commands_and_options", PROGRAM, |env| {
        let answers =
            [("'wrapyfi' 'yarps'", "yarpserver"), ("'wrapyfi' 'demo' '--sec'", "--seconds")];
        for (words, answer) in answers {
            let line = format!(
                "eval \"$(wrapyfi completions bash)\" && COMP_WORDS=({words}) && \
                 COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)) && \
                 _wrapyfi wrapyfi \"${{COMP_WORDS[-1]}}\" \"${{COMP_WORDS[-2]}}\" && echo \"${{COMPREPLY[@]}}\""
            );
            let mut shell = env.shell(&line)?;
            shell.exits_with(0)?;
            assert_eq!(shell.stdout().trim(), answer, "{words}");
        }
        Ok(())
    })
}

// Ends ------------------------------------------------------------------------------------------

#[test]
fn sigterm_ends_a_bridge_with_success() -> Result {
    run("sigterm_ends_a_bridge_with_success", PROGRAM, |env| {
        let mut bridge =
            env.bridge(&env.embedded().route(Route::new("zeromq:/a", "ros2:/a", "Image")))?;
        bridge.wait_until("a status report", report)?;
        bridge.terminate()?;
        complains(&mut bridge, &[0], &["ends: 0 in, 0 out, 0 unread, dropped: none"])
    })
}

#[test]
fn sigterm_ends_a_broker_with_success() -> Result {
    run("sigterm_ends_a_broker_with_success", &[Need::Program, Need::Python], |env| {
        let mut broker = env.broker()?;
        // It serves: a publisher that insists on a listener sends.
        let publisher = env.wrapyfi_publisher(&env.topic("x"), "--no-broker")?;
        let _listener = env.wrapyfi_listener(&env.topic("x"), "")?;
        publisher.messages(1)?;
        broker.terminate()?;
        broker.exits_with(0)
    })
}

#[test]
fn pub_waits_for_a_broker_that_was_killed_as_echo_does() -> Result {
    run("pub_waits_for_a_broker_that_was_killed_as_echo_does", PROGRAM, |env| {
        let mut broker = env.broker()?;
        let endpoint = zeromq(&env.topic("x"));
        let hear = ["echo", &endpoint, "--type", "NativeObject", "--json"];
        let listener = env.wrapyfi(hear)?;
        let talk = ["pub", &endpoint, "--type", "NativeObject", "--value", "1", "--rate", "20"];
        let _talker = env.wrapyfi(talk)?;
        listener.objects(2)?;
        broker.kill()?;
        // The listener's process is the broker now.
        let before = listener.stdout().lines().count();
        listener.objects(before + 5)?;
        Ok(())
    })
}

#[test]
fn sigterm_ends_a_bridge_that_still_waits_for_a_broker() -> Result {
    run("sigterm_ends_a_bridge_that_still_waits_for_a_broker", PROGRAM, |env| {
        let mut bridge =
            env.bridge(&env.foreign().route(Route::new("zeromq:/a", "ros2:/a", "Image")))?;
        let waiting = bridge.wait_until("a status report", report)?;
        assert_eq!(waiting["routes"][0]["state"], "waiting", "{waiting}");
        assert!(
            waiting["routes"][0]["reason"].as_str().is_some_and(|r| !r.is_empty()),
            "it says for what: {waiting}"
        );
        bridge.terminate()?;
        bridge.exits_with(0)
    })
}

#[test]
fn a_bridge_ends_by_itself_after_its_seconds() -> Result {
    run("a_bridge_ends_by_itself_after_its_seconds", PROGRAM, |env| {
        let config = env.embedded().route(Route::new("zeromq:/a", "ros2:/a", "Image"));
        let file = env.write("bridge.yaml", config.yaml())?;
        let file = file.display().to_string();
        let mut bridge = env.wrapyfi(["bridge", "--config", &file, "--seconds", "1", "--json"])?;
        bridge.exits_with(0)?;
        let last = bridge.wait_until("the last report", report)?;
        assert_eq!(last["routes"].as_array().map(Vec::len), Some(1), "{last}");
        Ok(())
    })
}

/// Calls that were answered, or messages that came, by name, as the demo's last table has them.
fn demo_received(table: &str) -> Vec<(String, u64)> {
    let last = table.rsplit("a ROS 2 node receives").next().unwrap_or_default();
    let row = |line: &str| {
        let mut words = line.split_whitespace();
        let (name, _type, got) = (words.next()?, words.next()?, words.next()?);
        Some((name.to_owned(), got.parse().ok()?))
    };
    last.lines().filter_map(row).collect()
}

#[test]
fn the_demo_delivers_on_every_route() -> Result {
    run("the_demo_delivers_on_every_route", PROGRAM, |env| {
        // A YARP network of the user's that is away: the demo neither needs nor changes it.
        let conf = "127.0.0.1 1 yarp\n";
        env.write("yarp.conf", conf)?;
        let mut demo = env.wrapyfi(["demo", "--seconds", "5"])?;
        demo.exits_with(0)?;
        let told = demo.stdout();
        let received = demo_received(&told);
        let names: Vec<_> = received.iter().map(|(name, _)| name.as_str()).collect();
        let expected = [
            "/camera/image_raw",
            "/camera/image_raw/compressed",
            "/microphone",
            "/object",
            "/object/json",
            "/robot/cam/left/image_raw",
            "/robot/ears",
            "/robot/light",
        ];
        assert_eq!(names, expected, "{told}");
        assert!(received.iter().all(|(_, count)| *count > 0), "{told}");
        assert!(told.contains("YARP name server on 127.0.0.1:"), "{told}");
        assert!(!told.contains("YARP name server on 127.0.0.1:1,"), "{told}");
        assert_eq!(std::fs::read_to_string(env.path("yarp.conf"))?, conf);
        // What libraries say of their insides is no line for the reader of a demo.
        let logged = demo.stderr();
        assert_eq!(logged.lines().find(|line| line.len() > 400), None);
        Ok(())
    })
}

// Exit codes ------------------------------------------------------------------------------------

#[test]
fn echo_without_a_message_ends_by_time_out() -> Result {
    run("echo_without_a_message_ends_by_time_out", PROGRAM, |env| {
        for endpoint in ["zeromq:/nothing", "ros2:/nothing"] {
            let mut echo = env.wrapyfi([
                "echo",
                endpoint,
                "--type",
                "NativeObject",
                "--count",
                "1",
                "--timeout",
                "1",
                "--json",
            ])?;
            complains(&mut echo, &[3], &[endpoint])?;
            assert_eq!(echo.stdout(), "", "nothing but messages on stdout");
        }
        Ok(())
    })
}

#[test]
fn bad_usage_is_two() -> Result {
    run("bad_usage_is_two", PROGRAM, |env| {
        let cases: &[(&[&str], &[&str])] = &[
            (&["eko"], &["echo"]),
            (&["echo"], &["ENDPOINT"]),
            (&["echo", "zeromq:/a", "--type", "Imag"], &["Imag", "Image"]),
            (&["echo", "zeromqq:/a", "--type", "Image"], &["zeromqq", "zeromq"]),
            (&["echo", "/a", "--type", "Image"], &["/a"]),
            (&["pub", "zeromq:/a", "--type", "NativeObject"], &["--value"]),
            (&["pub", "zeromq:/a", "--type", "NativeObject", "--value", "{"], &["JSON"]),
            (&["bridge"], &["--config"]),
            (&["bridge", "--config", "no_such_file.yaml"], &["no_such_file.yaml"]),
            (&["check", "no_such_file.yaml"], &["no_such_file.yaml"]),
        ];
        for (args, words) in cases {
            complains(&mut env.wrapyfi(*args)?, &[2], words)?;
        }
        let missing = ["pub", "zeromq:/a", "--type", "Image", "--file", "no_such_file.png"];
        complains(&mut env.wrapyfi(missing)?, &[1, 2], &["no_such_file.png"])
    })
}

/// `wrapyfi … | head`: a reader that has seen enough is no fault of the command.
#[test]
fn a_reader_that_went_is_no_complaint() -> Result {
    run("a_reader_that_went_is_no_complaint", PROGRAM, |env| {
        let _broker = env.broker()?;
        let config = env.foreign().route(Route::new("zeromq:/a", "ros2:/a", "NativeObject"));
        let file = env.write("bridge.yaml", config.yaml())?.display().to_string();
        let rep = env.rep_port().to_string();
        let req = env.req_port().to_string();
        let ports = ["--rep-port", rep.as_str(), "--req-port", req.as_str()];
        let serve = [&["serve", "zeromq:/f", "--echo"], &ports[..]].concat();
        let server = env.wrapyfi(&serve)?;
        server.wait_until("the server", |output| {
            output.err.iter().any(|line| line.contains("serving")).then_some(())
        })?;
        let call = ["call", "zeromq:/f", "--rep-port", &rep, "--value", "1", "--timeout", "100"];
        let set_bool = ["--type", "std_srvs/srv/SetBool"];
        let of_ros = env.topic("set");
        let of_ros = format!("ros2:{of_ros}");
        let _ros = env.wrapyfi([&["serve", &of_ros, "--echo"], &set_bool[..]].concat())?;
        let publish =
            ["pub", "zeromq:/a", "--type", "NativeObject", "--value", "1", "--rate", "20"];
        let _publisher = env.wrapyfi(publish)?;
        let echo = ["echo", "zeromq:/a", "--type", "NativeObject"];
        for args in [
            &["check", &file][..],
            &["bridge", "--config", &file, "--json", "--seconds", "2"],
            &["demo", "--seconds", "2"],
            &["list", "--json"],
            &["--help"],
            &echo,
            &call,
            &["call", &of_ros, "--value", "{}", "--timeout", "100"],
        ] {
            let mut unread = env.wrapyfi_unread(args)?;
            unread.exits_with(0)?;
            let said = unread.stderr();
            assert!(!said.contains("pipe") && !said.contains("wrapyfi:"), "{args:?}: {said}");
        }
        Ok(())
    })
}

/// Calls the server at `endpoint` in every way, all of which mean the same.
fn called_in_every_way(env: &TestEnv, endpoint: &str, serve: &[&str]) -> Result {
    let server = env.wrapyfi([&["serve", endpoint, "--count", "4", "--json"], serve].concat())?;
    server.wait_until("the server", |output| {
        output.err.iter().any(|line| line.contains("serving")).then_some(())
    })?;
    let kind: &[&str] = if serve.contains(&"--type") { &serve[..2] } else { &[] };
    for given in [
        &["--value", r#"{"data": true}"#][..],
        &["--args", r#"[{"data": true}]"#],
        &["--args", "[true]"],
        &["--kwargs", r#"{"data": true}"#],
    ] {
        let rep = env.rep_port().to_string();
        let ports: &[&str] =
            if endpoint.starts_with("zeromq") { &["--rep-port", &rep] } else { &[] };
        let call = ["call", endpoint, "--timeout", "100", "--json"];
        let mut call = env.wrapyfi([&call, given, kind, ports].concat())?;
        let told = call.objects(1)?.remove(0)["value"].clone();
        call.exits_with(0)?;
        assert_eq!(told, json!({"success": true, "message": "on"}), "{endpoint} {given:?}");
    }
    for asked in server.objects(4)? {
        let is_on = |value: &Value| *value == json!({"data": true}) || *value == json!(true);
        let (args, kwargs) = (&asked["args"], &asked["kwargs"]);
        let on = is_on(&asked["value"]) || is_on(kwargs) || args.get(0).is_some_and(is_on);
        assert!(on, "{endpoint}: {asked}");
    }
    Ok(())
}

const SET_BOOL: [&str; 2] = ["--type", "std_srvs/srv/SetBool"];
const ON: [&str; 2] = ["--value", r#"{"success": true, "message": "on"}"#];

#[test]
fn arguments_are_given_alike_on_every_side() -> Result {
    run("arguments_are_given_alike_on_every_side", PROGRAM, |env| {
        let _names = env.yarpserver()?;
        let typed = [SET_BOOL, ON].concat();
        called_in_every_way(env, &format!("ros2:{}", env.topic("set")), &typed)?;
        called_in_every_way(env, &format!("yarp:{}", env.topic("set")), &typed)?;
        called_in_every_way(env, &format!("yarp:{}", env.topic("function")), &ON)?;
        let native = [["--type", "NativeObject"], ON].concat();
        called_in_every_way(env, "zeromq:/set", &native)?;
        called_in_every_way(env, "zeromq:/set", &ON)
    })
}

#[test]
fn arguments_are_given_alike_on_ros_1_too() -> Result {
    run("arguments_are_given_alike_on_ros_1_too", &[Need::Program, Need::Ros1], |env| {
        let _roscore = env.roscore()?;
        let typed = [SET_BOOL, ON].concat();
        called_in_every_way(env, &format!("ros:{}", env.topic("set")), &typed)?;
        let mut untyped = env.wrapyfi(["serve", "ros:/x", "--echo"])?;
        complains(&mut untyped, &[2], &["ros:/x: --type is needed", "NativeObject"])
    })
}

#[test]
fn an_address_of_its_own_is_for_middlewares_that_tell_it() -> Result {
    run("an_address_of_its_own_is_for_middlewares_that_tell_it", PROGRAM, |env| {
        let ip = |endpoint: &str, ip: &str| {
            env.wrapyfi(["echo", endpoint, "--type", "Image", "--ip", ip])
        };
        complains(&mut ip("yarp:/x", "10.0.0")?, &[2], &["--ip", "write it as 192.168.1.7"])?;
        let words = ["--ip and --insecure are for ros and yarp"];
        complains(&mut ip("ros2:/x", "192.0.2.7")?, &[2], &words)?;
        let words = [words[0], "WRAPYFI_ZEROMQ_SOCKET_IP"];
        complains(&mut ip("zeromq:/x", "192.0.2.7")?, &[2], &words)?;
        let mut call = env.wrapyfi(["call", "ros2:/x", "--option", "carrier=tcp"])?;
        complains(
            &mut call,
            &[2],
            &["option carrier is unknown on ros2; options here: introspection"],
        )
    })
}

#[test]
fn ros_arguments_are_for_the_bridge_alone() -> Result {
    run("ros_arguments_are_for_the_bridge_alone", PROGRAM, |env| {
        let mut echo = env.wrapyfi(["echo", "ros2:/x", "--ros-args", "-r", "__ns:=/lab"])?;
        complains(&mut echo, &[2], &["--ros-args is for the nodes"])?;
        let mut bridge = env.wrapyfi(["bridge", "--ros-args", "--loud"])?;
        complains(&mut bridge, &[2], &["--loud"])
    })
}

#[test]
fn help_and_version_are_success() -> Result {
    run("help_and_version_are_success", PROGRAM, |env| {
        let mut help = env.wrapyfi(["--help"])?;
        help.exits_with(0)?;
        for word in ["demo", "bridge", "check", "echo", "pub", "broker", "ZeroMQ", "YARP", "ROS 1"]
        {
            assert!(help.stdout().contains(word), "help does not mention {word}");
        }
        env.wrapyfi(["--version"])?.exits_with(0)
    })
}

// ROS 2 from the command line ---------------------------------------------------------------------

#[test]
fn echo_and_pub_speak_ros() -> Result {
    run("echo_and_pub_speak_ros", PROGRAM, |env| {
        let topic = format!("ros2:{}", env.topic("x"));
        let common = ["--type", "std_msgs/msg/String", "--count", "1"];
        // The publisher waits for the listener; the listener may start last.
        let mut publisher =
            env.wrapyfi([&["pub", &topic, "--value", "{\"a\": [1, 2]}"][..], &common].concat())?;
        let mut echo =
            env.wrapyfi([&["echo", &topic, "--json", "--timeout", "100"][..], &common].concat())?;
        assert_eq!(echo.objects(1)?[0]["value"], serde_json::json!({"a": [1, 2]}));
        echo.exits_with(0)?;
        publisher.exits_with(0)
    })
}

/// No program has the topic: it is said, and the type is learned when a program comes.
#[test]
fn echo_without_a_type_tells_that_nobody_announces_one() -> Result {
    run("echo_without_a_type_tells_that_nobody_announces_one", PROGRAM, |env| {
        let topic = format!("ros2:{}", env.topic("x"));
        let mut echo = env.wrapyfi(["echo", &topic, "--json", "--count", "1"])?;
        echo.wait_until("a line of the log", |output| {
            output.err.iter().any(|line| line.contains("waiting for somebody")).then_some(())
        })?;
        let value = ["--type", "std_msgs/msg/Bool", "--value", "{\"data\": true}"];
        let _publisher = env.wrapyfi([&["pub", &topic, "--rate", "10"][..], &value].concat())?;
        assert_eq!(echo.objects(1)?[0]["value"]["data"], true);
        echo.exits_with(0)
    })
}

// The YARP name server ---------------------------------------------------------------------------

#[test]
fn a_name_server_is_detected_and_written_down() -> Result {
    run("a_name_server_is_detected_and_written_down", PROGRAM, |env| {
        let port = env.yarp_port().to_string();
        // The group is asked at the base port of the network.
        env.set_variable("YARP_PORT_RANGE", &port);
        let detect = |more: &[&str]| env.wrapyfi([&["detect"], more].concat());
        detect(&["--timeout", "0.1"])?.exits_with(3)?;
        let _server = env.wrapyfi(["yarpserver", "--port", &port])?.pillar();
        let mut detect = detect(&["--write", "--timeout", "30"])?;
        detect.exits_with(0)?;
        assert_eq!(detect.stdout().trim(), format!("/root 127.0.0.1 {port}"));
        // Everybody finds it now.
        env.wrapyfi(["list", "yarp"])?.exits_with(0)
    })
}

#[test]
fn a_yarpserver_says_where_it_is_and_ends_in_good_order() -> Result {
    use std::io::{Read as _, Write as _};

    run("a_yarpserver_says_where_it_is_and_ends_in_good_order", PROGRAM, |env| {
        let mut server = env.wrapyfi(["yarpserver", "--port", "0", "--no-discovery"])?;
        let port = server.wait_until("its address", |output| {
            let said = output.err.iter().find(|line| line.contains("name server /root on"))?;
            said.split_once("http://127.0.0.1:")?.1.split('/').next()?.parse::<u16>().ok()
        })?;
        let mut asked = std::net::TcpStream::connect(("127.0.0.1", port))?;
        asked.write_all(b"NAME_SERVER query /root\n")?;
        asked.shutdown(std::net::Shutdown::Write)?;
        let mut answer = String::new();
        asked.read_to_string(&mut answer)?;
        let expected = format!(
            "registration name /root ip 127.0.0.1 port {port} type tcp\r\n*** end of message\r\n"
        );
        assert_eq!(answer, expected);
        // A second one names the port.
        let port = port.to_string();
        let args = ["yarpserver", "--port", &port, "--no-discovery", "--silent"];
        complains(&mut env.wrapyfi(args)?, &[1], &[&port, "is taken"])?;
        let args = ["yarpserver", "--ip", "0.0.0.0", "--port", "0", "--no-discovery"];
        complains(&mut env.wrapyfi(args)?, &[2], &["insecure"])?;
        server.terminate()?;
        server.exits_with(0)
    })
}
