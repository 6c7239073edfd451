"""Nodes of rclpy, with the Python of a real ROS 2.

    rclpy_peer.py publish   --topic /x --type std_msgs/msg/String --value '{"data": "{n}"}'
    rclpy_peer.py publish   --topic /x --type sensor_msgs/msg/LaserScan          every field filled at random
    rclpy_peer.py subscribe --topic /x --type std_msgs/msg/String [--count N]
    rclpy_peer.py serve     --topic /x --type std_srvs/srv/SetBool --value '{"message": "=request.data"}'
    rclpy_peer.py call      --topic /x --type std_srvs/srv/SetBool --value '{"data": true}'
    rclpy_peer.py achieve   --topic /x --type test_msgs/action/Fibonacci         a server of the action
    rclpy_peer.py send      --topic /x --type test_msgs/action/Fibonacci --value '{"order": 3}' [--count N] [--cancel]
    rclpy_peer.py hash      --topic /x --type std_srvs/srv/SetBool_Event         that of a publisher, and that of the type
    rclpy_peer.py params    --value '{"rate": 30}'               a node that has these parameters

In a published value {n} stands for the number of the message; in a reply = is an expression. Lines on stdout:
{"event": "ready"}, then {"event": "message", "index", "value", "sha256"}: the fields, and the digest of them as
JSON; `reply` where it called. A publisher waits for a subscription. The server gives feedback as many times as the
goal's order says, rejects a negative one, aborts at 0, and cancels all but 10 013. Goals are cancelled at the first feedback.
"""
import argparse
import hashlib
import importlib
import json
import os
import pathlib
import random
import string

parser = argparse.ArgumentParser()
parser.add_argument("role", choices=["publish", "subscribe", "serve", "call", "achieve", "send", "hash", "params"])
parser.add_argument("--topic", default="/x")
parser.add_argument("--type", default="std_msgs/msg/String")
parser.add_argument("--value")
parser.add_argument("--node", default="rclpy_peer")
parser.add_argument("--qos", default="reliable", choices=["reliable", "best_effort", "latched"])
parser.add_argument("--count", type=int, default=0, help="0: until stdin closes")
parser.add_argument("--rate", type=float, default=20.0)
parser.add_argument("--cancel", action="store_true")
args = parser.parse_args()

import rclpy  # noqa: E402
import rclpy.action  # noqa: E402
import rclpy.callback_groups  # noqa: E402
import rclpy.executors  # noqa: E402
import rclpy.node  # noqa: E402
import rclpy.qos  # noqa: E402
from lines import leave, leaving, say, watch_stdin  # noqa: E402
from rosidl_parser import definition  # noqa: E402

watch_stdin()
rclpy.init(args=[])

WHOLE = {f"{sign}int{bits}": (0 if sign else -(1 << bits - 1), (1 << bits) - 1 if sign else (1 << bits - 1) - 1)
         for sign in ("", "u") for bits in (8, 16, 32, 64)}


def made(kind, source):
    """A value of a field's type, none that JSON would change."""
    if isinstance(kind, definition.BasicType):
        name = kind.typename
        if name == "boolean":
            return bool(source.getrandbits(1))
        if name in ("float", "double"):
            return source.randint(-10_000, 10_000) / 8
        if name == "octet":
            return bytes([source.getrandbits(8)])
        return source.randint(*WHOLE["uint8" if name == "char" else name])
    if isinstance(kind, definition.AbstractGenericString):
        return "".join(source.choices(string.ascii_letters + "äß€ \"\\", k=12))
    if isinstance(kind, definition.Array):
        return [made(kind.value_type, source) for _ in range(kind.size)]
    if isinstance(kind, definition.AbstractNestedType):
        most = kind.maximum_size if isinstance(kind, definition.BoundedSequence) else 5
        return [made(kind.value_type, source) for _ in range(source.randint(1, min(most, 5)))]
    return filled(getattr(importlib.import_module(".".join(kind.namespaces)), kind.name)(), source)


