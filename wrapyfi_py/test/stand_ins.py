"""The classes of wrapyfi_msgs where ROS 2 is sourced, and classes with the same fields where it is not."""

import importlib.util
import types
from dataclasses import dataclass, field
from typing import Any

import wrapyfi_py


@dataclass
class Time:
    sec: int = 0
    nanosec: int = 0


@dataclass
class Header:
    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
class Tensor:
    dtype: str = ""
    shape: Any = ()
    device: str = ""
    data: Any = b""


@dataclass
class NativeObject:
    header: Header = field(default_factory=Header)
    json: str = ""
    tensors: Any = ()


@dataclass
class AudioChunk:
    header: Header = field(default_factory=Header)
    chunk_size: int = 0
    channels: int = 0
    sample_rate: int = 0
    encoding: str = ""
    is_bigendian: int = 0
    bitrate: int = 0
    coding_format: str = ""
    step: int = 0
    data: Any = b""


MESSAGES = types.SimpleNamespace(Tensor=Tensor, NativeObject=NativeObject, AudioChunk=AudioChunk)
if importlib.util.find_spec("wrapyfi_msgs"):
    import wrapyfi_msgs.msg as MESSAGES


def write(value, message="NativeObject"):
    return wrapyfi_py.from_python(value, message, messages=MESSAGES)


def travels(value, message="NativeObject"):
    """What becomes of an object that is sent and received."""
    return wrapyfi_py.to_python(write(value, message))


def missing(*names):
    """Why a test of these libraries is skipped, empty where all are there."""
    return ", ".join(f"{name} is not installed" for name in names if not importlib.util.find_spec(name))
