#!/usr/bin/python3
"""What bench/src/tcpros stands beside, with Debian's Python.

    rospy_relay.py master --port P              a roscore: master and parameter server
    rospy_relay.py relay /from /to [/from /to]  a rospy node that passes messages on as they are

The relay knows no type, so it neither reads nor writes fields: rospy cannot relay with less. Both end when
stdin does, and print {"ready": true} before.
"""
import argparse
import json
import os
import sys
import threading

parser = argparse.ArgumentParser()
parser.add_argument("role", choices=["master", "relay"])
parser.add_argument("--port", type=int, default=0)
parser.add_argument("--node", default="rospy_relay")
parser.add_argument("topics", nargs="*")
args = parser.parse_args()


def ready():
    print(json.dumps({"ready": True}), flush=True)


def end_with_stdin():
    while os.read(sys.stdin.fileno(), 4096):
        pass
    os._exit(0)


threading.Thread(target=end_with_stdin, daemon=True).start()
if args.role == "master":
    import rosmaster.master
    rosmaster.master.Master(args.port, num_workers=3).start()
else:
    import rospy
    rospy.init_node(args.node, disable_signals=True)
    for there, here in zip(args.topics[::2], args.topics[1::2]):
        publisher = rospy.Publisher(here, rospy.AnyMsg, queue_size=100, tcp_nodelay=True)
        rospy.Subscriber(there, rospy.AnyMsg, publisher.publish, queue_size=100, buff_size=1 << 24, tcp_nodelay=True)
ready()
threading.Event().wait()
