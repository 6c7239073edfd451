//! Scripts on `wrapyfi_rs` beside scripts on Wrapyfi and beside this library's programs, both ways, on each middleware.
//!
//! | | Wrapyfi 0.5 | Rust | the peers' own tools |
//! | --- | --- | --- | --- |
//! | ZeroMQ | `python_package.rs` | here | |
//! | ROS 1 | here, on rospy | here | |
//! | ROS 2 | here, on rclpy of Kilted | here | |
//! | YARP | here, on its bindings, which are in no package | here | here, with a `yarpserver` of YARP |

use wrapyfi_e2e::{Need, Process, RealRos2, Result, TestEnv, run, texts};

use crate::real_yarp::yarps_server;

const NEEDS: &[Need] = &[Need::Program, Need::Python];

/// Messages that a publisher sends in a row arrive at a listener.
fn arrives(publisher: &Process, mut listener: Process) -> Result {
    let heard = texts(&listener.messages(3)?, "sha256");
    publisher.sent_in_a_row("sha256", &heard)?;
    listener.exits_with(0)
}

/// Both ways between this package and Wrapyfi, whose peers `theirs` starts.
fn both_ways(
    env: &TestEnv,
    mware: &str,
    whats: &[&str],
    theirs: impl Fn(&str) -> Result<Process>,
) -> Result {
    for what in whats {
        let args = |role: &str, way: &str| {
            let topic =
                env.topic(&format!("{way}_{}", what.replace([' ', '-'], "_").to_lowercase()));
            format!("{role} --mware {mware} --topic {topic} --type {what}")
        };
        let listener = theirs(&format!("{} --count 3", args("listen", "out")))?;
        arrives(&env.our_peer("wrapyfi_peer.py", &args("publish", "out"))?, listener)?;
        let listener =
            env.our_peer("wrapyfi_peer.py", &format!("{} --count 3", args("listen", "in")))?;
        arrives(&theirs(&args("publish", "in"))?, listener)?;
    }
    Ok(())
}

#[test]
fn wrapyfi_on_rospy_and_this_package_hear_each_other() -> Result {
    let needs = [NEEDS, &[Need::Ros1]].concat();
    run("wrapyfi_on_rospy_and_this_package_hear_each_other", &needs, |env| {
        let _master = env.roscore()?;
        let whats = [
            "NativeObject --flavour rich",
            "Image --flavour colour",
            "Image --flavour mono",
            "AudioChunk --flavour stereo",
        ];
        both_ways(env, "ros", &whats, |args| env.peer("wrapyfi_peer.py", args))
    })
}

#[test]
fn wrapyfi_on_rospy_and_this_package_ask_each_other() -> Result {
    let needs = [NEEDS, &[Need::Ros1]].concat();
    run("wrapyfi_on_rospy_and_this_package_ask_each_other", &needs, |env| {
        let _master = env.roscore()?;
        ask_each_other(env, "ros", |args| env.peer("wrapyfi_peer.py", args))
    })
}

/// This package asks Wrapyfi, whose peers `theirs` starts, and Wrapyfi this package.
fn ask_each_other(env: &TestEnv, mware: &str, theirs: impl Fn(&str) -> Result<Process>) -> Result {
    for (what, ours_asks) in [("rich", true), ("array", false)] {
        let service = env.topic(what);
        let common = format!("--mware {mware} --topic {service} --flavour {what}");
        let peer = |is_ours: bool, args: &str| match is_ours {
            true => env.our_peer("wrapyfi_peer.py", args),
            false => theirs(args),
        };
        let server = peer(!ours_asks, &format!("reply {common}"))?;
        let mut client = peer(ours_asks, &format!("request {common} --count 3 --number"))?;
        let answers = texts(&client.messages(3)?, "sha256");
        server.sent_in_a_row("sha256", &answers)?;
        client.exits_with(0)?;
    }
    Ok(())
}

#[test]
fn wrapyfi_on_rclpy_and_this_package_hear_each_other() -> Result {
    let needs = [NEEDS, &[Need::Kilted]].concat();
    run("wrapyfi_on_rclpy_and_this_package_hear_each_other", &needs, |env| {
        let ros = RealRos2::kilted(env)?;
        let whats =
            ["NativeObject --flavour rich", "Image --flavour colour", "Image --flavour mono"];
        both_ways(env, "ros2", &whats, |args| ros.wrapyfi_peer(args))
    })
}

