//! A bridge whose configuration changes while it runs.

use wrapyfi_e2e::{
    Config, Need, Process, Result, Route, TestEnv, ros1, ros2, run, until_route, yarp, zeromq,
};

const FILE: &str = "reload.yaml";

fn named(env: &TestEnv, name: &str) -> Route {
    let topic = env.topic(name);
    Route::new(&zeromq(&topic), &ros2(&topic), "NativeObject").with("name", name)
}

/// The text of a configuration with these routes.
fn text(env: &TestEnv, names: &[&str]) -> String {
    let begin = env.embedded();
    names.iter().fold(begin, |config, name| config.route(named(env, name))).yaml()
}

fn there(bridge: &Process, name: &str) -> Result {
    until_route(bridge, name, |route| route.is_some())
}

/// The file is written anew, another takes its place, half of it is there, and it is gone.
#[test]
fn a_bridge_turns_to_its_changed_file_and_refuses_a_wrong_one() -> Result {
    run("reload_file", &[Need::Program], |env| {
        let config =
            ["stays", "goes"].iter().fold(env.embedded(), |it, name| it.route(named(env, name)));
        let bridge = env.bridge_named(FILE, &config)?;
        there(&bridge, "goes")?;
        env.write(FILE, text(env, &["stays", "comes"]))?;
        there(&bridge, "comes")?;
        until_route(&bridge, "goes", |route| route.is_none())?;
        // An editor that writes beside, and takes the name.
        let beside = env.write("beside.yaml", text(env, &["stays", "renamed"]))?;
        std::fs::rename(beside, env.path(FILE))?;
        there(&bridge, "renamed")?;
        // Half a file, and what needs a start.
        let half = format!("{}  - {{ from: 'zeromq:/hal", text(env, &["stays"]));
        env.write(FILE, half)?;
        let told = |what: &'static str| {
            bridge.wait_until(what, move |output| {
                output.err.iter().any(|line| line.contains(what)).then_some(())
            })
        };
        told("the routes stay as they are")?;
        let elsewhere =
            text(env, &["stays"]).replace("endpoints:", "endpoints:\n  ros2: { domain_id: 77 }");
        env.write(FILE, elsewhere)?;
        told("endpoints.ros2.domain_id was")?;
        told("is 77 now: start the program anew for that")?;
        let to_itself = format!("  - {{ from: '{0}', to: '{0}', type: Text }}\n", zeromq("/x"));
        env.write(FILE, text(env, &["stays"]) + &to_itself)?;
        told("to itself: it would loop")?;
        std::fs::remove_file(env.path(FILE))?;
        told("is gone: the routes stay as they are")?;
        there(&bridge, "renamed")?;
        env.write(FILE, text(env, &["stays", "last"]))?;
        there(&bridge, "last")?;
        until_route(&bridge, "renamed", |route| route.is_none())
    })
}

/// The signal has the file read though it is the same, and so often in a row that it is read meanwhile.
#[test]
fn a_signal_has_the_file_read_again() -> Result {
    run("reload_signal", &[Need::Program], |env| {
        let config = env.embedded().route(named(env, "stays"));
        let bridge = env.bridge_named(FILE, &config)?;
        there(&bridge, "stays")?;
        let told = |what: String| {
            bridge.wait_until(&what.clone(), move |output| {
                output.err.iter().any(|line| line.contains(&what)).then_some(())
            })
        };
        bridge.hang_up()?;
        told("0 added, 0 removed, 0 changed, 1 the same".to_owned())?;
        for n in 0..50 {
            let beside = env.write("beside.yaml", text(env, &["stays", &format!("x{n}")]))?;
            std::fs::rename(beside, env.path(FILE))?;
            bridge.hang_up()?;
        }
        there(&bridge, "x49")?;
        for n in 0..49 {
            until_route(&bridge, &format!("x{n}"), |route| route.is_none())?;
        }
        there(&bridge, "stays")
    })
}

