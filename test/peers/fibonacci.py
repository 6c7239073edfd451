#!/usr/bin/env python3
"""A function of the real Wrapyfi on ZeroMQ, as a script of a user has it: what it works on it publishes while it works.

    fibonacci.py [--own-broker]

`fibonacci(order)` returns {"sequence": [0, 1, 1, …]}, and publishes each number more on /fibonacci/progress. An order below zero
raises ValueError, which ends the script, as Wrapyfi has no form for it. Lines on stdout: {"event": "ready"}, then {"event": "goal", "order"}
for each call. --own-broker starts the broker of requests in this script, as Wrapyfi does by itself.
"""
import argparse
import logging
import os
import sys
import time

parser = argparse.ArgumentParser()
parser.add_argument("--own-broker", action="store_true")
parser.add_argument("--step", type=float, default=0.05, help="seconds that each number takes")
args = parser.parse_args()
logging.basicConfig(stream=sys.stderr, level=logging.WARNING)

import numpy as np  # noqa: E402
from wrapyfi.connect.wrapper import MiddlewareCommunicator  # noqa: E402

from lines import leave, say, watch_stdin  # noqa: E402

progress = {"start_proxy_broker": False, "pubsub_monitor_listener_spawn": "thread"}
# As a thread, so that it ends with this process at once.
function = {"start_proxy_broker": args.own_broker, "proxy_broker_spawn": "thread"}


class Fibonacci(MiddlewareCommunicator):
    @MiddlewareCommunicator.register("NativeObject", "zeromq", "Fibonacci", "/fibonacci", **function)
    def fibonacci(self, order):
        say("goal", order=order)
        if order < 0:
            raise ValueError(f"order is {order}, which is below zero")
        sequence = [0, 1]
        for _ in range(order):
            sequence.append(sequence[-1] + sequence[-2])
            self.progress(sequence)
            time.sleep(args.step)
        return {"sequence": np.array(sequence, dtype=np.int32)},

    @MiddlewareCommunicator.register("NativeObject", "zeromq", "Fibonacci", "/fibonacci/progress", **progress)
    def progress(self, sequence):
        return {"sequence": sequence},


watch_stdin()
robot = Fibonacci()
robot.activate_communication(robot.fibonacci, mode="reply")
robot.activate_communication(robot.progress, mode="publish")
say("ready")
try:
    while True:
        robot.fibonacci(0)
except ValueError as error:
    print(error, file=sys.stderr)
    leave(1)
