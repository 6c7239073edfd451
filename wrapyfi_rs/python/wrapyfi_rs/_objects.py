"""Objects of other libraries, which the core hands over: plug-ins written in Python, and what a library is needed for."""

import importlib
import json
import sys
import types

from ._messages.reading import Reader
from ._messages.values import Budget, DeviceArray, MessageError, Tagged
from ._messages.writing import Writer
from ._ros_objects import fields_of
from .errors import ObjectError, ValueMismatch
from .utils.core_utils import PluginRegistrar

#: Libraries of arrays: the key of Wrapyfi's plug-in, an object's array and its device, and back.
_ARRAYS = {
    "torch": ("PytorchTensor", "Tensor", lambda it: (it.detach().cpu().resolve_conj().numpy(), str(it.device)), "from_numpy"),
    "tensorflow": ("TensorflowTensor", "Tensor", lambda it: (it.numpy(), ""), "convert_to_tensor"),
    "jax": ("JAXTensor", "Array", lambda it: (importlib.import_module("numpy").asarray(it), ""), "numpy.asarray"),
    "cupy": ("CuPyArray", "ndarray", lambda it: (it.get(), f"cuda:{it.device.id}"), "asarray"),
    "paddle": ("PaddleTensor", "Tensor", lambda it: (it.numpy(), str(it.place)), "to_tensor"),
    "mxnet": ("MXNetTensor", "nd.NDArray", lambda it: (it.asnumpy(), str(it.context)), "nd.array"),
}
_LIBRARY_OF = {key: (library, back) for library, (key, _, _, back) in _ARRAYS.items()}


class Codec:
    """Objects of one value of a method, with the options that it is registered with."""

    def __init__(self, data_type, options):
        self.data_type, self.options = data_type, options

    def encode(self, value):
        """What stands for an object: the key and the JSON of a plug-in, or None, and JSON with arrays beside it."""
        plugin = PluginRegistrar.writing(type(value))
        if plugin is not None:
            is_taken, found = plugin(**self.options).encode(value)
            if is_taken:
                text = json.dumps(found, default=self._of_plugin)
                return found["__wrapyfi__"][0], text.encode(), []
        value = fields_of(value)
        writer = Writer()
        try:
            text = json.dumps(writer.value(_as_device_array(_without_palette(value)), 0))
        except MessageError as error:
            raise ObjectError(str(error)) from None
        tensors = [
            (tensor["dtype"], list(tensor["shape"]), tensor["device"], bytes(tensor["data"])) for tensor in writer.arrays
        ]
        return None, text.encode(), tensors

    def _of_plugin(self, value):
        """An object among the parts of a plug-in."""
        key, text, tensors = self.encode(value)
        if tensors:
            raise ObjectError(f"a plug-in with a {type(value).__name__} among its parts: write it as text")
        return json.loads(text)

    def decode(self, text, tensors):
        """The object that JSON stands for, with its arrays beside it."""
        fields = [
            types.SimpleNamespace(dtype=dtype, shape=shape, device=device, data=data)
            for dtype, shape, device, data in tensors
        ]
        try:
            return _as_of_library(Reader(fields, Budget(sys.maxsize)).value(json.loads(text), 0))
        except MessageError as error:
            raise ValueMismatch(str(error)) from None

    def tagged(self, key, text, refused):
        """The object that a plug-in wrote, by the plug-in of this name here; else what it wrote, as it is."""
        plugin = PluginRegistrar.decoder_registry.get(key)
        parts = json.loads(text)["__wrapyfi__"]
        if plugin is not None:
            is_taken, found = plugin(**self.options).decode(key, parts)
            if is_taken:
                return found
        return Tagged(key, parts[1:], refused or "no plug-in here reads it; pickles are not run")


def _without_palette(value):
    """A picture of Pillow in the colours of its palette, which has no form in a message; other objects as they are."""
    if type(value).__module__.partition(".")[0] == "PIL" and getattr(value, "mode", "") in ("P", "PA"):
        return value.convert("RGBA" if value.has_transparency_data else "RGB")
    return value


def _as_device_array(value):
    """An array of NumPy's that knows the library of an object; other objects as they are."""
    library = type(value).__module__.partition(".")[0].replace("jaxlib", "jax")
    if library not in _ARRAYS:
        return value
    key, kind, array, _ = _ARRAYS[library]
    cls = sys.modules[library]
    for name in kind.split("."):
        cls = getattr(cls, name)
    if not isinstance(value, cls):
        return value
    elements, device = array(value)
    return DeviceArray.of(elements, device, {"key": key})


def _as_of_library(value):
    """The object of a library that an array came from, where the library is installed."""
    if not isinstance(value, DeviceArray):
        return value
    origin = value.origin or {}
    library, back = _LIBRARY_OF.get(origin.get("key"), (None, None))
    try:
        make = importlib.import_module(library) if library else None
    except ImportError:
        return value
    for name in back.split(".") if make else ():
        make = getattr(make, name)
    return make(value.view(importlib.import_module("numpy").ndarray)) if make else value
