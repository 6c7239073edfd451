"""Objects of Python alone, and of NumPy."""

import datetime
import unittest

import numpy as np

from wrapyfi_py import DeviceArray, MessageError, Tagged, from_python, to_python

from .stand_ins import MESSAGES, Header, NativeObject, Tensor, Time, travels, write


def read(json, *tensors):
    return to_python(NativeObject(json=json, tensors=list(tensors)))


class Objects(unittest.TestCase):
    def test_objects_return_as_they_were(self):
        berlin = datetime.timezone(datetime.timedelta(hours=1))
        for value in [
            None,
            True,
            5,
            2**70,
            -(2**70),
            1.5,
            -0.0,
            float("inf"),
            "grüße",
            "\ud800",
            [1, [2]],
            {"a": {"b": []}},
            (1, (2,), [(3,)]),
            {1, "a", (2, 3)},
            datetime.datetime(2024, 1, 2, 3, 4, 5, 678901),
            datetime.datetime(2024, 1, 2, tzinfo=berlin),
            np.datetime64("2024-01-02"),
            np.datetime64("2024-01-02T03:04:05.123456789"),
            {"__wrapyfi__": None},
            {"__wrapyfi__": "tuple"},
            {"__wrapyfi__": [5, "tuple"]},
        ]:
            found = travels(value)
            self.assertEqual(repr(found), repr(value))
            self.assertIs(type(found), type(value))
        self.assertTrue(np.isnan(travels(float("nan"))))
        self.assertTrue(np.isnat(travels(np.datetime64("NaT"))))

    def test_the_text_is_as_the_wire_says(self):
        message = write({"when": datetime.datetime(2024, 1, 2), "at": (1, (2,)), "a": np.zeros((2, 3), "f4")})
        self.assertEqual(
            message.json,
            '{"when": {"__wrapyfi__": ["datetime", "2024-01-02T00:00:00"]}, '
            '"at": {"__wrapyfi__": ["tuple", [1, {"__wrapyfi__": ["tuple", [2]]}]]}, '
            '"a": {"__wrapyfi__": ["tensor", 0]}}',
        )
        (tensor,) = message.tensors
        self.assertEqual(
            (tensor.dtype, list(tensor.shape), tensor.device, len(tensor.data)), ("float32", [2, 3], "", 24)
        )

    def test_tags_follow_the_rules_of_the_wire(self):
        self.assertEqual(read('{"__wrapyfi__": ["set", [1]], "other": 5}'), {1})
        self.assertEqual(read('{"__wrapyfi__": ["tuple", [1], 2]}'), (1,))
        self.assertEqual(read('{"__wrapyfi__": ["tuple", "ab"]}'), ("a", "b"))
        self.assertEqual(read('{"__wrapyfi__": ["tuple", {"a": 1}]}'), ("a",))
        self.assertEqual(read('{"a": 1, "a": 2}'), {"a": 2})

    def test_keys_become_text_as_in_json(self):
        self.assertEqual(
            travels({7: "a", None: "b", True: "c", 1.5: "d"}), {"7": "a", "null": "b", "true": "c", "1.5": "d"}
        )
        for value in [{1: "a", "1": "b"}, {(1, 2): "a"}, {"__wrapyfi__": ["tuple", []]}, {"__wrapyfi__": 5}]:
            with self.assertRaises(MessageError):
                write(value)

    def test_an_object_of_an_unknown_plugin_stays_as_it_came(self):
        text = '{"__wrapyfi__": ["Pose2D", 1.0, {"__wrapyfi__": ["tuple", [2]]}]}'
        found = read(text)
        self.assertEqual(found, Tagged("Pose2D", [1.0, (2,)]))
        self.assertEqual(write(found).json, text)
        pickled = read('{"__wrapyfi__": ["PandasData", "\\u0080\\u0005cos\\nsystem\\n"]}')
        self.assertEqual((pickled.tag, pickled.body), ("PandasData", "\x80\x05cos\nsystem\n"))
        self.assertIn("not run", pickled.reason)

    def test_what_has_no_form_is_named_with_its_place_and_a_remedy(self):
        for value, words in [
            ({"a": [1, b"x"]}, "$.a[1]: raw bytes have no form in JSON: send numpy.frombuffer"),
            ([datetime.date(2024, 1, 2)], "$[0]: an object of type datetime.date: send datetime.datetime"),
            (object(), "an object of type builtins.object: send its parts"),
            (np.array([None]), "an array of Python objects"),
            ({frozenset([1])}, "a set as member of a set"),
            (10**5000, "digits"),
            ({"a": [Unwilling()]}, "$.a[0]: Unwilling as NumPy array: KeyError: 'no'"),
            (datetime.datetime(2024, 1, 2, tzinfo=NowhereTime()), "a datetime: OSError: nowhere"),
            (np.ma.masked_array([1, 2], [True, False]), "a masked array: send its filled()"),
        ]:
            with self.assertRaises(MessageError) as caught:
                write(value)
            self.assertIn(words, str(caught.exception))
        for value in [[1, [2]], Unwilling(), "x", np.ma.masked]:
            with self.assertRaises(MessageError):
                write(value, "Tensor")
        for value in [5, (np.float32([1]), float("inf")), (Unwilling(), 1), ([1, [2]], 3)]:
            with self.assertRaises(MessageError):
                write(value, "AudioChunk")
        endless = []
        endless.append(endless)
        with self.assertRaisesRegex(MessageError, "nested deeper than 64"):
            write(endless)

    def test_a_header_is_handed_on(self):
        header = Header(Time(5, 6), "map")
        self.assertIs(from_python(1, NativeObject, header=header, messages=MESSAGES).header, header)