/// The first route on a middleware starts it; other settings have it start anew, and the same ones in other words
/// do not.
#[test]
fn a_middleware_starts_and_starts_anew_alone() -> Result {
    run("reload_middleware", &[Need::Program], |env| {
        let stays = env.embedded().route(named(env, "stays"));
        let bridge = env.bridge_named(FILE, &stays)?;
        there(&bridge, "stays")?;
        let ends = [yarp(&env.topic("robot")), ros2(&env.topic("robot"))];
        let robot = Route::new(&ends[0], &ends[1], "NativeObject").with("name", "robot");
        let both = stays.yarp(env).route(robot).yaml();
        env.write(FILE, &both)?;
        let told = |what: &'static str| {
            bridge.wait_until(what, move |output| {
                let told = output.err.iter().filter(|line| line.contains(what)).count();
                (told > 0).then_some(told)
            })
        };
        told("yarp starts")?;
        until_route(&bridge, "robot", |route| {
            // Its port is asked for: YARP has started.
            route.is_some_and(|it| it["reason"].to_string().contains("port "))
        })?;
        let ports = |pub_port: u16, sub_port: u16| {
            both.replace(&format!("pub_port: {}", env.pub_port()), &format!("pub_port: {pub_port}"))
                .replace(&format!("sub_port: {}", env.sub_port()), &format!("sub_port: {sub_port}"))
        };
        let is_open = |port: u16| std::net::TcpStream::connect(("127.0.0.1", port)).is_ok();
        assert!(is_open(env.pub_port()) && !is_open(env.rep_port()));
        let other = ports(env.rep_port(), env.req_port());
        env.write(FILE, &other)?;
        told("zeromq starts anew")?;
        told("zeromq has started")?;
        assert!(is_open(env.rep_port()) && !is_open(env.pub_port()));
        until_route(&bridge, "stays", |route| {
            route.is_some_and(|it| !it["reason"].to_string().contains("in use"))
        })?;
        // The default, spelled out.
        env.write(FILE, other.replace("    broker:", "    send_hwm: 1000\n    broker:"))?;
        told("was read again: 0 added, 0 removed, 0 changed, 2 the same")?;
        let anew = bridge.wait_until("the log", |output| {
            Some(output.err.iter().filter(|line| line.contains("starts anew")).count())
        })?;
        // Once as it is decided, and once as the reason of its route's end.
        anyhow::ensure!(anew <= 2, "{anew} lines: {}", bridge.stderr());
        Ok(())
    })
}

/// The service tells what has changed, or why nothing has; `check --against` tells it before.
#[test]
fn a_reload_by_the_service_tells_the_difference() -> Result {
    run("reload_service", &[Need::Program], |env| {
        let config = env.embedded().route(named(env, "stays"));
        let bridge = env.bridge_named(FILE, &config)?;
        there(&bridge, "stays")?;
        let new = env.write("new.yaml", text(env, &["stays", "comes"]))?;
        let against = ["check", &new.display().to_string(), "--against"].map(str::to_owned);
        let old = env.path(FILE).display().to_string();
        let mut check = env.wrapyfi(against.into_iter().chain([old]))?;
        check.exits_with(0)?;
        let told = check.stdout();
        assert!(told.contains("+ zeromq:") && told.contains("1 added, 0 removed"), "{told}");
        std::fs::rename(new, env.path(FILE))?;
        let call = || {
            let service = ros2("/wrapyfi_bridge/reload");
            let mut call =
                env.wrapyfi(["call", &service, "--type", "std_srvs/srv/Trigger", "--json"])?;
            call.exits_with(0)?;
            Result::Ok(call.stdout())
        };
        // The file may have been read already because it is another.
        let told = call()?;
        assert!(told.contains("true") && told.contains("removed"), "{told}");
        there(&bridge, "comes")?;
        env.write(FILE, "routes: [")?;
        let told = call()?;
        assert!(told.contains("false") && told.contains("reload.yaml"), "{told}");
        there(&bridge, "comes")
    })
}

