"""Wrapyfi's decorator: a method that publishes, listens, asks or answers, as its mode says."""

import atexit
import functools
import inspect
import os
import threading
import weakref
from collections.abc import Callable
from typing import Any

from .. import _native
from .._ends import Value, open_ends
from ..config.manager import ConfigManager
from ..errors import ModeError, ReturnError

DEFAULT_COMMUNICATOR = os.environ.get("WRAPYFI_DEFAULT_COMMUNICATOR", "zeromq")
DEFAULT_COMMUNICATOR = os.environ.get("WRAPYFI_DEFAULT_MWARE", DEFAULT_COMMUNICATOR)

MODES = ("publish", "listen", "receive", "reemit", "transceive", "request", "reply", "disable", "none")


class _Method:
    """A registered method: its values, the top decorator's first, and the instances that have a mode, in their order."""

    def __init__(self, function):
        self.function = function
        self.values = []
        self.instances = []

    @property
    def has_feedback(self):
        """Whether the method is an action that tells how far it is, through its argument ``feedback``."""
        return self.is_action and "feedback" in inspect.signature(self.function).parameters

    @property
    def is_action(self):
        """Whether the method is an action: its arguments are a goal, and what it returns is the result."""
        return any(value.data_type == "Action" for value in self.all_values())

    def number(self, instance):
        """Number of an instance, counted from 0 in the order in which modes were chosen."""
        if id(instance) not in self.instances:
            self.instances.append(id(instance))
        return self.instances.index(id(instance))

    def flat(self, returned):
        """The values of what the method returned, those of lists one after the other."""
        if not isinstance(returned, (tuple, list)):
            kind = type(returned).__name__
            raise ReturnError(
                f"{self.function.__qualname__} returned {kind}, and is to return a tuple of {len(self.values)}: "
                "write `return value,`"
            )
        if len(returned) != len(self.values):
            raise ReturnError(
                f"{self.function.__qualname__} returned {len(returned)} values, and is registered for {len(self.values)}"
            )
        flat = []
        for value, part in zip(self.values, returned):
            flat.extend(part) if isinstance(value, list) else flat.append(part)
        return flat

    def nested(self, flat):
        """The shape of what the method returns, filled with values one after the other."""
        parts = iter(flat)
        return [[next(parts) for _ in value] if isinstance(value, list) else next(parts) for value in self.values]

    def all_values(self):
        """All values, those of lists one after the other."""
        return [one for value in self.values for one in (value if isinstance(value, list) else [value])]


class _State:
    """The mode of a method of one instance, and its ends once a call has opened them."""

    def __init__(self):
        self.mode, self.ends, self.lock = None, None, threading.Lock()

    def close(self):
        ends, self.ends = self.ends, None
        if ends is not None:
            ends.close()

    def cancel(self):
        """Ends the waits that have begun."""
        ends = self.ends
        if ends is not None:
            ends.cancel()


class _Registry:
    """What there is, in the form in which Wrapyfi's own tests look at it."""

    def __init__(self):
        self.methods = {}

    def __getitem__(self, name):
        method = self.methods[name]
        return {"__WRAPYFI_INSTANCES": [hex(instance) for instance in method.instances]}

    def __contains__(self, name):
        base, dot, number = name.rpartition(".")
        if dot and number.isdigit():
            return base in self.methods and 2 <= int(number) <= len(self.methods[base].instances)
        return name in self.methods


_REGISTRY = _Registry()
_INSTANCES = weakref.WeakValueDictionary()


