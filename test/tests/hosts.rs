//! Two and three machines, in network namespaces that are joined: who is reached where, who may listen,
//! and what a route says that waits.

use std::io::Write as _;
use std::time::Instant;

use serde_json::Value;
use wrapyfi_e2e::{Host, Need, Process, Result, Route, TestEnv, run, texts};

const NEEDS: &[Need] = &[Need::Program, Need::Hosts];
const WITH_PYTHON: &[Need] = &[Need::Program, Need::Hosts, Need::Python];
const WITH_ROS: &[Need] = &[Need::Program, Need::Hosts, Need::Ros1];

/// Message of the ROS 1 publishers.
const HELLO: &str = "--value {\"data\":\"hello\"}";

/// Receives three messages.
fn echo(host: &Host<'_>, endpoint: &str, message_type: &str) -> Result<Process> {
    let args = ["echo", endpoint, "--type", message_type, "--count", "3", "--json"];
    host.wrapyfi(args.into_iter().chain(["--timeout", "100"]))
}

/// Publishes text until it is dropped.
fn publish(host: &Host<'_>, endpoint: &str) -> Result<Process> {
    let args = ["pub", endpoint, "--type", "NativeObject", "--value", "{\"n\": 1}", "--rate", "20"];
    host.wrapyfi(args)
}

/// Runs routes on a machine.
fn bridge(env: &TestEnv, host: &Host<'_>, yaml: &str) -> Result<Process> {
    let file = env.write("bridge.yaml", yaml)?.display().to_string();
    host.wrapyfi(["bridge", "--config", &file, "--json"])
}

/// Waits until the first route says why it waits in words that have all these.
fn waits(bridge: &Process, words: &[&str]) -> Result {
    bridge.wait_until(&format!("a route that waits for {words:?}"), |output| {
        output.objects().find(|status| {
            let reason = status["routes"][0]["reason"].as_str().unwrap_or_default();
            words.iter().all(|word| reason.contains(word))
        })
    })?;
    Ok(())
}

/// Ends with exit code 2 and says these words.
fn is_refused(process: Process, words: &[&str]) -> Result {
    ends_with(process, 2, words)
}

/// Ends with an exit code and says these words.
fn ends_with(mut process: Process, code: i32, words: &[&str]) -> Result {
    process.exits_with(code)?;
    let said = process.stderr();
    assert!(words.iter().all(|word| said.contains(word)), "{words:?} not in {said}");
    Ok(())
}

#[test]
fn three_machines_meet_at_a_zeromq_broker() -> Result {
    run("three_machines_meet_at_a_zeromq_broker", WITH_PYTHON, |env| {
        let [robot, laptop, desk] = env.hosts(["robot", "laptop", "desk"])?;
        let (pub_port, sub_port) = (env.pub_port().to_string(), env.sub_port().to_string());
        let ports = ["--pub-port", &pub_port, "--sub-port", &sub_port];
        let topic = env.topic("x");
        // A broker that is not there: the route says what is probable.
        let route = format!(
            "hosts: {{ robot: {} }}\nendpoints:\n  zeromq: {{ ip: robot, pub_port: {pub_port}, sub_port: \
             {sub_port}, broker: foreign }}\nroutes:\n  - {{ from: \"zeromq:{topic}\", to: \
             \"ros2:{topic}\", type: NativeObject }}\n",
            robot.ip()
        );
        let bridge = bridge(env, &desk, &route)?;
        waits(&bridge, &[robot.ip(), "unless WRAPYFI_ZEROMQ_SOCKET_IP is set there"])?;

        let args = ["broker", "--ip", robot.ip(), "--insecure"].into_iter().chain(ports);
        let _broker = robot.wrapyfi(args)?;
        let laptop = laptop.with("WRAPYFI_ZEROMQ_SOCKET_IP", robot.ip());
        let publisher = format!(
            "publish --topic {topic} --pub-port {pub_port} --sub-port {sub_port} --no-broker --no-wait"
        );
        let _publisher = laptop.peer("wrapyfi_peer.py", &publisher)?;
        // Connecting out needs no word, wherever the address is said.
        let listener = desk.with("WRAPYFI_ZEROMQ_SOCKET_IP", robot.ip());
        let heard = echo(&listener, &format!("zeromq:{topic}"), "NativeObject")?;
        heard.objects(3)?;
        bridge.wait_until("messages from the broker", |output| {
            output.objects().find(|status| {
                status["routes"][0]["counters"]["received"].as_u64().unwrap_or(0) > 2
            })
        })?;
        Ok(())
    })
}

