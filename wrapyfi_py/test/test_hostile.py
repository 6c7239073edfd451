"""Messages of strangers: an object or a MessageError comes of each, quickly, and nothing is run."""

import base64
import copy
import datetime
import json
import os
import random
import sys
import time
import unittest
import warnings

import numpy as np

from wrapyfi_py import MessageError, Tagged, to_python

from .stand_ins import NativeObject, Tensor, missing, write

FORBIDDEN = (
    "pickle.find_class",
    "os.system",
    "os.exec",
    "os.posix_spawn",
    "subprocess.Popen",
    "socket.connect",
    "marshal.loads",
)
seen = []
listening = False


def listen(event, arguments):
    if listening and event in FORBIDDEN:
        seen.append((event, arguments))


sys.addaudithook(listen)


def read(found, *tensors, **options):
    text = found if isinstance(found, str) else json.dumps(found)
    return to_python(NativeObject(json=text, tensors=list(tensors)), **options)


def tag(*parts):
    return {"__wrapyfi__": list(parts)}


#: What a mutation puts into a message's JSON, and into the fields of its tensors.
WORDS = [
    None,
    True,
    -1,
    0,
    2**64,
    1e308,
    "",
    "column",
    "a" * 300,
    [],
    {},
    "range 0 2 1",
    "levels 2",
    "int64",
    "dictionary",
    "timestamp[ns, UTC]",
    "duration[s]",
    "utf8",
    "object",
    "boolean",
    "string[pyarrow]",
    "period[M]",
    "category",
    "Int64",
    "PyArrowArray",
    "ChunkedArray",
    "Series",
    "Index",
    "32FC3",
    "1",
    "rgba8",
    tag("tensor", 0),
    tag("tuple", [1]),
    tag("set", []),
    tag("datetime", "2024-01-01"),
    tag("numpy.ndarray", "k05VTVBZAQB2AA=="),
    tag("Pose"),
    {"key": "PytorchTensor"},
]
TENSORS = {
    "dtype": ["int64", "uint8", "bool", "bfloat16", "float16", "complex64", "x"],
    "shape": [[], [0], [1], [2], [2, 3], [2**40]],
    "data": [b"", bytes(8), bytes(16), b"\xff" * 16, b"\1" * 2],
}


def nodes(found):
    """Each member of each list and dict, with where it stands."""
    for key in list(found if isinstance(found, dict) else range(len(found))):
        yield found, key
        if isinstance(found[key], (dict, list)):
            yield from nodes(found[key])


def mutant(originals, seed):
    """One of the messages with one to three faults, the same ones for the same seed."""
    chance = random.Random(seed)
    message = chance.choice(originals)
    tensors = [Tensor(t.dtype, list(t.shape), t.device, bytes(t.data)) for t in message.tensors]
    found = [json.loads(message.json)]
    for _ in range(chance.randint(1, 3)):
        kind = chance.randrange(4)
        places = list(nodes(found))
        where, key = chance.choice(places)
        if kind == 0:
            # A copy: a word that stood in two places, or in itself, would be no message.
            where[key] = copy.deepcopy(chance.choice(WORDS))
        elif kind == 1:
            other, another = chance.choice(places)
            where[key] = copy.deepcopy(other[another])
        elif kind == 2 and isinstance(where, dict):
            where.pop(key, None)
        elif tensors:
            tensor = chance.choice(tensors)
            field = chance.choice(list(TENSORS))
            setattr(tensor, field, chance.choice(TENSORS[field]))
    text = json.dumps(found[0]) if found else "null"
    if chance.random() < 0.2:
        at = chance.randrange(len(text))
        text = text[:at] + chance.choice('[]{},:"\\0-eE. NIn\x00é') + text[at + chance.randint(0, 2) :]
    return NativeObject(json=text, tensors=tensors)


