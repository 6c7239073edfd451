//! Programs with registered methods and real Python Wrapyfi scripts: every data type both ways, the
//! schemes, ROS 2.

use std::time::{Duration, Instant};

use wrapyfi_e2e::{Need, Process, RealRos2, Result, TIMEOUT, TestEnv, run, texts};

use super::actions::{FIBONACCI, end, kilted};

const HELLO: &[Need] = &[Need::Program, Need::Python, Need::Example("hello_world")];
const EXCHANGE: &[Need] = &[Need::Program, Need::Python, Need::Example("exchange")];
const FORWARDING: &[Need] = &[Need::Program, Need::Python, Need::Example("forwarding")];
const ACTION: &[Need] = &[Need::Program, Need::Example("fibonacci"), Need::Kilted];
const CHANNELING: &[Need] = &[Need::Program, Need::Python, Need::Example("channeling")];

/// Waits for these lines, in this order, whatever is between.
fn says(process: &Process, lines: &[String]) -> Result {
    process.wait_until(&format!("{lines:?}"), |output| {
        // The prompt has no line end of its own.
        let said: Vec<_> =
            output.out.iter().map(|line| line.replace("Type message: ", "")).collect();
        let mut rest = said.iter();
        lines.iter().all(|line| rest.any(|said| said == line)).then_some(())
    })
}

fn results(words: &[&str]) -> Vec<String> {
    words
        .iter()
        .map(|word| format!("Method result: {{\"msg\":\"hello\",\"msg_ip\":\"{word}\"}}"))
        .collect()
}

/// Words typed in one program are returned in all others.
fn hello(test: &str, is_rust: bool, mware: &str) -> Result {
    run(test, HELLO, |env| {
        let _broker = env.broker()?;
        let mut typed = if is_rust {
            env.example("hello_world", &format!("--mode publish --mware {mware}"))?
        } else {
            env.peer("hello_world.py", "--mode publish")?
        };
        let mut rust = env.example("hello_world", &format!("--mode listen --mware {mware}"))?;
        let python = match mware {
            "zeromq" => Some(env.peer("hello_world.py", "--mode listen")?),
            _ => None,
        };
        // A publisher waits for its first listener, not for all.
        let mirrors = || [&rust].into_iter().chain(&python);
        let started = Instant::now();
        while mirrors().any(|mirror| !mirror.stdout().contains("Method result")) {
            anyhow::ensure!(
                started.elapsed() < TIMEOUT,
                "a mirror heard nothing:\n{}",
                rust.tail()
            );
            typed.tell("one")?;
            std::thread::sleep(Duration::from_millis(50));
        }
        says(&typed, &results(&["one"]))?;
        typed.tell("two words")?;
        for mirror in [&typed, &rust].into_iter().chain(&python) {
            says(mirror, &results(&["two words"]))?;
        }
        if !is_rust {
            // A publisher in Python that ends takes along what it has not sent yet.
            return Ok(());
        }
        typed.close_stdin();
        for mirror in [&typed, &rust].into_iter().chain(&python) {
            says(mirror, &results(&["exit"]))?;
        }
        rust.exits_with(0)
    })
}

#[test]
fn what_is_typed_in_rust_is_returned_everywhere() -> Result {
    hello("what_is_typed_in_rust_is_returned_everywhere", true, "zeromq")
}

#[test]
fn what_is_typed_in_python_is_returned_everywhere() -> Result {
    hello("what_is_typed_in_python_is_returned_everywhere", false, "zeromq")
}

#[test]
fn what_is_typed_is_returned_over_ros2() -> Result {
    hello("what_is_typed_is_returned_over_ros2", true, "ros2")
}

#[test]
fn a_publisher_brings_its_own_broker() -> Result {
    run("a_publisher_brings_its_own_broker", HELLO, |env| {
        let listener = env.peer("hello_world.py", "--mode listen")?;
        let mut typed = env.example("hello_world", "--mode publish")?;
        typed.tell("one")?;
        says(&listener, &results(&["one"]))
    })
}