#[test]
fn an_address_that_others_reach_needs_the_word_of_its_place() -> Result {
    run("an_address_that_others_reach_needs_the_word_of_its_place", NEEDS, |env| {
        let [robot, other] = env.hosts(["robot", "other"])?;
        let ip = robot.ip().to_owned();
        is_refused(robot.wrapyfi(["broker", "--ip", &ip])?, &["--insecure", &ip])?;
        is_refused(robot.wrapyfi(["yarpserver", "--ip", &ip])?, &["--insecure", &ip])?;
        let check = |name: &str, endpoints: &str| {
            let yaml = format!(
                "endpoints:\n{endpoints}routes:\n  - {{ from: \"zeromq:/a\", to: \"ros2:/a\", type: Image }}\n"
            );
            let file = env.write(name, yaml)?.display().to_string();
            robot.wrapyfi(["check", &file])
        };
        let in_file = ["insecure: true under endpoints.", &ip];
        is_refused(check("a.yaml", &format!("  zeromq: {{ ip: {ip} }}\n"))?, &in_file)?;
        is_refused(check("b.yaml", &format!("  yarp: {{ ip: {ip} }}\n"))?, &in_file)?;
        for endpoints in [
            format!("  zeromq: {{ ip: {ip}, insecure: true }}\n"),
            format!("  zeromq: {{ ip: {ip}, broker: foreign }}\n"),
            format!("  zeromq: {{ ip: {} }}\n", other.ip()),
        ] {
            check("c.yaml", &endpoints)?.exits_with(0)?;
        }
        // For an address of the file the word of a later place counts: of an argument, of a parameter.
        let yaml = format!(
            "endpoints: {{ zeromq: {{ ip: {ip} }} }}\nroutes:\n  - {{ from: \"zeromq:/a\", to: \"zeromq:/b\", type: Image }}\n"
        );
        let file = env.write("d.yaml", yaml)?.display().to_string();
        let bridge = ["bridge", "--config", &file, "--seconds", "1"];
        is_refused(robot.wrapyfi(bridge)?, &in_file)?;
        let parameter = ["--ros-args", "-p", "endpoints.zeromq.insecure:=true"];
        for word in [&["--insecure"][..], &parameter] {
            robot.wrapyfi(bridge.iter().chain(word))?.exits_with(0)?;
        }
        let robot = robot.with("WRAPYFI_ZEROMQ_SOCKET_IP", &ip);
        is_refused(robot.wrapyfi(["broker"])?, &["WRAPYFI_ZEROMQ_INSECURE=1", &ip])?;
        let robot = robot.with("WRAPYFI_ZEROMQ_INSECURE", "1");
        // The file goes before the environment: its address needs a word of its own.
        is_refused(robot.wrapyfi(bridge)?, &in_file)?;
        let broker = robot.wrapyfi(["broker"])?;
        broker.wait_until("its address", |output| {
            output.err.iter().any(|line| line.contains(&format!("broker on {ip}"))).then_some(())
        })
    })
}

#[test]
fn a_communicator_owns_the_broker_of_several_machines() -> Result {
    let needs = &[WITH_PYTHON, &[Need::Example("exchange")]].concat();
    run("a_communicator_owns_the_broker_of_several_machines", needs, |env| {
        let [robot, laptop] = env.hosts(["robot", "laptop"])?;
        let ip = robot.ip().to_owned();
        let laptop = laptop.with("WRAPYFI_ZEROMQ_SOCKET_IP", &ip);
        // The address, and the word that belongs to it: as options of the method, then as variables.
        let said = |more: &str| format!("--mode publish --topic {} {more}", env.topic("x"));
        let by_options = robot.example("exchange", &said(&format!("--socket-ip {ip}")))?;
        ends_with(by_options, 1, &[&ip, "insecure=true"])?;
        let by_options = said(&format!("--socket-ip {ip} --insecure"));
        is_heard(env, &laptop, &robot.example("exchange", &by_options)?)?;

        let robot = robot.with("WRAPYFI_ZEROMQ_SOCKET_IP", &ip);
        let by_variables = robot.example("exchange", &said(""))?;
        ends_with(by_variables, 1, &[&ip, "WRAPYFI_ZEROMQ_INSECURE=1"])?;
        let robot = robot.with("WRAPYFI_ZEROMQ_INSECURE", "1");
        is_heard(env, &laptop, &robot.example("exchange", &said(""))?)
    })
}

