//! Every pair of modes with every data type, between programs of this library and real Python Wrapyfi
//! scripts: `test/pairs` and its twin `test/peers/pairs.py`.
//!
//! | pair | Rust to Rust | Rust to Python | Python to Rust | Rust to Rust on ROS 2 | Rust to Rust on ROS 1 | Rust to Python on ROS 1 | Python to Rust on ROS 1 |
//! | --- | --- | --- | --- | --- | --- | --- | --- |
//! | publish, listen | O I J S R | O I J S R | O I J S | O T I J S R, P | O I J S R | O I J S | O I J S |
//! | publish, receive | O I J S R | Wrapyfi has no receiver that works | O I J S | O T I J S R | O I J S R | | |
//! | transceive, reemit | O I J S R | O I J S | O I J S | O T I J S R | O I J S R | O I J S | O I J S |
//! | request, reply | O I J S | O I J S | O I J S | O I J S | O I S | O I S | O I S |
//!
//! O: native objects with tuples, sets, dates, integers beyond 64 bits and NumPy arrays. T: the same as
//! Python Wrapyfi writes them on ROS 2, in a string. I: raw images. J: images with `jpg`. S: sound. R: ROS
//! messages, of a generated type and of one by name; a Python listener gets a dict. P: the parameters of a node, which are set and watched but neither asked for nor sent on. "To" says who is in
//! the first of the two modes. Without an installation of ROS 2, Python's Wrapyfi speaks ZeroMQ and, with
//! Debian's rospy, ROS 1. Its services of ROS 1 have no `jpg`.

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Output, Process, Result, TestEnv, run};

/// Messages of each kind that must arrive.
const COUNT: usize = 3;

#[derive(Clone, Copy, PartialEq)]
enum Language {
    Rust,
    Python,
}
use Language::{Python, Rust};

/// One end of a pair.
fn start(
    env: &TestEnv,
    language: Language,
    mware: &str,
    mode: &str,
    kinds: &str,
    (way_in, way_out): (&str, &str),
) -> Result<Process> {
    let args = format!("--mode {mode} --kinds {kinds} --way-in {way_in} --way-out {way_out}");
    let process = match language {
        Rust => env.example("pairs", &format!("{args} --mware {mware}")),
        Python => env.peer("pairs.py", &format!("{args} --mware {mware}")),
    };
    Ok(process?.pillar())
}

/// Facts about the messages of one kind that a peer sent or received.
fn told(output: &Output, kind: &str, what: &str) -> Vec<Value> {
    let messages = output.events("message").into_iter().filter(|one| one["kind"] == kind);
    messages.map(|one| one[what].clone()).filter(|facts| !facts.is_null()).collect()
}

/// One message is the other: the same digest, or for a JPEG nearly the same colours.
fn are_equal(one: &Value, other: &Value) -> bool {
    let (Some(means), Some(others)) = (one["means"].as_array(), other["means"].as_array()) else {
        return one["sha256"].is_string() && one["sha256"] == other["sha256"];
    };
    let is_near = |(a, b): (&Value, &Value)| match (a.as_i64(), b.as_i64()) {
        (Some(a), Some(b)) => a.abs_diff(b) <= 2,
        _ => false,
    };
    one["shape"] == other["shape"] && means.len() == 3 && means.iter().zip(others).all(is_near)
}

/// Asserts that the first messages of a kind that `to` received were sent by `from`, in this order.
fn passes(from: &Process, to: &Process, kind: &str) -> Result {
    let received = to.wait_until(&format!("{COUNT} of kind {kind}"), |output| {
        let received = told(output, kind, "received");
        (received.len() >= COUNT).then(|| received[..COUNT].to_vec())
    })?;
    // The receiver may be ahead of the line in which the sender tells what it sent.
    from.wait_until(&format!("{kind}: {received:?} among what was sent"), |output| {
        let sent = told(output, kind, "sent");
        let mut rest = sent.iter();
        let is_there = received.iter().all(|received| rest.any(|sent| are_equal(sent, received)));
        let is_hopeless = sent.len() > 400;
        (is_there || is_hopeless).then_some(is_there)
    })?
    .then_some(())
    .ok_or_else(|| anyhow::anyhow!("{kind}: never sent in this order: {received:?}"))
}

