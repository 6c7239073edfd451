#!/usr/bin/env bash
# A node publishes a type of a package that only its own machine has.
source "$(dirname "$0")/../common.sh"
mkdir -p "$scratch/there/demo/msg"
echo "int32 number" >"$scratch/there/demo/msg/Odd.msg"
start node "$wrapyfi" pub ros2:/odd --type demo/msg/Odd --definitions "$scratch/there" --value '{"number": 1}'
why odd "$@"
