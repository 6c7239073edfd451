"""Objects of Python into JSON with arrays beside it."""

import datetime
import json
import sys

import numpy as np

from . import labelled, pictures, tables
from .arrays import as_array, is_tensor, tensor_fields, write_npy
from .values import MAX_DEPTH, TAG, MessageError, Tagged, problem_text

#: Libraries whose objects have a tag, and what writes each. A library that nobody imported has no objects.
_LIBRARIES = {
    "pandas": tables.write_pandas,
    "pyarrow": tables.write_arrow,
    "PIL.Image": pictures.write,
    "xarray": labelled.write,
    "pint": labelled.write_quantity,
}


def write(value):
    """The JSON of an object, and the arrays beside it."""
    writer = Writer()
    found = writer.value(value, 0)
    try:
        return json.dumps(found), writer.arrays
    except ValueError as problem:  # an integer of more digits than Python writes
        raise MessageError(str(problem)) from None


def tagged(tag, *parts):
    """The JSON object for a tagged value."""
    return {TAG: [tag, *parts]}


class Writer:
    """Writes the JSON of one message."""

    def __init__(self):
        self.arrays = []

    def value(self, value, depth):
        """The JSON for an object inside `depth` containers."""
        if value is None or isinstance(value, (bool, int, float, str)):
            return value
        if depth >= MAX_DEPTH:
            raise MessageError(f"nested deeper than {MAX_DEPTH}")
        if isinstance(value, list):
            return self.items(value, depth)
        if isinstance(value, dict):
            return self.dict(value, depth)
        if isinstance(value, tuple):
            return tagged("tuple", self.items(value, depth))
        if isinstance(value, (set, frozenset)):
            return tagged("set", self.set(value, depth))
        if isinstance(value, datetime.datetime):
            return _datetime(value)
        if isinstance(value, np.datetime64):
            return tagged("numpy.datetime64", str(value))
        if isinstance(value, (np.ndarray, np.generic)):
            return self.array(value)
        if isinstance(value, Tagged):
            return tagged(value.tag, *(self.value(part, depth + 1) for part in value.parts))
        return self.foreign(value, depth)

    def items(self, items, depth):
        found = []
        for index, item in enumerate(items):
            try:
                found.append(self.value(item, depth + 1))
            except MessageError as error:
                error.inside(index)
                raise
        return found

    def set(self, members, depth):
        for member in members:
            if isinstance(member, frozenset):
                raise MessageError("a set as member of a set: use tuples inside sets, or a list")
        return self.items(members, depth)

    def dict(self, members, depth):
        found = {}
        for key, member in members.items():
            text = _key(key)
            if text in found:
                raise MessageError(f"two keys become {text!r} in JSON, which has text alone: rename one")
            try:
                found[text] = self.value(member, depth + 1)
            except MessageError as error:
                error.inside(text)
                raise
        if TAG in found and _is_misread(members[TAG]):
            raise MessageError(f"a dict with the key {TAG} that a receiver takes for a tag: use another key")
        return found

    def array(self, elements):
        elements = as_array(elements)
        if not is_tensor(elements):
            return tagged("numpy.ndarray", write_npy(elements))
        self.arrays.append(tensor_fields(elements))
        origin = getattr(elements, "origin", None)
        return tagged("tensor", len(self.arrays) - 1, *([origin] if origin else []))

    def foreign(self, value, depth):
        """An object of a library: its tag, or the array that it says it is."""
        for name, writes in _LIBRARIES.items():
            try:
                found = name in sys.modules and writes(value)
            except MessageError:
                raise
            except Exception as problem:  # a library has its own opinion of its objects
                raise MessageError(f"{type(value).__name__}: {problem_text(problem)}") from None
            if found:
                tag, body = found
                return tagged(tag, self.value(body, depth + 1))
        if isinstance(value, (bytes, bytearray, memoryview)):
            raise MessageError("raw bytes have no form in JSON: send numpy.frombuffer(value, numpy.uint8)")
        if hasattr(value, "__array__"):
            return self.array(value)
        remedy = {
            complex: "numpy.complex128",
            datetime.date: "datetime.datetime",
            datetime.timedelta: "numpy.timedelta64, or seconds",
            datetime.time: "its isoformat()",
        }.get(type(value), "its parts")
        raise MessageError(f"an object of type {type(value).__module__}.{type(value).__qualname__}: send {remedy}")


class CellWriter(Writer):
    """Writes the JSON of an object in a table, which has no arrays beside it."""

    def array(self, elements):
        return tagged("numpy.ndarray", write_npy(as_array(elements)))

    def foreign(self, value, depth):
        raise MessageError(f"an object of type {type(value).__name__} in a table: cast the column")


def _datetime(value):
    if value != value:  # pandas's NaT, which is a datetime to Python
        return tagged("numpy.datetime64", "NaT")
    if getattr(value, "nanosecond", 0):
        raise MessageError("a datetime of pandas with nanoseconds: send its to_datetime64()")
    try:
        return tagged("datetime", value.isoformat())
    except Exception as problem:  # of a time zone that somebody wrote
        raise MessageError(f"a datetime: {problem_text(problem)}") from None


def _key(key):
    """A key as Python's json writes it."""
    if isinstance(key, str):
        return key
    if key is None or isinstance(key, (bool, int, float)):
        return json.dumps(key)
    raise MessageError(f"a key of type {type(key).__name__}: use text, a number, a bool or None")


def _is_misread(value):
    """Whether a receiver takes the value of the tag's key for a tag; there is no way to escape it."""
    if isinstance(value, list):
        return not value or isinstance(value[0], str)
    return value is not None and not isinstance(value, str)
