//! The `wrapyfi` program and the real Wrapyfi on ZeroMQ: every type, both directions, either broker,
//! either order of start.

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Process, Result, TestEnv, run, sha256, texts};

const NEEDS: &[Need] = &[Need::Program, Need::Python];

fn echo(env: &TestEnv, topic: &str, message_type: &str, count: usize) -> Result<Process> {
    let (endpoint, count) = (format!("zeromq:{topic}"), count.to_string());
    env.wrapyfi([
        "echo",
        &endpoint,
        "--type",
        message_type,
        "--count",
        &count,
        "--timeout",
        "100",
        "--json",
    ])
}

/// Wrapyfi publishes, with its own broker; `wrapyfi echo` must find the same hashes.
fn echo_hears(test: &str, peer: &str, message_type: &str, key: &str) -> Result {
    run(test, NEEDS, |env| {
        let topic = env.topic("x");
        let publisher = env.wrapyfi_publisher(&topic, peer)?;
        let mut echo = echo(env, &topic, message_type, 3)?;
        let heard = echo.objects(3)?;
        publisher.sent_in_a_row(key, &texts(&heard, "sha256"))?;
        echo.exits_with(0)?;
        assert_eq!(heard.len(), 3);
        let sent = publisher.messages(1)?;
        for one in &heard {
            assert_eq!(one["type"].as_str(), Some(message_type), "{one}");
            if message_type == "Image" {
                let expected = sent[0]["shape"].as_array().cloned().unwrap_or_default();
                let shape = one["shape"].as_array().cloned().unwrap_or_default();
                assert!(shape.starts_with(&expected), "shape sent {expected:?}: {one}");
            }
            if message_type != "NativeObject" {
                assert!(
                    one["stamp"].as_f64().is_some_and(|s| s > 1.7e9),
                    "Wrapyfi's time stamp is kept: {one}"
                );
            }
        }
        Ok(())
    })
}

macro_rules! echo_hears {
    ($($test:ident: $peer:literal as $message_type:literal by $key:literal;)*) => {
        $(#[test]
        fn $test() -> Result {
            echo_hears(stringify!($test), $peer, $message_type, $key)
        })*
    };
}

echo_hears! {
    echo_hears_a_small_object: "--flavour small" as "NativeObject" by "sha256";
    echo_hears_tuples_sets_dates_and_arrays: "--flavour rich" as "NativeObject" by "sha256";
    echo_hears_an_array: "--flavour array" as "NativeObject" by "sha256";
    echo_hears_a_colour_image: "--type Image --flavour colour" as "Image" by "sha256";
    echo_hears_a_mono_image: "--type Image --flavour mono" as "Image" by "sha256";
    echo_hears_a_float_image: "--type Image --flavour float" as "Image" by "sha256";
    echo_hears_a_mono_float_image: "--type Image --flavour float_mono" as "Image" by "sha256";
    echo_hears_a_red_image: "--type Image --flavour red" as "Image" by "sha256";
    echo_hears_a_colour_jpeg: "--type Image --flavour jpg" as "CompressedImage" by "file_sha256";
    echo_hears_a_mono_jpeg: "--type Image --flavour jpg_mono" as "CompressedImage" by "file_sha256";
    echo_hears_mono_sound: "--type AudioChunk --flavour mono" as "AudioChunk" by "sha256";
    echo_hears_stereo_sound: "--type AudioChunk --flavour stereo" as "AudioChunk" by "sha256";
}

#[test]
fn echo_prints_the_object_itself() -> Result {
    run("echo_prints_the_object_itself", NEEDS, |env| {
        let topic = env.topic("x");
        let publisher = env.wrapyfi_publisher(&topic, "--flavour small")?;
        let heard = echo(env, &topic, "NativeObject", 1)?.objects(1)?;
        publisher.sent_in_a_row("sha256", &texts(&heard, "sha256"))?;
        let sent = publisher.messages(1)?;
        let mut expected = sent[0]["value"].clone();
        // Only these two tell the messages apart.
        expected["seq"] = heard[0]["value"]["seq"].clone();
        expected["big"] = heard[0]["value"]["big"].clone();
        assert_eq!(heard[0]["value"], expected);
        Ok(())
    })
}

