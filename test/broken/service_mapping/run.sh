#!/usr/bin/env bash
# The server's middleware maps services to DDS in another way than the bridge's.
source "$(dirname "$0")/../common.sh"
start server "${WRAPYFI_FAST_PEER:?names no program: the tests compile it from test/peers/fast_peer}" \
    server --topic /add --type example_interfaces/srv/AddTwoInts
until_said server ready
why add "$@"