def filled(message, source):
    for name, kind in zip(message.get_fields_and_field_types(), message.SLOT_TYPES):
        if name == "nanosec":
            message.nanosec = source.randint(0, 999_999_999)
        else:
            setattr(message, name, made(kind, source))
    return message


# As rosidl_runtime_py has them, which the wheels of ROS 2 lack.
def interface(name):
    package, folder, kind = name.split("/")
    return getattr(importlib.import_module(f"{package}.{folder}"), kind)


def plain(value):
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return value.decode("latin-1")
    if isinstance(value, (str, bool, int, float)):
        return value
    return [plain(item) for item in (value.tolist() if hasattr(value, "tolist") else value)]


def set_fields(message, values):
    kinds = dict(zip(message.get_fields_and_field_types(), message.SLOT_TYPES))
    for name, value in values.items():
        setattr(message, name, given(kinds[name], value))
    return message


def given(kind, value):
    if isinstance(kind, definition.AbstractNestedType):
        return [given(kind.value_type, item) for item in value]
    if isinstance(kind, definition.NamespacedType):
        return set_fields(interface("/".join((*kind.namespaces, kind.name)))(), value)
    if isinstance(kind, definition.BasicType) and kind.typename in ("float", "double"):
        return float(value)
    return value


def facts(message):
    value = plain(message)
    text = json.dumps(value, sort_keys=True, ensure_ascii=False, default=str)
    return {"value": value if len(text) < 4096 else None, "sha256": hashlib.sha256(text.encode()).hexdigest()}


def message_number(n):
    message = interface(args.type)()
    if args.value is None:
        return filled(message, random.Random(n))
    return set_fields(message, json.loads(args.value.replace("{n}", str(n))))


def profile():
    depth = rclpy.qos.QoSProfile(depth=100)
    if args.qos == "best_effort":
        depth.reliability = rclpy.qos.ReliabilityPolicy.BEST_EFFORT
    if args.qos == "latched":
        depth.durability = rclpy.qos.DurabilityPolicy.TRANSIENT_LOCAL
    return depth


def publish(node):
    publisher = node.create_publisher(interface(args.type), args.topic, profile())
    say("ready")
    n = 0
    while not leaving.wait(1 / args.rate) and (args.count == 0 or n < args.count):
        if args.qos == "latched" or publisher.get_subscription_count() > 0:
            message = message_number(n)
            say("message", index=n, **facts(message))
            publisher.publish(message)
            n += 1
    say("done")
    leaving.wait()


def subscribe(node):
    got = []

    def heard(message):
        if args.count == 0 or len(got) < args.count:
            say("message", index=len(got), **facts(message))
            got.append(None)

    node.create_subscription(interface(args.type), args.topic, heard, profile())
    say("ready")
    while not leaving.is_set() and (args.count == 0 or len(got) < args.count):
        rclpy.spin_once(node, timeout_sec=0.1)


def serve(node):
    def answer(request, response):
        say("message", index=0, **facts(request))
        fields = json.loads(args.value or "{}")
        for name, value in fields.items():
            if isinstance(value, str) and value.startswith("="):
                fields[name] = eval(value[1:], {"request": request})
        return set_fields(response, fields)

    node.create_service(interface(args.type), args.topic, answer)
    say("ready")
    while not leaving.is_set():
        rclpy.spin_once(node, timeout_sec=0.1)


def call(node):
    kind = interface(args.type)
    client = node.create_client(kind, args.topic)
    say("ready")
    # Asks in the moment in which the service is there.
    while not client.service_is_ready():
        if leaving.wait(0.002):
            return
    future = client.call_async(set_fields(kind.Request(), json.loads(args.value or "{}")))
    while not future.done() and not leaving.is_set():
        rclpy.spin_once(node, timeout_sec=0.1)
    if future.done():
        say("reply", **facts(future.result()))


