//! ZeroMQ with CURVE: sockets and certificates of pyzmq at our broker, and who is refused there.

use wrapyfi_e2e::{Need, Process, Result, Route, TestEnv, ros2, run, until_route, zeromq};

const NEEDS: &[Need] = &[Need::Program, Need::Python];

/// Has pyzmq write certificates into the test's folder.
fn certificates(env: &TestEnv, names: &str) -> Result {
    let folder = env.path("keys");
    std::fs::create_dir_all(&folder)?;
    let args = format!("keys --dir {} --names {names}", folder.display());
    let mut peer = env.peer("curve_peer.py", &args)?;
    peer.event("done")?;
    peer.exits_with(0)
}

/// A socket of pyzmq with the key `key` that takes the broker's for `server`.
fn socket(env: &TestEnv, role: &str, topic: &str, key: &str, server: &str) -> Result<Process> {
    let port = match role {
        "pub" => env.sub_port(),
        "sub" => env.pub_port(),
        "req" => env.rep_port(),
        _ => env.req_port(),
    };
    let folder = env.path("keys");
    let keys = format!("--dir {} --key {key} --server {server}", folder.display());
    let keys = if key.is_empty() { "" } else { &keys };
    env.peer("curve_peer.py", &format!("{role} --port {port} --topic {topic} --bytes 1000 {keys}"))
}

fn logged(broker: &Process, words: &[&str]) -> Result {
    broker.wait_until(&format!("{words:?} in the log"), |output| {
        let has_all = |line: &String| words.iter().all(|word| line.contains(word));
        output.err.iter().any(has_all).then_some(())
    })
}

#[test]
fn sockets_of_pyzmq_have_what_the_list_says() -> Result {
    run("sockets_of_pyzmq_have_what_the_list_says", NEEDS, |env| {
        certificates(env, "broker,robot,stranger")?;
        let (from, to) = (env.topic("in"), env.topic("out"));
        let curve = format!(
            "    curve:\n      secret_key_file: keys/broker.key_secret\n      clients:\n        - {{ key: \
             keys/robot.key, publish: [\"{from}\"], subscribe: [\"{to}\"] }}\n"
        );
        let route = Route::new(&zeromq(&from), &zeromq(&to), "NativeObject");
        let bridge = env.bridge(&env.embedded().endpoint(&curve).route(route))?;
        let listener = socket(env, "sub", &to, "robot", "broker")?;
        let publisher = socket(env, "pub", &from, "robot", "broker")?;
        let heard = listener.event("heard")?;
        assert!(heard["text"].as_str().is_some_and(|text| text.contains("seq")), "{heard}");
        for peer in [&listener, &publisher] {
            assert_eq!(peer.event("handshake")?["ok"], true);
        }
        {
            let stranger = socket(env, "sub", &to, "stranger", "broker")?;
            let refused = stranger.event("handshake")?;
            assert_eq!((&refused["ok"], &refused["code"]), (&false.into(), &400.into()));
            logged(&bridge, &["unknown_key", "is not among the clients"])?;
        }
        {
            let without = socket(env, "sub", &to, "", "")?;
            // ZMQ_PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH
            assert_eq!(without.event("handshake")?["code"], 0x1100_0002);
        }
        {
            let _wrong = socket(env, "sub", &to, "robot", "stranger")?;
            logged(&bridge, &["curve", "made for another server key"])?;
        }
        // The route listens to it: a PUB sends nothing that no program wants.
        let _wanted = socket(env, "sub", &to, "robot", "broker")?;
        let _forger = socket(env, "pub", &to, "robot", "broker")?;
        logged(&bridge, &["may not publish", &to])
    })
}

