"""Arrays: the fields of ``wrapyfi_msgs/msg/Tensor``, and ``.npy`` files inside JSON."""

import array
import ast
import base64
import binascii
import io
import math

import numpy as np

from .values import DeviceArray, MessageError, problem_text

#: Element types of a tensor, little-endian; ``bfloat16`` besides.
DTYPES = {
    name: np.dtype(np.dtype(name).newbyteorder("<").str)
    for name in (
        "bool",
        "int8",
        "int16",
        "int32",
        "int64",
        "uint8",
        "uint16",
        "uint32",
        "uint64",
        "float16",
        "float32",
        "float64",
        "complex64",
        "complex128",
    )
}

#: Longest header of a ``.npy`` file, as NumPy itself has it.
MAX_HEADER = 10_000


def from_tensor(message):
    """The array of a ``Tensor`` message: a view of its bytes, nothing is copied.

    ``bfloat16`` needs the package ml_dtypes; without it the elements are copied into ``float32``, which
    holds each of them.
    """
    dtype, widen = _element_type(message.dtype)
    try:
        shape = tuple(int(extent) for extent in message.shape)
    except (TypeError, ValueError, OverflowError) as problem:
        raise MessageError(f"shape: {problem}").inside("shape") from None
    found = octets(message.data, "data")
    wanted = math.prod(shape) * dtype.itemsize
    if min(shape, default=0) < 0 or wanted != found.size:
        raise MessageError(f"{message.dtype} array {list(shape)} needs {wanted} bytes, {found.size} are there")
    try:
        elements = found.view(dtype)
        if widen:
            elements = np.left_shift(elements, 16, dtype="<u4").view("<f4")
        elements = elements.reshape(shape)
    except ValueError as problem:  # more dimensions than NumPy has
        raise MessageError(f"shape of {len(shape)} dimensions: {problem}") from None
    if dtype == bool and (found > 1).any():
        raise MessageError("a bool that is neither 0 nor 1")
    device = str(message.device)
    return DeviceArray.of(elements, device) if device else elements


def _element_type(name):
    if isinstance(name, str) and name in DTYPES:
        return DTYPES[name], False
    if name != "bfloat16":
        raise MessageError(f"dtype {str(name)[:40]!r} is none of {', '.join(DTYPES)}, bfloat16").inside("dtype")
    try:
        import ml_dtypes
    except ImportError:
        return np.dtype("<u2"), True
    return np.dtype(ml_dtypes.bfloat16), False


def octets(data, name):
    """The bytes of a field, as a view where it is a buffer and not a list."""
    try:
        if isinstance(data, (list, tuple)):
            data = bytes(data)
        return np.frombuffer(data, np.uint8)
    except (TypeError, ValueError, BufferError) as problem:
        raise MessageError(f"{name} of type {type(data).__name__}: {problem}").inside(name) from None


def buffer(elements):
    """The bytes of an array as ROS messages of rclpy hold them."""
    data = array.array("B")
    data.frombytes(np.ascontiguousarray(elements).reshape(-1).view(np.uint8).data)
    return data


def as_array(value):
    """The array that an object says it is."""
    if np.ma.isMaskedArray(value):
        raise MessageError("a masked array: send its filled(), and its mask beside that")
    try:
        return np.asanyarray(value)
    except Exception as problem:  # whatever the object's own conversion raises
        raise MessageError(f"{type(value).__name__} as NumPy array: {problem_text(problem)}") from None


def is_tensor(elements):
    """Whether an array has elements that a ``Tensor`` message holds."""
    return elements.dtype.name in DTYPES or elements.dtype.name == "bfloat16"


def tensor_fields(elements):
    """The fields of the ``Tensor`` message for an array of numbers."""
    dtype = elements.dtype
    if dtype.byteorder == ">" or dtype.byteorder == "=" and not np.little_endian:
        elements = elements.astype(dtype.newbyteorder("<"))
    return {
        "dtype": dtype.name,
        "shape": array.array("Q", elements.shape),
        "device": getattr(elements, "device_label", ""),
        "data": buffer(elements),
    }


def read_npy(text, budget):
    """The array of a base64 ``.npy`` file. Its size is checked before anything is made of it; objects, which
    are pickles, are refused."""
    if not isinstance(text, str):
        raise MessageError(f"a numpy.ndarray is text, not of type {type(text).__name__}")
    budget.take("an array in base64", len(text) * 3 // 4)
    try:
        file = base64.b64decode(text)
    except (binascii.Error, ValueError) as problem:
        raise MessageError(f"base64 of an array: {problem}") from None
    version, begin, length_bytes = file[6:8], 12, 4
    if file[:6] != b"\x93NUMPY" or version not in (b"\1\0", b"\2\0", b"\3\0"):
        raise MessageError("an array that is no .npy file of version 1 to 3")
    if version == b"\1\0":
        begin, length_bytes = 10, 2
    length = int.from_bytes(file[8 : 8 + length_bytes], "little")
    if length > MAX_HEADER:
        raise MessageError(f"header of a .npy file: {length} bytes, the limit is {MAX_HEADER}")
    header = file[begin : begin + length].decode("utf-8" if version == b"\3\0" else "latin-1", "replace")
    try:
        fields = ast.literal_eval(header.strip())
        shape, order = tuple(fields["shape"]), "F" if fields["fortran_order"] else "C"
        dtype = np.lib.format.descr_to_dtype(fields["descr"])
        if not all(type(extent) is int and extent >= 0 for extent in shape):
            raise ValueError(f"shape {shape}")
    except Exception as problem:  # NumPy and the parser raise whatever a header leads them to
        raise MessageError(f"header of a .npy file: {problem}") from None
    if dtype.hasobject:
        raise MessageError("an array of objects is a pickle and is not read")
    count, there = math.prod(shape), len(file) - begin - length
    if count * dtype.itemsize > there:
        raise MessageError(
            f"{dtype} array {list(shape)} needs {count * dtype.itemsize} bytes, {max(there, 0)} are there"
        )
    try:
        if count * dtype.itemsize == 0:
            return np.zeros(shape, dtype)
        return np.frombuffer(file, dtype, count, begin + length).reshape(shape, order=order)
    except ValueError as problem:
        raise MessageError(f"{dtype} array {list(shape)}: {problem}") from None


def write_npy(elements):
    """The base64 ``.npy`` file of an array whose elements are no plain numbers."""
    if elements.dtype.hasobject:
        raise MessageError("an array of Python objects: use numbers, text of a fixed length, or a list")
    file = io.BytesIO()
    np.lib.format.write_array(file, np.asarray(elements), allow_pickle=False)
    return base64.b64encode(file.getvalue()).decode()