/// Waits until Wrapyfi and `wrapyfi echo` hear `publisher` on a machine.
fn is_heard(env: &TestEnv, host: &Host<'_>, publisher: &Process) -> Result {
    let topic = env.topic("x");
    let ours = echo(host, &format!("zeromq:{topic}"), "NativeObject")?;
    let args = format!("listen --topic {topic} --pub-port {} --count 3", env.pub_port());
    let theirs = host.peer("wrapyfi_peer.py", &args)?;
    ours.objects(3).map_err(|error| error.context(publisher.tail()))?;
    theirs.messages(3).map_err(|error| error.context(publisher.tail()))?;
    Ok(())
}

/// Asks a name server for a port.
const ASK_YARP: &str = "import socket, sys\n\
    s = socket.create_connection((sys.argv[1], int(sys.argv[2])))\n\
    s.sendall(b'NAME_SERVER query ' + sys.argv[3].encode() + b'\\n')\n\
    s.shutdown(socket.SHUT_WR)\n\
    print(s.makefile().read())\n";

/// Entry of a port at the name server, asked on the server's own machine.
fn registered(robot: &Host<'_>, port: &str, name: &str) -> Result<String> {
    let script = "ask_yarp.py";
    let mut asked =
        robot.program("/usr/bin/python3", &format!("{script} {} {port} {name}", robot.ip()))?;
    asked.exits_with(0)?;
    Ok(asked.stdout())
}

#[test]
fn yarp_ports_are_reached_from_the_machine_of_the_name_server_and_from_a_third() -> Result {
    run("yarp_ports_are_reached_from_the_machine_of_the_name_server", NEEDS, |env| {
        let [robot, laptop, desk] = env.hosts(["robot", "laptop", "desk"])?;
        let port = env.yarp_port().to_string();
        env.write("ask_yarp.py", ASK_YARP)?;
        env.write("yarp.conf", format!("{} {port} yarp\n", robot.ip()))?;
        // Its ports would be open to others: that has to be said.
        is_refused(publish(&laptop, "yarp:/cam")?, &[laptop.ip(), "WRAPYFI_YARP_INSECURE=1"])?;
        let laptop = laptop.with("WRAPYFI_YARP_INSECURE", "1");
        let desk = desk.with("WRAPYFI_YARP_INSECURE", "1");
        let route = "endpoints:\n  yarp: { insecure: true }\nroutes:\n  - { from: \"yarp:/cam\", to: \
                     \"ros2:/cam\", type: NativeObject }\n";
        let waiting = bridge(env, &desk, route)?;
        waits(&waiting, &["name server", robot.ip(), "has to run there"])?;
        drop(waiting);

        let args =
            ["yarpserver", "--ip", robot.ip(), "--port", &port, "--no-discovery", "--insecure"];
        let server = robot.wrapyfi(args)?;
        server.wait_until("the name server", |output| {
            output.err.iter().any(|line| line.contains("name server /root on")).then_some(())
        })?;
        let publisher = publish(&laptop, "yarp:/cam")?;
        let heard = echo(&desk, "yarp:/cam", "NativeObject")?.objects(3);
        heard.map_err(|error| error.context(publisher.tail()))?;
        let told = registered(&robot, &port, "/cam")?;
        assert!(told.contains(&format!("name /cam ip {} port", laptop.ip())), "{told}");
        drop(publisher);

        // YARP's programs read these from the environment.
        let renamed = laptop.with("YARP_PORT_PREFIX", "/left").with("YARP_RENAME_cam", "/eye");
        let renamed = renamed.with("YARP_IP", "10.77.");
        let publisher = publish(&renamed, "yarp:/cam")?;
        let heard = echo(&desk, "yarp:/left/eye", "NativeObject")?.objects(3);
        heard.map_err(|error| error.context(publisher.tail()))?;
        let told = registered(&robot, &port, "/left/eye")?;
        assert!(told.contains(&format!("ip {} port", renamed.ip())), "{told}");
        Ok(())
    })
}

