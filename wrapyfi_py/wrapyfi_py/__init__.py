"""Messages of ``wrapyfi_msgs`` to objects of Python and back.

    >>> from wrapyfi_py import from_python, to_python
    >>> node.create_subscription(NativeObject, "/object", lambda message: print(to_python(message)), 10)
    >>> publisher.publish(from_python({"speed": numpy.array([1.0, 2.5])}))

Needs NumPy alone. A message may hold objects of pandas, PyArrow, xarray, Pillow and pint: they become such
objects where the library is installed, and :class:`Tagged` where it is not. Nothing that a message holds is
executed, imported by name or unpickled.
"""

from .messages import from_python, to_python
from .values import DeviceArray, MessageError, Tagged

__all__ = ["DeviceArray", "MessageError", "Tagged", "from_python", "to_python"]
