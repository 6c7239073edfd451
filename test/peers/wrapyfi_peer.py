#!/usr/bin/env python3
"""The real Wrapyfi on ZeroMQ or ROS 1, as publisher or listener, client or server.

    wrapyfi_peer.py publish --type Image --flavour colour --topic /cam --pub-port P --sub-port S
    wrapyfi_peer.py listen  --type Image --flavour colour --topic /cam --pub-port P --count 3
    wrapyfi_peer.py reply   --type Image --flavour colour --topic /cam --rep-port P --req-port S
    wrapyfi_peer.py request --type Image --flavour colour --topic /cam --rep-port P --count 3
    wrapyfi_peer.py broker  --topic /cam --rep-port P --req-port S    the broker of its servers, without one
    wrapyfi_peer.py publish --mware ros --topic /x            over rospy of Debian
    wrapyfi_peer.py publish --case pint --topic /x --pub-port P --sub-port S      an object of plugins.py

Lines on stdout: {"event": "ready"}, {"event": "message", "index", "sha256", ...}, {"event": "done"}.
A publisher with --count 0 goes on until stdin closes; with a count it stays after the last message
until stdin closes, because its broker lives in it. A client sends the payload as its only argument and
tells what came back; a server returns the payload whose number is its first argument. --fails makes a client
expect an exception: {"event": "failed", "error"}.
"""
import argparse
import hashlib
import logging
import os
import sys
import threading
import traceback

FLAVOURS = {
    "NativeObject": ["small", "rich", "array", "settings"],
    "Image": ["colour", "mono", "float", "float_mono", "jpg", "jpg_mono", "red"],
    "AudioChunk": ["mono", "stereo"],
}

parser = argparse.ArgumentParser()
parser.add_argument("role", choices=["publish", "listen", "request", "reply", "broker"])
parser.add_argument("--type", default="NativeObject", choices=sorted(FLAVOURS))
parser.add_argument("--flavour")
parser.add_argument("--quality", type=int, help="of JPEG files, instead of Wrapyfi's own")
parser.add_argument("--case", help="an object of another library, by its name in plugins.py, instead of a flavour")
parser.add_argument("--bare", action="store_true", help="the case's object itself, not a dict that has it")
parser.add_argument("--cases", default="plugins", help="the module that has the case")
parser.add_argument("--topic", required=True)
parser.add_argument("--mware", default="zeromq", choices=["zeromq", "ros", "ros2", "yarp"])
parser.add_argument("--pub-port", type=int, default=0, help="XPUB side of the broker: listeners")
parser.add_argument("--sub-port", type=int, default=0, help="XSUB side of the broker: publishers")
parser.add_argument("--rep-port", type=int, default=0, help="ROUTER side of the broker: clients")
parser.add_argument("--req-port", type=int, default=0, help="DEALER side of the broker: servers")
parser.add_argument("--number", action="store_true", help="calls have their number as argument, not the payload")
parser.add_argument("--fails", action="store_true", help="calls must raise")
parser.add_argument("--count", type=int, default=0, help="0: until stdin closes")
parser.add_argument("--rate", type=float, default=20.0)
parser.add_argument("--no-broker", action="store_true")
parser.add_argument("--no-wait", action="store_true", help="should_wait=False")
args = parser.parse_args()
flavour = args.flavour or FLAVOURS[args.type][0]
if flavour not in FLAVOURS[args.type]:
    parser.error(f"{args.type} has no flavour {flavour!r}; it has {', '.join(FLAVOURS[args.type])}")

logging.basicConfig(stream=sys.stderr, level=logging.WARNING)
case = None
if args.case:
    import importlib
    cases = importlib.import_module(args.cases)
    case = cases.load(args.case)
import cv2  # noqa: E402
if args.mware == "ros":
    import rospy_in_venv  # noqa: E402,F401
import numpy as np  # noqa: E402
import wrapyfi  # noqa: E402
from wrapyfi.connect.wrapper import MiddlewareCommunicator  # noqa: E402

import payload  # noqa: E402
from lines import leave, leaving, say, watch_stdin  # noqa: E402

# The broker and the monitor run as threads of this process, so that nothing outlives it.
options = {"should_wait": not args.no_wait, "socket_ip": os.environ["WRAPYFI_ZEROMQ_SOCKET_IP"]}
if args.role in ("publish", "listen"):
    options.update(socket_pub_port=args.pub_port, pubsub_monitor_listener_spawn="thread")
else:
    options.update(socket_rep_port=args.rep_port)
if args.role == "publish":
    options.update(socket_sub_port=args.sub_port, start_proxy_broker=not args.no_broker,
                   proxy_broker_spawn="thread")
