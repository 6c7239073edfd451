#!/usr/bin/python3
"""Nodes of rospy, with Debian's Python.

    rospy_peer.py publish   --topic /x --type std_msgs/String --value '{"data": "{}"}' [--latch] [--count N]
    rospy_peer.py subscribe --topic /x --type std_msgs/String [--count N]
    rospy_peer.py master    --port P                          a roscore: master and parameter server
    rospy_peer.py serve     --topic /x                        std_srvs/SetBool, refuses False
    rospy_peer.py param     --topic /x [--value JSON]         sets or prints a parameter

With --definition FILE the type is made from that full text, and is in no package. In a published value {n} stands for the number of the message. Lines on stdout: {"event": "ready"}, then
{"event": "message", "index", "value"}: the fields, bytes as their SHA-256.
"""
import argparse
import hashlib
import json
import os
import sys

parser = argparse.ArgumentParser()
parser.add_argument("role", choices=["publish", "subscribe", "master", "serve", "param"])
parser.add_argument("--topic", default="/x")
parser.add_argument("--type", default="std_msgs/String")
parser.add_argument("--definition")
parser.add_argument("--value")
parser.add_argument("--node", default="rospy_peer")
parser.add_argument("--latch", action="store_true")
parser.add_argument("--count", type=int, default=0, help="0: until stdin closes")
parser.add_argument("--rate", type=float, default=20.0)
parser.add_argument("--port", type=int, default=0)
args = parser.parse_args()

from lines import leave, leaving, say, watch_stdin  # noqa: E402

watch_stdin()

if args.role == "master":
    import rosmaster.master
    import rosmaster.master_api
    master = rosmaster.master.Master(args.port, num_workers=3)
    master.start()
    say("ready", uri=master.uri)
    leaving.wait()
    leave()

import genpy  # noqa: E402
import genpy.message  # noqa: E402
import roslib.message  # noqa: E402
import rospy  # noqa: E402

rospy.init_node(args.node, anonymous=False, disable_signals=True)


def plain(value):
    """A message as JSON."""
    if isinstance(value, genpy.Message):
        return {name: plain(getattr(value, name)) for name in value.__slots__}
    if isinstance(value, (genpy.Time, genpy.Duration)):
        return {"secs": value.secs, "nsecs": value.nsecs}
    if isinstance(value, (bytes, bytearray)):
        return {"sha256": hashlib.sha256(value).hexdigest(), "size": len(value)}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value


def message_class():
    if args.definition is None:
        return roslib.message.get_message_class(args.type)
    import genpy.dynamic
    with open(args.definition) as file:
        return genpy.dynamic.generate_dynamic(args.type, file.read())[args.type]


def finish():
    rospy.signal_shutdown("done")
    leave()


if args.role == "publish":
    kind = message_class()
    publisher = rospy.Publisher(args.topic, kind, queue_size=100, latch=args.latch)
    say("ready")
    index = 0
    while not leaving.is_set() and (args.count == 0 or index < args.count):
        if not args.latch and publisher.get_num_connections() == 0:
            leaving.wait(0.01)
            continue
        message = kind()
        value = json.loads(args.value.replace("{n}", str(index)))
        genpy.message.fill_message_args(message, [value])
        publisher.publish(message)
        say("message", index=index, value=plain(message))
        index += 1
        leaving.wait(1.0 / args.rate)
    say("done", count=index)
    leaving.wait()
elif args.role == "subscribe":
    kind = message_class()
    index = [0]

    def heard(message):
        if args.count == 0 or index[0] < args.count:
            say("message", index=index[0], value=plain(message))
            index[0] += 1
        if index[0] == args.count:
            leaving.set()

    subscriber = rospy.Subscriber(args.topic, kind, heard, queue_size=100)
    say("ready")
    leaving.wait()
elif args.role == "serve":
    from std_srvs.srv import SetBool, SetBoolResponse

    def answer(request):
        say("message", index=0, value=request.data)
        return SetBoolResponse(success=request.data, message="so be it" if request.data else "no")

    service = rospy.Service(args.topic, SetBool, answer)
    say("ready")
    leaving.wait()
elif args.role == "param":
    if args.value is not None:
        rospy.set_param(args.topic, json.loads(args.value))
        say("ready")
        leaving.wait()
    else:
        say("ready")
        while not leaving.is_set():
            if rospy.has_param(args.topic):
                say("message", index=0, value=rospy.get_param(args.topic))
                break
            leaving.wait(0.05)
finish()
