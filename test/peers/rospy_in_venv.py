"""Debian's rospy for an interpreter that has Wrapyfi, and the messages of Wrapyfi's package for ROS 1.

Debian's packages come last, so that they hide none of the interpreter's own. Nobody ships
`wrapyfi_ros_interfaces` compiled: genpy makes its classes from the definitions.
"""
import sys
import types

sys.path.append("/usr/lib/python3/dist-packages")

import genmsg.gentools  # noqa: E402
import genmsg.msg_loader  # noqa: E402
import genpy.dynamic  # noqa: E402

HEADER = """
================================================================================
MSG: std_msgs/Header
uint32 seq
time stamp
string frame_id
"""
AUDIO = """std_msgs/Header header
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


def _make(name, definition):
    full = f"wrapyfi_ros_interfaces/{name}"
    return genpy.dynamic.generate_dynamic(full, definition)[full]


ROSAudioMessage = _make("ROSAudioMessage", AUDIO + HEADER)


def _service_md5(name, definition):
    """As genmsg has it."""
    context = genmsg.msg_loader.MsgContext.create_default()
    for full, text in (("std_msgs/Header", HEADER.split("Header\n", 1)[1]),
                       ("wrapyfi_ros_interfaces/ROSAudioMessage", AUDIO)):
        context.register(full, genmsg.msg_loader.load_msg_from_string(context, text, full))
    spec = genmsg.msg_loader.load_srv_from_string(context, definition, f"wrapyfi_ros_interfaces/{name}")
    return genmsg.gentools.compute_md5(context, spec)


class ROSAudioService:
    _type = "wrapyfi_ros_interfaces/ROSAudioService"
    _md5sum = _service_md5("ROSAudioService",
                           "string request\n---\nwrapyfi_ros_interfaces/ROSAudioMessage response\n")
    _request_class = _make("ROSAudioServiceRequest", "string request\n")
    _response_class = _make(
        "ROSAudioServiceResponse",
        "wrapyfi_ros_interfaces/ROSAudioMessage response\n"
        "\n" + "=" * 80 + "\nMSG: wrapyfi_ros_interfaces/ROSAudioMessage\n" + AUDIO + HEADER)


package = types.ModuleType("wrapyfi_ros_interfaces")
package.msg = types.ModuleType("wrapyfi_ros_interfaces.msg")
package.msg.ROSAudioMessage = ROSAudioMessage
package.srv = types.ModuleType("wrapyfi_ros_interfaces.srv")
package.srv.ROSAudioService = ROSAudioService
for module in (package, package.msg, package.srv):
    sys.modules[module.__name__] = module