/// The program that was refused last: the state of a route names the last, with the line that would let it in.
#[test]
fn who_is_refused_is_named_with_the_line_that_lets_it_in() -> Result {
    run("who_is_refused_is_named_with_the_line_that_lets_it_in", NEEDS, |env| {
        certificates(env, "broker,robot,stranger")?;
        let topics = ["in", "out"].map(|name| env.topic(name));
        let curve = "    curve:\n      secret_key_file: keys/broker.key_secret\n      clients:\n        - { key: \
                     keys/robot.key }\n";
        let mut config = env.embedded().endpoint(curve);
        for (topic, name) in topics.iter().zip(["first", "second"]) {
            let route = Route::new(&zeromq(topic), &ros2(topic), "NativeObject");
            config = config.route(route.with("name", name));
        }
        let bridge = env.bridge(&config)?;
        until_route(&bridge, "first", |route| route.is_some())?;
        let is_told = |name: &str, who: &str, allow: &str| {
            until_route(&bridge, name, |route| {
                let told = |key: &str| route.and_then(|it| it["counters"]["refused"][key].as_str());
                told("who").is_some_and(|it| it.contains(who))
                    && told("allow").is_some_and(|it| it.contains(allow))
            })
        };
        let _stranger = socket(env, "pub", &topics[0], "stranger", "broker")?;
        let line = |topic: &str| format!(", publish: [\"{topic}\"] }}");
        is_told("first", "is not among the clients", &line(&topics[0]))?;
        let _forger = socket(env, "pub", &topics[1], "robot", "broker")?;
        // It is listed, and not to be listed twice.
        let change = |topic: &str| format!(" publish: [\"{topic}\"] in the entry");
        is_told("second", "may not publish", &change(&topics[1]))?;
        // One throttle for all would have hidden the second.
        logged(&bridge, &["unknown_key", "is not among the clients"])?;
        logged(&bridge, &["may not publish", &topics[1]])?;
        let file = env.path("bridge.yaml").display().to_string();
        let mut why = env.wrapyfi(["why", "second", "--config", &file])?;
        why.exits_with(1)?;
        let said = why.stdout();
        assert!(said.contains("may not publish") && said.contains(&change(&topics[1])), "{said}");
        assert!(said.contains(&env.path("keys/robot.key").display().to_string()), "{said}");
        env.set_variable("WRAPYFI_ZEROMQ_CURVE_SECRET_KEY_FILE", env.path("keys/robot.key_secret"));
        env.set_variable("WRAPYFI_ZEROMQ_CURVE_SERVER_KEY", env.path("keys/broker.key"));
        let forbidden = zeromq(&topics[1]);
        let mut forger =
            env.wrapyfi(["pub", &forbidden, "--type", "NativeObject", "--value", "1"])?;
        forger.exits_with(1)?;
        let said = forger.stderr();
        assert!(said.contains("does not let our CURVE key publish"), "{said}");
        assert!(said.contains(&format!("must have{}", change(&topics[1]))), "{said}");
        assert!(!said.contains("published"), "{said}");
        let mut top = env.wrapyfi(["top", "--once"])?;
        top.exits_with(0)?;
        assert!(top.stdout().contains("to let it in: "), "{}", top.stdout());
        // A broker that does not take a key is neither slow nor none.
        env.set_variable(
            "WRAPYFI_ZEROMQ_CURVE_SECRET_KEY_FILE",
            env.path("keys/stranger.key_secret"),
        );
        let mut why = env.wrapyfi(["why", &zeromq(&env.topic("other")), "--json"])?;
        why.exits_with(1)?;
        let told: serde_json::Value = serde_json::from_str(why.stdout().trim())?;
        assert_eq!(told["cause"], "middleware", "{told}");
        assert!(told["what"].to_string().contains("does not take our CURVE keys"), "{told}");
        Ok(())
    })
}

