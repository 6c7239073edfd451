"""Tables as frames, series and indices of pandas.

What a column has no place for stands beside the columns:

============  ===================================================================================
kind          ``DataFrame``, ``Series`` or ``Index``
index         ``range START STOP STEP``, ``column``: the first one, ``levels N``: the first N ones
index_name    JSON of the index's name or names, where they are not those of the columns
freq          step of the times in the index
labels        JSON of the columns' labels, where they are not the columns' names
columns_name  JSON of the name or names of the labels
============  ===================================================================================
"""

import dataclasses
import datetime
import json
import re
import zoneinfo

import numpy as np

from .columns import DECIMAL, NESTED, column_of
from .values import Absent, MessageError, library, member

#: What pandas calls an array of PyArrow.
ARROW = "[pyarrow]"

#: dtype of a column of objects that are not of one kind: the JSON of each as text.
JSON = "object(json)"

#: ``interval[int64, right]``: a struct of left and right
_INTERVAL = re.compile(r"interval\[.*, (left|right|both|neither)\]")

#: Bytes that a value in such a JSON counts beside its own.
BYTES_A_VALUE = 64

_OFFSET = re.compile(r"([+-])(\d\d):(\d\d)")
_MISSING = {"object(nan)": lambda pandas: np.nan, "object(NA)": lambda pandas: pandas.NA}
_MASKED = {"i": "IntegerArray", "u": "IntegerArray", "f": "FloatingArray", "b": "BooleanArray"}


def read(body, rows, columns, reader):
    """The frame, series or index that a table is."""
    pandas = library("pandas")
    kind, text = body.get("kind", "DataFrame"), body.get("index")
    columns = [_parsed(column, reader) for column in columns]
    name = _json(body, "index_name", reader)
    if text is None:
        index = pandas.RangeIndex(rows, name=name)
    elif text == "column" and columns:
        first = columns.pop(0)
        index = pandas.Index(values(pandas, first), name=name if "index_name" in body else first.name)
        if "freq" in body:
            if not isinstance(index, (pandas.DatetimeIndex, pandas.TimedeltaIndex)):
                raise MessageError("freq of an index that has no times")
            index.freq = member(body, "freq", str, "table")
    else:
        index = _other_index(pandas, str(text), rows, columns, name)
    labels = _json(body, "labels", reader)
    if labels is None:
        labels = [column.name for column in columns]
    if not isinstance(labels, list) or len(labels) != len(columns):
        raise MessageError(f"labels of a table of {len(columns)} columns: {str(body.get('labels'))[:40]}")
    if kind == "Index":
        return index
    if len(index) != rows:
        raise MessageError(f"index of a table: {len(index)} labels for {rows} rows")
    if kind == "Series":
        if len(columns) != 1:
            raise MessageError(f"a Series of {len(columns)} columns")
        return pandas.Series(values(pandas, columns[0]), index=index, name=labels[0], copy=False)
    content = {number: values(pandas, column) for number, column in enumerate(columns)}
    frame = pandas.DataFrame(content, index=index, copy=False)
    frame.columns = _labels(pandas, labels, _json(body, "columns_name", reader))
    return frame


def _other_index(pandas, text, rows, columns, name):
    words = text.split(" ")
    try:
        numbers = [int(word) for word in words[1:]]
    except ValueError:
        numbers = []
    if words[0] == "range" and len(numbers) == 3 and numbers[2] != 0:
        return pandas.RangeIndex(*numbers, name=name)
    if words[0] == "levels" and len(numbers) == 1 and 1 <= numbers[0] <= len(columns):
        levels = [columns.pop(0) for _ in range(numbers[0])]
        if not all(level.categories is not None for level in levels):
            raise MessageError("a level of an index that is no dictionary")
        names = name if isinstance(name, list) else [level.name for level in levels]
        codes = [level.data if level.valid is None else np.where(level.valid, level.data, -1) for level in levels]
        return pandas.MultiIndex([values(pandas, level.categories) for level in levels], codes, names=names)
    raise MessageError(f"index {text[:40]!r} of a table")


def _labels(pandas, labels, name):
    """The row of labels: a range where it is one, as pandas itself makes it."""
    if labels and all(isinstance(label, tuple) for label in labels):
        return pandas.MultiIndex.from_tuples(labels, names=name)
    if all(type(label) is int and label == number for number, label in enumerate(labels)):
        return pandas.RangeIndex(len(labels), name=name)
    return pandas.Index(labels, name=name)


