#!/usr/bin/env bash
# The publisher is connected, and sends a message a minute.
source "$(dirname "$0")/../common.sh"
start bridge "$wrapyfi" bridge --config "$config" --json
until_said bridge "1 routes from"
start listener "$wrapyfi" echo zeromq:/chatter --type Text
publisher talker --topic /chatter --type std_msgs/msg/String --text hello --rate 0.01
until_said bridge "talk.*active"
# Until its first message is none of the last second: a status comes once a second.
until [ "$(grep -c '"received":1,' "$scratch/bridge")" -ge 4 ]; do
    sleep 0.1
done
why talk "$@"
