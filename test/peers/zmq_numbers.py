#!/usr/bin/env python3
"""Numbers over bare pyzmq, in the frames of Wrapyfi's native objects: quick to start, where many are killed.

    zmq_numbers.py publish   --topic /x --text z1:{n} --rate 50
    zmq_numbers.py subscribe --topic /x
    zmq_numbers.py round     --topic /x --count 100    a number on each of /x_0, /x_1, ... in turn
    zmq_numbers.py crowd     --topic /x --count 100    a socket for each of them

Ports are those of the broker in WRAPYFI_ZEROMQ_SOCKET_PUB_PORT and _SUB_PORT. Lines on stdout: `ready`,
`message` with `value`; of a crowd `heard`, with the number of messages that came to the socket that heard the
fewest (`least`).
"""
import argparse
import json
import os

import zmq

from lines import leave, leaving, say, watch_stdin

parser = argparse.ArgumentParser()
parser.add_argument("role", choices=["publish", "subscribe", "round", "crowd"])
parser.add_argument("--topic", required=True)
parser.add_argument("--text", default="{n}")
parser.add_argument("--rate", type=float, default=20.0)
parser.add_argument("--count", type=int, default=1)
args = parser.parse_args()
watch_stdin()
port = {side: os.environ[f"WRAPYFI_ZEROMQ_SOCKET_{side}_PORT"] for side in ("PUB", "SUB")}
if args.role in ("publish", "round"):
    is_round = args.role == "round"
    topics = [f"{args.topic}_{topic}" for topic in range(args.count)] if is_round else [args.topic]
    socket = zmq.Context().socket(zmq.PUB)
    socket.connect(f"tcp://127.0.0.1:{port['SUB']}")
    say("ready")
    number = 0
    while not leaving.wait(1 / args.rate):
        text = args.text.replace("{n}", str(number))
        for topic in topics:
            socket.send_multipart([topic.encode(), json.dumps(text).encode()])
        if not is_round:
            say("message", value=text)
        number += 1
elif args.role == "crowd":
    context, poller, heard = zmq.Context(), zmq.Poller(), {}
    for topic in range(args.count):
        socket = context.socket(zmq.SUB)
        socket.subscribe(f"{args.topic}_{topic}".encode())
        socket.connect(f"tcp://127.0.0.1:{port['PUB']}")
        poller.register(socket, zmq.POLLIN)
        heard[socket] = 0
    say("ready")
    least = 0
    while not leaving.is_set():
        for socket, _ in poller.poll(100):
            socket.recv_multipart()
            heard[socket] += 1
        if min(heard.values()) != least:
            least = min(heard.values())
            say("heard", least=least)
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