def _json(body, key, reader):
    text = body.get(key)
    if text is None:
        return None
    if isinstance(text, str):
        reader.budget.take(f"{key} of a table", BYTES_A_VALUE * sum(map(text.count, ",[{")))
    try:
        return reader.value(json.loads(text), 0)
    except (TypeError, ValueError, RecursionError) as problem:
        raise MessageError(f"{key} of a table: {problem}") from None


def _parsed(column, reader):
    """The column with the objects that it has as JSON."""
    if column.categories is not None:
        return dataclasses.replace(column, categories=_parsed(column.categories, reader))
    if column.dtype != JSON or not isinstance(column.data, list):
        return column
    return dataclasses.replace(column, data=Objects(_json({"cell": text}, "cell", reader) for text in column.data))


class Objects(list):
    """Objects of any kind."""


def values(pandas, column):
    """A column as an array that pandas takes."""
    dtype, data, valid = column.dtype, column.data, column.valid
    if isinstance(data, Objects):
        return _objects(data, None, None)
    if dtype.endswith(ARROW):
        return pandas.arrays.ArrowExtensionArray(column.to_arrow(library("pyarrow")))
    if dtype.startswith("period["):
        counts = data if valid is None else np.where(valid, data, np.iinfo("i8").min)
        return pandas.PeriodIndex.from_ordinals(counts, freq=dtype[7:-1])
    if column.categories is not None:
        codes = data if valid is None else np.where(valid, data, -1)
        return pandas.Categorical.from_codes(
            codes, pandas.Index(values(pandas, column.categories)), ordered=dtype == "category(ordered)"
        )
    closed = _INTERVAL.fullmatch(dtype)
    if closed and column.type == "struct" and len(column.inner) == 2:
        left, right = (pandas.Index(values(pandas, end)) for end in column.inner)
        return pandas.arrays.IntervalArray.from_arrays(left, right, closed[1])
    if DECIMAL.fullmatch(column.type):
        return _objects(column.numbers(), None, None)
    if column.type in NESTED or column.type.startswith(("time32", "time64")):
        return _objects(column.to_arrow(library("pyarrow")).to_pylist(), None, None)
    if isinstance(data, list):
        return _texts(pandas, data, dtype)
    times = column.unit()
    if times:
        return _times(pandas, data, valid, *times)
    if column.type in ("date32", "date64"):
        days = data.astype("M8[D]") if column.type == "date32" else data.astype("M8[ms]").astype("M8[D]")
        return _objects(days.astype(object).tolist(), valid, None)
    if dtype.startswith("object"):
        return _objects(data.tolist(), valid, _missing(pandas, dtype))
    kind = data.dtype.kind
    if column.type == "float16" and valid is not None:
        return np.where(valid, data, np.float16(np.nan))
    if valid is not None or dtype == "boolean" or dtype[:1] in ("I", "U", "F"):
        mask = np.zeros(len(data), bool) if valid is None else ~valid
        return getattr(pandas.arrays, _MASKED[kind])(data, mask)
    return data


def _missing(pandas, dtype):
    return _MISSING.get(dtype, lambda _pandas: None)(pandas)


def _objects(items, valid, missing):
    found = np.empty(len(items), object)
    # One by one: NumPy would make a second dimension of lists of one length.
    for row, item in enumerate(items):
        found[row] = item
    if valid is not None:
        found[~valid] = missing
    return found


def _texts(pandas, data, dtype):
    if dtype.startswith("object"):
        missing = _missing(pandas, dtype)
        return _objects([missing if text is None else text for text in data], None, None)
    # `str` is the text of pandas 3; before it there are objects.
    old = dtype != "string" and int(pandas.__version__.split(".")[0]) < 3
    return pandas.array(data, dtype=object if old else "string" if dtype == "string" else "str")


def _times(pandas, data, valid, kind, unit, zone):
    if valid is not None:
        data = np.where(valid, data, np.iinfo("i8").min)
    found = data.view(f"{'M' if kind == 'timestamp' else 'm'}8[{unit}]")
    if zone is None:
        return found
    return pandas.DatetimeIndex(found).tz_localize("UTC").tz_convert(_zone(zone))


