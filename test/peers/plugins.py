"""Objects of other libraries that Wrapyfi's plug-ins carry: one case a library, for wrapyfi_peer.py.

A case says which plug-in of Wrapyfi it needs, makes object number `seq`, and says what identifies
an object, in plain JSON: a receiver of the same object says the same.
"""
import hashlib
import importlib.util
import json
import os
import pathlib
import shutil
import tempfile

import payload

CASES = {}


def case(plugin):
    """Registers a class with `make(seq)` and `facts(object)`; `plugin` is Wrapyfi's file for it."""
    def register(cls):
        cls.plugin = plugin
        CASES[cls.__name__.lower()] = cls
        return cls
    return register


def load(name):
    """Makes Wrapyfi load the plug-in of a case, and no other. To be called before Wrapyfi is imported.

    Wrapyfi 0.5.0 looks for its own plug-ins beside a file that has moved, so they are pointed out to
    it. One alone, because those for classes with a common base take each other's objects.
    """
    found = CASES[name]
    if found.plugin is None:
        return found
    source = pathlib.Path(importlib.util.find_spec("wrapyfi").origin).parent / "plugins" / f"{found.plugin}.py"
    folder = pathlib.Path(tempfile.mkdtemp(prefix="wrapyfi_plugin_"))
    try:
        (folder / "plugins").mkdir()
        shutil.copy(source, folder / "plugins")
        os.environ["WRAPYFI_PLUGIN_PATHS"] = str(folder)
        import wrapyfi
        assert wrapyfi.PluginRegistrar.decoder_registry, f"Wrapyfi did not load {source}"
    finally:
        shutil.rmtree(folder)
    return found


def digest(facts):
    """Hash of what `facts` says, to compare messages by."""
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()


def plain(found):
    """Plain JSON of a dict; NaN and what JSON has no form for as text."""
    return json.loads(json.dumps(found, default=str).replace("NaN", '"NaN"'))


# NumPy needs no plug-in: it is here because every library's object must travel in this way.


@case(plugin=None)
class Numpy:
    @staticmethod
    def make(seq):
        import numpy as np
        return np.arange(6, dtype="<i4").reshape(2, 3) + seq

    @staticmethod
    def facts(array):
        return {"dtype": array.dtype.str, "shape": list(array.shape), "values": array.tolist()}


@case(plugin=None)
class Builtins:
    """Everything that needs no library but NumPy."""
    @staticmethod
    def make(seq):
        import datetime
        import numpy as np
        zone = datetime.timezone(datetime.timedelta(hours=-3, minutes=-30))
        return (seq, 2 ** 70, -0.0, float("inf"), "gr\u00fc\u00dfe \U0001f680", None, True, {"a": [{}, []]}, {seq},
                datetime.datetime(2024, 1, 2, 3, 4, 5, 678901), datetime.datetime(2024, 1, 2, tzinfo=zone),
                np.datetime64("2024-01-02T03:04"), np.array(["a", "bc"]), np.array([1, 2], "m8[s]"), np.zeros((0, 3), "f2"),
                np.array([(1, [2, 3])], [("a", "<i4"), ("b", "<f4", (2,))]), np.array(1 + 2j, "c8"), np.array([True, False]))

    @staticmethod
    def facts(found):
        return {"types": [type(value).__name__ for value in found], "values": [repr(value) for value in found]}


@case(plugin=None)
class Frame:
    """A camera frame as OpenCV has it."""
    @staticmethod
    def make(seq):
        return payload.image(seq)

    @staticmethod
    def facts(array):
        return {"pixels": payload.digest(array)}


@case(plugin="pint_quantities")
class Pint:
    @staticmethod
    def make(seq):
        import pint
        return pint.Quantity(1.5 + seq, "kilogram * meter / second ** 2")

    @staticmethod
    def facts(quantity):
        return {"magnitude": float(quantity.magnitude), "units": str(quantity.units)}


def pixels(image):
    """Mode and size of a Pillow image, and the hash of its pixels as OpenCV would have them."""
    import numpy as np
    array = np.array(image)
    if image.mode in ("RGB", "RGBA"):
        array = array[..., [2, 1, 0, 3][: array.shape[2]]]
    return {"mode": image.mode, "size": list(image.size), "pixels": payload.digest(array)}


