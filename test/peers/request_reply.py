#!/usr/bin/env python3
"""Requests and replies, the twin of examples/communicator/src/bin/request_reply.rs.

    python test/peers/request_reply.py --mode reply
    python test/peers/request_reply.py --mode request --scale 2 1 2 6
    python test/peers/request_reply.py --mode request --picture
"""
import argparse

import example  # before wrapyfi
import numpy as np
from wrapyfi.connect.wrapper import MiddlewareCommunicator

from lines import leave, say

parser = argparse.ArgumentParser()
parser.add_argument("--mode", default=None)
parser.add_argument("--mware", default="zeromq")
parser.add_argument("--picture", action="store_true")
parser.add_argument("--scale", type=float)
parser.add_argument("numbers", type=float, nargs="*", default=[1.0, 2.0, 6.0])
args = parser.parse_args()


class Calculator(MiddlewareCommunicator):
    @MiddlewareCommunicator.register("NativeObject", "$0", "Calculator", "/example/describe")
    def describe(self, mware, numbers, scale=None):
        mean = sum(numbers) / len(numbers) * (1.0 if scale is None else scale) if numbers else None
        return {"count": len(numbers), "mean": mean},

    @MiddlewareCommunicator.register("Image", "$0", "Calculator", "/example/picture")
    def picture(self, mware, number, width, height):
        ramp = np.arange(width * height * 3) % 251 + number
        return ramp.astype(np.uint8).reshape(height, width, 3),


def main():
    calculator = Calculator()
    calculator.activate_communication("describe", mode=args.mode)
    calculator.activate_communication("picture", mode=args.mode)
    asked = 0
    while args.mode == "reply" or asked < len(args.numbers):
        asked += 1
        if args.picture:
            image, = calculator.picture(args.mware, asked, 32, 24)
            value = example.image_facts(image)
        else:
            value, = calculator.describe(args.mware, args.numbers[:asked], scale=args.scale)
        say("message", value=value)
    leave()


if __name__ == "__main__":
    main()