def _zone(name):
    offset = _OFFSET.fullmatch(name)
    if offset:
        sign, hours, minutes = offset.groups()
        minutes = (int(hours) * 60 + int(minutes)) * (-1 if sign == "-" else 1)
        return datetime.timezone(datetime.timedelta(minutes=minutes))
    if name == "UTC":
        return datetime.timezone.utc
    try:
        # A key of the database alone: pandas itself would open a file of any name.
        return zoneinfo.ZoneInfo(name)
    except (OSError, ValueError, KeyError) as problem:
        raise Absent(f"time zone {name!r}: {problem}") from None


def write(value):
    """The body of a table for a frame, a series or an index; ``None`` for anything else."""
    import pandas

    if isinstance(value, pandas.Index):
        kind, index, columns, labels, names = "Index", value, [], [], None
    elif isinstance(value, pandas.Series):
        kind, index, columns, labels, names = "Series", value.index, [value.array], [value.name], None
    elif isinstance(value, pandas.DataFrame):
        kind, index, names = "DataFrame", value.index, value.columns.names
        columns, labels = [value.iloc[:, n].array for n in range(value.shape[1])], value.columns.tolist()
        # As the bridge has it: a list of names would be a label of that type.
        names = tuple(names) if isinstance(value.columns, pandas.MultiIndex) else names[0]
    else:
        return None
    if getattr(value, "attrs", None):
        raise MessageError("attrs of a frame are not sent: send them beside the frame")
    body = {"key": "PandasData", "kind": kind}
    written = _write_index(pandas, index, body)
    if len({label for label in labels if isinstance(label, str)}) < len(labels):
        body["labels"] = _label_json(labels)
    if names is not None:
        body["columns_name"] = _label_json(names)
    for label, values in zip(labels, columns):
        written.append({"name": _label_text(label), **_write_values(pandas, values, label)})
    return body | {"rows": len(index), "columns": written}


def _write_index(pandas, index, body):
    if isinstance(index, pandas.RangeIndex):
        if (index.start, index.step) != (0, 1) or index.name is not None:
            body["index"] = f"range {index.start} {index.stop} {index.step}"
        if index.name is not None:
            body["index_name"] = _label_json(index.name)
        return []
    if isinstance(index, pandas.MultiIndex):
        body["index"] = f"levels {index.nlevels}"
        if not all(isinstance(name, str) for name in index.names):
            body["index_name"] = _label_json(list(index.names))
        return [
            {"name": _label_text(name), "dtype": "category", **_dictionary(pandas, np.asarray(codes), level, name)}
            for name, codes, level in zip(index.names, index.codes, index.levels)
        ]
    body["index"] = "column"
    if not isinstance(index.name, str):
        body["index_name"] = _label_json(index.name)
    if getattr(index, "freq", None) is not None and not isinstance(index, pandas.PeriodIndex):
        body["freq"] = index.freqstr
    return [{"name": _label_text(index.name), **_write_values(pandas, index.array, index.name)}]


def _label_text(label):
    if label is None or isinstance(label, str):
        return label or ""
    if isinstance(label, tuple):
        return f"({', '.join(json.dumps(level) for level in label)})"
    return json.dumps(_plain(label))


def _label_json(label):
    from .writing import Writer

    return json.dumps(Writer().value(_plain(label), 0))


def _plain(label):
    """A label without NumPy's types, which pandas has in its indices."""
    if isinstance(label, (list, tuple)):
        return type(label)(map(_plain, label))
    label = label.item() if isinstance(label, np.generic) else label
    if label is None or isinstance(label, (bool, int, float, str)):
        return label
    raise MessageError(f"a label of type {type(label).__name__}: use text, a number or None")


def _dictionary(pandas, codes, categories, label):
    if len(codes) and (codes < 0).any():
        extra = {"valid": codes >= 0}
        codes = np.where(codes < 0, 0, codes).astype(codes.dtype)
    else:
        extra = {}
    return {
        "type": "dictionary",
        "codes": codes.dtype.name,
        "data": codes,
        **extra,
        "categories": {"name": "", **_write_values(pandas, categories.array, label)},
    }


