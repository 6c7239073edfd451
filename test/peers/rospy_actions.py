#!/usr/bin/python3
"""Servers and clients of Fibonacci actions on rospy's actionlib, with Debian's Python.

    rospy_actions.py serve --action /fib [--step S] [--behave reject|abort|refuse_cancel|pend]
    rospy_actions.py send  --action /fib --order N [--goals M] [--cancel-after K] [--count N]
    …                      --type demo/Count --part int32-x,int32-y          another name, results with a field `part`

The type is test_msgs/Fibonacci, which no package of ROS 1 has: genpy makes its classes on the spot. Options and lines on stdout are
those of rclpy_actions.py; states are those of actionlib, in small letters. A server that pends takes no goal up, and recalls the
cancelled ones; one of several goals tells the stamp of each in nanoseconds.
"""
import argparse
import threading
import time

parser = argparse.ArgumentParser()
parser.add_argument("role", choices=["serve", "send"])
parser.add_argument("--action", default="/fib")
parser.add_argument("--order", type=int, default=5)
parser.add_argument("--step", type=float, default=0.05)
parser.add_argument("--behave", default="reach", choices=["reach", "reject", "abort", "refuse_cancel", "pend"])
parser.add_argument("--goals", type=int, default=1)
parser.add_argument("--count", type=int, default=1)
parser.add_argument("--cancel-after", type=int, default=0, help="0: never")
parser.add_argument("--type", default="test_msgs/Fibonacci")
parser.add_argument("--part", default="", help="fields, with commas between, of a message that results have beside")
args = parser.parse_args()

import actionlib  # noqa: E402
import actionlib.action_server  # noqa: E402
import actionlib_msgs.msg  # noqa: E402
import genpy.dynamic  # noqa: E402
import rospy  # noqa: E402
from lines import leave, leaving, say, watch_stdin  # noqa: E402

HEADER = "MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
GOAL_ID = "MSG: actionlib_msgs/GoalID\ntime stamp\nstring id\n"
STATUS = "MSG: actionlib_msgs/GoalStatus\n" + actionlib_msgs.msg.GoalStatus._full_text.split("=" * 80)[0]
LINE = "=" * 80 + "\n"
STATES = {value: name.lower() for name, value in vars(actionlib_msgs.msg.GoalStatus).items()
          if name.isupper() and isinstance(value, int)}


def of(part, fields):
    """Class of a part, and of the message that carries it."""
    first = "actionlib_msgs/GoalID goal_id" if part == "Goal" else "actionlib_msgs/GoalStatus status"
    nested = [HEADER, GOAL_ID] if part == "Goal" else [HEADER, GOAL_ID, STATUS]
    name = f"{args.type}{part}"
    text = f"std_msgs/Header header\n{first}\n{name.split('/')[1]} {part.lower()}\n"
    text = text.replace("std_msgs/Header", "Header")
    if args.part and part == "Result":
        fields += "\nPart part"
        nested.append(f"MSG: {args.type.split('/')[0]}/Part\n" + args.part.translate(str.maketrans("-,", " \n")) + "\n")
    text += "".join(LINE + part for part in nested + [f"MSG: {name}\n{fields}\n"])
    made = genpy.dynamic.generate_dynamic(f"{args.type}Action{part}", text)
    return made[f"{args.type}Action{part}"], made[name]


ACTION_GOAL, GOAL = of("Goal", "int32 order")
ACTION_RESULT, RESULT = of("Result", "int32[] sequence")
ACTION_FEEDBACK, FEEDBACK = of("Feedback", "int32[] sequence")


class Fibonacci:
    """The message that holds the three, as actionlib wants it."""

    def __init__(self):
        self.action_goal, self.action_result, self.action_feedback = ACTION_GOAL(), ACTION_RESULT(), ACTION_FEEDBACK()


watch_stdin()
rospy.init_node("rospy_actions", anonymous=True, disable_signals=True)


def serve_simply():
    def execute(goal):
        say("goal", order=goal.order)
        sequence = [0, 1]
        for _ in range(goal.order):
            if server.is_preempt_requested() and args.behave != "refuse_cancel":
                say("end", state="preempted")
                server.set_preempted(RESULT(sequence=sequence))
                return
            sequence.append((sequence[-1] + sequence[-2]) % (1 << 31))
            server.publish_feedback(FEEDBACK(sequence=sequence))
            time.sleep(args.step)
        end = server.set_aborted if args.behave == "abort" else server.set_succeeded
        say("end", state="aborted" if args.behave == "abort" else "succeeded")
        end(RESULT(sequence=sequence), "because")

    server = actionlib.SimpleActionServer(args.action, Fibonacci, execute_cb=execute, auto_start=False)
    server.start()
    return server


def serve_many():
    """Has many goals at once, or takes none."""
    def run(handle):
        goal = handle.get_goal()
        sequence = [0, 1]
        for _ in range(goal.order):
            sequence.append((sequence[-1] + sequence[-2]) % (1 << 31))
            handle.publish_feedback(FEEDBACK(sequence=sequence))
            time.sleep(args.step)
        say("end", state="succeeded")
        handle.set_succeeded(RESULT(sequence=sequence))

    def on_goal(handle):
        say("goal", order=handle.get_goal().order, stamp=handle.get_goal_id().stamp.to_nsec())
        if args.behave == "reject":
            handle.set_rejected(RESULT(), "not today")
            return
        if args.behave == "pend":
            return
        handle.set_accepted()
        threading.Thread(target=run, args=(handle,), daemon=True).start()

    def on_cancel(handle):
        say("cancel")
        if args.behave == "pend":
            handle.set_canceled(RESULT(), "recalled")

    server = actionlib.ActionServer(args.action, Fibonacci, on_goal, on_cancel, auto_start=False)
    server.start()
    return server


def send_all():
    client = actionlib.ActionClient(args.action, Fibonacci)
    while not client.wait_for_server(rospy.Duration(0.5)):
        if leaving.is_set():
            return
    say("ready")
    done, index, kept = threading.Semaphore(0), 0, []

    def send(index):
        seen, begun = {"feedback": 0, "accepted": False, "ended": False}, time.monotonic()

        def on_state(handle):
            state = handle.get_comm_state()
            name = actionlib.CommState.to_string(state)
            if name == "ACTIVE" and not seen["accepted"]:
                seen["accepted"] = True
                say("accepted", index=index, accepted=True, ms=round(1e3 * (time.monotonic() - begun), 3))
            if name == "PREEMPTING":
                say("canceling", index=index)
            if name == "DONE" and not seen["ended"]:
                seen["ended"] = True
                result = handle.get_result()
                say("end", index=index, state=STATES.get(handle.get_terminal_state()),
                    text=handle.get_goal_status_text(), sequence=list(result.sequence) if result else [])
                done.release()

        def on_feedback(handle, feedback):
            seen["feedback"] += 1
            say("feedback", index=index, sequence=list(feedback.sequence))
            if seen["feedback"] == args.cancel_after:
                handle.cancel()

        kept.append(client.send_goal(GOAL(order=args.order), on_state, on_feedback))

    for _ in range(args.count):
        for _ in range(args.goals):
            send(index)
            index += 1
        for _ in range(args.goals):
            while not done.acquire(timeout=0.2):
                if leaving.is_set():
                    return
    say("done")


if args.role == "serve":
    server = serve_many() if args.behave in ("reject", "pend") or args.goals > 1 else serve_simply()
    say("ready")
else:
    threading.Thread(target=send_all, daemon=True).start()
leaving.wait()
leave()
