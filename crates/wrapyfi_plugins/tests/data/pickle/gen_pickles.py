#!/usr/bin/env python3
"""Writes protocols.json: values pickled by CPython and NumPy in every protocol, each with the
native-object text that they stand for.

    python gen_pickles.py > protocols.json
"""
import base64
import collections
import datetime
import io
import json
import pickle
import pickletools
import sys

import numpy as np


def tag(*parts):
    return {"__wrapyfi__": list(parts)}


def native(v):
    """The value in Wrapyfi's JSON, tuples tagged at every level."""
    if isinstance(v, (np.ndarray, np.generic)) and not isinstance(v, (float, str)):
        a = np.asarray(v)
        if a.dtype.names is None and a.dtype.kind in "iufcb":
            a = a.astype(a.dtype.newbyteorder("<"))
        file = io.BytesIO()
        np.save(file, np.array(a, order="C", copy=True))
        return tag("numpy.ndarray", base64.b64encode(file.getvalue()).decode())
    if isinstance(v, tuple):
        return tag("tuple", [native(x) for x in v])
    if isinstance(v, (set, frozenset)):
        return tag("set", [native(x) for x in v])
    if isinstance(v, datetime.datetime):
        return tag("datetime", v.isoformat())
    if isinstance(v, list):
        return [native(x) for x in v]
    if isinstance(v, dict):
        return {k: native(x) for k, x in v.items()}
    return v


shared = [1, "two"]
hour = datetime.timezone(datetime.timedelta(hours=-3, minutes=-30))
structured = np.array([(1, 2.5, b"x")], dtype=[("a", "<i4"), ("b", ">f8", (2,)), ("c", "S2")])
VALUES = {
    "atoms": [None, True, False, 0, 255, 256, 65535, 65536, -1, -2**31, 2**31, 2**63 - 1, -2**63],
    "big": [2**63, -2**64, 10**40, 2**3000],
    "floats": [0.0, -0.0, 1.5, 1e300, 5e-324, float("inf"), float("-inf"), float("nan")],
    "text": ["", "a", "gr\u00fc\u00dfe", "\u4f60\u597d", "\U0001f916", "\ud800", "a\nb\\u0041\\", "x" * 300],
    "containers": [[], (), {}, [[]], ((),), (1,), (1, 2), (1, 2, 3), (1, 2, 3, 4), {"a": {"b": [1]}}],
    "sets": [set(), {1}, frozenset(), frozenset({"x"})],
    "shared": [shared, shared, (shared, shared), {"a": shared}],
    "many": [str(i) for i in range(300)],
    "ordered": collections.OrderedDict([("z", 1), ("a", (2,))]),
    "datetimes": [
        datetime.datetime(2024, 1, 2, 3, 4, 5, 678901),
        datetime.datetime(1, 1, 1, tzinfo=datetime.timezone.utc),
        datetime.datetime(9999, 12, 31, 23, 59, 59, 999999, tzinfo=hour),
        datetime.datetime(2024, 10, 27, 2, 30, fold=1),
    ],
    "arrays": [np.arange(6).astype(t).reshape(2, 3) for t in "? b h i q B H I Q e f d F D".split()],
    "scalars": [np.int8(-5), np.float32(0.1), np.bool_(True), np.complex64(1 + 2j), np.uint64(2**63)],
    "orders": [
        np.asfortranarray(np.arange(6, dtype="<i4").reshape(2, 3)),
        np.arange(24, dtype="<i2").reshape(2, 3, 4).transpose(1, 0, 2),
        np.arange(24, dtype="<i2").reshape(2, 3, 4).transpose(2, 0, 1),
        np.arange(24, dtype="<i2").reshape(2, 3, 4)[:, ::2, 1:],
        np.arange(6, dtype=">f8").reshape(2, 3),
        np.array(7, dtype=">u2"),
        np.zeros((0, 3), dtype="f4"),
        np.zeros((2, 0, 3), dtype="f4"),
    ],
    "times": [
        np.array(["2024-01-02T03:04:05.123456789", "NaT"], dtype="M8[ns]"),
        np.array([1, -2], dtype="m8[25s]"),
        np.array(["2024-01-02"], dtype=">M8[D]"),
    ],
    "flexible": [
        np.array(["a", "\u4f60\u597d"]),
        np.array([b"ab", b"c"]),
        np.frombuffer(b"abcdef", dtype="V3"),
        np.array([1.5], dtype=np.longdouble),
        np.asfortranarray(np.array([["a", "b"], ["c", "dd"]])),
    ],
    "structured": [
        structured,
        np.zeros(2, dtype=np.dtype([("a", "u1"), ("b", "<f8")], align=True)),
        np.zeros(1, dtype=[("in", [("x", "<i2"), ("y", "<U3")]), ("it's", "u1")]),
    ],
    "matrix": np.matrix([[1, 2], [3, 4]]),
}


def main():
    entries = []
    for name, value in VALUES.items():
        for protocol in range(6):
            for beside in ([False, True] if protocol == 5 else [False]):
                buffers = []
                callback = buffers.append if beside else None
                data = pickle.dumps(value, protocol, buffer_callback=callback)
                entries.append({
                    "name": f"{name}, protocol {protocol}" + (", buffers beside" if beside else ""),
                    "pickle": base64.b64encode(data).decode(),
                    "buffers": [base64.b64encode(b.raw()).decode() for b in buffers],
                    "native": json.dumps(native(value)),
                })
                if protocol == 2:
                    data = pickletools.optimize(data)
                    entries.append({**entries[-1], "name": f"{name}, optimized",
                                    "pickle": base64.b64encode(data).decode()})
    json.dump({"python": sys.version.split()[0], "numpy": np.__version__, "vectors": entries}, sys.stdout, indent=0)
    print()


main()
