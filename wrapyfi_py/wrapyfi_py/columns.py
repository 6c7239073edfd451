"""Columns of a table, between what a message holds and an array of PyArrow."""

import decimal
import re
from dataclasses import dataclass
from typing import Any, Optional

import numpy as np

from .arrays import DTYPES
from .values import MessageError, mapping, member

#: Arrow's types of a fixed width, by name: what a tensor of theirs holds. Arrow has no complex numbers.
NUMBERS = {name: name for name, dtype in DTYPES.items() if dtype.kind in "biuf"}
NUMBERS |= {"date32": "int32", "date64": "int64"}
NUMBERS |= {"time32[s]": "int32", "time32[ms]": "int32", "time64[us]": "int64", "time64[ns]": "int64"}

#: Types whose values are those of other columns, or bytes; and the type of offsets where they have them.
NESTED = {
    "null": None,
    "list": "int32",
    "large_list": "int64",
    "binary": "int32",
    "map": "int32",
    "fixed_size_list": None,
    "struct": None,
}

TEXTS = ("utf8", "large_utf8")

#: ``decimal128(5, 2)``: numbers as text
DECIMAL = re.compile(r"decimal128\((\d{1,2}), (-?\d{1,3})\)")

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
    #: Of lists and binary data: where each begins, and the last ends. Of lists of one size: that.
    offsets: Any = None
    #: Of lists: their items. Of structs: their fields.
    inner: tuple = ()
    #: Whether a value may be missing.
    nullable: bool = True

    def __len__(self):
        return len(self.data if self.type != "binary" else self.offsets[1:])

    @classmethod
    def read(cls, body, rows, depth=0):
        """Checks a column of a message; `rows` is of use to those whose data do not tell."""
        body, what = mapping(body, "column"), "column"
        name, kind = member(body, "name", str, what), member(body, "type", str, what)
        valid, dtype, categories = body.get("valid"), body.get("dtype", ""), None
        if not isinstance(dtype, str):
            raise MessageError(f"dtype of column {name[:40]!r} is no text")
        if depth > MAX_DEPTH:
            raise MessageError(f"columns nested deeper than {MAX_DEPTH}")
        nullable = body.get("nullable") is not False
        if kind in NESTED:
            return cls(name, dtype, kind, nullable=nullable, **_nested(body, kind, rows, depth))
        if kind in TEXTS or DECIMAL.fullmatch(kind):
            data = member(body, "data", list, what)
            if not all(text is None or isinstance(text, str) for text in data):
                raise MessageError(f"column {name[:40]!r} has something else than text")
            return cls(name, dtype, kind, data, nullable=nullable)
        codes = kind if kind != "dictionary" else member(body, "codes", str, what)
        element = NUMBERS.get(codes) or ("int64" if TIMES.fullmatch(codes) else None)
        if element is None or codes.startswith("duration") and ", " in codes:
            raise MessageError(f"type {codes[:40]!r} of column {name[:40]!r} is not known")
        if kind == "dictionary":
            categories = cls.read(body.get("categories"), 0, depth + 1)
        data = _elements(body.get("data"), element, f"data of column {name[:40]!r}")
        if valid is not None:
            valid = _elements(valid, "bool", f"valid of column {name[:40]!r}")
            if len(valid) != len(data):
                raise MessageError(f"valid of column {name[:40]!r} has {len(valid)} of {len(data)} rows")
        return cls(
            name,
            dtype,
            kind if kind != "dictionary" else f"dictionary[{codes}]",
            data,
            valid,
            categories,
            nullable=nullable,
        )

    def copied_bytes(self):
        """Bytes at most that an object made of the column takes besides the message's own."""
        inner = sum(
            column.copied_bytes() for column in (*self.inner, *([self.categories] if self.categories else []))
        )
        if isinstance(self.data, range):
            return inner + len(self.data)
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
        if self.type in NESTED:
            return self._nested_to_arrow(arrow)
        kind = _arrow_type(arrow, self)
        if arrow.types.is_decimal(kind):
            return arrow.array(self.numbers(), kind)
        if isinstance(self.data, list):
            return arrow.array(self.data, kind)
        if self.type == "bool":
            return arrow.array(self.data, kind, mask=None if self.valid is None else ~self.valid)
        data = arrow.py_buffer(np.ascontiguousarray(self.data))
        return arrow.Array.from_buffers(kind, len(self.data), [self._bits(arrow), data])

    def numbers(self):
        """The numbers of a column of decimals."""
        try:
            return [None if text is None else decimal.Decimal(text) for text in self.data]
        except decimal.InvalidOperation:
            raise MessageError(f"column {self.name[:40]!r} of decimals has another text") from None

    def _bits(self, arrow):
        return None if self.valid is None else arrow.py_buffer(np.packbits(self.valid, bitorder="little"))

    def _nested_to_arrow(self, arrow):
        if self.type == "null":
            return arrow.nulls(len(self))
        children = [column.to_arrow(arrow) for column in self.inner]
        fields = [
            arrow.field(column.name, array.type, column.nullable) for column, array in zip(self.inner, children)
        ]
        kind = {
            "list": lambda: arrow.list_(fields[0]),
            "large_list": lambda: arrow.large_list(fields[0]),
            "fixed_size_list": lambda: arrow.list_(fields[0], self.offsets),
            "struct": lambda: arrow.struct(fields),
            "map": lambda: arrow.map_(*self._entry(arrow, fields[0])),
            "binary": arrow.binary,
        }[self.type]()
        buffers = [self._bits(arrow)]
        if isinstance(self.offsets, np.ndarray):
            buffers.append(arrow.py_buffer(np.ascontiguousarray(self.offsets)))
        if self.type == "binary":
            buffers.append(arrow.py_buffer(np.ascontiguousarray(self.data)))
        found = arrow.Array.from_buffers(kind, len(self), buffers, children=children)
        found.validate()
        return found


    def _entry(self, arrow, entries):
        """Fields of the key and of the value in the entries of a map."""
        if not arrow.types.is_struct(entries.type) or entries.type.num_fields != 2:
            raise MessageError(f"column {self.name[:40]!r} of maps has items that are no key and value")
        return entries.type.field(0), entries.type.field(1)


