"""A check of `ros2 doctor`: routes and middlewares of the bridges on the graph, by what these say on /diagnostics.

    a bridge ─ /diagnostics, once a second ─▶ ros2 doctor: what waits or fails, with the reason
"""
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from ros2cli.node.direct import DirectNode
from ros2doctor.api import DoctorCheck, Result
from ros2doctor.api.format import doctor_error, doctor_warn

import rclpy
from rclpy.qos import qos_profile_system_default

# Keys that the status of a route has, and of no other program.
OF_ROUTE = {"from", "to", "dropped", "latency_p50_us"}
# A route without a listener rests, as it should.
AT_REST = "nobody_listens"
# Time in seconds within which every bridge has told its state twice.
LISTEN_S = 2.5


def statuses():
    """The last status of each route and middleware on the graph, by its name; blocks for LISTEN_S."""
    told, bridges = {}, set()

    def heard(array):
        for one in array.status:
            told[one.name] = one
            if OF_ROUTE <= {pair.key for pair in one.values}:
                bridges.add(one.name.split(":")[0])

    with DirectNode(None) as node:
        node.node.create_subscription(DiagnosticArray, "/diagnostics", heard, qos_profile_system_default)
        end = time.monotonic() + LISTEN_S
        while time.monotonic() < end:
            rclpy.spin_once(node.node, timeout_sec=0.1)
    # A bridge tells of its middlewares under the same name.
    return {name: one for name, one in told.items() if name.split(":")[0] in bridges}


class RoutesCheck(DoctorCheck):
    """Warns of each route and middleware that waits or is degraded, and fails for one with an error."""

    def category(self):
        """Word of the summary."""
        return "wrapyfi"

    def check(self):
        """Looks once."""
        result = Result()
        for name, status in sorted(statuses().items()):
            if any(pair.key == "cause" and pair.value == AT_REST for pair in status.values):
                continue
            if status.level == DiagnosticStatus.ERROR:
                doctor_error(f"{name}: {status.message}")
                result.add_error()
            elif status.level == DiagnosticStatus.WARN:
                doctor_warn(f"{name}: {status.message}")
                result.add_warning()
        return result
