"""What exists, what is said there, and why nothing is: the commands of ``wrapyfi`` as functions.

    for message in echo("ros2:/chatter", count=3): print(message)
    call("ros2:/light", data=True)
    for endpoint in list(): print(endpoint["middleware"], endpoint["name"], endpoint["role"], endpoint["type"])
    print(why("ros2:/chatter"))

Addresses are ``middleware:/name``, as on the command line. Times are in seconds.
"""

import builtins
import dataclasses
import json
from collections.abc import Callable, Iterator
from typing import Any

from . import _native, connect  # noqa: F401  which looks for plug-ins
from ._ends import Value, cancelled_with_task, opened
from .errors import CallError, OptionError, WaitTimeout


def echo(
    endpoint: str, data_type: "str | type | None" = None, *, count: int | None = None, timeout: float | None = None,
    **options: Any,
) -> Iterator[Any]:
    """The messages of a topic, one after the other as they come.

    ``data_type`` is ``NativeObject``, ``Image``, ``AudioChunk``, a type of ROS by name, or a class of ``ros.message``;
    without it the type that the topic's ends tell. An image is an array of shape (height, width) or (height, width,
    channels); sound is a pair of an array of shape (samples, channels) and its rate in Hz; a message of ROS is a dict,
    or an instance of the class. Ends after ``count`` messages; raises ``WaitTimeout`` where the next one does not come
    within ``timeout``, and ``OpenError`` where the middleware is not here. ``options`` are those of ``register``.
    """
    if data_type is None:
        data_type, options = _told(_native.topic_type(endpoint, timeout, _look()), options)
    value = _value(endpoint, data_type, {"should_wait": True, **_time(timeout), **options})
    ends = opened(f"echo {endpoint}", "listen", value)
    heard = 0
    try:
        while count is None or heard < count:
            (one,) = ends.listen()
            yield value.of_class(one)
            heard += 1
    finally:
        ends.close()


def call(
    endpoint: str, *args: Any, data_type: "str | None" = None, timeout: float = 5.0, **kwargs: Any
) -> Any:
    """The reply of a service to these arguments: fields of its request, or those of a function.

    ``data_type`` is the service's type, for instance ``std_srvs/srv/SetBool``; without it what its servers on ROS tell,
    elsewhere a function that returns a native object. Raises ``CallError`` where the server refuses or does not answer
    within ``timeout``.
    """
    options = _time(timeout)
    if data_type is None and _split(endpoint)[0] in ("ros", "ros2"):
        try:
            data_type, options = _told(_native.service_type(endpoint, timeout, _look()), options)
        except WaitTimeout as error:
            raise CallError(str(error)) from error
    ends = opened(f"call {endpoint}", "request", _value(endpoint, data_type or "NativeObject", options))
    try:
        (reply,) = ends.call(args, kwargs)
        return reply
    finally:
        ends.close()


def send_goal(
    endpoint: str, action_type: str | None = None, *args: Any, feedback: Callable[[dict[str, Any]], Any] | None = None,
    timeout: float | None = None, **kwargs: Any,
) -> dict[str, Any]:
    """The result of a goal of an action, a dict; the goal's fields are the arguments.

    ``action_type`` is for instance ``example_interfaces/action/Fibonacci``; without it what the servers on ROS tell.
    ``feedback`` is called with each feedback, a dict; what it raises cancels the goal, and so do Ctrl-C and ``timeout``.
    Raises ``CallError`` where the goal is rejected or does not succeed.
    """
    if action_type is None:
        try:
            action_type = _native.action_type(endpoint, 5.0 if timeout is None else timeout, _look())
        except WaitTimeout as error:
            raise CallError(str(error)) from error
    value = _value(endpoint, "Action", {"action_type": action_type, **_time(timeout)})
    ends = opened(f"goal {endpoint}", "request", value)
    try:
        (result,) = ends.call(args, kwargs, feedback)
        return result
    finally:
        ends.close()


def list(middleware: str | None = None, *, wait: float | None = None) -> "builtins.list[dict[str, Any]]":  # noqa: A001
    """The endpoints that exist now, of one middleware or of all: dicts with ``middleware``, ``name``, ``role``, and where
    they are known ``type``, ``node`` and ``qos``. Looks for ``wait``, else until all is told, at most for 3 s."""
    return [{"middleware": name, **json.loads(one)} for name, one in _native.endpoints(middleware, wait)]


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """What is in place on a way of messages, and the first thing that is missing; as text what ``wrapyfi why`` prints."""

    #: The ends, in words.
    way: str
    #: What is in place, in the order of the way.
    passed: "builtins.list[str]"
    #: Kind of the cause; None where nothing is missing.
    cause: str | None = None
    #: Cause, who could mend it, and how, in words.
    what: str | None = None
    who: str | None = None
    remedy: str | None = None
    text: str = dataclasses.field(default="", repr=False)

    def __str__(self):
        return self.text


def why(name: str, *, config: str | None = None, node: str | None = None) -> Diagnosis:
    """The first thing that is missing at an endpoint (``ros2:/chatter``), for a type (``geometry_msgs/msg/Twist``), or on
    a route of the file ``config``; ``node`` is a bridge that runs and is asked instead."""
    found, text = _native.why(name, config, node)
    return Diagnosis(**json.loads(found), text=text)


def _split(endpoint):
    middleware, colon, topic = endpoint.partition(":")
    if not (middleware and colon and topic):
        raise OptionError(f"{endpoint!r} is no endpoint: write it as ros2:/chatter")
    known = _native.middlewares()
    if middleware not in known:
        raise OptionError(f"{endpoint!r}: there is no middleware {middleware!r}, only {', '.join(known)}")
    return middleware, topic


def _look():
    return cancelled_with_task(_native.Look())


def _time(seconds):
    return {} if seconds is None else {"timeout_ms": round(seconds * 1000)}


def _told(told, options):
    """Data type and options for the type that the ends of a name tell."""
    data_type, name, *_ = told
    return "ROSMessage" if "/" in name else data_type, {"message_type": name, **options}


def _value(endpoint, data_type, options):
    middleware, topic = _split(endpoint)
    if not isinstance(data_type, str) or "/" in data_type:
        data_type, options = "ROSMessage", {**options, "message_type": data_type}
    return Value.of(data_type, middleware, (None, topic), options)
