#!/usr/bin/env python3
"""A pipeline whose steps run here or are mirrored, the twin of examples/communicator/src/bin/mirroring.rs.

    python test/peers/mirroring.py --here sense
    python test/peers/mirroring.py --here think
    python test/peers/mirroring.py                      mirrors both
    python test/peers/mirroring.py --config modes.yaml  as the file says
"""
import argparse
import json
import time

import example  # noqa: F401  before wrapyfi
from wrapyfi.config.manager import ConfigManager
from wrapyfi.connect.wrapper import MiddlewareCommunicator

parser = argparse.ArgumentParser()
parser.add_argument("--here", default="", help="steps that run here: sense,think")
parser.add_argument("--config", help="modes of all steps, instead of --here")
parser.add_argument("--mware", default="zeromq")
args = parser.parse_args()


class Pipeline(MiddlewareCommunicator):
    def __init__(self):
        super().__init__()
        self.sensed = 0

    @MiddlewareCommunicator.register("NativeObject", "$mware", "Pipeline", "/mirroring/sense", should_wait=True)
    def sense(self, mware=None):
        self.sensed += 1
        return self.sensed,

    @MiddlewareCommunicator.register("NativeObject", "$mware", "Pipeline", "/mirroring/think", should_wait=False)
    def think(self, number, mware=None):
        return {"number": number, "square": number * number},


def main():
    if args.config:
        ConfigManager(args.config)
    pipeline = Pipeline()
    if not args.config:
        here = args.here.split(",")
        for step in ("sense", "think"):
            pipeline.activate_communication(step, mode="publish" if step in here else "listen")
    while True:
        # From here on nothing depends on who does the work.
        number, = pipeline.sense(mware=args.mware)
        if number is not None:
            thought, = pipeline.think(number, mware=args.mware)
            if thought is not None:
                print(json.dumps(thought, separators=(",", ":")), flush=True)
        time.sleep(0.005)


if __name__ == "__main__":
    main()
