#!/usr/bin/env python3
"""A chain of methods, the twin of examples/communicator/src/bin/forwarding.rs.

    python test/peers/forwarding.py --role source --mware_a zeromq
    python test/peers/forwarding.py --role sink --mware_b zeromq
"""
import argparse
import os
import time

# A broker runs already: `wrapyfi broker`, or a publisher in Rust.
os.environ.setdefault("WRAPYFI_ZEROMQ_START_PROXY_BROKER", "False")
os.environ.setdefault("WRAPYFI_ZEROMQ_PUBSUB_MONITOR_LISTENER_SPAWN", "thread")

from wrapyfi.connect.wrapper import MiddlewareCommunicator  # noqa: E402

MODES = {"source": ("publish", "disable"), "forward": ("listen", "publish"), "sink": ("disable", "listen")}

parser = argparse.ArgumentParser()
parser.add_argument("--role", choices=sorted(MODES), required=True)
parser.add_argument("--mware_a", default="zeromq")
parser.add_argument("--mware_b", default="zeromq")
args = parser.parse_args()


class ForwardCls(MiddlewareCommunicator):
    @MiddlewareCommunicator.register("NativeObject", "$mware", "ForwardCls", "/example/native_a_msg", should_wait=True)
    def send_a(self, mware=None, msg=""):
        return msg,

    @MiddlewareCommunicator.register("NativeObject", "$mware", "ForwardCls", "/example/native_b_msg", should_wait=True)
    def send_b(self, mware=None, msg=""):
        return msg,


def main():
    chain = ForwardCls()
    first, second = MODES[args.role]
    chain.activate_communication(chain.send_a, mode=first)
    chain.activate_communication(chain.send_b, mode=second)
    number = 0
    while True:
        number += 1
        if args.role == "source":
            msg, = chain.send_a(mware=args.mware_a, msg=f"message {number}")
        elif args.role == "forward":
            msg, = chain.send_a(mware=args.mware_a)
            if msg is not None:
                msg, = chain.send_b(mware=args.mware_b, msg=msg)
        else:
            msg, = chain.send_b(mware=args.mware_b)
        if msg is not None:
            print(msg, flush=True)
        time.sleep(0.005)


if __name__ == "__main__":
    main()