#[test]
fn wrapyfi_on_yarp_and_this_package_hear_each_other() -> Result {
    let needs = [NEEDS, &[Need::Yarp, Need::YarpPython]].concat();
    run("wrapyfi_on_yarp_and_this_package_hear_each_other", &needs, |env| {
        // Ours: YARP's gives away ports that other tests have.
        let _server = env.yarpserver()?;
        let whats = [
            "NativeObject --flavour rich",
            "Image --flavour colour",
            "Image --flavour mono",
            "Image --flavour float",
        ];
        both_ways(env, "yarp", &whats, |args| env.wrapyfi_on_yarp(args))
    })
}

#[test]
fn wrapyfi_on_yarp_and_this_package_ask_each_other() -> Result {
    let needs = [NEEDS, &[Need::Yarp, Need::YarpPython]].concat();
    run("wrapyfi_on_yarp_and_this_package_ask_each_other", &needs, |env| {
        // Ours: YARP's gives away ports that other tests have.
        let _server = env.yarpserver()?;
        ask_each_other(env, "yarp", |args| env.wrapyfi_on_yarp(args))
    })
}

/// A topic of this library's program, which a script on this package hears.
fn hears_rust(test: &str, mware: &str, needs: &[Need]) -> Result {
    run(test, &[NEEDS, needs].concat(), |env| {
        let (_broker, _names) = (env.broker()?, env.yarpserver()?);
        let _master = needs.contains(&Need::Ros1).then(|| env.roscore()).transpose()?;
        let script = env.our_script(
            "import sys, wrapyfi_rs\n\
             print(next(wrapyfi_rs.echo(sys.argv[1], 'NativeObject', message_type='NativeObject'))['word'])",
            &format!("{mware}:/words"),
        )?;
        let publish = ["pub", &format!("{mware}:/words"), "--type", "NativeObject", "--rate", "20"];
        let _publisher =
            env.wrapyfi([&publish[..], &["--value", r#"{"word": "hello"}"#]].concat())?;
        script.wait_until("the word", |output| (output.out.first()? == "hello").then_some(()))
    })
}

macro_rules! hears_rust {
    ($($test:ident: $mware:literal, $needs:expr;)*) => {
        $(#[test]
        fn $test() -> Result {
            hears_rust(stringify!($test), $mware, $needs)
        })*
    };
}

hears_rust! {
    rust_is_heard_on_zeromq: "zeromq", &[];
    rust_is_heard_on_yarp: "yarp", &[];
    rust_is_heard_on_ros_1: "ros", &[Need::Ros1];
    rust_is_heard_on_ros_2: "ros2", &[];
}

/// A script that publishes to YARP's tools, or hears what they write.
const BOTTLES: &str = r#"
import sys, time
from wrapyfi_rs.connect.wrapper import MiddlewareCommunicator

class Words(MiddlewareCommunicator):
    @MiddlewareCommunicator.register("NativeObject", "yarp", "Words", "/words", should_wait=False)
    def word(self):
        return {"word": "hello"},

words = Words()
words.activate_communication("word", sys.argv[1])
while True:
    word, = words.word()
    if word is not None and sys.argv[1] == "listen":
        print(word)
    time.sleep(0.05)
"#;

#[test]
fn scripts_meet_at_a_name_server_of_yarp() -> Result {
    run("scripts_meet_at_a_name_server_of_yarp", &[NEEDS, &[Need::Yarp]].concat(), |env| {
        env.yarp_conf()?;
        let _server = yarps_server(env)?;
        let listener = env.our_script(BOTTLES, "listen")?;
        let _publisher = env.our_script(BOTTLES, "publish")?;
        listener.wait_until("the word", |output| {
            (output.out.first()? == "{'word': 'hello'}").then_some(())
        })?;
        let reader = env.yarp_tool("yarp", &["read", "/reader", "/words"])?;
        reader.wait_until("the word", |output| {
            output.out.iter().any(|line| line.contains("hello")).then_some(())
        })
    })
}

#[test]
fn wrapyfis_tests_pass_at_a_name_server_of_yarp() -> Result {
    let needs = [NEEDS, &[Need::Yarp]].concat();
    run("wrapyfis_tests_pass_at_a_name_server_of_yarp", &needs, |env| {
        env.yarp_conf()?;
        let _server = yarps_server(env)?;
        for case in ["test_wrapper.YarpTestWrapper", "test_middleware.YarpTestMiddleware"] {
            let mut tests = env.our_module("unittest", &format!("-v wrapyfi.tests.{case}"))?;
            tests.exits_with(0)?;
            assert!(!tests.stderr().contains("skipped"), "{}", tests.stderr());
        }
        Ok(())
    })
}
