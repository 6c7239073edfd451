"""Columns of a table, between what a message holds and an array of PyArrow."""

import re
from dataclasses import dataclass
from typing import Any, Optional

import numpy as np

from .values import MessageError, mapping, member

#: Arrow's types of a fixed width, by name: what a tensor of theirs holds.
NUMBERS = {
    name: name
    for name in (
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
    )
}
NUMBERS |= {"date32": "int32", "date64": "int64", "bool": "bool"}

TEXTS = ("utf8", "large_utf8")

#: ``timestamp[ns]``, ``timestamp[us, Europe/Berlin]``, ``duration[s]``
TIMES = re.compile(r"(timestamp|duration)\[(s|ms|us|ns)(?:, ([^\]]{1,64}))?\]")

#: Categories of categories.
MAX_DEPTH = 8


@dataclass
class Column:
    """A column as a message has it."""

    #: Label, where that is text; the frame has the others.
    name: str
    #: pandas's name of the type, empty without one.
    dtype: str
    #: Arrow's name of the type.
    type: str
    #: A one-dimensional array, or a list of texts.
    data: Any
    #: A bool for each row that is not missing; ``None`` where none is missing.
    valid: Optional[np.ndarray] = None
    #: Of a dictionary: its values.
    categories: Optional["Column"] = None

    def __len__(self):
        return len(self.data)

    @classmethod
    def read(cls, body, depth=0):
        """Checks a column of a message."""
        body, what = mapping(body, "column"), "column"
        name, kind = member(body, "name", str, what), member(body, "type", str, what)
        valid, dtype, categories = body.get("valid"), body.get("dtype", ""), None
        if not isinstance(dtype, str):
            raise MessageError(f"dtype of column {name[:40]!r} is no text")
        if kind in TEXTS:
            data = member(body, "data", list, what)
            if not all(text is None or isinstance(text, str) for text in data):
                raise MessageError(f"column {name[:40]!r} has something else than text")
            return cls(name, dtype, kind, data)
        codes = kind if kind != "dictionary" else member(body, "codes", str, what)
        element = NUMBERS.get(codes) or ("int64" if TIMES.fullmatch(codes) else None)
        if element is None or codes.startswith("duration") and ", " in codes:
            raise MessageError(f"type {codes[:40]!r} of column {name[:40]!r} is not known")
        if kind == "dictionary":
            if depth >= MAX_DEPTH:
                raise MessageError(f"categories nested deeper than {MAX_DEPTH}")
            categories = cls.read(body.get("categories"), depth + 1)
        data = _elements(body.get("data"), element, f"data of column {name[:40]!r}")
        if valid is not None:
            valid = _elements(valid, "bool", f"valid of column {name[:40]!r}")
            if len(valid) != len(data):
                raise MessageError(f"valid of column {name[:40]!r} has {len(valid)} of {len(data)} rows")
        return cls(name, dtype, kind if kind != "dictionary" else f"dictionary[{codes}]", data, valid, categories)

    def copied_bytes(self):
        """Bytes at most that an object made of the column takes besides the message's own."""
        inner = self.categories.copied_bytes() if self.categories else 0
        return inner + (8 * len(self.data) if isinstance(self.data, list) else 2 * self.data.nbytes)

    def unit(self):
        """Kind, unit and zone of times; ``None`` for anything else."""
        found = TIMES.fullmatch(self.type)
        return found and found.groups()

    def to_arrow(self, arrow):
        """The array of PyArrow, over the message's bytes where they are as Arrow's."""
        if self.categories is not None:
            mask = None if self.valid is None else ~self.valid
            codes = arrow.array(self.data, mask=mask)
            return arrow.DictionaryArray.from_arrays(codes, self.categories.to_arrow(arrow))
        kind = _arrow_type(arrow, self)
        if isinstance(self.data, list):
            return arrow.array(self.data, kind)
        if self.type == "bool":
            return arrow.array(self.data, kind, mask=None if self.valid is None else ~self.valid)
        bits = None
        if self.valid is not None:
            bits = arrow.py_buffer(np.packbits(self.valid, bitorder="little"))
        data = arrow.py_buffer(np.ascontiguousarray(self.data))
        return arrow.Array.from_buffers(kind, len(self.data), [bits, data])


def _elements(data, element, what):
    if not isinstance(data, np.ndarray) or data.ndim != 1 or data.dtype.name != element:
        raise MessageError(f"{what} is no list of {element}")
    return np.asarray(data)


def _arrow_type(arrow, column):
    if column.type in ("utf8", "large_utf8"):
        return arrow.string() if column.type == "utf8" else arrow.large_string()
    times = column.unit()
    if not times:
        return getattr(arrow, {"bool": "bool_"}.get(column.type, column.type))()
    kind, unit, zone = times
    return arrow.timestamp(unit, zone) if kind == "timestamp" else arrow.duration(unit)


def column_of(array, name):
    """The body of a column but its name, for an array of PyArrow."""
    import pyarrow as arrow

    if isinstance(array, arrow.ChunkedArray):
        array = array.combine_chunks()
        if isinstance(array, arrow.ChunkedArray):  # of no chunk
            array = arrow.array([], array.type)
    kind = str(array.type)
    if arrow.types.is_dictionary(array.type):
        codes = column_of(array.indices, name)
        body = {
            "type": "dictionary",
            "codes": codes["type"],
            "data": codes["data"],
            "categories": {"name": "", **column_of(array.dictionary, name)},
        }
        return body | ({"valid": codes["valid"]} if "valid" in codes else {})
    if kind in ("string", "large_string", "string_view"):
        return {"type": "large_utf8" if kind == "large_string" else "utf8", "data": array.to_pylist()}
    # Arrow's own words for two of them.
    kind = {
        "halffloat": "float16",
        "float": "float32",
        "double": "float64",
        "date32[day]": "date32",
        "date64[ms]": "date64",
    }.get(kind, kind).replace(", tz=", ", ")
    if kind not in NUMBERS and not TIMES.fullmatch(kind):
        raise MessageError(f"column {name!r} of type {array.type}: cast it, or send its to_pylist()")
    if kind == "bool":
        data = np.asarray(array.fill_null(False).to_numpy(zero_copy_only=False))
    else:
        width = np.dtype(NUMBERS.get(kind, "int64"))
        begin = array.offset * width.itemsize
        buffer = array.buffers()[1]
        data = (
            np.frombuffer(buffer, np.uint8)[begin : begin + len(array) * width.itemsize].view(width)
            if buffer is not None
            else np.zeros(len(array), width)
        )
    body = {"type": kind, "data": data}
    return body | ({"valid": np.asarray(array.is_valid().to_numpy(zero_copy_only=False))} if array.null_count else {})
