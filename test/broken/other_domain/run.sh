#!/usr/bin/env bash
# The node was started with another ROS_DOMAIN_ID.
source "$(dirname "$0")/../common.sh"
ROS_DOMAIN_ID=12 publisher talker --topic /chatter --type std_msgs/msg/String --text hello
why talk "$@"