/// A route that is added or taken away by the services holds beside what the file says, also when that is read again.
#[test]
fn routes_are_added_and_removed_by_the_services() -> Result {
    run("reload_edits", &[Need::Program], |env| {
        let config =
            ["stays", "goes"].iter().fold(env.embedded(), |it, name| it.route(named(env, name)));
        let bridge = env.bridge_named(FILE, &config)?;
        there(&bridge, "goes")?;
        let call = |service: &str, kind: &str, field: &str, text: &str| {
            let service = ros2(&format!("/wrapyfi_bridge/{service}"));
            let value = serde_json::json!({ field: text }).to_string();
            let mut call =
                env.wrapyfi(["call", &service, "--type", kind, "--value", &value, "--json"])?;
            call.exits_with(0)?;
            Result::Ok(call.stdout())
        };
        let add = |text: &str| call("add_route", "wrapyfi_msgs/srv/AddRoute", "route", text);
        let remove =
            |name: &str| call("remove_route", "wrapyfi_msgs/srv/RemoveRoute", "name", name);
        let topic = env.topic("added");
        let entry =
            format!("name: added\nfrom: '{}'\nto: '{}'\ntype: Text", zeromq(&topic), ros2(&topic));
        let told = add(&entry)?;
        assert!(told.contains("true") && told.contains("1 added, 0 removed"), "{told}");
        there(&bridge, "added")?;
        // A second time it would be there twice; and what is no route is none.
        for (wrong, why) in
            [(entry.as_str(), "stands already"), ("{form: a}", "form"), ("x", "the added route")]
        {
            let told = add(wrong)?;
            assert!(told.contains("false") && told.contains(why), "{told}");
        }
        let told = remove("goes")?;
        assert!(told.contains("true") && told.contains("0 added, 1 removed"), "{told}");
        until_route(&bridge, "goes", |route| route.is_none())?;
        let told = remove("nobody")?;
        assert!(told.contains("false") && told.contains("stays, added"), "{told}");
        // The file is another: both changes hold.
        env.write(FILE, text(env, &["stays", "goes", "comes"]))?;
        there(&bridge, "comes")?;
        there(&bridge, "added")?;
        until_route(&bridge, "goes", |route| route.is_none())?;
        let told = remove("added")?;
        assert!(told.contains("0 added, 1 removed"), "{told}");
        until_route(&bridge, "added", |route| route.is_none())
    })
}

/// Settings that a middleware cannot start with leave its own routes waiting, with the reason; the rest of the plan
/// holds, and so do the others' routes. It starts once it can.
#[test]
fn a_middleware_that_cannot_start_anew_has_its_own_routes_wait() -> Result {
    run("reload_port_taken", &[Need::Program], |env| {
        let ends = [yarp(&env.topic("robot")), ros2(&env.topic("robot"))];
        let robot = Route::new(&ends[0], &ends[1], "NativeObject").with("name", "robot");
        let before = env.embedded().route(named(env, "stays")).yarp(env).route(robot);
        let bridge = env.bridge_named(FILE, &before)?;
        there(&bridge, "stays")?;
        there(&bridge, "robot")?;
        let held = std::net::TcpListener::bind(("127.0.0.1", env.rep_port()))?;
        let comes = "  - from: \"zeromq:/comes\"\n    to: \"ros2:/comes\"\n    type: Text\n    name: comes\n";
        let after = before
            .yaml()
            .replace(
                &format!("pub_port: {}", env.pub_port()),
                &format!("pub_port: {}", env.rep_port()),
            )
            .replace(
                &format!("sub_port: {}", env.sub_port()),
                &format!("sub_port: {}", env.req_port()),
            );
        env.write(FILE, after + comes)?;
        let words = format!("port {} on 127.0.0.1 is taken", env.rep_port());
        for name in ["stays", "comes"] {
            until_route(&bridge, name, |route| {
                route.is_some_and(|it| {
                    it["state"] == "waiting" && it["reason"].to_string().contains(&words)
                })
            })?;
        }
        drop(held);
        for name in ["stays", "comes"] {
            until_route(&bridge, name, |route| {
                route.is_some_and(|it| !it["reason"].to_string().contains("to start"))
            })?;
        }
        let ended = |name: &str| {
            let of_route = |line: &str| line.contains(name) && line.contains("route ended");
            bridge.stderr().lines().any(of_route)
        };
        anyhow::ensure!(ended("stays") && !ended("robot"), "{}", bridge.stderr());
        Ok(())
    })
}

/// A file that is another a thousand times a second is read once it stays the same: the last one holds, and what all
/// of them have goes on.
#[test]
fn a_file_that_never_rests_is_read_once_it_does() -> Result {
    run("reload_storm", &[Need::Program], |env| {
        let config = env.embedded().route(named(env, "stays"));
        let bridge = env.bridge_named(FILE, &config)?;
        there(&bridge, "stays")?;
        for n in 0..1000 {
            // Whole, half, none, and nothing in it.
            match n % 4 {
                0 => drop(env.write(FILE, text(env, &["stays", &format!("x{n}")]))?),
                1 => drop(env.write(FILE, "routes:\n  - { from: 'zeromq:/hal")?),
                2 => std::fs::remove_file(env.path(FILE))?,
                _ => drop(env.write(FILE, "")?),
            }
        }
        env.write(FILE, text(env, &["stays", "last"]))?;
        there(&bridge, "last")?;
        until_route(&bridge, "x996", |route| route.is_none())?;
        let ended = |line: &str| line.contains("stays") && line.contains("route ended");
        anyhow::ensure!(!bridge.stderr().lines().any(ended), "{}", bridge.stderr());
        Ok(())
    })
}