#[test]
fn a_port_at_an_address_of_its_own_machine_is_named() -> Result {
    run("a_port_at_an_address_of_its_own_machine_is_named", NEEDS, |env| {
        let [robot, laptop, desk] = env.hosts(["robot", "laptop", "desk"])?;
        let port = env.yarp_port().to_string();
        env.write("yarp.conf", format!("{} {port} yarp\n", robot.ip()))?;
        let args =
            ["yarpserver", "--ip", robot.ip(), "--port", &port, "--no-discovery", "--insecure"];
        let _server = robot.wrapyfi(args)?;
        // They register where only their own machine reaches them.
        let laptop = laptop.with("YARP_IP", "127.0.0.1");
        let publisher = publish(&laptop, "yarp:/cam")?;
        let server = laptop.wrapyfi(["serve", "yarp:/function", "--echo"])?;
        server.wait_until("the server", |output| {
            output.err.iter().any(|line| line.contains("serving")).then_some(())
        })?;
        let desk = desk.with("WRAPYFI_YARP_INSECURE", "1");
        let route = "endpoints:\n  yarp: { insecure: true }\nroutes:\n  - { from: \"yarp:/cam\", to: \
                     \"ros2:/cam\", type: NativeObject }\n";
        let hint = "registered at an address of its own machine alone: set YARP_IP there";
        let waiting = bridge(env, &desk, route)?;
        waits(&waiting, &["port /cam", hint]).map_err(|error| error.context(publisher.tail()))?;
        let calls = ["call", "yarp:/function", "--value", "1", "--timeout", "5"];
        ends_with(desk.wrapyfi(calls)?, 3, &["port /function", hint])
    })
}

/// `wrapyfi yarpserver` on a machine, whose `yarp.conf` all machines read.
fn names(env: &TestEnv, robot: &Host<'_>) -> Result<Process> {
    let port = env.yarp_port().to_string();
    env.write("yarp.conf", format!("{} {port} yarp\n", robot.ip()))?;
    let args = ["yarpserver", "--ip", robot.ip(), "--port", &port, "--no-discovery", "--insecure"];
    let server = robot.wrapyfi(args)?;
    server.wait_until("the name server", |output| {
        output.err.iter().any(|line| line.contains("name server /root on")).then_some(())
    })?;
    Ok(server)
}

#[test]
fn the_address_that_others_are_told_is_said_on_the_command_line() -> Result {
    run("the_address_that_others_are_told_is_said_on_the_command_line", NEEDS, |env| {
        let [robot, laptop, desk] = env.hosts(["robot", "laptop", "desk"])?;
        let _names = names(env, &robot)?;
        // Goes before the variable, which leads nowhere from another machine.
        let laptop = laptop.with("YARP_IP", "127.0.0.1");
        let ip = laptop.ip().to_owned();
        let route =
            "routes:\n  - { from: \"zeromq:/cam\", to: \"yarp:/cam\", type: NativeObject }\n";
        let file = env.write("bridge.yaml", route)?.display().to_string();
        let value = ["--value", "{\"n\": 1}"];
        let commands: [&[&str]; 4] = [
            &["bridge", "--config", &file],
            &["serve", "yarp:/x", "--echo"],
            &["echo", "yarp:/x", "--type", "Image"],
            &["pub", "yarp:/cam", "--type", "NativeObject", "--rate", "20", value[0], value[1]],
        ];
        for command in commands {
            let said = [command, &["--ip", &ip]].concat();
            is_refused(laptop.wrapyfi(said)?, &[&ip, "give --insecure"])?;
        }
        let own = ["--ip", &ip, "--insecure"];
        let publisher = laptop.wrapyfi([commands[3], &own].concat())?;
        let heard = desk.wrapyfi([
            "echo",
            "yarp:/cam",
            "--type",
            "NativeObject",
            "--count",
            "3",
            "--json",
            "--insecure",
        ])?;
        heard.objects(3).map_err(|error| error.context(publisher.tail()))?;
        let port = env.yarp_port().to_string();
        env.write("ask_yarp.py", ASK_YARP)?;
        let told = registered(&robot, &port, "/cam")?;
        assert!(told.contains(&format!("name /cam ip {ip} port")), "{told}");
        Ok(())
    })
}

