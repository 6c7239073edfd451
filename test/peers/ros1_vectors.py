#!/usr/bin/env python3
"""Random messages of every ROS 1 interface in a place, as ROS 1 and as ROS 2 write them: one a line.

    ros1_vectors.py [--seed N] [--cases N] [--brief] [--prefix /usr] PLACE

PLACE is a folder of packages (/usr/share) or a file in the format of standard/ros1.txt. Definition texts,
checksums and ROS 1 bytes come from ROS 1's own genmsg and genpy (Debian's python3-genpy, below the prefix),
CDR and type hashes from rosbags with the types of ROS 2 Jazzy; of those that Jazzy lacks, as ROS 2 would
have them. A line:

    {"event": "type", "type": "std_msgs/String", "kind": "msg", "md5": …, "text": …, "ros2": …, "hash": …,
     "messages": [{"part": "", "seq": 7, "ros1": hex, "cdr": hex}]}

Of a service, `part` is Request or Response. `seq` is what header.seq has in ROS 1. Where ROS 2 lacks fields,
`back` is what comes back.
"""
import argparse
import hashlib
import io
import pathlib
import random
import re
import sys
import tempfile

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from lines import say

RENAMED = {
    "std_msgs/Time": "builtin_interfaces/msg/Time",
    "std_msgs/Duration": "builtin_interfaces/msg/Duration",
    "rosgraph_msgs/Log": "rcl_interfaces/msg/Log",
    "tf/tfMessage": "tf2_msgs/msg/TFMessage",
    "wrapyfi_ros_interfaces/ROSAudioMessage": "wrapyfi_ros2_interfaces/msg/ROS2AudioMessage",
    "roscpp/Empty": "std_srvs/srv/Empty",
    "tf/FrameGraph": "tf2_msgs/srv/FrameGraph",
    "wrapyfi_ros_interfaces/ROSAudioService": "wrapyfi_ros2_interfaces/srv/ROS2AudioService",
}
LEVELS = {1: 10, 2: 20, 4: 30, 8: 40, 16: 50}
SIZES = {"bool": "?", "int8": "b", "byte": "b", "uint8": "B", "char": "B", "int16": "h", "uint16": "H",
         "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d"}
LETTERS = "abcXYZ 019/_äß€漢🙂"


def unpack(place):
    """A folder of packages with what the file at `place` has."""
    if place.is_dir():
        return place
    folder = pathlib.Path(tempfile.mkdtemp(prefix="ros1_vectors_"))
    for section in place.read_text().split("=" * 80 + "\n")[1:]:
        head, text = section.split("\n", 1)
        kind, name = head.split(": ")
        package, name = name.split("/")
        path = folder / package / kind.lower() / f"{name}.{kind.lower()}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


class Definitions:
    """What genmsg makes of the files."""

    def __init__(self, folder):
        import genmsg
        import genmsg.msg_loader
        self.genmsg = genmsg
        self.files = sorted([*folder.glob("*/msg/*.msg"), *folder.glob("*/srv/*.srv")])
        self.search = {}
        for file in self.files:
            self.search.setdefault(file.parts[-3], [str(folder / file.parts[-3] / "msg")])

    def load(self, file):
        name = f"{file.parts[-3]}/{file.stem}"
        context = self.genmsg.MsgContext.create_default()
        kind = file.suffix[1:]
        load = self.genmsg.msg_loader.load_msg_from_file if kind == "msg" else self.genmsg.msg_loader.load_srv_from_file
        spec = load(context, str(file), name)
        self.genmsg.load_depends(context, spec, self.search)
        if kind == "srv":
            both = [depended for part in (spec.request, spec.response)
                    for depended in context.get_depends(part.full_name)]
            context.set_depends(name, both)
        text = lambda spec: self.genmsg.compute_full_text(context, spec)
        parts = {"": text(spec)} if kind == "msg" else \
            {"Request": text(spec.request), "Response": text(spec.response)}
        return name, kind, text(spec), self.genmsg.compute_md5(context, spec), parts


