"""Tables: ``["table", {"key": "PandasData", "rows": 2, "columns": [{"name", "dtype", "type", "data", …}]}]``.

``type`` is Arrow's, ``dtype`` pandas's name of what a column holds; ``valid`` says which values are there. A
column becomes an array of pandas or of PyArrow without a copy where that has the numbers as they are.
"""

from . import frames
from .columns import Column, column_of
from .values import MessageError, library, mapping, member

#: Rows that a table may claim to have; what it has is checked.
MAX_ROWS = 1 << 48

#: Key of PyArrow's objects; tables of any other key become objects of pandas.
ARROW_KEY = "PyArrowArray"


def read(body, reader):
    """The object of pandas or PyArrow that a table is."""
    body = mapping(body, "table")
    rows, kind = member(body, "rows", int, "table"), body.get("kind")
    if not 0 <= rows < MAX_ROWS:
        raise MessageError(f"a table of {rows} rows")
    columns = [Column.read(column, rows) for column in member(body, "columns", list, "table")]
    for column in columns:
        if len(column) != rows:
            raise MessageError(f"column {column.name[:40]!r} has {len(column)} of {rows} rows")
    for column in columns:
        reader.budget.take("a table", column.copied_bytes())
    if member(body, "key", str, "table") != ARROW_KEY:
        return frames.read(body, rows, columns, reader)
    arrow = library("pyarrow")
    arrays = [column.to_arrow(arrow) for column in columns]
    if kind == "Scalar" and len(arrays) == rows == 1:
        return arrays[0][0]
    if kind in ("Array", "ChunkedArray", "Scalar"):
        if len(arrays) != 1:
            raise MessageError(f"an {kind} of {len(arrays)} columns")
        return arrays[0] if kind == "Array" else arrow.chunked_array(arrays)
    metadata = body.get("metadata", {})
    if not isinstance(metadata, dict) or not all(isinstance(text, str) for text in metadata.values()):
        raise MessageError("metadata of a table is no dict of texts")
    fields = [arrow.field(column.name, array.type, column.nullable) for column, array in zip(columns, arrays)]
    fields = arrow.schema(fields, metadata or None)
    make = arrow.RecordBatch if kind == "RecordBatch" else arrow.Table
    return make.from_arrays(arrays, schema=fields)


def write_arrow(value):
    """Tag and body of an object of PyArrow; ``None`` for any other."""
    import pyarrow as arrow

    extra = {}
    if isinstance(value, arrow.Scalar):
        kind, named, rows = "Scalar", [("", arrow.array([value.as_py()], value.type), True)], 1
    elif isinstance(value, (arrow.Array, arrow.ChunkedArray)):
        kind = "ChunkedArray" if isinstance(value, arrow.ChunkedArray) else "Array"
        named, rows = [("", value, True)], len(value)
    elif isinstance(value, (arrow.Table, arrow.RecordBatch)):
        kind = type(value).__name__
        named = [(field.name, array, field.nullable) for field, array in zip(value.schema, value.columns)]
        rows = value.num_rows
        if value.schema.metadata:
            metadata = value.schema.metadata.items()
            extra = {"metadata": {key.decode(): text.decode() for key, text in metadata}}
    else:
        return None
    columns = [{"name": name, **column_of(array, name, nullable)} for name, array, nullable in named]
    return "table", {"key": ARROW_KEY, "kind": kind, "rows": rows, **extra, "columns": columns}


def write_pandas(value):
    """Tag and body of a frame, a series or an index of pandas; ``None`` for anything else."""
    body = frames.write(value)
    return body and ("table", body)