#[test]
fn what_others_do_not_connect_to_needs_no_word() -> Result {
    run("what_others_do_not_connect_to_needs_no_word", NEEDS, |env| {
        let [robot, laptop] = env.hosts(["robot", "laptop"])?;
        let _names = names(env, &robot)?;
        let server = robot.wrapyfi(["serve", "yarp:/function", "--echo", "--insecure"])?;
        let mut call =
            laptop.wrapyfi(["call", "yarp:/function", "--value", "\"x\"", "--timeout", "60"])?;
        call.exits_with(0).map_err(|error| error.context(server.tail()))?;
        assert_eq!(call.stdout().trim(), "\"x\"");
        let mut list = laptop.wrapyfi(["list", "yarp"])?;
        list.exits_with(0)?;
        assert!(list.stdout().contains("/function"), "{}", list.tail());
        // A variable that says an address is no port either.
        let ip = laptop.ip().to_owned();
        let named = laptop.with("YARP_IP", &ip);
        named.wrapyfi(["list", "yarp"])?.exits_with(0)?;
        is_refused(named.wrapyfi(["echo", "yarp:/x"])?, &["WRAPYFI_YARP_INSECURE=1"])
    })
}

#[test]
fn a_name_server_behind_a_dead_link_is_what_is_waited_for() -> Result {
    run("a_name_server_behind_a_dead_link_is_what_is_waited_for", NEEDS, |env| {
        let [robot, laptop] = env.hosts(["robot", "laptop"])?;
        let _names = names(env, &robot)?;
        robot.plug(false)?;
        let echo = laptop.wrapyfi(["echo", "yarp:/cam", "--type", "Image", "--insecure"])?;
        let first = echo.wait_until("what it waits for", |output| {
            output.err.iter().find(|line| line.contains("waiting for")).cloned()
        })?;
        let server = format!("name server {}", robot.ip());
        assert!(first.contains(&server), "{first}");
        Ok(())
    })
}

#[test]
fn programs_of_yarp_meet_ours_between_machines() -> Result {
    let needs = &[Need::Program, Need::Hosts, Need::Yarp];
    run("programs_of_yarp_meet_ours_between_machines", needs, |env| {
        let [robot, laptop] = env.hosts(["robot", "laptop"])?;
        let port = env.yarp_port().to_string();
        let server = robot.yarp_tool("yarpserver", &["--socket", &port, "--write"])?;
        server.wait_until("its address", |output| {
            let mut lines = output.out.iter().chain(&output.err);
            lines.any(|line| line.contains(&format!("{}:{port}/", robot.ip()))).then_some(())
        })?;
        let laptop = laptop.with("WRAPYFI_YARP_INSECURE", "1");
        let publisher = publish(&laptop, "yarp:/cam")?;
        publisher.wait_until("its port", |output| {
            output.err.iter().any(|line| line.contains("a reader of /cam")).then_some(())
        })?;
        let reader = robot.yarp_tool("yarp", &["read", "/reader", "/cam"])?;
        let read = reader.wait_until("what the laptop publishes", |output| {
            output.out.iter().any(|line| line.contains("n\\\": 1")).then_some(())
        });
        read.map_err(|error| error.context(publisher.tail()))?;
        let heard = echo(&laptop, "yarp:/out", "NativeObject")?;
        let mut writer = robot.yarp_tool("yarp", &["write", "/out"])?;
        let mut lines = 0;
        while heard.stdout().lines().count() < 3 {
            lines += 1;
            assert!(lines < 1000, "{}\n{}", writer.tail(), heard.tail());
            writer.tell("hello")?;
            std::thread::sleep(std::time::Duration::from_millis(100));
        }
        Ok(())
    })
}

