#!/usr/bin/env bash
# The broker's host name is known to the robot alone.
source "$(dirname "$0")/../common.sh"
start broker "$wrapyfi" broker
until_said broker "listeners connect to port"
why camera "$@"
