#!/usr/bin/env bash
# The server's middleware maps services to DDS in another way than the bridge, which is limited to one.
source "$(dirname "$0")/../common.sh"
export RMW_IMPLEMENTATION=rmw_cyclonedds_cpp
start server "${WRAPYFI_FAST_PEER:?names no program: the tests compile it from test/peers/fast_peer}" \
    server --topic /add --type example_interfaces/srv/AddTwoInts
until_said server ready
why add "$@"
