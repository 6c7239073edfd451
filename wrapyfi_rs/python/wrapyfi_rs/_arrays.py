"""Arrays of other libraries in a message: their elements, the device that held them, and what the library keeps beside.

    a tensor ──▶ elements of NumPy's, without a copy where they lie in main memory ──▶ the core
    the core ──▶ elements over the message's own memory ──▶ a tensor, on the device that the message or the options name
"""

import importlib
import json
import sys

from .errors import ObjectError, ValueMismatch


class Library:
    """A library of arrays: the key of Wrapyfi's plug-in for it, and the name of its class."""

    key = name = kind = ""

    def elements(self, value):
        """Elements, their type where NumPy has another name for it, device, and texts that are kept beside."""
        return self.library.asarray(value), None, "", {}

    def made(self, elements, dtype, device, kept):
        """The object of the library over the elements; what it cannot make of them, it raises."""
        return self.library.asarray(elements)

    @property
    def library(self):
        return importlib.import_module(self.name)

    def has(self, value):
        """Whether an object is the library's. One that nobody imported has none."""
        found = sys.modules.get(self.name)
        for name in self.kind.split("."):
            found = getattr(found, name, None)
        return isinstance(found, type) and isinstance(value, found)


class Torch(Library):
    key, name, kind = "PytorchTensor", "torch", "Tensor"

    def elements(self, value):
        flags = {"requires_grad": value.requires_grad, "parameter": isinstance(value, self.library.nn.Parameter)}
        kept = {name: "true" for name, flag in flags.items() if flag}
        plain = value.detach().cpu().resolve_conj().resolve_neg()
        if value.dtype is self.library.bfloat16:
            return plain.contiguous().view(self.library.int16).numpy(), "bfloat16", str(value.device), kept
        return plain.numpy(), None, str(value.device), kept

    def made(self, elements, dtype, device, kept):
        if dtype == "bfloat16":
            found = self.library.from_numpy(elements.astype("float32")).bfloat16()
        else:
            found = self.library.from_numpy(elements)
        found = found.to(device or "cpu")
        if "parameter" in kept:
            return self.library.nn.Parameter(found, requires_grad="requires_grad" in kept)
        return found.requires_grad_() if "requires_grad" in kept else found


class Jax(Library):
    key, name, kind = "JAXTensor", "jax", "Array"

    def elements(self, value):
        return importlib.import_module("numpy").asarray(value), None, "", {}

    def made(self, elements, dtype, device, kept):
        return self.library.numpy.asarray(elements)


class Trax(Jax):
    """What Trax works with are arrays of JAX."""

    key, kind = "TraxArray", ""


class TensorFlow(Library):
    key, name, kind = "TensorflowTensor", "tensorflow", "Tensor"

    def elements(self, value):
        return value.numpy(), None, "", {}

    def made(self, elements, dtype, device, kept):
        return self.library.convert_to_tensor(elements)


class CuPy(Library):
    key, name, kind = "CuPyArray", "cupy", "ndarray"

    def elements(self, value):
        return value.get(), None, f"cuda:{value.device.id}", {}

    def made(self, elements, dtype, device, kept):
        with self.library.cuda.Device(int(device.partition(":")[2] or 0)):
            return self.library.asarray(elements)


class Paddle(Library):
    key, name, kind = "PaddleTensor", "paddle", "Tensor"

    def elements(self, value):
        # Its name for a GPU is the one of the wire: Place(gpu:0).
        device = str(value.place)[6:-1].replace("cuda", "gpu")
        dtype = "bfloat16" if "bfloat16" in str(value.dtype) else None
        return value.numpy(), dtype, device, {"name": value.name}

    def made(self, elements, dtype, device, kept):
        plain = elements.astype("float32") if dtype == "bfloat16" else elements
        found = self.library.to_tensor(plain, place=device or None).astype(dtype)
        found.name = kept.get("name", found.name)
        return found


class MxNet(Library):
    key, name, kind = "MXNetTensor", "mxnet", "nd.NDArray"

    def elements(self, value):
        return value.asnumpy(), None, str(value.context).replace("(", ":").replace(")", "").replace("gpu", "cuda"), {}

    def made(self, elements, dtype, device, kept):
        kind, _, number = device.partition(":")
        context = self.library.Context({"cuda": "gpu"}.get(kind, kind) or "cpu", int(number or 0))
        return self.library.nd.array(elements, ctx=context, dtype=dtype)


class Zarr(Library):
    key, name, kind = "ZarrData", "zarr", "Array"

    def elements(self, value):
        kept = {"attrs": json.dumps(dict(value.attrs)), **({"name": value.name} if value.name else {})}
        return importlib.import_module("numpy").asarray(value[...]), None, "", kept

    def made(self, elements, dtype, device, kept):
        found = self.library.array(elements)
        found.attrs.update(json.loads(kept.get("attrs", "{}")))
        return found


class Dask(Library):
    key, name, kind = "DaskData", "dask.array", "Array"

    def elements(self, value):
        return importlib.import_module("numpy").asarray(value.compute()), None, "", {"partitions": "1"}

    def made(self, elements, dtype, device, kept):
        return self.library.from_array(elements, chunks=-1)


LIBRARIES = [Torch(), Jax(), Trax(), TensorFlow(), CuPy(), Paddle(), MxNet(), Zarr(), Dask()]
_BY_KEY = {library.key: library for library in LIBRARIES}


def fields(value):
    """Origin, element type, shape, device and elements of an array of a library; None for other objects."""
    for library in LIBRARIES:
        if library.has(value):
            try:
                elements, dtype, device, kept = library.elements(value)
            except Exception as problem:  # a library has its own opinion of its objects
                raise ObjectError(f"a {type(value).__name__} of {library.name}: {problem}") from None
            return {"key": library.key, **kept}, dtype, device, elements
    if hasattr(value, "__dlpack__") and not hasattr(value, "__array__"):
        return {}, None, "", importlib.import_module("numpy").from_dlpack(value)
    return None


def made(elements, dtype, device, origin):
    """The object of the library that an array is of; the array itself where the library is not installed."""
    library = _BY_KEY.get(origin.get("key"))
    try:
        library and library.library
    except ImportError:
        library = None
    if library is None:
        return None
    try:
        return library.made(elements, dtype, device, origin)
    except Exception as problem:  # a device that is not here, a type that the library lacks
        raise ValueMismatch(f"an array of {dtype} for {library.name} on {device or 'the CPU'}: {problem}") from None
