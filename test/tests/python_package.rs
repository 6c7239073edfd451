//! The package `wrapyfi_rs` for Python: as Wrapyfi to Wrapyfi's scripts, on both sides of each wire.

use wrapyfi_e2e::{Need, Process, Result, TestEnv, run, texts};

const NEEDS: &[Need] = &[Need::Program, Need::Python];

/// Both sides of one topic on ZeroMQ: the hashes that the one sends in a row arrive at the other.
fn both_ways(test: &str, what: &str) -> Result {
    run(test, NEEDS, |env| {
        let _broker = env.broker()?;
        let (pub_port, sub_port) = (env.pub_port(), env.sub_port());
        let publishes = |topic: &str| {
            format!(
                "publish --no-broker --topic {topic} --pub-port {pub_port} --sub-port {sub_port} {what}"
            )
        };
        let listens =
            |topic: &str| format!("listen --topic {topic} --pub-port {pub_port} --count 5 {what}");
        let arrives = |publisher: &Process, mut listener: Process| {
            let heard = listener.messages(5)?;
            publisher.sent_in_a_row("sha256", &texts(&heard, "sha256"))?;
            listener.exits_with(0)
        };
        let (to_wrapyfi, to_ours) = (env.topic("to_wrapyfi"), env.topic("to_ours"));
        let theirs = env.peer("wrapyfi_peer.py", &listens(&to_wrapyfi))?;
        arrives(&env.our_peer("wrapyfi_peer.py", &publishes(&to_wrapyfi))?, theirs)?;
        let ours = env.our_peer("wrapyfi_peer.py", &listens(&to_ours))?;
        arrives(&env.peer("wrapyfi_peer.py", &publishes(&to_ours))?, ours)
    })
}

macro_rules! both_ways {
    ($($test:ident: $what:literal;)*) => {
        $(#[test]
        fn $test() -> Result {
            both_ways(stringify!($test), $what)
        })*
    };
}

both_ways! {
    a_small_object_goes_both_ways: "--flavour small";
    tuples_sets_dates_and_arrays_go_both_ways: "--flavour rich";
    an_array_goes_both_ways: "--flavour array";
    a_colour_image_goes_both_ways: "--type Image --flavour colour";
    a_mono_image_goes_both_ways: "--type Image --flavour mono";
    a_float_image_goes_both_ways: "--type Image --flavour float";
    mono_sound_goes_both_ways: "--type AudioChunk --flavour mono";
    stereo_sound_goes_both_ways: "--type AudioChunk --flavour stereo";
}

/// Calls of a client on one package, which a server on the other answers.
fn asks(test: &str, what: &str, is_client_ours: bool) -> Result {
    run(test, NEEDS, |env| {
        let (rep_port, req_port) = (env.rep_port(), env.req_port());
        let reply =
            format!("reply --topic /unused --rep-port {rep_port} --req-port {req_port} {what}");
        let request =
            format!("request --topic /unused --rep-port {rep_port} --count 4 --number {what}");
        let (server, mut client) = match is_client_ours {
            true => {
                (env.peer("wrapyfi_peer.py", &reply)?, env.our_peer("wrapyfi_peer.py", &request)?)
            }
            false => {
                (env.our_peer("wrapyfi_peer.py", &reply)?, env.peer("wrapyfi_peer.py", &request)?)
            }
        };
        let answers = client.messages(4)?;
        server.sent_in_a_row("sha256", &texts(&answers, "sha256"))?;
        client.exits_with(0)
    })
}

macro_rules! asks {
    ($($test:ident: $what:literal, $is_client_ours:literal;)*) => {
        $(#[test]
        fn $test() -> Result {
            asks(stringify!($test), $what, $is_client_ours)
        })*
    };
}

