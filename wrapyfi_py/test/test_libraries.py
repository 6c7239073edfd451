"""Objects of pandas, PyArrow, Pillow, xarray and pint; and what is made of them where these are missing."""

import datetime
import json
import sys
import unittest
from unittest import mock

import numpy as np

from wrapyfi_py import MessageError, Tagged, to_python

from .stand_ins import missing, travels, write

NOT_HERE = missing("pandas", "pyarrow", "PIL", "xarray", "pint")


@unittest.skipIf(missing("pandas", "pyarrow"), missing("pandas", "pyarrow"))
class Tables(unittest.TestCase):
    def same(self, value):
        import pandas

        found = travels(value)
        self.assertIs(type(found), type(value))
        if isinstance(value, pandas.DataFrame):
            pandas.testing.assert_frame_equal(found, value, check_index_type="exact", check_column_type="exact")
        elif isinstance(value, pandas.Series):
            pandas.testing.assert_series_equal(found, value, check_index_type="exact")
        else:
            pandas.testing.assert_index_equal(found, value, exact=True)

    def frame(self):
        import pandas

        days = pandas.to_datetime(["2024-01-01", "2024-06-01"], utc=True)
        return pandas.DataFrame(
            {
                "i1": np.array([5, -1], "i1"),
                "u8": np.array([1, 2**64 - 1], "u8"),
                "f2": np.float16([0.5, np.nan]),
                "b": [True, False],
                "Int64": pandas.array([1, None], "Int64"),
                "UInt8": pandas.array([1, 2], "UInt8"),
                "boolean": pandas.array([True, None], "boolean"),
                "Float32": pandas.array([0.25, None], "Float32"),
                "object": np.array(["x", None], object),
                "nan": np.array(["x", np.nan], object),
                "ints": np.array([1, 2], object),
                "str": ["a", None],
                "string": pandas.array(["a", None], "string"),
                "ordered": pandas.Categorical(["b", None], categories=["b", "a", "c"], ordered=True),
                "days": pandas.Categorical(days),
                "delta": pandas.to_timedelta([1, None], unit="s"),
                "time": pandas.to_datetime(["2024-01-01", None]),
                "float[pyarrow]": pandas.array([1.5, None], "float32[pyarrow]"),
                "text[pyarrow]": pandas.array(["a", None], "string[pyarrow]"),
                "period": pandas.period_range("2024-01", "2024-02", freq="M"),
                "utc": days,
                "berlin": days.tz_convert("Europe/Berlin"),
                "offset": days.tz_convert("-03:30"),
            }
        )

    def test_columns_of_every_type_return(self):
        self.same(self.frame())

    def test_indices_and_labels_of_every_kind_return(self):
        import pandas

        frame = self.frame()
        self.same(frame.set_index("str"))
        self.same(frame.set_index("berlin"))
        self.same(frame.set_index(["ordered", "i1"])[["f2"]])
        self.same(frame.rename_axis("row").rename_axis(columns="label"))
        self.same(pandas.DataFrame({"x": [1.0, 2.0]}, index=pandas.RangeIndex(10, 30, 10)))
        self.same(pandas.DataFrame({"x": [1, 2, 3]}, index=pandas.date_range("2024-01-01", periods=3, freq="15min")))
        self.same(pandas.DataFrame([[1, 2]], columns=["a", "a"]))
        self.same(pandas.DataFrame([[1, 2], [3, 4]]))
        self.same(pandas.DataFrame([[1, 2]], columns=["a", 7]))
        self.same(
            pandas.DataFrame([[1, 2]], columns=pandas.MultiIndex.from_tuples([("a", 1), ("b", 2)], names=["u", None]))
        )
        self.same(pandas.DataFrame())
        self.same(pandas.DataFrame(index=[1, 5]))

    def test_series_and_indices_return(self):
        import pandas

        self.same(pandas.Series([0.5, float("nan")], name="speed", index=pandas.Index([0.5, 1.5], name="at")))
        self.same(pandas.Series([1, 2]))
        for index in [
            pandas.Index([1, 5], name="n"),
            pandas.RangeIndex(3),
            pandas.MultiIndex.from_tuples([(1, "a"), (2, None)]),
            pandas.period_range("2024-01", "2024-03", freq="M"),
            pandas.Index(["a", "b"]),
        ]:
            self.same(index)

    def test_numbers_are_read_where_they_lie(self):
        import pandas

        message = write(pandas.DataFrame({"x": np.arange(1000.0)}))
        found = to_python(message)["x"].to_numpy()
        self.assertTrue(np.shares_memory(found, np.frombuffer(message.tensors[0].data, np.uint8)))

    def test_objects_of_pyarrow_return(self):
        import pyarrow as pa

        day = datetime.date(2024, 1, 1)
        for value in [
            pa.array([1, 2, None, 4]).slice(1, 3),
            pa.array(["a", None]),
            pa.array(["a"], pa.large_string()),
            pa.chunked_array([[1], [2]]),
            pa.chunked_array([], pa.int8()),
            pa.array([True, None, False]).slice(1),
            pa.table({"a": [1, 2], "b": ["x", None]}),
            pa.record_batch({"a": [1.5]}),
            pa.array([], pa.float16()),
            pa.array(["a", None, "a"]).dictionary_encode(),
            pa.array([day, None]),
            pa.array([day], pa.date64()),
            pa.array([datetime.datetime(2024, 1, 1), None], pa.timestamp("us", "Europe/Berlin")),
            pa.array([5], pa.duration("ms")),
        ]:
            found = travels(value)
            self.assertIs(type(found), type(value))
            self.assertTrue(found.equals(value), f"{found} instead of {value}")
            self.assertIsNone(found.validate(full=True) if hasattr(found, "validate") else None)

    def test_nested_objects_of_pyarrow_return(self):
        import pyarrow as pa

        pairs = pa.array([[1, 2], [3, 4], None], pa.list_(pa.int8(), 2))
        structs = pa.array([{"x": 1, "l": [1, 2]}, None, {"x": 3, "l": None}])
        strict = pa.schema([pa.field("a", pa.int64(), nullable=False)], metadata={"k": "v"})
        for value in [
            pa.array([[1, 2], None, [], [3]]).slice(1),
            pa.array([["a"]], pa.large_list(pa.string())),
            pairs,
            pairs.slice(1),
            structs,
            structs.slice(1),
            pa.array([b"ab", None, b"c"]).slice(1),
            pa.array([], pa.binary()),
            pa.array([], pa.list_(pa.int8())),
            pa.nulls(3),
            pa.array([datetime.time(1, 2)], pa.time32("s")),
            pa.array([datetime.time(1, 2), None], pa.time64("us")),
            pa.table({"a": [1]}, schema=strict),
        ]:
            found = travels(value)
            self.assertIs(type(found), type(value))
            self.assertTrue(found.equals(value), f"{found} instead of {value}")
            self.assertEqual(getattr(found, "schema", None), getattr(value, "schema", None))
            found.validate(full=True)
        for scalar in [pa.scalar(3), pa.scalar(None, pa.string()), pa.scalar({"a": [None, 1.5]})]:
            self.assertEqual(travels(scalar), scalar)

    def test_what_a_table_cannot_hold_is_named(self):
        import pandas
        import pyarrow

        frame = pandas.DataFrame({"x": [1]})
        frame.attrs["unit"] = "m"
        for value, words in [
            (pandas.Series([1, pandas.Timedelta(1)]), "$[0][1]: an object of type Timedelta in a table"),
            (pandas.Series([1j]), "complex128: cast it"),
            (pandas.Series(pandas.arrays.SparseArray([0, 1])), "Sparse"),
            (frame, "attrs of a frame"),
            (pandas.Timestamp("2024-01-01T00:00:00.000000001"), "to_datetime64"),
            (pandas.Timedelta(1), "its parts"),
            (pyarrow.array([1], pyarrow.decimal256(50)), "to_pylist"),
            (pandas.DataFrame([[1]], columns=[datetime.date(2024, 1, 1)]), "a label of type date"),
        ]:
            with self.assertRaises(MessageError, msg=words) as caught:
                write([value])
            self.assertIn(words, str(caught.exception))

    def test_points_in_time_of_pandas_are_pythons(self):
        import pandas

        when = pandas.Timestamp("2024-01-01T00:00:00.000001", tz="Europe/Berlin")
        self.assertEqual(travels(when), when)
        self.assertTrue(np.isnat(travels(pandas.NaT)))

    def test_a_zone_is_no_path(self):
        import pandas

        message = write(
            pandas.DataFrame({"t": pandas.to_datetime(["2024-01-01"], utc=True).tz_convert("Europe/Berlin")})
        )
        for zone in ["../../etc/passwd", "/etc/passwd", "dateutil//etc/passwd", "Atlantis/Poseidonis"]:
            forged = json.loads(message.json)
            forged["__wrapyfi__"][1]["columns"][0]["type"] = f"timestamp[s, {zone}]"
            message.json = json.dumps(forged)
            self.assertIsInstance(to_python(message), Tagged, zone)


