#!/usr/bin/env python3
"""A camera or a display, the twin of examples/communicator/src/bin/camera.rs.

    python test/peers/camera.py --mode publish --source FOLDER
    python test/peers/camera.py --mode listen --save FOLDER
"""
import argparse
import pathlib
import time

import example  # before wrapyfi
import cv2
from wrapyfi.connect.wrapper import MiddlewareCommunicator

from lines import say

parser = argparse.ArgumentParser()
parser.add_argument("--mode", default=None)
parser.add_argument("--mware", default="zeromq")
parser.add_argument("--topic", default="/sensors/camera")
parser.add_argument("--source", help="folder of PNG files, or a number: a camera of OpenCV")
parser.add_argument("--once", action="store_true", help="ends after the last file")
parser.add_argument("--rate", type=float, default=20.0)
parser.add_argument("--jpg", action="store_true")
parser.add_argument("--save", type=pathlib.Path)
args = parser.parse_args()


class Eye(MiddlewareCommunicator):
    def __init__(self):
        super().__init__()
        self.taken, self.files, self.device = 0, [], None
        if args.mode == "listen":
            return
        if args.source and args.source.isdigit():
            self.device = cv2.VideoCapture(int(args.source))
        else:
            self.files = example.pictures(args.source)

    @MiddlewareCommunicator.register("Image", "$mware", "Eye", "$topic", carrier="tcp", rgb=True, jpg="$jpg")
    def look(self, mware=None, topic=None, jpg=False):
        if self.device is not None:
            return self.device.read()[1],
        frame = self.files[self.taken % len(self.files)]
        self.taken += 1
        return frame,


def main():
    eye = Eye()
    eye.activate_communication("look", mode=args.mode)
    shown = 0
    while not (args.once and eye.taken == len(eye.files)):
        frame, = eye.look(mware=args.mware, topic=args.topic, jpg=args.jpg)
        if frame is not None:
            shown += 1
            facts = example.image_facts(frame)
            if args.save:
                args.save.mkdir(exist_ok=True)
                file = args.save / f"{shown:05}.png"
                example.save(frame, file)
                facts["file"] = str(file)
            say("message", **facts)
        time.sleep(0.005 if args.mode == "listen" else 1.0 / args.rate)
    example.leave_after_the_last_message()


if __name__ == "__main__":
    main()
