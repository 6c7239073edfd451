#!/usr/bin/env bash
# The node was killed, and the master still has its name.
source "$(dirname "$0")/../common.sh"
export ROS_MASTER_URI=http://127.0.0.1:11311 ROS_IP=127.0.0.1
start master /usr/bin/python3 "$peers/rospy_peer.py" master --port 11311
until_said master ready
start talker /usr/bin/python3 "$peers/rospy_peer.py" publish --topic /chatter --value '{"data": "hello"}'
until_said talker ready
kill -KILL "${started[-1]}"
why talk "$@"
