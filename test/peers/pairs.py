#!/usr/bin/env python3
"""Every data type in every mode, the twin of test/pairs: one method for each kind on a topic of its own.

    pairs.py --mode reemit --kinds object,jpg --way-in /a --way-out /b [--mware ros]

Lines on stdout: {"event": "message", "kind", "sent", "received"}, one for each call in which something was
sent or received. A method that was given something returns it turned around, else a message that depends on
a number that counts up.
"""
import argparse
import os

# A broker runs already: `wrapyfi broker`.
os.environ.setdefault("WRAPYFI_ZEROMQ_START_PROXY_BROKER", "False")
os.environ.setdefault("WRAPYFI_ZEROMQ_PUBSUB_MONITOR_LISTENER_SPAWN", "thread")

import datetime  # noqa: E402
import logging  # noqa: E402
import sys  # noqa: E402
import threading  # noqa: E402
import traceback  # noqa: E402

if "ros" in sys.argv:
    import rospy_in_venv  # noqa: E402,F401
import numpy as np  # noqa: E402
from wrapyfi.connect.wrapper import MiddlewareCommunicator  # noqa: E402

import payload  # noqa: E402
from lines import leave, leaving, say, watch_stdin  # noqa: E402

parser = argparse.ArgumentParser()
parser.add_argument("--mode", required=True)
parser.add_argument("--mware", default="zeromq", choices=["zeromq", "ros"])
parser.add_argument("--kinds", required=True)
parser.add_argument("--way-in", required=True)
parser.add_argument("--way-out", required=True)
args = parser.parse_args()
logging.basicConfig(stream=sys.stderr, level=logging.WARNING)

RATE = 16000
TYPES = {
    "object": ("NativeObject", {}),
    "image": ("Image", {"width": 64, "height": 48}),
    "jpg": ("Image", {"jpg": True}),
    "sound": ("AudioChunk", {"rate": RATE, "channels": 2, "chunk": 441}),
    # A ROS message: a dict here, and only heard.
    "twist": ("NativeObject", {}),
}


def make_object(seq):
    return {"seq": seq, "text": "na\u00efve \u65e5\u672c\u8a9e \U0001f680 \"quoted\" \\ \n", "e": 2.718281828459045,
            "yes": True, "nothing": None, "big": 2 ** 80 + seq, "pair": (seq, "b"), "letters": {"x"},
            "at": datetime.datetime(2025, 6, 7, 8, 9, 10, 112131),
            "matrix": np.arange(12, dtype="<i4").reshape(3, 4) * 2 + seq, "flags": np.array([True, False]),
            "half": np.float16([0.5, -2.0]), "deep": {"list": [{"tuple": (1, 2)}]}}


def make(kind, seq):
    if kind == "object":
        return make_object(seq)
    if kind == "sound":
        return payload.audio(seq, 441, 2), RATE
    if kind == "jpg":
        # One colour, which compression hardly changes; blue, green and red differ.
        return np.full((48, 64, 3), np.array([40, 120, 200]) + seq % 30, np.uint8)
    return payload.image(seq)


def arrived(value):
    return value is not None and not (isinstance(value, tuple) and value[0] is None)


def turned(kind, value):
    """What was given, turned around; nothing of nothing."""
    if not arrived(value):
        return value
    if kind == "object":
        return {"back": value}
    if kind == "sound":
        return -value[0], value[1]
    return 255 - value


def facts(kind, value):
    if not arrived(value):
        return None
    if kind == "jpg":
        return {"shape": list(value.shape), "means": [int(value[..., c].mean()) for c in range(3)]}
    return {"sha256": payload.digest(value[0] if kind == "sound" else value)}


class State:
    """What the method was given and what it made, and how often it was called."""

    def __init__(self):
        self.seq, self.given, self.made = 0, None, None


state = State()
NOTHING = object()


def exchange(kind):
    def method(self, mware="", way_in="", way_out="", given=None, prev=NOTHING):
        if given is not None:
            state.given = facts("object", given)
        if prev is NOTHING:
            state.seq += 1
            value = make(kind, state.seq)
        else:
            state.given = facts(kind, prev)
            value = turned(kind, prev)
        state.made = facts(kind, value)
        return (value,)

    # Wrapyfi keeps its registry by the names of class and method.
    method.__name__, method.__qualname__ = kind, f"Exchange.{kind}"
    data_type, options = TYPES[kind]
    # Clients and servers of Wrapyfi take no topic of one side.
    if args.mode not in ("request", "reply"):
        options = {**options, "listener_kwargs": {"in_topic": f"{args.way_in}/{kind}"},
                   "publisher_kwargs": {"out_topic": f"{args.way_out}/{kind}"}}
    # On ROS its test of a publisher's connection is inverted: it waits for nobody.
    waits = args.mware == "zeromq" or args.mode != "publish"
    if args.mware == "ros" and args.mode in ("transceive", "reemit"):
        options["publisher_kwargs"]["should_wait"] = False
    return MiddlewareCommunicator.register(
        data_type, args.mware, "Exchange", f"{args.way_in}/{kind}", should_wait=waits, **options)(method)


def main():
    kinds = args.kinds.split(",")
    node = type("Exchange", (MiddlewareCommunicator,), {kind: exchange(kind) for kind in kinds})()
    for kind in kinds:
        node.activate_communication(getattr(node, kind), mode=args.mode)
    while not leaving.is_set():
        for kind in kinds:
            state.given = state.made = None
            asked = None
            if args.mode == "request":
                state.seq += 1
                asked = make_object(state.seq)
                # Arguments are a tuple, and Wrapyfi makes lists of the tuples inside one.
                del asked["pair"], asked["deep"]
            # By place, as the twin in Rust has them: a request sends them all.
            (value,) = getattr(node, kind)(args.mware, args.way_in, args.way_out, asked)
            sent, received = state.made, state.given
            if args.mode in ("listen", "transceive", "request"):
                received = facts(kind, value)
            if args.mode == "request":
                sent = facts("object", asked)
            if sent is not None or received is not None:
                say("message", kind=kind, sent=sent, received=received)
        # What a server replies is not paced: its client is.
        leaving.wait(0 if args.mode in ("request", "reply") else 0.01)


if __name__ == "__main__":
    # Wrapyfi blocks until the other side is there, so it runs beside the main thread, which waits for the
    # order to leave.
    watch_stdin()
    outcome = []

    def guarded():
        try:
            main()
            outcome.append(0)
        except BaseException:  # the test reads the reason on stderr
            traceback.print_exc()
            outcome.append(1)

    worker = threading.Thread(target=guarded, daemon=True)
    worker.start()
    while worker.is_alive() and not leaving.is_set():
        worker.join(0.05)
    leave(outcome[0] if outcome else 0)