asks! {
    wrapyfis_client_asks_for_an_object: "--flavour rich", false;
    wrapyfis_server_answers_with_an_object: "--flavour rich", true;
    wrapyfis_client_asks_for_an_image: "--type Image --flavour colour", false;
    wrapyfis_server_answers_with_an_image: "--type Image --flavour colour", true;
    wrapyfis_client_asks_for_sound: "--type AudioChunk --flavour stereo", false;
    wrapyfis_server_answers_with_sound: "--type AudioChunk --flavour stereo", true;
}

/// Runs a script to its good end; its lines are these.
fn prints(test: &str, script: &str, expected: &[&str]) -> Result {
    run(test, NEEDS, |env| {
        let _broker = env.broker()?;
        let mut script = env.our_script(script, "")?;
        script.exits_with(0)?;
        let printed = script.stdout();
        let lines: Vec<_> = printed.lines().collect();
        assert_eq!(lines, expected, "{}", script.stderr());
        Ok(())
    })
}

#[test]
fn faults_of_a_script_are_exceptions_of_their_own_class() -> Result {
    prints(
        "faults_of_a_script_are_exceptions_of_their_own_class",
        include_str!("../peers/python_faults.py"),
        &[
            "no tuple: ReturnError",
            "too many: ReturnError",
            "generator: ReturnError",
            "object: ObjectError",
            "cycle: ObjectError",
            "objects: ObjectError",
            "bytes: ObjectError",
            "strided: [0, 2, 4]",
            "big-endian: [1, 2]",
            "huge: True",
            "image of float64: ValueMismatch",
            "sound: ValueMismatch",
            "raises: ZeroDivisionError",
            "static: 5",
            "mode: ModeError",
            "name: AttributeError",
            "argument: KeyError",
            "place: IndexError",
            "list: IndexError",
            "unknown middleware: [None]",
            "time-out: WaitTimeout",
            "panic: InternalError",
            "closed: own",
            "two classes: a b",
        ],
    )
}

/// The first lines of two scripts on this package, one of which publishes and one listens, have one in common.
fn one_line_is_heard(env: &TestEnv, publishes: &str, listens: &str, typed: &str) -> Result {
    let listener = env.our_peer("listings.py", listens)?;
    let mut publisher = env.our_peer("listings.py", publishes)?;
    for _ in 0..20 {
        publisher.tell(typed)?;
    }
    listener.wait_until("a line that was published", |output| {
        let line = output.out.first()?;
        Some(line.contains(typed) || line.starts_with('['))?.then_some(())
    })
}

#[test]
fn the_papers_listing_of_mirroring_runs_as_printed() -> Result {
    run("the_papers_listing_of_mirroring_runs_as_printed", NEEDS, |env| {
        let _broker = env.broker()?;
        let _names = env.yarpserver()?;
        for mware in ["zeromq", "yarp", "ros2"] {
            let (publish, listen) =
                (format!("mirror publish {mware}"), format!("mirror listen {mware}"));
            one_line_is_heard(env, &publish, &listen, "typed here")?;
        }
        Ok(())
    })
}

#[test]
fn the_papers_listing_of_forwarding_runs_as_printed() -> Result {
    run("the_papers_listing_of_forwarding_runs_as_printed", NEEDS, |env| {
        let _broker = env.broker()?;
        let _names = env.yarpserver()?;
        for method in ["send_yarp", "send_zmq"] {
            let (publish, listen) =
                (format!("forward {method} publish"), format!("forward {method} listen"));
            one_line_is_heard(env, &publish, &listen, "message")?;
        }
        Ok(())
    })
}

#[test]
fn the_papers_listing_of_channeling_runs_as_printed() -> Result {
    let needs = [NEEDS, &[Need::Ros1]].concat();
    run("the_papers_listing_of_channeling_runs_as_printed", &needs, |env| {
        let (_broker, _names, _master) = (env.broker()?, env.yarpserver()?, env.roscore()?);
        let listener = env.our_peer("listings.py", "channel listen")?;
        let _publisher = env.our_peer("listings.py", "channel publish")?;
        listener.wait_until("the three values", |output| {
            (output.out.first()? == "[[200, 200, 3], [200, 200, 3], [8820], 44100]").then_some(())
        })
    })
}