/// Words typed in the server are the reply to each request.
fn asked(
    test: &str,
    mware: &str,
    start: fn(&TestEnv, &str, &str) -> Result<[Process; 2]>,
) -> Result {
    run(test, HELLO, |env| {
        let _broker = env.broker()?;
        let [mut server, mut client] = start(env, "--mode reply", mware)?;
        for word in ["one", "two words", "exit"] {
            server.tell(word)?;
        }
        for mirror in [&server, &client] {
            says(mirror, &results(&["one", "two words", "exit"]))?;
        }
        client.exits_with(0)
    })
}

#[test]
fn rust_asks_rust() -> Result {
    asked("rust_asks_rust", "zeromq", |env, reply, _| {
        let server = env.example("hello_world", reply)?;
        Ok([server, env.example("hello_world", "--mode request")?])
    })
}

#[test]
fn rust_asks_rust_over_ros2() -> Result {
    asked("rust_asks_rust_over_ros2", "ros2", |env, reply, mware| {
        let server = env.example("hello_world", &format!("{reply} --mware {mware}"))?;
        let client = env.example("hello_world", &format!("--mode request --mware {mware}"))?;
        Ok([server, client])
    })
}

#[test]
fn rust_asks_python() -> Result {
    asked("rust_asks_python", "zeromq", |env, reply, _| {
        let server = env.peer("hello_world.py", reply)?;
        Ok([server, env.example("hello_world", "--mode request")?])
    })
}

#[test]
fn python_asks_rust() -> Result {
    asked("python_asks_rust", "zeromq", |env, reply, _| {
        let server = env.example("hello_world", reply)?;
        Ok([server, env.peer("hello_world.py", "--mode request")?])
    })
}

/// Rust listens to a Python publisher.
fn from_python(test: &str, data_type: &str, flavour: &str, ours: &str, key: &str) -> Result {
    run(test, EXCHANGE, |env| {
        let topic = env.topic("x");
        let args = format!("--type {data_type} --flavour {flavour}");
        let publisher = env.wrapyfi_publisher(&topic, &args)?;
        let args = format!("--type {data_type} --mode listen --topic {topic} {ours}");
        let listener = env.example("exchange", &args)?;
        let heard = listener.messages(3)?;
        if data_type == "NativeObject" {
            assert!(heard.iter().all(|one| one["greeting"] == "hello"), "{heard:?}");
            assert!(heard[0]["seq"].as_i64() < heard[1]["seq"].as_i64(), "{heard:?}");
            return Ok(());
        }
        publisher.sent_in_a_row(key, &texts(&heard, "sha256"))
    })
}

/// Python listens to a Rust publisher.
fn to_python(test: &str, data_type: &str, flavour: &str) -> Result {
    run(test, EXCHANGE, |env| {
        let topic = env.topic("x");
        let _broker = env.broker()?;
        let args = format!("--type {data_type} --mode publish --topic {topic}");
        let publisher = env.example("exchange", &args)?;
        let args = format!("--type {data_type} --flavour {flavour} --count 3");
        let mut listener = env.wrapyfi_listener(&topic, &args)?;
        let heard = listener.messages(3)?;
        listener.exits_with(0)?;
        if data_type == "NativeObject" {
            for one in &heard {
                let (seq, value) = (one["seq"].clone(), &one["value"]);
                assert_eq!(value["pair"]["@tuple"], serde_json::json!([seq, "b"]), "{one}");
                let shape = value["ramp"]["@array"]["shape"][0].as_i64();
                assert_eq!(shape, seq.as_i64().map(|seq| seq + 1), "{one}");
            }
            return Ok(());
        }
        publisher.sent_in_a_row("sha256", &texts(&heard, "sha256"))
    })
}

#[test]
fn an_object_comes_from_python() -> Result {
    from_python("an_object_comes_from_python", "NativeObject", "small", "", "")
}

#[test]
fn an_image_comes_from_python() -> Result {
    from_python("an_image_comes_from_python", "Image", "colour", "", "sha256")
}

