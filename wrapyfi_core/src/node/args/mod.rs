//! `--ros-args`: the command line every ROS 2 node understands.
