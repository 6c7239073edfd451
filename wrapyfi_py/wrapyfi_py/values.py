"""What both directions share: errors, limits, and the two types of value that are ours."""

import importlib
from dataclasses import dataclass, field

import numpy as np

#: The member that makes a JSON object stand for something else.
TAG = "__wrapyfi__"

#: Containers inside each other, in what is read and what is written.
MAX_DEPTH = 64

#: Bytes of a message, and of everything that is copied out of it.
MAX_MESSAGE_MIB = 64


class MessageError(ValueError):
    """A message, or an object that shall become one, is wrong; the text says where, and why."""

    def __init__(self, reason):
        super().__init__(reason)
        self.reason = reason
        self._path = []

    def inside(self, step):
        """Adds the key or index under which the fault lies; called from the inside out."""
        self._path.append(f"[{step}]" if isinstance(step, int) else f".{step}")
        return self

    @property
    def path(self):
        """Place of the fault: ``$.frames[3]``."""
        return "$" + "".join(reversed(self._path))

    def __str__(self):
        return f"{self.path}: {self.reason}"


@dataclass
class Tagged:
    """An object that stays as the message has it: of an unknown plug-in, or of a library that is not here.

    ``from_python`` writes it as it came.
    """

    #: Name of what it is: ``table``, ``picture``, or the key of a plug-in.
    tag: str
    #: What stands behind the tag: one dict for the tags of the graph, with arrays in it.
    parts: list
    #: Why it was not made into an object of Python.
    reason: str = field(default="", compare=False)

    @property
    def body(self):
        """The first part, ``None`` without any."""
        return self.parts[0] if self.parts else None


class DeviceArray(np.ndarray):
    """A NumPy array that remembers which library it came from, and on which device that held it.

    What is computed from it is an ordinary array's: without a device, without an origin.
    """

    #: Label of the device: ``cuda:0``; empty for main memory.
    device_label = ""
    #: Library and what it remembers: ``{"key": "PytorchTensor", "requires_grad": "true"}``.
    origin = None

    @classmethod
    def of(cls, array, device_label="", origin=None):
        """The array with a label and an origin; no element is copied."""
        view = np.asarray(array).view(cls)
        view.device_label, view.origin = device_label, origin
        return view


class Budget:
    """Bytes that may still be copied out of one message, so that a small one cannot fill the memory."""

    def __init__(self, limit):
        self.limit, self.taken = limit, 0

    def take(self, what, count):
        """Books a copy before it is made."""
        self.taken += count
        if self.taken > self.limit:
            raise MessageError(f"{what} would need {self.taken} bytes, the limit is {self.limit}: raise limit_mib")


class Absent(Exception):
    """A library that an object needs is not installed, or does not take the object."""


def problem_text(problem):
    """What an exception of somebody else says, in a length for a message."""
    return f"{type(problem).__name__}: {str(problem)[:200]}"


def library(name):
    """A library, imported now because a message has an object of it."""
    try:
        return importlib.import_module(name)
    except Exception as problem:  # an installation that is broken raises anything
        raise Absent(f"{name} cannot be imported: {problem}") from None


def member(body, key, kind, what):
    """A member of a tag's body, which must be of a type."""
    found = body.get(key)
    if not isinstance(found, kind) or isinstance(found, bool):
        raise MessageError(f"{key} of a {what} is {_name(found)}, not {_kind_name(kind)}")
    return found


def mapping(body, what):
    """A tag's body, which must be a dict."""
    if not isinstance(body, dict):
        raise MessageError(f"a {what} is {_name(body)}, not a dict")
    return body


def _kind_name(kind):
    return " or ".join(k.__name__ for k in kind) if isinstance(kind, tuple) else kind.__name__


def _name(value):
    return "missing" if value is None else f"of type {type(value).__name__}"
