#!/usr/bin/env bash
# A node publishes the topic under a name that differs in a capital letter.
source "$(dirname "$0")/../common.sh"
publisher talker --topic /Chatter --type std_msgs/msg/String --text hello
why talk "$@"
