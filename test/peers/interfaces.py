"""ROS 2 interfaces for the peers: rosbags' type store plus this repository's own .msg files."""
import pathlib

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROOT = pathlib.Path(__file__).resolve().parents[2]

# Python Wrapyfi's published message (package wrapyfi_ros2_interfaces 0.4.30); ours has the same fields.
UPSTREAM_AUDIO = """
std_msgs/Header header
uint32 chunk_size
uint8 channels
uint32 sample_rate
string encoding
uint8 is_bigendian
uint32 bitrate
string coding_format
uint32 step
uint8[] data
"""


def store():
    types = get_typestore(Stores.ROS2_JAZZY)
    own = get_types_from_msg(UPSTREAM_AUDIO, "wrapyfi_ros2_interfaces/msg/ROS2AudioMessage")
    own.update(get_types_from_msg(UPSTREAM_AUDIO, "wrapyfi_msgs/msg/AudioChunk"))
    for folder in ("wrapyfi_msgs/msg", "wrapyfi_ros2_interfaces/msg"):
        package = folder.split("/")[0]
        for path in sorted((ROOT / folder).glob("*.msg")):
            own.update(get_types_from_msg(path.read_text(), f"{package}/msg/{path.stem}"))
    types.register(own)
    return types


def dds_name(ros_type):
    """`sensor_msgs/msg/Image` as DDS writes it: `sensor_msgs::msg::dds_::Image_`."""
    package, kind, name = ros_type.split("/")
    return f"{package}::{kind}::dds_::{name}_"