/// Starts both ends, and has everything arrive.
fn pair(
    test: &str,
    (first, second): (&str, &str),
    (from, to): (Language, Language),
    mware: &str,
    kinds: &str,
) -> Result {
    let mut needs = vec![Need::Program, Need::Example("pairs")];
    if (from, to) != (Rust, Rust) {
        needs.push(Need::Python);
    }
    if mware == "ros" {
        needs.push(Need::Ros1);
    }
    run(test, &needs, |env| {
        let _roscore = (mware == "ros").then(|| env.roscore()).transpose()?;
        let _broker = (mware == "zeromq").then(|| env.broker()).transpose()?;
        let (there, back) = (env.topic("there"), env.topic("back"));
        // A service has one name.
        let back = if first == "request" { &there } else { &back };
        let to = start(env, to, mware, second, kinds, (&there, back))?;
        let from = start(env, from, mware, first, kinds, (back, &there))?;
        for kind in kinds.split(',') {
            passes(&from, &to, kind)?;
            if matches!(first, "transceive" | "request") {
                passes(&to, &from, kind)?;
            }
        }
        Ok(())
    })
}

macro_rules! pairs {
    ($($test:ident: $first:literal of $from:ident, $second:literal of $to:ident, $kinds:literal on $mware:literal;)*) => {
        $(#[test]
        fn $test() -> Result {
            pair(stringify!($test), ($first, $second), ($from, $to), $mware, $kinds)
        })*
    };
}

pairs! {
    publish_and_listen: "publish" of Rust, "listen" of Rust, "object,image,jpg,sound,twist,joints" on "zeromq";
    publish_and_listen_in_python:
        "publish" of Rust, "listen" of Python, "object,image,jpg,sound,twist" on "zeromq";
    publish_in_python_and_listen:
        "publish" of Python, "listen" of Rust, "object,image,jpg,sound" on "zeromq";
    publish_and_listen_on_ros2:
        "publish" of Rust, "listen" of Rust, "object,text,image,jpg,sound,twist,joints" on "ros2";

    publish_and_receive: "publish" of Rust, "receive" of Rust, "object,image,jpg,sound,twist,joints" on "zeromq";
    publish_in_python_and_receive:
        "publish" of Python, "receive" of Rust, "object,image,jpg,sound" on "zeromq";
    publish_and_receive_on_ros2:
        "publish" of Rust, "receive" of Rust, "object,text,image,jpg,sound,twist,joints" on "ros2";

    transceive_and_reemit:
        "transceive" of Rust, "reemit" of Rust, "object,image,jpg,sound,twist,joints" on "zeromq";
    transceive_and_reemit_in_python:
        "transceive" of Rust, "reemit" of Python, "object,image,jpg,sound" on "zeromq";
    transceive_in_python_and_reemit:
        "transceive" of Python, "reemit" of Rust, "object,image,jpg,sound" on "zeromq";
    transceive_and_reemit_on_ros2:
        "transceive" of Rust, "reemit" of Rust, "object,text,image,jpg,sound,twist,joints" on "ros2";

    // A ZeroMQ broker has one service, so each kind has a test of its own.
    request_and_reply_of_objects: "request" of Rust, "reply" of Rust, "object" on "zeromq";
    request_and_reply_of_images: "request" of Rust, "reply" of Rust, "image" on "zeromq";
    request_and_reply_of_jpegs: "request" of Rust, "reply" of Rust, "jpg" on "zeromq";
    request_and_reply_of_sound: "request" of Rust, "reply" of Rust, "sound" on "zeromq";
    request_and_reply_in_python_of_objects:
        "request" of Rust, "reply" of Python, "object" on "zeromq";
    request_and_reply_in_python_of_images:
        "request" of Rust, "reply" of Python, "image" on "zeromq";
    request_and_reply_in_python_of_jpegs: "request" of Rust, "reply" of Python, "jpg" on "zeromq";
    request_and_reply_in_python_of_sound: "request" of Rust, "reply" of Python, "sound" on "zeromq";
    request_in_python_and_reply_of_objects:
        "request" of Python, "reply" of Rust, "object" on "zeromq";
    request_in_python_and_reply_of_images:
        "request" of Python, "reply" of Rust, "image" on "zeromq";
    request_in_python_and_reply_of_jpegs: "request" of Python, "reply" of Rust, "jpg" on "zeromq";
    request_in_python_and_reply_of_sound: "request" of Python, "reply" of Rust, "sound" on "zeromq";
    request_and_reply_on_ros2:
        "request" of Rust, "reply" of Rust, "object,image,jpg,sound" on "ros2";

    publish_and_listen_on_ros1:
        "publish" of Rust, "listen" of Rust, "object,image,jpg,sound,twist,joints" on "ros";
    publish_and_listen_in_python_on_ros1:
        "publish" of Rust, "listen" of Python, "object,image,jpg,sound" on "ros";
    publish_in_python_and_listen_on_ros1:
        "publish" of Python, "listen" of Rust, "object,image,jpg,sound" on "ros";
    publish_and_receive_on_ros1:
        "publish" of Rust, "receive" of Rust, "object,image,jpg,sound,twist,joints" on "ros";
    transceive_and_reemit_on_ros1:
        "transceive" of Rust, "reemit" of Rust, "object,image,jpg,sound,twist,joints" on "ros";
    transceive_and_reemit_in_python_on_ros1:
        "transceive" of Rust, "reemit" of Python, "object,image,jpg,sound" on "ros";
    transceive_in_python_and_reemit_on_ros1:
        "transceive" of Python, "reemit" of Rust, "object,image,jpg,sound" on "ros";
    request_and_reply_on_ros1: "request" of Rust, "reply" of Rust, "object,image,sound" on "ros";
    request_and_reply_in_python_of_objects_on_ros1:
        "request" of Rust, "reply" of Python, "object" on "ros";
    request_and_reply_in_python_of_images_on_ros1:
        "request" of Rust, "reply" of Python, "image" on "ros";
    request_and_reply_in_python_of_sound_on_ros1:
        "request" of Rust, "reply" of Python, "sound" on "ros";
    request_in_python_and_reply_of_objects_on_ros1:
        "request" of Python, "reply" of Rust, "object" on "ros";
    request_in_python_and_reply_of_images_on_ros1:
        "request" of Python, "reply" of Rust, "image" on "ros";
    request_in_python_and_reply_of_sound_on_ros1:
        "request" of Python, "reply" of Rust, "sound" on "ros";
}