#[test]
fn nodes_of_ros_1_are_found_by_the_names_of_their_machines() -> Result {
    run("nodes_of_ros_1_are_found_by_the_names_of_their_machines", WITH_ROS, |env| {
        let [robot, laptop, arm] = env.hosts(["robot", "laptop", "arm"])?;
        let port = env.ros_port();
        let uri = format!("http://{}:{port}", robot.ip());
        let arm_ip = arm.ip().to_owned();
        let [robot, arm] = [(robot, "robot"), (arm, "arm")].map(|(host, name)| {
            host.with("ROS_MASTER_URI", &uri).with("ROS_IP", "").with("ROS_HOSTNAME", name)
        });
        let laptop = laptop.with("ROS_MASTER_URI", &uri).with("ROS_IP", "");

        let topic = "/far/x".to_owned();
        let endpoint = format!("ros:{topic}");
        is_refused(echo(&laptop, &endpoint, "Text")?, &[laptop.ip(), "WRAPYFI_ROS_INSECURE=1"])?;
        let laptop = laptop.with("WRAPYFI_ROS_INSECURE", "1");
        let yaml = |hosts: &str, topic: &str| {
            format!(
                "{hosts}routes:\n  - {{ from: \"ros:{topic}\", to: \"ros2:{topic}\", type: Text, lazy: \
                 true }}\n"
            )
        };
        // Also while no program listens, a route says that there is no master.
        let waiting = bridge(env, &laptop, &yaml("", &topic))?;
        waits(&waiting, &[robot.ip(), "roscore has to run there"])?;
        drop(waiting);

        let master = robot.rospy(&format!("master --port {port}"))?;
        master.event("ready")?;
        // The robot's name resolves nowhere, but its master says it.
        let publisher = robot.rospy(&format!("publish --topic {topic} {HELLO}"))?;
        let heard = echo(&laptop, &endpoint, "Text")?.objects(3);
        let heard = heard.map_err(|error| error.context(publisher.tail()))?;
        assert_eq!(heard.len(), 3);
        drop(publisher);

        // A third machine's is written in the configuration.
        let topic = "/far/y";
        let _publisher = arm.rospy(&format!("publish --topic {topic} {HELLO}"))?;
        let eager =
            |hosts: &str, topic: &str| yaml(hosts, topic).replace("lazy: true", "lazy: false");
        let lost = bridge(env, &laptop, &eager("", topic))?;
        waits(&lost, &["\"arm\"", "does not resolve", "hosts:"])?;
        drop(lost);
        let found = bridge(env, &laptop, &eager(&format!("hosts: {{ arm: {arm_ip} }}\n"), topic))?;
        found.wait_until("messages of the arm", |output| {
            output.objects().find(|status| {
                status["routes"][0]["counters"]["received"].as_u64().unwrap_or(0) > 2
            })
        })?;
        drop(found);

        // A node that announced an address of its own machine alone.
        let topic = "/far/z";
        let local = arm.with("ROS_HOSTNAME", "").with("ROS_IP", "127.0.0.1");
        let _publisher = local.rospy(&format!("publish --topic {topic} {HELLO}"))?;
        let lost = bridge(env, &laptop, &eager("", topic))?;
        waits(&lost, &["127.0.0.1", "set ROS_IP where it runs"])
    })
}

