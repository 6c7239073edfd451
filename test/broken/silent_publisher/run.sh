#!/usr/bin/env bash
# The publisher is connected, and sends a message a minute.
source "$(dirname "$0")/../common.sh"
start bridge "$wrapyfi" bridge --config "$config"
until_said bridge "1 routes from"
start listener "$wrapyfi" echo zeromq:/chatter --type Text
publisher talker --topic /chatter --type std_msgs/msg/String --text hello --rate 0.01
until_said bridge "talk.*active"
# Until its first message is none of the last second.
sleep 2.5
why talk "$@"
