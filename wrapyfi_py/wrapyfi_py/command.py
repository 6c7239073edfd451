"""The command `ros2 wrapyfi`: the program `wrapyfi` under the name by which users of ROS 2 look for it.

    ros2 wrapyfi why /camera      the same as      ros2 run wrapyfi_bridge wrapyfi why /camera
"""
import argparse
import os
import shutil

from ros2cli.command import CommandExtension


def program():
    """The program of the first prefix of AMENT_PREFIX_PATH that has one, else that of PATH; None where there is none."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    places = [os.path.join(prefix, "lib", "wrapyfi_bridge") for prefix in prefixes if prefix]
    return shutil.which("wrapyfi", path=os.pathsep.join(places)) or shutil.which("wrapyfi")


class WrapyfiCommand(CommandExtension):
    """Bridges to YARP, ZeroMQ and ROS 1: run them, list, watch and explain what goes over them"""

    def add_arguments(self, parser, cli_name, *, argv=None):
        """Leaves everything behind the name to the program, `--help` too: to argparse, nothing begins an option."""
        parser.prefix_chars = "\0"
        parser.add_argument("arguments", nargs=argparse.REMAINDER)

    def main(self, *, parser, args):
        """Becomes the program, so that signals, terminal and exit code are its own."""
        found = program()
        if found is None:
            parser.error("there is no program wrapyfi: source the workspace that has wrapyfi_bridge, or install it")
        os.execv(found, [found, *args.arguments])