def _write_values(pandas, array, label):
    """The body of a column but its name, for an array of pandas."""
    dtype = array.dtype
    name = str(dtype)
    if isinstance(dtype, pandas.ArrowDtype):
        import pyarrow

        return {"dtype": name} | column_of(pyarrow.array(array), str(label))
    if isinstance(dtype, pandas.StringDtype):
        texts = [text if isinstance(text, str) else None for text in array.astype(object)]
        return {"dtype": "str" if name == "str" else "string", "type": "utf8", "data": texts}
    if isinstance(dtype, pandas.CategoricalDtype):
        ordered = "category(ordered)" if dtype.ordered else "category"
        return {"dtype": ordered} | _dictionary(pandas, np.asarray(array.codes), dtype.categories, label)
    missing = np.asarray(array.isna())
    valid = {"valid": ~missing} if missing.any() else {}
    if isinstance(dtype, pandas.PeriodDtype):
        return {"dtype": name, "type": "int64", "data": np.asarray(array.asi8), **valid}
    if isinstance(dtype, pandas.DatetimeTZDtype) or dtype.kind in "mM":
        return {"dtype": name, **_write_times(pandas, array, dtype), **valid}
    if (
        isinstance(dtype, (pandas.Int64Dtype, pandas.Float64Dtype, pandas.BooleanDtype))
        or hasattr(dtype, "numpy_dtype")
        and name[:1] in "IUF"
    ):
        element = dtype.numpy_dtype
        data = array.to_numpy(dtype=element, na_value=element.type(0))
        return {"dtype": name, "type": element.name, "data": data, **valid}
    if isinstance(dtype, pandas.IntervalDtype):
        ends = (("left", array.left), ("right", array.right))
        fields = [{"name": end, **_write_values(pandas, index.array, label)} for end, index in ends]
        return {"dtype": name, "type": "struct", "fields": fields}
    if name == "object":
        return _write_objects(pandas, array, missing, label)
    elements = np.asarray(array) if isinstance(dtype, np.dtype) or hasattr(dtype, "numpy_dtype") else None
    if elements is None or elements.dtype.kind not in "biuf" or elements.dtype.itemsize > 8:
        raise MessageError(f"column {label!r} of type {name}: cast it to numbers, text, times or categories")
    # NaN is a number like any other.
    return {"dtype": elements.dtype.name, "type": elements.dtype.name, "data": elements}


def _write_times(pandas, array, dtype):
    unit = getattr(dtype, "unit", None) or np.datetime_data(dtype)[0]
    counts = np.asarray(array.asi8)
    if not isinstance(dtype, pandas.DatetimeTZDtype):
        return {"type": f"{'timestamp' if dtype.kind == 'M' else 'duration'}[{unit}]", "data": counts}
    zone = str(dtype.tz)
    found = re.fullmatch(r"(?:UTC|pytz\.FixedOffset\((-?\d+)\))([+-]\d\d:\d\d)?", zone)
    if found and found.group(1):
        minutes = int(found.group(1))
        zone = f"{'-' if minutes < 0 else '+'}{abs(minutes) // 60:02}:{abs(minutes) % 60:02}"
    elif found and found.group(2):
        zone = found.group(2)
    return {"type": f"timestamp[{unit}, {zone}]", "data": counts}


def _write_objects(pandas, array, missing, label):
    """A column of Python's objects: of text or numbers of one kind, else the JSON of each."""
    items = array.tolist()
    there = [item for item, lacks in zip(items, missing) if not lacks]
    kinds = {type(item) for item in there}
    lacking = {
        ("NA" if item is pandas.NA else "nan" if item != item else "None")
        for item, lacks in zip(items, missing)
        if lacks
    }
    if len(kinds) > 1 or len(lacking) > 1 or kinds - {str, bool, int, float}:
        return _write_json(items)
    dtype = "object" if lacking <= {"None"} else f"object({lacking.pop()})"
    kind = next(iter(kinds), str)
    if kind is str:
        data = [None if lacks else item for item, lacks in zip(items, missing)]
        return {"dtype": dtype, "type": "utf8", "data": data}
    element = {bool: "bool", int: "int64", float: "float64"}[kind]
    try:
        data = np.array([kind() if lacks else item for item, lacks in zip(items, missing)], element)
    except OverflowError:
        return _write_json(items)
    return {"dtype": dtype, "type": element, "data": data} | ({"valid": ~missing} if missing.any() else {})


def _write_json(items):
    """A column of objects of any kind."""
    from .writing import CellWriter

    data = []
    for row, item in enumerate(items):
        try:
            data.append(json.dumps(CellWriter().value(item, 0)))
        except MessageError as error:
            error.inside(row)
            raise
        except ValueError as problem:  # an integer of more digits than Python writes
            raise MessageError(str(problem)) from None
    return {"dtype": JSON, "type": "utf8", "data": data}