/// Wrapyfi's own tests, with this package in place of Wrapyfi.
fn own_tests_pass(test: &str, case: &str, count: usize) -> Result {
    run(test, NEEDS, |env| {
        let (_broker, _names) = (env.broker()?, env.yarpserver()?);
        let mut tests = env.our_module("unittest", &format!("-v wrapyfi.tests.{case}"))?;
        tests.exits_with(0)?;
        let said = tests.stderr();
        assert!(said.contains(&format!("Ran {count} test")) && !said.contains("skipped"), "{said}");
        Ok(())
    })
}

macro_rules! own_tests_pass {
    ($($test:ident: $case:literal, $count:literal;)*) => {
        $(#[test]
        fn $test() -> Result {
            own_tests_pass(stringify!($test), $case, $count)
        })*
    };
}

own_tests_pass! {
    wrapyfis_tests_of_the_decorator_pass_on_zeromq: "test_wrapper.ZeroMQTestWrapper", 3;
    wrapyfis_tests_of_the_decorator_pass_on_ros_2: "test_wrapper.ROS2TestWrapper", 3;
    wrapyfis_tests_of_the_decorator_pass_on_yarp: "test_wrapper.YarpTestWrapper", 3;
    wrapyfis_tests_of_middlewares_pass_on_zeromq: "test_middleware.ZeroMQTestMiddleware", 1;
    wrapyfis_tests_of_middlewares_pass_on_ros_2: "test_middleware.ROS2TestMiddleware", 1;
    wrapyfis_tests_of_middlewares_pass_on_yarp: "test_middleware.YarpTestMiddleware", 1;
}

/// A script that waits in a mode, and says that it does.
const WAITS: &str = r#"
import sys
from wrapyfi_rs.connect.wrapper import MiddlewareCommunicator

class Waits(MiddlewareCommunicator):
    @MiddlewareCommunicator.register("NativeObject", sys.argv[2], "Waits", "/waits/" + sys.argv[1], timeout_ms=100_000)
    def wait(self):
        return 1,

waits = Waits()
waits.activate_communication("wait", sys.argv[1])
try:
    waits.wait()
except KeyboardInterrupt:
    print("interrupted")
"#;

#[test]
fn ctrl_c_ends_every_wait() -> Result {
    run("ctrl_c_ends_every_wait", NEEDS, |env| {
        let (_broker, _names) = (env.broker()?, env.yarpserver()?);
        for mware in ["zeromq", "yarp", "ros2"] {
            // A request that nobody answers stays in the broker, and would be served.
            for mode in ["listen", "publish", "reply", "request"] {
                let mut script = env.our_script(WAITS, &format!("{mode} {mware}"))?;
                script.wait_until("the word that it waits", |output| {
                    output.err.iter().any(|line| line.contains("waits for")).then_some(())
                })?;
                script.interrupt()?;
                script.exits_with(0)?;
                assert_eq!(script.stdout().trim(), "interrupted", "{mode} {mware}");
            }
        }
        Ok(())
    })
}

/// A server whose method raises, and its client.
const RAISES: &str = r#"
import sys
from wrapyfi_rs.connect.wrapper import MiddlewareCommunicator

class Raises(MiddlewareCommunicator):
    @MiddlewareCommunicator.register("NativeObject", sys.argv[2], "Raises", "/raises")
    def ask(self, number, by=1):
        return number / by,

raises = Raises()
raises.activate_communication("ask", sys.argv[1])
try:
    print(raises.ask(6, by=3)[0])
    print(raises.ask(6, by=0)[0])
except Exception as error:
    print(f"{type(error).__name__}: {error}")
"#;