/// A server that comes back at another address: a middleware of `end` starts anew at the address of a changed file.
/// `begin` starts the server at one of two ports and gives its section of the configuration.
fn server_that_moves(
    test: &str,
    needs: &[Need],
    end: impl Fn(&str) -> String,
    begin: impl Fn(&TestEnv, u16) -> Result<(Process, Config)>,
    ports: impl Fn(&TestEnv) -> [u16; 2],
) -> Result {
    run(test, needs, |env| {
        let topic = env.topic("x");
        let route = Route::new(&ros2(&topic), &end(&topic), "Text");
        let _talker = env.dds_publisher(&topic, "std_msgs/msg/String", "--rate 20 --text {n}")?;
        let [first, second] = ports(env);
        let hears = || {
            let echo = env.wrapyfi(["echo", &end(&topic), "--type", "Text", "--json"])?;
            echo.objects(5).map(drop)
        };
        let (mut server, config) = begin(env, first)?;
        let before = config.route(route.clone());
        let bridge = env.bridge_named(FILE, &before)?;
        hears().map_err(|error| error.context(bridge.tail()))?;
        server.kill()?;
        drop(server);
        let (_server, config) = begin(env, second)?;
        let now = config.route(route).yaml();
        match now == before.yaml() {
            true => bridge.hang_up()?,
            false => drop(env.write(FILE, now)?),
        }
        hears().map_err(|error| error.context(bridge.tail()))
    })
}

#[test]
fn a_name_server_of_yarp_may_move() -> Result {
    let begin = |env: &TestEnv, port: u16| {
        env.write("yarp.conf", format!("127.0.0.1 {port} yarp\n"))?;
        let server = env.yarpserver_there()?;
        let section = format!("  yarp: {{ name_server: \"127.0.0.1:{port}\" }}\n");
        Ok((server, env.foreign().endpoint(&section)))
    };
    let ports = |env: &TestEnv| [env.yarp_port(), env.req_port()];
    let needs = &[Need::Program, Need::Python];
    server_that_moves("a_name_server_of_yarp_may_move", needs, yarp, begin, ports)
}

/// YARP's own configuration says where, and the bridge is told to read its file again.
#[test]
fn a_name_server_of_yarp_may_move_with_yarp_conf() -> Result {
    let begin = |env: &TestEnv, port: u16| {
        env.write("yarp.conf", format!("127.0.0.1 {port} yarp\n"))?;
        Ok((env.yarpserver_there()?, env.foreign()))
    };
    let ports = |env: &TestEnv| [env.yarp_port(), env.req_port()];
    let needs = &[Need::Program, Need::Python];
    server_that_moves("a_name_server_of_yarp_may_move_with_yarp_conf", needs, yarp, begin, ports)
}

#[test]
fn a_broker_of_zeromq_may_move() -> Result {
    let begin = |env: &TestEnv, port: u16| {
        let sub_port = if port == env.pub_port() { env.sub_port() } else { env.yarp_port() };
        env.set_variable("WRAPYFI_ZEROMQ_SOCKET_PUB_PORT", port.to_string());
        env.set_variable("WRAPYFI_ZEROMQ_SOCKET_SUB_PORT", sub_port.to_string());
        let broker = env.broker_at(port, sub_port)?;
        Ok((broker, Config::foreign(port, sub_port)))
    };
    let ports = |env: &TestEnv| [env.pub_port(), env.ros_port()];
    let needs = &[Need::Program, Need::Python];
    server_that_moves("a_broker_of_zeromq_may_move", needs, zeromq, begin, ports)
}

#[test]
fn a_master_of_ros_1_may_move() -> Result {
    let begin = |env: &TestEnv, port: u16| {
        let uri = format!("http://127.0.0.1:{port}");
        env.set_variable("ROS_MASTER_URI", &uri);
        let master = env.rospy(&format!("master --port {port}"), None)?;
        master.event("ready")?;
        Ok((master, env.foreign().endpoint(&format!("  ros: {{ master_uri: \"{uri}\" }}\n"))))
    };
    let ports = |env: &TestEnv| [env.ros_port(), env.req_port()];
    let needs = &[Need::Program, Need::Python, Need::Ros1];
    server_that_moves("a_master_of_ros_1_may_move", needs, ros1, begin, ports)
}
