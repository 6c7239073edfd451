"""Messages of ROS as objects: those of ``rospy``, of ``rclpy``, and of ``wrapyfi_rs.ros``."""

import array


def ros_type(message):
    """The name of a message's type, for instance ``geometry_msgs/msg/Pose``; None for other objects."""
    cls = type(message)
    if hasattr(cls, "ROS_TYPE"):
        return cls.ROS_TYPE
    if hasattr(cls, "get_fields_and_field_types"):
        return f"{cls.__module__.partition('.')[0]}/msg/{cls.__name__}"
    if hasattr(cls, "_slot_types"):
        return cls._type.replace("/", "/msg/")
    return None


def fields_of(message):
    """The fields of a message as a dict with dicts inside; other objects as they are."""
    cls = type(message)
    if hasattr(cls, "ROS_TYPE"):
        return message.to_fields()
    if hasattr(cls, "get_fields_and_field_types"):
        return {name: fields_of(getattr(message, name)) for name in cls.get_fields_and_field_types()}
    if hasattr(cls, "_slot_types"):
        # Its place in the row of messages, which ROS 2 has no more.
        without = {"seq"} if cls._type == "std_msgs/Header" else set()
        return {name: fields_of(getattr(message, name)) for name in cls.__slots__ if name not in without}
    if cls.__module__ == "genpy.rostime":
        return {"sec": message.secs, "nanosec": message.nsecs}
    if isinstance(message, array.array):
        return message.tolist()
    if isinstance(message, (list, tuple)):
        return [fields_of(one) for one in message]
    return message
