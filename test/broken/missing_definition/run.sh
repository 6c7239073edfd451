#!/usr/bin/env bash
# A node publishes a type that only its own machine has, and does not describe it.
source "$(dirname "$0")/../common.sh"
publisher node --topic /odd --type geometry_msgs/msg/PolygonInstance --fields '{"polygon":{"points":[]},"id":1}'
why odd "$@"