def _nested(body, kind, rows, depth):
    """What a column has that is made of others, or of bytes."""
    found, element = {"data": range(rows)}, NESTED[kind]
    if element:
        offsets = _elements(body.get("offsets"), element, f"offsets of a {kind}")
        if not len(offsets) or offsets[0] < 0 or (np.diff(offsets) < 0).any():
            raise MessageError(f"offsets of a {kind} are no numbers from 0 on that never fall")
        rows, last = len(offsets) - 1, int(offsets[-1])
        found = {"data": range(rows), "offsets": offsets}
        if kind == "binary":
            found["data"] = _elements(body.get("data"), "uint8", "data of binary values")
            there = len(found["data"])
        else:
            found["inner"] = (Column.read(body.get("items"), last, depth + 1),)
            there = len(found["inner"][0])
        if there < last:
            raise MessageError(f"offsets of a {kind} end at {last}, {there} are there")
    elif kind == "fixed_size_list":
        size = member(body, "size", int, kind)
        items = Column.read(body.get("items"), rows * max(size, 0), depth + 1)
        if size < 0 or len(items) != rows * size:
            raise MessageError(f"{rows} lists of {size} have {len(items)} items")
        found |= {"offsets": size, "inner": (items,)}
    elif kind == "struct":
        fields = member(body, "fields", list, kind)
        found["inner"] = tuple(Column.read(field, rows, depth + 1) for field in fields)
        # Categories have as many rows as their fields have.
        rows = len(found["inner"][0]) if fields else rows
        found["data"] = range(rows)
        if any(len(field) != rows for field in found["inner"]):
            raise MessageError(f"a field of a struct has another length than {rows} rows")
    valid = body.get("valid")
    if valid is not None and kind != "null":
        found["valid"] = _elements(valid, "bool", f"valid of a {kind}")
        if len(found["valid"]) != rows:
            raise MessageError(f"valid of a {kind} has {len(found['valid'])} of {rows} rows")
    return found


