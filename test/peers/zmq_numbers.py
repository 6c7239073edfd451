#!/usr/bin/env python3
"""Numbers over bare pyzmq, in the frames of Wrapyfi's native objects: quick to start, where many are killed.

    zmq_numbers.py publish   --topic /x --text z1:{n} --rate 50
    zmq_numbers.py subscribe --topic /x

Ports are those of the broker in WRAPYFI_ZEROMQ_SOCKET_PUB_PORT and _SUB_PORT. Lines on stdout: `ready`,
`message` with `value`.
"""
import argparse
import json
import os

import zmq

from lines import leave, leaving, say, watch_stdin

parser = argparse.ArgumentParser()
parser.add_argument("role", choices=["publish", "subscribe"])
parser.add_argument("--topic", required=True)
parser.add_argument("--text", default="{n}")
parser.add_argument("--rate", type=float, default=20.0)
args = parser.parse_args()
watch_stdin()
port = {side: os.environ[f"WRAPYFI_ZEROMQ_SOCKET_{side}_PORT"] for side in ("PUB", "SUB")}
if args.role == "publish":
    socket = zmq.Context().socket(zmq.PUB)
    socket.connect(f"tcp://127.0.0.1:{port['SUB']}")
    say("ready")
    number = 0
    while not leaving.wait(1 / args.rate):
        text = args.text.replace("{n}", str(number))
        socket.send_multipart([args.topic.encode(), json.dumps(text).encode()])
        say("message", value=text)
        number += 1
else:
    socket = zmq.Context().socket(zmq.SUB)
    socket.subscribe(args.topic.encode())
    socket.connect(f"tcp://127.0.0.1:{port['PUB']}")
    say("ready")
    while not leaving.is_set():
        if socket.poll(100):
            topic, body = socket.recv_multipart()
            if topic == args.topic.encode():
                say("message", value=json.loads(body))
leave()