class Random:
    """Random contents for genpy's messages."""

    def __init__(self, seed):
        self.random = random.Random(seed)

    def message(self, message, path=""):
        for name, kind in zip(message.__slots__, message._slot_types):
            setattr(message, name, self.field(kind, f"{path}{name}", message, name))
        return message

    def field(self, kind, path, message, name):
        match = re.fullmatch(r"(.*)\[(\d*)\]", kind)
        if not match:
            return self.value(kind, path, message, name)
        kind, count = match.groups()
        if not count:
            limit = 3 if kind not in ("uint8", "int8", "char") else 40
            count = self.random.randint(0, limit)
        count = int(count)
        if kind in ("uint8", "char"):
            return bytes(self.random.randrange(256) for _ in range(count))
        return [self.value(kind, path + "[]", message, name) for _ in range(count)]

    def value(self, kind, path, message, name):
        import genpy
        if name == "seq" and message._type == "std_msgs/Header" and path != "header.seq":
            return 0  # only that of the message's own header is anything
        if name == "level" and message._type == "rosgraph_msgs/Log":
            return self.random.choice(list(LEVELS))
        if kind == "string":
            return "".join(self.random.choices(LETTERS, k=self.random.randint(0, 12)))
        if kind == "time":
            return genpy.Time(self.random.randrange(1 << 32), self.random.randrange(10**9))
        if kind == "duration":
            return genpy.Duration(self.random.randrange(-1 << 31, 1 << 31), self.random.randrange(10**9))
        if kind == "bool":
            return self.random.random() < 0.5
        if kind in ("float32", "float64"):
            return float(np.dtype(kind).type(self.random.uniform(-1e6, 1e6)))
        if kind in SIZES:
            bits = 8 * np.dtype({"byte": "int8", "char": "uint8"}.get(kind, kind)).itemsize
            low = -(1 << (bits - 1)) if SIZES[kind].islower() else 0
            return self.random.randrange(low, low + (1 << bits))
        # Of a list's elements genpy makes none by itself.
        fresh = self.classes[kind if "/" in kind else f"std_msgs/{kind}"]()
        return self.message(fresh, f"{path}.")

    def of(self, name, text):
        import genpy.dynamic
        self.classes = genpy.dynamic.generate_dynamic(name, text)
        return self.message(self.classes[name]())


