#!/usr/bin/env python3
"""Bare sockets with CURVE, as pyzmq has it, and the certificates that it writes.

    curve_peer.py keys --dir D --names a,b        certificates D/a.key, D/a.key_secret, …
    curve_peer.py pub|sub|req|rep --port P --topic T [--dir D --key a --server s]

Without --key the socket has no security. Each event of its handshake is {"event": "handshake", "ok", "code"}; each
message, request or reply {"event": "heard", "text"}.
"""
import argparse
import os
import threading

import zmq
import zmq.auth
from zmq.utils.monitor import recv_monitor_message

from lines import leave, leaving, say, watch_stdin

FAILED = (zmq.EVENT_HANDSHAKE_FAILED_AUTH, zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL, zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL)


def keys(args):
    for name in args.names.split(","):
        public, secret = zmq.auth.create_certificates(args.dir, name)
        os.chmod(secret, 0o600)
        say("key", name=name, public=zmq.auth.load_certificate(public)[0].decode())
    say("done")


def watch(socket):
    monitor = socket.get_monitor_socket()

    def run():
        while True:
            event = recv_monitor_message(monitor)
            if event["event"] == zmq.EVENT_HANDSHAKE_SUCCEEDED:
                say("handshake", ok=True, code=0)
            elif event["event"] in FAILED:
                say("handshake", ok=False, code=event["value"])
            elif event["event"] == zmq.EVENT_DISCONNECTED:
                say("disconnected")

    threading.Thread(target=run, daemon=True).start()


def open_socket(args, kind):
    socket = zmq.Context.instance().socket(kind)
    socket.linger = 0
    if args.key:
        socket.curve_publickey, socket.curve_secretkey = zmq.auth.load_certificate(
            os.path.join(args.dir, f"{args.key}.key_secret"))
        socket.curve_serverkey, _ = zmq.auth.load_certificate(os.path.join(args.dir, f"{args.server}.key"))
    watch(socket)
    if kind == zmq.SUB:
        socket.subscribe(args.topic.encode())
    socket.connect(f"tcp://127.0.0.1:{args.port}")
    return socket


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("role", choices=["keys", "pub", "sub", "req", "rep"])
    for name in ("--dir", "--names", "--topic", "--key", "--server"):
        parser.add_argument(name)
    parser.add_argument("--port", type=int)
    parser.add_argument("--bytes", type=int, default=0, help="more bytes in each message")
    args = parser.parse_args()
    watch_stdin()
    if args.role == "keys":
        keys(args)
        leave()
    kinds = {"pub": zmq.PUB, "sub": zmq.SUB, "req": zmq.REQ, "rep": zmq.REP}
    socket = open_socket(args, kinds[args.role])
    number = 0
    while not leaving.is_set():
        number += 1
        text = f'{{"seq": {number}, "more": "{"x" * args.bytes}"}}'.encode()
        if args.role == "pub":
            socket.send_multipart([args.topic.encode(), text])
            leaving.wait(0.02)
        elif args.role == "req":
            socket.send(b'{"args": [], "kwargs": {}}')
            while not leaving.is_set() and not socket.poll(100):
                pass
        elif args.role == "rep":
            while not leaving.is_set() and not socket.poll(100):
                pass
        if args.role != "pub" and socket.poll(100):
            frames = socket.recv_multipart()
            say("heard", topic=frames[0].decode(errors="replace"), text=frames[-1].decode(errors="replace")[:200],
                bytes=sum(map(len, frames)))
            if args.role == "rep":
                socket.send(b"[42]")
            elif args.role == "req":
                break
    leave()


main()
