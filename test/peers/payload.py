"""Test payloads as pure functions of a sequence number, and digests that do not depend on the language.

A receiver never needs to see the sender: it can rebuild what message `seq` must contain.

    image(seq)    v = (7*row + 3*column + 11*channel + seq) mod 256; float images hold v / 255 as float32
    red(seq)      pure red in OpenCV's order: blue 0, green 0, red 255
    audio(seq)    ((13*frame + 5*channel + seq) mod 1000) / 1000 - 0.5 as float32
    native(seq)   dictionaries: `small` (JSON only), `rich` (tuple, set, date, arrays, Unicode),
                  `array` (one float32 array), `settings` (of a node: gain, lens.label)
"""
import datetime
import hashlib
import json

import numpy as np

HEIGHT, WIDTH = 48, 64


def _grid(seq, rows, columns, channels, factors, modulus):
    r, c, k = np.ogrid[:rows, :columns, :channels]
    return (factors[0] * r + factors[1] * c + factors[2] * k + seq) % modulus


def image(seq, flavour="colour", height=HEIGHT, width=WIDTH):
    if flavour == "red":
        frame = np.zeros((height, width, 3), np.uint8)
        frame[..., 2] = 255
        return frame
    mono = flavour in ("mono", "float_mono", "jpg_mono")
    frame = _grid(seq, height, width, 1 if mono else 3, (7, 3, 11), 256).astype(np.uint8)
    if mono:
        frame = frame[:, :, 0]
    if flavour.startswith("float"):
        frame = frame.astype(np.float32) / np.float32(255)
    return np.ascontiguousarray(frame)


def audio(seq, frames=441, channels=1):
    steps = _grid(seq, frames, channels, 1, (13, 5, 0), 1000)[:, :, 0]
    return np.ascontiguousarray(steps.astype(np.float32) / np.float32(1000) - np.float32(0.5))


def native(seq, flavour="small"):
    if flavour == "small":
        return {"seq": seq, "greeting": "hello", "e": 2.718281828459045, "yes": True, "nothing": None,
                "list": [1, -2, 3.5, "four"], "big": 2 ** 80 + seq}
    if flavour == "rich":
        return {"seq": seq, "text": "na\u00efve \u65e5\u672c\u8a9e \U0001f680 \"quoted\" \\ \n",
                "pair": (seq, "b"), "letters": {"x"}, "at": datetime.datetime(2025, 6, 7, 8, 9, 10, 112131),
                "matrix": np.arange(12, dtype="<i4").reshape(3, 4) * 2 + seq,
                "flags": np.array([True, False, True]), "half": np.float16([0.5, -2.0]),
                "deep": {"list": [{"tuple": (1, 2)}]}}
    if flavour == "array":
        return {"seq": seq, "ramp": np.arange(5000, dtype="<f4") / np.float32(8) + np.float32(seq)}
    if flavour == "settings":
        return {"gain": seq + 0.5, "lens": {"label": f"take {seq}"}}
    raise ValueError(f"no native flavour {flavour!r}")


def neutral(value):
    """Plain JSON that says the same in every language; arrays by dtype, shape and hash of the bytes."""
    if isinstance(value, (np.ndarray, np.generic)):
        value = np.asarray(value)
        raw = np.ascontiguousarray(value).tobytes()
        return {"@array": {"dtype": value.dtype.str, "shape": list(value.shape),
                           "sha256": hashlib.sha256(raw).hexdigest()}}
    if isinstance(value, tuple):
        return {"@tuple": [neutral(v) for v in value]}
    if isinstance(value, (set, frozenset)):
        return {"@set": sorted((neutral(v) for v in value), key=str)}
    if isinstance(value, datetime.datetime):
        return {"@datetime": value.isoformat()}
    if isinstance(value, dict):
        return {str(k): neutral(v) for k, v in value.items()}
    if isinstance(value, list):
        return [neutral(v) for v in value]
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    return {"@other": type(value).__name__}


def digest(value):
    """Hash of the bytes of an array, or of the canonical text of anything else."""
    if isinstance(value, np.ndarray):
        return hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
    text = json.dumps(neutral(value), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
