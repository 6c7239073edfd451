//! Commands as functions, services and messages of any type of ROS, actions: the part of the package `wrapyfi_rs` that is not Wrapyfi's.

use wrapyfi_e2e::{Need, Process, Result, TestEnv, run};

use crate::actions::FIBONACCI;

const NEEDS: &[Need] = &[Need::Program, Need::Python];
const BOTH_ROS: &[Need] = &[Need::Program, Need::Python, Need::Ros1];

/// Waits until a script has ended well with these lines.
pub(crate) fn said(mut script: Process, lines: &[&str]) -> Result {
    script.exits_with(0)?;
    let printed = script.stdout();
    assert_eq!(printed.lines().collect::<Vec<_>>(), lines, "{}", script.stderr());
    Ok(())
}

/// Looks at a topic of ROS 2.
const LOOKS: &str = r#"
import wrapyfi_rs
from wrapyfi_rs.errors import WrapyfiError
from wrapyfi_rs.ros import message

Twist = message("geometry_msgs/msg/Twist")
for one in wrapyfi_rs.echo("ros2:/twist", count=1, timeout=100):
    print(one["linear"]["x"])
for one in wrapyfi_rs.echo("ros2:/twist", Twist, count=2, timeout=100):
    print(type(one).__name__, one.linear.x, one.angular == Twist().angular)
found = [one for one in wrapyfi_rs.list("ros2") if one["name"] == "/twist"]
print(found[0]["middleware"], found[0]["role"], found[0]["type"])
print(wrapyfi_rs.why("ros2:/twist").passed != [], wrapyfi_rs.why("ros2:/nobody").cause is None)
for wrong in (lambda: next(wrapyfi_rs.echo("/twist")), lambda: wrapyfi_rs.list("telegraph"),
              lambda: message("no_msgs/msg/Nothing"),
              lambda: next(wrapyfi_rs.echo("ros2:/nobody", Twist, timeout=0.2)),
              lambda: wrapyfi_rs.call("ros2:/nobody", timeout=0.2),
              lambda: next(wrapyfi_rs.echo("telegraph:/x", "NativeObject")), lambda: wrapyfi_rs.call("telegraph:/x"),
              # No name server of YARP is named here.
              lambda: next(wrapyfi_rs.echo("yarp:/x", "NativeObject")), lambda: wrapyfi_rs.call("yarp:/x")):
    try:
        wrong()
    except WrapyfiError as error:
        print(type(error).__name__)
"#;

#[test]
fn commands_are_functions() -> Result {
    run("commands_are_functions", NEEDS, |env| {
        let publish = ["pub", "ros2:/twist", "--type", "geometry_msgs/msg/Twist", "--rate", "20"];
        let value = r#"{"linear": {"x": 0.5}}"#;
        let _publisher = env.wrapyfi([&publish[..], &["--value", value]].concat())?;
        let lines = [
            "0.5",
            "Twist 0.5 True",
            "Twist 0.5 True",
            "ros2 publisher geometry_msgs/msg/Twist",
            "True False",
            "OptionError",
            "OptionError",
            "OptionError",
            "WaitTimeout",
            "CallError",
            "OptionError",
            "OptionError",
            "OpenError",
            "OpenError",
        ];
        said(env.our_script(LOOKS, "")?, &lines)
    })
}

/// A joint state as a dataclass, published or heard.
const JOINTS: &str = r#"
import sys, time
from wrapyfi_rs.connect.wrapper import MiddlewareCommunicator
from wrapyfi_rs.ros import message

JointState = message("sensor_msgs/msg/JointState")

class Joints(MiddlewareCommunicator):
    @MiddlewareCommunicator.register("ROS2Message", sys.argv[2], "Joints", "/joints", message_type=JointState)
    def state(self):
        state = JointState(name=["neck", "jaw"], position=[0.25, -0.5])
        state.header.frame_id = "head"
        return state,

joints = Joints()
joints.activate_communication("state", sys.argv[1])
while True:
    state, = joints.state()
    print(type(state).__name__, state.header.frame_id, list(state.name), [float(one) for one in state.position], len(state.effort))
    time.sleep(0.05)
"#;

#[test]
fn messages_are_dataclasses() -> Result {
    run("messages_are_dataclasses", BOTH_ROS, |env| {
        let _master = env.roscore()?;
        for mware in ["ros", "ros2"] {
            let listener = env.our_script(JOINTS, &format!("listen {mware}"))?;
            let _publisher = env.our_script(JOINTS, &format!("publish {mware}"))?;
            listener.wait_until("a joint state", |output| {
                (output.out.first()? == "JointState head ['neck', 'jaw'] [0.25, -0.5] 0")
                    .then_some(())
            })?;
            let endpoint = format!("{mware}:/joints");
            let mut echo = env.wrapyfi(["echo", &endpoint, "--count", "1", "--json"])?;
            let heard = echo.objects(1)?.remove(0);
            echo.exits_with(0)?;
            assert_eq!(heard["value"]["position"], serde_json::json!([0.25, -0.5]), "{heard}");
        }
        Ok(())
    })
}

