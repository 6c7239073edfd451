#!/usr/bin/env python3
"""Python Wrapyfi as server or client of an image of 640x480, obeying as bench/src/asked.rs does.

    python_requests.py asked --rep-port P --req-port S     replies, with Wrapyfi's broker, until stdin ends
    python_requests.py asker --rep-port P --req-port S     asks; orders on stdin, a report on stdout for each
"""
import argparse
import json
import logging
import os
import signal
import sys
import threading
import time

logging.disable(logging.WARNING)
import numpy as np  # noqa: E402
from wrapyfi.connect.wrapper import MiddlewareCommunicator  # noqa: E402

parser = argparse.ArgumentParser()
parser.add_argument("role", choices=["asked", "asker"])
parser.add_argument("--rep-port", type=int, required=True)
parser.add_argument("--req-port", type=int, required=True)
args = parser.parse_args()
WARM = 1


def picture(width=640, height=480):
    y, x, c = np.ogrid[:height, :width, :3]
    noise = np.random.default_rng(1).integers(0, 40, (height, width, 3))
    return ((x * (c + 1) // 5 + y // 3 + noise) % 256).astype(np.uint8)


FRAME = picture()
options = {"socket_rep_port": args.rep_port}
if args.role == "asked":
    options["socket_req_port"] = args.req_port


class Camera(MiddlewareCommunicator):
    @MiddlewareCommunicator.register("Image", "zeromq", "Camera", "/asked/image", width=640, height=480, **options)
    def picture(self):
        return FRAME,


def leave(*_):
    import multiprocessing
    for child in multiprocessing.active_children():
        child.terminate()
    os._exit(0)


def serve(camera):
    def until_the_end():
        # Not through sys.stdin: the broker, a fork of this process, would wait for its lock.
        while os.read(0, 4096):
            pass
        leave()

    threading.Thread(target=until_the_end, daemon=True).start()
    while True:
        camera.picture()


def calls(camera, count):
    latency, begin = [], time.monotonic_ns()
    for _ in range(count):
        start = time.monotonic_ns()
        (image,) = camera.picture()
        latency.append((time.monotonic_ns() - start) / 1e3)
        assert image.shape == (480, 640, 3) and image.dtype == np.uint8
    return {"sent": count, "refused": 0, "received": count, "duplicates": 0, "latency_us": latency, "latest_us": 0,
            "awake_ns": 0, "span_ns": time.monotonic_ns() - begin, "opening_ns": 0}


def ask(camera):
    for line in sys.stdin:
        order = json.loads(line)
        # The first call waits for the server however long it takes to come.
        report = calls(camera, WARM if order["do"] == "warm" else order["count"])
        print(json.dumps(report), flush=True)
    leave()


signal.signal(signal.SIGTERM, leave)
camera = Camera()
if args.role == "asked":
    camera.activate_communication(camera.picture, mode="reply")
    serve(camera)
else:
    camera.activate_communication(camera.picture, mode="request")
    ask(camera)
