"""Bridges all of one middleware: ros2 launch wrapyfi all_of.launch.py middleware:=ros1"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description():
    text = {
        name: ParameterValue(LaunchConfiguration(name), value_type=str)
        for name in ("config_file", "prefix")
    }
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "middleware",
                description="Whose topics and services are bridged into ROS 2 and back: ros1, yarp, zeromq",
            ),
            DeclareLaunchArgument(
                "prefix",
                default_value="",
                description="Put before names on the ROS 2 side, such as /lab",
            ),
            DeclareLaunchArgument(
                "config_file",
                default_value="",
                description="Routes and endpoints in place of everything",
            ),
            DeclareLaunchArgument(
                "namespace",
                default_value="",
                description="Namespace of the node",
            ),
            DeclareLaunchArgument(
                "log_level",
                default_value="info",
                description="debug, info, warn, error or fatal",
            ),
            Node(
                package="wrapyfi_bridge",
                executable=[LaunchConfiguration("middleware"), "_bridge"],
                namespace=LaunchConfiguration("namespace"),
                parameters=[text],
                ros_arguments=["--log-level", LaunchConfiguration("log_level")],
                output="screen",
            ),
        ]
    )