/// A robot with a master and a laptop, each announcing its own address.
fn on_ros_1(env: &TestEnv) -> Result<([Host<'_>; 2], Process)> {
    let port = env.ros_port();
    let [robot, laptop] = env.hosts(["robot", "laptop"])?;
    let uri = format!("http://{}:{port}", robot.ip());
    let hosts = [robot, laptop].map(|host| {
        let ip = host.ip().to_owned();
        let host = host.with("ROS_MASTER_URI", &uri).with("ROS_IP", &ip);
        host.with("WRAPYFI_ROS_INSECURE", "1")
    });
    let master = hosts[0].rospy(&format!("master --port {port}"))?;
    master.event("ready")?;
    Ok((hosts, master))
}

/// A publisher's machine loses its link, and nothing is closed: its silence tells, and it is heard again after.
#[test]
fn a_ros_1_publisher_behind_a_dead_link_is_missed_and_heard_again() -> Result {
    run("a_ros_1_publisher_behind_a_dead_link_is_missed_and_heard_again", WITH_ROS, |env| {
        let ([robot, laptop], _master) = on_ros_1(env)?;
        let _publisher = laptop.rospy(&format!("publish --topic /far/x {HELLO}"))?;
        let yaml =
            "routes:\n  - { from: \"ros:/far/x\", to: \"ros2:/far/x\", type: Text, lazy: false }\n";
        let bridge = bridge(env, &robot, yaml)?;
        let received = |more: u64| {
            bridge.wait_until("messages", |output| {
                let last = output.objects().next_back()?;
                last["routes"][0]["counters"]["received"].as_u64().filter(|count| *count > more)
            })
        };
        let before = received(2)?;
        laptop.plug(false)?;
        waits(&bridge, &["the connection broke"])?;
        let lost = received(before - 1)?;
        laptop.plug(true)?;
        received(lost).map(drop)
    })
}

/// A subscriber's machine loses its link while messages are on their way to it: what it acknowledges no more tells. rospy
/// holds the lost connection open and does not connect again by itself; it is told to, and has each message once.
#[test]
fn a_ros_1_subscriber_behind_a_dead_link_is_missed_and_called_back() -> Result {
    run("a_ros_1_subscriber_behind_a_dead_link_is_missed_and_called_back", WITH_ROS, |env| {
        let ([robot, laptop], _master) = on_ros_1(env)?;
        let _publisher = robot.rospy("publish --topic /near/x --value {\"data\":\"{n}\"}")?;
        let subscriber = laptop.rospy("subscribe --topic /far/x --node far_ear")?;
        let yaml = "routes:\n  - { from: \"ros:/near/x\", to: \"ros:/far/x\", type: Text }\n";
        let bridge = bridge(env, &robot, yaml)?;
        let state = |wanted: &str| {
            bridge.wait_until(wanted, |output| {
                let last = output.objects().next_back()?;
                (last["routes"][0]["state"] == wanted).then_some(())
            })
        };
        let heard = |more: usize| {
            subscriber.wait_until(&format!("{more} messages"), |output| {
                let words = |it: &Value| Some(it["value"]["data"].as_str()?.to_owned());
                let all: Vec<String> = output.objects().filter_map(|it| words(&it)).collect();
                (all.len() >= more).then_some(all)
            })
        };
        heard(3)?;
        laptop.plug(false)?;
        state("waiting")?;
        let before = heard(0)?.len();
        laptop.plug(true)?;
        let back = Instant::now();
        heard(before + 1)?;
        writeln!(std::io::stderr(), "heard again after {:?}", back.elapsed())?;
        // The master tells of all publishers, under the addresses at which they registered.
        let _other = robot.rospy("publish --topic /far/x --value {\"data\":\"other\"}")?;
        let is_other = |all: &Vec<String>| all.iter().any(|it| it == "other");
        let mut all = heard(before + 1)?;
        while !is_other(&all) {
            all = heard(all.len() + 1)?;
        }
        let numbers = |all: Vec<String>| -> Vec<u64> {
            all.iter().filter_map(|it| it.parse().ok()).collect()
        };
        let numbers = numbers(heard(all.len() + 60)?);
        assert!(numbers.is_sorted_by(|one, next| one < next), "{numbers:?}");
        Ok(())
    })
}

/// A node of ROS 2 loses its link, and is missed once its lease is over, and heard again after.
#[test]
fn a_node_of_ros_2_behind_a_dead_link_is_missed_and_heard_again() -> Result {
    run("a_node_of_ros_2_behind_a_dead_link_is_missed_and_heard_again", NEEDS, |env| {
        let hosts = env.hosts(["robot", "laptop"])?;
        let peers = hosts.iter().map(Host::ip).collect::<Vec<_>>().join(";");
        let [robot, laptop] = hosts.map(|host| {
            let host = host.with("CYCLONEDDS_URI", "").with("ROS_STATIC_PEERS", &peers);
            host.with("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
        });
        let text = ["--type", "Text", "--value", "\"hello\"", "--rate", "20"];
        let _publisher = laptop.wrapyfi(["pub", "ros2:/far/x"].into_iter().chain(text))?;
        let config = env.embedded();
        let route = Route::new("ros2:/far/x", "zeromq:/far/x", "Text").with("lazy", "false");
        let bridge = bridge(env, &robot, &config.route(route).yaml())?;
        let listener = robot.wrapyfi(["echo", "zeromq:/far/x", "--type", "Text"])?;
        let state = |wanted: &str| {
            bridge.wait_until(wanted, |output| {
                let last = output.objects().next_back()?;
                (last["routes"][0]["state"] == wanted).then_some(())
            })
        };
        state("active")?;
        laptop.plug(false)?;
        let cut = Instant::now();
        state("waiting")?;
        let missed = cut.elapsed();
        let heard = listener.wait_until("what it heard", |output| Some(output.out.len()))?;
        laptop.plug(true)?;
        let back = Instant::now();
        listener.wait_until("a message after the cable is back", |output| {
            (output.out.len() > heard).then_some(())
        })?;
        // Written directly: the test runner hides what `println!` says when a test passes.
        writeln!(std::io::stderr(), "missed after {missed:?}, back after {:?}", back.elapsed())?;
        state("active")
    })
}

/// A peer of ROS 2 by a name that begins to resolve while a program runs.
#[test]
fn a_peer_of_ros_2_is_found_once_its_name_resolves() -> Result {
    run("a_peer_of_ros_2_is_found_once_its_name_resolves", NEEDS, |env| {
        let hosts = env.hosts(["robot", "laptop"])?;
        let known = format!("127.0.0.1 localhost\n{} robot\n", hosts[0].ip());
        // Without multicast.
        let [robot, laptop] = hosts.map(|host| {
            host.with("CYCLONEDDS_URI", "").with("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        });
        let laptop = laptop.with("ROS_STATIC_PEERS", "robot");
        let text = ["--type", "Text", "--value", "\"hello\"", "--rate", "20"];
        let _publisher = robot.wrapyfi(["pub", "ros2:/far/x"].into_iter().chain(text))?;
        let mut echo = echo(&laptop, "ros2:/far/x", "Text")?;
        echo.wait_until("the name", |output| {
            output
                .err
                .iter()
                .any(|line| line.contains("\"robot\" of ROS_STATIC_PEERS"))
                .then_some(())
        })?;
        env.write("hosts_laptop", known)?;
        echo.exits_with(0)
    })
}

#[test]
fn a_middleware_that_is_not_there_makes_its_own_routes_wait() -> Result {
    let needs = &[Need::Program];
    run("a_middleware_that_is_not_there_makes_its_own_routes_wait", needs, |env| {
        // There is no yarp.conf.
        let (from, there) = (env.topic("from"), env.topic("there"));
        let yaml = format!(
            "endpoints:\n  zeromq: {{ pub_port: {}, sub_port: {} }}\nroutes:\n  - {{ from: \"yarp:{from}\", \
             to: \"ros2:{from}\", type: NativeObject }}\n  - {{ from: \"zeromq:{there}\", to: \
             \"ros2:{there}\", type: NativeObject }}\n",
            env.pub_port(),
            env.sub_port()
        );
        let file = env.write("bridge.yaml", yaml)?.display().to_string();
        let args = ["--config", &file, "--ros-args", "-p", "status_json:=true", "-p", "rate:=10"];
        let bridge = env.node(args)?;
        waits(&bridge, &["yarp to start", "yarp.conf does not exist"])?;
        let states = bridge.objects(1)?;
        let routes = states[0]["routes"].as_array().cloned().unwrap_or_default();
        assert_eq!(texts(&routes, "state").len(), 2);
        assert!(!routes[1]["reason"].to_string().contains("yarp"), "{routes:?}");
        // Now there is one, and the route goes on.
        env.yarp_conf()?;
        waits(&bridge, &["name server 127.0.0.1", "start one with `wrapyfi yarpserver`"])?;
        let port = env.yarp_port().to_string();
        let _server = env.wrapyfi(["yarpserver", "--port", &port, "--no-discovery"])?;
        waits(&bridge, &[&format!("port {from}, which no program has opened")])
    })
}

#[test]
fn the_example_runs_where_nothing_else_does() -> Result {
    run("the_example_runs_where_nothing_else_does", &[Need::Program], |env| {
        let example = wrapyfi_e2e::repository().join("config/example.yaml").display().to_string();
        let args =
            ["--config", &example, "--ros-args", "-p", "seconds:=2", "-p", "status_json:=true"];
        let mut bridge = env.node(args)?;
        bridge.exits_with(0)?;
        assert!(bridge.stdout().contains("yarp.conf does not exist"), "{}", bridge.stdout());
        Ok(())
    })
}