@unittest.skipIf(missing("PIL"), missing("PIL"))
class Pictures(unittest.TestCase):
    def test_images_of_every_mode_return(self):
        from PIL import Image

        colour = Image.fromarray((np.arange(48 * 64 * 3) * 7 % 256).astype("u1").reshape(48, 64, 3))
        for mode in ["RGB", "L", "RGBA", "1", "F", "I", "I;16", "CMYK"]:
            image = (
                Image.fromarray(np.arange(12, dtype="u2").reshape(3, 4)) if mode == "I;16" else colour.convert(mode)
            )
            found = travels(image)
            self.assertEqual((found.mode, found.size, found.tobytes()), (image.mode, image.size, image.tobytes()))
        self.assertEqual(travels(Image.new("RGB", (0, 5))).size, (0, 5))

    def test_blue_first_is_read_as_red_first(self):
        message = write(np.array([[[255, 0, 0]]], "u1"))
        message.json = (
            '{"__wrapyfi__": ["picture", {"encoding": "bgr8", "width": 1, "height": 1, "data": %s}]}' % message.json
        )
        self.assertEqual(to_python(message).getpixel((0, 0)), (0, 0, 255))

    def test_places_in_a_palette_stay_places(self):
        message = write(np.array([[0, 7, 255]], "u1"))
        body = '{"encoding": "mono8", "mode": "P", "width": 3, "height": 1, "data": %s}' % message.json
        message.json = '{"__wrapyfi__": ["picture", %s]}' % body
        found = to_python(message)
        self.assertEqual((found.mode, found.tobytes()), ("P", b"\x00\x07\xff"))
        with self.assertRaisesRegex(MessageError, "convert"):
            write(found)

    def test_a_file_is_opened(self):
        import io
        from PIL import Image

        for name, kind in [("png", "PNG"), ("jpeg", "JPEG")]:
            file = io.BytesIO()
            Image.new("RGB", (4, 3), (200, 0, 0)).save(file, kind)
            message = write(np.frombuffer(file.getvalue(), np.uint8))
            message.json = '{"__wrapyfi__": ["picture", {"format": "%s", "data": %s}]}' % (name, message.json)
            found = to_python(message)
            self.assertEqual((found.format, found.size), (kind, (4, 3)))
            # Under the other name it is no picture, whatever Pillow could make of it.
            message.json = message.json.replace(name, "jpeg" if name == "png" else "png")
            self.assertIsInstance(to_python(message), Tagged)


