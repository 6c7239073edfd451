#!/usr/bin/env python3
"""Imitation of facial expressions, the twin of examples/communicator/src/bin/facial_expression.rs.

THE RECOGNISER IS A STAND-IN: it names frames by their brightness and knows nothing about faces.

    python test/peers/facial_expression.py --role recogniser
    python test/peers/facial_expression.py --role pepper --source FOLDER
    python test/peers/facial_expression.py --role icub --source FOLDER
"""
import argparse
import time

import example  # before wrapyfi
from wrapyfi.connect.wrapper import MiddlewareCommunicator

from lines import say

EXPRESSIONS = ["anger", "contempt", "disgust", "fear", "sadness", "neutral", "surprise", "happiness"]
COLOURS = {"anger": [255, 0, 0], "contempt": [160, 80, 0], "disgust": [0, 160, 0], "fear": [128, 0, 128],
           "sadness": [0, 0, 255], "neutral": [255, 255, 255], "surprise": [255, 160, 0], "happiness": [255, 255, 0]}
FACES = {"anger": ">:(", "contempt": ":/", "disgust": ":S", "fear": "D:", "sadness": ":(", "neutral": ":|",
         "surprise": ":O", "happiness": ":D"}

parser = argparse.ArgumentParser()
parser.add_argument("--role", choices=["pepper", "icub", "recogniser"], required=True)
parser.add_argument("--pepper_mware", default="zeromq")
parser.add_argument("--icub_mware", default="zeromq")
parser.add_argument("--source", help="folder of PNG files")
args = parser.parse_args()


class Robot(MiddlewareCommunicator):
    def __init__(self, frames=()):
        super().__init__()
        self.frames, self.taken = frames, 0

    @MiddlewareCommunicator.register("Image", "$mware", "Robot", "$topic", rgb=True, should_wait=False)
    def acquire(self, mware=None, topic=None):
        self.taken += 1
        return self.frames[self.taken % len(self.frames)],

    @MiddlewareCommunicator.register("NativeObject", "$mware", "Robot", "$topic", should_wait=False)
    def express(self, seen=None, mware=None, topic=None):
        return seen,


def stand_in(image):
    brightness = int(image.sum(dtype="u8")) // image.size
    return {"expression": EXPRESSIONS[brightness // 32], "brightness": brightness,
            "recogniser": "stand-in: mean brightness"}


def recognise():
    robots = []
    for name, mware in (("pepper", args.pepper_mware), ("icub", args.icub_mware)):
        robot = Robot()
        robot.activate_communication("acquire", mode="listen")
        robot.activate_communication("express", mode="publish")
        robots.append((name, mware, robot))
    while True:
        # One robot after the other is looked through and told what to show.
        for name, mware, robot in robots:
            image, = robot.acquire(mware=mware, topic=f"/{name}/image")
            if image is not None:
                seen, = robot.express(stand_in(image), mware=mware, topic=f"/{name}/expression")
                say("message", robot=name, seen=seen)
        time.sleep(0.005)


def imitate(name, mware):
    robot = Robot(example.pictures(args.source))
    robot.activate_communication("acquire", mode="publish")
    robot.activate_communication("express", mode="listen")
    shows = COLOURS if name == "pepper" else FACES
    while True:
        robot.acquire(mware=mware, topic=f"/{name}/image")
        seen, = robot.express(mware=mware, topic=f"/{name}/expression")
        if seen is not None:
            say("message", robot=name, seen=seen, shows=shows[seen["expression"]])
        time.sleep(0.05)


if __name__ == "__main__":
    if args.role == "recogniser":
        recognise()
    else:
        imitate(args.role, args.pepper_mware if args.role == "pepper" else args.icub_mware)