#[test]
fn what_a_server_raises_reaches_the_client() -> Result {
    run("what_a_server_raises_reaches_the_client", NEEDS, |env| {
        let (_broker, _names) = (env.broker()?, env.yarpserver()?);
        for mware in ["zeromq", "yarp", "ros2"] {
            let mut server = env.our_script(RAISES, &format!("reply {mware}"))?;
            let mut client = env.our_script(RAISES, &format!("request {mware}"))?;
            client.exits_with(0)?;
            server.exits_with(0)?;
            let (asked, served) = (client.stdout(), server.stdout());
            assert!(
                asked.starts_with("2.0\nCallError: ") && asked.contains("division by zero"),
                "{asked}"
            );
            assert_eq!(served, "2.0\nZeroDivisionError: division by zero");
        }
        Ok(())
    })
}

/// A script of Wrapyfi's examples on this package, and another one of it: a line of the second has these words.
fn example(test: &str, module: &str, roles: [&str; 2], words: &str) -> Result {
    run(test, NEEDS, |env| {
        let _broker = env.broker()?;
        let module = format!("examples.{module}");
        let second = env.our_module(&module, roles[1])?;
        let mut first = env.our_module(&module, roles[0])?;
        for _ in 0..50 {
            first.tell("typed here")?;
        }
        second.wait_until(words, |output| {
            output.out.iter().any(|line| line.contains(words)).then_some(())
        })
    })
}

macro_rules! examples {
    ($($test:ident: $module:literal, $first:literal, $second:literal, $words:literal;)*) => {
        $(#[test]
        fn $test() -> Result {
            example(stringify!($test), $module, [$first, $second], $words)
        })*
    };
}

examples! {
    hello_world_is_heard: "hello_world", "--publish", "--listen", "'message': 'typed here'";
    hello_world_is_asked: "hello_world", "--reply", "--request", "'message': 'typed here'";
    mirroring_is_heard: "communication_schemes.mirroring_example", "--mode publish", "--mode listen", "'msg_ip': 'typed here'";
    mirroring_is_asked: "communication_schemes.mirroring_example", "--mode reply", "--mode request", "'msg_ip': 'typed here'";
    channels_are_heard: "communication_schemes.channeling_example",
        "--mode publish --mware_A zeromq --mware_B zeromq --mware_C zeromq",
        "--mode listen --mware_A zeromq --mware_B zeromq --mware_C zeromq", "zeromq_aud";
    pandas_is_heard: "encoders.numpy_pandas_example", "--mode publish", "--mode listen", "'message': 'typed here'";
    pint_is_heard: "encoders.pint_example", "--mode publish", "--mode listen", "<Quantity(42, 'meter')>";
    pyarrow_is_heard: "encoders.pyarrow_example", "--mode publish", "--mode listen", "'message': 'typed here'";
    xarray_is_heard: "encoders.xarray_example", "--mode publish", "--mode listen", "'message': 'typed here'";
}

/// Two tasks of one loop on an `async def`, and one that is cancelled.
const TASKS: &str = r#"
import asyncio
from wrapyfi_rs.connect.wrapper import MiddlewareCommunicator

class Tasks(MiddlewareCommunicator):
    @MiddlewareCommunicator.register("NativeObject", "zeromq", "Tasks", "/tasks")
    async def number(self, number=None):
        await asyncio.sleep(0)
        return number,

async def main():
    here, there = Tasks(), Tasks()
    here.activate_communication("number", "publish")
    there.activate_communication("number", "listen")
    print(await asyncio.gather(here.number(number=7), there.number()))
    waits = asyncio.create_task(there.number())
    await asyncio.sleep(0)
    waits.cancel()
    try:
        await waits
    except asyncio.CancelledError:
        print("cancelled")

asyncio.run(main())
"#;

#[test]
fn an_async_method_is_awaited() -> Result {
    prints("an_async_method_is_awaited", TASKS, &["[(7,), [7]]", "cancelled"])
}

#[test]
fn objects_of_other_libraries_arrive_equal() -> Result {
    let packages = ["pandas", "pint", "pyarrow", "xarray", "PIL"].map(Need::Package);
    let needs = [NEEDS, &packages].concat();
    run("objects_of_other_libraries_arrive_equal", &needs, |env| {
        let _broker = env.broker()?;
        let mut script = env.our_peer("python_objects.py", "")?;
        script.exits_with(0)?;
        assert_eq!(script.stdout(), "True", "{}", script.stderr());
        Ok(())
    })
}

