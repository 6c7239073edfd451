"""The values of a method as the core wants them: ``$`` replaced, options of plug-ins taken out."""

import contextvars
import inspect
import logging

from . import _log, _native
from ._objects import Codec
from ._ros_objects import ros_type
from .errors import OpenError, OptionError

_LOG = logging.getLogger("wrapyfi_rs")
#: What a task has opened, and cancels where it is cancelled itself.
OPENED = contextvars.ContextVar("wrapyfi_rs.opened", default=None)

#: Messages of Wrapyfi's topics on ROS 2; the option ``message_type`` names others.
_ON_ROS_2 = {"NativeObject": "std_msgs/msg/String", "AudioChunk": "wrapyfi_ros2_interfaces/msg/ROS2AudioMessage"}


class Value:
    """A returned value as the decorator describes it."""

    def __init__(self, data_type, middleware, topic, options):
        self.data_type, self.middleware, self.topic, self.options = data_type, middleware, topic, options
        #: Class of the messages, where the type is a dataclass of ``ros.message``.
        self.message_class = None
        written = options.get("message_type")
        if isinstance(written, type):
            self.message_class, options["message_type"] = written, written.ROS_TYPE

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
        _check(options)
        # Both carry dicts, of the type that the option message_type names.
        data_type = "ROSMessage" if data_type == "ROS2Message" else data_type
        return cls(data_type, middleware, topic, options)

    @property
    def is_untyped(self):
        """Whether messages of ROS tell their type themselves."""
        return self.data_type == "ROSMessage" and "message_type" not in self.options

    def of_class(self, one):
        """A message as a listener returns it."""
        return self.message_class.from_fields(one) if self.message_class and isinstance(one, dict) else one

    def nothing(self):
        """What a listener returns where nothing has come."""
        return (None, self.options.get("rate", 44100)) if self.data_type == "AudioChunk" else None


def open_ends(method, mode, args, kwargs, returned=()):
    """Opens the ends of a method for a mode; ``args`` and ``kwargs`` are those of the call, without the instance, and
    ``returned`` what the method returned, where its messages tell their types."""
    if mode == "disable":
        return None
    parameters = inspect.signature(method.function).parameters.values()
    named = {one.name: one.default for one in parameters if one.default is not one.empty}
    named.update(kwargs)
    replace = _Replacement(method.function.__qualname__, args, named).replace
    values = [_resolved(value, replace, mode, method.has_feedback) for value in method.all_values()]
    for (data_type, _, _, options, _), message in zip(values, returned):
        if data_type == "ROSMessage" and ros_type(message) is not None:
            options.setdefault("message_type", ros_type(message))
    if mode == "transceive" and all(_is_echo(topic, options) for _, _, topic, options, _ in values):
        # Wrapyfi's listener hears its own publisher, which has a listener with it.
        mode, values = "publish", [(*one[:3], {**one[3], "should_wait": False}, one[4]) for one in values]
    _log.start()
    return _native.open(method.function.__qualname__, mode, values)


def opened(name, mode, value, has_feedback=True):
    """The ends of one value that no method has. Raises ``OpenError`` where its middleware is not here."""
    _log.start()
    ends = _native.open(name, mode, [_resolved(value, lambda written: written, mode, has_feedback)])
    (why,) = ends.absent()
    if why is not None:
        ends.close()
        raise OpenError(f"{name}: {why}")
    cancelled_with_task(ends)
    return ends


def cancelled_with_task(wait):
    """What has a method ``cancel``, which is called where the task is cancelled that this is a part of."""
    if (opened_by_task := OPENED.get()) is not None:
        opened_by_task.append(wait)
    return wait


def _check(options):
    """Warns of options that are nobody's and nearly the name of one; others may be those of a plug-in."""
    known = _native.option_names()
    for name, option in options.items():
        if name not in known:
            import difflib

            for meant in difflib.get_close_matches(name, known, 1, 0.75):
                _LOG.warning("register: %r is no option and has no effect; did you mean %r?", name, meant)
        elif isinstance(option, dict) and name in ("listener_kwargs", "publisher_kwargs"):
            _check(option)


def _is_echo(topic, options):
    """Whether what is published is what is listened to."""
    there = (options.get("publisher_kwargs") or {}).get("out_topic", options.get("out_topic", topic))
    here = (options.get("listener_kwargs") or {}).get("in_topic", options.get("in_topic", topic))
    return there == here


def _resolved(value, replace, mode, has_feedback):
    middleware, topic = replace(value.middleware), replace(value.topic)
    options = {name: replace(option) for name, option in value.options.items()}
    if not _is_here(middleware, value.data_type, topic):
        middleware = None
    data_type = value.data_type
    if middleware == "ros2" and mode not in ("request", "reply") and data_type in _ON_ROS_2:
        options.setdefault("message_type", _ON_ROS_2[data_type])
    if value.is_untyped and mode in ("listen", "receive") and middleware is not None:
        options["message_type"] = _native.topic_type(f"{middleware}:{topic}", None)[-1]
    if data_type == "Action" and not has_feedback:
        data_type = "PlainAction"
    return data_type, middleware, str(topic), options, Codec(value.data_type, options)


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