class MiddlewareCommunicator:
    """Base of classes with registered methods."""

    _MiddlewareCommunicator__registry = _REGISTRY

    def __init__(self):
        modes = ConfigManager(None).config.get(type(self).__name__) or {}
        for name, mode in modes.items():
            self.activate_communication(getattr(type(self), name), mode)

    @classmethod
    def register(cls, data_type: str | list, middleware: str = DEFAULT_COMMUNICATOR, *args: Any, **kwargs: Any):
        """Registers a returned value of a method.

        One decorator stands for each value of the returned tuple, the first on top. ``args`` are the name of the class
        and the topic. In texts ``$0`` or ``$name`` is an argument of the first call. A value that is a list is
        written as a list of ``[data_type, middleware, class_name, topic, {options}]``. An ``async def`` stays one: its
        waits are awaited.

        ``data_type`` is ``NativeObject``, any of Python's own objects and those of plug-ins; ``Image``, an array of shape
        (height, width) or (height, width, 3), bytes in the order blue, green, red, or with ``fp=True`` float32;
        ``AudioChunk``, a pair of a float32 array of shape (samples,) or (samples, channels) and its rate in Hz;
        ``ROSMessage`` or ``ROS2Message``, a dict or a class of ``wrapyfi_rs.ros.message``, with the option
        ``message_type``, which in modes request and reply is a service; ``Action``, with the option ``action_type``: the
        arguments are the goal's fields, a dict of the result's fields is returned, and an argument ``feedback`` tells
        how far the goal is: ``feedback.send({…})`` and ``feedback.is_canceled`` where the method serves, a function of
        the caller's where it asks.
        """
        if isinstance(data_type, str):
            value = Value.of(data_type, middleware, args, kwargs)
        elif isinstance(data_type, list):
            value = []
            for kind, mware, *rest in data_type:
                options = [part for part in rest if isinstance(part, dict)]
                value.append(Value.of(kind, mware, [part for part in rest if part not in options], *options))
        else:
            raise NotImplementedError(f"a data type of type {type(data_type).__name__}: a name, or a list of lists")

        def registered(function):
            method = getattr(function, "__wrapyfi_method__", None)
            if method is not None:
                method.values.insert(0, value)
                return function
            method = _Method(function)
            method.values.append(value)
            _REGISTRY.methods[function.__qualname__] = method

            @functools.wraps(function)
            def wrapper(*args, **kwargs):
                state = _state_of(args[0], method) if args else None
                if state is None or state.mode is None:
                    return function(*args, **kwargs)
                return _CALLS[state.mode](_Call(method, state, args, kwargs))

            @functools.wraps(function)
            async def awaited(*args, **kwargs):
                import asyncio  # here, because it takes longer than all the rest

                from .._tasks import in_thread

                state = _state_of(args[0], method) if args else None
                if state is None or state.mode is None:
                    return await function(*args, **kwargs)
                mode, loop = state.mode, asyncio.get_running_loop()
                return await in_thread(lambda: _CALLS[mode](_Call(method, state, args, kwargs, loop)), [state])

            chosen = awaited if inspect.iscoroutinefunction(function) else wrapper
            chosen.__wrapyfi_method__ = method
            return chosen

        return registered

    def activate_communication(self, func: str | Callable, mode: str | None | list) -> None:
        """Chooses the mode of a method, given itself or by name: a mode for this instance, or a list with one for each."""
        if isinstance(func, str):
            func = getattr(self, func)
        method = getattr(func, "__wrapyfi_method__", None)
        if method is None:
            raise ModeError(f"{getattr(func, '__qualname__', func)} is not registered")
        number = method.number(self)
        if isinstance(mode, (list, tuple)):
            if number >= len(mode):
                raise IndexError(
                    f"modes of {func.__qualname__} are listed for {len(mode)} instances, and this is number {number + 1}"
                )
            mode = mode[number]
        if mode is not None and mode not in MODES:
            raise ModeError(f"{mode!r} is no mode; modes are {', '.join(MODES)}")
        _INSTANCES[id(self)] = self
        state = self.__dict__.setdefault("_wrapyfi_states", {}).setdefault(method, _State())
        with state.lock:
            state.mode = None if mode == "none" else mode
            state.close()

    def close(self):
        """Closes the ends of this instance; its methods are as if no mode had been chosen."""
        for method, state in self.__dict__.pop("_wrapyfi_states", {}).items():
            if id(self) in method.instances:
                method.instances.remove(id(self))
            state.close()

    @staticmethod
    def get_communicators():
        """The middlewares that are here."""
        return set(_native.middlewares())

    @classmethod
    def close_all_instances(cls):
        """Closes every instance of every class."""
        for instance in list(_INSTANCES.values()):
            instance.close()

    @classmethod
    def close_instance(cls, instance_addr=None):
        """Closes the instance with this ``hex(id(instance))``, or all."""
        for instance in list(_INSTANCES.values()):
            if instance_addr in (None, hex(id(instance))):
                instance.close()

    def __del__(self):
        # At the end of the program, modules may have gone before their instances.
        if hasattr(self, "__dict__"):
            self.close()