#[test]
fn a_jpeg_comes_from_python() -> Result {
    from_python("a_jpeg_comes_from_python", "Image", "jpg", "--jpg", "file_sha256")
}

/// Bytes of a JPEG file that a publisher with this quality sends, as an independent listener has them.
fn jpeg_bytes(env: &TestEnv, is_rust: bool, quality: Option<u8>) -> Result<u64> {
    let topic = env.topic(&format!("{is_rust}_{}", quality.unwrap_or_default()));
    let quality = quality.map(|quality| format!("--quality {quality}")).unwrap_or_default();
    let _publisher = if is_rust {
        let args = format!("--type Image --mode publish --topic {topic} --jpg {quality}");
        env.example("exchange", &args)?
    } else {
        let args = format!("--type Image --flavour jpg --no-broker {quality}");
        env.wrapyfi_publisher(&topic, &args)?
    };
    let endpoint = format!("zeromq:{topic}");
    let args = ["echo", &endpoint, "--type", "CompressedImage", "--count", "1", "--json"];
    let mut echo = env.wrapyfi(args.into_iter().chain(["--timeout", "100"]))?;
    let heard = echo.objects(1)?.remove(0);
    echo.exits_with(0)?;
    assert_eq!(heard["format"], "jpeg", "{heard}");
    anyhow::Context::context(heard["size"].as_u64(), "no size")
}

#[test]
fn the_quality_of_jpegs_is_followed_in_both_languages() -> Result {
    run("the_quality_of_jpegs_is_followed_in_both_languages", EXCHANGE, |env| {
        let _broker = env.broker()?;
        for is_rust in [false, true] {
            let qualities = [Some(5), Some(50), Some(80), None, Some(100)];
            let sizes = qualities.map(|quality| jpeg_bytes(env, is_rust, quality));
            let sizes = sizes.into_iter().collect::<Result<Vec<_>>>()?;
            // Without one it is 95.
            assert!(sizes.is_sorted_by(|one, next| one < next), "Rust {is_rust}: {sizes:?}");
        }
        Ok(())
    })
}

#[test]
fn sound_comes_from_python() -> Result {
    from_python("sound_comes_from_python", "AudioChunk", "mono", "", "sha256")
}

#[test]
fn an_object_goes_to_python() -> Result {
    to_python("an_object_goes_to_python", "NativeObject", "rich")
}

#[test]
fn an_image_goes_to_python() -> Result {
    to_python("an_image_goes_to_python", "Image", "colour")
}

#[test]
fn sound_goes_to_python() -> Result {
    to_python("sound_goes_to_python", "AudioChunk", "mono")
}

/// Between two Rust programs.
fn between_rust(test: &str, data_type: &str, mware: &str) -> Result {
    run(test, EXCHANGE, |env| {
        let _broker = env.broker()?;
        let topic = env.topic("x");
        let start = |mode: &str| {
            let args = format!("--type {data_type} --mode {mode} --topic {topic} --mware {mware}");
            env.example("exchange", &args)
        };
        let (listener, publisher) = (start("listen")?, start("publish")?);
        let heard = listener.messages(3)?;
        if data_type == "NativeObject" {
            for one in &heard {
                let seq = one["seq"].as_i64();
                assert_eq!(one["ramp"][0].as_i64(), seq.map(|seq| seq + 1), "{one}");
                assert_eq!(one["pair"], "tuple", "{one}");
            }
            return Ok(());
        }
        publisher.sent_in_a_row("sha256", &texts(&heard, "sha256"))
    })
}

macro_rules! between_rust {
    ($($test:ident: $data_type:literal on $mware:literal;)*) => {
        $(#[test]
        fn $test() -> Result {
            between_rust(stringify!($test), $data_type, $mware)
        })*
    };
}

between_rust! {
    objects_between_rust_programs: "NativeObject" on "zeromq";
    images_between_rust_programs: "Image" on "zeromq";
    sound_between_rust_programs: "AudioChunk" on "zeromq";
    objects_between_rust_programs_on_ros2: "NativeObject" on "ros2";
    images_between_rust_programs_on_ros2: "Image" on "ros2";
    sound_between_rust_programs_on_ros2: "AudioChunk" on "ros2";
}

