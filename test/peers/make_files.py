#!/usr/bin/env python3
"""Writes files for `wrapyfi pub` into a folder, as other programs write them.

    make_files.py FOLDER

Prints {"event": "file", "name", "path", "sha256"} for each; the hash is what a Wrapyfi listener finds.
"""
import pathlib
import struct
import sys

import cv2
import numpy as np

import payload
from lines import say

folder = pathlib.Path(sys.argv[1])
colour, mono, sound = payload.image(7), payload.image(7, "mono"), payload.audio(7, 441, 2)


def wav(path, samples, rate):
    """A WAV file of IEEE floats."""
    data, channels = samples.astype("<f4").tobytes(), samples.shape[1]
    form = struct.pack("<HHIIHH", 3, channels, rate, rate * channels * 4, channels * 4, 32)
    chunks = b"fmt " + struct.pack("<I", len(form)) + form + b"data" + struct.pack("<I", len(data)) + data
    path.write_bytes(b"RIFF" + struct.pack("<I", 4 + len(chunks)) + b"WAVE" + chunks)


def tell(name, value):
    say("file", name=name, path=str(folder / name), sha256=payload.digest(value))


np.save(folder / "colour.npy", colour)
tell("colour.npy", colour)
cv2.imwrite(str(folder / "colour.png"), colour)
tell("colour.png", colour)
cv2.imwrite(str(folder / "mono.png"), mono)
tell("mono.png", mono)
cv2.imwrite(str(folder / "colour.jpg"), colour)
tell("colour.jpg", cv2.imread(str(folder / "colour.jpg")))
wav(folder / "stereo.wav", sound, 16000)
tell("stereo.wav", sound)
say("done")