/// A service of a type of ROS.
const LIGHT: &str = r#"
import sys
from wrapyfi_rs.connect.wrapper import MiddlewareCommunicator

class Light(MiddlewareCommunicator):
    @MiddlewareCommunicator.register("ROSMessage", sys.argv[2], "Light", "/light", message_type="std_srvs/srv/SetBool")
    def switch(self, data=False):
        return {"success": True, "message": "on" if data else "off"},

light = Light()
light.activate_communication("switch", sys.argv[1])
if sys.argv[1] == "request":
    print(light.switch(True)[0]["message"], light.switch(data=False)[0]["message"])
while sys.argv[1] == "reply":
    light.switch()
"#;

const CALLS: &str = r#"
import sys, wrapyfi_rs
print(wrapyfi_rs.call(sys.argv[1], data=True, timeout=100))
print(wrapyfi_rs.call(sys.argv[1], False, data_type="std_srvs/srv/SetBool")["message"])
"#;

#[test]
fn services_have_types_of_ros() -> Result {
    run("services_have_types_of_ros", BOTH_ROS, |env| {
        let _master = env.roscore()?;
        for mware in ["ros", "ros2"] {
            let server = env.our_script(LIGHT, &format!("reply {mware}"))?;
            let endpoint = format!("{mware}:/light");
            let reply = "{'success': True, 'message': 'on'}";
            said(env.our_script(CALLS, &endpoint)?, &[reply, "off"])
                .map_err(|error| error.context(server.tail()))?;
            let ask = ["call", &endpoint, "--timeout", "100", "--value", r#"{"data": true}"#];
            let mut call = env.wrapyfi([&ask[..], &["--json"]].concat())?;
            let reply = call.objects(1)?.remove(0);
            call.exits_with(0)?;
            assert_eq!(reply["value"]["message"], "on", "{reply}");
            said(env.our_script(LIGHT, &format!("request {mware}"))?, &["on off"])?;
        }
        Ok(())
    })
}

/// An action that counts, or one that goes on until its client has enough of it.
const COUNTS: &str = r#"
import sys, time
from wrapyfi_rs.connect.wrapper import MiddlewareCommunicator

class Numbers(MiddlewareCommunicator):
    @MiddlewareCommunicator.register("Action", sys.argv[2], "Numbers", "/numbers", action_type="test_msgs/action/Fibonacci")
    def count(self, order, feedback=None):
        sequence = [0, 1]
        while len(sequence) < order or order < 0:
            if feedback.is_canceled:
                print("canceled")
                break
            sequence.append(sequence[-1] + sequence[-2] if order > 0 else 1)
            feedback.send({"sequence": sequence[-3:]})
            time.sleep(0.02)
        if order == 0:
            raise ValueError("no numbers")
        return {"sequence": sequence[:7]},

numbers = Numbers()
numbers.activate_communication("count", sys.argv[1])
if sys.argv[1] == "request":
    print(numbers.count(7)[0]["sequence"].tolist())
while sys.argv[1] == "reply":
    try:
        numbers.count()
    except ValueError as error:
        print(error)
"#;

const GOALS: &str = r#"
import sys, wrapyfi_rs
from wrapyfi_rs.errors import CallError

class Enough(Exception):
    pass

def enough(feedback):
    raise Enough(len(feedback["sequence"]))

goal = sys.argv[1], "test_msgs/action/Fibonacci"
print(wrapyfi_rs.send_goal(*goal, order=7, timeout=100)["sequence"].tolist())
print(wrapyfi_rs.send_goal(sys.argv[1], order=3, timeout=100)["sequence"].tolist())
try:
    wrapyfi_rs.send_goal(*goal, -1, feedback=enough)
except Enough as error:
    print("enough", error)
try:
    wrapyfi_rs.send_goal(*goal, order=0)
except CallError as error:
    print("no result:", "aborted" in str(error))
"#;

fn fibonacci(env: &TestEnv) -> Result {
    let (file, text) = FIBONACCI;
    let index = "share/ament_index/resource_index/rosidl_interfaces/test_msgs";
    let share = format!("share/{file}");
    let prefix = env.definitions(&[(&share, text), (index, "action/Fibonacci.action\n")])?;
    env.set_variable("AMENT_PREFIX_PATH", prefix);
    Ok(())
}

const NUMBERS: &str = "[0, 1, 1, 2, 3, 5, 8]";

#[test]
fn actions_are_served_and_sent() -> Result {
    run("actions_are_served_and_sent", BOTH_ROS, |env| {
        fibonacci(env)?;
        let _master = env.roscore()?;
        for mware in ["ros", "ros2"] {
            let server = env.our_script(COUNTS, &format!("reply {mware}"))?;
            let endpoint = format!("{mware}:/numbers");
            said(
                env.our_script(GOALS, &endpoint)?,
                &[NUMBERS, "[0, 1, 1]", "enough 3", "no result: True"],
            )
            .map_err(|error| error.context(server.tail()))?;
            server.wait_until("the word that a goal was cancelled", |output| {
                output.out.iter().any(|line| line == "canceled").then_some(())
            })?;
            let send = ["action", "send", &endpoint, "--type", "test_msgs/action/Fibonacci"];
            let mut send = env.wrapyfi([&send[..], &["--args", "[7]", "--json"]].concat())?;
            let end = send.wait_until("the result", |output| {
                output.objects().find(|one| one["goal"] == "succeeded")
            })?;
            send.exits_with(0)?;
            assert_eq!(end["value"]["sequence"], serde_json::json!([0, 1, 1, 2, 3, 5, 8]));
        }
        Ok(())
    })
}

#[test]
fn a_method_sends_goals_to_a_server_elsewhere() -> Result {
    run("a_method_sends_goals_to_a_server_elsewhere", NEEDS, |env| {
        fibonacci(env)?;
        let serve = ["action", "serve", "ros2:/numbers", "--type", "test_msgs/action/Fibonacci"];
        let result = r#"{"sequence": [0, 1, 1, 2, 3, 5, 8]}"#;
        let more = ["--value", result, "--seconds", "0.1"];
        let _server = env.wrapyfi([&serve[..], &more].concat())?;
        said(env.our_script(COUNTS, "request ros2")?, &[NUMBERS])
    })
}

/// Functions that wait for programs which are not there.
const WAITS: &str = r#"
import sys, wrapyfi_rs
nobody = {
    "type": lambda: next(wrapyfi_rs.echo("ros2:/nobody")),
    "echo": lambda: next(wrapyfi_rs.echo("ros2:/nobody", "NativeObject")),
    "call": lambda: wrapyfi_rs.call("ros2:/nobody", timeout=1000),
    "goal": lambda: wrapyfi_rs.send_goal("ros2:/nobody", "test_msgs/action/Fibonacci", 1, feedback=print),
}
try:
    print("begins")
    nobody[sys.argv[1]]()
except KeyboardInterrupt:
    print("interrupted")
"#;

#[test]
fn ctrl_c_ends_functions_that_wait() -> Result {
    run("ctrl_c_ends_functions_that_wait", NEEDS, |env| {
        fibonacci(env)?;
        for function in ["type", "echo", "call", "goal"] {
            let script = env.our_script(WAITS, function)?;
            script.wait_until("its begin", |output| {
                (output.out.first()? == "begins").then_some(())
            })?;
            script.interrupt()?;
            said(script, &["begins", "interrupted"])
                .map_err(|error| error.context(function.to_owned()))?;
        }
        Ok(())
    })
}

/// Functions of one loop: what waits for nobody does not keep the others waiting, and ends when it is cancelled.
const AWAITS: &str = r#"
import asyncio
from wrapyfi_rs import aio

async def heard():
    return [message["linear"]["x"] async for message in aio.echo("ros2:/twist", count=2, timeout=100)]

async def untold():
    async for _ in aio.echo("ros2:/nobody"):
        pass

async def silent():
    async for _ in aio.echo("ros2:/nobody", "NativeObject"):
        pass

async def main():
    waits = [untold(), silent(), aio.call("ros2:/nobody", data_type="std_srvs/srv/Trigger", timeout=1000),
             aio.send_goal("ros2:/nobody", "test_msgs/action/Fibonacci", 1, timeout=1000)]
    waits = [asyncio.create_task(one) for one in waits]
    print(await heard())
    print((await aio.send_goal("ros2:/numbers", order=7, timeout=100))["sequence"].tolist())
    print(any(one["name"] == "/twist" for one in await aio.list("ros2")), (await aio.why("ros2:/twist")).passed != [])
    for one in waits:
        one.cancel()
    print([type(end).__name__ for end in await asyncio.gather(*waits, return_exceptions=True)])

asyncio.run(main())
"#;

#[test]
fn functions_are_awaited() -> Result {
    run("functions_are_awaited", NEEDS, |env| {
        fibonacci(env)?;
        let publish = ["pub", "ros2:/twist", "--type", "geometry_msgs/msg/Twist", "--rate", "20"];
        let value = r#"{"linear": {"x": 0.5}}"#;
        let _publisher = env.wrapyfi([&publish[..], &["--value", value]].concat())?;
        let _server = env.our_script(COUNTS, "reply ros2")?;
        let ends = "['CancelledError', 'CancelledError', 'CancelledError', 'CancelledError']";
        said(env.our_script(AWAITS, "")?, &["[0.5, 0.5]", NUMBERS, "True True", ends])
    })
}
