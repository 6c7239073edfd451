//! YARP's own tools around our programs: with its name server and with ours.

use serde_json::json;
use wrapyfi_e2e::{
    Need, Process, Result, Route, TestEnv, asked_until, ros2, run, until_route, yarp,
};

const NEEDS: &[Need] = &[Need::Program, Need::Yarp];

/// Name server at which ports are registered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Names {
    Ours,
    Yarps,
}

/// The same tests at each name server.
macro_rules! at_each {
    ($($test:ident;)*) => {
        mod ours { $(
            #[test]
            fn $test() -> wrapyfi_e2e::Result {
                super::at(concat!("ours_", stringify!($test)), super::Names::Ours, super::$test)
            }
        )* }
        mod yarps { $(
            #[test]
            fn $test() -> wrapyfi_e2e::Result {
                super::at(concat!("yarps_", stringify!($test)), super::Names::Yarps, super::$test)
            }
        )* }
    };
}

at_each! {
    the_tools_know_our_ports;
    read_hears_ours_by_every_carrier;
    ours_hears_write;
    connect_and_disconnect_work_on_our_ports;
    rpc_asks_ours;
    ours_asks_rpcserver;
    numbers_are_answered_as_the_client_writes_them;
    unix_sockets_carry_both_ways;
    ports_of_tools_find_each_other;
    a_bridge_carries_what_tools_write_and_read;
    a_control_board_is_commanded_and_asked;
    an_input_that_comes_after_its_topic_finds_its_name_free;
    ours_take_no_number_that_a_robot_is_given;
    the_name_of_a_killed_program_is_ours;
}

fn at(test: &str, names: Names, body: impl FnOnce(&TestEnv) -> Result) -> Result {
    run(test, NEEDS, |env| {
        let _server = match names {
            Names::Ours => env.yarpserver()?,
            Names::Yarps => yarps_server(env)?,
        };
        body(env)
    })
}

/// YARP's name server on this test's port.
pub(crate) fn yarps_server(env: &TestEnv) -> Result<Process> {
    let port = env.yarp_port().to_string();
    let args = ["--write", "--ip", "127.0.0.1", "--socket", &port];
    let server = env.yarp_tool("yarpserver", &args)?.pillar();
    told(env, &["where"], |said| said.contains(&port))?;
    Ok(server)
}

/// A name server keeps the address of a program that was killed, and may be told it again by the program that restores
/// what it knew.
fn the_name_of_a_killed_program_is_ours(env: &TestEnv) -> Result {
    let name = env.topic("kept");
    // No program listens at this port: it is the test's own, for a broker that it does not start.
    let dead = env.rep_port().to_string();
    let left_behind = ["name", "register", &name, "tcp", "127.0.0.1", &dead];
    let is_at_it = |said: &str| said.contains(&format!("port {dead} "));
    let is_ours = |said: &str| said.contains("registration name") && !is_at_it(said);
    told(env, &left_behind, is_at_it)?;
    let _publisher = publisher(env, &name, "here")?;
    told(env, &["name", "query", &name], is_ours)?;
    told(env, &left_behind, is_at_it)?;
    told(env, &["name", "query", &name], is_ours)?;
    let ours = yarp(&name);
    let mut hears = env.wrapyfi(["echo", &ours, "--type", "Text", "--count", "1"])?;
    hears.exits_with(0)
}

/// Output of `yarp`, once it is as wanted.
fn told(env: &TestEnv, args: &[&str], wanted: impl Fn(&str) -> bool) -> Result<String> {
    let mut last = String::new();
    let said = asked_until(&format!("yarp {} to say it", args.join(" ")), || {
        let mut tool = env.yarp_tool("yarp", args)?;
        tool.exit_code()?;
        last = tool.stdout() + &tool.stderr();
        Ok(wanted(&last).then(|| last.clone()))
    });
    said.map_err(|error| error.context(last))
}

/// Waits until `yarp exists` finds the port.
pub(crate) fn exists(env: &TestEnv, port: &str) -> Result {
    asked_until(&format!("port {port}"), || {
        Ok((env.yarp_tool("yarp", &["exists", port])?.exit_code()? == 0).then_some(()))
    })
}