elif args.role == "reply":
    options.update(socket_req_port=args.req_port, start_proxy_broker=not args.no_broker,
                   proxy_broker_spawn="thread")
if args.mware == "ros":
    # Its test of a publisher's connection is inverted: it waits for nobody.
    options = {"should_wait": args.role not in ("publish",)}
channels, rate = (2 if flavour == "stereo" else 1), 16000
frames = 441
if args.type == "Image":
    jpg = flavour.startswith("jpg") and (True if args.quality is None else {"quality": args.quality})
    options.update(rgb="mono" not in flavour, fp=flavour.startswith("float"), jpg=jpg)
elif args.type == "AudioChunk":
    options.update(channels=channels, rate=rate, chunk=frames)


def make(seq):
    if case:
        return case.make(seq) if args.bare else {"object": case.make(seq)}
    if args.type == "Image":
        return payload.image(seq, flavour)
    if args.type == "AudioChunk":
        return payload.audio(seq, frames, channels), rate
    return payload.native(seq, flavour)


class Peer(MiddlewareCommunicator):
    @MiddlewareCommunicator.register(args.type, args.mware, "Peer", args.topic, **options)
    def exchange(self, seq=0):
        return (make(seq),)


def facts(value):
    """What identifies a message: hash and shape; for a JPEG sent also hashes of file and decoded pixels."""
    found = {}
    if case:
        found["facts"] = case.facts(value if args.bare else value["object"])
        if "pixels" in found["facts"]:
            found["pixels"] = found["facts"]["pixels"]
        return {**found, "sha256": cases.digest(found["facts"])}
    if args.type == "AudioChunk":
        value, found["rate"] = value[0], int(value[1])
    if isinstance(value, np.ndarray):
        found.update(dtype=value.dtype.str, shape=list(value.shape), mean=float(value.mean()))
        if value.ndim == 3:
            found["channel_means"] = [float(value[..., c].mean()) for c in range(value.shape[2])]
    elif isinstance(value, dict):
        if "seq" in value:
            found["seq"] = value["seq"]
        found["value"] = payload.neutral(value)
    elif isinstance(value, str):
        found["value"] = value
    found["sha256"] = payload.digest(value)
    if flavour.startswith("jpg") and args.role in ("publish", "reply"):
        from wrapyfi.utils.image_encoders import JpegEncoder
        file = bytes(JpegEncoder(**(jpg if isinstance(jpg, dict) else {})).encode_jpg_image(value))
        pixels = cv2.imdecode(np.frombuffer(file, np.uint8), cv2.IMREAD_UNCHANGED)
        found.update(file_sha256=hashlib.sha256(file).hexdigest(), decoded_sha256=payload.digest(pixels))
    return found


def arrived(value):
    return value is not None and not (isinstance(value, tuple) and value[0] is None)


def main():
    if args.role == "broker":
        from wrapyfi.middlewares.zeromq import ZeroMQMiddlewareReqRep
        ZeroMQMiddlewareReqRep.activate(socket_rep_address=f"tcp://127.0.0.1:{args.rep_port}",
                                        socket_req_address=f"tcp://127.0.0.1:{args.req_port}",
                                        proxy_broker_spawn="thread")
        say("ready", role=args.role, wrapyfi=wrapyfi.__version__)
        leaving.wait()
        return
    peer = Peer()
    peer.activate_communication(peer.exchange, mode=args.role)
    say("ready", role=args.role, wrapyfi=wrapyfi.__version__)
    index = 0
    while not leaving.is_set() and (args.count == 0 or index < args.count):
        if args.role == "request":
            try:
                (value,) = peer.exchange(index if args.number else make(index))
            except Exception as error:
                if not args.fails:
                    raise
                say("failed", index=index, error=f"{type(error).__name__}: {error}")
            else:
                say("message", index=index, **facts(value))
            index += 1
            continue
        if args.role == "reply":
            (value,) = peer.exchange()
            say("message", index=index, **facts(value))
            index += 1
            continue
        (value,) = peer.exchange(seq=index) if args.role == "publish" else peer.exchange()
        if args.role == "publish":
            say("message", index=index, **facts(value))
            leaving.wait(1.0 / args.rate)
        elif arrived(value):
            say("message", index=index, **facts(value))
        else:
            leaving.wait(0.002)
            continue
        index += 1
    say("done", count=index)
    if args.role in ("publish", "reply"):
        leaving.wait()


if __name__ == "__main__":
    # Wrapyfi blocks in its first exchange until the other side is there, so it runs beside the main
    # thread, which waits for its end or for the order to leave.
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