class Ros2:
    """What rosbags makes of the same."""

    def __init__(self):
        self.store = get_typestore(Stores.ROS2_JAZZY)

    def name(self, name, kind):
        return RENAMED.get(name, name.replace("/", f"/{kind}/"))

    def add(self, name, text):
        """Makes the types of a full text known, as ROS 2 would define them."""
        known = {}
        for found, (constants, fields) in get_types_from_msg(text, name).items():
            found = RENAMED.get(found.replace("/msg/", "/"), found)
            if found in self.store.fielddefs or found == "std_msgs/msg/Header":
                continue
            fields = [(field.lower(), kind) for field, kind in fields]
            known[found] = (constants, fields or
                            [("structure_needs_at_least_one_member", (1, ("uint8", 0)))])
        if known:
            from rosbags.interfaces import Nodetype
            known = {found: (constants, [(field, self.renamed(kind, Nodetype)) for field, kind in fields])
                     for found, (constants, fields) in known.items()}
            self.store.register(known)

    def renamed(self, kind, nodetype):
        what, inner = nodetype(kind[0]), kind[1]
        if what == nodetype.NAME:
            return (what, RENAMED.get(inner.replace("/msg/", "/"), inner))
        if what in (nodetype.ARRAY, nodetype.SEQUENCE):
            return (what, (self.renamed(inner[0], nodetype), inner[1]))
        return (what, inner)

    def message(self, message, name):
        values = {}
        for field, kind in self.store.fielddefs[name][1]:
            found = [slot for slot in getattr(message, "__slots__", []) if slot.lower() == field]
            if name == "rcl_interfaces/msg/Log" and field == "stamp":
                value = self.value(message.header.stamp, kind)
            elif name == "rcl_interfaces/msg/Log" and field == "level":
                value = LEVELS[message.level]
            else:
                value = self.value(getattr(message, found[0]) if found else None, kind)
            values[field] = value
        return self.store.types[name](**values)

    def value(self, value, kind):
        what, inner = int(kind[0]), kind[1]
        if what == 1:
            plain = "" if inner[0] == "string" else 0
            return plain if value is None else value
        if what == 2:
            if inner.endswith(("msg/Time", "msg/Duration")) and inner.startswith("builtin_interfaces"):
                return self.time(value, inner)
            return self.message(value, inner)
        (element, count) = inner
        count = count if what == 3 else 0
        value = list(value) if value is not None else [None] * count
        if int(element[0]) == 1 and element[1][0] != "string":
            kind = {"byte": "uint8", "octet": "uint8", "char": "uint8"}.get(element[1][0], element[1][0])
            # An array of signed bytes, which rosbags has unsigned.
            plain = [0 if one is None else one % 256 if kind == "uint8" else one for one in value]
            return np.array(plain, dtype=kind)
        return [self.value(one, element) for one in value]

    def time(self, value, name):
        seconds, nanoseconds = (value.secs, value.nsecs) if value is not None else (0, 0)
        seconds = seconds - (1 << 32) if seconds >= 1 << 31 else seconds
        return self.store.types[name](sec=seconds, nanosec=nanoseconds)

    def cdr(self, message, name):
        if name.startswith("builtin_interfaces/"):
            return bytes(self.store.serialize_cdr(self.time(message.data, name), name))
        return bytes(self.store.serialize_cdr(self.message(message, name), name))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", type=int, default=2)
    parser.add_argument("--prefix", default="/usr")
    parser.add_argument("--brief", action="store_true", help="the SHA-256 of texts in their place")
    parser.add_argument("place", type=pathlib.Path)
    asked = parser.parse_args()
    # Behind what the interpreter has itself: only genmsg, genpy and what they need come from there.
    sys.path.append(f"{asked.prefix}/lib/python3/dist-packages")
    definitions, ros2 = Definitions(unpack(asked.place)), Ros2()
    contents = Random(asked.seed)
    # Those of wrapyfi_services are made by hand in Python: no tool of ROS 1 has their checksums.
    for file in (file for file in definitions.files if file.parts[-3] != "wrapyfi_services"):
        name, kind, text, md5, parts = definitions.load(file)
        target = ros2.name(name, kind)
        messages, hashed = [], None
        shown = hashlib.sha256(text.encode()).hexdigest() if asked.brief else text
        for part, part_text in parts.items():
            part_name = f"{target}_{part}" if part else target
            stored = f"{name}{part}".replace("/", "/msg/")
            if part:
                ros2.add(stored, part_text)
                # Under the name that ROS 2 gives the parts of services.
                ros2.store.fielddefs[part_name] = ros2.store.fielddefs[stored]
                ros2.store.types[part_name] = ros2.store.types[stored]
                part_name = stored
            elif target not in ros2.store.fielddefs or target != name.replace("/", "/msg/"):
                ros2.add(name.replace("/", "/msg/"), part_text)
            # rosbags 0.11 takes char for another type than uint8, which ROS 2 does not.
            if not part and name != "std_msgs/Char":
                hashed = ros2.store.hash_rihs01(target)
            for _ in range(asked.cases):
                message = contents.of(f"{name}{part}", part_text)
                out = io.BytesIO()
                message.serialize(out)
                seq = message.header.seq if getattr(message, "_has_header", False) else 0
                messages.append({"part": part, "seq": seq, "ros1": out.getvalue().hex(),
                                 "cdr": ros2.cdr(message, part_name).hex()})
                if name == "rosgraph_msgs/Log":
                    message.header.frame_id, message.topics, back = "", [], io.BytesIO()
                    message.serialize(back)
                    messages[-1]["back"] = back.getvalue().hex()
        say("type", type=name, kind=kind, md5=md5, text=shown, ros2=target, hash=hashed, messages=messages)


if __name__ == "__main__":
    main()