/// A publisher sets the parameters of a node that is none of ours, and a listener hears of it.
#[test]
fn parameters_are_set_and_watched() -> Result {
    const NEEDS: &[Need] = &[Need::Program, Need::Example("pairs"), Need::Python];
    run("parameters_are_set_and_watched", NEEDS, |env| {
        let node = env.topic("camera");
        let camera = env.peer("param_node.py", &format!("--node {node} {{\"gain\":0.25}}"))?;
        camera.event("ready")?;
        let ways = (node.as_str(), node.as_str());
        let listener = start(env, Rust, "ros2", "listen", "properties", ways)?;
        let all = listener.event("message")?;
        assert_eq!(all["received"]["value"], json!({"gain": 0.25}));
        let publisher = start(env, Rust, "ros2", "publish", "properties", ways)?;
        let set = publisher.event("message")?["sent"]["value"].clone();
        assert!(set["gain"].as_f64() > Some(1.0), "{set}");
        listener.wait_until("what was set", |output| {
            let heard = told(output, "properties", "received");
            heard.iter().any(|one| one["value"]["gain"].as_f64() > Some(1.0)).then_some(())
        })
    })
}

/// `--ros-args` as every node takes them: namespace, name, and a rule for one name, on both sides.
#[test]
fn a_node_is_remapped() -> Result {
    const NEEDS: &[Need] = &[Need::Program, Need::Example("pairs"), Need::Python];
    run("a_node_is_remapped", NEEDS, |env| {
        let ros_args = "-- --ros-args -r __ns:=/lab -r __node:=driver -r x/text:=seen/text";
        let talks = "--mode publish --kinds text --mware ros2 --way-in y --way-out x";
        let hears = "--mode listen --kinds text --mware ros2 --way-in x --way-out y";
        let publisher = env.example("pairs", &format!("{talks} {ros_args}"))?.pillar();
        let listener = env.example("pairs", &format!("{hears} {ros_args}"))?.pillar();
        passes(&publisher, &listener, "text")?;
        let seen = env.dds_subscriber("/lab/seen/text", "std_msgs/msg/String", "--count 1")?;
        seen.messages(1).map(drop)?;
        let mut list = env.wrapyfi(["list", "ros2"])?;
        list.exits_with(0)?;
        let said = list.stdout();
        for line in ["/lab/driver", "/lab/driver_in", "/lab/seen/text"] {
            assert!(said.contains(line), "{line} is not in {said}");
        }
        Ok(())
    })
}