class Unwilling:
    """An object whose own conversion fails."""

    def __array__(self, *_, **__):
        raise KeyError("no")


class NowhereTime(datetime.tzinfo):
    """A time zone that cannot be read."""

    def utcoffset(self, _):
        raise OSError("nowhere")


class Arrays(unittest.TestCase):
    DTYPES = ["bool", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f2", "f4", "f8", "c8", "c16"]

    def test_arrays_of_numbers_travel_beside_the_text(self):
        for dtype in self.DTYPES:
            for shape in [(), (3,), (2, 3), (0, 3), (2, 1, 3)]:
                array = (np.arange(6) % 2).astype(dtype)[: int(np.prod(shape))].reshape(shape)
                for message in ("NativeObject", "Tensor"):
                    found = travels(array, message)
                    self.assertEqual((found.dtype, found.shape), (array.dtype, array.shape))
                    self.assertEqual(found.tobytes(), array.tobytes())

    def test_views_and_foreign_byte_orders_are_sent_as_their_elements(self):
        array = np.arange(12).reshape(3, 4)
        for value in [array.T, array[::2, ::-1], np.asfortranarray(array), array.astype(">i4"), array.astype(">f8")]:
            found = travels(value)
            np.testing.assert_array_equal(found, value)
            self.assertEqual(found.dtype.byteorder, "=")

    def test_arrays_of_other_elements_are_npy_files(self):
        for array in [
            np.array(["a", "bc"]),
            np.array([b"a"]),
            np.array(["2024-01-02", "NaT"], "M8[ns]"),
            np.array([1, 2], "m8[s]"),
            np.array([(1, [2, 3])], [("a", "<i4"), ("b", "<f4", (2,))]),
            np.zeros((0, 2), "U3"),
            np.asfortranarray(np.array([["a", "b"], ["c", "d"]])),
        ]:
            found = travels(array)
            self.assertEqual((found.dtype, found.shape, found.tobytes()), (array.dtype, array.shape, array.tobytes()))

    def test_reading_copies_nothing(self):
        message = write({"a": np.arange(1000.0), "b": [np.zeros(5, "u1")]})
        found = to_python(message)
        self.assertTrue(np.shares_memory(found["a"], np.frombuffer(message.tensors[0].data, np.uint8)))
        self.assertTrue(np.shares_memory(found["b"][0], np.frombuffer(message.tensors[1].data, np.uint8)))
        tensor = write(np.arange(5), "Tensor")
        self.assertTrue(np.shares_memory(to_python(tensor), np.frombuffer(tensor.data, np.uint8)))

    def test_device_and_library_stay_with_the_array(self):
        sent = DeviceArray.of(np.ones(2, "f4"), "cuda:0", {"key": "PytorchTensor", "requires_grad": "true"})
        message = write(sent)
        self.assertEqual(
            message.json, '{"__wrapyfi__": ["tensor", 0, {"key": "PytorchTensor", "requires_grad": "true"}]}'
        )
        found = to_python(message)
        self.assertEqual((found.device_label, found.origin), (sent.device_label, sent.origin))
        self.assertEqual((found[:1].device_label, (found + 1).origin), ("", None))
        self.assertEqual(travels(sent, "Tensor").device_label, "cuda:0")

    def test_bfloat16_is_read_without_a_library(self):
        tensor = Tensor("bfloat16", [2], "", np.array([0x3FC0, 0xC000], "<u2").tobytes())
        np.testing.assert_array_equal(to_python(tensor).astype("f4"), [1.5, -2.0])

    def test_bytes_as_any_message_class_has_them(self):
        octets = np.arange(3, dtype="<i2").tobytes()
        for data in [octets, bytearray(octets), list(octets), np.frombuffer(octets, np.uint8), memoryview(octets)]:
            self.assertEqual(to_python(Tensor("int16", [3], "", data)).tolist(), [0, 1, 2])


class Sound(unittest.TestCase):
    def test_samples_return_with_their_rate(self):
        for samples in [
            np.linspace(-1, 1, 12, dtype="f4").reshape(6, 2),
            np.arange(5, dtype="i2"),
            np.zeros((0, 1), "f4"),
        ]:
            message = write((samples, 16000), "AudioChunk")
            found, rate = to_python(message)
            self.assertEqual(
                (rate, found.dtype, found.shape, message.coding_format),
                (16000, samples.dtype, samples.shape, "flat" if samples.ndim == 1 else ""),
            )
            self.assertEqual(found.tobytes(), samples.tobytes())
            self.assertEqual(
                (message.encoding, message.step),
                ("FLOAT32LE" if samples.dtype == "f4" else "S16LE", message.channels * samples.itemsize),
            )

    def test_floats_under_the_label_that_wrapyfi_insists_on(self):
        message = write((np.float32([0.5, -0.5]), 8000), "AudioChunk")
        message.encoding = "S16LE"
        self.assertEqual(to_python(message)[0].ravel().tolist(), [0.5, -0.5])

    def test_big_endian_samples(self):
        message = write((np.int16([1, 2]).byteswap(), 8000), "AudioChunk")
        message.is_bigendian = 1
        self.assertEqual(to_python(message)[0].ravel().tolist(), [1, 2])

    def test_what_is_no_sound_is_refused(self):
        for value in [
            np.zeros(3),
            (np.zeros(3), 8000),
            (np.zeros((1, 2, 3), "f4"), 8000),
            (np.zeros((1, 300), "i2"), 8000),
            (np.zeros(3, "f4"), -1),
            5,
        ]:
            with self.assertRaises(MessageError):
                write(value, "AudioChunk")
        message = write((np.float32([0.5, -0.5]), 8000), "AudioChunk")
        message.chunk_size = 3
        with self.assertRaisesRegex(
            MessageError, "3 samples of 1 channels need 12 bytes as float32 or 6 as int16, 8 are"
        ):
            to_python(message)


if __name__ == "__main__":
    unittest.main()
