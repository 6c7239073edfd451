//! Finds of `wrapyfi list`, and topics of types that are not compiled in: real nodes and real
//! Wrapyfi scripts on the other side.

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Process, Result, TestEnv, run};

const NEEDS: &[Need] = &[Need::Program, Need::Python];
const TWIST: &str = "geometry_msgs/msg/Twist";

/// A folder with the definitions of a package that is installed nowhere here.
fn definitions(env: &TestEnv) -> Result<String> {
    std::fs::create_dir_all(env.path("interfaces/geometry_msgs/msg"))?;
    let package = "interfaces/geometry_msgs/msg";
    env.write(&format!("{package}/Twist.msg"), "Vector3 linear\nVector3 angular\n")?;
    env.write(&format!("{package}/Vector3.msg"), "float64 x\nfloat64 y\nfloat64 z\n")?;
    Ok(env.path("interfaces").display().to_string())
}

/// Lists until `wanted` is satisfied: discovery takes as long as it takes.
fn list(env: &TestEnv, side: &str, wanted: impl Fn(&[Value]) -> bool) -> Result<Vec<Value>> {
    let mut last = Vec::new();
    for _ in 0..20 {
        let mut list = env.wrapyfi(["list", side, "--json", "--wait", "3"])?;
        // 3: a broker that a peer brings along has not answered yet.
        let code = list.exit_code()?;
        anyhow::ensure!(code == 0 || code == 3, "list ended with {code}\n{}", list.tail());
        last = list.wait_until("its output", |output| Some(output.objects().collect()))?;
        if wanted(&last) {
            return Ok(last);
        }
    }
    anyhow::bail!("what was wanted is not among {last:#?}")
}

fn find<'a>(found: &'a [Value], name: &str, role: &str) -> Option<&'a Value> {
    found.iter().find(|endpoint| endpoint["name"] == name && endpoint["role"] == role)
}

#[test]
fn list_shows_the_endpoints_of_foreign_nodes() -> Result {
    run("list_shows_the_endpoints_of_foreign_nodes", NEEDS, |env| {
        let (talk, hear) = (env.topic("talk"), env.topic("hear"));
        let publisher = env.dds_publisher(&talk, TWIST, "--best-effort --depth 7")?;
        publisher.event("ready")?;
        let listener = env.dds_subscriber(&hear, TWIST, "--transient-local")?;
        listener.event("ready")?;
        let found = list(env, "ros2", |found| {
            find(found, &talk, "publisher").is_some() && find(found, &hear, "listener").is_some()
        })?;
        let publisher_found = find(&found, &talk, "publisher").cloned().unwrap_or_default();
        assert_eq!(publisher_found["type"], TWIST);
        assert_eq!(publisher_found["qos"]["reliability"], "best_effort");
        assert_eq!(publisher_found["qos"]["durability"], "volatile");
        assert_eq!(publisher_found["node"], Value::Null, "it announces no node");
        // Computed by rosbags, which shares no code with us.
        let hash = publisher_found["type_hash"].as_str().unwrap_or_default();
        assert!(hash.starts_with("RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a"), "{hash}");
        let listener_found = find(&found, &hear, "listener").cloned().unwrap_or_default();
        assert_eq!(listener_found["qos"]["reliability"], "reliable");
        assert_eq!(listener_found["qos"]["durability"], "transient_local");
        let own =
            found.iter().find(|one| one["node"].as_str().is_some_and(|n| n.contains("wrapyfi")));
        assert_eq!(own, None, "it lists itself");

        // A publisher that goes is gone.
        drop(publisher);
        list(env, "ros2", |found| {
            find(found, &talk, "publisher").is_none() && find(found, &hear, "listener").is_some()
        })
        .map(drop)
    })
}

#[test]
fn list_names_the_node_that_owns_a_topic() -> Result {
    run("list_names_the_node_that_owns_a_topic", NEEDS, |env| {
        let topic = env.topic("image");
        let mut node = env.ros_node("camera_driver")?;
        let _images = node.subscribe::<wrapyfi_e2e::RosImage>(&topic, "sensor_msgs/msg/Image")?;
        let named = |found: &[Value]| {
            find(found, &topic, "listener").is_some_and(|one| one["node"] == "/camera_driver")
        };
        list(env, "ros2", named).map(drop)
    })
}

