"""Wrapyfi's decorator on a core in Rust: ZeroMQ, YARP, ROS 1 and ROS 2 after one ``pip install``.

    from wrapyfi_rs.connect.wrapper import MiddlewareCommunicator

    class Camera(MiddlewareCommunicator):
        @MiddlewareCommunicator.register("Image", "ros2", "Camera", "/camera", width=640, height=480)
        def frame(self):
            return read_camera(),

    camera = Camera()
    camera.activate_communication("frame", mode="publish")

A script that says ``import wrapyfi`` runs unchanged by ``python -m wrapyfi_rs script.py``, or with ``WRAPYFI_RS=1`` in
its environment.
"""

import os
from typing import TYPE_CHECKING

from . import _native
from .utils.core_utils import Plugin, PluginRegistrar

__version__ = _native.version()
# Without the functions below, one of which is called list: what a script of Wrapyfi's may take with a star.
__all__ = ["Plugin", "PluginRegistrar"]

if TYPE_CHECKING:
    from .graph import call, echo, list, send_goal, why  # noqa: A004

os.register_at_fork(after_in_child=_native.forked)


def __getattr__(name):
    # Imported when one of them is wanted: most scripts want none.
    if name in ("call", "echo", "list", "send_goal", "why"):
        from . import graph

        return getattr(graph, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