class Hostile(unittest.TestCase):
    def refused(self, found, words, *tensors, **options):
        with self.assertRaises(MessageError) as caught:
            read(found, *tensors, **options)
        self.assertIn(words, str(caught.exception))

    def test_malformed_text(self):
        for text in ["", "{", "[1,]", "{'a': 1}", "\x00", "nul", '"\n"', "[" * 10**6, "1" * 5000]:
            self.refused(text, "JSON")

    def test_malformed_tags(self):
        for meaning, words in [
            ([], "without its name"),
            (5, "begins with a name"),
            ({}, "begins with a name"),
            (["tuple"], "without its body"),
            (["tuple", 5], "has no members"),
            (["set", [[1]]], "member of a set"),
            (["datetime", "yesterday"], "datetime"),
            (["datetime", 5], "datetime"),
            (["numpy.datetime64", "today"], "is no numpy.datetime64"),
            (["numpy.datetime64", "2024-99-99"], "numpy.datetime64"),
            (["tensor", 0], "tensor 0 of 0"),
            (["tensor", -1], "tensor -1 of 0"),
            (["tensor", True], "tensor True of 0"),
            (["numpy.ndarray", 5], "text"),
        ]:
            self.refused({"at": [{"__wrapyfi__": meaning}]}, words)

    def test_a_place_is_named(self):
        self.refused({"frames": [1, {"a": tag("tensor", 3)}]}, "$.frames[1].a: tensor 3 of 0 tensors")

    def test_nesting_ends(self):
        deep = []
        for _ in range(64):
            deep = [deep]
        self.refused(deep, "nested deeper than 64")
        self.refused(tag("tuple", deep), "nested deeper than 64")

    def test_tensors_that_do_not_fit(self):
        for tensor, words in [
            (Tensor("float32", [3], "", bytes(8)), "tensors[0]: float32 array [3] needs 12 bytes, 8 are there"),
            (Tensor("object", [1], "", bytes(8)), "none of"),
            (Tensor("O", [1], "", bytes(8)), "none of"),
            (Tensor("uint8", [2**63, 2**63], "", b""), "needs"),
            (Tensor("uint8", [-1, -8], "", bytes(8)), "needs"),
            (Tensor("uint8", [1] * 100, "", bytes(1)), "dimensions"),
            (Tensor("bool", [1], "", b"\2"), "neither 0 nor 1"),
            (Tensor("uint8", [2**62, 2**62, 0], "", b""), "dimensions"),
            (Tensor("uint8", ["x"], "", b""), "shape"),
            (Tensor("uint8", [float("inf")], "", b""), "shape"),
            (Tensor([], [0], "", b""), "dtype"),
            (Tensor("uint8", [1], "", [300]), "data"),
        ]:
            self.refused(tag("tensor", 0), words, tensor)

    def npy(self, header, data=b"", version=b"\1\0"):
        header = header.encode("latin-1") + b"\n"
        length = len(header).to_bytes(2 if version == b"\1\0" else 4, "little")
        return tag("numpy.ndarray", base64.b64encode(b"\x93NUMPY" + version + length + header + data).decode())

    def test_files_of_arrays_that_lie(self):
        descr = "{'descr': '%s', 'fortran_order': False, 'shape': %s}"
        for file, words in [
            (self.npy(descr % ("<U4", f"({10**15},)")), "needs"),
            (self.npy(descr % ("|O", "(1,)"), b"cos\nsystem\n"), "pickle"),
            (self.npy(descr % ("<f8", "(-1,)")), "shape"),
            (self.npy(descr % ("<f8", "(True,)")), "shape"),
            (self.npy("__import__('os').system('true')"), "header"),
            (self.npy("(" * 9000), "header"),
            (self.npy("{}"), "header"),
            (self.npy("{'descr': (), 'fortran_order': False, 'shape': ''}"), "header"),
            (self.npy(" " * 20000), "limit is 10000"),
            (self.npy(descr % ("<f8", "(1,)"), bytes(8), b"\7\0"), "version"),
            (tag("numpy.ndarray", "gASVAAAA"), "no .npy"),
            (tag("numpy.ndarray", "é"), "base64"),
        ]:
            self.refused(file, words)

    def test_a_message_has_a_size(self):
        self.refused("1", "limit is 0", limit_mib=0)
        self.refused(tag("tensor", 0), "raise limit_mib", Tensor("uint8", [2 << 20], "", bytes(2 << 20)), limit_mib=1)
        self.refused("[" + "[]," * 200_000 + "[]]", "values", limit_mib=1)
        # Commas inside of text are no values.
        self.assertEqual(len(read(["," * 200_000], limit_mib=1)[0]), 200_000)

    def test_small_messages_do_not_become_large(self):
        """A picture, a table and a file may stand a thousand times for one tensor."""
        tensor = Tensor("uint8", [1000, 1000], "", bytes(10**6))
        picture = tag("picture", {"encoding": "mono8", "width": 1000, "height": 1000, "data": tag("tensor", 0)})
        if not missing("PIL"):
            self.refused([picture] * 100, "limit_mib", tensor, limit_mib=8)
        flat = Tensor("uint8", [10**6], "", bytes(10**6))
        column = {"name": "x", "type": "uint8", "data": tag("tensor", 0)}
        self.refused(
            [tag("table", {"key": "PandasData", "rows": 10**6, "columns": [column]})] * 100,
            "limit_mib",
            flat,
            limit_mib=8,
        )
        array = read([tag("tensor", 0)] * 1000, tensor, limit_mib=2)
        self.assertTrue(all(np.shares_memory(array[0], other) for other in array))

    def test_tables_that_contradict_themselves(self):
        def table(**fields):
            return tag("table", {"key": "PandasData", "rows": 2, "columns": [], **fields})

        two = Tensor("int64", [2], "", bytes(16))
        data = tag("tensor", 0)
        for body in [
            table(rows=-1, columns=[{"name": "x", "type": "int64", "data": data}]),
            table(rows=True),
            table(columns=5),
            table(columns=[5]),
            table(columns=[{"name": "x", "type": "int64", "data": [1, 2]}]),
            table(columns=[{"name": "x", "type": "float64", "data": data}]),
            table(columns=[{"name": "x", "type": "utf8", "data": [1, 2]}]),
            table(columns=[{"name": "x", "type": "list", "data": data}]),
            table(columns=[{"name": 5, "type": "int64", "data": data}]),
            table(columns=[{"name": "x", "type": "int64", "data": data, "valid": data}]),
            table(rows=3, columns=[{"name": "x", "type": "int64", "data": data}]),
            table(columns=[{"name": "x", "type": "dictionary", "codes": "int64", "data": data}]),
            table(key=5),
        ]:
            with self.assertRaises(MessageError, msg=body):
                read(body, two)
        if missing("pandas", "pyarrow"):
            return
        text = {"name": "", "type": "utf8", "data": ["a"]}
        codes = Tensor("int64", [2], "", np.int64([0, 7]).tobytes())
        for key in ("PandasData", "PyArrowArray"):
            body = table(
                key=key,
                columns=[{"name": "x", "type": "dictionary", "codes": "int64", "data": data, "categories": text}],
            )
            self.assertIsInstance(read(body, codes), Tagged)
        for fields in [
            {"index": "range 0 10000000000000000000 1"},
            {"index": "range 0 2 0"},
            {"index": "levels 5"},
            {"labels": "[1]"},
            {"labels": "["},
            {"columns_name": "[" * 5000},
            {"kind": "Series"},
            {"index": "column", "freq": "nonsense"},
        ]:
            columns = [{"name": "x", "type": "int64", "data": data}] * 2
            try:
                self.assertIsInstance(read(table(columns=columns, **fields), two), Tagged, fields)
            except MessageError:
                pass

    def corpus(self):
        """Messages as honest peers send them."""
        yield {
            "a": (1, {2}),
            "at": datetime.datetime(2024, 1, 2),
            "d": np.datetime64("2024-01-02"),
            "u": np.array(["a", "b"]),
            "t": [np.arange(6.0).reshape(2, 3), np.array([True, False]), None, 2**70, "é"],
            "p": Tagged("Pose", [1]),
        }
        if not missing("pandas", "pyarrow"):
            import pandas
            import pyarrow

            yield pandas.DataFrame(
                {
                    "x": [1, 2],
                    "s": ["a", None],
                    "c": pandas.Categorical(["a", "b"]),
                    "n": pandas.array([1, None], "Int64"),
                    "t": pandas.to_datetime(["2024-01-01", None], utc=True),
                },
                index=pandas.Index([5, 6], name="row"),
            )
            yield pandas.Series([1.5], index=pandas.MultiIndex.from_tuples([("a", 1)]))
            yield pyarrow.array([{"l": [1, 2], "b": b"x"}, None])
            pairs = pyarrow.array([[1, 2], [3, 4]], pyarrow.list_(pyarrow.int8(), 2))
            yield pyarrow.table({"f": pairs, "n": pyarrow.nulls(2)})
            yield pyarrow.table(
                {"x": [1, None], "b": [True, None], "s": pyarrow.array(["a", "b"]).dictionary_encode()}
            )
        if not missing("PIL"):
            from PIL import Image

            yield [Image.new("RGB", (4, 3)), Image.new("1", (9, 2))]
        if not missing("xarray"):
            import xarray

            yield xarray.DataArray(
                [[1.0, 2.0]], dims=("a", "b"), name="t", coords={"b": [1, 2], "t": "x"}, attrs={"u": 1}
            )
        if not missing("pint"):
            import pint

            yield pint.Quantity(1.5, "meter / second ** 2")

    def test_mutated_messages_give_an_object_or_an_error(self):
        """``WRAPYFI_SEEDS=100000`` tries more mutants, ``WRAPYFI_SEED=7`` one."""
        global listening
        originals = [write(value) for value in self.corpus()]
        one = os.environ.get("WRAPYFI_SEED")
        seeds = range(int(os.environ.get("WRAPYFI_SEEDS", 4000))) if one is None else [int(one)]
        begin, objects = time.monotonic(), 0
        listening = True
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                for seed in seeds:
                    with self.subTest(WRAPYFI_SEED=seed):
                        message = mutant(originals, seed)
                        try:
                            found = to_python(message)
                            objects += 1
                            write(found)
                        except MessageError:
                            pass
                        except Exception as problem:
                            raise AssertionError(f"{message.json} {message.tensors}") from problem
        finally:
            listening = False
        self.assertEqual(seen, [])
        if one is None:
            self.assertGreater(objects, len(seeds) / 10, "too few mutants are objects for the others to mean much")
            self.assertLess(time.monotonic() - begin, len(seeds) * 0.075)


if __name__ == "__main__":
    unittest.main()
