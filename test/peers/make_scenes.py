#!/usr/bin/env python3
"""Writes what the sensor examples see and hear into a folder, as other programs write it.

    make_scenes.py FOLDER

    frames/  five pictures in colour          voice.wav  16-bit stereo at 8000 Hz
    sad/     one grey picture, brightness 140
    happy/   one grey picture, brightness 250
    corner/  black, but for a bright corner on the upper left

Prints {"event": "frames", "sha256": [...]} and {"event": "voice", "frames", "sha256"}: of the pixels, and of
the samples as floats.
"""
import pathlib
import sys
import wave

import cv2
import numpy as np

import payload
from lines import say

folder = pathlib.Path(sys.argv[1])


def pictures(name, frames):
    (folder / name).mkdir()
    for number, frame in enumerate(frames):
        cv2.imwrite(str(folder / name / f"{number:03}.png"), frame)


frames = [payload.image(seq) for seq in range(5)]
pictures("frames", frames)
pictures("sad", [np.full((24, 32, 3), 140, np.uint8)])
pictures("happy", [np.full((24, 32, 3), 250, np.uint8)])
corner = np.zeros((9, 11, 3), np.uint8)
corner[0, 0] = 200
pictures("corner", [corner])
say("frames", sha256=[payload.digest(frame) for frame in frames])

voice = np.round(payload.audio(3, 2000, 2) * 20000).astype("<i2")
with wave.open(str(folder / "voice.wav"), "wb") as file:
    file.setnchannels(2)
    file.setsampwidth(2)
    file.setframerate(8000)
    file.writeframes(voice.tobytes())
say("voice", frames=len(voice), sha256=payload.digest(voice.astype(np.float32) / np.float32(32768)))