@unittest.skipIf(missing("xarray"), missing("xarray"))
class Labelled(unittest.TestCase):
    def test_arrays_and_data_sets_return(self):
        import xarray

        days = np.array(["2024-01-01", "2024-01-02"], dtype="M8[ns]")
        array = xarray.DataArray(
            [[0.5, np.nan], [3, 4]],
            dims=("time", "x"),
            name="t",
            attrs={"unit": "K", "at": (1, 2)},
            coords={"time": days, "x": [10, 20], "place": "a"},
        )
        data_set = xarray.Dataset(
            {"a": ("x", [1, 2]), "b": (("x", "y"), [[True], [False]]), "s": ("x", ["u", "v"]), "n": 5},
            coords={"x": [0.5, 1.5]},
            attrs={"made": "here", "list": [1, None]},
        )
        for value in [array, array.rename(None), data_set, xarray.Dataset()]:
            found = travels(value)
            self.assertTrue(found.identical(value), f"{found} instead of {value}")

    def test_what_json_cannot_hold_is_named(self):
        import xarray

        for value in [xarray.DataArray([1], dims=(("a", "b"),)), xarray.DataArray(np.array([1], "m8[s]"), dims="x")]:
            with self.assertRaises(MessageError):
                write(value)


@unittest.skipIf(missing("pint"), missing("pint"))
class Quantities(unittest.TestCase):
    def test_quantities_return(self):
        import pint

        for quantity in [
            pint.Quantity(1.5, "kilogram * meter / second ** 2"),
            pint.Quantity(3, "degC"),
            pint.Quantity(2, ""),
            pint.Quantity(1, "1 / second"),
            pint.Quantity(1, "volt / hertz ** 0.5"),
            pint.Quantity(7, "µm"),
        ]:
            found = travels(quantity)
            self.assertEqual((found.magnitude, found.units), (quantity.magnitude, quantity.units))

    def test_pint_computes_nothing_for_a_stranger(self):
        for units in [
            "9**9**9**9",
            "meter ** 99999999",
            "(meter)",
            "__import__",
            "meter; second",
            "9 * 9",
            "nonsense",
            "m" * 10**6,
        ]:
            text = json.dumps({"__wrapyfi__": ["quantity", {"magnitude": 1, "units": units}]})
            self.assertIsInstance(to_python(write(None).__class__(json=text)), Tagged, units)

    def test_arrays_with_a_unit_are_named(self):
        import pint

        with self.assertRaisesRegex(MessageError, "magnitude is of type ndarray"):
            write(pint.Quantity(np.ones(2), "m"))


