#!/usr/bin/env python3
"""Both ways at once, the twin of examples/communicator/src/bin/transceive_reemit.rs.

    python test/peers/transceive_reemit.py --mode transceive
    python test/peers/transceive_reemit.py --mode reemit
"""
import argparse
import time

import example  # noqa: F401  before wrapyfi
from wrapyfi.connect.wrapper import MiddlewareCommunicator

from lines import say

parser = argparse.ArgumentParser()
parser.add_argument("--mode", choices=["transceive", "reemit"], required=True)
parser.add_argument("--mware", default="zeromq")
args = parser.parse_args()


class Partner(MiddlewareCommunicator):
    def __init__(self):
        super().__init__()
        self.said = 0

    @MiddlewareCommunicator.register("NativeObject", "$mware", "Partner", "$way_in", should_wait=False,
                                     listener_kwargs=dict(in_topic="$way_in"),
                                     publisher_kwargs=dict(out_topic="$way_out"))
    def exchange(self, heard=None, mware=None, way_in=None, way_out=None):
        # Wrapyfi appends what came in to the arguments by place.
        self.said += 1
        answers = heard["number"] if heard is not None else None
        return {"by": args.mode, "number": self.said, "answers": answers},


def main():
    partner = Partner()
    partner.activate_communication("exchange", mode=args.mode)
    ways = ("/example/ping", "/example/pong")
    way_in, way_out = ways if args.mode == "reemit" else reversed(ways)
    while True:
        note, = partner.exchange(mware=args.mware, way_in=way_in, way_out=way_out)
        if note is not None and note["answers"] is not None:
            say("message", note=note)
        time.sleep(0.005)


if __name__ == "__main__":
    main()
