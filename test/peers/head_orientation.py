#!/usr/bin/env python3
"""Imitation of a head's orientation, the twin of examples/communicator/src/bin/head_orientation.rs.

BOTH SENSORS ARE STAND-INS, a circle and the middle of a frame's brightness.

    python test/peers/head_orientation.py --role sensors --frames FOLDER
    python test/peers/head_orientation.py --role robot --source worn
"""
import argparse
import math
import time

import example  # before wrapyfi
import numpy as np
from wrapyfi.connect.wrapper import MiddlewareCommunicator

from lines import say

parser = argparse.ArgumentParser()
parser.add_argument("--role", choices=["sensors", "robot"], required=True)
parser.add_argument("--source", choices=["worn", "seen", "both"], default="both")
parser.add_argument("--worn_mware", default="zeromq")
parser.add_argument("--seen_mware", default="zeromq")
parser.add_argument("--frames", help="folder of PNG files")
args = parser.parse_args()


def worn_stand_in(seq):
    turn = seq % 40 / 40 * math.tau
    return {"source": "worn", "seq": seq, "roll_deg": 5 * math.sin(turn), "pitch_deg": 20 * math.sin(turn),
            "yaw_deg": 70 * math.cos(turn), "gaze": [math.cos(turn + 0.3), math.sin(turn + 0.3)]}


def seen_stand_in(seq, image):
    grey = example.greys(image).astype("u8")
    total = int(grey.sum())
    if total == 0:
        return None
    rows, columns = np.indices(grey.shape, dtype="u8")
    middle = [int((grey * places).sum()) / total / (max(length, 2) - 1) * 2 - 1
              for places, length in zip((rows, columns), grey.shape)]
    return {"source": "seen", "seq": seq, "roll_deg": 0.0, "pitch_deg": -40 * middle[0], "yaw_deg": -60 * middle[1],
            "gaze": None}


class Imitation(MiddlewareCommunicator):
    def __init__(self, frames=()):
        super().__init__()
        self.frames, self.measured = frames, 0

    @MiddlewareCommunicator.register("NativeObject", "$worn_mware", "Imitation", "/head/worn", should_wait=False)
    @MiddlewareCommunicator.register("NativeObject", "$seen_mware", "Imitation", "/head/seen", should_wait=False)
    def orientations(self, worn_mware=None, seen_mware=None):
        self.measured += 1
        frame = self.frames[self.measured % len(self.frames)]
        return worn_stand_in(self.measured), seen_stand_in(self.measured, frame)


def joints(orientation):
    """About the limits of iCub's neck; the eyes look ahead where nothing tracks them."""
    wanted = [orientation["pitch_deg"], orientation["roll_deg"], orientation["yaw_deg"]]
    neck = [min(max(angle, least), largest)
            for angle, (least, largest) in zip(wanted, [(-40.0, 30.0), (-60.0, 60.0), (-50.0, 50.0)])]
    right, up = orientation["gaze"] or (0.0, 0.0)
    return {"neck_deg": neck, "eyes_deg": [30.0 * min(max(up, -1), 1), 30.0 * min(max(right, -1), 1)]}


def main():
    is_robot = args.role == "robot"
    imitation = Imitation(() if is_robot else example.pictures(args.frames))
    imitation.activate_communication("orientations", mode="listen" if is_robot else "publish")
    selected = {"worn_mware": args.worn_mware, "seen_mware": args.seen_mware}
    if is_robot and args.source != "both":
        # An unknown name is a missing middleware: its value is None.
        selected["seen_mware" if args.source == "worn" else "worn_mware"] = "none"
    worn_at = -math.inf
    while True:
        worn, seen = imitation.orientations(**selected)
        if is_robot:
            # What is worn, until it has been silent for a second.
            if worn is not None:
                worn_at = time.monotonic()
            orientation = worn if worn is not None or time.monotonic() - worn_at <= 1 else seen
            if orientation is not None:
                say("message", orientation=orientation, head=joints(orientation))
            time.sleep(0.005)
            continue
        for orientation in (worn, seen):
            if orientation is not None:
                say("message", orientation=orientation)
        time.sleep(0.05)


if __name__ == "__main__":
    main()