fn prints(process: &Process, words: &str) -> Result {
    process.wait_until(words, |output| {
        output.out.iter().chain(&output.err).any(|line| line.contains(words)).then_some(())
    })
}

/// Ours that publishes a text at a rate.
fn publisher(env: &TestEnv, port: &str, text: &str) -> Result<Process> {
    let (endpoint, value) = (yarp(port), json!(text).to_string());
    let publish = ["pub", &endpoint, "--type", "Text", "--value", &value, "--rate", "20"];
    env.wrapyfi(publish)
}

fn the_tools_know_our_ports(env: &TestEnv) -> Result {
    let port = env.topic("cam");
    let publisher = publisher(env, &port, "hello")?;
    exists(env, &port)?;
    told(env, &["name", "list"], |said| said.contains(&port))?;
    told(env, &["name", "query", &port], |said| said.contains("ip 127.0.0.1 port"))?;
    told(env, &["ping", &port], |said| said.contains("no outgoing connections"))?;
    let mut wait = env.yarp_tool("yarp", &["wait", &port])?;
    // It ends when the port is there, and says 1 then.
    wait.exits_with(1)?;
    let listed = ["list", "yarp", "--json"];
    let mut list = env.wrapyfi(listed)?;
    list.exits_with(0)?;
    let found = list.objects(1)?;
    assert!(found.iter().any(|one| one["name"].as_str() == Some(&port)), "{found:?}");
    drop(publisher);
    told(env, &["name", "list"], |said| !said.contains(&port)).map(drop)
}

fn read_hears_ours_by_every_carrier(env: &TestEnv) -> Result {
    let port = env.topic("text");
    let _publisher = publisher(env, &port, "how are you")?;
    exists(env, &port)?;
    for carrier in ["tcp", "fast_tcp", "udp", "text", "text_ack", "mcast"] {
        let ear = env.topic(&format!("ear_{carrier}"));
        let read = env.yarp_tool("yarp", &["read", &ear])?;
        exists(env, &ear)?;
        let mut connect = env.yarp_tool("yarp", &["connect", &port, &ear, carrier])?;
        connect.exits_with(0).map_err(|error| error.context(carrier))?;
        prints(&read, "how are you").map_err(|error| error.context(carrier))?;
    }
    Ok(())
}

fn ours_hears_write(env: &TestEnv) -> Result {
    let port = env.topic("typed");
    let mut write = env.yarp_tool("yarp", &["write", &port])?;
    exists(env, &port)?;
    let endpoint = yarp(&port);
    let echo = env.wrapyfi(["echo", &endpoint, "--type", "NativeObject", "--json"])?;
    told(env, &["ping", &port], |said| said.contains(&format!("{port}:in")))?;
    write.tell("say 7 (1 2.5 \"a b\")")?;
    let heard = echo.objects(1)?.remove(0);
    let value = &heard["value"];
    assert_eq!((&value[0], &value[2]), (&json!("say"), &json!([1, 2.5, "a b"])), "{heard}");
    Ok(())
}

fn connect_and_disconnect_work_on_our_ports(env: &TestEnv) -> Result {
    let (port, ear) = (env.topic("mouth"), env.topic("ear"));
    let _publisher = publisher(env, &port, "x")?;
    exists(env, &port)?;
    let read = env.yarp_tool("yarp", &["read", &ear])?;
    exists(env, &ear)?;
    env.yarp_tool("yarp", &["connect", &port, &ear])?.exits_with(0)?;
    prints(&read, "x")?;
    told(env, &["ping", &port], |said| said.contains(&ear))?;
    assert_eq!(env.yarp_tool("yarp", &["exists", &port, &ear])?.exit_code()?, 0);
    env.yarp_tool("yarp", &["disconnect", &port, &ear])?.exits_with(0)?;
    told(env, &["ping", &port], |said| !said.contains(&ear)).map(drop)
}