#[test]
fn list_shows_wrapyfi_scripts_through_our_broker() -> Result {
    run("list_shows_wrapyfi_scripts_through_our_broker", NEEDS, |env| {
        let _broker = env.broker()?;
        let topic = env.topic("cam");
        let listener = env.wrapyfi_listener(&topic, "--type Image --flavour red")?;
        let _publisher = env.wrapyfi_publisher(&topic, "--type Image --flavour red --no-broker")?;
        listener.messages(3)?;
        let found = list(env, "zeromq", |found| find(found, &topic, "publisher").is_some())?;
        let publisher = find(&found, &topic, "publisher").cloned().unwrap_or_default();
        assert_eq!(publisher["type"], "Image");
        assert!(publisher["traffic"]["messages"].as_u64() >= Some(3), "{publisher}");
        assert_eq!(
            find(&found, &topic, "listener").map(|one| one["count"].clone()),
            Some(json!(1))
        );
        assert_eq!(found.len(), 2, "nothing of the looking itself is listed: {found:?}");
        Ok(())
    })
}

/// A look must not make a publisher believe that a program listens.
#[test]
fn looking_is_no_listening() -> Result {
    run("looking_is_no_listening", NEEDS, |env| {
        let _broker = env.broker()?;
        let topic = format!("zeromq:{}", env.topic("once"));
        let mut publisher = env.wrapyfi([
            "pub",
            &topic,
            "--type",
            "NativeObject",
            "--value",
            "[1]",
            "--count",
            "1",
        ])?;
        publisher.wait_until("it to wait", |output| {
            output.err.iter().any(|line| line.contains("waiting for a listener")).then_some(())
        })?;
        list(env, "zeromq", <[Value]>::is_empty)?;
        let mut echo = env.wrapyfi([
            "echo",
            &topic,
            "--type",
            "NativeObject",
            "--count",
            "1",
            "--timeout",
            "100",
            "--json",
        ])?;
        assert_eq!(echo.objects(1)?[0]["value"], json!([1]), "the one message was still there");
        echo.exits_with(0)?;
        publisher.exits_with(0)
    })
}

#[test]
fn list_shows_topics_of_wrapyfis_own_broker() -> Result {
    run("list_shows_topics_of_wrapyfis_own_broker", NEEDS, |env| {
        let topic = env.topic("cam");
        let _publisher =
            env.wrapyfi_publisher(&topic, "--type Image --flavour jpg --no-wait --rate 5")?;
        let seen = |found: &[Value]| {
            find(found, &topic, "publisher").is_some_and(|one| one["type"] == "CompressedImage")
        };
        list(env, "zeromq", seen).map(drop)
    })
}

#[test]
fn a_side_that_does_not_answer_is_said() -> Result {
    run("a_side_that_does_not_answer_is_said", NEEDS, |env| {
        // Nothing would come of waiting: without --wait it ends when everybody has told.
        let mut both = env.wrapyfi(["list"])?;
        both.exits_with(0)?;
        let head =
            "ros2: 0 endpoints, on CycloneDDS inside (RMW_IMPLEMENTATION=rmw_cyclonedds_cpp)";
        assert!(both.stdout().contains(head), "{}", both.tail());
        assert!(
            both.stderr().contains("zeromq: no answer from the broker at tcp://127.0.0.1:"),
            "{}",
            both.tail()
        );
        let mut one = env.wrapyfi(["list", "zeromq", "--wait", "1"])?;
        one.exits_with(3)?;
        assert!(one.stderr().contains("zeromq: no answer from the broker at"), "{}", one.tail());
        let mut wrong = env.wrapyfi(["list", "yarpp"])?;
        wrong.exits_with(2)?;
        assert!(wrong.stderr().contains("available: zeromq, ros2"), "{}", wrong.tail());
        Ok(())
    })
}

