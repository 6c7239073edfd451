#!/usr/bin/env python3
"""A bag of ROS 1 beside what was made of it, read by the package rosbags.

    rosbags_same.py BAG RECORDING [--converted FOLDER] [--played]

Each message of BAG is in RECORDING, a folder or an .mcap, with the same time and the same values; topics have the names of ROS 2. With
--played RECORDING was recorded while BAG was played: it has some of the topics, and other times.
With --converted, a recording that rosbags-convert has made of the same bag, its bytes are the same, too. Prints how many messages it
has compared.
"""
import argparse
import pathlib
import re
import sys
from collections import defaultdict

import numpy
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

# Fields of ROS 1 that ROS 2 has not, and those with another name there.
DROPPED = {"seq"}
RENAMED = {"xPos": "x_pos", "D": "d", "K": "k", "R": "r", "P": "p"}


def ros2_name(topic):
    parts = [re.sub(r"[^A-Za-z0-9]", "_", part) for part in topic.split("/") if part]
    return "/" + "/".join(f"_{part}" if part[0].isdigit() else part for part in parts)


def fields(message):
    return [name for name in message.__dataclass_fields__ if not name.startswith("__")]


def same(one, other, path):
    if hasattr(one, "__dataclass_fields__"):
        there = set(fields(other))
        for name in fields(one):
            if name in DROPPED and name not in there:
                continue
            renamed = name if name in there else RENAMED.get(name)
            if renamed not in there:
                sys.exit(f"{path}.{name} is lost: {sorted(there)}")
            same(getattr(one, name), getattr(other, renamed), f"{path}.{name}")
    elif isinstance(one, numpy.ndarray):
        if not numpy.array_equal(numpy.asarray(one, dtype=other.dtype), other):
            sys.exit(f"{path}: {one} became {other}")
    elif isinstance(one, list):
        if len(one) != len(other):
            sys.exit(f"{path}: {len(one)} became {len(other)}")
        for index, (left, right) in enumerate(zip(one, other)):
            same(left, right, f"{path}[{index}]")
    elif one != other and one % 256 != other:  # byte is signed in ROS 1
        sys.exit(f"{path}: {one!r} became {other!r}")


def messages(path):
    found = defaultdict(list)
    # Files of ours have their definitions inside; the store is that of bags without.
    with AnyReader([path], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        for connection, time, data in reader.messages():
            found[connection.topic].append((time, connection.msgtype, data, reader.deserialize(data, connection.msgtype)))
    for topic in found.values():
        topic.sort(key=lambda one: one[0])
    return found


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("bag", type=pathlib.Path)
    parser.add_argument("recording", type=pathlib.Path)
    parser.add_argument("--converted", type=pathlib.Path)
    parser.add_argument("--played", action="store_true")
    args = parser.parse_args()
    before, after = messages(args.bag), messages(args.recording)
    names = {topic: ros2_name(topic) for topic in before}
    if args.played:
        names = {topic: name for topic, name in names.items() if name in after}
    if set(names.values()) != set(after):
        sys.exit(f"topics {sorted(names.values())} became {sorted(after)}")
    compared = 0
    for topic in names:
        all_of_it = before[topic]
        ours = after[names[topic]]
        if len(all_of_it) != len(ours):
            sys.exit(f"{topic}: {len(all_of_it)} messages became {len(ours)}")
        for (time, _, _, message), (time_now, _, _, message_now) in zip(all_of_it, ours):
            if time != time_now and not args.played:
                sys.exit(f"{topic}: time {time} became {time_now}")
            same(message, message_now, topic)
            compared += 1
    if args.converted:
        theirs = messages(args.converted)
        for topic, all_of_it in theirs.items():
            for (_, _, data, _), (_, _, ours, _) in zip(all_of_it, after[names[topic]]):
                if bytes(data) != bytes(ours):
                    sys.exit(f"{topic}: rosbags-convert has {bytes(data).hex()}, here it is {bytes(ours).hex()}")
    print(compared)


main()