#[test]
fn an_image_is_an_ordinary_one_to_ros2() -> Result {
    run("an_image_is_an_ordinary_one_to_ros2", EXCHANGE, |env| {
        let topic = env.topic("x");
        let args = format!("--type Image --mode publish --topic {topic} --mware ros2");
        let publisher = env.example("exchange", &args)?;
        let subscriber = env.dds_subscriber(&topic, "sensor_msgs/msg/Image", "--count 3")?;
        let heard = subscriber.messages(3)?;
        publisher.sent_in_a_row("sha256", &texts(&heard, "sha256"))
    })
}

/// A chain over two middlewares; `source` and `sink` are started by the test.
fn chain(test: &str, (source, sink): (&str, &str), (mware_a, mware_b): (&str, &str)) -> Result {
    run(test, FORWARDING, |env| {
        let _broker = env.broker()?;
        let start = |language: &str, role: &str| {
            if language == "python" {
                return env.peer("forwarding.py", &format!("--role {role}"));
            }
            let args = format!("--role {role} --mware-a {mware_a} --mware-b {mware_b}");
            env.example("forwarding", &args)
        };
        let (last, _middle) = (start(sink, "sink")?, start("rust", "forward")?);
        let first = start(source, "source")?;
        let arrived = last.wait_until("three messages", |output| {
            let messages = output.out.iter().filter(|line| line.starts_with("message "));
            let messages: Vec<_> = messages.take(3).cloned().collect();
            (messages.len() == 3).then_some(messages)
        })?;
        says(&first, &arrived)
    })
}

#[test]
fn a_chain_from_python_to_ros2() -> Result {
    chain("a_chain_from_python_to_ros2", ("python", "rust"), ("zeromq", "ros2"))
}

#[test]
fn a_chain_from_ros2_to_python() -> Result {
    chain("a_chain_from_ros2_to_python", ("rust", "python"), ("ros2", "zeromq"))
}

#[test]
fn a_rust_receiver_takes_the_channels_it_has() -> Result {
    run("a_rust_receiver_takes_the_channels_it_has", CHANNELING, |env| {
        let _broker = env.broker()?;
        let _publisher = env.example("channeling", "--mode publish")?;
        let all = env.example("channeling", "--mode listen")?;
        let deaf = env.example("channeling", "--mode listen --image-mware none")?;
        let shape = |value: &serde_json::Value| value["shape"].clone();
        let has_both = all.wait_until("an image and sound", |output| {
            let events = output.events("message");
            let image = events.iter().find(|event| !event["image"].is_null())?.clone();
            let sound = events.iter().find(|event| !event["sound"].is_null())?.clone();
            Some((image, sound))
        })?;
        assert_eq!(shape(&has_both.0["image"]), serde_json::json!([100, 200, 3]));
        assert_eq!(shape(&has_both.1["sound"]), serde_json::json!([8820, 1]));
        for event in deaf.messages(2)? {
            assert!(event["image"].is_null() && event["object"].is_null(), "{event}");
            assert_eq!(event["sound"]["rate"], 44_100);
        }
        let absent = "middleware yarp is not available here";
        let told = all.stderr().lines().filter(|line| line.contains(absent)).count();
        assert_eq!(told, 1, "one clear line: {}", all.stderr());
        Ok(())
    })
}

#[test]
fn a_python_receiver_takes_the_channel_it_has() -> Result {
    run("a_python_receiver_takes_the_channel_it_has", CHANNELING, |env| {
        let _broker = env.broker()?;
        let publisher = env.example("channeling", "--mode publish")?;
        let listener = env.peer("channeling.py", "--mode listen")?;
        let heard = listener.messages(2)?;
        for event in &heard {
            assert_eq!((&event["object"], &event["image"]), (&false.into(), &false.into()));
        }
        let sounds: Vec<_> = heard.iter().map(|event| event["sound"]["sha256"].clone()).collect();
        publisher.wait_until("the chunks that arrived", |output| {
            let sent: Vec<_> =
                output.events("message").iter().map(|one| one["sound"]["sha256"].clone()).collect();
            sounds.iter().all(|sound| sent.contains(sound)).then_some(())
        })
    })
}

