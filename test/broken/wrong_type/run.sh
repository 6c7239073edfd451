#!/usr/bin/env bash
# The route has another type than the topic.
source "$(dirname "$0")/../common.sh"
publisher talker --topic /chatter --type std_msgs/msg/String --text hello
why talk "$@"