fn rpc_asks_ours(env: &TestEnv) -> Result {
    let port = env.topic("light");
    let (endpoint, value) = (yarp(&port), r#"{"success": true, "message": "it is on"}"#);
    let kind = ["--type", "std_srvs/srv/SetBool", "--value", value, "--json"];
    let server = env.wrapyfi([&["serve", &endpoint], &kind[..]].concat())?;
    exists(env, &port)?;
    let mut rpc = env.yarp_tool("yarp", &["rpc", &port])?;
    rpc.tell("1")?;
    rpc.tell("(data 0)")?;
    let asked = server.objects(2)?;
    // Fields that are true or false take 1 and 0.
    assert_eq!(asked[0]["args"], json!([true]), "{asked:?}");
    assert_eq!(asked[1]["kwargs"], json!({"data": false}), "{asked:?}");
    // Output into a pipe comes when the tool ends.
    rpc.close_stdin();
    rpc.exits_with(0)?;
    assert_eq!(rpc.stdout().matches("[ok] \"it is on\"").count(), 2, "{}", rpc.tail());
    Ok(())
}

fn ours_asks_rpcserver(env: &TestEnv) -> Result {
    let port = env.topic("echoes");
    let server = env.yarp_tool("yarp", &["rpcserver", "--echo", &port])?;
    exists(env, &port)?;
    let endpoint = yarp(&port);
    let args = ["--args", r#"["set", "pos", 2, 10.5]"#, "--option", "bottle=true"];
    let mut call =
        env.wrapyfi([&["call", &endpoint, "--json", "--timeout", "60"], &args[..]].concat())?;
    let told = call.objects(1)?.remove(0);
    call.exits_with(0)?;
    assert_eq!(told["value"], json!(["set", "pos", 2, 10.5]), "{}", server.tail());
    // As `yarp rpc` shows it.
    let args = ["--timeout", "60", "--args", r#"["[get]", [1, "two words"]]"#];
    let mut call = env.wrapyfi([&["call", &endpoint], &args[..]].concat())?;
    call.exits_with(0)?;
    assert_eq!(call.stdout().trim(), r#"[get] (1 "two words")"#, "{}", server.tail());
    Ok(())
}

/// Numbers of [`server`] as YARP prints them, of either version.
const NUMBERS: [&str; 2] = ["2.5 -7 w (0.10000", ") 9007199254740993"];

/// Ours that answers with numbers.
fn server(env: &TestEnv, port: &str) -> Result<Process> {
    let endpoint = yarp(port);
    let value = r#"[2.5, -7, "w", [0.1], 9007199254740993]"#;
    let server = env.wrapyfi(["serve", &endpoint, "--value", value, "--option", "bottle=true"])?;
    exists(env, port)?;
    Ok(server)
}

/// Asks from a port with a name, and looks for what every answer should have.
fn asks(env: &TestEnv, port: &str, client: &str, lines: &[&str], wanted: &[&str]) -> Result {
    let mut rpc = env.yarp_tool("yarp", &["rpc", "--client", client])?;
    exists(env, client)?;
    env.yarp_tool("yarp", &["connect", client, port])?.exits_with(0)?;
    for line in lines {
        rpc.tell(line)?;
    }
    // Output into a pipe comes when the tool ends.
    rpc.close_stdin();
    rpc.exits_with(0)?;
    for wanted in wanted {
        assert_eq!(rpc.stdout().matches(wanted).count(), lines.len(), "{}", rpc.tail());
    }
    Ok(())
}

/// YARP 4 writes floats in another way than YARP 3, and a request with one shows which.
fn numbers_are_answered_as_the_client_writes_them(env: &TestEnv) -> Result {
    let (port, client) = (env.topic("numbers"), env.topic("client"));
    let _server = server(env, &port)?;
    asks(env, &port, &client, &["(1.5 2)", "hello", "1"], &NUMBERS)
}

/// Requests without floats: the name server is of the same YARP.
#[test]
fn numbers_for_who_shows_none_are_those_of_the_name_server() -> Result {
    run("numbers_for_who_shows_none_are_those_of_the_name_server", NEEDS, |env| {
        let _names = yarps_server(env)?;
        let [port, client, params, own] =
            ["numbers", "client", "params", "own"].map(|name| env.topic(name));
        let _server = server(env, &port)?;
        asks(env, &port, &client, &["hello", "1"], &NUMBERS)?;
        let mut rpc = env.yarp_tool("yarp", &["rpc", &port])?;
        rpc.tell("hello")?;
        rpc.close_stdin();
        rpc.exits_with(0)?;
        assert!(rpc.stdout().contains(NUMBERS[0]), "{}", rpc.tail());

        // A service of ROS 2, by a bridge.
        let (offered, kind) = (ros2(&params), "rcl_interfaces/srv/GetParameters");
        let value = r#"{"values": [{"type": 3, "double_value": 2.5, "integer_value": -7}]}"#;
        let _ros = env.wrapyfi(["serve", &offered, "--type", kind, "--value", value])?;
        let route = Route::service(&offered, &yarp(&own), kind);
        let _bridge = env.bridge(&env.embedded().route(route))?;
        exists(env, &own)?;
        asks(
            env,
            &own,
            &env.topic("asker"),
            &["(gain)"],
            &["(double_value 2.5)", "(integer_value -7)"],
        )
    })
}

/// Messages, requests and replies; with acknowledgements and without.
fn unix_sockets_carry_both_ways(env: &TestEnv) -> Result {
    env.set_variable("YARP_RUNTIME_DIR", env.path("sockets"));
    let port = env.topic("ours");
    let _publisher = publisher(env, &port, "how are you")?;
    exists(env, &port)?;
    let (typed, echoes) = (env.topic("typed"), env.topic("echoes"));
    let mut write = env.yarp_tool("yarp", &["write", &typed])?;
    exists(env, &typed)?;
    let _server = env.yarp_tool("yarp", &["rpcserver", "--echo", &echoes])?;
    exists(env, &echoes)?;
    for carrier in ["unix_stream", "unix_stream+ack"] {
        let ear = env.topic(&carrier.replace('+', "_"));
        let read = env.yarp_tool("yarp", &["read", &ear])?;
        exists(env, &ear)?;
        env.yarp_tool("yarp", &["connect", &port, &ear, carrier])?.exits_with(0)?;
        prints(&read, "how are you").map_err(|error| error.context(carrier))?;
        told(env, &["ping", &port], |said| said.contains(carrier))?;
        env.yarp_tool("yarp", &["disconnect", &port, &ear])?.exits_with(0)?;
        told(env, &["ping", &port], |said| !said.contains(&ear))?;

        let carried = format!("carrier={carrier}");
        let listen = ["echo", &yarp(&typed), "--type", "NativeObject", "--json"];
        let echo = env.wrapyfi([&listen[..], &["--option", &carried]].concat())?;
        let wanted = format!("{typed}:in");
        told(env, &["ping", &typed], |said| said.contains(&wanted) && said.contains(carrier))?;
        write.tell("say 7 (1 2.5 \"a b\")")?;
        let heard = echo.objects(1)?.remove(0);
        assert_eq!(heard["value"], json!(["say", 7, [1, 2.5, "a b"]]), "{carrier}");
        drop(echo);
        told(env, &["ping", &typed], |said| !said.contains(&wanted))?;

        let ask = ["call", &yarp(&echoes), "--json", "--timeout", "60"];
        let how = ["--args", "[\"get\", 2.5]", "--option", "bottle=true", "--option", &carried];
        let mut call = env.wrapyfi([&ask[..], &how[..]].concat())?;
        let told = call.objects(1)?.remove(0);
        call.exits_with(0)?;
        assert_eq!(told["value"], json!(["get", 2.5]), "{carrier}");
    }
    assert_eq!(std::fs::read_dir(env.path("sockets"))?.count(), 0, "sockets are left");
    Ok(())
}

/// Connects tools of YARP with each other: nothing of ours but perhaps the name server takes part.
fn ports_of_tools_find_each_other(env: &TestEnv) -> Result {
    let (mouth, ear) = (env.topic("mouth"), env.topic("ear"));
    let read = env.yarp_tool("yarp", &["read", &ear])?;
    let mut write = env.yarp_tool("yarp", &["write", &mouth])?;
    exists(env, &mouth)?;
    exists(env, &ear)?;
    env.yarp_tool("yarp", &["connect", &mouth, &ear, "udp"])?.exits_with(0)?;
    write.tell("among us")?;
    prints(&read, "among us")?;
    told(env, &["name", "list"], |said| said.contains(&mouth) && said.contains(&ear))?;
    drop(write);
    told(env, &["clean", "--timeout", "1"], |_| true)?;
    told(env, &["name", "list"], |said| !said.contains(&mouth)).map(drop)
}

fn a_bridge_carries_what_tools_write_and_read(env: &TestEnv) -> Result {
    let [typed, shown, said] = ["typed", "shown", "said"].map(|name| env.topic(name));
    let routes = [
        Route::new(&yarp(&typed), &ros2(&shown), "Text"),
        Route::new(&ros2(&said), &yarp(&said), "Text"),
    ];
    let mut write = env.yarp_tool("yarp", &["write", &typed])?;
    exists(env, &typed)?;
    let config = routes.into_iter().fold(env.embedded(), wrapyfi_e2e::Config::route);
    let bridge = env.bridge(&config)?;
    let endpoint = ros2(&shown);
    let echo = env.wrapyfi(["echo", &endpoint, "--type", "Text", "--json"])?;
    bridge.wait_until("the route to be active", |output| {
        let last = output.objects().last()?;
        (last["routes"][0]["state"] == "active").then_some(())
    })?;
    write.tell("up you go")?;
    let heard = echo.objects(1).map_err(|error| error.context(bridge.tail()))?.remove(0);
    assert!(heard.to_string().contains("up you go"), "{heard}");

    let endpoint = ros2(&said);
    let publish = ["pub", &endpoint, "--type", "Text", "--value", "\"down again\"", "--rate", "10"];
    let _publisher = env.wrapyfi(publish)?;
    exists(env, &said)?;
    let read = env.yarp_tool("yarp", &["read", "...", &said])?;
    prints(&read, "down again")
}

/// Programs of YARP do not register again: the new name server knows the writer's port only when the test is over.
#[test]
fn a_new_name_server_ends_no_route_whose_port_lives() -> Result {
    run("a_new_name_server_ends_no_route_whose_port_lives", NEEDS, |env| {
        let mut server = yarps_server(env)?;
        let typed = env.topic("typed");
        let mut write = env.yarp_tool("yarp", &["write", &typed])?;
        exists(env, &typed)?;
        let pattern = Route::new(&yarp("/(.*)"), &ros2("/$1"), "Text");
        let bridge = env.bridge(&env.embedded().route(pattern))?;
        let endpoint = ros2(&typed);
        let echo = env.wrapyfi(["echo", &endpoint, "--type", "Text", "--json"])?;
        let route = format!("{} -> {endpoint}", yarp(&typed));
        until_route(&bridge, &route, |route| {
            route.is_some_and(|route| route["state"] == "active")
        })?;
        write.tell("before")?;
        echo.objects(1).map_err(|error| error.context(bridge.tail()))?;
        server.kill()?;
        server = yarps_server(env)?;
        // Twice as long as a route lives without its source.
        for heard in 2..=11 {
            write.tell("and on")?;
            echo.objects(heard).map_err(|error| error.context(bridge.tail()))?;
            std::thread::sleep(std::time::Duration::from_secs(1));
        }
        // The bridge's own port is registered again.
        let lists = format!("{typed} ");
        told(env, &["name", "list"], |said| said.contains("/root") && !said.contains(&lists))?;
        let mut why = env.wrapyfi(["why", &yarp(&typed), "--node", "/wrapyfi_bridge"])?;
        why.exit_code()?;
        let said = why.stdout();
        let forgotten = format!("has 1 publisher, but nobody publishes {} that the", yarp(&typed));
        assert!(said.contains(&forgotten), "{said}");
        let log = bridge.stderr();
        assert!(!log.contains("route ended"), "{log}");
        // The program ends without an announcement.
        write.kill()?;
        until_route(&bridge, &route, |route| route.is_none())?;
        drop(server);
        Ok(())
    })
}

/// A simulated head under YARP's own control board server.
fn control_board(env: &TestEnv, head: &str) -> Result<Process> {
    let device = ["--device", "deviceBundler", "--wrapper_device", "controlBoard_nws_yarp"];
    let joints = ["--attached_device", "fakeMotionControl", "--period", "0.02", "--name", head];
    let board = env.yarp_tool("yarpdev", &[&device[..], &joints[..]].concat())?;
    exists(env, &format!("{head}/stateExt:o"))?;
    Ok(board)
}

fn a_control_board_is_commanded_and_asked(env: &TestEnv) -> Result {
    let head = env.topic("head");
    let _board = control_board(env, &head)?;
    let bridge = env.executable("yarp_bridge", &[])?;
    let ask = |endpoint: &str, args: &str| {
        let kind = ["--type", "NativeObject", "--json", "--timeout", "60", "--args", args];
        let mut call = env.wrapyfi([&["call", endpoint], &kind[..]].concat())?;
        call.exits_with(0).map_err(|error| error.context(bridge.tail()))?;
        Ok::<_, anyhow::Error>(call.objects(1)?.remove(0)["value"].clone())
    };
    let nws = format!("{head}/nws/rpc:i");
    let is_of_yarp_4 = env.yarp_tool("yarp", &["exists", &nws])?.exit_code()? == 0;
    // Of YARP 3 it has no help, and says so.
    let (rpc, questions) = if is_of_yarp_4 {
        (nws, [(r#"["getAxesRPC"]"#, &["[ok]", "1"][..]), (r#"["help"]"#, &["getAxesRPC"])])
    } else {
        let words = &["[is]", "enc", "[ok]"][..];
        (format!("{head}/rpc:i"), [(r#"["get", "enc", 0]"#, words), (r#"["help"]"#, &["[nak]"])])
    };
    for endpoint in [ros2(&rpc.replace(':', "/")), yarp(&rpc)] {
        for (question, words) in questions {
            // On ROS 2 the object is in a message.
            let told = ask(&endpoint, question)?.to_string();
            assert!(words.iter().all(|word| told.contains(word)), "{told}");
        }
    }
    let (endpoint, input) = (ros2(&format!("{head}/command/i")), format!("{head}/command:i"));
    let kind = ["--type", "std_msgs/msg/Float64MultiArray", "--value", r#"{"data": [1.0]}"#];
    let _commands = env.wrapyfi([&["pub", &endpoint], &kind[..], &["--rate", "10"]].concat())?;
    prints(&bridge, &format!("writes to the port {input}"))?;
    told(env, &["ping", &input], |said| said.contains(":out:")).map(drop)
}

/// YARP's ports do not start where their name is registered.
fn an_input_that_comes_after_its_topic_finds_its_name_free(env: &TestEnv) -> Result {
    let words = format!("{}/words/in", env.topic("robot"));
    let bridge = env.executable("yarp_bridge", &["-p", "status_json:=true"])?;
    let (topic, kind) = (ros2(&words), ["--type", "Text", "--value", "\"up you go\""]);
    let _publisher = env.wrapyfi([&["pub", &topic], &kind[..], &["--rate", "10"]].concat())?;
    let name = format!("{topic} -> {}", yarp(&words));
    bridge.wait_until("the route", |output| {
        let status = output.objects().last()?;
        status["routes"].as_array()?.iter().find(|route| route["name"] == *name).map(drop)
    })?;
    let mut known = env.yarp_tool("yarp", &["name", "query", &words])?;
    known.exit_code()?;
    let said = known.stdout() + &known.stderr();
    assert!(!said.contains(" port "), "nobody has the name: {said}");
    let robot = env.yarp_tool("yarp", &["read", &words])?;
    prints(&robot, "up you go").map_err(|error| error.context(bridge.tail()))
}

/// YARP's server, started anew, gives the same numbers away again.
fn ours_take_no_number_that_a_robot_is_given(env: &TestEnv) -> Result {
    let port = env.topic("cam");
    let _publisher = publisher(env, &port, "hello")?;
    exists(env, &port)?;
    let number = |name: &str| {
        let said = told(env, &["name", "query", name], |said| said.contains(" port "))?;
        let number = said.split(" port ").nth(1).and_then(|rest| rest.split(' ').next());
        Ok::<_, anyhow::Error>(number.unwrap_or_default().parse::<u16>()?)
    };
    let ours = number(&port)?;
    let given = env.topic("given");
    told(env, &["name", "register", &given], |said| said.contains(" port "))?;
    let base = env.yarp_port();
    let near = |number: u16| {
        let bases = [base, 10_000];
        bases.iter().any(|base| (*base..base.saturating_add(100)).contains(&number))
    };
    assert!(near(number(&given)?), "the name server gives {} away", number(&given)?);
    assert!(!near(ours), "ours listens on {ours}");
    Ok(())
}
