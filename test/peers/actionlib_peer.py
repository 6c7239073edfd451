#!/usr/bin/python3
"""Servers and clients of actionlib, with Debian's Python.

    actionlib_peer.py serve  --topic /x [--node NAME]     a SimpleActionServer that counts to its goal
    actionlib_peer.py reject --topic /x                   an ActionServer that rejects every goal
    actionlib_peer.py deaf   --topic /x                   an ActionServer whose goals go on whatever is cancelled
    actionlib_peer.py ask    --topic /x --goal N [--cancel AT] [--goals COUNT]     a SimpleActionClient

The type is actionlib/Test, whose parts have one int32 each, called as the part. A server counts 1, 2, … up to its goal
as feedback, and returns the last; a goal below zero it aborts. A client cancels its goal at feedback AT, or at once where
that is 0. Lines on stdout: {"event": "ready"}, of a client {"event": "server"} once there is one, then {"event":
"feedback", "value"} and {"event": "ended", "state", "text", "result"}; a server says {"event": "goal", "value"} and
{"event": "preempted"}.
"""
import argparse

import actionlib
import rospy
from actionlib.msg import TestAction, TestFeedback, TestGoal, TestResult
from actionlib_msgs.msg import GoalStatus

from lines import leave, leaving, say, watch_stdin

parser = argparse.ArgumentParser()
parser.add_argument("role", choices=["serve", "reject", "deaf", "ask"])
parser.add_argument("--topic", default="/x")
parser.add_argument("--node", default="actionlib_peer")
parser.add_argument("--goal", type=int, default=3)
parser.add_argument("--goals", type=int, default=1)
parser.add_argument("--cancel", type=int, default=-1)
parser.add_argument("--rate", type=float, default=20.0)
args = parser.parse_args()

watch_stdin()
rospy.init_node(args.node, anonymous=False, disable_signals=True)


def serve():
    def execute(goal):
        say("goal", value=goal.goal)
        for value in range(1, goal.goal + 1):
            if server.is_preempt_requested() or leaving.is_set():
                say("preempted")
                server.set_preempted(TestResult(result=value), "given up")
                return
            server.publish_feedback(TestFeedback(feedback=value))
            leaving.wait(1.0 / args.rate)
        if goal.goal < 0:
            server.set_aborted(TestResult(result=goal.goal), "below zero")
        else:
            server.set_succeeded(TestResult(result=goal.goal), "counted")

    server = actionlib.SimpleActionServer(args.topic, TestAction, execute_cb=execute, auto_start=False)
    server.start()
    say("ready")
    leaving.wait()


def answer(on_goal):
    server = actionlib.ActionServer(args.topic, TestAction, on_goal, lambda handle: None, auto_start=False)
    server.start()
    say("ready")
    leaving.wait()


def reject(handle):
    handle.set_rejected(TestResult(), "no map")


def deaf(handle):
    handle.set_accepted()
    say("goal", value=handle.get_goal().goal)


def ask():
    client = actionlib.SimpleActionClient(args.topic, TestAction)
    say("ready")
    while not client.wait_for_server(rospy.Duration(0.1)):
        if leaving.is_set():
            return
    say("server")

    def heard(feedback):
        say("feedback", value=feedback.feedback)
        if feedback.feedback == args.cancel:
            client.cancel_goal()

    for _ in range(args.goals):
        client.send_goal(TestGoal(goal=args.goal), feedback_cb=heard)
        if args.cancel == 0:
            client.cancel_goal()
        while not client.wait_for_result(rospy.Duration(0.1)):
            if leaving.is_set():
                return
        result = client.get_result()
        say("ended", state=GoalStatus.to_string(client.get_state()), text=client.get_goal_status_text(),
            result=result.result if result else None)
    leaving.wait()


{"serve": serve, "ask": ask, "reject": lambda: answer(reject), "deaf": lambda: answer(deaf)}[args.role]()
rospy.signal_shutdown("done")
leave()
