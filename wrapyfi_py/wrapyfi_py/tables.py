"""Tables: ``["table", {"key": "PandasData", "rows": 2, "columns": [{"name", "dtype", "type", "data", …}]}]``.

``type`` is Arrow's, ``dtype`` pandas's name of what a column holds; ``valid`` says which values are there. A
column becomes an array of pandas or of PyArrow without a copy where that has the numbers as they are.
"""

from . import frames
from .columns import Column, column_of
from .values import MessageError, library, mapping, member

#: Key of PyArrow's objects; tables of any other key become objects of pandas.
ARROW_KEY = "PyArrowArray"


def read(body, reader):
    """The object of pandas or PyArrow that a table is."""
    body = mapping(body, "table")
    rows, kind = member(body, "rows", int, "table"), body.get("kind")
    columns = [Column.read(column) for column in member(body, "columns", list, "table")]
    for column in columns:
        if len(column) != rows:
            raise MessageError(f"column {column.name[:40]!r} has {len(column)} of {rows} rows")
    for column in columns:
        reader.budget.take("a table", column.copied_bytes())
    if member(body, "key", str, "table") != ARROW_KEY:
        return frames.read(body, rows, columns, reader)
    arrow = library("pyarrow")
    arrays = [column.to_arrow(arrow) for column in columns]
    if kind in ("Array", "ChunkedArray"):
        if len(arrays) != 1:
            raise MessageError(f"an {kind} of {len(arrays)} columns")
        return arrays[0] if kind == "Array" else arrow.chunked_array(arrays)
    fields = arrow.schema([arrow.field(column.name, array.type) for column, array in zip(columns, arrays)])
    make = arrow.RecordBatch if kind == "RecordBatch" else arrow.Table
    return make.from_arrays(arrays, schema=fields)


def write_arrow(value):
    """Tag and body of an object of PyArrow; ``None`` for any other."""
    import pyarrow as arrow

    if isinstance(value, arrow.Scalar):
        value = arrow.array([value.as_py()], value.type)
    if isinstance(value, (arrow.Array, arrow.ChunkedArray)):
        kind = "ChunkedArray" if isinstance(value, arrow.ChunkedArray) else "Array"
        named, rows = [("", value)], len(value)
    elif isinstance(value, (arrow.Table, arrow.RecordBatch)):
        kind = type(value).__name__
        named, rows = list(zip(value.schema.names, value.columns)), value.num_rows
    else:
        return None
    columns = [{"name": name, **column_of(array, name)} for name, array in named]
    return "table", {"key": ARROW_KEY, "kind": kind, "rows": rows, "columns": columns}


def write_pandas(value):
    """Tag and body of a frame, a series or an index of pandas; ``None`` for anything else."""
    body = frames.write(value)
    return body and ("table", body)
