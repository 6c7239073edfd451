//! The package `wrapyfi_rs` for Python: as Wrapyfi to Wrapyfi's scripts, on both sides of each wire.

use std::time::Duration;

use wrapyfi_e2e::{Need, Process, Result, TestEnv, asked_until, repository, run, texts};

use crate::python_graph::said;

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
        said(env.our_script(script, "")?, expected)
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
            "object: ObjectError (value 1 that Pair.say returned)",
            "cycle: ObjectError (value 1 that Pair.say returned)",
            "objects: ObjectError (value 1 that Pair.say returned)",
            "bytes: ObjectError",
            "strided: [0, 2, 4]",
            "big-endian: [1, 2]",
            "huge: True",
            "image of float64: ValueMismatch (value 1 that Faults.image returned)",
            "sound: ValueMismatch (value 1 that Faults.sound returned)",
            "raises: ZeroDivisionError",
            "static: 5",
            "mode: ModeError",
            "name: AttributeError",
            "argument: KeyError",
            "place: IndexError",
            "list: IndexError",
            "unknown middleware: [None]",
            "middleware without a name server: ([None], 'WARNING')",
            "misspelt options: ('WARNING', 'WARNING')",
            "time-out: WaitTimeout",
            "no broker, listen: WaitTimeout",
            "no broker, publish: WaitTimeout",
            "no broker, request: CallError",
            "no broker, none is waited for: ('alone',)",
            "panic: InternalError",
            "closed: own",
            "two classes: a b",
        ],
    )
}

/// The last of these runs of a script of the examples says these words, while the first ones are typed at.
fn example_says(env: &TestEnv, script: &str, runs: &[&str], words: &str) -> Result {
    let (last, before) = runs.split_last().ok_or_else(|| anyhow::anyhow!("no run"))?;
    let last = env.our_example(script, last)?;
    let mut others = Vec::new();
    for run in before {
        let mut other = env.our_example(script, run)?;
        for _ in 0..50 {
            other.tell("typed here")?;
        }
        others.push(other);
    }
    last.wait_until(words, |output| {
        output.out.iter().any(|line| line.contains(words)).then_some(())
    })
}

#[test]
fn the_papers_listing_of_mirroring_runs_as_printed() -> Result {
    run("the_papers_listing_of_mirroring_runs_as_printed", NEEDS, |env| {
        let _broker = env.broker()?;
        let _names = env.yarpserver()?;
        for mware in ["zeromq", "yarp", "ros2"] {
            let (publish, listen) = (format!("publish {mware}"), format!("listen {mware}"));
            let words = "{'msg': 'hello', 'msg_ip': 'typed here'}";
            example_says(env, "mirroring.py", &[&publish, &listen], words)?;
        }
        Ok(())
    })
}

#[test]
fn the_papers_listing_of_forwarding_runs_as_printed() -> Result {
    run("the_papers_listing_of_forwarding_runs_as_printed", NEEDS, |env| {
        let _broker = env.broker()?;
        let _names = env.yarpserver()?;
        let runs = ["publish disable", "listen publish", "disable listen"];
        example_says(env, "forwarding.py", &runs, "message ")
    })
}

#[test]
fn the_papers_listing_of_channeling_runs_as_printed() -> Result {
    let needs = [NEEDS, &[Need::Ros1]].concat();
    run("the_papers_listing_of_channeling_runs_as_printed", &needs, |env| {
        let (_broker, _names, _master) = (env.broker()?, env.yarpserver()?, env.roscore()?);
        let words = "2 (200, 200, 3) (8820,) 44100";
        example_says(env, "channeling.py", &["publish", "listen"], words)
    })
}