@unittest.skipIf(NOT_HERE, NOT_HERE)
class Without(unittest.TestCase):
    """A machine that lacks the library."""

    def test_an_object_stays_readable_and_travels_on(self):
        import pandas
        import pint
        import pyarrow
        import xarray
        from PIL import Image

        for value, name, tag, reach in [
            (
                pandas.DataFrame({"x": [1.5, 2]}),
                "pandas",
                "table",
                lambda body: body["columns"][0]["data"].tolist() == [1.5, 2],
            ),
            (pyarrow.array([1, 2]), "pyarrow", "table", lambda body: body["columns"][0]["data"].tolist() == [1, 2]),
            (Image.new("RGB", (4, 3)), "PIL.Image", "picture", lambda body: body["data"].shape == (3, 4, 3)),
            (
                xarray.DataArray([1, 2], dims="x"),
                "xarray",
                "labelled",
                lambda body: body["array"]["data"].tolist() == [1, 2],
            ),
            (pint.Quantity(5, "m"), "pint", "quantity", lambda body: body == {"magnitude": 5, "units": "meter"}),
        ]:
            message = write({"object": value})
            with mock.patch.dict(sys.modules, {name: None}):
                found = to_python(message)["object"]
                self.assertEqual(found.tag, tag)
                self.assertIn(f"{name} cannot be imported", found.reason)
                self.assertTrue(reach(found.body), found)
                again = write({"object": found})
            self.assertEqual((again.json, again.tensors), (message.json, message.tensors))


if __name__ == "__main__":
    unittest.main()