#[test]
fn echo_may_start_before_any_broker() -> Result {
    run("echo_may_start_before_any_broker", NEEDS, |env| {
        let topic = env.topic("x");
        let mut echo = echo(env, &topic, "NativeObject", 2)?;
        let publisher = env.wrapyfi_publisher(&topic, "")?;
        publisher.sent_in_a_row("sha256", &texts(&echo.objects(2)?, "sha256"))?;
        echo.exits_with(0)
    })
}

/// A publisher comes back with another type: one line in five seconds says so, and what to do.
#[test]
fn echo_tells_of_another_type_now_and_then() -> Result {
    run("echo_tells_of_another_type_now_and_then", NEEDS, |env| {
        let _broker = env.broker()?;
        let topic = env.topic("x");
        let mut objects = env.wrapyfi_publisher(&topic, "--no-broker")?;
        let echo = env.wrapyfi(["echo", &format!("zeromq:{topic}"), "--json"])?;
        echo.objects(1)?;
        objects.kill()?;
        let images = env.wrapyfi_publisher(&topic, "--type Image --flavour colour --no-broker")?;
        let dropped = |line: &&String| line.contains("dropped a message");
        echo.wait_until("a line about images", |output| output.err.iter().find(dropped).cloned())?;
        images.messages(20)?;
        let said: Vec<String> = echo.stderr().lines().map(str::to_owned).collect();
        let said: Vec<&String> = said.iter().filter(dropped).collect();
        assert!((1..=3).contains(&said.len()), "{said:?}");
        for words in ["NativeObject in 2 frames", "which look like Image", "start again"] {
            assert!(said[0].contains(words), "{said:?}");
        }
        Ok(())
    })
}

#[test]
fn echo_hears_only_its_topic() -> Result {
    // ZeroMQ subscribes by prefix: `/…/x` also gets `/…/xy`.
    run("echo_hears_only_its_topic", NEEDS, |env| {
        let _broker = env.broker()?;
        let (wanted, longer) = (env.topic("x"), env.topic("xy"));
        let mut echo = echo(env, &wanted, "NativeObject", 3)?;
        let other = env.wrapyfi_publisher(&longer, "--flavour array --no-broker --no-wait")?;
        other.messages(1)?;
        let publisher = env.wrapyfi_publisher(&wanted, "--no-broker")?;
        publisher.sent_in_a_row("sha256", &texts(&echo.objects(3)?, "sha256"))?;
        echo.exits_with(0)
    })
}

/// Our broker in the place of Wrapyfi's: both ends are the real Wrapyfi, both insist on a connection.
fn our_broker_serves_wrapyfi(test: &str, listener_first: bool) -> Result {
    run(test, NEEDS, |env| {
        let topic = env.topic("x");
        let _broker = env.broker()?;
        let start_listener = || env.wrapyfi_listener(&topic, "--flavour rich --count 3");
        let start_publisher = || env.wrapyfi_publisher(&topic, "--flavour rich --no-broker");
        let (publisher, mut listener);
        if listener_first {
            listener = start_listener()?;
            listener.event("ready")?;
            publisher = start_publisher()?;
        } else {
            publisher = start_publisher()?;
            publisher.event("ready")?;
            listener = start_listener()?;
        }
        publisher.sent_in_a_row("sha256", &texts(&listener.messages(3)?, "sha256"))?;
        listener.exits_with(0)
    })
}

#[test]
fn our_broker_serves_wrapyfi_when_the_listener_is_first() -> Result {
    our_broker_serves_wrapyfi("our_broker_serves_wrapyfi_when_the_listener_is_first", true)
}

#[test]
fn our_broker_serves_wrapyfi_when_the_publisher_is_first() -> Result {
    our_broker_serves_wrapyfi("our_broker_serves_wrapyfi_when_the_publisher_is_first", false)
}

#[derive(Clone, Copy, PartialEq)]
enum Broker {
    Ours,
    Wrapyfis,
}