#[test]
fn a_rust_receiver_hears_a_python_channel() -> Result {
    run("a_rust_receiver_hears_a_python_channel", CHANNELING, |env| {
        let _broker = env.broker()?;
        let listener = env.example("channeling", "--mode listen")?;
        let publisher = env.peer("channeling.py", "--mode publish")?;
        let heard = listener.messages(1)?;
        assert_eq!(heard[0]["sound"]["shape"], serde_json::json!([8820, 1]));
        publisher.event("message").map(drop)
    })
}

/// Runs the sync method of an action, then the async one, each on an action of its own; both know the type of rclpy's peers.
fn action(test: &str, body: impl Fn(&TestEnv, &RealRos2<'_>, &str, &str) -> Result) -> Result {
    run(test, ACTION, |env| {
        let ros = kilted(env)?;
        let (file, text) = FIBONACCI;
        let index = "share/ament_index/resource_index/rosidl_interfaces/test_msgs";
        let files = [(&*format!("share/{file}"), text), (index, "action/Fibonacci.action\n")];
        env.set_variable("AMENT_PREFIX_PATH", env.definitions(&files)?);
        for how in ["", "--asynchronous"] {
            let action = env.topic(if how.is_empty() { "sync" } else { "async" });
            let args = format!("--action {action} --kind test_msgs/action/Fibonacci {how}");
            body(env, &ros, &action, &args)?;
        }
        Ok(())
    })
}

#[test]
fn a_client_of_rclpy_runs_a_registered_action() -> Result {
    action("a_client_of_rclpy_runs_a_registered_action", |env, ros, action, args| {
        let server = env.example("fibonacci", &format!("--mode reply {args}"))?;
        let client = ros.rclpy_actions(&format!("send --action {action} --order 6"))?;
        let told = end(&client, 0).map_err(|error| error.context(server.tail()))?;
        assert_eq!(told["state"], "succeeded", "{told}");
        assert_eq!(told["sequence"], serde_json::json!([0, 1, 1, 2, 3, 5, 8, 13]));
        assert_eq!(client.event("feedback")?["sequence"], serde_json::json!([0, 1, 1]));
        let client =
            ros.rclpy_actions(&format!("send --action {action} --order 4000 --cancel-after 3"))?;
        let told = end(&client, 0).map_err(|error| error.context(server.tail()))?;
        assert_eq!(told["state"], "canceled", "{told}");
        assert!(told["sequence"].as_array().is_some_and(|numbers| numbers.len() >= 5), "{told}");
        assert_eq!(client.event("canceling")?["code"], 0);
        Ok(())
    })
}

#[test]
fn a_registered_action_drives_a_server_of_rclpy() -> Result {
    action("a_registered_action_drives_a_server_of_rclpy", |env, ros, action, args| {
        let server = ros.rclpy_actions(&format!("serve --action {action}"))?;
        server.event("ready")?;
        let mut client = env.example("fibonacci", &format!("--mode request --order 6 {args}"))?;
        let told = client.event("end").map_err(|error| error.context(server.tail()))?;
        assert_eq!(told["sequence"], serde_json::json!([0, 1, 1, 2, 3, 5, 8, 13]));
        assert_eq!(client.event("feedback")?["sequence"], serde_json::json!([0, 1, 1]));
        client.exits_with(0)?;
        // Its future is dropped, or its wait is ended by another thread.
        let given_up = format!("--mode request --order 4000 --cancel-after 3 {args}");
        let mut client = env.example("fibonacci", &given_up)?;
        let told = client.event("end").map_err(|error| error.context(server.tail()))?;
        assert!(told["sequence"].is_null(), "{told}");
        client.exits_with(0)?;
        server.wait_until("the goal is cancelled", |output| {
            output.events("end").iter().find(|end| end["state"] == "canceled").map(drop)
        })
    })
}
