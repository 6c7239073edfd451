"""Messages of ROS as dataclasses, made from their definitions: no ROS is installed, nothing is compiled.

    Twist = message("geometry_msgs/msg/Twist")

    class Robot(MiddlewareCommunicator):
        @MiddlewareCommunicator.register("ROS2Message", "ros2", "Robot", "/cmd_vel", message_type=Twist)
        def velocity(self):
            twist = Twist()
            twist.linear.x = 0.5      # m/s
            return twist,
"""

import copy
import dataclasses
import functools
import keyword
from typing import Any, ClassVar

from . import _native
from ._objects import Codec

_NUMBERS = {"bool": bool, "float32": float, "float64": float, "string": str, "wstring": str}


class Message:
    """A message of ROS, with an attribute for each field; in metres, radians and seconds, where its package does not say otherwise."""

    #: Name of the type, for instance ``geometry_msgs/msg/Twist``.
    ROS_TYPE: ClassVar[str] = ""

    @classmethod
    def from_fields(cls, fields: dict[str, Any]) -> "Message":
        """The message with these fields, a dict with dicts inside; fields that are left out have their defaults."""
        made = cls()
        for field in dataclasses.fields(made):
            name, nested = field.metadata["ros"]
            if name in fields:
                value = fields[name]
                if nested is not None:
                    value = _nested(nested, value)
                setattr(made, field.name, value)
        return made

    def to_fields(self) -> dict[str, Any]:
        """The fields, as a dict with dicts inside."""
        fields = {}
        for field in dataclasses.fields(self):
            name, nested = field.metadata["ros"]
            value = getattr(self, field.name)
            if nested is not None:
                value = [one.to_fields() for one in value] if isinstance(value, list) else value.to_fields()
            fields[name] = value
        return fields


@functools.cache
def message(name: str) -> type[Message]:
    """The dataclass of a type of ROS, for instance ``message("sensor_msgs/msg/JointState")``.

    The definition is looked for in the packages that ``AMENT_PREFIX_PATH`` names, then among those that are built in.
    Numbers and texts are Python's, arrays of numbers NumPy's, other messages their dataclasses. Raises ``OptionError``
    where no definition is found.
    """
    found = {_short(ros_type): (ros_type, fresh, fields) for ros_type, fresh, fields in _definitions(name)}
    return _Maker(found).made(_short(name))


def _definitions(name):
    return _native.definitions(name, Codec("ROSMessage", {}))


def _short(name):
    return name.replace("/msg/", "/")


def _nested(cls, value):
    if isinstance(value, (list, tuple)):
        return [cls.from_fields(one) for one in value]
    return cls.from_fields(value)


class _Maker:
    """Makes the classes of a definition, each once."""

    def __init__(self, found):
        self.found, self.classes = found, {}

    def made(self, short):
        if short not in self.classes:
            ros_type, fresh, fields = self.found[short]
            described = [self.field(name, kind, fresh[name]) for name, kind in fields]
            text = f"``{ros_type}``: " + ", ".join(f"{kind} {name}" for name, kind in fields)
            namespace = {"ROS_TYPE": ros_type, "__doc__": text, "__module__": __name__}
            self.classes[short] = dataclasses.make_dataclass(
                ros_type.rpartition("/")[2], described, bases=(Message,), namespace=namespace
            )
        return self.classes[short]

    def field(self, name, kind, fresh):
        """Name, type and default of an attribute."""
        element, bracket, _ = kind.partition("[")
        nested = self.made(_short(element)) if _short(element) in self.found else None
        python = nested or _NUMBERS.get(element.partition("<")[0], int)
        if nested is not None:
            default = functools.partial(_nested, nested, fresh)
        else:
            default = functools.partial(copy.deepcopy, fresh)
        attribute = name + "_" if keyword.iskeyword(name) else name
        described = dataclasses.field(default_factory=default, metadata={"ros": (name, nested)})
        return attribute, (list[python] if bracket else python), described
