#!/usr/bin/env python3
"""Sends poses to one topic and prints what comes back on another.

    WRAPYFI_PLUGIN_PATHS=examples/pose_plugin/python python examples/pose_plugin/python/poses.py /poses /mirrored
"""
import sys
import threading

import wrapyfi.utils.core_utils  # noqa: F401  loads the plug-ins
from wrapyfi.connect.wrapper import MiddlewareCommunicator

Pose = next(kind for kind in wrapyfi.utils.core_utils.PluginRegistrar.encoder_registry if kind.__name__ == "Pose")
there, back = sys.argv[1:3]


class Sender(MiddlewareCommunicator):
    @MiddlewareCommunicator.register("NativeObject", "zeromq", "Sender", there, should_wait=True,
                                     start_proxy_broker=False, pubsub_monitor_listener_spawn="thread")
    def send(self, step):
        return (Pose(float(step), 2.0 * step, 0.1),)


class Receiver(MiddlewareCommunicator):
    @MiddlewareCommunicator.register("NativeObject", "zeromq", "Receiver", back, should_wait=False,
                                     pubsub_monitor_listener_spawn="thread")
    def receive(self):
        return (None,)


def main():
    sender, receiver = Sender(), Receiver()
    sender.activate_communication(sender.send, mode="publish")
    receiver.activate_communication(receiver.receive, mode="listen")
    pause = threading.Event()
    step = 0
    while True:
        (pose,) = receiver.receive()
        if pose is not None:
            print(type(pose).__name__, pose, flush=True)
        sender.send(step)
        step += 1
        pause.wait(0.05)


if __name__ == "__main__":
    main()
