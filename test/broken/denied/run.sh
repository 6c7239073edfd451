#!/usr/bin/env bash
# The pattern leaves the topic out.
source "$(dirname "$0")/../common.sh"
publisher camera --topic /camera/raw --type std_msgs/msg/String --text picture
why ros2:/camera/raw "$@"
