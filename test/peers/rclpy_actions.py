"""Servers and clients of Fibonacci actions on rclpy, with the Python of a real ROS 2.

    rclpy_actions.py serve --action /fib [--step S] [--behave reject|abort|refuse_cancel]
    rclpy_actions.py send  --action /fib --order N [--goals M] [--cancel-after K] [--cancel-accepted] [--count N]
    rclpy_actions.py watch --action /fib

A goal of order N has a feedback every S seconds and ends with the sequence of N + 2 numbers. `send` sends M goals at once,
N times one after the other, and cancels each after K messages of its feedback, or once it is accepted. `watch` comes late: it asks
for the kept status and says {"event": "status", "states": [STATE, …]}. Lines on stdout: {"event": "ready"};
of a server `goal`, `cancel` and `end`; of a client `accepted` with the time from sending the goal, `feedback`, `canceling` and `end`,
each with the index of the goal.
"""
import argparse
import threading
import time

parser = argparse.ArgumentParser()
parser.add_argument("role", choices=["serve", "send", "watch"])
parser.add_argument("--action", default="/fib")
parser.add_argument("--order", type=int, default=5)
parser.add_argument("--step", type=float, default=0.05)
parser.add_argument("--behave", default="reach", choices=["reach", "reject", "abort", "refuse_cancel"])
parser.add_argument("--goals", type=int, default=1)
parser.add_argument("--count", type=int, default=1)
parser.add_argument("--cancel-after", type=int, default=0, help="0: never")
parser.add_argument("--cancel-accepted", action="store_true")
args = parser.parse_args()

import rclpy  # noqa: E402
import rclpy.action  # noqa: E402
import rclpy.callback_groups  # noqa: E402
import rclpy.executors  # noqa: E402
import rclpy.node  # noqa: E402
import rclpy.qos  # noqa: E402
from action_msgs.msg import GoalStatus, GoalStatusArray  # noqa: E402
from lines import leave, leaving, say, watch_stdin  # noqa: E402
from test_msgs.action import Fibonacci  # noqa: E402


STATES = {GoalStatus.STATUS_SUCCEEDED: "succeeded", GoalStatus.STATUS_ABORTED: "aborted",
          GoalStatus.STATUS_CANCELED: "canceled", GoalStatus.STATUS_UNKNOWN: "unknown"}

watch_stdin()
rclpy.init(args=[])
node = rclpy.node.Node("rclpy_actions")
executor = rclpy.executors.MultiThreadedExecutor(8)
executor.add_node(node)
group = rclpy.callback_groups.ReentrantCallbackGroup()


def execute(handle):
    order = handle.request.order
    say("goal", order=order)
    sequence = [0, 1]
    for _ in range(order):
        if handle.is_cancel_requested:
            handle.canceled()
            say("end", state="canceled")
            return Fibonacci.Result(sequence=sequence)
        sequence.append((sequence[-1] + sequence[-2]) % (1 << 31))
        handle.publish_feedback(Fibonacci.Feedback(sequence=sequence))
        time.sleep(args.step)
    if args.behave == "abort":
        handle.abort()
    else:
        handle.succeed()
    say("end", state="aborted" if args.behave == "abort" else "succeeded")
    return Fibonacci.Result(sequence=sequence)


def on_goal(_request):
    reject = args.behave == "reject"
    return rclpy.action.GoalResponse.REJECT if reject else rclpy.action.GoalResponse.ACCEPT


def on_cancel(_handle):
    say("cancel")
    refuse = args.behave == "refuse_cancel"
    return rclpy.action.CancelResponse.REJECT if refuse else rclpy.action.CancelResponse.ACCEPT


def send(client, index, done):
    feedbacks, handles = [0], []

    def on_feedback(message):
        feedbacks[0] += 1
        say("feedback", index=index, sequence=list(message.feedback.sequence))
        if feedbacks[0] == args.cancel_after and handles:
            handles[0].cancel_goal_async().add_done_callback(on_canceling)

    def on_canceling(future):
        response = future.result()
        say("canceling", index=index, code=response.return_code, goals=len(response.goals_canceling))

    def on_result(future):
        answer = future.result()
        say("end", index=index, state=STATES.get(answer.status, str(answer.status)), sequence=list(answer.result.sequence))
        done.release()

    def on_accepted(future):
        handle = future.result()
        say("accepted", index=index, accepted=handle.accepted, ms=round(1e3 * (time.monotonic() - begun), 3))
        if not handle.accepted:
            done.release()
            return
        handles.append(handle)
        if args.cancel_accepted:
            handle.cancel_goal_async().add_done_callback(on_canceling)
        handle.get_result_async().add_done_callback(on_result)

    goal, begun = Fibonacci.Goal(order=args.order), time.monotonic()
    client.send_goal_async(goal, feedback_callback=on_feedback).add_done_callback(on_accepted)


def send_all(client):
    while not client.wait_for_server(timeout_sec=0.5):
        if leaving.is_set():
            return
    say("ready")
    done, index = threading.Semaphore(0), 0
    for _ in range(args.count):
        for _ in range(args.goals):
            send(client, index, done)
            index += 1
        for _ in range(args.goals):
            while not done.acquire(timeout=0.2):
                if leaving.is_set():
                    return
    say("done")


if args.role == "serve":
    server = rclpy.action.ActionServer(node, Fibonacci, args.action, execute_callback=execute, goal_callback=on_goal,
                                       cancel_callback=on_cancel, callback_group=group)
    say("ready")
elif args.role == "watch":
    watcher = node.create_subscription(
        GoalStatusArray, args.action + "/_action/status",
        lambda array: say("status", states=[one.status for one in array.status_list]), rclpy.qos.qos_profile_action_status_default)
    say("ready")
else:
    # Made before the executor spins, which reads what its constructor sets last.
    client = rclpy.action.ActionClient(node, Fibonacci, args.action, callback_group=group)
    threading.Thread(target=send_all, args=(client,), daemon=True).start()
threading.Thread(target=executor.spin, daemon=True).start()
leaving.wait()
leave()