/// A script that publishes or listens to dicts of a ROS type, and a node's parameters.
const DICTS: &str = r#"
import sys, time
from wrapyfi_rs.connect.wrapper import MiddlewareCommunicator

class Dicts(MiddlewareCommunicator):
    @MiddlewareCommunicator.register("ROS2Message", sys.argv[2], "Dicts", "/twist", message_type="geometry_msgs/msg/Twist")
    def twist(self):
        return {"linear": {"x": 0.5}},

dicts = Dicts()
dicts.activate_communication("twist", sys.argv[1])
while True:
    print(dicts.twist()[0]["linear"]["x"])
    time.sleep(0.05)
"#;

#[test]
fn dicts_are_messages_of_a_ros_type() -> Result {
    let needs = [NEEDS, &[Need::Ros1]].concat();
    run("dicts_are_messages_of_a_ros_type", &needs, |env| {
        let _master = env.roscore()?;
        for mware in ["ros", "ros2"] {
            let endpoint = format!("{mware}:/twist");
            let _script = env.our_script(DICTS, &format!("publish {mware}"))?;
            let kind = ["--type", "geometry_msgs/msg/Twist"];
            let echo = ["echo", &endpoint, "--count", "1", "--timeout", "100"];
            let mut echo = env.wrapyfi([&echo[..], &kind].concat())?;
            echo.exits_with(0)?;
            assert!(echo.stdout().contains("0.5"), "{}", echo.stdout());
            let listener = env.our_script(DICTS, &format!("listen {mware}"))?;
            listener
                .wait_until("a number", |output| (output.out.first()? == "0.5").then_some(()))?;
        }
        Ok(())
    })
}

/// A publisher on this package, heard by a listener on it and by `wrapyfi echo`.
fn is_heard_on(test: &str, mware: &str, needs: &[Need]) -> Result {
    run(test, &[NEEDS, needs].concat(), |env| {
        let _names = env.yarpserver()?;
        let _master = needs.contains(&Need::Ros1).then(|| env.roscore()).transpose()?;
        for what in [
            "NativeObject --flavour rich",
            "Image --flavour colour",
            "Image --flavour mono",
            "AudioChunk --flavour mono",
        ] {
            // YARP's samples have 16 bits, so that others arrive than were sent.
            if mware == "yarp" && what.starts_with("AudioChunk") {
                continue;
            }
            let kind = what.split(' ').next().unwrap_or_default();
            let topic = env.topic(&what.replace([' ', '-'], "_").to_lowercase());
            let common = format!("--mware {mware} --topic {topic} --type {what}");
            let publisher = env.our_peer("wrapyfi_peer.py", &format!("publish {common}"))?;
            let mut listener =
                env.our_peer("wrapyfi_peer.py", &format!("listen {common} --count 3"))?;
            let heard = texts(&listener.messages(3)?, "sha256");
            listener.exits_with(0)?;
            publisher.sent_in_a_row("sha256", &heard)?;
            let endpoint = format!("{mware}:{topic}");
            let args =
                ["echo", &endpoint, "--type", kind, "--count", "3", "--timeout", "100", "--json"];
            let mut echo = env.wrapyfi(args)?;
            let heard = texts(&echo.objects(3)?, "sha256");
            echo.exits_with(0)?;
            publisher.sent_in_a_row("sha256", &heard)?;
        }
        Ok(())
    })
}

#[test]
fn every_type_is_heard_on_ros_2() -> Result {
    is_heard_on("every_type_is_heard_on_ros_2", "ros2", &[])
}

#[test]
fn every_type_is_heard_on_ros_1() -> Result {
    is_heard_on("every_type_is_heard_on_ros_1", "ros", &[Need::Ros1])
}

#[test]
fn every_type_is_heard_on_yarp() -> Result {
    is_heard_on("every_type_is_heard_on_yarp", "yarp", &[])
}