def _elements(data, element, what):
    if not isinstance(data, np.ndarray) or data.ndim != 1 or data.dtype.name != element:
        raise MessageError(f"{what} is no list of {element}")
    return np.asarray(data)


def _arrow_type(arrow, column):
    if column.type in ("utf8", "large_utf8"):
        return arrow.string() if column.type == "utf8" else arrow.large_string()
    decimals = DECIMAL.fullmatch(column.type)
    if decimals:
        return arrow.decimal128(int(decimals[1]), int(decimals[2]))
    times = column.unit() or re.fullmatch(r"(time32|time64)\[(.*)\]()", column.type)
    if isinstance(times, re.Match):
        return getattr(arrow, times[1])(times[2])
    if not times:
        return getattr(arrow, {"bool": "bool_"}.get(column.type, column.type))()
    kind, unit, zone = times
    return arrow.timestamp(unit, zone) if kind == "timestamp" else arrow.duration(unit)


def column_of(array, name, nullable=True):
    """The body of a column but its name, for an array of PyArrow."""
    body = _column_of(array, name)
    return body if nullable else body | {"nullable": False}


def _column_of(array, name):
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
    nested = _nested_of(arrow, array, name)
    if nested:
        missing = array.null_count and nested["type"] != "null"
        return nested | ({"valid": np.asarray(array.is_valid().to_numpy(zero_copy_only=False))} if missing else {})
    if kind in ("string", "large_string", "string_view"):
        return {"type": "large_utf8" if kind == "large_string" else "utf8", "data": array.to_pylist()}
    if DECIMAL.fullmatch(kind):
        texts = [None if number is None else format(number, "f") for number in array.to_pylist()]
        return {"type": kind, "data": texts}
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


def _nested_of(arrow, array, name):
    """The body of a column that is made of others, or of bytes; ``None`` for any other."""
    types, kind = arrow.types, array.type

    def inner(field, items):
        return {"name": field.name, **column_of(items, name, field.nullable)}

    if types.is_null(kind):
        return {"type": "null"}
    if types.is_list(kind) or types.is_large_list(kind):
        offsets = array.offsets.to_numpy()
        begin = offsets[0] if len(offsets) else 0
        items = array.values.slice(begin, (offsets[-1] if len(offsets) else 0) - begin)
        word = "list" if types.is_list(kind) else "large_list"
        return {"type": word, "offsets": offsets - begin, "items": inner(kind.value_field, items)}
    if types.is_map(kind):
        offsets = array.offsets.to_numpy()
        begin, end = (offsets[0], offsets[-1]) if len(offsets) else (0, 0)
        fields = [
            inner(field, part.slice(begin, end - begin))
            for field, part in ((kind.key_field, array.keys), (kind.item_field, array.items))
        ]
        entries = {"name": "entries", "type": "struct", "fields": fields, "nullable": False}
        return {"type": "map", "offsets": offsets - begin, "items": entries}
    if types.is_fixed_size_list(kind):
        size = kind.list_size
        items = array.values.slice(array.offset * size, len(array) * size)
        return {"type": "fixed_size_list", "size": size, "items": inner(kind.value_field, items)}
    if types.is_struct(kind):
        fields = [inner(kind.field(number), array.field(number)) for number in range(kind.num_fields)]
        return {"type": "struct", "fields": fields}
    if types.is_binary(kind):
        _, offsets, data = array.buffers()
        offsets = (
            np.frombuffer(offsets, "<i4")[array.offset : array.offset + len(array) + 1]
            if len(array)
            else np.zeros(1, "i4")
        )
        data = np.frombuffer(data, np.uint8) if data is not None else np.zeros(0, "u1")
        return {"type": "binary", "offsets": offsets - offsets[0], "data": data[offsets[0] : offsets[-1]]}
    return None
