#!/usr/bin/env bash
# Three routes make a circle.
source "$(dirname "$0")/../common.sh"
start bridge "$wrapyfi" bridge --config "$config"
until_said bridge "3 routes from"
start talker "$wrapyfi" pub ros2:/state --type NativeObject --value '{"n": 1}' --rate 20
until_said bridge "out.*active"
why over "$@"
