#!/usr/bin/python3
"""What bench/src/routes.rs bridges, with Debian's Python.

    ros1_topics.py master --port P     a roscore: master and parameter server
    ros1_topics.py topics --count N    a rospy node that advertises /many/t0 to /many/tN

Both print {"ready": true} when they are there, and end when stdin does.
"""
import argparse
import json
import os
import sys
import threading

parser = argparse.ArgumentParser()
parser.add_argument("role", choices=["master", "topics"])
parser.add_argument("--port", type=int, default=0)
parser.add_argument("--count", type=int, default=0)
args = parser.parse_args()


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
    from std_msgs.msg import String
    rospy.init_node("many", disable_signals=True)
    publishers = [rospy.Publisher(f"/many/t{n}", String, queue_size=1) for n in range(args.count)]
print(json.dumps({"ready": True}), flush=True)
threading.Event().wait()