@case(plugin="pillow_image")
class PillowFile:
    """An image that came from a file travels as that file."""
    facts = staticmethod(pixels)

    @staticmethod
    def make(seq):
        from io import BytesIO
        from PIL import Image
        file = BytesIO()
        Image.fromarray(payload.image(seq)).save(file, "PNG")
        return Image.open(file)


def pillow_case(name, mode):
    """An image made in memory: Wrapyfi sends its pixels, and reads them wrong."""
    class Made:
        facts = staticmethod(pixels)

        @staticmethod
        def make(seq):
            from PIL import Image
            colour = Image.fromarray(payload.image(seq))
            if mode == "P":  # Wrapyfi sends no palette: here are greys
                return Image.frombytes("P", colour.size, colour.convert("L").tobytes())
            if mode in ("RGB", "L", "RGBA", "1", "F", "I", "CMYK"):
                return colour.convert(mode)
            return Image.fromarray((payload.image(seq, "mono").astype("<u2") << 7) + seq)
    Made.__name__ = name
    return case(plugin="pillow_image")(Made)


for _name, _mode in [("PillowP", "P"), ("PillowCmyk", "CMYK"), ("PillowRgb", "RGB"), ("PillowL", "L"), ("PillowRgba", "RGBA"), ("PillowBits", "1"),
                     ("PillowF", "F"), ("PillowI", "I"), ("PillowI16", "I;16")]:
    pillow_case(_name, _mode)


@case(plugin="xarray_data")
class XArray:
    @staticmethod
    def make(seq):
        import numpy as np
        import xarray
        days = np.array(["2024-01-01", "2024-01-02"], dtype="datetime64[ns]")
        return xarray.DataArray(np.array([[0.5, np.nan, 2.0], [3.0, 4.0, 5.0]]) + seq, dims=("time", "x"), name="t",
                                coords={"time": days, "x": [10, 20, 30], "place": "a"}, attrs={"unit": "K"})

    @staticmethod
    def facts(array):
        return plain(array.to_dict()) | {"dtype": str(array.dtype)}


@case(plugin="xarray_data")
class XArraySet:
    @staticmethod
    def make(seq):
        import xarray
        return xarray.Dataset({"a": ("x", [seq, 2]), "b": (("x", "y"), [[True], [False]]), "s": ("x", ["u", "v"])},
                              coords={"x": [0.5, 1.5]}, attrs={"made": "here", "list": [1, None]})

    @staticmethod
    def facts(dataset):
        return plain(dataset.to_dict())


def frame_facts(frame):
    """Everything that pandas compares of a frame: labels, types and values."""
    index = frame.index
    return plain({"columns": [str(label) for label in frame.columns], "dtypes": [str(dtype) for dtype in frame.dtypes],
                  "columns_type": f"{type(frame.columns).__name__} {frame.columns.dtype} {frame.columns.name}",
                  "index": [str(label) for label in index], "index_type": f"{type(index).__name__} {index.dtype} {index.name}",
                  "names": [str(name) for name in [*index.names, *frame.columns.names]], "freq": str(getattr(index, "freqstr", None)),
                  "values": [[repr(value) for value in frame.iloc[:, place].tolist()] for place in range(frame.shape[1])]})


@case(plugin="pandas_data")
class PandasFrame:
    facts = staticmethod(frame_facts)

    @staticmethod
    def make(seq):
        import pandas
        return pandas.DataFrame({"a": [seq, 2], "s": ["x", None], "t": pandas.to_datetime(["2024-01-01", "2024-01-02"])},
                                index=pandas.Index(["first", "second"], name="row"))


@case(plugin="pandas_data")
class PandasTypes:
    facts = staticmethod(frame_facts)

    @staticmethod
    def make(seq):
        import numpy as np
        import pandas
        return pandas.DataFrame({
            "i8": np.array([seq % 100, -1], "i1"), "u16": np.array([1, 65535], "u2"), "f4": np.array([0.5, np.nan], "f4"),
            "yes": [True, False], "Int64": pandas.array([1, None], "Int64"), "boolean": pandas.array([True, None], "boolean"),
            "Float32": pandas.array([0.25, None], "Float32"), "object": np.array(["x", None], object),
            "category": pandas.Categorical(["b", "a"], categories=["b", "a", "c"], ordered=True),
            "delta": pandas.to_timedelta([1, None], unit="s"),
            "zone": pandas.to_datetime(["2024-01-01", "2024-06-01"], utc=True), 7: [1.0, 2.0]},
            index=pandas.RangeIndex(10, 30, 10))


