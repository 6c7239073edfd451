"""JSON with arrays beside it, into objects of Python."""

import datetime
import json
import re

import numpy as np

from . import labelled, pictures, tables
from .arrays import from_tensor, read_npy
from .values import MAX_DEPTH, TAG, Absent, Budget, DeviceArray, MessageError, Tagged, mapping, problem_text

#: Bytes of a message for each value in its JSON: an object takes far more than the two bytes of ``[]``.
BYTES_A_VALUE = 8

_DATETIME64 = re.compile(r"(?i:nat)|[-+]?\d{1,19}(-\d\d(-\d\d([T ]\d\d(:\d\d(:\d\d(\.\d{1,18})?)?)?)?)?)?", re.ASCII)
_STRINGS = re.compile(r'"(?:[^"\\]|\\.)*"', re.DOTALL)

#: Tags whose body becomes an object of a library.
_LIBRARIES = {
    "table": tables.read,
    "picture": pictures.read,
    "labelled": labelled.read,
    "quantity": labelled.read_quantity,
}


def read(text, tensors, limit):
    """The object that a ``NativeObject`` message holds."""
    reader = Reader(tensors, Budget(limit))
    _count_values(text, limit // BYTES_A_VALUE)
    return reader.value(_parse(text), 0)


def _parse(text):
    try:
        return json.loads(text)
    except RecursionError:
        raise MessageError(f"JSON nested far deeper than {MAX_DEPTH}") from None
    except ValueError as problem:
        raise MessageError(f"malformed JSON: {problem}") from None


def _count_values(text, limit):
    def count(text):
        return 1 + sum(map(text.count, ",[{"))

    # Exactly only where it matters: texts may be full of commas.
    if count(text) > limit and count(_STRINGS.sub("", text)) > limit:
        raise MessageError(f"JSON of more than {limit} values: raise limit_mib")


class Reader:
    """Reads the JSON of one message."""

    def __init__(self, tensors, budget):
        self.tensors, self.budget, self.arrays = tensors, budget, {}

    def value(self, found, depth):
        """The object for parsed JSON inside `depth` containers. Lists and dicts are filled where they are."""
        kind = type(found)
        if kind is not dict and kind is not list:
            return found
        if depth >= MAX_DEPTH:
            raise MessageError(f"nested deeper than {MAX_DEPTH}")
        if kind is dict and TAG in found:
            meaning = found[TAG]
            if isinstance(meaning, list) and not (meaning and not isinstance(meaning[0], str)):
                return self.tagged(meaning, depth)
            if meaning is not None and not isinstance(meaning, (str, list)):
                raise MessageError(f"{TAG} is a list that begins with a name, or an ordinary text")
        for key, inner in found.items() if kind is dict else enumerate(found):
            if type(inner) in (dict, list):
                try:
                    found[key] = self.value(inner, depth + 1)
                except MessageError as error:
                    error.inside(key)
                    raise
        return found

    def tagged(self, meaning, depth):
        """What ``{"__wrapyfi__": [tag, body, …]}`` stands for."""
        if not meaning:
            raise MessageError("a tag without its name")
        tag, *parts = meaning
        reads = getattr(self, _READERS.get(tag, ""), None)
        if reads is None and tag not in _LIBRARIES:
            parts = [self.value(part, depth + 1) for part in parts]
            return Tagged(tag, parts, "no tag of this package; plug-ins and pickles are not run")
        if not parts:
            raise MessageError(f"tag {tag!r} without its body")
        if reads is not None:
            return reads(parts, depth)
        body = self.value(parts[0], depth + 1)
        try:
            return _LIBRARIES[tag](body, self)
        except Absent as absent:
            return Tagged(tag, [body], str(absent))
        except MessageError:
            raise
        except Exception as problem:  # a library has its own opinion of what it takes
            return Tagged(tag, [body], problem_text(problem))

    def members(self, body, depth):
        """Whatever Python can iterate over, as ``tuple(body)`` does."""
        # A list is the container that the tag itself counted as.
        members = self.value(body, depth if isinstance(body, list) else depth + 1)
        if not isinstance(members, (list, tuple, set, str, dict)):
            raise MessageError(f"{type(members).__name__} has no members")
        return members

    def tuple(self, parts, depth):
        return tuple(self.members(parts[0], depth))

    def set(self, parts, depth):
        try:
            return set(self.members(parts[0], depth))
        except TypeError as problem:
            raise MessageError(f"member of a set: {problem}") from None

    def datetime(self, parts, _depth):
        try:
            return datetime.datetime.fromisoformat(parts[0])
        except (TypeError, ValueError) as problem:
            raise MessageError(f"datetime: {problem}") from None

    def datetime64(self, parts, _depth):
        if not isinstance(parts[0], str) or not _DATETIME64.fullmatch(parts[0]):
            raise MessageError(f"{str(parts[0])[:40]!r} is no numpy.datetime64")
        try:
            return np.datetime64(parts[0])
        except ValueError as problem:
            raise MessageError(f"numpy.datetime64: {problem}") from None

    def ndarray(self, parts, _depth):
        return read_npy(parts[0], self.budget)

    def tensor(self, parts, depth):
        index = parts[0]
        if type(index) is not int or not 0 <= index < len(self.tensors):
            raise MessageError(f"tensor {str(index)[:20]} of {len(self.tensors)} tensors")
        if index not in self.arrays:
            try:
                self.arrays[index] = from_tensor(self.tensors[index])
            except MessageError as error:
                error.inside(f"tensors[{index}]")
                raise
        found = self.arrays[index]
        if len(parts) == 1:
            return found
        origin = mapping(self.value(parts[1], depth + 1), "origin")
        if not isinstance(origin.get("key"), str) or not all(isinstance(text, str) for text in origin.values()):
            raise MessageError("the origin of a tensor is a dict of texts with a key")
        return DeviceArray.of(found, getattr(found, "device_label", ""), origin)


#: Tags that need no library, and the method that reads each.
_READERS = {
    "tuple": "tuple",
    "set": "set",
    "datetime": "datetime",
    "numpy.datetime64": "datetime64",
    "numpy.ndarray": "ndarray",
    "tensor": "tensor",
}