/// Wrapyfi's own tests, with this package in place of Wrapyfi.
fn own_tests_pass(test: &str, case: &str, count: usize) -> Result {
    let needs_ros_1: &[Need] = if case.contains(".ROSTest") { &[Need::Ros1] } else { &[] };
    run(test, &[NEEDS, needs_ros_1].concat(), |env| {
        let (_broker, _names) = (env.broker()?, env.yarpserver()?);
        let _master = (!needs_ros_1.is_empty()).then(|| env.roscore()).transpose()?;
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
    wrapyfis_tests_of_the_decorator_pass_on_ros_1: "test_wrapper.ROSTestWrapper", 3;
    wrapyfis_tests_of_the_decorator_pass_on_ros_2: "test_wrapper.ROS2TestWrapper", 3;
    wrapyfis_tests_of_the_decorator_pass_on_yarp: "test_wrapper.YarpTestWrapper", 3;
    wrapyfis_tests_of_middlewares_pass_on_zeromq: "test_middleware.ZeroMQTestMiddleware", 1;
    wrapyfis_tests_of_middlewares_pass_on_ros_1: "test_middleware.ROSTestMiddleware", 1;
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
    @MiddlewareCommunicator.register("NativeObject", sys.argv[2], "Raises", "/raises", timeout_ms=100_000)
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
    let runs_on_ros_1 = roles[0].contains("--mware ros ");
    let needs: &[Need] = if runs_on_ros_1 { &[Need::Ros1] } else { &[] };
    run(test, &[NEEDS, needs].concat(), |env| {
        let (_broker, _names) = (env.broker()?, env.yarpserver()?);
        let _master = runs_on_ros_1.then(|| env.roscore()).transpose()?;
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
    hello_world_is_heard_on_yarp: "hello_world", "--mware yarp --publish", "--mware yarp --listen", "'message': 'typed here'";
    hello_world_is_heard_on_ros_1: "hello_world", "--mware ros --publish", "--mware ros --listen", "'message': 'typed here'";
    hello_world_is_heard_on_ros_2: "hello_world", "--mware ros2 --publish", "--mware ros2 --listen", "'message': 'typed here'";
    hello_world_is_asked_on_yarp: "hello_world", "--mware yarp --reply", "--mware yarp --request", "'message': 'typed here'";
    hello_world_is_asked_on_ros_1: "hello_world", "--mware ros --reply", "--mware ros --request", "'message': 'typed here'";
    hello_world_is_asked_on_ros_2: "hello_world", "--mware ros2 --reply", "--mware ros2 --request", "'message': 'typed here'";
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

/// Its publisher and its listener have one topic.
#[test]
fn hello_world_hears_itself() -> Result {
    run("hello_world_hears_itself", NEEDS, |env| {
        let _broker = env.broker()?;
        let mut script = env.our_module("examples.hello_world", "--transceive")?;
        script.tell("typed here")?;
        script.wait_until("what was typed", |output| {
            output.out.iter().any(|line| line.contains("'message': 'typed here'")).then_some(())
        })
    })
}

/// The example of forwarding, in three programs: one publishes, one forwards to another middleware, one listens there.
fn forwards(test: &str, from: &str, to: &str, needs: &[Need]) -> Result {
    run(test, &[NEEDS, needs].concat(), |env| {
        let (_broker, _names) = (env.broker()?, env.yarpserver()?);
        let _master = needs.contains(&Need::Ros1).then(|| env.roscore()).transpose()?;
        let chain = |a: &str, b: &str| {
            let args = format!(
                "--mware_chain_A {from} --mode_chain_A {a} --mware_chain_B {to} --mode_chain_B {b}"
            );
            env.our_module("examples.communication_schemes.forwarding_example", &args)
        };
        let last = chain("disable", "listen")?;
        let _between = chain("listen", "publish")?;
        let _first = chain("publish", "disable")?;
        last.wait_until("the last word of the chain", |output| {
            let sent = format!("sent from read_chain_A transmitted over {from}");
            let received = format!("the last in the chain received over {to}");
            let all = |line: &String| line.contains(&sent) && line.contains(&received);
            output.out.iter().any(all).then_some(())
        })
    })
}

#[test]
fn forwarding_goes_from_zeromq_to_ros_2() -> Result {
    forwards("forwarding_goes_from_zeromq_to_ros_2", "zeromq", "ros2", &[])
}

#[test]
fn forwarding_goes_from_yarp_to_zeromq() -> Result {
    forwards("forwarding_goes_from_yarp_to_zeromq", "yarp", "zeromq", &[])
}

#[test]
fn forwarding_goes_from_ros_2_to_ros_1() -> Result {
    forwards("forwarding_goes_from_ros_2_to_ros_1", "ros2", "ros", &[Need::Ros1])
}

/// The examples of messages that are objects of `rospy` and `rclpy`: what the one publishes, the other hears as dicts.
fn messages_are_objects(test: &str, module: &str, packages: &str, need: Need) -> Result {
    run(test, &[NEEDS, &[need]].concat(), |env| {
        let _master = (need == Need::Ros1).then(|| env.roscore()).transpose()?;
        let ours = env.python_package()?;
        let path = std::env::join_paths([ours, packages.into()])?;
        let start = |mode: &str| {
            let module = format!("examples.custom_msgs.{module}");
            let path = path.to_str().unwrap_or_default();
            let args = ["-u", "-m", "wrapyfi_rs", "-m", &module, "--mode", mode];
            env.our_python_with(&args, &[("PYTHONPATH", path)])
        };
        let listener = start("listen")?;
        let mut publisher = start("publish")?;
        // The first ones may go to the connection by which the listener learns the type.
        asked_until("both messages", || {
            publisher.tell("typed here")?;
            std::thread::sleep(Duration::from_millis(20));
            let words =
                ["{'data': 'typed here'}", "'orientation': {'x': 0.1, 'y': -0.1, 'z': -0.8"];
            let all = |line: &str| words.iter().all(|word| line.contains(word));
            Ok(listener.stdout().lines().any(all).then_some(()))
        })
    })
}

#[test]
fn messages_are_objects_of_rclpy() -> Result {
    let packages = format!("{}/.venv-kilted/lib/python3.11/site-packages", repository().display());
    let test = "messages_are_objects_of_rclpy";
    messages_are_objects(test, "ros2_message_example", &packages, Need::Kilted)
}

#[test]
fn messages_are_objects_of_rospy() -> Result {
    let test = "messages_are_objects_of_rospy";
    messages_are_objects(test, "ros_message_example", "/usr/lib/python3/dist-packages", Need::Ros1)
}

/// A module of plug-ins in a folder that the script names before it imports Wrapyfi, as the example of Astropy does.
const NAMES_PLUG_INS: &str = r#"
import os, pathlib, sys
folder = pathlib.Path(__file__).parent
(folder / "plugins").mkdir(exist_ok=True)
(folder / "plugins" / "poses.py").write_text("""
from wrapyfi.utils.core_utils import *

class Pose: pass

@PluginRegistrar.register(types=(Pose,))
class PosePlugin(Plugin): pass
""")
os.environ["WRAPYFI_PLUGIN_PATHS"] = str(folder)
exec(sys.argv[1])
from wrapyfi.utils.core_utils import PluginRegistrar
print("PosePlugin" in PluginRegistrar.decoder_registry)
"#;

#[test]
fn a_script_names_folders_of_plug_ins_before_its_import() -> Result {
    run("a_script_names_folders_of_plug_ins_before_its_import", NEEDS, |env| {
        let script = env.write("names_plug_ins.py", NAMES_PLUG_INS)?.display().to_string();
        for import in [
            "from wrapyfi.connect.wrapper import MiddlewareCommunicator",
            "from wrapyfi import echo",
        ] {
            let mut ran = env.our_python_with(&["-m", "wrapyfi_rs", &script, import], &[])?;
            ran.exits_with(0)?;
            assert_eq!(ran.stdout(), "True", "{import}: {}", ran.stderr());
        }
        Ok(())
    })
}

/// An unchanged script, started as any, finds this package where the variable says so, and Wrapyfi where it does not.
#[test]
fn a_variable_puts_this_package_in_place_of_wrapyfi() -> Result {
    run("a_variable_puts_this_package_in_place_of_wrapyfi", NEEDS, |env| {
        let script = "import sys; ours = 'wrapyfi_rs' in sys.modules\n\
                      import wrapyfi.connect.wrapper as it; print(ours, it.__name__)";
        for (value, printed) in [
            (Some("1"), "True wrapyfi_rs.connect.wrapper"),
            (Some("0"), "False wrapyfi.connect.wrapper"),
            (None, "False wrapyfi.connect.wrapper"),
        ] {
            let variables: Vec<_> = value.map(|value| ("WRAPYFI_RS", value)).into_iter().collect();
            let mut ran = env.our_python_with(&["-c", script], &variables)?;
            ran.exits_with(0)?;
            assert_eq!(ran.stdout(), printed, "WRAPYFI_RS={value:?}: {}", ran.stderr());
        }
        Ok(())
    })
}

#[test]
fn the_switch_says_how_it_is_used() -> Result {
    run("the_switch_says_how_it_is_used", NEEDS, |env| {
        for (argument, exit_code, word) in [
            ("--help", 0, "usage"),
            ("--version", 0, "wrapyfi_rs"),
            ("--hepl", 1, "no option --hepl"),
        ] {
            let mut ran = env.our_python_with(&["-m", "wrapyfi_rs", argument], &[])?;
            ran.exits_with(exit_code)?;
            let said = ran.stdout() + &ran.stderr();
            assert!(said.contains(word) && !said.contains("Traceback"), "{argument}: {said}");
        }
        Ok(())
    })
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
        let (printed, said) = (script.stdout(), script.stderr());
        let count = printed.strip_suffix(" objects").and_then(|count| count.parse::<u32>().ok());
        assert!(count.is_some_and(|count| count >= 102), "{printed}: {said}");
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
            let wire = match (mware, kind) {
                ("ros2", "NativeObject") => "std_msgs/msg/String",
                ("ros2", "AudioChunk") => "wrapyfi_ros2_interfaces/msg/ROS2AudioMessage",
                _ => kind,
            };
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
                ["echo", &endpoint, "--type", wire, "--count", "3", "--timeout", "100", "--json"];
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
