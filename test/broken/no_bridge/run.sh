#!/usr/bin/env bash
# Everything is there but the bridge.
source "$(dirname "$0")/../common.sh"
echo "127.0.0.1 10000 yarp" >"$scratch/yarp.conf"
start server "$wrapyfi" yarpserver --no-discovery
until_said server "name server /root on"
publisher talker --topic /chatter --type std_msgs/msg/String --text hello
why back "$@"
