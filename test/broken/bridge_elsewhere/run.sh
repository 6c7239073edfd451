#!/usr/bin/env bash
# The bridge was started with another ROS_DOMAIN_ID than its peers and this shell.
source "$(dirname "$0")/../common.sh"
echo "127.0.0.1 10000 yarp" >"$scratch/yarp.conf"
start server "$wrapyfi" yarpserver --no-discovery
until_said server "name server /root on"
publisher talker --topic /chatter --type std_msgs/msg/String --text hello
# From a copy, as on another machine: the processes of this one do not tell.
cp "$config" "$scratch/there.yaml"
start bridge env ROS_DOMAIN_ID=12 "$wrapyfi" bridge --config "$scratch/there.yaml" --json
until_said bridge '"name":"back"'
why back "$@"
