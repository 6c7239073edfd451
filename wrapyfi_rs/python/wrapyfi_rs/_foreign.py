"""Objects of other libraries as JSON with arrays beside it, and back."""

import json
import sys
import types

import numpy as np

from . import _arrays
from ._messages.reading import Reader
from ._messages.values import TAG, Budget, DeviceArray, MessageError, Tagged
from ._messages.writing import Writer
from .errors import ObjectError, ValueMismatch

__all__ = ["Tagged", "read", "write"]


def write(value):
    """The JSON of an object; element type, shape, device and elements of each array beside it."""
    array = _arrays.fields(value)
    if array is not None:
        origin, dtype, device, elements = array
        if dtype is None:
            value = DeviceArray.of(elements, device, origin)
        else:
            text = json.dumps({TAG: ["tensor", 0, origin]})
            return text.encode(), [(dtype, list(elements.shape), device, elements.tobytes())]
    writer = Writer()
    try:
        text = json.dumps(writer.value(_without_palette(value), 0))
    except MessageError as error:
        raise ObjectError(str(error)) from None
    tensors = [
        (tensor["dtype"], list(tensor["shape"]), tensor["device"], bytes(tensor["data"])) for tensor in writer.arrays
    ]
    return text.encode(), tensors


def read(text, tensors):
    """The object that JSON stands for, with its arrays beside it."""
    fields = [
        types.SimpleNamespace(dtype=dtype, shape=shape, device=device, data=data)
        for dtype, shape, device, data in tensors
    ]
    try:
        found = Reader(fields, Budget(sys.maxsize)).value(json.loads(text), 0)
    except MessageError as error:
        raise ValueMismatch(str(error)) from None
    if not isinstance(found, DeviceArray) or not found.origin:
        return found
    made = _arrays.made(found.view(np.ndarray), fields[0].dtype, found.device_label, found.origin)
    return found if made is None else made


def _without_palette(value):
    """A picture of Pillow in the colours of its palette, which has no form in a message; other objects as they are."""
    if type(value).__module__.partition(".")[0] == "PIL" and getattr(value, "mode", "") in ("P", "PA"):
        return value.convert("RGBA" if value.has_transparency_data else "RGB")
    return value
