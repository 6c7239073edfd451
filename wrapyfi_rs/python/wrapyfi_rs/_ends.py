"""The values of a method as the core wants them: ``$`` replaced, options of plug-ins taken out."""

import inspect
import logging

from . import _native
from ._objects import Codec
from .errors import OptionError

_LOG = logging.getLogger("wrapyfi_rs")

class Value:
    """A returned value as the decorator describes it."""

    def __init__(self, data_type, middleware, topic, options):
        self.data_type, self.middleware, self.topic, self.options = data_type, middleware, topic, options

    @classmethod
    def of(cls, data_type, middleware, args, kwargs=None):
        """The value for the arguments of ``register``: class and topic, each also by its name."""
        options = dict(kwargs or {})
        middleware = options.pop("middleware", middleware)
        places = dict(zip(("class_name", "topic"), args))
        options.pop("class_name", None)
        topic = options.pop("topic", places.get("topic"))
        if topic is None:
            raise OptionError(f"register({data_type!r}, {middleware!r}, …) without a topic: name the class, then the topic")
        # Both carry dicts, of the type that the option message_type names.
        data_type = "ROSMessage" if data_type == "ROS2Message" else data_type
        return cls(data_type, middleware, topic, options)

    def nothing(self):
        """What a listener returns where nothing has come."""
        return (None, self.options.get("rate", 44100)) if self.data_type == "AudioChunk" else None


def open_ends(method, mode, args, kwargs):
    """Opens the ends of a method for a mode; ``args`` and ``kwargs`` are those of the call, without the instance."""
    if mode == "disable":
        return None
    parameters = inspect.signature(method.function).parameters.values()
    named = {one.name: one.default for one in parameters if one.default is not one.empty}
    named.update(kwargs)
    replace = _Replacement(method.function.__qualname__, args, named).replace
    return _native.open(
        method.function.__qualname__, mode, [_resolved(value, replace) for value in method.all_values()]
    )


def _resolved(value, replace):
    middleware, topic = replace(value.middleware), replace(value.topic)
    options = {name: replace(option) for name, option in value.options.items()}
    if not _is_here(middleware, value.data_type, topic):
        middleware = None
    return value.data_type, middleware, str(topic), options, Codec(value.data_type, options)


def _is_here(middleware, data_type, topic):
    """Whether a middleware is here; a value on another one is None, and is sent nowhere."""
    if middleware in (None, "", "none"):
        return False
    known = _native.middlewares()
    if middleware in known:
        return True
    _LOG.warning(
        "%s on %s is None and goes nowhere: there is no middleware %r, only %s",
        data_type, topic, middleware, ", ".join(known),
    )
    return False


class _Replacement:
    """What stands for ``$0`` and ``$name``: the arguments of the first call."""

    def __init__(self, method, args, named):
        self.method, self.args, self.named = method, args, named

    def replace(self, written):
        """The argument that a text names, or the text itself; a dict with each of its values replaced."""
        if isinstance(written, dict):
            return {key: self.replace(value) for key, value in written.items()}
        if not isinstance(written, str) or not written.startswith("$"):
            return written
        name = written[1:]
        if name.isdigit():
            if int(name) >= len(self.args):
                raise IndexError(f"{self.method}: {written} names no argument: the call has {len(self.args)}")
            return self.args[int(name)]
        if name not in self.named:
            known = ", ".join(sorted(self.named)) or "none"
            raise KeyError(f"{self.method}: {written} names no keyword argument; there are {known}")
        return self.named[name]