#[test]
fn echo_finds_type_and_quality_of_service_by_itself() -> Result {
    run("echo_finds_type_and_quality_of_service_by_itself", NEEDS, |env| {
        let (topic, folder) = (env.topic("cmd_vel"), definitions(env)?);
        // Best effort: a reliable subscription would hear nothing.
        let _publisher = env.dds_publisher(&topic, TWIST, "--best-effort")?;
        let endpoint = format!("ros2:{topic}");
        let common = ["echo", &endpoint, "--definitions", &folder, "--timeout", "100"];
        let mut echo = env.wrapyfi([&common[..], &["--count", "2", "--json"]].concat())?;
        let heard = echo.objects(2)?;
        echo.exits_with(0)?;
        assert_eq!(heard[0]["type"], TWIST);
        let x = heard[0]["value"]["linear"]["x"].as_f64().unwrap_or_default();
        assert_eq!(heard[1]["value"]["linear"]["x"].as_f64(), Some(x + 1.0));
        assert_eq!(heard[0]["value"]["angular"]["z"], -1.25);
        let mut echo = env.wrapyfi([&common[..], &["--count", "1"]].concat())?;
        echo.exits_with(0)?;
        let text = echo.stdout();
        assert!(text.starts_with("linear:\n  x: ") && text.contains("\n  z: -1.25\n---"), "{text}");
        Ok(())
    })
}

#[test]
fn plain_text_of_ros_is_shown_as_it_is() -> Result {
    run("plain_text_of_ros_is_shown_as_it_is", NEEDS, |env| {
        let topic = env.topic("chatter");
        let _publisher = env.dds_publisher(&topic, "std_msgs/msg/String", "--flavour small")?;
        let endpoint = format!("ros2:{topic}");
        let mut echo = env.wrapyfi(["echo", &endpoint, "--count", "1", "--timeout", "100"])?;
        echo.exits_with(0)?;
        assert!(echo.stdout().starts_with("data: "), "{}", echo.tail());
        Ok(())
    })
}

#[test]
fn pub_sends_any_type() -> Result {
    run("pub_sends_any_type", NEEDS, |env| {
        let (topic, folder) = (env.topic("cmd_vel"), definitions(env)?);
        let listener = env.dds_subscriber(&topic, TWIST, "--count 2")?;
        let graph = env.graph()?;
        // It goes on until it is ended: the graph is to see it, which takes as long as it takes.
        let value = r#"{"linear": {"x": 1.5}}"#;
        let mut publisher = publish_for(env, &topic, TWIST, &folder, value, "1000000")?;
        for message in listener.messages(2)? {
            let zeros = json!({"x": 0.0, "y": 0.0, "z": 0.0});
            let fields = json!({"linear": {"x": 1.5, "y": 0.0, "z": 0.0}, "angular": zeros});
            assert_eq!(message["fields"], fields);
        }
        let name = format!("rt{topic}");
        let ours = graph.wait_until("our publisher", |output| {
            let mut endpoints = output.events("endpoint").into_iter();
            endpoints.rfind(|one| one["topic"] == name.as_str() && one["role"] == "writer")
        })?;
        let hash = ours["hash"].as_str().unwrap_or_default();
        assert!(hash.starts_with("RIHS01_9c45bf16fe0983d80e3cfe750d683584"), "{ours}");
        publisher.terminate()?;
        publisher.exits_with(0)
    })
}

fn publish(env: &TestEnv, topic: &str, kind: &str, folder: &str, value: &str) -> Result<Process> {
    publish_for(env, topic, kind, folder, value, "2")
}

/// Publishes so many messages.
fn publish_for(
    env: &TestEnv,
    topic: &str,
    kind: &str,
    folder: &str,
    value: &str,
    count: &str,
) -> Result<Process> {
    let endpoint = format!("ros2:{topic}");
    let what = ["pub", &endpoint, "--type", kind, "--definitions", folder, "--value", value];
    env.wrapyfi([&what[..], &["--count", count, "--rate", "10", "--timeout", "100"]].concat())
}