@case(plugin="pandas_data")
class PandasArrow:
    """Columns whose types are PyArrow's: Wrapyfi's own example of pandas."""
    facts = staticmethod(frame_facts)

    @staticmethod
    def make(seq):
        import pandas
        import pyarrow
        lists = pandas.ArrowDtype(pyarrow.list_(pyarrow.int64()))
        members = pandas.ArrowDtype(pyarrow.struct([("x", pyarrow.int64()), ("y", pyarrow.string())]))
        return pandas.DataFrame({
            "f": pandas.Series([seq + 0.5, None, 3], dtype="float32[pyarrow]"), "i": pandas.Series([1, 2, None], dtype="int64[pyarrow]"),
            "s": pandas.Series(["a", None, "c"], dtype=pandas.ArrowDtype(pyarrow.string())),
            "l": pandas.Series([[1, seq], None, []], dtype=lists), "m": pandas.Series([{"x": 1, "y": "u"}, None, {"x": seq, "y": None}], dtype=members)})


@case(plugin="pandas_data")
class PandasTimes:
    """Zones by name and by offset, periods, and an index of regular times."""
    facts = staticmethod(frame_facts)

    @staticmethod
    def make(seq):
        import pandas
        return pandas.DataFrame({
            "berlin": pandas.to_datetime(["2024-01-01", "2024-07-01", None]).tz_localize("Europe/Berlin"),
            "east": pandas.to_datetime(["2024-01-01T00:00+05:30", None, "2024-01-02T00:00+05:30"]),
            "month": pandas.PeriodIndex(["2024-01", None, "2024-03"], freq="M"), "n": [seq, 2, 3]},
            index=pandas.date_range("2024-03-30 22:00", periods=3, freq="15min", tz="America/New_York", name="when"))


@case(plugin="pandas_data")
class PandasFreq:
    """A step of times that is the sender's own, a different one each time."""
    @staticmethod
    def make(seq):
        import pandas
        steps = ["D", "2h", "B", "ME", "MS", "W-MON", "2QS-FEB", "YE-DEC", "SME-15", "-1D"]
        return pandas.Series([1, 2, seq], index=pandas.date_range("2024-01-01", periods=3, freq=steps[seq % len(steps)]))

    @staticmethod
    def facts(series):
        return frame_facts(series.to_frame())


@case(plugin="pandas_data")
class PandasLevels:
    """Several levels of labels, of rows and of columns."""
    facts = staticmethod(frame_facts)

    @staticmethod
    def make(seq):
        import pandas
        rows = pandas.MultiIndex.from_tuples([("a", 1, "2024-01"), ("b", seq, None), ("a", 3, "2024-02")], names=["x", None, "month"])
        columns = pandas.MultiIndex.from_tuples([("left", 1), ("left", 2), ("right", 1)], names=["side", "n"])
        return pandas.DataFrame([[1, 2.5, "u"], [3, 4.5, "v"], [seq, 0.5, None]], index=rows, columns=columns)


@case(plugin="pandas_data")
class PandasTwice:
    """Two columns of one label."""
    facts = staticmethod(frame_facts)

    @staticmethod
    def make(seq):
        import pandas
        return pandas.DataFrame([[seq, "x"], [2, None]], columns=pandas.Index(["a", "a"], name="label"))


@case(plugin="pandas_data")
class PandasSeries:
    @staticmethod
    def make(seq):
        import pandas
        return pandas.Series([0.5, float("nan"), seq], name="speed", index=pandas.DatetimeIndex(["2024-01-01", "2024-01-02", "2024-01-03"]))

    @staticmethod
    def facts(series):
        return frame_facts(series.to_frame()) | {"type": type(series).__name__, "name": series.name}


@case(plugin="pandas_data")
class PandasIndex:
    @staticmethod
    def make(seq):
        import pandas
        return pandas.Index([seq, 5, 7], name="n")

    @staticmethod
    def facts(index):
        return {"type": type(index).__name__, "dtype": str(index.dtype), "name": index.name, "values": index.tolist()}


