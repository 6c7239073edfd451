#!/usr/bin/env python3
"""Decodes CDR with rosbags' own codec: one {"type", "cdr": hex} a line in, one {"event": "decoded"} out.

    rosbags_decode.py hash TYPE...     prints the REP-2016 hash that rosbags computes instead
"""
import dataclasses
import hashlib
import json
import sys

import numpy as np

import interfaces
from lines import say


def plain(value):
    if isinstance(value, np.ndarray):
        if value.dtype == np.uint8:
            return {"bytes": int(value.size), "sha256": hashlib.sha256(value.tobytes()).hexdigest()}
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if dataclasses.is_dataclass(value):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)
                if not f.name.startswith("__")}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    return value


def main():
    types = interfaces.store()
    if sys.argv[1:2] == ["hash"]:
        for name in sys.argv[2:]:
            say("hash", type=name, hash=types.hash_rihs01(name))
        return
    for line in sys.stdin:
        asked = json.loads(line)
        raw = bytes.fromhex(asked["cdr"])
        try:
            message = types.deserialize_cdr(raw, asked["type"])
        except Exception as problem:  # a test asserts that this does not happen
            say("refused", type=asked["type"], problem=f"{type(problem).__name__}: {problem}")
            continue
        again = bytes(types.serialize_cdr(message, asked["type"]))
        say("decoded", type=asked["type"], fields=plain(message),
            same_bytes=raw.rstrip(b"\0") == again.rstrip(b"\0"))


if __name__ == "__main__":
    main()