/// A key that the broker takes, and that may not listen: the program says so, and is neither silent nor idle.
#[test]
fn a_listener_is_told_that_its_key_may_not_subscribe() -> Result {
    run("a_listener_is_told_that_its_key_may_not_subscribe", NEEDS, |env| {
        certificates(env, "broker,robot")?;
        let topic = env.topic("x");
        let curve = format!(
            "    curve:\n      secret_key_file: keys/broker.key_secret\n      clients:\n        - {{ key: \
             keys/robot.key, publish: [\"{topic}\"], subscribe: [\"/other\"] }}\n"
        );
        let route = Route::new(&zeromq(&topic), &ros2(&topic), "NativeObject").with("name", "x");
        let bridge = env.bridge(&env.embedded().endpoint(&curve).route(route))?;
        let _publisher = socket(env, "pub", &topic, "robot", "broker")?;
        until_route(&bridge, "x", |route| {
            route.is_some_and(|it| it["counters"]["received"].as_u64() > Some(0))
        })?;
        let why = || -> Result<String> {
            let mut why = env.wrapyfi(["why", &zeromq(&topic), "--json"])?;
            why.exits_with(1)?;
            let told: serde_json::Value = serde_json::from_str(why.stdout().trim())?;
            Ok(told["what"].to_string())
        };
        env.set_variable("WRAPYFI_ZEROMQ_CURVE_SERVER_KEY", env.path("keys/broker.key"));
        // A key that is made anew each time cannot be listed.
        let told = why()?;
        assert!(told.contains("makes another one with each start"), "{told}");
        env.set_variable("WRAPYFI_ZEROMQ_CURVE_SECRET_KEY_FILE", env.path("keys/robot.key_secret"));
        let line = format!("must have subscribe: [\"{topic}\"] in the entry of our key");
        let echo = env.wrapyfi(["echo", &zeromq(&topic), "--type", "NativeObject"])?;
        logged(&echo, &["does not let our CURVE key listen", &line])?;
        let told = why()?;
        assert!(told.contains("does not let our CURVE key listen"), "{told}");
        // A fault of the file is none of the environment, and the reverse.
        let twice = "        - { key: keys/robot.key }\n".repeat(2);
        let twice = format!(
            "    curve:\n      secret_key_file: keys/broker.key_secret\n      clients:\n{twice}"
        );
        let route = Route::new(&zeromq(&topic), &ros2(&topic), "NativeObject");
        let twice = env.write("twice.yaml", env.embedded().endpoint(&twice).route(route).yaml())?;
        let mut check = env.wrapyfi(["check", &twice.display().to_string()])?;
        check.exits_with(2)?;
        let said = check.stderr();
        assert!(said.contains("twice.yaml:") && said.contains("is listed twice"), "{said}");
        assert!(!said.contains("WRAPYFI_"), "{said}");
        env.set_variable("WRAPYFI_ZEROMQ_CURVE_SERVER_KEY", env.path("keys/none.key"));
        let mut check = env.wrapyfi(["check", &env.path("bridge.yaml").display().to_string()])?;
        check.exits_with(2)?;
        let said = check.stderr();
        // No line of the file has it.
        assert!(said.contains("bridge.yaml: WRAPYFI_ZEROMQ_CURVE_SERVER_KEY: "), "{said}");
        // The user is not sent to the broker for what is wrong here, nor to a bridge that would not start.
        let told = why()?;
        assert!(told.contains("WRAPYFI_ZEROMQ_CURVE_SERVER_KEY: "), "{told}");
        let route = Route::new(&zeromq(&topic), &ros2(&topic), "NativeObject");
        let bare = env.write("bare.yaml", env.embedded().route(route).yaml())?;
        let mut check = env.wrapyfi(["check", &bare.display().to_string()])?;
        check.exits_with(2)?;
        let said = check.stderr();
        assert!(said.contains("WRAPYFI_ZEROMQ_CURVE_SERVER_KEY: "), "{said}");
        drop(bridge);
        let told = why()?;
        assert!(told.contains("WRAPYFI_ZEROMQ_CURVE_SERVER_KEY: "), "{told}");
        env.set_variable("WRAPYFI_ZEROMQ_CURVE_SERVER_KEY", env.path("keys/broker.key"));
        env.set_variable("WRAPYFI_ZEROMQ_CURVE_SECRET_KEY_FILE", env.path("keys/none.key"));
        for command in ["broker", "demo"] {
            let mut command = env.wrapyfi([command])?;
            command.exits_with(2)?;
            let said = command.stderr();
            assert!(said.contains("WRAPYFI_ZEROMQ_CURVE_SECRET_KEY_FILE: "), "{said}");
        }
        Ok(())
    })
}

#[test]
fn programs_take_keys_from_the_environment() -> Result {
    run("programs_take_keys_from_the_environment", NEEDS, |env| {
        certificates(env, "broker,robot")?;
        let key = |name: &str| env.path("keys").join(name);
        env.set_variable("WRAPYFI_ZEROMQ_CURVE_SECRET_KEY_FILE", key("broker.key_secret"));
        let broker = env.broker()?;
        logged(&broker, &["every client that knows the public key of this broker"])?;
        let topic = env.topic("x");
        let _publisher = socket(env, "pub", &topic, "robot", "broker")?;
        env.set_variable("WRAPYFI_ZEROMQ_CURVE_SECRET_KEY_FILE", key("robot.key_secret"));
        env.set_variable("WRAPYFI_ZEROMQ_CURVE_SERVER_KEY", key("broker.key"));
        let endpoint = zeromq(&topic);
        let mut echo =
            env.wrapyfi(["echo", &endpoint, "--type", "NativeObject", "--count", "2", "--json"])?;
        assert_eq!(echo.objects(2)?.len(), 2);
        echo.exits_with(0)?;
        let said = zeromq(&env.topic("said"));
        let mut hears =
            env.wrapyfi(["echo", &said, "--type", "NativeObject", "--count", "1", "--json"])?;
        let _speaks = env.wrapyfi(["pub", &said, "--type", "NativeObject", "--value", "7"])?;
        assert_eq!(hears.objects(1)?[0]["value"], 7);
        hears.exits_with(0)?;
        let _server = socket(env, "rep", "x", "robot", "broker")?;
        let client = socket(env, "req", "x", "robot", "broker")?;
        assert_eq!(client.event("heard")?["text"], "[42]");
        Ok(())
    })
}