/// `wrapyfi pub --count 1` waits for the listener: its only message must arrive.
fn pub_reaches(test: &str, broker: Broker, listener_first: bool) -> Result {
    run(test, NEEDS, |env| {
        let topic = env.topic("x");
        // Wrapyfi's broker lives in the first publisher of a process: one that sends nothing more.
        let _broker = match broker {
            Broker::Ours => env.broker()?,
            Broker::Wrapyfis => {
                let holder = env.wrapyfi_publisher(&env.topic("holder"), "--no-wait --count 1")?;
                holder.event("done")?;
                holder
            }
        };
        let value =
            json!({"text": "hello", "list": [1, 2.5, null, true], "nested": {"a": {"b": "c"}}});
        let (endpoint, text) = (format!("zeromq:{topic}"), value.to_string());
        let start_pub = || {
            env.wrapyfi([
                "pub",
                &endpoint,
                "--type",
                "NativeObject",
                "--value",
                &text,
                "--count",
                "1",
            ])
        };
        let start_listener = || env.wrapyfi_listener(&topic, "--count 1");
        let (mut publisher, mut listener);
        if listener_first {
            listener = start_listener()?;
            listener.event("ready")?;
            publisher = start_pub()?;
        } else {
            publisher = start_pub()?;
            listener = start_listener()?;
        }
        publisher.exits_with(0)?;
        let heard = listener.messages(1)?;
        // The peer tells values only of objects with `seq`; the hash says the same of any.
        let canonical = r#"{"list":[1,2.5,null,true],"nested":{"a":{"b":"c"}},"text":"hello"}"#;
        assert_eq!(heard[0]["sha256"], sha256(canonical.as_bytes()));
        listener.exits_with(0)
    })
}

#[test]
fn pub_reaches_a_listener_that_was_first_through_our_broker() -> Result {
    pub_reaches("pub_reaches_a_listener_that_was_first_through_our_broker", Broker::Ours, true)
}

#[test]
fn pub_waits_for_a_listener_through_our_broker() -> Result {
    pub_reaches("pub_waits_for_a_listener_through_our_broker", Broker::Ours, false)
}

#[test]
fn pub_reaches_a_listener_that_was_first_through_wrapyfis_broker() -> Result {
    pub_reaches(
        "pub_reaches_a_listener_that_was_first_through_wrapyfis_broker",
        Broker::Wrapyfis,
        true,
    )
}

#[test]
fn pub_waits_for_a_listener_through_wrapyfis_broker() -> Result {
    pub_reaches("pub_waits_for_a_listener_through_wrapyfis_broker", Broker::Wrapyfis, false)
}

/// A file that another program wrote, through `wrapyfi pub`, must be what a Wrapyfi listener gets.
fn pub_sends_a_file(test: &str, file: &str, message_type: &str, peer: &str) -> Result {
    run(test, NEEDS, |env| {
        let folder = env.path("");
        let files = env
            .peer("make_files.py", &folder.display().to_string())?
            .wait_until("the files", |output| {
                (!output.events("done").is_empty()).then(|| output.events("file"))
            })?;
        let file = files.iter().find(|f| f["name"] == file).cloned().unwrap_or(Value::Null);
        let path = file["path"].as_str().unwrap_or_default().to_owned();

        let topic = env.topic("x");
        let _broker = env.broker()?;
        let mut listener = env.wrapyfi_listener(&topic, &format!("{peer} --count 2"))?;
        let endpoint = format!("zeromq:{topic}");
        let mut publisher = env.wrapyfi([
            "pub",
            &endpoint,
            "--type",
            message_type,
            "--file",
            &path,
            "--count",
            "2",
            "--rate",
            "10",
        ])?;
        publisher.exits_with(0)?;
        let expected = file["sha256"].as_str().unwrap_or_default();
        assert_eq!(texts(&listener.messages(2)?, "sha256"), [expected, expected]);
        listener.exits_with(0)
    })
}

macro_rules! pub_sends {
    ($($test:ident: $file:literal as $message_type:literal to $peer:literal;)*) => {
        $(#[test]
        fn $test() -> Result {
            pub_sends_a_file(stringify!($test), $file, $message_type, $peer)
        })*
    };
}

pub_sends! {
    pub_sends_an_array_file: "colour.npy" as "Image" to "--type Image --flavour colour";
    pub_sends_a_colour_png: "colour.png" as "Image" to "--type Image --flavour colour";
    pub_sends_a_mono_png: "mono.png" as "Image" to "--type Image --flavour mono";
    pub_sends_a_jpeg: "colour.jpg" as "CompressedImage" to "--type Image --flavour jpg";
    pub_sends_a_wav: "stereo.wav" as "AudioChunk" to "--type AudioChunk --flavour stereo";
}