atexit.register(MiddlewareCommunicator.close_all_instances)


def _state_of(instance, method):
    states = getattr(instance, "_wrapyfi_states", None)
    return states.get(method) if isinstance(states, dict) else None


class _Call:
    """One call of a registered method."""

    def __init__(self, method, state, args, kwargs, loop=None):
        self.method, self.state, self.args, self.kwargs, self.loop = method, state, args, kwargs, loop
        self.ends = state.ends
        if self.ends is None and not (state.mode == "publish" and any(v.is_untyped for v in method.all_values())):
            self.open()

    def open(self, returned=()):
        """Opens the ends; messages of ROS that were ``returned`` may tell their types."""
        with self.state.lock:
            if self.state.ends is None:
                self.state.ends = open_ends(self.method, self.state.mode, self.args[1:], self.kwargs, returned)
            self.ends = self.state.ends

    def body(self, *more):
        """What the method itself returns; with arguments after those of the call."""
        return self.run(*self.args, *more, **self.kwargs)

    def run(self, *args, **kwargs):
        """What the method returns for these arguments; of a coroutine, what it returns in the loop of the call."""
        returned = self.method.function(*args, **kwargs)
        if self.loop is not None:
            import asyncio

            return asyncio.run_coroutine_threadsafe(returned, self.loop).result()
        return returned

    def received(self):
        """What other programs published, in the shape of what the method returns."""
        heard = self.ends.listen()
        values = zip(self.method.all_values(), heard)
        return self.method.nested([value.nothing() if one is None else value.of_class(one) for value, one in values])

    def publish(self, returned):
        self.ends.publish(self.method.flat(returned))


def _publish(call):
    if call.ends is None:
        returned = call.body()
        call.open(call.method.flat(returned))
        call.ends.await_listeners()
        call.publish(returned)
        return returned
    call.ends.await_listeners()
    returned = call.body()
    call.publish(returned)
    return returned


def _reemit(call):
    received = call.received()
    call.ends.await_listeners()
    returned = call.body(*received)
    call.publish(returned)
    return returned


def _transceive(call):
    returned = _publish(call)
    if not call.ends.listens():
        return call.method.nested(call.method.flat(returned))
    return call.received()


def _request(call):
    kwargs = dict(call.kwargs)
    feedback = kwargs.pop("feedback", None) if call.method.has_feedback else None
    replies = call.ends.call(call.args[1:], kwargs, feedback)
    values = zip(call.method.all_values(), replies)
    return call.method.nested([value.of_class(one) for value, one in values])


def _reply(call):
    if not call.ends.serves():
        return call.body()
    returned = None

    def body(args, kwargs, feedback):
        nonlocal returned
        if call.method.has_feedback:
            kwargs = {**kwargs, "feedback": feedback}
        returned = call.run(call.args[0], *args, **kwargs)
        return call.method.flat(returned)

    served = call.ends.serve(body)
    return returned if served else _nothing(call)


def _nothing(call):
    return call.method.nested([None] * len(call.method.all_values()))


_CALLS = {
    "publish": _publish,
    "listen": _Call.received,
    "receive": lambda call: call.body(*call.received()),
    "reemit": _reemit,
    "transceive": _transceive,
    "request": _request,
    "reply": _reply,
    "disable": _nothing,
}


def _after_fork():
    """The ends of the parent are not those of the child, which opens its own at its next call."""
    for instance in list(_INSTANCES.values()):
        for state in instance.__dict__.get("_wrapyfi_states", {}).values():
            ends, state.ends, state.lock = state.ends, None, threading.Lock()
            if ends is not None:
                ends.forget()


os.register_at_fork(after_in_child=_after_fork)