#[test]
fn wrong_values_and_types_are_named() -> Result {
    run("wrong_values_and_types_are_named", NEEDS, |env| {
        let (topic, folder) = (env.topic("x"), definitions(env)?);
        for (kind, value, words) in [
            (TWIST, r#"{"linear": {"q": 1}}"#, "linear.q"),
            (TWIST, r#"{"linear": {"x": "fast"}}"#, "linear.x"),
            (TWIST, "{", "--value"),
            ("demo_msgs/msg/Wrench", "{}", "demo_msgs/msg/Wrench"),
            ("geometry_msgs/Twist", "{}", "did you mean geometry_msgs/msg/Twist?"),
        ] {
            let mut refused = publish(env, &topic, kind, &folder, value)?;
            refused.exits_with(2)?;
            assert!(refused.stderr().contains(words), "{words}: {}", refused.tail());
        }
        let mut zeromq = env.wrapyfi(["echo", "zeromq:/x", "--type", "demo/msg/None"])?;
        zeromq.exits_with(2)?;
        assert!(zeromq.stderr().contains("demo/msg/None is defined nowhere"), "{}", zeromq.tail());
        // A publisher might tell its type, once there is a broker to ask.
        let mut untyped = env.wrapyfi(["echo", "zeromq:/x", "--timeout", "1"])?;
        untyped.exits_with(3)?;
        assert!(untyped.stderr().contains("still waiting for the broker"), "{}", untyped.tail());
        Ok(())
    })
}

#[test]
fn echo_says_that_it_waits_for_a_broker() -> Result {
    run("echo_says_that_it_waits_for_a_broker", &[Need::Program], |env| {
        let native = ["--type", "NativeObject"];
        let echo = ["echo", "zeromq:/x", "--count", "1", "--json"];
        let mut echoes = [env.wrapyfi([&echo, &native[..]].concat())?, env.wrapyfi(echo)?];
        let port = env.pub_port();
        let words = format!("zeromq:/x: waiting for the broker at tcp://127.0.0.1:{port}");
        for echo in &echoes {
            echo.wait_until("what it waits for", |output| {
                output.err.iter().any(|line| line.contains(&words)).then_some(())
            })?;
        }
        // It goes on when there is one.
        let _broker = env.broker()?;
        let publish = ["pub", "zeromq:/x", "--value", "1", "--rate", "20"];
        let _publisher = env.wrapyfi([&publish[..], &native].concat())?;
        for echo in &mut echoes {
            assert_eq!(echo.objects(1)?[0]["value"], 1);
            echo.exits_with(0)?;
        }
        Ok(())
    })
}

/// Wrapyfi's publishers send nothing until a program names their topic.
#[test]
fn echo_without_a_type_is_a_listener_that_publishers_wait_for() -> Result {
    run("echo_without_a_type_is_a_listener_that_publishers_wait_for", NEEDS, |env| {
        let _broker = env.broker()?;
        let topic = env.topic("shy");
        let _publisher = env.wrapyfi_publisher(&topic, "--type Image --flavour red --no-broker")?;
        let address = format!("zeromq:{topic}");
        let mut echo =
            env.wrapyfi(["echo", &address, "--count", "1", "--timeout", "100", "--json"])?;
        assert_eq!(echo.objects(1)?[0]["type"], "Image");
        echo.exits_with(0)
    })
}

/// A node built from another version of the same definition, and one of another type.
#[test]
fn who_has_another_type_is_named() -> Result {
    run("who_has_another_type_is_named", NEEDS, |env| {
        let (topic, folder) = (env.topic("cmd_vel"), definitions(env)?);
        let _listener = env.dds_subscriber(&topic, TWIST, "")?;
        let warned = |publisher: &Process, words: &[&str]| {
            publisher.wait_until("a warning", |output| {
                let said = |line: &String| words.iter().all(|word| line.contains(word));
                output.err.iter().any(said).then_some(())
            })
        };
        let other = publish(env, &topic, "geometry_msgs/msg/Vector3", &folder, "{}")?;
        warned(&other, &["has type geometry_msgs/msg/Twist", "Vector3", "do not hear each other"])?;
        drop(other);
        let old = "float64 x\nfloat64 y\n";
        env.write("interfaces/geometry_msgs/msg/Vector3.msg", old)?;
        let older = publish(env, &topic, TWIST, &folder, "{}")?;
        warned(&older, &["built from another definition", "RIHS01_9c45bf16"])
    })
}
