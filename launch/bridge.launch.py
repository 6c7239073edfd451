"""Starts the bridge: ros2 launch wrapyfi bridge.launch.py config_file:=/path/to/routes.yaml"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    example = PathJoinSubstitution([FindPackageShare("wrapyfi"), "config", "example.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "config_file",
                default_value=example,
                description="Routes and endpoints; the installed example explains every key",
            ),
            DeclareLaunchArgument(
                "namespace",
                default_value="",
                description="Namespace of the node and of every relative name in it",
            ),
            DeclareLaunchArgument(
                "autostart",
                default_value="true",
                choices=["true", "false"],
                description="false: wait until others configure and activate the node",
            ),
            DeclareLaunchArgument(
                "log_level",
                default_value="info",
                description="debug, info, warn, error or fatal",
            ),
            Node(
                package="wrapyfi_bridge",
                executable="bridge",
                namespace=LaunchConfiguration("namespace"),
                # Declared a string: launch would read a bare file name such as 1.5 as a number.
                parameters=[
                    {
                        "config_file": ParameterValue(LaunchConfiguration("config_file"), value_type=str),
                        "autostart": ParameterValue(LaunchConfiguration("autostart"), value_type=bool),
                    }
                ],
                ros_arguments=["--log-level", LaunchConfiguration("log_level")],
                output="screen",
            ),
        ]
    )
