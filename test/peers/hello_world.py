#!/usr/bin/env python3
"""Wrapyfi's hello world, the twin of examples/communicator/src/bin/hello_world.rs.

    python test/peers/hello_world.py --mode publish     asks for messages
    python test/peers/hello_world.py --mode listen      prints what was typed elsewhere
    python test/peers/hello_world.py --mode request     asks a program in mode reply, which asks its user
"""
import argparse
import json
import os
import time

# A broker runs already: `wrapyfi broker`, or a publisher in Rust.
os.environ.setdefault("WRAPYFI_ZEROMQ_START_PROXY_BROKER", "False")
os.environ.setdefault("WRAPYFI_ZEROMQ_PUBSUB_MONITOR_LISTENER_SPAWN", "thread")

import zmq  # noqa: E402
from wrapyfi.connect.wrapper import MiddlewareCommunicator  # noqa: E402

from lines import leave  # noqa: E402

parser = argparse.ArgumentParser()
parser.add_argument("--mode", default=None)
parser.add_argument("--mware", default="zeromq")
parser.add_argument("--msg", default="hello")
args = parser.parse_args()


class MirrorCls(MiddlewareCommunicator):
    @MiddlewareCommunicator.register("NativeObject", "$0", "MirrorCls", "/example/read_msg",
                                     carrier="tcp", should_wait="$blocking")
    def read_msg(self, mware, msg="", blocking=True):
        try:
            msg_ip = input("Type message: ")
        except EOFError:
            msg_ip = "exit"
        obj = {"msg": msg, "msg_ip": msg_ip}
        return obj,


def main():
    mirror = MirrorCls()
    mirror.activate_communication("read_msg", mode=args.mode)
    while True:
        # As Wrapyfi's own example of mirroring asks: without what has a default.
        if args.mode == "request":
            message, = mirror.read_msg(args.mware, msg=args.msg)
        else:
            message, = mirror.read_msg(args.mware, msg=args.msg, blocking=True)
        if message is None:
            time.sleep(0.005)
            continue
        print("Method result:", json.dumps(message, separators=(",", ":")), flush=True)
        if message["msg_ip"] == "exit":
            if args.mode == "reply":
                # The last reply may still be in the socket.
                zmq.Context.instance().destroy(linger=10_000)
            leave()


if __name__ == "__main__":
    main()