/// The key of the file may be that of the environment: then the bridge is the broker that clients are told of.
#[test]
fn a_bridge_is_the_broker_unless_clients_are_told_another_key() -> Result {
    run("a_bridge_is_the_broker_unless_clients_are_told_another_key", NEEDS, |env| {
        certificates(env, "broker,robot")?;
        let topic = env.topic("x");
        let config =
            env.embedded().endpoint("    curve: { secret_key_file: keys/broker.key_secret }\n");
        let config = config.route(Route::new(&zeromq(&topic), &ros2(&topic), "NativeObject"));
        let yaml = config.yaml().replace("broker: embedded", "broker: null");
        let file = env.write("bridge.yaml", yaml)?.display().to_string();
        let is_logged = |words: &[&str]| {
            let bridge = env.wrapyfi(["bridge", "--config", &file])?;
            logged(&bridge, words)
        };
        env.set_variable("WRAPYFI_ZEROMQ_CURVE_SERVER_KEY", env.path("keys/broker.key"));
        is_logged(&["ZeroMQ broker runs", "public_key"])?;
        env.set_variable("WRAPYFI_ZEROMQ_CURVE_SERVER_KEY", env.path("keys/robot.key"));
        is_logged(&["no ZeroMQ broker is started here", "WRAPYFI_ZEROMQ_CURVE_SERVER_KEY"])?;
        env.set_variable("WRAPYFI_ZEROMQ_CURVE_SERVER_KEY", env.path("keys/broker.key"));
        // For scripts, in a shell that the bridge may share with them.
        env.set_variable("WRAPYFI_ZEROMQ_START_PROXY_BROKER", "False");
        is_logged(&["ZeroMQ broker runs", "public_key"])
    })
}

#[test]
fn a_broker_takes_the_clients_of_its_arguments() -> Result {
    run("a_broker_takes_the_clients_of_its_arguments", NEEDS, |env| {
        certificates(env, "broker,robot,stranger")?;
        let (pub_port, sub_port) = (env.pub_port().to_string(), env.sub_port().to_string());
        let (own, robot) = (env.path("keys/broker.key_secret"), env.path("keys/robot.key"));
        let arguments = [
            "broker",
            "--pub-port",
            &pub_port,
            "--sub-port",
            &sub_port,
            "--curve-secret-key-file",
            &own.display().to_string(),
            "--curve-client",
            &robot.display().to_string(),
        ];
        let _broker = env.wrapyfi(arguments)?.pillar();
        let topic = env.topic("x");
        let listener = socket(env, "sub", &topic, "robot", "broker")?;
        let _publisher = socket(env, "pub", &topic, "robot", "broker")?;
        listener.event("heard")?;
        let stranger = socket(env, "pub", &topic, "stranger", "broker")?;
        assert_eq!(stranger.event("handshake")?["code"], 400);
        // Without keys, a program is told which it needs.
        let endpoint = zeromq(&topic);
        let mut without =
            env.wrapyfi(["pub", &endpoint, "--type", "NativeObject", "--value", "1"])?;
        assert_ne!(without.exit_code()?, 0);
        let said = without.stderr();
        assert!(said.contains("WRAPYFI_ZEROMQ_CURVE_SERVER_KEY"), "{said}");
        assert!(!said.contains("choose other ports"), "{said}");
        Ok(())
    })
}

#[test]
fn a_secret_that_others_read_is_refused_with_its_remedy() -> Result {
    run("a_secret_that_others_read_is_refused_with_its_remedy", &[Need::Program], |env| {
        use std::os::unix::fs::PermissionsExt as _;
        let file = env.write("secret", "JTKVSB%%)wK0E.X)V>+}o?pNmC{O&4W4b!Ni{Lh6\n")?;
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o644))?;
        let topic = env.topic("x");
        let config = env.embedded().endpoint("    curve: { secret_key_file: secret }\n");
        let config = config.route(Route::new(&zeromq(&topic), &ros2(&topic), "Text"));
        let config = env.write("keys.yaml", config.yaml())?.display().to_string();
        let mut check = env.wrapyfi(["check", &config])?;
        check.exits_with(2)?;
        let said = check.stderr();
        assert!(said.contains("chmod 600") && said.contains("keys.yaml:"), "{said}");
        env.set_variable("WRAPYFI_ZEROMQ_CURVE_SECRET_KEY_FILE", &file);
        let mut broker = env.broker_that_may_fail()?;
        broker.exits_with(2)?;
        let said = broker.stderr();
        assert!(said.contains(&format!("chmod 600 {}", file.display())), "{said}");
        Ok(())
    })
}
