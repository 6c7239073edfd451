"""What rclpy and `ros2 param` do with the parameters of another node, with the Python of a real ROS 2.

    rclpy_parameters.py --node /x --value '[["list"], ["describe", "a"], ["get", "a", "b"], ["set", {"a": 5}]]'

Waits for the node and its services, does each step, and listens to its events until stdin closes, `--gone` until the
node is there no more. Lines on stdout: {"event": "ready"}, then "list", "describe", "get", "set", "load" (all or none),
each with its `value`; "changed" for each event of the node; "gone".
"""
import argparse
import json

parser = argparse.ArgumentParser()
parser.add_argument("--node", required=True)
parser.add_argument("--value", default="[]")
parser.add_argument("--gone", action="store_true")
args = parser.parse_args()

import rclpy  # noqa: E402
import rclpy.node  # noqa: E402
import rclpy.parameter  # noqa: E402
from lines import leave, leaving, say, watch_stdin  # noqa: E402
from rcl_interfaces.msg import ParameterEvent  # noqa: E402
from rclpy.parameter import Parameter, parameter_value_to_python  # noqa: E402
from rclpy.parameter_client import AsyncParameterClient  # noqa: E402

watch_stdin()
rclpy.init(args=[])
node = rclpy.node.Node("rclpy_parameters", enable_rosout=False)


def is_there():
    names = node.get_node_names_and_namespaces()
    return args.node in [f"{space.rstrip('/')}/{name}" for name, space in names]


def heard(event):
    if event.node == args.node:
        values = {it.name: parameter_value_to_python(it.value)
                  for it in [*event.new_parameters, *event.changed_parameters]}
        say("changed", value=values, deleted=[it.name for it in event.deleted_parameters])


def done(future):
    while not future.done() and not leaving.is_set():
        rclpy.spin_once(node, timeout_sec=0.05)
    return future.result()


def described(one):
    ranges = [*one.integer_range, *one.floating_point_range]
    return {"type": one.type, "description": one.description, "constraints": one.additional_constraints,
            "range": [[it.from_value, it.to_value] for it in ranges], "read_only": one.read_only}


node.create_subscription(ParameterEvent, "/parameter_events", heard, rclpy.qos.qos_profile_parameter_events)
client = AsyncParameterClient(node, args.node)
while not (is_there() and client.services_are_ready()) and not leaving.wait(0.05):
    rclpy.spin_once(node, timeout_sec=0)
say("ready")
for step, *rest in json.loads(args.value):
    if leaving.is_set():
        break
    if step == "list":
        say(step, value=list(done(client.list_parameters()).result.names))
    elif step == "describe":
        said = done(client.describe_parameters(rest)).descriptors
        say(step, value={it.name: described(it) for it in said})
    elif step == "get":
        said = done(client.get_parameters(rest)).values
        say(step, value=[parameter_value_to_python(it) for it in said])
    else:
        wanted = [Parameter(name, value=value) for name, value in rest[0].items()]
        atomically = step == "load"
        said = done((client.set_parameters_atomically if atomically else client.set_parameters)(wanted))
        results = [said.result] if atomically else said.results
        say(step, value=[[it.successful, it.reason] for it in results])
while not leaving.is_set() and (not args.gone or is_there()):
    rclpy.spin_once(node, timeout_sec=0.05)
if args.gone:
    say("gone")
leave()
