#!/usr/bin/python3
"""Nodes of rospy, with Debian's Python.

    rospy_peer.py publish   --topic /x --type std_msgs/String --value '{"data": "{}"}' [--latch] [--count N]
    rospy_peer.py subscribe --topic /x --type std_msgs/String [--count N]
    rospy_peer.py bag       --topic /x --value JSON --count N --bag FILE     writes what rosbag play publishes
    rospy_peer.py master    --port P                          a roscore: master and parameter server
    rospy_peer.py serve     --topic /x                        std_srvs/SetBool, refuses False
    rospy_peer.py serve     --topic /x --type demo/Say --value '{"sum": "=request.a + 1"}'     = is an expression
    rospy_peer.py call      --topic /x --type demo/Say --value '{"a": 3}' [--count N]
    rospy_peer.py param     --topic /x [--value JSON]         sets or prints a parameter
    rospy_peer.py params    --topic /x                        prints a namespace, and at every change; a line
                                                              on stdin sets: {"gain": 2.5, "old": null}
    rospy_peer.py log       --value TEXT                      rospy.logwarn

In a published value {n} stands for the number of the message. Types come from Debian's packages, or from
--definitions, a folder with `package/msg/Type.msg` and `package/srv/Type.srv`: genpy makes their classes on the
spot; or from --definition, a file with the full text of --type. Lines on stdout: {"event": "ready"}, of a subscriber
{"event": "matched"}, then {"event": "message", "index", "value"}: the fields, bytes as their SHA-256; the same as
`reply` where it called.
"""
import argparse
import hashlib
import json
import os
import sys
import types

parser = argparse.ArgumentParser()
parser.add_argument("role", choices=["publish", "subscribe", "bag", "master", "serve", "call", "param", "params", "log"])
parser.add_argument("--topic", default="/x")
parser.add_argument("--type", default="std_msgs/String")
parser.add_argument("--definition")
parser.add_argument("--value")
parser.add_argument("--definitions")
parser.add_argument("--node", default="rospy_peer")
parser.add_argument("--latch", action="store_true")
parser.add_argument("--count", type=int, default=0, help="0: until stdin closes")
parser.add_argument("--rate", type=float, default=20.0)
parser.add_argument("--bag")
parser.add_argument("--port", type=int, default=0)
args = parser.parse_args()

from lines import leave, leaving, say, watch_stdin  # noqa: E402

if args.role != "params":
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


def definitions():
    """What genmsg needs to read a type: its context and where packages are."""
    import genmsg.msg_loader
    folder = args.definitions
    packages = {name: [os.path.join(folder, name, "msg")] for name in os.listdir(folder)}
    search = {name: [f"/usr/share/{name}/msg"] for name in ("std_msgs", "geometry_msgs", "sensor_msgs")}
    return genmsg.msg_loader.MsgContext.create_default(), {**search, **packages}


def generated(context, spec, search):
    """The class of a message that no package has compiled."""
    import genmsg.gentools
    import genmsg.msg_loader
    import genpy.dynamic
    genmsg.msg_loader.load_depends(context, spec, search)
    full = spec.full_name
    made = genpy.dynamic.generate_dynamic(full, genmsg.gentools.compute_full_text(context, spec))
    # genpy looks for the classes of fields in packages: these are as if they were installed.
    for name, kind in made.items():
        package, name = name.split("/")
        if os.path.isdir(os.path.join(args.definitions, package)):
            module = sys.modules.setdefault(package, types.ModuleType(package))
            module.msg = sys.modules.setdefault(package + ".msg", types.ModuleType(package + ".msg"))
            setattr(module.msg, name, kind)
    return made[full]


def message_class():
    if args.definition:
        import genpy.dynamic
        with open(args.definition) as file:
            return genpy.dynamic.generate_dynamic(args.type, file.read())[args.type]
    if not args.definitions:
        return roslib.message.get_message_class(args.type)
    import genmsg.msg_loader
    context, search = definitions()
    return generated(context, genmsg.msg_loader.load_msg_by_type(context, args.type, search), search)


def service_class():
    if not args.definitions:
        return roslib.message.get_service_class(args.type)
    import genmsg.gentools
    import genmsg.msg_loader
    context, search = definitions()
    package, name = args.type.split("/")
    file = os.path.join(args.definitions, package, "srv", name + ".srv")
    spec = genmsg.msg_loader.load_srv_from_file(context, file, args.type)
    request = generated(context, spec.request, search)
    response = generated(context, spec.response, search)
    return type(name, (), {"_type": args.type, "_md5sum": genmsg.gentools.compute_md5(context, spec),
                           "_request_class": request, "_response_class": response})


def filled(message, value):
    genpy.message.fill_message_args(message, [value])
    return message


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
        message = filled(kind(), json.loads(args.value.replace("{n}", str(index))))
        publisher.publish(message)
        say("message", index=index, value=plain(message))
        index += 1
        leaving.wait(1.0 / args.rate)
    say("done", count=index)
    leaving.wait()
elif args.role == "bag":
    import rosbag
    kind = message_class()
    with rosbag.Bag(args.bag, "w") as bag:
        for index in range(args.count):
            message = filled(kind(), json.loads(args.value.replace("{n}", str(index))))
            bag.write(args.topic, message, rospy.Time.from_sec(1_700_000_000 + index / args.rate))
    say("done", count=args.count)
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
    while subscriber.get_num_connections() == 0 and not leaving.is_set():
        leaving.wait(0.01)
    say("matched")
    leaving.wait()
elif args.role == "serve" and args.value:
    kind = service_class()

    def answer(request):
        say("message", index=0, value=plain(request))
        value = json.loads(args.value)
        computed = {name: one for name, one in value.items() if isinstance(one, str) and one.startswith("=")}
        response = filled(kind._response_class(), {name: one for name, one in value.items() if name not in computed})
        for name, one in computed.items():
            setattr(response, name, eval(one[1:], {"request": request}))  # the test's own words
        return response

    service = rospy.Service(args.topic, kind, answer)
    say("ready")
    leaving.wait()
elif args.role == "call":
    kind = service_class()
    say("ready")
    rospy.wait_for_service(args.topic)
    proxy = rospy.ServiceProxy(args.topic, kind)
    for index in range(args.count):
        try:
            say("reply", index=index, value=plain(proxy(filled(kind._request_class(), json.loads(args.value)))))
        except rospy.ServiceException as problem:
            say("reply", index=index, error=str(problem))
    say("done")
    leaving.wait()
elif args.role == "serve":
    from std_srvs.srv import SetBool, SetBoolResponse

    def answer(request):
        say("message", index=0, value=request.data)
        return SetBoolResponse(success=request.data, message="so be it" if request.data else "no")

    service = rospy.Service(args.topic, SetBool, answer)
    say("ready")
    leaving.wait()
elif args.role == "log":
    # rospy keeps its last line for who comes later.
    rospy.logwarn(args.value)
    say("message", index=0, value=args.value)
    leaving.wait()
elif args.role == "params":
    import threading

    def obey():
        for line in sys.stdin:
            for name, value in json.loads(line).items():
                if value is None:
                    rospy.delete_param(args.topic + "/" + name)
                else:
                    rospy.set_param(args.topic + "/" + name, value)
        leaving.set()

    threading.Thread(target=obey, daemon=True).start()
    say("ready")
    last = None
    while not leaving.is_set():
        now = rospy.get_param(args.topic, {})
        if now != last:
            say("message", index=0, value=now)
            last = now
        leaving.wait(0.05)
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