@case(plugin="pandas_data")
class PandasObjects:
    """Columns of objects of any kind, and labels."""
    facts = staticmethod(frame_facts)

    @staticmethod
    def make(seq):
        import datetime
        import numpy as np
        import pandas
        mixed = [seq, "x", [1, [None, 2.5]], {"k": [True, (1, "y")]}, None, float("nan"), datetime.datetime(2024, 1, 2, 3, 4, 5, 6)]
        return pandas.DataFrame({"mixed": mixed, "lists": [[seq]] * 7, "arrays": [np.float32([[0.5, seq]])] * 7, "large": [2 ** 70 + seq] * 6 + [None]},
                                index=pandas.Index([1, "a", 2.5, "b", True, "c", "d"], name="i"))


@case(plugin="pandas_data")
class PandasIntervals:
    facts = staticmethod(frame_facts)

    @staticmethod
    def make(seq):
        import pandas
        times = pandas.date_range("2024-01-01", periods=4, tz="UTC")
        return pandas.DataFrame({"whole": pandas.arrays.IntervalArray.from_breaks([0, 1, 2, 3 + seq]),
                                 "missing": pandas.arrays.IntervalArray.from_tuples([(0.0, 0.5), None, (1.0, 2.0)], closed="both"),
                                 "cut": pandas.cut([1, 5, float("nan")], [0, 2, 6])},
                                index=pandas.IntervalIndex.from_breaks(times, closed="left", name="when"))


def arrow_facts(array):
    return plain({"type": str(array.type), "values": array.to_pylist()})


@case(plugin="pyarrow_array")
class ArrowArray:
    facts = staticmethod(arrow_facts)

    @staticmethod
    def make(seq):
        import pyarrow
        return pyarrow.array([seq, 2, None, 4]).slice(1, 3) if seq % 2 else pyarrow.array(["a", None, str(seq)])


@case(plugin="pyarrow_array")
class ArrowStruct:
    facts = staticmethod(arrow_facts)

    @staticmethod
    def make(seq):
        import pyarrow
        return pyarrow.array([{"x": seq, "list": [1, 2]}, None, {"x": 3, "list": None}])


@case(plugin="pyarrow_array")
class ArrowDecimal:
    facts = staticmethod(arrow_facts)

    @staticmethod
    def make(seq):
        import decimal
        import pyarrow
        kind = pyarrow.decimal128(7, -2) if seq % 2 else pyarrow.decimal128(38, 5)
        return pyarrow.array([decimal.Decimal(seq * 1000), None, decimal.Decimal("-1200"), decimal.Decimal(0)], kind)


@case(plugin="pyarrow_array")
class ArrowMap:
    facts = staticmethod(arrow_facts)

    @staticmethod
    def make(seq):
        import pyarrow
        kind = pyarrow.map_(pyarrow.string(), pyarrow.list_(pyarrow.int64()))
        found = pyarrow.array([[("a", [1])], None, [("b", None), ("c", [seq, 3])], []], kind)
        return found.slice(1) if seq % 2 else found


@case(plugin="pyarrow_array")
class ArrowList:
    facts = staticmethod(arrow_facts)

    @staticmethod
    def make(seq):
        import pyarrow
        if seq % 2:
            return pyarrow.array([["a"], None, ["b", None]], pyarrow.large_list(pyarrow.string())).slice(1)
        return pyarrow.array([[[1, seq], None], [], None])


@case(plugin="pyarrow_array")
class ArrowScalar:
    @staticmethod
    def make(seq):
        import datetime
        import pyarrow
        kinds = [pyarrow.scalar(seq + 0.5), pyarrow.scalar("x"), pyarrow.scalar({"a": seq, "b": [1, None]}),
                 pyarrow.scalar(None, pyarrow.int32()), pyarrow.scalar(datetime.datetime(2024, 1, 2, 3, 4, 5, 6)),
                 pyarrow.scalar([[1], None])]
        return kinds[seq % len(kinds)]

    @staticmethod
    def facts(scalar):
        return plain({"type": str(scalar.type), "value": repr(scalar.as_py())})
