#!/usr/bin/env bash
# The master was killed; its nodes still run.
source "$(dirname "$0")/../common.sh"
export ROS_MASTER_URI=http://127.0.0.1:11311 ROS_IP=127.0.0.1
start master /usr/bin/python3 "$peers/rospy_peer.py" master --port 11311
until_said master ready
master=${started[-1]}
start talker /usr/bin/python3 "$peers/rospy_peer.py" publish --topic /chatter --value '{"data": "hello"}'
until_said talker ready
kill -KILL "$master"
why talk "$@"