def achieve(node):
    kind = interface(args.type)

    def execute(goal):
        order = goal.request.order
        say("goal", **facts(goal.request))
        sequence = [0, 1]
        for _ in range(order):
            if goal.is_cancel_requested:
                goal.canceled()
                return kind.Result(sequence=sequence)
            # A goal that lasts reaches what 32 bits hold, and rclpy aborts it.
            sequence.append((sequence[-1] + sequence[-2]) % 2**31)
            goal.publish_feedback(kind.Feedback(sequence=sequence))
            leaving.wait(1 / args.rate)
        goal.abort() if order == 0 else goal.succeed()
        return kind.Result(sequence=sequence)

    def judge(request):
        response = rclpy.action.GoalResponse
        return response.REJECT if request.order < 0 else response.ACCEPT

    def cancel(goal):
        response = rclpy.action.CancelResponse
        return response.REJECT if goal.request.order == 10_013 else response.ACCEPT

    rclpy.action.ActionServer(node, kind, args.topic, execute, goal_callback=judge, cancel_callback=cancel,
                              callback_group=rclpy.callback_groups.ReentrantCallbackGroup())
    executor = rclpy.executors.MultiThreadedExecutor(8)
    executor.add_node(node)
    say("ready")
    while not leaving.is_set():
        executor.spin_once(timeout_sec=0.1)


def send(node):
    kind = interface(args.type)
    client = rclpy.action.ActionClient(node, kind, args.topic)
    say("ready")
    while not client.wait_for_server(timeout_sec=0.1):
        if leaving.is_set():
            return
    goal = set_fields(kind.Goal(), json.loads(args.value or "{}"))
    handles, ended = {}, []

    def progress(number, feedback):
        say("feedback", number=number, **facts(feedback))
        if args.cancel and number in handles and not handles[number][1]:
            handles[number][1] = True
            asked = handles[number][0].cancel_goal_async()
            asked.add_done_callback(lambda done: say("cancel", code=done.result().return_code))

    def begin(number, handle):
        say("accepted" if handle.accepted else "rejected", number=number)
        if not handle.accepted:
            ended.append(number)
            return
        handles[number] = [handle, False]
        handle.get_result_async().add_done_callback(lambda done: end(number, done.result()))

    def end(number, result):
        say("ended", number=number, status=result.status, **facts(result.result))
        ended.append(number)

    for number in range(max(args.count, 1)):
        future = client.send_goal_async(goal, lambda it, number=number: progress(number, it.feedback))
        future.add_done_callback(lambda done, number=number: begin(number, done.result()))
    while not leaving.is_set() and len(ended) < max(args.count, 1):
        rclpy.spin_once(node, timeout_sec=0.1)


def type_hash(node):
    """The hash that publishers announce, and the one that comes with ROS 2."""
    package, folder, _ = args.type.split("/")
    shares = [pathlib.Path(prefix, "share", package, folder) for prefix in os.environ["AMENT_PREFIX_PATH"].split(":")]
    files = [json.loads(path.read_text()) for share in shares for path in share.glob("*.json")]
    known = {one["type_name"]: one["hash_string"] for file in files for one in file["type_hashes"]}
    while not leaving.wait(0.05):
        publishers = node.get_publishers_info_by_topic(args.topic)
        if publishers:
            say("hash", announced=sorted({str(one.topic_type_hash) for one in publishers}), known=known[args.type])
            return


def params(node):
    for name, value in json.loads(args.value).items():
        node.declare_parameter(name, value)
    node.add_on_set_parameters_callback(told)
    say("ready")
    while not leaving.is_set():
        rclpy.spin_once(node, timeout_sec=0.1)


def told(parameters):
    from rcl_interfaces.msg import SetParametersResult
    for parameter in parameters:
        say("set", name=parameter.name, value=parameter.value)
    return SetParametersResult(successful=True)


{"publish": publish, "subscribe": subscribe, "serve": serve, "call": call, "achieve": achieve, "send": send,
 "hash": type_hash, "params": params}[args.role](
    rclpy.node.Node(args.node))
leave()
