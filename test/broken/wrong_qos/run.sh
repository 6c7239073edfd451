#!/usr/bin/env bash
# The publisher is best effort, the route asks for reliable.
source "$(dirname "$0")/../common.sh"
publisher sensor --topic /scan --type std_msgs/msg/String --text near --best-effort
why scan "$@"
